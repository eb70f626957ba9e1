"""The load at which the last way along an axis closes, surface by surface and of several surfaces.

A study with ``record.transport.closing`` has the closing load solved. Elsewhere a way is known at its computed states
alone. The last way then closes between the last state with an open way and the next state, and both loads are given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from xarray import Dataset

from roughvol.analysis.leak import ways
from roughvol.analysis.parts import Part, WithParts
from roughvol.analysis.tables import number
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


@dataclass(frozen=True)
class Closing(WithParts):
    """The loads at which the last way of several surfaces closes, in ``unit`` (empty for p*).

    ``spans`` are those of the surfaces whose way is followed. ``parts`` is the error budget of the mean load.
    """

    spans: tuple[Span, ...]
    unit: str
    parts: tuple[Part, ...] = ()

    @property
    def value(self) -> float:
        """Mean of the loads over the surfaces; NaN unless all surfaces close."""
        return float(np.mean(self.bracket))

    @property
    def interval(self) -> tuple[float, float]:
        """Smallest and largest closing load by the budget; NaN if a part is not known."""
        return self.value / self.smaller, self.value * self.factor

    @property
    def closed(self) -> tuple[Span, ...]:
        """The surfaces whose way closes within their sweep."""
        return tuple(span for span in self.spans if span.closes)

    @property
    def bracket(self) -> tuple[float, float]:
        """Means of both ends over the surfaces; NaN unless all surfaces close."""
        return _ends(self.spans) if self.spans and len(self.closed) == len(self.spans) else (math.nan, math.nan)

    @property
    def words(self) -> str:
        """The loads in words."""
        closed, still = self.closed, [span.open_up_to for span in self.spans if not span.closes]
        if not self.spans:
            return "not followed"
        if not closed:
            return f"open up to {self.load(max(still))}, the end of the sweep"
        low, high = _ends(closed)
        at = f"at {self.load(low)}" if low == high else f"between {self._range(low, high)}"
        ends = self.interval
        error = f", between {self._range(*ends)}" if all(map(math.isfinite, ends)) else ""
        if self.parts and not error:
            error = f", its error is not known ({self.unknown})"
        if len(self.spans) == 1:
            return f"{at}{error}"
        if still:
            count = f"{len(closed)} of {len(self.spans)} surfaces"
            return f"{at} on {count}, open up to {self.load(max(still))} on the others"
        first, last = min(span.open_up_to for span in closed), max(span.closed_from for span in closed)
        return f"{at} in the mean{error}; the first surface above {self.load(first)}, the last below {self.load(last)}"

    @property
    def short(self) -> str:
        """The loads in few words, from the last open step of the first surface to the first closed step of the last."""
        if not self.closed:
            return self.words.removesuffix(", the end of the sweep")
        first, last = min(span.open_up_to for span in self.closed), max(span.closed_from for span in self.closed)
        count = f"{len(self.closed)} of {len(self.spans)}: " if len(self.spans) > 1 else ""
        return f"{count}{self.load(first) if first == last else self._range(first, last).replace(' and ', ' to ')}"

    def _range(self, low: float, high: float) -> str:
        """Return two loads in words, with one unit."""
        return f"{self.load(low).removesuffix(f' {self.unit}')} and {self.load(high).removeprefix('p* = ')}"

    def load(self, value: float) -> str:
        """Return a load in ``unit`` in words, as ``0.5 MPa`` or ``p* = 0.3``."""
        return f"{number(value)} {self.unit}" if self.unit else f"p* = {number(value)}"


def _ends(spans: tuple[Span, ...]) -> tuple[float, float]:
    """Return the means of both ends."""
    return float(np.mean([span.open_up_to for span in spans])), float(np.mean([span.closed_from for span in spans]))
