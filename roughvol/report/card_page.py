"""The leak card as files: one page of HTML, and one page of PDF; several cards beside each other in a table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from xarray import Dataset

from roughvol.analysis.closing import LOADS
from roughvol.analysis.leak_card import Card, SealLeak, Way
from roughvol.analysis.tables import Table, number
from roughvol.report import card_text, html
from roughvol.report.document import Document, Drawing, Section
from roughvol.report.figures import card_print, leak_card
from roughvol.store import stamped_file
from roughvol.study import Study

NARROW = "\u00a0"  # keeps a factor on one line
NONE_EXCEEDED = "No limit of the model is exceeded among those compared."
NUMBERS = (  # heads of the numbers of cards as CSV
    *("card", "load", "surfaces", *LOADS, "of", "axis"),
    *("leak", "leak_lower", "leak_upper", "leak_unit"),
    *("closing_pressure", "closing_pressure_lower", "closing_pressure_upper"),
)


@dataclass(frozen=True, eq=False)
class Page:
    """A card with its runs on the finest grid, its study and command, and the name of its files without a suffix."""

    card: Card
    fine: tuple[Dataset, ...]
    study: Study
    command: str
    stem: str


def write(page: Page, folder: Path) -> Path:
    """Write a card as HTML and PDF, and return the path of the first; the card of another study is not overwritten."""
    path, shown = folder / f"{page.stem}.html", document(page)
    study = card_text.digest(page.study)
    if path.exists() and study.encode() not in path.read_bytes():
        path = path.with_name(f"{page.stem}_{study}.html")
    stamped_file.write(path, html.render(shown).encode())
    card_print.page_of(page.card, shown).savefig(path.with_name(f"{path.name.removesuffix('.html')}.pdf"))
    return path


def document(page: Page) -> Document:
    """Return a card as a page: answers, drawings, each way, and what the card rests on."""
    card = page.card
    facts, kept, exceeded = card_text.rests_on(page.fine)
    panels = leak_card.panels(card)
    drawn = tuple(Drawing(panel.name, panel.caption, "", leak_card.drawing_of(card, panel)) for panel in panels)
    answers = tuple((f"Along {way.axis}", card_text.answer(card, way)) for way in card.ways)
    if card.seal is not None:
        answers = (("The seal", card_text.seal(card.seal, legs=card_text.has_legs(card))), *answers)
    limits = Section(kind="warnings", items=tuple(exceeded)) if exceeded else Section(notes=(NONE_EXCEEDED,))
    held = (Section(kind="kept", under="Kept:", items=tuple(kept)),) if kept else ()
    parts = [
        Section(kind="answer", notes=(f"At {card_text.load_of(card)}.",), facts=answers),
        Section(kind="card", notes=(card_text.patch(card),), drawings=drawn),
        Section(kind="pair", sections=tuple(_way(f"Along {way.axis}", card, way) for way in card.ways)),
        *([_seal(f"The seal of {card.seal.label}", card.seal)] if card.seal and card.seal.words else []),
        *([Section("Surfaces", tables=(card_text.surfaces(card),))] if len(card.surfaces) > 1 else []),
        Section("What the card rests on", facts=(*card_text.load_facts(card), *facts)),
        Section("Limits of the model, over the states of the sweep", sections=(limits, *held)),
        Section("Identity", facts=tuple(card_text.identity(page.fine, page.study, page.command))),
    ]
    return Document(f"Leak card: {card.title}", sections=tuple(parts))


def _way(title: str, card: Card, way: Way) -> Section:
    """Return where a way closes, and the error of its leak."""
    return _leak(title, [*card_text.details(way), *card_text.closes(card, way)], way)


def _seal(title: str, seal: SealLeak) -> Section:
    """Return how the leak of a seal was found, and its error."""
    return _leak(title, card_text.seal_details(seal), seal)


def _leak(title: str, words: Iterable[str], leak: Way | SealLeak) -> Section:
    """Return words on a leak as sentences, and its error."""
    lines = tuple(f"{line[:1].upper()}{line[1:]}." for line in words)
    rows = tuple((name, factor.replace(" ", NARROW), words) for name, factor, words in card_text.budget(leak))
    return Section(title, notes=lines, tables=(Table("", card_text.HEAD, rows),) if leak.parts else ())


def brief(page: Page) -> Section:
    """Return a card for a terminal: load, leaks with their errors, and warnings."""
    card = page.card
    length = f" {card.length_unit}" if card.length_unit else ""
    sizes = (
        f"Sq {card_text.short(surface.number('Sq'))}{length}, Sdq {card_text.short(surface.number('Sdq'))}"
        for surface in card.surfaces
    )
    surfaces = [("Surface", f"{surface.name}, {size}") for surface, size in zip(card.surfaces, sizes, strict=True)]
    found, _, exceeded = card_text.rests_on(page.fine)
    facts = (*surfaces, *card_text.load_facts(card), *(fact for fact in found if fact[0] in card_text.FLUID))
    ways = (_way(f"along {way.axis}: {card_text.answer(card, way)}", card, way) for way in card.ways)
    warnings = tuple(f"warning: {line}" for line in exceeded)
    seal = []
    if card.seal is not None:
        seal = [_seal(f"The seal {card_text.seal(card.seal, legs=card_text.has_legs(card))}", card.seal)]
    return Section(facts=facts, sections=(*seal, *ways, Section(notes=(card_text.patch(card),), items=warnings)))


def table_of(pages: Sequence[Page]) -> Table:
    """Return several cards beside each other."""
    rows = [tuple(_cells(page.card)) for page in pages]
    note = "The leak of several surfaces is their median."
    if any(way.leak.value == 0.0 for page in pages for way in page.card.ways):
        note += " The error of a closed way is that of its closing load."
    return Table(
        "Cards", tuple(head for head, _ in rows[0]), tuple(tuple(cell for _, cell in row) for row in rows), note
    )


def _cells(card: Card) -> Iterator[tuple[str, str]]:
    """Yield the head of each column of the table of cards, and what a card has there."""
    short, gases = card_text.short, card_text.gases(card)
    unit = card_text.in_brackets(card.ways[0].unit) or f" T* V*³{f' {card_text.OF_LIQUID}' * bool(gases)}"
    yield "card", card.title
    yield "surfaces", str(len(card.surfaces))
    yield "load", card_text.load_of(card)
    for way in card.ways:
        yield f"leak {way.axis}{unit}", short(way.leak.value)
        yield "error", card_text.factor(way.factor, way.smaller)
        yield f"{way.axis} closes", way.closing.short
    for gas in gases:
        for way, leak in zip(card.ways, gas.leaks, strict=True):
            yield f"leak of the gas {way.axis}{card_text.in_brackets(gas.unit)}", short(leak.value)
    if (seal := card.seal) is not None:
        known = math.isfinite(seal.closing)
        yield f"leak of the seal{unit}", short(seal.leak)
        yield "error", card_text.factor(seal.factor, seal.smaller)
        yield "seal closes", f"{number(seal.closing)} {seal.load_unit}".strip() if known else short(seal.closing)
        if seal.gas_unit:
            yield f"leak of the gas, seal{card_text.in_brackets(seal.gas_unit)}", short(seal.gas_leak)


def numbers_of(pages: Sequence[Page]) -> list[tuple[Any, ...]]:
    """Return the numbers of cards under `NUMBERS`, a row for each leak; pressures are in MPa, None where unknown."""
    return [
        (page.card.title, page.card.load, len(page.card.surfaces), *map(found["load"].get, LOADS), *leak)
        for page in pages
        for found in [page.card.plain()]
        for leak in _leaks(found)
    ]


def _leaks(card: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    """Yield the leaks of the plain data of a card: of the patch, of what is beside it, and of the seal."""
    unknown = None, None
    for way in card["ways"]:
        leak, closing = (way[key] or unknown for key in ("leak_interval", "closing_pressure_interval"))
        yield "patch", way["axis"], way["leak"], *leak, way["unit"], way["closing_pressure"], *closing
    for beside in card.get("beside", ()):
        for axis in (way["axis"] for way in card["ways"]):
            leak = beside.get(f"{axis}_interval") or unknown
            yield beside["words"], axis, beside[axis], *leak, beside["unit"], None, *unknown
    if seal := card.get("seal"):
        leak, closing = (seal[key] or unknown for key in ("leak_interval", "tight_above_interval"))
        yield "seal", None, seal["leak"], *leak, card["ways"][0]["unit"], seal["tight_above"], *closing
        if "gas_leak" in seal:
            leak = seal["gas_leak_interval"] or unknown
            yield "seal, gas", None, seal["gas_leak"], *leak, seal["gas_leak_unit"], None, *unknown


def write_table(pages: Sequence[Page], stem: str, title: str, folder: Path) -> Path:
    """Write several cards beside each other as a page of HTML."""
    found, path = table_of(pages), folder / f"{stem}.html"
    rows = tuple(tuple(cell.replace("×÷ ", f"×÷{NARROW}") for cell in row) for row in found.rows)
    page = Document(f"Leak cards: {title}", sections=(Section(tables=(replace(found, rows=rows),)),))
    stamped_file.write(path, html.render(page).encode())
    return path
