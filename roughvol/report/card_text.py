"""The words of a leak card: answers, error budget, what the numbers rest on, and the identity of the run."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from xarray import Dataset

from roughvol.analysis.at import legs_of
from roughvol.analysis.leak_card import Card, Way
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import Table, number
from roughvol.campaign import validity
from roughvol.report.figures.style import unit_text
from roughvol.report.run_facts import facts
from roughvol.store.stamped_file import digest_of
from roughvol.study import Study

HEAD = ("source of error", "factor", "how it was found")
STEPS = "a bracket of two steps of the sweep, without the errors of grid and window"
TIMES = ((1000.0, "1000 s"), (86400.0, "a day"), (31557600.0, "a year"))  # in which an amount is said
DIGITS = 16  # of a sha256 that are shown
WHOLE = ("", "x/L_x 0 to 1, y/L_y 0 to 1")  # regions that leave nothing out
SAME = 1e-3  # relative difference of loads that are shown as the same
LEAST = 0.1  # amount that is said in figures a person reads
NOT_OF_A_CARD = ("File", "States", "Comment")  # facts of a run that a card leaves out, or has elsewhere
FLUID = ("Leak rate", "Fluid pressure", "Gas")  # facts of the flow, which a terminal shows too
OF_EACH = ("Nodes", "Size", "Treatment", "Missing heights")  # facts of several files that stand beside each other


@dataclass(frozen=True)
class Identity:
    """Where a card comes from.

    Attributes
    ----------
    study : Study
        The study as the user wrote it.
    command : str
        The command that writes the card.
    """

    study: Study
    command: str


def amount(value: float, unit: str) -> str:
    """Return a leak in words with an amount in a time, as ``2.79e-4 mm³/s (0.279 mm³ in 1000 s)``."""
    text = f"{short(value)} {unit_text(unit)}" if unit else f"T* V*³ = {short(value)}"
    whole = unit.removesuffix("/s")
    if whole == unit or not 0.0 < value < LEAST:
        return text
    seconds, words = next(((s, words) for s, words in TIMES if value * s >= LEAST), TIMES[-1])
    return f"{text} ({short(value * seconds)} {unit_text(whole)} in {words})"


def short(value: float) -> str:
    """Return a number in three digits, as 0.0279 or 2.79e-4."""
    if not math.isfinite(value):
        return "–"
    if value == 0.0 or 1e-3 <= abs(value) < 999.5:
        return f"{value:.3g}"
    digits, _, power = f"{value:.2e}".partition("e")
    return f"{digits}e{int(power)}"


def answer(way: Way) -> str:
    """Return the leak along an axis with its error in words."""
    found = way.leak
    if not math.isfinite(found.value):
        return "not known: the sweep does not reach this load"
    # a closed way is certified to be closed on its grid
    unknown = [part.name for part in way.parts if not part.known and (found.value > 0.0 or part.name != "solver")]
    error = f"its error is not known ({', '.join(unknown)})"
    low, high = (short(end) for end in way.interval)
    if found.surfaces == 1:
        if found.value > 0.0:
            return f"{amount(found.value, way.unit)}, {error if unknown else f'between {low} and {high}'}"
        end = f"; {_printed(way.last_open, way.unit)}" if way.last_open else ""
        return f"closed on this grid, {amount(0.0, way.unit)}; {error}{end}"
    absent = found.surfaces - found.count
    counts = f"{way.open} of {found.count} surfaces open" + (f", {absent} not pressed to this load" if absent else "")
    if not way.open:
        return f"closed on this grid, {amount(0.0, way.unit)}; {counts}; {error}"
    spread = f"16-84 % of the surfaces {short(found.low)} to {short(found.high)}"
    interval = error if unknown else f"the median lies between {low} and {high}"
    return f"median {amount(found.value, way.unit)}; {counts}; {spread}; {interval}"


def closes(card: Card, way: Way) -> list[str]:
    """Return where a way closes in words, on each grid, and what these loads leave out."""
    dry = "without fluid pressure " if card.lifted else ""
    leg = "on leg 1 " if has_legs(card) else ""
    bracket = f" ({STEPS})" if way.closing.closed else ""
    lines = [f"closes: {leg}{dry}{way.closing.words}{bracket}"]
    if way.coarser:
        lines.append("; ".join(f"at {words}: {closing.words}" for words, closing in way.coarser))
    return lines


def factor(value: float) -> str:
    """Return a factor of the error in words."""
    return f"×÷ {number(value)}" if math.isfinite(value) else "unknown"


def budget(way: Way) -> list[tuple[str, str, str]]:
    """Return the error budget of a way."""
    rows = [(part.name, factor(part.factor), _printed(part.words, way.unit)) for part in way.parts]
    together = "logarithms added in squares" if math.isfinite(way.factor) else "a part of it is not known"
    return [*rows, ("together", factor(way.factor), together)]


def _printed(words: str, unit: str) -> str:
    return words.replace(unit, unit_text(unit)) if unit else words


def surfaces(card: Card) -> Table:
    """Return the surfaces of a card: name, Sq, load, leaks and closings."""
    numbers = {f"Sq{in_brackets(card.length_unit)}": "Sq", "Sdq": "Sdq", "p*": "mean_pressure"}
    numbers |= {f"p [{card.pressure_unit}]": "nominal_pressure"} if card.pressure_unit else {}
    numbers |= {"A*": "contact_area", "V*": "free_volume"}
    flow = in_brackets(card.ways[0].unit) or " T* V*³"
    leaks, closings = [f"leak {way.axis}{flow}" for way in card.ways], [f"{way.axis} closes" for way in card.ways]
    rows = []
    for one in card.surfaces:
        values = (number(getattr(one, name)) for name in numbers.values())
        rows.append((one.name, *values, *map(short, one.leaks), *(closing.short for closing in one.closings)))
    return Table("Surfaces", ("surface", *numbers, *leaks, *closings), tuple(rows))


def in_brackets(unit: str) -> str:
    """Return a unit for the head of a column, as `` [MPa]``; empty without a unit."""
    return f" [{unit_text(unit)}]" if unit else ""


def load_of(card: Card) -> str:
    """Return the load of a card in words, as ``0.5 MPa (p* = 3)``; of surfaces with different loads their range."""
    load = f"p* = {_range(card.loads('mean_pressure'))}"
    if card.pressure_unit:
        load = f"{_range(card.loads('nominal_pressure'))} {card.pressure_unit} ({load})"
    return " ".join(filter(None, [load, _leg(card), "under fluid pressure" if card.lifted else ""]))


def has_legs(card: Card) -> bool:
    """Return whether the surfaces of a card are pressed along a path of several legs."""
    return len(legs_of(card.surfaces[0].table)) > 1


def _leg(card: Card) -> str:
    """Return the leg of the load of a card in words; empty without legs."""
    legs = legs_of(card.surfaces[0].table)
    leg = card.load.partition(", leg ")[2] or legs[-1 if card.load == "last" else 0]
    return f"on leg {leg}" if len(legs) > 1 else ""


def _range(loads: list[float]) -> str:
    if not loads:
        return "not reached"
    low, high = min(loads), max(loads)
    return number(low) if high - low <= SAME * high else f"{number(low)} to {number(high)}"


def load_facts(card: Card) -> Iterator[tuple[str, str]]:
    """Yield the load of a card and the state there, in pairs of words."""
    yield "Load", f"{load_of(card)}, at {_words(card.load)}"
    mean = "mean " if len(card.surfaces) > 1 else ""
    yield "Contact area A*", f"{mean}{number(card.mean('contact_area'))}"
    gap = ""
    if card.length_unit:
        lengths = [one.free_volume * one.Sq for one in card.surfaces if math.isfinite(one.free_volume)]
        gap = f", {number(sum(lengths) / len(lengths))} {unit_text(card.length_unit)}" if lengths else ""
    dry = ", of the dry gap" if card.lifted else ""
    yield "Mean gap V*", f"{mean}{number(card.mean('free_volume'))} σ{gap}{dry}"
    for beside in card.beside:
        values = (short(leak.value) if math.isfinite(leak.value) else "not known" for leak in beside.leaks)
        axes = ", ".join(f"{way.axis} {value}" for way, value in zip(card.ways, values, strict=True))
        median = "median, " if len(card.surfaces) > 1 else ""
        yield f"{beside.words[:1].upper()}{beside.words[1:]}", f"{median}{axes} {unit_text(beside.unit)}".strip()


def _words(load: str) -> str:
    """Return the label of a load in words."""
    return load.replace("last", "the end of the sweep", 1).replace("the end of the sweep, leg", "the end of leg", 1)


def patch(card: Card) -> str:
    """Return of which patch the leaks are, in a sentence."""
    sizes = {_size(one.table, card.length_unit) for one in card.surfaces}
    each = "each surface" if len(card.surfaces) > 1 else "the surface"
    region = str(card.surfaces[0].table.attrs.get("region", ""))
    inside = f", observed in its region {region}" if region not in WHOLE else ""
    named = " or ".join(sorted(sizes))
    return f"The leak is that of the patch, {each} of {named}{inside}, not that of a seal of many patches."


def _size(table: Dataset, unit: str) -> str:
    """Return length and width of a surface in words."""
    L = float(table["L"])
    rows, columns = (int(table[name]) for name in ("nodes_x", "nodes_y"))
    less = 0 if "periodic" in table.attrs else 1
    words = f" {unit_text(unit)}" if unit else " (unit of L)"
    return f"{number(L)} × {number(L * (columns - less) / (rows - less))}{words}"


def rests_on(fine: Sequence[Dataset]) -> tuple[list[tuple[str, str]], list[str], list[str]]:
    """Return size, treatment, material and fluid of the runs, and the limits of the model kept and exceeded."""
    found: dict[str, dict[str, None]] = {}
    kept, exceeded = {limit.key: limit.kept for limit in validity.LIMITS.values() if limit.kept}, list[str]()
    for ds in fine:
        run = Run.of("", ds)
        own = facts(run)
        for name, value in (*own.surface, *_material(run), *own.loading):
            if name not in NOT_OF_A_CARD:
                found.setdefault(name, {})[value.replace(own.title, "the file")] = None
        label = f"{own.title}: " if len(fine) > 1 else ""
        exceeded += [f"{label}{line}" for line in own.warnings]
        study = run.study
        held = validity.kept(validity.setting(study), run.dataset) if study is not None else []
        kept = {limit.key: limit.kept for limit in held if limit.key in kept}
    # the table of surfaces has what differs, but for sizes and treatments
    pairs = [(name, "; ".join(values)) for name, values in found.items() if len(values) == 1 or name in OF_EACH]
    return pairs, list(kept.values()), list(dict.fromkeys(exceeded))


def _material(run: Run) -> Iterator[tuple[str, str]]:
    """Yield the material as the study gives it."""
    given = run.study.material.model_dump(mode="json", exclude_none=True, exclude_defaults=True) if run.study else {}
    if run.study and list(given) != ["E_star"]:
        yield "Material", ", ".join(f"{name} {value}" for name, value in given.items()) or "E* 1"


def identity(fine: Sequence[Dataset], origin: Identity) -> list[tuple[str, str]]:
    """Return study, files, version, date and command of a card."""
    files = [body for ds in fine for body in json.loads(str(ds.attrs.get("height_files", "[]")))]
    computed = {f"{str(ds.attrs.get('date', ''))[:10]}, roughvol {ds.attrs.get('roughvol_version', '')}" for ds in fine}
    return [
        ("Study", f"{origin.study.name}, sha256 {digest_of(origin.study.stored())[:DIGITS]}"),
        *((f"File {body['file']}", f"sha256 {body['sha256'][:DIGITS]}") for body in files),
        ("Computed", "; ".join(sorted(computed))),
        ("Command", origin.command),
    ]
