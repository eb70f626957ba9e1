"""Quantities of one surface at a state, from the stored numbers of its sweep.

Between two steps a quantity is interpolated by `observables.at_state`. The step before the first is first touch. There
all void is connected; the transmissivity of that state is not stored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from roughvol.errors import Problem, StudyError
from roughvol.observables.at_state import at_state, error_between_steps
from roughvol.store.dataset import Arrays
from roughvol.study import CLOSING, STORED_AS, Case, Level
from roughvol.study.yaml_text import number_text
from roughvol.typing import Array

PERCOLATION = Level("percolation")
"""State of the quantities that belong to none: the closing of the void."""

OF_STATE = ("indentation", "separation", "contact_area_fraction", "mean_pressure", "free_volume")
ALONG_AXES = ("percolates_x", "percolates_y", "transmissivity_x", "transmissivity_y")

Series = Mapping[str, Array]


def series_of(arrays: Arrays) -> Series:
    """Return the quantities along the steps, with first touch before the first step.

    Parameters
    ----------
    arrays : mapping
        Stored variables of a case: dimensions and values by name.

    Returns
    -------
    dict
        Arrays of shape (steps + 1,) by name, NaN where nothing is known.
    """

    def along(name: str, first: float) -> Array:
        return np.concatenate([[first], np.asarray(arrays[name][1], dtype=np.float64).reshape(-1)])

    series = {name: along(name, 0.0) for name in OF_STATE}
    touch = series["indentation"][1] + series["separation"][1]  # d/σ at first touch, equal to V* there
    series["separation"][0] = series["free_volume"][0] = touch
    series |= {name: along(name, 1.0 if name.startswith("p") else np.nan) for name in ALONG_AXES if name in arrays}
    if "connected_volume_fraction" in arrays:
        series["connected_volume_fraction"] = along("connected_volume_fraction", 1.0)
    if "transmissivity_x" in series:
        axes = np.stack([series["transmissivity_x"], series["transmissivity_y"]])
        with np.errstate(divide="ignore"):
            series["log_leak_rate"] = np.log10(axes).mean(axis=0) + 3.0 * np.log10(series["free_volume"])
        series["transmissivity"] = axes.mean(axis=0)
    return series


def value_and_error(series: Series, stored: str, state: Level, case: Case) -> tuple[float, float]:
    """Return a quantity at a state, and the error of the interpolation between steps.

    Parameters
    ----------
    series : mapping
        From `series_of`.
    stored : str
        Name of the quantity, as a stored variable.
    state : Level
        The state; `PERCOLATION` for the pressures in `study.CLOSING`.
    case : Case
        Its sweep and its label for errors.

    Returns
    -------
    tuple of float
        Value and signed error.

    Raises
    ------
    StudyError
        If the sweep ends before the state, or the quantity has no value there.
    """
    if stored in CLOSING:
        return _closing_pressure(series, stored, case)
    quantity = series[stored]
    if state.value is None:
        _require_value(float(quantity[-1]), stored, state, case)
        return float(quantity[-1]), 0.0
    along = series[STORED_AS.get(state.kind, state.kind)]
    if not math.isfinite(float(at_state(along, along, state.value)[0])):
        message = (
            f"{number_text(state.value)} is not reached by {case.label}, whose sweep ends at {state.kind} "
            f"{float(along[-1]):.4g}: sweep further, as to: {{{state.kind}: {number_text(state.value)}}}"
        )
        raise StudyError([Problem(message, f"ensemble.at.{state.kind}")])
    value = float(at_state(along, quantity, state.value)[0])
    _require_value(value, stored, state, case)
    return value, float(np.nan_to_num(error_between_steps(along, quantity, state.value)[0]))


def _require_value(value: float, stored: str, state: Level, case: Case) -> None:
    """Refuse a quantity that is not defined at a state: no way is left, or the first step lies beyond it."""
    if not math.isfinite(value):
        message = (
            f"has no value at {state.label} on {case.label}: no way is left along x or y there, or the first step "
            "of the sweep lies beyond it; ask at other states, or take more sweep.steps"
        )
        raise StudyError([Problem(message, f"ensemble.accuracy.{stored}")])


def _closing_pressure(series: Series, stored: str, case: Case) -> tuple[float, float]:
    """Return p* at which the void closes, and the error of the middle between two steps.

    At the end of a sweep to percolation p* is exact. Otherwise it is the middle of p* at the last open step and at the
    first closed one. Its error is the change without every second step, over three, as for a rule of second order.
    """
    pressure, end = series["mean_pressure"], CLOSING[stored]
    if case.sweep.legs[0].target.kind == end:
        return float(pressure[-1]), 0.0
    axis = end.removeprefix("percolation-")
    ways = [series[name] for name in ("percolates_x", "percolates_y") if name.endswith(axis) or axis == "both"]
    closed = np.max(ways, axis=0) == 0.0
    if not closed[-1]:
        message = (
            f"the void of {case.label} is still open at the end of its sweep, p* = {float(pressure[-1]):.4g}: "
            f"sweep further, as to: {{percolation: {axis}}}"
        )
        raise StudyError([Problem(message, f"ensemble.accuracy.{stored}")])
    middle = _middle(pressure, closed)
    half = slice((pressure.size - 1) % 2, None, 2)
    kept = np.unique(np.concatenate([[0], np.arange(pressure.size)[half]]))
    return middle, (middle - _middle(pressure[kept], closed[kept])) / 3.0


def _middle(pressure: Array, closed: Array) -> float:
    """Return the middle of p* at the last open step and at the first closed one."""
    first = int(np.argmax(closed))
    return float(pressure[max(first - 1, 0) : first + 1].mean())
