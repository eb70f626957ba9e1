"""The part of the grid: on a finer grid loads rise with the slope, and closing load and leak move along with it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roughvol.analysis.leak_budget.state import Grids, Loaded, closing_of, leak_of, log_ratio, part_of_surfaces
from roughvol.analysis.parts import Part
from roughvol.analysis.tables import number
from roughvol.observables.variables import AXES

# From the spacing of a map down to a quarter: python -m tests.bench.card_coverage
OCTAVES = 2.0  # a leak changes at most as much in each as from coarser grids; its loads rise as the slope
PIXEL = 1.0  # octave of the closing load that means over pixels take off the map
SCATTER = 0.25  # logarithm of the closing load: on a finer grid another channel closes last
OPEN = 0.5  # share of it for leaks, which pass through several channels
ROUGH = 0.2  # change of the closing load from twice the spacing, from which on the scatter is whole
STEEP = 0.25  # growth of the slope in an octave, a fractal dimension of 2.36
NO_COARSER = "no coarser grid has enough nodes for the surface"


@dataclass(frozen=True)
class Finer:
    """What a grid 4 times finer may change, as logarithms.

    At one contact area the load goes with the slope. If the spectrum goes on below the map, slopes grow in each octave
    by ``growth``; if the spectrum ends at the map, they stay. The map does not show which.
    """

    growth: float  # of the slope in an octave
    scatter: float  # of the closing load

    @classmethod
    def of(cls, surface: Loaded, others: Sequence[Loaded]) -> Finer:
        """Return what follows from the same surface on coarser grids, those at twice the spacing first.

        Slopes grow below the map as in the last octave but one, or by less as far as the last octave has less: there a
        spectrum that ends shows. Heights at points have slopes of shorter waves in their last octave as well.
        """
        closings = [(surface.closing[axis].value, others[0].closing[axis].value) for axis in AXES]
        changes = [abs(math.log(here / there)) for here, there in closings if math.isfinite(here) and there > 0.0]
        scatter = SCATTER * min(1.0, max(changes, default=ROUGH) / ROUGH)
        slopes = [grid.number("Sdq") for grid in (surface, *others)]
        if not min(slopes) > 0.0:
            return cls(0.0, scatter)
        last, *before = (math.log(here / there) for here, there in itertools.pairwise(slopes))
        return cls(max(0.0, min(before[0], 2.0 * last - before[0]) if before else last), scatter)

    @property
    def of_closing(self) -> tuple[float, float]:
        """By how much closing loads may be smaller and larger."""
        return self.scatter, self.scatter + (OCTAVES + PIXEL) * self.growth

    @property
    def of_leak(self) -> tuple[float, float]:
        """By how much the loads of an open leak may be smaller and larger."""
        return OPEN * self.scatter, OPEN * self.scatter + OCTAVES * self.growth


def _finer_words(finer: Sequence[Finer]) -> str:
    growth = float(np.mean([below.growth for below in finer]))
    if growth == 0.0:
        return "slopes grow no more at this spacing: the spectrum ends before it"
    counts = ": roughness below the spacing counts" if growth >= STEEP else ""
    return f"slopes grow × {math.exp(growth):.2f} as the spacing halves, and may go on so to a quarter of it{counts}"


def grid_part_of_load(fine: Sequence[Loaded], coarser: Grids, finer: Sequence[Finer], axis: str) -> Part:
    """Return the part of the grid of the closing load, from one coarser grid at least."""
    fall, rise = (float(np.mean(logs)) for logs in zip(*(below.of_closing for below in finer), strict=True))
    words = "; ".join((_trend(fine, coarser, axis), _finer_words(finer)))
    return Part("grid", math.exp(rise), words, math.exp(fall))


def grid_part(fine: Sequence[Loaded], coarser: Grids, finer: Sequence[Finer], axis: str) -> Part:
    """Return the part of the grid of the leak: that of the loads, at most twice the largest change from a coarser grid.

    The changes are those from twice the spacing, and from four times to twice. If the way is closed there, no change
    bounds the part. There is one coarser grid at least.
    """
    words = ", ".join(f"{words}: {_change(fine, surfaces, axis)}" for words, surfaces in coarser)
    ends = list[tuple[float, float]]()
    for surface, below, *others in zip(fine, finer, *(surfaces for _, surfaces in coarser), strict=True):
        here, (fall, rise) = surface.leak(axis), below.of_leak
        low, high = surface.leak_if(axis, -fall), surface.leak_if(axis, rise)
        octaves = [abs(log_ratio(*pair, axis)) for pair in itertools.pairwise((surface, *others))]
        if math.isnan(low):  # the change is all that is known: an octave that closes the way is left out
            octaves = [octaves[0], *(log for log in octaves[1:] if math.isfinite(log))]
        change = math.exp(OCTAVES * float(np.max(octaves)))
        ends.append((np.nanmax([here / change, low, 0.0]), np.nanmin([here * change, high, math.inf])))
    return part_of_surfaces("grid", fine, ends, axis, f"{words}; {_finer_words(finer)}")


def _change(fine: Sequence[Loaded], other: Sequence[Loaded], axis: str) -> str:
    """Return the leak in another run over that on the finest grid, in words."""
    here, there = leak_of(fine, axis).value, leak_of(other, axis).value
    if not math.isfinite(there):
        return "not pressed to this load"
    shut = sum(
        surface.leak(axis) > 0.0 and coarse.leak(axis) == 0.0 for surface, coarse in zip(fine, other, strict=True)
    )
    count = f" ({shut} of {len(fine)} surfaces close)" if shut and len(fine) > 1 else ""
    return f"× {number(there / here)}{count}" if there > 0.0 else "closed"


def _trend(fine: Sequence[Loaded], coarser: Grids, axis: str) -> str:
    """Return in words what coarser grids show of a way that is closed on the finest."""
    leaks = [(words, leak_of(surfaces, axis).value) for words, surfaces in coarser]
    unit = fine[0].unit()
    text = [f"{words} the way is open and leaks {number(leak)} {unit}".strip() for words, leak in leaks if leak > 0.0]
    closings = [closing_of(surfaces, axis) for surfaces in (fine, *(surfaces for _, surfaces in coarser))]
    middles = [sum(closing.bracket) / 2.0 for closing in closings]
    known = [load for load in middles if math.isfinite(load)]
    if len(known) > 1 and math.isfinite(middles[0]):
        loads = ", ".join(number(load) for load in reversed(known))
        rises = all(finer_load > coarser_load for finer_load, coarser_load in itertools.pairwise(known))
        text.append(
            f"it closes at about {loads} {closings[0].unit or '(p*)'} from the coarsest grid to the finest"
            + (": closing loads rise, and on a finer grid the way may be open" if rises else "")
        )
    return "; ".join(text) or "coarser grids do not show where a finer grid closes"
