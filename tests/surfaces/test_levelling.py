"""Levelling, filling and filtering: each does what it says to surfaces for which that is known in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from roughvol.errors import SurfaceError
from roughvol.surfaces.treatment import ALPHA, FILLS, LEVELS, fill, level, low_pass

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


@pytest.mark.parametrize("missing", [np.zeros_like(HOLES), HOLES, HOLE], ids=["whole", "scattered", "hole"])
@pytest.mark.parametrize(
    ("kind", "taken_off"), [("mean", np.full_like(PLANE, 7.0)), ("tilt", PLANE), ("quadratic", QUADRATIC)]
)
def test_what_a_kind_takes_off_is_levelled_to_rounding(
    kind: str, taken_off: Heights, missing: NDArray[np.bool_]
) -> None:
    levelled = level(_without(taken_off, missing), kind)
    assert np.array_equal(np.isnan(levelled), missing)
    assert np.nanmax(np.abs(levelled)) <= 4e-16 * np.abs(taken_off).max()


@pytest.mark.parametrize("missing", [np.zeros_like(HOLES), HOLES], ids=["whole", "scattered"])
@pytest.mark.parametrize(("kind", "degree"), [("mean", 0), ("tilt", 1), ("quadratic", 2)])
def test_levelling_is_least_squares_on_the_known_heights(kind: str, degree: int, missing: NDArray[np.bool_]) -> None:
    heights, known = _without(ROUGH + QUADRATIC, missing), ~missing
    terms = [X**a * Y**b for a in range(degree + 1) for b in range(degree + 1 - a)]
    found = np.linalg.lstsq(np.stack([term[known] for term in terms], axis=1), heights[known], rcond=None)[0]
    expected = heights - sum(c * term for c, term in zip(found, terms, strict=True))
    assert np.nanmax(np.abs(level(heights, kind) - expected)) < 1e-12


def test_none_takes_nothing_off_and_nothing_missing_is_filled() -> None:
    for result in (level(ROUGH, "none"), *(fill(ROUGH, rule) for rule in FILLS)):
        assert np.array_equal(result, ROUGH)
        assert result is not ROUGH


@pytest.mark.parametrize("power", [-900, 900])
@pytest.mark.parametrize(
    "treated",
    [
        *(lambda z, kind=kind: level(z, kind) for kind in LEVELS),
        *(lambda z, rule=rule: fill(_without(z, HOLE), rule) for rule in FILLS),
        lambda z: low_pass(z, 1.0, 4.0),
    ],
    ids=[*LEVELS, *FILLS, "low pass"],
)
def test_any_scale_of_heights_is_treated_alike(treated: Callable[[Heights], Heights], power: int) -> None:
    expected = np.ldexp(treated(ROUGH + PLANE), power)
    assert np.array_equal(treated(np.ldexp(ROUGH + PLANE, power)), expected)


def test_known_heights_in_one_line_are_levelled_along_it() -> None:
    heights = np.full((5, 6), np.nan)
    heights[2] = 3.0 + 0.5 * np.arange(6)
    levelled = level(heights, "tilt")
    assert np.abs(levelled[2]).max() < 1e-14
    assert np.isnan(levelled).sum() == 24


@pytest.mark.parametrize("rule", FILLS)
@pytest.mark.parametrize("missing", [HOLES, HOLE], ids=["scattered", "hole"])
def test_filling_leaves_the_known_alone_and_stays_between_them(rule: str, missing: NDArray[np.bool_]) -> None:
    filled, known = fill(_without(ROUGH, missing), rule), ROUGH[~missing]
    assert np.array_equal(filled[~missing], known)
    assert known.min() <= filled.min()
    assert filled.max() <= known.max()


def test_interpolated_heights_are_the_means_of_their_neighbours() -> None:
    missing = HOLES.copy()
    missing[0, 0] = missing[0, 1] = missing[1, 0] = missing[20:24, 20] = True  # a corner, and a rim
    filled = fill(_without(ROUGH, missing), "interpolate")
    padded = np.pad(filled, 1, constant_values=np.nan)
    around = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    assert np.abs(np.nanmean(around, axis=0) - filled)[missing].max() < 1e-14
    assert np.abs(fill(_without(PLANE, HOLE), "interpolate") - PLANE).max() < 1e-13


def test_the_nearest_height_is_that_of_no_farther_node() -> None:
    filled = fill(_without(ROUGH, HOLE), "nearest")
    known = np.argwhere(~HOLE)
    for place in np.argwhere(HOLE):
        distance = np.hypot(*(known - place).T)
        assert filled[tuple(place)] in ROUGH[tuple(known[distance == distance.min()].T)]


SPACING, CUT_OFF = 0.5, 8.0  # 16 nodes a cut-off
N = 161
INSIDE = np.s_[48 + 1 : -48 - 1]  # 1.5 cut-offs of 16 nodes from the edges
ALONG = SPACING * np.arange(N)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("angle", [0.0, 0.2, 0.8, 1.5707963267948966, 2.5])
def test_a_wave_in_any_direction_keeps_the_share_that_the_standard_gives_it(ratio: float, angle: float) -> None:
    distance = math.cos(angle) * ALONG[:, np.newaxis] + math.sin(angle) * ALONG
    wave = np.sin(2.0 * math.pi * distance / (ratio * CUT_OFF) + 0.3)
    filtered = low_pass(wave, SPACING, CUT_OFF)
    assert np.abs(filtered - 0.5 ** (1.0 / ratio**2) * wave)[INSIDE, INSIDE].max() < 1e-12


def test_constants_pass_everywhere_and_planes_away_from_the_edges() -> None:
    constant = np.full((N, N), 3.25)
    assert np.array_equal(low_pass(constant, SPACING, CUT_OFF), constant)
    plane = 1.0 + 0.5 * ALONG[:, np.newaxis] - 0.25 * ALONG
    assert np.abs(low_pass(plane, SPACING, CUT_OFF) - plane)[INSIDE, INSIDE].max() < 1e-12


def test_filtering_is_the_weighted_mean_over_the_nodes_there_are() -> None:
    heights, cut_off = ROUGH + PLANE, 5.0
    along = [np.arange(nodes) for nodes in heights.shape]
    x, y = (np.exp(-math.pi * ((i[:, np.newaxis] - i) / (ALPHA * cut_off)) ** 2) for i in along)
    expected = (x @ heights @ y.T) / (x.sum(axis=1)[:, np.newaxis] * y.sum(axis=1))
    assert np.abs(low_pass(heights, 1.0, cut_off) - expected).max() < 1e-12


NOTHING = np.full((4, 4), np.nan)
CUT_OFFS = r"low_pass is .*; allowed: 2 \(twice the spacing\) to 20 \(the shorter"


@pytest.mark.parametrize(
    ("treated", "said"),
    [
        (lambda: level(NOTHING, "tilt"), "none of the 16 heights is known"),
        (lambda: fill(NOTHING, "nearest"), "none of the 16 heights is known"),
        (
            lambda: fill(_without(np.eye(4), np.eye(4) == 0), "nearest"),
            "12 of 16 heights are missing; allowed: up to 5",
        ),
        (lambda: level(ROUGH, "plane"), "level must be one of 'none', 'mean', 'tilt', 'quadratic', got 'plane'"),
        (lambda: fill(ROUGH, "zero"), "missing must be one of 'nearest', 'interpolate', got 'zero'"),
        (lambda: low_pass(_without(ROUGH, HOLES), 1.0, 4.0), "known at every node"),
        *((lambda at=at: low_pass(ROUGH, 1.0, at), CUT_OFFS) for at in (0.0, 1.9, 20.1, math.nan, math.inf)),
    ],
)
def test_what_cannot_be_treated_is_refused(treated: Callable[[], Heights], said: str) -> None:
    with pytest.raises(SurfaceError, match=said):
        treated()
