"""Height maps in grids of Surfer: text (DSAA), Surfer 6 (DSBB) and Surfer 7 (DSRB).

Conventions: a row runs along x and has one y, the first row the lowest. The array is the transpose of the rows, so both
axes ascend with the index. The limits of x and y are the coordinates of the outer nodes. A grid has no units. Missing
heights are 1.70141e38, as `reading` marks them; a grid of Surfer 7 may name another number (BlankValue).

Layouts: Golden Software, Surfer help, pages "Surfer 6 Text Grid Format", "Surfer 6 Binary Grid File Format" and
"Surfer 7 Grid File Format".
"""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces.files import plain_text
from roughvol.surfaces.files.description import Description, HeightMap, Request, binary, first_bytes
from roughvol.typing import Array

_HEAD_6 = struct.Struct("<4s2h6d")  # name, nodes along x and y, limits of x, y and z
_GRID_7 = struct.Struct("<2i8d")  # nodes along y and x, lowest x and y, spacings, limits of z, rotation, blank
_TAG_7 = struct.Struct("<4si")  # name and bytes of a section


def is_grid(path: Path) -> bool:
    """Return whether a file starts with the name of a Surfer grid."""
    return first_bytes(path, 4) in _KINDS


def opened(request: Request) -> HeightMap:
    """Return the map in a Surfer grid; binary heights are read on demand."""
    request.refuse_variable()
    return _KINDS[first_bytes(request.path, 4)](request.path)


def _text(path: Path) -> HeightMap:
    (number, start), *others = plain_text.numbered(path)
    lines = [(number, start[4:]), *others]
    filled = [(number, line.strip(" \t\x1a")) for number, line in lines if line.strip(" \t\x1a")]
    numbers = plain_text.words(plain_text.Text([], filled, []))
    if len(numbers) < 8:
        raise DatasetError("ends within its header")
    described = _described("text", *numbers[:6].tolist())
    columns, rows = described.shape
    if len(numbers) - 8 != rows * columns:
        raise SurfaceError(f"holds {len(numbers) - 8} heights; its header gives {columns} x {rows}")
    return HeightMap(described, lambda: numbers[8:].reshape(rows, columns).T)


def _six(path: Path) -> HeightMap:
    head = first_bytes(path, _HEAD_6.size)
    if len(head) < _HEAD_6.size:
        raise DatasetError("ends within its header")
    described = _described("Surfer 6", *_HEAD_6.unpack(head)[1:7])
    return binary(path, described, "<f4", len(head), path.stat().st_size - len(head))


def _seven(path: Path) -> HeightMap:
    sections = _sections(path)
    if not {b"GRID", b"DATA"} <= sections.keys() or sections[b"GRID"][1] < _GRID_7.size:
        raise DatasetError(f"holds the sections {', '.join(map(_printable, sections))}; needed: sections GRID and DATA")
    with path.open("rb") as stream:
        version = int.from_bytes(stream.read(_TAG_7.size + 4)[_TAG_7.size :], "little")
        stream.seek(sections[b"GRID"][0])
        ny, nx, left, front, dx, dy, *_, blank = _GRID_7.unpack(stream.read(_GRID_7.size))
    if version not in (1, 2):
        raise SurfaceError(f"is of version {version}; allowed: 1 and 2")
    limits = left, left + dx * (nx - 1), front, front + dy * (ny - 1)
    values = binary(path, _described("Surfer 7", nx, ny, *limits), "<f8", *sections[b"DATA"])

    def heights() -> Array:
        z = values.heights()
        return np.where(z >= blank if version == 1 else z == blank, math.nan, z)

    return HeightMap(values.description, heights)


def _sections(path: Path) -> dict[bytes, tuple[int, int]]:
    """Return start and size of each section of a grid of Surfer 7 by its name; the first of equal names."""
    sections: dict[bytes, tuple[int, int]] = {}
    end = path.stat().st_size
    with path.open("rb") as stream:
        while len(tag := stream.read(_TAG_7.size)) == _TAG_7.size:
            name, size = _TAG_7.unpack(tag)
            left = end - stream.tell()
            if not 0 <= size <= left:
                raise DatasetError(f"its section {_printable(name)} has {size} bytes, the file {left} from there")
            sections.setdefault(name, (stream.tell(), size))
            stream.seek(size, 1)
    return sections


def _printable(name: bytes) -> str:
    return name.decode("ascii", errors="replace") if name.isalnum() else repr(name)


def _described(kind: str, nx: float, ny: float, left: float, right: float, front: float, back: float) -> Description:
    if not all(math.isfinite(number) and number == int(number) and number > 0 for number in (nx, ny)):
        raise SurfaceError(f"its header gives {nx:g} x {ny:g} nodes; allowed: whole numbers above 0")
    shape, limits = (int(nx), int(ny)), ((left, right), (front, back))
    for name, (low, high) in zip("xy", limits, strict=True):
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise SurfaceError(f"its header gives {name} from {low:g} to {high:g}; allowed: rising and finite")
    counted = all(low in (0.0, 1.0) and high - low == n - 1 for n, (low, high) in zip(shape, limits, strict=True))
    sides, source = (right - left, back - front), "the limits in its header"
    return Description(shape, sides, reader=f"Surfer grid, {kind}", read_as="surfer", source=source, counted=counted)


_KINDS = {b"DSAA": _text, b"DSBB": _six, b"DSRB": _seven}
