"""Influence coefficients: displacement of one element by a unit pressure on another.

Lattice units, see `halfspace`: u = δ/(π E*) Σ K(i - k, j - l) p. K is even along both axes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from roughvol.errors import ContactError
from roughvol.typing import Array, Index

# Kernels whose K⁻¹ is an M-matrix, see docs/solver.md: overlaps at the hardness are never undone on a leg of a path.
M_MATRIX = ("love",)
_SERIES_FROM = 64.0  # spacings; the two forms are equally exact there (test_halfspace, love_kernel)


def love_kernel(x: Array, y: Array) -> Array:
    r"""Return Love's influence coefficients of a unit square element at offsets x, y ≥ 0.

    .. math:: K(x, y) = \int_{-1/2}^{1/2}\int_{-1/2}^{1/2} \frac{dξ\,dη}{\sqrt{(x-ξ)^2 + (y-η)^2}}

    u = δ/(π E*) K p. The closed form loses digits as ε r². Beyond 64 spacings the multipole series of a uniform square
    replaces it, up to fourth moments. The relative error is below 1e-13 everywhere.

    Parameters
    ----------
    x, y : array_like
        Offsets [spacings], ≥ 0, broadcast together, not on the edge of the element. The kernel is even.

    Returns
    -------
    array
        K, without unit.

    Raises
    ------
    ContactError
        If an offset is negative.

    References
    ----------
    A. E. H. Love, Phil. Trans. R. Soc. A 228 (1929) 377-420; K. L. Johnson, Contact Mechanics (1985), eq. 3.25.
    """
    x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    if x.size and min(x.min(), y.min()) < 0:
        raise ContactError(f"love_kernel: offset is {min(x.min(), y.min()):g}; allowed: >= 0 (the kernel is even)")
    kernel = np.empty(x.shape)
    far = np.hypot(x, y) > _SERIES_FROM
    kernel[far] = _love_far(x[far], y[far])
    kernel[~far] = _love_near(x[~far], y[~far])
    return kernel


def _love_near(x: Array, y: Array) -> Array:
    """Return the closed form over the four corners, with ``log1p``, which keeps all digits along the axes."""
    a, b, c, d = x + 0.5, x - 0.5, y + 0.5, y - 0.5  # corner offsets; b, d ≥ -1/2
    ac, ad, bc, bd = np.hypot(a, c), np.hypot(a, d), np.hypot(b, c), np.hypot(b, d)

    def pair(s: Array, t_hi: Array, t_lo: Array, r_hi: Array, r_lo: Array) -> Array:
        # s ln[(t_hi + r_hi) / (t_lo + r_lo)]; the denominator is positive: t_lo ≥ -1/2, and s ≠ 0 at every node
        return s * np.log1p(((t_hi - t_lo) + (t_hi - t_lo) * (t_hi + t_lo) / (r_hi + r_lo)) / (t_lo + r_lo))

    # r_hi - r_lo = (t_hi² - t_lo²) / (r_hi + r_lo), as both share s: no cancellation in the difference of radii
    return pair(a, c, d, ac, ad) - pair(b, c, d, bc, bd) + pair(c, a, b, ac, bc) - pair(d, a, b, ad, bd)


def _love_far(x: Array, y: Array) -> Array:
    """Return 1/r + ∇²(1/r)/24 + fourth moments of a unit square."""
    x2, y2 = x * x, y * y
    r2 = x2 + y2
    r = np.sqrt(r2)
    # derivatives of 1/r in the plane: ∂⁴ₓ = (9 - 90 x²/r² + 105 x⁴/r⁴)/r⁵, ∂²ₓ∂²_y = (105 x² y²/r⁴ - 12)/r⁵
    r5 = r2 * r2 * r
    fourth_x = (9.0 - 90.0 * x2 / r2 + 105.0 * (x2 / r2) ** 2) / r5
    fourth_y = (9.0 - 90.0 * y2 / r2 + 105.0 * (y2 / r2) ** 2) / r5
    mixed = (105.0 * x2 * y2 / r2**2 - 12.0) / r5
    return 1.0 / r + 1.0 / (24.0 * r2 * r) + (fourth_x + fourth_y) / 1920.0 + mixed / 576.0


def punch_kernel(x: Array, y: Array) -> Array:
    """Return the influence coefficients of a rigid punch on itself, and of a disc on other elements.

    K(0, 0) = 2 and K(r) = 2 asin(1/(2 r)), which tends to 1/r. K⁻¹ is no M-matrix: the diagonal is small.

    Parameters
    ----------
    x, y : array_like
        Offsets [spacings], broadcast together.

    Returns
    -------
    array
        K, without unit.
    """
    r = np.hypot(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    kernel = np.full(r.shape, 2.0)
    away = r > 0
    kernel[away] = 2.0 * np.arcsin(0.5 / r[away])
    return kernel


KERNELS: dict[str, Callable[[Array, Array], Array]] = {"love": love_kernel, "punch": punch_kernel}


def kernel_quadrant(shape: tuple[int, int], kernel: str = "love") -> Array:
    """Return K(i, j) for the offsets 0 ≤ i < rows, 0 ≤ j < columns.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns.
    kernel : {"love", "punch"}
        Name of the kernel.

    Returns
    -------
    array (rows, columns)
        K in units δ/(π E*).

    Raises
    ------
    ContactError
        If the kernel is unknown.
    """
    if kernel not in KERNELS:
        raise ContactError(f"kernel is {kernel!r}; allowed: {', '.join(KERNELS)}")
    row, column = (np.arange(float(n)) for n in shape)
    return np.ascontiguousarray(KERNELS[kernel](row[:, None], column))


def influence_matrix(influence: Array, elements: Index) -> Array:
    """Return K between some elements.

    Parameters
    ----------
    influence : array (rows, columns)
        K of the non-negative offsets.
    elements : array (n,)
        Flat indices on the same grid.

    Returns
    -------
    array (n, n)
        K in units δ/(π E*).
    """
    columns = np.int32(influence.shape[1])
    row, column = np.divmod(elements.astype(np.int32), columns)
    offset = np.abs(np.subtract.outer(row, row))
    offset *= columns
    across = np.subtract.outer(column, column)
    offset += np.abs(across, out=across)
    matrix: Array = influence.ravel().take(offset)
    return matrix
