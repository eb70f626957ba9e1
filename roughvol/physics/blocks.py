"""The far field of a contact by blocks of elements and blocks of blocks: a preconditioner for grids of any size.

Let t be the pressure that answers a uniform further indentation, K t = 1 on the contact. Under the share of t that
falls on it, a block of 8 × 8 elements moves almost evenly, for that is what t does everywhere. Pressures are therefore
split into t-shaped forces on blocks, and a rest without force on any block, which reaches no further than their
neighbours:

    M⁻¹ = P C Pᵀ + (1 - P Xᵀ) B,        X = E + N C.

P spreads the force of a block over its elements as t is spread there (Pᵀ: the mean of a block, weighted by t), E gives
all elements of a block the same value, N is by how much the displacement under forces on the same and the surrounding
blocks departs from its mean over the block. B is the near-field inverse on the elements, C ≈ (Pᵀ K P)⁻¹: the same
problem with a 64th of the elements, whose nearest coefficients are summed exactly, whose others are those of points,
and which is solved in the same way, down to a few blocks and a factorisation.

This is not symmetric. With a factor (1 - X Pᵀ) on the right ("balanced") it is, and positive definite whatever t, N and
C are; were C exact, the eigenvalues would be the same, and it costs another product with N and another with C. What it
does is to take the smooth part off r before B, which makes too much of it, the more the finer the grid is: from where
that begins to matter on, and where M⁻¹r is no descent, as with a t from states far off, the balanced one is used.

Numbers are rounded to 32 bits, which is closer than any of the approximations.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Index = NDArray[Any]
Map = Callable[[NDArray[Any]], NDArray[Any]]
Inverse = Callable[[NDArray[Any], bool], NDArray[Any]]  # (r, balanced) ↦ M⁻¹ r
Offsets = tuple[tuple[int, int], ...]

_SIDE = 8  # elements along the side of a block; 4 makes more blocks, 16 more products within
_DENSE_UP_TO = 256  # blocks that are solved for by factorisation
_EIGHT: Offsets = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1))  # to the blocks around a block, and itself
_FOUR: Offsets = tuple((i, j) for i, j in _EIGHT if i == 0 or j == 0)
_PIECE = 2**12  # elements whose coefficients are gathered at a time, to stay in cache
_LEAST_PIVOT = 0.05  # of a diagonal coefficient, should points be too rough for blocks; the least one seen is 0.6


def influence_matrix(influence: Array, elements: Index) -> Array:
    """Return K(i - j) between some elements (flat indices), from K of the non-negative offsets of the whole grid."""
    columns = np.int32(influence.shape[1])
    row, column = np.divmod(elements.astype(np.int32), columns)
    offset = np.abs(np.subtract.outer(row, row))
    offset *= columns
    across = np.subtract.outer(column, column)
    offset += np.abs(across, out=across)
    matrix: Array = influence.ravel().take(offset)
    return matrix


def by_blocks(
    near: Map, influence: Array, shape: tuple[int, int], elements: Index, t: NDArray[Any], *, eight: bool = True
) -> Inverse:
    """Return (r, balanced) ↦ M⁻¹ r on the elements, of the module's docstring.

    Parameters
    ----------
    near : B, symmetric and positive definite.
    influence : K(i, j) of the non-negative offsets.
    shape : rows and columns of the grid.
    elements : flat indices, increasing.
    t : ≥ 0 on the elements.
    eight : whether N and the exact coefficients go to all eight blocks around, or only to the four that share a side,
        which takes half the time to make and costs iterations, the more the finer the grid.

    References
    ----------
    J. M. Tang, R. Nabben, C. Vuik, Y. A. Erlangga, J. Sci. Comput. 39 (2009) 340-370 (two levels: "A-DEF2", and
    "BNN", the balanced one).
    """
    return _corrected(near, _Level(influence, shape, elements, t, _EIGHT if eight else _FOUR, None))


def _corrected(near: Map, blocks: _Level) -> Inverse:
    """Return M⁻¹ for the elements that make up the blocks."""
    coarse: Inverse
    if blocks.numbers.size <= _DENSE_UP_TO:
        factorised = _factorised(blocks)

        def coarse(r: NDArray[Any], _: bool) -> NDArray[Any]:
            return factorised(r)

    else:
        above = _Level(blocks.influence, blocks.shape, blocks.numbers, blocks.mass, blocks.around, blocks)
        coarse = _corrected(_near_field(blocks), above)
    spread, moved, count = blocks.spread, blocks.moved, blocks.numbers.size
    mean, moments = spread.T, moved.T

    def apply(r: NDArray[Any], balanced: bool) -> NDArray[Any]:
        r = r.astype(np.float32, copy=False)
        means = mean @ r
        if balanced:
            forces = coarse(means, balanced)
            z = near(r - moved @ np.concatenate((forces, means)))
            back = moments @ z
            forces -= coarse(back[:count], balanced)
        else:
            z = near(r)
            back = moments @ z
            forces = coarse(means - back[:count], balanced)
        forces -= back[count:]
        z += spread @ forces
        return z

    return apply


class _Level:
    """Elements in blocks, and the operator between the blocks, Pᵀ K P.

    Attributes
    ----------
    shape, influence, numbers : grid of blocks, kernel between distant ones, flat indices of those that hold elements.
    mass : the sum of t over each.
    around : offsets to the blocks that count as near, its own included.
    neighbours : number, in ``numbers``, of each of these, or their count.
    near : exact coefficients between those.
    spread : P.
    moved : N and E side by side.
    """

    shape: tuple[int, int]
    influence: Array
    numbers: Index
    mass: Single
    around: Offsets
    neighbours: NDArray[np.int32]
    near: Single
    spread: sparse.csr_array
    moved: sparse.csr_array

    def __init__(
        self,
        influence: Array,
        shape: tuple[int, int],
        elements: Index,
        t: NDArray[Any],
        around: Offsets,
        below: _Level | None,
    ) -> None:
        self.around = around
        self.shape = (-(-shape[0] // _SIDE), -(-shape[1] // _SIDE))
        self.influence = influence[::_SIDE, ::_SIDE]
        row, column = np.divmod(elements.astype(np.int32), np.int32(shape[1]))
        width = self.shape[1] + 2
        block = (row // _SIDE + 1) * width + column // _SIDE + 1
        occupied = np.flatnonzero(np.bincount(block))
        count = occupied.size
        number = np.full((self.shape[0] + 2) * width, count, dtype=np.int32)
        number[occupied] = np.arange(count, dtype=np.int32)
        x, y = np.divmod(occupied, width)
        self.numbers = (x - 1) * self.shape[1] + y - 1
        self.neighbours = number[occupied[:, None] + np.array([i * width + j for i, j in around])]
        of_element = number[block]
        within = (row % _SIDE) * _SIDE + column % _SIDE
        place = of_element.astype(np.intp) * _SIDE**2 + within
        shapes = np.zeros((count, _SIDE**2), dtype=np.float32)
        shapes.ravel()[place] = np.maximum(t, 1e-9 * t.max()) if t.any() else 1.0
        self.mass = shapes.sum(axis=1)
        shapes /= self.mass[:, None]
        share = shapes.ravel().take(place)
        start = np.arange(elements.size + 1, dtype=np.int32)
        self.spread = sparse.csr_array((share, of_element, start), shape=(elements.size, count))

        # displacement of every element under a unit force on each of the blocks around; the last column is E
        fields = np.empty((count + 2, len(around) * _SIDE**2), dtype=np.float32)
        fields[count:] = [[0.0], [1.0]]  # of no block, and E
        tables = _tables(influence[: 2 * _SIDE, : 2 * _SIDE].tobytes(), min(2 * _SIDE, influence.shape[0]), around)
        np.matmul(shapes, tables, out=fields[:count])
        begin = np.full((count, len(around) + 1), (count + 1) * fields.shape[1], dtype=np.intp)
        begin[:, :-1] = self.neighbours * fields.shape[1] + np.arange(len(around)) * _SIDE**2
        data = np.empty((elements.size, len(around) + 1), dtype=np.float32)
        for first in range(0, elements.size, _PIECE):
            some = slice(first, first + _PIECE)
            at = begin.take(of_element[some], axis=0)
            at += within[some, None]
            fields.ravel().take(at, out=data[some], mode="clip")
        if below is not None:  # the elements are blocks themselves: those around them act by more than points do
            points = [_at(influence, i, j) for i, j in around]
            here, k = np.nonzero(below.neighbours < elements.size)
            other = below.neighbours[here, k]
            excess = (below.near[here, k] - np.array(points)[k]) * share[other]
            towards = np.zeros(2 * width + 3, dtype=np.intp)
            towards[[(i + 1) * width + j + 1 for i, j in around]] = np.arange(len(around))
            column_of = towards[block[other] - block[here] + width + 1]
            data += np.bincount(here * data.shape[1] + column_of, excess, data.size).reshape(data.shape)
        means = self.spread.T @ data
        self.near = means[:, :-1].copy()
        means[:, -1] = 0.0
        data -= means.take(of_element, axis=0)
        where = np.empty(begin.shape, dtype=np.int32)
        where[:, :-1] = np.minimum(self.neighbours, count - 1)
        where[:, -1] = np.arange(count, 2 * count)
        where = where.take(of_element, axis=0)
        start = np.arange(0, data.size + 1, data.shape[1], dtype=np.int32)
        self.moved = sparse.csr_array((data.ravel(), where.ravel(), start), shape=(elements.size, 2 * count))


@lru_cache(maxsize=16)
def _tables(influence: bytes, rows: int, around: Offsets) -> Single:
    """Return, side by side for each of the blocks around, the displacement of each element of a block by that one's."""
    given = np.frombuffer(influence).reshape(rows, -1)
    kernel = np.zeros((2 * _SIDE, 2 * _SIDE))
    kernel[: given.shape[0], : given.shape[1]] = given
    place = np.arange(_SIDE)
    tables = np.empty((_SIDE**2, len(around), _SIDE**2), dtype=np.float32)
    for k, (i, j) in enumerate(around):
        row = np.abs(place[:, None] + i * _SIDE - place)
        column = np.abs(place[:, None] + j * _SIDE - place)
        tables[:, k] = kernel[row[:, None, :, None], column[None, :, None, :]].reshape(_SIDE**2, _SIDE**2)
    return tables.reshape(_SIDE**2, -1)


