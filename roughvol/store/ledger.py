"""The ledger of a folder: size and time of the file of each finished case, when a run last saw that it is sound.

It spares `status` the opening of every file. A line is written when a case has been stored, and all are written anew
when a run has checked every bit of every file. Nothing else trusts it: `run` and `collect` read the files themselves,
and a file that has no line, or another size or time than its line says, is opened by `status` too. So a ledger that is
torn, old, or gone costs time, and no more.

    {"format": …, "ledger": 2}                       of the files and of the lines, on the first line
    <id> <bytes> <time of change, ns> <version>      a line for each case, with the version of roughvol that computed it
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from roughvol.errors import FolderError
from roughvol.store import stamped_file

Seen = tuple[int, int]  # bytes, and nanoseconds of the last change

MAX_BYTES = 1 << 26  # 100 000 lines are 6 MB
_HEAD = json.dumps({"format": stamped_file.FORMAT, "ledger": 2}, sort_keys=True)


class Entry(NamedTuple):
    """The line of a case: its file as it was seen, and the version of roughvol in it."""

    seen: Seen
    version: str


def files(folder: Path, suffix: str) -> dict[str, Seen]:
    """Return the size and time of each file of a folder that ends so, by its name without the ending."""
    found = {}
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(suffix) and not entry.name.startswith("."):
                with contextlib.suppress(FileNotFoundError):  # one that has just been removed
                    standing = entry.stat()
                    found[entry.name.removesuffix(suffix)] = (standing.st_size, standing.st_mtime_ns)
    return found


def read(path: Path) -> dict[str, Entry]:
    """Return what a ledger holds; nothing if it is of another format, or there is none."""
    try:
        with path.open("rb") as stream:
            head, *lines = stream.read(MAX_BYTES).decode().split("\n")
    except (OSError, UnicodeDecodeError):
        return {}
    if head != _HEAD:
        return {}
    found = {}
    for line in lines:
        id, *rest = line.split(" ")
        if len(rest) == 3 and all(number.isascii() and number.isdigit() for number in rest[:2]):
            found[id] = Entry((int(rest[0]), int(rest[1])), rest[2])
    return found


def write(path: Path, entries: Mapping[str, Entry]) -> None:
    """Write a ledger anew; that it cannot be written is no reason to stop."""
    with contextlib.suppress(FolderError):
        stamped_file.store(path, "\n".join([_HEAD, *_lines(entries.items())]).encode() + b"\n")


def add(path: Path, id: str, file: Path, version: str) -> None:
    """Add the file of a case that has just been stored."""
    with contextlib.suppress(OSError):
        standing = file.stat()
        with path.open("a", encoding="utf-8") as stream:
            entry = Entry((standing.st_size, standing.st_mtime_ns), version)
            stream.write("\n".join([*_lines([(id, entry)]), ""]))


def _lines(items: Iterable[tuple[str, Entry]]) -> Iterable[str]:
    return (f"{id} {size} {time} {version}" for id, ((size, time), version) in items)
