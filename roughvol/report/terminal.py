"""Sections as lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from roughvol.report.document import Section


def lines(part: Section) -> Iterator[str]:
    """Yield title, facts in columns, tables row by row, items and inner sections, each indented."""
    if part.title:
        yield part.title
    width = max((len(name) for name, _ in part.facts), default=0)
    yield from (f"  {line}" for line in part.notes)
    yield from (f"  {name:<{width}}  {value}" for name, value in part.facts)
    for table in part.tables:
        yield f"  {table.title}"
        for row in table.rows:
            yield f"    {', '.join(f'{head} {cell}' for head, cell in zip(table.head, row, strict=True))}"
    yield from (f"  {line}" for line in part.items)
    for inner in part.sections:
        yield from (f"  {line}" for line in lines(inner))
