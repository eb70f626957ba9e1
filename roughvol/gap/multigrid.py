"""Multigrid for the pressures of elements that are joined by conductances.

The levels are the grid, its aggregates (`aggregates`), their aggregates, and so on. A cycle visits the first aggregates
once, and each coarser level twice for each visit of the finer level. One damped Jacobi sweep precedes the coarse
correction and one follows, so that the cycle is symmetric and may precondition conjugate gradients. A level of up to
`DIRECT` elements is factorised (SuperLU). flow.md has the measured iterations.

Of a level, A is the matrix from the pressures to the flow out of each element, D its diagonal, ω the `DAMPING` and
s = ω/D the sweep. A Jacobi sweep from the pressure 0 gives s r for the inflow r, and leaves

    r - A s r = (1 - ω) r + W s r,    W = D - A, the conductances to the neighbours.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from roughvol.gap import aggregates
from roughvol.gap.aggregates import STRETCHED, Graph, Indices, Numbers
from roughvol.gap.compiled import compiled
from roughvol.typing import Array, Single

DIRECT = 2500  # elements; with 5000, grids of 65² take three times as long (flow.md)
DAMPING = 0.8  # of a Jacobi sweep
SWEEPS = 2  # of the grid after nested levels: fewer cycles, and inflow and outflow nearer to the flow (flow.md)
# an M-matrix needs no pivoting, so the order may follow the sparsity alone
_SPLU: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
Field = Array


class Conductances(NamedTuple):
    """Conductances ≥ 0 of a grid: to the next row (south), to the next column (east), and to pressures held (own).

    Shape (rows, columns). The last row leads to the first one, and the last column to the first.
    """

    south: Field
    east: Field
    own: Field

    def matrix(self) -> Any:
        """Return the matrix from the pressures to the flow out of each element."""
        number = np.arange(self.own.size).reshape(self.own.shape)
        heads = np.concatenate([np.roll(number, -1, axis).ravel() for axis in (0, 1)])
        tails, joints = np.tile(number.ravel(), 2), np.concatenate([self.south.ravel(), self.east.ravel()])
        leads = (joints > 0.0) & (heads != tails)
        return _matrix(tails[leads], heads[leads], joints[leads], self.own.ravel())


def _matrix(tails: NDArray[Any], heads: NDArray[Any], joints: Array, own: Array) -> Any:
    """Return the matrix from the pressures to the flow out, of joints that are each listed once."""
    number = np.arange(own.size)
    diagonal = own + np.bincount(tails, joints, own.size) + np.bincount(heads, joints, own.size)
    ends = np.concatenate([number, tails, heads]), np.concatenate([number, heads, tails])
    return sparse.csc_array((np.concatenate([diagonal, -joints, -joints]), ends), shape=(own.size, own.size))


class Multigrid:
    """An approximate inverse of the matrix of conductances, symmetric and positive definite.

    It is exact on grids of up to `direct` elements. An element without any conductance keeps the pressure 0.
    """

    def __init__(self, network: Conductances, direct: int | None = None) -> None:
        direct = DIRECT if direct is None else direct
        self.exact = network.own.size <= direct
        if self.exact:
            self._factor = _factor(network.matrix())
            return
        number, count = aggregates.of_grid(*network)
        graph = aggregates.graph_of_grid(*network, number, count)
        # the grid is visited once, its digits do not add up: 32 bits do
        self._grid = network.south.astype(np.float32), network.east.astype(np.float32), _sweep(*network)
        self._number, self._first = number, np.empty(number.shape, np.float32)
        self._single, self._pressure = np.empty(number.shape, np.float32), np.empty(number.shape)
        self._levels = []
        for _ in range(max(number.shape).bit_length()):  # until a block is the whole grid
            if graph.own.size <= direct:
                break
            coarse, count = aggregates.of_graph(graph)
            diagonal = _diagonal(graph)
            self._levels.append(_Level(graph, diagonal, DAMPING / diagonal, coarse))
            graph = aggregates.graph_of_graph(graph, coarse, count)
        self._factor = _factor(_matrix(graph.tails, graph.heads, graph.weight, graph.own))

    def __call__(self, inflow: Array) -> Array:
        """Return the pressures that drive an inflow of every element, shape (rows, columns).

        The next call writes to the same array.
        """
        if self.exact:
            return self._factor.solve(inflow.ravel()).reshape(inflow.shape)
        single, pressure = self._single, self._pressure
        single[...] = inflow
        left = _before(*self._grid, self._number, single, self._first, np.zeros(self._size(0)))
        _after(*self._grid, self._number, single, self._visit(left, 0), self._first, pressure)
        return pressure

    def nested(self, inflow: Array) -> Array:
        """Return pressures that an inflow drives nearly.

        The coarsest level is solved. Each finer level starts from the pressures of its aggregates, and has one cycle
        (full multigrid: Briggs, Henson & McCormick, A Multigrid Tutorial, SIAM 2000, chapter 3). Of all pressures that
        are equal in each aggregate, those of a solved level have the least dissipation. An inflow is stretched as the
        conductances of aggregates are, so that pressures keep their size. The grid has sweeps alone.
        """
        number = self._number.ravel()
        coarse = self._nested(_gathered(number, STRETCHED * inflow.ravel(), self._size(0)), 0)
        pressure = _spread(number, coarse).reshape(inflow.shape)
        for _ in range(SWEEPS):
            pressure = _swept(*self._grid, inflow, pressure, np.empty(inflow.shape))
        return pressure

    def _nested(self, inflow: Array, depth: int) -> Array:
        """Return the pressures of a level."""
        if depth == len(self._levels):
            return self._visit(inflow, depth)
        level = self._levels[depth]
        coarse = self._nested(_gathered(level.number, STRETCHED * inflow, self._size(depth + 1)), depth + 1)
        pressure = _spread(level.number, coarse)
        return pressure + self._visit(_left(level, inflow, pressure), depth)

    def _size(self, depth: int) -> int:
        """Return the number of nodes of a level."""
        return int(self._levels[depth].diagonal.size if depth < len(self._levels) else self._factor.shape[0])

    def _visit(self, inflow: Array, depth: int) -> Array:
        """Return the pressures of a level."""
        if depth == len(self._levels):
            direct: Array = self._factor.solve(inflow)
            return direct
        level = self._levels[depth]
        first = np.empty(inflow.size)
        left = _graph_before(level, inflow, first, np.zeros(self._size(depth + 1)))
        coarse = self._visit(left, depth + 1)
        if depth + 1 < len(self._levels):
            below = self._levels[depth + 1]
            left = _left(below, left, coarse)
            coarse += self._visit(left, depth + 1)
        return _graph_after(level, inflow, coarse, first)


class _Level(NamedTuple):
    """A graph, the diagonal D of its matrix, the sweep s, and the aggregate of each node."""

    graph: Graph
    diagonal: Array
    sweep: Array
    number: Indices


def _factor(matrix: Any) -> Any:
    """Return the factors of a matrix; an element without any conductance keeps the pressure 0."""
    diagonal = matrix.diagonal()
    matrix.setdiag(np.where(diagonal == 0.0, 1.0, diagonal))
    return linalg.splu(matrix, **_SPLU)


@compiled
def turned(
    direction: Field, towards: Field, turn: float, south: Field, east: Field, own: Field, outflow: Field
) -> None:
    """Turn a direction to ``towards`` plus ``turn`` times itself, and write the flow out of each element.

    Lines are turned one ahead of their outflow, so that fields are read once.
    """
    rows, columns = own.shape
    for line in range(0, rows, max(rows - 1, 1)):  # the first and the last are neighbours
        for j in range(columns):
            direction[line, j] = towards[line, j] + turn * direction[line, j]
    for i in range(rows):
        up, down = i - 1 if i else rows - 1, i + 1 if i + 1 < rows else 0
        if 0 < down < rows - 1:
            for j in range(columns):
                direction[down, j] = towards[down, j] + turn * direction[down, j]
        for j in range(columns):
            back, on = j - 1 if j else columns - 1, j + 1 if j + 1 < columns else 0
            p = direction[i, j]
            along = south[up, j] * (p - direction[up, j]) + south[i, j] * (p - direction[down, j])
            across = east[i, back] * (p - direction[i, back]) + east[i, j] * (p - direction[i, on])
            outflow[i, j] = own[i, j] * p + (along + across)


@compiled
def stepped(pressure: Field, left: Field, direction: Field, outflow: Field, step: float) -> None:
    """Take a step along a direction, and its outflow from the inflow that is left."""
    for i in range(pressure.shape[0]):
        for j in range(pressure.shape[1]):
            pressure[i, j] += step * direction[i, j]
            left[i, j] -= step * outflow[i, j]


@compiled
def _sweep(south: Field, east: Field, own: Field) -> Single:
    """Return the sweep s of a grid; 0 of an element without any conductance."""
    rows, columns = own.shape
    sweep = np.zeros(own.shape, np.float32)
    for i in range(rows):
        up = i - 1 if i else rows - 1
        for j in range(columns):
            back = j - 1 if j else columns - 1
            diagonal = own[i, j] + (south[up, j] + south[i, j]) + (east[i, back] + east[i, j])
            if diagonal > 0.0:
                sweep[i, j] = DAMPING / diagonal
    return sweep


@compiled
def _gathered(number: NDArray[Any], inflow: Array, size: int) -> Array:
    """Add up an inflow by aggregates."""
    gathered = np.zeros(size)
    for k in range(number.size):
        if number[k] >= 0:
            gathered[number[k]] += inflow[k]
    return gathered


@compiled
def _spread(number: NDArray[Any], coarse: Array) -> Array:
    """Return the pressures of aggregates on their elements or nodes."""
    spread = np.zeros(number.size)
    for k in range(number.size):
        if number[k] >= 0:
            spread[k] = coarse[number[k]]
    return spread


@compiled
def _before(
    south: Single, east: Single, sweep: Single, number: Numbers, inflow: Single, first: Single, left: Array
) -> Array:
    """Write the pressures of a sweep to ``first``, and add up the inflow that they leave, by aggregates."""
    rows, columns = sweep.shape
    rest, drive = np.float32(1.0 - DAMPING), np.empty(columns, np.float32)
    for i in range(rows):
        for j in range(columns):
            first[i, j] = sweep[i, j] * inflow[i, j]
    for i in range(rows):
        _driven(south, east, first, i, drive)
        for j in range(columns):
            if number[i, j] >= 0:
                left[number[i, j]] += rest * inflow[i, j] + drive[j]
    return left


@compiled
def _after(
    south: Single,
    east: Single,
    sweep: Single,
    number: Numbers,
    inflow: Single,
    coarse: Array,
    first: Single,
    out: Array,
) -> None:
    """Add the coarse correction to the ``first`` pressures, and write those after a sweep to ``out``."""
    for i in range(sweep.shape[0]):
        for j in range(sweep.shape[1]):
            if number[i, j] >= 0:
                first[i, j] += np.float32(coarse[number[i, j]])
    _swept(south, east, sweep, inflow, first, out)


@compiled
def _swept(
    south: Single, east: Single, sweep: Single, inflow: NDArray[Any], before: NDArray[Any], after: Array
) -> Array:
    """Write the pressures after a sweep to ``after``."""
    rest = np.float32(1.0 - DAMPING)
    for i in range(sweep.shape[0]):
        _driven(south, east, before, i, after[i])
        for j in range(sweep.shape[1]):
            after[i, j] = rest * before[i, j] + sweep[i, j] * (inflow[i, j] + after[i, j])
    return after


@compiled
def _driven(south: Single, east: Single, pressure: NDArray[Any], i: int, drive: NDArray[Any]) -> None:
    """Write the inflow that the pressures around drive into each element of line i."""
    rows, last = pressure.shape[0], pressure.shape[1] - 1
    up, down = i - 1 if i else rows - 1, i + 1 if i + 1 < rows else 0
    north, along, aside = south[up], south[i], east[i]
    above, here, below = pressure[up], pressure[i], pressure[down]
    for j in range(1, last):  # without the ends: several at a time
        drive[j] = (north[j] * above[j] + along[j] * below[j]) + (aside[j - 1] * here[j - 1] + aside[j] * here[j + 1])
    for back, j, on in ((last, 0, min(1, last)), (max(last - 1, 0), last, 0)):
        drive[j] = (north[j] * above[j] + along[j] * below[j]) + (aside[back] * here[back] + aside[j] * here[on])


@compiled
def _diagonal(graph: Graph) -> Array:
    """Return the diagonal of the matrix of a graph; 1 of a node without any conductance."""
    diagonal = graph.own.copy()
    for k in range(graph.tails.size):
        diagonal[graph.tails[k]] += graph.weight[k]
        diagonal[graph.heads[k]] += graph.weight[k]
    for node in range(diagonal.size):
        if diagonal[node] == 0.0:
            diagonal[node] = 1.0
    return diagonal


@compiled
def _graph_driven(graph: Graph, pressure: Array, inflow: Array) -> None:
    """Add the flow that pressures drive into their neighbours to an inflow."""
    tails, heads, weight = graph.tails, graph.heads, graph.weight
    for k in range(tails.size):
        tail, head = tails[k], heads[k]
        inflow[tail] += weight[k] * pressure[head]
        inflow[head] += weight[k] * pressure[tail]


@compiled
def _graph_before(level: _Level, inflow: Array, first: Array, left: Array) -> Array:
    """Write the pressures of a sweep to ``first``, and add up the inflow that they leave, by aggregates."""
    rest = np.empty(inflow.size)
    for node in range(inflow.size):
        first[node], rest[node] = level.sweep[node] * inflow[node], (1.0 - DAMPING) * inflow[node]
    _graph_driven(level.graph, first, rest)
    for node in range(inflow.size):
        left[level.number[node]] += rest[node]
    return left


@compiled
def _graph_after(level: _Level, inflow: Array, coarse: Array, first: Array) -> Array:
    """Return the pressures after the coarse correction of the ``first`` ones and a sweep."""
    for node in range(inflow.size):
        first[node] += coarse[level.number[node]]
    pressure = inflow.copy()
    _graph_driven(level.graph, first, pressure)
    for node in range(inflow.size):
        pressure[node] = (1.0 - DAMPING) * first[node] + level.sweep[node] * pressure[node]
    return pressure


@compiled
def _left(level: _Level, inflow: Array, pressure: Array) -> Array:
    """Return the inflow that pressures of a graph leave."""
    left = np.empty(inflow.size)
    for node in range(inflow.size):
        left[node] = inflow[node] - level.diagonal[node] * pressure[node]
    _graph_driven(level.graph, pressure, left)
    return left
