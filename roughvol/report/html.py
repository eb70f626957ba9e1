"""Pieces of HTML: elements whose text is escaped, tables, lists, pairs of facts, figures."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from roughvol.report.drawings import Drawing

DPI = 170  # of the figures in the page: sharp at twice their size there


class Html(str):
    """Text that is HTML already; all other text is escaped."""

    __slots__ = ()


def join(*parts: str) -> Html:
    """Return parts one after the other, text among them escaped."""
    return Html("".join(part if isinstance(part, Html) else escape(part) for part in parts))


def tag(element: str, *inner: str, kind: str = "", **attributes: str) -> Html:
    """Return an element.

    Parameters
    ----------
    element : str
        Its name, as ``td``.
    *inner : str
        Its content; all that is not `Html` is escaped.
    kind : str
        Its class.
    **attributes : str
        Its attributes, those that are empty left out; ``_`` is written ``-``.
    """
    given = {**attributes, "class": kind}
    words = "".join(f" {key.replace('_', '-')}='{escape(value)}'" for key, value in given.items() if value)
    return Html(f"<{element}{words}>{join(*inner)}</{element}>")


def fold(summary: str, *inner: str, kind: str = "", unfolded: bool = False) -> Html:
    """Return content that a click unfolds."""
    opened = {"open": "open"} if unfolded else {}
    return tag("details", tag("summary", summary), *inner, kind=kind, **opened)


def table(head: Sequence[str], rows: Iterable[Any], kind: str = "") -> Html:
    """Return a table: each row is a sequence of cells, or `Html`; a cell of text holds its column's name."""
    lines = []
    for row in rows:
        cells = () if isinstance(row, Html) else zip(head, row, strict=True)
        filled = [cell if isinstance(cell, Html) else tag("td", cell, kind="v", data_head=name) for name, cell in cells]
        lines.append(row if isinstance(row, Html) else tag("tr", *filled))
    top = tag("thead", tag("tr", *(tag("th", name) for name in head)))
    return tag("table", top, tag("tbody", *lines), kind=kind)


def box(inner: str) -> Html:
    """Return a table in a box of its own that scrolls where the window is narrower."""
    return tag("div", inner, kind="box")


def items(words: Iterable[str]) -> Html:
    """Return a list."""
    return tag("ul", *(tag("li", line) for line in words))


def pairs(facts: Iterable[tuple[str, str]]) -> Html:
    """Return pairs of a quantity and its value."""
    return tag("dl", *(part for name, value in facts for part in (tag("dt", name), tag("dd", value))))


def figure_html(id: str, drawing: Drawing) -> Html:
    """Return a figure as PNG inside the page, with its caption; as the target of a link it fills the window."""
    buffer = io.BytesIO()
    drawing.figure.savefig(buffer, format="png", dpi=DPI, facecolor="white", metadata={"Software": None})
    image = base64.b64encode(buffer.getvalue()).decode("ascii")
    kind = "plot wide" if drawing.figure.get_figwidth() > 5.0 else "plot"
    source = join(" ", tag("small", f"Run: {drawing.source}.")) if drawing.source else ""
    picture = Html(f"<img src='data:image/png;base64,{image}' alt='{escape(drawing.caption)}'>")
    return tag(
        "figure",
        tag("a", "close", kind="close", href=f"#at-{id}"),
        tag("a", picture, kind="open", href=f"#{id}", title="full size"),
        tag("figcaption", drawing.caption, source, id=f"at-{id}"),
        id=id,
        kind=kind,
    )
