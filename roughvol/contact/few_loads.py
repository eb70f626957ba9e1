"""Displacement by few loaded elements: a sum of coefficients, where this takes less time than a convolution."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.typing import Array, Index

_PIECE = 2**13  # elements summed at a time, to stay in cache


class Superposition:
    """The influence of few loaded elements on many, in lattice units; not thread-safe.

    Parameters
    ----------
    influence : array (rows, columns)
        K(i, j) of the non-negative offsets of the whole grid.
    terms : float
        Terms of a sum per node of the grid, up to which it replaces a convolution.
    """

    def __init__(self, influence: Array, terms: float) -> None:
        self._influence, self._columns, self._terms = influence, influence.shape[1], terms * influence.size
        self._mirrored: NDArray[Any] = np.empty(0, dtype=bool)
        self._numbered: tuple[Index, NDArray[np.intp]] | None = None

    def displacement(self, elements: Index, loaded: Index, pressure: Array, *, single: bool) -> NDArray[Any] | None:
        """Return u on the elements under pressures on a few of them, or None where a convolution takes less time.

        Parameters
        ----------
        elements : array (n,)
            Flat indices, increasing.
        loaded : array (k,)
            Numbers of the loaded ones among them, increasing.
        pressure : array (k,)
            Their pressures; u has the same unit.
        single : bool
            Whether 32 bits are enough.
        """
        if loaded.size * elements.size > self._terms:
            return None
        table, number = self._table(single), self._numbers(elements)
        displacement: NDArray[Any] = np.zeros(elements.size, dtype=table.dtype)
        offset, term = np.empty(_PIECE, dtype=np.intp), np.empty(_PIECE, dtype=table.dtype)
        sources = list(zip(number[loaded].tolist(), pressure.astype(table.dtype), strict=True))
        for first in range(0, elements.size, _PIECE):
            here, total = number[first : first + _PIECE], displacement[first : first + _PIECE]
            offset, term = offset[: here.size], term[: here.size]
            for place, q in sources:
                np.abs(np.subtract(here, place, out=offset), out=offset)
                table.take(offset, out=term, mode="clip")  # no offset lies outside; without a mode, take would copy
                total += np.multiply(term, q, out=term)
        return displacement

    def _numbers(self, elements: Index) -> NDArray[np.intp]:
        """Return numbers whose differences are places in the table; they are kept until other elements come.

        In a table whose rows hold both signs of the column, an offset is the distance of two numbers.
        """
        if self._numbered is None or self._numbered[0] is not elements:
            columns = np.int32(self._columns)
            row, column = np.divmod(elements.astype(np.int32), columns)
            self._numbered = elements, (row * (2 * columns - 1) + column).astype(np.intp)
        return self._numbered[1]

    def _table(self, single: bool) -> NDArray[Any]:
        """Return K at every offset, flat, from the origin on: rows ≥ 0 by columns of both signs.

        An offset (i, j) with i > 0, or i = 0 ≤ j, is at i (2 columns - 1) + j. The others are these, turned round.
        """
        precision = np.dtype(np.float32 if single else np.float64)
        if precision != self._mirrored.dtype:
            half = self._influence.astype(precision)
            self._mirrored = np.hstack((half[:, :0:-1], half)).ravel()[self._columns - 1 :]
        return self._mirrored
