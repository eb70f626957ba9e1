"""The load at which the last way along an axis closes, surface by surface.

A study with ``record.transport.closing`` has the closing load solved. Elsewhere a way is known at its computed states
alone. The last way then closes between the last state with an open way and the next state, and both loads are given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from xarray import Dataset

from roughvol.analysis.leak import ways
from roughvol.observables.variables import SOLVED
from roughvol.typing import Array

LOADS = ("nominal_pressure", "mean_pressure")


@dataclass(frozen=True)
class Span:
    """The loads between which the last way along an axis of a surface closes; equal loads where the closing is solved.

    ``open_up_to`` is 0 if no state has an open way. ``closed_from`` is infinite if the way is open at the last state.
    """

    open_up_to: float
    closed_from: float

    @property
    def closes(self) -> bool:
        """Whether the way closes within the stored states."""
        return math.isfinite(self.closed_from)


def load_of(group: Dataset) -> str:
    """Return the name of the load of a table: the nominal pressure where it is known, else p*."""
    return next(name for name in LOADS if name in group)


def spans(group: Dataset, axis: str, load: str = "") -> list[Span]:
    """Return where the last way along an axis of each surface closes; empty without a record of it.

    ``group`` is one loading leg with the ways of `derived.derived`; under fluid pressure they are those of the dry gap.
    Surfaces without a computed state are left out. Default of ``load``: the variable of `load_of`.
    """
    load = load or load_of(group)
    loads, name = group[load].transpose("seed", "step").values, ways(group)
    without = np.full(loads.shape, 1.0 if SOLVED in group else np.nan)  # a way without a solved closing is open
    rows = group[name].sel(axis=axis).transpose("seed", "step").values if name else without
    solved = solved_loads(group, axis, load)
    surfaces = zip(solved, rows, loads, strict=True)
    found = [Span(end, end) if math.isfinite(end) else span_of(way, at) for end, way, at in surfaces]
    return [span for span in found if span is not None]


def solved_loads(group: Dataset, axis: str, load: str, leg: int = 1) -> list[float]:
    """Return the solved load at which each surface closes along an axis, as a variable of `LOADS`; NaN without it.

    On a later leg elastic contact closes and opens at the same load. A surface that yields does not.
    """
    if SOLVED not in group or (leg > 1 and "plastic_volume" in group):
        return [math.nan] * group.sizes["seed"]
    loads, starred = (group[name].transpose("seed", "step").values for name in (load, "mean_pressure"))
    return [
        float(end) * load_per_starred(at, p)
        for end, at, p in zip(group[SOLVED].sel(axis=axis).values, loads, starred, strict=True)
    ]


def load_per_starred(loads: Array, starred: Array) -> float:
    """Return a load over p* on the states of a surface, from the largest; NaN without a load."""
    at = int(np.nanargmax(starred)) if np.isfinite(starred).any() else 0
    return float(loads[at] / starred[at]) if starred[at] else math.nan


def span_of(way: Array, loads: Array) -> Span | None:
    """Return where a way closes that is open where it is > 0, along rising loads; None without a computed state."""
    known = np.isfinite(way) & np.isfinite(loads)
    if not known.any():
        return None
    loads, still = loads[known], np.flatnonzero(way[known] > 0.0)
    last = int(still[-1]) if still.size else -1
    below = float(loads[last]) if last >= 0 else 0.0
    return Span(below, float(loads[last + 1]) if last + 1 < loads.size else math.inf)
