"""Aggregates of elements, and their graph, against dense matrices."""

import errno
from unittest.mock import Mock

import numba
import numpy as np
import pytest
from numba.core.caching import CompileResultCacheImpl, IndexDataCacheFile
from numpy.testing import assert_allclose

from roughvol.gap import aggregates
from roughvol.gap.aggregates import STRETCHED
from roughvol.gap.compiled import compiled
from roughvol.gap.multigrid import Conductances

EACH_SHAPE = pytest.mark.parametrize("shape", [(8, 8), (9, 6), (7, 11), (1, 9), (6, 1)])


def decades(shape, seed):
    """Conductances over eight decades, a third of the joints closed, some of them around."""
    random = np.random.default_rng(seed)
    south, east = 10.0 ** random.uniform(-8.0, 0.0, (2, *shape)) * (random.random((2, *shape)) > 0.35)
    own = np.zeros(shape)
    own[0] = random.random(shape[1])
    return Conductances(south, east, own)


def dense(graph):
    """Return the matrix of the joints of a graph."""
    joints = np.zeros((graph.own.size, graph.own.size))
    np.add.at(joints, (graph.tails, graph.heads), graph.weight)
    return joints + joints.T


def summed(joints, number, count):
    """Return the joints between aggregates."""
    member = (number.ravel()[:, None] == np.arange(count)).astype(float)
    between = STRETCHED * member.T @ joints @ member
    np.fill_diagonal(between, 0.0)
    return between


@EACH_SHAPE
def test_joints_of_aggregates_are_the_scaled_sums_of_those_of_their_elements(shape):
    grid = decades(shape, 1)
    matrix = grid.matrix().toarray()
    number, count = aggregates.of_grid(*grid)
    graph = aggregates.graph_of_grid(*grid, number, count)
    joints = np.diag(matrix.diagonal()) - matrix
    while True:
        assert_allclose(dense(graph), summed(joints, number, count), rtol=1e-13)
        held = [STRETCHED * own[number.ravel() == k].sum() for own in [grid.own.ravel()] for k in range(count)]
        assert_allclose(graph.own, held, rtol=1e-13)
        if count == 1 or (graph.row.max() == 0 and graph.column.max() == 0):
            break
        joints, grid = dense(graph), Conductances(graph.weight, graph.weight, graph.own)
        number, count = aggregates.of_graph(graph)
        graph = aggregates.graph_of_graph(graph, number, count)


@EACH_SHAPE
def test_an_aggregate_is_a_chain_of_strong_joints_in_one_block(shape):
    grid = decades(shape, 2)
    number, count = aggregates.of_grid(*grid)
    assert sorted(set(number[number >= 0].tolist())) == list(range(count))
    conducts = grid.matrix().diagonal().reshape(shape) > 0.0
    assert np.array_equal(number >= 0, conducts)
    largest = np.maximum(grid.own, np.maximum(grid.south, grid.east))
    largest = np.maximum(largest, np.maximum(np.roll(grid.south, 1, 0), np.roll(grid.east, 1, 1)))
    for aggregate in range(count):
        elements = [tuple(at) for at in np.argwhere(number == aggregate).tolist()]
        assert len({(i // 2, j // 2) for i, j in elements}) == 1
        reached, waiting = set(), elements[:1]
        while waiting:
            i, j = waiting.pop()
            reached.add((i, j))
            for other, joint in (
                ((i ^ 1, j), grid.south[min(i, i ^ 1), j]),
                ((i, j ^ 1), grid.east[i, min(j, j ^ 1)]),
            ):
                if other in elements and other not in reached:
                    strong = joint >= aggregates.STRONG * min(largest[i, j], largest[other])
                    if joint > 0.0 and strong:
                        waiting.append(other)
        assert reached == set(elements)


def _inner(number):
    return number + 1.0


@pytest.mark.parametrize("fault", ["no folder", "full disk", "damaged file"])
def test_code_that_cannot_be_kept_on_disk_is_compiled_all_the_same(fault, tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    inner = compiled(_inner)
    monkeypatch.setitem(globals(), "_inner", inner)
    assert compiled(lambda number: 2.0 * _inner(number))(2.0) == 6.0
    kept = [path for path in tmp_path.rglob("*.nbi") if path.stat().st_size]
    assert len(kept) == 2
    if fault == "no folder":
        monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [])
    for path in kept if fault == "damaged file" else ():
        path.write_bytes(b"")
    if fault == "full disk":
        monkeypatch.setattr(IndexDataCacheFile, "save", Mock(side_effect=OSError(errno.ENOSPC, "full")))
    monkeypatch.setitem(globals(), "_inner", compiled(inner.py_func))
    twice = compiled(lambda number: 2.0 * _inner(number))
    assert twice(2.0) == 6.0
    assert twice(3) == 8.0  # of another type
