"""Height fields from files: a reader for each kind of content, all giving a float64 array of heights, positive up.

Conventions: the first axis of the array is x, whose length a study calls L. Labels in the file say which axis is x;
without labels, the order of the file stays. Missing heights are refused, or given as NaN to a caller who fills them.
Nothing is ever unpickled. docs/measured.md has a table of who reads what.
"""

from __future__ import annotations

import tokenize
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces.files import instrument, netcdf, plain_text, text_map, tiff
from roughvol.surfaces.files.description import Description, HeightMap, NotRead, refuse_huge
from roughvol.typing import Array

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
TEXT = (".txt", ".csv", ".xyz", ".dat", ".asc")
TIFF = (".tif", ".tiff")
SENTINELS = (-9999.0, 9999.0, -99999.0, 99999.0, -999999.0, -32768.0, float(np.float32(-3.4028235e38)), 1e38, -1e38)
_FAR = 3.0  # ranges of the other heights by which a number is off that marks missing ones


def describe(
    path: str | Path, variable: str | None = None, *, columns: str | None = None, ignore_header: bool = False
) -> Description:
    """Return what a file gives beside its heights: nodes, size, units, channel, reader.

    Parameters and errors as `read`.
    """
    return _opened(Path(path), variable, columns, ignore_header).description


def read(
    path: str | Path,
    variable: str | None = None,
    *,
    holes: bool = False,
    columns: str | None = None,
    ignore_header: bool = False,
) -> Array:
    """Return the heights stored in a file, in the unit that `describe` calls ``heights_unit``.

    Parameters
    ----------
    path : str or Path
        An array in ``.npy``; one of the arrays in ``.npz`` or ``.nc``; text of heights or of points x y z; an ESRI
        ASCII grid; a grey-scale TIFF. All other files are for SurfaceTopography, see `instrument`.
    variable : str, optional
        Name of the array in an ``.npz`` or ``.nc`` file, needed if it holds several with two dimensions; or of the
        channel in the file of an instrument. Digits that are no name are a number from 0.
    holes : bool
        Return NaN where a height is missing or not finite, rather than refuse the file.
    columns : {"heights"}, optional
        All columns of a text are heights, also if there are three as of points x y z.
    ignore_header : bool
        Pass over sizes and units that are not understood.

    Returns
    -------
    heights : (nodes along x, nodes along y) float64 array, finite (or NaN in holes), at least 3 x 3

    Raises
    ------
    DatasetError
        If the file is missing, cannot be read, or does not say which array is meant.
    SurfaceError
        If what it holds is not a field of finite heights.
    """
    path = Path(path)
    found = _opened(path, variable, columns, ignore_header)
    return _checked(path, _guarded(path, found.heights), holes)


def _opened(path: Path, variable: str | None, columns: str | None, ignore_header: bool) -> HeightMap:
    def opened() -> HeightMap:
        size = path.stat().st_size
        if size > MAX_BYTES:
            message = f"{path}: has {size} bytes, at most {MAX_BYTES} are read"
            raise DatasetError(message)
        suffix = path.suffix.lower()
        own = {".npy": _npy, ".npz": _npz}.get(suffix)
        if own is not None:
            return own(path, variable)
        if suffix == ".nc":
            return netcdf.opened(path, variable, ignore_header=ignore_header)
        if suffix in TEXT and plain_text.is_text(path):
            return _text(path, variable, columns, ignore_header)
        return _instrument(path, variable, columns, ignore_header)

    found = _guarded(path, opened)
    refuse_huge(path, _two(path, found.description.shape))
    return found


def _guarded(path: Path, call: Callable[[], Any]) -> Any:
    """Call a reader; whatever a damaged file makes it raise becomes an error with the name of the file."""
    try:
        return call()
    except (DatasetError, SurfaceError):
        raise
    except _UNREADABLE as error:
        kind = f" as {path.suffix.lower()}" if path.suffix else ""
        message = f"{path}: cannot be read{kind}: {getattr(error, 'strerror', None) or error}"
        raise DatasetError(message) from error


