"""The leak card as files: one page of HTML, and one page of PDF; several cards beside each other in a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from xarray import Dataset

from roughvol.analysis.leak_card import Card, Way
from roughvol.analysis.tables import Table
from roughvol.report import card_text, html
from roughvol.report.card_text import Identity
from roughvol.report.document import Document, Drawing, Section
from roughvol.report.figures import leak_card
from roughvol.store import stamped_file

NARROW = "\u00a0"  # keeps a factor on one line
MOST = 6  # surfaces and limits that the page of print has; the page of HTML has all
NONE_EXCEEDED = "No limit of the model is exceeded among those compared."


@dataclass(frozen=True, eq=False)
class Page:
    """A card with the runs that it rests on.

    Attributes
    ----------
    card : Card
        The card.
    fine : tuple of Dataset
        The runs on the finest grid.
    identity : Identity
        Study and command.
    stem : str
        Name of its files without a suffix.
    """

    card: Card
    fine: tuple[Dataset, ...]
    identity: Identity
    stem: str


def write(page: Page, folder: Path) -> Path:
    """Write a card as HTML and PDF, and return the path of the first."""
    path, shown = folder / f"{page.stem}.html", document(page)
    stamped_file.write(path, html.render(shown).encode())
    leak_card.page_of(page.card, list(_print(shown))).savefig(folder / f"{page.stem}.pdf")
    return path


def document(page: Page) -> Document:
    """Return a card as a page: answers, drawings, each way, and what the card rests on."""
    card = page.card
    facts, kept, exceeded = card_text.rests_on(page.fine)
    drawn = tuple(
        Drawing(panel.name, panel.caption, "", leak_card.drawing_of(card, panel)) for panel in leak_card.panels(card)
    )
    answers = tuple((f"Along {way.axis}", card_text.answer(way)) for way in card.ways)
    limits = Section(kind="warnings", items=tuple(exceeded)) if exceeded else Section(notes=(NONE_EXCEEDED,))
    held = (Section(kind="kept", under="Kept:", items=tuple(kept)),) if kept else ()
    parts = [
        Section(kind="answer", notes=(f"At {card_text.load_of(card)}.",), facts=answers),
        Section(kind="card", notes=(card_text.patch(card),), drawings=drawn),
        *(_way(card, way) for way in card.ways),
        *([Section("Surfaces", tables=(card_text.surfaces(card),))] if len(card.surfaces) > 1 else []),
        Section("What the card rests on", facts=(*card_text.load_facts(card), *facts)),
        Section("Limits of the model, over the states of the sweep", sections=(limits, *held)),
        Section("Identity", facts=tuple(card_text.identity(page.fine, page.identity))),
    ]
    return Document(f"Leak card: {card.title}", sections=tuple(parts))


def _way(card: Card, way: Way) -> Section:
    """Return where a way closes, and the error of its leak."""
    closes = tuple(line[:1].upper() + line[1:] + "." for line in card_text.closes(card, way))
    rows = tuple((name, factor.replace(" ", NARROW), words) for name, factor, words in card_text.budget(way))
    return Section(f"Along {way.axis}", notes=closes, tables=(Table("", card_text.HEAD, rows),))


def _print(shown: Document) -> Iterator[tuple[str, list[str]]]:
    """Yield headings and lines of the page of print: the answers first, then each titled section."""
    yield shown.title, [line for part in shown.sections if not part.title for line in _lines(part)]
    yield from ((part.title, list(_lines(part))) for part in shown.sections if part.title)


def _lines(part: Section) -> Iterator[str]:
    """Yield the lines of a section in print; facts go on one line, answers on one each."""
    yield from part.notes
    facts = [f"{name}: {value}" for name, value in part.facts]
    yield from facts if part.kind == "answer" else filter(None, ["  ·  ".join(facts)])
    for table in part.tables:
        if table.head == card_text.HEAD:
            yield from (f"{name}: {factor}; {words}" for name, factor, words in table.rows)
        else:
            cells = ([f"{name} {cell}" for name, cell in zip(table.head, row, strict=True)] for row in table.rows)
            yield from _most([", ".join(row) for row in cells])
    kept = f"{part.under} {'; '.join(part.items)}."
    yield from [kept] if part.under else _most([f"•  {line}" for line in part.items])
    for inner in part.sections:
        yield from _lines(inner)


def _most(lines: list[str]) -> list[str]:
    """Return the lines that fit on the page of print."""
    left = len(lines) - MOST
    return [*lines[:MOST], f"and {left} more, on the page of HTML"] if left > 0 else lines


def brief(page: Page) -> Section:
    """Return a card for a terminal: load, leaks with their errors, and warnings."""
    card = page.card
    length = f" {card.length_unit}" if card.length_unit else ""
    surfaces = (
        ("Surface", f"{one.name}, Sq {card_text.short(one.Sq)}{length}, Sdq {card_text.short(one.Sdq)}")
        for one in card.surfaces
    )
    found, _, exceeded = card_text.rests_on(page.fine)
    facts = (*surfaces, *card_text.load_facts(card), *(fact for fact in found if fact[0] in card_text.FLUID))
    ways = (replace(_way(card, way), title=f"along {way.axis}: {card_text.answer(way)}") for way in card.ways)
    warnings = tuple(f"warning: {line}" for line in exceeded)
    return Section(facts=facts, sections=(*ways, Section(notes=(card_text.patch(card),), items=warnings)))


def table_of(pages: Sequence[Page]) -> Table:
    """Return several cards beside each other."""
    ways = pages[0].card.ways
    unit = card_text.in_brackets(ways[0].unit) or " T* V*³"
    rows = []
    for page in pages:
        card = page.card
        row = [card.title, str(len(card.surfaces)), card_text.load_of(card)]
        for way in card.ways:
            row += [card_text.short(way.leak.value), card_text.factor(way.factor), way.closing.short]
        rows.append(tuple(row))
    heads = (head for way in ways for head in (f"leak {way.axis}{unit}", "error", f"{way.axis} closes"))
    note = "The leak of several surfaces is their median."
    return Table("Cards", ("card", "surfaces", "load", *heads), tuple(rows), note)


def write_table(pages: Sequence[Page], stem: str, title: str, folder: Path) -> Path:
    """Write several cards beside each other as a page of HTML."""
    found, path = table_of(pages), folder / f"{stem}.html"
    rows = tuple(tuple(cell.replace("×÷ ", f"×÷{NARROW}") for cell in row) for row in found.rows)
    page = Document(f"Leak cards: {title}", sections=(Section(tables=(replace(found, rows=rows),)),))
    stamped_file.write(path, html.render(page).encode())
    return path
