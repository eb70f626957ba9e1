"""Sheets of patches: the matrix of their nodes, duality, limits, bounds, and the load at which the last way closes."""

from fractions import Fraction

import numpy as np
import pytest

from roughvol.gap import sheet


def logs(shape, seed, scatter=1.5):
    return np.random.default_rng(seed).normal(0.0, scatter, shape)


def exact(along, across, *, ring=False):
    """Return the conductance of a sheet from the matrix of its nodes, in fractions."""
    n, m = along.shape
    node = np.arange((n - 1) * m).reshape(n - 1, m)
    size = node.size
    rows = [[Fraction(0)] * (size + 1) for _ in range(size)]  # the last column is the inflow
    pairs = [(node[i, j], node[i + 1, j], along[i + 1, j]) for i in range(n - 2) for j in range(m)]
    last = m if ring else m - 1
    pairs += [(node[i, j], node[i, (j + 1) % m], across[i, j]) for i in range(n - 1) for j in range(last)]
    for a, b, g in pairs:
        for one, other in ((a, b), (b, a)):
            rows[one][one] += Fraction(g)
            rows[one][other] -= Fraction(g)
    for j in range(m):
        rows[node[0, j]][node[0, j]] += Fraction(along[0, j])
        rows[node[-1, j]][node[-1, j]] += Fraction(along[-1, j])
        rows[node[0, j]][size] += Fraction(along[0, j])
    for k in (k for k in range(size) if rows[k][k]):  # the pressure of a node without a way to an end is any
        pivot = [value / rows[k][k] for value in rows[k]]
        for i in (i for i in range(size) if i != k):
            rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], pivot, strict=True)]
        rows[k] = pivot
    flow = sum(Fraction(along[0, j]) * (1 - rows[node[0, j]][size]) for j in range(m))
    return float(flow * n / m)


@pytest.mark.parametrize(
    ("shape", "ring"), [((2, 3), False), ((5, 4), False), ((4, 1), False), ((4, 6), True), ((2, 2), True)]
)
@pytest.mark.parametrize("scatter", [1.5, 20.0])
def test_agrees_with_the_matrix_of_its_nodes_in_all_digits(shape, scatter, *, ring):
    along, across = np.exp(logs(shape, 1, scatter)), np.exp(logs((shape[0] - 1, shape[1]), 2, scatter))
    assert sheet.conductance(along, across, ring=ring) == pytest.approx(exact(along, across, ring=ring), rel=1e-13)
    along[np.random.default_rng(3).random(shape) < 0.3] = 0.0
    found = sheet.conductance(along, across, ring=ring)
    assert found == pytest.approx(exact(along, across, ring=ring), rel=1e-13, abs=0.0)


@pytest.mark.parametrize(("shape", "ring"), [((1, 3), False), ((1, 3), True), ((4, 1), False), ((3, 5), True)])
def test_closes_where_the_last_way_of_open_patches_does(shape, *, ring):
    n, m = shape
    rng = np.random.default_rng(9)
    along, across = rng.random((20, n, m)), rng.random((20, n - 1, m))
    loads = sheet.closing(along, across, ring=ring)
    for beside, is_open in ((-1e-9, True), (1e-9, False)):
        open_patches = [np.where(some >= loads[:, None, None] + beside, 1.0, 0.0) for some in (along, across)]
        assert np.all((sheet.conductance(*open_patches, ring=ring) > 0.0) == is_open)


def test_sheets_together_are_those_of_each_alone():
    along, across = np.exp(logs((2, 5, 3, 4), 10)), np.exp(logs((2, 5, 2, 4), 11))
    for of in (sheet.conductance, sheet.closing):
        together = of(along, across)
        assert together.shape == (2, 5)
        assert together[1, 3] == of(along[1, 3], across[1, 3])


@pytest.mark.parametrize("shape", [(2, 2), (3, 5), (24, 24)])
def test_the_product_with_the_dual_sheet_is_one(shape):
    n, m = shape
    along, across = np.exp(logs((n, m), 4, 3.0)), np.exp(logs((n - 1, m), 5, 3.0))
    dual = np.zeros((m - 1, n))
    dual[:, : n - 1] = 1.0 / across[:, : m - 1].T
    assert sheet.conductance(along, across) * sheet.conductance(1.0 / along.T, dual) == pytest.approx(1.0, rel=1e-12)


def test_patches_side_by_side_conduct_their_mean():
    one_row = np.exp(logs((1, 9), 7))
    assert sheet.conductance(one_row, np.empty((0, 9))) == pytest.approx(one_row.mean())


def test_decades_between_patches_leave_the_widest_way():
    along, across = np.full((3, 3), 1e-20), np.full((2, 3), 1e-20)
    along[:, 1] = 1e9, 1.0, 1e9
    assert sheet.conductance(along, across) == pytest.approx(1.0 / (1.0 + 2e-9), rel=1e-14)
    along[1, 1] = 0.0
    found = sheet.conductance(along, across)
    assert found == pytest.approx(exact(along, across), rel=1e-14, abs=0.0)
    assert found == pytest.approx(1e-20, rel=1e-9, abs=0.0)  # two streams past the middle
