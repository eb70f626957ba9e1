"""Rules across the sections of a study: keys that exclude each other, and values that do not fit together.

pydantic checks each section. A rule reads validated sections. A study with a faulty key is checked without this key:
the rules that read the key are left out, and all other problems are reported beside the fault.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

from roughvol.study.sections.ensemble import AUTO_TO, CLOSING, FEWEST_LEVELS, RECORDED_BY
from roughvol.study.sections.height_file import BARE_FORMATS, HEIGHT_FORMATS, CounterBody, HeightFile
from roughvol.study.sections.material import YoungPoisson
from roughvol.study.sections.record import EVERY_STEP, Record
from roughvol.study.sections.solver import PAPER_MAX_M, FreeKernel, PeriodicKernel
from roughvol.study.sections.spectral import FEWEST, SpectralSurface
from roughvol.study.sections.spectral import OWN as SPECTRAL
from roughvol.study.sections.surface import GeneratedSurface
from roughvol.study.sections.sweep import Legs, Sweep
from roughvol.study.validation import Problems, Rule, Sections
from roughvol.study.values.state_kinds import STATE_KINDS, Level
from roughvol.study.values.units import unit_of
from roughvol.study.yaml_text import KeyPath, number_text

MAX_CASES = 100_000  # cases of a study
UNPRESSED = ("heights", "residual_heights", "region", "texture", "psd", "all_legs")  # records that need no contact
PERIODIC_LEAST_M = 3  # smallest m of a periodic midpoint surface
BREAK_PERIOD = ("crop", "downsample", "resample", "low_pass")  # keys that change a period
SEVERAL_ARRAYS = (".npz", ".nc", ".tif", ".tiff", ".dat")  # formats of files with several arrays
LISTS_OF_NUMBERS = ("D", "H", "m", "n", "seeds")  # of a surface
NEEDED_BY_UNIT = {"leak_rate": "transmissivity", "critical_gap": "constriction", "gas_leak_rate": "gas_flow"}


RULES: list[Rule] = []


def _rule(*reads: str) -> Callable[[Callable[[Sections], Problems]], Callable[[Sections], Problems]]:
    """Register a function as a rule that reads these keys."""

    def register(problems: Callable[[Sections], Problems]) -> Callable[[Sections], Problems]:
        RULES.append(Rule(tuple(tuple(key.split(".")) for key in reads), problems))
        return problems

    return register


# What rules read.


def _numbers(path: KeyPath, values: Iterable[float]) -> Iterator[tuple[KeyPath, float]]:
    """Yield the numbers of a list that have no unit, each with its place."""
    yield from (((*path, k), value) for k, value in enumerate(values) if unit_of(value) is None)


def _legs(sweep: Sweep | Legs) -> list[tuple[KeyPath, Sweep]]:
    """Return the legs of a sweep, each with its place."""
    if isinstance(sweep, Legs):
        return [(("sweep", k), leg) for k, leg in enumerate(sweep.legs)]
    return [(("sweep",), sweep)]


def _levels(study: Sections) -> Iterator[tuple[KeyPath, str, tuple[float, ...]]]:
    """Yield place, kind and values of the levels of a record and of an ensemble."""
    chosen = {("record", *path): select.named for path, select in study.record.selects.items()}
    if study.ensemble is not None:
        chosen["ensemble", "at"] = study.ensemble.at.named
    yield from (((*path, kind), kind, values) for path, named in chosen.items() for kind, values in named.items())


# The rules.


@_rule("surface")
def _cases(study: Sections) -> Problems:
    surface = study.surface
    if isinstance(surface, HeightFile):
        return
    cases = len(surface.dimensions) * len(surface.m) * len(surface.seeds)
    if cases > MAX_CASES:
        yield ("surface",), f"makes {cases} cases (D times m times seeds); allowed: at most {MAX_CASES}"


@_rule()
def _duplicates(study: Sections) -> Problems:
    lists: list[tuple[KeyPath, Any]] = [
        (("surface", name), getattr(study.surface, name))
        for name in LISTS_OF_NUMBERS
        if name in type(study.surface).model_fields
    ]
    record = study.record
    if record.box_counting is not None:
        lists.append((("record", "box_counting", "thresholds"), record.box_counting.thresholds))
    if record.region_widths is not None:
        lists.append((("record", "region_widths", "shares"), record.region_widths.shares))
    lists += [(path, values) for path, _, values in _levels(study)]
    for path, values in lists:
        seen: set[float] = set()
        for where, number in _numbers(path, values):
            if number in seen:
                yield where, f"duplicate value {number_text(number)}"
            seen.add(number)


@_rule()
def _dense(study: Sections) -> Problems:
    if study.solver.method != "paper" or isinstance(study.surface, HeightFile):
        return
    dense = "solver method 'paper' is dense and takes"
    if isinstance(study.surface, SpectralSurface):
        if max(study.surface.m, default=AUTO_TO) > PAPER_MAX_M:
            yield ("surface", "n"), f"{dense} n <= {2**PAPER_MAX_M}"
        return
    for path, m in _numbers(("surface", "m"), study.surface.m):
        if m > PAPER_MAX_M:
            yield path, f"{dense} m <= {PAPER_MAX_M}, given {number_text(m)}"


@_rule("material")
def _hardness(study: Sections) -> Problems:
    if study.record.residual_heights and not study.yields:
        yield ("record", "residual_heights"), "no plastic displacement: give material.hardness"
    if study.yields and study.solver.method == "paper":
        yield ("solver",), "solver method 'paper' takes no hardness; allowed: material.plastic: false"
    if study.yields and study.record.fluid_pressure is not None:
        yield ("record", "fluid_pressure"), "needs elastic contact: material.plastic is true and a hardness given"


@_rule("surface.L", "surface.unit")
def _files(study: Sections) -> Problems:
    surface = study.surface
    if not isinstance(surface, HeightFile):
        return
    bodies: list[tuple[KeyPath, HeightFile | CounterBody]] = [] if surface.files else [(("surface",), surface)]
    if surface.against is not None:
        bodies.append((("surface", "against"), surface.against))
    suffixes = [Path(body.file).suffix.lower() for _, body in bodies]
    for (path, body), suffix in zip(bodies, suffixes, strict=True):
        if body.variable is not None and suffix in HEIGHT_FORMATS and suffix not in SEVERAL_ARRAYS:
            yield (*path, "variable"), f"a {suffix} file holds one array without a name: omit 'variable'"
    if surface.files or not {*suffixes} <= {*BARE_FORMATS}:
        return  # other formats may have sizes and units
    if surface.L is None:
        yield ("surface", "L"), f"missing, and the file has no size ({HeightFile.model_fields['L'].description})"
    if surface.length_unit is not None:
        return
    lengths: list[tuple[KeyPath, Any]] = [(("low_pass",), surface.low_pass)]
    if surface.crop is not None:
        lengths += [(("crop", axis), position) for axis in ("x", "y") for position in getattr(surface.crop, axis)]
    for key, length in lengths:
        if unit_of(length):
            yield ("surface", *key), f"has a unit ({length}) and L has none: give L with its unit, as L: 100 um"


@_rule("surface.periodic")
def _periodic(study: Sections) -> Problems:
    surface, record = study.surface, study.record
    cell = record.transport is not None and record.transport.cell_transmissivity is not None
    if cell and (not surface.periodic or record.region is not None):
        message = "needs surface.periodic: true and no record.region: a part of a plane is no period"
        yield ("record", "transport", "cell_transmissivity"), message
    if not surface.periodic:
        if (kernel := study.solver.kernel) in get_args(PeriodicKernel):
            allowed = ", ".join(get_args(FreeKernel))
            yield ("solver", "kernel"), f"{kernel!r} needs surface.periodic: true; allowed on a free patch: {allowed}"
        return
    if isinstance(surface, GeneratedSurface):
        for path, m in _numbers(("surface", "m"), surface.m):
            if m < PERIODIC_LEAST_M:
                yield path, f"a periodic surface takes m >= {PERIODIC_LEAST_M} (8 x 8 elements), given {number_text(m)}"
    if isinstance(surface, HeightFile):
        for key in BREAK_PERIOD:
            if getattr(surface, key) != HeightFile.model_fields[key].default:
                message = "changes or cuts the period of a periodic surface: treat the file beforehand, or omit it"
                yield ("surface", key), message
        if surface.level not in ("none", "mean"):
            yield ("surface", "level"), "a tilted or curved surface is not periodic; allowed with periodic: none, mean"


@_rule("material")
def _beyond_full_contact(study: Sections) -> Problems:
    if not study.surface.periodic or study.yields:
        return
    for path, level in study.sweep.states():
        if level.kind == "separation" and (value := level.value or 0.0) < 0.0:
            given = number_text(value) if unit_of(value) is None else value
            yield path, f"must be >= 0, given {given}: d of a periodic surface is its mean gap, 0 at full contact"


@_rule(*(f"surface.{key}" for key in (*SPECTRAL, "D", "L", "unit")))
def _spectrum(study: Sections) -> Problems:
    surface = study.surface
    if not isinstance(surface, SpectralSurface):
        return
    if not surface.H and not surface.D:
        yield ("surface", "H"), "missing: give the Hurst exponent H, or D = 3 - H"
    for name, other in (("D", "H"), ("shortest", "cut"), ("slope", "Sq")):
        if getattr(surface, name) and getattr(surface, other):
            yield ("surface", name), f"excluded by '{other}': give one of them"
    if unit_of(surface.shortest) and surface.length_unit is None:
        message = f"has a unit ({surface.shortest}) and L has none: give L with its unit, as L: 100 um"
        yield ("surface", "shortest"), message
        return
    given = next((name for name in ("shortest", "cut") if getattr(surface, name) is not None), "n")
    if not surface.n and given == "n":
        yield ("surface", "n"), "'auto' needs cut or shortest: without them λ_s is 2 δ, and each n is another surface"
        return
    cut, most = surface.shortest_ratio, max(surface.n, default=2**AUTO_TO) / 2.0
    if cut <= surface.rolloff:
        text = f"L/λ_s is {number_text(cut)}; allowed: more than rolloff, {number_text(surface.rolloff)}"
        yield ("surface", given), text
    elif cut > most * (1.0 + 1e-9):
        largest = f"half the largest n{'' if surface.n else ' of auto'}, {number_text(most)}"
        yield ("surface", given), f"L/λ_s is {number_text(cut)}; allowed: at most {largest}"
    elif surface.anisotropy >= cut:
        yield ("surface", "anisotropy"), f"must be less than L/λ_s, {number_text(cut)}: no wave along x is left"


@_rule("surface.L", "surface.unit")
def _units(study: Sections) -> Problems:
    surface, Sq = study.surface, getattr(study.surface, "Sq", None)
    own = unit_of(surface.L)
    if own is not None and surface.unit not in (None, own):
        yield ("surface", "unit"), f"L has a unit already ({surface.L}): omit 'unit'"
    if unit_of(Sq) and surface.length_unit is None:
        yield ("surface", "Sq"), f"has a unit ({Sq}) and L has none: give L with its unit, as L: 100 um"


@_rule("material")
def _moduli(study: Sections) -> Problems:
    if study.material.unit is not None:
        return
    if unit_of(study.material.hardness):
        yield ("material", "hardness"), "has a unit and the modulus has none: give both with units, or none"
    other = study.material.against if isinstance(study.material, YoungPoisson) else None
    if other is not None and unit_of(other.E):
        yield ("material", "against", "E"), "has a unit and that of the first body has none: give both with units"
    fluid = study.record.fluid_pressure
    for name in ("inlet", "outlet") if fluid is not None else ():
        if unit_of(getattr(fluid, name)):
            yield ("record", "fluid_pressure", name), "has a unit and the modulus has none: give both with units"


@_rule("surface.L", "surface.unit", "material", "record.transport")
def _dimensional(study: Sections) -> Problems:
    record = study.record
    for name in record.dimensional.named if record.dimensional is not None else ():
        place = ("record", "dimensional", name)
        if name == "pressure" and study.material.unit is None:
            yield place, "needs the modulus with its unit, as material: {E_star: 100 GPa}"
        if name != "pressure" and study.length_unit is None:
            yield place, "needs the unit of length, as surface: {L: 100 um}"
        needed = NEEDED_BY_UNIT.get(name)
        if needed and (record.transport is None or getattr(record.transport, needed) is None):
            yield place, f"needs record.transport.{needed}"


@_rule("surface.L", "surface.unit", "fluid", "record.transport")
def _gas(study: Sections) -> Problems:
    wanted = study.record.transport is not None and study.record.transport.gas_flow is not None
    if study.fluid is None:
        if wanted:
            message = "needs the section fluid, as fluid: {gas: helium, inlet: 1 bar, outlet: 0 bar}"
            yield ("record", "transport", "gas_flow"), message
        return
    if not wanted:
        yield ("fluid",), "needs record.transport.gas_flow, which records the flow of the gas"
    if study.length_unit is None:
        yield ("fluid",), "needs the unit of length, as surface: {L: 100 um}"


@_rule("surface.L", "surface.unit", "material")
def _units_of_states(study: Sections) -> Problems:
    for path, level in (*study.sweep.states(), *study.record.levels()):
        if message := level.lacking(study.material.unit, study.length_unit):
            yield path, message
        if level.kind == "load" and study.record.region is not None:
            yield path, "is a load on the whole surface, and states are those of record.region: give a pressure"


@_rule("record.dimensional")
def _leak_rates(study: Sections) -> Problems:
    if study.record.dimensional is None or study.record.dimensional.leak_rate is None:
        for path, level in study.sweep.states():
            if level.kind.startswith("leak_rate"):
                fluid = "{dimensional: {leak_rate: {pressure_drop: 1 bar, viscosity: 1 mPa*s}}}"
                yield path, f"needs a fluid: record: {fluid}"


@_rule("sweep")
def _path(study: Sections) -> Problems:
    legs = _legs(study.sweep)
    for path, leg in legs:
        if leg.equal == "log pressure" and (leg.steps == 0 or leg.target == Level("pressure", 0.0)):
            yield (*path, "equal"), "equal ratios of pressure need steps, and an end > 0"
    if not isinstance(study.sweep, Legs):
        return
    if study.ensemble is not None:
        yield ("sweep",), "an ensemble takes one sweep, {steps, to}, and no list of legs"
    first = legs[0][1].target
    if first.value == 0.0 and first.kind in ("pressure", "indentation"):
        yield ("sweep", 0, "to", first.kind), "must be > 0 on the first leg, which begins at first touch"
    for (_, before), (path, leg) in itertools.pairwise(legs):
        if before.target.label == leg.target.label:
            yield (*path, "to"), "is the end of the leg before: the leg has no length"


@_rule("surface", "ensemble", "sweep")
def _ensemble(study: Sections) -> Problems:
    surface, ensemble = study.surface, study.ensemble
    made = not isinstance(surface, HeightFile)
    resolution = "n" if isinstance(surface, SpectralSurface) else "m"
    if ensemble is None:
        if made and not getattr(surface, resolution):
            yield ("surface", resolution), "'auto' needs the section 'ensemble', whose accuracy decides it"
        return
    if not made:
        yield ("ensemble",), "needs generated surfaces (surface.D, surface.m): a file of heights is one surface"
        return
    if "seeds" in surface.model_fields_set:
        yield ("surface", "seeds"), "cannot be given beside 'ensemble', which decides how many: leave it out"
    finest = getattr(surface, resolution)
    if len(finest) > 1:
        message = "must be one number beside 'ensemble': the finest resolution, or 'auto'"
        yield ("surface", resolution), message
    least = FEWEST << FEWEST_LEVELS - 1 if resolution == "n" else PERIODIC_LEAST_M + FEWEST_LEVELS - 1
    for path, value in _numbers(("surface", resolution), finest):
        if value < least and (resolution == "n" or surface.periodic):
            yield path, f"must be at least {least} beside 'ensemble', which takes {FEWEST_LEVELS} levels or more"
    if study.sweep.steps == 0:
        yield ("ensemble",), "there is no contact to average, since sweep.steps is 0"
    listed = study.sweep.listed if isinstance(study.sweep, Sweep) else None
    if listed is None:
        return
    known = [level.value for level in listed if unit_of(level.value) is None]
    name, kind_listed = STATE_KINDS[listed[0].kind].plural, listed[0].kind
    for kind, values in ensemble.at.named.items():
        for path, value in _numbers(("ensemble", "at", kind), values):
            if kind != kind_listed or value not in known:
                yield path, f"{number_text(value)} is not among sweep.{name}: list it there, or give steps and to"


@_rule("ensemble", "sweep", "record.transport")
def _means(study: Sections) -> Problems:
    """Yield means without scatter, and means of numbers that are not recorded."""
    if study.ensemble is None or isinstance(study.surface, HeightFile):
        return
    states, quantities, end = study.ensemble.at.named, study.ensemble.accuracy.named, study.sweep.target.kind
    constant = "separation" if end == "mean-plane" else end
    for name in quantities:
        place: KeyPath = ("ensemble", "accuracy", name)
        if name in states:
            yield place, f"is given by ensemble.at.{name}: its value there has no scatter"
        if not states and name == constant:
            yield place, "is the same on every surface at the last step: name states in 'at'"
        key = RECORDED_BY.get(name)
        if key is None or CLOSING.get(name) == end or getattr(study.record.transport, key, None) == EVERY_STEP:
            continue
        sweep = (
            f"sweep.to: {{percolation: {CLOSING[name].removeprefix('percolation-')}}}, or " if name in CLOSING else ""
        )
        yield place, f"needs {sweep}record.transport.{key}: {EVERY_STEP}"
    if states and quantities.keys() <= CLOSING.keys():
        yield ("ensemble", "at"), f"is of no use for {', '.join(quantities)} alone: leave it out"


@_rule("sweep")
def _contact(study: Sections) -> Problems:
    """Yield records without contact, and levels beyond the end of a sweep."""
    record, steps = study.record, study.sweep.steps
    if steps == 0:
        pressed = [name for name in Record.model_fields if name not in UNPRESSED]
        paths: list[KeyPath] = [(name,) for name in pressed if getattr(record, name) not in (None, False)]
        if record.texture is not None and record.texture.at.named:  # texture before load needs no contact
            paths.append(("texture", "at"))
        if record.psd is not None and record.psd.at is not None:
            paths.append(("psd", "at"))
        yield from ((("record", *path), "no contact to record: sweep.steps is 0") for path in paths)
        return
    ends = [leg.target for leg in study.sweep.legs]
    for path, kind, values in _levels(study):
        lasts = [float(steps)] if kind == "step" else [end.value for end in ends if end.kind == kind]
        plain = [value for value in lasts if value is not None and unit_of(value) is None]
        if len(plain) < (1 if kind == "step" else len(ends)):  # a leg ends at another quantity
            continue
        sign = -1 if kind in STATE_KINDS and STATE_KINDS[kind].falls else 1
        last = max(plain, key=lambda value: sign * value)
        for where, level in _numbers(path, values):
            if sign * (level - last) > 1e-9 * max(1.0, abs(last)):
                yield where, f"{number_text(level)} is not reached: the sweep ends at {kind} {number_text(last)}"
