"""The path of a sweep: the indentations of its legs, each from the state in which the leg before ends."""

from __future__ import annotations

import numpy as np

from roughvol.contact.bracket import Target
from roughvol.contact.loading import Compliance, Trials, sweep
from roughvol.contact.options import Options
from roughvol.contact.search import first_indentation, indentation_for, state_crossing, state_reaching
from roughvol.errors import ContactError
from roughvol.observables.levels import check_touch, end_of, options_of, places_of, starred, target_of
from roughvol.observables.reduction import Reduction
from roughvol.observables.regions import within
from roughvol.study import Case, Level, Sweep
from roughvol.surfaces import texture
from roughvol.surfaces.surface import Surface

RANGE = 1e3  # p* of the last step over that of the first, of steps in equal ratios


class Path:
    """The path of a sweep, which has the indentation of each step once the state before is known.

    On an endless surface indentations are the approach Δ'/σ. ``end`` is Δ/σ at the end of the leg begun last, ``plan``
    the Δ/σ of its steps, or p* of steps equal in pressure.
    """

    def __init__(self, case: Case, surface: Surface, half_space: Compliance) -> None:
        self._case, self._surface, self._half_space = case, surface, half_space
        self._options = options_of(case, surface)
        self._places = places_of(case)
        self.end, self.plan = 0.0, list[float]()

    def after(self, so_far: Reduction) -> float:
        """Return Δ/σ of the step after the states so far."""
        (number, place), legs = self._places[so_far.steps], self._case.sweep.legs
        leg = legs[number]
        if leg.listed is not None:
            return self._reaching(leg.listed[place], so_far)
        if place == 0:
            if number and legs[number - 1].listed is not None:
                self.end = so_far.states[-1]["indentation"]
            self._begin(leg, number, so_far)
        last = place == leg.steps - 1
        if last and self._case.plastic and leg.steps > 1 and not self._half_space.kernel.m_matrix:
            # what has yielded on the way may differ from what the search at the begin of the leg found
            self.end = self._reaching(leg.target, so_far)
            return self.end
        if leg.equal == "indentation":
            return self.plan[place]
        return self.end if last else self._reaching(Level("pressure", self.plan[place]), so_far)

    def _begin(self, leg: Sweep, number: int, so_far: Reduction) -> None:
        """Find the end of a leg that begins where the leg before ends, and plan its steps."""
        begin, self.end = self.end, self._reaching(leg.target, so_far)
        if self.end == begin:
            message = f"leg {number + 1} has no length: the leg before ends at Δ/σ = {begin:.6g}, its end, too"
            raise ContactError(message)
        if leg.equal == "indentation":
            self.plan = list((begin + (self.end - begin) * np.arange(1, leg.steps + 1) / leg.steps).tolist())
            return
        target, first = (starred(one, self._case, self._surface) for one in (leg.target, Level("pressure", leg.first)))
        high = target.value or 0.0
        if target.kind != "pressure":
            last = next(sweep(self._surface, self._half_space, [self.end], self._options, resume=so_far.states))
            high = float(within(last, self._case).mean_pressure)
        self.plan = _even(leg, so_far.mean_pressure, high, number, first.value)

    def _reaching(self, target: Level, so_far: Reduction) -> float:
        """Return Δ/σ at a state on the way from the last one."""
        case, surface, states = self._case, self._surface, so_far.states
        target = level_on(starred(target, case, surface), surface, plastic=case.plastic, first=not states)
        if not states and not case.plastic:
            return self.first(target)
        if not target.searched(endless=surface.endless):
            return _plane(target, surface)
        options, goal = self._options, target_of(target, case, surface)
        largest = options.hardness
        if target.kind == "pressure" and largest is not None and goal.value > largest:
            message = f"p* = {goal.value:.6g} is not reached: pressures end at the hardness, p* = {largest:.6g}"
            raise ContactError(message)
        if not states:
            return self._from_touch(target, goal)
        last, before = states[-1], states[-2]["indentation"] if len(states) > 1 else -np.inf
        trials = Trials(surface, self._half_space, options, after=last)
        start = trials.known(last, so_far.residual)
        begin, fell = goal.measure(start), last["indentation"] < before
        if begin == goal.value:
            end = target.label.removesuffix("-both")
            raise ContactError(f"the leg begins at Δ/σ = {start.approach:g}, where its end, {end}, is reached already")
        if target.kind in ("contact_area", "pressure") and goal.value > begin and not (case.plastic or fell):
            trials.least = start
            return state_reaching(trials, goal, [start], below=True).approach
        if (goal.value < begin) != fell or not self._half_space.kernel.m_matrix:
            trials = Trials(surface, self._half_space, options, after=last, turned=True)
            start = trials.known(last, so_far.residual)
        if target.kind.startswith("leak_rate"):
            _check_leak(target, goal, trials)
        return state_crossing(trials, goal, start).approach

    def first(self, target: Level) -> float:
        """Return Δ/σ at a state of elastic contact, from first touch."""
        case, surface, half_space = self._case, self._surface, self._half_space
        in_region = case.record.part is not None and target.kind in ("contact_area", "pressure", "free_volume")
        if in_region or target.kind.startswith("leak_rate"):
            return self._from_touch(target, target_of(target, case, surface))
        if target.kind == "free_volume":
            check_touch(target, case, surface, Trials(surface, half_space, self._options).untouched)
        solver = case.solver
        options = Options(min(solver.tolerance, solver.pressure_error or 1.0), solver.method)
        predicate = end_of(case, target)
        if predicate is not None:
            return first_indentation(surface, half_space, predicate, options)
        if not target.searched(endless=surface.endless):
            return _plane(target, surface)
        kind, value = target.kind, target.value or 0.0
        if kind in ("indentation", "separation"):
            kind, value = "free_volume", value if kind == "separation" else _plane(Level("separation", value), surface)
        return indentation_for(surface, half_space, kind, value, options)

    def _from_touch(self, target: Level, goal: Target) -> float:
        """Return Δ/σ at a state on the way from first touch; a target that lies before is refused."""
        trials = Trials(self._surface, self._half_space, self._options)
        if target.kind == "free_volume":
            check_touch(target, self._case, self._surface, trials.untouched)
        else:
            _check_leak(target, goal, trials)
        return state_crossing(trials, goal, trials.untouched).approach


