"""Numbers of a study that may be meant in another way: loads and lengths without a unit, a hardness out of proportion.

A load or length of a state is starred unless it has a unit: p* = p L/(E* Sq), d/σ, Δ/σ. Beside a modulus or a length
with a unit it may be meant in that unit, and a sentence gives both readings. So it does beside a modulus without a unit
that is not 1: starred numbers do not depend on it, so its value must mean something. 0 is 0 in every unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from roughvol.study import STARRED, ContactModulus, Level, Study
from roughvol.study.sections.ensemble import WIDEST
from roughvol.study.values.units import convert, unit_of
from roughvol.study.yaml_text import number_text

SOFT, HARD = (
    1e-4,
    1.0,
)  # hardness over E*: a tenth of that of the softest metals (`validity.SOFTEST`); no solid is harder
SHOWN = 4  # values in a sentence
SCATTER = 0.01  # relative difference of the largest and the smallest Sq from which both are shown


def sentences(study: Study, Sq: Iterable[float], L: float, unit: str | None, *, about: str = "") -> list[str]:
    """Return a sentence for each kind of number that may be meant in another way.

    Parameters
    ----------
    study : Study
        The study, without lists.
    Sq : iterable of float
        Root mean square heights of its surfaces, in the unit of L.
    L : float
        Length of the surfaces.
    unit : str or None
        Unit of L; None for an arbitrary one.
    about : str
        A word before converted numbers, as "about" where Sq is not that of all surfaces.

    Returns
    -------
    list of str
        The sentences; empty for a study without doubt.
    """
    found = [*_hardness(study), *_accuracies(study)]
    heights = np.array([height for height in Sq if np.isfinite(height) and height > 0.0])
    if not heights.size:
        return found
    ends = heights.min(), heights.max()
    modulus, measured = study.material.contact_modulus, study.material.unit
    given = study.material.E_star if isinstance(study.material, ContactModulus) else study.material.E
    states = _states(study)
    pressures = sorted({level.value for level in states if level.kind == "pressure" and level.value})
    if pressures and (measured is not None or given != 1.0):
        scales = [float(modulus * end / L) for end in ends]
        found.append(_pressures(study, "pressure", pressures, scales, about))
    if (fluid := study.record.fluid_pressure) is not None and not fluid.has_units and measured is not None:
        scales = [float(modulus * end / L) for end in ends]
        found.append(_pressures(study, "fluid pressure", [p for p in (fluid.outlet, fluid.inlet) if p], scales, about))
    if unit is not None:
        for kind in ("separation", "indentation"):
            if values := sorted({level.value for level in states if level.kind == kind and level.value}):
                lengths = _range(values, [float(end) for end in ends])
                star = STARRED[kind].symbol
                found.append(
                    f"{_listed(kind, values, star)}, that is {about}{lengths} {unit}; "
                    f"write '{number_text(values[0])} {unit}' for a length"
                )
    return found


def _states(study: Study) -> list[Level]:
    """Return the states of a study without a unit: ends, lists, recorded levels, states of an ensemble."""
    if not study.sweep.steps:
        return []
    states = [level for leg in study.sweep.legs for level in (leg.listed or (leg.target,))]
    states += [Level("pressure", leg.first) for leg in study.sweep.legs]
    states += [level for select in study.record.selects.values() for level in select.levels]
    states += study.ensemble.at.levels if study.ensemble is not None else ()
    return [level for level in states if level.value is not None and unit_of(level.value) is None]


def _pressures(study: Study, kind: str, values: Sequence[float], scales: Sequence[float], about: str) -> str:
    """Return the sentence on pressures, with their nominal values: starred ones times E* Sq/L."""
    text, wanted = _listed(kind, values, STARRED["pressure"].symbol), study.record.dimensional
    unit = study.material.unit
    if unit is None:
        name = "E_star" if isinstance(study.material, ContactModulus) else "E"
        return (
            f"{text}, that is {about}{_range(values, scales)} in the unit of {name}; "
            f"for a nominal pressure give both with units, as {name}: 10 MPa and 0.1 MPa"
        )
    shown = (wanted.pressure if wanted is not None else None) or "MPa"
    factor = convert(1.0, unit, shown)
    nominal = _range(values, [factor * scale for scale in scales])
    written = f"'{number_text(values[0])} {shown}' for a nominal pressure"
    return f"{text}, that is {about}{nominal} {shown}; write {written}"


def _listed(kind: str, values: Sequence[float], star: str) -> str:
    """Return the first half of a sentence: the numbers, and what they are."""
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


def _hardness(study: Study) -> Iterator[str]:
    hardness = study.material.indentation_hardness
    if hardness is None or SOFT <= (ratio := hardness / study.material.contact_modulus) <= HARD:
        return
    yield (
        f"hardness {study.material.hardness} is {ratio:.2g} of the contact modulus, and that of solids lies between "
        f"{SOFT:g} and {HARD:g} of it: is its unit right?"
    )


def _accuracies(study: Study) -> Iterator[str]:
    named = study.ensemble.accuracy.named if study.ensemble is not None else {}
    for name, width in named.items():
        if not width.relative and width >= WIDEST:
            number = number_text(float(width))
            text = f"accuracy of {name} is {number} in units of {name} itself, no share"
            yield f"{text}: write '{number} %' for a percentage"
