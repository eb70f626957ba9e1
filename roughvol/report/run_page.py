"""The part of the report page that is about one run: its surface, how it was pressed, its states, its figures."""

from __future__ import annotations

from html import escape

from roughvol.report.drawings import Drawing
from roughvol.report.html import box, facts_list, figure_html, table
from roughvol.report.run_facts import Facts

OPEN = 3  # tables of states that are shown at once; further ones unfold


def section(facts: Facts, figures: list[Drawing], anchor: str) -> str:
    """Return the section of a run.

    Parameters
    ----------
    facts : Facts
        What the run says of itself.
    figures : list of Drawing
        What it can feed.
    anchor : str
        Its id on the page; those of its figures begin with it.
    """
    parts = [f"<section class='run' id='{anchor}'><h2>{escape(facts.name)}</h2>"]
    parts.append(f"<p class='place'>{escape(facts.title)}</p>")
    if facts.warnings:
        lines = "".join(f"<li>{escape(line)}</li>" for line in facts.warnings)
        parts.append(f"<div class='warnings'><h3>Warnings</h3><ul>{lines}</ul></div>")
    parts.append(
        f"<div class='pair'><div><h3>Surface</h3>{facts_list(facts.surface)}</div>"
        f"<div><h3>Loading</h3>{facts_list(facts.loading)}</div></div>"
    )
    for place, one in enumerate(facts.tables):
        note = f"<p class='note'>{escape(one.note)}</p>" if one.note else ""
        inner = box(table(one.head, one.rows)) + note
        if place < OPEN:
            parts.append(f"<h3>{escape(one.title)}</h3>{inner}")
        else:
            parts.append(f"<details><summary>{escape(one.title)}</summary>{inner}</details>")
    if figures:
        shown = "".join(figure_html(f"{anchor}-{drawing.name}", drawing) for drawing in figures)
        parts.append(f"<h3>Figures</h3><div class='figures'>{shown}</div>")
    return "".join(parts) + "</section>"
