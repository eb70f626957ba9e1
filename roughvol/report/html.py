"""Pieces of HTML that the parts of the report page share: tables in boxes that scroll, facts in pairs, figures."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape

from roughvol.report.drawings import Drawing

DPI = 170  # of the figures in the page: sharp at twice their size there


def box(inner: str) -> str:
    """Return a table in a box of its own that scrolls where the window is narrower."""
    return f"<div class='box'>{inner}</div>"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "") -> str:
    """Return a table of text, escaped; each cell holds its column's name for narrow windows."""
    top = "".join(f"<th>{escape(words)}</th>" for words in head)
    body = "".join(
        "<tr>"
        + "".join(
            f"<td class='v' data-head='{escape(words, quote=True)}'>{escape(cell)}</td>"
            for words, cell in zip(head, row, strict=True)
        )
        + "</tr>"
        for row in rows
    )
    named = f" class='{kind}'" if kind else ""
    return f"<table{named}><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def facts_list(pairs: Iterable[tuple[str, str]]) -> str:
    """Return pairs of what and its value."""
    return "<dl>" + "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in pairs) + "</dl>"


def figure_html(id: str, drawing: Drawing) -> str:
    """Return a figure as PNG inside the page, with its caption; as the target of a link it fills the window."""
    buffer = io.BytesIO()
    drawing.figure.savefig(buffer, format="png", dpi=DPI, facecolor="white", metadata={"Software": None})
    image = base64.b64encode(buffer.getvalue()).decode("ascii")
    wide = " wide" if drawing.figure.get_figwidth() > 5.0 else ""
    drawn = f" <small>Run: {escape(drawing.source)}.</small>" if drawing.source else ""
    caption = escape(drawing.caption, quote=True)
    return (
        f"<figure id='{id}' class='plot{wide}'><a class='close' href='#at-{id}'>close</a>"
        f"<a class='open' href='#{id}' title='full size'><img src='data:image/png;base64,{image}' alt='{caption}'></a>"
        f"<figcaption id='at-{id}'>{caption}{drawn}</figcaption></figure>"
    )
