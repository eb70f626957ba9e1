"""Measured heights made fit to be pressed: levelled, their holes filled, their short waves filtered off.

Conventions: heights z on a lattice, axis 0 is x and axis 1 is y. A height that is not known is NaN. Nothing is changed
in place. All functions are linear in z, so the sum of two treated surfaces is their treated sum. All are exact under a
change of the unit of z by a power of two.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse import linalg

from roughvol.errors import SurfaceError
from roughvol.typing import Array, Index, Mask

LEVELS = {"none": -1, "mean": 0, "tilt": 1, "quadratic": 2}  # degree of the surface that is taken off
FILLS = ("nearest", "interpolate")
LARGEST_SHARE = 0.5  # of missing nodes that is filled: beyond, a map is more invented than measured

ALPHA = math.sqrt(math.log(2.0) / math.pi)  # ISO 16610-61: halves the amplitude at the cut-off
REACH = 1.5  # in cut-offs; there the weight has fallen to e^(-2.25 π²/ln 2) = 1e-14 of its largest


def level(heights: Array, kind: str, among: Mask | None = None) -> Array:
    """Return the heights less the least-squares surface of the known ones.

    z' = z - Σ c_ab x^a y^b over a + b ≤ n, where the c minimise Σ z'² over the nodes with known z. The degree n is 0
    for ``mean``, 1 for ``tilt`` (a plane) and 2 for ``quadratic``. ``none`` takes nothing off. ``among`` restricts the
    fit to some of the known nodes.
    """
    if kind not in LEVELS:
        raise SurfaceError(f"level must be one of {', '.join(map(repr, LEVELS))}, got {kind!r}")
    mask = _some_known(heights)
    support = mask if among is None else among & mask
    degree = LEVELS[kind]
    if degree < 0:
        return heights.copy()
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
    return np.where(mask, np.ldexp(left, exponent), np.nan)


def fill(heights: Array, rule: str, *, periodic: bool = False) -> Array:
    """Return the heights with those filled in that are not known, at most half of them.

    ``nearest`` takes the height of the nearest known node (of several equally near ones always the same). With
    ``interpolate`` every filled height is the mean of its 4 neighbours, 3 or 2 at the rim (the discrete Laplace
    equation). This is smooth, exact for a plane away from the rim, and within the known heights around the hole.
    """
    if rule not in FILLS:
        raise SurfaceError(f"missing must be one of {', '.join(map(repr, FILLS))}, got {rule!r}")
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
        message = (
            f"low_pass is {cut_off:.6g}; allowed: {2.0 * spacing:.6g} (twice the spacing) to {shorter:.6g} "
            "(the shorter side)"
        )
        raise SurfaceError(message)
    if not np.isfinite(heights).all():
        raise SurfaceError("heights must be known at every node before they are filtered")
    from scipy import signal  # imports scipy.stats: half a second, for this filter alone

    reach = math.ceil(REACH * cut_off / spacing)
    weights = np.exp(-math.pi * np.square(np.arange(-reach, reach + 1) * spacing / (ALPHA * cut_off)))
    exponent = _exponent(heights)
    filtered = np.ldexp(heights, -exponent)
    middle = float(filtered.mean())  # taken off and put back, so that rounding is that of the roughness alone
    filtered -= middle
    for axis, nodes in enumerate(heights.shape):
        along = weights[:, np.newaxis] if axis == 0 else weights[np.newaxis]
        inside = np.convolve(np.ones(nodes), weights)[reach : reach + nodes]
        filtered = signal.oaconvolve(filtered, along, axes=axis)
        filtered = filtered[reach : reach + nodes] if axis == 0 else filtered[:, reach : reach + nodes]
        filtered /= inside[:, np.newaxis] if axis == 0 else inside
    return np.asarray(np.ldexp(filtered + middle, exponent), dtype=np.float64)


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
    row, column = ndimage.distance_transform_edt(padded, return_distances=False, return_indices=True)
    top, left = frame[0][0], frame[1][0]
    here = np.s_[top : top + rows, left : left + columns]
    return (row[here] - top) % rows, (column[here] - left) % columns


def _harmonic(heights: Array, missing: Mask, periodic: bool) -> Array:
    """Return the missing heights from the discrete Laplace equation, with natural conditions at the rim.

    A period has no rim.
    """
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
    coupling = sparse.coo_array((-np.ones(len(first)), (first, second)), shape=(len(here), len(here)))
    system = (sparse.diags_array(neighbours) + coupling).tocsc()
    solved = linalg.spsolve(system, known_sum, permc_spec="MMD_AT_PLUS_A")
    return np.ldexp(np.atleast_1d(solved), exponent)
