"""Kernels: displacement of the elements around one element under a unit pressure on it.

Lattice units, see `halfspace`: u = δ/(π E*) Σ K(i - k, j - l) p. K is even along both axes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from roughvol.errors import ContactError
from roughvol.typing import Array, Index

_SERIES_FROM = 64.0  # spacings; the two forms are equally exact there (test_kernels, love_kernel)


@dataclass(frozen=True)
class Kernel:
    """The elastic body as a half space sees it: influence coefficients, or displacement of waves.

    A kernel with a length is made by a function of this length in spacings. Two kernels of one name are the same.

    Attributes
    ----------
    name : str
        Name, with the length if it has one.
    coefficients : callable, optional
        (x, y) ↦ K at offsets ≥ 0 [spacings]. Default: none, for a kernel of periodic half spaces alone.
    spectrum : callable, optional
        (f₁, f₂) ↦ displacement under a unit wave of f periods per spacing, on a periodic half space; any value at 0.
        Default: the coefficients summed over images. They then differ from Love's as 1/r⁵ at most.
    m_matrix : bool
        Whether K⁻¹ is an M-matrix, see solver.md: overlaps at the hardness are never undone on a leg of a path.
    """

    name: str
    coefficients: Callable[[Array, Array], Array] | None = field(default=None, compare=False, repr=False)
    spectrum: Callable[[Array, Array], Array] | None = field(default=None, compare=False, repr=False)
    m_matrix: bool = field(default=False, compare=False)

    def quadrant(self, shape: tuple[int, int]) -> Array:
        """Return K(i, j) for the offsets 0 ≤ i < rows, 0 ≤ j < columns."""
        if self.coefficients is None:
            allowed = ", ".join(kernel.name for kernel in KERNELS.values() if kernel.coefficients)
            raise ContactError(f"kernel is {self.name!r}; allowed on a free patch: {allowed}")
        row, column = (np.arange(float(n)) for n in shape)
        return np.ascontiguousarray(self.coefficients(row[:, None], column))


def love_kernel(x: Array, y: Array) -> Array:
    r"""Return Love's influence coefficients of a unit square element at offsets x, y ≥ 0.

    .. math:: K(x, y) = \int_{-1/2}^{1/2}\int_{-1/2}^{1/2} \frac{dξ\,dη}{\sqrt{(x-ξ)^2 + (y-η)^2}}

    The closed form loses digits as ε r². Beyond 64 spacings the multipole series of a uniform square replaces it, up to
    fourth moments. The relative error is below 1e-13 everywhere. Offsets are in spacings, off the edge of the element.

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
    """Return the coefficients of a rigid punch on itself, K(0, 0) = 2, and of a disc on others, 2 asin(1/(2 r)).

    K(r) tends to 1/r. K⁻¹ is no M-matrix: the diagonal is small.
    """
    r = np.hypot(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    kernel = np.full(r.shape, 2.0)
    away = r > 0
    kernel[away] = 2.0 * np.arcsin(0.5 / r[away])
    return kernel


def _fourier(row: Array, column: Array) -> Array:
    """Return the displacement 1/|f| of the half space itself, 2/(E* q), on the waves of the grid."""
    with np.errstate(divide="ignore"):
        displacement: Array = 1.0 / np.hypot(row, column)
    return displacement


LOVE = Kernel("love", love_kernel, m_matrix=True)
PUNCH = Kernel("punch", punch_kernel)
FOURIER = Kernel("fourier", spectrum=_fourier)
KERNELS = {kernel.name: kernel for kernel in (LOVE, PUNCH, FOURIER)}


def kernel_of(kernel: Kernel | str) -> Kernel:
    """Return a kernel, or the kernel of a name."""
    if isinstance(kernel, Kernel):
        return kernel
    if kernel not in KERNELS:
        raise ContactError(f"kernel is {kernel!r}; allowed: {', '.join(KERNELS)}")
    return KERNELS[kernel]


def influence_matrix(influence: Array, elements: Index) -> Array:
    """Return K (n, n) between elements, by their flat indices on the grid of the coefficients."""
    columns = np.int32(influence.shape[1])
    row, column = np.divmod(elements.astype(np.int32), columns)
    offset = np.abs(np.subtract.outer(row, row))
    offset *= columns
    across = np.subtract.outer(column, column)
    offset += np.abs(across, out=across)
    matrix: Array = influence.ravel().take(offset)
    return matrix
