"""Heights from files, as a float64 array, positive up. docs/how-to/measured.md lists the formats and their readers.

Conventions: the first axis of the array is x, and its length is L in a study. Labels in the file give the axes. Without
labels, the order of the file stays. Missing heights are refused, or NaN on demand. No file is ever unpickled.
"""

from __future__ import annotations

import contextlib
import math
import tokenize
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces.files import instrument, netcdf, plain_text, surfer, text_map, tiff
from roughvol.surfaces.files.description import EXTRA, Description, HeightMap, NotRead, array_name, reading, refuse_huge
from roughvol.typing import Array

# Errors of numpy, zipfile and netCDF4 on damaged files, such as a header that asks for petabytes.
_DAMAGED = (EOFError, tokenize.TokenError, zipfile.BadZipFile, zlib.error)
_UNREADABLE = (ArithmeticError, MemoryError, OSError, RuntimeError, ValueError, *_DAMAGED)
MAX_BYTES = 1 << 32  # like MAX_NODES far above the size of any contact problem
TEXT = (".txt", ".csv", ".xyz", ".dat", ".asc")
TIFF = (".tif", ".tiff")
GRID = ".grd"  # an ending of many programs
SENTINELS = (-9999.0, 9999.0, -99999.0, 99999.0, -999999.0, -32768.0)
BEYOND = 9e36  # pm or more: no height. Programs mark missing heights with larger numbers: 9.97e36, 1.70141e38, -3.4e38
_FAR = 3.0  # least distance of a mark of missing heights from the others, over their range


def describe(
    path: str | Path, variable: str | None = None, *, columns: str | None = None, ignore_header: bool = False
) -> Description:
    """Return the description of a height file, with the arguments of `read`."""
    return _opened(Path(path), variable, columns, ignore_header).description


def read(
    path: str | Path,
    variable: str | None = None,
    *,
    holes: bool = False,
    columns: str | None = None,
    ignore_header: bool = False,
) -> Array:
    """Return the heights in a file, in the unit ``heights_unit`` of its description.

    ``variable`` is the array of an ``.npz`` or ``.nc`` file, the channel of an instrument, or the page of a TIFF: its
    name, or its number from 0. ``holes`` returns NaN for missing heights, which are refused otherwise. ``columns`` as
    "heights" takes all columns of a text for heights. ``ignore_header`` passes over sizes and units.
    """
    path = Path(path)
    height_map = _opened(path, variable, columns, ignore_header)
    with _reading(path):
        heights = height_map.heights()
    return _checked(path, heights, holes)


def _opened(path: Path, variable: str | None, columns: str | None, ignore_header: bool) -> HeightMap:
    with _reading(path):
        height_map = _by_content(path, variable, columns, ignore_header)
    refuse_huge(path, _two(path, height_map.description.shape))
    sides, source = height_map.description.sides, height_map.description.source
    if sides is not None and not ignore_header and not all(0.0 < side < math.inf for side in sides):
        raise SurfaceError(f"{path}: {source} makes sides of {sides[0]:g} by {sides[1]:g}; allowed: finite and above 0")
    return height_map


def _by_content(path: Path, variable: str | None, columns: str | None, ignore_header: bool) -> HeightMap:
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise DatasetError(f"{path}: has {size} bytes; allowed: at most {MAX_BYTES}")
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return _npy(path, variable)
    if suffix == ".npz":
        return _npz(path, variable)
    if suffix in netcdf.ENDINGS or netcdf.is_classic(path) or (suffix == GRID and netcdf.is_hdf5(path)):
        return netcdf.opened(path, variable, ignore_header=ignore_header)
    if surfer.is_grid(path):
        _refuse_variable(path, variable)
        return surfer.opened(path)
    if suffix in TEXT and plain_text.is_text(path):
        return _text(path, variable, columns, ignore_header)
    try:
        return _instrument(path, variable, columns, ignore_header)
    except NotRead as refused:
        if suffix != GRID:
            raise
        message = (
            f"{path}: is no Surfer grid; allowed in {GRID}: Surfer grids (DSAA, DSBB, DSRB), netCDF and ESRI ASCII "
            "grids; save it as one of them"
        )
        raise DatasetError(message) from refused


def _reading(path: Path) -> contextlib.AbstractContextManager[None]:
    return reading(path, path.suffix.lower(), _UNREADABLE)


