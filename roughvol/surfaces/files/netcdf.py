"""Height maps in netCDF: the names of the dimensions say which axis is x, their coordinates give size and unit.

Conventions: dimensions (y, x) are transposed, so that the first axis is x; without such names the order of the file
stays. Both axes ascend with the index if they have coordinates.

This comes before the reader of SurfaceTopography, which takes classic netCDF with a variable ``heights`` alone, does
not look at the order of its dimensions, and knows the attribute ``unit`` but not ``units``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces.files.description import Description, HeightMap, chosen, length_unit, refuse_huge

_AXES = (
    re.compile(r"(?:.*_)?(?:x|lon|longitude|easting)", re.IGNORECASE),
    re.compile(r"(?:.*_)?(?:y|lat|latitude|northing)", re.IGNORECASE),
)
_EVEN = 1e-3  # of a spacing: by which a coordinate may lie off its node
_SAME = 1e-4  # by which a length and the coordinates beside it may differ


def opened(path: Path, variable: str | None = None, *, ignore_header: bool = False) -> HeightMap:
    """Return the map in a netCDF file; the heights are read when they are asked for.

    Raises
    ------
    DatasetError
        If the file cannot be read, or does not say which variable is meant.
    SurfaceError
        If the coordinates are not equidistant, or a unit is no unit of length.
    """
    from netCDF4 import Dataset

    with Dataset(path) as stored:
        name = _choice(path, stored, variable)
        held = stored[name]
        refuse_huge(path, held.shape)
        if len(held.shape) != 2:
            message = f"{path}: {name} has shape {held.shape}; allowed: two dimensions"
            raise SurfaceError(message)
        turned = bool(_axis(stored, held.dimensions[0]) == 1 or _axis(stored, held.dimensions[1]) == 0)
        if {_axis(stored, dim) for dim in held.dimensions} in ({0}, {1}):
            turned = False
        dims = held.dimensions[::-1] if turned else held.dimensions
        shape = held.shape[::-1] if turned else held.shape
        axes = [None if ignore_header else _coordinate(path, stored, dim) for dim in dims]
        unit = None if ignore_header else _unit(path, held, name)
        masked = name == "heights" and "mask" in stored.variables and stored["mask"].shape == held.shape
    sides, lateral, source, counted = None, None, "", False
    if axes[0] is not None and axes[1] is not None:
        if axes[0][1] != axes[1][1]:
            message = f"{path}: {dims[0]} is in {axes[0][1]}, {dims[1]} in {axes[1][1]}; allowed: one unit for both"
            raise SurfaceError(message)
        sides, lateral = (axes[0][0], axes[1][0]), axes[0][1]
        source, counted = f"coordinates {dims[0]} and {dims[1]}", lateral is None and axes[0][3] and axes[1][3]
    flips = tuple(slice(None, None, -1) if axis is not None and axis[2] else slice(None) for axis in axes)
    labelled = turned or flips != (slice(None), slice(None)) or masked or sides is not None
    described = Description(
        (shape[0], shape[1]), sides, lateral, unit, name, "netCDF", "labels" if labelled else None, source, counted
    )
    return HeightMap(described, lambda: _read(path, name, turned, flips, masked))


def _read(path: Path, name: str, turned: bool, flips: Any, masked: bool) -> NDArray[Any]:
    from netCDF4 import Dataset

    with Dataset(path) as stored:
        held = np.ma.asarray(stored[name][...])
        mask = np.ma.getmaskarray(held)
        if masked:  # as SurfaceTopography writes it
            mask = mask | (np.ma.filled(stored["mask"][...], 1) != 0)
    filled = mask.any() and held.dtype.kind in "fiu"
    array: NDArray[Any] = np.where(mask, np.nan, held.data) if filled else np.asarray(held.data)
    return (array.T if turned else array)[flips]


def _choice(path: Path, stored: Any, variable: str | None) -> str:
    """Return the name of the variable meant: the one named or numbered, or the only one with two dimensions."""
    shapes = {name: held.shape for name, held in stored.variables.items()}
    fields = [name for name, shape in shapes.items() if len(shape) == 2]
    if variable is None and "heights" in fields and set(fields) <= {"heights", "mask"}:
        return "heights"
    return choice(path, variable, shapes)


def choice(path: Path, variable: str | None, shapes: dict[str, tuple[int, ...]]) -> str:
    """Return the name of the array meant: the one named or numbered, or the only one with two dimensions."""
    fields = [name for name, shape in shapes.items() if len(shape) == 2]
    held = ", ".join(f"{name} {shape}" for name, shape in shapes.items()) or "none"
    if variable is None:
        if len(fields) == 1:
            return fields[0]
        message = f"{path}: which array holds the heights is not said (variable); arrays in the file: {held}"
        raise DatasetError(message)
    return list(shapes)[chosen(path, list(shapes), variable, held, "array")]


def _axis(stored: Any, dim: str) -> int | None:
    """Return 0 for a dimension that is x by its name or the attribute axis of its coordinate, 1 for y."""
    marked = str(getattr(stored.variables.get(dim), "axis", "")).lower()
    if marked in ("x", "y"):
        return "xy".index(marked)
    return next((axis for axis, pattern in enumerate(_AXES) if pattern.fullmatch(dim)), None)


def _coordinate(path: Path, stored: Any, dim: str) -> tuple[float, str | None, bool, bool] | None:
    """Return the span of a coordinate, its unit, whether it descends, and whether it only counts; None if absent."""
    held = stored.variables.get(dim)
    if held is None or held.dimensions != (dim,) or held.dtype.kind not in "fiu" or held.shape[0] < 3:
        return None
    values = np.ma.filled(np.ma.asarray(held[...], dtype=np.float64), np.nan)
    spacing = (values[-1] - values[0]) / (len(values) - 1)
    off = np.abs(values - (values[0] + spacing * np.arange(len(values)))).max()
    if not (spacing != 0.0 and off <= _EVEN * abs(spacing)):
        message = f"{path}: the coordinate {dim} is not equidistant; allowed: a regular grid"
        raise SurfaceError(message)
    length = getattr(held, "length", None)  # of all pixels, as SurfaceTopography writes it
    if length is not None and abs(float(length) / len(values) - abs(spacing)) > _SAME * abs(spacing):
        message = f"{path}: {dim}:length is {float(length):g}, its coordinate has a spacing of {spacing:g}"
        raise SurfaceError(message)
    counted = bool(spacing == 1.0 and values[0] in (0.0, 1.0))
    return abs(float(spacing)) * (len(values) - 1), _unit(path, held, dim), bool(spacing < 0.0), counted


def _unit(path: Path, held: Any, name: str) -> str | None:
    for key in ("units", "unit"):
        if key in held.ncattrs():
            return length_unit(path, held.getncattr(key), f"{name}:{key}")
    return None
