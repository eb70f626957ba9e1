"""The surface record, and random midpoint displacement against a plain loop fed with the same stream."""

from __future__ import annotations

import itertools
import pickle

import numpy as np
import pytest

from roughvol.errors import SurfaceError
from roughvol.surfaces.midpoint import midpoint_levels, random_midpoint_displacement
from roughvol.surfaces.surface import Surface

BUMP = np.add.outer([0.0, 1.0, 0.0, 2.0], [0.0, 3.0, 1.0])


def deviation(half_step, D, law):
    if law == "std":
        return (1 / np.sqrt(0.09)) / (2 ** ((3 - D) / 2)) ** half_step
    return np.sqrt((1 / np.sqrt(0.09)) / (2 ** ((3 - D) / 2)) ** half_step)


def displaced_by_loops(D, m, seed, law):
    """Node by node, in the order the seed means, each mean taken over the neighbours that exist."""
    n = 2**m
    z = np.full((n + 1, n + 1), np.nan)
    z[::n, ::n] = 0.0
    stream = iter(np.random.Generator(np.random.PCG64(seed)).standard_normal(4 * (n + 1) ** 2))

    def neighbours(i, j, offsets):
        places = [(i + a, j + b) for a, b in offsets if 0 <= i + a <= n and 0 <= j + b <= n]
        return [z[place] for place in places]

    for level in range(m):
        step, half = n >> level, n >> (level + 1)
        odd, even, inside = range(half, n, step), range(0, n + 1, step), range(step, n, step)
        diagonal = [(-half, -half), (-half, half), (half, -half), (half, half)]
        straight = [(-half, 0), (half, 0), (0, -half), (0, half)]
        for i, j in itertools.product(odd, odd):
            values = neighbours(i, j, diagonal)
            z[i, j] = sum(values) / 4 + deviation(2 * level + 1, D, law) * next(stream)
        edges = [(i, 0) for i in odd] + [(i, n) for i in odd] + [(0, j) for j in odd] + [(n, j) for j in odd]
        edges += [*itertools.product(odd, inside), *itertools.product(inside, odd)]
        assert len(edges) == len(set(edges)) == 2 * len(odd) * len(even)
        for i, j in edges:
            values = neighbours(i, j, straight)
            assert len(values) == (3 if i in (0, n) or j in (0, n) else 4)
            z[i, j] = sum(values) / len(values) + deviation(2 * level + 2, D, law) * next(stream)
    return z


@pytest.mark.parametrize("law", ["std", "variance"])
@pytest.mark.parametrize(("D", "m", "seed"), [(2.3, 1, 0), (2.001, 2, 1), (2.999, 3, 2), (2.5, 5, 3)])
def test_displacement_equals_plain_loops(D, m, seed, law):
    surface = random_midpoint_displacement(D, m, seed=seed, law=law)
    np.testing.assert_allclose(surface.heights, displaced_by_loops(D, m, seed, law), rtol=0, atol=1e-13)


def test_stream_digits():
    heights = random_midpoint_displacement(2.3, 1).heights
    deviations = [deviation(h, 2.3, "std") for h in (1, 2)]
    xi = [0.12573022, -0.13210486, 0.64042265, 0.10490012, -0.53566937]
    centre = deviations[0] * xi[0]
    edges = [centre / 3 + deviations[1] * x for x in xi[1:]]
    expected = [[0, edges[2], 0], [edges[0], centre, edges[1]], [0, edges[3], 0]]
    np.testing.assert_allclose(heights, expected, atol=1e-7)


@pytest.mark.parametrize("law", ["std", "variance"])
def test_nested_bit_for_bit(law):
    fine = random_midpoint_displacement(2.3, 7, seed=5, law=law).heights
    for m in range(6, 0, -1):
        fine = fine[::2, ::2]
        np.testing.assert_array_equal(fine, random_midpoint_displacement(2.3, m, seed=5, law=law).heights)


def test_equal_seeds_are_matched_pairs():
    # The heights are linear in the random numbers: taken apart by half step, two D differ by the deviations alone.
    levels = midpoint_levels(3)
    one, two = (random_midpoint_displacement(D, 3, seed=9).heights for D in (2.2, 2.8))

    def numbers(heights, D):
        xi = np.zeros_like(heights)
        for level in range(3):
            step, half = 8 >> level, 4 >> level
            mean = heights[::step, ::step]
            mean = (mean[1:, 1:] + mean[1:, :-1] + mean[:-1, 1:] + mean[:-1, :-1]) / 4
            xi[half::step, half::step] = (heights[half::step, half::step] - mean) / deviation(2 * level + 1, D, "std")
        return xi[levels % 2 == 1]

    np.testing.assert_allclose(numbers(one, 2.2), numbers(two, 2.8), atol=1e-13)


