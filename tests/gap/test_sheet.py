"""Sheets of patches: duality, limits, bounds, and the threshold of closed patches."""

import numpy as np
import pytest

from roughvol.gap import sheet


def logs(shape, seed, scatter=1.5):
    return np.random.default_rng(seed).normal(0.0, scatter, shape)


def dense(along, across, *, ring=False):
    """Return the conductance of a sheet from the dense matrix of its nodes."""
    n, m = along.shape
    node = np.arange((n - 1) * m).reshape(n - 1, m)
    matrix, inflow = np.zeros((node.size, node.size)), np.zeros(node.size)
    pairs = [(node[i, j], node[i + 1, j], along[i + 1, j]) for i in range(n - 2) for j in range(m)]
    last = m if ring else m - 1
    pairs += [(node[i, j], node[i, (j + 1) % m], across[i, j]) for i in range(n - 1) for j in range(last)]
    for a, b, g in pairs:
        matrix[[a, b], [a, b]] += g
        matrix[a, b] -= g
        matrix[b, a] -= g
    for j in range(m):
        matrix[node[0, j], node[0, j]] += along[0, j]
        matrix[node[-1, j], node[-1, j]] += along[-1, j]
        inflow[node[0, j]] += along[0, j]
    pressure = np.linalg.lstsq(matrix, inflow, rcond=None)[0]
    return float(n / m * along[0] @ (1.0 - pressure[node[0]]))


@pytest.mark.parametrize(("shape", "ring"), [((2, 3), False), ((5, 4), False), ((4, 6), True), ((2, 2), True)])
def test_agrees_with_the_dense_matrix_of_its_nodes(shape, *, ring):
    along, across = np.exp(logs(shape, 1)), np.exp(logs((shape[0] - 1, shape[1]), 2))
    assert sheet.conductance(along, across, ring=ring) == pytest.approx(dense(along, across, ring=ring), rel=1e-6)
    along[np.random.default_rng(3).random(shape) < 0.3] = 0.0
    assert sheet.conductance(along, across, ring=ring) == pytest.approx(dense(along, across, ring=ring), abs=1e-9)


@pytest.mark.parametrize("shape", [(2, 2), (3, 5), (6, 4)])
def test_the_product_with_the_dual_sheet_is_one(shape):
    n, m = shape
    along, across = np.exp(logs((n, m), 4, 3.0)), np.exp(logs((n - 1, m), 5, 3.0))
    dual = np.zeros((m - 1, n))
    dual[:, : n - 1] = 1.0 / across[:, : m - 1].T
    assert sheet.conductance(along, across) * sheet.conductance(1.0 / along.T, dual) == pytest.approx(1.0, rel=1e-6)


def test_closes_where_its_dual_opens():
    """Void leads along the flow, or closed patches across it: so sheets close at one half of the joints."""
    rng = np.random.default_rng(6)
    for _ in range(50):
        along, across = rng.random((4, 5)), rng.random((3, 5))
        load = sheet.closing(along, across)
        dual = np.zeros((4, 4))
        dual[:, :3] = 1.0 - across[:, :4].T
        assert sheet.closing(1.0 - along.T, dual) == pytest.approx(1.0 - load)


def test_limits_of_patches_side_by_side_and_in_a_row():
    one_row, one_column = np.exp(logs((1, 9), 7)), np.exp(logs((9, 1), 8))
    assert sheet.conductance(one_row, np.empty((0, 9))) == pytest.approx(one_row.mean())
    harmonic = 1.0 / np.mean(1.0 / one_column)
    assert sheet.conductance(one_column, np.ones((8, 1))) == pytest.approx(harmonic, rel=1e-6)
    assert sheet.closing(one_row, np.empty((0, 9))) == one_row.max()
    assert sheet.closing(one_column, np.ones((8, 1))) == one_column.min()


def test_many_patches_alike_in_all_directions_conduct_their_geometric_mean():
    scatter = 2.0
    found = [
        np.log(sheet.conductance(np.exp(logs((24, 24), k, scatter)), np.exp(logs((23, 24), 100 + k, scatter))))
        for k in range(40)
    ]
    error = np.std(found, ddof=1) / np.sqrt(len(found))
    assert abs(np.mean(found)) < 3.0 * error
    assert error < 0.02 * scatter


def test_decades_between_patches_leave_the_widest_way():
    along, across = np.full((3, 3), 1e-20), np.full((2, 3), 1e-20)
    along[:, 1] = 1e9, 1.0, 1e9
    assert sheet.conductance(along, across) == pytest.approx(1.0, rel=1e-6)
    along[1, 1] = 0.0
    assert sheet.conductance(along, across) == pytest.approx(1e-20, rel=1e-5, abs=0.0)  # two streams past the middle
