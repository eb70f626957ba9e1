"""Clusters of the gap: percolation, shares of the free volume, and sizes of contact and pockets.

Conventions are those of `transport`: void is 4-connected, contact 8-connected. Opposite sides of a period are joined.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from roughvol.errors import ContactError
from roughvol.typing import Array, Index, Mask

SIDES = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])
SIDES_AND_CORNERS = np.ones((3, 3))


class Connectivity(NamedTuple):
    """How void and contact hang together, with shares of the free volume and sizes [elements], the largest first.

    ``connected`` reaches a side of the patch; of a periodic surface, it percolates. ``percolating`` does so along
    either axis. connected + trapped = 1, or NaN where there is no volume. Pockets are void that is not connected.
    """

    percolates_x: bool
    percolates_y: bool
    connected: float
    percolating: float
    trapped: float
    contact_clusters: Index
    trapped_pockets: Index


def percolates(void: Mask, *axes: int, periodic: bool = False) -> bool:
    """Return whether 4-connected void leads from the first to the last line of elements along any of the axes."""
    labels = dict[tuple[bool, bool], NDArray[np.integer]]()
    for axis in axes:
        if (sides := joined(axis, periodic)) not in labels:
            labels[sides], _ = labelled(void, SIDES, sides)
        if spanning(labels[sides], axis).size:
            return True
    return False


def connectivity(gap: Array, contact: Mask, *, periodic: bool = False) -> Connectivity:
    """Return what percolates, the shares of the free volume, and the clusters of contact and of trapped void."""
    everywhere = (periodic, periodic)
    void: Mask = gap > 0.0
    labels, count = labelled(void, SIDES, everywhere)
    volumes = np.bincount(labels.ravel(), (gap / (gap.max() or 1.0)).ravel(), count + 1)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    along = [spanning(labels, axis) for axis in (0, 1)]
    reaches = np.zeros(count + 1, dtype=np.bool_)
    if periodic:
        along = [spanning_period(labels, void, axis) for axis in (0, 1)]
        reaches[np.union1d(*along)] = True
    else:
        for line in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
            reaches[line] = True
    reaches[0] = True  # label 0 is the closed rest, without volume
    total = volumes.sum() or np.nan
    clusters, _ = labelled(contact, SIDES_AND_CORNERS, everywhere)
    return Connectivity(
        percolates_x=bool(along[0].size),
        percolates_y=bool(along[1].size),
        connected=float(volumes[reaches].sum() / total),
        percolating=float(volumes[np.union1d(*along)].sum() / total),
        trapped=float(volumes[~reaches].sum() / total),
        contact_clusters=np.sort(np.bincount(clusters.ravel())[1:])[::-1],
        trapped_pockets=np.sort(sizes[~reaches])[::-1],
    )


def endless(void: Mask) -> bool:
    """Return whether 4-connected void of a periodic field leads along axis 0 from period to period without end.

    A path from side to side may miss its own continuation in the next period. Clusters between the seams are numbered
    by their period; a cluster that meets itself in another period leads on without end.
    """
    labels, _ = labelled(void, SIDES, (False, True))
    over = (labels[-1] > 0) & (labels[0] > 0)
    neighbours: dict[int, list[tuple[int, int]]] = {}
    for before, after in np.unique(np.stack([labels[-1][over], labels[0][over]]), axis=1).T.tolist():
        neighbours.setdefault(before, []).append((after, 1))
        neighbours.setdefault(after, []).append((before, -1))
    period: dict[int, int] = {}
    for start in neighbours:
        if start in period:
            continue
        period[start] = 0
        waiting = [start]
        while waiting:
            here = waiting.pop()
            for there, step in neighbours[here]:
                if there not in period:
                    period[there] = period[here] + step
                    waiting.append(there)
                elif period[there] != period[here] + step:
                    return True
    return False


def joined(axis: int, periodic: bool) -> tuple[bool, bool]:
    """Return along which axes opposite sides are joined, for a flow along one of them."""
    return periodic and axis == 1, periodic and axis == 0


def labelled(mask: Mask, structure: NDArray[Any], joined: tuple[bool, bool]) -> tuple[NDArray[np.integer], int]:
    """Return the numbers of the connected clusters, and how many there are. Sides may be joined along each axis."""
    if not any(joined):
        labels, count = scipy.ndimage.label(mask, structure)
        return labels, int(count)
    from scipy.sparse import csgraph  # for periods alone

    # The first line of a joined axis comes again behind the last one: both numbers of its elements are of one cluster.
    labels, count = scipy.ndimage.label(np.pad(mask, [(0, int(join)) for join in joined], mode="wrap"), structure)
    seams = [lines[[0, -1]] for lines, join in zip((labels, labels.T), joined, strict=True) if join]
    pairs = np.concatenate(seams, axis=1)
    graph = scipy.sparse.coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(count + 1, count + 1))
    components, number = csgraph.connected_components(graph, directed=False)  # the closed rest, 0, is joined to none
    return number[labels[: mask.shape[0], : mask.shape[1]]], components - 1


def spanned(void: Mask, periodic: bool) -> Mask:
    """Return the void that leads from side to side along axis 0."""
    labels, _ = labelled(void, SIDES, joined(0, periodic))
    leads = np.zeros(int(labels.max()) + 1, dtype=np.bool_)
    leads[spanning(labels, 0)] = True
    return leads.take(labels)


def spanning_period(labels: NDArray[np.integer], void: Mask, axis: int) -> NDArray[np.integer]:
    """Return the labels of a period that hold a path from side to side along an axis."""
    between, _ = labelled(void, SIDES, joined(axis, periodic=True))
    return np.unique(labels[np.isin(between, spanning(between, axis))])


def spanning(labels: NDArray[np.integer], axis: int) -> NDArray[np.integer]:
    """Return the labels found on both sides along an axis."""
    ends = labels.T if axis else labels
    both = set(ends[0].tolist()) & set(ends[-1].tolist())  # numpy is slow for short lines
    return np.array(sorted(both - {0}), dtype=labels.dtype)


def check_gap(gap: Array) -> None:
    """Refuse a gap that is no 2-D field of finite numbers ≥ 0."""
    if gap.ndim != 2 or gap.size == 0 or not np.all((gap >= 0.0) & np.isfinite(gap)):
        least = f" with minimum {gap.min():g}" if gap.size and np.isfinite(gap).all() else ""
        raise ContactError(f"gap must be a 2-D field of finite numbers >= 0, got shape {gap.shape}{least}")
