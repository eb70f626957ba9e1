"""Rough surfaces: heights on a square lattice, and the random midpoint displacement that makes fractal ones.

Conventions: heights z are positive up, axis 0 is x and axis 1 is y, the nodes are δ = ``spacing`` apart on both axes.
A surface made here has N = 2^m + 1 nodes per side and δ = side / 2^m; its four corners are zero.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roughvol.errors import SurfaceError
from roughvol.typing import Array

LARGEST_M = 14  # 2 GiB of heights; the contact problem ends well before
SMALLEST_RANGE = 1e-290  # of heights that are not flat: below, their differences are denormal and Sq loses its digits
LAWS = ("std", "variance")
INITIAL_SPREAD = 1.0 / 0.3  # the paper's free parameter 1/√0.09, Section 2


@dataclass(frozen=True, eq=False)
class Surface:
    """A height field z on a lattice of spacing δ, checked once and read-only from then on.

    Parameters
    ----------
    heights : array_like, shape (rows, columns), both at least 3
        Heights z [length], positive up, finite. They are copied.
    spacing : float
        Distance δ of neighbouring nodes [length], the same on both axes, finite and positive.
    filled : int
        How many of the heights were not measured but filled in.
    outliers : int
        How many measured heights were taken out as outliers.
    peak_before : float, optional
        `peak` of the surface with its outliers, where outliers were looked for.

    Raises
    ------
    SurfaceError
        If the heights are not a real, finite 2-D array of at least 3 × 3 nodes whose range is a float (and 0 or
        at least `SMALLEST_RANGE`), or δ is not finite and positive.
    """

    heights: Array
    spacing: float
    filled: int = 0
    outliers: int = 0
    peak_before: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "heights", _checked_heights(self.heights))
        object.__setattr__(self, "spacing", _positive("spacing", self.spacing))

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle through the constructor: a plain pickle would bring the heights back writable."""
        return (Surface, (self.heights, self.spacing, self.filled, self.outliers, self.peak_before))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of nodes along x and y."""
        rows, columns = self.heights.shape
        return rows, columns

    @property
    def side(self) -> float:
        """Length of the first axis, L = δ (rows - 1) [length]."""
        return self.spacing * (self.shape[0] - 1)

    @cached_property
    def z_max(self) -> float:
        """Highest height [length]: where a flat half space touches first."""
        return float(self.heights.max())

    @cached_property
    def z_min(self) -> float:
        """Lowest height [length]."""
        return float(self.heights.min())

    @cached_property
    def mean_height(self) -> float:
        """Height of the mean plane, z̄ = mean(z) [length]."""
        return self._moments[0]

    @cached_property
    def Sq(self) -> float:
        """Root mean square of the heights about their mean plane, Sq = √mean((z - z̄)²) [length] (ISO 25178-2).

        Right for any scale of heights: they are brought to unit range first, because the squares of 1e-250 underflow.
        """
        return self._moments[1]

    @property
    def peak(self) -> float:
        """Highest point above the mean plane over Sq, (z_max - z̄)/Sq; NaN if the surface is flat."""
        return (self.z_max - self.mean_height) / self.Sq if self.Sq > 0.0 else math.nan

    @property
    def pit(self) -> float:
        """Lowest point above the mean plane over Sq, (z_min - z̄)/Sq, negative; NaN if the surface is flat."""
        return (self.z_min - self.mean_height) / self.Sq if self.Sq > 0.0 else math.nan

    @cached_property
    def _moments(self) -> tuple[float, float]:
        # A power of two, so that scaling is exact and Sq(2^k z) = 2^k Sq(z) to the last bit.
        exponent = math.frexp(self.z_max - self.z_min)[1]
        depth = np.ldexp(self.z_max - self.heights, -exponent)
        mean_depth = float(depth.mean())
        depth -= mean_depth
        mean_height = self.z_max - math.ldexp(mean_depth, exponent)
        return mean_height, math.ldexp(math.sqrt(float(np.mean(np.square(depth)))), exponent)


def random_midpoint_displacement(D: float, m: int, *, side: float = 1.0, seed: int = 0, law: str = "std") -> Surface:
    """Return a self-affine surface by random midpoint displacement (Peitgen & Saupe 1988; the paper's Section 2).

    Level by level, every square gets a centre (mean of its 4 corners + s_h ξ), then every edge a midpoint (mean of its
    4 neighbours, 3 on the boundary, + s_{h+1} ξ); nodes that exist get no addition, the corners are zero. ξ are
    standard normal, and the standard deviation of half step h = 1 … 2m is, with s₀ = v₀ = 1/√0.09,

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
        Seed ≥ 0 of the random stream. The stream is drawn coarse level first and does not depend on D: equal seeds at
        m - 1 and m are nested bit for bit, and equal seeds at two D are a matched pair.
    law : {"std", "variance"}
        Which quantity is divided by 2^{(3-D)/2} at each half step.

    Returns
    -------
    Surface
        Heights of shape (N, N).

    Raises
    ------
    SurfaceError
        If an argument lies outside its interval.
    """
    m = _integer("m", m, 1, LARGEST_M)
    seed = _integer("seed", seed, 0)
    side = _positive("side", side)
    deviations = _deviations(D, m, law)
    # Generator and bit generator are both named: `default_rng` may change its mind between versions.
    normal = np.random.Generator(np.random.PCG64(seed)).standard_normal
    nodes = 2**m
    heights = np.zeros((nodes + 1, nodes + 1))
    for level in range(m):
        step = nodes >> level
        half = step // 2
        cells = 1 << level
        corners = heights[::step, ::step]
        centres = 0.25 * (corners[:-1, :-1] + corners[:-1, 1:] + corners[1:, :-1] + corners[1:, 1:])
        centres += deviations[2 * level] * normal((cells, cells))
        heights[half::step, half::step] = centres
        heights_x, heights_y = _edge_midpoints(corners, centres)
        noise_x, noise_y = _edge_noise(normal, cells)
        heights[half::step, ::step] = heights_x + deviations[2 * level + 1] * noise_x
        heights[::step, half::step] = heights_y + deviations[2 * level + 1] * noise_y
    return Surface(heights, side / nodes)


def midpoint_levels(m: int) -> NDArray[np.int64]:
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
    m = _integer("m", m, 1, LARGEST_M)
    nodes = 2**m
    levels = np.zeros((nodes + 1, nodes + 1), dtype=np.int64)
    for level in range(m):
        step = nodes >> level
        half = step // 2
        levels[half::step, half::step] = 2 * level + 1
        levels[half::step, ::step] = 2 * level + 2
        levels[::step, half::step] = 2 * level + 2
    return levels


def _edge_midpoints(corners: Array, centres: Array) -> tuple[Array, Array]:
    """Return the mean of the neighbours of the midpoints of the edges along x and of those along y."""
    along_x = corners[:-1] + corners[1:]
    along_x[:, 1:] += centres
    along_x[:, :-1] += centres
    along_x[:, 1:-1] /= 4.0
    along_x[:, [0, -1]] /= 3.0
    along_y = corners[:, :-1] + corners[:, 1:]
    along_y[1:] += centres
    along_y[:-1] += centres
    along_y[1:-1] /= 4.0
    along_y[[0, -1]] /= 3.0
    return along_x, along_y


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
        message = f"law must be one of {', '.join(map(repr, LAWS))}, got {law!r}"
        raise SurfaceError(message)
    D = _real("D", D)
    if not 2.0 < D < 3.0:
        message = f"D must be in (2, 3), got {D!r}"
        raise SurfaceError(message)
    factors = [2.0 ** (-half_step * (3.0 - D) / 2.0) for half_step in range(1, 2 * m + 1)]
    if law == "variance":
        return [math.sqrt(INITIAL_SPREAD * factor) for factor in factors]
    return [INITIAL_SPREAD * factor for factor in factors]


def _checked_heights(heights: ArrayLike) -> Array:
    """Return a read-only, C-contiguous copy of the heights, or say what is wrong with them."""
    masked = int(np.ma.count_masked(heights)) if isinstance(heights, np.ma.MaskedArray) else 0
    if masked:
        message = f"heights must be known at every node, {masked} are masked"
        raise SurfaceError(message)
    try:
        given = np.asarray(heights)
    except ValueError as error:  # rows of unequal length
        message = f"heights must be a 2-D array of numbers: {error}"
        raise SurfaceError(message) from error
    if given.dtype.kind not in "fiub":
        message = f"heights must be real numbers, got an array of {given.dtype}"
        raise SurfaceError(message)
    if given.ndim != 2 or min(given.shape) < 3:
        message = f"heights must be 2-D with at least 3 nodes per axis, got shape {given.shape}"
        raise SurfaceError(message)
    checked = np.array(given, dtype=np.float64, order="C")
    bad = ~np.isfinite(checked)
    if bad.any():
        row, column = np.argwhere(bad)[0].tolist()
        message = (
            f"heights must be finite, got {int(bad.sum())} NaN or infinite out of {bad.size}, "
            f"the first at [{row}, {column}] ({checked[row, column]})"
        )
        raise SurfaceError(message)
    height_range = float(checked.max()) - float(checked.min())
    if not math.isfinite(height_range):
        message = f"heights must have a finite range, got {checked.min():.3g} … {checked.max():.3g}"
        raise SurfaceError(message)
    if 0.0 < height_range < SMALLEST_RANGE:
        message = f"the range of the heights is {height_range:.3g}; allowed: 0 (flat), or at least {SMALLEST_RANGE:g}"
        raise SurfaceError(message)
    checked.flags.writeable = False
    return checked


def _real(name: str, value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        message = f"{name} must be a number, got {value!r}"
        raise SurfaceError(message) from error


def _positive(name: str, value: float) -> float:
    number = _real(name, value)
    if not (math.isfinite(number) and number > 0.0):
        message = f"{name} must be finite and positive, got {value!r}"
        raise SurfaceError(message)
    return number


def _integer(name: str, value: int, lowest: int, highest: int | None = None) -> int:
    allowed = f"an integer >= {lowest}" if highest is None else f"an integer in [{lowest}, {highest}]"
    try:
        number = operator.index(value)
    except TypeError as error:
        message = f"{name} must be {allowed}, got {value!r}"
        raise SurfaceError(message) from error
    if number < lowest or (highest is not None and number > highest):
        message = f"{name} must be {allowed}, got {value!r}"
        raise SurfaceError(message)
    return number
