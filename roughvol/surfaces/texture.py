"""Texture of a height field: ISO 25178-2 numbers, summits, functional indices, structure function, Hurst exponents.

Conventions: z(x, y) are heights [length] of shape (rows, columns), positive up, axis 0 is x. ζ = z - z̄ are heights
about the mean plane. No form is removed and no filter applied: the whole field is the scale-limited surface. Every mean
is over nodes of equal weight. Functions with ``periodic`` join the opposite sides of one period. Gradients and summits
take the heights with their neighbours (`Surface.with_neighbours`); other numbers depend on single heights.

Amplitudes of any scale are allowed (1e-250, 1e250): heights are brought to unit range before they are squared. A ratio
that a flat surface leaves undefined is NaN.
"""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike

from roughvol.errors import SurfaceError
from roughvol.surfaces.surface import about_mean_plane, intervals, root_mean_square
from roughvol.typing import Array, Index, Mask

FEWEST_CELLS_FOR_SPECTRUM = 32  # below, the range of `hurst_spectrum` spans less than one octave
SPECTRUM_BINS = 8
AROUND = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], dtype=bool)  # the eight neighbours of a node


def standardised(heights: Array) -> Array:
    """Return the heights about their mean plane in units of their root mean square, ζ/Sq [1]."""
    unit = about_mean_plane(heights)[0]
    spread = root_mean_square(unit)
    return unit / spread if spread > 0.0 else np.full(unit.shape, math.nan)


def Sq(heights: Array) -> float:
    """Return the root mean square height, Sq = √mean(ζ²) [length] (ISO 25178-2)."""
    unit, exponent, _ = about_mean_plane(heights)
    return math.ldexp(root_mean_square(unit), exponent)


def Sa(heights: Array) -> float:
    """Return the arithmetical mean height, Sa = mean(abs(ζ)) [length] (ISO 25178-2)."""
    unit, exponent, _ = about_mean_plane(heights)
    return math.ldexp(float(np.abs(unit).mean()), exponent)


def Ssk(heights: Array) -> float:
    """Return the skewness, Ssk = mean(ζ³) / Sq³ [1], NaN if flat (ISO 25178-2)."""
    return float(np.mean(standardised(heights) ** 3))


def Sku(heights: Array) -> float:
    """Return the kurtosis, Sku = mean(ζ⁴) / Sq⁴ [1], 3 for a Gaussian, NaN if flat (ISO 25178-2)."""
    return float(np.mean(standardised(heights) ** 4))


def Sp(heights: Array) -> float:
    """Return the maximum peak height, Sp = max(ζ) [length] (ISO 25178-2)."""
    unit, exponent, _ = about_mean_plane(heights)
    return math.ldexp(float(unit.max()), exponent)


def Sv(heights: Array) -> float:
    """Return the maximum pit height, Sv = -min(ζ) [length], not negative (ISO 25178-2)."""
    unit, exponent, _ = about_mean_plane(heights)
    return math.ldexp(-float(unit.min()), exponent)


def Sz(heights: Array) -> float:
    """Return the maximum height, Sz = Sp + Sv = max(z) - min(z) [length] (ISO 25178-2)."""
    return float(heights.max() - heights.min())


def Sdq(heights: Array, spacing: float) -> float:
    """Return the root mean square gradient, Sdq = √mean((∂z/∂x)² + (∂z/∂y)²) [1] (ISO 25178-2).

    Central differences over 2δ on the interior nodes. They are exact for planes and blind to the wavelength 2δ. A field
    that is rough down to the lattice has larger slopes between neighbouring nodes.
    """
    if min(heights.shape) < 3:
        return math.nan
    unit, exponent, _ = about_mean_plane(heights)
    along_x = unit[2:, 1:-1] - unit[:-2, 1:-1]
    along_y = unit[1:-1, 2:] - unit[1:-1, :-2]
    differences = math.sqrt(float(np.mean(along_x * along_x + along_y * along_y)))
    return math.ldexp(differences, exponent) / (2.0 * spacing)


