"""Multigrid for the pressures of elements that are joined by conductances, by aggregates that follow the conductances.

Conductances span decades, also between neighbours. An aggregate must not join waters on both sides of a closed place.
Elements of a block of 2 × 2 belong to one aggregate if a chain of strong joints connects them. A joint is strong if its
conductance is at least `STRONG` times the largest one at either end, or if it is the best of an element in its block
and that strong for this element. Aggregates are joined by the sum of the conductances between their elements times
`STRETCHED`, because the way between the centres is longer. They lie in blocks of twice the size, and so on.

A W-cycle visits each coarse level twice. One damped Jacobi sweep precedes the coarse correction and one follows, so
that the cycle is symmetric and may precondition conjugate gradients. A level of up to `DIRECT` elements is factorised
(SuperLU). flow.md has the measured iterations. Aggregation after Notay, Electronic Transactions on Numerical Analysis
37 (2010) 123-146; the scaled coarse matrix after Braess, Computing 55 (1995) 379-393.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph, linalg

from roughvol.typing import Array

DIRECT = 5000  # elements
DAMPING = 0.8  # of a Jacobi sweep
STRONG, STRETCHED = 0.25, 0.7
# an M-matrix needs no pivoting, so the order may follow the sparsity alone
_SPLU: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
Numbers = NDArray[np.int32]
Field = Array


class Conductances(NamedTuple):
    """Conductances ≥ 0 of a grid, each of shape (rows, columns).

    Attributes
    ----------
    south : from the element (i, j) to (i + 1, j); those of the last row lead to the first row.
    east : from the element (i, j) to (i, j + 1); those of the last column lead to the first column.
    own : from the element to pressures that are held.
    """

    south: Field
    east: Field
    own: Field

    def matrix(self) -> Any:
        """Return the matrix from the pressures to the flow out of each element, by diagonals."""
        (_, columns), size = self.own.shape, self.own.size
        diagonals = {0: self.own.ravel().copy()}
        for joints, axis, step in ((self.south, 0, columns), (self.east, 1, 1)):
            for part, jump in _parts(joints, axis, step):
                back = part.ravel()
                there = np.roll(back, jump)
                diagonals[0] += back
                diagonals[0] += there
                for offset, values in ((jump, there), (-jump, back)):
                    diagonals[offset] = diagonals[offset] - values if offset in diagonals else -values
        data, offsets = np.stack(list(diagonals.values())), list(diagonals)
        return sparse.dia_array((data, offsets), shape=(size, size))

    def aggregates(self) -> Numbers:
        """Return the number of the aggregate of each element in its block of 2 × 2; the last if it does not conduct."""
        largest = self.own
        for joints, axis in ((self.south, 0), (self.east, 1)):
            largest = np.maximum(np.maximum(largest, joints), np.roll(joints, 1, axis))
        inside = [np.zeros(largest.shape), np.zeros(largest.shape)]  # conductance to the partner in the block
        for joints, axis in ((self.south, 0), (self.east, 1)):
            for ends in _pairs(inside[axis], axis):
                ends[...] = _pairs(joints, axis)[0]
        chosen, alone = [], np.ones(largest.shape, dtype=np.bool_)
        for axis in (0, 1):
            strong = (inside[axis] >= STRONG * largest) & (inside[axis] > 0.0)
            one, other = _pairs(strong, axis)
            chosen.append(one & other)
            for ends in _pairs(alone, axis):
                ends &= ~chosen[axis]
        best = inside[0] >= inside[1]  # one of equal ones: both might lead into two waters
        for axis, better in ((0, best), (1, ~best)):
            for ends in _pairs(alone & better & (inside[axis] >= STRONG * largest) & (inside[axis] > 0.0), axis):
                chosen[axis] |= ends
        own = np.arange(largest.size, dtype=np.int32).reshape(largest.shape)
        label = own.copy()
        for axis in (0, 1, 0, 1):  # around the four elements of a block
            one, other = _pairs(label, axis)
            np.minimum(one, other, out=one, where=chosen[axis])
            np.copyto(other, one, where=chosen[axis])
        conducts = largest > 0.0
        number = np.cumsum(conducts & (label == own), dtype=np.int32) - 1
        return np.where(conducts, number[label], number[-1] + 1).ravel()

    def joined(self, aggregates: Numbers) -> "_Graph":
        """Return the graph of the aggregates."""
        field, parts = aggregates.reshape(self.own.shape), []
        for joints, axis in ((self.south, 0), (self.east, 1)):
            beyond = np.roll(field, -1, axis)
            apart = (joints > 0.0) & (field != beyond)
            parts.append((field[apart], beyond[apart], joints[apart]))
        tails, heads, weight = (np.concatenate(both) for both in zip(*parts, strict=True))
        row, column = np.divmod(np.arange(self.own.size, dtype=np.int32), self.own.shape[1])
        ends = np.concatenate([tails, heads]), np.concatenate([heads, tails])
        return _graph(aggregates, ends, np.concatenate([weight, weight]), self.own.ravel(), row, column)


def _pairs(field: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return every second line, those with a partner behind them, and their partners."""
    lines = np.moveaxis(field, axis, 0)
    return lines[: lines.shape[0] // 2 * 2 : 2], lines[1::2]


def _parts(joints: Field, axis: int, step: int) -> list[tuple[Field, int]]:
    """Return the joints inside, and those of the last line to the first, with the distances of the elements."""
    length, last = joints.shape[axis], [slice(None), slice(None)]
    last[axis] = slice(-1, None)
    if length == 1 or not joints.any():
        return []
    if not joints[*last].any():
        return [(joints, step)]
    inside, around = joints.copy(), np.zeros_like(joints)
    inside[*last], around[*last] = 0.0, joints[*last]
    return [(inside, step), (around, step - length * step)]


class Multigrid:
    """An approximate inverse of the matrix of conductances, symmetric and positive definite; exact on a small grid.

    An element without any conductance keeps the pressure 0.

    Parameters
    ----------
    network : Conductances
        Of the elements.
    matrix : sparse array
        Of the network.
    direct : int, optional
        Grids of up to so many elements are factorised, `DIRECT` by default.
    """

    def __init__(self, network: Conductances, matrix: Any, direct: int | None = None) -> None:
        direct = DIRECT if direct is None else direct
        self.exact = matrix.shape[0] <= direct
        self._levels: list[_Level] = []
        graph: Conductances | _Graph = network
        for _ in range(max(network.own.shape).bit_length()):  # until a block is the whole grid
            if matrix.shape[0] <= direct:
                break
            aggregates = graph.aggregates()
            graph = graph.joined(aggregates)
            # the grid is visited once, its digits do not add up: 32 bits do
            matrix = matrix.astype(np.float32) if not self._levels else matrix
            self._levels.append(_level(matrix, aggregates, graph.own.size))
            matrix = graph.matrix()
        matrix = sparse.csc_array(matrix)
        alone = np.asarray(matrix.diagonal() == 0.0, dtype=np.float64)
        self._factor = linalg.splu(matrix + sparse.diags_array(alone, format="csc"), **_SPLU)

    def __call__(self, inflow: Array, depth: int = 0) -> Array:
        """Return the pressures that drive an inflow of every element, both flat."""
        if depth == len(self._levels):
            direct: Array = self._factor.solve(inflow)
            return direct
        level = self._levels[depth]
        inflow = inflow.astype(level.sweep.dtype, copy=False)
        pressure: Any = level.sweep * inflow
        left: Any = np.bincount(level.aggregates, inflow - level.matrix @ pressure, level.coarse)
        coarse = self(left, depth + 1)
        if depth + 1 < len(self._levels):
            coarse += self(left - self._levels[depth + 1].matrix @ coarse, depth + 1)
        pressure += coarse[level.aggregates]
        pressure += level.sweep * (inflow - level.matrix @ pressure)
        return pressure


class _Level(NamedTuple):
    """The matrix of a level, the factors of a damped Jacobi sweep, and the aggregate of each element."""

    matrix: Any
    sweep: Array
    aggregates: Numbers
    coarse: int


def _level(matrix: Any, aggregates: Numbers, coarse: int) -> _Level:
    diagonal = matrix.diagonal()
    sweep = np.divide(diagonal.dtype.type(DAMPING), diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0)
    return _Level(matrix, sweep, aggregates, coarse)


class _Graph(NamedTuple):
    """Elements or aggregates, the blocks in which they lie, and their joints.

    Attributes
    ----------
    joints : symmetric matrix of the conductances between them, by rows.
    own : conductances to pressures that are held.
    row, column : of the block.
    """

    joints: Any
    own: Array
    row: Numbers
    column: Numbers

    def aggregates(self) -> Numbers:
        """Return the number of the aggregate of each element in its block of twice the size, as those of a grid."""
        starts, heads, weight = self.joints.indptr, self.joints.indices, self.joints.data
        count = np.diff(starts)
        tails = np.repeat(np.arange(self.own.size, dtype=np.int32), count)
        block = (self.row // 2) * (self.column.max() // 2 + 1) + self.column // 2
        largest = np.maximum(_row_max(starts, weight), self.own)
        inside = np.where(block[tails] == block[heads], weight, 0.0)
        strong = (inside >= STRONG * largest[tails]) & (inside > 0.0)
        chosen = strong & (inside >= STRONG * largest[heads])
        alone = np.ones(self.own.size, dtype=np.bool_)
        alone[tails[chosen]] = False
        best = np.flatnonzero(strong & alone[tails] & (inside == _row_max(starts, inside)[tails]))
        chosen[best[np.diff(tails[best], prepend=-1) > 0]] = True  # one of equal ones: two might lead into two waters
        chain = sparse.coo_array((chosen[chosen], (tails[chosen], heads[chosen])), shape=self.joints.shape)
        _, found = csgraph.connected_components(chain, directed=False)
        conducts = (self.own > 0.0) | (count > 0)
        used = np.zeros(self.own.size, dtype=np.bool_)
        used[found[conducts]] = True
        number = np.cumsum(used, dtype=np.int32) - 1
        return np.where(conducts, number[found], number[-1] + 1)

    def joined(self, aggregates: Numbers) -> "_Graph":
        """Return the graph of the aggregates."""
        tails, heads = np.repeat(aggregates, np.diff(self.joints.indptr)), aggregates[self.joints.indices]
        apart = tails != heads
        ends, weight = (tails[apart], heads[apart]), self.joints.data[apart]
        return _graph(aggregates, ends, weight, self.own, self.row, self.column)

    def matrix(self) -> Any:
        """Return the matrix from the pressures to the flow out of each element."""
        diagonal = self.own + self.joints.sum(axis=1)
        return sparse.csr_array(sparse.diags_array(diagonal, format="csr") - self.joints)


def _graph(
    aggregates: Numbers, ends: tuple[Numbers, Numbers], weight: Array, own: Array, row: Numbers, column: Numbers
) -> _Graph:
    """Return the graph of aggregates from the joints between their elements, which are given in both directions."""
    count = int(aggregates.max()) + 1
    joints = sparse.coo_array((STRETCHED * weight, ends), shape=(count, count)).tocsr()
    blocks = np.zeros((2, count), dtype=np.int32)
    blocks[0, aggregates], blocks[1, aggregates] = row // 2, column // 2
    held: Any = np.bincount(aggregates, STRETCHED * own, count)
    return _Graph(joints, held, blocks[0], blocks[1])


def _row_max(starts: Numbers, values: Array) -> Array:
    """Return the largest value of each row of a matrix by rows, 0 of an empty one."""
    filled = np.diff(starts) > 0
    largest = np.zeros(starts.size - 1)
    if filled.any():
        largest[filled] = np.maximum.reduceat(values, starts[:-1][filled])
    return largest
