"""One scan in every format: the same heights, axes, size and unit; a file without a height field is refused by name."""

import pickle
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import tifffile
import xarray as xr
from height_files import (
    ESRI,
    GERMAN,
    GWYDDION,
    HEIGHTS,
    HOLED,
    HOLES,
    PIXEL,
    POINTS,
    SDF,
    SHUFFLED,
    library,
    netcdf,
    nms,
    npy,
    put,
    refusals_of,
    refused,
    rows,
    same,
    simple_field,
    surfer_6,
    surfer_7,
    surfer_text,
    wsxm,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st

from roughvol.errors import RoughvolError
from roughvol.study import HEIGHT_FORMATS
from roughvol.surfaces.files import reading
from tests.study.kit import case_of, surface_of

NANOMETRES = 1e3 * HEIGHTS
L = ", L: 2.5 um"


def _gridded(unit, turned=True, falling=False, **attributes):
    """NetCDF with coordinates in um; y falls with the index if asked for."""
    heights = {"um": 1.0, "nm": 1e3}[unit] * (-HEIGHTS if "positive" in attributes else HEIGHTS)
    step = -1 if falling else 1
    along = {"x": PIXEL * np.arange(6), "y": PIXEL * np.arange(5)}
    coordinates = {dim: (dim, values, {"units": "um"}) for dim, values in along.items()}
    whole = xr.Dataset({"h": (("x", "y"), heights, {"units": unit, **attributes})}, coords=coordinates)
    stored = (whole.transpose("y", "x") if turned else whole).isel(y=slice(None, None, step))
    return lambda path: stored.to_netcdf(path)


def _hdf5(path):
    with pytest.importorskip("h5py").File(path, "w") as stored:
        stored["scan/z"], stored["scan/quality"] = HEIGHTS, np.ones(HEIGHTS.shape)


def _matlab_7_3(path):
    with pytest.importorskip("h5py").File(path, "w") as stored:
        stored["z"] = HEIGHTS.T  # MATLAB counts the first index fastest


# name -> content, and further keys of a study in um; these come back bit for bit
PLAIN = {
    "z.npy": (npy(HEIGHTS), L),
    "fortran.npy": (npy(np.asfortranarray(HEIGHTS)), L),
    "big-endian.npy": (npy(HEIGHTS.astype(">f8")), L),
    "Z.NPY": (npy(HEIGHTS), L),
    "scalars.npz": (lambda path: np.savez_compressed(path, L=2.5, z=HEIGHTS, steps=np.arange(9)), L),
    "objects.npz": (lambda path: np.savez(path, z=HEIGHTS, notes=np.array([{}, None], dtype=object)), L),
    "z.nc": (lambda path: netcdf(path, z=HEIGHTS, x=np.arange(5), L=np.float64(2.0)), L),
    "blanks.txt": ("# a title\n\n" + rows(HEIGHTS, "   "), L),
    "tabs.txt": (rows(HEIGHTS, "\t"), L),
    "marked.txt": (b"\xef\xbb\xbf" + rows(HEIGHTS).encode(), L),
    "commas.csv": ("# x, y\n" + rows(HEIGHTS, ", "), L),
    "semicolons.csv": (rows(HEIGHTS, ";").replace("\n", "\r\n"), L),
    "decimal-commas.csv": (rows(HEIGHTS, ";").replace(".", ","), L),
    "decimal-commas.txt": (rows(HEIGHTS, "\t").replace(".", ","), L),
    "ended.dat": (rows(HEIGHTS, ";").replace("\n", ";\n"), L),  # as MIRCO writes them
    "plain.asc": (rows(HEIGHTS), L),
    "grid.asc": (ESRI + rows(HEIGHTS.T[::-1]), ""),
    "commas.asc": ((ESRI + rows(HEIGHTS.T[::-1])).replace(".", ","), ""),
    "wrapped.asc": (ESRI + rows(HEIGHTS.T[::-1]).replace(" ", "\n"), ""),
    "points.xyz": (rows(SHUFFLED), ""),
    "points.dat": (rows(POINTS[::-1], ","), ""),
    "points.asc": (rows(SHUFFLED, "\t"), L),
    "points": (rows(SHUFFLED), ""),
    "xy.nc": (_gridded("um", turned=False), ""),
    "falling.nc": (_gridded("um", falling=True), ""),
    "depths.nc": (_gridded("um", positive="down"), ""),
    "z.h5": (_hdf5, L + ", variable: scan/z"),
    "matlab-7.3.mat": (_matlab_7_3, L),
    "z.mat": (lambda path: scipy.io.savemat(path, {"z": HEIGHTS, "L": 4.0}), L),
    "text.grd": (surfer_text(HEIGHTS), ""),
    "surfer-6.grd": (surfer_6(HEIGHTS), ""),
    "surfer-7.grd": (surfer_7(HEIGHTS), ""),
    "field.gsf": (simple_field(HEIGHTS, "um"), ""),
    "image.tif": (lambda path: tifffile.imwrite(path, HEIGHTS.T), L),
    "IMAGE.TIFF": (lambda path: tifffile.imwrite(path, HEIGHTS.T, compression="zlib"), L),
    "tagged.tif": (
        lambda path: tifffile.imwrite(path, HEIGHTS.T, resolution=(2e4, 2e4), resolutionunit="CENTIMETER"),
        ", heights_unit: um",
    ),
    "imagej.tif": (
        lambda path: tifffile.imwrite(
            path, HEIGHTS.T.astype("f4"), imagej=True, resolution=(2.0, 2.0), metadata={"unit": "um"}
        ),
        ", heights_unit: um",
    ),
}
CONVERTED = {
    "metres.txt": ("# heights in m\n" + rows(1e-6 * HEIGHTS), L),
    "named.txt": ("# heights in nm\n" + rows(NANOMETRES), L),
    "nanometres.txt": (rows(NANOMETRES), L + ", heights_unit: nm"),
    "gwyddion.txt": (GWYDDION + rows(NANOMETRES.T), ""),
    "latin.txt": ((GWYDDION + rows(NANOMETRES.T)).encode("latin-1"), ""),
    "utf-16.txt": ((GWYDDION + rows(NANOMETRES.T)).encode("utf-16"), ""),
    "german.txt": (GERMAN + rows(NANOMETRES.T), ""),
    "hw.txt": ("h=5 w=6\npixel size = 5e-7 m\nheight conversion factor (-> m) = 1e-9\n" + rows(NANOMETRES.T), ""),
    "points.csv": ("X [µm];Y [µm];Z [nm]\n" + rows(SHUFFLED * [1, 1, 1e3], ";"), ""),
    "points-below.csv": ("X;Y;Z\nµm;µm;nm\n" + rows(SHUFFLED * [1, 1, 1e3], ";"), ""),
    "points-below.txt": ('"x"\t"y"\t"z"\n[um]\t[um]\t[nm]\n' + rows(SHUFFLED * [1, 1, 1e3], "\t"), ""),
    "yx.nc": (_gridded("nm"), ""),
    "image.stp": (wsxm(HEIGHTS[:, ::-1], (6 * PIXEL, 5 * PIXEL)), ""),
    "image.nms": (nms(HEIGHTS, 500.0, 500.0), L),
    "library.nc": (library, ""),
    "library.x3p": (library, ""),
    "library.gwy": (library, ""),
    "library.txt": (library, ""),
    "iso.sdf": (SDF + rows(HEIGHTS.T) + "*\nend\n*\n", ""),
    "iso.txt": (SDF + rows(HEIGHTS.T) + "*\nend\n*\n", ""),
    "counts.tif": (
        lambda path: tifffile.imwrite(path, np.rint((HEIGHTS.T - HEIGHTS.min()) / 1e-4).astype("u2")),
        L + ", heights_unit: 0.1 nm",
    ),
}
FORMATS = PLAIN | CONVERTED
PAGE = (Path(__file__).parents[2] / "docs" / "how-to" / "measured.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", list(FORMATS))
def test_one_scan_is_one_surface_in_every_format(tmp_path, name):
    content, keys = FORMATS[name]
    path, variable = put(tmp_path / name, content), keys.partition("variable: ")[2] or None
    surface = surface_of(tmp_path, f"file: {name}, unit: um{keys}")
    assert surface.spacing == pytest.approx(PIXEL, rel=1e-9)
    error = np.abs(surface.heights - surface.mean_height - (HEIGHTS - HEIGHTS.mean())).max()
    assert error < 2e-5 * np.ptp(HEIGHTS)  # counts of 16 bits
    found = reading.describe(path, variable)
    assert found.shape == HEIGHTS.shape
    assert found.reader.split(",")[0].removeprefix("SurfaceTopography ") in PAGE
    if name in PLAIN:
        same(path, HEIGHTS, variable)


def test_every_ending_of_a_study_has_a_file():
    assert {Path(name).suffix.lower() for name in FORMATS} >= set(HEIGHT_FORMATS)


@pytest.mark.parametrize("kind", ["i2", "u1", "f4", "f2", "longdouble"])
def test_numbers_of_any_kind_become_float64(tmp_path, kind):
    array = np.arange(12).reshape(3, 4).astype(kind)
    same(put(tmp_path / "z.npy", npy(array)), array)


MARKS = (1.70141e38, 1.71041e38, -3.4028234663852886e38, -1e37, 9.97e36)  # Surfer, the limits of float32, netCDF
MISSING = {
    "nan.npy": npy(HOLED),
    "inf.npy": npy(np.where(HOLES, -np.inf, HEIGHTS)),
    "sentinel.npy": npy(np.where(HOLES, -9999.0, HEIGHTS)),
    **{f"{mark}.txt": rows(np.where(HOLES, mark, HEIGHTS)) for mark in (-32768, 32767, 65535, 2147483647)},
    "large sentinel.npy": npy(np.where(HOLES, 1e10, HEIGHTS)),
    **{f"{mark:g}.npy": npy(np.where(HOLES, mark, HEIGHTS)) for mark in MARKS},
    **{f"{mark:g} f4.npy": npy(np.where(HOLES, mark, HEIGHTS).astype("f4")) for mark in MARKS},
    "z.asc": ESRI + rows(np.where(HOLES, -9999.0, HEIGHTS).T[::-1]),
    "points.xyz": rows(POINTS[~HOLES.ravel()]),
    "z.nc": lambda path: netcdf(path, z=np.ma.masked_invalid(HOLED)),
    "library.nc": lambda path: library(path, np.ma.masked_array(HEIGHTS, HOLES)),
    "text.grd": surfer_text(HOLED),
    "surfer-6.grd": surfer_6(HOLED),
    "surfer-7.grd": surfer_7(HOLED),
    "field.gsf": simple_field(HOLED, "um"),
}


@pytest.mark.parametrize("name", list(MISSING))
def test_missing_heights_are_nan_on_demand_and_else_counted_and_located(tmp_path, name):
    path = put(tmp_path / name, MISSING[name])
    same(path, HOLED, holes=True)
    refused(path, r"3 heights are missing or not finite, the first in row 1, column 2")


def test_a_number_that_often_marks_holes_is_a_height_among_its_like(tmp_path):
    heights = -9999.0 + 100.0 * HEIGHTS
    heights[2, 2] = -9999.0
    same(put(tmp_path / "z.npy", npy(heights)), heights)
    for known in (0.0, -9999.0):  # beside equal numbers, and alone
        put(tmp_path / "z.npy", npy(np.where(HOLES, -9999.0, known)))
        same(tmp_path / "z.npy", np.where(HOLES, np.nan, 0.0) if known == 0.0 else np.full((6, 5), -9999.0), holes=True)


class _Trap:
    def __reduce__(self):
        return (pytest.fail, ("a pickle was opened",))


def _huge(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("heights.npy", npy((100_000, 100_000)))


REFUSED = {
    "absent.npy": (lambda path: None, "No such file"),
    "absent.x3p": (lambda path: None, "cannot be read as .x3p: No such file"),
    "folder.npy": (lambda path: path.mkdir(), "Is a directory"),
    "pickle.npy": (pickle.dumps(_Trap()), "cannot be read as .npy"),
    "objects.npz": (lambda path: np.savez(path, z=np.full((3, 3), _Trap(), dtype=object)), "Object arrays"),
    "empty.npy": (b"", "cannot be read"),
    "short.npy": (npy(HEIGHTS)[:-3], "cannot be read"),
    "petabytes.npy": (npy((5, 10**15)) + bytes(160), r"\(5, 1000000000000000\); allowed: at most \d+ nodes"),
    "huge.npz": (_huge, r"\(100000, 100000\); allowed: at most \d+ nodes"),
    "unclosed.npy": (npy(HEIGHTS).replace(b"5)", b"5 "), "multi-line"),
    "vector.npy": (npy(np.zeros(9)), r"shape \(9,\)"),
    "thin.npy": (npy(np.zeros((2, 9))), r"shape \(2, 9\)"),
    "complex.npy": (npy(np.zeros((3, 3), complex)), "type complex128"),
    "mask.npy": (npy(np.zeros((3, 3), bool)), "type bool, not numbers"),
    "long.npy": (npy(np.full((3, 3), np.longdouble("1e400"))), "none of the 9 heights is known"),
    "text.npz": ("1 2 3", "not a zip file"),
    "none.npz": (lambda path: np.savez(path), "arrays in the file: none"),
    "text.nc": ("1 2 3", "cannot be read as .nc"),
    "two columns.dat": ("1 2\n" * 9, r"shape \(9, 2\); allowed: two dimensions of .* each; a profile is no map"),
}
OF_HEIGHTS = ("objects.npz", "short.npy", "complex.npy", "mask.npy", "long.npy")  # their headers are sound
OTHERS = {name: row for name, row in REFUSED.items() if name not in OF_HEIGHTS}
test_what_is_no_height_field_is_refused_by_name = refusals_of(OTHERS)


@pytest.mark.parametrize("name", OF_HEIGHTS)
def test_what_holds_no_heights_is_refused_where_they_are_read(tmp_path, name):
    content, pattern = REFUSED[name]
    with pytest.raises(RoughvolError, match=pattern):
        reading.read(put(tmp_path / name, content))


@pytest.mark.parametrize("suffix", [".npz", ".nc"])
def test_one_of_several_arrays_is_named_or_numbered(tmp_path, suffix):
    path = tmp_path / f"several{suffix}"
    arrays = {"z": HEIGHTS, "gap": HEIGHTS + 1.0, "L": np.float64(2.0)}
    np.savez(path, **arrays) if suffix == ".npz" else netcdf(path, **arrays)
    same(path, HEIGHTS + 1.0, "gap")
    same(path, HEIGHTS + 1.0, "1")
    listing = r"arrays in the file: z \(6, 5\), gap \(6, 5\), L \(\)"
    refused(path, rf"give the array of heights \(variable\); {listing}")
    refused(path, rf"has no array 'Z'; {listing}", "Z")
    refused(path, r"shape \(\)", "L")


@pytest.mark.parametrize("name", ["z.npy", "plain.asc", "surfer-6.grd", "field.gsf"])
def test_a_file_of_one_array_takes_no_variable(tmp_path, name):
    path = put(tmp_path / name, PLAIN[name][0])
    refused(path, "holds one array, without a name; leave out the variable 'z'", "z")


def test_what_roughvol_reads_itself_needs_no_library(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)  # as if it were not installed
    for name in ("points.xyz", "blanks.txt", "grid.asc", "surfer-7.grd", "image.tif", "xy.nc", "z.npy"):
        same(put(tmp_path / name, PLAIN[name][0]), HEIGHTS)
    same(put(tmp_path / "gwyddion.txt", CONVERTED["gwyddion.txt"][0]), NANOMETRES)
    extra = r"pip install 'roughvol\[measured\]'"
    refused(put(tmp_path / "scan.al3d", b""), rf"scan\.al3d: .*not installed: {extra}")
    for name, line in (("german.txt", "# Breite: 3 µm"), ("hw.txt", "h=5 w=6")):
        refused(put(tmp_path / name, CONVERTED[name][0]), rf"line 1 is not understood: '{line}'.*{extra}")
    monkeypatch.setitem(sys.modules, "tifffile", None)
    refused(tmp_path / "image.tif", rf"through tifffile, which is not installed: {extra}")


# Headers that programs or people have changed

CHANGED = {
    name: content.encode() if isinstance(content, str) else content
    for name in ("gwyddion.txt", "hw.txt", "grid.asc", "points.csv", "text.grd", "surfer-6.grd", "surfer-7.grd")
    if not callable(content := FORMATS[name][0])
}
HEAD = 130  # bytes of the longest header
TOKENS = (
    *("", " ", "\n", ";", ",", ".", "-", "+", "#", "\0", "²", "µ", "nan", "inf", "-1", "0", "1e400", "1e-400"),
    *("nm", "m", "V", "kg", "1.70141e38", "DSAA", "DSBB", "DSRB", "GRID", "DATA", "ncols", "width:", "pixel size ="),
    *("9" * 400, "\xff\xff\xff\x7f", "\0\0\0\x80", "\0\0\0\0\0\0\xf8\x7f"),
)


@st.composite
def _changed(draw):
    """A file with up to four places of its header replaced, and some cut off."""
    name = draw(st.sampled_from(sorted(CHANGED)))
    content = CHANGED[name]
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, min(HEAD, len(content))))
        token = draw(st.sampled_from(TOKENS)).encode("latin-1")
        content = content[:start] + token + content[start + draw(st.sampled_from([0, 1, len(token), 8])) :]
    return name, content[: draw(st.integers(0, len(content)))] if draw(st.integers(0, 9)) == 0 else content


@settings(derandomize=True, max_examples=30)
@given(_changed())
@example(("text.grd", b"DSAA"))
@example(("surfer-7.grd", surfer_7(HEIGHTS)[:12]))
@example(("gwyddion.txt", CHANGED["gwyddion.txt"].replace(b"3 ", b"61e-400 ")))  # a width that rounds to 0
def test_a_changed_header_is_read_or_refused_in_one_message(file):
    name, content = file
    with tempfile.TemporaryDirectory() as folder:
        path = put(Path(folder, name), content)
        for keys in ("", ", L: 3 um, heights_unit: nm, header: ignore"):
            said = name
            try:
                heights = reading.read(path, holes=True, ignore_header="header" in keys)
                assert heights.dtype == np.float64
                assert min(heights.shape) >= 3
                assert case_of(Path(folder), f"file: {name}{keys}").L > 0.0
            except RoughvolError as error:
                said = str(error)
            assert name in said
            assert len(said) < 1200