def test_corners_zero_and_seeds_differ():
    fields = [random_midpoint_displacement(2.5, 4, seed=seed).heights for seed in range(4)]
    for field in fields:
        np.testing.assert_array_equal(field[[0, 0, -1, -1], [0, -1, 0, -1]], 0.0)
    assert len({field.tobytes() for field in fields}) == 4


def test_laws_have_the_stated_deviations():
    # At the first centre the mean of the corners is zero: the height is the deviation times a standard normal.
    for law in ("std", "variance"):
        centres = np.array([random_midpoint_displacement(2.4, 1, seed=s, law=law).heights[1, 1] for s in range(500)])
        # 500 samples: the standard error of a standard deviation is 3.2 %; four of them.
        assert np.sqrt(np.mean(centres**2)) == pytest.approx(deviation(1, 2.4, law), rel=0.13)


def test_side_changes_the_spacing_only():
    small, large = (random_midpoint_displacement(2.3, 4, side=side) for side in (1.0, 100.0))
    np.testing.assert_array_equal(small.heights, large.heights)
    assert (large.spacing, large.side, small.side) == (100.0 / 16, 100.0, 1.0)


def test_midpoint_levels():
    assert midpoint_levels(1).tolist() == [[0, 2, 0], [2, 1, 2], [0, 2, 0]]
    levels = midpoint_levels(4)
    np.testing.assert_array_equal(levels[::2, ::2], midpoint_levels(3))
    # Half step 2k+1 fills the 4^k centres, half step 2k+2 the 2 · 2^k (2^k + 1) edges of the cells.
    assert np.bincount(levels.ravel()).tolist() == [4] + [n for k in range(4) for n in (4**k, 2 * 2**k * (2**k + 1))]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"D": 2.0}, r"D must be in \(2, 3\), got 2.0"),
        ({"D": 3.0}, r"\(2, 3\)"),
        ({"D": float("nan")}, r"\(2, 3\)"),
        ({"D": "rough"}, "D must be a number, got 'rough'"),
        ({"m": 0}, r"m must be an integer in \[1, 14\], got 0"),
        ({"m": 15}, "got 15"),
        ({"m": 2.0}, "integer"),
        ({"seed": -1}, "seed must be an integer >= 0, got -1"),
        ({"side": 0.0}, "side must be finite and positive, got 0.0"),
        ({"side": float("inf")}, "side"),
        ({"law": "sigma"}, "'std', 'variance', got 'sigma'"),
    ],
)
def test_arguments_out_of_range(arguments, words):
    with pytest.raises(SurfaceError, match=words):
        random_midpoint_displacement(**{"D": 2.3, "m": 3} | arguments)


def test_surface_owns_read_only_contiguous_float64():
    given = np.asfortranarray(np.arange(12).reshape(3, 4))
    surface = Surface(given, 2)
    given[0, 0] = 99
    assert surface.heights[0, 0] == 0.0
    assert surface.heights.dtype == np.float64
    assert surface.heights.flags.c_contiguous
    assert (surface.shape, surface.side, surface.z_min, surface.z_max) == ((3, 4), 4.0, 0.0, 11.0)
    for heights in (surface.heights, pickle.loads(pickle.dumps(surface)).heights):
        with pytest.raises(ValueError, match="read-only"):
            heights[0, 0] = 1.0


@pytest.mark.parametrize(
    ("heights", "words"),
    [
        (np.zeros(9), r"2-D .* shape \(9,\)"),
        (np.zeros((2, 5)), r"shape \(2, 5\)"),
        (np.where(BUMP == 4.0, np.nan, BUMP), r"1 NaN or infinite out of 12, the first at \[1, 1\] \(nan\)"),
        (np.where(BUMP >= 3.0, -np.inf, BUMP), r"5 NaN or infinite .* \[0, 1\] \(-inf\)"),
        (BUMP + 0j, "real numbers"),
        ([["a"] * 3] * 3, "real numbers"),
        ([[1.0, 2.0], [1.0]], "2-D array of numbers"),
        (np.ma.masked_equal(BUMP, 0.0), "2 are masked"),
        (np.where(BUMP > 2.0, 1e308, -1e308), "finite range"),
    ],
)
def test_heights_refused(heights, words):
    with pytest.raises(SurfaceError, match=words):
        Surface(heights, 1.0)


@pytest.mark.parametrize("spacing", [0.0, -1.0, float("nan"), float("inf"), "wide"])
def test_spacing_refused(spacing):
    with pytest.raises(SurfaceError, match="spacing must be"):
        Surface(BUMP, spacing)


