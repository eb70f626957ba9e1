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
operator is an M-matrix (test_periodic), and docs/solver.md applies as it stands.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from roughvol.contact.convolution import Convolution
from roughvol.contact.kernels import love_kernel, punch_kernel
from roughvol.contact.tuning import TUNING, Tuning
from roughvol.errors import ContactError
from roughvol.typing import Array

PERIODIC_KERNELS = ("love", "punch", "fourier")
LEAST = 5  # the neighbours of an element within two spacings are then five different ones along an axis
# The split of 1/r into near and far: erfc(r/2)/r vanishes to rounding beyond 13 spacings, and the transform of the
# rest, erfc(2π|f|)/|f|, beyond |f| = 1.
_WIDTH, _NEAR = 0.5, 13
_POINTS = 16  # of the Gauss-Legendre rule over an element; the far part is smooth
_PUNCH_REACH = 200  # spacings; punch and Love differ by 0.02/r⁵ there


class PeriodicHalfSpace:
    """Displacement under periodic pressure, u = K ∗ p, for one grid shape and kernel.

    Buffers and FFTW plans are made once. Not thread-safe. Displacements are in lattice units, see the module.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of one period, each at least 5.
    kernel : {"love", "punch", "fourier"}
        Influence coefficients.
    threads : int
        Threads inside one convolution. Results do not depend on them.
    tuning : Tuning
        Constants.

    Attributes
    ----------
    periodic : bool
        True.
    influence : array (rows, columns)
        K(i, j) of the non-negative offsets, images included.
    convolutions, convolutions_fp32 : float
        Convolutions so far, by precision. Every one is over the whole grid.

    Raises
    ------
    ContactError
        If the shape is too small, the kernel unknown, or K not positive definite.
    """

    periodic = True

    def __init__(self, shape: tuple[int, int], kernel: str = "love", threads: int = 1, tuning: Tuning = TUNING) -> None:
        self.shape = (int(shape[0]), int(shape[1]))
        if min(self.shape) < LEAST:
            raise ContactError(f"shape is {shape}; allowed: at least {LEAST} elements along each axis of a period")
        self.kernel, self.threads, self._tuning = kernel, threads, tuning
        spectrum = periodic_spectrum(self.shape, kernel)
        if not spectrum.min() > 0.0:
            message = f"the {kernel} kernel is not positive definite on {self.shape}; no unique solution there"
            raise ContactError(message)
        self.influence = _influence(spectrum, self.shape)
        self.influence.flags.writeable = False
        self._mean = np.float64(spectrum[0, 0])
        self._spectrum = spectrum / math.prod(self.shape)
        self._engines: dict[str, Convolution] = {}
        self._positions: dict[str, tuple[NDArray[np.intp], tuple[list[int], NDArray[Any]]]] = {}
        self.convolutions = 0.0
        self.convolutions_fp32 = 0.0

    def displacement(self, pressure: Array) -> Array:
        """Return u = K ∗ p on every element, by one convolution.

        Parameters
        ----------
        pressure : array (rows, columns)
            Pressures of one period.

        Returns
        -------
        array (rows, columns)
            Displacement [lattice units].

        Raises
        ------
        ContactError
            If the shape differs from that of the grid.
        """
        if pressure.shape != self.shape:
            raise ContactError(f"pressure has shape {pressure.shape}; the half space has {self.shape}")
        self.convolutions += 1.0
        return self._engine("float64").convolve(pressure)

    def displacement_above(self, heights: Array, elements: NDArray[np.intp], pressure: NDArray[Any]) -> Array:
        """Return u - heights on every element, by one convolution.

        Parameters
        ----------
        heights : array (rows * columns,)
            Heights [lattice units].
        elements : array (n,)
            Flat indices of the elements under pressure, increasing.
        pressure : array (n,)
            Pressures there.

        Returns
        -------
        array (rows * columns,)
            u - heights [lattice units].
        """
        self.convolutions += 1.0
        engine = self._engine("float64")
        positions = engine.positions(*np.divmod(elements.astype(np.int32), np.int32(self.shape[1])))
        return engine.convolve_above(heights.reshape(self.shape), *positions, pressure).ravel()

    def displacement_at(
        self, elements: NDArray[np.intp], pressure: NDArray[Any], *, single: bool = False
    ) -> NDArray[Any]:
        """Return u at the elements that carry the pressure.

        Parameters
        ----------
        elements : array (n,)
            Flat indices, increasing.
        pressure : array (n,)
            Pressures there.
        single : bool
            Transform in 32 bits.

        Returns
        -------
        array (n,)
            Displacement [lattice units].
        """
        precision = "float32" if single else "float64"
        engine = self._engine(precision)
        held = self._positions.get(precision)
        if held is None or not np.array_equal(held[0], elements):
            row, column = np.divmod(elements.astype(np.int32), np.int32(self.shape[1]))
            held = self._positions[precision] = elements.copy(), engine.positions(row, column)
        if single:
            self.convolutions_fp32 += 1.0
        else:
            self.convolutions += 1.0
        return engine.convolve_at(*held[1], pressure)

    @property
    def total_compliance(self) -> Array:
        """Displacement λ(0) under unit pressure everywhere, array (rows, columns) [lattice units]."""
        return np.broadcast_to(self._mean, self.shape)

    def _engine(self, precision: str) -> Convolution:
        if precision not in self._engines:
            shape, dtype = self.shape, np.dtype(precision)
            self._engines[precision] = Convolution(shape, self._spectrum, dtype, self.threads, self._tuning, shape)
        return self._engines[precision]


def periodic_spectrum(shape: tuple[int, int], kernel: str = "love") -> Array:
    """Return λ, the displacement per pressure of each wave of the grid.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of one period.
    kernel : {"love", "punch", "fourier"}
        Influence coefficients.

    Returns
    -------
    array (rows // 2 + 1, columns // 2 + 1)
        λ in units δ/(π E*), at k = 0, 1, … periods in the grid along each axis; λ(0) = π max(shape).

    Raises
    ------
    ContactError
        If the kernel is unknown.

    References
    ----------
    K. L. Johnson, Contact Mechanics (1985), Section 13.2 (waves on a half space); P. P. Ewald, Ann. Phys. 369 (1921)
    253-287 (the sum over images, split in two that converge fast).
    """
    if kernel not in PERIODIC_KERNELS:
        raise ContactError(f"kernel is {kernel!r}; allowed on a periodic half space: {', '.join(PERIODIC_KERNELS)}")
    row, column = (np.arange(n // 2 + 1) / n for n in shape)
    if kernel == "fourier":
        with np.errstate(divide="ignore"):
            spectrum = 1.0 / np.hypot(row[:, None], column)
    else:
        spectrum = _far_part(row[:, None], column) + _wave_sums(_near_part(), shape)
        if kernel == "punch":
            spectrum += _wave_sums(_punch_over_love(), shape)
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


def _punch_over_love() -> Array:
    """Return the coefficients of the punch less Love's. They fall off as 1/r⁵, so images far away do not count."""
    offset = np.arange(_PUNCH_REACH + 1.0)
    return punch_kernel(offset[:, None], offset) - love_kernel(offset[:, None], offset)


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
