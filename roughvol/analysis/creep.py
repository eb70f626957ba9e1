"""The leak of a seal over time: a material that creeps under constant load, from a stored sweep.

Lee & Radok, J. Appl. Mech. 27 (1960) 438: where the contact area does not fall with time, the contact of a linear
viscoelastic body is the elastic one with the compliance J(t) in place of 1/E. At constant load the state at time t is
the elastic state of the modulus E(t) = 1/J(t). Its p* is p*(0) J(t)/J(0), on the same stored sweep. Conditions, checked
here as far as a sweep shows them:

- the load is put on at once, and held: J does not fall with time (the creep law is refused otherwise);
- the contact area does not fall along the sweep;
- contact is elastic, without a hardness; Poisson's ratio does not change with time.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from xarray import Dataset

from roughvol.analysis.leak_budget import AXES
from roughvol.analysis.legs import first_leg
from roughvol.analysis.read_off import check_leaks, curves, log_leak
from roughvol.errors import Problem, StudyError
from roughvol.observables.at_state import at_state
from roughvol.store import stamped_file
from roughvol.study import Creep, loads
from roughvol.typing import Array


@dataclass(frozen=True, eq=False)
class History:
    """A seal over time, mean over the surfaces.

    Attributes
    ----------
    seconds : array (n,)
        Time under load [s].
    ratio : array (n,)
        J(t)/J(0).
    equivalent : array (n,)
        Nominal pressure of the same p* at the modulus of the study, p J(t)/J(0), in the unit of the study.
    area : array (n,)
        A*.
    leak : dict of array (n,)
        Leak by axis in the unit of the study; 0 where closed, NaN between the last open step and the first closed one.
    error : dict of array (n,)
        Estimated relative error of the leak by interpolation.
    pressure : float
        Nominal pressure in the unit of the study.
    pressure_unit, leak_unit : str
        Units.
    """

    seconds: Array
    ratio: Array
    equivalent: Array
    area: Array
    leak: dict[str, Array]
    error: dict[str, Array]
    pressure: float
    pressure_unit: str
    leak_unit: str


def history(run: Dataset, law: Creep, pressure: float, seconds: Sequence[float]) -> History:
    """Return the leak over time at a constant nominal pressure; nothing is solved.

    Parameters
    ----------
    run : Dataset
        A study with leak rates and nominal pressures; its modulus is that at once.
    law : Creep
        Creep law.
    pressure : float
        Nominal pressure in the unit of the study.
    seconds : sequence of float
        Times [s].

    Returns
    -------
    History
        Leak and contact at the times.

    Raises
    ------
    StudyError
        If the run has no leak rates, yields, or its contact area falls; or if a time needs states beyond the sweep.
    """
    check_leaks(run)
    if "plastic_volume" in run:
        _refuse("the surface yields: the theory of Lee and Radok holds for elastic contact alone")
    first = first_leg(run)
    area = first["contact_area_fraction"].transpose(..., "step").values
    if np.any(np.diff(area, axis=-1) < -1e-12):
        _refuse("the contact area falls along the stored sweep: the theory of Lee and Radok does not hold")
    material = loads(str(run.attrs["study"]), stored=True).material
    ratio = np.array([law.ratio(time, material) for time in seconds])
    equivalent = pressure * ratio
    _within_reach(run, equivalent, np.asarray(seconds, dtype=np.float64), pressure)
    leaks, errors = {}, {}
    for axis in AXES:
        surfaces = curves(run, axis)
        values, error = log_leak(surfaces, np.log(equivalent))
        closes = min(one.closes for one in surfaces)
        leaks[axis] = np.where(equivalent >= closes, 0.0, np.exp(values))
        errors[axis] = np.where(equivalent >= closes, 0.0, error)
    cases = [dim for dim in first["mean_pressure"].dims if dim != "step"]
    stacked = first[["nominal_pressure", "contact_area_fraction"]].stack(surface=cases).transpose("surface", "step")
    areas = [
        at_state(p, a, equivalent)
        for p, a in zip(stacked["nominal_pressure"].values, stacked["contact_area_fraction"].values, strict=True)
    ]
    return History(
        np.asarray(seconds, dtype=np.float64),
        ratio,
        equivalent,
        np.mean(areas, axis=0),
        leaks,
        errors,
        pressure,
        str(run["nominal_pressure"].attrs["units"]),
        str(run["leak_rate_x"].attrs["units"]),
    )


def _within_reach(run: Dataset, equivalent: Array, seconds: Array, pressure: float) -> None:
    """Refuse times whose states lie beyond the stored sweep."""
    surfaces = curves(run, "x")
    low = max(float(one.pressure[0]) for one in surfaces)
    high = min(float(one.pressure[-1]) for one in surfaces)
    unit = str(run["nominal_pressure"].attrs["units"])
    if equivalent[0] < low * (1.0 - 1e-12):
        _refuse(
            f"at {seconds[0]:.4g} s the state is that of {equivalent[0]:.4g} {unit}; the sweep begins at "
            f"{low:.4g} {unit}: give more steps at low load"
        )
    late = np.flatnonzero(equivalent > high * (1.0 + 1e-12))
    if late.size:
        k = int(late[0])
        until = f"reached up to {seconds[k - 1]:.4g} s" if k else "reached at no time"
        _refuse(
            f"at {seconds[k]:.4g} s the state is that of {equivalent[k]:.4g} {unit} (p = {pressure:.4g} {unit}, "
            f"J(t)/J(0) = {equivalent[k] / pressure:.4g}); the sweep ends at {high:.4g} {unit}, {until}: press "
            "farther, or ask for less"
        )


def _refuse(message: str) -> NoReturn:
    raise StudyError([Problem(message)])


COLUMNS = ("time [s]", "J(t)/J(0)", "p J(t)/J(0)", "A*", "leak x", "leak y", "error x", "error y")
WIDTHS = (8, 16, 8, 16, 16)


def rows_of(over_time: History) -> list[tuple[float, ...]]:
    """Return the numbers of `COLUMNS`, row by row.

    Parameters
    ----------
    over_time : History
        A seal over time.

    Returns
    -------
    list of tuple
        One row for each time; the errors are relative.
    """
    leak, error = over_time.leak, over_time.error
    columns = (over_time.seconds, over_time.ratio, over_time.equivalent, over_time.area)
    table = np.stack([*columns, leak["x"], leak["y"], error["x"], error["y"]], axis=1)
    return [tuple(map(float, row)) for row in table]


def write_csv(over_time: History, path: Path) -> None:
    """Write the numbers as comma-separated values.

    Parameters
    ----------
    over_time : History
        A seal over time.
    path : path
        The file.

    Raises
    ------
    FolderError
        If it cannot be written.
    """
    units = {"p J(t)/J(0)": over_time.pressure_unit, "leak x": over_time.leak_unit, "leak y": over_time.leak_unit}
    head = [f"{name} [{units[name]}]" if name in units else name for name in COLUMNS]
    text = io.StringIO(newline="")
    csv.writer(text).writerows([head, *(map(repr, row) for row in rows_of(over_time))])
    stamped_file.write(path, text.getvalue().encode())


def lines_of(over_time: History) -> list[str]:
    """Return a table for a terminal.

    Parameters
    ----------
    over_time : History
        A seal over time.

    Returns
    -------
    list of str
        Head and one line for each time.
    """
    leak, unit = over_time.leak_unit, over_time.pressure_unit
    head = ("J/J(0)", f"p J/J(0) [{unit}]", "A*", f"Q_x [{leak}]", f"Q_y [{leak}]")
    lines = [f"{'time':>10}  " + "  ".join(f"{name:>{width}}" for name, width in zip(head, WIDTHS, strict=True))]
    for seconds, ratio, equivalent, area, x, y, *_ in rows_of(over_time):
        flows = "  ".join(f"{_leak(value):>16}" for value in (x, y))
        lines.append(f"{_time(seconds):>10}  {ratio:8.4f}  {equivalent:16.4g}  {area:8.4g}  {flows}")
    leaking = [over_time.error[axis][over_time.leak[axis] > 0.0] for axis in over_time.leak]
    worst = np.concatenate(leaking).max(initial=0.0)
    about = f"; estimated error of a leak up to {100.0 * worst:.2g} %" if worst > 0.0 else ""
    lines.append(f"read off the stored sweep{about}")
    return lines


def _leak(value: float) -> str:
    return "closing" if math.isnan(value) else "closed" if value == 0.0 else f"{value:.4g}"


def _time(seconds: float) -> str:
    for size, unit in ((86400.0, "day"), (3600.0, "h"), (60.0, "min")):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
