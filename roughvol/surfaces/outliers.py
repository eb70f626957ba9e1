"""Outliers of a measured map: single heights that no surface has, from dust, speckle or a lost signal.

Conventions: heights z on a lattice, axis 0 is x and axis 1 is y; a height that is not known is NaN.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from roughvol.errors import SurfaceError
from roughvol.surfaces import levelling
from roughvol.typing import Array, Index, Mask

NORMAL = 1.482602218505602  # 1/Φ⁻¹(3/4): the median absolute deviation of normal heights is their deviation over this
ROUNDS = 10  # fits of the plane: two sets of outliers may follow each other for ever
LARGEST_SHARE = 0.05  # of heights taken out: beyond, they are a part of the surface
AT_ONCE = 1 << 22  # heights of all windows that are sorted together


def outliers(heights: Array, sigma: float, window: int = 5, degree: str = "tilt", *, periodic: bool = False) -> Mask:
    """Return which heights lie farther than so many robust deviations from the median of their neighbourhood.

        |r - med_w(r)| > sigma s,   s = 1.4826 med |r - med(r)|

    where r are the heights less a plane (or quadratic). med_w is the median of the known heights in the window around
    the node, med that of the whole map. Both medians ignore what up to half of the heights are (Huber 1981), so
    spikes hide neither themselves nor each other. It is the identifier of Hampel (1974) with the deviation of the whole
    map in place of that of the window. This matters twice:

    - A high peak or a deep groove of a real surface is no outlier, as its neighbours are high or deep as well. A
      distance from the mean plane would cut both; of honed surfaces it would cut the grooves.
    - The deviation inside a window is small on smooth parts of a surface. In units of that, ordinary texture beside a
      smooth part would be cut.

    Of white noise with normal heights, r - med_w(r) deviates by less than 1.1 s, and of smoother heights by less. At
    sigma = 6 that is fewer than one height in 10⁷. A patch of dust that fills more than half of the window is its
    own median and stays. Corners of a wall are cut if it rises by more than sigma s from node to node.

    The plane is fitted again without heights farther than sigma s from it, until these are the same twice, or `ROUNDS`
    times. Otherwise the outliers would tilt it, and a tilt would raise s. Where less than half of a window is known,
    the reference is the plane: heights alone in a hole are often wrong and have no neighbours to show it.
    """
    known = ~np.isnan(heights)
    rest, middle, deviation = _robust(heights, known, sigma, degree)
    limit = sigma * deviation
    mask = np.zeros(heights.shape, dtype=bool)
    # Only a node whose window holds a height so far below or above it can be so far from the median.
    reach = window // 2
    framed = np.pad(rest, reach, mode="wrap") if periodic else np.pad(rest, reach, constant_values=np.nan)
    here = (slice(reach, -reach),) * 2
    low = ndimage.minimum_filter(np.where(np.isnan(framed), np.inf, framed), size=window)[here]
    high = ndimage.maximum_filter(np.where(np.isnan(framed), -np.inf, framed), size=window)[here]
    with np.errstate(invalid="ignore"):
        suspect = known & ((rest - low > limit) | (high - rest > limit) | (np.abs(rest - middle) > limit))
    row, column = np.nonzero(suspect)
    windows = np.lib.stride_tricks.sliding_window_view(framed, (window, window))
    inside = [_nodes_inside(n, reach, periodic) for n in heights.shape]
    step = max(AT_ONCE // window**2, 1)
    for start in range(0, len(row), step):
        part = row[start : start + step], column[start : start + step]
        around = np.sort(windows[part].reshape(len(part[0]), -1), axis=1)  # NaN goes to the end
        count = (~np.isnan(around)).sum(axis=1)
        node = np.arange(len(count))
        median = 0.5 * (around[node, (count - 1) // 2] + around[node, count // 2])
        few = 2 * count < inside[0][part[0]] * inside[1][part[1]]
        mask[part] = np.abs(rest[part] - np.where(few, middle, median)) > limit
    share = mask.sum() / known.sum()
    if share > LARGEST_SHARE:
        message = (
            f"outliers: {mask.sum()} heights, {share:.1%}, lie farther than {sigma:g} robust deviations from the "
            f"median of their neighbours; allowed: up to {LARGEST_SHARE:.0%}; raise sigma"
        )
        raise SurfaceError(message)
    return mask


def _nodes_inside(nodes: int, reach: int, periodic: bool) -> Index:
    """Return how many nodes along an axis are in the window around each node."""
    node = np.arange(nodes)
    if periodic:
        return np.full(nodes, 2 * reach + 1)
    return np.asarray(np.minimum(node + reach, nodes - 1) - np.maximum(node - reach, 0) + 1)


def _robust(heights: Array, known: Mask, sigma: float, degree: str) -> tuple[Array, float, float]:
    """Return the heights less a surface that outliers do not bend, their median and their robust deviation."""
    fitted = known
    for _ in range(ROUNDS):
        rest = levelling.level(heights, degree, fitted)
        middle = float(np.median(rest[known]))
        away = np.abs(rest - middle)
        deviation = NORMAL * float(np.median(away[known]))
        near = known & (away <= sigma * deviation)
        if (near == fitted).all():
            break
        fitted = near
    if deviation <= 16.0 * np.finfo(float).eps * float(np.median(np.abs(heights[known]))):
        message = "outliers: half of the heights or more lie in one plane, so there is no robust deviation to count in"
        raise SurfaceError(message)
    return rest, middle, deviation
