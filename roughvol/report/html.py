"""A document as one HTML page: no network, no script; light, dark and on paper. All text is escaped.

A figure opens in full size as the target of a link to itself.
"""

from __future__ import annotations

import base64
import io
import string
from collections.abc import Iterator
from html import escape
from pathlib import Path

from roughvol.analysis.tables import Table
from roughvol.report.document import Cell, Document, Drawing, Section

DPI = 170  # of the figures in the page: sharp at twice their size there


class Html(str):
    """Text that is HTML already; all other text is escaped."""

    __slots__ = ()


def render(document: Document) -> str:
    """Return a page, everything in it."""
    linked = [part for part in document.sections if part.anchor]
    links = [tag("a", part.short or part.title, href=f"#{part.anchor}") for part in linked]
    chips = [tag("li", tag("b", chip), f" {chip.small}", kind=chip.kind) for chip in document.chips]
    header = tag(
        "header",
        tag("h1", document.title),
        filled("p", document.lead, kind="lead"),
        filled("ul", *chips, kind="chips"),
        filled("nav", Html(" · ".join(links))),
    )
    body = "\n".join([header, *(section(part) for part in document.sections)])
    css, page = (Path(__file__).with_name(name).read_text(encoding="utf-8") for name in ("report.css", "report.html"))
    return string.Template(page).substitute(title=tag("title", document.title), css=css, body=body)


def section(part: Section, level: int = 2) -> Html:
    """Return a section with a heading of a level, or folded under its title."""
    inner = list(_inner(part, level + bool(part.title)))
    if part.folded:
        opened = {"open": "open"} if part.folded == "open" else {}
        return tag("details", tag("summary", part.title), *inner, kind=part.kind, id=part.anchor, **opened)
    badge = [" ", tag("span", part.badge, kind=f"badge {part.badge.kind}")] if part.badge else []
    heading = tag(f"h{level}", part.title, *badge) if part.title else ""
    return tag("section", heading, *inner, kind=part.kind, id=part.anchor)


def _inner(part: Section, level: int) -> Iterator[str]:
    """Yield the content of a section."""
    yield filled("p", part.under, kind="place")
    yield filled("blockquote", part.quote)
    yield from (tag("p", line) for line in part.notes)
    yield filled("dl", *(tag(*pair) for fact in part.facts for pair in zip(("dt", "dd"), fact, strict=True)))
    yield filled("ul", *(tag("li", line) for line in part.items))
    for table in part.tables:
        cards = "verdicts" in part.kind.split()  # on a phone its rows turn into cards; other tables scroll in a box
        yield _table(table, "verdicts") if cards else tag("div", _table(table), kind="box")
        yield filled("p", table.note, kind="note")
    yield from (section(inner, min(level, 3)) for inner in part.sections)
    yield filled("div", *map(_figure, part.drawings), kind="figures")
    yield filled("pre", part.code)
    yield filled("p", tag("a", f"↑ {part.back}", href=f"#{part.back}") if part.back else "", kind="up")


def _table(table: Table, kind: str = "") -> Html:
    head = tag("thead", tag("tr", *(tag("th", name) for name in table.head)))
    rows = [tag("tr", *(_cell(cell, name) for cell, name in zip(row, table.head, strict=True))) for row in table.rows]
    return tag("table", head, tag("tbody", *rows), kind=kind)


def _cell(cell: str, name: str) -> Html:
    """Return a cell; a cell without a kind holds the name of its column, for narrow windows."""
    if not isinstance(cell, Cell):
        return tag("td", *_lines(cell), kind="v", data_head=name)
    badge = "badge" in cell.kind
    text = tag("span", cell, kind=cell.kind) if badge else tag("a", cell, href=f"#{cell.link}") if cell.link else cell
    small = [" ", tag("small", cell.small)] if cell.small else []
    more = [section(cell.more)] if cell.more else []
    named = "" if cell.kind or cell.link else name
    return tag("td", *_lines(text), *small, *more, kind="" if badge else cell.kind, data_head=named)


def _lines(text: str) -> list[str]:
    """Return the lines of a text, where it has several."""
    return [text] if isinstance(text, Html) or "\n" not in text else [tag("div", line) for line in text.splitlines()]


def _figure(drawing: Drawing) -> Html:
    """Return a figure as PNG inside the page, with its caption; as the target of a link it fills the window."""
    buffer = io.BytesIO()
    drawing.figure.savefig(buffer, format="png", dpi=DPI, facecolor="white", metadata={"Software": None})
    image = base64.b64encode(buffer.getvalue()).decode("ascii")
    source = join(" ", tag("small", f"Run: {drawing.source}.")) if drawing.source else ""
    picture = Html(f"<img src='data:image/png;base64,{image}' alt='{escape(drawing.caption)}'>")
    return tag(
        "figure",
        tag("a", "close", kind="close", href=f"#at-{drawing.name}"),
        tag("a", picture, kind="open", href=f"#{drawing.name}", title="full size"),
        tag("figcaption", drawing.caption, source, id=f"at-{drawing.name}"),
        id=drawing.name,
        kind="plot wide" if drawing.figure.get_figwidth() > 5.0 else "plot",
    )


def filled(element: str, *inner: str, kind: str = "") -> Html:
    """Return an element, or nothing without content."""
    return tag(element, *inner, kind=kind) if any(inner) else Html()


def join(*parts: str) -> Html:
    """Return parts one after the other, text among them escaped."""
    return Html("".join(part if isinstance(part, Html) else escape(part) for part in parts))


def tag(element: str, *inner: str, kind: str = "", **attributes: str) -> Html:
    """Return an element; ``kind`` is its class, empty attributes are left out, and ``_`` in their names is ``-``."""
    given = {**attributes, "class": kind}
    words = "".join(f" {key.replace('_', '-')}='{escape(value)}'" for key, value in given.items() if value)
    return Html(f"<{element}{words}>{join(*inner)}</{element}>")
