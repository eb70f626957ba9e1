"""The words of a leak card: answers, error budget, what the numbers rest on, and the identity of the run."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence

from xarray import Dataset

from roughvol.analysis.leak_card import Beside, Card, SealLeak, Way
from roughvol.analysis.legs import legs_of
from roughvol.analysis.seal import NO_LEAK, sizes_of
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import Table, number, with_interval
from roughvol.campaign import validity
from roughvol.observables.variables import AXES
from roughvol.report.figures.origin import region_of
from roughvol.report.figures.style import unit_text
from roughvol.report.run_facts import facts
from roughvol.store.stamped_file import digest_of
from roughvol.study import Study, convert
from roughvol.study.plain_data import inline

OF_LIQUID = "of a liquid"
ON_LEG = " on leg 1"
HEAD = ("source of error", "factor", "how it was found")
TIMES = ((1.0, ""), (1000.0, "1000 s"), (86400.0, "a day"), (31557600.0, "a year"))  # in which an amount is said
VOLUMES = ("um^3", "mm^3", "ml", "l", "m^3")
LEAST, MOST = 0.1, 1000.0  # amounts that a person reads
DIGITS = 16  # of a sha256 that are shown
SAME = 1e-3  # relative difference of loads that are shown as the same
NOT_OF_A_CARD = ("File", "States", "Comment", "Seal")  # facts of a run that a card leaves out, or has elsewhere
FLUID = ("Leak rate", "Fluid pressure", "Gas")  # facts of the flow, which a terminal shows too
OF_EACH = ("Nodes", "Size", "Treatment", "Missing heights")  # facts of several files that stand beside each other
NAMED = 60  # most letters of the files of a fact that are named


def amount(
    leak: float, unit: str, interval: tuple[float, float] = (math.nan, math.nan), *, upwards: bool | None = None
) -> str:
    """Return a leak as a person says it, as ``0.28 mm³ in 1000 s, between 0.12 and 0.62``; digits follow the interval.

    Volume and time are such that the amount lies between 0.1 and 1000, the volume that of the study if possible. The
    largest leak of a closed joint is rounded ``upwards``.
    """
    factor, volume, time = _said(leak, unit)
    words, low, high = with_interval(*(factor * number for number in (leak, *interval)), upwards=upwards)
    between = f", between {low} and {high}" if all(map(math.isfinite, interval)) else ""
    if not unit:
        return f"T* V*³ = {words}{between}"
    rate = f"{words} {unit_text(volume)}"
    return f"{rate} in {time}{between}" if time else f"{rate}{between}"


def _said(leak: float, unit: str) -> tuple[float, str, str]:
    """Return the factor from a unit of flow to an amount, its unit, and its time in words."""
    own, per, _ = unit.partition("/")
    if not per or LEAST <= leak < MOST or not leak > 0.0:
        return 1.0, unit, ""
    sizes = [own, *VOLUMES] if leak >= MOST else [own, *reversed(VOLUMES)]
    for volume in sizes:
        a_second = convert(1.0, unit, f"{volume}/s")
        for seconds, time in TIMES:
            if LEAST <= leak * a_second * seconds < MOST:
                return a_second * seconds, volume if time else f"{volume}/s", time
    return 1.0, unit, ""


def short(value: float) -> str:
    """Return a number in three digits, as 0.0279 or 2.79e-4."""
    if not math.isfinite(value):
        return "–"
    if value == 0.0 or 1e-3 <= abs(value) < 999.5:
        return f"{value:.3g}"
    digits, _, power = f"{value:.2e}".partition("e")
    return f"{digits}e{int(power)}"


def answer(card: Card, way: Way) -> str:
    """Return the leak along an axis with its interval, and where the way closes, in words."""
    found = way.leak
    if not math.isfinite(found.value):
        return "not known: the sweep does not reach this load"
    dry = "without fluid pressure " if card.lifted else ""
    closing = tight(way, legs=has_legs(card))
    return "; ".join(filter(None, [_leaks(card, way), _counts(way), _unknown(way), closing and f"{dry}{closing}"]))


def gases(card: Card) -> list[Beside]:
    """Return the leaks of the gas of a card."""
    return [beside for beside in card.beside if beside.gas]


def _leaks(card: Card, way: Way) -> str:
    """Return the leak with its interval; of a study of a gas alone the leak of the gas first."""
    gas, k = next((beside for beside in gases(card) if beside.unit and not way.unit), None), AXES.index(way.axis)
    of_gas = None if gas is None else (gas.leaks[k].value, gas.unit, gas.intervals[k])
    words = _flows(way.leak.value, way.unit, way.interval, of_gas)
    if way.leak.value > 0.0:
        return f"{'median ' if way.leak.surfaces > 1 else ''}{words}"
    return f"closed on this grid, at most {words}" if words else "closed on this grid"


def _flows(
    leak: float, unit: str, interval: tuple[float, float], gas: tuple[float, str, tuple[float, float]] | None
) -> str:
    """Return a leak, or the largest leak of a closed joint, after that of a gas alone; empty where unknown."""
    if leak > 0.0:
        liquid = amount(leak, unit, interval)
        return f"{_of_gas(*gas)}; {OF_LIQUID} {liquid}" if gas is not None and math.isfinite(gas[0]) else liquid
    if not (math.isfinite(interval[1]) and interval[1] > 0.0):
        return ""
    liquid = amount(interval[1], unit, upwards=True)
    if gas is None:
        return liquid
    throughput = f"{_of_gas(gas[2][1], gas[1], upwards=True)}; " if math.isfinite(gas[2][1]) else ""
    return f"{throughput}{OF_LIQUID} {liquid}"


def _of_gas(
    leak: float, unit: str, interval: tuple[float, float] = (math.nan, math.nan), *, upwards: bool | None = None
) -> str:
    """Return the leak of a gas with its interval; digits follow the interval."""
    value, low, high = with_interval(leak, *interval, upwards=upwards)
    between = f", between {low} and {high}" if all(map(math.isfinite, interval)) else ""
    return f"{value} {unit_text(unit)} of the gas{between}"


def _counts(way: Way) -> str:
    """Return how many of several surfaces are open."""
    found = way.leak
    absent = found.surfaces - found.count
    missed = f", {absent} not pressed to this load" if absent else ""
    return f"{way.open} of {found.count} surfaces open{missed}" if found.surfaces > 1 else ""


def _unknown(way: Way) -> str:
    """Return the parts of the error of a leak that are not known; those of a closed way are of its closing load."""
    return f"its error is not known ({way.unknown})" if way.unknown and way.leak.value > 0.0 else ""


def tight(way: Way, *, legs: bool = False) -> str:
    """Return the load above which a way is tight, as ``tight above 0.41 MPa, between 0.33 and 0.55``.

    Of a sweep with ``legs`` it is that of leg 1: on a later leg of a surface that has yielded another load closes.
    """
    closing = way.closing
    if not closing.closed or not math.isfinite(closing.value):  # not followed, or surfaces that stay open
        closed = "closed " if closing.closed else ""
        return f"{ON_LEG if legs else ''} {closed}{closing.words}".strip() if closing.spans else ""
    mean = f"{' in the mean' if len(closing.spans) > 1 else ''}{ON_LEG if legs else ''}"
    unknown = f"({closing.unknown})" if closing.unknown else ""
    return _tight_above(closing.value, closing.interval, closing.unit, mean, unknown)


def _tight_above(load: float, ends: tuple[float, float], unit: str, mean: str = "", unknown: str = "") -> str:
    """Return a load that closes with its interval, rounded upwards; digits follow the interval."""
    name, unit = ("", f" {unit}") if unit else ("p* = ", "")
    value, low, high = with_interval(load, *ends, upwards=True)
    if not all(map(math.isfinite, ends)):
        return f"tight above {name}{value}{unit}{mean}, its error is not known {unknown}".rstrip()
    return f"tight above {name}{value}{unit}{mean}, between {low} and {high}"


def details(way: Way) -> list[str]:
    """Return the leak in the unit of the study, with its range over several surfaces."""
    found = way.leak
    if not math.isfinite(found.value):
        return []
    low, high = way.interval
    ends = f", between {short(low)} and {short(high)}" if math.isfinite(low) and math.isfinite(high) else ""
    unit = f" {unit_text(way.unit)}" if way.unit else ""
    words = f"leak: {short(found.value)}{unit or ', T* V*³'}{ends}"
    if found.surfaces > 1 and way.open:
        words += f"; 16-84 % of the surfaces {short(found.low)} to {short(found.high)}"
    return [words, *([_printed(way.last_open, way.unit)] if way.last_open else [])]


def closes(card: Card, way: Way) -> list[str]:
    """Return where a way closes in words, on each grid, and what these loads leave out."""
    dry = "without fluid pressure " if card.lifted else ""
    leg = "on leg 1 " if has_legs(card) else ""
    lines = [f"closes: {leg}{dry}{way.closing.words}"]
    if way.coarser:
        lines.append("; ".join(f"at {words}: {closing.words}" for words, closing in way.coarser))
    return lines


def factor(larger: float, smaller: float) -> str:
    """Return a factor of the error in words: up and down where they differ."""
    if not math.isfinite(larger):
        return "unknown"
    if math.isclose(larger, smaller, rel_tol=SAME):
        return f"×÷ {number(larger)}"
    return f"× {number(larger)}, {f'÷ {number(smaller)}' if math.isfinite(smaller) else 'down to 0'}"


def budget(way: Way | SealLeak) -> list[tuple[str, str, str]]:
    """Return the error budget of a way or a seal; of a closed way that of its closing load."""
    rows = [(part.name, factor(part.factor, part.smaller), _printed(part.words, way.unit)) for part in way.parts]
    together = "logarithms added in squares" if math.isfinite(way.factor) else "a part of it is not known"
    value = way.leak.value if isinstance(way, Way) else way.leak
    together += "; factors of the closing load" if value == 0.0 else ""
    return [*rows, ("together", factor(way.factor, way.smaller), together)]


def _printed(words: str, unit: str) -> str:
    return words.replace(unit, unit_text(unit)) if unit else words


def surfaces(card: Card) -> Table:
    """Return the surfaces of a card: name, Sq, load, leaks and closings."""
    numbers = {f"Sq{in_brackets(card.length_unit)}": "Sq", "Sdq": "Sdq", "p*": "mean_pressure"}
    numbers |= {f"p [{card.pressure_unit}]": "nominal_pressure"} if card.pressure_unit else {}
    numbers |= {"A*": "contact_area_fraction", "V*": "free_volume"}
    flow = in_brackets(card.ways[0].unit) or " T* V*³"
    leaks, closings = [f"leak {way.axis}{flow}" for way in card.ways], [f"{way.axis} closes" for way in card.ways]
    rows = []
    for surface in card.surfaces:
        values = [number(surface.number(name)) for name in numbers.values()]
        values += [short(surface.leak(axis)) for axis in AXES]
        rows.append((surface.name, *values, *(surface.closing[axis].short for axis in AXES)))
    return Table("Surfaces", ("surface", *numbers, *leaks, *closings), tuple(rows))


def in_brackets(unit: str) -> str:
    """Return a unit for the head of a column, as `` [MPa]``; empty without a unit."""
    return f" [{unit_text(unit)}]" if unit else ""


def load_of(card: Card) -> str:
    """Return the load of a card in words, as ``0.5 MPa (p* = 3)``; of surfaces with different loads their range."""
    if not card.loads("mean_pressure"):
        return f"{_words(card.load)}, beyond the end of the sweep"
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
    named = (load.partition(", leg ")[2] for load in (card.load, card.surfaces[0].recorded))
    leg = next(filter(None, named), legs[-1 if card.load == "last" else 0])
    return f"on leg {leg}" if len(legs) > 1 else ""


def _range(loads: list[float]) -> str:
    low, high = min(loads), max(loads)
    return number(low) if high - low <= SAME * high else f"{number(low)} to {number(high)}"


def load_facts(card: Card) -> Iterator[tuple[str, str]]:
    """Yield the load of a card and the state there, in pairs of words."""
    at = f", at {_words(card.load)}" if card.loads("mean_pressure") else ""
    yield "Load", f"{load_of(card)}{at}"
    if math.isfinite(card.mean("free_volume")):  # beyond the end of a sweep that ends closed the state is not known
        yield from _state_facts(card)
    for beside in card.beside:
        values = [short(leak.value) if math.isfinite(leak.value) else "not known" for leak in beside.leaks]
        for k, (low, high) in enumerate(beside.intervals):
            values[k] += f" ({short(low)} to {short(high)})" * math.isfinite(high)
        axes = ", ".join(f"{way.axis} {value}" for way, value in zip(card.ways, values, strict=True))
        median = "median, " if len(card.surfaces) > 1 else ""
        yield f"{beside.words[:1].upper()}{beside.words[1:]}", f"{median}{axes} {unit_text(beside.unit)}".strip()


def _state_facts(card: Card) -> Iterator[tuple[str, str]]:
    """Yield contact area and mean gap at the load of a card."""
    mean = "mean " if len(card.surfaces) > 1 else ""
    dry, gap = ", without fluid pressure" if card.lifted else "", ""
    yield "Contact area A*", f"{mean}{number(card.mean('contact_area_fraction'))}{dry}"
    if card.length_unit:
        unit = str(card.surfaces[0].table["mean_gap"].attrs["units"])
        lengths = [surface.number("free_volume") * surface.number("Sq") for surface in card.surfaces]
        lengths = [convert(length, card.length_unit, unit) for length in lengths if math.isfinite(length)]
        gap = f", {number(sum(lengths) / len(lengths))} {unit_text(unit)}"
    yield "Mean gap V*", f"{mean}{number(card.mean('free_volume'))} σ{gap}{dry}"


def micro(text: str) -> str:
    """Return a text with µm in the place of um."""
    return re.sub(r"\bum\b", "µm", text)


def _words(load: str) -> str:
    """Return the label of a load in words."""
    return load.replace("last", "the end of the sweep", 1).replace("the end of the sweep, leg", "the end of leg", 1)


def seal(of_seal: SealLeak, *, legs: bool = False) -> str:
    """Return a seal, its leak and the load that closes it, in words that follow "the seal".

    Of a sweep with ``legs`` the closing load is that of leg 1.
    """
    is_gas_alone = bool(of_seal.gas_unit) and not of_seal.unit
    of_gas = (of_seal.gas_leak, of_seal.gas_unit, of_seal.gas_interval) if is_gas_alone else None
    words = _flows(of_seal.leak, of_seal.unit, of_seal.interval, of_gas)
    if not math.isfinite(of_seal.leak):
        leaks = f"has no known leak: {NO_LEAK}"
    elif of_seal.leak > 0.0:
        leaks = f"leaks {words}" if of_seal.gas_unit or of_seal.unit else f"has {words}"
    else:
        leaks = f"is closed, and leaks at most {words}" if words else "is closed"
    known = math.isnan(of_seal.leak) or all(map(math.isfinite, of_seal.interval))
    unknown = "" if known else "; its error is not known"
    closing = "the load that closes it is not known"
    if math.isfinite(of_seal.closing):
        closing = _tight_above(of_seal.closing, of_seal.closing_interval, of_seal.load_unit, ON_LEG if legs else "")
    leaks = leaks.replace("T* V*³", "T* V*³ length/width")
    return f"of {of_seal.label} {leaks}{unknown}; {closing}"


def seal_details(of_seal: SealLeak) -> list[str]:
    """Return how the leak of a seal was found, in words."""
    return [micro(_printed(words, of_seal.gas_unit)) for words in of_seal.words]


def patch(card: Card) -> str:
    """Return of which patch the leaks are, in a sentence."""
    sizes = {_size(surface.table, card.length_unit) for surface in card.surfaces}
    each = "each surface" if len(card.surfaces) > 1 else "the surface"
    region = region_of(card.surfaces[0].table)
    inside = f", observed in its region {region}" if region else ""
    named = " or ".join(sorted(sizes))
    leak, other = "The leak", ", not that of a seal of many patches"
    if card.seal is not None:
        leak, other = "The leak along x and along y", ""
    return f"{leak} is that of the patch, {each} of {named}{inside}{other}."


def _size(table: Dataset, unit: str) -> str:
    """Return length and width of a surface in words."""
    L = float(table["L"])
    ((rows, columns),) = sizes_of(table)
    words = f" {unit_text(unit)}" if unit else " (unit of L)"
    return f"{number(L)} × {number(L * columns / rows)}{words}"


def rests_on(fine: Sequence[Dataset]) -> tuple[list[tuple[str, str]], list[str], list[str]]:
    """Return size, treatment, material and fluid of the runs, and the limits of the model kept and exceeded."""
    found: dict[str, dict[str, list[str]]] = {}
    kept, exceeded = {limit.key: limit.kept for limit in validity.LIMITS.values() if limit.kept}, list[str]()
    for ds in fine:
        run = Run.of("", ds)
        own = facts(run)
        for name, value in (*own.surface, *_material(run), *own.loading):
            if name not in NOT_OF_A_CARD:
                words = micro(value.replace(own.title, "the file"))
                found.setdefault(name, {}).setdefault(words, []).append(own.title)
        label = f"{own.title}: " if len(fine) > 1 else ""
        exceeded += [f"{label}{line}" for line in own.warnings]
        study = run.study
        held = validity.kept(validity.setting(study), run.dataset) if study is not None else []
        kept = {limit.key: limit.kept for limit in held if limit.key in kept}
    # the table of surfaces has what differs, but for sizes and treatments
    pairs = [(name, _of_files(values)) for name, values in found.items() if len(values) == 1 or name in OF_EACH]
    return pairs, list(kept.values()), list(dict.fromkeys(exceeded))


def _of_files(values: Mapping[str, Sequence[str]]) -> str:
    """Return a fact of several files: the steps that all have, then those of some files behind their names."""
    steps = {tuple(words.split("; ")): names for words, names in values.items()}
    of_all = [step for step in next(iter(steps)) if all(step in own for own in steps)]
    of_some = dict[str, list[str]]()
    for own, names in steps.items():
        for step in own:
            if step not in of_all:
                of_some.setdefault(step, []).extend(names)
    named = (f"{_some(names)}: {step}" for step, names in of_some.items())
    return "; ".join([*of_all, *named])


def _some(names: Sequence[str]) -> str:
    """Return the names of files, or the number of many."""
    return listed if len(listed := ", ".join(names)) <= NAMED else f"{len(names)} files"


def _material(run: Run) -> Iterator[tuple[str, str]]:
    """Yield the material as the study gives it."""
    given = run.study.material.model_dump(mode="json", exclude_none=True, exclude_defaults=True) if run.study else {}
    if run.study and list(given) != ["E_star"]:
        yield "Material", ", ".join(f"{name} {inline(value)}" for name, value in given.items()) or "E* 1"


def identity(fine: Sequence[Dataset], study: Study, command: str) -> list[tuple[str, str]]:
    """Return study, files, version, date and command of a card."""
    files = [body for ds in fine for body in json.loads(str(ds.attrs.get("height_files", "[]")))]
    computed = {f"{str(ds.attrs.get('date', ''))[:10]}, roughvol {ds.attrs.get('roughvol_version', '')}" for ds in fine}
    return [
        ("Study", f"{study.name}, sha256 {digest(study)}"),
        *((f"File {body['file']}", f"sha256 {body['sha256'][:DIGITS]}") for body in files),
        ("Computed", "; ".join(sorted(computed))),
        ("Command", command),
    ]


def digest(study: Study) -> str:
    """Return the sha256 of a study as a card shows it."""
    return digest_of(study.stored())[:DIGITS]
