"""Limits of the model: a linear elastic half space of small slopes, without yield or fluid pressure.

Conventions: pressures are over E*, p/E* = p* Sq/L. s = Sdq/2 is the root mean square contact pressure over E* of a
surface pressed flat (Persson 2001). The limits are rows of `validity.toml`; validity.md argues them and has remedies.

Slopes and p/E* depend on the ratio of heights to L. A file, ``Sq``, or L with a unit gives it. Otherwise slope and p/E*
are not judged. A hardness is always judged. The rim of a free patch is judged in studies with a flow or units and
without a region: their patch is a sample of a larger joint.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roughvol.campaign.case_surface import surface_of
from roughvol.observables import levels
from roughvol.study import Level, MadeSurface, SpectralSurface, Study, convert
from roughvol.study.axes import with_endings
from roughvol.study.values.state_kinds import REACHED
from roughvol.study.values.units import in_unit, unit_of
from roughvol.surfaces import texture
from roughvol.surfaces.surface import Surface, intervals
from roughvol.tables import table
from roughvol.typing import Array, Mask

if TYPE_CHECKING:
    from xarray import Dataset, Variable

    from roughvol.study.sections.fluid import Fluid

LOOKED_AT = 10  # largest m of a surface made for its slope alone
ATMOSPHERE = 101325.0  # Pa: the ambient of a gas, whose pressures are absolute; other pressures are over the ambient
STIFF = 20.0  # GPa, E*: above polymers and rubber, below all structural metals
UNLOADED = 1e-12  # p*: an unloaded surface to rounding
FLOWS = ("leak_rate", "gas_leak_rate", "gas_transmissivity")  # stored flows of a pressure drop
CLOSES_AT = 0.42  # A* at the closing of the last way (Persson & Yang 2008; Wang & Müser 2021)


@dataclass(frozen=True)
class Limit:
    """A limit of the model, with the fields that `validity.toml` explains."""

    key: str
    value: float
    source: str
    found: str
    expected: str = ""
    kept: str = ""
    from_value: bool = False  # the value itself is beyond the limit

    def exceeded(self, number: Array) -> Mask:
        """Return where numbers lie beyond the limit, by more than the error of a state that is searched for."""
        if self.from_value:
            return number >= self.value * (1.0 - REACHED)
        return number > self.value * (1.0 + REACHED)


_TABLE = table(__file__)
LIMITS = {key: Limit(key, **row) for key, row in _TABLE.items()}


class Finding(NamedTuple):
    """A limit of the model that a study exceeds."""

    key: str  # of its row in `LIMITS`
    sentence: str  # quantity, amount and states beyond the limit


@dataclass(frozen=True)
class Setting:
    """Settings of a study for comparison with the limits."""

    modulus: float  # E* in `unit`
    unit: str | None = None  # of moduli and pressures; None: arbitrary
    shown: str = "MPa"  # unit of pressures in sentences
    hardness: float | None = None  # in `unit`
    hardness_text: str = ""
    yields: bool = False  # pressures end at the hardness
    drop_text: str = ""  # pressure drop of a leak rate
    of_gas: bool = False  # the pressure drop is that of a gas
    drop: float = math.nan  # over E*; NaN for a modulus without a unit
    fluid: float = math.nan  # largest mean pressure of a fluid over the ambient, over E*; NaN without one
    fluid_text: str = ""  # its inlet and outlet
    free_path: float = math.nan  # of a gas by the law kinetic at the mean of its pressures, in m
    lifted: bool = False  # the fluid of the pressure drop lifts the gap at recorded states
    thickness: float = math.inf  # of a layer, in the unit of L
    scaled: bool = False  # the ratio of heights to L is that of a real surface
    patch: bool = False  # a free patch that is a sample of a larger joint
    measured: bool = False  # heights come from files
    cleaned: bool = False  # outliers were removed


def setting(study: Study) -> Setting:
    """Return the settings of a study for comparison with the limits."""
    surface, material, record = study.surface, study.material, study.record
    wanted, unit = record.dimensional, material.unit
    (drop, drop_text, of_gas), (mean, sides) = _fluids(study)
    scaled = not isinstance(surface, MadeSurface) or bool(surface.Sq or surface.length_unit)
    scaled = scaled or (isinstance(surface, SpectralSurface) and surface.slope is not None)
    asks = record.transport is not None or wanted is not None or unit is not None
    whole = record.part is None and record.region_widths is None
    return Setting(
        modulus=material.contact_modulus,
        unit=unit,
        shown=(wanted.pressure if wanted is not None else None) or "MPa",
        hardness=material.indentation_hardness,
        hardness_text=_written(material.hardness, unit),
        yields=material.yields,
        drop_text=drop_text,
        of_gas=of_gas,
        drop=math.nan if unit is None else convert(drop, "Pa", unit) / material.contact_modulus,
        fluid=math.nan if unit is None else convert(mean, "Pa", unit) / material.contact_modulus,
        fluid_text=sides,
        free_path=_free_path(study.fluid),
        lifted=record.fluid_pressure is not None and not of_gas,
        thickness=dict(study.kernel(surface.length_unit).lengths).get("thickness", math.inf) if scaled else math.inf,
        scaled=scaled,
        patch=asks and whole and surface.sides == "free",  # others have no rim
        measured=not isinstance(surface, MadeSurface),
        cleaned=not isinstance(surface, MadeSurface) and surface.outliers is not None,
    )


def _fluids(study: Study) -> tuple[tuple[float, str, bool], tuple[float, str]]:
    """Return the largest pressure drop of the fluids, and their largest mean pressure over the ambient, in Pa.

    Both have their words, and the drop whether it is that of a gas. Without a fluid they are NaN.
    """
    wanted, lift = study.record.dimensional, study.record.fluid_pressure
    drops, means = list[tuple[float, str, bool]](), list[tuple[float, str]]()
    if wanted is not None and (leak := wanted.leak_rate) is not None:
        drop = in_unit(leak.pressure_drop, "Pa")
        drops.append((drop, str(leak.pressure_drop), False))
        means.append((0.5 * drop, f"inlet {leak.pressure_drop} over the outlet at the ambient"))
    if (fluid := study.fluid) is not None:
        inlet, outlet = fluid.pressures
        drops.append((inlet - outlet, f"{fluid.inlet} - {fluid.outlet}", True))
        means.append((0.5 * (inlet + outlet) - ATMOSPHERE, f"inlet {fluid.inlet}, outlet {fluid.outlet}, absolute"))
    if lift is not None and unit_of(lift.inlet) is not None:
        mean = 0.5 * (in_unit(lift.inlet, "Pa") + in_unit(lift.outlet, "Pa"))
        means.append((mean, f"inlet {lift.inlet}, outlet {lift.outlet}"))
    # of equal drops that of the liquid
    largest = max(drops, key=lambda drop: (drop[0], not drop[2]), default=(math.nan, "", False))
    return largest, max(means, default=(math.nan, ""))


def _free_path(fluid: Fluid | None) -> float:
    """Return the mean free path of a gas at the mean of its pressures [m]; NaN without one, and by another law."""
    return (
        fluid.mean_free_path(0.5 * sum(fluid.pressures)) if fluid is not None and fluid.law == "kinetic" else math.nan
    )


def _longer_side(L: float, nodes: tuple[int, int], unit: str | None, *, periodic: bool) -> float:
    """Return the longer side of a surface in m; NaN without a unit."""
    along_x, along_y = (intervals(number, periodic) for number in nodes)
    return math.nan if unit is None else convert(L * max(1.0, along_y / along_x), unit, "m")


def _written(hardness: float | None, unit: str | None) -> str:
    """Return a hardness with its own unit, or with that of the modulus."""
    if hardness is None or unit_of(hardness) is not None:
        return str(hardness)
    return f"{hardness:g} {unit or ''}".strip()


@dataclass(frozen=True)
class _States:
    """Numbers of a study that are compared with the limits; arrays of states have a row for each case."""

    expected: bool
    nominal: Array  # pressure p/E*
    starred: Array  # pressure p*
    deepest: Array  # displacement of the deepest point, in the unit of L
    flow: Mask  # states with a leak rate
    length: float  # longer side of a surface, the least of several, in m; NaN without a unit
    peak: float  # highest point above the mean plane over Sq
    filled: float  # largest share of a map that was filled
    slopes: Array  # of the surfaces
    in_contact: float  # mean pressure of the contact over E* at the highest load
    above: tuple[Array, Array] | None  # shares of the contact and of the load above the hardness
    central: Array  # pressure in the centre over that of the patch, of each case

    def highest(self, values: Array) -> float:
        """Return the value at the state of highest load."""
        return float(values.flat[int(np.argmax(np.nan_to_num(self.starred, nan=-1.0)))])


def before(
    given: Setting,
    targets: Sequence[Level],
    *,
    Sq: float,
    Sdq: float,
    L: float,
    length: float = math.nan,
    peak: float = math.nan,
    filled: float = 0.0,
) -> list[Finding]:
    """Return the limits that a study will probably exceed at its highest load, with pressures by Persson's theory.

    Persson (2001): A* = erf(√2 p/(E* Sdq)). At light load the contact pressure over E* has the density

        (p/s²) exp(-p²/(2 s²)) with s = Sdq/2, and the mean √(π/2) s = 0.63 Sdq.

    ``targets`` are the ends of the legs, and listed states. Sq, Sdq and L are those of the roughest surface, unused if
    ``given.scaled`` is False. ``length`` is its longer side in m, ``peak`` its highest point above the mean plane over
    Sq, and ``filled`` the share of its heights that were missing.
    """
    scale = 0.5 * Sdq if given.scaled else math.nan
    ends = [_end(target, scale, Sq / L) for target in targets if given.scaled]
    end = max((load for load in ends if not math.isnan(load)), default=math.nan)
    shares = None
    if given.hardness is not None and not given.yields and scale > 0.0:
        x = given.hardness / given.modulus / scale
        contact = math.exp(-0.5 * x * x)
        load = contact * x * math.sqrt(2.0 / math.pi) + math.erfc(x / math.sqrt(2.0))
        shares = np.array([[contact]]), np.array([[load]])
    expected = _States(
        expected=True,
        nominal=np.array([[end]]),
        starred=np.ones((1, 1)),
        deepest=np.array([[max([Sq * _depth(target, peak) for target in targets], default=math.nan)]]),
        flow=np.array([[end > 0.0]]),
        length=length,
        peak=peak,
        filled=filled,
        slopes=np.array([Sdq]),
        in_contact=math.sqrt(0.5 * math.pi) * scale,
        above=shares,
        central=np.empty(0),
    )
    return _findings(given, expected)


def after(given: Setting, results: Dataset) -> list[Finding]:
    """Return the limits exceeded by the computed states of a study, heights scaled to its Sq."""
    if "mean_pressure" not in results:
        return []  # no contact

    numbers = results.variables  # quicker than arrays with their coordinates

    def states(variable: Variable) -> Array:
        values = variable.transpose(..., "step").values
        return np.reshape(values, (-1, values.shape[-1]))

    L, unit, periodic = float(numbers["L"]), results.attrs.get("length_unit"), "periodic" in results.attrs
    starred, Sq = states(numbers["mean_pressure"]), numbers["Sq"].values.reshape(-1, 1)
    nominal = starred * np.where(Sq > 0.0, Sq, 1.0) / L
    above = ("contact_above_hardness_fraction", "load_above_hardness_fraction")
    leaks = [numbers[name].notnull().any("axis") for name in FLOWS if name in results]
    stored = (numbers[name].values.ravel() if name in results else [2.0] for name in ("nodes_x", "nodes_y"))
    nodes = np.transpose(list(stored))
    shapes = nodes[np.isfinite(nodes).all(axis=1)].astype(int).tolist()
    central = numbers["central_pressure_ratio"].values.ravel() if "central_pressure_ratio" in results else np.empty(0)
    with np.errstate(divide="ignore", invalid="ignore"):
        in_contact = np.where(starred > 0.0, nominal / states(numbers["contact_area_fraction"]), np.nan)
    found = _States(
        expected=False,
        nominal=nominal,
        starred=starred,
        deepest=states(numbers["indentation"]) * Sq,
        flow=np.any([states(leak) for leak in leaks], axis=0) if leaks else np.zeros(starred.shape, dtype=bool),
        length=min((_longer_side(L, (x, y), unit, periodic=periodic) for x, y in shapes), default=math.nan),
        # d/σ + Δ/σ: height of the first touch above the mean plane
        peak=float((numbers["separation"] + numbers["indentation"]).max()),
        filled=float(numbers["filled_fraction"].max()) if "filled_fraction" in results else 0.0,
        slopes=numbers["Sdq"].values.ravel() if given.scaled else np.empty(0),
        in_contact=math.nan,
        above=(states(numbers[above[0]]), states(numbers[above[1]])) if above[1] in results else None,
        central=central,
    )
    return _findings(given, replace(found, in_contact=found.highest(in_contact)))


def foreseen(study: Study, surface: Surface | None = None) -> list[Finding]:
    """Return the limits of the model that a study will exceed, as far as known before a run.

    Parameters
    ----------
    study : Study
        The study.
    surface : Surface, optional
        The surface from its height file, as `check_surfaces` returns it. Default: read here.

    Returns
    -------
    list of Finding
        Of generated surfaces, the roughest of the first seed is judged, at m ≤ `LOOKED_AT`: its slope grows with m.
    """
    if study.axes:
        every = [(variant.words, foreseen(variant.study)) for variant in study.variants]
        return [Finding(one.key, f"{one.sentence}{ending}") for one, ending in with_endings(every)]
    case, *others = study.cases()
    made, given = study.surface, setting(study)
    if case.sweep.steps == 0:
        return []
    shapes = {case.shape, *(other.shape for other in others)}
    length = min(_longer_side(case.L, shape, case.length_unit, periodic=case.periodic) for shape in shapes)
    if not given.scaled:
        return before(given, [], Sq=math.nan, Sdq=math.nan, L=case.L, length=length)
    size = 1.0
    if isinstance(made, MadeSurface):
        m = min(max(made.m, default=case.m or 0), LOOKED_AT)
        surface = surface_of(replace(case, D=max(made.dimensions), m=m))
        size = (made.height or surface.Sq) / surface.Sq
    surface = surface or surface_of(case)
    targets = [levels.starred(level, case, surface) for leg in case.sweep.legs for level in leg.goals]
    Sdq = size * texture.Sdq(surface.with_neighbours, surface.spacing)
    found = {"Sq": size * surface.Sq, "Sdq": Sdq, "L": surface.side, "peak": surface.peak}
    found["filled"] = surface.filled / surface.heights.size
    return before(given, targets, **found, length=length)


def kept(given: Setting, results: Dataset) -> list[Limit]:
    """Return the limits with words that are judged in a study and not exceeded by its states."""
    judged = {
        "slope": given.scaled,
        "nominal_pressure": given.scaled,
        "thickness": math.isfinite(given.thickness),
        "hardness": given.hardness is not None and not given.yields,
        "pressure_drop": math.isfinite(given.drop) and not given.lifted and any(name in results for name in FLOWS),
        "free_path": math.isfinite(given.free_path) and any(name in results for name in FLOWS),
        "rim": given.patch,
        "peak": given.measured,
        "filled": "filled_fraction" in results,
    }
    beyond = {finding.key for finding in after(given, results)}
    return [LIMITS[key] for key, is_judged in judged.items() if is_judged and key not in beyond]


def sentences(findings: Iterable[Finding], notes: Iterable[str] = ()) -> list[str]:
    """Return notes and findings as sentences, without duplicates."""
    return list(dict.fromkeys([*notes, *(finding.sentence for finding in findings)]))


def _end(target: Level, scale: float, ratio: float) -> float:
    """Return the nominal pressure over E* at the end of a sweep, NaN without an estimate."""
    if target.kind == "pressure":
        return (target.value or 0.0) * ratio
    area = CLOSES_AT if target.kind.startswith("percolation") else 1.0
    if target.kind == "contact_area":
        area = target.value or 1.0
    return scale * NormalDist().inv_cdf(0.5 * (1.0 + area)) if area < 1.0 else math.nan


def _depth(target: Level, peak: float) -> float:
    """Return Δ/σ at the end of a leg, 0 of an end that names neither indentation nor plane."""
    if target.kind == "indentation":
        return target.value or 0.0
    return peak - (target.value or 0.0) if target.kind in ("separation", "mean-plane") else 0.0


def _findings(given: Setting, states: _States) -> list[Finding]:
    """Return the limits exceeded by numbers."""
    return [*_of_surfaces(given, states), *_of_states(given, states)]


def _of_surfaces(given: Setting, states: _States) -> Iterator[Finding]:
    """Yield the findings with one number for a study or for each surface."""
    if given.measured and LIMITS["peak"].exceeded(np.array(states.peak)):
        remedy = "outliers were removed already" if given.cleaned else "see surface.outliers"
        yield _finding("peak", {"highest": f"{states.peak:.3g}", "remedy": remedy})
    if LIMITS["filled"].exceeded(np.array(states.filled)):
        yield _finding("filled", {"share": f"{states.filled:.1%}"})
    slopes = states.slopes[np.isfinite(states.slopes)]
    if given.scaled and (steep := int(np.sum(LIMITS["slope"].exceeded(slopes)))):
        surfaces = f" on {steep} of {slopes.size} surfaces" if slopes.size > 1 else ""
        yield _finding("slope", {"highest": f"{slopes.max():.2g}", "surfaces": surfaces})
    contact = states.in_contact if given.scaled else math.nan
    pressed = math.isnan(contact) or LIMITS["metal"].exceeded(np.array(contact))
    if given.unit is not None and given.hardness is None and pressed:
        modulus = convert(given.modulus, given.unit, "GPa")
        if modulus >= STIFF:
            mean = f" (mean in contact: {'about ' * states.expected}{_pressure(given, contact, 'GPa')})"
            yield _finding("metal", {"modulus": f"{modulus:.3g}", "reached": "" if math.isnan(contact) else mean})
    if given.drop_text and math.isnan(given.drop) and (states.expected or states.flow.any()):
        text = "cannot be compared with the contact pressure: the modulus has no unit"
        yield Finding("pressure_drop", f"pressure_drop {given.drop_text} {text}")
    if LIMITS["free_path"].exceeded(np.array(given.free_path / states.length)):
        yield _finding("free_path", {"path": f"{1e6 * given.free_path:.3g}", "length": f"{1e6 * states.length:.3g}"})
    ratios = states.central[np.isfinite(states.central)]
    if given.patch and ratios.size and (median := np.median(ratios)) < LIMITS["rim"].value:
        cases = f", median of {ratios.size} cases" if ratios.size > 1 else ""
        yield _finding("rim", {"median": f"{median:.2f}", "cases": cases})


def _of_states(given: Setting, states: _States) -> Iterator[Finding]:
    """Yield the findings with a number for each state, NaN where it is not judged."""
    nominal, compared = states.nominal, np.isfinite(states.starred)
    flow, unknown = states.flow & compared, np.full_like(states.nominal, math.nan)
    loaded = np.where(states.starred > UNLOADED, nominal, math.nan)  # a fluid opens and widens no unloaded joint
    contact, load = states.above or (unknown, unknown)
    yielding = given.modulus / given.hardness if given.yields and given.hardness is not None else math.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        numbers = {
            "nominal_pressure": (nominal if given.scaled else unknown, compared),
            "thickness": (states.deepest / given.thickness, compared),
            "hardness": (load, compared),
            "persistence": (nominal * yielding if given.scaled else unknown, compared),
            "fluid": (given.fluid / loaded, flow),
            "pressure_drop": (given.drop / loaded, flow),
        }
    words = {name: f"{100.0 * states.highest(each):.3g} %" for name, each in (("contact", contact), ("load", load))}
    words |= {"hardness": given.hardness_text, "fluid": _pressure(given, given.fluid), "sides": given.fluid_text}
    words |= {"drop": given.drop_text, "remedy": _remedy(given)}
    for key, (number, among) in numbers.items():
        beyond = LIMITS[key].exceeded(number) & among
        if not beyond.any():
            continue
        least, p = nominal[beyond].min(), states.starred[beyond].min()
        words |= {
            "highest": f"{np.nanmax(number[beyond]):.2g}",
            "least": _pressure(given, least) if given.scaled and given.unit else f"p* = {p:.3g}",
            "largest": _pressure(given, nominal[beyond].max()),
            "extent": f"{beyond.sum()} of {among.sum()} states",
        }
        if (of_cases := among.any(-1).sum()) != 1:
            words["extent"] += f" ({beyond.any(-1).sum()} of {of_cases} cases)"
        yield _finding(key, words, expected=states.expected)


def _remedy(given: Setting) -> str:
    """Return what has the leak of a gap that its fluid widens."""
    if given.lifted:
        return "the leak at the states of record.fluid_pressure has it, the dry leak along the steps has not"
    only = " and ".join(["liquids"] * given.of_gas + ["elastic contact"] * given.yields)
    return f"record.fluid_pressure computes it{f' for {only} alone' if only else ''}"


def _finding(key: str, words: Mapping[str, str], *, expected: bool = False) -> Finding:
    """Return a finding with the sentence of its limit."""
    limit = LIMITS[key]
    text = limit.expected if expected else limit.found
    return Finding(key, text.format(limit=limit.value, **words))


def _pressure(given: Setting, over_modulus: float, unit: str | None = None) -> str:
    """Return a pressure over E* in a unit, by default the one shown; unchanged for a modulus without a unit."""
    if given.unit is None:
        return f"{over_modulus:.3g} E*"
    unit = unit or given.shown
    return f"{convert(over_modulus * given.modulus, given.unit, unit):.3g} {unit}"
