"""The elastic half space: displacement of a free rectangle of square elements under pressure, by FFT.

Conventions
-----------
Every node (i, j) of the surface is the centre of a square element of side δ under uniform pressure p_ij ≥ 0 in
compression. Displacements are positive into the half space. Everything here is in *lattice units*: u in δ/(π E*) times
the unit of p, so that one half space serves every spacing, modulus and height scale of a campaign::

    u_ij = δ/(π E*) Σ_kl K(i-k, j-l) p_kl,        K(0, 0) = 4 ln(1 + √2) = 3.52549 for the Love kernel

The patch is free (nothing is periodic). K is even along both axes, so a transform length M ≥ 2 (n - 1) represents the
linear convolution exactly: of the lags ±(n - 1), which share one place when M = 2 (n - 1), both have the same
coefficient. For n = 2^m + 1 that is M = 2^(m+1), the best length there is, where padding to 2n would be prime-ridden.
For the same reason its spectrum is real and even, a type-I cosine transform of one quadrant; if it is positive the
discrete operator is positive definite, being a compression of the circulant one.
"""

from __future__ import annotations

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
    """Return the FFT length for an even kernel on so many nodes: the next fast even length ≥ 2 (nodes - 1)."""
    half: int = scipy_fft.next_fast_len(max(nodes - 1, 1), real=True)
    return 2 * half


class HalfSpace:
    """The influence of pressure on displacement, u = K ∗ p, for one grid shape and kernel; counts what it does.

    It owns its buffers and FFTW plans, so it is made once and serves any number of surfaces of its shape; it is not
    thread-safe. Lattice units: multiply by δ/(π E*) for a displacement.

    Parameters
    ----------
    shape : (rows, cols), each at least 1.
    kernel : "love" or "punch".
    threads : threads inside one convolution; the result does not depend on them.

    Attributes
    ----------
    convolutions, convolutions_fp32 : zero-padded FFT convolutions done so far, by precision, in units of one on the
        full grid: one over a window counts by its share of the points transformed.
    """

    def __init__(self, shape: tuple[int, int], kernel: str = "love", threads: int = 1, tuning: Tuning = TUNING) -> None:
        self.shape = (int(shape[0]), int(shape[1]))
        if min(self.shape) < 1:
            message = f"shape is {shape}; allowed: at least one element along each axis"
            raise ContactError(message)
        self.kernel, self.threads, self._tuning = kernel, threads, tuning
        self._halves = transform_length(self.shape[0]) // 2, transform_length(self.shape[1]) // 2
        # Also lags beyond the grid, which never enter a result, get the kernel: zeros there would make the spectrum
        # of a positive operator negative in places, and it could not certify anything
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
        """Return u = K ∗ p on every element by one convolution; shape of the grid, a new array."""
        if pressure.shape != self.shape:
            message = f"pressure has shape {pressure.shape}; the half space has {self.shape}"
            raise ContactError(message)
        self.convolutions += 1.0
        return self._engine(self._halves, "float64").convolve(pressure)

    def displacement_above(self, heights: Array, elements: NDArray[np.intp], pressure: NDArray[Any]) -> Array:
        """Return u - heights on every element, flat, by one convolution; the elements (as below) carry the pressure."""
        self.convolutions += 1.0
        engine = self._engine(self._halves, "float64")
        places = engine.places(*np.divmod(elements.astype(np.int32), np.int32(self.shape[1])))
        return engine.convolve_above(heights.reshape(self.shape), *places, pressure).ravel()

    def displacement_at(
        self, elements: NDArray[np.intp], pressure: NDArray[Any], *, single: bool = False
    ) -> NDArray[Any]:
        """Return u at the elements (flat indices, increasing) that alone carry pressure, ``single`` in 32 bits.

        On large grids only the rectangle that holds the elements takes part: this costs the less the smaller it is.
        """
        precision = "float32" if single else "float64"
        window = self._windows.get(precision)
        if window is None or not np.array_equal(window.elements, elements):
            window = self._windows[precision] = self._window(elements, precision)
        if single:
            self.convolutions_fp32 += window.share
        else:
            self.convolutions += window.share
        return window.displacement(pressure)

    @property
    def total_compliance(self) -> Array:
        """Σ_kl K(i-k, j-l) over all elements: the displacement under unit pressure everywhere.

        The kernel is symmetric, so Σu = Σ (K ∗ 1) p: the mean displacement, and with it the free volume, of any
        pressure is one dot product with this array and no field is needed for it.
        """
        if self._compliance is None:
            self._compliance = self.displacement(np.ones(self.shape))
            self.convolutions -= 1.0  # belongs to the grid, not to the first case that happens to use it
            self._compliance.flags.writeable = False
        return self._compliance

    def _window(self, elements: NDArray[np.intp], precision: str) -> _Window:
        """Return the convolution over the least rectangle of allowed size that holds the elements."""
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
        return _Window(engine, elements, row - first[0], column - first[1], share)

    def _engine(self, halves: tuple[int, int], precision: str) -> Convolution:
        """Return the convolution with half the transform lengths given; those of windows are kept for a while."""
        key = (*halves, precision)
        engine = self._engines.pop(key, None)
        if engine is None:
            whole = halves == self._halves
            spectrum = self._spectrum if whole else _spectrum(self._quadrant[: halves[0] + 1, : halves[1] + 1])
            shape = (min(halves[0] + 1, self.shape[0]), min(halves[1] + 1, self.shape[1]))
            engine = Convolution(shape, spectrum, np.dtype(precision), self.threads, self._tuning)
            if not whole:
                windows = [kept for kept in self._engines if kept[:2] != self._halves]
                room = 4 * self._halves[0] * self._halves[1] - engine.size
                held = sum(self._engines[kept].size for kept in windows)
                for old in windows:  # least recently used first
                    if held <= room:
                        break
                    held -= self._engines.pop(old).size
        self._engines[key] = engine  # last used, last in line
        return engine


# Half lengths of the transforms of a window, times a power of two, along the index of rows and along that of columns.
# Complex transforms (the first) are fast for few factors, real ones for more.
_FAST = ((4, 5), (4, 5, 6, 7))


def _window_half(reach: int, half: int, nodes: int, fast: tuple[int, ...]) -> int:
    """Return half the transform length for lags up to ``reach``: the next fast one, or that of the full grid."""
    scale = 4
    while scale < nodes:
        for factor in fast:
            if reach <= factor * scale < min(nodes, half):
                return factor * scale
        scale *= 2
    return half


def _spectrum(quadrant: Array) -> Array:
    """Transform of the even extension of K with the 1/(M₁ M₂) of the inverse transform folded in."""
    spectrum: Array = scipy_fft.dctn(quadrant, type=1)
    spectrum /= 4.0 * max(quadrant.shape[0] - 1, 1) * max(quadrant.shape[1] - 1, 1)
    return spectrum


class _Window:
    """A convolution applied to elements somewhere on the grid."""

    def __init__(
        self, engine: Convolution, elements: NDArray[np.intp], row: NDArray[Any], column: NDArray[Any], share: float
    ) -> None:
        self.elements = elements.copy()
        self.share = share
        self._engine = engine
        self._places = engine.places(row, column)

    def displacement(self, pressure: NDArray[Any]) -> NDArray[Any]:
        return self._engine.convolve_at(*self._places, pressure)
