"""Transport: hand-drawn voids, brute-force searches, closed forms of the flow, symmetries, and extreme contrasts."""

from __future__ import annotations

import time
from collections import deque
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from roughvol.errors import ContactError
from roughvol.gap.clusters import connectivity, percolates
from roughvol.gap.quick_estimates import CLOSES_AT, effective_medium, single_junction
from roughvol.gap.transport import conduction, constriction
from roughvol.surfaces.midpoint import random_midpoint_displacement

Field = NDArray[np.float64]
RANDOM = np.random.Generator(np.random.PCG64(11))


def drawn(text: str) -> Field:
    """Return a gap field from a drawing: # closed, . open by 1, a digit open by so much."""
    rows = text.split()
    return np.array([[{"#": 0.0, ".": 1.0}.get(c) if c in "#." else float(c) for c in row] for row in rows])


def rough(share: float, seed: int = 0, m: int = 5) -> Field:
    """Return the gap over a rough surface cut off so that a share of it is closed."""
    z = random_midpoint_displacement(2.4, m, seed=seed).heights
    return np.maximum(np.quantile(z, 1.0 - share) - z, 0.0)


def floods(void: NDArray[np.bool_], axis: int, *, corners: bool = False) -> bool:
    """Walk from element to element through their sides, or through corners as well."""
    steps = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if abs(a) + abs(b) == 1 or (corners and a and b)]
    void = void if axis == 0 else void.T
    wet = {(0, int(column)) for column in np.flatnonzero(void[0])}
    queue = deque(wet)
    while queue:
        row, column = queue.popleft()
        if row == len(void) - 1:
            return True
        for near in ((row + a, column + b) for a, b in steps):
            inside = 0 <= near[0] < void.shape[0] and 0 <= near[1] < void.shape[1]
            if inside and void[near] and near not in wet:
                wet.add(near)
                queue.append(near)
    return False


def by_elimination(gap: Field, exponent: float) -> float:
    """Return the coefficient along x by replacing stars of conductances with meshes: no difference is ever taken."""
    k, (rows, columns) = gap**exponent, gap.shape
    number = np.arange(gap.size).reshape(gap.shape)
    mesh = np.zeros((gap.size + 2, gap.size + 2))
    for a, b, ka, kb in (
        (number[:-1], number[1:], k[:-1], k[1:]),
        (number[:, :-1], number[:, 1:], k[:, :-1], k[:, 1:]),
    ):
        mesh[a, b] = mesh[b, a] = 2.0 / (1.0 / ka + 1.0 / kb)
    for reservoir, line in ((-2, 0), (-1, -1)):
        mesh[reservoir, number[line]] = mesh[number[line], reservoir] = 2.0 * k[line]
    for node in range(gap.size):
        star = mesh[node, node + 1 :]
        mesh[node + 1 :, node + 1 :] += np.outer(star, star) / star.sum()
        np.fill_diagonal(mesh, 0.0)
    return float(mesh[-1, -2] / (gap.mean() ** exponent * columns / rows))


# What hangs together

SPIRAL = """
.##########
.#.......##
.#.#####.##
.#.#...#.##
.#.###.#.##
.#.....#.##
.#######.##
.........##
###########
"""
DIAGONAL = """
#...
.#..
..#.
...#
"""
RING = """
.......
.#####.
.#...#.
.#.#.#.
.#...#.
.#####.
.......
"""


def test_a_spiral_reaches_one_side_only() -> None:
    gap = drawn(SPIRAL)
    state = connectivity(gap, gap == 0.0)
    assert (state.percolates_x, state.percolates_y) == (False, False)
    assert (state.connected, state.percolating, state.trapped) == (1.0, 0.0, 0.0)
    assert state.trapped_pockets.size == 0
    opened = gap.copy()
    opened[4, 4:9] = 1.0  # from its heart through the windings
    opened[4, 9:] = 1.0
    assert connectivity(opened, opened == 0.0).percolates_y
    gap[0, 0] = gap[1:, 0] = 0.0
    assert_array_equal(connectivity(gap, gap == 0.0).trapped_pockets, [np.count_nonzero(gap)])


