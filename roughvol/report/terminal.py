"""Sections and tables as lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the command line prints tables of texts before numpy is there
    from roughvol.analysis.tables import Table
    from roughvol.report.document import Section


def lines(part: Section) -> Iterator[str]:
    """Yield the title of a section and the rest below it, indented."""
    if part.title:
        yield part.title
    yield from (f"  {line}" if part.title else line for line in _content(part))


def _content(part: Section) -> Iterator[str]:
    """Yield notes, facts in columns, tables, items and inner sections."""
    width = max((len(name) for name, _ in part.facts), default=0)
    yield from part.notes
    yield from (f"{name:<{width}}  {value}" for name, value in part.facts)
    for table in part.tables:
        yield from table_lines(table)
    yield from part.items
    for inner in part.sections:
        yield from lines(inner)


def table_lines(table: Table) -> Iterator[str]:
    """Yield the title of a table, its rows in columns, and its note."""
    yield from filter(None, [table.title])
    yield from aligned(table.head, table.rows).splitlines()
    yield from filter(None, [table.note and f"  {table.note}"])


def aligned(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in aligned columns; text to the left, numbers to the right."""
    columns = list(zip(head, *rows, strict=True))
    cells = zip(*map(_aligned, columns), strict=True)
    return "\n".join("  ".join(row).rstrip() for row in cells)


def _aligned(column: Sequence[str]) -> list[str]:
    """Return the cells of a column in its width; the first cell is the head."""
    width = max(map(len, column))
    words = len(column) == 1 or any(cell[:1].isalpha() for cell in column[1:])
    return [cell.ljust(width) if words else cell.rjust(width) for cell in column]
