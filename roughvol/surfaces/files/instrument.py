"""Height maps from the files of instruments, through the library SurfaceTopography (optional: roughvol[measured]).

Conventions: the first axis of the array is x of the file; a height that the instrument did not find is NaN. Nodes are
one pixel apart, so the length of the first axis is that of its pixels less one. The library recognises a format by its
content; two formats without any mark (NMS, HGT) are believed only of a file that ends so.
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

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces.files.description import Description, HeightMap, NotRead, chosen, length_unit, refuse_huge
from roughvol.typing import Array

EXTRA = "pip install 'roughvol[measured]'"
UNMARKED = ("nms", "hgt")
TEXT = ("asc", "xyz")  # what the library calls its readers of text without a mark


def opened(path: Path, channel: str | None = None) -> HeightMap:
    """Return the map that the library finds in a file; the heights are read when they are asked for.

    Parameters
    ----------
    path : Path
        File of an instrument.
    channel : str, optional
        Name of the channel, or its number from 0; the one that the format counts as its heights if not given.

    Raises
    ------
    NotRead
        If the library is not there, or does not recognise the file.
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
        one = _chosen(path, reader, channel)
        # the library builds no map without a size; where the file gives none, any will do
        size = None if one.physical_sizes is not None else tuple(map(float, one.nb_grid_pts))
        heights = one.topography(physical_sizes=size).heights()
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
    # Forty readers of binary formats raise whatever comes when a file lies to them, hence the bare Exception.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            path.open("rb").close()
            with open_topography(str(path)) as reader:
                if reader.format() in UNMARKED and path.suffix.lower() != f".{reader.format()}":
                    raise CannotDetectFileFormat
                yield reader
        except (DatasetError, SurfaceError):
            raise
        except CannotDetectFileFormat as error:  # what it says is what each of the readers said
            message = f"{path}: is damaged, or in none of the formats that SurfaceTopography reads"
            raise NotRead(message) from error
        except Exception as error:
            said = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
            message = f"{path}: cannot be read: {' '.join(said.split())[:200]}"
            raise DatasetError(message) from error


def _chosen(path: Path, reader: Any, channel: str | None) -> Any:
    """Return the channel named or numbered, or the one that the format counts as its heights."""
    if channel is None:
        return reader.default_channel
    channels = list(reader.channels)
    held = ", ".join(f"{number}: {one.name} ({one.data_kind.value})" for number, one in enumerate(channels))
    return channels[chosen(path, [one.name for one in channels], channel, held, "channel")]


def _described(path: Path, reader: Any, wanted: str | None) -> Description:
    channel = _chosen(path, reader, wanted)
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
    heights = [one for one in reader.channels if one.data_kind.value == "height" and one.dim == 2]
    notes: tuple[str, ...] = ()
    if wanted is None and len(heights) > 1:
        held = ", ".join(f"{one.index}: {one.name}" for one in heights)
        notes = (f"{path.name} holds {len(heights)} maps ({held}); {channel.index} is read, variable names another",)
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
    """Refuse text in which the library's reader skips a line among the numbers, or joins two maps of one name."""
    numbers, skipped = 0, 0
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if all(re.fullmatch(r"[-+.\deE]+|bad|nan|[-+]?inf(?:inite)?", word, re.IGNORECASE) for word in words):
            if skipped:
                message = f"{path}: line {skipped} stands among the numbers and is none; delete it, or mark it as NaN"
                raise SurfaceError(message)
            numbers += 1
        elif numbers:
            skipped = skipped or number
