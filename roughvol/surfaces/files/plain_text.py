"""Tables of numbers in text of unknown origin: encoding, comments, delimiters, decimal commas and missing cells.

A line is data if all its cells are numbers or marks of a missing number. Lines before the first one are the header.
Any later line that is neither data nor a comment is an error: a reader that skips it loses a row of the map.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces.files.description import FEWEST, NotRead, first_bytes
from roughvol.typing import Array

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?|[-+]?(?:inf|infinity)", re.I)
_SHEET = r"#(?:n/a|div/0!|num!|value!|ref!|null!)"  # of a spreadsheet
_C = re.compile(r"(?<![\w.])[-+]?1[.,]#(?:ind|qnan|snan|inf)0*(?!\w)", re.I)  # no number, in C on Windows
_MISSING = re.compile(rf"|[-+]?nan|na|n/a|{_SHEET}|null|none|bad|void|no_?data|invalid|undefined|\*+|-+|\?+", re.I)
_NO_DATA = re.compile(r"\bno data\b", re.I)
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
_PAIR = r"[-+]?(?:0|[1-9]\d*),\d+"
_PAIRS = re.compile(rf"{_PAIR}(?:,{_PAIR})+")  # numbers with decimal commas, and commas between them
_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+")  # a whole number with commas between thousands
_SMALL = re.compile(r"[-+]?[1-9]\d{0,2}")  # a whole number below a thousand
_NO_WHOLE = re.compile(r"-0,|,0\d")  # in pairs of whole numbers
_QUOTED = re.compile(r'"([-+]?\d+),(\d+(?:[eE][-+]?\d+)?)"')
_COMMENT = re.compile(rf"(?!{_SHEET})#.*", re.I)
EMPTY = "holds empty cells alone; delete it, or write NaN for missing heights"
NO_NUMBER = "line {}: {!r} is no number; a missing height is an empty cell or NaN"
_FEW = 3  # cells of a line that may be a title with numbers
_SAMPLE = 50  # lines searched for the delimiter
_HEAD = 4096  # bytes searched for control characters


@dataclass(frozen=True)
class Text:
    """The lines of a text file, each with its number."""

    header: list[tuple[int, str]]  # lines before the first line of numbers
    data: list[tuple[int, str]]  # lines from there on, without comments
    comments: list[tuple[int, str]]  # comments from there on


def is_text(path: Path) -> bool:
    """Return whether a file starts like text: no zero bytes and few control characters, or the mark of UTF-16."""
    start = first_bytes(path, _HEAD)
    control = sum(byte < 32 and byte not in b"\t\n\r\f\x1a" for byte in start)
    return start[:2] in (b"\xff\xfe", b"\xfe\xff") or (0 not in start and control <= len(start) // 100)


def split(path: Path) -> Text:
    """Split a text file in UTF-8, UTF-16 or Latin-1 into header, data and comments."""
    lines = numbered(path)
    first = next((index for index, (_, line) in enumerate(lines) if _is_data(line)), None)
    if first is None:
        allowed = "allowed: numbers alone, set apart by blanks, tabs, semicolons or commas"
        raise SurfaceError(f"holds no numbers, or words in each line of them; {allowed}")
    header = [(number, line.strip()) for number, line in lines[:first] if line.strip()]
    data = [(number, bare) for number, line in lines[first:] if (bare := _bare(line))]
    usual = Counter(len(_cells(line)) for _, line in data[:_SAMPLE]).most_common(1)[0][0]
    for number, line in header:
        _refuse_row(number, line, usual)
    comments = [(number, line.strip()) for number, line in lines[first:] if line.lstrip().startswith("#")]
    return Text(header, data, comments)


def numbered(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a text file, each with its number from 1."""
    content = path.read_bytes()
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = content.decode("utf-16")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("latin-1")  # µ is one byte there
    text = text.replace("\u2212", "-")  # the minus sign of typesetting
    text = _C.sub("nan", text) if "#" in text else text  # it has the decimal mark of the numbers
    return list(enumerate(re.split("\r\n|\r|\n", text), start=1))  # str.splitlines also breaks at form feeds


def words(text: Text) -> Array:
    """Return all numbers of a text in one row, across its lines, NaN where missing."""
    if _delimiter(_sample(text)) != ",":
        text = replace(text, data=[(number, line.replace(",", ".")) for number, line in text.data])
    try:
        return np.array(" ".join(line for _, line in text.data).split(), dtype=np.float64)
    except ValueError:
        cells = ((number, cell) for number, line in text.data for cell in re.split(r"[\s;,]+", line.strip(" ;,\t")))
        return np.array([_value(number, cell) for number, cell in cells])


