"""Header lines of text files: size, units, channel and the names of columns.

Known lines are the exports of Gwyddion (``# Width: 10.00 µm``), lines of ``h= w=``, ``pixel size=`` and ``height
conversion factor``, ESRI ASCII grids, and names of columns with their units (``X [µm]; Y [µm]; Z [nm]``). Any other
line with a size or a unit is kept as ``unclear``: ignored, it might scale the map wrongly.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

from roughvol.errors import SurfaceError
from roughvol.surfaces import length_units
from roughvol.surfaces.files.description import length_unit

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
_KEYED = {
    "channel": re.compile(r"channel\s*[:=]\s*(.*)", re.IGNORECASE),
    "width": re.compile(rf"width\s*[:=]\s*{_FLOAT}\s*(.*)", re.IGNORECASE),
    "height": re.compile(rf"height\s*[:=]\s*{_FLOAT}\s*(.*)", re.IGNORECASE),
    "values": re.compile(r"(?:value|height|z)s?[- ]units?\s*[:=]\s*(.*)", re.IGNORECASE),
    "lateral": re.compile(r"lateral[- ]units?\s*[:=]\s*(.*)", re.IGNORECASE),
    "pixel": re.compile(rf"pixel\s+size\s*[:=]\s*{_FLOAT}\s*(.*)", re.IGNORECASE),
    "factor": re.compile(
        rf"height\s+conversion\s+factor\s*(?:\(\s*->\s*(.*?)\s*\))?\s*[:=]\s*{_FLOAT}\s*(.*)", re.IGNORECASE
    ),
}
_COUNTS = re.compile(r"(?:^|[\s,;])([hw])\s*=\s*(\d+)(?!\S*[.\d])", re.IGNORECASE)


@dataclass
class Header:
    """The content of the header lines of a text file.

    Attributes
    ----------
    size : list of float or None
        Size of all pixels along the lines and down the lines, in ``unit``.
    pixel : float or None
        Size of one pixel, in ``unit``.
    counts : dict of int
        Pixels along the lines ("w") and down the lines ("h").
    unit, heights_unit : str or None
        Units of the sizes and of the heights.
    factor : float
        Factor of the heights.
    channel : str
        Name of the channel.
    points : bool
        Columns are named x, y and z.
    esri : dict of float
        Values of an ESRI ASCII grid.
    source : str
        Position of the size in the file, for messages.
    unclear : (int, str) or None
        Number and text of the first line that is not understood.
    """

    size: list[float | None] = field(default_factory=lambda: [None, None])
    pixel: float | None = None
    counts: dict[str, int] = field(default_factory=dict)
    unit: str | None = None
    heights_unit: str | None = None
    factor: float = 1.0
    channel: str = ""
    points: bool = False
    esri: dict[str, float] = field(default_factory=dict)
    source: str = ""
    unclear: tuple[int, str] | None = None

    @property
    def along_lines(self) -> bool:
        """Whether the header gives the axis along the lines, which then is x."""
        return self.pixel is not None or self.size != [None, None] or bool(self.counts)


def parse(path: Path, lines: list[tuple[int, str]], *, ignore: bool = False) -> Header:
    """Parse header lines.

    Parameters
    ----------
    path : Path
        File, for messages.
    lines : list of (int, str)
        Numbers and text of the lines before the first line of data.
    ignore : bool
        Pass over lines with an unknown unit.

    Returns
    -------
    Header
        Their content.

    Raises
    ------
    SurfaceError
        If a unit is no unit of length, or differs between columns of coordinates, or the heights have the factor 0.
    """
    header = Header()
    for number, line in lines:
        place = f"line {number} ({_short(line)})"
        bare = line.lstrip("#%;/* \t").strip()
        if not bare:
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


def _short(line: str) -> str:
    return line if len(line) <= 60 else f"{line[:57]}..."


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
    for key, pattern in _KEYED.items():
        match = pattern.fullmatch(bare)
        if match is None:
            continue
        if key == "channel":
            header.channel = match[1].strip()
        elif key in ("values", "factor") and (unit := match[1] or ""):
            header.heights_unit = length_unit(path, unit, place)
        elif key == "lateral":
            _lateral(header, path, match[1], place)
        elif key in ("width", "height", "pixel"):
            length = _number(match[1]) * _prefix(header, path, match[2], place)
            header.source = header.source or place
            if key == "pixel":
                header.pixel = length
            else:
                header.size[key == "height"] = length
        if key == "factor":
            header.factor = _number(match[2])
            if not 0.0 < abs(header.factor) < math.inf:
                raise SurfaceError(f"{path}: {place} is {header.factor:g}; allowed: finite and not 0")
        return True
    counts = {name.lower(): int(value) for name, value in _COUNTS.findall(bare)}
    header.counts |= counts
    return bool(counts)


def _prefix(header: Header, path: Path, unit: str, place: str) -> float:
    """Return the factor from the unit of a length to that of the first length, which is the unit of all."""
    name = length_unit(path, unit, place)
    header.unit = header.unit or name
    return 1.0 if name is None or header.unit is None else length_units.factor(name, header.unit)


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
