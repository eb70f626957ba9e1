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
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft as scipy_fft

from roughvol.contact.convolution import Convolution
from roughvol.contact.kernels import LOVE, Kernel, kernel_of
from roughvol.contact.tuning import TUNING, Tuning
from roughvol.errors import ContactError
from roughvol.typing import Array, Index


def transform_length(nodes: int) -> int:
    """Return the FFT length for an even kernel: the next fast even length ≥ 2 (nodes - 1)."""
    half: int = scipy_fft.next_fast_len(max(nodes - 1, 1), real=True)
    return 2 * half


@dataclass(frozen=True)
class Window:
    """A convolution over the whole grid or a part of it, for fixed elements.

    Attributes
    ----------
    engine : Convolution
        The convolution over the window.
    elements : array (n,)
        Flat indices on the grid.
    share : float
        Points transformed, over those of the whole grid.
    positions : edges and positions
        The elements in the window, see `Convolution.positions`.
    """

    engine: Convolution
    elements: Index
    share: float
    positions: tuple[list[int], NDArray[Any]]


class ElasticBody:
    """Displacement under pressure, u = K ∗ p, by convolutions: the common part of free and periodic half spaces.

    Buffers and FFTW plans are made once, for any number of surfaces of the shape. Not thread-safe. Displacements are in
    lattice units, see the conventions of `halfspace`.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the grid.
    kernel : Kernel or str
        Influence coefficients, or the name of a kernel in `kernels`: "love", "punch", "fourier".
    threads : int
        Threads inside one convolution. Results do not depend on them.
    tuning : Tuning
        Constants.

    Attributes
    ----------
    influence : array (rows, columns)
        K(i, j) of the non-negative offsets. On a periodic half space images are included.
    convolutions, convolutions_fp32 : float
        Convolutions so far, by precision. Unit: one on the full grid. A convolution over a window counts by its share
        of the points transformed.

    Raises
    ------
    ContactError
        If the shape is too small, the kernel unknown, or K not positive definite.
    """

    periodic: bool
    least: int  # elements along an axis
    influence: Array

    def __init__(
        self, shape: tuple[int, int], kernel: Kernel | str = LOVE, threads: int = 1, tuning: Tuning = TUNING
    ) -> None:
        self.shape, self.kernel = (int(shape[0]), int(shape[1])), kernel_of(kernel)
        if min(self.shape) < self.least:
            raise ContactError(f"shape is {shape}; allowed: at least {self.least} × {self.least} elements")
        self.threads, self._tuning = threads, tuning
        self._windows: dict[str, Window] = {}
        self.convolutions = 0.0
        self.convolutions_fp32 = 0.0
        self._spectrum = self._waves()
        if not self._spectrum.min() > 0.0:
            message = (
                f"the {self.kernel.name} kernel is not positive definite on {self.shape}; no unique solution there"
            )
            raise ContactError(message)
        self.influence.flags.writeable = False

    def displacement(self, pressure: Array) -> Array:
        """Return u = K ∗ p (rows, columns) on every element, by one convolution."""
        if pressure.shape != self.shape:
            raise ContactError(f"pressure has shape {pressure.shape}; the half space has {self.shape}")
        self.convolutions += 1.0
        return self._whole("float64").convolve(pressure)

    def displacement_above(self, heights: Array, elements: Index, pressure: NDArray[Any]) -> Array:
        """Return u - heights on every element, flat, by one convolution; pressure (n,) on increasing elements."""
        self.convolutions += 1.0
        engine = self._whole("float64")
        positions = engine.positions(*np.divmod(elements.astype(np.int32), np.int32(self.shape[1])))
        return engine.convolve_above(heights.reshape(self.shape), *positions, pressure).ravel()

    def displacement_at(self, elements: Index, pressure: NDArray[Any], *, single: bool = False) -> NDArray[Any]:
        """Return u (n,) at the increasing elements that carry the pressure (n,), in 32 bits if `single`."""
        precision = "float32" if single else "float64"
        window = self._windows.get(precision)
        if window is None or not np.array_equal(window.elements, elements):
            window = self._windows[precision] = self._window(elements, precision)
        if single:
            self.convolutions_fp32 += window.share
        else:
            self.convolutions += window.share
        return window.engine.convolve_at(*window.positions, pressure)

    def _waves(self) -> Array:
        """Return one quadrant of the spectrum, with the factor of the inverse transform, and set `influence`."""
        raise NotImplementedError

    def _whole(self, precision: str) -> Convolution:
        """Return the convolution over the whole grid."""
        raise NotImplementedError

    def _window(self, elements: Index, precision: str) -> Window:
        """Return the convolution for pressures on some elements: over the whole grid."""
        engine = self._whole(precision)
        return Window(engine, elements.copy(), 1.0, engine.positions(*np.divmod(elements, self.shape[1])))


class HalfSpace(ElasticBody):
    """The free half space: nothing is periodic.

    On large grids only the rectangle of the elements under pressure is transformed.
    """

    periodic = False
    least = 1

    def _waves(self) -> Array:
        self._halves = transform_length(self.shape[0]) // 2, transform_length(self.shape[1]) // 2
        # Lags beyond the grid enter no result, but have the kernel as well. With zeros there, the spectrum of a
        # positive operator would be negative in places.
        self._quadrant = self.kernel.quadrant((self._halves[0] + 1, self._halves[1] + 1))
        self._quadrant.flags.writeable = False
        self.influence = np.ascontiguousarray(self._quadrant[: self.shape[0], : self.shape[1]])
        self._engines: dict[tuple[int, int, str], Convolution] = {}
        return _spectrum(self._quadrant)

    @cached_property
    def total_compliance(self) -> Array:
        """Displacement K ∗ 1 under unit pressure everywhere, array (rows, columns) [lattice units].

        K is symmetric, so Σu = Σ (K ∗ 1) p. The mean displacement and the free volume are a dot product with it.
        """
        compliance = self._whole("float64").convolve(np.ones(self.shape))
        compliance.flags.writeable = False
        return compliance

    def _whole(self, precision: str) -> Convolution:
        return self._engine(self._halves, precision)

    def _window(self, elements: Index, precision: str) -> Window:
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
        return Window(engine, elements.copy(), share, engine.positions(row - first[0], column - first[1]))

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
