"""Reduction of a sweep: each state becomes stored numbers at once, and fields at the states that a study names.

Numbers of a contact are those of the region of the study, as if it were cut out of the loaded surface. The heights, the
fields of gap and pressure, Sq and the separation are those of the whole surface. Lengths are over that Sq.

Every function returns a mapping from names of `variables.VARIABLES` to arrays, without the dimensions of the case.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from roughvol.contact.loading import Compliance, Contact
from roughvol.gap.perimeter import contact_perimeter
from roughvol.observables import deformed, plastic, waves
from roughvol.observables.along_steps import AlongSteps
from roughvol.observables.levels import at_level, is_end, on_legs, reached
from roughvol.observables.pressures import above, central_pressure_ratio
from roughvol.observables.recorded import AT_STATES, asked_at_states, fields_of
from roughvol.observables.regions import State, within
from roughvol.observables.variables import OF_STATE
from roughvol.study import Case, Legs, Level
from roughvol.surfaces import texture
from roughvol.surfaces.surface import Surface

Values = dict[str, Any]

PER_STEP = (
    "indentation",
    "separation",
    "contact_area_fraction",
    "mean_pressure",
    "free_volume",
    "iterations",
    "convolutions",
    "convolutions_fp32",
    "residual",
    "mean_pressure_bound",
    "converged",
)
PLASTIC = ("plastic_volume", "plastic_area_fraction")
ABOVE_HARDNESS = ("contact_above_hardness_fraction", "load_above_hardness_fraction")


def of_surface(case: Case, surface: Surface) -> Values:
    """Return the numbers of the undeformed surface, its heights and texture if asked for, and the labels of nodes.

    Parameters
    ----------
    case : Case
        Names what to record.
    surface : Surface
        The undeformed surface.

    Returns
    -------
    dict
        Values by stored name.
    """
    heights, spacing = surface.heights, surface.spacing
    values: Values = {"Sq": surface.Sq, "Sdq": texture.Sdq(surface.with_neighbours, spacing), "z_max": surface.z_max}
    values["hurst_measured"] = texture.hurst_spectrum(heights, spacing, periodic=surface.periodic)
    rows, columns = surface.shape
    values |= {"nodes_x": rows, "nodes_y": columns}
    if fields_of(case.record) > 0:
        values |= {"x": np.arange(rows) / surface.intervals[0], "y": np.arange(columns) / surface.intervals[0]}
    if case.record.heights:
        values["heights"] = heights
    if case.record.texture is not None:
        values |= deformed.before_load(case, surface)
    if case.record.psd is not None:
        values |= waves.before_load(case, surface)
    return values


def of_sweep(
    case: Case,
    surface: Surface,
    half_space: Compliance,
    contacts: Iterable[Contact],
    on_step: Callable[[int], None] | None = None,
) -> Values:
    """Return the numbers of every step, and the observables of the states that a study selects.

    Parameters
    ----------
    case : Case
        Names the states and what to record of them.
    surface : Surface
        The surface pressed.
    half_space : Compliance
        On which the states at levels between two steps are solved.
    contacts : iterable of Contact
        The states in the order of the sweep; none is held longer than its turn.
    on_step : callable, optional
        Called with the number of each step that has been reduced.

    Returns
    -------
    dict
        Values by stored name.
    """
    reduction = Reduction(case, surface, half_space)
    for step, contact in enumerate(contacts, start=1):
        reduction.follow(contact)
        if on_step is not None:
            on_step(step)
    return reduction.values()


class Reduction:
    """The values recorded of a sweep so far; it takes in the states one by one."""

    def __init__(self, case: Case, surface: Surface, half_space: Compliance) -> None:
        self._case, self._surface = case, surface
        self._per_step: dict[str, list[Any]] = {name: [] for name in PER_STEP}
        self._hardness = None if case.plastic else plastic.starred_hardness(case, surface)
        if self._hardness is not None:
            self._per_step |= {name: [] for name in ABOVE_HARDNESS}
        if case.plastic:
            self._per_step |= {name: [] for name in PLASTIC}
        if case.record.contact_perimeter:
            self._per_step["contact_perimeter"] = []
        self._levels = {name: on_legs(by_label, case) for name, by_label in asked_at_states(case.record).items()}
        self._kept: dict[str, dict[str, tuple[int, Values]]] = {name: {} for name in self._levels}
        self._along = AlongSteps(case, surface)
        self._seconds = dict.fromkeys(self._levels, 0.0)
        self._half_space, self._convolutions = half_space, 0.0
        self._states: list[Mapping[str, Any]] = []

    @property
    def steps(self) -> int:
        """Number of states taken in."""
        return len(self._per_step["indentation"])

    @property
    def states(self) -> list[Mapping[str, Any]]:
        """The last two states, as `Contact.state` returns them."""
        return self._states

    @property
    def mean_pressure(self) -> float:
        """Pressure p* of the last state taken in, in the region of the study; 0 before any."""
        return float(self._per_step["mean_pressure"][-1]) if self._states else 0.0

    @property
    def residual(self) -> float:
        """Residual η/σ of the last state taken in; 0 before any."""
        return self._per_step["residual"][-1] if self._states else 0.0

    def follow(self, whole: Contact) -> None:
        """Take in the next state."""
        contact, step = within(whole, self._case), self.steps + 1
        self._along.follow(step, contact, whole, self._before)
        for level, wanted in self._reached(step, contact).items():
            state = within(self._at(level, step, whole), self._case)
            for observable, label in wanted:
                started, row = time.perf_counter(), AT_STATES[observable]
                solver = (self._half_space,) if row.solves else ()
                own = {f"{row.dim}_{name}": getattr(state, name) for name in OF_STATE}
                self._kept[observable][label] = step, own | row.of_state(self._case, self._surface, state, *solver)
                self._seconds[observable] += time.perf_counter() - started
        for name in (*PER_STEP, *(PLASTIC if self._case.plastic else ())):
            self._per_step[name].append(getattr(contact, name))
        if self._case.record.contact_perimeter:
            self._per_step["contact_perimeter"].append(contact_perimeter(contact.contact(), contact.periodic))
        if self._hardness is not None:
            for name, share in zip(ABOVE_HARDNESS, above(contact.pressure(), self._hardness), strict=True):
                self._per_step[name].append(share)
        if step == self._case.sweep.steps and min(whole.shape) > 3:  # 3 nodes have one in the middle
            self._along.values["central_pressure_ratio"] = central_pressure_ratio(whole)
        if step == self._case.sweep.steps and self._case.plastic:
            self._along.values |= plastic.residual(self._case, self._surface, whole)
        self._states = [*self._states, whole.state()][-2:]

    @property
    def _before(self) -> dict[str, float] | None:
        """The numbers of the last state taken in, None before any."""
        if not self._per_step["indentation"]:
            return None
        return {name: float(self._per_step[name][-1]) for name in OF_STATE}

    def _reached(self, step: int, contact: State) -> dict[Level, list[tuple[str, str]]]:
        """Return the levels that this state is the first to reach, each with its observables and labels."""
        hits: dict[Level, list[tuple[str, str]]] = {}
        for name, by_label in self._levels.items():
            for label, level in by_label.items():
                if label not in self._kept[name] and (
                    level in hits or reached(level, step, contact, self._case, self._before)
                ):
                    hits.setdefault(level, []).append((name, label))
        return hits

    def _at(self, level: Level, step: int, whole: Contact) -> Contact:
        """Return the state at a level between this step and the one before."""
        if level.value is None or level.kind == "step" or is_end(level, step, self._case):
            return whole
        half_space = self._half_space
        before = half_space.convolutions + half_space.convolutions_fp32
        state = at_level(level, self._case, self._surface, half_space, self._states, self.residual, whole)
        self._convolutions += half_space.convolutions + half_space.convolutions_fp32 - before
        return state

    def values(self) -> Values:
        """Return the values by stored name."""
        sweep = self._case.sweep
        values: Values = {**self._per_step, **self._along.values, "step": np.arange(1, self._case.sweep.steps + 1)}
        if isinstance(sweep, Legs):
            values["leg"] = np.repeat(np.arange(1, len(sweep.legs) + 1), [leg.steps for leg in sweep.legs])
        if seconds := {**self._along.seconds, **self._seconds}:
            values |= {"observable": list(seconds), "observable_time": list(seconds.values())}
        for name, by_label in self._levels.items():
            kept, dim = self._kept[name], AT_STATES[name].dim
            values |= AT_STATES[name].labels(self._case, self._surface)
            values[dim] = list(by_label)
            values[f"{dim}_step"] = [kept[label][0] if label in kept else -1 for label in by_label]
            values |= {f"{dim}_{number}": np.full(len(by_label), np.nan) for number in OF_STATE}
            values |= _stacked(list(by_label), {label: arrays for label, (_, arrays) in kept.items()})
        if self._levels:
            values["level_convolutions"] = self._convolutions
        return values

    def state(self) -> Values:
        """Return the content without the last two states, as plain data and arrays, for `restore`."""
        held = {"per_step": self._per_step, "kept": self._kept, "seconds": self._seconds}
        return {**held, "level_convolutions": self._convolutions, **self._along.state()}

    def restore(self, state: Values, states: list[Mapping[str, Any]]) -> None:
        """Take the content of another reduction, from its `state` and `states`."""
        self._per_step = state["per_step"]
        self._kept = {
            name: {label: (step, values) for label, (step, values) in by_label.items()}
            for name, by_label in state["kept"].items()
        }
        self._seconds, self._convolutions = state["seconds"], state["level_convolutions"]
        self._states = list(states)
        self._along.restore(state)


def _stacked(labels: list[str], kept: Mapping[str, Values]) -> Values:
    """Return the arrays of all states along a new first axis, NaN where one was not reached; empty if none was."""
    stacked: Values = {}
    for name, example in next(iter(kept.values()), {}).items():
        absent = np.full(np.shape(example), np.nan)
        arrays = [kept[label][name] if label in kept else absent for label in labels]
        stacked[name] = np.stack([np.asarray(array, dtype=float) for array in arrays])
    return stacked
