"""The periodic elastic half space: displacement of a plane under one pressure pattern repeated without end, by FFT.

Conventions: n × n' elements of side δ are one period, without a repeated edge, so L = n δ. Units and signs are those of
`halfspace`. Waves of pressure displace the surface in proportion, u(q) = λ(q) p(q), and the transforms have the length
of the grid::

    kernel love:     Love's coefficients summed over all images. With f = q δ/2π and sinc f = sin(π f)/(π f),
                     λ(f) = Σ_m sinc(f₁ + m₁) sinc(f₂ + m₂)/|f + m|        over all pairs m of whole numbers
    kernel punch:    the coefficients of the punch, summed in the same way
    kernel fourier:  λ(f) = 1/|f|, the half space 2/(E* q) itself, on the waves of the grid

in units δ/(π E*). The displacement under a uniform pressure is infinite. It is replaced by λ(0) = π n, n being the
larger number of elements: the mean displacement over σ is p*, on a square. This number has no effect on pressures and
gaps. It only relabels the indentation,

    Δ' = Δ + mean(u) = Δ + p*        over σ,

where Δ is that of the mean planes, and Δ' is the approach at which the solver solves. With λ(0) the inverse of the Love
operator is an M-matrix (test_periodic), and docs/explanation/solver.md applies as it stands.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import special

from roughvol.contact.convolution import Convolution
from roughvol.contact.halfspace import ElasticBody
from roughvol.contact.kernels import LOVE, Kernel, love_kernel
from roughvol.typing import Array

LEAST = 5  # the neighbours of an element within two spacings are then five different ones along an axis
# The split of 1/r into near and far: erfc(r/2)/r vanishes to rounding beyond 13 spacings, and the transform of the
# rest, erfc(2π|f|)/|f|, beyond |f| = 1.
_WIDTH, _NEAR = 0.5, 13
_POINTS = 16  # of the Gauss-Legendre rule over an element; the far part is smooth
_REACH = 200  # spacings; punch and Love differ by 0.02/r⁵ there


class PeriodicHalfSpace(ElasticBody):
    """The half space under one pressure pattern repeated without end; every convolution is over the whole period."""

    periodic = True
    least = LEAST

    def _waves(self) -> Array:
        spectrum = periodic_spectrum(self.shape, self.kernel)
        self.influence = _influence(spectrum, self.shape)
        self._mean = np.float64(spectrum[0, 0])
        self._engines: dict[str, Convolution] = {}
        return spectrum / math.prod(self.shape)

    @property
    def total_compliance(self) -> Array:
        """Displacement λ(0) under unit pressure everywhere, array (rows, columns) [lattice units]."""
        return np.broadcast_to(self._mean, self.shape)

    def _whole(self, precision: str) -> Convolution:
        if precision not in self._engines:
            shape, dtype = self.shape, np.dtype(precision)
            self._engines[precision] = Convolution(shape, self._spectrum, dtype, self.threads, self._tuning, shape)
        return self._engines[precision]


def periodic_spectrum(shape: tuple[int, int], kernel: Kernel = LOVE) -> Array:
    """Return λ, the displacement per pressure of each wave of the grid, λ(0) = π max(shape) [δ/(π E*)].

    The array (rows // 2 + 1, columns // 2 + 1) has the waves of k = 0, 1, … periods in the grid along each axis.

    References
    ----------
    K. L. Johnson, Contact Mechanics (1985), Section 13.2 (waves on a half space); P. P. Ewald, Ann. Phys. 369 (1921)
    253-287 (the sum over images, split in two that converge fast).
    """
    row, column = (np.arange(n // 2 + 1) / n for n in shape)
    if kernel.spectrum is not None:
        spectrum = kernel.spectrum(row[:, None], column)
    else:
        spectrum = _far_part(row[:, None], column) + _wave_sums(_near_part(), shape)
        if kernel != LOVE:  # images far away do not count in the difference
            reach = (_REACH + 1, _REACH + 1)
            spectrum += _wave_sums(kernel.quadrant(reach) - LOVE.quadrant(reach), shape)
    spectrum[0, 0] = math.pi * max(shape)
    return spectrum


def _far_part(row: Array, column: Array) -> Array:
    """Return the sum over aliases of the waves of erf(r/2)/r, spread over elements; those beyond |f| = 1 vanish."""
    total = np.zeros(np.broadcast_shapes(row.shape, column.shape))
    for i in (0.0, -1.0):
        for j in (0.0, -1.0):
            f = np.hypot(row + i, column + j)
            f[f == 0.0] = np.inf  # the mean
            total += np.sinc(row + i) * np.sinc(column + j) * special.erfc(np.pi * f / _WIDTH) / f
    return total


def _near_part() -> Array:
    """Return the displacement by a unit element under erfc(r/2)/r: Love's, less a smooth integral. Offsets ≥ 0."""
    offset = np.arange(_NEAR + 1.0)
    node, weight = np.polynomial.legendre.leggauss(_POINTS)
    along = offset[:, None] - 0.5 * node
    r = np.hypot(along[:, None, :, None], along[None, :, None, :])
    smooth = np.where(r > 0.0, special.erf(_WIDTH * r) / np.where(r > 0.0, r, 1.0), 2.0 * _WIDTH / math.sqrt(math.pi))
    return love_kernel(offset[:, None], offset) - 0.25 * np.einsum("ijkl,k,l->ij", smooth, weight, weight)


def _wave_sums(coefficients: Array, shape: tuple[int, int]) -> Array:
    """Return Σ_r K(r) cos(2π f₁ r₁) cos(2π f₂ r₂) on the waves of the grid, K even and given for offsets ≥ 0."""
    twice = coefficients.copy()
    twice[1:] *= 2.0
    twice[:, 1:] *= 2.0
    reach = np.arange(len(coefficients))
    # the phase modulo one turn, exactly
    row, column = (np.cos(2.0 * np.pi * (np.outer(np.arange(n // 2 + 1), reach) % n) / n) for n in shape)
    sums: Array = row @ twice @ column.T
    return sums


def _influence(spectrum: Array, shape: tuple[int, int]) -> Array:
    """Return K(i, j) from λ, its even extension being real."""
    rows = np.arange(shape[0])
    half: Array = np.fft.irfft2(spectrum[np.minimum(rows, shape[0] - rows)], s=shape)
    return half
