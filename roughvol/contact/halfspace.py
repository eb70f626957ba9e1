"""The elastic half space: displacement of a free rectangle of square elements under pressure, by FFT.

Conventions: every node (i, j) of the surface is the centre of a square element of side δ under uniform pressure
p_ij ≥ 0 in compression. Displacements are positive into the half space. *Lattice units* are δ/(π E*) times the unit of
p. One half space therefore serves every spacing, modulus and height scale::

    u_ij = δ/(π E*) Σ_kl K(i-k, j-l) p_kl,        K(0, 0) = 4 ln(1 + √2) = 3.52549 for the Love kernel

The patch is free: nothing is periodic. K is even along both axes, so a transform length M ≥ 2 (n - 1) represents the
linear convolution exactly. The lags ±(n - 1) share one index when M = 2 (n - 1), and have the same coefficient. For
n = 2^m + 1 this is the fast length M = 2^(m+1). The spectrum is real and even: a type-I cosine transform of one
quadrant. If it is positive, the operator on the grid is positive definite, as a block of the circulant operator.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft as scipy_fft

from roughvol.contact.convolution import Convolution
from roughvol.contact.kernels import kernel_quadrant
from roughvol.contact.tuning import TUNING, Tuning
from roughvol.errors import ContactError
from roughvol.typing import Array


def transform_length(nodes: int) -> int:
    """Return the FFT length for an even kernel: the next fast even length ≥ 2 (nodes - 1).

    Parameters
    ----------
    nodes : int
        Nodes along the axis.

    Returns
    -------
    int
        Points of the transform.
    """
    half: int = scipy_fft.next_fast_len(max(nodes - 1, 1), real=True)
    return 2 * half


class HalfSpace:
    """Displacement under pressure, u = K ∗ p, for one grid shape and kernel.

    Buffers and FFTW plans are made once, for any number of surfaces of this shape. Not thread-safe. Displacements are
    in lattice units, see the conventions of the module.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns, each at least 1.
    kernel : {"love", "punch"}
        Influence coefficients, see `kernels`.
    threads : int
        Threads inside one convolution. Results do not depend on them.
    tuning : Tuning
        Constants.

    Attributes
    ----------
    influence : array (rows, columns)
        K(i, j) of the non-negative offsets.
    convolutions, convolutions_fp32 : float
        Convolutions so far, by precision. Unit: one on the full grid. A convolution over a window counts by its share
        of the points transformed.

    Raises
    ------
    ContactError
        If the shape is empty, the kernel unknown, or K not positive definite.
    """

    periodic = False

    def __init__(self, shape: tuple[int, int], kernel: str = "love", threads: int = 1, tuning: Tuning = TUNING) -> None:
        self.shape = (int(shape[0]), int(shape[1]))
        if min(self.shape) < 1:
            raise ContactError(f"shape is {shape}; allowed: at least one element along each axis")
        self.kernel, self.threads, self._tuning = kernel, threads, tuning
        self._halves = transform_length(self.shape[0]) // 2, transform_length(self.shape[1]) // 2
        # Lags beyond the grid enter no result, but have the kernel as well. With zeros there, the spectrum of a
        # positive operator would be negative in places.
        self._quadrant = kernel_quadrant((self._halves[0] + 1, self._halves[1] + 1), kernel)
        self._quadrant.flags.writeable = False
        self.influence = np.ascontiguousarray(self._quadrant[: self.shape[0], : self.shape[1]])
        self._spectrum = _spectrum(self._quadrant)
        if not self._spectrum.min() > 0.0:
            message = f"the {self.kernel} kernel is not positive definite on {self.shape}; no unique solution there"
            raise ContactError(message)
        self._engines: dict[tuple[int, int, str], Convolution] = {}
        self._windows: dict[str, _Window] = {}
        self.convolutions = 0.0
        self.convolutions_fp32 = 0.0
        self._compliance: Array | None = None

    def displacement(self, pressure: Array) -> Array:
        """Return u = K ∗ p on every element, by one convolution.

        Parameters
        ----------
        pressure : array (rows, columns)
            Pressures.

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
        return self._engine(self._halves, "float64").convolve(pressure)

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
        engine = self._engine(self._halves, "float64")
        positions = engine.positions(*np.divmod(elements.astype(np.int32), np.int32(self.shape[1])))
        return engine.convolve_above(heights.reshape(self.shape), *positions, pressure).ravel()

    def displacement_at(
        self, elements: NDArray[np.intp], pressure: NDArray[Any], *, single: bool = False
    ) -> NDArray[Any]:
        """Return u at the elements that carry the pressure. On large grids only their rectangle is transformed.

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
        window = self._windows.get(precision)
        if window is None or not np.array_equal(window.elements, elements):
            window = self._windows[precision] = self._window(elements, precision)
        if single:
            self.convolutions_fp32 += window.share
        else:
            self.convolutions += window.share
        return window.engine.convolve_at(*window.positions, pressure)

    @property
    def total_compliance(self) -> Array:
        """Displacement K ∗ 1 under unit pressure everywhere, array (rows, columns) [lattice units].

        K is symmetric, so Σu = Σ (K ∗ 1) p. The mean displacement and the free volume are a dot product with it.
        """
        if self._compliance is None:
            self._compliance = self.displacement(np.ones(self.shape))
            self.convolutions -= 1.0  # a property of the grid, not a cost of the first case
            self._compliance.flags.writeable = False
        return self._compliance

    def _window(self, elements: NDArray[np.intp], precision: str) -> _Window:
        """Return the convolution over the least window that holds the elements."""
        row, column = np.divmod(elements, self.shape[1])
        first = (int(row[0]), int(column.min())) if elements.size else (0, 0)
        last = (int(row[-1]), int(column.max())) if elements.size else (0, 0)
        halves = self._halves
        if 4 * halves[0] * halves[1] >= self._tuning.windows_from:
            row_half, column_half = (
                _window_half(high - low, half, nodes, fast)
                for low, high, half, nodes, fast in zip(first, last, self._halves, self.shape, _FAST, strict=True)
            )
            halves = row_half, column_half
        share = halves[0] * halves[1] / (self._halves[0] * self._halves[1])
        engine = self._engine(halves, precision)
        first = (
            min(first[0], self.shape[0] - engine.shape[0]),
            min(first[1], self.shape[1] - engine.shape[1]),
        )
        return _Window(engine, elements.copy(), share, engine.positions(row - first[0], column - first[1]))

    @property
    def window_points(self) -> int:
        """Points of the transforms kept for windows, at most those of the full grid."""
        return sum(engine.size for key, engine in self._engines.items() if key[:2] != self._halves)

    def _engine(self, halves: tuple[int, int], precision: str) -> Convolution:
        """Return the convolution of given half transform lengths. Windows are kept up to the points of the grid."""
        key = (*halves, precision)
        engine = self._engines.pop(key, None)
        if engine is None:
            whole = halves == self._halves
            spectrum = self._spectrum if whole else _spectrum(self._quadrant[: halves[0] + 1, : halves[1] + 1])
            shape = (min(halves[0] + 1, self.shape[0]), min(halves[1] + 1, self.shape[1]))
            engine = Convolution(shape, spectrum, np.dtype(precision), self.threads, self._tuning)
            if not whole:
                room = 4 * self._halves[0] * self._halves[1] - engine.size
                for old in [kept for kept in self._engines if kept[:2] != self._halves]:  # least recently used first
                    if self.window_points <= room:
                        break
                    del self._engines[old]
        self._engines[key] = engine  # the most recently used comes last
        return engine


# Half transform lengths of a window, over a power of two: along the row index, and along the column index. Complex
# transforms (the first) are fast for few factors, real ones for more.
_FAST = ((4, 5), (4, 5, 6, 7))


def _window_half(reach: int, half: int, nodes: int, fast: tuple[int, ...]) -> int:
    """Return half the transform length for lags up to `reach`: the next fast one, or that of the full grid."""
    scale = 4
    while scale < nodes:
        for factor in fast:
            if reach <= factor * scale < min(nodes, half):
                return factor * scale
        scale *= 2
    return half


def _spectrum(quadrant: Array) -> Array:
    """Return the transform of the even extension of K, with the factor 1/(M₁ M₂) of the inverse transform."""
    spectrum: Array = scipy_fft.dctn(quadrant, type=1)
    spectrum /= 4.0 * max(quadrant.shape[0] - 1, 1) * max(quadrant.shape[1] - 1, 1)
    return spectrum


@dataclass(frozen=True)
class _Window:
    """A convolution over a part of the grid, for fixed elements."""

    engine: Convolution
    elements: NDArray[np.intp]
    share: float
    positions: tuple[list[int], NDArray[Any]]