def _check_leak(target: Level, goal: Target, trials: Trials) -> None:
    """Refuse a leak that no contact has."""
    if goal.reached(trials.untouched):
        message = f"{target.label} lies before the first touch; allowed: below the leak rate of the first touch"
        raise ContactError(message)


def last_indentation(case: Case, surface: Surface, half_space: Compliance) -> float:
    """Return Δ/σ at the end of the first leg: on a plane, at a value given, or where the search for one ends."""
    target = starred(case.sweep.legs[0].target, case, surface)
    return Path(case, surface, half_space).first(level_on(target, surface, first=True))


def _even(leg: Sweep, low: float, high: float, number: int, first: float | None) -> list[float]:
    """Return p* of the steps of a leg: equal differences, or equal ratios."""
    places = np.arange(1, leg.steps + 1) / leg.steps
    if leg.equal == "pressure":
        if low == high:
            raise ContactError(f"leg {number + 1} begins and ends at p* = {high:.6g}: no steps are equal in pressure")
        return list((low + (high - low) * places).tolist())
    if number == 0:
        low = first or high / RANGE
        places = np.arange(leg.steps) / max(leg.steps - 1, 1) if leg.steps > 1 else np.ones(1)
    if not (low > 0.0 and high > 0.0):
        raise ContactError(f"equal ratios from p* = {low:.6g} to {high:.6g} on leg {number + 1}; allowed: both > 0")
    if number == 0 and leg.steps > 1 and not low < high:
        raise ContactError(f"the first step is at p* = {low:.6g}; allowed: below that of the last, {high:.6g}")
    return list((low * (high / low) ** places).tolist())


def level_on(target: Level, surface: Surface, *, plastic: bool = False, first: bool = False) -> Level:
    """Return the level of a target on an endless surface, where no plane can pass the mean one unless it yields.

    Of the ``first`` state, a plane before first touch is refused on any surface.
    """
    if target.kind not in ("indentation", "separation", "mean-plane", "summit-plane"):
        return target
    indentation = _plane(target, surface)
    if first and not indentation > 0.0:
        message = f"a sweep to {target.label} would end at Δ/σ = {indentation:.6g}"
        raise ContactError(f"{message}; allowed: beyond first touch, Δ/σ > 0")
    if not surface.endless:
        return target
    if plastic:
        return Level("indentation", indentation)
    deepest = _plane(Level("mean-plane"), surface)
    if indentation > deepest * (1.0 + 1e-12):
        raise ContactError(
            f"a sweep to {target.label} would end at Δ/σ = {indentation:.6g}; allowed on a {surface.sides} surface: "
            f"up to {deepest:.6g}, full contact"
        )
    full = indentation >= deepest * (1.0 - 1e-12)
    return Level("contact_area", 1.0) if full else Level("indentation", indentation)


def _plane(target: Level, surface: Surface) -> float:
    """Return Δ/σ at an indentation, a separation or a plane of the virgin surface."""
    if target.kind == "indentation":
        return target.value or 0.0
    if target.kind == "summit-plane":
        return (surface.z_max - texture.summit_plane(surface.with_neighbours)) / surface.unit
    # d/σ = value; 0 on the mean plane
    return (surface.z_max - surface.mean_height) / surface.unit - (target.value or 0.0)
