"""The elastic half space: displacement of square elements under pressure, by FFT; a patch, or a part of a plane.

Conventions: every node (i, j) of the surface is the centre of a square element of side δ under uniform pressure
p_ij ≥ 0 in compression. Displacements are positive into the half space. *Lattice units* are δ/(π E*) times the unit of
p. One half space therefore serves every spacing, modulus and height scale::

    u_ij = δ/(π E*) Σ_kl K(i-k, j-l) p_kl,        K(0, 0) = 4 ln(1 + √2) = 3.52549 for the Love kernel

On a free patch nothing is periodic. K is even along both axes, so a transform length M ≥ 2 (n - 1) represents the
linear convolution exactly. The lags ±(n - 1) share one index when M = 2 (n - 1), and have the same coefficient. For
n = 2^m + 1 this is the fast length M = 2^(m+1). The spectrum is real and even: a type-I cosine transform of one
quadrant. If it is positive, the operator on the grid is positive definite, as a block of the circulant operator.

On a periodic surface n × n' elements are one period, without a repeated edge, so L = n δ. The transforms have the
length of the grid, and the coefficients include all images (`kernels`).

A mirrored surface of n × n' elements is repeated in its mirror images at the outer edges of its outer elements, to
a plane with the period of 2n × 2n' elements. Pressures have the symmetry of the heights. With Kp of that period,
K(i, k) = Kp(i - k) + Kp(i + k + 1) along each axis.
"""

import math
import operator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft as scipy_fft

from roughvol.contact.convolution import Convolution, Places
from roughvol.contact.cosines import MirroredConvolution
from roughvol.contact.kernels import LOVE, Kernel, influence_matrix, kernel_of, periodic_spectrum
from roughvol.contact.options import TUNING, Tuning
from roughvol.errors import ContactError
from roughvol.spellings import arguments
from roughvol.typing import Array, Index, Shape, Sides

