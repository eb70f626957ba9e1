"""Heights in memory as a file: arrays, masked arrays, quantities of pint, arrays of xarray, Topographies.

The file has all that the object has: missing heights, names of axes, coordinates, units. The rules for files then hold
for heights in memory as well, see `netcdf`. A plain array becomes ``.npy``. Everything with labels or units becomes
netCDF-3, whose bytes depend on the content alone.

Attributes tell the objects apart: no library is imported for them.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.errors import SurfaceError
from roughvol.surfaces.files.description import map_shape
from roughvol.surfaces.files.netcdf import ONE_AT_A_TIME
from roughvol.surfaces.length_units import named
from roughvol.typing import Array

KEPT = ("units", "unit", "axis", "positive")  # attributes of xarray that the reader of netCDF knows
VARIABLE = "heights"


Text = dict[str, str]  # attributes
Coordinates = dict[str, tuple[Array, Text]]  # positions by the names of axes


def write(heights: Any, folder: Path, name: str = VARIABLE) -> Path:
    """Write heights in memory, positive out of the body, to a ``.npy`` or ``.nc`` file."""
    dims: tuple[str, ...] = ("axis_0", "axis_1")
    coordinates: Coordinates = {}
    if callable(getattr(heights, "heights", None)) and hasattr(heights, "physical_sizes"):
        array, attributes, coordinates = _of_topography(heights)
        dims = ("x", "y")
    elif hasattr(heights, "data_vars"):
        names = ", ".join(map(str, heights.data_vars)) or "none"
        raise SurfaceError(f"a Dataset of xarray is no map; give one of its variables: {names}")
    elif hasattr(heights, "dims") and hasattr(heights, "attrs"):  # a DataArray or a Variable
        array, attributes, coordinates = _of_data_array(heights)
        dims = tuple(map(_name, heights.dims))
    elif isinstance(getattr(heights, "heights", None), np.ndarray):
        raise SurfaceError("a Surface has no unit of length; give its numbers, as surface.heights, and L")
    else:
        if any(type(axis).__name__ != "RangeIndex" for axis in getattr(heights, "axes", ())):
            raise SurfaceError("a DataFrame has labels without units; give its numbers, as .to_numpy(), and L")
        array, attributes = _numbers(heights)
        if not attributes:
            path = folder / f"{name}.npy"
            np.save(path, array)
            return path
    return _netcdf(folder / f"{name}.nc", array, dims, attributes, coordinates)


def _of_topography(heights: Any) -> tuple[Array, Text, Coordinates]:
    if heights.dim != 2 or not getattr(heights, "is_uniform", True):
        raise SurfaceError(f"a {type(heights).__name__} is no map of equidistant nodes; allowed: a uniform Topography")
    array, attributes = _numbers(heights.heights())
    unit = {"units": str(heights.unit)} if heights.unit else {}
    sides = zip("xy", heights.physical_sizes, array.shape, strict=True)
    return array, attributes | unit, {dim: (float(side) / n * np.arange(n), unit) for dim, side, n in sides}


def _of_data_array(heights: Any) -> tuple[Array, Text, Coordinates]:
    """Return an array of xarray; the coordinate of one axis alone gives the spacing of both."""
    if len(heights.dims) != 2 or len(set(map(_name, heights.dims))) != 2:
        sizes = ", ".join(f"{dim} {size}" for dim, size in zip(heights.dims, heights.shape, strict=True)) or "none"
        allowed = "two with names of their own, as after .isel or .squeeze"
        raise SurfaceError(f"heights have the dimensions {sizes}; allowed: {allowed}")
    array, unit = _numbers(heights.data)
    given = getattr(heights, "coords", {})
    along = {dim: given[dim] for dim in heights.dims if dim in given}  # xarray makes up the missing ones
    coordinates: Coordinates = {
        _name(dim): (np.asarray(coordinate.values, dtype=np.float64), _attributes(coordinate.attrs))
        for dim, coordinate in along.items()
        if coordinate.dims == (dim,) and coordinate.dtype.kind in "fiu"
    }
    if len(coordinates) == 1:
        nodes = dict(zip(map(_name, heights.dims), array.shape, strict=True))
        ((known, (values, attributes)),) = coordinates.items()
        (other,) = nodes.keys() - {known}
        spacing = abs(values[-1] - values[0]) / (len(values) - 1)
        coordinates[other] = (spacing * np.arange(nodes[other]), {**attributes, "axis": ""})
    return array, _attributes(heights.attrs) | unit, coordinates


def _numbers(heights: Any) -> tuple[Array, Text]:
    """Return heights as numbers, NaN where they are missing, and their unit if they are a quantity of pint."""
    unit = {}
    if isinstance(heights, list | tuple):
        firsts = [row[0] if isinstance(row, list | tuple) and row else row for row in heights]
        if any(map(_is_quantity, firsts)):
            raise SurfaceError("each row of the heights is a quantity; allowed: one quantity, as numpy.stack(rows)")
    if _is_quantity(heights):
        text = f"{heights.units:~C}"
        if named(text) is None and heights.check("[length]"):  # an inch, or a unit of the user
            text, heights = "m", heights.to("m")
        unit, heights = {"units": text}, heights.magnitude
    try:
        array: NDArray[Any] = np.ma.asarray(heights) if np.ma.isMaskedArray(heights) else np.asarray(heights)
    except (TypeError, ValueError) as error:  # rows of unequal length
        raise SurfaceError(f"heights make no array: {error}; allowed: rows of one length") from error
    if array.dtype.kind not in "fiu":
        raise SurfaceError(f"heights are of the type {array.dtype}; allowed: real numbers")
    map_shape(array.shape)
    return np.ma.filled(array.astype(np.float64, order="C"), np.nan), unit


def _is_quantity(value: Any) -> bool:
    return hasattr(value, "magnitude") and hasattr(value, "units")


def _name(dim: Any) -> str:
    """Return the name of a dimension as one of netCDF."""
    name = re.sub(r"\W", "_", str(dim)) or "_"
    return f"dim_{name}" if name == VARIABLE or not name[0].isalpha() else name


def _attributes(attributes: Mapping[Any, Any]) -> Text:
    """Return the attributes that the reader of netCDF knows, as text."""
    found = {name: attributes[name] for name in KEPT if attributes.get(name) is not None}
    return {name: f"{value:~C}" if hasattr(value, "dimensionality") else str(value) for name, value in found.items()}


def _netcdf(path: Path, heights: Array, dims: tuple[str, ...], attributes: Text, coordinates: Coordinates) -> Path:
    from netCDF4 import Dataset

    with ONE_AT_A_TIME, Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as stored:
        for dim, nodes in zip(dims, heights.shape, strict=True):
            stored.createDimension(dim, nodes)
        variables = {dim: ((dim,), *coordinate) for dim, coordinate in coordinates.items()}
        for name, (along, values, texts) in (variables | {VARIABLE: (dims, heights, attributes)}).items():
            stored.createVariable(name, "f8", along)[:] = values
            stored[name].setncatts(texts)
    return path
