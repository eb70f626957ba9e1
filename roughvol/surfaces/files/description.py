"""The height map in a file: shape, size and unit as the file gives them, and the function that reads the heights.

Conventions: the first axis of an array of heights is x, the second y. A side is the length between the centres of the
outer nodes: ``nodes - 1`` pixels. A file that gives the width of all its pixels has a side one pixel shorter.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces import length_units

MAX_NODES = 1 << 28
EXTRA = "pip install 'roughvol[measured]'"
FEWEST = 3  # nodes along an axis of a map
_HEIGHTS = re.compile(r"height|topograph", re.IGNORECASE)
_NO_HEIGHTS = re.compile(
    r"amplitude|deflection|phase|friction|lateral|lock[-_ ]?in|current|potential|voltage|frequency|adhesion|modulus|"
    r"stiffness|dissipation|deformation|indentation|intensity",
    re.IGNORECASE,
)
_ERROR = re.compile(r"error", re.IGNORECASE)  # also that of a height


@dataclass(frozen=True)
class Description:
    """Everything in a file beside its heights."""

    shape: tuple[int, int]  # nodes along x and along y
    sides: tuple[float, float] | None = None  # lengths of the two axes in `unit`; None in a file without size
    unit: str | None = None  # of the sides
    heights_unit: str | None = None
    channel: str = ""  # name of the channel or array
    reader: str = ""
    read_as: str | None = None  # layout of a text, part of the identity of a case
    source: str = ""  # position of the size in the file, for messages
    counted: bool = False  # the sides count nodes, and a length in the study replaces them
    unsized: str = ""  # reason why the sides need a length in the study
    counts: bool = False  # heights are whole numbers of an instrument, in no unit of length
    notes: tuple[str, ...] = ()  # remarks for the user


@dataclass(frozen=True)
class HeightMap:
    """The map in a file: its description, and a function that returns the heights, NaN where they are missing."""

    description: Description
    heights: Callable[[], Any]


@dataclass(frozen=True)
class Request:
    """A height file as a study requests it; a reader is a function of it that returns a `HeightMap`.

    The heights are read while the files are open.
    """

    path: Path
    variable: str | None  # array, channel or page, by its name or its number from 0
    columns: str | None  # "heights": all columns of a text are heights
    ignore_header: bool  # pass over sizes and units
    files: contextlib.ExitStack  # open files

    def refuse_variable(self) -> None:
        """Refuse the name of an array in a file of one array."""
        if self.variable is not None:
            raise DatasetError(f"holds one array, without a name; leave out the variable {self.variable!r}")


class NotRead(DatasetError):
    """A file that one reader does not understand. Another reader may; otherwise this message is final."""


def first_bytes(path: Path, count: int) -> bytes:
    """Return the bytes at the start of a file."""
    with path.open("rb") as stream:
        return stream.read(count)


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn any error on a file into one message with its name: libraries raise errors of all types."""
    try:
        yield
    except (DatasetError, SurfaceError) as error:
        raise type(error)(f"{path}: {error}") from error
    except Exception as error:
        reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        kind = f" as {path.suffix.lower()}" if path.suffix else ""
        raise DatasetError(f"{path}: cannot be read{kind}: {' '.join(reason.split())[:200]}") from error


def binary(path: Path, described: Description, kind: str, start: int, size: int) -> HeightMap:
    """Return the map of binary heights, rows along x, a number of bytes from a position on."""
    nx, ny = described.shape
    each = np.dtype(kind).itemsize
    if size != each * nx * ny:
        raise DatasetError(f"holds {size} bytes of heights; its header gives {nx} x {ny} of {each} bytes each")
    return HeightMap(described, lambda: np.fromfile(path, kind, nx * ny, offset=start).reshape(ny, nx).T.astype("f8"))


def length_unit(unit: object, place: str) -> str | None:
    """Return the name of a unit of length, None for an empty unit or pixels; refuse any other unit."""
    text = unit.decode("latin-1") if isinstance(unit, bytes) else str(unit)
    if text.strip() in ("", "1", "None", "px", "pixel", "pixels"):
        return None
    name = length_units.named(text)
    if name is None:
        raise SurfaceError(f"{place} has the unit {text.strip()[:40]!r}; allowed: {', '.join(length_units.METRES)}")
    return name


def names_no_heights(name: str) -> bool:
    """Return whether a channel holds another quantity than heights by its name, as ``AmplitudeError`` does."""
    return bool(_ERROR.search(name) or (_NO_HEIGHTS.search(name) and not _HEIGHTS.search(name)))


def map_shape(shape: tuple[int, ...]) -> tuple[int, int]:
    """Return the shape of a map; refuse other arrays before they are read, and more nodes than `MAX_NODES`.

    A small compressed file may hold any number of zeros.
    """
    if len(shape) != 2 or min(shape) < FEWEST:
        profile = "; a profile is no map" if sum(length >= FEWEST for length in shape) == 1 else ""
        raise SurfaceError(f"heights have shape {shape}; allowed: two dimensions of at least 3 nodes each{profile}")
    if math.prod(map(int, shape)) > MAX_NODES:
        raise DatasetError(f"the array has shape {shape}; allowed: at most {MAX_NODES} nodes")
    return int(shape[0]), int(shape[1])


def position(names: list[str], wanted: str, listing: str, kind: str) -> int:
    """Return the index of a channel or array, named or numbered from 0; refuse names that match none or several."""
    matches = [index for index, name in enumerate(names) if name == wanted]
    if not matches and wanted.isdecimal() and int(wanted) < len(names):
        return int(wanted)
    if len(matches) != 1:
        reason = f"has several {kind}s {wanted!r}, give the number" if matches else f"has no {kind} {wanted!r}"
        raise DatasetError(f"{reason}; {kind}s in the file: {listing}")
    return matches[0]


def array_name(variable: str | None, shapes: dict[str, tuple[int, ...]]) -> str:
    """Return the name of the array of heights: the wanted one, or the only map of at least 3 x 3 nodes."""
    listing = ", ".join(f"{name} {shape}" for name, shape in shapes.items()) or "none"
    if variable is not None:
        return list(shapes)[position(list(shapes), variable, listing, "array")]
    fields = [name for name, shape in shapes.items() if len(shape) == 2 and min(shape) >= FEWEST]
    if len(fields) == 1:
        return fields[0]
    reason = "give the array of heights (variable)" if fields else "holds no map of at least 3 x 3 nodes"
    raise DatasetError(f"{reason}; arrays in the file: {listing}")
