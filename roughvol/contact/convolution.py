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

# ESTIMATE chooses a plan without timing: the same plan, hence the same rounding, in every run and process.
PLANNER = "FFTW_ESTIMATE"
FFTW_VERSION: str = pyfftw.fftw_version


class Convolution:
    """Plans and buffers of one circulant convolution, in one precision.

    Only occupied rows are transformed forward, and only rows of the result backward. Rows and columns pass through
    buffers that stay in cache. Columns are copied into rows there, for contiguous transforms. Transforms are out of
    place: plans in place take longer.

    Parts of the grid do not depend on the number of threads, so results do not either.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of pressure and displacement.
    spectrum : array (rows / 2 + 1, columns / 2 + 1)
        One quadrant of the real spectrum, over the transform lengths, with the factor of the inverse transform.
    dtype : dtype
        Type of real numbers.
    threads : int
        Threads inside one convolution.
    tuning : Tuning
        Constants.
    lengths : (int, int), optional
        Lengths of the transforms along rows and columns. Default: twice the intervals of the quadrant, both even.

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
        lengths: tuple[int, int] | None = None,
    ) -> None:
        self.shape, rows = shape, shape[0]
        length, width = lengths or tuple(2 * max(n - 1, 1) for n in spectrum.shape)
        waves = width // 2 + 1
        self.size = length * width
        self._dtype, complex_type = dtype, np.result_type(dtype, np.complex64)
        # The kernel is even and real: one coefficient serves the column frequencies k and length - k, and both parts
        # of a complex number. Repeated in full, the multiplication is a contiguous one of real numbers.
        full = np.empty((waves, length, 2), dtype=dtype)
        full[:, : length // 2 + 1] = spectrum.T[:, :, None]
        full[:, length // 2 + 1 :] = full[:, (length - 1) // 2 : 0 : -1]
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
            self._row_plans.append(_plans(source, self._waves[part], target))
        deepest = max(part.stop - part.start for part in self._column_parts)
        self._at_once = max(tuning.columns_together // 4, tuning.cache // column)
        self._blocks = [
            tuple(pyfftw.zeros_aligned((count, length), dtype=complex_type) for count in (deepest, self._at_once))
            for _ in range(workers)
        ]
        self._block_plans = [
            [
                _plans(some, after[: len(some)], some)
                for some in (before[first : first + self._at_once] for first in range(0, deepest, self._at_once))
            ]
            for before, after in self._blocks
        ]

    def convolve(self, pressure: NDArray[Any]) -> NDArray[Any]:
        """Return u (rows, columns) under pressure (rows, columns), in units of the spectrum."""
        columns = self.shape[1]

        def forward(worker: int, k: int) -> None:
            part = self._row_parts[k]
            buffer = self._rows[worker][: part.stop - part.start]
            buffer[:, :columns] = pressure[part]
            self._row_plans[k][0]()
            buffer[:, :columns] = 0.0

        return self._field(forward, np.zeros((self.shape[0], 1), dtype=self._dtype))

    def positions(self, row: NDArray[Any], column: NDArray[Any]) -> tuple[list[int], NDArray[Any]]:
        """Return the edges of the elements in each part of the rows, and their positions in its buffer.

        Elements come by increasing row. The edges are the number of the first element of each part, and n.
        """
        starts = np.array([part.start for part in self._row_parts] + [self.shape[0]])
        edges = np.searchsorted(row, starts)
        width = self._rows[0].shape[1]
        positions = row * width + column - np.repeat(starts[:-1] * width, np.diff(edges))
        return edges.tolist(), positions

    def convolve_at(self, edges: list[int], positions: NDArray[Any], pressure: NDArray[Any]) -> NDArray[Any]:
        """Return u (n,) on the elements that carry the pressure (n,), for edges and positions of `positions`."""
        result = np.empty(pressure.shape, dtype=self._dtype)

        def backward(worker: int, k: int) -> None:
            some = slice(edges[k], edges[k + 1])
            if some.start == some.stop:
                return
            self._row_plans[k][1]()
            result[some] = self._results[worker].reshape(-1)[positions[some]]

        self._transform(self._scattered(edges, positions, pressure), backward)
        return result

    def convolve_above(
        self, heights: NDArray[Any], edges: list[int], positions: NDArray[Any], pressure: NDArray[Any]
    ) -> NDArray[Any]:
        """Return u - heights (rows, columns), for pressure (n,) at edges and positions of `positions`."""
        return self._field(self._scattered(edges, positions, pressure), heights)

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

    def _scattered(
        self, edges: list[int], positions: NDArray[Any], pressure: NDArray[Any]
    ) -> Callable[[int, int], None]:
        """Return the forward transform of the rows of a part, for pressure at some positions."""

        def forward(worker: int, k: int) -> None:
            some = slice(edges[k], edges[k + 1])
            if some.start == some.stop:
                self._waves[self._row_parts[k]] = 0.0
                return
            buffer = self._rows[worker].reshape(-1)
            buffer[positions[some]] = pressure[some]
            self._row_plans[k][0]()
            buffer[positions[some]] = 0.0

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
        """Do all tasks; worker k does the numbers k, k + workers, k + 2 workers, …."""
        workers = len(self._blocks)

        def work(worker: int) -> None:
            for k in range(worker, count, workers):
                task(worker, k)

        list((self._pool.map if self._pool else map)(work, range(workers)))


def _plans(source: Any, waves: Any, target: Any) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return the forward transform of a source, and the backward one of its waves, which it destroys."""
    forward = pyfftw.FFTW(source, waves, axes=(1,), direction="FFTW_FORWARD", flags=(PLANNER,))
    flags = (PLANNER, "FFTW_DESTROY_INPUT")
    return forward.execute, pyfftw.FFTW(waves, target, axes=(1,), direction="FFTW_BACKWARD", flags=flags).execute


def parts(count: int, size: int, cache: int, together: int = 1) -> list[slice]:
    """Divide transforms into parts of about the cache each.

    The number of transforms in a part is a multiple of `together`, except in the last part.
    """
    return _pieces(count, max(together, count // max(1, count * size // cache) // together * together))


def _pieces(count: int, length: int) -> list[slice]:
    """Return 0 … count in pieces of one length; the last one has from half of it to half more."""
    starts = list(range(0, count - length // 2, length)) or [0]
    return [slice(start, stop) for start, stop in pairwise([*starts, count])]
