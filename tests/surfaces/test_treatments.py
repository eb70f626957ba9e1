"""Treatments of measured heights: closed forms, slow and obvious oracles, and refusals."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from roughvol.errors import SurfaceError
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.treatment import ALPHA, LEVELS, ROUNDS, block_means, fill, level, low_pass, outliers, squared
from tests.refused import refusals

FILLS = ("nearest", "interpolate")
ROUGH = np.random.default_rng(11).normal(size=(33, 21))
X, Y = np.meshgrid(np.arange(33.0), np.arange(21.0), indexing="ij")
PLANE = 5.0 - 2.0 * X + 0.25 * Y
QUADRATIC = PLANE + 0.01 * X**2 - 0.03 * X * Y + 0.02 * Y**2
HOLES = np.random.default_rng(12).random((33, 21)) < 0.1
HOLE = np.zeros((33, 21), dtype=bool)
HOLE[4:9, 7:15] = True


def _without(heights, missing):
    return np.where(missing, np.nan, heights)


TAKEN_OFF = {"mean": np.full_like(PLANE, 7.0), "tilt": PLANE, "quadratic": QUADRATIC}


@pytest.mark.parametrize("missing", [np.zeros_like(HOLES), HOLES, HOLE], ids=["whole", "scattered", "hole"])
@pytest.mark.parametrize(("degree", "kind"), list(enumerate(TAKEN_OFF)))
def test_levelling_is_least_squares_on_the_known_heights(degree, kind, missing):
    """A surface of the kind is levelled to rounding."""
    levelled = level(_without(TAKEN_OFF[kind], missing), kind)
    assert np.array_equal(np.isnan(levelled), missing)
    assert np.nanmax(np.abs(levelled)) <= 4e-16 * np.abs(TAKEN_OFF[kind]).max()
    heights, known = _without(ROUGH + QUADRATIC, missing), ~missing
    terms = [X**a * Y**b for a in range(degree + 1) for b in range(degree + 1 - a)]
    found = np.linalg.lstsq(np.stack([term[known] for term in terms], axis=1), heights[known], rcond=None)[0]
    expected = heights - sum(c * term for c, term in zip(found, terms, strict=True))
    assert np.nanmax(np.abs(level(heights, kind) - expected)) < 1e-12


@pytest.mark.parametrize("power", [-900, 900])
@pytest.mark.parametrize(
    "treated",
    [
        *(lambda z, kind=kind: level(z, kind) for kind in LEVELS),
        *(lambda z, rule=rule: fill(_without(z, HOLE), rule) for rule in FILLS),
        lambda z: low_pass(z, 1.0, 4.0),
        lambda z: np.where(outliers(z, 3.0), 0.0, z),
    ],
    ids=[*LEVELS, *FILLS, "low pass", "outliers"],
)
def test_any_scale_of_heights_is_treated_alike(treated, power):
    expected = np.ldexp(treated(ROUGH + PLANE), power)
    assert np.array_equal(treated(np.ldexp(ROUGH + PLANE, power)), expected)


@pytest.mark.parametrize(("kind", "plane"), [("mean", [0, 0]), ("tilt", [2.0, -0.7]), ("quadratic", [1e6, 3.0])])
def test_what_rounding_leaves_of_a_plane_is_no_roughness(kind, plane):
    x, y = np.mgrid[0:23, 0:16] / 7.0
    heights = 3.7 + plane[0] * x + plane[1] * y
    heights[4, 5] = np.nan
    assert np.nanmax(np.abs(level(heights, kind))) == 0.0
    rough = heights + 1e-9 * (1.0 + plane[0]) * np.random.default_rng(1).normal(size=heights.shape)
    assert np.nanstd(level(rough, kind)) > 0.5e-9 * (1.0 + plane[0])


def test_known_heights_in_one_line_are_levelled_along_it():
    heights = np.full((5, 6), np.nan)
    heights[2] = 3.0 + 0.5 * np.arange(6)
    levelled = level(heights, "tilt")
    assert np.abs(levelled[2]).max() < 1e-14
    assert np.isnan(levelled).sum() == 24


def test_interpolated_heights_are_the_means_of_their_neighbours():
    missing = HOLES.copy()
    missing[0, 0] = missing[0, 1] = missing[1, 0] = missing[20:24, 20] = True  # a corner, and a rim
    filled = fill(_without(ROUGH, missing), "interpolate")
    assert np.array_equal(filled[~missing], ROUGH[~missing])
    padded = np.pad(filled, 1, constant_values=np.nan)
    around = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    assert np.abs(np.nanmean(around, axis=0) - filled)[missing].max() < 1e-14
    assert np.abs(fill(_without(PLANE, HOLE), "interpolate") - PLANE).max() < 1e-13


def test_the_nearest_height_is_that_of_no_farther_node():
    filled = fill(_without(ROUGH, HOLE), "nearest")
    assert np.array_equal(filled[~HOLE], ROUGH[~HOLE])
    known = np.argwhere(~HOLE)
    for place in np.argwhere(HOLE):
        distance = np.hypot(*(known - place).T)
        assert filled[tuple(place)] in ROUGH[tuple(known[distance == distance.min()].T)]


SPACING, CUT_OFF = 0.5, 8.0  # 16 nodes a cut-off
N = 161
INSIDE = np.s_[48 + 1 : -48 - 1]  # 1.5 cut-offs of 16 nodes from the edges
ALONG = SPACING * np.arange(N)


def test_a_wave_in_any_direction_keeps_the_share_that_the_standard_gives_it():
    for ratio, angle in ((0.5, 0.8), (1.0, 0.0), (1.0, 2.5), (4.0, 0.5 * math.pi)):
        distance = math.cos(angle) * ALONG[:, np.newaxis] + math.sin(angle) * ALONG
        wave = np.sin(2.0 * math.pi * distance / (ratio * CUT_OFF) + 0.3)
        filtered = low_pass(wave, SPACING, CUT_OFF)
        assert np.abs(filtered - 0.5 ** (1.0 / ratio**2) * wave)[INSIDE, INSIDE].max() < 1e-12


def test_filtering_is_the_weighted_mean_over_the_nodes_there_are():
    heights, cut_off = ROUGH + PLANE, 5.0
    along = [np.arange(nodes) for nodes in heights.shape]
    x, y = (np.exp(-math.pi * ((i[:, np.newaxis] - i) / (ALPHA * cut_off)) ** 2) for i in along)
    expected = (x @ heights @ y.T) / (x.sum(axis=1)[:, np.newaxis] * y.sum(axis=1))
    assert np.abs(low_pass(heights, 1.0, cut_off) - expected).max() < 1e-12


# Another lattice

SIZES = st.integers(4, 23)


def _plane(rows, columns, dx=1.0, dy=1.0):
    return 3.0 + 0.5 * dx * np.arange(rows)[:, np.newaxis] - 0.25 * dy * np.arange(columns)


@settings(max_examples=15)
@given(SIZES, SIZES, st.integers(1, 4))
def test_the_block_means_of_a_plane_are_the_plane(rows, columns, side):
    heights = block_means(_plane(rows, columns), side)
    middle = 0.5 * (side - 1)
    expected = _plane(rows // side, columns // side, side, side) + 0.5 * middle - 0.25 * middle
    assert heights.shape == (rows // side, columns // side)
    assert np.allclose(heights, expected, rtol=0.0, atol=1e-13)


def test_a_block_is_the_mean_of_its_known_heights_and_missing_if_most_of_them_are():
    _ = np.nan
    heights = np.array([[1.0, 2.0, _, 2.0], [3.0, _, _, _], [0.0, _, _, _], [4.0, _, _, _]])
    assert np.array_equal(block_means(heights, 2), [[2.0, _], [2.0, _]], equal_nan=True)
    assert np.array_equal(block_means(heights, 1), heights, equal_nan=True)


@settings(max_examples=20)
@given(SIZES, SIZES, st.floats(0.5, 2.0))
def test_a_plane_on_oblong_pixels_is_the_plane_on_square_ones(rows, columns, ratio):
    heights = squared(_plane(rows, columns, 1.0, ratio), ratio)
    finer = min(1.0, ratio)
    assert np.allclose(heights, _plane(*heights.shape, finer, finer), rtol=0.0, atol=1e-12)
    # as many nodes as fit
    for nodes, length in zip(heights.shape, (rows - 1, (columns - 1) * ratio), strict=True):
        assert (nodes - 1) * finer <= length * (1.0 + 1e-8) < nodes * finer * (1.0 + 1e-7)


@pytest.mark.parametrize("ratio", [0.9994, 1.37])
def test_waves_come_through_on_either_axis(ratio):
    def wave(rows, columns, dx, dy):
        x, y = np.meshgrid(dx * np.arange(rows), dy * np.arange(columns), indexing="ij")
        return np.sin(2.0 * math.pi * (x + 0.7 * y) / 16.0)

    heights = squared(wave(200, 180, 1.0, ratio), ratio)
    finer = min(1.0, ratio)
    error = np.abs(heights - wave(*heights.shape, finer, finer))[8:-8, 8:-8]
    assert error.max() < 1e-3
    turned = squared(wave(200, 180, 1.0, ratio).T, 1.0 / ratio)
    assert np.allclose(turned, heights.T, rtol=0.0, atol=1e-12)


def test_waves_of_four_pixels_keep_their_amplitude_everywhere():
    y = np.arange(200.0)
    even, odd = (squared(np.tile(wave(0.5 * math.pi * y), (4, 1)), 1.37)[0] for wave in (np.cos, np.sin))
    amplitude = np.hypot(even, odd)[20:-20]
    assert 0.97 < amplitude.min() < amplitude.max() < 1.0 + 1e-6


def test_new_nodes_beside_a_hole_are_missing_and_no_others():
    heights = np.random.default_rng(0).normal(size=(10, 12))
    heights[4, 6] = np.nan
    missing = np.isnan(squared(heights, 1.5))
    place = np.arange(missing.shape[1]) / 1.5
    assert np.array_equal(missing[4], np.abs(place - 6.0) < 1.0)
    assert not np.delete(missing, 4, axis=0).any()


# Outliers

RNG = np.random.default_rng(3)
WHITE = RNG.normal(size=(300, 280))
CORRELATED = low_pass(RNG.normal(size=(200, 200)), 1.0, 12.0)
ALONG_X, ALONG_Y = np.meshgrid(np.arange(200.0), np.arange(200.0), indexing="ij")
DEVIATION = float(CORRELATED.std())


def _slow(heights, sigma, window):
    """Slow and obvious: node by node, the plane fitted ten times, each time to the heights near the one before."""
    known = ~np.isnan(heights)
    near = known
    for _ in range(ROUNDS):  # two sets may follow each other for ever
        rest = level(heights, "tilt", near)
        middle = np.median(rest[known])
        limit = sigma * 1.482602218505602 * np.median(np.abs(rest[known] - middle))
        near = known & (np.abs(rest - middle) <= limit)
    found = np.zeros(heights.shape, dtype=bool)
    reach = window // 2
    for i, j in np.argwhere(known):
        around = rest[max(i - reach, 0) : i + reach + 1, max(j - reach, 0) : j + reach + 1]
        others = around[~np.isnan(around)]
        reference = middle if 2 * others.size < around.size else np.median(others)
        found[i, j] = abs(rest[i, j] - reference) > limit
    return found


def test_nothing_of_a_rough_surface_is_an_outlier():
    for heights in (WHITE, CORRELATED, *(random_midpoint_displacement(D, 7, seed=5).heights for D in (2.05, 2.95))):
        assert not outliers(heights, 6.0).any()


@pytest.mark.parametrize(("height", "window", "tilt"), [(40.0, 3, 0.0), (-40.0, 5, 0.5), (9.0, 9, 0.0), (9.0, 5, 0.5)])
def test_spikes_are_found_and_nothing_else(height, window, tilt):
    expected = np.zeros(CORRELATED.shape, dtype=bool)
    for place in ((0, 0), (0, 77), (199, 199), (100, 50), (101, 50), (30, 199), (64, 64)):
        expected[place] = True
    heights = CORRELATED + tilt * ALONG_X - 0.3 * tilt * ALONG_Y + height * DEVIATION * expected
    assert np.array_equal(outliers(heights, 6.0, window), expected)


def test_many_spikes_on_one_side_do_not_hide_behind_the_tilt_they_make():
    expected = (RNG.random(CORRELATED.shape) < 0.04) & (ALONG_X > 100.0)
    heights = CORRELATED + 1000.0 * DEVIATION * expected
    assert np.array_equal(outliers(heights, 6.0), expected)


def test_a_quadratic_is_no_roughness_where_one_is_levelled():
    bowl = 50.0 * DEVIATION * (ALONG_X / 100.0 - 1.0) ** 2
    heights = CORRELATED + bowl
    heights[20, 100] += 9.0 * DEVIATION
    assert not outliers(heights, 6.0, degree="tilt").any()  # the bowl counts as roughness
    assert np.argwhere(outliers(heights, 6.0, degree="quadratic")).tolist() == [[20, 100]]


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1), st.sampled_from([3, 5, 7]), st.sampled_from([0.0, 0.3, 0.6]))
@example(238, 5, 0.6)  # two sets of outliers that follow each other
def test_fast_and_slow_agree(seed, window, holes):
    rng = np.random.default_rng(seed)
    heights = rng.normal(size=(rng.integers(15, 22), rng.integers(15, 22)))
    heights[rng.random(heights.shape) < 0.02] *= 8.0
    heights[rng.random(heights.shape) < holes] = np.nan
    expected = _slow(heights, 4.0, window)
    if expected.sum() <= 0.05 * np.isfinite(heights).sum():
        assert np.array_equal(outliers(heights, 4.0, window), expected)


NOTHING = np.full((4, 4), np.nan)
CUT_OFFS = r"low_pass is .*; allowed: 2 \(twice the spacing\) to 20 \(the shorter"


test_what_cannot_be_treated_is_refused = refusals(
    SurfaceError,
    (lambda: level(NOTHING, "tilt"), "none of the 16 heights is known"),
    (lambda: fill(NOTHING, "nearest"), "none of the 16 heights is known"),
    (lambda: fill(_without(np.eye(4), np.eye(4) == 0), "nearest"), "12 of 16 heights are missing; allowed: up to 5"),
    (
        lambda: outliers(np.where(RNG.random(CORRELATED.shape) < 0.2, 30.0, CORRELATED), 3.0),
        r"farther than 3 .*: up to 5%",
    ),
    (lambda: outliers(np.eye(30), 3.0), "half of the heights or more lie in one plane"),
    (lambda: outliers(NOTHING, 3.0), "none of the 16 heights is known"),
    *((lambda at=at: low_pass(ROUGH, 1.0, at), CUT_OFFS) for at in (0.0, 1.9, 20.1, math.nan, math.inf)),
)
