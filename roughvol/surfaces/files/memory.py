"""Heights in memory as a file: arrays, masked arrays, quantities of pint, arrays of xarray, Topographies.

The file has all that the object has: missing heights, names of axes, coordinates, units. The rules for files then hold
for heights in memory as well, see `netcdf`. A plain array becomes ``.npy``. Everything with labels or units becomes
netCDF-3, whose bytes depend on the content alone.

Attributes tell the objects apart: no library is imported for them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.errors import SurfaceError
from roughvol.typing import Array

KEPT = ("units", "unit", "axis", "positive")  # attributes of xarray that the reader of netCDF knows
VARIABLE = "heights"
SQUARE = 1e-4  # largest relative difference of the spacings of square pixels


@dataclass
class Labelled:
    """A map with its labels."""

    heights: Array  # NaN where they are missing
    dims: tuple[str, ...] = ()  # names of the axes; empty for a plain array
    attributes: dict[str, str] = field(default_factory=dict)  # of the heights, as `units`
    coordinates: dict[str, tuple[Array, dict[str, str]]] = field(default_factory=dict)  # positions and attributes


def write(heights: Any, folder: Path, name: str = VARIABLE) -> Path:
    """Write heights in memory, positive out of the body, to a ``.npy`` or ``.nc`` file."""
    labelled = _labelled(heights)
    if not labelled.dims and not labelled.attributes:
        path = folder / f"{name}.npy"
        np.save(path, labelled.heights)
        return path
    path = folder / f"{name}.nc"
    _write_netcdf(labelled, path)
    return path


def _labelled(heights: Any) -> Labelled:
    if callable(getattr(heights, "heights", None)) and hasattr(heights, "physical_sizes"):  # a Topography
        return _of_topography(heights)
    if hasattr(heights, "data_vars"):
        names = ", ".join(map(str, heights.data_vars)) or "none"
        raise SurfaceError(f"a Dataset of xarray is no map; give one of its variables: {names}")
    if hasattr(heights, "dims") and hasattr(heights, "attrs"):  # a DataArray or a Variable
        return _of_data_array(heights)
    if hasattr(heights, "columns") and {type(axis).__name__ for axis in getattr(heights, "axes", ())} != {"RangeIndex"}:
        raise SurfaceError("a DataFrame has labels without units; give its numbers, as .to_numpy(), and L")
    array, attributes = _numbers(heights)
    return Labelled(array, attributes=attributes)


def _of_topography(heights: Any) -> Labelled:
    if heights.dim != 2 or not getattr(heights, "is_uniform", True):
        raise SurfaceError(f"a {type(heights).__name__} is no map of equidistant nodes; allowed: a uniform Topography")
    array, attributes = _numbers(heights.heights())
    unit = {"units": str(heights.unit)} if heights.unit else {}
    pixels = (float(side) / nodes for side, nodes in zip(heights.physical_sizes, array.shape, strict=True))
    coordinates = {
        dim: (pixel * np.arange(nodes), dict(unit)) for dim, pixel, nodes in zip("xy", pixels, array.shape, strict=True)
    }
    return Labelled(array, ("x", "y"), attributes | unit, coordinates)


def _of_data_array(heights: Any) -> Labelled:
    """Return an array of xarray; the coordinate of one axis alone gives the spacing of both."""
    if len(heights.dims) != 2:
        sizes = ", ".join(f"{dim} {size}" for dim, size in heights.sizes.items()) or "none"
        raise SurfaceError(f"heights have the dimensions {sizes}; allowed: two, as after .isel or .squeeze")
    array, unit = _numbers(heights.data)
    dims = tuple(_name(dim) for dim in heights.dims)
    coordinates: dict[str, tuple[Array, dict[str, str]]] = {}
    given = getattr(heights, "coords", {})
    for dim, name in zip(heights.dims, dims, strict=True):
        if dim not in given:  # xarray makes up the missing ones
            continue
        along = given[dim]
        if along.dims == (dim,) and along.dtype.kind in "fiu":
            coordinates[name] = (np.asarray(along.values, dtype=np.float64), _attributes(along.attrs))
    if _are_shares(coordinates):
        coordinates = {}
    if len(coordinates) == 1 and min(array.shape) > 1:
        (known,) = coordinates
        (other,) = set(dims) - {known}
        values, attributes = coordinates[known]
        spacing = (values[-1] - values[0]) / (len(values) - 1)
        nodes = array.shape[dims.index(other)]
        coordinates[other] = (abs(spacing) * np.arange(nodes), {**attributes, "axis": ""})
    return Labelled(array, dims, {**_attributes(heights.attrs), **unit}, coordinates)


def _are_shares(coordinates: Mapping[str, tuple[Array, dict[str, str]]]) -> bool:
    """Return whether coordinates are positions over a length on square pixels, as in datasets of roughvol."""
    spacings = [float(np.diff(values).mean()) for values, _ in coordinates.values() if len(values) > 1]
    units = {attributes.get("units") for _, attributes in coordinates.values()}
    return units == {"1"} and len(spacings) == 2 and math.isclose(*spacings, rel_tol=SQUARE)


def _numbers(heights: Any) -> tuple[Array, dict[str, str]]:
    """Return heights as numbers, NaN where they are missing, and their unit if they are a quantity of pint."""
    unit = {}
    if hasattr(heights, "magnitude") and hasattr(heights, "units"):
        unit, heights = {"units": f"{heights.units:~C}"}, heights.magnitude
    try:
        array: NDArray[Any] = np.ma.asarray(heights) if np.ma.isMaskedArray(heights) else np.asarray(heights)
    except (TypeError, ValueError) as error:
        raise SurfaceError(f"heights make no array: {_ragged(heights) or error}") from error
    if array.dtype.kind not in "fiu":
        kind = {"c": "complex", "b": "true or false", "O": "objects"}.get(array.dtype.kind, str(array.dtype))
        raise SurfaceError(f"heights are of the type {array.dtype} ({kind}); allowed: real numbers")
    if array.ndim != 2:
        raise SurfaceError(f"heights have shape {array.shape}; allowed: two axes")
    return np.ma.filled(array.astype(np.float64), np.nan), unit


def _ragged(heights: Any) -> str:
    """Return that rows have different lengths in words; empty if that is not the fault."""
    try:
        shapes = list(dict.fromkeys(np.shape(row) for row in heights))
    except (TypeError, ValueError):
        return ""
    if len(shapes) < 2:
        return ""
    return f"its rows have the shapes {shapes[0]} and {shapes[1]}; allowed: rows of one length"


def _name(dim: Any) -> str:
    """Return the name of a dimension as one of netCDF."""
    name = re.sub(r"\W", "_", str(dim)) or "_"
    return f"dim_{name}" if name == VARIABLE or not name[0].isalpha() else name


def _attributes(attributes: Mapping[Any, Any]) -> dict[str, str]:
    """Return the attributes that the reader of netCDF knows, as text."""
    found = {name: attributes[name] for name in KEPT if attributes.get(name) is not None}
    return {name: f"{value:~C}" if hasattr(value, "dimensionality") else str(value) for name, value in found.items()}


def _write_netcdf(labelled: Labelled, path: Path) -> None:
    from netCDF4 import Dataset

    with Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as stored:
        dims = labelled.dims or ("axis_0", "axis_1")
        for dim, nodes in zip(dims, labelled.heights.shape, strict=True):
            stored.createDimension(dim, nodes)
        for dim, (values, attributes) in labelled.coordinates.items():
            stored.createVariable(dim, "f8", (dim,))[:] = values
            stored[dim].setncatts(attributes)
        stored.createVariable(VARIABLE, "f8", dims)[:] = labelled.heights
        stored[VARIABLE].setncatts(labelled.attributes)