def _text(path: Path, variable: str | None, columns: str | None, ignore_header: bool) -> HeightMap:
    """Read text; headers of other programs that are not understood here are left to SurfaceTopography."""
    try:
        found = text_map.opened(path, columns, ignore_header=ignore_header)
    except (NotRead, SurfaceError) as refused:
        try:
            other = instrument.opened(path, variable)
        except (DatasetError, SurfaceError):
            raise refused from None
        known = other.description
        ours = known.reader.endswith(instrument.TEXT)
        if ours and (isinstance(refused, SurfaceError) or known.sides is None or known.unit is None):
            raise  # that reader passes over what it does not understand
        return other
    if variable is not None:
        message = f"{path}: holds one array, without a name; leave out the variable {variable!r}"
        raise DatasetError(message)
    return found


def _instrument(path: Path, variable: str | None, columns: str | None, ignore_header: bool) -> HeightMap:
    """Ask SurfaceTopography; TIFF and text that it does not know, or reads as text without a mark, are read here."""
    try:
        found = instrument.opened(path, variable)
    except (DatasetError, SurfaceError) as refused:
        if path.suffix.lower() in TIFF and path.is_file():  # its reader knows those of one maker alone
            return tiff.opened(path, variable, ignore_header=ignore_header)
        if isinstance(refused, NotRead) and path.stat().st_size and plain_text.is_text(path):
            return _text(path, variable, columns, ignore_header)
        raise
    if found.description.reader.endswith(instrument.TEXT):
        return _text(path, variable, columns, ignore_header)
    return found


def _checked(path: Path, array: NDArray[Any], holes: bool) -> Array:
    if array.dtype.kind not in "fiu":
        message = f"{path}: holds values of type {array.dtype}, not numbers"
        raise SurfaceError(message)
    _two(path, array.shape)
    with np.errstate(over="ignore"):  # a long double too large for float64 becomes inf, and is refused below
        heights = np.ascontiguousarray(array, dtype=np.float64)
    missing = ~np.isfinite(heights)
    marks = []
    for mark in SENTINELS:
        found = heights == mark
        if found.any() and _far(mark, heights[~found & ~missing]):
            missing |= found
            marks.append(f"{mark:g}")
    if missing.any() and not holes:
        row, column = np.argwhere(missing)[0]
        count = f"{missing.sum()} height{' is' if missing.sum() == 1 else 's are'}"
        message = (
            f"{path}: {count} missing or not finite, the first in row {row}, column {column}"
            f"{f' ({chr(44).join(marks)} marks a missing one)' if marks else ''}; "
            "a study may have them filled (surface.missing)"
        )
        raise SurfaceError(message)
    return np.where(missing, np.nan, heights) if holes else heights


def _far(mark: float, others: Array) -> bool:
    """Return whether a number that often marks missing heights lies far off all others."""
    others = others[~np.isin(others, SENTINELS)]
    if not others.size:
        return False
    low, high = float(others.min()), float(others.max())
    return min(abs(mark - low), abs(mark - high)) > _FAR * (high - low) and not low <= mark <= high


def _npy(path: Path, variable: str | None) -> HeightMap:
    if variable is not None:
        message = f"{path}: holds one array, without a name; leave out the variable {variable!r}"
        raise DatasetError(message)
    with path.open("rb") as stream:
        shape = _header_shape(stream)
    refuse_huge(path, shape)

    def heights() -> NDArray[Any]:
        with path.open("rb") as stream:
            return np.lib.format.read_array(stream, allow_pickle=False)

    return HeightMap(Description(_two(path, shape), reader="numpy"), heights)


def _npz(path: Path, variable: str | None) -> HeightMap:
    with zipfile.ZipFile(path) as archive:
        members = {name.removesuffix(".npy"): name for name in archive.namelist() if name.endswith(".npy")}
        shapes = {}
        for name, member in members.items():  # the headers alone: the arrays not asked for may be large
            with archive.open(member) as stream:
                shapes[name] = _header_shape(stream)
    name = netcdf.choice(path, variable, shapes)
    refuse_huge(path, shapes[name])

    def heights() -> NDArray[Any]:
        with zipfile.ZipFile(path) as archive, archive.open(members[name]) as stream:
            return np.lib.format.read_array(stream, allow_pickle=False)

    return HeightMap(Description(_two(path, shapes[name]), channel=name, reader="numpy"), heights)


def _two(path: Path, shape: tuple[int, ...]) -> tuple[int, int]:
    if len(shape) != 2 or min(shape) < 3:
        message = f"{path}: heights have shape {shape}; allowed: two dimensions of at least 3 nodes each"
        raise SurfaceError(message)
    return shape[0], shape[1]


def _header_shape(stream: Any) -> tuple[int, ...]:
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    return tuple(read_header(stream)[0])