@pytest.mark.parametrize("turn", [np.asarray, np.fliplr])
def test_a_diagonal_of_contacts_is_one_cluster_and_a_barrier(turn) -> None:
    gap = turn(drawn(DIAGONAL))
    state = connectivity(gap, gap == 0.0)
    assert_array_equal(state.contact_clusters, [4])
    assert (state.percolates_x, state.percolates_y) == (False, False)
    assert (conduction(gap, 0).coefficient, conduction(gap, 1).coefficient) == (0.0, 0.0)
    assert state.connected == 1.0


def test_a_ring_traps_what_is_inside() -> None:
    gap = drawn(RING)
    state = connectivity(gap, gap == 0.0)
    assert_array_equal(state.contact_clusters, [16, 1])
    assert_array_equal(state.trapped_pockets, [8])
    assert_allclose([state.trapped, state.percolating], [8 / 32, 24 / 32], rtol=1e-15)
    gap[2:5, 2:5] *= 3.0  # volumes count, not elements
    state = connectivity(gap, gap == 0.0)
    assert_allclose([state.trapped, state.connected], [24 / 48, 24 / 48], rtol=1e-15)


@pytest.mark.parametrize("shape", [(6, 6), (7, 4)])
def test_void_does_not_percolate_through_corners(shape) -> None:
    gap = (np.indices(shape).sum(axis=0) % 2).astype(float)
    state = connectivity(gap, gap == 0.0)
    assert not state.percolates_x
    assert not state.percolates_y
    assert_array_equal(state.contact_clusters, [np.count_nonzero(gap == 0.0)])
    assert_array_equal(np.unique(state.trapped_pockets), [1])


@pytest.mark.parametrize("seed", range(40))
def test_percolation_is_what_a_search_finds_and_void_and_solid_exclude_each_other(seed) -> None:
    random = np.random.default_rng(seed)
    void = random.random(random.integers(1, 12, 2)) < random.uniform(0.4, 0.8)
    state = connectivity(void.astype(float), ~void)
    for axis, found in enumerate((state.percolates_x, state.percolates_y)):
        assert found == percolates(void, axis) == floods(void, axis)
        assert found != floods(~void, 1 - axis, corners=True)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.9])
@pytest.mark.parametrize("seed", range(3))
def test_connected_and_trapped_are_all(share, seed) -> None:
    gap = rough(share, seed)
    state = connectivity(gap, gap == 0.0)
    assert state.connected + state.trapped == pytest.approx(1.0, abs=1e-15)
    assert 0.0 <= state.percolating <= state.connected
    assert state.contact_clusters.sum() == np.count_nonzero(gap == 0.0)
    assert np.all(np.diff(state.contact_clusters) <= 0)


def test_full_contact_has_no_volume_to_share() -> None:
    gap = np.zeros((4, 5))
    state = connectivity(gap, gap == 0.0)
    assert np.isnan([state.connected, state.percolating, state.trapped]).all()
    assert (state.percolates_x, constriction(gap, 0).gap, conduction(gap, 0).coefficient) == (False, 0.0, 0.0)
    assert (effective_medium(gap), single_junction(gap, 1)) == (0.0, 0.0)


# Where it is narrowest


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("axis", [0, 1])
def test_critical_constriction_is_the_brute_force_one(seed, axis) -> None:
    random = np.random.default_rng(seed)
    gap = np.maximum(random.integers(-2, 12, random.integers(1, 11, 2)), 0).astype(float)  # with ties
    levels = [level for level in np.unique(gap[gap > 0.0]) if floods(gap >= level, axis)]
    found = constriction(gap, axis)
    assert found.gap == max(levels, default=0.0)
    if found.element is not None:
        assert gap[found.element] == found.gap
        beyond = gap > found.gap
        assert not floods(beyond, axis)
        narrowed = gap.copy()
        narrowed[found.element] = 0.5 * found.gap
        assert constriction(narrowed, axis).gap <= found.gap


def test_critical_constriction_of_distinct_gaps_carries_every_wide_path() -> None:
    gap = rough(0.2, 3)
    found = constriction(gap, 0)
    wider = gap >= found.gap
    assert floods(wider, 0)
    wider[found.element] = False
    assert not floods(wider, 0)


