"""The critical constriction: the narrowest place of the widest way through the gap.

Conventions are those of `transport`. Elements are taken in the order of falling gap, equal ones in order along the
axis, until the first path is complete. Water that enters from one side finds the last element of that path: it always
enters the widest element on its shore, and fills what lies behind at once (invasion percolation; Wilkinson & Willemsen,
J. Phys. A 16 (1983) 3365-3376). Few floods bracket the gap h_c before, so that few elements must be ordered.
"""

import heapq
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from roughvol.gap.clusters import check_gap, endless
from roughvol.gap.compiled import compiled
from roughvol.typing import Array

_SAMPLE, _BRACKET = 4096, 512  # values of the gap that may bracket h_c, and how many of them a bracket holds


class Constriction(NamedTuple):
    """The narrowest place of the widest way: its gap h_c (0 if there is no way) and its element, row and column."""

    gap: float
    element: tuple[int, int] | None


def constriction(gap: Array, axis: int, *, periodic: bool = False) -> Constriction:
    """Return the critical constriction: the largest h_c such that the elements with g ≥ h_c still percolate."""
    check_gap(gap)
    along = np.ascontiguousarray(gap if axis == 0 else gap.T)
    bracket = _bracket(along, lambda least: _invaded(along, periodic, least, least) >= 0)
    if bracket is None:
        return Constriction(0.0, None)
    place = divmod(_invaded(along, periodic, *bracket), along.shape[1])
    return Constriction(float(along[place]), place if axis == 0 else place[::-1])


def endless_constriction(gap: Array) -> float:
    """Return the largest h_c at which void leads along axis 0 from period to period without end; 0 without a way."""
    check_gap(gap)
    bracket = _bracket(gap, lambda least: endless(gap >= least))
    if bracket is None:
        return 0.0
    values = np.unique(gap[(gap >= bracket[0]) & (gap < bracket[1])])
    while values.size > 1:
        upper = values[values.size // 2 :]
        values = upper if endless(gap >= upper[0]) else values[: values.size // 2]
    return float(values[0])


def _bracket(gap: Array, connected: Callable[[float], bool]) -> tuple[float, float] | None:
    """Return gaps low < high, where the elements of g ≥ low are connected, and those of g ≥ high are not."""
    some = gap.ravel()[:: gap.size // _SAMPLE | 1]  # odd: lines of 2^m elements are met in more than few columns
    sample = np.unique(some[some > 0.0])
    values = np.concatenate([[np.nextafter(0.0, 1.0)], sample, [np.inf]])
    low, high = 0, values.size - 1
    while high - low > _BRACKET:
        middle = (low + high) // 2
        if connected(values[middle]):
            low = middle
        else:
            high = middle
    if low == 0 and not connected(values[0]):
        return None
    return float(values[low]), float(values[high])


@compiled
def _invaded(gap: Array, periodic: bool, least: float, flooded: float) -> int:
    """Return the last element (flat) of the first complete path along axis 0; -1 without a path of g ≥ least.

    Elements of the first line are wet, and so are elements of g ≥ flooded beside wet ones. Where that makes no path,
    the widest dry element beside a wet one is next.
    """
    rows, columns = gap.shape
    wet, stack, shore = np.zeros(gap.size, np.bool_), np.empty(gap.size, np.int32), [(0.0, 0)]
    shore.clear()
    narrowest, latest = flooded, -1
    for j in range(columns):
        if gap[0, j] >= least:
            heapq.heappush(shore, (-gap[0, j], j))
            wet[j] = True
    while shore:
        fall, here = heapq.heappop(shore)
        if -fall < narrowest or (-fall == narrowest and here > latest >= 0):
            narrowest, latest = -fall, here
        stack[0], top = here, 1
        while top:
            top -= 1
            i = stack[top] // columns
            j = stack[top] - i * columns
            if i + 1 == rows:
                return latest if latest >= 0 else stack[top]
            for there, beside in ((i, j - 1), (i, j + 1), (i - 1, j), (i + 1, j)):  # the last leaves the stack first
                if periodic:
                    beside %= columns
                if there < 0 or beside < 0 or beside == columns:
                    continue
                at, width = there * columns + beside, gap[there, beside]
                if width >= least and not wet[at]:
                    wet[at] = True
                    if width > narrowest or (width == narrowest and (latest < 0 or at <= latest)):
                        stack[top] = at
                        top += 1
                    else:
                        heapq.heappush(shore, (-width, at))
    return -1
