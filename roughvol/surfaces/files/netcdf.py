"""Height maps in netCDF: names of dimensions give the axes, coordinates give size and unit.

Conventions: dimensions (y, x) are transposed, so that the first axis is x. Without such names the order of the file
stays. Dimensions of length 1 before them, as of one time, are left out. Both axes ascend with the index if they have
coordinates. Heights are positive up: those of a variable with the attribute ``positive = "down"``, as depths, are
turned over.

The reader of SurfaceTopography takes classic netCDF with a variable ``heights`` alone. It ignores the order of the
dimensions, and the attribute ``units``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from threading import RLock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.errors import SurfaceError
from roughvol.surfaces.files.description import Description, HeightMap, Request, array_name, length_unit, map_shape

_AXES = [re.compile(rf"(?:.*_)?(?:{name})", re.I) for name in ("x|lon|longitude|easting", "y|lat|latitude|northing")]
ENDINGS = (".nc", ".nc4", ".cdf")
CLASSIC = (b"CDF\1", b"CDF\2", b"CDF\5")  # first bytes of classic netCDF
HDF5 = b"\x89HDF\r\n\x1a\n"  # first bytes of HDF5, and so of netCDF 4
ONE_AT_A_TIME = RLock()  # netcdf-c crashes where two threads are in it
_EVEN = 1e-3  # largest distance of a coordinate from its node, in spacings
_SAME = 1e-4  # largest relative difference of a length from its coordinates


def opened(request: Request) -> HeightMap:
    """Return the map in a netCDF file."""
    from netCDF4 import Dataset

    ignored = request.ignore_header
    request.files.enter_context(ONE_AT_A_TIME)
    stored = request.files.enter_context(Dataset(request.path))
    name = _field(stored, request.variable)
    field = stored[name]
    if not _holds_numbers(field):
        raise SurfaceError(f"{name} holds text, or values of a type of its own, not numbers")
    down = _is_down(field, name)
    shape, of_map = map_shape(_shape(field)), field.dimensions[-2:]
    turned = [_axis(stored, dim) for dim in of_map] in ([1, 0], [1, None], [None, 0])
    dims, nodes = (of_map[::-1], (shape[1], shape[0])) if turned else (of_map, shape)
    x, y = (None if ignored else _coordinate(stored, dim) for dim in dims)
    masked = name == "heights" and "mask" in stored.variables and _shape(stored["mask"]) == shape
    sides, lateral, source, counted = None, None, "", False
    if x and y:
        if x.unit != y.unit:
            units = f"{x.name} is in {x.unit or 'no unit'}, {y.name} in {y.unit or 'no unit'}"
            raise SurfaceError(f"{units}; allowed: one unit for both")
        sides, lateral, source = (x.span, y.span), x.unit, f"coordinates {x.name} and {y.name}"
        counted = lateral is None and x.counted and y.counted
    flips = tuple(slice(None, None, -1 if axis and axis.falls else 1) for axis in (x, y))
    labelled = turned or any(axis and axis.falls for axis in (x, y)) or masked or sides is not None

    def heights() -> NDArray[Any]:
        values = np.ma.asarray(field[...]).reshape(shape)
        mask = np.ma.getmaskarray(values)
        if masked:  # as SurfaceTopography writes it
            mask = mask | (np.ma.filled(stored["mask"][...], 1).reshape(shape) != 0)
        filled = np.where(mask, np.nan, values.data) if mask.any() else np.asarray(values.data)
        return (-1.0 if down else 1.0) * (filled.T if turned else filled)[flips]

    described = Description(
        nodes,
        sides,
        lateral,
        None if ignored else _unit(field, name),
        name,
        "netCDF",
        ", ".join(["labels"] * labelled + ["down"] * down) or None,
        source,
        counted,
        notes=(f"has {name}:positive = 'down': its heights are turned over",) * down,
    )
    return HeightMap(described, heights)


def _holds_numbers(variable: Any) -> bool:
    """Return whether a variable holds numbers: no text, and no compound, enumerated or ragged type."""
    return isinstance(variable.datatype, np.dtype) and variable.dtype.kind in "fiu"


def _is_down(variable: Any, name: str) -> bool:
    """Return whether values are positive down, by the attribute of the CF conventions."""
    direction = str(getattr(variable, "positive", "up")).strip().lower()
    if direction not in ("up", "down"):
        raise SurfaceError(f"{name}:positive is {direction[:40]!r}; allowed: up and down")
    return direction == "down"


def _field(stored: Any, variable: str | None) -> str:
    """Return the name of the variable of heights; ``heights`` may have a ``mask`` beside it."""
    shapes = {name: _shape(array) for name, array in stored.variables.items()}
    fields = {name for name, shape in shapes.items() if len(shape) == 2}
    return "heights" if variable is None and fields == {"heights", "mask"} else array_name(variable, shapes)


def _shape(variable: Any) -> tuple[int, ...]:
    """Return the shape of a variable without the dimensions of length 1 before a map, as of one time."""
    shape: tuple[int, ...] = variable.shape
    return shape[-2:] if set(shape[:-2]) == {1} else shape


def _axis(stored: Any, dim: str) -> int | None:
    """Return 0 for x and 1 for y, by the attribute axis of the coordinate or the name of the dimension."""
    attribute = str(getattr(stored.variables.get(dim), "axis", "")).lower()
    if attribute in ("x", "y"):
        return "xy".index(attribute)
    return next((axis for axis, pattern in enumerate(_AXES) if pattern.fullmatch(dim)), None)


@dataclass(frozen=True)
class _Coordinate:
    """The coordinate of one axis."""

    name: str
    span: float
    unit: str | None
    falls: bool
    counted: bool  # 0, 1, 2 … or 1, 2, 3 …


def _coordinate(stored: Any, dim: str) -> _Coordinate | None:
    """Return the coordinate of a dimension, None without one; shares of a length (units "1") are none."""
    variable = stored.variables.get(dim)
    if variable is None or variable.dimensions != (dim,) or not _holds_numbers(variable) or variable.shape[0] < 3:
        return None
    if getattr(variable, "units", None) == "1":
        return None
    values = np.ma.filled(np.ma.asarray(variable[...], dtype=np.float64), np.nan)
    spacing = (values[-1] - values[0]) / (len(values) - 1)
    off = np.abs(values - (values[0] + spacing * np.arange(len(values)))).max()
    if not (spacing != 0.0 and off <= _EVEN * abs(spacing)):
        raise SurfaceError(f"the coordinate {dim} is not equidistant; allowed: a regular grid")
    length = getattr(variable, "length", None)  # of all pixels, as SurfaceTopography writes it
    if length is not None and abs(float(length) / len(values) - abs(spacing)) > _SAME * abs(spacing):
        raise SurfaceError(f"{dim}:length is {float(length):g}, its coordinate has a spacing of {spacing:g}")
    counted = bool(spacing == 1.0 and values[0] in (0.0, 1.0))
    span = abs(float(spacing)) * (len(values) - 1)
    return _Coordinate(dim, span, _unit(variable, dim), bool(spacing < 0.0), counted)


def _unit(variable: Any, name: str) -> str | None:
    for key in ("units", "unit"):
        if key in variable.ncattrs():
            return length_unit(variable.getncattr(key), f"{name}:{key}")
    return None
