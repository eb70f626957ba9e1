"""Box counting: how many boxes of side r hold a part of a domain, and the local dimension this gives.

Conventions: lengths are in nodes (r = 1 is one element, r δ its length). The mask is cropped, from
index 0, to as many squares of 2^k nodes as fit side by side; k is the largest that fits the shorter axis. Of the
(2^m + 1)² nodes of a surface 2^m × 2^m are left, without the last row and column.

A period has no first index. Its boxes go around it, and N(r) is the mean over all positions of the lattice of boxes. It
is rows · columns/r² times the share of all boxes of side r that hold a part of the domain. Nothing is cropped.
"""

from typing import NamedTuple

import numpy as np

from roughvol.typing import Array, Index, Mask


class BoxCounts(NamedTuple):
    """Box sides ``r`` = 1, 2, 4 … 2^k [nodes] and the ``counts`` N(r) of boxes with at least one node of the domain."""

    r: Index
    counts: Index | Array


class LocalDimension(NamedTuple):
    """Local dimension 𝒟 (``dimension``) between neighbouring box sides, at their geometric mean ``r_mid`` [nodes]."""

    r_mid: Array
    dimension: Array


def box_counts(mask: Mask, *, periodic: bool = False) -> BoxCounts:
    """Return N(r), the boxes of side r that hold at least one True node (the paper's Section 3.2, Fig. 11a)."""
    levels = min(mask.shape).bit_length() - 1
    sides = 2 ** np.arange(levels + 1, dtype=np.int64)
    if periodic:
        return BoxCounts(sides, _means_around(mask, sides))
    side = 1 << levels
    rows, columns = (side * (length // side) for length in mask.shape)
    boxes = mask[:rows, :columns]
    counts = [np.count_nonzero(boxes)]
    for _ in range(levels):
        # A box of side 2r is black if one of its four boxes of side r is.
        boxes = boxes[::2, ::2] | boxes[1::2, ::2] | boxes[::2, 1::2] | boxes[1::2, 1::2]
        counts.append(np.count_nonzero(boxes))
    return BoxCounts(sides, np.array(counts, dtype=np.int64))


def _means_around(mask: Mask, sides: Index) -> Array:
    """Return N(r) of one period, the mean over all positions of the boxes."""
    means = []
    for side in sides.tolist():
        means.append(np.count_nonzero(mask) / side**2)
        # Now of the boxes of side 2r that begin at each node: one of their four boxes of side r is black.
        mask = mask | np.roll(mask, -side, axis=0)
        mask = mask | np.roll(mask, -side, axis=1)
    return np.array(means)


def local_dimension(counts: BoxCounts) -> LocalDimension:
    """Return 𝒟(r) = -d log N / d log r between neighbouring sides, at r = √(r_i r_{i+1}) (Section 3.2, Fig. 11b)."""
    r_mid = np.sqrt(counts.r[1:] * counts.r[:-1].astype(np.float64))
    if not np.all(counts.counts > 0):
        return LocalDimension(r_mid, np.full(r_mid.shape, np.nan))
    log_counts = np.log(counts.counts)
    return LocalDimension(r_mid, (log_counts[:-1] - log_counts[1:]) / np.diff(np.log(counts.r)))
