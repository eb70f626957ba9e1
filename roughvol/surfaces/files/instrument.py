"""Height maps from the files of instruments, through the library SurfaceTopography (optional: roughvol[measured]).

Conventions: the first axis of the array is x of the file, and a missing height is NaN. Nodes are one pixel apart, so an
axis is one pixel shorter than all its pixels. The library recognises a format by its content. Two formats without any
mark (NMS, HGT) count only in files with this ending. HDF5 and MATLAB hold arrays of any meaning: of several, one is
named. Channels that are no heights by their kind, unit or name are refused.

NMS has no unit of its pixels. The library takes the numbers for mm, the reader of surfalize for nm: 512 pixels of 312.5
are 160 m or 160 um. So the length of the axis is that of the study.
"""

from __future__ import annotations

import contextlib
import re
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from roughvol.errors import SurfaceError
from roughvol.surfaces.files.description import (
    EXTRA,
    Description,
    HeightMap,
    NotRead,
    array_name,
    length_unit,
    names_no_heights,
    position,
    reading,
)
from roughvol.typing import Array

UNMARKED = ("nms", "hgt")
ARRAYS = ("h5", "mat")  # formats of arrays without meaning
UNSIZED = "nms"
TEXT = ("asc", "xyz")  # readers of text in the library


def opened(path: Path, channel: str | None = None) -> HeightMap:
    """Return the map in the file of an instrument; its heights are read on demand."""
    with _opened(path) as reader:
        described = _described(path, reader, channel)
    return HeightMap(described, lambda: _read(path, channel))


def _read(path: Path, channel: str | None) -> Array:
    with _opened(path) as reader:
        data = _channel(path, reader, channel)
        # The library builds no map without a size. Any size does where the file gives none.
        size = None if data.physical_sizes is not None else tuple(map(float, data.nb_grid_pts))
        heights = data.topography(physical_sizes=size).heights()
    return np.ma.filled(np.ma.asarray(heights, dtype=np.float64), np.nan)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the library warns that it runs without MPI
            from SurfaceTopography import open_topography
            from SurfaceTopography.Exceptions import CannotDetectFileFormat
    except ImportError as error:
        raise NotRead(f"{path}: is read through SurfaceTopography, which is not installed: {EXTRA}") from error
    # The library has forty readers of binary formats. On damaged files they raise errors of any type.
    with warnings.catch_warnings(), reading(path, ""):
        warnings.simplefilter("ignore")
        try:
            path.open("rb").close()
            with _recognised(open_topography, path) as reader:
                if reader.format() in UNMARKED and path.suffix.lower() != f".{reader.format()}":
                    raise CannotDetectFileFormat
                yield reader
        except CannotDetectFileFormat as error:
            raise NotRead(f"{path}: is damaged, or in none of the formats that SurfaceTopography reads") from error


def _recognised(open_topography: Any, path: Path) -> Any:
    """Return the reader of a file. Files of an unmarked format may look like another one."""
    ending = path.suffix.lower().removeprefix(".")
    if ending in UNMARKED:
        with contextlib.suppress(Exception):
            return open_topography(str(path), format=ending)
    return open_topography(str(path))


def _channel(path: Path, reader: Any, wanted: str | None) -> Any:
    """Return a channel of heights by name or number. Default: that of the format, or the first one."""
    channels = list(reader.channels)
    if reader.format() in ARRAYS:
        shapes = {data.name: tuple(data.nb_grid_pts or ()) for data in channels}
        wanted = array_name(path, wanted, shapes)
    maps = {data.index: data for data in channels if not _no_heights(data)}
    if wanted is not None:
        kinds = (
            "no heights" if _is_height(data) and data.index not in maps else data.data_kind.value for data in channels
        )
        listing = ", ".join(f"{text} ({kind})" for text, kind in zip(_texts(channels), kinds, strict=True))
        chosen = channels[position(path, [data.name for data in channels], wanted, listing, "channel")]
    elif not channels:
        raise SurfaceError(f"{path}: holds no channels")
    else:
        chosen = reader.default_channel
        if chosen.index not in maps:
            chosen = next(iter(maps.values()), chosen)
    if reason := _no_heights(chosen):
        message = f"{path}: {chosen.name} {reason}; channels of heights: {', '.join(_texts(maps.values())) or 'none'}"
        raise SurfaceError(message)
    return chosen


def _texts(channels: Iterable[Any]) -> list[str]:
    return [f"{data.index}: {data.name}" for data in channels]


def _is_height(data: Any) -> bool:
    return bool(data.data_kind.value == "height")


def _no_heights(data: Any) -> str:
    """Return why a channel is none of heights, empty if it may be one."""
    if not _is_height(data):
        return f"holds {data.data_kind.value}, not heights"
    if isinstance(data.unit, tuple):  # lateral and vertical unit: the library finds no heights in the second
        return "holds no heights: its unit is no length"
    return "holds no heights, by its name" if names_no_heights(data.name.rpartition("/")[2]) else ""


def _described(path: Path, reader: Any, wanted: str | None) -> Description:
    channel = _channel(path, reader, wanted)
    if reader.format() in TEXT:
        _refuse_lost_lines(path)
    shape = tuple(channel.nb_grid_pts or ())
    if channel.dim != 2 or len(shape) != 2 or channel.is_uniform is False or min(shape) < 3:
        message = f"{path}: {channel.name} has nodes {shape}; allowed: a map of equidistant nodes, at least 3 x 3"
        raise SurfaceError(message)
    unit = None if channel.unit is None else length_unit(path, channel.unit, channel.name)
    sizes = channel.physical_sizes
    sides = None if sizes is None else (_side(sizes[0], shape[0]), _side(sizes[1], shape[1]))
    maps = [data for data in reader.channels if not _no_heights(data) and data.dim == 2]
    other = f"channel {channel.index}" if wanted is None and channel.index != reader.default_channel.index else None
    notes: tuple[str, ...] = ()
    if wanted is None and len(maps) > 1:
        listing = ", ".join(_texts(maps))
        notes = (f"{path.name} holds {len(maps)} maps ({listing}); {channel.index} is read, variable names another",)
    unsized = ""
    if reader.format() == UNSIZED and sides is not None:
        x, y = (1e-3 * side / (nodes - 1) for side, nodes in zip(sides, shape, strict=True))
        would = f"in nm, L would be {1e-3 * x * (shape[0] - 1):.6g} um"
        unsized = f"its pixels are {x:.6g} by {y:.6g} of an unknown unit; {would}"
    nodes, lateral, source = (int(shape[0]), int(shape[1])), None if unsized else unit, "its header" if sides else ""
    name, counted = f"SurfaceTopography {reader.format()}", bool(unsized)
    return Description(nodes, sides, lateral, unit, channel.name, name, other, source, counted, unsized, notes=notes)


def _side(size: float, nodes: int) -> float:
    """Return the length between the outer nodes from that of all pixels."""
    return float(size) / nodes * (nodes - 1)


def _refuse_lost_lines(path: Path) -> None:
    """Refuse text with other lines between lines of numbers. The library skips them, or joins two maps."""
    numbers, skipped = 0, 0
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if all(re.fullmatch(r"[-+.\deE]+|bad|nan|[-+]?inf(?:inite)?", word, re.IGNORECASE) for word in words):
            if skipped:
                message = (
                    f"{path}: line {skipped} holds no numbers, between lines of numbers; delete it, or mark it as NaN"
                )
                raise SurfaceError(message)
            numbers += 1
        elif numbers:
            skipped = skipped or number
