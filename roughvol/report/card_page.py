"""The leak card as files: one page of HTML, and one page of PDF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from xarray import Dataset

from roughvol.analysis.leak_budget import Card, card_of
from roughvol.analysis.tables import number
from roughvol.report.drawings import Drawing
from roughvol.report.figures import leak_card
from roughvol.report.html import Html, figure_html, items, join, pairs, table, tag
from roughvol.report.style import CSS
from roughvol.store import stamped_file

CAPTION = (
    "Leak against load with the interval at the load of the card (left); flux along x over its mean (middle); parts of "
    "the error as factors (right)."
)
HEAD = ("source of error", "factor", "how it was found")


def write(runs: Mapping[str, Dataset], name: str, folder: Path) -> Path:
    """Write ``card.html`` and ``card.pdf``, and return the path of the first.

    Parameters
    ----------
    runs : mapping
        Datasets of `campaign.card.compute`.
    name : str
        Title of the card.
    folder : path
        Folder of the files.

    Returns
    -------
    path
        The page.

    Raises
    ------
    FolderError
        If the folder cannot be written.
    """
    card, fine = card_of(runs, name), next(iter(runs.values()))
    stamped_file.write(folder / "card.html", html_of(card, fine).encode())
    leak_card.page_of(card, fine).savefig(folder / "card.pdf")
    return folder / "card.html"


def html_of(card: Card, fine: Dataset) -> str:
    """Return the page of a card.

    Parameters
    ----------
    card : Card
        The card.
    fine : Dataset
        The run on the finest grid.

    Returns
    -------
    str
        One file without links to others.
    """
    ways = []
    for column, way in enumerate(card.ways):
        rows = [(part.name, _factor(part.factor), part.words) for part in way.parts]
        rows += [("together", _factor(way.factor), "logarithms added in squares")] if rows else []
        title = tag("h2", f"Along {way.axis}: {leak_card.headline(card, column)}")
        budget = table(HEAD, rows) if rows else Html()
        ways.append(join(title, tag("p", f"Closes: {way.closing}."), budget))
    drawing = Drawing("card", CAPTION, card.title, leak_card.drawing_of(card, fine))
    limits = items(card.warnings) if card.warnings else tag("p", "No limit of the model is passed.")
    body = join(
        tag("header", tag("h1", f"Leak card: {card.title}")),
        pairs(card.facts),
        *ways,
        figure_html("card", drawing),
        tag("h2", "Limits of the model"),
        limits,
    )
    title = tag("title", f"Leak card: {card.title}")
    return (
        "<!DOCTYPE html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        f"<meta name='viewport' content='width=device-width, initial-scale=1'>\n{title}\n<style>{CSS}</style>\n"
        f"</head>\n<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _factor(factor: float) -> str:
    text = number(factor)
    return "unknown" if text == "–" else f"×÷ {text}"


def lines_of(runs: Mapping[str, Dataset], name: str) -> list[str]:
    """Return the card as lines for a terminal.

    Parameters
    ----------
    runs, name
        As in `write`.

    Returns
    -------
    list of str
        Facts, leaks with their intervals, and the error budget.
    """
    card = card_of(runs, name)
    lines = [f"{fact}: {value}" for fact, value in card.facts]
    for column, way in enumerate(card.ways):
        lines += [f"along {way.axis}: {leak_card.headline(card, column)}", f"  closes: {way.closing}"]
        lines += [f"  {part.name}: {_factor(part.factor)} ({part.words})" for part in way.parts]
    return lines
