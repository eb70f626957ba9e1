"""Heights from files, as a float64 array, positive up. docs/how-to/measured.md lists the formats and their readers.

Conventions: the first axis of the array is x, and its length is L in a study. Labels in the file give the axes. Without
labels, the order of the file stays. Missing heights are refused, or NaN on demand. No file is ever unpickled.
"""

from __future__ import annotations

import contextlib
import math
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces.files import description, instrument, netcdf, plain_text, simple_field, surfer, text_map, tiff
from roughvol.surfaces.files.description import Description, HeightMap, NotRead, Request
from roughvol.typing import Array

MAX_BYTES = 1 << 32  # like MAX_NODES far above the size of any contact problem
TEXT = (".txt", ".csv", ".xyz", ".dat", ".asc")
TIFF = (".tif", ".tiff")
GRID = ".grd"  # an ending of many programs
LIMITS = (-32768.0, 32767.0, 65535.0, -2147483648.0, 2147483647.0)  # of whole numbers
SENTINELS = (-9999.0, 9999.0, -99999.0, 99999.0, -999999.0, 1e10, *LIMITS)
BEYOND = 9e36  # pm or more: no height. Programs mark missing heights with larger numbers: 9.97e36, 1.70141e38, -3.4e38
_FAR = 3.0  # least distance of a mark of missing heights from the others, over their range


def describe(
    path: str | Path, variable: str | None = None, *, columns: str | None = None, ignore_header: bool = False
) -> Description:
    """Return the description of a height file, with the arguments of `read`."""
    with _opened(Path(path), variable, columns, ignore_header) as height_map:
        return height_map.description


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
    with _opened(Path(path), variable, columns, ignore_header) as height_map:
        return _checked(height_map.heights(), holes)


@contextlib.contextmanager
def _opened(path: Path, variable: str | None, columns: str | None, ignore_header: bool) -> Iterator[HeightMap]:
    """Open the map in a file, by its content."""
    with description.reading(path), tiff.damage() as damaged, contextlib.ExitStack() as files:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise DatasetError(f"has {size} bytes; allowed: at most {MAX_BYTES}")
        height_map = _by_content(Request(path, variable, columns, ignore_header, files))
        description.map_shape(height_map.description.shape)
        sides, source = height_map.description.sides, height_map.description.source
        if sides is not None and not ignore_header and not all(0.0 < side < math.inf for side in sides):
            raise SurfaceError(f"{source} makes sides of {sides[0]:g} by {sides[1]:g}; allowed: finite and above 0")
        yield _noted(path, height_map, list(damaged))


def _noted(path: Path, height_map: HeightMap, damaged: list[str]) -> HeightMap:
    """Return a map with a note on the damaged parts of its file, and the name of the file before each note."""
    notes = [*height_map.description.notes]
    if damaged:
        more = f" and {len(damaged) - 1} more" * (len(damaged) > 1)
        notes.append(f"is damaged, and read without: {damaged[0]}{more}")
    named = tuple(f"{path.name} {note}" for note in notes)
    return replace(height_map, description=replace(height_map.description, notes=named))


def _by_content(request: Request) -> HeightMap:
    path, suffix = request.path, request.path.suffix.lower()
    if suffix == ".npy":
        request.refuse_variable()
        return _array(request.files.enter_context(path.open("rb")))
    if suffix == ".npz":
        return _npz(request)
    start = description.first_bytes(path, len(netcdf.HDF5))
    if suffix in netcdf.ENDINGS or start.startswith(netcdf.CLASSIC) or (suffix == GRID and start == netcdf.HDF5):
        return netcdf.opened(request)
    if surfer.is_grid(path):
        return surfer.opened(request)
    if simple_field.is_field(path):
        return simple_field.opened(request)
    text = plain_text.is_text(path)
    if suffix in TEXT and text:
        return _text(request)
    try:
        height_map = instrument.opened(request)
    except Exception as refused:  # of the library: errors of all types
        if suffix in TIFF:
            return tiff.opened(request)
        if not isinstance(refused, NotRead):
            raise
        if text and path.stat().st_size:
            return _text(request)
        if suffix == GRID:
            allowed = f"allowed in {GRID}: Surfer grids (DSAA, DSBB, DSRB), netCDF and ESRI ASCII grids"
            raise DatasetError(f"is no Surfer grid; {allowed}; save it as one of them") from refused
        raise
    return _text(request) if height_map.description.reader.endswith(instrument.TEXT) else height_map


