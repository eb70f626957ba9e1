"""The leak card: how much gets through at one load, along x and y, when it closes, and the error that belongs to it.

The leak of a state is T* V*³, the flow over that between plates σ apart, in the unit of the study where it has one.
Each part of the error is a factor: the leak may be as many times larger or smaller. Parts are independent, so their
logarithms add in squares. The part of the solver is certified, the others are estimates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from xarray import DataArray, Dataset

from roughvol.analysis.tables import number
from roughvol.observables.transport import conduction
from roughvol.study import loads
from roughvol.typing import Array

AXES = ("x", "y")
SHRINKS = 0.9  # largest ratio of two steps of refinement that is extrapolated


@dataclass(frozen=True)
class Part:
    """A part of the error of a leak.

    Attributes
    ----------
    name : str
        Source of the error.
    factor : float
        The leak may be as many times larger or smaller, ≥ 1; NaN if it is not known.
    words : str
        How it was found.
    """

    name: str
    factor: float
    words: str


@dataclass(frozen=True)
class Way:
    """The leak along one axis.

    Attributes
    ----------
    axis : str
        x or y.
    leak : float
        Leak in `unit`; 0 where the axis is closed.
    unit : str
        Unit of the study, or empty for T* V*³.
    closing : str
        Nominal pressure at which the last way closes, in words.
    parts : tuple of Part
        Error budget.
    """

    axis: str
    leak: float
    unit: str
    closing: str
    parts: tuple[Part, ...]

    @property
    def factor(self) -> float:
        """All parts together: the leak may be as many times larger or smaller."""
        logs = [math.log(part.factor) for part in self.parts if math.isfinite(part.factor)]
        return math.exp(math.sqrt(sum(log * log for log in logs)))

    @property
    def interval(self) -> tuple[float, float]:
        """Smallest and largest leak."""
        return self.leak / self.factor, self.leak * self.factor


@dataclass(frozen=True)
class Card:
    """A leak card: facts in pairs of words, the two ways, and the warnings of the run."""

    title: str
    facts: tuple[tuple[str, str], ...]
    ways: tuple[Way, ...]
    warnings: tuple[str, ...]


def card_of(runs: Mapping[str, Dataset], name: str) -> Card:
    """Return the card of the runs of `campaign.card`.

    Parameters
    ----------
    runs : mapping
        Datasets by name, the finest grid first, then coarser ones (``spacing × 2``), then another levelling.
    name : str
        Title: the name of the study.

    Returns
    -------
    Card
        Leak, error budget and closing pressure along x and y.
    """
    fine, *others = runs.values()
    names = list(runs)[1:]
    coarser = [run for run, label in zip(others, names, strict=True) if label.startswith("spacing")]
    levelled = {label: run for run, label in zip(others, names, strict=True) if label.startswith("level")}
    ways = tuple(_way(fine, coarser, levelled, axis) for axis in AXES)
    warnings = tuple(line for line in str(fine.attrs.get("warnings", "")).splitlines() if line.strip())
    return Card(name, tuple(_facts(fine)), ways, warnings)


def leaks(run: Dataset, axis: str) -> Array:
    """Return T* V*³ of every surface at the recorded state, 0 where closed and NaN where not reached."""
    flow, volume = run[f"flux_at_transmissivity_{axis}"], run["flux_at_free_volume"]
    return np.asarray((flow * volume**3).isel(flux_at=0).values, dtype=float).ravel()


def _compared(run: Dataset, fine: Dataset, axis: str) -> Array:
    """Return T* V*³ of another grid or levelling, over the Sq³ of the finest grid: that of a map changes with both."""
    values = leaks(run, axis)
    return values * (float(run["Sq"].mean()) / float(fine["Sq"].mean())) ** 3 if "case" in fine.dims else values


def unit_leaks(run: Dataset, axis: str) -> tuple[Array, str]:
    """Return the leak rate of T* V*³ = 1 on every surface in the unit of the study; 1 without a unit."""
    name = f"leak_rate_{axis}"
    if name not in run:
        return np.ones(leaks(run, axis).shape), ""
    starred = run[f"transmissivity_{axis}"] * run["free_volume"] ** 3
    return _over(run, run[name], starred, 3), str(run[name].attrs["units"])


def _over(run: Dataset, quantity: DataArray, starred: DataArray, power: int) -> Array:
    """Return a quantity over its starred number on every surface; it goes with that power of Sq."""
    per_height = (quantity / starred.where(starred > 0.0) / run["Sq"] ** power).mean("step")
    filled = per_height.fillna(per_height.mean())  # a surface that is closed at all steps
    return np.asarray((filled * run["Sq"] ** power).values, dtype=float).ravel()


def _way(fine: Dataset, coarser: Sequence[Dataset], levelled: Mapping[str, Dataset], axis: str) -> Way:
    values = leaks(fine, axis)
    factors, unit = unit_leaks(fine, axis)
    open_ = values > 0.0
    leak = _mean(values * factors)
    parts = []
    if open_.any():
        parts = [
            _solver(fine, axis),
            _grid([values, *(_compared(run, fine, axis) for run in coarser)]),
            _window(fine, values * factors, axis),
            *(_levelling(values, _compared(run, fine, axis), label) for label, run in levelled.items()),
        ]
    return Way(axis, leak, unit, _closing(fine, axis), tuple(parts))


def _mean(values: Array) -> float:
    """Return the geometric mean of the leaks of open surfaces; 0 if all are closed."""
    open_ = values[values > 0.0]
    return float(np.exp(np.log(open_).mean())) if open_.size else 0.0


def _solver(fine: Dataset, axis: str) -> Part:
    """Return the certified part: the flow falls where a gap falls, and every gap is right to η.

    The mean of several surfaces has the geometric mean of their factors.
    """
    bound = _bound(fine)
    words = f"certified: every gap is right to η/σ = {bound:.1e}"
    logs = []
    for surface in np.flatnonzero(leaks(fine, axis) > 0.0):
        gap, whole = _field(fine, int(surface))
        periodic = whole and "periodic" in fine.attrs
        flows = []
        for shift in (-bound, 0.0, bound):  # elements in contact may be open by η as well
            shifted = np.where(gap > 0.0, np.maximum(gap + shift, 0.0), max(shift, 0.0))
            through = conduction(shifted, AXES.index(axis), periodic=periodic).coefficient
            flows.append(through * shifted.mean() ** 3)
        low, middle, high = flows
        if not low > 0.0:
            return Part("solver", math.inf, f"{words}; the way may be closed")
        logs.append(math.log(max(high / middle, middle / low)))
    return Part("solver", math.exp(float(np.mean(logs))), words)


def _bound(fine: Dataset) -> float:
    """Return η/σ: the largest of the steps, and that to which a state between two steps is solved."""
    largest = float(fine["residual"].max())
    return max(largest, loads(str(fine.attrs["study"]), stored=True).solver.tolerance)


def _grid(values: Sequence[Array]) -> Part:
    """Return the part of the grid, from the leak at spacings in the ratio 1, 2, 4."""
    means = [np.log(_paired(values[0], other)) for other in values]
    if len(values) < 2:
        return Part("grid", math.nan, "too few nodes for a coarser grid")
    if not np.isfinite(means[1]).any():
        return Part("grid", math.nan, "no coarser grid with an open way")
    first = -float(np.nanmean(means[1]))
    if len(values) < 3 or not np.isfinite(means[2]).any():
        return Part("grid", math.exp(abs(first)), "change from twice the spacing")
    second = -float(np.nanmean(means[2])) - first
    ratio = abs(first / second) if second else math.inf
    words = f"twice the spacing: × {number(math.exp(-first))}, four times: × {number(math.exp(-first - second))}"
    if ratio < SHRINKS:  # the last change at least: two changes may cancel by chance
        left = abs(first) * max(1.0, ratio / (1.0 - ratio))
        return Part("grid", math.exp(left), f"{words}; extrapolated")
    return Part("grid", math.exp(abs(first)), f"{words}; does not converge, last change taken")


def _paired(one: Array, other: Array) -> Array:
    """Return other over one for the surfaces that are open in both, NaN elsewhere."""
    if one.shape != other.shape:
        return np.array([_mean(other) / _mean(one)]) if _mean(one) and _mean(other) else np.array([np.nan])
    both = (one > 0.0) & (other > 0.0)
    return np.divide(other, one, out=np.full(one.shape, np.nan), where=both)


def _window(fine: Dataset, values: Array, axis: str) -> Part:
    """Return the part of the window: surfaces among each other, or the quadrants of the only one."""
    open_ = np.log(values[values > 0.0])
    if open_.size > 1:
        half = stats.t.ppf(0.975, open_.size - 1) * open_.std(ddof=1) / math.sqrt(open_.size)
        closed = values.size - open_.size
        words = f"95 % interval of the mean over {open_.size} surfaces" + (f", {closed} closed" if closed else "")
        return Part("window", math.exp(float(half)), words)
    gap, _ = _field(fine, int(np.flatnonzero(values > 0.0)[0]))
    middle = [n // 2 for n in gap.shape]
    quadrants = [gap[rows, columns] for rows in _halves(middle[0]) for columns in _halves(middle[1])]
    flows = np.array([conduction(part, AXES.index(axis)).coefficient * part.mean() ** 3 for part in quadrants])
    logs = np.log(flows[flows > 0.0])
    if logs.size < 2:
        return Part("window", math.nan, f"{4 - logs.size} of 4 quadrants are closed: the map is too small")
    half = stats.t.ppf(0.975, logs.size - 1) * logs.std(ddof=1) / math.sqrt(logs.size)
    words = f"scatter of {logs.size} open quadrants of the map, 95 %"
    return Part("window", math.exp(float(half)), words)


def _halves(middle: int) -> tuple[slice, slice]:
    return slice(None, middle), slice(middle, None)


def _levelling(values: Array, other: Array, label: str) -> Part:
    ratio = _paired(values, other)
    if not np.isfinite(ratio).any():
        return Part("levelling", math.nan, f"with {label} the way is closed")
    change = float(np.nanmean(np.log(ratio)))
    return Part("levelling", math.exp(abs(change)), f"with {label}: × {number(math.exp(change))}")


def state_of(fine: Dataset, surface: int) -> Dataset:
    """Return the recorded state of one surface, by its place in `leaks`."""
    state = fine.isel(field_at=0, flux_at=0)
    cases = [dim for dim in ("D", "m", "seed", "case") if dim in state.dims]
    places = np.unravel_index(surface, [state.sizes[dim] for dim in cases])
    return state.isel(dict(zip(cases, map(int, places), strict=True)))


def _field(fine: Dataset, surface: int) -> tuple[Array, bool]:
    """Return the gap over σ of a surface at the recorded state, in the region, and whether that is the whole."""
    state = state_of(fine, surface)
    gap, flux = (state[name].transpose("x", "y").values for name in ("gap", "flux_x"))
    inside, solved = np.isfinite(flux), np.isfinite(gap)
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return gap[window], bool(inside[solved].all())


def _closing(fine: Dataset, axis: str) -> str:
    """Return between which pressures the last way along an axis closes."""
    name = "nominal_pressure" if "nominal_pressure" in fine else "mean_pressure"
    unit = str(fine[name].attrs.get("units", "1"))

    def words(load: float) -> str:
        return f"p* = {number(load)}" if unit == "1" else f"{number(load)} {unit}"

    first = fine.isel(step=fine["leg"].values == 1) if "leg" in fine else fine
    opens, closes = [], []
    case_dims = [dim for dim in ("D", "m", "seed", "case") if dim in first.dims]
    for _, surface in first[[name, f"percolates_{axis}"]].stack(all=case_dims).groupby("all"):
        p, way = surface[name].values.ravel(), surface[f"percolates_{axis}"].values.ravel() > 0.0
        last = int(np.flatnonzero(way)[-1]) if way.any() else -1
        opens.append(p[last] if last >= 0 else 0.0)
        closes.append(p[last + 1] if last + 1 < p.size else math.inf)
    closed = np.isfinite(closes)
    if not closed.any():
        return f"open up to {words(max(opens))}"
    low, high = (words(float(np.mean(np.array(ends)[closed]))) for ends in (opens, closes))
    between = f"between {low.removesuffix(f' {unit}')} and {high.removeprefix('p* = ')}"
    if closed.all():
        return between
    still = max(np.array(opens)[~closed])
    return f"{np.count_nonzero(closed)} of {closed.size} surfaces {between}, the others open up to {words(still)}"


def _gas_facts(fine: Dataset) -> list[tuple[str, str]]:
    """Return the leak of a gas at the state of the card, where one is recorded."""
    leaks, words = [], ""
    for axis in AXES:
        name, starred = f"gas_leak_rate_{axis}", f"flux_at_gas_transmissivity_{axis}"
        if name not in fine or starred not in fine:
            continue
        factors = _over(fine, fine[name], fine[f"gas_transmissivity_{axis}"] * fine["free_volume"] ** 3, 3)
        flows = (fine[starred] * fine["flux_at_free_volume"] ** 3).isel(flux_at=0).values.ravel()
        leaks.append(f"{axis} {number(_mean(flows * factors))}")
        words = f"{fine[name].attrs['units']} ({fine[name].attrs['gas']})"
    return [("Gas leak", f"{', '.join(leaks)} {words}")] if leaks else []


def _facts(fine: Dataset) -> list[tuple[str, str]]:
    """Return surface and load of the card in pairs of words."""
    state = fine.isel(flux_at=0)
    reached = np.isfinite(leaks(fine, "x"))
    unit = fine.attrs.get("length_unit", "")
    surface = str(fine["case"].values[0]) if "case" in fine.dims else f"{reached.size} generated surfaces"
    if not reached.all():
        surface += f", {np.count_nonzero(reached)} of them pressed to this load"
    pressures = state["flux_at_mean_pressure"].values.ravel()
    pressure = float(np.nanmean(pressures))
    facts = [("Surface", surface), ("Sq", f"{number(float(fine['Sq'].mean()))} {unit}".strip())]
    facts.append(("Sdq", number(float(fine["Sdq"].mean()))))
    load = f"p* = {number(pressure)}"
    if "nominal_pressure" in fine:
        nominal = float(np.nanmean(pressures * _over(fine, fine["nominal_pressure"], fine["mean_pressure"], 1)))
        load = f"{number(nominal)} {fine['nominal_pressure'].attrs['units']} ({load})"
    facts.append(("Load", load))
    facts.append(("Contact area A*", number(float(state["flux_at_contact_area_fraction"].mean()))))
    volume = float(state["flux_at_free_volume"].mean())
    facts += _gas_facts(fine)
    gap = f", {number(volume * float(fine['Sq'].mean()))} {unit}" if unit else ""
    facts.append(("Mean gap V*", f"{number(volume)} σ{gap}"))
    return facts
