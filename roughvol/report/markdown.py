"""A document as Markdown, for reading in a terminal: without figures and without code."""

from __future__ import annotations

import re
from collections.abc import Iterator

from roughvol.analysis.tables import Table
from roughvol.report.document import Cell, Document, Section


def render(document: Document) -> str:
    """Return a page as Markdown."""
    lines = [f"# {document.title}", *(["", document.lead] if document.lead else [])]
    if document.chips:
        lines += ["", f"{', '.join(f'{chip} {chip.small}' for chip in document.chips)}."]
    lines += [line for part in document.sections for line in _section(part, 2)]
    return "\n".join(map(_without_tags, lines)) + "\n"


def _section(part: Section, level: int) -> Iterator[str]:
    """Yield the lines of a section; a section of code or figures alone has none."""
    inner = [line for sub in part.sections for line in _section(sub, min(level + bool(part.title), 6))]
    paragraphs = [part.under, part.quote, *part.notes]
    if not any((*paragraphs, part.facts, part.items, part.tables, inner)):
        return
    if part.title:
        yield from ("", f"{'#' * level} {part.title}{f': {part.badge}' if part.badge else ''}")
    for line in filter(None, paragraphs):
        yield from ("", line)
    listed = [*(f"- {name}: {value}" for name, value in part.facts), *(f"- {line}" for line in part.items)]
    yield from ("", *listed) if listed else ()
    for table in part.tables:
        yield from ("", *_table(table), *(["", table.note] if table.note else []))
    yield from inner


def _table(table: Table) -> list[str]:
    lines = [f"| {' | '.join(map(_cell, row))} |" for row in (table.head, *table.rows)]
    return [lines[0].replace("|  |", "| |"), "|" + "---|" * len(table.head), *lines[1:]]


def _cell(text: str) -> str:
    if isinstance(text, Cell):
        more = f"; {text.more.title}: {'; '.join(text.more.items)}" if text.more else ""
        text = f"{text}{f' ({text.small})' if text.small else ''}{more}".removeprefix("; ")
    return text.replace("|", "\\|").replace("\n", "; ")


def _without_tags(line: str) -> str:
    """Return a line whose ``<`` begins no element of HTML, as in the name of a file or in the symbol ``<V*>``."""
    return re.sub(r"(\\*)<(?=[A-Za-z/!?])", r"\1\1\\<", line)
