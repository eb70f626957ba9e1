"""The leak of a surface over the load: read between the solved steps of a sweep, with the error of the reading.

Between two steps log(leak) is a monotone cubic in log(p). Its error is measured at solved steps: the two steps around a
load are read off without themselves; next to an end these are the nearest two inner steps. The error is the larger of
the two, and at least the distance of the cubic from the straight line. A step without itself lies in a gap twice as
wide, so the error is rather too large. No factor is tuned. The leak falls with the load, so it also lies between the
leaks of the two steps.

The error contains the true leak in 97 % of readings on random sweeps (``python -m tests.bench.read_off``,
docs/explanation/notes/intervals.md).

A way closes between its last open step and the next step, or at its solved closing load. Until then the leak lies
between 0 and that of the open step. Its value is on the straight line to 0, as in `at`.

A seal is made of its patches at each load, as in `at`: its leak is no curve through those of a few steps. It rises with
that of each patch. So it lies between two seals: all patches at the lower ends of their readings, and all at the upper
ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy
from xarray import Dataset

from roughvol.analysis.closing import Span, load_per_starred, solved_loads, span_of, spans
from roughvol.analysis.derived import groups
from roughvol.analysis.leak import with_closed
from roughvol.analysis.legs import first_leg
from roughvol.analysis.seal import ONE_LOAD, Patch, closing_of, conductance_of
from roughvol.analysis.units import sigma
from roughvol.observables.at_state import at_state
from roughvol.observables.variables import AXES, LISTED, SOLVED
from roughvol.store.variants import study_in
from roughvol.study import refused
from roughvol.study.values.state_kinds import REACHED
from roughvol.typing import Array

SEAL = "the seal"  # in the place of the name of a surface
PARTS = ("value", "low", "high")  # of the readings of patches
BISECTED = 1e-8  # logarithm of a load at which a seal has a leak
LEAST = 1e-300  # leak in the place of 0
ENDLESS = 1e150  # load in the place of infinity


@dataclass(frozen=True)
class Reading:
    """Leaks at loads in the unit of the study, 0 from the first closed step on, each with the interval of its reading.

    The interval is NaN before the first step, and beyond the last step of an open way.
    """

    value: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class LoadReading:
    """A load, and the loads between which it lies; infinite beyond the last step, 0 below the first one."""

    value: float
    low: float
    high: float
    closing: bool = False  # the way closes inside

    @classmethod
    def of(cls, span: Span) -> LoadReading:
        """Return the load at which a way closes: that of the first closed step, 0 without an open step.

        A way that closes nowhere is open at its last step, also of an unloaded region.
        """
        is_open = span.open_up_to > 0.0 or not span.closes
        return cls(span.closed_from if is_open else 0.0, span.open_up_to, span.closed_from, is_open and span.closes)


@dataclass(frozen=True, eq=False)
class Curve:
    """The leak of one surface, by its file or seed, along the first leg of a sweep: arrays over the steps.

    The nominal pressure rises, the leak is 0 where closed, ``starred`` is p*. Pressure, leak and ``Sq`` have the units
    of the study. ``of_seal`` returns the leaks of a seal at pressures, with one part of the readings of its patches.
    """

    surface: str
    pressure: Array
    leak: Array
    starred: Array
    Sq: float
    of_seal: Callable[[Array, str], Array] | None = None

    @cached_property
    def closing(self) -> Span:
        """Nominal pressures between which the last way closes."""
        span = span_of(self.leak, self.pressure)
        assert span is not None
        return span

    @property
    def begins(self) -> float:
        """Nominal pressure of the first step."""
        return float(self.pressure[0])

    @property
    def ends(self) -> float:
        """Largest nominal pressure with a known leak: infinite for a surface that is closed at its last step."""
        return math.inf if self.closing.closes else float(self.pressure[-1])

    def at(self, pressures: Array) -> Reading:
        """Return the leaks and their intervals at nominal pressures > 0 in the unit of the study."""
        if self.of_seal is not None:
            value, low, high = (self.of_seal(pressures, part) for part in PARTS)
            value[pressures >= self.closing.closed_from * (1.0 - REACHED)] = 0.0
            return Reading(value, np.fmin(low, value), np.fmax(high, value))
        logs = np.log(pressures)
        value, low, high = (np.full(len(logs), np.nan) for _ in range(3))
        open_up_to, closed_from = self.closing.open_up_to, self.closing.closed_from
        if open_up_to > 0.0:
            between = (logs > math.log(open_up_to)) & (pressures < closed_from)
            if self.closing.closes:
                last = self.leak[self.leak > 0.0][-1]
                share = (closed_from - pressures[between]) / (closed_from - open_up_to)
                value[between], low[between], high[between] = share * last, 0.0, last
            cubic, error, ends = self._read(logs)
            known = np.isfinite(cubic)
            value[known] = np.exp(cubic[known])
            low[known] = np.maximum(np.exp(cubic[known] - error[known]), ends.min(axis=0)[known])
            high[known] = np.minimum(np.exp(cubic[known] + error[known]), ends.max(axis=0)[known])
        for array in (value, low, high):
            array[pressures >= closed_from * (1.0 - REACHED)] = 0.0
        return Reading(value, low, high)

    def load_where(self, log_wanted: Callable[[Array], Array]) -> LoadReading:
        """Return the nominal pressure from which the leak is at most a value, or at a closing the first closed step.

        ``log_wanted`` returns the log of the value at logarithms of nominal pressures; it does not fall.
        """
        if self.of_seal is not None:
            value, low, high = (self._load_of_seal(log_wanted, part) for part in PARTS)
            if closes := self.closing.closed_from * (1.0 - 2.0 * REACHED) <= value < math.inf:
                value = self.closing.closed_from
            low = min(low, value, float(self.pressure[-1]))  # more is not known of a load beyond the last step
            return LoadReading(value, low, max(high, value, self.begins), closes)
        x, y = self._logs
        above = np.flatnonzero(y > log_wanted(x) + REACHED)  # a step that misses the value by less has it
        if not above.size:
            return LoadReading(0.0, 0.0, self.begins)
        k = int(above[-1])
        if k == x.size - 1:
            return LoadReading.of(self.closing)

        def crossing(shift: float) -> float:
            """Return where the cubic, moved by an error, has the value; an end of the step if it is beyond."""

            def excess(log: float) -> float:
                here = np.array([log])
                return float(self._read(here)[0][0] + shift - log_wanted(here)[0])

            if excess(x[k]) <= 0.0:
                return float(x[k])
            if excess(x[k + 1]) >= -REACHED:
                return float(x[k + 1])
            return float(scipy.optimize.brentq(excess, x[k], x[k + 1], xtol=1e-14, rtol=1e-14))

        found = crossing(0.0)
        error = float(self._read(np.array([found]))[1][0])
        return LoadReading(math.exp(found), math.exp(crossing(-error)), math.exp(crossing(error)))

    def _load_of_seal(self, log_wanted: Callable[[Array], Array], part: str) -> float:
        """Return the load from which on a seal leaks at most a value, with one part of the readings of its patches.

        The load is 0 if the seal leaks less at the first step, infinite if it leaks more at the last one.
        """

        def excess(log: float) -> float:
            assert self.of_seal is not None
            leak = float(self.of_seal(np.exp([log]), part)[0])
            return math.log(max(leak, LEAST)) - float(log_wanted(np.array([log]))[0])

        first, last = (math.log(self.pressure[k]) for k in (0, -1))
        if excess(first) <= REACHED:  # a step that misses the value by less has it
            return 0.0
        if (at_last := excess(last)) > 0.0:
            return math.inf if at_last > REACHED else math.exp(last)
        return math.exp(float(scipy.optimize.brentq(excess, first, last, xtol=BISECTED)))

    @cached_property
    def _logs(self) -> tuple[Array, Array]:
        """Logarithms of pressure and leak at the open steps."""
        open_ = self.leak > 0.0
        return np.log(self.pressure[open_]), np.log(self.leak[open_])

    @cached_property
    def _without_itself(self) -> Array:
        """Error of log(leak) at each inner open step, read off without the step."""
        x, y = self._logs
        inner = range(1, x.size - 1)
        return np.array([abs(at_state(np.delete(x, k), np.delete(y, k), x[k])[0] - y[k]) for k in inner])

    def _read(self, logs: Array) -> tuple[Array, Array, Array]:
        """Return log(leak) and its error at logarithms of pressures, NaN outside the steps, and leaks of both steps."""
        x, y = self._logs
        k = np.clip(np.searchsorted(x, logs) - 1, 0, max(x.size - 2, 0))
        on_step = [(k + side, abs(logs - x[np.minimum(k + side, x.size - 1)]) <= REACHED) for side in (0, 1)]
        cubic = at_state(x, y, logs)
        error = np.full(len(logs), math.inf)  # two steps: the leak lies between them
        if x.size > 2:
            first = np.clip(k, 1, max(x.size - 3, 1))
            second = np.minimum(first + 1, x.size - 2)
            measured = np.maximum(self._without_itself[first - 1], self._without_itself[second - 1])
            error = np.maximum(measured, np.abs(cubic - at_state(x, y, logs, straight=True)))
        for step, there in on_step:
            cubic[there], error[there] = y[np.minimum(step, x.size - 1)[there]], 0.0
        return cubic, error, np.exp(np.stack([y[k], y[np.minimum(k + 1, x.size - 1)]]))


def axes(run: Dataset) -> tuple[str, ...]:
    """Return the axes along which a run leaks: that of the seal of its study, or both."""
    patch = patch_of(run)
    return AXES if patch is None else (patch.seal.flow,)


def patch_of(run: Dataset) -> Patch | None:
    """Return the patch of a seal that a run observes; None for a study without a seal."""
    return Patch.of(study_in(run), run)


def closings(run: Dataset, axis: str, load: str) -> list[tuple[str, Span, Dataset]]:
    """Return where the last way of each surface closes, and the surface; of a seal, where the seal closes.

    The run has surfaces of one kind with the ways of `derived.derived`; the load is a variable of it. A `StudyError`
    refuses a surface whose ways are not known.
    """
    tables, patch = surfaces(run), patch_of(run)
    found = {
        way: [(name, span, table) for name, table in tables for span in spans(table.expand_dims("seed"), way, load)]
        for way in (AXES if patch is not None else [axis])
    }
    _check_known(tables, {way: [name for name, _, _ in each] for way, each in found.items()}, "way")
    own = found[axis]
    if patch is None:
        return own
    loads = [[(span.open_up_to, span.closed_from) for _, span, _ in found[way]] for way in patch.axes]
    span = Span(*(_sheet_closes(tables, patch, end) for end in np.transpose(loads)))
    table = own[_farthest([table[load].values for _, _, table in own])][2]
    Sq = table["Sq"].copy(data=np.mean([table["Sq"] for _, table in tables]))
    return [(SEAL, span, table.assign(Sq=Sq))]


def _farthest(loads: Sequence[Array]) -> int:
    """Return the number of the surface that is pressed farthest, from the loads of its steps.

    Of several that are pressed to one load it is that of the lightest steps: their ends differ by the searches alone.
    """
    ends = [float(np.nanmax(steps)) for steps in loads]
    farthest = (k for k, end in enumerate(ends) if end >= max(ends) * (1.0 - ONE_LOAD))
    return min(farthest, key=lambda k: float(np.nanmean(loads[k])))


def _sheet_closes(tables: list[tuple[str, Dataset]], patch: Patch, loads: Array) -> float:
    """Return the load at which a seal closes, from those of its patches (surfaces, along and across).

    Infinite if the seal stays open.
    """
    isotropic = patch.is_isotropic([table for _, table in tables])
    closes = closing_of(np.fmin(loads, ENDLESS)[:, np.newaxis], patch.patches, isotropic=isotropic).value
    return closes if closes < ENDLESS else math.inf


def curves(run: Dataset) -> dict[str, list[Curve]]:
    """Return the leak of each surface along the first leg by axis, at the steps with a leak; of a seal, of the seal.

    A `StudyError` refuses a surface without a known leak, and surfaces of a seal without a common load of known leaks.
    """
    patch, tables = patch_of(run), surfaces(run)
    found = {axis: _of_surfaces(tables, axis) for axis in axes(run)}
    _check_known(tables, {axis: [curve.surface for curve in each] for axis, each in found.items()}, "leak")
    return found if patch is None else {patch.seal.flow: [_of_seal(run, tables, patch)]}


def _check_known(tables: list[tuple[str, Dataset]], found: Mapping[str, list[str]], what: str) -> None:
    """Refuse surfaces of which nothing is known along an axis."""
    for axis, known in found.items():
        if missing := [name for name, _ in tables if name not in known]:
            of = f" of {', '.join(missing)}" if known else ""
            raise refused(f"the run has no stored {what}{of} along {axis}; record the flow at every step")


def _of_surfaces(tables: list[tuple[str, Dataset]], axis: str) -> list[Curve]:
    """Return the leak of each surface, 0 where its way is closed; a solved closing load is a closed step."""
    made = []
    for name, surface in tables:
        pressure, starred = (surface[key].values for key in ("nominal_pressure", "mean_pressure"))
        leak = with_closed(surface["leak_rate"], surface).sel(axis=axis).values
        if SOLVED in surface and np.isfinite(leak).any():
            end = float(surface[SOLVED].sel(axis=axis))
            pressure = np.append(pressure, end * load_per_starred(pressure, starred))
            starred, leak = np.append(starred, end), np.append(leak, 0.0)
        kept = np.flatnonzero(np.isfinite(leak) & (starred > 0.0))
        order = kept[np.argsort(pressure[kept], kind="stable")]
        if order.size:
            made.append(Curve(name, pressure[order], leak[order], starred[order], float(sigma(surface))))
    return made


def _of_seal(run: Dataset, tables: list[tuple[str, Dataset]], patch: Patch) -> Curve:
    """Return the leak of a seal over the nominal pressure, at the steps of one surface within the sweeps of all.

    The ends are the largest first load and the smallest last load of the surfaces. Each leak is the median over sheets
    of patches at its load. The same patches are drawn at all loads.
    """
    ways = {axis: _of_surfaces(tables, axis) for axis in AXES}
    each = [curve for some in ways.values() for curve in some]
    low, high = max(curve.begins for curve in each), min(curve.ends for curve in each)
    if low > high * (1.0 + REACHED):
        unit = run["nominal_pressure"].attrs["units"]
        message = f"the leaks of all surfaces are known from {low:.4g} {unit}, and up to {high:.4g} {unit}"
        raise refused(f"{message}: a seal needs one load; record the flow at every step")
    along_flow = ways[patch.seal.flow]
    longest = along_flow[_farthest([curve.pressure for curve in along_flow])]
    kept = (longest.pressure >= low * (1.0 - REACHED)) & (longest.pressure <= high * (1.0 + REACHED))
    steps = longest.pressure[kept]
    inner = steps[(steps > low * (1.0 + REACHED)) & (steps < high * (1.0 - REACHED))]
    at_steps = np.array([low, *inner, *([high] if low < high < math.inf else [])])
    isotropic = patch.is_isotropic([table for _, table in tables])
    end = math.inf
    if SOLVED in run:
        each_alone = [table.expand_dims("seed") for _, table in tables]
        loads = [[solved_loads(table, axis, "nominal_pressure")[0] for axis in patch.axes] for table in each_alone]
        end = _sheet_closes(tables, patch, np.array(loads))
    if end <= high and math.isfinite(end):  # a solved closing load is a closed step
        at_steps = np.append(at_steps[at_steps < end * (1.0 - REACHED)], max(end, low))
    starred = longest.starred[-1] / longest.pressure[-1]
    Sq = float(np.mean([curve.Sq for curve in along_flow]))
    of_each = patch.of_each([table for _, table in tables])

    def leaks(pressures: Array, part: str) -> Array:
        """Return the leaks of the seal, 0 where closed; NaN before the first load and beyond the last one."""
        readings = [[getattr(curve.at(pressures), part) for curve in ways[axis]] for axis in AXES]
        values = of_each.conductances(np.transpose(readings), in_units=True)
        sheet = partial(conductance_of, patches=patch.patches, isotropic=isotropic, draws=patch.draws_of_many)
        found = [sheet(some[:, np.newaxis]).value if np.isfinite(some).all() else math.nan for some in values]
        return np.where(pressures < end * (1.0 - REACHED), found, 0.0) * patch.squares

    return Curve(SEAL, at_steps, leaks(at_steps, "value"), at_steps * starred, Sq, leaks)


def surfaces(run: Dataset) -> list[tuple[str, Dataset]]:
    """Return the surfaces of a run at one D, one m and one value of each list, by file or seed, along the first leg."""
    table = run.squeeze([name for name in LISTED if name in run.dims])
    found = []
    for label, group in groups(first_leg(table)):
        for place in range(group.sizes["seed"]):
            name = label if "case" in run.dims else f"seed {int(group['seed'][place])}"
            found.append((name, group.isel(seed=place).drop_vars("seed", errors="ignore")))
    return found
