"""Displacement as a convolution by FFTW, or as a sum where few elements are loaded."""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from roughvol.contact.fftw import pyfftw
from roughvol.contact.kernels import short_way
from roughvol.contact.options import TUNING, Tuning
from roughvol.typing import Array, Index, Shape


class Places(NamedTuple):
    """Elements under pressure: first element of each part of the rows, position in the buffer of the part, order."""

    edges: list[int]
    positions: NDArray[Any]
    order: Index | None = None


Task = Callable[[int, int], None]
"""A function of the number of the worker and of the part."""

# ESTIMATE chooses a plan without timing: the same plan, hence the same rounding, in every run and process.
PLANNER = "FFTW_ESTIMATE"
FFTW_VERSION: str = pyfftw.fftw_version


class Convolution:
    """Plans and buffers of one circulant convolution, in one precision: rows forward, columns filtered, rows back.

    `spectrum` is one quadrant of the real spectrum (rows / 2 + 1, columns / 2 + 1) over the transform lengths, with the
    factor of the inverse transform. `size` is the number of points transformed.

    Only occupied rows are transformed forward, and only rows of the result backward. Rows and columns pass through
    buffers that stay in cache. Columns are copied into rows there, for contiguous transforms. Transforms are out of
    place: plans in place take longer. Parts of the grid, and so the results, do not depend on the number of threads.
    """

    def __init__(
        self, shape: Shape, spectrum: Array, lengths: Shape, dtype: np.dtype[Any], threads: int, tuning: Tuning
    ) -> None:
        self.shape, rows = shape, shape[0]
        length, width = lengths
        waves, self.size = width // 2 + 1, length * width
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
        self._column_count = len(self._column_parts)
        self._bands = _pieces(rows, tuning.band)
        workers = self._started(threads)
        deepest = max(part.stop - part.start for part in self._row_parts)
        self._rows = [pyfftw.zeros_aligned((deepest, width), dtype=dtype) for _ in range(workers)]
        self._results = [pyfftw.zeros_aligned((deepest, width), dtype=dtype) for _ in range(workers)]
        self._row_plans = []
        for k, part in enumerate(self._row_parts):
            source, target = (buffers[k % workers][: part.stop - part.start] for buffers in (self._rows, self._results))
            self._row_plans.append(_plans(source, self._waves[part], target))
        self._waves_of = [self._waves[part] for part in self._row_parts]
        deepest = max(part.stop - part.start for part in self._column_parts)
        self._at_once = max(tuning.columns_together // 4, tuning.cache // column)
        sizes = (deepest, length), (self._at_once, length)
        self._blocks = [[pyfftw.zeros_aligned(size, dtype=complex_type) for size in sizes] for _ in range(workers)]
        self._block_plans = []
        for before, after in self._blocks:
            together = [before[first : first + self._at_once] for first in range(0, deepest, self._at_once)]
            self._block_plans.append([_plans(some, after[: len(some)], some) for some in together])

    def _started(self, threads: int) -> int:
        """Start threads, at most as many as there are blocks of columns, and return their number."""
        workers = min(threads, self._column_count)
        self._pool = ThreadPoolExecutor(workers) if workers > 1 else None
        return workers

    def places(self, row: NDArray[Any], column: NDArray[Any]) -> Places:
        """Return the places of elements, which come by increasing row."""
        starts = np.array([part.start for part in self._row_parts] + [self.shape[0]])
        edges = np.searchsorted(row, starts)
        width = self._rows[0].shape[1]
        positions = row * width + column - np.repeat(starts[:-1] * width, np.diff(edges))
        return Places(edges.tolist(), positions)

    def convolve_at(self, places: Places, pressure: NDArray[Any]) -> NDArray[Any]:
        """Return u (n,) on the elements that carry the pressure (n,)."""
        edges, positions, _ = places
        result = np.empty(pressure.shape, dtype=self._dtype)

        def backward(worker: int, k: int) -> None:
            some = slice(edges[k], edges[k + 1])
            if some.start == some.stop:
                return
            self._row_plans[k][1]()
            result[some] = self._results[worker].reshape(-1)[positions[some]]

        self._convolve(places, pressure, backward)
        return result

    def convolve_above(self, heights: NDArray[Any], places: Places, pressure: NDArray[Any]) -> NDArray[Any]:
        """Return u - heights (rows, columns), subtracted while u is in cache, for pressure (n,) on some elements."""
        result = np.empty(self.shape, dtype=self._dtype)

        def backward(worker: int, k: int) -> None:
            part = self._row_parts[k]
            self._row_plans[k][1]()
            displacement = self._results[worker][: part.stop - part.start, : self.shape[1]]
            np.subtract(displacement, heights[part], out=result[part])

        self._convolve(places, pressure, backward)
        return result

    def _convolve(self, places: Places, pressure: NDArray[Any], backward: Task) -> None:
        """Transform the rows under pressure, filter the columns, and let each part of the rows be transformed back."""
        edges, positions, _ = places

        def forward(worker: int, k: int) -> None:
            some = slice(edges[k], edges[k + 1])
            if some.start == some.stop:
                self._waves_of[k][:] = 0.0
                return
            buffer = self._rows[worker].reshape(-1)
            buffer[positions[some]] = pressure[some]
            self._row_plans[k][0]()
            buffer[positions[some]] = 0.0

        self._share(forward, len(self._row_parts))
        self._share(self._columns, self._column_count)
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

    def _share(self, task: Task, count: int) -> None:
        """Do all tasks; worker k does the numbers k, k + workers, k + 2 workers, …."""
        workers = len(self._rows)

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
    """Divide transforms into parts of about the cache each, all but the last multiples of `together`."""
    return _pieces(count, max(together, count // max(1, count * size // cache) // together * together))


def _pieces(count: int, length: int) -> list[slice]:
    """Return 0 … count in pieces of one length; the last one has from half of it to half more."""
    starts = list(range(0, count - length // 2, length)) or [0]
    return [slice(start, stop) for start, stop in pairwise([*starts, count])]


class Superposition:
    """Displacement of many elements by few loaded ones, in lattice units; not thread-safe."""

    def __init__(self, influence: Array, tuning: Tuning = TUNING, *, mirrored: bool = False) -> None:
        self._nodes = influence.shape[0] - mirrored, influence.shape[1] - mirrored
        self._images, self._terms = mirrored, tuning.sum_terms * math.prod(self._nodes) / (4 if mirrored else 1)
        if mirrored:  # as far as to the nearest image
            influence = influence[np.ix_(*(short_way(np.arange(3 * n // 2 + 1), n) for n in self._nodes))]
        self._influence, self._columns, self._piece = influence, influence.shape[1], tuning.cache // 32
        self._mirrored: NDArray[Any] = np.empty(0, dtype=bool)
        self._numbered: tuple[Index, NDArray[np.intp]] | None = None

    def displacement(self, elements: Index, loaded: Index, pressure: Array, *, single: bool) -> NDArray[Any] | None:
        """Return u on the elements, loaded at increasing positions; None where a convolution takes less time."""
        if loaded.size * elements.size > self._terms:
            return None
        table, number = self._table(single), self._numbers(elements)
        displacement: NDArray[Any] = np.zeros(elements.size, dtype=table.dtype)
        offset, term = np.empty(self._piece, dtype=np.intp), np.empty(self._piece, dtype=table.dtype)
        sources = self._sources(elements[loaded], number[loaded], pressure.astype(table.dtype))
        for first in range(0, elements.size, self._piece):
            piece = slice(first, first + self._piece)
            target, total = number[piece], displacement[piece]
            offset, term = offset[: target.size], term[: target.size]
            for source, q in sources:
                np.abs(np.subtract(target, source, out=offset), out=offset)
                table.take(offset, out=term, mode="clip")  # no offset lies outside; without a mode, take would copy
                total += np.multiply(term, q, out=term)
        return displacement

    def _numbers(self, elements: Index) -> NDArray[np.intp]:
        """Return numbers whose differences are indices of the table, kept until other elements come."""
        if self._numbered is None or self._numbered[0] is not elements:
            row, column = np.divmod(elements.astype(np.int32), np.int32(self._nodes[1]))
            self._numbered = elements, self._number(row, column)
        return self._numbered[1]

    def _number(self, row: NDArray[Any], column: NDArray[Any]) -> NDArray[np.intp]:
        return (row * np.int32(2 * self._columns - 1) + column).astype(np.intp)

    def _sources(self, loaded: Index, number: NDArray[np.intp], pressure: NDArray[Any]) -> list[tuple[int, Any]]:
        """Return the numbers of loaded elements and of their nearest mirror images, with the pressure."""
        if not self._images:
            return list(zip(number.tolist(), pressure, strict=True))
        (row, up), (column, left) = (
            (x, np.where(2 * x < n, -1 - x, 2 * n - 1 - x))
            for x, n in zip(np.divmod(loaded, self._nodes[1]), self._nodes, strict=True)
        )
        numbers = [self._number(i, j) for i in (row, up) for j in (column, left)]
        return list(zip(np.concatenate(numbers).tolist(), np.tile(pressure, 4), strict=True))

    def _table(self, single: bool) -> NDArray[Any]:
        """Return K at every offset, flat: (i, j) with i > 0, or i = 0 ≤ j, has the index i (2 columns - 1) + j."""
        precision = np.dtype(np.float32 if single else np.float64)
        if precision != self._mirrored.dtype:
            half = self._influence.astype(precision)
            self._mirrored = np.hstack((half[:, :0:-1], half)).ravel()[self._columns - 1 :]
        return self._mirrored