def summits(heights: Array) -> Mask:
    """Return where the summits are: interior nodes strictly higher than each of their eight neighbours.

    A plateau of equal nodes has no summit, and neither has the boundary, whose neighbourhood is not known.
    """
    heights = np.asarray(heights, dtype=np.float64)
    mask: Mask = heights > scipy.ndimage.maximum_filter(heights, footprint=AROUND, mode="constant", cval=np.inf)
    return mask


def summit_plane(heights: Array) -> float:
    """Return the mean height of the summits [length]: the paper's "mean plane of the asperity heights" (Section 3)."""
    return float(heights[_some_summits(heights)].mean())


def summit_radius(heights: Array, spacing: float) -> float:
    """Return the radius of curvature of the summits, ρ = 1 / mean(κ) [length].

    κ = -½ (∂²z/∂x² + ∂²z/∂y²) at each summit, by second differences over δ. 1/ρ is the Spc of ISO 25178-2 over the
    nodes of `summits` instead of pruned peaks. ρ is that of the plasticity index.
    """
    i, j = np.nonzero(_some_summits(heights))
    top = heights[i, j]
    # Differences before sums: a surface far above z = 0 keeps its digits.
    drop = (top - heights[i - 1, j]) + (top - heights[i + 1, j]) + (top - heights[i, j - 1]) + (top - heights[i, j + 1])
    return spacing / (0.5 * float(drop.mean()) / spacing)


def material_ratio(heights: Array, levels: ArrayLike) -> Array:
    """Return the areal material ratio, the share of nodes at or above each level (Smr(c) of ISO 25178-2)."""
    ordered = np.sort(heights, axis=None)
    below = np.searchsorted(ordered, levels, side="left")
    return np.asarray((ordered.size - below) / ordered.size, dtype=np.float64)


def Svi(heights: Array) -> float:
    """Return the valley fluid retention index, Svi = mean(max(h₂₀ - z, 0)) / Sq [1], NaN if flat.

    h₂₀ is the plane that leaves 20 % of the heights below it (the paper's Section 3.2; Dong, Sullivan & Stout 1994).
    Gaussian heights give 0.112.
    """
    unit = standardised(heights)
    return float(np.maximum(np.quantile(unit, 0.20) - unit, 0.0).mean())


def Sbi(heights: Array) -> float:
    """Return the surface bearing index, Sbi = Sq / ζ₀₅ [1], NaN if flat.

    ζ₀₅ is the height above the mean plane that leaves 5 % of the heights above it (Dong, Sullivan & Stout
    1994). Gaussian heights give 0.608; a larger number is a surface that bears better.
    """
    level = float(np.quantile(standardised(heights), 0.95))
    return 1.0 / level if level != 0.0 else math.nan


def structure_function(heights: Array, lags: Index, *, periodic: bool = False) -> Array:
    """Return the structure function, S(l) = mean((z(x + l) - z(x))²) [length²], the mean of both axes.

    A self-affine surface has S ~ l^(2H). Far beyond its correlation length S is 2 Sq². Lags l are in nodes, from 1 to
    the shorter axis less one. Squares of the heights must be in the range of doubles.
    """
    structure = np.empty(lags.shape)
    for place, lag in enumerate(lags):
        if periodic:
            squares_x = np.square(np.roll(heights, -lag, axis=0) - heights)
            squares_y = np.square(np.roll(heights, -lag, axis=1) - heights)
        else:
            squares_x = np.square(heights[lag:] - heights[:-lag])
            squares_y = np.square(heights[:, lag:] - heights[:, :-lag])
        # Mean of the two axes, not of all pairs: their shares change with the lag where the axes differ in length.
        structure[place] = 0.5 * (squares_x.mean() + squares_y.mean())
    return structure


