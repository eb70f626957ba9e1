"""What a study has done to measured maps: a crop, outliers, block means, square pixels, in this order, on each body."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roughvol.campaign import case_surface, one_case
from roughvol.errors import StudyError, SurfaceError
from roughvol.store import dataset
from roughvol.study import Case, loads
from roughvol.study.sections.height_file import Crop
from roughvol.study.sections.treatment import Lattice, after, nodes_kept, resampled_nodes
from roughvol.surfaces import treatment
from roughvol.surfaces.surface import Surface
from tests.study.kit import case_of, surface_of, table

MAP = treatment.low_pass(np.random.default_rng(0).normal(size=(41, 37)), 1.0, 5.0)
SPIKES = np.zeros(MAP.shape, dtype=bool)
SPIKES[[3, 20, 40], [7, 30, 0]] = True
SPIKED = MAP + 40.0 * MAP.std() * SPIKES
OTHER = treatment.low_pass(np.random.default_rng(1).normal(size=(41, 37)), 1.0, 5.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    np.save(tmp_path / "map.npy", MAP)
    np.save(tmp_path / "spiked.npy", SPIKED)
    np.save(tmp_path / "other.npy", OTHER)
    np.save(tmp_path / "small.npy", OTHER[:-1])
    return tmp_path


def _case(folder: Path, keys: str, rest: str = "", L: str = "40 um") -> Case:
    return case_of(folder, f"{keys}, L: {L}", rest)


def _surface(folder: Path, keys: str) -> Surface:
    return surface_of(folder, f"{keys}, L: 40 um")


# Crop


@pytest.mark.parametrize(
    "crop",
    [
        "{x: [0.25, 0.75], y: [0.5, 1]}",
        "{x: [10 um, 30 um], y: [18 um, 1]}",
        "{x: [0.01 mm, 30 um], y: [18 um, 36 um]}",
    ],
)
def test_a_crop_by_shares_or_by_lengths_keeps_the_nodes_inside(folder: Path, crop: str) -> None:
    case = _case(folder, f"file: map.npy, crop: {crop}")
    surface = case_surface.surface_of(case)
    assert np.array_equal(surface.heights, MAP[10:31, 18:])
    assert (case.L, surface.side, surface.spacing) == (20.0, 20.0, 1.0)
    assert case.treatment.crop == ((10, 30), (18, 36))
    assert case.surface_text == "cropped to nodes 10 to 30 along x and 18 to 36 along y"
    assert case.id == _case(folder, "file: map.npy, crop: {x: [10 um, 30 um], y: [18 um, 36 um]}").id


@settings(max_examples=30)
@given(st.integers(5, 400), st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4, unique=True))
def test_a_crop_of_a_crop_lies_in_it(nodes: int, shares: list[float]) -> None:
    a, b, c, d = sorted(shares)
    whole = Lattice((nodes, nodes), (1.0, 1.0))
    try:
        outer = nodes_kept(Crop(x=(a, d)), 1, whole, None) or ((0, nodes - 1), (0, nodes - 1))
        inner = nodes_kept(Crop(x=(b, c)), 1, whole, None) or ((0, nodes - 1), (0, nodes - 1))
    except StudyError:  # fewer than 3 nodes
        return
    assert outer[0][0] <= inner[0][0] <= inner[0][1] <= outer[0][1]
    left = after(whole, outer, 1, "none")
    # the same nodes, cropped once or twice
    first, last = (node - outer[0][0] for node in inner[0])
    ends = (first / (left.shape[0] - 1), last / (left.shape[0] - 1))
    again = nodes_kept(Crop(x=ends), 1, left, None) or ((0, left.shape[0] - 1), (0, 0))
    assert again[0] == (first, last)


def test_what_is_not_allowed_is_refused_by_key(folder: Path) -> None:
    bare = ["crop: {x: [0, 20 um]}", "surface.crop.x", "L has none: give L with its unit", "40"]
    for keys, key, said, *L in (*table("maps.toml")["treatment"], bare):
        with pytest.raises(StudyError) as caught:
            _case(folder, f"file: map.npy, {keys}", L=(L or ["40 um"])[0])
        (problem,) = caught.value.problems
        assert problem.key == key, keys
        assert re.search(said, problem.message), problem.message


def test_of_several_maps_the_map_that_a_crop_exceeds_is_named(tmp_path: Path) -> None:
    for nodes in (9, 7):
        x, y = np.indices((nodes, nodes)).reshape(2, -1)
        np.savetxt(tmp_path / f"{nodes}.xyz", np.transpose([x, y, x % 3]), header="X [um] Y [um] Z [um]")
    study = loads("surface: {files: [9.xyz, 7.xyz], crop: {x: [0, 8 um]}}", tmp_path / "s.yaml")
    with pytest.raises(StudyError, match=r"surface\.crop\.x: 7\.xyz: reaches to 8 um; allowed: up to 6 um"):
        study.cases()


# Block means


def test_block_means_and_what_fills_no_block(folder: Path) -> None:
    case = _case(folder, "file: map.npy, downsample: 4")
    surface = case_surface.surface_of(case)
    assert np.array_equal(surface.heights, treatment.block_means(MAP, 4))
    assert (surface.shape, surface.spacing, case.L) == ((10, 9), 4.0, 36.0)
    assert case.surface_text == "cropped to nodes 0 to 39 along x and 0 to 35 along y; means of 4 x 4 nodes taken"


def test_block_means_of_a_period_leave_its_length(folder: Path) -> None:
    np.save(folder / "period.npy", MAP[:40, :36])
    case = _case(folder, "file: period.npy, sides: periodic, downsample: 4")
    surface = case_surface.surface_of(case)
    assert surface.shape == case.shape
    assert np.array_equal(surface.heights, treatment.block_means(MAP[:40, :36], 4))
    assert (surface.periodic, surface.spacing, surface.side, case.L) == (True, 4.0, 40.0, 40.0)
    assert case.surface_text == "means of 4 x 4 nodes taken"


@settings(max_examples=40)
@given(st.integers(3, 300), st.integers(3, 300), st.integers(1, 7), st.floats(0.5, 2.0))
def test_the_lattice_is_the_one_that_comes_out(rows: int, columns: int, side: int, ratio: float) -> None:
    whole = Lattice((rows, columns), (0.3, 0.3 * ratio))
    try:
        nodes = nodes_kept(None, side, whole, None)
    except StudyError:
        assert min(rows, columns) // side < 3
        return
    left = after(whole, nodes, side, "square")
    expected = list(np.array([rows, columns]) // side)
    if whole.ratio > 1.0:
        expected[1] = resampled_nodes(expected[1], whole.ratio)
    else:
        expected[0] = resampled_nodes(expected[0], 1.0 / whole.ratio)
    assert list(left.shape) == expected
    assert left.pixel[0] == left.pixel[1] == pytest.approx(side * 0.3 * min(1.0, ratio), rel=1e-12)
    if rows * columns < 4000:
        assert treatment.squared(np.zeros((rows // side, columns // side)), whole.ratio).shape == left.shape


# Outliers


def test_outliers_are_filled_even_where_missing_heights_are_refused(folder: Path) -> None:
    surface = _surface(folder, "file: spiked.npy, outliers: {sigma: 6}")
    expected = treatment.fill(np.where(SPIKES, np.nan, MAP), "interpolate")
    assert np.array_equal(surface.heights, expected)
    assert (surface.outliers, surface.filled) == (3, 3)
    assert surface.peak_before == pytest.approx(Surface(SPIKED, 1.0).peak, rel=1e-14)
    assert surface.peak_before > 10.0
    assert surface.peak < 6.0


def test_a_file_with_holes_is_refused_all_the_same(folder: Path) -> None:
    np.save(folder / "holed.npy", np.where(SPIKES, np.nan, MAP))
    with pytest.raises(SurfaceError, match=r"3 heights are missing"):
        _surface(folder, "file: holed.npy, outliers: {sigma: 6}")


def test_the_order_of_all_treatments(folder: Path) -> None:
    keys = "crop: {x: [0, 0.9]}, outliers: {sigma: 5, window: 7}, downsample: 2, level: tilt, missing: nearest"
    tilted = SPIKED + 0.3 * np.arange(41.0)[:, np.newaxis]
    np.save(folder / "spiked.npy", tilted)
    surface = _surface(folder, f"file: spiked.npy, {keys}, low_pass: 8 um")
    heights = tilted[:36, :36]
    heights = np.where(treatment.outliers(heights, 5.0, 7), np.nan, heights)
    heights = treatment.fill(treatment.level(treatment.block_means(heights, 2), "tilt"), "nearest")
    assert np.array_equal(surface.heights, treatment.low_pass(heights, 2.0, 8.0))
    assert (surface.outliers, surface.filled) == (2, 0)  # the third is cut off; means of blocks have no holes
    assert surface.peak_before > surface.peak + 2.0
    text = _case(folder, f"file: spiked.npy, {keys}, low_pass: 8 um").surface_text
    steps = ["cropped to", "removed", "means of 2 x 2", "least-squares tilt", "missing heights", "waves shorter"]
    assert [text.index(step) for step in steps] == sorted(text.index(step) for step in steps)


# Two bodies


@pytest.mark.parametrize(
    ("mirror", "keys"),
    [
        ("none", "downsample: 3, level: tilt, low_pass: 9 um"),
        ("x", "crop: {x: [0.1, 0.6], y: [0, 0.5]}"),
        ("y", "downsample: 4, crop: {y: [0.2, 1]}"),
    ],
)
def test_two_bodies_are_treated_as_their_sum_would_be(folder: Path, mirror: str, keys: str) -> None:
    turned = {"none": OTHER, "x": OTHER[::-1], "y": OTHER[:, ::-1]}[mirror]
    np.save(folder / "sum.npy", MAP + turned)
    both = _surface(folder, f"file: map.npy, {keys}, against: {{file: other.npy, mirror: {mirror}}}")
    assert np.abs(both.heights - _surface(folder, f"file: sum.npy, {keys}").heights).max() < 1e-13


def test_outliers_of_both_bodies_are_taken_out_and_counted(folder: Path) -> None:
    both = _surface(folder, "file: spiked.npy, outliers: {}, against: {file: spiked.npy, mirror: y}")
    assert (both.outliers, both.filled) == (6, 6)
    assert both.peak_before == pytest.approx(Surface(SPIKED + SPIKED[:, ::-1], 1.0).peak, rel=1e-14)
    assert both.peak < 6.0


# Stored


def test_what_was_taken_out_is_stored(folder: Path) -> None:
    stored = one_case.run_case(_case(folder, "file: spiked.npy, outliers: {}", "sweep: {steps: 0}"))
    assert stored.outliers_removed.item() == 3
    assert stored.filled_fraction.item() == 3 / MAP.size
    assert stored.peak_height_before.item() > 6.0 > stored.peak_height.item()
    assert "removed and filled" in stored.attrs["surface"]
    path = folder / "study.nc"
    dataset.write(dataset.combine([stored], stored.attrs), path)
    assert dataset.read(path).outliers_removed.item() == 3
    plain = one_case.run_case(_case(folder, "file: spiked.npy", "sweep: {steps: 0}"))
    assert not {"outliers_removed", "peak_height", "filled_fraction"} & set(plain)