# How much flows: closed forms


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("exponent", [1.0, 3.0])
@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (9, 4), (16, 16)])
def test_plane_gap(shape, exponent, axis) -> None:
    flow = conduction(np.full(shape, 0.37), axis, exponent)
    assert flow.coefficient == pytest.approx(1.0, rel=1e-13)
    assert flow.conservation_error < 1e-13
    assert_allclose(flow.flux[axis], 1.0, rtol=1e-13)
    assert_allclose(flow.flux[1 - axis], 0.0, atol=1e-13)
    assert effective_medium(np.full(shape, 0.37), exponent) == pytest.approx(1.0, rel=1e-12)


def test_channel_between_walls() -> None:
    gap = np.zeros((12, 10))
    gap[:, 3:7] = 0.2
    # a width of 4 of 10 elements, and a mean gap 0.4 times that of the channel
    assert conduction(gap, 0).coefficient == pytest.approx(0.4 / 0.4**3, rel=1e-13)
    assert conduction(gap, 0, 1.0).coefficient == pytest.approx(1.0, rel=1e-13)
    assert conduction(gap, 1).coefficient == 0.0


@pytest.mark.parametrize("exponent", [1.0, 3.0])
def test_waves_along_and_across_the_flow(exponent) -> None:
    wave = 1.0 + 0.9 * np.sin(2 * np.pi * (np.arange(40) + 0.5) / 40)
    gap = np.repeat(wave[:, None], 7, axis=1)
    k = wave**exponent / wave.mean() ** exponent
    # the interior faces are harmonic means of neighbours and the outer halves their own: together exactly Σ 1/k
    assert conduction(gap, 0, exponent).coefficient == pytest.approx(1.0 / np.mean(1.0 / k), rel=1e-12)
    assert conduction(gap, 1, exponent).coefficient == pytest.approx(np.mean(k), rel=1e-12)


def test_wave_tends_to_the_integral() -> None:
    errors = []
    for n in (50, 100, 200):
        wave = 1.0 + 0.5 * np.sin(2 * np.pi * (np.arange(n) + 0.5) / n)
        integral = (1 - 0.25) ** 2.5 / (1 + 0.5 * 0.25)  # 1/∫ (1 + a sin)^-3 = (1 - a²)^(5/2)/(1 + a²/2)
        errors.append(abs(conduction(wave[:, None], 0).coefficient / integral - 1.0))
    assert max(errors) < 1e-12  # the midpoint rule is exact to rounding for a periodic integrand


def test_checkerboard_of_two_gaps_tends_to_the_geometric_mean() -> None:
    low, high = 1.0, 4.0
    errors, means = [], []
    for size in (2, 4, 8, 16):
        fields = np.indices((8 * size, 8 * size)) // size
        gap = np.where(fields.sum(axis=0) % 2, low, high)
        coefficient = conduction(gap, 0, 1.0).coefficient * gap.mean()
        errors.append(abs(coefficient - np.sqrt(low * high)))
        means.append(effective_medium(gap, 1.0) * gap.mean())
    assert all(fine < 0.62 * coarse for coarse, fine in pairwise(errors))
    assert errors[-1] < 0.011 * np.sqrt(low * high)
    assert_allclose(means, np.sqrt(low * high), rtol=1e-12)  # Bruggeman's estimate is exact here


def test_dead_ends_and_pockets_do_not_conduct() -> None:
    gap = drawn(".#### .###9 ..9#9 .#### .####")
    straight = drawn(".#### .#### .#### .#### .####")
    ratio = gap.mean() / straight.mean()
    assert conduction(gap, 0, 3.0).coefficient * ratio**3 == pytest.approx(
        conduction(straight, 0, 3.0).coefficient, rel=1e-6
    )


