"""The near field of K⁻¹: a sparse factor made of the nearest neighbours of each element.

Entries of K⁻¹ fall off as 1/r³. A factor G with few neighbours per row therefore has GᵀG ≈ K⁻¹, except for smooth
pressures; `blocks` handles these.

Few neighbours make few neighbourhoods: 2ⁿ for n neighbours. The small systems of all of them are solved once per
kernel, and a factor is made by looking rows up.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from roughvol.typing import Array, Index, Map, Mask

_SQUARE = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3)])  # offsets within two spacings along each axis
_CENTRE = len(_SQUARE) // 2


def near_field(influence: Array, columns: int, elements: Index, reach: float) -> Map:
    """Return r ↦ Gᵀ G r ≈ K⁻¹ r on the elements, G sparse and triangular.

    Row i of G solves K_PP y = e_i on P = element i and those of its preceding neighbours that belong to the set;
    G_i = y/√y_i. This is the factorised sparse approximate inverse, symmetric and positive definite whenever K is.

    Parameters
    ----------
    influence : array (rows, columns)
        K(i, j) of the non-negative offsets.
    columns : int
        Columns of the grid.
    elements : array (n,)
        Flat indices, increasing.
    reach : float
        Distance of the farthest neighbours in spacings, at most √8. √5 takes 10 preceding neighbours.

    References
    ----------
    L. Yu. Kolotilina, A. Yu. Yeremin, SIAM J. Matrix Anal. Appl. 14 (1993) 45-58.
    """
    offsets, table = _rows(tuple(map(tuple, influence[:5, :5].tolist())), reach)
    size = elements.size
    row, column = np.divmod(elements.astype(np.int32), np.int32(columns))
    row -= row[0]
    column -= column.min()
    width = int(column.max()) + 5
    place = (row + 2).astype(np.intp) * width + column + 2
    # Absent neighbours are ~i of some i below the size: their zeros then lie at many places, see below.
    places, below = (int(row[-1]) + 3) * width, 1 << (size.bit_length() - 1)
    repeated = np.empty((-(-places // below), below), dtype=np.int32)
    repeated[:] = ~np.arange(below, dtype=np.int32)
    number = repeated.ravel()
    number[place] = np.arange(size, dtype=np.int32)
    shifts = offsets @ (width, 1)
    neighbours = number.take(np.add.outer(shifts, place))
    present = neighbours >= 0
    bits = (1 << np.arange(shifts.size)) * (shifts != 0)
    with np.errstate(invalid="ignore"):  # some BLAS raise the flag on memory beyond the end of an array
        # a product of floating-point numbers: exact, and the fastest way
        code = (bits.astype(np.float32) @ present.astype(np.float32)).astype(np.intp)
    # Rows of one length, zeros included, are faster than rows of several lengths. Zeros at one single place are not:
    # each addition would wait for the one before. From ~i to i, the rest unchanged:
    neighbours ^= neighbours >> 31
    start = np.arange(0, neighbours.size + 1, shifts.size, dtype=np.int32)
    factor = sparse.csr_array((table.take(code, axis=0).ravel(), neighbours.T.ravel(), start), shape=(size, size))
    transposed = factor.T
    return lambda r: transposed @ (factor @ r.astype(np.float32, copy=False))


@lru_cache(maxsize=8)
def _rows(influence: tuple[tuple[float, ...], ...], reach: float) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return the offsets of preceding neighbours and the element itself, and the row of G for each set of them.

    Sets are numbered by bits, one per neighbour. A row is zero where there is no neighbour.
    """
    near = np.hypot(*_SQUARE.T) <= reach + 0.01
    offsets = _SQUARE[: _CENTRE + 1][near[: _CENTRE + 1]]
    before = len(offsets) - 1
    present = np.ones((1 << before, before + 1), dtype=bool)
    present[:, :-1] = (np.arange(1 << before)[:, None] >> np.arange(before)) & 1
    rows = _columns_of_inverse(_between(np.array(influence), offsets), present, before)
    return offsets, (rows / np.sqrt(rows[:, -1:])).astype(np.float32)


def border(
    influence: Array, columns: int, elements: Index, left_out: Mask, some: Index
) -> tuple[Index, NDArray[np.float32]]:
    """Return the elements around some that were left out of the inverse, and the rows g of their border.

    With one more element x, the inverse of K is the one without it plus g gᵀ, g = y/√y_x, K y = e_x. Here y is solved
    for on x and the elements around it that are not left out, within two spacings along each axis.

    Parameters
    ----------
    influence, columns, elements
        As in `near_field`.
    left_out : array (n,) of bool
        Elements left out of the inverse.
    some : array (k,)
        Numbers of those that take part nevertheless.

    Returns
    -------
    members : array (k, 25)
        Numbers of the elements around each, itself included.
    rows : array (k, 25)
        g, zero where there is no element.
    """
    wanted = elements[some, None] + _SQUARE @ (columns, 1)
    members = np.minimum(np.searchsorted(elements, wanted), elements.size - 1)
    column = elements[some, None] % columns + _SQUARE[:, 1]
    present = (elements[members] == wanted) & (column >= 0) & (column < columns) & ~left_out[members]
    present[:, _CENTRE] = True
    rows = _columns_of_inverse(_between(influence[:5, :5], _SQUARE), present, _CENTRE)
    return members, (rows / np.sqrt(rows[:, _CENTRE, None])).astype(np.float32)


def _between(influence: Array, offsets: NDArray[np.intp]) -> Array:
    """Return K between elements at some offsets from each other; zero where the grid does not reach so far."""
    kernel = np.zeros((5, 5))
    kernel[: influence.shape[0], : influence.shape[1]] = influence
    away = np.abs(offsets[:, None] - offsets)
    return kernel[away[..., 0], away[..., 1]]


def _columns_of_inverse(matrix: Array, present: Mask, column: int) -> Array:
    """Return one column of the inverse of each principal submatrix, zero elsewhere; shape of `present`."""
    # absent members become rows of the identity, so that all systems have one size
    systems = np.where(present[:, :, None] & present[:, None, :], matrix, np.eye(len(matrix)))
    unit = np.zeros((len(matrix), 1))
    unit[column] = 1.0
    return np.asarray(np.linalg.solve(systems, unit)[:, :, 0], dtype=np.float64)
