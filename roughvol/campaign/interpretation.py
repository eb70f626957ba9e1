"""Interpretation of a study: its surface in words, and numbers that may be meant in another way.

A load or length of a state is starred unless it has a unit: p* = p L/(E* Sq), d/σ, Δ/σ. Beside a modulus or a length
with a unit it may be meant in that unit, and a sentence gives both readings. So it does beside a modulus without a unit
that is not 1: starred numbers do not depend on it, so its value must mean something. 0 is 0 in every unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from roughvol.campaign.case_surface import surface_of
from roughvol.observables import void
from roughvol.study import STARRED, Case, Level, MadeSurface, Study
from roughvol.study.axes import with_endings
from roughvol.study.plain_data import number_text
from roughvol.study.sections import treatment
from roughvol.study.sections.ensemble import WIDEST
from roughvol.study.sections.seal import unevenness
from roughvol.study.values.units import convert, in_unit, unit_of
from roughvol.surfaces import length_units, measured, texture
from roughvol.surfaces.body import Body
from roughvol.surfaces.files import reading
from roughvol.surfaces.surface import BEYOND, Surface

LARGEST_M = 10  # of a generated surface made to show it: 2^20 nodes
SOFT, HARD = 1e-4, 1.0  # hardness over E*: a tenth of that of the softest metals (validity.toml: `metal`); of no solid
SHOWN = 4  # values in a sentence
SCATTER = 0.01  # relative difference of the largest and the smallest Sq from which both are shown


def shown(study: Study, measured: Surface | None) -> Surface | None:
    """Return the surface of the first case in the units of the study; None if generated and finer than `LARGEST_M`."""
    if measured is not None or not isinstance(study.surface, MadeSurface):
        return measured
    return None if (study.cases()[0].m or 0) > LARGEST_M else _first_surface(study)


def _first_surface(study: Study) -> Surface:
    """Return the surface of the first case in the units of the study, with m ≤ `LARGEST_M` if it is generated."""
    case = study.cases()[0]
    surface = surface_of(case if case.m is None else replace(case, m=min(case.m, LARGEST_M)))
    height = study.surface.height if isinstance(study.surface, MadeSurface) else None
    return surface if height is None else surface.scaled(height)


def text(surface: Surface, case: Case, cases: int = 1) -> str:
    """Return the surface of the first of so many cases as comments of YAML: size, heights, readers, treatment."""
    unit = f" {case.length_unit}" if case.length_unit else ""
    (rows, columns), spacing = surface.shape, surface.spacing
    period, width = "one period of " if surface.periodic else "", spacing * surface.intervals[1]
    lines = [
        f"surface {period}{rows} x {columns} nodes, L = {surface.side:.6g}{unit} by {width:.6g}{unit}, "
        f"spacing {spacing:.6g}{unit}",
        f"sides {surface.sides}: {BEYOND[surface.sides]}",
    ]
    if case.file is None or cases > 1:
        lines.append(case.label + f", the first of {cases} cases" * (cases > 1))
    roughness = f"Sq = {surface.Sq:.6g}{unit}, Sdq = {texture.Sdq(surface.with_neighbours, spacing):.4g}"
    if surface.Sq > 0.0:
        roughness += f", z_max/Sq = {surface.peak:.3g}, z_min/Sq = {surface.pit:.3g} (from the mean plane)"
    lines.append(roughness)
    if case.file is not None:
        lines += [_reading(body, case.length_unit) for body in case.bodies]
        share = surface.filled / (rows * columns)
        number = f"{surface.filled} height{'s' * (surface.filled != 1)}"
        lines.append(f"missing {number} ({share:.2%})" + ", filled" * (surface.filled > 0))
    if surface.peak_before is not None:
        count = "1 outlier" if surface.outliers == 1 else f"{surface.outliers} outliers"
        lines.append(f"{count} removed; z_max/Sq was {surface.peak_before:.3g} and is {surface.peak:.3g}")
    steps = treatment.steps(case.treatment, case.length_unit)
    lines += [f"step {number}: {step}" for number, step in enumerate(steps, 1)]
    lines += [body.added for body in case.bodies[1:]]
    first, *others = lines
    return "\n".join([f"# {first}", *(f"#         {line}" for line in others)])


def _reading(body: Body, wanted: str | None) -> str:
    """Return file, reader and unit of a body."""
    ignored = body.header == "ignore"
    reader = reading.describe(body.file, body.variable, columns=body.columns, ignore_header=ignored).reader
    unit = f"in {wanted}, the unit of the study" if wanted else "without a unit"
    if body.numbers_in:
        unit = f"of {body.numbers_in} a count" if length_units.is_count(body.numbers_in) else f"in {body.numbers_in}"
        unit += f", converted to {wanted}" * (wanted is not None and body.numbers_in != wanted)
    return f"{body.file.name} read by {reader}, heights {unit}"


def default_sides(study: Study) -> str:
    """Return a sentence on the sides of height files where a study does not name them; versions before 0.16 differ."""
    if isinstance(study.surface, MadeSurface) or "sides" in study.surface.model_fields_set:
        return ""
    return (
        "surface.sides is not given: height files are mirrored at their sides; before version 0.16 they were pressed "
        "as a free patch, which is sides: free"
    )


def notes(cases: Sequence[Case], surface: Surface) -> tuple[str, ...]:
    """Return the doubts of cases, and of heights of the first case that are absurd for its length."""
    return (*(note for case in cases for note in case.notes), *measured.notes(surface, cases[0].length_unit))


def doubts(study: Study, surface: Surface | None = None) -> list[str]:
    """Return sentences on the numbers of a study that may be meant in another way."""
    if study.axes:
        every = [(variant.words, doubts(variant.study, surface)) for variant in study.variants]
        return [f"{sentence}{ending}" for sentence, ending in with_endings(every)]
    surface = surface or _first_surface(study)
    several, case = isinstance(study.surface, MadeSurface) or len(study.surface.each) > 1, study.cases()[0]
    waves = void.region(case, surface)["region_waves"] if study.seal is not None else ()
    return sentences(study, [surface.Sq], surface.side, case.length_unit, waves, about="about " * several)


def sentences(
    study: Study, Sq: Iterable[float], L: float, unit: str | None, waves: Sequence[float], *, about: str = ""
) -> list[str]:
    """Return a sentence for each kind of number that may be meant in another way.

    L and the Sq have one unit, None for an arbitrary one. ``waves`` are the numbers of waves along x and y of a patch
    of a seal. ``about`` is a word before converted numbers.
    """
    found, every = [*_unused(study), *_hardness(study), *_accuracies(study), *_seal(study, unit, waves)], list(Sq)
    if flat := every.count(0.0):
        what = "the surface is flat" if len(every) == 1 else f"{flat} of {len(every)} surfaces are flat"
        found.append(f"{what} once treated: Sq is 0, and numbers over Sq have no meaning")
    heights = [float(height) for height in every if height > 0.0]
    if not heights:
        return found
    ends = [min(heights), max(heights)]
    material, fluid = study.material, study.record.fluid_pressure
    scales = [material.contact_modulus * end / L for end in ends]
    pressures = _bare(study, "pressure")
    if pressures and (material.unit is not None or getattr(material, material.MODULUS) != 1.0):
        found.append(_pressures(study, "pressure", pressures, scales, about))
    hardness = material.indentation_hardness if material.plastic else None
    if pressures and hardness is not None and pressures[-1] * min(scales) > hardness:
        largest = f"p* = {number_text(pressures[-1])} is not reached: pressures end at the hardness"
        found.append(f"{largest}, {about}p* = {hardness / max(scales):.3g}")
    if fluid is not None and not fluid.has_units and material.unit is not None:
        found.append(_pressures(study, "fluid pressure", [p for p in (fluid.outlet, fluid.inlet) if p], scales, about))
    for kind in ("separation", "indentation") if unit is not None else ():
        if values := _bare(study, kind):
            text = f"{_listed(kind, values)}, that is {about}{_range(values, ends)} {unit}"
            found.append(f"{text}; write '{number_text(values[0])} {unit}' for a length")
    return found


def _bare(study: Study, kind: str) -> list[float]:
    """Return the values without a unit of the states of a kind: ends, lists, recorded levels, states of an ensemble."""
    if not study.sweep.steps:
        return []
    states = _goals(study)
    states.append(Level("pressure", study.sweep.legs[0].first))
    states += [level for _, level in study.record.levels()]
    states += study.ensemble.at.levels if study.ensemble is not None else ()
    return sorted({level.value for level in states if level.kind == kind and level.value and not unit_of(level.value)})


def _goals(study: Study) -> list[Level]:
    return [level for leg in study.sweep.legs for level in leg.goals]


def _pressures(study: Study, kind: str, values: Sequence[float], scales: Sequence[float], about: str) -> str:
    """Return the sentence on pressures, with their nominal values: starred ones times E* Sq/L."""
    text, unit, wanted = _listed(kind, values), study.material.unit, study.record.dimensional
    if unit is None:
        name = study.material.MODULUS
        return (
            f"{text}, that is {about}{_range(values, scales)} in the unit of {name}; "
            f"for a nominal pressure give both with units, as {name}: 10 MPa and 0.1 MPa"
        )
    shown = (wanted.pressure if wanted is not None else None) or "MPa"
    nominal = _range(values, [convert(1.0, unit, shown) * scale for scale in scales])
    written = f"'{number_text(values[0])} {shown}' for a nominal pressure"
    return f"{text}, that is {about}{nominal} {shown}; write {written}"


def _listed(kind: str, values: Sequence[float]) -> str:
    """Return the first half of a sentence: the numbers, and their starred symbol."""
    star = STARRED[kind.removeprefix("fluid ")].symbol
    if len(values) == 1:
        return f"{kind} {number_text(values[0])} is {star} = {number_text(values[0])}"
    return f"{kind}s {_few(map(number_text, values))} are {star}"


def _range(values: Sequence[float], scales: Sequence[float]) -> str:
    """Return values times a scale; of several values and scales, the extremes."""
    low, high = min(scales), max(scales)
    if high <= low * (1.0 + SCATTER):
        return _few(f"{value * high:.3g}" for value in values)
    products = [value * scale for value in values for scale in scales]
    return f"{min(products):.3g} to {max(products):.3g}"


def _few(texts: Iterable[str]) -> str:
    """Return the first texts, and the last of more."""
    known = list(texts)
    return ", ".join(known if len(known) <= SHOWN else [*known[: SHOWN - 2], "…", known[-1]])


def _unused(study: Study) -> Iterator[str]:
    for k, leg in enumerate(study.sweep.legs):
        if k and leg.first is not None:
            yield f"sweep[{k}].first is not used: equal ratios of a later leg begin at the end of the leg before"
    if study.material.conductivity and (study.material.yields or study.kernel(None).lengths):
        yield "material.conductivity is not used: metal that yields and layers have no conductance from their stiffness"


def _hardness(study: Study) -> Iterator[str]:
    hardness = study.material.indentation_hardness
    if hardness is None or SOFT <= (ratio := hardness / study.material.contact_modulus) <= HARD:
        return
    yield (
        f"hardness {study.material.hardness} is {ratio:.2g} of the contact modulus, and that of solids lies between "
        f"{SOFT:g} and {HARD:g} of it: is its unit right?"
    )


def _seal(study: Study, unit: str | None, waves: Sequence[float]) -> Iterator[str]:
    seal = study.seal
    if seal is None:
        return
    if len(waves) and (text := unevenness(waves)):
        yield text
    if seal.squares(unit) < 1.0:
        yield (
            f"seal.width {seal.width} is larger than seal.length {seal.length}: the length is along the seal line, the "
            "width along the flow"
        )
    forces = [level for level in _goals(study) if level.kind == "load"]
    if forces and unit is not None:
        most = max(forces, key=lambda level: in_unit(level.value or 0.0, "N"))
        pressure = f"write pressure: {seal.pressure(most, unit):.3g} MPa"
        yield f"load {most.value} is the force on one patch; for this force on the seal of {seal.label} {pressure}"


def _accuracies(study: Study) -> Iterator[str]:
    named = study.ensemble.accuracy.named if study.ensemble is not None else {}
    for name, width in named.items():
        if not width.relative and width >= WIDEST and name != "log_leak_rate":
            number = number_text(float(width))
            text = f"accuracy of {name} is {number} in units of {name} itself, no share"
            yield f"{text}: write '{number} %' for a percentage"
