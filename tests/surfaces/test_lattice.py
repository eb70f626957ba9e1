"""Block means and square pixels: exact for planes, and holes stay holes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roughvol.surfaces.treatment import block_means, squared

SIZES = st.integers(4, 23)


def _plane(rows: int, columns: int, dx: float = 1.0, dy: float = 1.0) -> np.ndarray:
    return 3.0 + 0.5 * dx * np.arange(rows)[:, np.newaxis] - 0.25 * dy * np.arange(columns)


@settings(max_examples=40, deadline=None)
@given(SIZES, SIZES, st.integers(1, 4))
def test_the_block_means_of_a_plane_are_the_plane(rows: int, columns: int, side: int) -> None:
    heights = block_means(_plane(rows, columns), side)
    middle = 0.5 * (side - 1)
    expected = _plane(rows // side, columns // side, side, side) + 0.5 * middle - 0.25 * middle
    assert heights.shape == (rows // side, columns // side)
    assert np.allclose(heights, expected, rtol=0.0, atol=1e-13)


def test_block_means_keep_the_mean_and_of_white_noise_take_off_its_due() -> None:
    white = np.random.default_rng(0).normal(size=(400, 400))
    coarse = block_means(white, 4)
    assert coarse.mean() == pytest.approx(white.mean(), abs=1e-15)
    assert coarse.std() == pytest.approx(0.25, rel=0.03)  # 1/√16


def test_block_means_of_block_means_are_those_of_larger_blocks() -> None:
    heights = np.random.default_rng(0).normal(size=(26, 39))
    assert np.allclose(block_means(block_means(heights, 2), 3), block_means(heights, 6), rtol=0.0, atol=1e-14)


def test_a_block_is_the_mean_of_its_known_heights_and_missing_if_most_of_them_are() -> None:
    _ = np.nan
    heights = np.array([[1.0, 2.0, _, 2.0], [3.0, _, _, _], [0.0, _, _, _], [4.0, _, _, _]])
    assert np.array_equal(block_means(heights, 2), [[2.0, _], [2.0, _]], equal_nan=True)
    assert np.array_equal(block_means(heights, 1), heights, equal_nan=True)


@settings(max_examples=60, deadline=None)
@given(SIZES, SIZES, st.floats(0.5, 2.0))
def test_a_plane_on_oblong_pixels_is_the_plane_on_square_ones(rows: int, columns: int, ratio: float) -> None:
    heights = squared(_plane(rows, columns, 1.0, ratio), ratio)
    finer = min(1.0, ratio)
    assert np.allclose(heights, _plane(*heights.shape, finer, finer), rtol=0.0, atol=1e-12)
    # as many nodes as fit
    for nodes, length in zip(heights.shape, (rows - 1, (columns - 1) * ratio), strict=True):
        assert (nodes - 1) * finer <= length * (1.0 + 1e-8) < nodes * finer * (1.0 + 1e-7)


def test_square_pixels_stay_as_they_are() -> None:
    heights = np.random.default_rng(0).normal(size=(8, 9))
    heights[2, 3] = np.nan
    assert np.allclose(squared(heights, 1.0), heights, rtol=0.0, atol=1e-14, equal_nan=True)


@pytest.mark.parametrize("ratio", [1.0006, 0.9994, 1.37])
def test_waves_come_through_on_either_axis(ratio: float) -> None:
    def wave(rows: int, columns: int, dx: float, dy: float) -> np.ndarray:
        x, y = np.meshgrid(dx * np.arange(rows), dy * np.arange(columns), indexing="ij")
        return np.sin(2.0 * math.pi * (x + 0.7 * y) / 16.0)

    heights = squared(wave(200, 180, 1.0, ratio), ratio)
    finer = min(1.0, ratio)
    error = np.abs(heights - wave(*heights.shape, finer, finer))[8:-8, 8:-8]
    assert error.max() < 1e-3
    turned = squared(wave(200, 180, 1.0, ratio).T, 1.0 / ratio)
    assert np.allclose(turned, heights.T, rtol=0.0, atol=1e-12)


def test_waves_of_four_pixels_keep_their_amplitude_everywhere() -> None:
    y = np.arange(200.0)
    even, odd = (squared(np.tile(wave(0.5 * math.pi * y), (4, 1)), 1.37)[0] for wave in (np.cos, np.sin))
    amplitude = np.hypot(even, odd)[20:-20]
    assert 0.97 < amplitude.min() < amplitude.max() < 1.0 + 1e-6


def test_new_nodes_beside_a_hole_are_missing_and_no_others() -> None:
    heights = np.random.default_rng(0).normal(size=(10, 12))
    heights[4, 6] = np.nan
    missing = np.isnan(squared(heights, 1.5))
    place = np.arange(missing.shape[1]) / 1.5
    assert np.array_equal(missing[4], np.abs(place - 6.0) < 1.0)
    assert not np.delete(missing, 4, axis=0).any()
