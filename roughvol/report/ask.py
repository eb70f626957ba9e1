"""Read-offs from a stored sweep: the pressure, the contact modulus or the Sq at which the leak falls below a value.

Starred numbers depend on E* and Sq through p* = p L/(E* Sq) alone, for surfaces of one shape and elastic contact. The
leak at a pressure drop is T* V*³ times Sq³. So one sweep answers for every modulus and height, without a solve:

    pressure    p = p*_0 E* Sq/L            where T* V*³ at p*_0 is the value, at the Sq of the study
    modulus     E* = p L/(p*_0 Sq)          a larger E* leaks more
    Sq          T* V*³ Sq³ is the value     at p* = p L/(E* Sq); a larger Sq leaks more

Between two steps log(T* V*³) is linear in p*; a way that closes between them is taken as closed from the second on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from scipy import optimize
from xarray import Dataset

from roughvol.errors import Problem, StudyError
from roughvol.observables.at_state import at_state
from roughvol.report.card import AXES, unit_leak
from roughvol.report.figures.origin import first_leg
from roughvol.typing import Array

UNKNOWNS = ("pressure", "modulus", "Sq")


@dataclass(frozen=True)
class Answer:
    """The value asked for along one axis.

    Attributes
    ----------
    axis : str
        x or y.
    value : float
        Value in `unit`; infinite where the stored loads do not suffice, 0 where any value does.
    unit : str
        Its unit.
    between : tuple of float
        p* of the two steps around it.
    """

    axis: str
    value: float
    unit: str
    between: tuple[float, float]


def ask(run: Dataset, largest: float, unknown: str, *, pressure: float | None = None) -> list[Answer]:
    """Return where the leak of the mean surface falls below a value, along x and y.

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
        If the quantity is unknown, a pressure is missing, the surface yields, or the run has no leak rates.
    """
    if unknown not in UNKNOWNS:
        _refuse(f"for is {unknown!r}; allowed: {', '.join(UNKNOWNS)}")
    if "leak_rate_x" not in run or "nominal_pressure" not in run:
        _refuse("the run has no leak rates: record dimensional.pressure and dimensional.leak_rate")
    if unknown != "pressure" and "plastic_volume" in run:
        _refuse("pressures end at a hardness, so numbers do not depend on p* alone; allowed: for pressure")
    if unknown != "pressure" and not (pressure is not None and pressure > 0.0):
        _refuse(f"for {unknown} the pressure must be given, > 0")
    if not largest > 0.0:
        _refuse(f"the leak is {largest}; allowed: > 0")
    return [_answer(run, largest, unknown, axis, pressure or 0.0) for axis in AXES]


def _refuse(message: str) -> NoReturn:
    raise StudyError([Problem(message)])


def _answer(run: Dataset, largest: float, unknown: str, axis: str, pressure: float) -> Answer:
    starred, leak = _curve(run, axis)
    factor, _ = unit_leak(run, axis)
    ratio = (run["nominal_pressure"] / run["mean_pressure"].where(run["mean_pressure"] > 0.0)).values
    per_starred = float(np.nanmean(ratio))  # E* Sq/L in the unit of pressures
    unit = str(run["nominal_pressure"].attrs["units"])
    if unknown == "Sq":
        value, at = _height(starred, leak, largest / factor, pressure / per_starred)
        return Answer(axis, value, "times the Sq of the study", _around(starred, at))
    at = _crossing(starred, leak, largest / factor)
    if unknown == "pressure":
        return Answer(axis, at * per_starred, unit, _around(starred, at))
    value = math.inf if at == 0.0 else pressure / (at * per_starred)
    return Answer(axis, value, "times the E* of the study", _around(starred, at))


def _curve(run: Dataset, axis: str) -> tuple[Array, Array]:
    """Return p* and the geometric mean of T* V*³ over surfaces at the steps of the first leg, increasing in p*."""
    first = first_leg(run)
    cases = [dim for dim in ("D", "m", "seed", "case") if dim in first.dims]
    leak = first[f"transmissivity_{axis}"] * first["free_volume"] ** 3
    with np.errstate(divide="ignore"):
        mean = np.exp(leak.reduce(_mean_log, cases).values)
    starred = first["mean_pressure"].mean(cases).values
    computed = np.isfinite(mean) & np.isfinite(starred)
    order = np.argsort(starred[computed], kind="stable")
    return starred[computed][order], mean[computed][order]


def _mean_log(values: Array, axis: tuple[int, ...]) -> Array:
    mean: Array = np.log(values).mean(axis=axis)
    return mean


def _crossing(starred: Array, leak: Array, largest: float) -> float:
    """Return the least p* with a leak up to a value; infinite beyond the last step, 0 where all leak less."""
    below = np.flatnonzero(leak <= largest)
    if not below.size:
        return math.inf
    k = int(below[0])
    if k == 0:
        return 0.0
    if leak[k] == 0.0:
        return float(starred[k])
    share = (math.log(largest) - math.log(leak[k - 1])) / (math.log(leak[k]) - math.log(leak[k - 1]))
    return float(starred[k - 1] + share * (starred[k] - starred[k - 1]))


def _height(starred: Array, leak: Array, largest: float, at_one: float) -> tuple[float, float]:
    """Return the largest Sq over that of the study with a leak up to a value, and its p*."""
    positive = leak > 0.0
    x, y = starred[positive], np.log(leak[positive])

    def excess(log_height: float) -> float:
        at = min(max(at_one * math.exp(-log_height), float(x[0])), float(x[-1]))  # of a rounded end
        return float(at_state(x, y, at, straight=True)[0]) + 3.0 * log_height - math.log(largest)

    low, high = math.log(at_one / x[-1]), math.log(at_one / max(x[0], 1e-300))
    if excess(low) > 0.0:
        return 0.0, math.inf
    if excess(high) < 0.0:
        return math.inf, float(x[0])
    root = optimize.brentq(excess, low, high, xtol=1e-12)
    return math.exp(root), at_one * math.exp(-root)


def _around(starred: Array, at: float) -> tuple[float, float]:
    """Return the p* of the steps around a value; infinite beyond the last."""
    k = int(np.searchsorted(starred, at))
    low = float(starred[k - 1]) if k else 0.0
    return low, float(starred[k]) if k < starred.size else math.inf
