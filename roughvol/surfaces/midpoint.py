"""Fractal surfaces by random midpoint displacement."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from roughvol.errors import SurfaceError
from roughvol.surfaces.surface import Surface, positive, real, whole
from roughvol.typing import Array, Index

LARGEST_M = 14  # 2 GiB of heights; the contact problem ends well before
LAWS = ("std", "variance")
INITIAL_SPREAD = 1.0 / 0.3  # the paper's free parameter 1/√0.09, Section 2


def random_midpoint_displacement(
    D: float, m: int, *, side: float = 1.0, seed: int = 0, law: str = "std", periodic: bool = False
) -> Surface:
    """Return a self-affine surface by random midpoint displacement (Peitgen & Saupe 1988; the paper's Section 2).

    Level by level, every square gets a centre: the mean of its 4 corners + s_h ξ. Then every edge gets a midpoint: the
    mean of its 4 neighbours, 3 on the boundary, + s_{h+1} ξ. Existing nodes get no addition. The corners are zero. ξ
    are standard normal, and the standard deviation of half step h = 1 … 2m is, with s₀ = v₀ = 1/√0.09,

        law "std":       s_h = s₀ 2^{-h (3-D)/2}        Hurst exponent 3 - D
        law "variance":  s_h = √(v₀ 2^{-h (3-D)/2})     Hurst exponent (3 - D)/2

    The second is the sentence of the paper read literally; the first gives the dimension D that it names.

    Parameters
    ----------
    D : float
        Fractal dimension, 2 < D < 3.
    m : int
        Number of levels, 1 … 14; the surface has N = 2^m + 1 nodes per side.
    side : float
        Lateral size L [length]; δ = L / 2^m. The heights do not depend on it.
    seed : int
        Seed ≥ 0 of the random stream. The stream is drawn coarse level first and does not depend on D. Equal
        seeds at m - 1 and m are nested bit for bit. Equal seeds at two D are a matched pair.
    law : {"std", "variance"}
        Which quantity is divided by 2^{(3-D)/2} at each half step.
    periodic : bool
        Whether the surface is one period of length L, of 2^m nodes per side. Every edge midpoint has 4 neighbours then,
        and the first height is zero. Other numbers of the stream are used, in the order: centres, edges along x, edges
        along y. Equal seeds are nested.

    Returns
    -------
    Surface
        Heights of shape (N, N), or (2^m, 2^m).

    Raises
    ------
    SurfaceError
        If an argument lies outside its interval.

    See Also
    --------
    power_law_surface : Returns a surface with a spectrum.

    Examples
    --------
    >>> from roughvol.surfaces import random_midpoint_displacement
    >>> surface = random_midpoint_displacement(2.3, 5, side=100.0, seed=1)
    >>> surface.shape, surface.spacing
    ((33, 33), 3.125)
    """
    m = whole("m", m, 1, LARGEST_M)
    seed = whole("seed", seed, 0)
    side = positive("side", side)
    deviations = _deviations(D, m, law)
    # Generator and bit generator are both named: `default_rng` may change its mind between versions.
    normal = np.random.Generator(np.random.PCG64(seed)).standard_normal
    nodes = 2**m
    if periodic:
        return Surface(_periodic_heights(m, deviations, normal), side / nodes, sides="periodic")
    heights = np.zeros((nodes + 1, nodes + 1))
    for level in range(m):
        step = nodes >> level
        half = step // 2
        cells = 1 << level
        corners = heights[::step, ::step]
        centres = 0.25 * (corners[:-1, :-1] + corners[:-1, 1:] + corners[1:, :-1] + corners[1:, 1:])
        centres += deviations[2 * level] * normal((cells, cells))
        heights[half::step, half::step] = centres
        heights_x, heights_y = _edge_midpoints(corners, centres), _edge_midpoints(corners.T, centres.T).T
        noise_x, noise_y = _edge_noise(normal, cells)
        heights[half::step, ::step] = heights_x + deviations[2 * level + 1] * noise_x
        heights[::step, half::step] = heights_y + deviations[2 * level + 1] * noise_y
    return Surface(heights, side / nodes)


def _periodic_heights(m: int, deviations: list[float], normal: Callable[[tuple[int, int]], Array]) -> Array:
    """Return one period of heights, each new node the mean of its 4 neighbours + s ξ."""
    heights = np.zeros((1, 1))
    for level in range(m):
        cells = (1 << level, 1 << level)
        finer = np.zeros((2 << level, 2 << level))
        finer[::2, ::2] = heights
        along = heights + np.roll(heights, -1, axis=0)
        across = heights + np.roll(heights, -1, axis=1)
        centres = 0.25 * (along + np.roll(along, -1, axis=1)) + deviations[2 * level] * normal(cells)
        deviation = deviations[2 * level + 1]
        finer[1::2, 1::2] = centres
        finer[1::2, ::2] = 0.25 * (along + (centres + np.roll(centres, 1, axis=1))) + deviation * normal(cells)
        finer[::2, 1::2] = 0.25 * (across + (centres + np.roll(centres, 1, axis=0))) + deviation * normal(cells)
        heights = finer
    return heights


def midpoint_levels(m: int) -> Index:
    """Return the half step at which each node gets its height (the paper's Fig. 1).

    Parameters
    ----------
    m : int
        Number of levels, 1 … 14.

    Returns
    -------
    ndarray of int, shape (2^m + 1, 2^m + 1)
        0 at the corners, 1 at the first centre, 2 at the first edge midpoints, … 2m at the last edge midpoints.

    Raises
    ------
    SurfaceError
        If m lies outside its interval.
    """
    m = whole("m", m, 1, LARGEST_M)
    nodes = 2**m
    levels = np.zeros((nodes + 1, nodes + 1), dtype=np.int64)
    for level in range(m):
        step = nodes >> level
        half = step // 2
        levels[half::step, half::step] = 2 * level + 1
        levels[half::step, ::step] = 2 * level + 2
        levels[::step, half::step] = 2 * level + 2
    return levels


def _edge_midpoints(corners: Array, centres: Array) -> Array:
    """Return the mean of the neighbours of the midpoints of the edges along the first axis."""
    means = corners[:-1] + corners[1:]
    means[:, 1:] += centres
    means[:, :-1] += centres
    means[:, 1:-1] /= 4.0
    means[:, [0, -1]] /= 3.0
    return means


def _edge_noise(normal: Callable[[int | tuple[int, int]], Array], cells: int) -> tuple[Array, Array]:
    """Draw the numbers of one edge pass: the boundary y = 0, y = L, x = 0, x = L, then the interior along x, along y.

    The order is part of what a seed means: changing it changes every surface.
    """
    along_x = np.empty((cells, cells + 1))
    along_y = np.empty((cells + 1, cells))
    along_x[:, 0] = normal(cells)
    along_x[:, -1] = normal(cells)
    along_y[0] = normal(cells)
    along_y[-1] = normal(cells)
    along_x[:, 1:-1] = normal((cells, cells - 1))
    along_y[1:-1] = normal((cells - 1, cells))
    return along_x, along_y


def _deviations(D: float, m: int, law: str) -> list[float]:
    """Return the standard deviations of the 2m half steps."""
    if law not in LAWS:
        raise SurfaceError(f"law must be one of {', '.join(map(repr, LAWS))}, got {law!r}")
    D = real("D", D)
    if not 2.0 < D < 3.0:
        raise SurfaceError(f"D must be in (2, 3), got {D!r}")
    factors = [2.0 ** (-half_step * (3.0 - D) / 2.0) for half_step in range(1, 2 * m + 1)]
    if law == "variance":
        return [math.sqrt(INITIAL_SPREAD * factor) for factor in factors]
    return [INITIAL_SPREAD * factor for factor in factors]
