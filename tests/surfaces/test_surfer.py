"""Grids of Surfer: text, Surfer 6 and Surfer 7, written here as their description has them, and read back."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from written import surfer_6, surfer_7, surfer_text

from roughvol.campaign import one_case
from roughvol.errors import DatasetError, RoughvolError, SurfaceError
from roughvol.study import loads
from roughvol.surfaces.files import reading

HEIGHTS = np.random.default_rng(11).normal(size=(6, 5)).astype("f4").astype(float)  # 6 nodes along x, 5 along y
HOLES = np.zeros(HEIGHTS.shape, dtype=bool)
HOLES[1, 2] = HOLES[4, 0] = HOLES[5, 4] = True

WRITERS: dict[str, Callable[..., bytes]] = {"text": surfer_text, "Surfer 6": surfer_6, "Surfer 7": surfer_7}


@pytest.mark.parametrize("kind", list(WRITERS))
@pytest.mark.parametrize("suffix", [".grd", ".GRD", ".dat", ""])
def test_a_grid_comes_back_with_its_axes_blanks_and_limits(tmp_path: Path, kind: str, suffix: str) -> None:
    path = tmp_path / f"z{suffix}"
    path.write_bytes(WRITERS[kind](np.where(HOLES, np.nan, HEIGHTS)))
    description = reading.describe(path)
    assert (description.shape, description.sides) == ((6, 5), pytest.approx((2.5, 4.0), rel=1e-15))
    assert (description.unit, description.heights_unit, description.counted) == (None, None, False)
    assert description.reader.startswith("Surfer grid")
    assert np.array_equal(reading.read(path, holes=True), np.where(HOLES, np.nan, HEIGHTS), equal_nan=True)
    with pytest.raises(SurfaceError, match=r"3 heights are missing .* row 1, column 2"):
        reading.read(path)


@pytest.mark.parametrize("kind", list(WRITERS))
def test_coordinates_that_count_nodes_are_no_lengths(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "z.grd"
    path.write_bytes(WRITERS[kind](HEIGHTS, (0.0, 5.0), (0.0, 4.0)))
    assert reading.describe(path).counted
    (case,) = loads("surface: {file: z.grd, L: 10 um, heights_unit: nm}", tmp_path / "s.yaml").cases()
    assert (case.L, one_case.surface_of(case).spacing) == (10.0, 2.0)
    assert np.abs(one_case.surface_of(case).heights - 1e-3 * HEIGHTS).max() < 1e-15


def test_numbers_of_a_text_may_run_over_lines_at_will(tmp_path: Path) -> None:
    path = tmp_path / "z.grd"
    path.write_bytes(b" ".join(surfer_text(HEIGHTS).split()))
    assert np.array_equal(reading.read(path), HEIGHTS)
    path.write_bytes(b"\r\n".join(surfer_text(HEIGHTS).split()))
    assert np.array_equal(reading.read(path), HEIGHTS)


@pytest.mark.parametrize(("version", "lost"), [(1, True), (2, False)])
def test_the_blank_of_surfer_7_is_that_of_the_grid(tmp_path: Path, version: int, lost: bool) -> None:
    """Version 1: blank at and above the value; version 2: at the value."""
    heights = np.where(HOLES, np.nan, np.minimum(HEIGHTS, 3.0))
    heights[0, 0] = 9.0
    path = tmp_path / "z.grd"
    path.write_bytes(surfer_7(heights, version=version, blank=5.0))
    expected = heights.copy()
    expected[0, 0] = np.nan if lost else 9.0
    assert np.array_equal(reading.read(path, holes=True), expected, equal_nan=True)


def test_unknown_sections_of_surfer_7_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "z.grd"
    path.write_bytes(surfer_7(HEIGHTS, between=struct.pack("<4si7s", b"FLTI", 7, b"faults.")) + b"TAIL\3\0\0\0end")
    assert np.array_equal(reading.read(path), HEIGHTS)


def test_a_text_and_a_binary_grid_are_pressed_alike(tmp_path: Path) -> None:
    results = []
    for kind, write in WRITERS.items():
        (tmp_path / f"{kind}.grd").write_bytes(write(HEIGHTS, (0.0, 1.0), (3.0, 3.8)))
        (case,) = loads(f"surface: {{file: {kind}.grd, unit: um}}\nsweep: {{steps: 2}}", tmp_path / "s.yaml").cases()
        results.append(one_case.run_case(case).mean_pressure.values)
    assert np.array_equal(results[0], results[1])
    assert np.allclose(results[0], results[2], rtol=1e-12)


def test_a_grid_of_gmt_is_netcdf(tmp_path: Path) -> None:
    path = tmp_path / "z.grd"
    coordinates = {"lat": ("lat", np.arange(5.0)), "lon": ("lon", np.arange(6.0))}
    for kind in ("NETCDF3_CLASSIC", "NETCDF4"):
        xr.Dataset({"z": (("lat", "lon"), HEIGHTS.T)}, coords=coordinates).to_netcdf(path, format=kind)
        assert reading.describe(path).reader == "netCDF"
        assert np.array_equal(reading.read(path), HEIGHTS)


BAD: dict[str, tuple[bytes, str]] = {
    "another": (b"HGPC1\0\0\1" + bytes(2000), r"no Surfer grid.*allowed in \.grd: Surfer"),
    "noise": (np.random.default_rng(2).bytes(3000), r"no Surfer grid.*allowed in \.grd: Surfer"),
    "empty": (b"", r"no Surfer grid.*allowed in \.grd: Surfer"),
    "cut text": (surfer_text(HEIGHTS)[:-30], r"holds \d+ heights; its header gives 6 x 5"),
    "long text": (surfer_text(HEIGHTS) + b"1 2 3\n", r"holds 33 heights; its header gives 6 x 5"),
    "no header": (b"DSAA\n6 5\n0 1\n", "ends within its header"),
    "letters": (surfer_text(HEIGHTS).replace(b"\n\n", b" x\n\n", 1), r"line 6: 'x' is no number"),
    "half nodes": (surfer_text(HEIGHTS).replace(b"6 5", b"6.5 5"), r"gives 6\.5 x 5 nodes; allowed: whole numbers"),
    "negative nodes": (surfer_text(HEIGHTS).replace(b"6 5", b"-6 -5"), r"gives -6 x -5 nodes; allowed: whole numbers"),
    "unknown nodes": (surfer_text(HEIGHTS).replace(b"6 5", b"nan 5"), r"gives nan x 5 nodes; allowed: whole numbers"),
    "turned x": (surfer_text(HEIGHTS, (4.5, 2.0)), r"x from 4\.5 to 2; allowed: rising"),
    "infinite y": (surfer_text(HEIGHTS, y=(0.0, np.inf)), r"y from 0 to inf; allowed: rising"),
    "cut 6": (surfer_6(HEIGHTS)[:-3], r"holds 117 bytes of heights; its header gives 6 x 5"),
    "short 6": (surfer_6(HEIGHTS)[:40], "ends within its header"),
    "cut 7": (surfer_7(HEIGHTS)[:-3], r"its section DATA has 240 bytes, the file 237"),
    "short 7": (surfer_7(HEIGHTS)[:50], r"its section GRID has 72 bytes"),
    "no data 7": (surfer_7(HEIGHTS)[:92], "needed: sections GRID and DATA"),
    "version 7": (surfer_7(HEIGHTS, version=3), r"version 3; allowed: 1 and 2"),
    "count 7": (
        surfer_7(HEIGHTS).replace(struct.pack("<2i", 5, 6), struct.pack("<2i", 5, 7)),
        r"holds 240 bytes of heights; its header gives 7 x 5",
    ),
}


@pytest.mark.parametrize("name", list(BAD))
def test_a_grid_that_may_be_misread_is_refused_by_name(tmp_path: Path, name: str) -> None:
    content, pattern = BAD[name]
    path = tmp_path / "z.grd"
    path.write_bytes(content)
    for call in (reading.describe, reading.read):
        with pytest.raises(RoughvolError, match=pattern) as caught:
            call(path)
        assert str(path) in str(caught.value)


def test_a_grid_takes_no_variable(tmp_path: Path) -> None:
    path = tmp_path / "z.grd"
    path.write_bytes(surfer_text(HEIGHTS))
    with pytest.raises(DatasetError, match="holds one array, without a name"):
        reading.read(path, "z")
