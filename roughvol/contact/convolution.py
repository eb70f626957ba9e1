"""One circulant convolution by FFTW, with its plans and buffers: rows forward, columns filtered, rows back."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import pyfftw
from numpy.typing import NDArray

from roughvol.contact.tuning import TUNING, Tuning
from roughvol.typing import Array

# ESTIMATE chooses a plan without timing anything: the same plan, hence the same rounding, on every run and in every
# worker process.
PLANNER = "FFTW_ESTIMATE"
FFTW_VERSION: str = pyfftw.fftw_version


class Convolution:
    """Plans and buffers of one precision.

    Padding is not transformed where it need not be: only occupied rows go forward, and only rows of the result come
    back. Rows and columns go through buffers that stay in cache. Columns are copied into rows there, so that their
    transforms are contiguous. Every transform has its result beside its argument: plans in place take longer.

    Blocks do not depend on the number of threads that share them out, so results do not either.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns that pressure and displacement have.
    spectrum : array
        One quadrant of the real spectrum, with the factor of the inverse transform.
    dtype : dtype
        Of real numbers.
    threads : int
        Threads inside one convolution.
    tuning : Tuning
        Constants.

    Attributes
    ----------
    size : int
        Points transformed.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        spectrum: Array,
        dtype: np.dtype[Any],
        threads: int = 1,
        tuning: Tuning = TUNING,
    ) -> None:
        self.shape, rows = shape, shape[0]
        length, width = (2 * max(n - 1, 1) for n in spectrum.shape)
        waves = width // 2 + 1
        self.size = length * width
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
        column, row = length * complex_type.itemsize, width * complex_type.itemsize
        self._row_parts = parts(rows, row, tuning.cache)
        self._column_parts = parts(waves, column, tuning.cache, tuning.columns_together)
        self._bands = _pieces(rows, tuning.band)
        workers = min(threads, len(self._column_parts))
        self._pool = ThreadPoolExecutor(workers) if workers > 1 else None
        deepest = max(part.stop - part.start for part in self._row_parts)
        self._rows = [pyfftw.zeros_aligned((deepest, width), dtype=dtype) for _ in range(workers)]
        self._results = [pyfftw.zeros_aligned((deepest, width), dtype=dtype) for _ in range(workers)]
        self._row_plans = []
        for k, part in enumerate(self._row_parts):
            source, target = (buffers[k % workers][: part.stop - part.start] for buffers in (self._rows, self._results))
            waves_of_part = self._waves[part]
            self._row_plans.append(
                (_plan(source, waves_of_part, "FFTW_FORWARD"), _plan(waves_of_part, target, "FFTW_BACKWARD"))
            )
        deepest = max(part.stop - part.start for part in self._column_parts)
        self._at_once = max(tuning.columns_together // 4, tuning.cache // column)
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
        """Return u on the elements that carry the pressure, in the precision of the plans."""
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
        for band in self._bands:
            before[:count, band] = self._waves[band, part].T
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


def parts(count: int, size: int, cache: int, together: int = 1) -> list[slice]:
    """Return parts of so many transforms of a size in bytes: about the cache each, all but the last a multiple."""
    return _pieces(count, max(together, count // max(1, count * size // cache) // together * together))


def _pieces(count: int, each: int) -> list[slice]:
    """Return 0 … count in pieces of so many; the last takes the remainder, from half of it to half more."""
    starts = list(range(0, count - each // 2, each)) or [0]
    return [slice(start, stop) for start, stop in pairwise([*starts, count])]
