"""The leak at one load along x and y, and where the last way closes, each with its error, from the runs of a card.

=========  ==================================================================================================
solver     the flow falls where a gap falls, and every gap is right to η: certified, under fluid pressure estimated
grid       on a finer grid loads rise with the slope: closing load and leak move along with it
window     several surfaces: t interval of the logarithms; one map: that of its quadrants
levelling  change with another levelling of a file
=========  ==================================================================================================

A part of the closing load is a factor of loads. The leak at p of a joint that closes at f times the load is about the
leak at p/f: so a part of the leak follows where the leak itself cannot be compared, as of a way that closes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator
from xarray import Dataset

from roughvol.analysis import seal
from roughvol.analysis.at import at, legs_of, scales
from roughvol.analysis.average import Average, average
from roughvol.analysis.closing import load_of, spans
from roughvol.analysis.derived import derived, groups
from roughvol.analysis.leak import STATE, is_lifted
from roughvol.analysis.leak_card import Beside, Card, Closing, Part, SealLeak, SurfaceAtLoad, Way, together
from roughvol.analysis.legs import first_leg
from roughvol.analysis.seal import Patch
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import number
from roughvol.ensemble.multilevel import COVERAGE, half_width
from roughvol.errors import DatasetError
from roughvol.gap.transport import conduction
from roughvol.observables.coupling import ACCURACY, RTOL
from roughvol.observables.levels import CLOSING
from roughvol.observables.variables import AXES
from roughvol.observables.void import quarters
from roughvol.store.card_runs import CardRuns, Pressed
from roughvol.study import HeightFile, Level, Quantity
from roughvol.typing import Array

EXACT = 1e-8  # accuracy of the flows whose ratios are the part of the solver
# standard error of the median of many normal numbers over that of their mean; of few numbers it is less
OF_MEDIAN = math.sqrt(0.5 * math.pi)
FLOW, ERROR, SWEEP = "leak_rate", "transmissivity_error", "the sweep"
STEEPEST = 10.0  # largest power of the indentation with which p* rises
# From the spacing of a map down to a quarter: python -m tests.bench.card_coverage
OCTAVES = 2.0  # a leak changes at most as much in each as from twice the spacing; its loads rise as the slope
PIXEL = 1.0  # octave of the closing load that means over pixels take off the map
SCATTER = 0.25  # logarithm of the closing load: on a finer grid another channel closes last
OPEN = 0.5  # share of it for leaks, which pass through several channels
ROUGH = 0.2  # change of the closing load from twice the spacing, from which on the scatter is whole
STEEP = 0.25  # growth of the slope in an octave, a fractal dimension of 2.36
QUADRANTS = 1.2  # quadrants of a map share its long waves: python -m tests.bench.window_coverage
FAR, LEAST_SLOPE = 20.0, 1e-6  # logarithm of loads before the first state; of a leak over that of the load
NEARER = 2.0 ** -np.arange(1.0, 31.0)  # distances to the closing load over that of the last state
NO_COARSER = "no coarser grid has enough nodes for the surface"


@dataclass(frozen=True, eq=False)
class _Loaded:
    """One surface of a run at the load of a card; ``of_leak``, ``of_load`` make it comparable with the finest grid."""

    name: str
    run: Run
    level: Level
    table: Dataset  # states along step, fields, of one surface along seed
    state: Dataset | None  # None if the sweep does not reach the load and is open at its end
    recorded: str
    leads: bool = True  # the state lies on the first leg
    of_leak: float = 1.0
    of_load: float = 1.0

    def number(self, name: str, axis: str = "") -> float:
        """Return a number of the state, along an axis where it has a direction; NaN without one."""
        if self.state is None or name not in self.state:
            return math.nan
        value = self.state[name].isel(seed=0)
        return float(value.sel(axis=axis) if axis else value)

    def leak(self, axis: str, name: str = FLOW) -> float:
        """Return a flow of the state: in the unit of the study, else T* V*³."""
        if self.state is None:
            return math.nan
        if name in self.state:
            return self.number(name, axis) * self.of_leak
        if name == FLOW and "flow" in self.state:
            return self.number("flow", axis) * self.of_leak
        starred = name.replace(FLOW, "transmissivity")
        volume = self.number("free_volume")
        return self.number(starred, axis) * (volume**3 if math.isfinite(volume) else 1.0) * self.of_leak

    def unit(self, name: str = FLOW) -> str:
        """Return the unit of a flow, empty for T* V*³."""
        return str(self.table[name].attrs["units"]) if name in self.table else ""

    @property
    def fields(self) -> Dataset:
        """The run without dimensions of cases."""
        return self.table.isel(seed=0)

    def closing(self, axis: str) -> Closing:
        """Return where the last way along an axis closes on loading."""
        loading = first_leg(self.table)
        unit = str(loading[load_of(loading)].attrs.get("units", "1"))
        found = spans(loading, axis)
        scaled = (
            replace(s, open_up_to=s.open_up_to * self.of_load, closed_from=s.closed_from * self.of_load) for s in found
        )
        return Closing(tuple(scaled), "" if unit == "1" else unit)

    def curve(self, axis: str) -> PchipInterpolator | None:
        """Return the logarithm of the leak, under fluid pressure of the dry gap, on the first leg, see `curve_of`."""
        table = first_leg(self.table).isel(seed=0)
        dry = "_dry" if is_lifted(self.table) else ""
        if f"transmissivity{dry}" not in table:
            return None
        starred = table[f"transmissivity{dry}"].sel(axis=axis).values * table["free_volume"].values ** 3
        leaks = table[f"{FLOW}{dry}"].sel(axis=axis).values if f"{FLOW}{dry}" in table else starred
        loads = table[load_of(table)].values * self.of_load
        points = dict(zip(loads.tolist(), (leaks * self.of_leak).tolist(), strict=True))
        if self.leads and not dry and self.state is not None:
            load = self.number(load_of(table)) * self.of_load
            points = {p: leak for p, leak in points.items() if not math.isclose(p, load)} | {load: self.leak(axis)}
        return curve_of(points, self.closing(axis).value)

    def leak_at(self, axis: str, load: float) -> float:
        """Return the leak at another load; NaN if unknown."""
        curve = self.curve(axis)
        if load >= self.closing(axis).value:
            return 0.0
        return math.exp(curve(math.log(load))) if curve is not None and load > 0.0 else math.nan

    def load_at(self, axis: str, leak: float) -> float:
        """Return the load with another leak, the closing load of none; NaN if unknown."""
        curve = self.curve(axis)
        if curve is None or not leak > 0.0:
            return self.closing(axis).value
        found = curve.solve(math.log(leak), extrapolate=False)
        return math.exp(found[-1]) if len(found) else self.closing(axis).value

    def leak_if(self, axis: str, log: float) -> float:
        """Return the leak of a joint with all loads larger by a factor; NaN where it is not known."""
        if not self.leads or is_lifted(self.table) or math.isnan(self.leak(axis)):
            return math.nan
        return self.leak_at(axis, self.load * math.exp(-log))

    @property
    def load(self) -> float:
        """Load of the state, as those of the closings; of a surface that closed before the load if it is a pressure."""
        name, level = load_of(self.table), self.level
        if math.isnan(found := self.number(name)) and level.kind == "pressure" and level.value is not None:
            _, starred = next(iter(scales(self.run, self.table))).starred(level.kind, level.value)
            return starred * float((self.table[name] / self.table["mean_pressure"]).max())
        return found


def curve_of(points: Mapping[float, float], closes: float) -> PchipInterpolator | None:
    """Return the logarithm of a leak over that of the load, from leaks by load; None from fewer than two open states.

    Before the first state the leak goes with a power of the load. From the last state to the closing load p_c it goes
    with a power of 1 - p/p_c, of the slope between the last two states. Without a closing load it is NaN there.
    """
    known = sorted((p, leak) for p, leak in points.items() if p > 0.0 and leak > 0.0 and not p >= closes)
    if len(known) < 2:
        return None
    loads, leaks = np.array(known).T
    x, y = np.log(loads), np.log(leaks)
    slopes = np.minimum(np.diff(y) / np.diff(x), -LEAST_SLOPE)
    before = np.array([x[0] - FAR]), np.array([y[0] - FAR * slopes[0]])
    after = np.empty(0), np.empty(0)
    if math.isfinite(closes):
        left = 1.0 - loads[-1] / closes
        power = max(1.0, -slopes[-1] * left / (1.0 - left))
        after = np.log(closes * (1.0 - left * NEARER)), y[-1] + power * np.log(NEARER)
    sides = (np.concatenate([one, middle, other]) for one, middle, other in zip(before, (x, y), after, strict=True))
    return PchipInterpolator(*sides, extrapolate=False)


def _loaded(pressed: Pressed) -> Iterator[_Loaded]:
    """Yield the surfaces of a run at the load of a card."""
    run = Run.of(SWEEP, pressed.dataset)
    for label, group in groups(derived(run.dataset, run.study)):
        for k in range(group.sizes["seed"]):
            one = group.isel(seed=[k])
            name = f"{label}, seed {int(one['seed'][0])}" if "seed" in one.coords else label
            try:
                state = at(run, one, pressed.level)
            except DatasetError:
                yield _Loaded(name, run, pressed.level, one, None, pressed.level.label)
                continue
            study = run.study
            dry = study is not None and study.record.fluid_pressure is not None and not is_lifted(one)
            leads = len(legs_of(one)) == 1 or _leg(one, pressed.level) == 1
            yield _Loaded(name, run, pressed.level, one, None if dry else state.data, state.recorded, leads)


def _leg(table: Dataset, level: Level) -> int:
    """Return the leg of a level: the last one of ``last``, else the first one if none is named."""
    if level.kind == "step":
        return int(table["leg"].sel(step=int(level.value or 1)))
    return level.leg or (legs_of(table)[-1] if level.kind == "last" else 1)


def check_reached(fine: Pressed) -> None:
    """Refuse a run without a surface that is pressed to the load of a card; the message has the loads of the run."""
    if all(one.state is None for one in _loaded(fine)):
        run = Run.of(SWEEP, fine.dataset)
        for _, group in groups(derived(run.dataset, run.study)):
            at(run, group, fine.level)  # raises, except beyond a sweep that ended closed
        message = f"{SWEEP} ends before {fine.level.label}, and the fluid may open the way again: press farther"
        raise DatasetError(message)


def card_of(runs: Sequence[CardRuns], name: str, load: str) -> Card:
    """Return the card of one surface or of several, from the runs of each height file or of generated surfaces."""
    fine = [surface for one in runs for surface in _loaded(one.fine)]
    if all(one.state is None for one in fine):
        check_reached(runs[0].fine)
    coarser = [_compared(grids, fine) for grids in zip(*(one.coarser for one in runs), strict=False)]
    levels = [one.levelled for one in runs if one.levelled is not None]
    levelled = None
    if len(levels) == len(runs):
        _, before = _compared([one.before_levelling for one in runs], fine)
        levelled = _Levelled(levels[0].words, before, _compared(levels, fine)[1])
    ways = tuple(_way(fine, coarser, levelled, axis) for axis in AXES)
    warnings = (line.strip() for one in runs for line in str(one.fine.dataset.attrs.get("warnings", "")).splitlines())
    units = {str(one.table["nominal_pressure"].attrs["units"]) for one in fine if "nominal_pressure" in one.table}
    return Card(
        title=name,
        load=load,
        surfaces=tuple(_surface(one) for one in fine),
        pressure_unit=next(iter(units), ""),
        length_unit=str(fine[0].run.dataset.attrs.get("length_unit", "")),
        ways=ways,
        beside=tuple(_beside(fine)),
        lifted=is_lifted(fine[0].table),
        warnings=tuple(dict.fromkeys(filter(None, warnings))),
        seal=_seal(fine, ways),
    )


def _seal(fine: Sequence[_Loaded], ways: Sequence[Way]) -> SealLeak | None:
    """Return the leak of the seal of a study, and where it closes; None without the section ``seal``."""
    patch = Patch.of(fine[0].run.study, fine[0].table)
    if patch is None:
        return None
    seal.check_alike([size for one in fine for size in seal.sizes_of(one.table)])
    reached = [one for one in fine if all(math.isfinite(one.leak(axis)) for axis in AXES)]
    flow = next(way for way in ways if way.axis == patch.seal.flow)
    units = bool(flow.unit)
    isotropic = seal.is_isotropic([seal.ratios(one.table) for one in fine])
    maps = patch.conductances(np.array([[one.leak(axis) for axis in AXES] for one in reached]), in_units=units)
    quadrants = patch.conductances(_of_quadrants(fine[0]), in_units=units) if len(fine) == 1 else None
    shared = [part for part in flow.parts if part.name != "window"] if flow.leak.value > 0.0 else []
    heights = [surface for one in fine if (surface := seal.surface_of(one.fields)) is not None]
    representative = bool(heights) and seal.is_representative(heights)
    closing, of_load = seal.Estimate(math.nan, math.nan, math.nan), tuple[Part, ...]()
    loads = np.array([[[one.closing(axis).value for axis in patch.axes]] for one in fine])
    if not is_lifted(fine[0].table) and (loads > 0.0).all():
        closing = seal.closing_of(loads, patch.patches, isotropic=isotropic and len(fine) > 1)
        of_load = tuple(part for part in flow.closing.parts if part.name != "window" or len(fine) == 1)
        closing = seal.Estimate(*[closing.value] * 3) if len(fine) == 1 else closing
        smaller, larger = together(of_load)
        of_load += (seal.window_of(closing, f"{len(fine)} surfaces"),) if len(fine) > 1 else ()
        closing = closing.with_factor(larger if representative else math.nan, smaller)
    leak, parts, words = seal.leak_of(
        patch,
        maps,
        quadrants,
        isotropic=isotropic,
        representative=representative,
        shared=shared,
    )
    if (name := f"gas_{FLOW}") in fine[0].table:
        leaks = np.array([[one.leak(axis, name) for axis in AXES] for one in fine])
        throughput = f"{number(seal.median(patch, leaks, isotropic=isotropic))} {fine[0].unit(name)}"
        gas = fine[0].table[name].attrs.get("gas", "the gas")
        words += (f"leak of {gas}: {throughput}, the median of as many sheets; the interval is that of the liquid",)
    if leak.value == 0.0 and representative:  # at most the leak of patches that close later
        most = patch.conductances(np.array([[way.at_most for way in ways]]), in_units=units)[0, 0] * patch.squares
        leak, parts = seal.Estimate(0.0, 0.0 if math.isfinite(most) else math.nan, most), flow.parts
    return SealLeak(
        label=patch.seal.label,
        flow=patch.seal.flow,
        patches=patch.patches,
        leak=leak.value,
        interval=(leak.low, leak.high),
        unit=flow.unit,
        parts=parts,
        closing=closing.value,
        closing_interval=(closing.low, closing.high),
        load_unit=flow.closing.unit,
        words=words,
        closing_parts=of_load,
    )


def _of_quadrants(one: _Loaded) -> Array:
    """Return the leaks that the quadrants of a map would have as the map, shape (4, 2)."""
    leaks = []
    for axis in AXES:
        gap, _ = _gap(one, axis, lifted=is_lifted(one.table))
        flows = [_flow(part, axis) for part in quarters(gap)] if gap.size else [0.0] * 4
        leaks.append(np.array(flows) * _per_starred(one, axis) if any(flows) else np.zeros(4))
    return np.stack(leaks, axis=1)


def _surface(one: _Loaded) -> SurfaceAtLoad:
    return SurfaceAtLoad(
        name=one.name,
        Sq=float(one.table["Sq"][0]),
        Sdq=float(one.table["Sdq"][0]),
        mean_pressure=one.number("mean_pressure"),
        nominal_pressure=one.number("nominal_pressure"),
        contact_area=one.number("contact_area_fraction"),
        free_volume=one.number("free_volume"),
        leaks=tuple(one.leak(axis) for axis in AXES),
        closings=tuple(one.closing(axis) for axis in AXES),
        table=one.fields,
        recorded=one.recorded,
    )


def _beside(fine: Sequence[_Loaded]) -> Iterator[Beside]:
    """Yield the leaks of the dry gap and of a gas."""
    dry = "leak of the dry gap, without fluid pressure"
    for name, words in ((f"{FLOW}_dry", dry), (f"gas_{FLOW}", "leak of"), (f"gas_{FLOW}_dry", dry)):
        leaks = [[one.leak(axis, name) for one in fine] for axis in AXES]
        variable = fine[0].table.get(name)
        if np.isfinite(leaks).any():
            gas = f"{variable.attrs['gas']}" if variable is not None and "gas" in variable.attrs else ""
            text = f"{words} {gas}" if words == "leak of" else f"{words}, {gas}".removesuffix(", ")
            yield Beside(text, tuple(average(name, row) for row in leaks), fine[0].unit(name))


@dataclass(frozen=True, eq=False)
class _Levelled:
    """Surfaces with another levelling, in words, and before it, both on one grid."""

    words: str
    before: list[_Loaded]
    after: list[_Loaded]

    def of_load(self, axis: str) -> float:
        """Return the logarithm of what the levelling does to the closing load; NaN where it is not known."""
        here, there = (_closing(some, axis).value for some in (self.before, self.after))
        return math.log(there / here) if here > 0.0 and there > 0.0 else math.nan


def _compared(runs: Sequence[Pressed], fine: Sequence[_Loaded]) -> tuple[str, list[_Loaded]]:
    """Return the words of another grid or levelling, and its surfaces with what makes them comparable.

    At equal nominal pressure leaks are compared as they are, and as T* V*³ Sq³ without a unit. At equal p* starred
    numbers are compared, as those of generated surfaces with starred loads.
    """
    surfaces = [surface for one in runs for surface in _loaded(one)]
    study = surfaces[0].run.study
    physical = (study is not None and isinstance(study.surface, HeightFile)) or isinstance(
        runs[0].level.value, Quantity
    )
    found = []
    for other, own in zip(surfaces, fine, strict=True):
        ratio = float(other.table["Sq"][0]) / float(own.table["Sq"][0])
        powers = (3, 1) if physical else (-3, -1)
        in_units = bool(own.unit()), load_of(own.table) == "nominal_pressure"
        of_leak, of_load = (ratio**n if physical != has else 1.0 for n, has in zip(powers, in_units, strict=True))
        found.append(replace(other, of_leak=of_leak, of_load=of_load))
    return runs[0].words, found


def _number(surfaces: Sequence[_Loaded], axis: str) -> Average:
    """Return the leak of several surfaces."""
    return average(FLOW, [one.leak(axis) for one in surfaces])


def _way(
    fine: Sequence[_Loaded],
    coarser: Sequence[tuple[str, list[_Loaded]]],
    levelled: _Levelled | None,
    axis: str,
) -> Way:
    """Return the leak along one axis with its closing and its error."""
    leak = _number(fine, axis)
    finer = [_Finer.of(one, others) for one, *others in _rows(fine, coarser)]
    window = _window_of_loads(fine, axis)
    of_load = [_solved(fine, axis), _grid_of_loads(fine, coarser, finer, axis), window]
    if levelled is not None:
        of_load.append(_levelling_of_loads(levelled, axis))
    closing = replace(_closing(fine, axis), parts=tuple(of_load))
    others = tuple((words, _closing(surfaces, axis)) for words, surfaces in coarser)
    if leak.value > 0.0:
        parts = [_solver(fine, axis), _grid(fine, coarser, finer, axis), _window(fine, window, axis)]
        if levelled is not None:
            parts.append(_levelling(fine, levelled, axis))
    else:
        parts = of_load
    count = sum(one.leak(axis) > 0.0 for one in fine)
    most = _at_most(fine, closing, axis) if leak.value == 0.0 else math.nan
    return Way(axis, leak, count, fine[0].unit(), closing, others, _last_open(fine, axis), tuple(parts), most)


def _at_most(fine: Sequence[_Loaded], closing: Closing, axis: str) -> float:
    """Return the leak of a closed way if it closes at the far end of the interval of its closing load."""
    _, larger = together(closing.parts)
    leaks = [one.leak_if(axis, math.log(larger)) for one in fine]
    return average(FLOW, leaks).value if np.isfinite(leaks).all() else math.nan


def _closing(surfaces: Sequence[_Loaded], axis: str) -> Closing:
    """Return where the last way of several surfaces closes."""
    found = [one.closing(axis) for one in surfaces]
    return Closing(tuple(span for closing in found for span in closing.spans), found[0].unit)


def _last_open(fine: Sequence[_Loaded], axis: str) -> str:
    """Return the leak of the last open step of the only surface, where it is closed at the load."""
    table = first_leg(fine[0].table)
    name = next((name for name in (FLOW, f"{FLOW}_dry") if name in table), "")
    if len(fine) > 1 or fine[0].leak(axis) != 0.0 or not name:
        return ""
    leaks = table[name].sel(axis=axis).values[0]
    open_ = np.flatnonzero(leaks > 0.0)
    if not open_.size:
        return "closed at every step"
    leak, load = float(leaks[open_[-1]]), float(table[load_of(table)][0, open_[-1]])
    amount = f"{number(leak)} {fine[0].unit(name)}" + (" without fluid pressure" if name.endswith("_dry") else "")
    return f"at the last open step, {fine[0].closing(axis).load(load)}, it leaks {amount}"


def _solver(fine: Sequence[_Loaded], axis: str) -> Part:
    """Return the part of the solver: the leak with all gaps η smaller, and η larger."""
    lifted, low, high = is_lifted(fine[0].table), list[float](), list[float]()
    for one in fine:
        leak = one.leak(axis)
        if not math.isfinite(leak):
            continue
        smaller, middle, larger = _flows(one, axis, lifted=lifted)
        low.append(leak * smaller / middle if middle else 0.0)
        high.append(leak * larger / middle if middle else larger * _per_starred(one, axis))
    largest = max(_bound(one, axis) for one in fine)
    words = f"certified: every gap is right to η/σ = {largest:.1e}"
    if lifted:
        words = (
            f"estimated: contacts are solved to η/σ = {largest:.1e}, the fluid pressure to {ACCURACY:.0e} of the drop"
        )
    flows = max((float(one.table[ERROR].max()) for one in fine if ERROR in one.table), default=0.0)
    words += f"; flows to {flows:.0e}" if flows > 0.0 else ""
    below, here, above = (average(FLOW, leaks).value for leaks in (low, [one.leak(axis) for one in fine], high))
    if not here > 0.0:
        at_most = f"; closed ways leak at most {number(above)} {fine[0].unit()}" if math.isfinite(above) else ""
        return Part("solver", math.inf, f"{words}{at_most}".strip())
    if not below > 0.0:
        return Part("solver", math.inf, f"{words}; the way may be closed")
    return Part("solver", (1.0 + flows) * max(above / here, here / below), words)


def _flows(one: _Loaded, axis: str, *, lifted: bool) -> tuple[float, float, float]:
    """Return T* V*³ with all gaps η smaller, as they are, and η larger; elements in contact may be open by η."""
    gap, whole = _gap(one, axis, lifted=lifted)
    if gap.size == 0:  # closed before the load
        return 0.0, 0.0, math.nan
    periodic, bound, flows = whole and _periodic(one), _bound(one, axis), []
    for shift in (-bound, 0.0, bound):
        shifted = np.where(gap > 0.0, np.maximum(gap + shift, 0.0), max(shift, 0.0))
        flows.append(_flow(shifted, axis, periodic=periodic))
    smaller, middle, larger = flows
    return smaller, middle, larger


def _periodic(one: _Loaded) -> bool:
    return "periodic" in one.run.dataset.attrs


def _flow(gap: Array, axis: str, *, periodic: bool = False) -> float:
    """Return T* V*³ of a gap over σ."""
    flow = conduction(gap, AXES.index(axis), periodic=periodic, accuracy=EXACT)
    return flow.coefficient * float(gap.mean()) ** 3


def _per_starred(one: _Loaded, axis: str) -> float:
    """Return the leak of T* V*³ = 1, from the first open step; 1 without a unit, NaN without an open step."""
    if not one.unit():
        return 1.0
    for dry in ("", "_dry"):
        names = f"{FLOW}{dry}", f"transmissivity{dry}"
        if all(name in one.table for name in names):
            leak, starred = (one.table[name].sel(axis=axis).values[0] for name in names)
            open_ = np.flatnonzero(starred > 0.0)
            volume = one.table["free_volume"].values[0]
            return float(leak[open_[0]] / (starred[open_[0]] * volume[open_[0]] ** 3)) if open_.size else math.nan
    return math.nan


def _bound(one: _Loaded, axis: str) -> float:
    """Return η/σ: the largest of the steps, and that to which a state between two steps is solved.

    Under fluid pressure P the gap is right to η and to the displacement of the error of P, taken as a wave of length L:
    L/(π E*) times its amplitude.
    """
    if not is_lifted(one.table):
        return max(float(one.table["residual"].max()), one.run.rtol)
    study = one.run.study
    assert study is not None
    assert study.record.fluid_pressure is not None
    state = one.fields.sel({STATE: one.recorded})
    drop = float(state[f"{STATE}_inlet"] - state[f"{STATE}_outlet"])
    if study.record.fluid_pressure.coupling == "one-way" or not math.isfinite(drop):
        return min(RTOL, one.run.rtol)
    names = ("fluid_leak_dry", "fluid_leak_one_way", "fluid_leak")
    dry, first, last = (float(state[name].sel(axis=axis)) for name in names)
    gain = max(1.0, abs((last - dry) / (first - dry))) if first != dry else 1.0
    return min(RTOL, one.run.rtol) + gain * ACCURACY * drop / math.pi


def _gap(one: _Loaded, axis: str, *, lifted: bool) -> tuple[Array, bool]:
    """Return the gap over σ at the recorded state, in the region, and whether that is the whole; empty without one."""
    if "flux" not in one.table:  # no surface reaches the load
        return np.empty((0, 0)), False
    state = one.fields.sel(field_at=one.recorded, flux_at=one.recorded)
    kept = state["fluid_gap"].sel({STATE: one.recorded, "axis": axis}) if lifted else state["gap"]
    gap = kept.transpose("x", "y").values
    inside, solved = np.isfinite(state["flux"].sel(axis=axis).transpose("x", "y").values), np.isfinite(gap)
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if not rows.size:
        return np.empty((0, 0)), False
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return np.asarray(gap[window]), bool(inside[solved].all())


@dataclass(frozen=True)
class _Finer:
    """What a grid 4 times finer may change, as logarithms; NaN without a coarser grid.

    At one contact area the load goes with the slope. If the spectrum goes on below the map, slopes grow in each octave
    by ``growth``; if the spectrum ends at the map, they stay. The map does not show which.
    """

    growth: float  # of the slope in an octave
    scatter: float  # of the closing load

    @classmethod
    def of(cls, one: _Loaded, others: Sequence[_Loaded]) -> _Finer:
        """Return what follows from the same surface on coarser grids, those at twice the spacing first.

        Slopes grow below the map as in the last octave but one, or by less as far as the last octave has less: there a
        spectrum that ends shows. Heights at points have slopes of shorter waves in their last octave as well.
        """
        if not others:
            return cls(math.nan, math.nan)
        closings = [(one.closing(axis).value, others[0].closing(axis).value) for axis in AXES]
        changes = [abs(math.log(here / there)) for here, there in closings if math.isfinite(here) and there > 0.0]
        scatter = SCATTER * min(1.0, max(changes, default=ROUGH) / ROUGH)
        slopes = [float(grid.table["Sdq"][0]) for grid in (one, *others)]
        if not min(slopes) > 0.0:
            return cls(0.0, scatter)
        last, *before = (math.log(here / there) for here, there in itertools.pairwise(slopes))
        return cls(max(0.0, min(before[0], 2.0 * last - before[0]) if before else last), scatter)

    @property
    def of_closing(self) -> tuple[float, float]:
        """By how much closing loads may be smaller and larger."""
        return self.scatter, self.scatter + (OCTAVES + PIXEL) * self.growth

    @property
    def of_leak(self) -> tuple[float, float]:
        """By how much the loads of an open leak may be smaller and larger."""
        return OPEN * self.scatter, OPEN * self.scatter + OCTAVES * self.growth


def _finer_words(finer: Sequence[_Finer]) -> str:
    growth = float(np.mean([one.growth for one in finer]))
    if growth == 0.0:
        return "slopes grow no more at this spacing: the spectrum ends before it"
    counts = ": roughness below the spacing counts" if growth >= STEEP else ""
    return f"slopes grow × {math.exp(growth):.2f} as the spacing halves, and may go on so to a quarter of it{counts}"


def _grid_of_loads(
    fine: Sequence[_Loaded],
    coarser: Sequence[tuple[str, list[_Loaded]]],
    finer: Sequence[_Finer],
    axis: str,
) -> Part:
    """Return the part of the grid of the closing load."""
    if not coarser:
        return Part("grid", math.nan, NO_COARSER)
    fall, rise = (float(np.mean(logs)) for logs in zip(*(one.of_closing for one in finer), strict=True))
    return Part(
        "grid",
        math.exp(rise),
        "; ".join(filter(None, (_trend(fine, coarser, axis), _finer_words(finer)))),
        math.exp(fall),
    )


def _grid(
    fine: Sequence[_Loaded],
    coarser: Sequence[tuple[str, list[_Loaded]]],
    finer: Sequence[_Finer],
    axis: str,
) -> Part:
    """Return the part of the grid of the leak: that of the loads, at most twice the change from twice the spacing."""
    if not coarser:
        return Part("grid", math.nan, NO_COARSER)
    words = ", ".join(f"{words}: {_change(fine, surfaces, axis)}" for words, surfaces in coarser)
    low, high = list[float](), list[float]()
    for (one, other, *_), below in zip(_rows(fine, coarser), finer, strict=True):
        fall, rise = below.of_leak
        here, change = one.leak(axis), math.exp(OCTAVES * abs(_log_ratio(one, other, axis)))
        low.append(np.nanmax([here / change, one.leak_if(axis, -fall), 0.0]))
        high.append(np.nanmin([here * change, one.leak_if(axis, rise), math.inf]))
    return _of_several("grid", fine, low, high, axis, f"{words}; {_finer_words(finer)}")


def _of_several(
    name: str, fine: Sequence[_Loaded], low: Sequence[float], high: Sequence[float], axis: str, words: str
) -> Part:
    """Return a part of the median of several leaks, from the smallest and the largest leak of each; NaN if unknown."""
    leaks = np.array([one.leak(axis) for one in fine])
    reached = np.isfinite(leaks)
    ends = np.where(np.isnan(low), 0.0, low), np.where(np.isnan(high), math.inf, high)
    here, least, most = (float(np.median(values[reached])) for values in (leaks, *ends))
    return Part(name, most / here, words, here / least if least > 0.0 else math.inf)


def _rows(fine: Sequence[_Loaded], others: Sequence[tuple[str, list[_Loaded]]]) -> Iterator[tuple[_Loaded, ...]]:
    """Yield each surface with the same surface of the other runs."""
    yield from zip(fine, *(surfaces for _, surfaces in others), strict=True)


def _log_ratio(one: _Loaded, other: _Loaded, axis: str) -> float:
    """Return the logarithm of the leak of another run over that on the finest grid; not finite without both."""
    here, there = one.leak(axis), other.leak(axis)
    return math.log(there / here) if here > 0.0 and there > 0.0 else math.nan


def _change(fine: Sequence[_Loaded], other: Sequence[_Loaded], axis: str) -> str:
    """Return the leak in another run over that on the finest grid, in words."""
    here, there = _number(fine, axis).value, _number(other, axis).value
    if not math.isfinite(there):
        return "not pressed to this load"
    shut = sum(one.leak(axis) > 0.0 and two.leak(axis) == 0.0 for one, two in zip(fine, other, strict=True))
    count = f" ({shut} of {len(fine)} surfaces close)" if shut and len(fine) > 1 else ""
    return f"× {number(there / here)}{count}" if there > 0.0 else "closed"


def _trend(fine: Sequence[_Loaded], coarser: Sequence[tuple[str, list[_Loaded]]], axis: str) -> str:
    """Return in words what coarser grids show of a way that is closed on the finest."""
    leaks = [(words, _number(surfaces, axis).value) for words, surfaces in coarser]
    unit = fine[0].unit()
    text = [f"{words} the way is open and leaks {number(leak)} {unit}".strip() for words, leak in leaks if leak > 0.0]
    closings = [_closing(surfaces, axis) for surfaces in (fine, *(surfaces for _, surfaces in coarser))]
    middles = [sum(closing.bracket) / 2.0 for closing in closings]
    known = [load for load in middles if math.isfinite(load)]
    if len(known) > 1 and math.isfinite(middles[0]):
        loads = ", ".join(number(load) for load in reversed(known))
        rises = all(one > other for one, other in itertools.pairwise(known))
        text.append(
            f"it closes at about {loads} {closings[0].unit or '(p*)'} from the coarsest grid to the finest"
            + (": closing loads rise, and on a finer grid the way may be open" if rises else "")
        )
    return "; ".join(text) or "coarser grids do not show where a finer grid closes"


def _window(fine: Sequence[_Loaded], of_loads: Part, axis: str) -> Part:
    """Return the part of the window of the leak: surfaces among each other, or the quadrants of the only one.

    Where surfaces or quadrants are closed, it is the part of the closing load.
    """
    values = np.array([one.leak(axis) for one in fine])
    values = values[np.isfinite(values)]
    if len(fine) > 1:
        if values.size < 2:
            return Part("window", math.inf, "one surface at this load: no interval of their median")
        if (values > 0.0).all():
            wider = OF_MEDIAN if values.size > 2 else 1.0  # the median of two is their mean
            words = f"{_percent()} interval of the median over {values.size} surfaces, of logarithms by t"
            return Part("window", math.exp(wider * _half(values)), words)
        closed = f"{np.count_nonzero(values == 0.0)} of {values.size} surfaces are closed"
    else:
        return _window_of_quadrants(fine[0], axis)
    if not of_loads.known:
        return Part("window", math.inf, f"{closed}: other windows of the joint may be open")
    log = math.log(of_loads.factor)
    low, high = ([one.leak_if(axis, end) for one in fine] for end in (-log, log))
    return _of_several("window", fine, low, high, axis, f"{closed}: from the closing load, {of_loads.words}")


def _window_of_quadrants(one: _Loaded, axis: str) -> Part:
    """Return the part of the window of the leak of the only surface."""
    lifted = is_lifted(one.table)
    gap, whole = _gap(one, axis, lifted=lifted)
    flows = np.array([_flow(part, axis) for part in quarters(gap)])
    shut = f", {np.count_nonzero(flows == 0.0)} closed" if (flows == 0.0).any() else ""
    words = f"scatter of the leaks of the quadrants of the map{shut}, {_percent()} by t, times {QUADRANTS}"
    if one.leads and not lifted:
        log = _scatter_of_loads(one, axis, flows / _flow(gap, axis, periodic=whole and _periodic(one)), one.load)
        return _of_several("window", [one], [one.leak_if(axis, -log)], [one.leak_if(axis, log)], axis, words)
    if shut:
        return Part("window", math.inf, f"{words}: other windows of the joint may be open")
    return Part("window", math.exp(QUADRANTS * _half(flows)), words)


def _scatter_of_loads(one: _Loaded, axis: str, ratios: Array, load: float) -> float:
    """Return the part of the window of loads, as a logarithm, from the leaks of quadrants over that of the map.

    Each quadrant has the load at which the map leaks as much; a closed quadrant has the closing load.
    """
    here = one.leak_at(axis, load)
    return QUADRANTS * _half(np.array([one.load_at(axis, here * ratio) for ratio in ratios]))


def _window_of_loads(fine: Sequence[_Loaded], axis: str) -> Part:
    """Return the part of the window of the closing load: surfaces among each other, or the quadrants of the only one.

    The leaks of the quadrants are those at a light load, where most are open.
    """
    if len(fine) > 1:
        loads = np.array([one.closing(axis).value for one in fine])
        if not np.isfinite(loads).all():
            return Part("window", math.inf, f"{np.count_nonzero(~np.isfinite(loads))} of {loads.size} do not close")
        words = f"{_percent()} interval of the mean over {loads.size} surfaces, of logarithms by t"
        return Part("window", math.exp(_half(loads)), words)
    one = fine[0]
    table = first_leg(one.table).isel(seed=0)
    starred = f"transmissivity{'_dry' if is_lifted(one.table) else ''}"
    if "quadrant_flow" not in table:
        return Part("window", math.nan, "the flows of its quadrants are not stored")
    along = table["quadrant_flow"].sel(axis=axis).dropna("step", how="all")
    if not along.sizes["step"]:
        return Part("window", math.nan, "the flows of its quadrants are not stored")
    step = table.sel(step=int(along["step"][0]))
    load, flow = float(step[load_of(table)]), float(step[starred].sel(axis=axis)) * float(step["free_volume"]) ** 3
    if not flow > 0.0:
        return Part("window", math.nan, f"the map is closed at {one.closing(axis).load(load)}")
    log = _scatter_of_loads(one, axis, along.values[0] / flow, load)
    at = f"the quadrants of the map at {one.closing(axis).load(load)}"
    words = f"scatter of the leaks of {at}, {_percent()} by t, times {QUADRANTS}, as loads of equal leak"
    return Part("window", math.exp(log), words)


def _half(values: Array) -> float:
    """Return the half-width of the interval of the mean logarithm."""
    return float(half_width(float(np.log(values).std(ddof=1)), values.size))


def _percent() -> str:
    return f"{100.0 * COVERAGE:.0f} %"


def _solved(fine: Sequence[_Loaded], axis: str) -> Part:
    """Return the part of the solver of the closing load."""
    found = [span for one in fine for span in one.closing(axis).spans]
    if not found or not all(span.closes for span in found):
        return Part("solver", math.nan, "the way does not close within the sweep" if found else "no way is followed")
    if all(span.open_up_to == span.closed_from for span in found):
        most = f"; {words}" if "leak at most" in (words := _solver(fine, axis).words) else ""
        return Part("solver", 1.0 + STEEPEST * CLOSING, f"solved, the indentation to {CLOSING:.0e}{most}")
    low, high = _closing(fine, axis).bracket
    return Part("solver", math.sqrt(high / low) if low > 0.0 else math.inf, "between two steps of the sweep")


def _levelling_of_loads(levelled: _Levelled, axis: str) -> Part:
    """Return the part of the levelling of the closing load."""
    log = levelled.of_load(axis)
    if math.isnan(log):
        return Part("levelling", math.nan, f"with {levelled.words}: not closed within the sweep")
    return Part("levelling", math.exp(abs(log)), f"with {levelled.words}: × {number(math.exp(log))}")


def _levelling(fine: Sequence[_Loaded], levelled: _Levelled, axis: str) -> Part:
    """Return the part of the levelling of the leak; where the way closes on its grid, that of the closing load."""
    low, high, logs = list[float](), list[float](), list[float]()
    for one, before, after in zip(fine, levelled.before, levelled.after, strict=True):
        log = _log_of_levelling(one, before, after, axis)
        here, change = one.leak(axis), math.exp(abs(log))
        ends = here / change, here * change
        if math.isnan(log) and after.closing(axis).value > 0.0 and before.closing(axis).value > 0.0:
            of_load = abs(math.log(after.closing(axis).value / before.closing(axis).value))
            ends = one.leak_if(axis, -of_load), one.leak_if(axis, of_load)
        low.append(ends[0])
        high.append(ends[1])
        logs.append(log)
    words, of_loads = "not known at this load", levelled.of_load(axis)
    if np.isfinite(logs).all():
        words = f"× {number(math.exp(float(np.median(logs))))}"
    elif math.isfinite(of_loads):
        words = f"closes at × {number(math.exp(of_loads))} of the load"
    return _of_several("levelling", fine, low, high, axis, f"with {levelled.words}: {words}")


def _log_of_levelling(one: _Loaded, before: _Loaded, after: _Loaded, axis: str) -> float:
    """Return the logarithm of what a levelling does to the leak; NaN where the way closes.

    A coarser grid closes at a smaller load. The leaks are those at the same share of the closing load.
    """
    closes, known = before.closing(axis).value, one.closing(axis).value
    if not one.leads or is_lifted(one.table) or not (0.0 < known < math.inf and 0.0 < closes < math.inf):
        return _log_ratio(before, after, axis)
    load = one.load * closes / known
    here, there = (grid.leak_at(axis, load) for grid in (before, after))
    return math.log(there / here) if here > 0.0 and there > 0.0 else math.nan
