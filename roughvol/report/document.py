"""A page as data: sections of facts, tables, figures and notes, which `html`, `markdown` and `terminal` render."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from roughvol.analysis.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Pairs = tuple[tuple[str, str], ...]


class Drawing(NamedTuple):
    """A figure with its name, its caption and the run it is drawn from, empty where it compares several."""

    name: str
    caption: str
    source: str
    figure: Figure


class Cell(str):
    """Text with a kind, the anchor that it leads to, small words below it, and a section that unfolds."""

    kind: str
    link: str
    small: str
    more: Section | None

    def __new__(cls, text: str, kind: str = "", link: str = "", small: str = "", more: Section | None = None) -> Cell:
        """Return text with what a page shows beside it."""
        cell = super().__new__(cls, text)
        cell.kind, cell.link, cell.small, cell.more = kind, link, small, more
        return cell


@dataclass(frozen=True)
class Section:
    """A part of a page, shown in the order of its fields from ``under`` on.

    ``anchor`` is its place on the page, and ``short`` its words at the top; ``badge`` stands beside the title. A
    section with a word in ``folded``, open or closed, unfolds at a click. ``back`` is the anchor of the way back.
    """

    title: str = ""
    anchor: str = ""
    short: str = ""
    kind: str = ""
    badge: Cell | None = None
    folded: str = ""
    under: str = ""
    quote: str = ""
    notes: tuple[str, ...] = ()
    facts: Pairs = ()
    items: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    sections: tuple[Section, ...] = ()
    drawings: tuple[Drawing, ...] = ()
    code: str = ""
    back: str = ""


@dataclass(frozen=True)
class Document:
    """A page: title, words below it, counts, and its sections."""

    title: str
    lead: str = ""
    chips: tuple[Cell, ...] = ()
    sections: tuple[Section, ...] = ()
