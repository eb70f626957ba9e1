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

from collections.abc import Callable
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
    convolutions, convolutions_fp32 : zero-padded FFT convolutions done so far, by precision, in units of one on the
        full grid: one over a window counts by its share of the points transformed.
    """

    def __init__(self, shape: tuple[int, int], kernel: str = "love", threads: int = 1) -> None:
        self.shape = (int(shape[0]), int(shape[1]))
        if min(self.shape) < 1:
            message = f"shape is {shape}; allowed: at least one element along each axis"
            raise ContactError(message)
        self.kernel, self.threads = kernel, threads
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
        self._engines: dict[tuple[int, int, str], _Convolution] = {}
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
        if 4 * halves[0] * halves[1] >= _WINDOWED_FROM:
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

    def _engine(self, halves: tuple[int, int], precision: str) -> _Convolution:
        """Return the convolution with half the transform lengths given; those of windows are kept for a while."""
        key = (*halves, precision)
        engine = self._engines.pop(key, None)
        if engine is None:
            whole = halves == self._halves
            spectrum = self._spectrum if whole else _spectrum(self._quadrant[: halves[0] + 1, : halves[1] + 1])
            shape = (min(halves[0] + 1, self.shape[0]), min(halves[1] + 1, self.shape[1]))
            engine = _Convolution(shape, spectrum, np.dtype(precision), self.threads)
            if not whole:
                windows = [kept for kept in self._engines if kept[:2] != self._halves]
                room = max(4 * self._halves[0] * self._halves[1], _KEPT) - engine.size
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
_SMALLEST_HALF = 16
_WINDOWED_FROM = 2**18  # points of the full grid (m = 8); below, new plans cost what smaller transforms save
_KEPT = 2**22  # points that the windows kept may come to where the full grid has fewer: some 60 MB


def _window_half(reach: int, half: int, nodes: int, fast: tuple[int, ...]) -> int:
    """Return half the transform length for lags up to ``reach``: the next fast one, or that of the full grid."""
    scale = _SMALLEST_HALF // 4
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
        self, engine: _Convolution, elements: NDArray[np.intp], row: NDArray[Any], column: NDArray[Any], share: float
    ) -> None:
        self.elements = elements.copy()
        self.share = share
        self._engine = engine
        self._places = engine.places(row, column)

    def displacement(self, pressure: NDArray[Any]) -> NDArray[Any]:
        return self._engine.convolve_at(*self._places, pressure)


class _Convolution:
    """Plans and buffers of one precision, for rows forward, columns forward, times spectrum, and back.

    Padding is never transformed where it need not be: only occupied rows go forward and only those come back. Rows and
    columns go through buffers, of which what is transformed at a time stays in cache. Columns are copied into rows
    there, where their transforms are contiguous, and every transform has its result beside its argument: plans in place
    take up to half as long again.
    The blocks do not depend on the number of threads, which share them out, so neither do the results.
    """

    def __init__(self, shape: tuple[int, int], spectrum: Array, dtype: np.dtype[Any], threads: int) -> None:
        self.shape, rows = shape, shape[0]
        length, width = (2 * max(n - 1, 1) for n in spectrum.shape)
        waves = width // 2 + 1
        self.size = length * width  # points transformed
        self._dtype, complex_type = dtype, np.result_type(dtype, np.complex64)
        # The kernel is even: one coefficient serves the column frequencies k and length - k, and, being real, both
        # parts of a complex number. Written out in full, the multiplication is a contiguous one of real numbers.
        full = np.empty((waves, length, 2), dtype=dtype)
        full[:, : length // 2 + 1] = spectrum.T[:, :, None]
        full[:, length // 2 + 1 :] = full[:, length // 2 - 1 : 0 : -1]
        self._spectrum = full.reshape(waves, 2 * length)
        aligned = 64 // complex_type.itemsize
        padded = -(-waves // aligned) * aligned
        self._waves = pyfftw.zeros_aligned((rows, padded), dtype=complex_type)[:, :waves]
        fine = self._waves.nbytes >= _FINE
        self._row_parts = _parts(rows, width * complex_type.itemsize)
        self._column_parts = _parts(waves, length * complex_type.itemsize, _TOGETHER[fine])
        self._bands = _cut(rows, _BAND)
        workers = min(threads, len(self._column_parts))
        self._pool = ThreadPoolExecutor(workers) if workers > 1 else None
        deepest = max(part.stop - part.start for part in self._row_parts)
        self._rows = [pyfftw.zeros_aligned((deepest, width), dtype=dtype) for _ in range(workers)]
        self._results = [pyfftw.zeros_aligned((deepest, width), dtype=dtype) for _ in range(workers)]
        copied = fine and width * dtype.itemsize <= _COPIED_ROW
        near = [pyfftw.zeros_aligned((deepest, padded), dtype=complex_type)[:, :waves] for _ in range(workers * copied)]
        self._row_plans = []
        for k, part in enumerate(self._row_parts):
            count, worker = part.stop - part.start, k % workers
            self._row_plans.append(
                _row_plans(
                    self._rows[worker][:count],
                    self._waves[part],
                    self._results[worker][:count],
                    near[worker][:count] if copied else None,
                )
            )
        deepest = max(part.stop - part.start for part in self._column_parts)
        self._at_once = max(_AT_ONCE, _PART // (length * complex_type.itemsize)) if fine else deepest
        self._blocks = [
            tuple(pyfftw.zeros_aligned((count, length), dtype=complex_type) for count in (deepest, self._at_once))
            for _ in range(workers)
        ]
        self._block_plans = [
            [
                (_plan(some, after[: len(some)], "FFTW_FORWARD"), _plan(after[: len(some)], some, "FFTW_BACKWARD"))
                for some in (before[first : first + self._at_once] for first in range(0, deepest, self._at_once))
            ]
            for before, after in self._blocks
        ]

    def convolve(self, pressure: NDArray[Any]) -> NDArray[Any]:
        """Return u on the whole of the rectangle, a new array."""
        columns = self.shape[1]

        def forward(worker: int, k: int) -> None:
            part = self._row_parts[k]
            buffer = self._rows[worker][: part.stop - part.start]
            buffer[:, :columns] = pressure[part]
            self._row_plans[k][0]()
            buffer[:, :columns] = 0.0

        return self._field(forward, np.zeros((self.shape[0], 1), dtype=self._dtype))

    def places(self, row: NDArray[Any], column: NDArray[Any]) -> tuple[list[int], NDArray[Any]]:
        """Return where the elements of each part of the rows begin, and their places in the buffer of that part."""
        starts = np.array([part.start for part in self._row_parts] + [self.shape[0]])
        edges = np.searchsorted(row, starts)
        width = self._rows[0].shape[1]
        places = row * width + column - np.repeat(starts[:-1] * width, np.diff(edges))
        return edges.tolist(), places

    def convolve_at(self, edges: list[int], places: NDArray[Any], pressure: NDArray[Any]) -> NDArray[Any]:
        """Return u on the elements that carry the pressure, in the precision of the engine."""
        result = np.empty(pressure.shape, dtype=self._dtype)

        def backward(worker: int, k: int) -> None:
            some = slice(edges[k], edges[k + 1])
            if some.start == some.stop:
                return
            self._row_plans[k][1]()
            result[some] = self._results[worker].reshape(-1)[places[some]]

        self._transform(self._scattered(edges, places, pressure), backward)
        return result

    def convolve_above(
        self, heights: NDArray[Any], edges: list[int], places: NDArray[Any], pressure: NDArray[Any]
    ) -> NDArray[Any]:
        """Return u - heights on the whole of the rectangle, a new array, for pressure at some places."""
        return self._field(self._scattered(edges, places, pressure), heights)

    def _field(self, forward: Callable[[int, int], None], heights: NDArray[Any]) -> NDArray[Any]:
        """Return u - heights, subtracted while u is in cache."""
        result = np.empty(self.shape, dtype=self._dtype)

        def backward(worker: int, k: int) -> None:
            part = self._row_parts[k]
            self._row_plans[k][1]()
            displacement = self._results[worker][: part.stop - part.start, : self.shape[1]]
            np.subtract(displacement, heights[part], out=result[part])

        self._transform(forward, backward)
        return result

    def _scattered(self, edges: list[int], places: NDArray[Any], pressure: NDArray[Any]) -> Callable[[int, int], None]:
        """Return the forward transform of the rows of a part, for pressure at some places."""

        def forward(worker: int, k: int) -> None:
            some = slice(edges[k], edges[k + 1])
            if some.start == some.stop:
                self._waves[self._row_parts[k]] = 0.0
                return
            buffer = self._rows[worker].reshape(-1)
            buffer[places[some]] = pressure[some]
            self._row_plans[k][0]()
            buffer[places[some]] = 0.0

        return forward

    def _transform(self, forward: Callable[[int, int], None], backward: Callable[[int, int], None]) -> None:
        self._share(forward, len(self._row_parts))
        self._share(self._columns, len(self._column_parts))
        self._share(backward, len(self._row_parts))

    def _columns(self, worker: int, k: int) -> None:
        """Filter a block of columns: forward, times spectrum, backward."""
        part = self._column_parts[k]
        count, rows = part.stop - part.start, self.shape[0]
        before, after = self._blocks[worker]
        for some in self._bands:
            before[:count, some] = self._waves[some, part].T
        before[:count, rows:] = 0.0
        firsts = range(part.start, part.stop, self._at_once)
        for first, (forward, backward) in zip(firsts, self._block_plans[worker], strict=False):
            spectrum = self._spectrum[first : min(first + self._at_once, part.stop)]
            forward()
            after[: len(spectrum)].view(self._dtype)[:] *= spectrum
            backward()
        self._waves[:, part] = before[:count, :rows].T

    def _share(self, task: Callable[[int, int], None], count: int) -> None:
        """Do all tasks: worker k takes every workers-th, beginning with number k."""
        if self._pool is None:
            for k in range(count):
                task(0, k)
            return
        workers = len(self._blocks)

        def work(worker: int) -> None:
            for k in range(worker, count, workers):
                task(worker, k)

        list(self._pool.map(work, range(workers)))


def _plan(source: Any, target: Any, direction: str) -> Callable[[], None]:
    flags = (PLANNER,) if direction == "FFTW_FORWARD" else (PLANNER, "FFTW_DESTROY_INPUT")
    execute: Callable[[], None] = pyfftw.FFTW(source, target, axes=(1,), direction=direction, flags=flags).execute
    return execute


def _row_plans(rows: Any, waves: Any, results: Any, near: Any) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return the transforms from rows to their waves and from these to results, by a copy of them if one is given."""
    if near is None:
        return _plan(rows, waves, "FFTW_FORWARD"), _plan(waves, results, "FFTW_BACKWARD")
    there, back = _plan(rows, near, "FFTW_FORWARD"), _plan(near, results, "FFTW_BACKWARD")

    def forward() -> None:
        there()
        waves[:] = near

    def backward() -> None:
        near[:] = waves
        back()

    return forward, backward


_PART = 2**18  # bytes of the transforms made at a time, to stay in cache
# Each number of a column to be copied is on another line of the cache and, on the finest grids, on another page of
# memory: so many columns at a time make use of whole lines, so many rows at a time of pages that are still known
_TOGETHER = (8, 64)  # on other grids, on fine ones
_BAND = 1024
_FINE = 2**25  # bytes of the waves, from which on little of them is still in cache when it is needed again
_AT_ONCE = 4  # columns, at least
# Rows are transformed in cache and their waves copied, which is one pass over memory where a transform may make
# several; above this size (bytes) a row and its waves leave no room for it
_COPIED_ROW = 2**15


def _parts(count: int, size: int, together: int = 1) -> list[slice]:
    """Cut so many transforms of a size in bytes into parts of about `_PART`, all but the last a multiple."""
    return _cut(count, max(together, count // max(1, count * size // _PART) // together * together))


def _cut(count: int, each: int) -> list[slice]:
    """Cut 0 … count into so many each; the last part takes what is left, from half of it to half more."""
    starts = list(range(0, count - each // 2, each)) or [0]
    return [slice(start, stop) for start, stop in pairwise([*starts, count])]
