"""The height map in a file: shape, size and unit as the file gives them, and the function that reads the heights.

Conventions: the first axis of an array of heights is x, the second y. A side is the length between the centres of the
outer nodes, ``nodes - 1`` pixels; a file that gives the width of all its pixels has a side one pixel shorter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces import length_units

MAX_NODES = 1 << 28


@dataclass(frozen=True)
class Description:
    """All that a file gives beside its heights.

    Attributes
    ----------
    shape : (int, int)
        Nodes along x and along y.
    sides : (float, float) or None
        Lengths of the two axes in ``unit``; None if the file gives no size.
    unit, heights_unit : str or None
        Units of the sides and of the heights; None if the file names none.
    channel, reader : str
        Name of the channel or array, and the reader that understood the file.
    read_as : str or None
        Layout of a text, part of the identity of a case.
    source : str
        Place in the file that gives the size, for messages.
    counted : bool
        The coordinates are whole numbers from 0 or 1 without a unit, so a length given by the study replaces them.
    notes : tuple of str
        What the user should look at.
    """

    shape: tuple[int, int]
    sides: tuple[float, float] | None = None
    unit: str | None = None
    heights_unit: str | None = None
    channel: str = ""
    reader: str = ""
    read_as: str | None = None
    source: str = ""
    counted: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class HeightMap:
    """A map found in a file: its description, and a function that returns the heights, NaN where they are missing."""

    description: Description
    heights: Callable[[], Any]


class NotRead(DatasetError):
    """A file that a reader does not understand, so that another one may be asked; the message is final otherwise."""


def length_unit(path: Path, unit: object, place: str) -> str | None:
    """Return the name of a unit of length found in a file; None for an empty one.

    Raises
    ------
    SurfaceError
        If it is no known unit of length.
    """
    text = unit.decode("latin-1") if isinstance(unit, bytes) else str(unit)
    if text.strip() in ("", "1", "None", "px", "pixel", "pixels"):
        return None
    name = length_units.named(text)
    if name is None:
        message = f"{path}: {place} has the unit {text.strip()[:40]!r}; allowed: {', '.join(length_units.METRES)}"
        raise SurfaceError(message)
    return name


def refuse_huge(path: Path, shape: tuple[int, ...]) -> None:
    """Refuse an array before memory is asked for: a small compressed file may hold any number of zeros."""
    nodes = 1
    for number in shape:
        nodes *= int(number)
    if nodes > MAX_NODES:
        message = f"{path}: the array has shape {shape}; allowed: at most {MAX_NODES} nodes"
        raise DatasetError(message)


def chosen(path: Path, names: list[str], wanted: str, held: str, kind: str) -> int:
    """Return the index of a channel or array given by its name, or by its number from 0.

    Raises
    ------
    DatasetError
        If there is no such one, or several of that name.
    """
    found = [index for index, name in enumerate(names) if name == wanted]
    if not found and wanted.isdecimal() and int(wanted) < len(names):
        return int(wanted)
    if len(found) != 1:
        which = f"has several {kind}s {wanted!r}, give the number" if found else f"has no {kind} {wanted!r}"
        message = f"{path}: {which}; {kind}s in the file: {held}"
        raise DatasetError(message)
    return found[0]
