"""Quantities of one surface at the states of an ensemble, from the stored numbers of its sweep.

A quantity at a state that the sweep defines, or that a step reaches (`observables.levels`), is that of the step.
Between two steps it is interpolated by `observables.at_state`. The step before the first is first touch. There
all void is connected; the transmissivity of that state, and the free volume of a region, are not stored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.errors import Problem, StudyError
from roughvol.observables.at_state import at_state, error_of_fewer_steps, kept_steps
from roughvol.observables.variables import AXES, OF_STATE, SOLVED, VARIABLES
from roughvol.study import CLOSING, Accuracy, Case, Ensemble, Level, Quantity, Scale
from roughvol.study.sections.ensemble import RECORDED_BY
from roughvol.study.values.state_kinds import STARRED, step_at, stored_name
from roughvol.study.values.units import unit_of
from roughvol.typing import Array

PERCOLATION = Level("percolation")  # state of the closing pressures, which belong to no state of the study
OF_VOID = ("percolates", "connected_volume_fraction", "transmissivity")  # of the numbers along the steps

SMALLEST = 1e-150  # half-width in place of 0, for a relative accuracy of a mean of 0; its square is a number > 0

Arrays = Mapping[str, tuple[tuple[str, ...], NDArray[Any]]]  # stored variables of a case: dimensions and values
# Sq (1,); closing_pressure (axes,); quantities along the steps (steps + 1,), percolates (steps + 1, axes)
Series = Mapping[str, Array]


@dataclass(frozen=True)
class Target:
    """A mean to estimate: the quantity as named in the study, the state, the accuracy."""

    quantity: str
    state: Level
    accuracy: Accuracy

    @property
    def stored(self) -> str:
        """Name of the stored variable."""
        return stored_name(self.quantity)

    @property
    def symbol(self) -> str:
        """Symbol of the quantity, as V*."""
        return VARIABLES[f"{self.stored}_mean"].symbol.strip("<>")

    def half_width(self, mean: float) -> float:
        """Return the half-width asked for, > 0."""
        return self.accuracy.of(mean) or SMALLEST

    def value(self, series: Series, case: Case) -> float:
        """Return the quantity of a surface at the state."""
        return value_at(series, self.stored, self.state, case)


def targets_of(ensemble: Ensemble) -> list[Target]:
    """Return the means to estimate, state by state; those without a state at the end."""
    accuracies: dict[str, Accuracy] = ensemble.accuracy.named
    closing = {name: accuracies.pop(name) for name in CLOSING if name in accuracies}
    at_states = [Target(name, state, accuracy) for state in ensemble.at.levels for name, accuracy in accuracies.items()]
    return [*at_states, *(Target(name, PERCOLATION, accuracy) for name, accuracy in closing.items())]


def series_of(arrays: Arrays) -> Series:
    """Return the quantities along the steps, with first touch first; NaN where unknown. Ways have an axis behind."""

    def along(name: str, first: float) -> Array:
        values = np.asarray(arrays[name][1], dtype=np.float64)
        steps = values.reshape(values.shape[arrays[name][0].index("step") :])
        return np.concatenate([np.full((1, *steps.shape[1:]), first), steps])

    series = {name: along(name, 0.0) for name in OF_STATE}
    for name in (name for name in ("Sq", SOLVED) if name in arrays):
        series[name] = np.ravel(np.asarray(arrays[name][1], dtype=np.float64))
    touch = series["indentation"][1] + series["separation"][1]  # d/σ at first touch, equal to V* there
    series["separation"][0] = series["free_volume"][0] = touch
    own = [name for name in arrays if VARIABLES[name].observable == "own" and arrays[name][0][-1] == "step"]
    series |= {name: along(name, VARIABLES[name].touch) for name in (*OF_VOID, *own) if name in arrays}
    if "transmissivity" in series:
        flows = series["transmissivity"]
        with np.errstate(divide="ignore"):
            series["log_leak_rate"] = np.log10(flows).mean(axis=1) + 3.0 * np.log10(series["free_volume"])
        series["transmissivity"] = flows.mean(axis=1)
    return series


def value_at(series: Series, stored: str, state: Level, case: Case) -> float:
    """Return a quantity at a state; `StudyError` if the sweep ends before, or the quantity has no value there."""
    if stored in CLOSING:
        return _closing_pressure(series, stored, case)
    quantity = series[stored]
    along = series[stored_name(state.kind)] if state.value is not None else quantity
    step = _step(series, along, state, case)
    if step is None:
        starred = _starred(series, state, case)
        _require_reached(series, along, state, starred, case)
        value = float(at_state(*_curve(series, stored, state, case), starred)[0])
    else:
        value = float(quantity[step])
    if not math.isfinite(value):
        reason = "" if stored in OF_STATE else "its function returns no finite number there, or "
        reason = "no way is left along x or y there, or " if stored in RECORDED_BY else reason
        message = (
            f"has no value at {state.label} on {case.label}: {reason}the first step of the sweep lies beyond it; "
            "ask at other states, or take more sweep.steps"
        )
        raise StudyError([Problem(message, f"ensemble.accuracy.{stored}")])
    return value


def error_at(series: Series, stored: str, state: Level, case: Case, every: int) -> float:
    """Return the signed error of a quantity at a state with every k-th step alone, k ≥ 2; 0 where a step is it."""
    if stored in CLOSING:
        if case.sweep.legs[0].target.kind == CLOSING[stored] or math.isfinite(_solved(series, stored)):
            return 0.0
        pressure, closed = series["mean_pressure"], _closed(series, stored)
        kept = kept_steps(pressure.size, every)
        return _middle(pressure[kept], closed[kept]) - _middle(pressure, closed)
    if state.value is None:
        return 0.0
    along = series[stored_name(state.kind)]
    step = _step(series, along, state, case)
    if step is not None and step in kept_steps(len(along), every):
        return 0.0
    value = _starred(series, state, case) if step is None else float(along[step])
    return error_of_fewer_steps(*_curve(series, stored, state, case), value, every)


def _curve(series: Series, stored: str, state: Level, case: Case) -> tuple[Array, Array]:
    """Return the quantity of a state, and a stored quantity, at the steps between which a surface is read off.

    A region may be unloaded at several steps: a pressure or a contact area is read off from the last of these on. The
    free volume of a region at first touch of the whole surface is not known.
    """
    along, quantity = series[stored_name(state.kind)], series[stored]
    if stored == "free_volume" and case.record.part is not None:
        quantity = np.append(math.nan, quantity[1:])
    begins = max(int(np.argmax(along > 0.0)) - 1, 0) if state.kind in ("pressure", "contact_area") else 0
    return along[begins:], quantity[begins:]


def _starred(series: Series, state: Level, case: Case) -> float:
    """Return the starred value of a state on a surface: the same on all in units of the study, if it gives their Sq."""
    assert state.value is not None
    if unit_of(state.value) is None:
        return state.value
    Sq = case.height or float(series["Sq"][0])
    scale = Scale(case.E_star, case.L, Sq, math.nan, case.modulus_unit, case.length_unit)
    return scale.starred(state.kind, state.value)[1]


def _step(series: Series, along: Array, state: Level, case: Case) -> int | None:
    """Return the index in a series of the step that is a state, None for a state between steps."""
    if state.value is None:
        return len(along) - 1
    step = case.sweep.legs[0].step_of(state)
    if step is None:
        step = step_at(state.kind, _starred(series, state, case), along[1:])
    return None if step is None else step + 1


def _require_reached(series: Series, along: Array, state: Level, starred: float, case: Case) -> None:
    """Refuse a state before the first touch, or beyond the end of a sweep."""
    if math.isfinite(float(at_state(along, along, starred)[0])):
        return
    unit = unit_of(state.value)
    per_unit = 1.0 if unit is None else _starred(series, Level(state.kind, Quantity(1.0, unit)), case)
    first, last = (" ".join(filter(None, (f"{end / per_unit:.4g}", unit))) for end in (along[0], along[-1]))
    message = (
        f"{state.written} is not reached by {case.label}, whose sweep ends at {state.kind} {last}: "
        f"sweep further, as to: {{{state.kind}: {state.written}}}"
    )
    if STARRED[state.kind].falls and starred > along[0]:
        message = f"{state.written} lies before the first touch of {case.label}; allowed: below {first}"
    raise StudyError([Problem(message, f"ensemble.at.{state.kind}")])


def _closing_pressure(series: Series, stored: str, case: Case) -> float:
    """Return p* at which the void closes: at the end of a sweep to percolation, solved, or the middle of two steps."""
    pressure, end = series["mean_pressure"], CLOSING[stored]
    if case.sweep.legs[0].target.kind == end:
        return float(pressure[-1])
    if math.isfinite(solved := _solved(series, stored)):
        return solved
    closed = _closed(series, stored)
    if not closed[-1]:
        message = (
            f"the void of {case.label} is still open at the end of its sweep, p* = {float(pressure[-1]):.4g}: "
            f"sweep further, as to: {{percolation: {end.removeprefix('percolation-')}}}"
        )
        raise StudyError([Problem(message, f"ensemble.accuracy.{stored}")])
    return _middle(pressure, closed)


def _solved(series: Series, stored: str) -> float:
    """Return the solved p* at which the last way closes along the axes of a closing pressure; NaN without one."""
    return float(series[SOLVED][_axes(stored)].max()) if SOLVED in series else math.nan


def _closed(series: Series, stored: str) -> Array:
    """Return whether no way is left at each step along the axes of a closing pressure."""
    closed: Array = series["percolates"][:, _axes(stored)].max(axis=1) == 0.0
    return closed


def _axes(stored: str) -> list[int]:
    """Return the axes of a closing pressure."""
    axis = CLOSING[stored].removeprefix("percolation-")
    return [k for k, name in enumerate(AXES) if axis in (name, "both")]


def _middle(pressure: Array, closed: Array) -> float:
    """Return the middle of p* at the last open step and at the first closed one."""
    first = int(np.argmax(closed))
    return float(pressure[max(first - 1, 0) : first + 1].mean())
