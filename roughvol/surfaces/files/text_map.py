"""Height maps in text: rows of heights with or without a header, points x y z, and ESRI ASCII grids.

Conventions: without labels, each line is a row of the array, as numpy.savetxt writes it. A header with the size along
the lines (Width, ncols) makes that axis x, and the array the transpose of the text. Points and ESRI grids have
coordinates: both axes ascend with the index. Nodes of a grid without a point are missing (NaN).

Known header lines are the exports of Gwyddion (``# Width: 10.00 µm``), ESRI ASCII grids, units of heights alone, and
names of columns with their units, in any order (``X [µm]; Y [µm]; Z [nm]``, or units in the next line). Any other
line with a size or a unit is kept as ``unclear``: ignored, it might scale the map wrongly.

The readers of SurfaceTopography skip every line that is not numbers: a row with ``***`` is lost. They take no decimal
commas, semicolons, ESRI headers or NODATA values.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np

from roughvol.errors import SurfaceError
from roughvol.surfaces import length_units
from roughvol.surfaces.files import plain_text
from roughvol.surfaces.files.description import Description, HeightMap, NotRead, Request, length_unit, names_no_heights
from roughvol.typing import Array, Index

INSIST = "surface.columns: heights takes all numbers as heights"
REMEDY = "; delete it, or pass over it with surface.header: ignore and give L and heights_unit"
_FLOAT = r"([-+]?(?:\d+(?:[.,]\d*)?|\.\d+)(?:[eE][-+]?\d+)?)"
_UNIT = (
    r"(?:pm|nm|[uµμ]m|mm|cm|km|microns?|(?:pico|nano|micro|milli|centi)[- ]?met(?:er|re)s?|Å|\u212b|[Aa]ngstr[oö]ms?|"
    r"(?:micro[- ]?|[uµμ])?inch(?:es)?)"
)
_HAS_UNIT = re.compile(
    rf"(?<![^\W\d_]){_UNIT}(?![^\W\d_])|{_FLOAT}\s*(?:m|met(?:er|re)s?)\b|[\[(]m[\])]|"
    r"\bin\s+(?:m|met(?:er|re)s?)(?=$|[,;.])"
)
_NUMBER_WITH_UNIT = re.compile(rf"{_FLOAT}\s*(?:{_UNIT}|m|met(?:er|re)s?)(?![^\W\d_])")
_LATERAL = re.compile(r"\b(?:x|y|xy|lateral|width|length|pixels?|spacing|step|size|scan|axis|cut.?off|tip)\b", re.I)
_VERTICAL = re.compile(r"\b(?:z|heights?|values?|data|elevations?|topography|depths?)\b", re.I)
_COLUMN = re.compile(r"(x|y|z|h|heights?|elevation|topography)\s*(?:[\[(/_]\s*([^\])]*?)\s*[\])]?)?", re.I)
_ESRI = re.compile(
    r"(ncols|nrows|[xy]ll(?:corner|center)|cellsize|dx|dy|nodata_value)\s+([-+.,\deE]+|[-+]?(?:nan|inf))", re.I
)
_SIZE = re.compile(rf"(width|height)\s*[:=]\s*{_FLOAT}\s*(.*)", re.I)
_CHANNEL = re.compile(r"channel\s*[:=]\s*(.*)", re.I)
_HEIGHTS_UNIT = re.compile(r"(?:value|height|z)s?[- ]units?\s*[:=]\s*(.*)", re.I)
# Sizes and factors that only SurfaceTopography reads, also in comments without a unit
_PIXELS = re.compile(r"\b(?:pixel\s+size|lateral[- ]units?)\s*[:=]|(?:^|[\s,;])[hw]\s*=\s*\d+(?!\S*[.\d])", re.I)
_FACTOR = re.compile(r"\bheight\s+conversion\s+factor\b", re.I)
_EVEN = 1e-6  # largest relative difference of steps of a coordinate
_LINE = 8  # least number of even steps that make a coordinate of one line alone
_DIGITS = 6  # significant digits of %g
_COARSE = 2.0  # least step of printed coordinates, in units of their last digit
_SAME = 1e-6  # largest difference of equal coordinates of points, over the span
_REGULAR = 0.02  # largest distance of a point from its node, in spacings
_CROWDED = 4  # most nodes a point for which points on a node are counted
_COVERED = 0.5  # least share of nodes with a point


def opened(request: Request) -> HeightMap:
    """Return the map in a text file."""
    ignored = request.ignore_header
    text = plain_text.split(request.path)
    header = _parsed(text.header, ignored)
    for number, comment in text.comments:
        if _parsed([(number, comment)], ignored=True) != Header():
            raise SurfaceError(f"line {number} is a header among the numbers: {comment[:80]!r}; allowed: one map")
    if names_no_heights(header.channel) and not ignored:
        raise SurfaceError(f"the channel {header.channel!r} holds no heights, by its name; if it does: header: ignore")
    if header.esri:
        return _esri(text, header)
    complete = header.size and header.unit and header.heights_unit and not header.factor
    if header.unclear is not None and not complete and not ignored:
        error = _not_understood(header.unclear, REMEDY)
        # SurfaceTopography multiplies a width by the size of a pixel where a header gives both
        raise SurfaceError(str(error)) if header.size else error
    numbers = plain_text.table(text)
    if not header.points and numbers.shape[1] != 3:
        plain_text.refuse_parts(text)
    if header.size and not header.points:
        return _sized(numbers, header)
    if request.columns == "heights":
        return header.map(numbers, None, "text, rows", "rows")
    if header.points or numbers.shape[1] == 3:
        return _points(numbers[:, header.points or [0, 1, 2]], header)
    _refuse_coordinates(numbers)
    return header.map(numbers, None, "text, rows", "rows")


@dataclass
class Header:
    """The content of the header lines of a text file."""

    size: dict[str, float] = field(default_factory=dict)  # width along the lines and height down the lines, in `unit`
    unit: str | None = None  # of the sizes
    heights_unit: str | None = None
    channel: str = ""
    points: list[int] = field(default_factory=list)  # the columns named x, y and z
    esri: dict[str, float] = field(default_factory=dict)  # values of an ESRI ASCII grid
    source: str = ""  # position of the size in the file, for messages
    factor: bool = False  # the heights have a factor, which is not read here
    unclear: tuple[int, str] | None = None  # number and text of the first line that is not understood

    def map(
        self, heights: Array, sides: tuple[float, float] | None, reader: str, read_as: str, counted: bool = False
    ) -> HeightMap:
        """Return the map of heights under this header."""
        shape = heights.shape[0], heights.shape[1]
        described = Description(
            shape, sides, self.unit, self.heights_unit, self.channel, reader, read_as, self.source, counted
        )
        return HeightMap(described, lambda: heights)


def _parsed(lines: list[tuple[int, str]], ignored: bool) -> Header:
    """Parse header lines, each with its number; those with an unknown unit may be ignored."""
    header = Header()
    for number, line in lines:
        bare = line.lstrip("#%;/* \t").strip()
        place = f"line {number} ({line if len(line) <= 60 else f'{line[:57]}...'})"
        try:
            if not bare or _taken(header, bare, place):
                continue
        except SurfaceError:
            if not ignored:
                raise
            continue
        factor, unit = _FACTOR.search(bare) is not None, _HAS_UNIT.search(bare)
        header.factor |= factor
        if header.unclear is None and (factor or unit or _PIXELS.search(bare) or bare == line):
            header.unclear = number, line
    return header


def _taken(header: Header, bare: str, place: str) -> bool:
    """Take the content of a header line; return whether it is known."""
    if _FACTOR.search(bare) or _PIXELS.search(bare):
        return False
    if match := _ESRI.fullmatch(bare):
        key = match[1].lower()
        header.esri[key] = _number(match[2])
        if key in ("cellsize", "dx"):
            header.source = place
    elif match := _SIZE.fullmatch(bare):
        unit = length_unit(match[3], place)
        header.unit = header.unit or unit  # the unit of the first length is that of all
        scale = 1.0 if unit is None or header.unit is None else length_units.factor(unit, header.unit)
        header.size[match[1].lower()] = _number(match[2]) * scale
        header.source = header.source or place
    elif match := _CHANNEL.fullmatch(bare):
        header.channel = match[1].strip()
    elif match := _HEIGHTS_UNIT.fullmatch(bare):
        header.heights_unit = length_unit(match[1], place) or header.heights_unit
    elif units := _columns(header, bare) or (_units(bare) if header.points else []):
        header.source = place
        x, y, header.heights_unit = (length_unit(unit, place) if (unit := units[i]) else None for i in header.points)
        if x and y and x != y:
            raise SurfaceError(f"{place} is in {y}, another size in {x}; allowed: one unit for both axes")
        header.unit = header.unit or x or y
    elif named := _HAS_UNIT.search(bare):
        if _NUMBER_WITH_UNIT.search(bare) or _LATERAL.search(bare) or not _VERTICAL.search(bare):
            return False
        header.heights_unit = length_unit(re.sub(r"^in\s+", "", named[0].strip("[]()")), place)
    else:
        return False
    return True


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def _columns(header: Header, bare: str) -> list[str | None]:
    """Take a line that names columns x, y and z; return their units, None for a column without one, else nothing."""
    joined = re.sub(r"\s+(?=[\[(])", "", bare.replace('"', ""))
    parts = re.split(r"[;,\t]", joined) if re.search(r"[;,\t]", joined) else joined.split()
    columns = [match for part in parts[:3] if (match := _COLUMN.fullmatch(part.strip()))]
    names = [name if (name := column[1].lower()) in "xy" else "z" for column in columns]
    if sorted(names) != ["x", "y", "z"]:
        return []
    header.points = [names.index(name) for name in "xyz"]
    return [column[2] for column in columns]


def _units(bare: str) -> list[str | None]:
    """Return the units in a line below the names of columns x, y and z, as ``µm;µm;nm``; else nothing."""
    units = [cell.strip("[]()") for cell in re.split(r"[;,\s]+", bare.replace('"', ""))][:3]
    return [*units] if len(units) == 3 and all(map(length_units.named, units)) else []


def _not_understood(line: tuple[int, str], remedy: str = "") -> NotRead:
    """Return the error of a header line."""
    return NotRead(f"line {line[0]} is not understood: {line[1][:80]!r}{remedy}")


def _sized(numbers: Array, header: Header) -> HeightMap:
    """Return rows under a header with the size of all their pixels."""
    lines, columns = numbers.shape
    sides = None
    if len(header.size) == 2:
        sides = header.size["width"] / columns * (columns - 1), header.size["height"] / lines * (lines - 1)
    return header.map(numbers.T, sides, "text with a header", "header")


def _esri(text: plain_text.Text, header: Header) -> HeightMap:
    given = header.esri
    if not {"ncols", "nrows"} <= given.keys():
        raise SurfaceError(f"the header gives {', '.join(given)}; needed: ncols and nrows")
    if header.unclear is not None:
        raise _not_understood(header.unclear)
    if not all(given[name].is_integer() and given[name] > 0.0 for name in ("ncols", "nrows")):
        raise SurfaceError(f"ncols {given['ncols']:g}, nrows {given['nrows']:g}; allowed: whole numbers above 0")
    rows, columns = int(given["nrows"]), int(given["ncols"])
    heights = plain_text.words(text)  # the numbers of a row may run over several lines
    if heights.size != rows * columns:
        raise SurfaceError(f"holds {heights.size} heights; its header gives {rows} x {columns}")
    heights[heights == given.get("nodata_value", -9999.0)] = math.nan
    cell = given.get("cellsize")
    dx, dy = given.get("dx", cell), given.get("dy", cell)
    sides = None if dx is None or dy is None else (dx * (columns - 1), dy * (rows - 1))
    grid = heights.reshape(rows, columns)[::-1].T  # lines run from north to south
    return header.map(grid, sides, "ESRI ASCII grid", "esri")


def _points(numbers: Array, header: Header) -> HeightMap:
    try:
        heights, sides, counted = _grid(numbers)
    except SurfaceError as error:
        raise SurfaceError(f"looks like x y z points, but they are no regular grid: {error}; {INSIST}") from error
    header.source = header.source or "its coordinates"
    return header.map(heights, sides, "text, points x y z", "points", counted and header.unit is None)


def _grid(points: Array) -> tuple[Array, tuple[float, float], bool]:
    """Return the map of points in any order, the spans of x and y, and whether both only count from 0 or 1."""
    if not np.isfinite(points[:, :2]).all():
        raise SurfaceError("a coordinate is missing")
    (i, nx, span_x, whole_x), (j, ny, span_y, whole_y) = (_nodes(points[:, axis], "xy"[axis]) for axis in (0, 1))
    node = i * ny + j
    shared = int((np.bincount(node) > 1).sum()) if nx * ny <= _CROWDED * len(node) else 0
    if shared:
        raise SurfaceError(f"{shared} nodes have several of the {len(node)} points")
    if len(node) < _COVERED * nx * ny:
        allowed = f"allowed: at least {_COVERED:.0%} of its nodes"
        raise SurfaceError(f"{len(node)} points lie on a grid of {nx} x {ny} nodes; {allowed}")
    heights = np.full(nx * ny, np.nan)
    heights[node] = points[:, 2]
    return heights.reshape(nx, ny), (span_x, span_y), whole_x and whole_y


def _nodes(values: Array, name: str) -> tuple[Index, int, float, bool]:
    """Return the node of each coordinate, the number of nodes, their span, and whether they only count."""
    order = np.unique(values)
    span = float(order[-1] - order[0])
    if not span > 0.0:
        raise SurfaceError(f"{name} is {order[0]:g} everywhere")
    steps = np.diff(order)
    count = round(span / float(np.median(steps[steps > _SAME * span])))
    if count < 2:
        raise SurfaceError(f"{name} takes {count + 1} values; allowed: at least 3")
    position = (values - order[0]) / (span / count)
    node = np.rint(position)
    off = float(np.abs(position - node).max())
    if off > _REGULAR:
        raise SurfaceError(f"{name} is not equidistant: a point lies {off:.2g} of a spacing off its node")
    return node.astype(np.int64), count + 1, span, bool(order[0] in (0.0, 1.0) and count == span)


def _refuse_coordinates(numbers: Array) -> None:
    """Refuse tables that hold coordinates among the heights."""
    rows, columns = numbers.shape
    for table, nodes, kind in ((numbers, columns, "columns"), (numbers.T, rows, "lines")):
        if 3 <= nodes <= 6 and len(table) >= 9:
            try:
                _grid(table[:, :3])
            except SurfaceError:
                continue
            found = f"looks like x y z points: the first two of its {nodes} {kind} form a grid"
            raise SurfaceError(f"{found}; give columns x y z alone; {INSIST}")
    inside = numbers[1:, 1:]
    if min(rows, columns) < 4 or any(all(map(_even, lines)) for lines in (inside, inside.T)):  # a plane, or grooves
        return
    along, down = (_coordinates(numbers[0, 1:], inside), _coordinates(numbers[1:, 0], inside.T))
    if (along and down) or (_even(numbers[0, 1:]) and _even(numbers[1:, 0])):
        both = "the first line and the first column look like coordinates: delete them and give L"
        raise SurfaceError(f"{both}; {INSIST}")
    for name, edge, others in (("line", numbers[0], numbers[1:]), ("column", numbers[:, 0], numbers[:, 1:].T)):
        if edge[0] in (0.0, 1.0) and np.array_equal(edge, edge[0] + np.arange(edge.size)):
            raise SurfaceError(f"the first {name} only counts: delete it; {INSIST}")
        if _coordinates(edge, others):
            raise SurfaceError(f"the first {name} looks like coordinates: delete it and give L; {INSIST}")


def _even(values: Array) -> bool:
    if not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    return bool(steps[0] != 0.0 and np.abs(steps - steps[0]).max() <= _EVEN * abs(steps[0]))


def _coordinates(edge: Array, others: Array) -> bool:
    """Return whether the numbers at an edge of a table are of even steps, and no other line of it to printed digits."""
    if edge.size <= _LINE:
        return False
    return _even(edge) or (_even_as_printed(edge) and not any(map(_even_as_printed, others)))


def _even_as_printed(values: Array) -> bool:
    """Return whether numbers lie on a straight line to their last printed digit."""
    if not np.isfinite(values).all():
        return False
    step = abs(values[-1] - values[0]) / (values.size - 1)
    off = np.abs(values - np.linspace(values[0], values[-1], values.size)).max()
    if _COARSE * off > step or step == 0.0:
        return False
    places = max(len(np.format_float_positional(value, trim="-").partition(".")[2]) for value in values)
    largest = math.floor(math.log10(np.abs(values).max())) + 1
    digit = 10.0 ** max(-places, largest - _DIGITS)
    return bool(off <= digit and step >= _COARSE * digit)
