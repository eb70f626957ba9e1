"""The leak at one load along x and y with its error, and where the last way closes, from the runs of a card.

=========  ==================================================================================================
solver     the flow falls where a gap falls, and every gap is right to η: certified, under fluid pressure estimated
grid       change of the leak at 2 and 4 times the spacing, extrapolated
window     several surfaces: t interval of the logarithms; one map: that of its quadrants
levelling  change of the leak with another levelling of a file
=========  ==================================================================================================
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from xarray import Dataset

from roughvol.analysis import seal
from roughvol.analysis.at import at
from roughvol.analysis.average import Average, average
from roughvol.analysis.closing import load_of, spans
from roughvol.analysis.derived import derived, groups
from roughvol.analysis.leak import STATE, is_lifted
from roughvol.analysis.leak_card import Beside, Card, Closing, Part, SealLeak, SurfaceAtLoad, Way
from roughvol.analysis.legs import first_leg
from roughvol.analysis.seal import Patch
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import number
from roughvol.ensemble.multilevel import COVERAGE, half_width
from roughvol.errors import DatasetError
from roughvol.gap.transport import conduction
from roughvol.observables.coupling import ACCURACY, RTOL
from roughvol.observables.variables import AXES
from roughvol.store.card_runs import CardRuns, Pressed
from roughvol.study import HeightFile, Quantity
from roughvol.typing import Array

SHRINKS = 0.9  # largest ratio of two steps of refinement that is extrapolated
# standard error of the median of many normal numbers over that of their mean; of few numbers it is less
EXACT = 1e-8  # accuracy of the flows whose ratios are the part of the solver
OF_MEDIAN = math.sqrt(0.5 * math.pi)
FLOW, SWEEP = "leak_rate", "the sweep"
EACH = "root mean square of the surfaces' own factors"
# docs/how-to/leak-card.md
MEASURED = "measured, it held in 92 % of 360 maps, in 86 % of 80 with a roll-off at light load"


@dataclass(frozen=True, eq=False)
class _Loaded:
    """One surface of a run at the load of a card.

    ``of_leak`` and ``of_load`` turn its leak and loads into those to compare with the finest grid.
    """

    name: str
    run: Run
    table: Dataset  # states along step, fields, of one surface along seed
    state: Dataset | None  # None if the sweep does not reach the load and is open at its end
    recorded: str
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
                yield _Loaded(name, run, one, None, pressed.level.label)
                continue
            study = run.study
            dry = study is not None and study.record.fluid_pressure is not None and not is_lifted(one)
            yield _Loaded(name, run, one, None if dry else state.data, state.recorded)


def check_reached(fine: Pressed) -> None:
    """Refuse a run without a surface that is pressed to the load of a card.

    Parameters
    ----------
    fine : Pressed
        The finest run of a card.

    Raises
    ------
    DatasetError
        With the loads of the run.
    """
    if all(one.state is None for one in _loaded(fine)):
        run = Run.of(SWEEP, fine.dataset)
        for _, group in groups(derived(run.dataset, run.study)):
            at(run, group, fine.level)  # raises, except beyond a sweep that ended closed
        message = f"{SWEEP} ends before {fine.level.label}, and the fluid may open the way again: press farther"
        raise DatasetError(message)


def card_of(runs: Sequence[CardRuns], name: str, load: str) -> Card:
    """Return the card of one surface or of several.

    Parameters
    ----------
    runs : sequence of CardRuns
        The runs of each height file, or those of generated surfaces.
    name : str
        Title: the name of the study.
    load : str
        The load in words.

    Returns
    -------
    Card
        Leak, error budget and closing loads along x and y.

    Raises
    ------
    DatasetError
        If no surface is pressed to the load.
    """
    fine = [surface for one in runs for surface in _loaded(one.fine)]
    if all(one.state is None for one in fine):
        check_reached(runs[0].fine)
    coarser = [_compared(grids, fine) for grids in zip(*(one.coarser for one in runs), strict=False)]
    levels = [one.levelled for one in runs if one.levelled is not None]
    levelled = _compared(levels, fine) if len(levels) == len(runs) else None
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
    reached = [one for one in fine if all(math.isfinite(one.leak(axis)) for axis in AXES)]
    flow = next(way for way in ways if way.axis == patch.seal.flow)
    units = bool(flow.unit)
    isotropic = seal.is_isotropic([seal.ratios(one.table) for one in fine])
    maps = patch.conductances(np.array([[one.leak(axis) for axis in AXES] for one in reached]), in_units=units)
    quadrants = patch.conductances(_of_quadrants(fine[0]), in_units=units) if len(fine) == 1 else None
    shared = [part for part in flow.parts if part.name != "window"]
    heights = [surface for one in fine if (surface := seal.surface_of(one.fields)) is not None]
    closings = [[one.closing(axis).spans for axis in patch.axes] for one in fine]
    closing = seal.Estimate(math.nan, math.nan, math.nan)
    if not is_lifted(fine[0].table) and all(len(found) == 1 and found[0].closes for row in closings for found in row):
        loads = np.array([[[found[0].middle for found in row]] for row in closings])
        closing = seal.closing_of(loads, patch.patches, isotropic=isotropic and len(fine) > 1)
    leak, parts, words = seal.leak_of(
        patch,
        maps,
        quadrants,
        isotropic=isotropic,
        representative=bool(heights) and seal.is_representative(heights),
        shared=shared,
    )
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
    )


def _of_quadrants(one: _Loaded) -> Array:
    """Return the leaks that the quadrants of a map would have as the map, shape (4, 2)."""
    leaks = []
    for axis in AXES:
        gap, _ = _gap(one, axis, lifted=is_lifted(one.table))
        flows = [_flow(part, axis) for part in _quadrants(gap)] if gap.size else [0.0] * 4
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
    levelled: tuple[str, list[_Loaded]] | None,
    axis: str,
) -> Way:
    """Return the leak along one axis with its closing and its error."""
    leak = _number(fine, axis)
    closing = _closing(fine, axis)
    others = tuple((words, _closing(surfaces, axis)) for words, surfaces in coarser)
    parts = [_solver(fine, axis), _grid(fine, coarser, axis), _window(fine, axis)]
    if levelled is not None:
        parts.append(_levelling(fine, *levelled, axis))
    count = sum(one.leak(axis) > 0.0 for one in fine)
    return Way(axis, leak, count, fine[0].unit(), closing, others, _last_open(fine, axis), tuple(parts))


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
    below, here, above = (average(FLOW, leaks).value for leaks in (low, [one.leak(axis) for one in fine], high))
    if not here > 0.0:
        at_most = f"; closed ways leak at most {number(above)} {fine[0].unit()}" if math.isfinite(above) else ""
        return Part("solver", math.inf, f"{words}{at_most}".strip())
    if not below > 0.0:
        return Part("solver", math.inf, f"{words}; the way may be closed")
    return Part("solver", max(above / here, here / below), words)


def _flows(one: _Loaded, axis: str, *, lifted: bool) -> tuple[float, float, float]:
    """Return T* V*³ with all gaps η smaller, as they are, and η larger; elements in contact may be open by η."""
    gap, whole = _gap(one, axis, lifted=lifted)
    if gap.size == 0:  # closed before the load
        return 0.0, 0.0, math.nan
    periodic, bound, flows = whole and "periodic" in one.run.dataset.attrs, _bound(one, axis), []
    for shift in (-bound, 0.0, bound):
        shifted = np.where(gap > 0.0, np.maximum(gap + shift, 0.0), max(shift, 0.0))
        flows.append(_flow(shifted, axis, periodic=periodic))
    smaller, middle, larger = flows
    return smaller, middle, larger


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


def _grid(fine: Sequence[_Loaded], coarser: Sequence[tuple[str, list[_Loaded]]], axis: str) -> Part:
    """Return the part of the grid, from the leak at spacings in the ratio 1, 2, 4."""
    leak = _number(fine, axis).value
    if not coarser:
        return Part("grid", math.nan, "no coarser grid has enough nodes for the surface")
    if not leak > 0.0:
        return Part("grid", math.nan, _trend(fine, coarser, axis))
    words = ", ".join(f"{words}: {_change(fine, surfaces, axis)}" for words, surfaces in coarser)
    each = [_extrapolated([_log_ratio(one, other, axis) for other in others]) for one, *others in _rows(fine, coarser)]
    if len(fine) == 1:
        return Part("grid", each[0][0], f"{words}; {each[0][1]}")
    return Part("grid", _of_several(fine, [factor for factor, _ in each], axis), f"{words}; {EACH}")


def _extrapolated(changes: Sequence[float]) -> tuple[float, str]:
    """Return the factor of the grid of one surface, from the logarithms of its leak at 2 and 4 times the spacing."""
    first = -changes[0]
    if not math.isfinite(first):
        return math.inf, "on a finer grid it may leak far more"
    if len(changes) < 2 or not math.isfinite(changes[1]):
        return math.exp(abs(first)), "change from twice the spacing"
    second = -changes[1] - first
    ratio = abs(first / second) if second else math.inf
    if ratio < SHRINKS:  # the last change at least: two changes may cancel by chance
        return math.exp(abs(first) * max(1.0, ratio / (1.0 - ratio))), "extrapolated"
    return math.exp(abs(first)), "does not converge, last change taken"


def _rows(fine: Sequence[_Loaded], others: Sequence[tuple[str, list[_Loaded]]]) -> Iterator[tuple[_Loaded, ...]]:
    """Yield each surface with the same surface of the other runs."""
    yield from zip(fine, *(surfaces for _, surfaces in others), strict=True)


def _log_ratio(one: _Loaded, other: _Loaded, axis: str) -> float:
    """Return the logarithm of the leak of another run over that on the finest grid; not finite without both."""
    here, there = one.leak(axis), other.leak(axis)
    return math.log(there / here) if here > 0.0 and there > 0.0 else math.nan


def _of_several(fine: Sequence[_Loaded], factors: Sequence[float], axis: str) -> float:
    """Return the factor of the median of several surfaces, each with a factor of its own; not finite if not known.

    A change of the grid is about as random between surfaces as the leak: the root mean square of the logarithms is that
    of each surface. A surface whose factor is not known may leak anything.
    """
    leaks, logs = np.array([one.leak(axis) for one in fine]), np.log(np.abs(factors))
    known = np.isfinite(logs)
    if not known.any():
        return math.inf
    here, reached = float(np.nanmedian(leaks)), np.isfinite(leaks)
    factor = math.exp(math.sqrt(float(np.mean(logs[known] ** 2))))
    low = np.median(np.where(known, leaks / factor, 0.0)[reached])
    high = np.median(np.where(known, leaks * factor, np.inf)[reached])
    return float(max(high / here, here / low)) if low > 0.0 else math.inf


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


def _window(fine: Sequence[_Loaded], axis: str) -> Part:
    """Return the part of the window: surfaces among each other, or the quadrants of the only one."""
    values = np.array([one.leak(axis) for one in fine])
    values = values[np.isfinite(values)]
    open_ = np.log(values[values > 0.0])
    closed = values.size - open_.size
    if len(fine) > 1:
        if closed or open_.size < 2:
            reason = (
                f"{closed} of {values.size} surfaces are closed" if closed else f"{open_.size} surface at this load"
            )
            return Part("window", math.inf, f"{reason}: no interval of their median")
        wider = OF_MEDIAN if open_.size > 2 else 1.0  # the median of two is their mean
        words = f"{COVERAGE:.0%} interval of the median over {open_.size} surfaces, of logarithms by t".replace(
            "%", " %"
        )
        return Part("window", math.exp(wider * half_width(float(open_.std(ddof=1)), open_.size)), words)
    gap, _ = _gap(fine[0], axis, lifted=is_lifted(fine[0].table))
    if gap.size == 0:
        return Part("window", math.inf, "closed before this load: other windows of the joint may be open")
    flows = np.array([_flow(part, axis) for part in _quadrants(gap)])
    logs = np.log(flows[flows > 0.0])
    if closed or logs.size < 2:
        count = f"{4 - logs.size} of 4 quadrants are closed"
        return Part("window", math.inf, f"{count}: the map is too small, other windows of the joint may be open")
    left_out = f", {4 - logs.size} closed" if logs.size < 4 else ""
    words = f"scatter of {logs.size} open quadrants of the map{left_out}, 95 % by t; {MEASURED}"
    return Part("window", math.exp(half_width(float(logs.std(ddof=1)), logs.size)), words)


def _quadrants(gap: Array) -> list[Array]:
    """Return the quadrants of a field."""
    rows, columns = ((slice(None, n // 2), slice(n // 2, None)) for n in gap.shape)
    return [gap[row, column] for row in rows for column in columns]


def _levelling(fine: Sequence[_Loaded], words: str, surfaces: Sequence[_Loaded], axis: str) -> Part:
    """Return the part of the levelling, from another levelling of the file."""
    if not _number(fine, axis).value > 0.0:
        leak = _number(surfaces, axis).value
        found = f"leaks {number(leak)} {surfaces[0].unit()}".strip() if leak > 0.0 else "closed"
        return Part("levelling", math.inf, f"with {words}: {'not pressed to this load' if math.isnan(leak) else found}")
    factors = [math.exp(abs(_log_ratio(one, other, axis))) for one, other in zip(fine, surfaces, strict=True)]
    words = f"with {words}: {_change(fine, surfaces, axis)}"
    if len(fine) == 1:
        return Part("levelling", factors[0], words)
    return Part("levelling", _of_several(fine, factors, axis), f"{words}; {EACH}")