def _text(path: Path, variable: str | None, columns: str | None, ignore_header: bool) -> HeightMap:
    """Read text. SurfaceTopography reads headers that are not understood here."""
    try:
        height_map = text_map.opened(path, columns, ignore_header=ignore_header)
    except (NotRead, SurfaceError) as refused:
        try:
            other = instrument.opened(path, variable)
        except (DatasetError, SurfaceError) as error:
            if isinstance(refused, NotRead) and EXTRA in str(error):
                raise NotRead(f"{refused}; for headers of other programs: {EXTRA}") from None
            raise refused from None
        lossy = other.description.reader.endswith(instrument.TEXT)  # this reader passes over unknown lines
        complete = other.description.sides is not None and other.description.unit is not None
        if lossy and (isinstance(refused, SurfaceError) or not complete):
            raise
        return other
    _refuse_variable(path, variable)
    return height_map


def _refuse_variable(path: Path, variable: str | None) -> None:
    if variable is not None:
        raise DatasetError(f"{path}: holds one array, without a name; leave out the variable {variable!r}")


def _instrument(path: Path, variable: str | None, columns: str | None, ignore_header: bool) -> HeightMap:
    """Read through SurfaceTopography, except for text, and TIFF that it does not know."""
    try:
        height_map = instrument.opened(path, variable)
    except (DatasetError, SurfaceError) as refused:
        if path.suffix.lower() in TIFF and path.is_file():
            return tiff.opened(path, variable, ignore_header=ignore_header)
        if isinstance(refused, NotRead) and path.stat().st_size and plain_text.is_text(path):
            return _text(path, variable, columns, ignore_header)
        raise
    if height_map.description.reader.endswith(instrument.TEXT):
        return _text(path, variable, columns, ignore_header)
    return height_map


def _checked(path: Path, array: NDArray[Any], holes: bool) -> Array:
    if array.dtype.kind not in "fiu":
        raise SurfaceError(f"{path}: holds values of type {array.dtype}, not numbers")
    _two(path, array.shape)
    with np.errstate(over="ignore"):  # a long double beyond float64 becomes inf, and is refused below
        heights = np.ascontiguousarray(array, dtype=np.float64)
    missing = ~(np.abs(heights) < BEYOND)
    marks = [f"{mark:g}" for mark in np.unique(heights[missing & np.isfinite(heights)])]
    for mark in SENTINELS:
        marked = heights == mark
        if marked.any() and _far(mark, heights[~marked & ~missing]):
            missing |= marked
            marks.append(f"{mark:g}")
    if missing.any() and not holes:
        row, column = np.argwhere(missing)[0]
        count = f"{missing.sum()} height{' is' if missing.sum() == 1 else 's are'}"
        marked_by = f" ({', '.join(marks[:3])} marks a missing one)" if marks else ""
        message = (
            f"{path}: {count} missing or not finite, the first in row {row}, column {column}{marked_by}; "
            "a study may have them filled (surface.missing)"
        )
        raise SurfaceError(message)
    return np.where(missing, np.nan, heights) if holes else heights


def _far(mark: float, others: Array) -> bool:
    """Return whether a usual mark of missing heights lies far from all other heights."""
    others = others[~np.isin(others, SENTINELS)]
    if not others.size:
        return False
    low, high = float(others.min()), float(others.max())
    return min(abs(mark - low), abs(mark - high)) > _FAR * (high - low) and not low <= mark <= high


def _npy(path: Path, variable: str | None) -> HeightMap:
    _refuse_variable(path, variable)
    return _array(path, "", lambda: path.open("rb"))


def _npz(path: Path, variable: str | None) -> HeightMap:
    shapes = {}
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():  # the headers alone: other arrays may be large
            if name.endswith(".npy"):
                with archive.open(name) as stream:
                    shapes[name.removesuffix(".npy")] = _header_shape(stream)
    chosen = array_name(path, variable, shapes)
    return _array(path, chosen, lambda: zipfile.ZipFile(path).open(f"{chosen}.npy"))


def _array(path: Path, name: str, opened: Callable[[], IO[bytes]]) -> HeightMap:
    with opened() as stream:
        shape = _header_shape(stream)

    def heights() -> NDArray[Any]:
        with opened() as stream:
            return np.lib.format.read_array(stream, allow_pickle=False)

    return HeightMap(Description(_two(path, shape), channel=name, reader="numpy"), heights)


def _two(path: Path, shape: tuple[int, ...]) -> tuple[int, int]:
    if len(shape) != 2 or min(shape) < 3:
        raise SurfaceError(f"{path}: heights have shape {shape}; allowed: two dimensions of at least 3 nodes each")
    return shape[0], shape[1]


def _header_shape(stream: Any) -> tuple[int, ...]:
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    return tuple(read_header(stream)[0])
