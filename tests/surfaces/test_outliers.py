"""Outliers: spikes are found wherever they are, and nothing of a real surface is taken for one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from roughvol.errors import SurfaceError
from roughvol.surfaces import treatment
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.treatment import ROUNDS, outliers

Heights = NDArray[np.float64]

RNG = np.random.default_rng(3)
WHITE = RNG.normal(size=(300, 280))
CORRELATED = treatment.low_pass(RNG.normal(size=(200, 200)), 1.0, 12.0)
X, Y = np.meshgrid(np.arange(200.0), np.arange(200.0), indexing="ij")
DEVIATION = float(CORRELATED.std())


def _slow(heights: Heights, sigma: float, window: int) -> NDArray[np.bool_]:
    """Slow and obvious: node by node, the plane fitted ten times, each time to the heights near the one before."""
    known = ~np.isnan(heights)
    near = known
    for _ in range(ROUNDS):  # two sets may follow each other for ever
        rest = treatment.level(heights, "tilt", near)
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


@pytest.mark.parametrize(
    "heights",
    [WHITE, CORRELATED, *(random_midpoint_displacement(D, 7, seed=5).heights for D in (2.05, 2.3, 2.7, 2.95))],
    ids=["white", "correlated", "D2.05", "D2.3", "D2.7", "D2.95"],
)
def test_nothing_of_a_rough_surface_is_an_outlier(heights: Heights) -> None:
    assert not outliers(heights, 6.0).any()


@pytest.mark.parametrize("window", [3, 5, 11])
def test_white_noise_is_cut_as_if_it_deviated_by_a_tenth_more(window: int) -> None:
    share = outliers(WHITE, 3.0, window).mean()
    assert math.erfc(3.3 / math.sqrt(2.0)) < share < math.erfc(3.0 / 1.1 / math.sqrt(2.0))


def test_a_high_smooth_peak_and_a_deep_groove_stay() -> None:
    peak = 12.0 * DEVIATION * np.exp(-((X - 90.0) ** 2 + (Y - 60.0) ** 2) / (2.0 * 4.0**2))
    groove = -15.0 * DEVIATION * np.exp(-((X + 0.2 * Y - 150.0) ** 2) / (2.0 * 4.0**2))
    heights = CORRELATED + peak + groove
    levelled = treatment.level(heights, "tilt")
    assert np.abs(levelled).max() > 10.0 * DEVIATION
    assert not outliers(heights, 6.0).any()


def test_ordinary_texture_beside_a_smooth_part_stays() -> None:
    heights = np.where(X < 120.0, 1e-3 * CORRELATED, CORRELATED) + 0.5 * DEVIATION * np.sin(X / 9.0)
    assert not outliers(heights, 6.0).any()


@pytest.mark.parametrize("tilt", [0.0, 0.5], ids=["level", "tilted"])
@pytest.mark.parametrize("height", [40.0, -40.0, 9.0])
@pytest.mark.parametrize("window", [3, 5, 9])
def test_spikes_are_found_and_nothing_else(height: float, window: int, tilt: float) -> None:
    expected = np.zeros(CORRELATED.shape, dtype=bool)
    for place in ((0, 0), (0, 77), (199, 199), (100, 50), (101, 50), (30, 199), (64, 64)):
        expected[place] = True
    heights = CORRELATED + tilt * X - 0.3 * tilt * Y + height * DEVIATION * expected
    assert np.array_equal(outliers(heights, 6.0, window), expected)


def test_many_spikes_on_one_side_do_not_hide_behind_the_tilt_they_make() -> None:
    expected = (RNG.random(CORRELATED.shape) < 0.04) & (X > 100.0)
    heights = CORRELATED + 1000.0 * DEVIATION * expected
    assert np.array_equal(outliers(heights, 6.0), expected)


def test_a_spike_beside_a_hole_or_alone_in_one_is_found() -> None:
    heights = CORRELATED.copy()
    heights[40:60, 40:60] = np.nan
    heights[[50, 45, 60], [50, 46, 50]] = 30.0 * DEVIATION
    heights[52, 53] = 0.0  # alone as well, and where the surface is
    found = outliers(heights, 6.0)
    assert sorted(map(tuple, np.argwhere(found).tolist())) == [(45, 46), (50, 50), (60, 50)]


def test_dust_is_found_while_it_fills_less_than_half_of_the_window() -> None:
    patch = np.zeros(CORRELATED.shape, dtype=bool)
    patch[100:105, 100:105] = True
    heights = CORRELATED + 20.0 * DEVIATION * patch
    assert np.array_equal(outliers(heights, 6.0, 11), patch)
    assert not outliers(heights, 6.0, 5)[102, 102]


def test_a_quadratic_is_no_roughness_where_one_is_levelled() -> None:
    bowl = 50.0 * DEVIATION * (X / 100.0 - 1.0) ** 2
    heights = CORRELATED + bowl
    heights[20, 100] += 9.0 * DEVIATION
    assert not outliers(heights, 6.0, degree="tilt").any()  # the bowl counts as roughness
    assert np.argwhere(outliers(heights, 6.0, degree="quadratic")).tolist() == [[20, 100]]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([3, 5, 7]), st.sampled_from([0.0, 0.3, 0.6]))
@example(238, 5, 0.6)  # two sets of outliers that follow each other
def test_fast_and_slow_agree(seed: int, window: int, holes: float) -> None:
    rng = np.random.default_rng(seed)
    heights = rng.normal(size=(rng.integers(15, 22), rng.integers(15, 22)))
    heights[rng.random(heights.shape) < 0.02] *= 8.0
    heights[rng.random(heights.shape) < holes] = np.nan
    expected = _slow(heights, 4.0, window)
    if expected.sum() <= 0.05 * np.isfinite(heights).sum():
        assert np.array_equal(outliers(heights, 4.0, window), expected)


@pytest.mark.parametrize("power", [-600, 600])
def test_the_unit_of_the_heights_does_not_matter(power: int) -> None:
    heights = WHITE.copy()
    heights[7, 7] = 50.0
    assert np.array_equal(outliers(np.ldexp(heights, power), 4.0), outliers(heights, 4.0))


@pytest.mark.parametrize(
    ("heights", "said"),
    [
        (np.where(RNG.random(CORRELATED.shape) < 0.2, 30.0, CORRELATED), r"lie farther than 3 .*allowed: up to 5%"),
        (np.eye(30), r"half of the heights or more lie in one plane"),
        (np.full((5, 5), np.nan), r"none of the 25 heights is known"),
    ],
    ids=["too many", "flat", "nothing"],
)
def test_what_has_no_outliers_to_speak_of_is_refused(heights: Heights, said: str) -> None:
    with pytest.raises(SurfaceError, match=said):
        outliers(heights, 3.0)