def gaps_of_another_code() -> dict[str, Field]:
    """Return 15 gaps of different kinds: waves, steps, channels, straits, random fields, and rough surfaces."""
    i, j = (np.indices((32, 32)) + 0.5) / 32
    random = np.random.default_rng(5)
    wedge, strait = 1.0 - 0.8 * i, np.ones((32, 32))
    strait[15:18] = 0.0
    strait[15:18, 9:12] = 0.2
    islands = np.where((i * 4 % 1 - 0.5) ** 2 + (j * 4 % 1 - 0.5) ** 2 < 0.1, 0.0, 1.0)
    gaps = {
        "plane": np.full((32, 32), 0.3),
        "wedge": wedge,
        "wave along": 1.0 + 0.9 * np.sin(2 * np.pi * i),
        "wave across": 1.0 + 0.9 * np.sin(2 * np.pi * j),
        "egg box": 1.1 + np.sin(4 * np.pi * i) * np.cos(2 * np.pi * j),
        "steps": np.where(i < 0.5, 1.0, 0.1),
        "checkerboard": np.where((np.indices((32, 32)) // 4).sum(axis=0) % 2, 1.0, 0.2),
        "strait": strait,
        "islands": islands,
        "uniform random": random.uniform(0.1, 1.0, (32, 32)),
        "lognormal": np.exp(random.normal(0.0, 0.5, (32, 32))),
    }
    return gaps | {f"rough, {share:.0%} closed": rough(share, 1) for share in (0.0, 0.05, 0.15, 0.25)}


@pytest.mark.filterwarnings("ignore")  # of what it imports
@pytest.mark.parametrize("kind", gaps_of_another_code())
def test_another_code_finds_the_same_flow(kind) -> None:
    other = pytest.importorskip("reynoldsflow.transport", reason="pip install 'roughvol[crosscheck]'")
    gap = gaps_of_another_code()[kind]
    gap[:, 0] = 0.0  # a wall: periodic sideways is then closed sideways
    filtered, _, flux = other.solve_fluid_problem(gap)
    total = abs(np.atleast_1d(other.compute_total_flux(filtered, flux, len(gap)))[0])
    assert total == pytest.approx(conduction(gap, 0).coefficient * gap.mean() ** 3 * gap.shape[1] / len(gap), rel=1e-7)


# Laws


@pytest.mark.parametrize("exponent", [1.0, 3.0])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.35])
def test_mirror_and_quarter_turn(share, exponent) -> None:
    gap = rough(share, 5)[:, :25]
    found = conduction(gap, 0, exponent)
    for other, axis in ((gap[::-1], 0), (gap[:, ::-1], 0), (gap.T, 1), (np.rot90(gap), 1)):
        turned = conduction(np.ascontiguousarray(other), axis, exponent)
        assert turned.coefficient == pytest.approx(found.coefficient, rel=1e-11)
        assert constriction(other, axis).gap == constriction(gap, 0).gap
        assert single_junction(other, axis) == pytest.approx(single_junction(gap, 0), rel=1e-12)
    assert_allclose(conduction(gap.T, 1, exponent).flux, found.flux[::-1].transpose(0, 2, 1), rtol=1e-9, atol=1e-12)
    contact = gap == 0.0
    here, there = connectivity(gap, contact), connectivity(np.rot90(gap), np.rot90(contact))
    assert (here.percolates_x, here.percolates_y) == (there.percolates_y, there.percolates_x)
    assert_array_equal(here.contact_clusters, there.contact_clusters)


def test_neither_unit_of_length_nor_underflow_matters() -> None:
    gap = rough(0.25, 2)
    for unit in (1e-200, 1e200):
        assert conduction(unit * gap, 0).coefficient == pytest.approx(conduction(gap, 0).coefficient, rel=1e-10)
        assert effective_medium(unit * gap) == pytest.approx(effective_medium(gap), rel=1e-10)
        assert single_junction(unit * gap, 0) == pytest.approx(single_junction(gap, 0), rel=1e-12)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_narrower_gap_lets_less_through(axis) -> None:
    wide = rough(0.1, 1)
    flows, critical = [], []
    for closing in (0.0, 0.1, 0.3, 0.6):
        gap = np.maximum(wide - closing * wide.mean() * RANDOM.random(wide.shape), 0.0)
        wide = gap
        flows.append(conduction(gap, axis).coefficient * gap.mean() ** 3)
        critical.append(constriction(gap, axis).gap)
    assert all(later < earlier for earlier, later in pairwise(flows))
    assert all(later <= earlier for earlier, later in pairwise(critical))


@pytest.mark.parametrize("axis", [0, 1])
def test_what_flows_in_flows_through_every_line_and_out(axis) -> None:
    flow = conduction(rough(0.3, 4), axis)
    assert flow.conservation_error < 1e-12
    assert_allclose(flow.flux[axis].mean(), flow.coefficient, rtol=1e-12)
    lines = flow.flux[axis].mean(axis=1 - axis)
    assert_allclose(lines, flow.coefficient, rtol=1e-12)
    assert not flow.flux[:, rough(0.3, 4) == 0.0].any()


