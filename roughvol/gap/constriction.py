"""The critical constriction: the narrowest place of the widest way through the gap.

Conventions are those of `transport`. Elements are taken in the order of falling gap, equal ones row by row, until the
first path is complete. Few labellings bracket the gap h_c between a value at which elements percolate and one at which
they do not. The graph of the elements in the bracket, and of the clusters wider than the bracket, is small. Its
minimum spanning tree contains the widest way (Hu, Operations Research 9 (1961) 898-900).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from roughvol.gap.clusters import SIDES, check_gap, endless, joined, labelled, percolates
from roughvol.typing import Array, Index, Mask

_SAMPLE, _BRACKET = 4096, 128  # values of the gap that may bracket h_c, and how many of them a bracket holds


class Constriction(NamedTuple):
    """The narrowest place of the widest way: its gap h_c (0 if there is no way) and its element, row and column."""

    gap: float
    element: tuple[int, int] | None


def constriction(gap: Array, axis: int, *, periodic: bool = False) -> Constriction:
    """Return the critical constriction: the largest h_c such that the elements with g ≥ h_c still percolate.

    See Also
    --------
    conduction : Returns the flow through the gap.

    Examples
    --------
    >>> import numpy as np
    >>> from roughvol.gap.constriction import constriction
    >>> gap = np.ones((4, 6))
    >>> gap[:, 2] = 0.5  # a throat across the flow along y
    >>> constriction(gap, axis=1).gap
    0.5
    """
    check_gap(gap)
    bracket = _bracket(gap, lambda void: percolates(void, axis, periodic=periodic))
    if bracket is None:
        return Constriction(0.0, None)
    low, high = bracket
    labels, _ = labelled(gap >= high, SIDES, joined(axis, periodic))
    between = _falling(gap, low, high)
    element = between[_last_of_the_widest_way(labels, between, axis, periodic)]
    row, column = divmod(int(element), gap.shape[1])
    return Constriction(float(gap[row, column]), (row, column))


def endless_constriction(gap: Array) -> float:
    """Return the largest h_c at which void leads along axis 0 from period to period without end; 0 without a way."""
    check_gap(gap)
    bracket = _bracket(gap, endless)
    if bracket is None:
        return 0.0
    values = np.unique(gap.ravel()[_falling(gap, *bracket)])
    while values.size > 1:
        upper = values[values.size // 2 :]
        values = upper if endless(gap >= upper[0]) else values[: values.size // 2]
    return float(values[0])


def _bracket(gap: Array, connected: Callable[[Mask], bool]) -> tuple[float, float] | None:
    """Return gaps low < high, where the elements of g ≥ low are connected, and those of g ≥ high are not."""
    open_gaps = gap[gap > 0.0]
    sample = np.unique(open_gaps[:: max(1, gap.size // _SAMPLE)])
    values = np.concatenate([[np.nextafter(0.0, 1.0)], sample, [np.inf]])
    low, high = 0, values.size - 1
    while high - low > _BRACKET:
        middle = (low + high) // 2
        if connected(gap >= values[middle]):
            low = middle
        else:
            high = middle
    if low == 0 and not connected(gap > 0.0):
        return None
    return float(values[low]), float(values[high])


def _falling(gap: Array, low: float, high: float) -> Index:
    """Return the flat indices of the elements with low ≤ g < high in the order of falling gap."""
    flat = gap.ravel()
    between = np.flatnonzero((flat >= low) & (flat < high))
    return between[np.argsort(-flat[between], kind="stable")]


def _last_of_the_widest_way(labels: NDArray[np.integer], between: Index, axis: int, periodic: bool) -> int:
    """Return the place, in the order of falling gap, of the narrowest element of the widest way along an axis.

    Nodes are the two sides, the clusters of wider elements, and the elements ``between``. The weight of a joint is the
    place of its narrower end.
    """
    shape, clusters = labels.shape, int(labels.max())
    node = labels.astype(np.int32)  # graphs of scipy before 1.17 have no larger ones
    node.ravel()[between] = np.arange(between.size) + clusters + 1
    inlet, outlet = 0, clusters + between.size + 1
    place = np.concatenate([np.full(clusters + 1, -1), np.arange(between.size), [-1]])
    here = np.stack(np.unravel_index(between, shape))
    tails, heads = [], []
    for along, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        there = here.copy()
        there[along] += step
        if joined(axis, periodic)[along]:
            there[along] %= shape[along]
        inside = (there[along] >= 0) & (there[along] < shape[along])
        tails.append(node[*here[:, inside]])
        heads.append(node[*there[:, inside]])
    for side, line in ((inlet, node.take(0, axis)), (outlet, node.take(-1, axis))):
        heads.append(line)
        tails.append(np.full(line.size, side, dtype=np.int32))
    tail, head = np.concatenate(tails), np.concatenate(heads)
    open_joint = head > 0  # no closed element
    ends = np.sort([tail[open_joint], head[open_joint]], axis=0)
    weight = np.maximum(place[ends[0]], place[ends[1]]) + 2.0
    size = (outlet + 1, outlet + 1)
    summed, count = (sparse.coo_array((w, ends), shape=size).tocsr() for w in (weight, np.ones_like(weight)))
    summed.data /= count.data  # a joint found twice has its weight once
    tree = csgraph.minimum_spanning_tree(summed)
    _, before = csgraph.breadth_first_order(tree, inlet, directed=False)
    last, at = -1, outlet
    while at != inlet:
        last, at = max(last, int(place[at])), int(before[at])
    return last
