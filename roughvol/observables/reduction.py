"""Reduction of a sweep: each state becomes stored numbers at once, and fields at the states that a study names.

Numbers are those of the region of the study, as if it were cut out of the loaded surface, over the Sq of the whole
surface. The heights, the fields of gap and pressure, Sq and the separation are those of the whole surface.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from roughvol.contact.loading import Compliance, Contact
from roughvol.observables.levels import Between, at_level, before_touch, closing, is_defined, on_legs, reached
from roughvol.observables.own import register
from roughvol.observables.regions import Values, View, within
from roughvol.observables.requests import asked, fields_of, value_of
from roughvol.observables.variables import AXES, OBSERVABLES, OF_STATE, OF_YIELD, SOLVED, VARIABLES, function
from roughvol.study import Case, Legs, Level
from roughvol.surfaces import texture
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array

OF_SOLVER = ("iterations", "convolutions", "convolutions_fp32", "residual", "mean_pressure_bound", "converged")
CONTENT = ("steps", "_values", "_kept", "_seconds", "_convolutions", "_pressures")
"""Attributes that make up a reduction, beside its last two states."""


def of_state(case: Case) -> tuple[str, ...]:
    """Return the numbers that every state has, between two steps as well."""
    return (*OF_STATE, *OF_YIELD) if case.plastic else OF_STATE


def numbers(view: View) -> Values:
    """Return the numbers of every step."""
    return {name: getattr(view.state, name) for name in (*of_state(view.case), *OF_SOLVER)}


def of_surface(case: Case, surface: Surface) -> Values:
    """Return the numbers of the undeformed surface, its heights and texture if asked for, and the labels of nodes."""
    heights, spacing = surface.heights, surface.spacing
    values: Values = {"Sq": surface.Sq, "Sdq": texture.Sdq(surface.with_neighbours, spacing), "z_max": surface.z_max}
    values["hurst_measured"] = texture.hurst_spectrum(heights, periodic=surface.periodic)
    rows, columns = surface.shape
    values |= {"nodes_x": rows, "nodes_y": columns}
    if fields_of(case.record) > 0:
        values |= {"x": np.arange(rows) / surface.intervals[0], "y": np.arange(columns) / surface.intervals[0]}
    if case.record.heights:
        values["heights"] = heights
    for row in OBSERVABLES.values():
        if row.before and value_of(case.record, row.key.partition(".")[0]) is not None:
            values |= function(row.before)(case, surface)
    return values


class Reduction:
    """The values recorded of a sweep so far; it takes in the states one by one."""

    def __init__(self, case: Case, surface: Surface, half_space: Compliance) -> None:
        register(case.record)
        self._case, self._surface, self._half_space = case, surface, half_space
        self.steps = 0  # states taken in
        self.states: list[Mapping[str, Any]] = []  # the last two, as `Contact.state` returns them
        levels = {name: some and on_legs(some, case, surface) for name, some in asked(case.record).items()}
        self._along = {name: by for name, by in levels.items() if not OBSERVABLES[name].dim}
        self._at = {name: by or {} for name, by in levels.items() if OBSERVABLES[name].dim}
        every = {level for by in self._at.values() for level in by.values()}
        self._never = before_touch(every, case, surface, half_space)
        self._values: Values = {}
        self._kept: dict[str, dict[str, tuple[int, Values]]] = {name: {} for name in levels}  # by label; once reached
        self._seconds = {name: 0.0 for name in levels if OBSERVABLES[name].seconds}
        self._convolutions = 0.0
        # Of the fluid at the last state. A resumed case has them as well.
        self._pressures: dict[str, Array] = {}

    @property
    def mean_pressure(self) -> float:
        """Pressure p* of the last state taken in, in the region of the study; 0 before any."""
        return self._last("mean_pressure")

    @property
    def residual(self) -> float:
        """Residual η/σ of the last state taken in; 0 before any."""
        return self._last("residual")

    def _last(self, name: str) -> float:
        return float(self._values[name][self.steps - 1]) if self.steps else 0.0

    def follow(self, whole: Contact) -> None:
        """Take in the next state."""
        step, before = self.steps + 1, {name: self._last(name) for name in OF_STATE} if self.steps else None
        view = self._view(whole)
        void = self._of_void()

        def first(name: str, label: str, level: Level) -> bool:
            """Return whether this state is the first to reach a level."""
            return label not in self._kept[name] and reached(level, step, view.state, self._case, self._surface, before)

        for name, levels in self._along.items():
            hit = [label for label, level in (levels or {}).items() if first(name, label, level)]
            if levels is None or hit:
                self._kept[name] |= dict.fromkeys(hit, (step, {}))
                self._store(step, self._taken(name, view))
        if (spent := self._of_void() - void) > 0.0:
            self._store(step, {"transport_time": spent})
        wanted: dict[Level, list[tuple[str, str]]] = {}
        for name, by_label in self._at.items():
            for label, level in by_label.items():
                if level not in self._never and first(name, label, level):
                    wanted.setdefault(level, []).append((name, label))
        for level, places in wanted.items():
            there = self._view(self._solved(level, step, whole))
            for name, label in places:
                dim = OBSERVABLES[name].dim
                own = {f"{dim}_{number}": getattr(there.state, number) for number in of_state(self._case)}
                self._kept[name][label] = step, own | self._taken(name, there)
        if value_of(self._case.record, "transport.closing") and step <= self._case.sweep.legs[0].steps:
            self._close(step, whole)
        self.steps, self.states = step, [*self.states, whole.state()][-2:]

    def _view(self, whole: Contact) -> View:
        return View(self._case, self._surface, whole, self._half_space, self._pressures)

    def _taken(self, name: str, view: View) -> Values:
        """Return the values of an observable, and count its seconds."""
        started = time.perf_counter()
        values = function(OBSERVABLES[name].of_state)(view)
        if name in self._seconds:
            self._seconds[name] += time.perf_counter() - started
        return values

    def _of_void(self) -> float:
        """Return the seconds spent on the void."""
        return sum(taken for name, taken in self._seconds.items() if OBSERVABLES[name].key.startswith("transport."))

    def _store(self, step: int, values: Values) -> None:
        """Store values along the steps, NaN where nothing is taken, or as they are where their row has no step."""
        for name, value in values.items():
            if " step" in VARIABLES[name].dims:
                absent = np.full((self._case.sweep.steps, *np.shape(value)), np.nan)
                self._values.setdefault(name, absent)[step - 1] = value
            else:
                self._values[name] = value

    def _solved(self, level: Level, step: int, whole: Contact) -> Contact:
        """Return the state at a level between this step and the step before."""
        if level.value is None or level.kind == "step" or is_defined(level, step, self._case, self._surface):
            return whole
        with self._counted():
            return at_level(level, self._between(whole))

    def _close(self, step: int, whole: Contact) -> None:
        """Store the load at which the last way along each axis closes, once it is known."""
        loads = self._values.setdefault(SOLVED, np.full(len(AXES), np.nan))
        for axis in np.flatnonzero(np.isnan(loads)):
            with self._counted():
                state = closing(AXES[axis], step, self._between(whole))
            if state is not None:
                loads[axis] = within(state, self._case).mean_pressure

    def _between(self, whole: Contact) -> Between:
        return Between(self._case, self._surface, self._half_space, self.states, self.residual, whole)

    @contextmanager
    def _counted(self) -> Iterator[None]:
        """Count the convolutions of states between two steps."""
        half_space = self._half_space
        before = half_space.convolutions + half_space.convolutions_fp32
        yield
        self._convolutions += half_space.convolutions + half_space.convolutions_fp32 - before

    def values(self) -> Values:
        """Return the values by stored name."""
        sweep = self._case.sweep
        values: Values = {**self._values, "step": np.arange(1, sweep.steps + 1)}
        if isinstance(sweep, Legs):
            values["leg"] = np.repeat(np.arange(1, len(sweep.legs) + 1), [leg.steps for leg in sweep.legs])
        if self._seconds:
            values |= {"observable": list(self._seconds), "observable_time": list(self._seconds.values())}
        for labels in dict.fromkeys(OBSERVABLES[name].labels for name in (*self._along, *self._at)):
            values |= function(labels)(self._case, self._surface) if labels else {}
        for name, by_label in self._at.items():
            kept, dim = self._kept[name], OBSERVABLES[name].dim
            values[dim] = list(by_label)
            values[f"{dim}_step"] = [kept[label][0] if label in kept else -1 for label in by_label]
            values |= {f"{dim}_{number}": np.full(len(by_label), np.nan) for number in of_state(self._case)}
            values |= _stacked(list(by_label), {label: arrays for label, (_, arrays) in kept.items()})
        if self._at:
            values["level_convolutions"] = self._convolutions
        if any(" axis" in VARIABLES[name].dims for name in values):
            values["axis"] = list(AXES)
        return values

    def state(self) -> Values:
        """Return the content without the last two states, as plain data and arrays, for `restore`."""
        return {name: getattr(self, name) for name in CONTENT}

    def restore(self, state: Values, states: list[Mapping[str, Any]]) -> None:
        """Take the content of another reduction, from its `state` and `states`."""
        for name in CONTENT:
            setattr(self, name, state[name])
        self.states = list(states)


def _stacked(labels: list[str], kept: Mapping[str, Values]) -> Values:
    """Return the arrays of all states along a new first axis, NaN where a state was not reached."""
    stacked: Values = {}
    for name, example in next(iter(kept.values()), {}).items():
        absent = np.full(np.shape(example), np.nan)
        arrays = [kept[label][name] if label in kept else absent for label in labels]
        stacked[name] = np.stack([np.asarray(array, dtype=float) for array in arrays])
    return stacked
