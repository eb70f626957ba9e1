"""Height fields from files: one reader for each ending, all giving a float64 array of heights, positive up.

Conventions: the first axis of the array is the one whose length a study calls L; rows stay in the order of the file.
Missing heights are refused, or given as NaN to a caller who fills them. Files of the endings below tell neither size
nor unit (what a header says about spacing is not used); all others are left to `instrument`, where they tell both.
Nothing is ever unpickled.
"""

from __future__ import annotations

import math
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol import instrument
from roughvol.errors import DatasetError, SurfaceError
from roughvol.instrument import MAX_NODES, Description

Heights = NDArray[np.float64]

# What numpy, zipfile and netCDF4 raise on damaged files; a header that asks for petabytes is one of them.
_UNREADABLE = (
    ArithmeticError,
    EOFError,
    MemoryError,
    OSError,
    RuntimeError,
    ValueError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
MAX_BYTES = 1 << 32  # like MAX_NODES far more than can be pressed, far less than a header may promise
_ESRI_KEYS = {
    *("ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter"),
    *("cellsize", "dx", "dy", "nodata_value"),
}


def describe(path: str | Path, variable: str | None = None) -> Description | None:
    """Return what the file of an instrument tells about its heights; None for the formats that tell nothing.

    Raises as `instrument.describe`.
    """
    path = Path(path)
    return None if path.suffix.lower() in _READERS else instrument.describe(path, variable)


def read(path: str | Path, variable: str | None = None, *, holes: bool = False) -> Heights:
    """Return the heights stored in a file, in the unit of the file.

    Parameters
    ----------
    path : str or Path
        An array in ``.npy``; one of the arrays in ``.npz`` or ``.nc``; numbers row by row in ``.txt`` or ``.csv``
        (comments after ``#``; columns set apart by blanks, commas, semicolons or tabs); an ESRI ASCII grid, with or
        without its header, in ``.asc``.
        All other endings are those of instruments, for `instrument.read`.
    variable : str, optional
        Name of the array in an ``.npz`` or ``.nc`` file, needed if it holds several with two dimensions; or of the
        channel in the file of an instrument.
    holes : bool
        Return NaN where a height is missing or not finite, rather than refuse the file.

    Returns
    -------
    heights : (rows, columns) float64 array, finite (or NaN in holes), at least 3 x 3

    Raises
    ------
    DatasetError
        If the file is missing, cannot be read, or does not say which array is meant.
    SurfaceError
        If what it holds is not a field of finite heights.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower(), instrument.read)
    if variable is not None and reader not in (_npz, _netcdf, instrument.read):
        message = f"{path}: holds one array, without a name; leave out the variable {variable!r}"
        raise DatasetError(message)
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            message = f"{path}: has {size} bytes, at most {MAX_BYTES} are read"
            raise DatasetError(message)
        array = reader(path, variable)
    except (DatasetError, SurfaceError):
        raise
    except _UNREADABLE as error:
        message = f"{path}: cannot be read as {path.suffix.lower()}: {getattr(error, 'strerror', None) or error}"
        raise DatasetError(message) from error
    return _checked(path, array, holes)


def _checked(path: Path, array: NDArray[Any], holes: bool) -> Heights:
    if array.dtype.kind not in "fiu":
        message = f"{path}: holds values of type {array.dtype}, not numbers"
        raise SurfaceError(message)
    if array.ndim != 2 or min(array.shape) < 3:
        message = f"{path}: heights have shape {array.shape}; allowed: two dimensions of at least 3 nodes each"
        raise SurfaceError(message)
    with np.errstate(over="ignore"):  # a long double too large for float64 becomes inf, and is refused below
        heights = np.ascontiguousarray(array, dtype=np.float64)
    missing = ~np.isfinite(heights)
    if missing.any() and not holes:
        row, column = np.argwhere(missing)[0]
        count = f"{missing.sum()} height{' is' if missing.sum() == 1 else 's are'}"
        message = (
            f"{path}: {count} missing or not finite, the first in row {row}, column {column}; "
            "a study may have them filled (surface.missing)"
        )
        raise SurfaceError(message)
    return np.where(missing, np.nan, heights) if holes else heights


def _choice(path: Path, variable: str | None, shapes: Mapping[str, tuple[int, ...]]) -> str:
    """Return the name of the array meant: the one named, or the only one with two dimensions."""
    fields = [name for name, shape in shapes.items() if len(shape) == 2]
    if variable is None and len(fields) == 1:
        return fields[0]
    if variable is not None and variable in shapes:
        return variable
    held = ", ".join(f"{name} {shape}" for name, shape in shapes.items()) or "none"
    asked = "which array holds the heights is not said (variable)" if variable is None else f"has no array {variable!r}"
    message = f"{path}: {asked}; arrays in the file: {held}"
    raise DatasetError(message)


def _refuse_huge(path: Path, shape: tuple[int, ...]) -> None:
    """Refuse an array before memory is asked for: a small compressed file may hold any number of zeros."""
    if math.prod(shape) > MAX_NODES:
        message = f"{path}: the array has shape {shape}; allowed: at most {MAX_NODES} nodes"
        raise DatasetError(message)


def _npy(path: Path, variable: str | None) -> NDArray[Any]:
    with path.open("rb") as stream:
        _refuse_huge(path, _header_shape(stream))
        stream.seek(0)
        return np.lib.format.read_array(stream, allow_pickle=False)


def _npz(path: Path, variable: str | None) -> NDArray[Any]:
    with zipfile.ZipFile(path) as archive:
        members = {name.removesuffix(".npy"): name for name in archive.namelist() if name.endswith(".npy")}
        shapes = {}
        for name, member in members.items():  # the headers alone: the arrays not asked for may be large
            with archive.open(member) as stream:
                shapes[name] = _header_shape(stream)
        name = _choice(path, variable, shapes)
        _refuse_huge(path, shapes[name])
        with archive.open(members[name]) as stream:
            return np.lib.format.read_array(stream, allow_pickle=False)


def _header_shape(stream: Any) -> tuple[int, ...]:
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    return tuple(read_header(stream)[0])


def _netcdf(path: Path, variable: str | None) -> NDArray[Any]:
    from netCDF4 import Dataset

    with Dataset(path) as stored:
        name = _choice(path, variable, {name: held.shape for name, held in stored.variables.items()})
        _refuse_huge(path, stored[name].shape)
        array = np.ma.asarray(stored[name][...])
    mask = np.ma.getmaskarray(array)
    if mask.any() and array.dtype.kind in "fiu":
        return np.where(mask, np.nan, array.data)
    return np.asarray(array.data)


def _text(path: Path, variable: str | None) -> NDArray[Any]:
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    first = next((line for line in lines if line.split("#")[0].strip()), None)
    if first is None:
        message = f"{path}: holds no numbers"
        raise SurfaceError(message)
    delimiter = next((mark for mark in ";,\t" if mark in first.split("#")[0].strip()), None)
    return np.loadtxt(lines, delimiter=delimiter, ndmin=2)


def _esri(path: Path, variable: str | None) -> NDArray[Any]:
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    header: dict[str, float] = {}
    for line in lines:
        words = line.lower().split()
        if len(words) != 2 or words[0] not in _ESRI_KEYS:
            break
        header[words[0]] = float(words[1])
    if not header:
        return _text(path, variable)
    if not {"ncols", "nrows"} <= header.keys():
        message = f"{path}: the header names {', '.join(header)}; needed: ncols and nrows"
        raise SurfaceError(message)
    shape = int(header["nrows"]), int(header["ncols"])
    if header.get("dx") != header.get("dy"):
        message = f"{path}: cells of {header.get('dx')} by {header.get('dy')}; allowed: square cells"
        raise SurfaceError(message)
    # The numbers of a row may run over several lines.
    heights = np.array(" ".join(lines[len(header) :]).split(), dtype=np.float64)
    if heights.size != math.prod(shape):
        message = f"{path}: holds {heights.size} heights; its header says {shape[0]} x {shape[1]}"
        raise SurfaceError(message)
    heights = heights.reshape(shape)
    heights[heights == header.get("nodata_value", math.nan)] = math.nan
    return heights


_READERS: dict[str, Callable[[Path, str | None], NDArray[Any]]] = {
    ".npy": _npy,
    ".npz": _npz,
    ".txt": _text,
    ".csv": _text,
    ".asc": _esri,
    ".nc": _netcdf,
}
