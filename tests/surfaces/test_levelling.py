"""Levelling, filling and filtering: each does what it says to surfaces for which that is known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from roughvol.errors import SurfaceError
from roughvol.surfaces import levelling

Heights = NDArray[np.float64]

ROUGH = np.random.default_rng(11).normal(size=(33, 21))
X, Y = np.meshgrid(np.arange(33.0), np.arange(21.0), indexing="ij")
PLANE = 5.0 - 2.0 * X + 0.25 * Y
QUADRATIC = PLANE + 0.01 * X**2 - 0.03 * X * Y + 0.02 * Y**2
HOLES = np.random.default_rng(12).random((33, 21)) < 0.1
HOLE = np.zeros((33, 21), dtype=bool)
HOLE[4:9, 7:15] = True


def _without(heights: Heights, missing: NDArray[np.bool_]) -> Heights:
    return np.where(missing, np.nan, heights)


def _dense_fit(heights: Heights, degree: int) -> Heights:
    """Slow and obvious: the least-squares surface by one column for each term."""
    known = ~np.isnan(heights)
    terms = [X**a * Y**b for a in range(degree + 1) for b in range(degree + 1 - a)]
    columns = np.stack([term[known] for term in terms], axis=1)
    found = np.linalg.lstsq(columns, heights[known], rcond=None)[0]
    return sum(c * term for c, term in zip(found, terms, strict=True))


# Levelling


@pytest.mark.parametrize("missing", [np.zeros_like(HOLES), HOLES, HOLE], ids=["whole", "scattered", "hole"])
@pytest.mark.parametrize(
    ("kind", "taken_off"), [("mean", np.full_like(PLANE, 7.0)), ("tilt", PLANE), ("quadratic", QUADRATIC)]
)
def test_what_a_kind_takes_off_is_levelled_to_rounding(
    kind: str, taken_off: Heights, missing: NDArray[np.bool_]
) -> None:
    levelled = levelling.level(_without(taken_off, missing), kind)
    assert np.array_equal(np.isnan(levelled), missing)
    assert np.nanmax(np.abs(levelled)) <= 4e-16 * np.abs(taken_off).max()


@pytest.mark.parametrize("missing", [np.zeros_like(HOLES), HOLES], ids=["whole", "scattered"])
@pytest.mark.parametrize(("kind", "degree"), [("mean", 0), ("tilt", 1), ("quadratic", 2)])
def test_levelling_is_least_squares_on_the_known_heights(kind: str, degree: int, missing: NDArray[np.bool_]) -> None:
    heights = _without(ROUGH + QUADRATIC, missing)
    expected = heights - _dense_fit(heights, degree)
    assert np.nanmax(np.abs(levelling.level(heights, kind) - expected)) < 1e-12


@pytest.mark.parametrize("kind", list(levelling.LEVELS))
def test_levelling_twice_is_levelling_once(kind: str) -> None:
    once = levelling.level(ROUGH + PLANE, kind)
    assert np.abs(levelling.level(once, kind) - once).max() < 1e-15 * 33


def test_none_takes_nothing_off() -> None:
    levelled = levelling.level(ROUGH, "none")
    assert np.array_equal(levelled, ROUGH)
    assert levelled is not ROUGH


@pytest.mark.parametrize("power", [-900, 900])
@pytest.mark.parametrize("kind", list(levelling.LEVELS))
def test_any_scale_of_heights_is_levelled_alike(kind: str, power: int) -> None:
    expected = np.ldexp(levelling.level(ROUGH + PLANE, kind), power)
    assert np.array_equal(levelling.level(np.ldexp(ROUGH + PLANE, power), kind), expected)


def test_known_heights_in_one_line_are_levelled_along_it() -> None:
    heights = np.full((5, 6), np.nan)
    heights[2] = 3.0 + 0.5 * np.arange(6)
    levelled = levelling.level(heights, "tilt")
    assert np.abs(levelled[2]).max() < 1e-14
    assert np.isnan(levelled).sum() == 24


# Filling


@pytest.mark.parametrize("rule", levelling.FILLS)
@pytest.mark.parametrize("missing", [HOLES, HOLE], ids=["scattered", "hole"])
def test_filling_leaves_the_known_alone_and_stays_between_them(rule: str, missing: NDArray[np.bool_]) -> None:
    filled = levelling.fill(_without(ROUGH, missing), rule)
    assert np.array_equal(filled[~missing], ROUGH[~missing])
    assert np.isfinite(filled).all()
    known = ROUGH[~missing]
    assert known.min() <= filled.min()
    assert filled.max() <= known.max()


def test_interpolated_heights_are_the_means_of_their_neighbours() -> None:
    missing = HOLES.copy()
    missing[0, 0] = missing[0, 1] = missing[1, 0] = missing[20:24, 20] = True  # a corner, and a rim
    filled = levelling.fill(_without(ROUGH, missing), "interpolate")
    padded = np.pad(filled, 1, constant_values=np.nan)
    around = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    assert np.abs(np.nanmean(around, axis=0) - filled)[missing].max() < 1e-14


def test_a_hole_in_a_plane_is_interpolated_exactly() -> None:
    assert np.abs(levelling.fill(_without(PLANE, HOLE), "interpolate") - PLANE).max() < 1e-13


def test_the_nearest_height_is_that_of_no_farther_node() -> None:
    filled = levelling.fill(_without(ROUGH, HOLE), "nearest")
    known = np.argwhere(~HOLE)
    for place in np.argwhere(HOLE):
        distance = np.hypot(*(known - place).T)
        nearest = ROUGH[tuple(known[distance == distance.min()].T)]
        assert filled[tuple(place)] in nearest


@pytest.mark.parametrize("rule", levelling.FILLS)
def test_filling_turns_and_scales_with_the_map(rule: str) -> None:
    alone = np.zeros_like(HOLE)
    alone[3, 4] = alone[9, 0] = alone[20:22, 10] = True
    filled = levelling.fill(_without(ROUGH, alone), rule)
    assert np.array_equal(levelling.fill(np.ldexp(_without(ROUGH, alone), -900), rule), np.ldexp(filled, -900))
    if rule == "interpolate":
        turned = levelling.fill(np.rot90(_without(ROUGH, alone)), rule)
        assert np.abs(turned - np.rot90(filled)).max() < 1e-14


def test_nothing_missing_nothing_filled() -> None:
    assert all(np.array_equal(levelling.fill(ROUGH, rule), ROUGH) for rule in levelling.FILLS)


# Filtering

SPACING, CUT_OFF = 0.5, 8.0  # 16 nodes a cut-off
N = 161
INSIDE = np.s_[48 + 1 : -48 - 1]  # 1.5 cut-offs of 16 nodes from the edges
ALONG = SPACING * np.arange(N)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0, 4.0])
def test_a_wave_keeps_the_share_that_the_standard_gives_it(ratio: float) -> None:
    wave = np.sin(2.0 * math.pi * ALONG / (ratio * CUT_OFF) + 0.3)
    share = math.exp(-math.pi * levelling.ALPHA**2 / ratio**2)
    heights = np.repeat(wave[:, np.newaxis], N, axis=1)
    for turned in (heights, heights.T):
        filtered = levelling.low_pass(turned, SPACING, CUT_OFF)
        assert np.abs(filtered - share * turned)[INSIDE, INSIDE].max() < 1e-12


@pytest.mark.parametrize("angle", [0.2, 0.8, 2.5])
def test_the_share_does_not_depend_on_the_direction_of_the_wave(angle: float) -> None:
    distance = math.cos(angle) * ALONG[:, np.newaxis] + math.sin(angle) * ALONG
    wave = np.sin(2.0 * math.pi * distance / CUT_OFF + 0.3)
    filtered = levelling.low_pass(wave, SPACING, CUT_OFF)
    assert np.abs(filtered - 0.5 * wave)[INSIDE, INSIDE].max() < 1e-12


def test_the_share_at_the_cut_off_is_one_half() -> None:
    assert math.exp(-math.pi * levelling.ALPHA**2) == pytest.approx(0.5, rel=1e-15)


def test_constants_pass_everywhere_and_planes_away_from_the_edges() -> None:
    constant = np.full((N, N), 3.25)
    assert np.array_equal(levelling.low_pass(constant, SPACING, CUT_OFF), constant)
    plane = 1.0 + 0.5 * ALONG[:, np.newaxis] - 0.25 * ALONG
    assert np.abs(levelling.low_pass(plane, SPACING, CUT_OFF) - plane)[INSIDE, INSIDE].max() < 1e-12


def test_filtering_is_the_weighted_mean_over_the_nodes_there_are() -> None:
    heights, cut_off = ROUGH + PLANE, 5.0
    filtered = levelling.low_pass(heights, 1.0, cut_off)
    along = [np.arange(nodes) for nodes in heights.shape]
    x, y = (np.exp(-math.pi * ((i[:, np.newaxis] - i) / (levelling.ALPHA * cut_off)) ** 2) for i in along)
    expected = (x @ heights @ y.T) / (x.sum(axis=1)[:, np.newaxis] * y.sum(axis=1))
    assert np.abs(filtered - expected).max() < 1e-12


def test_filtering_is_linear_and_mirrors_with_the_map() -> None:
    first, second = ROUGH, np.roll(ROUGH, 5, axis=0)
    both = levelling.low_pass(first + second, 1.0, 4.0)
    assert np.abs(both - levelling.low_pass(first, 1.0, 4.0) - levelling.low_pass(second, 1.0, 4.0)).max() < 1e-14
    assert np.abs(levelling.low_pass(first[::-1], 1.0, 4.0) - levelling.low_pass(first, 1.0, 4.0)[::-1]).max() < 1e-14


@pytest.mark.parametrize("power", [-900, 900])
def test_any_scale_of_heights_is_filtered_alike(power: int) -> None:
    expected = np.ldexp(levelling.low_pass(ROUGH, 1.0, 4.0), power)
    assert np.array_equal(levelling.low_pass(np.ldexp(ROUGH, power), 1.0, 4.0), expected)


# What is refused


def test_what_cannot_be_treated_is_refused() -> None:
    nothing = np.full((4, 4), np.nan)
    with pytest.raises(SurfaceError, match="none of the 16 heights is known"):
        levelling.level(nothing, "tilt")
    with pytest.raises(SurfaceError, match="none of the 16 heights is known"):
        levelling.fill(nothing, "nearest")
    mostly = nothing.copy()
    mostly[0] = 1.0
    with pytest.raises(SurfaceError, match="12 of 16 heights are missing; allowed: up to 50%"):
        levelling.fill(mostly, "interpolate")
    with pytest.raises(SurfaceError, match="level must be one of 'none', 'mean', 'tilt', 'quadratic', got 'plane'"):
        levelling.level(ROUGH, "plane")
    with pytest.raises(SurfaceError, match="missing must be one of 'nearest', 'interpolate', got 'zero'"):
        levelling.fill(ROUGH, "zero")
    with pytest.raises(SurfaceError, match="known at every node"):
        levelling.low_pass(_without(ROUGH, HOLES), 1.0, 4.0)
    for cut_off in (0.0, 1.9, 20.1, math.nan, math.inf):
        with pytest.raises(SurfaceError, match=r"low_pass is .*; allowed: 2 \(twice the spacing\) to 20 \(the shorter"):
            levelling.low_pass(ROUGH, 1.0, cut_off)
