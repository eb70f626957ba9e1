"""Height maps from the files of instruments, through the library SurfaceTopography (optional: roughvol[measured]).

Conventions: the first axis of the array is x of the file, and a missing height is NaN. Nodes are one pixel apart, so an
axis is one pixel shorter than all its pixels. The library recognises a format by its content. Two formats without any
mark (NMS, HGT) count only in files with this ending.
"""

from __future__ import annotations

import contextlib
import math
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from roughvol.errors import SurfaceError
from roughvol.surfaces.files.description import (
    EXTRA,
    Description,
    HeightMap,
    NotRead,
    length_unit,
    position,
    reading,
    refuse_huge,
)
from roughvol.typing import Array

UNMARKED = ("nms", "hgt")
TEXT = ("asc", "xyz")  # readers of text in the library


def opened(path: Path, channel: str | None = None) -> HeightMap:
    """Return the map in the file of an instrument; its heights are read on demand.

    Parameters
    ----------
    path : Path
        File.
    channel : str, optional
        Name of the channel, or its number from 0. Default: the channel of heights in the format.

    Returns
    -------
    HeightMap
        The map.

    Raises
    ------
    NotRead
        If the library is not installed, or does not recognise the file.
    DatasetError
        If the file is missing or broken, or has no such channel.
    SurfaceError
        If the channel is no map of heights.
    """
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
        message = f"{path}: is read through SurfaceTopography, which is not installed: {EXTRA}"
        raise NotRead(message) from error
    # The library has forty readers of binary formats. On damaged files they raise errors of any type.
    with warnings.catch_warnings(), reading(path, ""):
        warnings.simplefilter("ignore")
        try:
            path.open("rb").close()
            with open_topography(str(path)) as reader:
                if reader.format() in UNMARKED and path.suffix.lower() != f".{reader.format()}":
                    raise CannotDetectFileFormat
                yield reader
        except CannotDetectFileFormat as error:
            message = f"{path}: is damaged, or in none of the formats that SurfaceTopography reads"
            raise NotRead(message) from error


def _channel(path: Path, reader: Any, wanted: str | None) -> Any:
    """Return a channel by name or number. Default: the channel of heights in the format."""
    if wanted is None:
        return reader.default_channel
    channels = list(reader.channels)
    listing = ", ".join(f"{number}: {data.name} ({data.data_kind.value})" for number, data in enumerate(channels))
    return channels[position(path, [data.name for data in channels], wanted, listing, "channel")]


def _described(path: Path, reader: Any, wanted: str | None) -> Description:
    channel = _channel(path, reader, wanted)
    if reader.format() in TEXT:
        _refuse_lost_lines(path)
    shape = tuple(channel.nb_grid_pts or ())
    if channel.dim != 2 or len(shape) != 2 or channel.is_uniform is False or min(shape) < 3:
        message = f"{path}: {channel.name} has nodes {shape}; allowed: a map of equidistant nodes, at least 3 x 3"
        raise SurfaceError(message)
    if channel.data_kind.value != "height":
        message = f"{path}: {channel.name} holds {channel.data_kind.value}, not heights"
        raise SurfaceError(message)
    refuse_huge(path, shape)
    unit = None if channel.unit is None else length_unit(path, channel.unit, channel.name)
    sides = _sides(path, shape, channel.physical_sizes)
    maps = [data for data in reader.channels if data.data_kind.value == "height" and data.dim == 2]
    notes: tuple[str, ...] = ()
    if wanted is None and len(maps) > 1:
        listing = ", ".join(f"{data.index}: {data.name}" for data in maps)
        notes = (f"{path.name} holds {len(maps)} maps ({listing}); {channel.index} is read, variable names another",)
    return Description(
        (int(shape[0]), int(shape[1])),
        sides,
        unit,
        unit,
        channel.name,
        f"SurfaceTopography {reader.format()}",
        source="its header" if sides else "",
        notes=notes,
    )


def _sides(path: Path, shape: tuple[int, ...], sizes: tuple[float, float] | None) -> tuple[float, float] | None:
    if sizes is None:
        return None
    pixel = [float(size) / nodes for size, nodes in zip(sizes, shape, strict=True)]
    if not all(math.isfinite(side) and side > 0.0 for side in pixel):
        message = f"{path}: pixels of {pixel[0]:.6g} by {pixel[1]:.6g}; allowed: finite and positive"
        raise SurfaceError(message)
    return pixel[0] * (shape[0] - 1), pixel[1] * (shape[1] - 1)


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
