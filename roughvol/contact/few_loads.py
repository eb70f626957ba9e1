"""Displacement by few loaded elements: a sum of coefficients, where this takes less time than a convolution."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.contact.tuning import TUNING, Tuning
from roughvol.typing import Array, Index


class Superposition:
    """Displacement of many elements by few loaded ones, in lattice units; not thread-safe."""

    def __init__(self, influence: Array, tuning: Tuning = TUNING) -> None:
        self._influence, self._columns = influence, influence.shape[1]
        self._terms, self._piece = tuning.sum_terms * influence.size, tuning.cache // 32
        self._mirrored: NDArray[Any] = np.empty(0, dtype=bool)
        self._numbered: tuple[Index, NDArray[np.intp]] | None = None

    def displacement(self, elements: Index, loaded: Index, pressure: Array, *, single: bool) -> NDArray[Any] | None:
        """Return u on the elements, or None where a convolution takes less time.

        `loaded` are the positions of the loaded elements among all, increasing. 32 bits are enough if `single`.
        """
        if loaded.size * elements.size > self._terms:
            return None
        table, number = self._table(single), self._numbers(elements)
        displacement: NDArray[Any] = np.zeros(elements.size, dtype=table.dtype)
        offset, term = np.empty(self._piece, dtype=np.intp), np.empty(self._piece, dtype=table.dtype)
        sources = list(zip(number[loaded].tolist(), pressure.astype(table.dtype), strict=True))
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
            columns = np.int32(self._columns)
            row, column = np.divmod(elements.astype(np.int32), columns)
            self._numbered = elements, (row * (2 * columns - 1) + column).astype(np.intp)
        return self._numbered[1]

    def _table(self, single: bool) -> NDArray[Any]:
        """Return K at every offset, flat, from the origin on: rows ≥ 0 by columns of both signs.

        An offset (i, j) with i > 0, or i = 0 ≤ j, has the index i (2 columns - 1) + j. K is even in the others.
        """
        precision = np.dtype(np.float32 if single else np.float64)
        if precision != self._mirrored.dtype:
            half = self._influence.astype(precision)
            self._mirrored = np.hstack((half[:, :0:-1], half)).ravel()[self._columns - 1 :]
        return self._mirrored
