"""The leak of a seal over time: a material that creeps under constant load, from a stored sweep.

Lee & Radok, J. Appl. Mech. 27 (1960) 438: where the contact area does not fall with time, the contact of a linear
viscoelastic body is the elastic one with the compliance J(t) in place of 1/E. J is the compliance 1/E* of the contact:
of both bodies, where both deform. At constant load the state at time t is the elastic state of the modulus
E*(t) = 1/J(t). Its p* is p*(0) J(t)/J(0), on the same stored sweep. Conditions, checked here as far as a sweep shows
them:

- the load is put on at once, and held: J does not fall with time (the creep law is refused otherwise);
- the contact area does not fall along the sweep;
- contact is elastic, without a hardness; Poisson's ratio does not change with time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from xarray import Dataset

from roughvol.analysis.average import average
from roughvol.analysis.leak_card import Card
from roughvol.analysis.leak_curve import Curve, curves, surfaces
from roughvol.analysis.read_off import errors_of, seal_words
from roughvol.analysis.tables import Table, evenly, number, rounded, with_interval
from roughvol.observables.at_state import at_state
from roughvol.study import Creep, loads, refused
from roughvol.study.plain_data import finite
from roughvol.study.values.state_kinds import REACHED
from roughvol.typing import Array

CARDS = 4  # largest number of leak cards for the errors of a history


@dataclass(frozen=True, eq=False)
class OverSurfaces:
    """The leak of several surfaces along one axis, in the unit of the study: arrays over the times.

    - ``value``: median over the surfaces; closed surfaces count as 0
    - ``low``, ``high``: interval of the reading, or with the errors of leak cards; NaN where an error is not known
    - ``least``, ``most``: 16 to 84 % range over the surfaces
    - ``open``: number of surfaces before their first closed step
    - ``closing``: number of open surfaces beyond their last open step; their leak is on the straight line to 0
    - ``is_closing``: whether the reading lies between 0 and the last open step
    """

    value: Array
    low: Array
    high: Array
    least: Array
    most: Array
    open: Array
    closing: Array
    surfaces: int
    is_closing: Array


@dataclass(frozen=True, eq=False)
class History:
    """A seal over time, in the units of the study: arrays over ``seconds`` under load.

    - ``ratio``: J(t)/J(0) of the contact
    - ``equivalent``: nominal pressure of the same p* at the modulus of the study, p J(t)/J(0)
    - ``area``: A*, mean over the surfaces whose sweep reaches the state; NaN if none does
    - ``reaching``: number of surfaces whose sweep reaches the state
    - ``surfaces``: number of all surfaces
    - ``leak``: leak by axis
    - ``body``: the body that creeps, in words
    - ``has_errors``: whether the intervals have the errors of leak cards
    - ``seal``: the seal that leaks, in words; empty where the leak is that of a patch
    """

    seconds: Array
    ratio: Array
    equivalent: Array
    area: Array
    reaching: Array
    surfaces: int
    leak: dict[str, OverSurfaces]
    pressure: float
    pressure_unit: str
    leak_unit: str
    body: str
    has_errors: bool = False
    seal: str = ""

    def plain(self) -> dict[str, Any]:
        """Return the numbers as ``creep --json`` prints them; None where a number is not known."""
        rows = []
        for k, time in enumerate(self.seconds):
            ways = [
                {
                    "axis": axis,
                    "value": finite(leak.value[k]),
                    "interval": [finite(leak.low[k]), finite(leak.high[k])],
                    "range_of_surfaces": [finite(leak.least[k]), finite(leak.most[k])],
                    "open": int(leak.open[k]),
                    "closing": int(leak.closing[k]),
                    "surfaces": leak.surfaces,
                }
                for axis, leak in self.leak.items()
            ]
            rows.append(
                {
                    "seconds": float(time),
                    "compliance_ratio": float(self.ratio[k]),
                    "equivalent_pressure": float(self.equivalent[k]),
                    "contact_area_fraction": finite(self.area[k]),
                    "surfaces_reaching": int(self.reaching[k]),
                    "leak": ways,
                }
            )
        return {
            "pressure": self.pressure,
            "unit": self.pressure_unit,
            "leak_unit": self.leak_unit,
            "body": self.body,
            "has_errors": self.has_errors,
            "times": rows,
        }


def history(run: Dataset, law: Creep, pressure: float, seconds: Sequence[float]) -> History:
    """Return the leak at times [s] under a constant nominal pressure in the unit of the study; nothing is solved.

    The run is as `read_off.checked` returns it, and its modulus that at once. A `StudyError` refuses a run with yield,
    or with a contact area that falls. It refuses a law that does not fit the bodies of the study, and a time whose
    state lies beyond the sweep.
    """
    if "plastic_volume" in run:
        raise refused("the surface yields: the theory of Lee and Radok holds without a hardness alone")
    if "contact_area_fraction" not in run:
        raise refused("contact_area_fraction is not in the dataset: it shows whether the theory of Lee and Radok holds")
    pressed = [surface for _, surface in surfaces(run)]
    if any(np.any(np.diff(surface["contact_area_fraction"].values) < -1e-12) for surface in pressed):
        raise refused("the contact area falls along the stored sweep: the theory of Lee and Radok does not hold")
    material = loads(str(run.attrs["study"]), stored=True).material
    ratio = np.array([law.ratio(time, material) for time in seconds])
    equivalent = pressure * ratio
    by_axis = curves(run)
    unit = str(run["nominal_pressure"].attrs["units"])
    _within_reach([curve for along in by_axis.values() for curve in along], unit, equivalent, seconds, pressure)
    areas = [
        at_state(p, surface["contact_area_fraction"].values, _on_steps(p, equivalent))
        for surface in pressed
        for p in [surface["nominal_pressure"].values]
    ]
    return History(
        np.asarray(seconds, dtype=np.float64),
        ratio,
        equivalent,
        np.array([average("contact_area_fraction", there).value for there in np.transpose(areas)]),
        np.isfinite(areas).sum(axis=0),
        len(areas),
        {axis: _over_surfaces(each, equivalent) for axis, each in by_axis.items()},
        pressure,
        unit,
        str(run["leak_rate"].attrs["units"]),
        law.words(material),
        seal=seal_words(run),
    )


def loads_of_cards(over_time: History) -> list[float]:
    """Return nominal pressures for leak cards, rising: those of all times, or of a few from the first to the last."""
    chosen = over_time.equivalent[evenly(over_time.equivalent.size, CARDS)]
    return sorted({float(f"{load:.5g}") for load in chosen})


def with_errors(over_time: History, cards: Mapping[float, Card]) -> History:
    """Return a history whose intervals have the errors of leak cards at nominal pressures from first to last state.

    The factors of a card go with the leak at its load; between two loads their logarithms are on a straight line over
    the logarithm of the load. Where a way is closed at a load, or an error is not known, the interval is not known.
    """
    at, logs, leaks = sorted(cards), np.log(over_time.equivalent), {}
    for axis, leak in over_time.leak.items():
        with np.errstate(divide="ignore"):  # a seal may be closed
            factors = np.log([errors_of(cards[load], axis).leak for load in at])
        smaller, larger = (np.exp(np.interp(logs, np.log(at), ends)) for ends in factors.T)
        leaks[axis] = replace(leak, low=leak.low * smaller, high=leak.high * larger)
    return replace(over_time, leak=leaks, has_errors=True)


def _on_steps(steps: Array, loads: Array) -> Array:
    """Return loads, those of a step where they miss the step by less than `REACHED`."""
    near = np.abs(loads[:, np.newaxis] - steps) <= REACHED * steps
    return np.where(near.any(axis=1), steps[near.argmax(axis=1)], loads)


def _over_surfaces(curves_of: Sequence[Curve], equivalent: Array) -> OverSurfaces:
    """Return median, range and interval of the leaks at nominal pressures."""
    readings = [curve.at(equivalent) for curve in curves_of]
    value, low, high = (
        [average("leak_rate", there) for there in np.transpose([getattr(reading, name) for reading in readings])]
        for name in ("value", "low", "high")
    )
    median, least, most = (np.array([getattr(leak, name) for leak in value]) for name in ("value", "low", "high"))
    lows, highs = (np.array([leak.value for leak in ends]) for ends in (low, high))
    open_ = np.sum([reading.value > 0.0 for reading in readings], axis=0)
    closing = np.sum([(reading.low == 0.0) & (reading.high > 0.0) for reading in readings], axis=0)
    return OverSurfaces(median, lows, highs, least, most, open_, closing, len(readings), (lows == 0.0) & (median > 0.0))


def _within_reach(
    curves_of: Sequence[Curve], unit: str, equivalent: Array, seconds: Sequence[float], pressure: float
) -> None:
    """Refuse times whose states lie beyond the stored sweep of a surface with an open way."""
    low, high = max(curve.begins for curve in curves_of), min(curve.ends for curve in curves_of)
    if equivalent[0] < low * (1.0 - REACHED):
        raise refused(
            f"at {seconds[0]:.4g} s the state is that of {equivalent[0]:.4g} {unit}; the leak is known from "
            f"{low:.4g} {unit} on: give more steps at low load, and record the flow at every step"
        )
    late = np.flatnonzero(equivalent > high * (1.0 + REACHED))
    if late.size:
        k = int(late[0])
        until = f"reached up to {seconds[k - 1]:.4g} s" if k else "reached at no time"
        raise refused(
            f"at {seconds[k]:.4g} s the state is that of {equivalent[k]:.6g} {unit} (p = {pressure:.4g} {unit}, "
            f"J(t)/J(0) = {equivalent[k] / pressure:.6g}); the leak is known up to {high:.6g} {unit}, {until}: press "
            "farther, record the flow at every step, or ask for less"
        )


PARTS = {
    "leak": "value",
    "lower": "low",
    "upper": "high",
    "16 %": "least",
    "84 %": "most",
    "open": "open",
    "closing": "closing",
}
"""Columns of each axis in a file, and their attributes."""
COUNTS = ("open", "closing")


def rows_of(over_time: History) -> tuple[list[str], list[list[float | None]]]:
    """Return the heads and the rows of a file of numbers; None in the place of a number that is missing."""
    head = ["time [s]", "J(t)/J(0)", f"p J(t)/J(0) [{over_time.pressure_unit}]", "A*"]
    columns = [over_time.seconds, over_time.ratio, over_time.equivalent, over_time.area]
    for axis, leak in over_time.leak.items():
        for name, attribute in PARTS.items():
            unit = "" if name in COUNTS else f" [{over_time.leak_unit}]"
            head.append(f"leak {axis}{unit}" if name == "leak" else f"leak {axis} {name}{unit}")
            columns.append(getattr(leak, attribute))
    head, columns = [*head, "surfaces of A*"], [*columns, over_time.reaching]
    return head, finite(list(zip(*(column.tolist() for column in columns), strict=True)))


def table_of(over_time: History) -> Table:
    """Return a table: one row for each time, with the range over surfaces and their counts where there are several."""
    unit, several = over_time.leak_unit, next(iter(over_time.leak.values())).surfaces > 1
    head = ["time", "J/J(0)", f"p J/J(0) [{over_time.pressure_unit}]", "A*"]
    intervals = ["with errors"] if over_time.has_errors else []
    for axis in over_time.leak:
        head += [
            f"Q_{'seal' if over_time.seal else axis} [{unit}]",
            *intervals,
            *(["16-84 %", f"open along {axis}"] if several else []),
        ]
    rows = []
    for k, seconds in enumerate(over_time.seconds):
        row = [
            _time(seconds),
            *(number(values[k]) for values in (over_time.ratio, over_time.equivalent, over_time.area)),
        ]
        if 0 < over_time.reaching[k] < over_time.surfaces:
            row[-1] += f" ({over_time.reaching[k]} of {over_time.surfaces})"
        for leak in over_time.leak.values():
            row += [_leak(leak, k), *(_interval(leak, k) for _ in intervals)]
            if several:
                least, most = (number(end[k], 2) for end in (leak.least, leak.most))
                row.append(f"{least} to {most}" if leak.most[k] > 0.0 else "0")
                closing = f" ({leak.closing[k]} closing)" if leak.closing[k] else ""
                row.append(f"{leak.open[k]} of {leak.surfaces}{closing}")
        rows.append(tuple(row))
    return Table("", tuple(head), tuple(rows), _note(over_time, several=several))


def _note(over_time: History, *, several: bool) -> str:
    """Return the error of the readings and the convention of several surfaces in words."""
    factors = [np.ones(1)]
    for leak in over_time.leak.values():
        known = leak.low > 0.0
        factors += [leak.high[known] / leak.value[known], leak.value[known] / leak.low[known]]
    worst = float(np.concatenate(factors).max())
    words = ["read off the stored sweep"]
    if over_time.has_errors:
        words.append("intervals with the errors of reading, solver, grid, window and levelling")
    elif worst > 1.0:
        words.append(f"error of the reading up to a factor of {number(worst, 3)}")
    if several:
        words.append("Q is the median over the surfaces, closed ones counted as 0")
    if np.any((over_time.reaching > 0) & (over_time.reaching < over_time.surfaces)):
        words.append("A* is the mean over the surfaces whose sweep reaches the state")
    return "; ".join(words)


def _leak(leak: OverSurfaces, k: int) -> str:
    """Return one leak in the digits of its interval."""
    value, low, high = float(leak.value[k]), float(leak.low[k]), float(leak.high[k])
    if leak.is_closing[k]:
        return f"closing, < {number(high, 2)}" if math.isfinite(high) else "closing"
    if value == 0.0:
        return "0" if leak.open[k] else "closed"
    return rounded(value, low, high)


def _interval(leak: OverSurfaces, k: int) -> str:
    """Return an interval with errors."""
    _, low, high = with_interval(*(float(of[k]) for of in (leak.value, leak.low, leak.high)))
    return "unknown" if "–" in (low, high) else f"{low} to {high}"


def _time(seconds: float) -> str:
    for size, unit in ((31557600.0, "year"), (86400.0, "day"), (3600.0, "h"), (60.0, "min")):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
