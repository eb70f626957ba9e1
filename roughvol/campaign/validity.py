"""Limits of the model: a linear elastic half space of small slopes, without yield or fluid pressure.

Conventions: pressures are over E*, p/E* = p* Sq/L. s = Sdq/2 is the root mean square contact pressure over E* of a
surface pressed flat (Persson 2001). Limits are choices of this module; validity.md has their sources and remedies.

Slopes and p/E* depend on the ratio of heights to L. A file, ``Sq``, or L with a unit gives it. Otherwise heights have
the unit of L by convention alone, and slope and p/E* are not judged. A hardness is always judged. The rim of a free
patch is judged in studies with a flow or units and without a region: their patch is a sample of a larger joint.

Functions take plain numbers or a collected dataset.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from roughvol.study import Level, MadeSurface, SpectralSurface, Study, convert
from roughvol.study.values.units import in_unit, unit_of

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

STEEPEST = 0.3  # Sdq: the true area is then 4.4 % larger, and the mean contact pressure 0.19 E*
HIGHEST = 0.1  # nominal pressure over E*: strains of ten per cent
LARGEST_DROP = 0.1  # pressure drop over nominal pressure: a linear drop then carries 5 % of the load
ATMOSPHERE = 101325.0  # Pa: the ambient of a gas, whose pressures are absolute; other pressures are over the ambient
PERSISTENT = 0.3  # nominal pressure over hardness: perfect plasticity has 1.3 times the area of persistent asperities
ABOVE_HARDNESS = 0.01  # share of the load above the hardness; tolerates a few peaks of one element
RIM = 0.8  # mean pressure in the central half of each side over that of the whole
HIGH = 6.0  # highest point above the mean plane over Sq: of 10⁶ independent normal heights the highest is at 5
METAL = 20.0  # GPa, E*: above polymers and rubber, below all structural metals
SOFTEST = 1e-3  # contact pressure over E* at which the softest metals yield: H = 3 Y (Tabor 1951), Y/E of 1/3000
UNLOADED = 1e-12  # p*: an unloaded surface to rounding
CLOSES_AT = 0.42  # A* at the closing of the last way (Persson & Yang 2008; Wang & Müser 2020)

SMALL_SLOPES = "Al-Qudsi, De Lorenzis & Scaraggi 2022; Sdr ≈ Sdq²/2 (ISO 25178-2)"
NORMAL_HEIGHTS = "extreme values of normal heights, docs/explanation/validity.md"
SMALL_STRAINS = "Johnson 1985, section 4.1"
HARDNESS = "Tabor 1951, H ≈ 3 Y"
PERSISTENCE = "Williamson & Hunt 1972; Pullen & Williamson 1972: A* = (p/H)/(1 + p/H)"
COUPLING = "Shvarts & Yastrebov 2018"
FREE_PATCH = "configs/seal_region.yaml, docs/explanation/validity.md"


@dataclass(frozen=True)
class Extent:
    """Cases and states beyond a limit."""

    cases: int = 0  # beyond the limit
    of_cases: int = 0  # 0 before the computation
    states: int = 0  # beyond the limit
    of_states: int = 0  # compared; 0 for a limit of the surface
    first: float = math.nan  # p* of the least loaded state beyond the limit

    def __str__(self) -> str:
        """Return the counts as text."""
        text = f"{self.states} of {self.of_states} states"
        return text if self.of_cases == 1 else f"{text} ({self.cases} of {self.of_cases} cases)"


@dataclass(frozen=True)
class Finding:
    """A limit of the model that a study exceeds."""

    key: str  # peak, slope, nominal_pressure, hardness, persistence, metal, pressure_drop, fluid or rim
    sentence: str  # quantity, amount and states beyond the limit
    limit: float
    source: str
    extent: Extent = Extent()


@dataclass(frozen=True)
class Setting:
    """Settings of a study for comparison with the limits."""

    modulus: float  # E* in `unit`
    unit: str | None = None  # of moduli and pressures; None: arbitrary
    shown: str = "MPa"  # unit of pressures in sentences
    hardness: float | None = None  # in `unit`
    hardness_text: str = ""
    yields: bool = False  # pressures end at the hardness
    drop_text: str | None = None  # pressure drop of a leak rate
    drop: float = math.nan  # over E*; NaN for a modulus without a unit
    fluid: float = math.nan  # largest mean pressure of a fluid over the ambient, over E*; NaN without one
    fluid_text: str = ""  # its inlet and outlet
    lifted: bool = False  # fluid pressure lifts the gap at recorded states
    scaled: bool = False  # the ratio of heights to L is that of a real surface
    patch: bool = False  # a free patch that is a sample of a larger joint
    measured: bool = False  # heights come from files
    cleaned: bool = False  # outliers were removed


def setting(study: Study) -> Setting:
    """Return the settings of a study for comparison with the limits."""
    surface, material, record = study.surface, study.material, study.record
    wanted, unit = record.dimensional, material.unit
    leak = wanted.leak_rate if wanted is not None else None
    drops = [] if leak is None else [(in_unit(leak.pressure_drop, "Pa"), str(leak.pressure_drop))]
    if (fluid := study.fluid) is not None:
        drops.append((fluid.pressures[0] - fluid.pressures[1], f"{fluid.inlet} - {fluid.outlet}"))
    pascal, drop_text = max(drops, default=(None, None))
    mean, sides = _mean_fluid(study)
    drop = convert(pascal, "Pa", unit) if pascal is not None and unit is not None else None
    scaled = not isinstance(surface, MadeSurface) or bool(surface.Sq or surface.length_unit)
    scaled = scaled or (isinstance(surface, SpectralSurface) and surface.slope is not None)
    asks = record.transport is not None or wanted is not None or unit is not None
    whole = record.region is None and record.region_widths is None
    return Setting(
        modulus=material.contact_modulus,
        unit=unit,
        shown=(wanted.pressure if wanted is not None else None) or "MPa",
        hardness=material.indentation_hardness,
        hardness_text=_written(material.hardness, unit),
        yields=material.hardness is not None and material.plastic,
        drop_text=drop_text,
        drop=math.nan if drop is None else drop / material.contact_modulus,
        fluid=math.nan if unit is None else convert(mean, "Pa", unit) / material.contact_modulus,
        fluid_text=sides,
        lifted=record.fluid_pressure is not None,
        scaled=scaled,
        patch=asks and whole and not surface.periodic,  # a period has no rim
        measured=not isinstance(surface, MadeSurface),
        cleaned=not isinstance(surface, MadeSurface) and surface.outliers is not None,
    )


def _mean_fluid(study: Study) -> tuple[float, str]:
    """Return the largest mean of inlet and outlet of the fluids of a study over the ambient [Pa], and both in words.

    The mean is NaN without a fluid.
    """
    record, means = study.record, list[tuple[float, str]]()
    if record.dimensional is not None and (leak := record.dimensional.leak_rate) is not None:
        drop = in_unit(leak.pressure_drop, "Pa") or 0.0
        means.append((0.5 * drop, f"inlet {leak.pressure_drop} over the outlet at the ambient"))
    if study.fluid is not None:
        sides = f"inlet {study.fluid.inlet}, outlet {study.fluid.outlet}, absolute"
        means.append((0.5 * sum(study.fluid.pressures) - ATMOSPHERE, sides))
    lift = record.fluid_pressure
    if lift is not None and unit_of(lift.inlet) is not None:
        mean = 0.5 * sum(in_unit(value, "Pa") or 0.0 for value in (lift.inlet, lift.outlet))
        means.append((mean, f"inlet {lift.inlet}, outlet {lift.outlet}"))
    return max(means, default=(math.nan, ""))


def _written(hardness: float | None, unit: str | None) -> str:
    """Return a hardness with its own unit, or with that of the modulus."""
    if hardness is None or unit_of(hardness) is not None:
        return str(hardness)
    return f"{hardness:g} {unit or ''}".strip()


def before(given: Setting, target: Level, *, Sq: float, Sdq: float, L: float) -> list[Finding]:
    """Return the limits that a study will probably exceed, with pressures by Persson's theory.

    Persson (2001): A* = erf(√2 p/(E* Sdq)). At light load the density of the contact pressure over E* is
    (p/s²) exp(-p²/(2 s²)) with s = Sdq/2, and its mean √(π/2) s = 0.63 Sdq.

    Parameters
    ----------
    given : Setting
        See `setting`.
    target : Level
        Last state of the sweep.
    Sq, Sdq, L : float
        Of the roughest surface: Sq and L [one length], Sdq [1]. Unused if ``given.scaled`` is False.

    Returns
    -------
    list of Finding
        Expected excesses.
    """
    findings = []
    scale = 0.5 * Sdq if given.scaled else math.nan
    end = _end(target, scale, Sq / L) if given.scaled else math.nan
    if given.scaled:
        findings += _slope(np.array([Sdq]))
    if end > HIGHEST:
        text = f"nominal pressure will be about {end:.2g} E* at the end (limit {HIGHEST}): strains are not small"
        findings.append(Finding("nominal_pressure", text, HIGHEST, SMALL_STRAINS))
    if given.hardness is not None and not given.yields and scale > 0.0:
        x = given.hardness / given.modulus / scale
        contact = math.exp(-0.5 * x * x)
        load = contact * x * math.sqrt(2.0 / math.pi) + math.erfc(x / math.sqrt(2.0))
        if load > ABOVE_HARDNESS:
            text = (
                f"contact pressure will exceed the hardness {given.hardness_text} on about {_percent(contact)} of the "
                f"contact, with {_percent(load)} of the load: yield is not computed"
            )
            findings.append(Finding("hardness", text, ABOVE_HARDNESS, HARDNESS))
    if given.yields and given.hardness is not None and end > PERSISTENT * given.hardness / given.modulus:
        text = (
            f"nominal pressure will be about {end * given.modulus / given.hardness:.2g} of the hardness at the end "
            f"(limit {PERSISTENT}): {_PERSIST}"
        )
        findings.append(Finding("persistence", text, PERSISTENT, PERSISTENCE))
    findings += _metal(given, math.sqrt(0.5 * math.pi) * scale, "about ")
    if 0.0 < end <= given.fluid:
        text = (
            f"the mean pressure of the fluid is {_pressure(given, given.fluid)} over the ambient ({given.fluid_text}), "
            f"the nominal pressure expected at the end about {_pressure(given, end)}: {_OPENS}"
        )
        findings.append(Finding("fluid", text, 1.0, COUPLING))
    if given.drop_text is not None and math.isnan(given.drop):
        findings.append(_drop_unknown(given))
    elif end > 0.0 and given.drop > LARGEST_DROP * end:
        text = (
            f"pressure_drop {given.drop_text} is {given.drop / end:.2g} of the nominal pressure expected at the end of "
            f"the sweep, about {_pressure(given, end)} (limit {LARGEST_DROP}): the fluid would carry part of the load"
        )
        findings.append(Finding("pressure_drop", text, LARGEST_DROP, COUPLING))
    return findings


def after(given: Setting, results: Dataset) -> list[Finding]:
    """Return the limits exceeded by the computed states of a study.

    Parameters
    ----------
    given : Setting
        See `setting`.
    results : Dataset
        Collected cases, heights scaled to the Sq of the study.

    Returns
    -------
    list of Finding
        Excesses with their states.
    """
    if "mean_pressure" not in results:
        return []  # no contact
    starred = results["mean_pressure"]
    nominal = starred * results["Sq"].where(results["Sq"] > 0.0, 1.0) / results["L"].item()
    # d/σ + Δ/σ: height of the first touch above the mean plane
    findings = peak(given, float((results["separation"] + results["indentation"]).max()))
    findings += _slope(results["Sdq"].values.ravel()) if given.scaled else []
    if given.scaled:
        findings += _nominal(nominal, starred)
    if "load_above_hardness_fraction" in results:
        findings += _hardness(given, results, starred, nominal)
    else:
        contact = (nominal / results["contact_area_fraction"]).where(starred > 0.0)
        findings += _metal(given, _at_highest(contact, starred) if given.scaled else math.nan, "")
    leaks = [results[name] for name in ("leak_rate", "gas_leak_rate") if name in results]
    if given.yields and given.scaled:
        findings += _persistence(given, starred, nominal)
    if leaks:
        leaking = starred.where(sum(leak.notnull().any("axis") for leak in leaks) > 0)
        findings += [*_fluid(given, leaking, nominal), *_drop(given, leaking, nominal)]
    if given.patch and "central_pressure_ratio" in results:
        findings += _rim(results["central_pressure_ratio"].values.ravel())
    return findings


def sentences(findings: Iterable[Finding], notes: Iterable[str] = ()) -> list[str]:
    """Return notes and findings as sentences, without duplicates."""
    return list(dict.fromkeys([*notes, *(finding.sentence for finding in findings)]))


def peak(given: Setting, height: float) -> list[Finding]:
    """Return the excess of the highest point of a measured surface.

    Parameters
    ----------
    given : Setting
        See `setting`.
    height : float
        Highest point above the mean plane over Sq.

    Returns
    -------
    list of Finding
        Empty or one.
    """
    if not (given.measured and height > HIGH):
        return []
    remedy = "outliers were removed already" if given.cleaned else "see surface.outliers"
    text = (
        f"the highest point lies {height:.3g} Sq above the mean plane and touches first, alone; "
        f"if it is dust or an error of the instrument, {remedy}"
    )
    return [Finding("peak", text, HIGH, NORMAL_HEIGHTS)]


def _end(target: Level, scale: float, ratio: float) -> float:
    """Return the nominal pressure over E* at the end of a sweep, NaN without an estimate."""
    if target.kind == "pressure":
        return (target.value or 0.0) * ratio
    area = CLOSES_AT if target.kind.startswith("percolation") else 1.0
    if target.kind == "contact_area":
        area = target.value or 1.0
    return scale * NormalDist().inv_cdf(0.5 * (1.0 + area)) if area < 1.0 else math.nan


def _slope(slopes: np.ndarray) -> list[Finding]:
    slopes = slopes[np.isfinite(slopes)]
    steep = int(np.sum(slopes > STEEPEST))
    if not steep:
        return []
    where = f" on {steep} of {slopes.size} surfaces" if slopes.size > 1 else ""
    text = f"rms slope Sdq is up to {slopes.max():.2g}{where} (limit {STEEPEST}): small-slope elasticity is inaccurate"
    return [Finding("slope", text, STEEPEST, SMALL_SLOPES, Extent(steep, slopes.size))]


def _nominal(nominal: DataArray, starred: DataArray) -> list[Finding]:
    beyond = nominal > HIGHEST
    if not bool(beyond.any()):
        return []
    extent = _extent(beyond, starred)
    text = (
        f"nominal pressure is up to {float(nominal.max()):.2g} E* (limit {HIGHEST}), beyond it at {extent} "
        f"from p* = {extent.first:.3g} on: strains are not small"
    )
    return [Finding("nominal_pressure", text, HIGHEST, SMALL_STRAINS, extent)]


def _hardness(given: Setting, results: Dataset, starred: DataArray, nominal: DataArray) -> list[Finding]:
    contact, load = results["contact_above_hardness_fraction"], results["load_above_hardness_fraction"]
    beyond = load > ABOVE_HARDNESS
    if not bool(beyond.any()):
        return []
    extent = _extent(beyond, starred)
    at = _pressure(given, float(nominal.where(beyond).min())) if given.scaled and given.unit else ""
    text = (
        f"contact pressure exceeds the hardness {given.hardness_text} at {extent}, "
        f"from {at or 'p* = ' + format(extent.first, '.3g')} on: {_percent(_at_highest(contact, starred))} of the "
        f"contact and {_percent(_at_highest(load, starred))} of the load at the highest load; yield is not computed"
    )
    return [Finding("hardness", text, ABOVE_HARDNESS, HARDNESS, extent)]


def _metal(given: Setting, contact: float, extent: str) -> list[Finding]:
    """Return the lack of a hardness, unless the contact pressure over E* (NaN: unknown) is below any yield."""
    if given.unit is None or given.hardness is not None or contact < SOFTEST:
        return []
    if convert(given.modulus, given.unit, "GPa") < METAL:
        return []
    modulus = f"{convert(given.modulus, given.unit, 'GPa'):.3g} GPa"
    reached = "" if math.isnan(contact) else f" (mean in contact: {extent}{_pressure(given, contact, 'GPa')})"
    text = f"contact modulus {modulus} is metal-like and no hardness is given: no yield limits the pressure{reached}"
    return [Finding("metal", text, SOFTEST, HARDNESS)]


def _drop_unknown(given: Setting) -> Finding:
    text = f"pressure_drop {given.drop_text} cannot be compared with the contact pressure: the modulus has no unit"
    return Finding("pressure_drop", text, LARGEST_DROP, COUPLING)


def _drop(given: Setting, starred: DataArray, nominal: DataArray) -> list[Finding]:
    """Return the states with a large pressure drop; ``starred`` is NaN without a leak rate."""
    if math.isnan(given.drop):
        return [_drop_unknown(given)]
    beyond = (given.drop > LARGEST_DROP * nominal) & starred.notnull()
    if not bool(beyond.any()):
        return []
    extent = _extent(beyond, starred)
    highest = float(nominal.where(beyond).max())
    text = (
        f"pressure_drop {given.drop_text} is more than {LARGEST_DROP} of the nominal pressure at {extent}, "
        f"up to {_pressure(given, highest)}: the fluid would carry part of the load there, and widen the gap; "
        + (
            "the leak at the states of record.fluid_pressure has it, the dry leak along the steps has not"
            if given.lifted
            else "record.fluid_pressure computes it"
        )
    )
    return [Finding("pressure_drop", text, LARGEST_DROP, COUPLING, extent)]


def _fluid(given: Setting, starred: DataArray, nominal: DataArray) -> list[Finding]:
    """Return the states whose load the fluid carries alone; ``starred`` is NaN without a leak rate."""
    beyond = (nominal <= given.fluid) & (starred > UNLOADED)
    if not bool(beyond.any()):
        return []
    extent = _extent(beyond, starred)
    text = (
        f"the mean pressure of the fluid is {_pressure(given, given.fluid)} over the ambient ({given.fluid_text}), "
        f"at least the nominal pressure at {extent}: {_OPENS}"
    )
    return [Finding("fluid", text, 1.0, COUPLING, extent)]


def _persistence(given: Setting, starred: DataArray, nominal: DataArray) -> list[Finding]:
    """Return the states of metal beyond the reach of perfect plasticity."""
    assert given.hardness is not None
    share = nominal * (given.modulus / given.hardness)
    beyond = share > PERSISTENT
    if not bool(beyond.any()):
        return []
    extent = _extent(beyond, starred)
    text = (
        f"nominal pressure is up to {float(share.max()):.2g} of the hardness (limit {PERSISTENT}), beyond it at "
        f"{extent}: {_PERSIST}"
    )
    return [Finding("persistence", text, PERSISTENT, PERSISTENCE, extent)]


_OPENS = "the fluid carries the whole load there and opens the joint; the dry leak does not hold"
_PERSIST = "asperities persist, and perfect plasticity has too much contact and too small a leak"


def _rim(ratios: np.ndarray) -> list[Finding]:
    ratios = ratios[np.isfinite(ratios)]
    middle = float(np.median(ratios)) if ratios.size else math.nan
    if not middle < RIM:
        return []
    low = int(np.sum(ratios < RIM))
    what = f", median of {ratios.size} cases" if ratios.size > 1 else ""
    text = (
        f"the rim carries more than the middle: the central half of each side has {middle:.2f} of the mean pressure at "
        f"the last state{what} (limit {RIM}); record: {{region: interior}} leaves the rim out"
    )
    return [Finding("rim", text, RIM, FREE_PATCH, Extent(low, ratios.size))]


def _at_highest(values: DataArray, starred: DataArray) -> float:
    """Return the value at the state of highest load."""
    load = starred.fillna(-1.0).values
    return float(values.transpose(*starred.dims).values.ravel()[int(np.argmax(load))])


def _extent(beyond: DataArray, starred: DataArray) -> Extent:
    """Return the cases and states beyond a limit, among those with p*."""
    compared = starred.notnull()
    cases, of_cases, states, of_states = (
        int(mask.sum()) for mask in (beyond.any("step"), compared.any("step"), beyond, compared)
    )
    return Extent(cases, of_cases, states, of_states, float(starred.where(beyond).min()))


def _pressure(given: Setting, over_modulus: float, unit: str | None = None) -> str:
    """Return a pressure over E* in a unit, by default the one shown; unchanged for a modulus without a unit."""
    if given.unit is None:
        return f"{over_modulus:.3g} E*"
    unit = unit or given.shown
    return f"{convert(over_modulus * given.modulus, given.unit, unit):.3g} {unit}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
