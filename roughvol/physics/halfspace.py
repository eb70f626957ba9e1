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

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import pyfftw
from numpy.typing import NDArray
from scipy import fft as scipy_fft

from roughvol.errors import ContactError

Array = NDArray[np.float64]

# ESTIMATE chooses a plan without timing anything: the same plan, hence the same rounding, on every run and in every
# worker process. Measured plans were not faster by a margin that shows (README, "Decisions").
PLANNER = "FFTW_ESTIMATE"
FFTW_VERSION: str = pyfftw.fftw_version

_SERIES_FROM = 64.0  # spacings; both forms have a relative error of 4e-14 there, the worst of all


def love_kernel(x: Array, y: Array) -> Array:
    r"""Return Love's influence coefficients of a unit square element at offsets x, y ≥ 0.

    .. math:: K(x, y) = \int_{-1/2}^{1/2}\int_{-1/2}^{1/2} \frac{dξ\,dη}{\sqrt{(x-ξ)^2 + (y-η)^2}}

    so that u = δ/(π E*) K p. Near the element the closed form is written with ``log1p`` of the relative differences,
    which keeps all digits along the axes; beyond r = 64 spacings it is the multipole series of a uniform square up to
    fourth moments, where the closed form would lose digits as ε r².

    Parameters
    ----------
    x, y : array, in spacings, ≥ 0 (the kernel is even: mirror for negative offsets), not on the edge of the element.

    Returns
    -------
    array, dimensionless; relative error below 1e-13 everywhere.

    References
    ----------
    A. E. H. Love, Phil. Trans. R. Soc. A 228 (1929) 377-420; K. L. Johnson, Contact Mechanics (1985), eq. 3.25.
    """
    x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    if x.size and min(x.min(), y.min()) < 0:
        message = "love_kernel takes offsets >= 0 (the kernel is even; mirror it)"
        raise ContactError(message)
    kernel = np.empty(x.shape)
    far = np.hypot(x, y) > _SERIES_FROM
    kernel[far] = _love_far(x[far], y[far])
    kernel[~far] = _love_near(x[~far], y[~far])
    return kernel


def _love_near(x: Array, y: Array) -> Array:
    """Return the closed form, Σ± over the four corners, grouped in two pairs of logarithms per axis."""
    a, b, c, d = x + 0.5, x - 0.5, y + 0.5, y - 0.5  # corner offsets; b, d ≥ -1/2
    ac, ad, bc, bd = np.hypot(a, c), np.hypot(a, d), np.hypot(b, c), np.hypot(b, d)

    def pair(s: Array, t_hi: Array, t_lo: Array, r_hi: Array, r_lo: Array) -> Array:
        # s ln[(t_hi + r_hi) / (t_lo + r_lo)]; t_lo ≥ -1/2 makes the denominator positive (s ≠ 0 at every node)
        return s * np.log1p(((t_hi - t_lo) + (t_hi - t_lo) * (t_hi + t_lo) / (r_hi + r_lo)) / (t_lo + r_lo))

    # (r_hi - r_lo) = (t_hi² - t_lo²) / (r_hi + r_lo) since both share s: no cancellation in the difference of radii
    return pair(a, c, d, ac, ad) - pair(b, c, d, bc, bd) + pair(c, a, b, ac, bc) - pair(d, a, b, ad, bd)


