"""Rules across the sections of a study: keys that need or exclude each other, and values that do not fit together.

pydantic checks each section. A rule reads validated sections. A study with a faulty key is checked without this key:
the rules that read the key are left out, and all other problems are reported beside the fault.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from roughvol.errors import meant
from roughvol.study.file import StudyFile
from roughvol.study.plain_data import KeyPath, number_text
from roughvol.study.sections.ensemble import AUTO_TO, CLOSING, FEWEST_LEVELS, RECORDED_BY, Accuracies
from roughvol.study.sections.height_file import HEIGHT_FORMATS, HeightFile
from roughvol.study.sections.record import EVERY_STEP, Dimensional, Record, Region
from roughvol.study.sections.solver import PAPER_MAX_M, FreeKernel, NamedKernel
from roughvol.study.sections.strict import names
from roughvol.study.sections.surface import FEWEST, SPECTRAL, GeneratedSurface, SpectralSurface
from roughvol.study.sections.sweep import Legs, Sweep
from roughvol.study.validation import Problems, Rule
from roughvol.study.values.state_kinds import LOAD_OF_REGION, STATE_KINDS, Level, slack
from roughvol.study.values.units import Quantity, in_unit, unit_of
from roughvol.surfaces.length_units import METRES
from roughvol.tables import table

MAX_CASES = 100_000  # cases of a study
UNPRESSED = ("heights", "residual_heights", "region", "texture", "psd", "all_legs")  # records that need no contact
PERIODIC_LEAST_M = 3  # smallest m of a periodic midpoint surface
SEVERAL_ARRAYS = (".npz", ".nc", ".tif", ".tiff", ".dat")  # formats of files with several arrays
LISTS_OF_NUMBERS = ("D", "H", "m", "n", "seeds")  # of a surface

OF_MODULUS = ("material.hardness", "material.against.E", "record.fluid_pressure.inlet", "record.fluid_pressure.outlet")
RULES: list[Rule] = []


def _rule(*reads: str) -> Callable[[Callable[[StudyFile], Problems]], Callable[[StudyFile], Problems]]:
    """Register a function as a rule that reads these keys."""

    def register(problems: Callable[[StudyFile], Problems]) -> Callable[[StudyFile], Problems]:
        RULES.append(Rule(tuple(map(_path, reads)), problems))
        return problems

    return register


def _path(key: str) -> KeyPath:
    return tuple(key.split("."))


# What rules read.


def _value(study: Any, path: Iterable[Any]) -> Any:
    """Return the value of a key or a property, None without its section."""
    return functools.reduce(lambda here, name: getattr(here, name, None), path, study)


def _given(study: StudyFile, key: str) -> bool:
    """Return whether a key has another value than its default, or a property is true."""
    *section, name = key.split(".")
    value, holder = _value(study, (*section, name)), _value(study, section)
    field = type(holder).model_fields.get(name) if isinstance(holder, BaseModel) else None
    return bool(value) and (field is None or value != field.default)


def _numbers(path: KeyPath, values: Iterable[float]) -> Iterator[tuple[KeyPath, float]]:
    """Yield the numbers of a list that have no unit, each with its place."""
    yield from (((*path, k), value) for k, value in enumerate(values) if unit_of(value) is None)


def _levels(study: StudyFile) -> list[tuple[KeyPath, Level]]:
    """Return the levels of a record and of an ensemble, each with its place."""
    return [*study.record.levels(), *(study.ensemble.states() if study.ensemble is not None else ())]


def _unloaded(level: Level) -> bool:
    """Return whether a state is without load."""
    return level.kind in ("pressure", "indentation") and level.value == 0.0


# The rules.


def _of_pair(key: str, other: str, message: str, *, needs: bool) -> Rule:
    """Return the rule of a key that needs another, or is excluded by it."""

    def problems(study: StudyFile) -> Problems:
        if _given(study, key) and _given(study, other) != needs:
            yield _path(key), message

    return Rule(tuple(map(_path, (key, *_TABLE["keys_of"].get(other, (other,))))), problems)


_TABLE = table(__file__)
RULES += [
    _of_pair(key, other, message, needs=needs)
    for rows, needs in (("needs", True), ("excludes", False))
    for key, others in _TABLE[rows].items()
    for other, message in others.items()
]
_LENGTH = _TABLE["needs"]["fluid"]["surface.has_length"]
RULES += [
    _of_pair(f"record.dimensional.{key}", "surface.has_length", _LENGTH, needs=True)
    for key in names(Dimensional)
    if key != "pressure"
]


@_rule("surface")
def _cases(study: StudyFile) -> Problems:
    surface = study.surface
    if isinstance(surface, HeightFile):
        return
    cases = len(surface.dimensions) * len(surface.m) * len(surface.seeds)
    if cases > MAX_CASES:
        yield ("surface",), f"makes {cases} cases (D times m times seeds); allowed: at most {MAX_CASES}"


@_rule()
def _duplicates(study: StudyFile) -> Problems:
    numbers: list[tuple[KeyPath, float]] = []
    for name, values in study.surface:
        numbers += _numbers(("surface", name), values) if name in LISTS_OF_NUMBERS else ()
    for path in map(_path, ("record.box_counting.thresholds", "record.region_widths.shares")):
        numbers += _numbers(path, _value(study, path) or ())
    seen: set[tuple[KeyPath, float]] = set()
    for path, number in numbers:
        if (path[:-1], number) in seen:
            yield path, f"duplicate value {number_text(number)}"
        seen.add((path[:-1], number))


@_rule()
def _dense(study: StudyFile) -> Problems:
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
def _beyond_hardness(study: StudyFile) -> Problems:
    material, hardness = study.material, study.material.indentation_hardness
    if hardness is None or not material.plastic or material.unit is None:
        return
    for path, level in study.sweep.states():
        value = level.value if level.kind == "pressure" and isinstance(level.value, Quantity) else 0.0
        if in_unit(value, material.unit) > hardness:
            yield path, f"{value} is not reached: pressures end at the hardness, {material.hardness}"


@_rule("surface.L", "surface.unit")
def _files(study: StudyFile) -> Problems:
    surface = study.surface
    if not isinstance(surface, HeightFile):
        return
    for place, body in zip((("surface",), ("surface", "against")), surface.bodies, strict=False):
        suffix = Path(body.file).suffix.lower()
        single = suffix in HEIGHT_FORMATS and suffix not in SEVERAL_ARRAYS and not (surface.files and body is surface)
        if single and body.variable is not None:
            yield (*place, "variable"), f"a {suffix} file holds one array without a name: omit 'variable'"
    if surface.L is None and not surface.may_have_units:
        yield ("surface", "L"), f"missing, and the heights have no size ({HeightFile.model_fields['L'].description})"


@_rule("surface.sides")
def _periodic(study: StudyFile) -> Problems:
    surface = study.surface
    own = study.material.kernel(study.solver.kernel, None)
    kernel = own or NamedKernel(study.solver.kernel)
    if surface.sides == "free" and kernel.name not in get_args(FreeKernel):
        needs, free = "needs surface.sides: mirrored or periodic", ", ".join(get_args(FreeKernel))
        if own:
            yield ("material", own.lengths[0][0]), f"a layer {needs}; allowed on a free patch: a half space, none"
        else:
            yield ("solver", "kernel"), f"{kernel.name!r} {needs}; allowed on a free patch: {free}"
    if surface.periodic and isinstance(surface, GeneratedSurface):
        for path, m in _numbers(("surface", "m"), surface.m):
            if m < PERIODIC_LEAST_M:
                yield path, f"a periodic surface takes m >= {PERIODIC_LEAST_M} (8 x 8 elements), given {number_text(m)}"
    if surface.periodic and isinstance(surface, HeightFile) and surface.level not in ("none", "mean"):
        message = "a tilted or curved surface is not periodic; allowed with sides: periodic are none, mean"
        yield ("surface", "level"), message


@_rule("solver.kernel", "material.thickness")
def _layer(study: StudyFile) -> Problems:
    material, kernel = study.material, study.solver.kernel
    if material.kernel(kernel, None) is not None and kernel == "punch":
        yield ("solver", "kernel"), "'punch' has no layer; allowed with material.thickness: love, fourier"


@_rule("material", "surface.sides")
def _beyond_full_contact(study: StudyFile) -> Problems:
    if study.surface.sides == "free" or study.material.yields:
        return
    for path, level in study.sweep.states():
        if level.kind == "separation" and (value := level.value or 0.0) < 0.0:
            given = number_text(value) if unit_of(value) is None else value
            sides = study.surface.sides
            yield path, f"must be >= 0, given {given}: d of a {sides} surface is its mean gap, 0 at full contact"


@_rule(*(f"surface.{key}" for key in (*SPECTRAL, "D", "L", "unit")))
def _spectrum(study: StudyFile) -> Problems:
    surface = study.surface
    if not isinstance(surface, SpectralSurface):
        return
    if not surface.H and not surface.D:
        yield ("surface", "H"), "missing: give the Hurst exponent H, or D = 3 - H"
    if unit_of(surface.shortest) and surface.length_unit is None:
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
def _units(study: StudyFile) -> Problems:
    surface, own = study.surface, unit_of(study.surface.L)
    if own is not None and surface.unit not in (None, own):
        yield ("surface", "unit"), f"L has a unit already ({surface.L}): omit 'unit'"
    if surface.has_length:
        return
    lengths: list[tuple[KeyPath, Any]] = []
    for section in ("surface", "material", "seal"):
        lengths += [((section, name), value) for name, value in getattr(study, section) or ()]
    for axis, positions in getattr(surface, "crop", None) or ():
        lengths += [(("surface", "crop", axis), position) for position in positions]
    for path, length in lengths:
        if unit_of(length) in METRES:
            yield path, f"has a unit ({length}) and L has none: give L with its unit, as L: 100 um"


@_rule("surface.L", "surface.unit", "record.region", "sweep")
def _seal(study: StudyFile) -> Problems:
    seal, surface = study.seal, study.surface
    if seal is None:
        return
    if study.sweep.steps == 0:
        yield ("seal",), "needs contact: sweep.steps is 0"
    if isinstance(surface, HeightFile):
        return  # `campaign.card` knows the size of a file
    sides = (study.record.region or Region()).sides(float(surface.L), float(surface.L))
    yield from ((("seal", key), message) for key, message in seal.problems(sides, surface.length_unit))


@_rule("material")
def _moduli(study: StudyFile) -> Problems:
    for path in map(_path, OF_MODULUS if study.material.unit is None else ()):
        if unit_of(_value(study, path)):
            yield path, "has a unit and the modulus has none: give both with units, or none"


@_rule("surface.L", "surface.unit", "material")
def _units_of_states(study: StudyFile) -> Problems:
    for path, level in (*study.sweep.states(), *_levels(study)):
        if message := level.lacking(study.material.unit, "m" if study.surface.has_length else None):
            yield path, message
        if level.kind == "load" and study.record.part is not None:
            yield path, LOAD_OF_REGION


@_rule("record.dimensional")
def _leak_rates(study: StudyFile) -> Problems:
    if study.record.leak_rate is None:
        for path, level in study.sweep.states():
            if level.kind.startswith("leak_rate"):
                fluid = "{dimensional: {leak_rate: {pressure_drop: 1 bar, viscosity: 1 mPa*s}}}"
                yield path, f"needs a fluid: record: {fluid}"


@_rule("record.fluid_pressure", "record.dimensional.leak_rate")
def _one_drop(study: StudyFile) -> Problems:
    fluid, leak = study.record.fluid_pressure, study.record.leak_rate
    if fluid is not None and leak is not None and fluid.has_units:
        inlet, outlet, drop = (in_unit(value, "Pa") for value in (fluid.inlet, fluid.outlet, leak.pressure_drop))
        if abs(inlet - outlet - drop) > 1e-6 * drop:
            message = f"inlet - outlet must equal dimensional.leak_rate.pressure_drop, {leak.pressure_drop}"
            yield ("record", "fluid_pressure"), message


@_rule("sweep", "material")
def _legs(study: StudyFile) -> Problems:
    several = isinstance(study.sweep, Legs)
    legs = [(("sweep", k) if several else ("sweep",), leg) for k, leg in enumerate(study.sweep.legs)]
    for path, leg in legs:
        if leg.equal == "log pressure" and (leg.steps == 0 or _unloaded(leg.target)):
            yield (*path, "equal"), "equal ratios of pressure need steps, and an end > 0"
        if several and leg.steps == 0:
            yield (*path, "steps"), "must be >= 1 on a leg of a path, given 0"
    (path, leg), *_ = legs
    if leg.first is not None and leg.steps > 1 and leg.target.kind == "pressure":
        unit, last = unit_of(leg.first), leg.target.value or 0.0
        if (unit_of(last) is None) == (unit is None) and not in_unit(leg.first, unit) < in_unit(last, unit):
            yield (*path, "first"), "must be below the pressure of the last step"
    if (first := next(leg.states(path), None)) and _unloaded(first[1]):
        where = " on the first leg, which begins at first touch" * several
        yield first[0], f"must be > 0{where}, given {first[1].written}"
    if not several:
        for one, other in itertools.pairwise((leg.listed or ())[:2]):
            falls, kind = in_unit(other.value or 0.0, unit_of(one.value)) < (one.value or 0.0), STATE_KINDS[one.kind]
            if falls != kind.falls:
                way = f"must {'fall' if kind.falls else 'rise'} from value to value, as on loading"
                yield (*path, kind.plural, 1), f"{way}, given {other.written}; a list of legs also unloads"
        return
    if study.ensemble is not None:
        yield ("sweep",), "an ensemble takes one sweep, {steps, to}, and no list of legs"
    for (_, before), (path, leg) in itertools.pairwise(legs):
        if leg.equal == "log pressure" and _unloaded(before.target):
            yield (*path, "equal"), "equal ratios of pressure need a begin > 0, and the leg before ends at 0"
        both = _unloaded(before.target) and _unloaded(leg.target)  # elastic contact is lost where it began
        if before.target.label == leg.target.label or (both and not study.material.yields):
            yield (*path, "to"), "is the end of the leg before: the leg has no length"


@_rule("surface", "ensemble", "sweep")
def _ensemble(study: StudyFile) -> Problems:
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
        yield ("surface", resolution), "must be one number beside 'ensemble': the finest resolution, or 'auto'"
    least = FEWEST << FEWEST_LEVELS - 1 if resolution == "n" else PERIODIC_LEAST_M + FEWEST_LEVELS - 1
    for path, value in _numbers(("surface", resolution), finest):
        if value < least and (resolution == "n" or surface.periodic):
            yield path, f"must be at least {least} beside 'ensemble', which takes {FEWEST_LEVELS} levels or more"
    if study.sweep.steps == 0:
        yield ("ensemble",), "there is no contact to average, since sweep.steps is 0"
    listed = study.sweep.listed if isinstance(study.sweep, Sweep) else None
    if listed is None:
        return
    name = STATE_KINDS[listed[0].kind].plural
    for path, level in ensemble.states():
        if not any(listed_level.same(level) for listed_level in listed):
            yield path, f"{level.written} is not among sweep.{name}: list it there, or give steps and to"


@_rule("ensemble.accuracy", "record.own")
def _quantities(study: StudyFile) -> Problems:
    known = [*names(Accuracies), *(study.record.own or {})]
    for name in study.ensemble.accuracy.own if study.ensemble is not None else ():
        if name not in known:
            hint = meant(name, known)
            place = ("ensemble", "accuracy", name)
            yield place, f"unknown quantity{hint}; allowed: {', '.join(known)}, or a name of record.own"


@_rule("ensemble", "sweep", "record.transport")
def _means(study: StudyFile) -> Problems:
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
        way = CLOSING.get(name, "").removeprefix("percolation-")
        sweep = f"sweep.to: {{percolation: {way}}}, or " if way else ""
        yield place, f"needs {sweep}record.transport.{key}: {EVERY_STEP}"
    if states and quantities.keys() <= CLOSING.keys():
        yield ("ensemble", "at"), f"is of no use for {', '.join(quantities)} alone: leave it out"


@_rule("sweep")
def _contact(study: StudyFile) -> Problems:
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
    for path, level in _levels(study):
        yield from _not_reached(path, level, [Level("step", float(steps))] if level.kind == "step" else ends)


def _not_reached(path: KeyPath, level: Level, ends: list[Level]) -> Problems:
    """Yield a level beyond the ends of all legs in the same quantity; with a unit, that of a mean.

    A leak card may record a load with a unit beyond the end: a way that has closed before is closed there.
    """
    plain = unit_of(level.value) is None
    values = [end.value for end in ends if end.kind == level.kind and (unit_of(end.value) is None) == plain]
    if len(values) < len(ends) or not (plain or path[0] == "ensemble"):  # a leg ends at another quantity
        return
    sign = -1 if level.kind in STATE_KINDS and STATE_KINDS[level.kind].falls else 1
    last = max((value for value in values if value is not None), key=lambda value: sign * value)
    if sign * (in_unit(level.value or 0.0, unit_of(last)) - last) > slack(level.kind, last):
        yield path, f"{level.written} is not reached: the sweep ends at {level.kind} {Level(level.kind, last).written}"
