"""Clusters: hand-drawn voids, a search from element to element, and periods joined at their sides."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import ndimage

from roughvol.gap.clusters import connectivity, endless, percolates
from tests.gap.kit import drawn, floods, rough, smooth

DIAGONAL = "#... .#.. ..#. ...#"
RING = """
.......
.#####.
.#...#.
.#.#.#.
.#...#.
.#####.
.......
"""


@pytest.mark.parametrize("turn", [np.asarray, np.fliplr])
def test_a_diagonal_of_contacts_is_one_cluster_and_a_barrier(turn):
    gap = turn(drawn(DIAGONAL))
    state = connectivity(gap, gap == 0.0)
    assert_array_equal(state.contact_clusters, [4])
    assert (state.percolates_x, state.percolates_y) == (False, False)
    assert state.connected == 1.0


def test_a_ring_traps_what_is_inside():
    gap = drawn(RING)
    state = connectivity(gap, gap == 0.0)
    assert_array_equal(state.contact_clusters, [16, 1])
    assert_array_equal(state.trapped_pockets, [8])
    assert_allclose([state.trapped, state.percolating], [8 / 32, 24 / 32], rtol=1e-15)
    gap[2:5, 2:5] *= 3.0  # volumes count, not elements
    state = connectivity(gap, gap == 0.0)
    assert_allclose([state.trapped, state.connected], [24 / 48, 24 / 48], rtol=1e-15)


def test_percolation_is_what_a_search_finds_and_void_and_solid_exclude_each_other():
    random = np.random.default_rng(1)
    for _ in range(40):
        void = random.random(random.integers(1, 12, 2)) < random.uniform(0.4, 0.8)
        state = connectivity(void.astype(float), ~void)
        for axis, found in enumerate((state.percolates_x, state.percolates_y)):
            assert found == percolates(void, axis) == floods(void, axis)
            assert found != floods(~void, 1 - axis, corners=True)
        for periodic in (False, True):
            one_by_one = [percolates(void, axis, periodic=periodic) for axis in (0, 1)]
            assert percolates(void, 0, 1, periodic=periodic) is any(one_by_one)


def test_connected_and_trapped_are_all():
    for gap, periodic in ((rough(0.05), False), (rough(0.6), False), (smooth(2, 0.3), True), (smooth(2, 0.9), True)):
        state = connectivity(gap, gap == 0.0, periodic=periodic)
        assert state.connected + state.trapped == pytest.approx(1.0, abs=1e-15)
        assert 0.0 <= state.percolating <= state.connected
        assert state.contact_clusters.sum() == np.count_nonzero(gap == 0.0)
        assert np.all(np.diff(state.contact_clusters) <= 0)


def test_full_contact_has_no_volume_to_share():
    gap = np.zeros((4, 5))
    state = connectivity(gap, gap == 0.0)
    assert np.isnan([state.connected, state.percolating, state.trapped]).all()
    assert not state.percolates_x


# Periods


@pytest.mark.parametrize(("seed", "closed"), [(0, 0.3), (1, 0.3), (2, 0.6)])
def test_clusters_and_pockets_are_those_of_the_plane(seed, closed):
    gap = smooth(seed, closed)
    one = connectivity(gap, gap == 0.0, periodic=True)
    nine = np.tile(gap, (3, 3))
    labels, _ = ndimage.label(nine == 0.0, np.ones((3, 3)))
    inside = [tuple(s.stop - s.start for s in found) for found in ndimage.find_objects(labels)]
    if max(max(size) for size in inside) < min(gap.shape):  # no cluster winds around: count them in the middle
        free = connectivity(nine, nine == 0.0)
        assert set(one.contact_clusters.tolist()) <= set(free.contact_clusters.tolist())
    rolled = np.roll(gap, (13, 5), (0, 1))
    other = connectivity(rolled, rolled == 0.0, periodic=True)
    assert one.contact_clusters.tolist() == other.contact_clusters.tolist()


def test_a_way_that_misses_itself_leads_nowhere():
    stairs = np.zeros((4, 5), dtype=bool)
    stairs[:2, 1] = stairs[1:, 2] = True
    assert percolates(stairs, 0, periodic=True)
    assert not endless(stairs)
    assert endless(np.eye(5) + np.roll(np.eye(5), 1, axis=1) > 0.0)  # goes on in the next period, one column further