def test_Sq_is_the_deviation_about_the_mean_plane():
    surface = Surface(BUMP, 1.0)
    assert surface.Sq == pytest.approx(np.std(BUMP), rel=1e-15)
    assert surface.mean_height == pytest.approx(BUMP.mean(), rel=1e-15)
    assert all(isinstance(number, float) for number in (surface.Sq, surface.mean_height, surface.z_max, surface.side))


def test_Sq_scales_exactly_with_powers_of_two_and_to_rounding_otherwise():
    surface = random_midpoint_displacement(2.5, 4, seed=1)
    assert Surface(surface.heights * 2.0**-900, 1.0).Sq == surface.Sq * 2.0**-900
    for factor in (1e-250, 1e250):
        scaled = Surface(surface.heights * factor, 1.0)
        assert scaled.Sq / factor == pytest.approx(surface.Sq, rel=1e-14)
        assert scaled.mean_height / factor == pytest.approx(surface.mean_height, rel=1e-13)


def test_Sq_does_not_feel_an_offset():
    surface = random_midpoint_displacement(2.5, 4, seed=1)
    shifted = Surface(np.round(surface.heights * 2**20) / 2**20 + 2.0**30, 1.0)
    level = Surface(np.round(surface.heights * 2**20) / 2**20, 1.0)
    assert shifted.Sq == pytest.approx(level.Sq, rel=1e-15)


@pytest.mark.parametrize("level", [0.0, -7.5, 1e-300])
def test_flat_surface_has_no_roughness(level):
    surface = Surface(np.full((3, 5), level), 1.0)
    assert (surface.Sq, surface.mean_height, surface.z_max) == (0.0, level, level)


# One period


@pytest.mark.parametrize("law", ["std", "variance"])
def test_a_period_is_displaced_as_plain_loops_do(law):
    D, m, n = 2.4, 3, 8
    stream = iter(np.random.Generator(np.random.PCG64(5)).standard_normal(n * n))
    z = np.full((n, n), np.nan)
    z[0, 0] = 0.0
    for level in range(m):
        step, half = n >> level, n >> (level + 1)
        odd, even = range(half, n, step), range(0, n, step)
        for rows, columns, offsets, half_step in (
            (odd, odd, [(-half, -half), (-half, half), (half, -half), (half, half)], 2 * level + 1),
            (odd, even, [(-half, 0), (half, 0), (0, -half), (0, half)], 2 * level + 2),
            (even, odd, [(-half, 0), (half, 0), (0, -half), (0, half)], 2 * level + 2),
        ):
            for i, j in itertools.product(rows, columns):
                mean = np.mean([z[(i + a) % n, (j + b) % n] for a, b in offsets])
                z[i, j] = mean + deviation(half_step, D, law) * next(stream)
    surface = random_midpoint_displacement(D, m, side=2.0, seed=5, law=law, periodic=True)
    np.testing.assert_allclose(surface.heights, z, rtol=1e-12, atol=1e-14)
    assert (surface.periodic, surface.side, surface.spacing) == (True, 2.0, 0.25)


def test_periods_of_a_seed_are_nested_bit_for_bit():
    finest = random_midpoint_displacement(2.3, 6, seed=2, periodic=True).heights
    for m in range(2, 6):
        every = 2 ** (6 - m)
        np.testing.assert_array_equal(
            random_midpoint_displacement(2.3, m, seed=2, periodic=True).heights, finest[::every, ::every]
        )


def test_periodic_side_counts_every_element():
    heights = np.random.default_rng(0).random((8, 6))
    free, periodic = Surface(heights, 0.5), Surface(heights, 0.5, periodic=True)
    assert (free.side, periodic.side) == (3.5, 4.0)
    assert (free.intervals, periodic.intervals) == ((7, 5), (8, 6))
    assert pickle.loads(pickle.dumps(periodic)).periodic
    assert periodic.scaled(2.0).periodic


@pytest.mark.parametrize("D", [2.2, 2.7])
def test_periodic_midpoint_surfaces_are_nested_and_wrap(D):
    fine, coarse = (random_midpoint_displacement(D, m, side=3.0, seed=4, periodic=True) for m in (7, 6))
    assert fine.shape == (128, 128)
    assert fine.side == coarse.side == 3.0
    assert np.array_equal(fine.heights[::2, ::2], coarse.heights)
    # the step over the edge is as large as any other
    steps = np.roll(fine.heights, -1, axis=0) - fine.heights
    over = np.sqrt(np.mean(steps[-1] ** 2)) / np.sqrt(np.mean(steps**2))
    assert 0.5 < over < 2.0
    # a line of the next period on each side closes it
    assert np.array_equal(fine.with_neighbours[0, 1:-1], fine.heights[-1])