def test_coefficients_lie_between_series_and_parallel() -> None:
    gap = rough(0.0, 6) + 0.1
    for exponent in (1.0, 3.0):
        k = gap**exponent / gap.mean() ** exponent
        assert 1 / np.mean(1 / k) < conduction(gap, 0, exponent).coefficient < np.mean(k)
        assert 1 / np.mean(1 / k) < effective_medium(gap, exponent) < np.mean(k)


# Extremes


@pytest.mark.parametrize("decades", [2, 6, 12])
@pytest.mark.parametrize("seed", range(4))
def test_contrast_of_many_decades_against_elimination_without_differences(decades, seed) -> None:
    gap = 10.0 ** (decades * np.random.default_rng(seed).uniform(-1.0, 0.0, (11, 9)))  # g³: up to 36 decades
    exact = by_elimination(gap, 3.0)
    assert conduction(gap, 0).coefficient == pytest.approx(exact, rel=1e-5 if decades > 2 else 1e-12)


@pytest.mark.parametrize("narrow", [1e-1, 1e-2, 1e-3, 1e-5])
def test_lakes_joined_by_narrow_straits_keep_their_flow(narrow) -> None:
    gap = np.ones((30, 10))
    gap[[9, 20]] = 0.0
    gap[9, 2] = gap[20, 7] = narrow
    flow = conduction(gap, 0)
    assert flow.coefficient == pytest.approx(by_elimination(np.where(gap, gap, 1e-60), 3.0), rel=1e-6)
    assert flow.conservation_error < 1e-7
    # two straits, each a square of k between two wide elements: 1/(2k) on either side of its centre
    if narrow < 1e-2:
        assert flow.coefficient == pytest.approx(0.5 * single_junction(gap, 0), rel=1e-6)


def test_a_grid_of_the_paper_takes_well_under_a_second() -> None:
    gap = rough(0.25, 1, m=8)
    times = []
    for _ in range(2):
        started = time.process_time()
        flow = conduction(gap, 0)
        times.append(time.process_time() - started)
    assert flow.conservation_error < 1e-12
    assert min(times) < 1.0


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: constriction(np.ones(4), 0), "2-D field"),
        (lambda: conduction(np.array([[1.0, -2.0]]), 0), "minimum -2"),
        (lambda: conduction(np.array([[1.0, np.nan]]), 0), "finite"),
        (lambda: conduction(np.ones((3, 3)), 0, 0.0), "exponent must be > 0, got 0.0"),
        (lambda: effective_medium(np.ones((3, 3)), -1.0), "exponent"),
        (lambda: connectivity(np.ones((3, 3)), np.ones((3, 3), dtype=bool)), "gap 0"),
        (lambda: connectivity(np.ones((3, 3)), np.zeros((3, 2), dtype=bool)), "shape"),
    ],
)
def test_refused(call, words) -> None:
    with pytest.raises(ContactError, match=words):
        call()


# Quick estimates


def test_the_corrected_medium_closes_where_it_is_told_to() -> None:
    gap = np.ones((20, 20))
    for closed, flows in ((0.40, True), (0.43, False)):
        gap.ravel()[: round(closed * 400)] = 0.0
        assert (effective_medium(gap, closes_at=CLOSES_AT) > 0.0) == flows
        assert effective_medium(gap) > 0.0


def test_half_as_threshold_is_the_equation_of_bruggeman() -> None:
    for share in (0.05, 0.3):
        gap = rough(share, 1)
        near = effective_medium(gap, closes_at=0.5 + 1e-12)
        assert near == pytest.approx(effective_medium(gap), rel=1e-8)


def test_the_corrected_medium_solves_its_equation() -> None:
    gap, s = rough(0.2, 2), CLOSES_AT / (1 - CLOSES_AT)
    k, effective = gap**3, effective_medium(gap, closes_at=CLOSES_AT) * gap.mean() ** 3
    assert np.mean((k - effective) / (k + s * effective)) == pytest.approx(0.0, abs=1e-9)


def test_a_medium_of_one_gap_has_its_flow() -> None:
    assert effective_medium(np.full((4, 4), 0.3), closes_at=CLOSES_AT) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("closes_at", [0.0, 1.0])
def test_a_threshold_outside_its_range_is_refused(closes_at) -> None:
    with pytest.raises(ContactError, match="closes_at"):
        effective_medium(np.ones((3, 3)), closes_at=closes_at)
