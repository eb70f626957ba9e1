"""The record of a surface: its own read-only heights, their root mean square at any scale, and what it refuses."""

import math
import pickle

import numpy as np
import pytest

from roughvol.errors import SurfaceError
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface
from tests.refused import refusals

BUMP = np.add.outer([0.0, 1.0, 0.0, 2.0], [0.0, 3.0, 1.0])
ROUGH = random_midpoint_displacement(2.5, 4, seed=1).heights


def test_a_surface_owns_read_only_contiguous_float64():
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


test_what_is_no_surface_and_has_no_scale_is_refused = refusals(
    SurfaceError,
    (lambda: Surface(np.zeros(9), 1.0), r"2-D .* shape \(9,\)"),
    (lambda: Surface(np.zeros((2, 5)), 1.0), r"shape \(2, 5\)"),
    (lambda: Surface(np.where(BUMP == 4.0, np.nan, BUMP), 1.0), r"1 NaN .* out of 12, the first at \[1, 1\] \(nan\)"),
    (lambda: Surface(np.where(BUMP >= 3.0, -np.inf, BUMP), 1.0), r"5 NaN or infinite .* \[0, 1\] \(-inf\)"),
    (lambda: Surface(BUMP + 0j, 1.0), "real numbers"),
    (lambda: Surface([["a"] * 3] * 3, 1.0), "real numbers"),
    (lambda: Surface([[1.0, 2.0], [1.0]], 1.0), "2-D array of numbers"),
    (lambda: Surface(np.ma.masked_equal(BUMP, 0.0), 1.0), "2 are masked"),
    (lambda: Surface(np.where(BUMP > 2.0, 1e308, -1e308), 1.0), "finite range"),
    (lambda: Surface(1e-300 * BUMP, 1.0), r"the range of .* is 5e-300; allowed: 0 \(flat\), or at least 1e-290"),
    *((lambda at=at: Surface(BUMP, at), "spacing must be") for at in (0.0, -1.0, math.nan, math.inf, "wide")),
    (lambda: Surface(np.zeros((4, 4)), 1.0).scaled(7.0), "the surface is flat, Sq is 0"),
    (lambda: Surface(BUMP, 1.0).scaled(-7.0), r"Sq must be finite and positive, got -7\.0"),
)


def test_Sq_is_the_deviation_about_the_mean_plane_and_extremes_are_in_its_unit():
    surface = Surface(BUMP, 1.0)
    assert surface.Sq == pytest.approx(np.std(BUMP), rel=1e-15)
    assert surface.mean_height == pytest.approx(BUMP.mean(), rel=1e-15)
    assert surface.peak - surface.pit == pytest.approx(np.ptp(BUMP) / np.std(BUMP), rel=1e-14)
    assert all(isinstance(number, float) for number in (surface.Sq, surface.mean_height, surface.z_max, surface.side))
    assert surface.scaled(7.0).Sq == pytest.approx(7.0, rel=1e-15)


def test_scaled_heights_keep_what_is_known_of_them():
    measured = Surface(BUMP, 1.0, filled=3, outliers=2, peak_before=9.0).scaled(7.0)
    assert (measured.filled, measured.outliers, measured.peak_before) == (3, 2, 9.0)


def test_Sq_scales_exactly_with_powers_of_two_and_to_rounding_otherwise():
    surface = Surface(ROUGH, 1.0)
    assert Surface(ROUGH * 2.0**-900, 1.0).Sq == surface.Sq * 2.0**-900
    for factor in (1e-250, 1e250):
        scaled = Surface(ROUGH * factor, 1.0)
        assert scaled.Sq / factor == pytest.approx(surface.Sq, rel=1e-14)
        assert scaled.mean_height / factor == pytest.approx(surface.mean_height, rel=1e-13)
    level = np.round(ROUGH * 2**20) / 2**20
    assert Surface(level + 2.0**30, 1.0).Sq == pytest.approx(Surface(level, 1.0).Sq, rel=1e-15)


@pytest.mark.parametrize("level", [0.0, -7.5, 1e-300])
def test_a_flat_surface_has_no_roughness(level):
    surface = Surface(np.full((3, 5), level), 1.0)
    assert (surface.Sq, surface.mean_height, surface.z_max, surface.unit) == (0.0, level, level, 1.0)
    assert math.isnan(surface.peak)
    assert math.isnan(surface.pit)


def test_a_period_counts_every_element_and_has_neighbours():
    heights = np.random.default_rng(0).random((8, 6))
    free, periodic = Surface(heights, 0.5), Surface(heights, 0.5, sides="periodic")
    assert (free.side, periodic.side) == (3.5, 4.0)
    assert (free.intervals, periodic.intervals) == ((7, 5), (8, 6))
    assert np.array_equal(periodic.with_neighbours[0, 1:-1], heights[-1])
    assert free.with_neighbours is free.heights
    assert pickle.loads(pickle.dumps(periodic)).periodic
    assert periodic.scaled(2.0).periodic
