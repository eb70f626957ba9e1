"""Read-offs from a stored sweep: the pressure, the contact modulus or the Sq at which the leak falls below a value.

Starred numbers depend on E* and Sq through p* = p L/(E* Sq) alone, for surfaces of one shape and elastic contact. The
leak of a liquid at a pressure drop is T* V*³ times Sq³. So one sweep answers for every modulus and height. With p₀ the
pressure that belongs to the same p* at the E* and Sq of the study:

    pressure    p = p₀             where the leak at p₀ is the value
    modulus     E* over p/p₀       the same p₀; a larger E* leaks more
    Sq          Sq over p/p₀       where the leak at p₀ times (p/p₀)³ is the value; a larger Sq leaks more

Several surfaces have the geometric mean of their leaks at the same nominal pressure; it is 0 once one is closed.
Between two steps log(leak) is a monotone cubic in log(p). A way that closes between them is taken as closed from the
second on. `campaign.inverse` refines an answer by solves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from scipy import optimize
from xarray import Dataset

from roughvol.analysis.leak_budget import AXES
from roughvol.analysis.legs import first_leg
from roughvol.errors import Problem, StudyError
from roughvol.observables.at_state import at_state, kept_steps
from roughvol.store import axis_variables
from roughvol.typing import Array

UNKNOWNS = ("pressure", "modulus", "Sq")
ONE_OF_EACH = ("D", "m", *axis_variables.ROWS)  # a mean over surfaces is one over seeds or files


@dataclass(frozen=True)
class Answer:
    """The value asked for along one axis.

    Attributes
    ----------
    axis : str
        x or y.
    value : float
        Value in `unit`; infinite where the stored loads do not suffice, 0 where any value does. For modulus and Sq
        0 where the stored loads do not suffice, infinite where any value does.
    unit : str
        Its unit.
    between : tuple of float
        p* of the two steps around it.
    nominal : float
        Pressure p₀ of the same p* at the E* and Sq of the study.
    error : float
        Estimated relative error of the value by interpolation; NaN without an estimate.
    """

    axis: str
    value: float
    unit: str
    between: tuple[float, float]
    nominal: float = math.nan
    error: float = math.nan


@dataclass(frozen=True)
class Curve:
    """The leak of one surface along the first leg of a sweep.

    Attributes
    ----------
    pressure : array (steps,)
        Nominal pressure in the unit of the study, rising.
    leak : array (steps,)
        Leak in the unit of the study; 0 where closed.
    starred : array (steps,)
        p*.
    """

    pressure: Array
    leak: Array
    starred: Array

    @property
    def open(self) -> int:
        """Number of steps before the first closed one."""
        closed = np.flatnonzero(self.leak <= 0.0)
        return int(closed[0]) if closed.size else self.leak.size

    @property
    def closes(self) -> float:
        """Nominal pressure of the first closed step; infinite without one."""
        return float(self.pressure[self.open]) if self.open < self.leak.size else math.inf


def ask(run: Dataset, largest: float, unknown: str, *, pressure: float | None = None) -> list[Answer]:
    """Return where the leak of the mean surface falls below a value, along x and y; nothing is solved.

    Parameters
    ----------
    run : Dataset
        A study with transmissivities along its steps, ``nominal_pressure`` and leak rates.
    largest : float
        Leak in the unit of the stored leak rates.
    unknown : {"pressure", "modulus", "Sq"}
        Quantity asked for. The modulus is given over that of the study, Sq over that of the study.
    pressure : float, optional
        Nominal pressure in the unit of the study, for modulus and Sq.

    Returns
    -------
    list of Answer
        One for each axis.

    Raises
    ------
    StudyError
        If the quantity is unknown, a pressure is missing, the surface yields, the run has no leak rates, or it has
        several D or m.
    """
    if unknown not in UNKNOWNS:
        _refuse(f"for is {unknown!r}; allowed: {', '.join(UNKNOWNS)}")
    check_leaks(run)
    if unknown != "pressure" and "plastic_volume" in run:
        _refuse("pressures end at a hardness, so numbers do not depend on p* alone; allowed: for pressure")
    if unknown != "pressure" and not (pressure is not None and pressure > 0.0):
        _refuse(f"for {unknown} the pressure must be given, > 0")
    if unknown == "Sq" and not _liquid(run):
        _refuse("the leak is not that of a liquid, and does not go with Sq^3; allowed: for pressure or modulus")
    if not largest > 0.0:
        _refuse(f"the leak is {largest}; allowed: > 0")
    return [_answer(curves(run, axis), largest, unknown, axis, pressure or 0.0, _unit(run)) for axis in AXES]


def check_leaks(run: Dataset) -> None:
    """Refuse a run without leak rates, or with several kinds of surfaces.

    Parameters
    ----------
    run : Dataset
        A study.

    Raises
    ------
    StudyError
        If it lacks leak rates or pressures, or has several D, m, or values of a list.
    """
    if "leak_rate_x" not in run or "nominal_pressure" not in run:
        _refuse("the run has no leak rates: record dimensional.pressure and dimensional.leak_rate")
    several = [dim for dim in ONE_OF_EACH if run.sizes.get(dim, 1) > 1]
    if several:
        held = ", ".join(f"{value:g}" if np.isreal(value) else str(value) for value in run[several[0]].values.tolist())
        _refuse(f"the run has several {several[0]} ({held}); allowed: surfaces of one kind at one value of each key")


def curves(run: Dataset, axis: str) -> list[Curve]:
    """Return the leak of each surface along the first leg, at the steps with a leak.

    Parameters
    ----------
    run : Dataset
        A study with leak rates.
    axis : str
        x or y.

    Returns
    -------
    list of Curve
        Surfaces in the order of the study, without those that have no stored step.
    """
    first = first_leg(run)
    names = ("nominal_pressure", f"leak_rate_{axis}", "mean_pressure")
    cases = [dim for dim in first["mean_pressure"].dims if dim != "step"]
    stacked = first[list(names)].stack(surface=cases).transpose("surface", "step")
    made = []
    for pressure, leak, starred in zip(*(stacked[name].values for name in names), strict=True):
        kept = np.isfinite(leak) & (starred > 0.0)
        order = np.argsort(pressure[kept], kind="stable")
        if kept.any():
            made.append(Curve(*(values[kept][order] for values in (pressure, leak, starred))))
    return made


def log_leak(surfaces: list[Curve], log_pressures: Array) -> tuple[Array, Array]:
    """Return log of the geometric mean of the leaks at nominal pressures, and an estimate of its error.

    Parameters
    ----------
    surfaces : list of Curve
        Leaks of the surfaces.
    log_pressures : array (n,)
        log of nominal pressures in the unit of the study.

    Returns
    -------
    values : array (n,)
        log of the mean; NaN before the first step of a surface, and from its last open step on.
    errors : array (n,)
        Errors of the interpolation, ≥ 0: the change without every second step over three, or that of straight lines.
    """
    values, errors = np.zeros(len(log_pressures)), np.zeros(len(log_pressures))
    for one in surfaces:
        if one.open == 0:  # closed from the first step on
            values += np.nan
            continue
        x, y = np.log(one.pressure[: one.open]), np.log(one.leak[: one.open])
        cubic = at_state(x, y, log_pressures)
        bent = np.abs(cubic - at_state(x, y, log_pressures, straight=True))  # next to the ends the cubic is no better
        half = kept_steps(x.size, 2)
        change = np.abs(cubic - at_state(x[half], y[half], log_pressures)) / 3.0
        values += cubic / len(surfaces)
        errors += np.maximum(change, bent) / len(surfaces)
    return values, errors


def _refuse(message: str) -> NoReturn:
    raise StudyError([Problem(message)])


def _liquid(run: Dataset) -> bool:
    """Return whether leaks go with T* V*³ on each surface."""
    flow = run["transmissivity_x"] * run["free_volume"] ** 3
    ratio = run["leak_rate_x"] / flow.where(flow > 0.0)
    return bool(
        (ratio.max("step") - ratio.min("step") <= 1e-6 * ratio.max("step")).where(flow.max("step") > 0, True).all()
    )


def _unit(run: Dataset) -> str:
    return str(run["nominal_pressure"].attrs["units"])


def _answer(surfaces: list[Curve], largest: float, unknown: str, axis: str, pressure: float, unit: str) -> Answer:
    cubed = unknown == "Sq"

    def excess(log_pressures: Array) -> Array:
        """Return log of the leak over the value, at p₀ and the Sq that belongs to it."""
        scaled = 3.0 * (math.log(pressure) - log_pressures) if cubed else 0.0
        excesses: Array = log_leak(surfaces, log_pressures)[0] + scaled - math.log(largest)
        return excesses

    at, error = _nominal(surfaces, excess)
    between = _around(surfaces, at)
    if unknown == "pressure":
        return Answer(axis, at, unit, between, at, error)
    value = math.inf if at == 0.0 else pressure / at
    words = "times the Sq of the study" if cubed else "times the E* of the study"
    return Answer(axis, value, words, between, at, error)


def _nominal(surfaces: list[Curve], excess: Callable[[Array], Array]) -> tuple[float, float]:
    """Return the least p₀ with a leak up to the value, and its error; infinite beyond the last step, 0 before all."""
    closes = min((one.closes for one in surfaces), default=math.inf)
    if not surfaces or any(one.open == 0 for one in surfaces):
        return (0.0 if surfaces else math.inf), math.nan
    low = max(math.log(one.pressure[0]) for one in surfaces)
    high = min(math.log(one.pressure[one.open - 1]) for one in surfaces)
    inside = np.concatenate([np.log(one.pressure) for one in surfaces])
    knots = np.unique(np.concatenate([[low], inside[(inside > low) & (inside < high)], [high]]))
    below = np.flatnonzero(excess(knots) <= 0.0)
    if not below.size:
        return closes, math.nan
    k = int(below[0])
    if k == 0:
        return 0.0, math.nan
    start, end = float(knots[k - 1]), float(knots[k])
    root = float(optimize.brentq(lambda x: float(excess(np.array([x]))[0]), start, end, xtol=1e-14, rtol=1e-14))
    step = 1e-3 * (end - start)
    around = excess(np.array([max(start, root - step), min(end, root + step)]))
    slope = float(around[1] - around[0]) / (min(end, root + step) - max(start, root - step))
    error = float(log_leak(surfaces, np.array([root]))[1][0])
    return math.exp(root), abs(error / slope) if slope else math.nan


def _around(surfaces: list[Curve], at: float) -> tuple[float, float]:
    """Return p* of the steps around a nominal pressure, of the first surface; infinite beyond the last."""
    if not surfaces:
        return 0.0, math.inf
    one = surfaces[0]
    k = int(np.searchsorted(one.pressure, at * (1.0 - 1e-12)))
    low = float(one.starred[k - 1]) if k else 0.0
    return low, float(one.starred[k]) if k < one.starred.size else math.inf
