"""Header lines of text files: size, units, channel and the names of columns.

Known lines are the exports of Gwyddion (``# Width: 10.00 µm``), ESRI ASCII grids, units of heights alone, and names of
columns with their units (``X [µm]; Y [µm]; Z [nm]``). Any other line with a size or a unit is kept as ``unclear``:
ignored, it might scale the map wrongly.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from roughvol.errors import SurfaceError
from roughvol.surfaces import length_units
from roughvol.surfaces.files.description import NotRead, length_unit

REMEDY = "; delete it, or pass over it with surface.header: ignore and give L and heights_unit"
_FLOAT = r"([-+]?(?:\d+(?:[.,]\d*)?|\.\d+)(?:[eE][-+]?\d+)?)"
_UNIT = (
    r"(?:pm|nm|[uµμ]m|mm|cm|km|microns?|(?:pico|nano|micro|milli|centi)[- ]?met(?:er|re)s?|Å|\u212b|[Aa]ngstr[oö]ms?)"
)
_HAS_UNIT = re.compile(rf"(?<![^\W\d_]){_UNIT}(?![^\W\d_])|{_FLOAT}\s*(?:m|met(?:er|re)s?)\b|[\[(]m[\])]")
_NUMBER_WITH_UNIT = re.compile(rf"{_FLOAT}\s*(?:{_UNIT}|m|met(?:er|re)s?)(?![^\W\d_])")
_LATERAL = re.compile(
    r"\b(?:x|y|xy|lateral|width|length|pixels?|spacing|step|size|scan|axis|cut.?off|tip)\b", re.IGNORECASE
)
_VERTICAL = re.compile(r"\b(?:z|heights?|values?|data|elevations?|topography|depths?)\b", re.IGNORECASE)
_COLUMN = re.compile(r"(x|y|z|h|heights?|elevation|topography)\s*(?:[\[(/_]\s*([^\])]*?)\s*[\])]?)?", re.IGNORECASE)
_ESRI = {"ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy", "nodata_value"}
_SIZE = re.compile(rf"(width|height)\s*[:=]\s*{_FLOAT}\s*(.*)", re.IGNORECASE)
_WORD = re.compile(r"(channel|(?:value|height|z)s?[- ]units?)\s*[:=]\s*(.*)", re.IGNORECASE)
# Sizes and factors that only SurfaceTopography reads, also in comments without a unit
_PIXELS = re.compile(
    r"\b(?:pixel\s+size|lateral[- ]units?)\s*[:=]|(?:^|[\s,;])[hw]\s*=\s*\d+(?!\S*[.\d])", re.IGNORECASE
)
_FACTOR = re.compile(r"\bheight\s+conversion\s+factor\b", re.IGNORECASE)


@dataclass
class Header:
    """The content of the header lines of a text file."""

    size: dict[str, float] = field(default_factory=dict)  # width along the lines and height down the lines, in `unit`
    unit: str | None = None  # of the sizes
    heights_unit: str | None = None
    channel: str = ""
    points: bool = False  # columns are named x, y and z
    esri: dict[str, float] = field(default_factory=dict)  # values of an ESRI ASCII grid
    source: str = ""  # position of the size in the file, for messages
    factor: bool = False  # the heights have a factor, which is not read here
    unclear: tuple[int, str] | None = None  # number and text of the first line that is not understood

    @property
    def described(self) -> dict[str, Any]:
        """What a `Description` takes from the header."""
        return {name: getattr(self, name) for name in ("unit", "heights_unit", "channel", "source")}


def not_understood(path: Path, line: tuple[int, str], remedy: str = "") -> NotRead:
    """Return the error of a header line."""
    return NotRead(f"{path}: line {line[0]} is not understood: {line[1][:80]!r}{remedy}")


def parse(path: Path, lines: list[tuple[int, str]], *, ignore: bool = False) -> Header:
    """Parse header lines, each with its number; ``ignore`` passes over lines with an unknown unit."""
    header = Header()
    for number, line in lines:
        place = f"line {number} ({line if len(line) <= 60 else f'{line[:57]}...'})"
        bare = line.lstrip("#%;/* \t").strip()
        if not bare:
            continue
        factor = _FACTOR.search(bare) is not None
        if factor or _PIXELS.search(bare):
            header.unclear = header.unclear or (number, line)
            header.factor |= factor
            continue
        try:
            taken = _esri(header, bare, place) or _keyed(header, path, bare, place)
            taken = taken or _columns(header, path, bare, place)
        except SurfaceError:
            if not ignore:
                raise
            continue
        if taken:
            continue
        unit = _HAS_UNIT.search(bare)
        if unit and not _NUMBER_WITH_UNIT.search(bare) and _VERTICAL.search(bare) and not _LATERAL.search(bare):
            header.heights_unit = length_unit(path, unit[0].strip("[]()"), place)
        elif header.unclear is None and (unit or bare == line):
            header.unclear = number, line
    return header


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def _esri(header: Header, bare: str, place: str) -> bool:
    words = bare.lower().split()
    if len(words) != 2 or words[0] not in _ESRI:
        return False
    try:
        header.esri[words[0]] = _number(words[1])
    except ValueError:
        return False
    if words[0] in ("cellsize", "dx"):
        header.source = place
    return True


def _keyed(header: Header, path: Path, bare: str, place: str) -> bool:
    """Take a line of a key and its value."""
    if match := _SIZE.fullmatch(bare):
        unit = length_unit(path, match[3], place)
        header.unit = header.unit or unit  # the unit of the first length is that of all
        scale = 1.0 if unit is None or header.unit is None else length_units.factor(unit, header.unit)
        header.size[match[1].lower()] = _number(match[2]) * scale
        header.source = header.source or place
    elif (match := _WORD.fullmatch(bare)) and match[1].lower() == "channel":
        header.channel = match[2].strip()
    elif match:
        header.heights_unit = length_unit(path, match[2], place) or header.heights_unit
    return match is not None


def _lateral(header: Header, path: Path, unit: str, place: str) -> None:
    name = length_unit(path, unit, place)
    if name is not None and header.unit not in (None, name):
        message = f"{path}: {place} is in {name}, another size in {header.unit}; allowed: one unit for both axes"
        raise SurfaceError(message)
    header.unit = header.unit or name


def _columns(header: Header, path: Path, bare: str, place: str) -> bool:
    """Take a line of the names of columns x, y, z, with or without their units."""
    joined = re.sub(r"\s+(?=[\[(])", "", bare.replace('"', ""))
    parts = [part.strip() for part in (re.split(r"[;,\t]", joined) if re.search(r"[;,\t]", joined) else joined.split())]
    columns = [match for part in parts[:3] if (match := _COLUMN.fullmatch(part))]
    names = [column[1].lower() for column in columns]
    if len(names) < 3 or names[:2] != ["x", "y"] or names[2] in "xy":
        return False
    header.points = True
    header.source = place
    for column in columns[:2]:
        if column[2]:
            _lateral(header, path, column[2], place)
    if columns[2][2]:
        header.heights_unit = length_unit(path, columns[2][2], place)
    return True
