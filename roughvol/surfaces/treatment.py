"""Measured heights made fit to be pressed: outliers out, another lattice, levelled, holes filled, short waves filtered.

Conventions: heights z on a lattice, axis 0 is x and axis 1 is y. A height that is not known is NaN. Nothing is changed
in place. All functions but `outliers` are linear in z, so the sum of two treated surfaces is their treated sum.
`level`, `fill` and `low_pass` are exact under a change of the unit of z by a power of two.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from roughvol.errors import SurfaceError
from roughvol.typing import Array, Index, Mask

NORMAL = 1.482602218505602  # 1/Φ⁻¹(3/4): the median absolute deviation of normal heights is their deviation over this
ROUNDS = 10  # fits of the plane: two sets of outliers may follow each other for ever
LARGEST_SHARE_OUT = 0.05  # of heights taken out: beyond, they are a part of the surface
AT_ONCE = 1 << 22  # heights of all windows that are sorted together
AT_NODE = 1e-9  # of an axis: a place as near to a node is at the node
ROUNDING = 2e-15  # of the largest height: what a fit leaves of an exact plane is no roughness
LEVELS = {"mean": 0, "tilt": 1, "quadratic": 2}  # degree of the surface that is taken off
LARGEST_SHARE = 0.5  # of missing nodes that is filled: beyond, a map is more invented than measured

ALPHA = math.sqrt(math.log(2.0) / math.pi)  # ISO 16610-61: halves the amplitude at the cut-off
REACH = 1.5  # in cut-offs; there the weight has fallen to e^(-2.25 π²/ln 2) = 1e-14 of its largest


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
    low = scipy.ndimage.minimum_filter(np.where(np.isnan(framed), np.inf, framed), size=window)[here]
    high = scipy.ndimage.maximum_filter(np.where(np.isnan(framed), -np.inf, framed), size=window)[here]
    with np.errstate(invalid="ignore"):
        suspect = known & ((rest - low > limit) | (high - rest > limit) | (np.abs(rest - middle) > limit))
    row, column = np.nonzero(suspect)
    windows = np.lib.stride_tricks.sliding_window_view(framed, (window, window))
    nodes_in_window = (np.convolve(np.ones(n), np.ones(window))[reach : reach + n] for n in heights.shape)
    inside = [np.full(nodes.shape, window) if periodic else nodes for nodes in nodes_in_window]
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
    if share > LARGEST_SHARE_OUT:
        raise SurfaceError(
            f"outliers: {mask.sum()} heights, {share:.1%}, lie farther than {sigma:g} robust deviations from the "
            f"median of their neighbours; allowed: up to {LARGEST_SHARE_OUT:.0%}; raise sigma"
        )
    return mask


def _robust(heights: Array, known: Mask, sigma: float, degree: str) -> tuple[Array, float, float]:
    """Return the heights less a surface that outliers do not bend, their median and their robust deviation."""
    fitted = known
    for _ in range(ROUNDS):
        rest = level(heights, degree, fitted)
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


def block_means(heights: Array, side: int) -> Array:
    """Return the means of the known heights in blocks of nodes, k times as far apart as the nodes.

    The mean of a plane over a block is the plane in the middle of the block. A mean is NaN where more than half of its
    block is not known. Rows and columns at the end that fill no block are left out.
    """
    rows, columns = (nodes // side for nodes in heights.shape)
    blocks = heights[: rows * side, : columns * side].reshape(rows, side, columns, side)
    count = (~np.isnan(blocks)).sum(axis=(1, 3))
    total = np.nansum(blocks, axis=(1, 3))
    return np.where(2 * count >= side**2, total / np.maximum(count, 1), np.nan)


def squared(heights: Array, ratio: float) -> Array:
    """Return the heights on square pixels of the finer of the two spacings, by cubic splines along the coarser axis.

    The ratio is the side of the pixels along y over that along x. A node between two others is NaN if one of them is.
    Interpolation onto the finer spacing leaves every wave that the map holds. A cubic spline keeps waves of four pixels
    and more to 3 % of their amplitude, wherever the new nodes fall between the old. Linear interpolation takes off up
    to 1 - cos(π/4) = 29 %, and nothing where old and new nodes meet, so roughness would vary over the map. Planes are
    exact.
    """
    axis = 1 if ratio > 1.0 else 0
    finer = ratio if ratio > 1.0 else 1.0 / ratio
    nodes = heights.shape[axis]
    last = (nodes - 1) * finer
    position = np.arange(int(np.floor(last + AT_NODE * nodes)) + 1) / finer
    nearest = np.rint(position)
    position = np.where(np.abs(position - nearest) < AT_NODE * nodes, nearest, position)
    missing = np.isnan(heights)
    filled = fill(heights, "interpolate") if missing.any() else heights
    spline = scipy.interpolate.make_interp_spline(np.arange(nodes), filled, k=min(3, nodes - 1), axis=axis)
    between = np.floor(position).astype(int), np.ceil(position).astype(int)
    gone = missing.take(between[0], axis=axis) | missing.take(between[1], axis=axis)
    return np.where(gone, np.nan, spline(position))


def level(heights: Array, kind: str, among: Mask | None = None) -> Array:
    """Return the heights less the least-squares surface of the known ones.

    z' = z - Σ c_ab x^a y^b over a + b ≤ n, where the c minimise Σ z'² over the nodes with known z. The degree n is 0
    for ``mean``, 1 for ``tilt`` (a plane) and 2 for ``quadratic``. ``among`` restricts the fit to some of the known
    nodes.
    """
    mask, degree = _some_known(heights), LEVELS[kind]
    support = mask if among is None else among & mask
    terms = [(a, b) for a in range(degree + 1) for b in range(degree + 1 - a)]
    x, y = (np.vander(np.linspace(-1.0, 1.0, nodes), 2 * degree + 1, increasing=True) for nodes in heights.shape)
    moments = x.T @ support @ y  # Σ x^a y^b over the fitted nodes
    normal = np.array([[moments[a + c, b + d] for c, d in terms] for a, b in terms])
    exponent = _exponent(heights)
    left = np.ldexp(np.where(mask, heights, 0.0), -exponent)
    for _ in range(3):  # the second and third time take off what rounding in the normal equations has left
        weighted = x[:, : degree + 1].T @ np.where(support, left, 0.0) @ y[:, : degree + 1]
        # where the fitted nodes do not fix all terms (all in one line), those of the smallest coefficients
        fitted = np.linalg.lstsq(normal, np.array([weighted[a, b] for a, b in terms]), rcond=1e-13)[0]
        coefficients = np.zeros((degree + 1, degree + 1))
        coefficients[tuple(np.transpose(terms))] = fitted
        left -= np.where(mask, x[:, : degree + 1] @ coefficients @ y[:, : degree + 1].T, 0.0)
    if np.abs(left[mask]).max() <= ROUNDING:  # a plane: what is left has no shape
        left[:] = 0.0
    return np.where(mask, np.ldexp(left, exponent), np.nan)


def fill(heights: Array, rule: str, *, periodic: bool = False) -> Array:
    """Return the heights with those filled in that are not known, at most half of them.

    ``nearest`` takes the height of the nearest known node (of several equally near ones always the same). With
    ``interpolate`` every filled height is the mean of its 4 neighbours, 3 or 2 at the rim (the discrete Laplace
    equation). This is smooth, exact for a plane away from the rim, and within the known heights around the hole.
    """
    missing = ~_some_known(heights)
    share = float(missing.mean())
    if share > LARGEST_SHARE:
        raise SurfaceError(f"{missing.sum()} of {missing.size} heights are missing; allowed: up to {LARGEST_SHARE:.0%}")
    if not missing.any():
        return heights.copy()
    filled = heights.copy()
    if rule == "nearest":
        row, column = _nearest(missing, periodic)
        filled[missing] = heights[row[missing], column[missing]]
    else:
        filled[missing] = _harmonic(heights, missing, periodic)
    return filled


def low_pass(heights: Array, spacing: float, cut_off: float) -> Array:
    """Return the heights without their waves shorter than the cut-off λc, from 2 δ to the shorter side: ISO 16610-61.

        s(x) = exp(-π (x/(α λc))²) / (α λc),   α = √(ln 2/π),   transmission exp(-π (α λc/λ)²)

    along x and along y; together they weigh by distance alone. A wave of wavelength λc in any direction keeps half its
    amplitude, if the lattice samples it (λc ≳ 4 δ). At the edges the weights inside are scaled up to a sum of one. A
    constant then passes unchanged everywhere, a plane at 1.5 λc and more from the edge.
    """
    shorter = spacing * (min(heights.shape) - 1)
    if not 2.0 * spacing <= cut_off <= shorter:
        allowed = f"{2.0 * spacing:.6g} (twice the spacing) to {shorter:.6g} (the shorter side)"
        raise SurfaceError(f"low_pass is {cut_off:.6g} in the unit of L; allowed: {allowed}")
    from scipy import signal  # imports scipy.stats: half a second, for this filter alone

    reach = math.ceil(REACH * cut_off / spacing)
    weights = np.exp(-math.pi * np.square(np.arange(-reach, reach + 1) * spacing / (ALPHA * cut_off)))
    exponent = _exponent(heights)
    filtered = np.ldexp(heights, -exponent)
    middle = float(filtered.mean())  # taken off and put back, so that rounding is that of the roughness alone
    filtered -= middle
    for nodes in heights.shape:
        inside = np.convolve(np.ones(nodes), weights)[reach : reach + nodes]
        wider = signal.oaconvolve(filtered, weights[:, np.newaxis], axes=0)
        filtered = (wider[reach : reach + nodes] / inside[:, np.newaxis]).T
    return np.ascontiguousarray(np.ldexp(filtered + middle, exponent), dtype=np.float64)


def _some_known(heights: Array) -> Mask:
    mask = ~np.isnan(heights)
    if not mask.any():
        raise SurfaceError(f"none of the {heights.size} heights is known")
    return mask


def _exponent(heights: Array) -> int:
    """Power of two that brings the heights to about one: squares and products of any heights are then floats."""
    return math.frexp(float(np.nanmax(np.abs(heights))))[1]


def _nearest(missing: Mask, periodic: bool) -> tuple[Index, Index]:
    """Return the row and column of the known node nearest to each node."""
    rows, columns = missing.shape
    # every known node of a period has an image within half a period along each axis
    frame = ((rows // 2 + 1,) * 2, (columns // 2 + 1,) * 2) if periodic else ((0, 0), (0, 0))
    padded = np.pad(missing, frame, mode="wrap") if periodic else missing
    row, column = scipy.ndimage.distance_transform_edt(padded, return_distances=False, return_indices=True)
    top, left = frame[0][0], frame[1][0]
    here = np.s_[top : top + rows, left : left + columns]
    return (row[here] - top) % rows, (column[here] - left) % columns


def _harmonic(heights: Array, missing: Mask, periodic: bool) -> Array:
    """Return the missing heights from the discrete Laplace equation, with natural conditions at the rim of a patch."""
    from scipy.sparse import linalg  # for holes alone

    rows, columns = heights.shape
    number = np.full(heights.shape, -1)
    number[missing] = np.arange(missing.sum())
    row, column = np.nonzero(missing)
    here = number[row, column]
    neighbours, known_sum = np.zeros(len(here)), np.zeros(len(here))
    exponent = _exponent(heights)
    scaled = np.ldexp(heights, -exponent)
    entries: list[tuple[Index, Index]] = []
    for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        there_row, there_column = row + down, column + right
        if periodic:
            there_row, there_column = there_row % rows, there_column % columns
        inside = (there_row >= 0) & (there_row < rows) & (there_column >= 0) & (there_column < columns)
        neighbours += inside
        own, there = here[inside], (there_row[inside], there_column[inside])
        unknown = missing[there]
        np.add.at(known_sum, own[~unknown], scaled[there][~unknown])
        entries.append((own[unknown], number[there][unknown]))
    first, second = (np.concatenate(part) for part in zip(*entries, strict=True))
    coupling = scipy.sparse.coo_array((-np.ones(len(first)), (first, second)), shape=(len(here), len(here)))
    system = (scipy.sparse.diags_array(neighbours) + coupling).tocsc()
    solved = linalg.spsolve(system, known_sum, permc_spec="MMD_AT_PLUS_A")
    return np.ldexp(np.atleast_1d(solved), exponent)
