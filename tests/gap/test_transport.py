"""Transport: brute-force searches, closed forms of the flow, symmetries, periods, and extreme contrasts."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.errors import ContactError
from roughvol.gap import clusters
from roughvol.gap.constriction import constriction
from roughvol.gap.gas import conduction_of_gas
from roughvol.gap.quick_estimates import effective_medium, single_junction
from roughvol.gap.transport import cell_conduction, conduction
from tests.gap.kit import floods, rough, smooth, straits
from tests.refused import refusals

RANDOM = np.random.Generator(np.random.PCG64(11))


def by_elimination(gap, exponent):
    """Return the coefficient along x by replacing stars of conductances with meshes: no difference is ever taken."""
    k, (rows, columns) = gap**exponent, gap.shape
    number = np.arange(gap.size).reshape(gap.shape)
    mesh = np.zeros((gap.size + 2, gap.size + 2))
    down, across = (number[:-1], number[1:], k[:-1], k[1:]), (number[:, :-1], number[:, 1:], k[:, :-1], k[:, 1:])
    for a, b, ka, kb in (down, across):
        mesh[a, b] = mesh[b, a] = 2.0 / (1.0 / ka + 1.0 / kb)
    for reservoir, line in ((-2, 0), (-1, -1)):
        mesh[reservoir, number[line]] = mesh[number[line], reservoir] = 2.0 * k[line]
    for node in range(gap.size):
        star = mesh[node, node + 1 :]
        mesh[node + 1 :, node + 1 :] += np.outer(star, star) / star.sum()
        np.fill_diagonal(mesh, 0.0)
    return float(mesh[-1, -2] / (gap.mean() ** exponent * columns / rows))


# Where it is narrowest


def test_critical_constriction_is_the_brute_force_one():
    for trial in range(24):
        random, axis = np.random.default_rng(trial // 2), trial % 2
        gap = np.maximum(random.integers(-2, 12, random.integers(1, 11, 2)), 0).astype(float)  # with ties
        levels = [level for level in np.unique(gap[gap > 0.0]) if floods(gap >= level, axis)]
        found = constriction(gap, axis)
        assert found.gap == max(levels, default=0.0)
        if found.element is not None:
            assert gap[found.element] == found.gap
            assert not floods(gap > found.gap, axis)
            gap[found.element] *= 0.5
            assert constriction(gap, axis).gap <= found.gap


# How much flows: closed forms


@pytest.mark.parametrize(("axis", "exponent"), [(0, 3.0), (1, 1.0)])
def test_plane_gap(axis, exponent):
    for shape in ((1, 1), (1, 6), (9, 4), (16, 16)):
        flow = conduction(np.full(shape, 0.37), axis, exponent)
        assert flow.coefficient == pytest.approx(1.0, rel=1e-13)
        assert flow.conservation_error < 1e-13
        assert_allclose(flow.flux[axis], 1.0, rtol=1e-13)
        assert_allclose(flow.flux[1 - axis], 0.0, atol=1e-13)
    assert cell_conduction(np.full((5, 7), 3.0), axis, exponent) == pytest.approx(1.0)


def test_channel_between_walls():
    gap = np.zeros((12, 10))
    gap[:, 3:7] = 0.2
    # a width of 4 of 10 elements, and a mean gap 0.4 times that of the channel
    assert conduction(gap, 0).coefficient == pytest.approx(0.4 / 0.4**3, rel=1e-13)
    assert conduction(gap, 0, 1.0).coefficient == pytest.approx(1.0, rel=1e-13)
    assert conduction(gap, 1).coefficient == conduction(0.0 * gap, 0).coefficient == 0.0


@pytest.mark.parametrize("exponent", [1.0, 3.0])
def test_waves_along_and_across_the_flow(exponent):
    wave = 1.0 + 0.9 * np.sin(2 * np.pi * (np.arange(40) + 0.5) / 40)
    gap = np.repeat(wave[:, None], 7, axis=1)
    k = wave**exponent / wave.mean() ** exponent
    for flow in (
        lambda axis: conduction(gap, axis, exponent).coefficient,
        lambda axis: cell_conduction(gap, axis, exponent),
    ):
        # the interior faces are harmonic means of neighbours and the outer halves their own: together exactly Σ 1/k
        assert flow(0) == pytest.approx(1.0 / np.mean(1.0 / k), rel=1e-10)
        assert flow(1) == pytest.approx(np.mean(k), rel=1e-10)


def test_checkerboard_of_two_gaps_tends_to_the_geometric_mean():
    low, high, errors = 1.0, 4.0, []
    for size in (2, 4, 8, 16):
        gap = np.where((np.indices((8 * size, 8 * size)) // size).sum(axis=0) % 2, low, high)
        errors.append(abs(conduction(gap, 0, 1.0).coefficient * gap.mean() - np.sqrt(low * high)))
        # Bruggeman's estimate is exact here
        assert effective_medium(gap, 1.0) * gap.mean() == pytest.approx(np.sqrt(low * high), rel=1e-12)
    assert all(fine < 0.62 * coarse for coarse, fine in pairwise(errors))
    assert errors[-1] < 0.011 * np.sqrt(low * high)


def gaps_of_another_code():
    """Return gaps of different kinds: waves, steps, channels, straits, random fields, and rough surfaces."""
    i, j = (np.indices((32, 32)) + 0.5) / 32
    random = np.random.default_rng(5)
    strait = np.ones((32, 32))
    strait[15:18] = 0.0
    strait[15:18, 9:12] = 0.2
    gaps = {
        "plane": np.full((32, 32), 0.3),
        "wedge": 1.0 - 0.8 * i,
        "wave along": 1.0 + 0.9 * np.sin(2 * np.pi * i),
        "wave across": 1.0 + 0.9 * np.sin(2 * np.pi * j),
        "egg box": 1.1 + np.sin(4 * np.pi * i) * np.cos(2 * np.pi * j),
        "steps": np.where(i < 0.5, 1.0, 0.1),
        "checkerboard": np.where((np.indices((32, 32)) // 4).sum(axis=0) % 2, 1.0, 0.2),
        "strait": strait,
        "islands": np.where((i * 4 % 1 - 0.5) ** 2 + (j * 4 % 1 - 0.5) ** 2 < 0.1, 0.0, 1.0),
        "uniform random": random.uniform(0.1, 1.0, (32, 32)),
        "lognormal": np.exp(random.normal(0.0, 0.5, (32, 32))),
    }
    return gaps | {f"rough, {share:.0%} closed": rough(share, 1) for share in (0.0, 0.05, 0.15, 0.25)}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of what it imports
@pytest.mark.parametrize("kind", gaps_of_another_code())
def test_another_code_finds_the_same_flow(kind):
    other = pytest.importorskip("reynoldsflow.transport", reason="pip install 'roughvol[crosscheck]'")
    gap = gaps_of_another_code()[kind]
    gap[:, 0] = 0.0  # a wall: periodic sideways is then closed sideways
    filtered, _, flux = other.solve_fluid_problem(gap)
    total = abs(np.atleast_1d(other.compute_total_flux(filtered, flux, len(gap)))[0])
    assert total == pytest.approx(conduction(gap, 0).coefficient * gap.mean() ** 3 * gap.shape[1] / len(gap), rel=1e-7)


# Laws


@pytest.mark.parametrize(("share", "exponent"), [(0.0, 1.0), (0.35, 3.0)])
def test_mirror_and_quarter_turn(share, exponent):
    gap = rough(share, 5)[:, :25]
    found = conduction(gap, 0, exponent)
    for other, axis in ((gap[::-1], 0), (gap[:, ::-1], 0), (gap.T, 1), (np.rot90(gap), 1)):
        turned = conduction(np.ascontiguousarray(other), axis, exponent)
        assert turned.coefficient == pytest.approx(found.coefficient, rel=1e-11)
        assert constriction(other, axis).gap == constriction(gap, 0).gap
        assert single_junction(other, axis) == pytest.approx(single_junction(gap, 0), rel=1e-12)
    assert_allclose(conduction(gap.T, 1, exponent).flux, found.flux[::-1].transpose(0, 2, 1), rtol=1e-9, atol=1e-12)


def test_neither_unit_of_length_nor_underflow_matters():
    gap = rough(0.25, 2)
    for unit in (1e-200, 1e200):
        assert conduction(unit * gap, 0).coefficient == pytest.approx(conduction(gap, 0).coefficient, rel=1e-10)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_narrower_gap_lets_less_through_and_what_flows_in_flows_through_every_line(axis):
    gap, flows, critical = rough(0.1, 1), [], []
    for closing in (0.0, 0.1, 0.3, 0.6):
        gap = np.maximum(gap - closing * gap.mean() * RANDOM.random(gap.shape), 0.0)
        flow = conduction(gap, axis)
        flows.append(flow.coefficient * gap.mean() ** 3)
        critical.append(constriction(gap, axis).gap)
        assert flow.conservation_error < 1e-12
        assert_allclose(flow.flux[axis].mean(axis=1 - axis), flow.coefficient, rtol=1e-12)
        assert not flow.flux[:, gap == 0.0].any()
    assert all(later < earlier for earlier, later in pairwise(flows))
    assert all(later <= earlier for earlier, later in pairwise(critical))


# Periods


@pytest.mark.parametrize("axis", [0, 1])
def test_joined_sides_do_not_depend_on_where_they_are_cut_and_let_more_through(axis):
    """A roll across the flow changes nothing with joined sides."""
    for seed in range(4):
        gap = smooth(seed, 0.45)
        across = np.roll(gap, 7, 1 - axis)
        for quantity in (conduction, constriction, clusters.percolates):
            one, other = (quantity(field, axis, periodic=True) for field in (gap, across))
            pair = [getattr(each, "coefficient", getattr(each, "gap", each)) for each in (one, other)]
            assert pair[0] == pytest.approx(pair[1], rel=1e-9)
        closed = conduction(gap, axis).coefficient
        assert conduction(gap, axis, periodic=True).coefficient >= closed * (1.0 - 1e-9)


def test_a_way_over_the_seam_counts():
    gap = np.zeros((4, 5))
    gap[:2, 0], gap[1:, 4] = 1.0, 1.0  # down the first column, over the seam, down the last
    assert not clusters.percolates(gap > 0.0, 0)
    assert clusters.percolates(gap > 0.0, 0, periodic=True)
    assert conduction(gap, 0).coefficient == 0.0
    flow = conduction(gap, 0, periodic=True)
    assert flow.coefficient > 0.0
    assert flow.conservation_error < 1e-12
    assert np.abs(flow.flux[0].sum(axis=1) - flow.flux[0].sum(axis=1)[0]).max() < 1e-12


@pytest.mark.parametrize(("seed", "axis"), [(0, 0), (1, 1)])
def test_cell_is_the_limit_of_many_periods_and_has_no_origin(seed, axis):
    gap = smooth(seed, 0.35)
    cell = cell_conduction(gap, axis)
    assert cell_conduction(np.roll(gap, (13, 5), (0, 1)), axis) == pytest.approx(cell, rel=1e-9)
    tiled = [np.tile(gap, (n, 1) if axis == 0 else (1, n)) for n in (4, 8)]
    few, many = (conduction(field, axis, periodic=True).coefficient for field in tiled)
    assert 2.0 / (2.0 / many - 1.0 / few) / 2.0 == pytest.approx(cell, rel=2e-2, abs=1e-12)
    assert cell_conduction(gap.T, 1 - axis) == pytest.approx(cell, rel=1e-12)


def test_a_cell_needs_a_way_without_end():
    stairs = np.zeros((4, 5))
    stairs[:2, 1], stairs[1:, 2] = 1.0, 1.0
    assert cell_conduction(stairs, 0) == 0.0
    assert cell_conduction(np.eye(5) + np.roll(np.eye(5), 1, axis=1), 0) > 0.0


# Extremes


def test_contrast_of_many_decades_against_elimination_without_differences():
    for decades, seed in ((2, 0), (6, 1), (12, 2), (12, 3)):
        gap = 10.0 ** (decades * np.random.default_rng(seed).uniform(-1.0, 0.0, (11, 9)))  # g³: up to 36 decades
        tolerance = 1e-5 if decades > 2 else 1e-12
        assert conduction(gap, 0).coefficient == pytest.approx(by_elimination(gap, 3.0), rel=tolerance)


def test_a_groove_with_a_ridge_conducts_too_little_by_1e_7_for_each_element():
    groove = np.full((400, 3), 1e4)
    groove[200] = 1.0
    in_series = 1.0 / np.mean((groove.mean() / groove[:, 0]) ** 3)
    of_gas = conduction_of_gas(groove, 0, "viscous", 0.0, 0.5, accuracy=1e-9)
    for flow in (conduction(groove, 0, accuracy=1e-9), of_gas):
        assert 0.9 < (1.0 - flow.coefficient / in_series) / 400e-7 < 1.0


@pytest.mark.parametrize("narrow", [1e-1, 1e-5])
def test_lakes_joined_by_narrow_straits_keep_their_flow(narrow):
    gap = straits(narrow)
    flow = conduction(gap, 0)
    assert flow.coefficient == pytest.approx(by_elimination(np.where(gap, gap, 1e-60), 3.0), rel=1e-6)
    assert flow.conservation_error < 1e-7
    # two straits, each a square of k between two wide elements: 1/(2k) on either side of its centre
    if narrow < 1e-2:
        assert flow.coefficient == pytest.approx(0.5 * single_junction(gap, 0), rel=1e-6)


def test_a_narrow_strait_of_a_cell_carries_the_flow_of_one_junction():
    gap = np.ones((12, 12))
    gap[5], gap[5, 4] = 0.0, 1e-4
    assert cell_conduction(gap, 0) * gap.mean() ** 3 == pytest.approx(2e-12 / 2.0, rel=1e-6, abs=0.0)


test_refused = refusals(
    ContactError,
    (lambda: constriction(np.ones(4), 0), "2-D field"),
    (lambda: conduction(np.array([[1.0, -2.0]]), 0), "minimum -2"),
    (lambda: conduction(np.array([[1.0, np.nan]]), 0), "finite"),
)
