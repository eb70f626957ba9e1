"""The print of a leak card: its document on one page of A4, lines broken by the widths of the letters.

Lengths are in points, from the upper left corner of the page.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure

from roughvol.analysis.leak_card import Card
from roughvol.analysis.tables import Table
from roughvol.report.document import Document, Section
from roughvol.report.figures import style
from roughvol.report.figures.leak_card import SANS, panels
from roughvol.report.figures.style import GREY, STYLE, Drawing

A4 = (595.0, 842.0)  # width and height
SMALL = {"font.size": 8.0, "axes.labelsize": 8.0, "axes.titlesize": 8.0, "legend.fontsize": 7.0}  # of the drawings
TITLE, ANSWER, CAPTION = 16.0, 10.0, 7.5  # sizes of type
TEXT = tuple(8.0 - 0.25 * k for k in range(14))  # below the drawings: the largest that fits
LEFT, TOP, FOOT = 42.0, 36.0, 24.0  # margins
WIDTH, GUTTER = A4[0] - 2.0 * LEFT, 20.0
HALF = (WIDTH - GUTTER) / 2.0  # of a column beside another
LINE = 1.36  # height of a line over its size
ABOVE, AXES, BELOW = 40.0, 136.0, 32.0  # heights of the legends, of the axes, of the labels under them
MOST = 6  # surfaces and limits that the page has; the page of HTML has all
FEWER = (3, 1, 0)  # limits in the smallest type, where it does not fit
CUT = "The rest is on the page of HTML."
NAMES = 0.4  # largest share of a column that the names of facts take
STEP = 2.0  # by which columns of a table are narrowed

# in the type of the page
wrapped = partial(style.wrapped, family=SANS["font.family"])
width_of = partial(style.width_of, family=SANS["font.family"])


class Piece(NamedTuple):
    """A text at a place in a line; a name is grey, a title bold."""

    x: float
    text: str
    weight: str = "normal"
    colour: str = "black"


class Line(NamedTuple):
    """A line of text, empty for a free one."""

    size: float
    pieces: tuple[Piece, ...] = ()


def page_of(card: Card, document: Document) -> Drawing:
    """Return a card on one page: sections without a title, the drawings, then the other sections."""
    lead = [part for part in document.sections if not (part.title or part.kind == "pair")]
    rest = [part for part in document.sections if part.title or part.kind == "pair"]
    with mpl.rc_context(STYLE | SANS | SMALL):
        fig = Drawing(figsize=(A4[0] / 72.0, A4[1] / 72.0), dpi=150)
        fig.style = SANS
        lines = _paragraph(document.title, WIDTH, TITLE, "bold")
        lines += [line for part in lead for line in _section(part, WIDTH, ANSWER)]
        place = _draw(fig, card, _write(fig, lines, TOP))
        _write(fig, _fitting(rest, A4[1] - FOOT - place), place)
    return fig


def _fitting(parts: Sequence[Section], room: float) -> list[Line]:
    """Return the lines of sections in the largest type that fits, with fewer limits if none does.

    Where the smallest type without limits is too high, the lines end with a sentence.
    """
    looks = [(size, MOST) for size in TEXT] + [(TEXT[-1], most) for most in FEWER]
    for size, most in looks:
        found = _all(parts, size, most)
        if _height(found) <= room:
            return found
    end = _paragraph(CUT, WIDTH, TEXT[-1], "bold")
    while _height([*found, *end]) > room:
        found.pop()
    return [*found, *end]


def _draw(fig: Figure, card: Card, top: float) -> float:
    """Draw the panels with their captions, and return the place below them."""
    shown = panels(card)
    upper = top + ABOVE
    bounds = {"top": 1.0 - upper / A4[1], "bottom": 1.0 - (upper + AXES) / A4[1]}
    grid = fig.add_gridspec(1, len(shown), left=0.12, right=0.93, wspace=0.6, **bounds)
    width, places = (WIDTH + GUTTER) / len(shown), []
    for k, panel in enumerate(shown):
        panel.draw(fig.add_subplot(grid[0, k]), card)
        rows = wrapped(panel.caption, CAPTION, width - GUTTER)
        lines = [Line(CAPTION, (Piece(k * width, row, colour=GREY),)) for row in rows]
        places.append(_write(fig, lines, upper + AXES + BELOW))
    return max(places)


def _write(fig: Figure, lines: Sequence[Line], top: float) -> float:
    """Write lines from a place on, and return the place below them."""
    for size, pieces in lines:
        for x, text, weight, colour in pieces:
            place = (LEFT + x) / A4[0], 1.0 - top / A4[1]
            fig.text(*place, text, fontsize=size, weight=weight, color=colour, va="top", parse_math=False)
        top += LINE * size
    return top


def _height(lines: Sequence[Line]) -> float:
    return sum(LINE * line.size for line in lines)


# sections as lines


def _all(parts: Sequence[Section], size: float, most: int) -> list[Line]:
    """Return the lines of sections, with so many limits; those of kind ``pair`` stand beside each other."""
    found: list[Line] = []
    for part in parts:
        if part.kind == "pair":
            found += _columns([_section(inner, HALF, size, most) for inner in part.sections])
        else:
            found += _section(part, WIDTH, size, most)
    return found


def _section(part: Section, width: float, size: float, most: int = MOST) -> list[Line]:
    """Return the lines of a section under its title."""
    found = [Line(0.7 * size)] if part.title else []
    found += _paragraph(part.title, width, size + 2.0, "bold")
    found += [line for note in part.notes for line in _paragraph(note, width, size)]
    if part.kind == "answer":
        found += _facts(part.facts, width, size, Piece(0.0, "", weight="bold"))
    elif part.facts:
        found += _columns(_halves([_facts([fact], HALF, size, Piece(0.0, "", colour=GREY)) for fact in part.facts]))
    for table in part.tables:
        found += _table(table, width, size)
    listed = [f"•  {item}" for item in (*part.items[:most], *_left(part.items, most))]
    items = [f"{part.under} {'; '.join(part.items)}."] if part.under else listed
    found += [line for item in items for line in _paragraph(item, width, size)]
    return [*found, *(line for inner in part.sections for line in _section(inner, width, size, most))]


def _left(items: Sequence[object], most: int) -> list[str]:
    """Return how many items the page leaves out, in words; empty where it has all."""
    left = len(items) - most
    return [f"and {left} more, on the page of HTML" if most else f"{left} on the page of HTML"] if left > 0 else []


def _paragraph(text: str, width: float, size: float, weight: str = "normal") -> list[Line]:
    return [Line(size, (Piece(0.0, row, weight),)) for row in wrapped(text, size, width, weight=weight) if row]


def _facts(facts: Sequence[tuple[str, str]], width: float, size: float, name: Piece) -> list[Line]:
    """Return names and values of facts beside each other; the names look like a piece."""
    widest = max(width_of(text, size, weight=name.weight) for text, _ in facts) + size
    place = min(widest, NAMES * width) if name.weight == "bold" else NAMES * width
    found = []
    for label, value in facts:
        rows = wrapped(label, size, place - 0.5 * size, weight=name.weight), wrapped(value, size, width - place)
        for left, right in itertools.zip_longest(*rows, fillvalue=""):
            found.append(Line(size, (name._replace(text=left), Piece(place, right))))
    return found


def _halves(blocks: Sequence[list[Line]]) -> list[list[Line]]:
    """Return blocks of lines in two columns of about the same height."""
    heights = [len(block) for block in blocks]
    left = min(range(len(blocks) + 1), key=lambda k: max(sum(heights[:k]), sum(heights[k:])))
    return [[line for block in some for line in block] for some in (blocks[:left], blocks[left:])]


def _columns(columns: Sequence[list[Line]]) -> list[Line]:
    """Return columns of the same type beside each other."""
    found = []
    for row in itertools.zip_longest(*columns, fillvalue=Line(0.0)):
        places = [(piece, k * (HALF + GUTTER)) for k, line in enumerate(row) for piece in line.pieces]
        pieces = tuple(piece._replace(x=piece.x + start) for piece, start in places)
        found.append(Line(max(line.size for line in row), pieces))
    return found


def _table(table: Table, width: float, size: float) -> list[Line]:
    """Return a table; columns that are too wide together are narrowed down to their longest word, the widest first."""
    rows = [table.head, *table.rows[:MOST]]
    columns = list(zip(*rows, strict=True))
    wide = [max(width_of(cell, size) for cell in column[1:]) + size for column in columns]
    least = [max(width_of(word, size) for cell in column for word in cell.split(" ")) + size for column in columns]
    wide = list(map(max, wide, least))
    while sum(wide) > width and any(now > end for now, end in zip(wide, least, strict=True)):
        k = max((k for k in range(len(wide)) if wide[k] > least[k]), key=lambda k: wide[k])
        wide[k] = max(wide[k] - STEP, least[k])
    starts = [0.0, *itertools.accumulate(wide)]
    found = []
    for number, row in enumerate(rows):
        cells = [wrapped(cell, size, room - size) for cell, room in zip(row, wide, strict=True)]
        for texts in itertools.zip_longest(*cells, fillvalue=""):
            look = {"colour": GREY} if number == 0 else {}
            found.append(Line(size, tuple(Piece(x, text, **look) for x, text in zip(starts, texts, strict=False))))
    return [*found, *(line for words in _left(table.rows, MOST) for line in _paragraph(words, width, size))]