def _love_far(x: Array, y: Array) -> Array:
    """Return the moments of a unit square: 1/r + Δ(1/r)/24 + fourth moments; Δ is the plane Laplacian."""
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
    """Return the coefficients of the same group's later code: a rigid punch on itself, a disc on the others.

    Self term 2/(π E* δ) per unit force, asin(δ/2r)·(…) elsewhere; in lattice units K(0, 0) = 2 and
    K(r) = 2 asin(1/(2 r)), which tends to 1/r. It under-weights the diagonal, so H⁻¹ is no M-matrix here.
    """
    r = np.hypot(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    kernel = np.full(r.shape, 2.0)
    away = r > 0
    kernel[away] = 2.0 * np.arcsin(0.5 / r[away])
    return kernel


KERNELS: dict[str, Callable[[Array, Array], Array]] = {"love": love_kernel, "punch": punch_kernel}


def kernel_quadrant(shape: tuple[int, int], kernel: str = "love") -> Array:
    """Return K(i, j) for the offsets 0 ≤ i < rows, 0 ≤ j < cols, in units δ/(π E*)."""
    if kernel not in KERNELS:
        message = f"kernel is {kernel!r}; allowed: {', '.join(KERNELS)}"
        raise ContactError(message)
    rows, cols = (np.arange(float(n)) for n in shape)
    quadrant = KERNELS[kernel](rows[:, None], cols[None, :])
    return np.ascontiguousarray(quadrant)


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
    convolutions, convolutions_fp32 : number of zero-padded FFT convolutions done so far, by precision.
    """

    def __init__(self, shape: tuple[int, int], kernel: str = "love", threads: int = 1) -> None:
        self.shape = (int(shape[0]), int(shape[1]))
        if min(self.shape) < 1:
            message = f"shape is {shape}; allowed: at least one element along each axis"
            raise ContactError(message)
        self.kernel, self.threads = kernel, threads
        self.influence = kernel_quadrant(self.shape, kernel)
        self.influence.flags.writeable = False
        self._lengths = (transform_length(self.shape[0]), transform_length(self.shape[1]))
        self._spectrum = self._quadrant_spectrum()
        self._engines: dict[str, _Convolution] = {}
        self.convolutions = 0
        self.convolutions_fp32 = 0
        self._compliance: Array | None = None

    def displacement(self, pressure: Array) -> Array:
        """Return u = K ∗ p on every element by one convolution; shape of the grid, a new array."""
        if pressure.shape != self.shape:
            message = f"pressure has shape {pressure.shape}; the half space has {self.shape}"
            raise ContactError(message)
        self.convolutions += 1
        return np.array(self._engine("float64").convolve(pressure))

    def displacement_at(
        self, elements: NDArray[np.intp], pressure: NDArray[Any], *, single: bool = False
    ) -> NDArray[Any]:
        """Return u at the elements (flat indices) that alone carry pressure; ``single`` does it in 32-bit arithmetic.

        Saves the passes over the grid on either side of the transform, which is all there is outside it.
        """
        if single:
            self.convolutions_fp32 += 1
        else:
            self.convolutions += 1
        return self._engine("float32" if single else "float64").convolve_at(elements, pressure)

    @property
    def total_compliance(self) -> Array:
        """Σ_kl K(i-k, j-l) over all elements: the displacement under unit pressure everywhere.

        The kernel is symmetric, so Σu = Σ (K ∗ 1) p: the mean displacement, and with it the free volume, of any
        pressure is one dot product with this array and no field is needed for it.
        """
        if self._compliance is None:
            self._compliance = self.displacement(np.ones(self.shape))
            self.convolutions -= 1  # belongs to the grid, not to the first case that happens to use it
            self._compliance.flags.writeable = False
        return self._compliance

    def _quadrant_spectrum(self) -> Array:
        """Transform of the even extension of K with the 1/(M₁ M₂) of the inverse transform folded in."""
        half_rows, half_cols = (length // 2 + 1 for length in self._lengths)
        # Also lags beyond the grid, which never enter a result, get the kernel: zeros there would make the spectrum
        # of a positive operator negative in places, and it could not certify anything
        quadrant = kernel_quadrant((half_rows, half_cols), self.kernel)
        spectrum: Array = scipy_fft.dctn(quadrant, type=1, overwrite_x=True)
        if not spectrum.min() > 0.0:
            message = f"the {self.kernel} kernel is not positive definite on {self.shape}; no unique solution there"
            raise ContactError(message)
        return spectrum / (self._lengths[0] * self._lengths[1])

    def _engine(self, precision: str) -> _Convolution:
        if precision not in self._engines:
            self._engines[precision] = _Convolution(
                self.shape, self._lengths, self._spectrum, np.dtype(precision), self.threads
            )
        return self._engines[precision]


class _Convolution:
    """Plans and buffers of one precision, for rows forward, columns forward, times spectrum, and back.

    Padding is never transformed where it need not be: only occupied rows go forward and only those come back. Columns
    are copied in blocks into rows of a small buffer that stays in cache, where their transforms are contiguous; a
    strided plan takes up to twice as long on large grids. The blocks do not depend on the number of threads, which
    share them out, so neither do the results.
    """

    def __init__(
        self, shape: tuple[int, int], lengths: tuple[int, int], spectrum: Array, dtype: np.dtype[Any], threads: int
    ) -> None:
        self.shape, (rows, columns) = shape, shape
        length, width = lengths
        waves = width // 2 + 1
        complex_type = np.result_type(dtype, np.complex64)
        # One coefficient serves the column frequencies k and length - k: the kernel is even
        self._spectrum = np.ascontiguousarray(spectrum.T, dtype=dtype)
        self._real = pyfftw.zeros_aligned((rows, width), dtype=dtype)
        self._waves = pyfftw.zeros_aligned((rows, waves), dtype=complex_type)
        self._result = pyfftw.zeros_aligned((rows, width), dtype=dtype)
        self._row_plans = [
            (
                _plan(self._real[part], self._waves[part], "FFTW_FORWARD"),
                _plan(self._waves[part], self._result[part], "FFTW_BACKWARD"),
            )
            for part in _parts(rows, width)
        ]
        self._column_parts = _parts(waves, length)
        deepest = max(part.stop - part.start for part in self._column_parts)
        workers = min(threads, len(self._column_parts))
        self._blocks = [pyfftw.zeros_aligned((deepest, length), dtype=complex_type) for _ in range(workers)]
        self._block_plans = [(_plan(b, b, "FFTW_FORWARD"), _plan(b, b, "FFTW_BACKWARD")) for b in self._blocks]
        self._pool = ThreadPoolExecutor(workers) if workers > 1 else None
        self._real[:] = 0.0
        self._field = self._real[:, :columns]  # the part of the padded input that carries pressure
        self._flat = self._real.reshape(-1)
        self._flat_result = self._result.reshape(-1)
        self._padding = width - columns

    def convolve(self, pressure: NDArray[Any]) -> NDArray[Any]:
        """Return a view of the result, valid until the next call."""
        self._field[:] = pressure
        self._transform()
        self._field[:] = 0.0
        return self._result[:, : self.shape[1]]

    def convolve_at(self, elements: NDArray[np.intp], pressure: NDArray[Any]) -> NDArray[Any]:
        """Return u on the elements that carry the pressure, in the precision of the engine."""
        places = elements + (elements // self.shape[1]) * self._padding
        self._flat[places] = pressure
        self._transform()
        self._flat[places] = 0.0
        return self._flat_result[places]

    def _transform(self) -> None:
        self._share(lambda _, plans: plans[0](), self._row_plans)
        self._share(self._columns, self._column_parts)
        self._share(lambda _, plans: plans[1](), self._row_plans)

    def _columns(self, worker: int, part: slice) -> None:
        """Filter a block of columns: forward, times spectrum, backward."""
        block, (forward, backward) = self._blocks[worker], self._block_plans[worker]
        rows, half = self.shape[0], self._spectrum.shape[1]
        used = block[: part.stop - part.start]
        used[:, :rows] = self._waves[:, part].T
        used[:, rows:] = 0.0
        forward()
        used[:, :half] *= self._spectrum[part]
        used[:, half:] *= self._spectrum[part, -2:0:-1]
        backward()
        self._waves[:, part] = used[:, :rows].T

    def _share(self, task: Callable[[int, Any], None], items: Sequence[Any]) -> None:
        """Do all items: worker k takes every workers-th, beginning with item k."""
        if self._pool is None:
            for item in items:
                task(0, item)
            return
        workers = len(self._blocks)

        def work(worker: int) -> None:
            for item in items[worker::workers]:
                task(worker, item)

        list(self._pool.map(work, range(workers)))


def _plan(source: Any, target: Any, direction: str) -> Callable[[], None]:
    flags = (PLANNER,) if direction == "FFTW_FORWARD" else (PLANNER, "FFTW_DESTROY_INPUT")
    execute: Callable[[], None] = pyfftw.FFTW(source, target, axes=(1,), direction=direction, flags=flags).execute
    return execute


def _parts(count: int, length: int) -> list[slice]:
    """Cut so many transforms of a length into equal parts of about half a MiB each, small enough to stay in cache."""
    parts = max(1, count * length // 2**15)
    edges = np.linspace(0, count, parts + 1).round().astype(int).tolist()
    return [slice(start, stop) for start, stop in pairwise(edges)]
