"""Transport through a periodic gap: sides that are joined, and the representative cell."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from roughvol.gap import clusters, quick_estimates, transport

Field = NDArray[np.float64]
SHIFT = (13, 5)


def gap_field(seed: int, closed: float, shape: tuple[int, int] = (24, 20)) -> Field:
    """A smooth periodic gap with a share of closed elements."""
    field = ndimage.gaussian_filter(np.random.default_rng(seed).standard_normal(shape), 2.0, mode="wrap")
    return np.maximum(field - np.quantile(field, closed), 0.0)


def rolled(field: Field) -> Field:
    return np.roll(field, SHIFT, (0, 1))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("seed", range(4))
def test_joined_sides_do_not_depend_on_where_they_are_cut(seed: int, axis: int) -> None:
    """A roll across the flow changes nothing with joined sides."""
    gap = gap_field(seed, 0.5)
    across = np.roll(gap, 7, 1 - axis)
    for quantity in (
        transport.conduction,
        quick_estimates.single_junction,
        transport.constriction,
        clusters.percolates,
    ):
        one, other = (quantity(field, axis, periodic=True) for field in (gap, across))
        assert np.asarray(one[0] if isinstance(one, tuple) else one) == pytest.approx(
            np.asarray(other[0] if isinstance(other, tuple) else other), rel=1e-9
        )


@pytest.mark.parametrize("axis", [0, 1])
def test_an_open_seam_lets_at_least_as_much_through(axis: int) -> None:
    for seed in range(6):
        gap = gap_field(seed, 0.4)
        closed = transport.conduction(gap, axis).coefficient
        assert transport.conduction(gap, axis, periodic=True).coefficient >= closed * (1.0 - 1e-9)


def test_a_way_over_the_seam_counts() -> None:
    gap = np.zeros((4, 5))
    gap[:2, 0], gap[1:, 4] = 1.0, 1.0  # down the first column, over the seam, down the last
    assert not clusters.percolates(gap > 0.0, 0)
    assert clusters.percolates(gap > 0.0, 0, periodic=True)
    assert transport.conduction(gap, 0).coefficient == 0.0
    flow = transport.conduction(gap, 0, periodic=True)
    assert flow.coefficient > 0.0
    assert flow.conservation_error < 1e-12
    assert np.abs(flow.flux[0].sum(axis=1) - flow.flux[0].sum(axis=1)[0]).max() < 1e-12


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("closed", [0.3, 0.6])
def test_clusters_and_pockets_are_those_of_the_plane(seed: int, closed: float) -> None:
    gap = gap_field(seed, closed)
    one = clusters.connectivity(gap, gap == 0.0, periodic=True)
    nine = np.tile(gap, (3, 3))
    labels, _ = ndimage.label(nine == 0.0, np.ones((3, 3)))
    inside = [tuple(s.stop - s.start for s in found) for found in ndimage.find_objects(labels)]
    assert one.connected + one.trapped == pytest.approx(1.0)
    assert one.contact_clusters.sum() == np.count_nonzero(gap == 0.0)
    if max(max(size) for size in inside) < min(gap.shape):  # no cluster winds around: count them in the middle
        free = clusters.connectivity(nine, nine == 0.0)
        assert set(one.contact_clusters.tolist()) <= set(free.contact_clusters.tolist())
    other = clusters.connectivity(rolled(gap), rolled(gap) == 0.0, periodic=True)
    assert one.contact_clusters.tolist() == other.contact_clusters.tolist()


def test_cell_of_layers_and_plates() -> None:
    """Layers across the flow: the harmonic mean of k; along it: the arithmetic one."""
    layers = np.ones((8, 6))
    layers[3] = 0.5
    assert transport.cell_conduction(np.full((5, 7), 3.0), 1) == pytest.approx(1.0)
    for exponent in (1.0, 3.0):
        k = layers**exponent
        plates = layers.mean() ** exponent
        assert transport.cell_conduction(layers, 0, exponent) * plates == pytest.approx(1.0 / np.mean(1.0 / k))
        assert transport.cell_conduction(layers, 1, exponent) * plates == pytest.approx(k.mean())


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("seed", range(3))
def test_cell_is_the_limit_of_many_periods_and_has_no_origin(seed: int, axis: int) -> None:
    gap = gap_field(seed, 0.35)
    cell = transport.cell_conduction(gap, axis)
    assert transport.cell_conduction(rolled(gap), axis) == pytest.approx(cell, rel=1e-9)
    few, many = (
        transport.conduction(np.tile(gap, (n, 1) if axis == 0 else (1, n)), axis, periodic=True).coefficient
        for n in (4, 8)
    )
    assert 2.0 / (2.0 / many - 1.0 / few) / 2.0 == pytest.approx(cell, rel=2e-2, abs=1e-12)
    assert transport.cell_conduction(gap.T, 1 - axis) == pytest.approx(cell, rel=1e-12)


def test_a_way_that_misses_itself_leads_nowhere() -> None:
    stairs = np.zeros((4, 5))
    stairs[:2, 1], stairs[1:, 2] = 1.0, 1.0
    assert clusters.percolates(stairs > 0.0, 0, periodic=True)
    assert not clusters.endless(stairs > 0.0)
    assert transport.cell_conduction(stairs, 0) == 0.0
    helix = np.eye(5) + np.roll(np.eye(5), 1, axis=1)  # goes on in the next period, one column further
    assert clusters.endless(helix > 0.0)
    assert transport.cell_conduction(helix, 0) > 0.0


def test_decades_of_conductance() -> None:
    """A narrow strait of 1e-4 in wide water carries the flow of one junction."""
    gap = np.ones((12, 12))
    gap[5], gap[5, 4] = 0.0, 1e-4
    k = transport.cell_conduction(gap, 0) * gap.mean() ** 3
    assert k == pytest.approx(2e-12 / 2.0, rel=1e-6)
