"""The convolution of a patch repeated in its mirror images, by cosine transforms of the patch alone.

Pressures and displacements have the symmetry of the patch. The waves of the plane are then the cosines of the patch,
cos(π k (2i + 1)/2n) along each axis with k = 0 … n - 1, and the kernel multiplies each by a real number.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.contact.convolution import PLANNER, Convolution, Places, parts
from roughvol.contact.fftw import pyfftw
from roughvol.contact.options import Tuning
from roughvol.typing import Array, Index

_LEAST_PART = 24  # products with matrices of 20 to 40 take about the time of the FFT that they spare
_MOST_PRODUCTS = 680  # of an element and a matrix; an FFT of a large prime takes their time
_LARGEST_FAST = 13  # prime for which FFTW has code of its own


class Cosines:
    """Cosine transforms of n elements that are mirrored at their outer edges, X_k = Σ_j cos(π k (2j + 1)/2n) x_j.

    The elements and their images have the period 2n. Every second element of a period is an element or the image of
    one. With V, the Fourier transform of these n values, V_k e^(-iπk/2n) = X_k - i X_(n-k) (J. Makhoul, IEEE Trans.
    Acoust. Speech Signal Process. 28 (1980) 27-34). For odd n the values are shifted by (a n - 1)/4, a = n mod 4. This
    multiplies V_k by i^(ak) e^(-iπk/2n): its real and imaginary parts are X_k and X_(n-k) in some order, up to signs.

    V is a product with real matrices and a complex FFT: n = p q, value number b + q a, wave number c + p d, c ≤ p/2.
    Large prime factors are in p, as FFTW has no fast code for them: 1025 = 41 · 25. Where products are too many, the
    largest prime factor is in q.

    `element` (q, p) is the element in each place of a buffer. `wave` (q, p // 2 + 1, 2) has the k of the real and the
    imaginary part of each wave; n where the part is always zero.
    """

    def __init__(self, nodes: int, dtype: np.dtype[Any]) -> None:
        self._dtype, odd = dtype, nodes % 2
        self.p = p = _matrix_size(nodes)
        self.q = q = nodes // p
        self.half = p // 2 + 1
        self.size = q * self.half
        number = np.arange(nodes).reshape(p, q).T
        twice = 2 * ((number + odd * ((nodes * (nodes % 4) - 1) // 4)) % nodes)
        self.element = np.where(twice < nodes, twice, 2 * nodes - 1 - twice)
        c, d = np.arange(self.half), np.arange(q)[:, None]
        wave = c + p * d
        self.wave = np.stack((wave, nodes - wave), axis=-1)
        if odd:
            swapped = wave % 2 == 1
            self.wave[swapped] = self.wave[swapped][:, ::-1]
        turns = (number[:, :, None] * c % nodes + (0.0 if odd else 0.25 * c)) / nodes
        factors = np.exp(-2j * np.pi * turns)
        self._into = factors.view(float).astype(dtype)
        factors *= np.where(2 * c % p == 0, 1.0, 2.0) / nodes  # waves c = 0 and p/2 come with their conjugates
        self._back = np.ascontiguousarray(factors.view(float).transpose(0, 2, 1).astype(dtype))
        phase = np.exp(-0.5j * np.pi * d[:, :, None] / q).astype(np.result_type(dtype, np.complex64))
        self._phases = None if odd else (phase, phase.conj())

    def plans(
        self, source: Any, between: Any, waves: Any, target: Any
    ) -> tuple[Callable[[], None], Callable[[], None]]:
        """Return the transforms of a source (q, count, p) and of its waves (q, count, p // 2 + 1), to be destroyed."""
        reals, flags = between.view(self._dtype), (PLANNER, "FFTW_DESTROY_INPUT")
        fourier = pyfftw.FFTW(between, waves, axes=(0,), direction="FFTW_FORWARD", flags=flags)
        inverse = pyfftw.FFTW(waves, between, axes=(0,), direction="FFTW_BACKWARD", flags=flags)

        def forward() -> None:
            np.matmul(source, self._into, out=reals)
            fourier.execute()
            if self._phases:
                np.multiply(waves, self._phases[0], out=waves)

        def backward() -> None:
            if self._phases:
                np.multiply(waves, self._phases[1], out=waves)
            inverse.execute()
            np.matmul(reals, self._back, out=target)

        return forward, backward


class FoldedCosines:
    """As `Cosines` for n with p = n, as most primes: products with two matrices of n/2 × n/2 numbers alone.

    The waves of even k are those of the sums x_j + x_(n-1-j), the waves of odd k those of the differences. A buffer has
    the elements j < n/2, the one in the middle, and the partners n - 1 - j; and even k before odd k.
    """

    def __init__(self, nodes: int, dtype: np.dtype[Any]) -> None:
        self._dtype, self.p, self.q = dtype, nodes, 1
        self.half = self.size = nodes // 2 + 1
        self._pairs, self._even = nodes // 2, nodes - nodes // 2
        j = np.arange(self._even)
        self.element = np.append(j, nodes - 1 - j[: self._pairs])[None]
        k = np.append(np.arange(0, nodes, 2), np.arange(1, nodes, 2))
        self.wave = np.append(k, np.full(2 * self.half - nodes, nodes)).reshape(1, -1, 2)
        into = np.cos(np.pi / (2 * nodes) * ((2 * j[:, None] + 1) * k % (4 * nodes)))
        back = np.ascontiguousarray((into * np.where(k == 0, 1.0, 2.0) / nodes).T)
        even, odd = slice(self._even), slice(self._even, None)
        self._into = into[:, even].astype(dtype), into[: self._pairs, odd].astype(dtype)
        self._back = back[even].astype(dtype), back[odd, : self._pairs].astype(dtype)

    def plans(
        self, source: Any, between: Any, waves: Any, target: Any
    ) -> tuple[Callable[[], None], Callable[[], None]]:
        """Return the transforms of `Cosines.plans`."""
        nodes, pairs, even = self.p, slice(self._pairs), slice(self._even)
        partners, middle = slice(self._even, nodes), slice(self._pairs, self._even)  # partners come as odd k do
        mixed, reals = between.view(self._dtype), waves.view(self._dtype)

        def products(one: Any, matrices: tuple[Any, Any], other: Any) -> None:
            np.matmul(one[..., even], matrices[0], out=other[..., even])
            np.matmul(one[..., partners], matrices[1], out=other[..., partners])

        def forward() -> None:
            np.add(source[..., pairs], source[..., partners], out=mixed[..., pairs])
            mixed[..., middle] = source[..., middle]
            np.subtract(source[..., pairs], source[..., partners], out=mixed[..., partners])
            products(mixed, self._into, reals)
            reals[..., nodes:] = 0.0

        def backward() -> None:
            products(reals, self._back, mixed)
            np.add(mixed[..., pairs], mixed[..., partners], out=target[..., pairs])
            target[..., middle] = mixed[..., middle]
            np.subtract(mixed[..., pairs], mixed[..., partners], out=target[..., partners])

        return forward, backward


def cosines(nodes: int, dtype: np.dtype[Any]) -> Cosines | FoldedCosines:
    """Return the cosine transforms of n elements that take less time."""
    return FoldedCosines(nodes, dtype) if _matrix_size(nodes) == nodes else Cosines(nodes, dtype)


def _matrix_size(nodes: int) -> int:
    """Return p of `Cosines`: the least divisor from 24 on that leaves fast primes in n/p, or n.

    Where these are too many products, p is n over its largest prime factor.
    """
    divisors = (p for p in range(_LEAST_PART, nodes) if nodes % p == 0)
    p = next((p for p in divisors if _largest_prime(nodes // p) <= _LARGEST_FAST), nodes)
    products = p / 2 if p == nodes else p  # of `FoldedCosines`, or of `Cosines`
    return p if products <= _MOST_PRODUCTS else nodes // _largest_prime(nodes)


def _largest_prime(number: int) -> int:
    """Return the largest prime factor, 1 of 1."""
    factor = 2
    while factor * factor <= number:
        if number % factor:
            factor += 1
        else:
            number //= factor
    return number


class MirroredConvolution(Convolution):
    """The convolution of a patch repeated in its mirror images: the passes of `Convolution`, the places of `Cosines`.

    `spectrum` (rows + 1, columns + 1) has the waves of k = 0 … n half periods in the patch along each axis.
    """

    def __init__(self, spectrum: Array, dtype: np.dtype[Any], threads: int, tuning: Tuning) -> None:
        self.shape = rows, columns = spectrum.shape[0] - 1, spectrum.shape[1] - 1
        self.size, self._dtype, complex_type = rows * columns, dtype, np.result_type(dtype, np.complex64)
        down, across = cosines(rows, dtype), cosines(columns, dtype)
        self._row_order = down.element.ravel()
        self._row_place, self._column_place = _inverse(self._row_order), _inverse(across.element.ravel())
        self._p = across.p
        self._row_parts = parts(rows, columns * complex_type.itemsize, tuning.cache)
        pieces = parts(2 * across.half, rows * complex_type.itemsize, tuning.cache)
        blocks = [(plane, piece) for plane in range(across.q) for piece in pieces]
        self._column_count = len(blocks)
        workers = self._started(threads)
        deepest, widest = (max(part.stop - part.start for part in some) for some in (self._row_parts, pieces))
        waves = pyfftw.zeros_aligned((across.q, rows, across.half), dtype=complex_type)

        def buffers(size: int, kind: Any) -> list[NDArray[Any]]:
            return [pyfftw.zeros_aligned(size, dtype=kind) for _ in range(workers)]

        self._rows, self._results = buffers(deepest * columns, dtype), buffers(deepest * columns, dtype)
        between = buffers(max(deepest * across.size, widest * down.size), complex_type)
        self._waves_of = [waves[:, part] for part in self._row_parts]
        self._row_plans, self._displacements = [], []
        for k, field in enumerate(self._waves_of):
            shape = across.q, field.shape[1], across.p
            source, target = (_cut(some[k % workers], shape) for some in (self._rows, self._results))
            self._row_plans.append(across.plans(source, _cut(between[k % workers], field.shape), field, target))
            self._displacements.append(target.transpose(1, 0, 2))
        # Real and imaginary parts of waves are columns of their own.
        columns_of = waves.view(dtype).reshape(across.q, down.q, down.p, -1)
        values, after = buffers(widest * rows, dtype), buffers(widest * down.size, complex_type)
        self._column_passes = []
        for k, (plane, piece) in enumerate(blocks):
            count = piece.stop - piece.start
            shape, wave = (down.q, count, down.half), across.wave[plane].ravel()[piece, None]
            column, filtered = _cut(values[k % workers], (down.q, count, down.p)), _cut(after[k % workers], shape)
            plans = down.plans(column, _cut(between[k % workers], shape), filtered, column)
            factors = spectrum[down.wave.reshape(down.q, 1, -1), wave].astype(dtype)
            place = columns_of[plane, :, :, piece].transpose(0, 2, 1)
            self._column_passes.append((place, column, plans, filtered.view(dtype), factors))

    def places(self, row: NDArray[Any], column: NDArray[Any]) -> Places:
        """Return the places of elements, which come by increasing row."""
        place = self._row_place[row]
        order = np.argsort(place, kind="stable")
        place, column = place[order], column[order]
        starts = np.array([part.start for part in self._row_parts] + [self.shape[0]])
        edges = np.searchsorted(place, starts)
        count, first = (np.repeat(some, np.diff(edges)) for some in (np.diff(starts), starts[:-1]))
        block, within = np.divmod(self._column_place[column], self._p)
        return Places(edges.tolist(), (block * count + place - first) * self._p + within, order)

    def convolve_at(self, places: Places, pressure: NDArray[Any]) -> NDArray[Any]:
        """Return u (n,) on the elements that carry the pressure (n,)."""
        result = np.empty(pressure.shape, dtype=self._dtype)
        result[places.order] = super().convolve_at(places, pressure[places.order])
        return result

    def convolve_above(self, heights: NDArray[Any], places: Places, pressure: NDArray[Any]) -> NDArray[Any]:
        """Return u - heights (rows, columns), for pressure (n,) on some elements."""
        result = np.empty(self.shape, dtype=self._dtype)

        def backward(_: int, k: int) -> None:
            self._row_plans[k][1]()
            rows = self._row_order[self._row_parts[k]]
            displacement = self._displacements[k].reshape(rows.size, -1)
            result[rows] = displacement.take(self._column_place, axis=1) - heights[rows]

        self._convolve(places, pressure[places.order], backward)
        return result

    def _columns(self, worker: int, k: int) -> None:
        """Filter a block of columns: forward, times spectrum, backward."""
        place, column, (forward, backward), waves, spectrum = self._column_passes[k]
        column[:] = place
        forward()
        waves *= spectrum
        backward()
        place[:] = column


def _cut(buffer: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Return the start of a flat buffer in a shape."""
    return buffer[: math.prod(shape)].reshape(shape)


def _inverse(order: Index) -> Index:
    """Return the inverse of a permutation."""
    inverse = np.empty_like(order)
    inverse[order] = np.arange(order.size)
    return inverse
