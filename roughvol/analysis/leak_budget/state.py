"""The surfaces of a run at the load of a card: leaks there and at other loads, gaps, and the run on another grid."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator
from xarray import DataArray, Dataset

from roughvol.analysis.at import LOAD_KINDS, state_at
from roughvol.analysis.average import Average, average
from roughvol.analysis.closing import Closing, Span, load_of, load_per_starred, spans
from roughvol.analysis.derived import derived, groups
from roughvol.analysis.leak import STATE, is_lifted
from roughvol.analysis.legs import first_leg
from roughvol.analysis.parts import Part
from roughvol.analysis.stored_run import Run
from roughvol.analysis.units import scales
from roughvol.errors import DatasetError
from roughvol.gap.transport import conduction
from roughvol.observables.variables import AXES
from roughvol.store.card_runs import Pressed
from roughvol.study import Level, parse
from roughvol.study.values.state_kinds import REACHED
from roughvol.typing import Array

EXACT = 1e-8  # accuracy of the flows whose ratios are parts of the error
FLOW, SWEEP = "leak_rate", "the sweep"
FAR, LEAST_SLOPE = 20.0, 1e-6  # logarithm of loads before the first state; of a leak over that of the load
NEARER = 2.0 ** -np.arange(1.0, 31.0)  # distances to the closing load over that of the last state


@dataclass(frozen=True, eq=False)
class Loaded:
    """One surface of a run at the load of a card; ``of_leak``, ``of_load`` make it comparable with the finest grid."""

    name: str
    run: Run
    level: Level
    table: Dataset  # states along step, fields, of one surface along seed
    state: Dataset | None  # None if the sweep does not reach the load and is open at its end
    recorded: str
    leads: bool = True  # the state lies on the curve of the first leg
    of_leak: float = 1.0
    of_load: float = 1.0

    def number(self, name: str, axis: str = "") -> float:
        """Return Sq or Sdq, or a number of the state, along an axis where it has a direction; NaN without one."""
        data = self.table if name in ("Sq", "Sdq") else self.state
        if data is None or name not in data:
            return math.nan
        value = data.variables[name].transpose("seed", ...).values[0]
        return float(value[AXES.index(axis)] if axis else value)

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
        found = (self.table[flow].attrs["units"] for flow in (name, f"{name}_dry") if flow in self.table)
        return str(next(found, ""))

    @cached_property
    def fields(self) -> Dataset:
        """The run without dimensions of cases."""
        return self.table.isel(seed=0)

    @cached_property
    def loading(self) -> Dataset:
        """The first leg, without dimensions of cases."""
        return first_leg(self.fields)

    def leaks(self, name: str = FLOW) -> DataArray:
        """Return a flow along the first leg, T* V*³ without a unit; under fluid pressure that of the dry gap."""
        dry = "_dry" if is_lifted(self.table) else ""
        if f"{name}{dry}" in self.loading:
            return self.loading[f"{name}{dry}"]
        return self.loading[f"{name.replace(FLOW, 'transmissivity')}{dry}"] * self.loading["free_volume"] ** 3

    @cached_property
    def closing(self) -> Mapping[str, Closing]:
        """Where the last way along each axis closes on loading."""
        units = str(self.loading[load_of(self.loading)].attrs.get("units", "1"))
        unit = "" if units == "1" else units
        leg = self.loading.expand_dims("seed")
        return {axis: Closing(tuple(map(self._scaled, spans(leg, axis))), unit) for axis in AXES}

    def _scaled(self, span: Span) -> Span:
        return replace(span, open_up_to=span.open_up_to * self.of_load, closed_from=span.closed_from * self.of_load)

    def curve(self, axis: str, name: str = FLOW) -> PchipInterpolator | None:
        """Return the logarithm of a flow of the first leg (`curve_of`), of the dry gap under fluid pressure."""
        leaks, load = self.leaks(name).sel(axis=axis).values * self.of_leak, load_of(self.table)
        points = dict(zip((self.loading[load].values * self.of_load).tolist(), leaks.tolist(), strict=True))
        if self.leads and not is_lifted(self.table) and self.state is not None:
            at = self.number(load) * self.of_load
            # a step that misses the load by the accuracy of a search is the state: the slope between both is noise
            steps = {p: leak for p, leak in points.items() if not math.isclose(p, at, rel_tol=REACHED)}
            points = steps | {at: self.leak(axis, name)}
        return curve_of(points, self.closing[axis].value)

    def leak_at(self, axis: str, load: float, name: str = FLOW) -> float:
        """Return a flow at another load; NaN if unknown."""
        curve = self.curve(axis, name)
        if load >= self.closing[axis].value:
            return 0.0
        return math.exp(curve(math.log(load))) if curve is not None and load > 0.0 else math.nan

    def load_at(self, axis: str, leak: float) -> float:
        """Return the load with another leak, the closing load of none; NaN if unknown."""
        curve = self.curve(axis)
        if curve is None or math.isnan(leak):
            return math.nan
        if leak == 0.0:
            return self.closing[axis].value
        found = curve.solve(math.log(leak), extrapolate=False)
        return math.exp(found[-1]) if len(found) else self.closing[axis].value

    def leak_if(self, axis: str, log: float, name: str = FLOW) -> float:
        """Return a flow of a joint with all loads larger by a factor; NaN where it is not known."""
        if not self.leads or is_lifted(self.table) or math.isnan(self.leak(axis)):
            return math.nan
        return self.leak_at(axis, self.load * math.exp(-log), name)

    @property
    def load(self) -> float:
        """Load of the state, as those of the closings; of a surface that closed before, the pressure of the level."""
        name, level = load_of(self.table), self.level
        if math.isnan(found := self.number(name)) and level.kind in LOAD_KINDS and level.value is not None:
            _, starred = next(iter(scales(self.run, self.table))).starred(level.kind, level.value)
            loads, pressures = (self.table[of].isel(seed=0).values for of in (name, "mean_pressure"))
            return starred * load_per_starred(loads, pressures)
        return found


Grids = Sequence[tuple[str, list[Loaded]]]
"""Coarser grids in words, the finest first, each with the surfaces at the load of the card."""


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
    sides = (np.concatenate([early, middle, late]) for early, middle, late in zip(before, (x, y), after, strict=True))
    return PchipInterpolator(*sides, extrapolate=False)


def surfaces_at_load(pressed: Pressed) -> Iterator[Loaded]:
    """Yield the surfaces of a run at the load of a card."""
    run = Run.of(SWEEP, pressed.dataset)
    for label, group in groups(derived(run.dataset, run.study)):
        for k in range(group.sizes["seed"]):
            table = group.isel(seed=slice(k, k + 1))  # a view: a list copies all fields
            name = f"{label}, seed {int(table['seed'][0])}" if "seed" in table.coords else label
            try:
                state = state_at(run, table, pressed.level)
            except DatasetError:
                yield Loaded(name, run, pressed.level, table, None, pressed.level.label)
                continue
            # elastic contact retraces its path
            leads = "plastic_volume" not in table or (parse(state.label).leg or 1) == 1
            yield Loaded(name, run, pressed.level, table, state.data, state.recorded, leads)


def comparable(runs: Sequence[Pressed], fine: Sequence[Loaded]) -> tuple[str, list[Loaded]]:
    """Return the words of another grid or levelling, and its surfaces with what makes them comparable.

    Nominal pressures are equal: leaks are compared as they are, and as T* V*³ Sq³ without a unit. Closing loads are
    compared as nominal pressures, p* Sq/L without a unit. Block means of a map have another L.
    """
    surfaces = [surface for pressed in runs for surface in surfaces_at_load(pressed)]
    found = []
    for other, own in zip(surfaces, fine, strict=True):
        ratio = other.number("Sq") / own.number("Sq")
        of_leak = 1.0 if own.unit() else ratio**3
        of_load = ratio * own.run.L / other.run.L if load_of(own.table) == "mean_pressure" else 1.0
        found.append(replace(other, of_leak=of_leak, of_load=of_load))
    return runs[0].words, found


def leak_of(surfaces: Sequence[Loaded], axis: str) -> Average:
    """Return the leak of several surfaces."""
    return average(FLOW, [surface.leak(axis) for surface in surfaces])


def closing_of(surfaces: Sequence[Loaded], axis: str) -> Closing:
    """Return where the last way of several surfaces closes."""
    found = [surface.closing[axis] for surface in surfaces]
    return Closing(tuple(span for closing in found for span in closing.spans), found[0].unit)


def log_ratio(surface: Loaded, other: Loaded, axis: str) -> float:
    """Return the logarithm of the leak of another run over that on the finest grid; not finite without both."""
    return log_of(surface.leak(axis), other.leak(axis))


def log_of(here: float, there: float) -> float:
    """Return the logarithm of a leak or a load over another; NaN where one of them is 0 or not known."""
    return math.log(there / here) if here > 0.0 and there > 0.0 else math.nan


def part_of_surfaces(
    name: str, fine: Sequence[Loaded], ends: Sequence[tuple[float, float]], axis: str, words: str
) -> Part:
    """Return a part of the median of several leaks, from the smallest and the largest leak of each; NaN if unknown."""
    leaks = np.array([surface.leak(axis) for surface in fine])
    known = np.where(np.isnan(ends), (0.0, math.inf), ends)
    reached = np.isfinite(leaks)
    here, least, most = (float(np.median(values[reached])) for values in (leaks, *known.T))
    return Part(name, most / here, words, here / least if least > 0.0 else math.inf)


def gap_of(fields: Dataset, at: str, axis: str) -> tuple[Array, bool]:
    """Return the gap over σ at a recorded state, in the region, and whether it is periodic; empty without one."""
    if "flux" not in fields:  # no surface reaches the load
        return np.empty((0, 0)), False
    kept = fields["fluid_gap"].sel({STATE: at, "axis": axis}) if is_lifted(fields) else fields["gap"].sel(field_at=at)
    gap, flux = (field.transpose("x", "y").values for field in (kept, fields["flux"].sel(flux_at=at, axis=axis)))
    inside = np.isfinite(flux)
    periodic = "periodic" in fields.attrs and bool(inside[np.isfinite(gap)].all())  # a region is no period
    return gap[np.ix_(inside.any(axis=1), inside.any(axis=0))], periodic


def flow_of(gap: Array, axis: str, *, periodic: bool = False) -> float:
    """Return T* V*³ of a gap over σ."""
    flow = conduction(gap, AXES.index(axis), periodic=periodic, accuracy=EXACT)
    return flow.coefficient * float(gap.mean()) ** 3


def per_starred(surface: Loaded, axis: str) -> float:
    """Return the leak of T* V*³ = 1, from the first open step; 1 without a unit, NaN without an open step."""
    if not surface.unit():
        return 1.0
    dry = "_dry" if is_lifted(surface.table) else ""
    leak, starred = (surface.table[f"{name}{dry}"].sel(axis=axis).values[0] for name in (FLOW, "transmissivity"))
    open_ = np.flatnonzero(starred > 0.0)
    volume = surface.table["free_volume"].values[0]
    return float(leak[open_[0]] / (starred[open_[0]] * volume[open_[0]] ** 3)) if open_.size else math.nan
