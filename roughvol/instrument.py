"""Height maps from the files of instruments, through the library SurfaceTopography (optional: roughvol[measured]).

Conventions: the first axis of the array is x of the file; a height that the instrument did not find is NaN. Nodes are
one pixel apart, so the length of the first axis is that of its pixels less one. The library recognises a format by its
content; two formats without any mark (NMS, HGT) are believed only of a file that ends so.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol import lengths
from roughvol.errors import DatasetError, SurfaceError

Heights = NDArray[np.float64]

EXTRA = "pip install 'roughvol[measured]'"
MAX_NODES = 1 << 28
UNMARKED = ("nms", "hgt")


@dataclass(frozen=True)
class Description:
    """What a file tells about its heights: nodes, lengths of both axes and unit (None: not told), channel."""

    shape: tuple[int, int]
    sides: tuple[float, float] | None
    unit: str | None
    channel: str

    @property
    def side(self) -> float | None:
        """Length of the first axis."""
        return None if self.sides is None else self.sides[0]


def describe(path: Path, channel: str | None = None) -> Description:
    """Return what a file tells about its heights without reading them.

    Parameters
    ----------
    path : Path
        File of an instrument.
    channel : str, optional
        Name of the channel; the one that the format counts as its heights if not given.

    Raises
    ------
    DatasetError
        If the library is not there, the file is missing or broken, or has no such channel.
    SurfaceError
        If the channel is no map of heights.
    """
    with _opened(path) as reader:
        return _described(path, _chosen(path, reader, channel))


def read(path: Path, channel: str | None = None) -> Heights:
    """Return the heights of a channel in the unit that `describe` names, NaN where they are missing.

    Raises as `describe`.
    """
    with _opened(path) as reader:
        chosen = _chosen(path, reader, channel)
        described = _described(path, chosen)
        # the library builds no map without a size; where the file tells none, any will do
        size = None if chosen.physical_sizes is not None else tuple(map(float, described.shape))
        heights = chosen.topography(physical_sizes=size).heights()
    return np.ma.filled(np.ma.asarray(heights, dtype=np.float64), np.nan)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        from SurfaceTopography import open_topography
        from SurfaceTopography.Exceptions import CannotDetectFileFormat
    except ImportError as error:
        message = f"{path}: is read through SurfaceTopography, which is not installed: {EXTRA}"
        raise DatasetError(message) from error
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
            raise DatasetError(message) from error
        except Exception as error:
            said = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
            message = f"{path}: cannot be read: {' '.join(said.split())[:200]}"
            raise DatasetError(message) from error


def _chosen(path: Path, reader: Any, channel: str | None) -> Any:
    """Return the channel named, or the one that the format counts as its heights."""
    if channel is None:
        return reader.default_channel
    found = [one for one in reader.channels if one.name == channel]
    if len(found) != 1:
        held = ", ".join(f"{one.name} ({one.data_kind.value})" for one in reader.channels)
        which = "several channels" if found else "no channel"
        message = f"{path}: has {which} {channel!r}; channels in the file: {held}"
        raise DatasetError(message)
    return found[0]


def _described(path: Path, channel: Any) -> Description:
    shape = tuple(channel.nb_grid_pts or ())
    if channel.dim != 2 or len(shape) != 2 or channel.is_uniform is False or min(shape) < 3:
        message = f"{path}: {channel.name} has nodes {shape}; allowed: a map of equidistant nodes, at least 3 x 3"
        raise SurfaceError(message)
    if channel.data_kind.value != "height":
        message = f"{path}: {channel.name} holds {channel.data_kind.value}, not heights"
        raise SurfaceError(message)
    if math.prod(shape) > MAX_NODES:
        message = f"{path}: holds an array of shape {shape}; allowed: at most {MAX_NODES} nodes"
        raise DatasetError(message)
    unit = None if channel.unit is None else lengths.named(channel.unit)
    if channel.unit is not None and unit is None:
        message = f"{path}: heights are in {channel.unit!r}; allowed: {', '.join(lengths.METRES)}"
        raise SurfaceError(message)
    return Description(shape, _sides(path, shape, channel.physical_sizes), unit, channel.name)


def _sides(path: Path, shape: tuple[int, ...], sizes: tuple[float, float] | None) -> tuple[float, float] | None:
    if sizes is None:
        return None
    pixel = [float(size) / nodes for size, nodes in zip(sizes, shape, strict=True)]
    if not all(math.isfinite(side) and side > 0.0 for side in pixel):
        message = f"{path}: pixels of {pixel[0]:.6g} by {pixel[1]:.6g}; allowed: finite and positive"
        raise SurfaceError(message)
    return pixel[0] * (shape[0] - 1), pixel[1] * (shape[1] - 1)
