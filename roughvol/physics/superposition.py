"""Displacement by few loaded elements, by superposition instead of a convolution over the whole grid.

The fewest are summed directly, coefficient by coefficient. For more, the kernel is split in two at R elements,
K = K_near + K_far,

    K_far(r) = (3 - r²/R²)/(2R)  for r < R,  K(r) beyond,

which has no kink at R. K_near is zero beyond R and is summed. K_far is smooth on the scale of R: pressures are shared
out to the nodes of a grid h times as coarse, convolved there, and interpolated back, linearly along both axes. Of a
function with second derivatives K'' this misses h² K''/8 per axis and end; none is larger than 2/R³, that along the
radius at R. Errors of several pressures add where these are close together.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Index = NDArray[Any]

_DIRECT = 3.0  # terms of a sum per node of the grid, up to which it is cheaper than a convolution
_INTERPOLATION = 30  # terms of a sum that take the time of one element's interpolation
_REACH = 64  # R, elements
_COARSE = 8  # h, elements
# of the split kernel, in the displacement by a unit pressure, and room for a few close together: one makes 1.22e-4 at
# most, as by the estimate above
ERROR = 3e-4


class Superposition:
    """The influence of few loaded elements on many, in lattice units; not thread-safe.

    Parameters
    ----------
    influence : K(i, j) of the non-negative offsets of the whole grid.
    """

    def __init__(self, influence: Array) -> None:
        self._influence, self._shape = influence, influence.shape
        self._mirrored: NDArray[Any] = np.empty(0, dtype=bool)
        self._numbered: tuple[Index, NDArray[np.int32]] | None = None

    def displacement(
        self, elements: Index, loaded: Index, pressure: Array, *, single: bool, error: float
    ) -> NDArray[Any] | None:
        """Return u on the elements under pressures on a few of them, or None where a convolution takes less time.

        Parameters
        ----------
        elements : flat indices, increasing.
        loaded : which of them are, increasing.
        pressure : on these, in any unit, which is then that of u.
        single : whether 32 bits are enough.
        error : allowed in u by one pressure; where the split kernel may exceed it, it is not used.
        """
        directly = loaded.size * elements.size
        by_parts = loaded.size * (2 * _REACH + 1) ** 2 + _INTERPOLATION * elements.size
        accurate = single and ERROR * float(np.abs(pressure).max(initial=0.0)) <= error
        if min(directly, by_parts if accurate else directly) > _DIRECT * self._shape[0] * self._shape[1]:
            return None
        if accurate and by_parts < directly:
            return self._split.displacement(elements, elements[loaded], pressure)
        table, number = self._table(single), self._numbers(elements)
        displacement: NDArray[Any] = np.zeros(elements.size, dtype=table.dtype)
        for place, q in zip(number[loaded], pressure.tolist(), strict=True):
            offset = number - place
            displacement += q * table.take(np.abs(offset, out=offset))
        return displacement

    def _numbers(self, elements: Index) -> NDArray[np.int32]:
        """Return numbers whose differences are places in the table; they are kept until other elements are asked for.

        In a table whose rows hold both signs of the column, an offset is the distance of two numbers.
        """
        if self._numbered is None or self._numbered[0] is not elements:
            columns = np.int32(self._shape[1])
            row, column = np.divmod(elements.astype(np.int32), columns)
            self._numbered = elements, row * (2 * columns - 1) + column
        return self._numbered[1]

    def _table(self, single: bool) -> NDArray[Any]:
        """Return K at every offset, flat, from the origin on: rows ≥ 0 by columns of both signs, in the precision used.

        An offset (i, j) with i > 0, or i = 0 ≤ j, is at i (2 columns - 1) + j; the others are these, turned round.
        """
        precision = np.dtype(np.float32 if single else np.float64)
        if precision != self._mirrored.dtype:
            half = self._influence.astype(precision)
            self._mirrored = np.hstack((half[:, :0:-1], half)).ravel()[self._shape[1] - 1 :]
        return self._mirrored

    @cached_property
    def _split(self) -> _SplitKernel:
        return _SplitKernel(self._influence)


class _SplitKernel:
    def __init__(self, influence: Array) -> None:
        rows, columns = self._shape = influence.shape
        away = np.arange(-_REACH, _REACH + 1)
        row, column = (np.minimum(np.abs(away), n - 1) for n in self._shape)  # what is beyond the grid is not read
        square = (away[:, None] ** 2 + away**2) / _REACH**2
        near = influence[row[:, None], column] - (1.5 - 0.5 * square) / _REACH
        self._near = np.where(square < 1.0, near, 0.0).astype(np.float32)
        self._field = np.zeros((rows + 2 * _REACH, columns + 2 * _REACH), dtype=np.float32)
        self._nodes = -(-rows // _COARSE) + 1, -(-columns // _COARSE) + 1
        self._lengths = tuple(fft.next_fast_len(2 * n, real=True) for n in self._nodes)
        # lags of the circular convolution; where the last nodes lie beyond the grid, K is not given: it is 1/r there
        row, column = (_COARSE * np.minimum(np.arange(n), n - np.arange(n)) for n in self._lengths)
        square = (row[:, None].astype(float) ** 2 + column**2) / _REACH**2
        far = influence[np.minimum(row, rows - 1)[:, None], np.minimum(column, columns - 1)]
        outside = (row[:, None] >= rows) | (column >= columns)
        far = np.where(outside, 1.0 / (_REACH * np.sqrt(np.maximum(square, 1.0))), far)
        far = np.where(square < 1.0, (1.5 - 0.5 * square) / _REACH, far)
        self._spectrum: Single = fft.rfft2(far).real.astype(np.float32)

    def displacement(self, elements: Index, loaded: Index, pressure: Array) -> Single:
        """Return u on the elements; those loaded as flat indices here."""
        columns = np.int32(self._shape[1])
        field, reach = self._field, 2 * _REACH + 1
        pressure = pressure.astype(np.float32)
        row, column = np.divmod(loaded.astype(np.int32), columns)
        windows = [
            (slice(i, i + reach), slice(j, j + reach)) for i, j in zip(row.tolist(), column.tolist(), strict=True)
        ]
        for window, q in zip(windows, pressure, strict=True):
            field[window] += q * self._near
        i, j = np.divmod(elements.astype(np.int32), columns)
        result: Single = field[i + np.int32(_REACH), j + np.int32(_REACH)]
        for window in windows:
            field[window] = 0.0

        coarse = np.zeros(self._nodes, dtype=np.float32)
        for node, share in _corners(row, column, self._nodes[1]):
            np.add.at(coarse.reshape(-1), node, share * pressure)
        waves = fft.rfft2(coarse, self._lengths)
        waves *= self._spectrum
        far = fft.irfft2(waves, self._lengths)[: self._nodes[0], : self._nodes[1]].ravel()
        for node, share in _corners(i, j, self._nodes[1]):
            share *= far.take(node)
            result += share
        return result


def _corners(row: Index, column: Index, width: int) -> list[tuple[Index, Single]]:
    """Return the four coarse nodes (flat) around each place, and the weights of linear interpolation."""
    i, down = np.divmod(row, np.int32(_COARSE))
    j, right = np.divmod(column, np.int32(_COARSE))
    down, right = (x.astype(np.float32) / np.float32(_COARSE) for x in (down, right))
    node = i * np.int32(width) + j
    both = down * right
    return [
        (node, 1.0 - down - right + both),
        (node + 1, right - both),
        (node + width, down - both),
        (node + width + 1, both),
    ]