def _at(influence: Array, row: int, column: int) -> float:
    """Return K at an offset, and what is nearest to it on a grid that does not reach so far (where nobody asks)."""
    return float(influence[min(abs(row), influence.shape[0] - 1), min(abs(column), influence.shape[1] - 1)])


def _factorised(blocks: _Level) -> Map:
    """Return the inverse of the operator between few blocks."""
    matrix = influence_matrix(blocks.influence, blocks.numbers)
    here, k = np.nonzero(blocks.neighbours < blocks.numbers.size)
    matrix[here, blocks.neighbours[here, k]] = blocks.near[here, k]
    try:
        factor = linalg.cho_factor(matrix, lower=True, check_finite=False)
    except linalg.LinAlgError:  # points for blocks were too rough; not seen on any contact
        return _near_field(blocks)
    return lambda r: linalg.cho_solve(factor, r, check_finite=False).astype(np.float32)


def _near_field(blocks: _Level) -> Map:
    """Return the near-field inverse of the operator between blocks, from those of the blocks around that come before.

    As in `precondition.near_field`; but coefficients differ from block to block, so the small systems cannot be
    tabulated and are solved all at once, by a Cholesky factorisation whose numbers are vectors over the blocks.
    """
    around, before = blocks.around, [offset for offset in blocks.around if offset <= (0, 0)]
    count, size = blocks.numbers.size, len(before)
    members = [blocks.neighbours[:, around.index(offset)] for offset in before]
    present = np.array([member < count for member in members])
    near = np.vstack((blocks.near, np.zeros((1, len(around)), dtype=np.float32)))
    factor = np.zeros((size, size, count), dtype=np.float32)
    for i, (row, column) in enumerate(before):
        factor[i, i] = np.where(present[i], near[members[i], around.index((0, 0))], 1.0)
        for j, (other_row, other_column) in enumerate(before[:i]):
            offset = other_row - row, other_column - column
            if offset in around:
                factor[i, j] = near[members[i], around.index(offset)] * present[j]
            else:
                factor[i, j] = _at(blocks.influence, *offset) * (present[i] & present[j])
    least = _LEAST_PIVOT * np.diagonal(factor).T
    for j in range(size):
        factor[j, j] = np.sqrt(np.maximum(factor[j, j], least[j]))
        factor[j + 1 :, j] /= factor[j, j]
        for i in range(j + 1, size):
            factor[i, j + 1 : i + 1] -= factor[i, j] * factor[j + 1 : i + 1, j]
    rows = np.zeros((size, count), dtype=np.float32)
    rows[-1] = 1.0 / factor[-1, -1]
    for i in range(size - 2, -1, -1):
        rows[i] = -(factor[i + 1 :, i] * rows[i + 1 :]).sum(axis=0) / factor[i, i]
    rows *= present
    start = np.arange(0, rows.size + 1, size, dtype=np.int32)
    where = np.minimum(members, count - 1).T.ravel()
    inverse = sparse.csr_array((rows.T.ravel(), where, start), shape=(count, count))
    transposed = inverse.T
    return lambda r: transposed @ (inverse @ r)
