"""Text and grids of other programs: faults are refused by line, and no row is lost or taken for heights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import xarray as xr
from netCDF4 import Dataset

from roughvol.errors import DatasetError, RoughvolError, SurfaceError
from roughvol.study import loads
from roughvol.surfaces import length_units
from roughvol.surfaces.files import reading

HEIGHTS = np.random.default_rng(8).normal(size=(6, 5)).round(6)
HOLES = np.zeros(HEIGHTS.shape, dtype=bool)
HOLES[1, 2] = HOLES[4, 0] = HOLES[5, 4] = True
X, Y = (axis.ravel() * 0.25 for axis in np.indices(HEIGHTS.shape))
POINTS = np.column_stack([X, Y, HEIGHTS.ravel()])
GWYDDION = "# Width: 6 µm\n# Height: 5 µm\n# Value units: nm\n"


def rows(numbers: np.ndarray, between: str = " ", hole: str = "nan") -> str:
    cells = [[hole if np.isnan(number) else repr(float(number)) for number in row] for row in numbers]
    return "\n".join(between.join(row) for row in cells) + "\n"


def _write(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_text(text, encoding=encoding)
    return path


@pytest.mark.parametrize("hole", ["***", "BAD", "nan", "NaN", "-", "--", "n/a", "#N/A", "inf", "-9999", "1e38"])
@pytest.mark.parametrize("between", [" ", ";", "\t", ","])
def test_marks_of_missing_heights_are_holes(tmp_path: Path, hole: str, between: str) -> None:
    path = _write(tmp_path / "z.txt", rows(np.where(HOLES, np.nan, HEIGHTS), between, hole))
    found = reading.read(path, holes=True)
    assert np.array_equal(found, np.where(HOLES, np.nan, HEIGHTS), equal_nan=True)
    with pytest.raises(SurfaceError, match=r"z\.txt: 3 heights are missing .* row 1, column 2"):
        reading.read(path)


@pytest.mark.parametrize("between", [";", "\t", ","])
@pytest.mark.parametrize("ended", [False, True], ids=["open", "ended"])
def test_empty_cells_are_holes_also_at_the_ends_of_a_line(tmp_path: Path, between: str, ended: bool) -> None:
    text = rows(np.where(HOLES, np.nan, HEIGHTS), between, "")
    path = _write(tmp_path / "z.csv", text.replace("\n", f"{between}\n") if ended else text)
    assert np.array_equal(reading.read(path, holes=True), np.where(HOLES, np.nan, HEIGHTS), equal_nan=True)


def test_a_delimiter_at_both_ends_of_every_line_sets_nothing_apart(tmp_path: Path) -> None:
    lines = rows(HEIGHTS, "\t").splitlines()
    path = _write(tmp_path / "z.txt", "".join(f"\t{line}\t\n" for line in lines))
    assert np.array_equal(reading.read(path), HEIGHTS)


def test_a_number_that_often_marks_holes_is_a_height_among_its_like(tmp_path: Path) -> None:
    heights = -9999.0 + 100.0 * HEIGHTS
    heights[2, 2] = -9999.0
    np.save(tmp_path / "z.npy", heights)
    assert np.array_equal(reading.read(tmp_path / "z.npy"), heights)
    np.save(tmp_path / "z.npy", np.where(HOLES, -9999.0, HEIGHTS))
    with pytest.raises(SurfaceError, match=r"3 heights are missing .*\(-9999 marks a missing one\)"):
        reading.read(tmp_path / "z.npy")


def test_points_that_are_missing_are_holes(tmp_path: Path) -> None:
    path = _write(tmp_path / "z.xyz", rows(POINTS[~HOLES.ravel()]))
    assert np.array_equal(reading.read(path, holes=True), np.where(HOLES, np.nan, HEIGHTS), equal_nan=True)
    assert reading.describe(path).sides == (1.25, 1.0)


@pytest.mark.parametrize("suffix", [".txt", ".csv", ".xyz", ".dat", ".asc", ""])
def test_three_columns_that_are_no_grid_are_refused_unless_the_user_insists(tmp_path: Path, suffix: str) -> None:
    path = _write(tmp_path / f"z{suffix}", rows(HEIGHTS[:, :3]))
    for call in (reading.describe, reading.read):
        with pytest.raises(SurfaceError, match=r"looks like x y z points, but .*surface\.columns: heights"):
            call(path)
    assert np.array_equal(reading.read(path, columns="heights"), HEIGHTS[:, :3])


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.column_stack([X + np.sqrt(X), Y, X]), "x is not equidistant"),
        (np.vstack([POINTS, POINTS[:1]]), "1 nodes have several of the 31 points"),
        (np.column_stack([X, 0 * Y + 2.0, X]), "y is 2 everywhere"),
        (np.column_stack([X, X, X])[::5], "6 points lie on a grid of 6 x 6 nodes"),
        (np.where(np.arange(3) == 1, np.nan, POINTS), "a coordinate is missing"),
        (POINTS[X < 0.3], "x takes 2 values"),
    ],
)
def test_the_reason_why_points_are_no_grid_is_said(tmp_path: Path, points: np.ndarray, reason: str) -> None:
    path = _write(tmp_path / "z.xyz", rows(points))
    with pytest.raises(SurfaceError, match=f"looks like x y z points, but they are no regular grid: {reason}"):
        reading.read(path)


def test_rounded_and_shifted_coordinates_are_a_grid(tmp_path: Path) -> None:
    points = POINTS + np.array([1e3, -2e3, 0.0])
    points[:, :2] += 1e-10 * np.random.default_rng(2).normal(size=(len(points), 2))
    path = _write(tmp_path / "z.xyz", rows(points))
    assert np.array_equal(reading.read(path), HEIGHTS)
    assert reading.describe(path).sides == pytest.approx((1.25, 1.0))


BAD: dict[str, tuple[str, str]] = {
    "quality.txt": (rows(np.column_stack([POINTS, X])), r"looks like x y z points: the first two of its 4 columns"),
    "across.txt": (rows(POINTS.T), r"looks like x y z points: the first two of its 3 lines"),
    "corner.csv": (
        rows(np.vstack([np.r_[np.nan, Y[:5]], np.column_stack([X[::5], HEIGHTS])]), ";", ""),
        "first line and the first column look like coordinates",
    ),
    "size.txt": (
        "# Scan size: 8 um\n" + rows(HEIGHTS),
        r"line 1 is not understood: '# Scan size: 8 um'.*header: ignore",
    ),
    "pixel.txt": ("# lateral unit um\n" + rows(HEIGHTS), r"line 1 is not understood"),
    "title.csv": ("a,b,c,d,e\n" + rows(HEIGHTS, ","), r"line 1 is not understood: 'a,b,c,d,e'"),
    "footer.txt": (rows(HEIGHTS) + "end of data\n", r"line 7 holds no numbers: 'end of data'; delete it"),
    "blocks.txt": (
        GWYDDION + rows(HEIGHTS.T) + GWYDDION + rows(HEIGHTS.T),
        r"line 9 is a header among the numbers: '# Width: 6 µm'",
    ),
    "short.txt": (rows(HEIGHTS)[:-20], r"line 6 holds \d numbers, most lines 5"),
    "both.csv": (rows(HEIGHTS, ";").replace(".", ",", 3), r"line 1 holds both commas and points"),
    "letter.txt": (rows(HEIGHTS).replace("\n", " 1O\n", 1), r"line 1"),
    "volts.txt": (GWYDDION.replace("nm", "V") + rows(HEIGHTS.T), r"line 3 \(# Value units: V\) has the unit 'V'"),
    "no width.txt": (GWYDDION.replace("6 µm", "0 µm") + rows(HEIGHTS.T), r"# Width: 0 µm.* makes sides of 0 by 4;"),
    "tiny.txt": (GWYDDION.replace("6 µm", "6e-400 µm") + rows(HEIGHTS.T), r"makes sides of 0 by 4; allowed: finite"),
    "factor.txt": ("height conversion factor = 0\n" + rows(HEIGHTS.T), r"line 1 .* is 0; allowed: finite and not 0"),
    "cells.asc": ("ncols 6\nnrows 5\ncellsize -1\n" + rows(HEIGHTS.T), r"cellsize -1\) makes sides of -5 by -4"),
    "half.asc": ("ncols 6.5\nnrows 5\ncellsize 1\n" + rows(HEIGHTS.T), r"ncols 6\.5, nrows 5; allowed: whole numbers"),
    "none.asc": ("ncols nan\nnrows 5\ncellsize 1\n" + rows(HEIGHTS.T), r"ncols nan, nrows 5; allowed: whole numbers"),
    "deflection.txt": (
        "# Channel: Deflection\n" + GWYDDION + rows(HEIGHTS.T),
        "'Deflection' holds no heights, by its name",
    ),
    "units.csv": ("X [µm];Y [nm];Z [nm]\n" + rows(POINTS, ";"), r"line 1 .* is in nm, another size in um"),
    "counts.txt": ("h=5 w=7\n" + rows(HEIGHTS.T), r"header gives w = 7, the text has 6 columns in 5 lines"),
    "cut.asc": ("ncols 6\nnrows 5\ncellsize 1\n" + rows(HEIGHTS.T[:2]), r"holds 12 heights; its header gives 5 x 6"),
    "empty.xyz": ("", "holds no numbers"),
    "huge.asc": ("ncols 1000000000\nnrows 1000000000\ncellsize 1\n1 2 3\n", "holds 3 heights"),
}


@pytest.mark.parametrize("name", list(BAD))
def test_text_that_may_be_misread_is_refused_by_line(tmp_path: Path, name: str) -> None:
    text, pattern = BAD[name]
    path = _write(tmp_path / name, text)
    for call in (reading.describe, reading.read):
        with pytest.raises(RoughvolError, match=pattern) as caught:
            call(path)
        assert str(path) in str(caught.value)


def test_a_header_may_be_passed_over(tmp_path: Path) -> None:
    for head in ("# Scan size: 8 um\n", "a b c\n"):
        path = _write(tmp_path / "z.txt", head + rows(HEIGHTS))
        assert np.array_equal(reading.read(path, ignore_header=True), HEIGHTS)
    path = _write(tmp_path / "z.txt", GWYDDION.replace("nm", "V") + rows(HEIGHTS.T))
    assert np.array_equal(reading.read(path, ignore_header=True), HEIGHTS)


def test_a_header_that_gives_all_needs_no_other_line(tmp_path: Path) -> None:
    path = _write(tmp_path / "z.txt", "# Objective 50x, stylus 2 um\n" + GWYDDION + rows(HEIGHTS.T))
    description = reading.describe(path)
    assert (description.sides, description.unit, description.heights_unit) == ((5.0, 4.0), "um", "nm")
    assert "# Width: 6 µm" in description.source


@pytest.mark.parametrize(
    ("width", "height"),
    [("6 µm", "5000 nm"), ("6000 nm", "5 µm"), ("0.006 mm", "5 µm"), ("6 µm", "5 µm"), ("6 µm", "5")],
)
def test_each_size_may_have_a_prefix_of_its_own(tmp_path: Path, width: str, height: str) -> None:
    head = f"# Channel: Topography\n# Width: {width}\n# Height: {height}\n# Value units: nm\n"
    path = _write(tmp_path / "z.txt", head + rows(HEIGHTS.T))
    (case,) = loads("surface: {file: z.txt, unit: um}", tmp_path / "study.yaml").cases()
    assert abs(case.L - 5.0) < 1e-12
    description = reading.describe(path)
    assert description.unit is not None
    micrometres = [side * length_units.factor(description.unit, "um") for side in description.sides or ()]
    assert micrometres == pytest.approx([5.0, 4.0], rel=1e-12)
    assert description.heights_unit == "nm"


def test_names_of_columns_may_carry_units(tmp_path: Path) -> None:
    for head in ("X [µm];Y [µm];Z [nm]", "x (um); y (um); height (nm)", '"x/um";"y/um";"z/nm"', "# x_um;y_um;z_nm"):
        path = _write(tmp_path / "z.csv", f"{head}\n{rows(POINTS, ';')}", "latin-1")
        description = reading.describe(path)
        assert (description.sides, description.unit, description.heights_unit) == ((1.25, 1.0), "um", "nm"), head


def test_the_library_would_lose_lines_and_axes(tmp_path: Path) -> None:
    """The reason for readers of text and netCDF of our own."""
    topography = pytest.importorskip("SurfaceTopography")
    path = _write(tmp_path / "z.txt", rows(np.where(HOLES, np.nan, HEIGHTS), " ", "***"))
    assert topography.read_topography(str(path), physical_sizes=(1, 1)).nb_grid_pts == (5, 3)  # of 6 lines
    assert reading.read(path, holes=True).shape == (6, 5)
    path = _write(tmp_path / "z.asc", "ncols 6\nnrows 5\ncellsize 2\nNODATA_value -1\n" + rows(np.full((5, 6), -1.0)))
    assert topography.read_topography(str(path), physical_sizes=(1, 1)).heights().min() == -1.0
    assert np.isnan(reading.read(path, holes=True)).all()
    with Dataset(tmp_path / "z.nc", "w", format="NETCDF3_CLASSIC") as stored:
        stored.createDimension("y", 5)
        stored.createDimension("x", 6)
        stored.createVariable("heights", "f8", ("y", "x"))[...] = HEIGHTS.T
    with topography.open_topography(str(tmp_path / "z.nc")) as reader:
        assert reader.channels[0].nb_grid_pts == (6, 5)
        assert reader.topography(physical_sizes=(6, 5)).heights().shape == (5, 6)
    assert np.array_equal(reading.read(tmp_path / "z.nc"), HEIGHTS)


@pytest.mark.parametrize(
    ("dims", "turned"),
    [
        (("x", "y"), False),
        (("y", "x"), True),
        (("lat", "lon"), True),
        (("scan_y", "scan_x"), True),
        (("row", "x"), True),
        (("y", "column"), True),
        (("row", "column"), False),
        (("x", "time"), False),
    ],
)
def test_names_of_dimensions_say_which_axis_is_x(tmp_path: Path, dims: tuple[str, str], turned: bool) -> None:
    xr.Dataset({"z": (dims, HEIGHTS.T if turned else HEIGHTS)}).to_netcdf(tmp_path / "z.nc")
    assert np.array_equal(reading.read(tmp_path / "z.nc"), HEIGHTS)


@pytest.mark.parametrize(
    ("x", "units", "pattern"),
    [
        (np.arange(6.0) ** 2, "um", "the coordinate x is not equidistant"),
        (np.arange(6.0), "degrees_east", "x:units has the unit 'degrees_east'"),
        (np.arange(6.0), "nm", "x is in nm, y in um"),
    ],
)
def test_coordinates_of_netcdf_that_cannot_be_used_are_refused(
    tmp_path: Path, x: np.ndarray, units: str, pattern: str
) -> None:
    coordinates = {"x": ("x", x, {"units": units}), "y": ("y", np.arange(5.0), {"units": "um"})}
    xr.Dataset({"z": (("x", "y"), HEIGHTS)}, coords=coordinates).to_netcdf(tmp_path / "z.nc")
    with pytest.raises(SurfaceError, match=pattern):
        reading.describe(tmp_path / "z.nc")
    assert np.array_equal(reading.read(tmp_path / "z.nc", ignore_header=True), HEIGHTS)


@pytest.mark.parametrize(("positive", "sign"), [("up", 1.0), ("down", -1.0), ("DOWN ", -1.0), (None, 1.0)])
@pytest.mark.parametrize("kind", ["f8", "i2"])
def test_netcdf_may_be_positive_down(tmp_path: Path, positive: str | None, sign: float, kind: str) -> None:
    path = tmp_path / "z.nc"
    heights = (1e3 * HEIGHTS).astype(kind)
    attributes = {} if positive is None else {"positive": positive}
    xr.Dataset({"z": (("y", "x"), heights.T, attributes)}).to_netcdf(path)
    assert np.array_equal(reading.read(path), sign * heights)
    description = reading.describe(path)
    assert description.read_as == ("labels, down" if sign < 0.0 else "labels")
    assert [note for note in description.notes if "turned over" in note] == list(description.notes)
    assert len(description.notes) == (sign < 0.0)


def test_another_direction_is_refused(tmp_path: Path) -> None:
    xr.Dataset({"z": (("x", "y"), HEIGHTS, {"positive": "east"})}).to_netcdf(tmp_path / "z.nc")
    with pytest.raises(SurfaceError, match=r"z:positive is 'east'; allowed: up and down"):
        reading.describe(tmp_path / "z.nc")


POINT = np.dtype([("height", "f8"), ("quality", "i4")])


def _compound(stored: Dataset) -> None:
    kind = stored.createCompoundType(POINT, "point")
    stored.createVariable("z", kind, ("x", "y"))[:] = np.zeros((6, 5), POINT)


def _ragged(stored: Dataset) -> None:
    stored.createVariable("z", stored.createVLType("f8", "ragged"), ("x", "y"))[0, 0] = np.zeros(3)


def _enumerated(stored: Dataset) -> None:
    stored.createVariable("z", stored.createEnumType("i1", "quality", {"bad": 0, "good": 1}), ("x", "y"))[:] = 0


def _words(stored: Dataset) -> None:
    stored.createVariable("z", str, ("x", "y"))[0, 0] = "high"


def _several_lengths(stored: Dataset) -> None:
    for dim in "xy":
        stored.createVariable(dim, "f8", (dim,))[:] = np.arange(stored.dimensions[dim].size)
    stored["x"].length = np.array([1.0, 2.0])
    stored.createVariable("z", "f8", ("x", "y"))[:] = HEIGHTS


@pytest.mark.parametrize("write", [_compound, _ragged, _enumerated, _words, _several_lengths])
def test_netcdf_without_plain_numbers_is_refused_by_name(tmp_path: Path, write: Callable[[Dataset], None]) -> None:
    path = tmp_path / "z.nc"
    with Dataset(path, "w") as stored:
        stored.createDimension("x", 6)
        stored.createDimension("y", 5)
        write(stored)
    for call in (reading.describe, reading.read):
        with pytest.raises(RoughvolError, match=r"z\.nc: .*(not numbers|cannot be read as \.nc)"):
            call(path)


def test_coordinates_in_words_are_no_coordinates(tmp_path: Path) -> None:
    path = tmp_path / "z.nc"
    with Dataset(path, "w") as stored:
        stored.createDimension("x", 6)
        stored.createDimension("y", 5)
        stored.createVariable("x", str, ("x",))[:] = np.array(list("abcdef"), dtype=object)
        stored.createVariable("z", "f8", ("x", "y"))[:] = HEIGHTS
    assert np.array_equal(reading.read(path), HEIGHTS)
    assert reading.describe(path).sides is None


def test_the_mask_of_the_library_marks_holes(tmp_path: Path) -> None:
    topography = pytest.importorskip("SurfaceTopography").Topography
    path = tmp_path / "z.nc"
    topography(np.ma.masked_array(HEIGHTS, HOLES), (6.0, 5.0), unit="nm").to_netcdf(str(path))
    assert np.array_equal(reading.read(path, holes=True), np.where(HOLES, np.nan, HEIGHTS), equal_nan=True)
    description = reading.describe(path)
    assert (description.sides, description.unit, description.heights_unit) == ((5.0, 4.0), "nm", "nm")


def test_two_channels_of_one_name_are_told_apart_by_number(tmp_path: Path) -> None:
    topography = pytest.importorskip("SurfaceTopography").Topography
    path = tmp_path / "z.gwy"
    one = topography(HEIGHTS, (6.0, 5.0), unit="m")
    topography(2.0 * HEIGHTS, (6.0, 5.0), unit="m").to_gwy(str(tmp_path / "b.gwy"))
    one.to_gwy(str(path))
    first, second = (file.read_bytes() for file in (path, tmp_path / "b.gwy"))
    joined = _joined(first, second)
    path.write_bytes(joined)
    with pytest.raises(DatasetError, match=r"several channels 'Topography', give the number; .*0: Topo.*1: Topo"):
        reading.read(path, "Topography")
    assert np.allclose(reading.read(path, "0"), HEIGHTS)
    assert np.allclose(reading.read(path, "1"), 2.0 * HEIGHTS)
    assert "2 maps" in reading.describe(path).notes[0]
    with pytest.raises(DatasetError, match="has no channel '2'"):
        reading.read(path, "2")


def _joined(first: bytes, second: bytes) -> bytes:
    """Return one Gwyddion container with the items of two; the second has number 1."""
    name = b"GwyContainer\0"
    start = first.index(name) + len(name)
    items = first[start + 4 :] + second[start + 4 :].replace(b"/0/data", b"/1/data")
    return first[:start] + len(items).to_bytes(4, "little") + items


@pytest.mark.parametrize("suffix", [".npz", ".nc"])
def test_arrays_may_be_given_by_number(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"z{suffix}"
    if suffix == ".npz":
        np.savez(path, a=HEIGHTS, b=-HEIGHTS)
    else:
        xr.Dataset({"a": (("u", "v"), HEIGHTS), "b": (("u", "v"), -HEIGHTS)}).to_netcdf(path)
    assert np.array_equal(reading.read(path, "1"), -HEIGHTS)


TIFFS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "colour": ("allowed: one grey value", lambda path: tifffile.imwrite(path, np.zeros((9, 9, 3), "u1"))),
    "8 bits": ("allowed: one grey value", lambda path: tifffile.imwrite(path, np.zeros((9, 9), "u1"))),
    "noise": ("cannot be read as TIFF", lambda path: path.write_bytes(np.random.default_rng(3).bytes(999))),
    "empty": ("cannot be read as TIFF", lambda path: path.touch()),
    "absent": ("No such file", lambda path: None),
}


@pytest.mark.parametrize("name", list(TIFFS))
def test_a_tiff_without_heights_is_refused(tmp_path: Path, name: str) -> None:
    pattern, write = TIFFS[name]
    write(tmp_path / "z.tif")
    with pytest.raises(RoughvolError, match=pattern):
        reading.read(tmp_path / "z.tif")


def test_a_tiff_gives_its_size_where_a_tag_is_no_default(tmp_path: Path) -> None:
    path = tmp_path / "z.tif"
    for resolution, unit, sides in [((300, 300), "INCH", None), ((5e3, 5e3), "CENTIMETER", (1e-3, 8e-4))]:
        tifffile.imwrite(path, HEIGHTS.T.astype("f4"), resolution=resolution, resolutionunit=unit)
        assert reading.describe(path).sides == (None if sides is None else pytest.approx(sides))
    tifffile.imwrite(path, HEIGHTS.T.astype("u2"), extratags=[(42113, "s", 0, "0", True)])
    assert np.isnan(reading.read(path, holes=True)).any()


@pytest.mark.parametrize(
    ("kind", "text", "stored"),
    [
        ("f4", "-3.4028234663852886e+38", -3.4028234663852886e38),
        ("f4", "-3.40282346638529e+38", -3.4028234663852886e38),
        ("f4", "-3.40282e+38", -3.4028234663852886e38),  # as written with six digits
        ("f4", "-9.9999", -9.9999),
        ("f4", "1e+39", np.inf),  # beyond the type of the image
        ("f4", "nan", np.nan),
        ("f8", "-9.9999", -9.9999),
        ("u2", "65535", 65535),
        ("i4", "-2147483648", -2147483648),
    ],
)
def test_nodata_of_a_tiff_is_compared_in_the_type_of_the_image(
    tmp_path: Path, kind: str, text: str, stored: float
) -> None:
    path = tmp_path / "z.tif"
    image = np.arange(30).reshape(6, 5).astype(kind)
    image[HOLES] = np.array(stored).astype(kind)
    tifffile.imwrite(path, image.T, extratags=[(42113, "s", 0, text, True)])
    expected = np.where(HOLES, np.nan, np.arange(30.0).reshape(6, 5))
    assert np.array_equal(reading.read(path, holes=True), expected, equal_nan=True)
    with pytest.raises(SurfaceError, match=r"z\.tif: 3 heights are missing"):
        reading.read(path)


@pytest.mark.parametrize(
    "mark", [1.70141e38, 1.7014118346046923e38, 1.71041e38, -3.4028234663852886e38, -1e37, 9.97e36]
)
@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_numbers_too_large_for_any_height_are_missing_ones(tmp_path: Path, mark: float, kind: str) -> None:
    """Surfer's blank, the limits of float32 and the fill value of netCDF, also as the only number beside zeros."""
    path = tmp_path / "z.npy"
    for heights in (HEIGHTS, np.zeros(HEIGHTS.shape)):
        np.save(path, np.where(HOLES, mark, heights).astype(kind))
        expected = np.where(HOLES, np.nan, heights).astype(kind)
        assert np.array_equal(reading.read(path, holes=True), expected, equal_nan=True)
    np.save(path, np.full(HEIGHTS.shape, mark).astype(kind))
    with pytest.raises(SurfaceError, match=r"z\.npy: 30 heights are missing"):
        reading.read(path)


def test_what_roughvol_reads_itself_needs_no_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)  # as if it were not installed
    for name, text in (("z.xyz", rows(POINTS)), ("z.dat", rows(HEIGHTS)), ("z.txt", GWYDDION + rows(HEIGHTS.T))):
        assert np.array_equal(reading.read(_write(tmp_path / name, text)), HEIGHTS)
    tifffile.imwrite(tmp_path / "z.tif", HEIGHTS.T)
    assert np.array_equal(reading.read(tmp_path / "z.tif"), HEIGHTS)
    path = _write(tmp_path / "other.txt", "# Breite: 6 µm\n" + rows(HEIGHTS))
    with pytest.raises(DatasetError, match="line 1 is not understood: '# Breite: 6 µm'"):
        reading.read(path)
