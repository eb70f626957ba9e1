"""The numbers of a case by dimensions, and the file of a small one: netCDF-3 with 64-bit offsets, made by scipy.

An ensemble stores thousands of small cases. A file made through xarray takes as long as the sweep at m = 5, and the
present one a fifth of that. The content is equal.

NetCDF-3 has no booleans, no integers of 64 bits and no texts of variable length. Flags are bytes with the attribute
``dtype``, integers have 32 bits, and texts are characters along one more dimension.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roughvol.errors import DatasetError
from roughvol.observables.variables import DTYPES, VARIABLES, Variable
from roughvol.study import Case

Array = tuple[tuple[str, ...], NDArray[Any]]  # dimensions and values
Arrays = Mapping[str, Array]

LARGEST = 1 << 31  # integers below it fit


def arrays_of_case(case: Case, values: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Return dimensions and values of one case by name; refuse names and dimensions that are not in the table."""
    leading: dict[str, Any] = {"case": case.label} if case.file else {"D": case.D, "m": case.m, "seed": case.seed}
    labels: dict[str, Any] = {name: [label] for name, label in leading.items()} | {"L": case.L}
    found: dict[str, Array] = {}
    for name, value in (labels | dict(values)).items():
        if name not in VARIABLES:
            raise DatasetError(f"{name!r} is not a stored variable; known are {', '.join(VARIABLES)}")
        array: NDArray[Any] = np.asarray(value, dtype=DTYPES[VARIABLES[name].kind])
        dims = tuple(VARIABLES[name].dims.split())
        if dims[:1] == ("...",):
            dims = (*leading, *dims[1:])
            array = array[(np.newaxis,) * len(leading)]
        if array.ndim != len(dims):
            raise DatasetError(f"{name} has dimensions ({', '.join(dims)}), got an array of shape {array.shape}")
        found[name] = (dims, array)
    return found


def fits(arrays: Arrays, most: int) -> bool:
    """Return whether a case may be stored in this form: few bytes, integers of 32 bits, no empty dimension."""
    values = [array for _, array in arrays.values()]
    integers = (array for array in values if array.dtype.kind == "i")
    return (
        sum(array.nbytes for array in values) <= most
        and all(array.size for array in values)
        and all(int(array.min()) >= -LARGEST and int(array.max()) < LARGEST for array in integers)
    )


def content(arrays: Arrays, coordinates: Collection[str], attributes: Mapping[str, str]) -> bytes:
    """Return the content of a netCDF-3 file; ``coordinates`` are those that are no dimensions."""
    unit, stream = attributes.get("length_unit", "length"), io.BytesIO()
    extra = {name: set(arrays[name][0]) for name in coordinates if name in arrays}
    from scipy.io import netcdf_file  # slow to import, and not needed to read

    file = netcdf_file(stream, "w", version=2)
    for name, text in attributes.items():
        setattr(file, name, text.encode())
    for name, (dims, array) in arrays.items():
        label = name in extra or dims == (name,)
        own, values, described = _encoded(VARIABLES[name].kind, array, label=label)
        described |= _described(name, unit)
        if beside := "" if label else " ".join(other for other, along in extra.items() if along <= set(dims)):
            described["coordinates"] = beside.encode()
        for dim, size in zip((*dims, *own), values.shape, strict=True):
            if dim not in file.dimensions:
                file.createDimension(dim, size)
        variable = file.createVariable(name, values.dtype, (*dims, *own))
        variable[...] = values
        for key, value in described.items():
            setattr(variable, key, value)
    try:
        file.flush()
        return stream.getvalue()
    finally:
        stream.close()  # else the file would be written again by its destructor


@functools.cache
def _described(name: str, unit: str) -> dict[str, bytes]:
    return {key: text.encode() for key, text in words_of(VARIABLES[name], unit).items()}


def words_of(row: Variable, unit: str) -> dict[str, str]:
    """Return the attributes of a variable; ``unit`` is that of lengths."""
    return {"units": row.units.replace("length", unit), "long_name": row.long_name, "symbol": row.symbol}


def _encoded(kind: str, array: NDArray[Any], *, label: bool) -> tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]:
    """Return further dimensions, values and attributes of a variable in the file."""
    if kind == "text":
        texts = np.strings.encode(array.astype(str), "utf-8")
        length = max(texts.dtype.itemsize, 1)
        characters = texts.astype(f"S{length}")[..., np.newaxis].view("S1")
        return (f"string{length}",), characters, {"_Encoding": b"utf-8"}
    if kind == "flag":
        return (), array.astype(np.int8), {"dtype": b"bool"}
    if kind == "index":
        return (), array.astype(np.int32), {}
    if kind == "count":
        return (), np.where(np.isnan(array), -1.0, array).astype(np.int32), {"_FillValue": np.int32(-1)}
    return (), array, {} if label else {"_FillValue": np.float64(np.nan)}
