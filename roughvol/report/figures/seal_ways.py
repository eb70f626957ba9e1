"""Ways through the gap: what flows along one direction of one surface under load, and the load at which it closed.

A way is known at its computed states alone. It is closed from the first state at which nothing flows (or no open void
leads from side to side) and that no open state follows; between the last open state and that one the closing load is
not known. Beyond its last state an open way is unknown, not closed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from xarray import DataArray, Dataset

from roughvol.analysis.average import RANGE
from roughvol.analysis.leak import is_lifted
from roughvol.observables.at_state import at_state
from roughvol.report.figures.families import Family, several
from roughvol.typing import Array

GRID = 240  # points of a curve over several surfaces
BAND = (100.0 * RANGE[0], 100.0 * RANGE[1])  # percentiles of a band over surfaces
EVIDENCE = ("transmissivity", "percolates", "critical_gap", "diffusivity")  # each is 0 where a way is closed


class Way(NamedTuple):
    """Computed states of one direction of one surface in the order of loading, shape (states,), and where it closed."""

    load: Array  # of the open states
    value: Array  # there
    closed: float  # load of the first state computed closed, NaN if it was open to the end

    @property
    def end(self) -> float:
        """Load up to which anything is known: without bound once closed."""
        return math.inf if math.isfinite(self.closed) else float(self.load[-1])


def flow(ds: Dataset, name: str, direction: str) -> DataArray:
    """Return a flow along a direction, also 0 at the states at which another variable shows that the way is closed."""
    ds = ds.sel(axis=direction)
    values = ds[name]
    if is_lifted(ds):  # the ways that are stored are those of the dry gap
        return values
    for other in EVIDENCE:
        if other in ds:
            values = values.where(values.notnull() | (ds[other] != 0.0), 0.0)
    return values


def way(load: Array, value: Array) -> Way:
    """Return the way of states in the order of loading; those without a value are not computed."""
    mask = np.isfinite(load) & np.isfinite(value)
    load, value = load[mask], value[mask]
    open_ = np.flatnonzero(value > 0.0)
    last = int(open_[-1]) if open_.size else -1
    closed = float(load[last + 1]) if last + 1 < load.size else math.nan
    return Way(load[open_], value[open_], closed)


def ways(family: Family, x: str, name: str, direction: str) -> list[Way]:
    """Return a flow along a direction against x, one way for each surface that has any state."""
    loads = family.data[x].transpose("seed", "step").values
    values = flow(family.data, name, direction).transpose("seed", "step").values
    members = [way(*pair) for pair in zip(loads, values, strict=True)]
    return [member for member in members if member.load.size or math.isfinite(member.closed)]


def falls(members: Sequence[Way]) -> bool:
    """Return whether x falls along the loading, as V* does."""
    for member in members:
        along = np.append(member.load, member.closed if math.isfinite(member.closed) else [])
        if along.size > 1:
            return bool(along[-1] < along[0])
    return False


def grid(members: Sequence[Way], *, before: bool = False) -> Array:
    """Return points along x, in the order of loading, at which every way is known.

    From the load at which the last has begun (with `before`, the first: a way is open before its first state) to the
    one at which the first ends open, or 5 % beyond the last closing. The closing loads are among the points.
    """
    sign = -1.0 if falls(members) else 1.0
    first = [sign * (member.load[0] if member.load.size else member.closed) for member in members]
    closings = [sign * member.closed for member in members if math.isfinite(member.closed)]
    ends = [sign * float(member.load[-1]) for member in members if not math.isfinite(member.closed)]
    start = min(first) if before else max(first)
    stop = min(ends) if ends else max(closings) + 0.05 * abs(max(closings))
    if stop < start:
        return np.empty(0)
    inside = [load for load in closings if start <= load <= stop]
    return sign * np.unique(np.concatenate([np.linspace(start, stop, GRID), inside]))


def ratios(family: Family, x: str, over: DataArray, direction: str) -> list[Way]:
    """Return ratios ``over`` to a flow along a direction against x, with the loads at which the flow closes."""
    loads = family.data[x].transpose("seed", "step").values
    flows = flow(family.data, "transmissivity", direction).transpose("seed", "step").values
    members = []
    for load, value, flow_values in zip(loads, over.transpose("seed", "step").values, flows, strict=True):
        open_part = way(load, np.where(flow_values > 0.0, value, np.nan))
        members.append(Way(open_part.load, open_part.value, way(load, flow_values).closed))
    return [member for member in members if member.load.size or math.isfinite(member.closed)]


def sample(members: Sequence[Way], at: Array, *, hold: bool = False, beyond: float = 0.0) -> Array:
    """Return every way on points along x, shape (ways, points), NaN where it is not known."""
    rows = np.full((len(members), at.size), np.nan)
    sign = -1.0 if falls(members) else 1.0
    points = sign * at
    for row, member in zip(rows, members, strict=True):
        load, closed = sign * member.load, sign * member.closed
        if load.size:
            inside = (points >= load[0]) & (points <= load[-1])
            row[inside] = np.exp(at_state(load, np.log(member.value), points[inside], straight=True))
            between = (points > load[-1]) & (points < closed)
            ends = [member.value[-1], member.value[-1] if hold else 0.0]
            row[between] = at_state([load[-1], closed], ends, points[between], straight=True)
        row[points >= closed] = beyond
    return rows


def is_open(members: Sequence[Way], at: Array) -> Array:
    """Return 1 where a way is open and 0 from the first state computed closed on, shape (ways, points).

    NaN beyond the last state of one that was open to the end; before its first step a surface hardly touches.
    """
    sign = -1.0 if falls(members) else 1.0
    rows = np.ones((len(members), at.size))
    for row, member in zip(rows, members, strict=True):
        row[sign * at >= sign * member.closed] = 0.0
        row[sign * at > sign * member.end if math.isfinite(member.end) else np.zeros(at.size, bool)] = np.nan
    return rows


def centre_and_band(rows: Array) -> tuple[Array, Array, Array]:
    """Return median, lower and upper end of the band `BAND` at every point, of rows of shape (surfaces, points)."""
    below, centre, above = np.percentile(rows, [BAND[0], 50.0, BAND[1]], axis=0)
    return centre, below, above


def band_words(counts: Sequence[int]) -> str:
    """Return what a curve and a band are, in words; nothing if every family has one surface alone."""
    if not (number := several(counts)):
        return ""
    return f"median of {number} surfaces, band {BAND[0]:.0f} to {BAND[1]:.0f} %"