def table(text: Text) -> Array:
    """Return the numbers of a text, a row for each line, NaN where a cell is empty or marked as missing."""
    if any('","' in line for _, line in text.data):
        text = replace(text, data=[(number, _QUOTED.sub(r"\1.\2", line)) for number, line in text.data])
    where, sample = f"line {text.data[0][0]}", _sample(text)
    mark = _delimiter(sample)
    if mark is None:
        text = replace(text, data=[(number, line) for number, line in text.data if line.strip()])
    lines = [line for _, line in text.data]
    if mark is not None and all(line.endswith(mark) for line in lines):
        lines = [line[:-1] for line in lines]  # a mark at the end of every row separates nothing
    if mark is not None and all(line.startswith(mark) for line in lines):
        lines = [line[1:] for line in lines]
    if mark is not None and not lines[-1].strip(f'{mark} "'):
        raise DatasetError(f"line {text.data[-1][0]} {EMPTY}")
    cells = [cell for line in sample for cell in line.split()] if mark == "," else []
    spaced = any(cell.endswith(",") for cell in cells)
    pairs = all(map(_PAIRS.fullmatch, lines)) and any(map(_NO_WHOLE.search, lines))
    if pairs or (spaced and all(_DECIMAL_COMMA.fullmatch(cell.rstrip(",")) for cell in cells)):
        allowed = "semicolons between them, or numbers in quotation marks"
        raise DatasetError(f"{where} holds commas in its numbers and between them; allowed: {allowed}")
    if mark != "," and any("," in line for line in lines):
        if any("." in line for line in lines):
            raise DatasetError(f"{where} holds both commas and points; allowed: one decimal mark")
        cells = [cell.strip() for line in sample for cell in line.split(mark)]
        marked = [cell for cell in cells if "," in cell]
        if marked and all(map(_GROUPED.fullmatch, marked)) and any(map(_SMALL.fullmatch, cells)):
            raise DatasetError(f"{where} may hold commas between thousands; allowed: numbers without them")
        lines = [line.replace(",", ".") for line in lines]
    try:
        return np.loadtxt(lines, delimiter=mark, comments=None, ndmin=2)
    except ValueError:
        return _slowly(text, lines, mark)


def refuse_parts(text: Text) -> None:
    """Refuse several maps with empty lines between them, and last columns that are empty, as of a spreadsheet."""
    places = [number for number, _ in text.data]
    starts = [0, *(i for i in range(1, len(places)) if places[i] - places[i - 1] > 1), len(places)]
    (lines, *others) = {end - start for start, end in itertools.pairwise(starts)}
    if len(starts) > 2 and not others and lines >= FEWEST:
        found = f"line {places[lines]} begins another map of {lines} lines, behind an empty line or a comment"
        raise DatasetError(f"{found}; allowed: one map; delete what stands between its lines")
    mark = _delimiter(_sample(text))
    if mark is not None and all(line.endswith(2 * mark) for _, line in text.data):
        raise DatasetError(f"the last column {EMPTY}")


def _slowly(text: Text, lines: list[str], mark: str | None) -> Array:
    """Read cell by cell: marks of missing numbers, quotes, and errors with their line."""
    rows: list[list[float]] = []
    for (number, whole), line in zip(text.data, lines, strict=True):
        cells = [cell.strip().strip('"') for cell in line.split(mark)]
        if not any(_NUMBER.fullmatch(cell) or _MISSING.fullmatch(cell) for cell in cells):
            raise NotRead(f"line {number} holds no numbers: {whole[:60]!r}; delete it")
        rows.append([_value(number, cell) for cell in cells])
    usual = Counter(map(len, rows)).most_common(1)[0][0]
    for (number, _), row in zip(text.data, rows, strict=True):
        if len(row) != usual:
            raise DatasetError(f"line {number} holds {len(row)} numbers, most lines {usual}; delete it if it is no row")
    return np.array(rows)


def _value(number: int, cell: str) -> float:
    if _NUMBER.fullmatch(cell):
        return float(cell.lower().replace("d", "e"))
    if _MISSING.fullmatch(cell):
        return np.nan
    raise DatasetError(NO_NUMBER.format(number, cell[:40]))


def _bare(line: str) -> str:
    """Return a line without its comment. Delimiters at its ends stay: cells there may be empty."""
    line = _NO_DATA.sub("nodata", line) if "ata" in line or "ATA" in line else line
    return (_COMMENT.sub("", line) if "#" in line else line).strip(" \r\f\x1a")


def _cells(line: str) -> list[str]:
    return [cell.strip('"') for cell in re.split(r"[\s;,]+", _bare(line).strip(" ;,\t"))]


def _refuse_row(number: int, line: str, usual: int) -> None:
    """Refuse a line of the header that is a row with an unknown mark: most of its cells are numbers."""
    cells = _cells(line)
    others = [cell for cell in cells if not (_NUMBER.fullmatch(cell) or _MISSING.fullmatch(cell))]
    if len(cells) == usual > _FEW and 2 * len(others) < usual:
        raise NotRead(NO_NUMBER.format(number, others[0][:40]))


def _is_data(line: str) -> bool:
    cells = _cells(line)
    numbers = sum(_NUMBER.fullmatch(cell) is not None for cell in cells)
    missing = sum(_MISSING.fullmatch(cell) is not None for cell in cells)
    return numbers + missing == len(cells) and (numbers > 0 or missing > 2)


def _sample(text: Text) -> list[str]:
    return [line for _, line in text.data[:_SAMPLE] if _is_data(line)]


def _delimiter(sample: list[str]) -> str | None:
    """Return the delimiter in lines: a semicolon, a tab, a comma, or blanks (None)."""
    for mark in ";\t":
        if all(mark in line.strip(" ") for line in sample) and not _blanks_inside(sample, mark):
            return mark
    cells = [cell for line in sample for cell in line.split()]
    with_comma = [cell for cell in cells if "," in cell]
    decimal = len(with_comma) > 0 and all(_DECIMAL_COMMA.fullmatch(cell) for cell in with_comma)
    if with_comma and not (decimal and len(cells) > len(sample)):
        return ","
    return None


def _blanks_inside(sample: list[str], mark: str) -> bool:
    """Return whether cells between delimiters hold several numbers: they then end or group rows only."""
    return any(len(cell.split()) > 1 for line in sample for cell in line.split(mark))