LEAST_PERIOD = 5  # the neighbours of an element within two spacings are then five different ones along an axis
_LEAST: dict[Sides, int] = {"free": 1, "mirrored": -(-LEAST_PERIOD // 2), "periodic": LEAST_PERIOD}
# Transform lengths of a window, over a power of two: along the row index, and along the column index. Complex
# transforms (the first) are fast for few factors, real ones for more.
_FAST = ((4, 5), (4, 5, 6, 7))


def transform_length(nodes: int) -> int:
    """Return the FFT length for an even kernel: the next fast even length ≥ 2 (nodes - 1)."""
    half: int = scipy_fft.next_fast_len(max(nodes - 1, 1), real=True)
    return 2 * half


class Window(NamedTuple):
    """A convolution over the grid or a part of it, for fixed elements, and its share of the points transformed."""

    engine: Convolution
    elements: Index
    share: float
    places: Places


@arguments
class HalfSpace:
    """Displacement under pressure, u = K ∗ p, by convolutions, on a free patch or on a part of an endless plane.

    Buffers and FFTW plans are made once, for any number of surfaces of the shape. Not thread-safe. Displacements are in
    lattice units, δ/(π E*) times the unit of pressure.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the grid.
    kernel : Kernel or str
        Elastic body, or the name of a kernel in `kernels`: "love", "punch", "fourier".
    threads : int
        Threads inside one convolution. Results do not depend on them.
    tuning : Tuning
        Constants.
    sides : {"free", "mirrored", "periodic"}
        Whether the grid is a patch, or a part of an endless plane: repeated in its mirror images, or as a period.

    Attributes
    ----------
    influence : array (rows, columns)
        K(i, j) of the non-negative offsets, images of a period included. On a mirrored half space that of the doubled
        period, (rows + 1, columns + 1): K between two elements is a sum over mirror images, see `between`.
    convolutions, convolutions_fp32 : float
        Convolutions so far, by precision. Unit: one on the full grid. A convolution over a window counts by its share
        of the points transformed.

    Raises
    ------
    ContactError
        If the shape is too small, the kernel unknown, or K not positive definite.

    See Also
    --------
    roughvol.contact.solve : Returns the contact of a rough surface with a half space.

    Examples
    --------
    >>> import numpy as np
    >>> from roughvol.contact import HalfSpace
    >>> one_element = np.zeros((9, 9))
    >>> one_element[4, 4] = 1.0
    >>> u = HalfSpace(one_element.shape).displacement(one_element)
    >>> (u[4, 6:] * [2, 3, 4]).round(2).tolist()  # far away u goes with 1/r
    [1.01, 1.0, 1.0]
    """

    def __init__(
        self,
        shape: Shape,
        kernel: Kernel | str = LOVE,
        threads: int = 1,
        tuning: Tuning = TUNING,
        *,
        sides: Sides = "free",
    ) -> None:
        if sides not in _LEAST:
            raise ContactError(f"sides is {sides!r}; allowed: {', '.join(_LEAST)}")
        try:
            rows, columns = map(operator.index, shape)
        except (TypeError, ValueError) as error:
            raise ContactError(f"shape is {shape!r}; allowed: two whole numbers") from error
        self.shape, self.kernel, self.sides = (rows, columns), kernel_of(kernel), sides
        self.threads, self._tuning = threads, tuning
        if not isinstance(threads, int | np.integer) or threads < 1:
            raise ContactError(f"threads is {threads!r}; allowed: whole numbers, at least 1")
        least = _LEAST[sides]
        if min(self.shape) < least:
            raise ContactError(f"shape is {shape}; allowed: at least {least} × {least} elements")
        self.convolutions = self.convolutions_fp32 = 0.0
        self._lengths = rows, columns = self.shape
        if sides == "mirrored":
            self._spectrum = periodic_spectrum((2 * rows, 2 * columns), self.kernel)
            self.influence: Array = scipy_fft.idctn(self._spectrum, type=1)  # half a period
            self._mean: float = self._spectrum[0, 0]
        elif sides == "periodic":
            waves = periodic_spectrum(self.shape, self.kernel)
            self._mean, self._spectrum = waves[0, 0], waves / math.prod(self.shape)
            row = np.arange(rows)  # the even extension of λ is real
            self.influence = np.fft.irfft2(waves[np.minimum(row, rows - row)], s=self.shape)
        else:
            self._lengths = transform_length(rows), transform_length(columns)
            # Lags beyond the grid enter no result, but have the kernel as well. With zeros there, the spectrum of a
            # positive operator would be negative in places.
            self._quadrant = self.kernel.quadrant((self._lengths[0] // 2 + 1, self._lengths[1] // 2 + 1))
            self._spectrum = _spectrum(self._quadrant)
            self.influence = np.ascontiguousarray(self._quadrant[:rows, :columns])
        self.influence.flags.writeable = False
        if not self._spectrum.min() > 0.0:
            name = self.kernel.name
            raise ContactError(f"the {name} kernel is not positive definite on {self.shape}; no unique solution there")
        self._latest: dict[str, Window] = {}  # of each precision
        self._engines: dict[tuple[int, int, str], Convolution | MirroredConvolution] = {}

    @property
    def endless(self) -> bool:
        """Whether the grid is a part of an endless plane, where mean displacements only relabel the indentation."""
        return self.sides != "free"

    def between(self, elements: Index) -> Array:
        """Return the matrix K (n, n) between elements, by their flat indices."""
        return influence_matrix(self.influence, elements, mirrored=self.sides == "mirrored")

    def displacement(self, pressure: Array) -> Array:
        """Return u = K ∗ p (rows, columns) on every element, by one convolution."""
        pressure = np.asarray(pressure)
        if pressure.shape != self.shape:
            raise ContactError(f"pressure has shape {pressure.shape}; the half space has {self.shape}")
        displacement: Array = self.displacement_at(np.arange(pressure.size), pressure.ravel())
        return displacement.reshape(self.shape)

    def displacement_above(self, heights: Array, elements: Index, pressure: NDArray[Any]) -> Array:
        """Return u - heights on every element, flat, by one convolution; pressure (n,) on increasing elements."""
        self.convolutions += 1.0
        engine = self._engine(self._lengths, "float64")
        places = engine.places(*np.divmod(elements.astype(np.int32), np.int32(self.shape[1])))
        return engine.convolve_above(heights.reshape(self.shape), places, pressure).ravel()

    def displacement_at(self, elements: Index, pressure: NDArray[Any], *, single: bool = False) -> NDArray[Any]:
        """Return u (n,) at the increasing elements that carry the pressure (n,), in 32 bits if `single`."""
        precision = "float32" if single else "float64"
        window = self._latest.get(precision)
        if window is None or not np.array_equal(window.elements, elements):
            window = self._latest[precision] = self._window(elements, precision)
        if single:
            self.convolutions_fp32 += window.share
        else:
            self.convolutions += window.share
        return window.engine.convolve_at(window.places, pressure)

    @cached_property
    def total_compliance(self) -> Array:
        """Displacement K ∗ 1 under unit pressure everywhere, so that Σu = Σ (K ∗ 1) p; λ(0) on an endless plane."""
        if self.endless:
            compliance = np.full(self.shape, self._mean)
        else:
            size = math.prod(self.shape)
            window = self._window(np.arange(size), "float64")
            compliance = window.engine.convolve_at(window.places, np.ones(size)).reshape(self.shape)
        compliance.flags.writeable = False
        return compliance

    @property
    def window_points(self) -> int:
        """Points of the transforms kept for windows, at most those of the full grid."""
        return sum(engine.size for key, engine in self._engines.items() if key[:2] != self._lengths)

    def _window(self, elements: Index, precision: str) -> Window:
        """Return the convolution over the least window that holds the elements: the whole grid, unless it is large."""
        row, column = np.divmod(elements, self.shape[1])
        lengths, points = self._lengths, math.prod(self._lengths)
        windowed = not self.endless and points >= self._tuning.windows_from and elements.size > 0
        if windowed:
            low = int(row[0]), int(column.min())
            lengths = self._window_length(int(row[-1]) - low[0], 0), self._window_length(int(column.max()) - low[1], 1)
        engine = self._engine(lengths, precision)
        if windowed:
            row = row - min(low[0], self.shape[0] - engine.shape[0])
            column = column - min(low[1], self.shape[1] - engine.shape[1])
        return Window(engine, elements.copy(), engine.size / points, engine.places(row, column))

    def _window_length(self, reach: int, axis: int) -> int:
        """Return the transform length for lags up to `reach`: the next fast one, or that of the full grid."""
        nodes, length = self.shape[axis], self._lengths[axis]
        scale = 4
        while scale < nodes:
            for factor in _FAST[axis]:
                if reach <= factor * scale < min(nodes, length // 2):
                    return 2 * factor * scale
            scale *= 2
        return length

    def _engine(self, lengths: Shape, precision: str) -> Convolution:
        """Return the convolution of given transform lengths. Windows are kept up to the points of the grid."""
        key = (*lengths, precision)
        engine = self._engines.pop(key, None)
        if engine is None and self.sides == "mirrored":
            engine = MirroredConvolution(self._spectrum, np.dtype(precision), self.threads, self._tuning)
        elif engine is None:
            shape, spectrum = self.shape, self._spectrum
            if lengths != self._lengths:
                halves = lengths[0] // 2 + 1, lengths[1] // 2 + 1
                shape = min(halves[0], shape[0]), min(halves[1], shape[1])
                spectrum = _spectrum(self._quadrant[: halves[0], : halves[1]])
            engine = Convolution(shape, spectrum, lengths, np.dtype(precision), self.threads, self._tuning)
        self._engines[key] = engine  # the most recently used comes last
        for old in [kept for kept in self._engines if kept[:2] != self._lengths]:
            if self.window_points <= math.prod(self._lengths):
                break
            del self._engines[old]
        return engine


def _spectrum(quadrant: Array) -> Array:
    """Return the transform of the even extension of K, with the factor 1/(M₁ M₂) of the inverse transform."""
    spectrum: Array = scipy_fft.dctn(quadrant, type=1)
    spectrum /= 4.0 * max(quadrant.shape[0] - 1, 1) * max(quadrant.shape[1] - 1, 1)
    return spectrum