def hurst_structure(heights: Array, *, periodic: bool = False) -> float:
    """Return the Hurst exponent from `structure_function`, H = ½ d log S / d log l.

    Least squares over the lags l = 1, 2, 4, … δ up to an eighth of the shorter side (at least 1 and 2).
    S converges slowly to its power law near H = 0 and H = 1. Midpoint surfaces at m = 8 give 0.67 for H = 0.8, and 0.24
    for H = 0.2 (tests/surfaces/test_texture.py holds the bounds). `hurst_spectrum` is closer and noisier.
    NaN for fewer than 3 nodes on an axis, or if S vanishes at a lag.
    """
    if min(heights.shape) < 3:
        return math.nan
    lags = dyadic_lags(max(2, intervals(min(heights.shape), periodic) // 8))
    structure = structure_function(about_mean_plane(heights)[0], lags, periodic=periodic)
    if structure.min() <= 0.0:
        return math.nan
    return 0.5 * _slope(np.log(lags), np.log(structure))


def dyadic_lags(longest: int) -> Index:
    """Return the lags 1, 2, 4 … up to the longest, in nodes; always the lag 1."""
    return np.array([2**k for k in range(max(longest, 1).bit_length())], dtype=np.intp)


def hurst_spectrum(heights: Array, *, periodic: bool = False) -> float:
    """Return the Hurst exponent from the power spectrum, C(q) ~ q^(-2-2H) in two dimensions.

    The heights about their weighted mean are multiplied by a parabolic (Welch) window. |FFT|² is averaged over eight
    rings of wave vectors, of equal width in log q. H comes from least squares of log C against log q over
    4 q₀ ≤ q < q_N / 2. Here q₀ = 2π / shorter side and q_N = π / δ. Below, the window counts; above, aliasing does.
    Midpoint surfaces of H = 0.2 … 0.8 give H - 0.05 on average at m = 8. The deviation between seeds is 0.04
    (tests/surfaces/test_texture.py holds the bounds). One period has its waves exactly, and is not multiplied by a
    window. NaN for fewer than 33 nodes on an axis (32 of a period), or flat heights.
    """
    cells = intervals(min(heights.shape), periodic)
    if cells < FEWEST_CELLS_FOR_SPECTRUM:
        return math.nan
    unit = about_mean_plane(heights)[0]
    rows, columns = unit.shape
    if not periodic:
        window = np.outer(1.0 - np.linspace(-1.0, 1.0, rows) ** 2, 1.0 - np.linspace(-1.0, 1.0, columns) ** 2)
        unit -= float((window * unit).sum() / window.sum())
        unit *= window
    power = np.square(np.abs(np.fft.rfft2(unit)))
    # Wave numbers over q₀. Those of a square period are whole, so no rounding decides whether a wave of 4 q₀ counts.
    along_x, along_y = (np.rint(np.fft.fftfreq(nodes) * nodes) * (cells / nodes) for nodes in (rows, columns))
    wave = np.hypot(along_x[:, None], along_y[: columns // 2 + 1])
    lowest, highest = 4.0, 0.25 * cells
    used = (wave >= lowest) & (wave < highest)
    used[rows // 2 + 1 :, 0] = False  # rfft2 holds half the plane, and both halves of its first column
    wave, power = wave[used], power[used]
    ring = np.floor(SPECTRUM_BINS * np.log(wave / lowest) / math.log(highest / lowest)).astype(np.int64)
    count = np.bincount(ring)
    filled = count > 0
    mean_power = np.bincount(ring, power)[filled] / count[filled]
    if not np.all(mean_power > 0.0):
        return math.nan
    mean_log_wave = np.bincount(ring, np.log(wave))[filled] / count[filled]
    return -0.5 * _slope(mean_log_wave, np.log(mean_power)) - 1.0


def _some_summits(heights: Array) -> Mask:
    mask = summits(heights)
    if not mask.any():
        rows, columns = heights.shape
        message = f"heights of {rows} × {columns} nodes have no summit: no interior node is above its eight neighbours"
        raise SurfaceError(message)
    return mask


def _slope(x: Array, y: Array) -> float:
    """Return the slope of the least squares line through (x, y)."""
    x = x - x.mean()
    return float(x @ y / (x @ x))
