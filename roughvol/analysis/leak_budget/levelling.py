"""The part of the levelling: the change of leak and closing load with another levelling of a height file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roughvol.analysis.leak import is_lifted
from roughvol.analysis.leak_budget.state import Loaded, closing_of, log_of, log_ratio, part_of_surfaces
from roughvol.analysis.parts import Part
from roughvol.analysis.tables import number


@dataclass(frozen=True, eq=False)
class Levelled:
    """Surfaces with another levelling, in words, and before it, both on one grid."""

    words: str
    before: list[Loaded]
    after: list[Loaded]

    def of_load(self, axis: str) -> float:
        """Return the logarithm of what the levelling does to the closing load; NaN where it is not known."""
        return log_of(closing_of(self.before, axis).value, closing_of(self.after, axis).value)


def levelling_part_of_load(levelled: Levelled, axis: str) -> Part:
    """Return the part of the levelling of the closing load."""
    log = levelled.of_load(axis)
    if math.isnan(log):
        return Part("levelling", math.nan, f"with {levelled.words}: not closed within the sweep")
    return Part("levelling", math.exp(abs(log)), f"with {levelled.words}: × {number(math.exp(log))}")


def levelling_part(fine: Sequence[Loaded], levelled: Levelled, axis: str) -> Part:
    """Return the part of the levelling of the leak; where the way closes on its grid, that of the closing load."""
    ends, logs = list[tuple[float, float]](), list[float]()
    for surface, before, after in zip(fine, levelled.before, levelled.after, strict=True):
        log = _log_of_levelling(surface, before, after, axis)
        here, change = surface.leak(axis), math.exp(abs(log))
        ends.append((here / change, here * change))
        if math.isnan(log) and after.closing[axis].value > 0.0 and before.closing[axis].value > 0.0:
            of_load = abs(math.log(after.closing[axis].value / before.closing[axis].value))
            ends[-1] = surface.leak_if(axis, -of_load), surface.leak_if(axis, of_load)
        logs.append(log)
    words, of_loads = "not known at this load", levelled.of_load(axis)
    if np.isfinite(logs).all():
        words = f"× {number(math.exp(float(np.median(logs))))}"
    elif math.isfinite(of_loads):
        words = f"closes at × {number(math.exp(of_loads))} of the load"
    return part_of_surfaces("levelling", fine, ends, axis, f"with {levelled.words}: {words}")


def _log_of_levelling(surface: Loaded, before: Loaded, after: Loaded, axis: str) -> float:
    """Return the logarithm of what a levelling does to the leak; NaN where the way closes.

    A coarser grid closes at a smaller load. The leaks are those at the same share of the closing load.
    """
    closes, known = before.closing[axis].value, surface.closing[axis].value
    if not surface.leads or is_lifted(surface.table) or not (0.0 < known < math.inf and 0.0 < closes < math.inf):
        return log_ratio(before, after, axis)
    load = surface.load * closes / known
    return log_of(before.leak_at(axis, load), after.leak_at(axis, load))