def _text(request: Request) -> HeightMap:
    """Read text. SurfaceTopography reads headers that are not understood here."""
    try:
        height_map = text_map.opened(request)
    except (NotRead, SurfaceError) as refused:
        try:
            other = instrument.opened(request)
            lossy = other.description.reader.endswith(instrument.TEXT)
            if lossy and not (isinstance(refused, NotRead) and _is_whole(request.path, other.description)):
                raise refused
        except Exception as error:
            if isinstance(refused, NotRead) and description.EXTRA in str(error):
                raise NotRead(f"{refused}; for headers of other programs: {description.EXTRA}") from None
            raise refused from None
        return other
    request.refuse_variable()
    return height_map


def _is_whole(path: Path, described: Description) -> bool:
    """Return whether a reader that passes over unknown lines found size, unit and all numbers."""
    numbers = plain_text.table(plain_text.split(path))
    return bool(described.sides and described.unit) and numbers.size == math.prod(described.shape)


def _checked(array: NDArray[Any], holes: bool) -> Array:
    if array.dtype.kind not in "fiu":
        raise SurfaceError(f"holds values of type {array.dtype}, not numbers")
    with np.errstate(over="ignore"):  # a long double beyond float64 becomes inf, and is refused below
        heights = np.ascontiguousarray(array, dtype=np.float64)
    missing = ~(np.abs(heights) < BEYOND)
    marks = [f"{mark:g}" for mark in np.unique(heights[missing & np.isfinite(heights)])]
    for mark in SENTINELS:
        marked = heights == mark
        if marked.any() and _far(mark, heights[~marked & ~missing]):
            missing |= marked
            marks.append(f"{mark:g}")
    if missing.all():
        raise SurfaceError(f"none of the {missing.size} heights is known")
    if missing.any() and not holes:
        row, column = np.argwhere(missing)[0]
        count = f"{missing.sum()} height{' is' if missing.sum() == 1 else 's are'}"
        marked_by = f" ({', '.join(marks[:3])} marks a missing one)" if marks else ""
        raise SurfaceError(
            f"{count} missing or not finite, the first in row {row}, column {column}, counted from 0"
            f"{marked_by}; surface.missing: interpolate, or nearest, fills them in a study"
        )
    return np.where(missing, np.nan, heights) if holes else heights


def _far(mark: float, others: Array) -> bool:
    """Return whether a usual mark of missing heights lies far from all other heights."""
    others = others[~np.isin(others, SENTINELS)]
    if not others.size:
        return False
    low, high = float(others.min()), float(others.max())
    return min(abs(mark - low), abs(mark - high)) > _FAR * (high - low) and not low <= mark <= high


def _npz(request: Request) -> HeightMap:
    archive = request.files.enter_context(zipfile.ZipFile(request.path))
    shapes = {}
    for name in archive.namelist():
        if name.endswith(".npy"):  # the headers alone: other arrays may be large
            with archive.open(name) as stream:
                shapes[name.removesuffix(".npy")] = _header_shape(stream)
    chosen = description.array_name(request.variable, shapes)
    return _array(request.files.enter_context(archive.open(f"{chosen}.npy")), chosen)


def _array(stream: IO[bytes], name: str = "") -> HeightMap:
    shape = description.map_shape(_header_shape(stream))

    def heights() -> NDArray[Any]:
        stream.seek(0)
        return np.lib.format.read_array(stream, allow_pickle=False)

    return HeightMap(Description(shape, channel=name, reader="numpy"), heights)


def _header_shape(stream: IO[bytes]) -> tuple[int, ...]:
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    return tuple(read_header(stream)[0])
