"""Height files: every format gives back its heights, and a file without a height field is refused by name."""

from __future__ import annotations

import io
import pickle
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from netCDF4 import Dataset
from written import surfer_7

from roughvol.errors import DatasetError, SurfaceError
from roughvol.study import HEIGHT_FORMATS
from roughvol.surfaces.files import reading

HEIGHTS = np.random.default_rng(5).normal(size=(5, 4)) * 10.0 ** np.arange(-2, 2)
ESRI = "NCOLS 5\nnrows 4\nxllcorner 0.0\nyllcorner 0.0\ncellsize 2.0\nNODATA_value -9999\n"


def _rows(heights: np.ndarray, between: str = " ") -> str:
    return "\n".join(between.join(repr(float(height)) for height in row) for row in heights) + "\n"


def _write_netcdf(path: Path, **arrays: Any) -> None:
    with Dataset(path, "w") as stored:
        for name, array in arrays.items():
            values = np.ma.asarray(array)
            dims = [f"{name}_{axis}" for axis in range(values.ndim)]
            for dim, size in zip(dims, values.shape, strict=True):
                stored.createDimension(dim, size)
            stored.createVariable(name, values.dtype, dims)[...] = values


def _esri(heights: np.ndarray) -> str:
    """Lines of an ESRI grid run from west to east, the first one in the north."""
    return ESRI + _rows(heights.T[::-1])


def _points(heights: np.ndarray, between: str = " ") -> str:
    x, y = (axis.ravel() for axis in np.indices(heights.shape) * 0.5)
    order = np.random.default_rng(4).permutation(heights.size)
    return _rows(np.column_stack([x, y, heights.ravel()])[order], between)


WRITERS: dict[str, Callable[[Path], Any]] = {
    "z.npy": lambda path: np.save(path, HEIGHTS),
    "fortran.npy": lambda path: np.save(path, np.asfortranarray(HEIGHTS)),
    "big-endian.npy": lambda path: np.save(path, HEIGHTS.astype(">f8")),
    "Z.NPY": lambda path: path.write_bytes(_npy_bytes(HEIGHTS)),
    "one.npz": lambda path: np.savez(path, heights=HEIGHTS),
    "with-scalars.npz": lambda path: np.savez_compressed(path, L=100.0, z=HEIGHTS, steps=np.arange(9)),
    "with-objects.npz": lambda path: np.savez(path, z=HEIGHTS, notes=np.array([{}, None], dtype=object)),
    "z.nc": lambda path: _write_netcdf(path, z=HEIGHTS, x=np.arange(5), L=np.float64(2.0)),
    "blanks.txt": lambda path: path.write_text("# heights in micrometres\n\n" + _rows(HEIGHTS, "   ")),
    "tabs.txt": lambda path: path.write_text(_rows(HEIGHTS, "\t")),
    "marked.txt": lambda path: path.write_text(_rows(HEIGHTS), encoding="utf-8-sig"),
    "commas.csv": lambda path: path.write_text("# x, y\n" + _rows(HEIGHTS, ", ")),
    "semicolons.csv": lambda path: path.write_text(_rows(HEIGHTS, ";").replace("\n", "\r\n")),
    "grid.asc": lambda path: path.write_text(_esri(HEIGHTS)),
    "wrapped.asc": lambda path: path.write_text(
        _esri(HEIGHTS)[: len(ESRI)] + _esri(HEIGHTS)[len(ESRI) :].replace(" ", "\n")
    ),
    "plain.asc": lambda path: path.write_text(_rows(HEIGHTS)),
    "ended.dat": lambda path: path.write_text(_rows(HEIGHTS, ";").replace("\n", ";\n")),  # as MIRCO writes them
    "points.xyz": lambda path: path.write_text(_points(HEIGHTS)),
    "surfer.grd": lambda path: path.write_bytes(surfer_7(HEIGHTS)),
    "image.tif": lambda path: tifffile.imwrite(path, HEIGHTS.T),
    "IMAGE.TIFF": lambda path: tifffile.imwrite(path, HEIGHTS.T, compression="zlib"),
}


def _npy_bytes(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def _npy_header(shape: tuple[int, int]) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return stream.getvalue()


@pytest.mark.parametrize("name", list(WRITERS))
def test_heights_come_back_bit_for_bit(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name)
    heights = reading.read(tmp_path / name)
    assert np.array_equal(heights, HEIGHTS)
    assert heights.dtype == np.float64
    assert heights.flags.c_contiguous


def test_every_format_a_study_may_name_is_read() -> None:
    assert {Path(name).suffix.lower() for name in WRITERS} == set(HEIGHT_FORMATS)


@pytest.mark.parametrize("kind", ["i2", "u1", "f4", "f2", "longdouble"])
def test_numbers_of_any_kind_become_float64(tmp_path: Path, kind: str) -> None:
    array = np.arange(12).reshape(3, 4).astype(kind)
    np.save(tmp_path / "z.npy", array)
    heights = reading.read(tmp_path / "z.npy")
    assert heights.dtype == np.float64
    assert np.array_equal(heights, array)


@pytest.mark.parametrize("suffix", [".npz", ".nc"])
def test_one_of_several_arrays_is_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"several{suffix}"
    arrays = {"z": HEIGHTS, "gap": HEIGHTS + 1.0, "L": np.float64(2.0)}
    np.savez(path, **arrays) if suffix == ".npz" else _write_netcdf(path, **arrays)
    assert np.array_equal(reading.read(path, "gap"), HEIGHTS + 1.0)
    with pytest.raises(
        DatasetError, match=r"several.*give the array of heights \(variable\).*z \(5, 4\), gap \(5, 4\), L \(\)"
    ):
        reading.read(path)
    with pytest.raises(DatasetError, match=r"several.*has no array 'Z'.*z \(5, 4\)"):
        reading.read(path, "Z")
    with pytest.raises(SurfaceError, match=r"several.*shape \(\)"):
        reading.read(path, "L")


def test_scaled_integers_of_netcdf_are_unpacked(tmp_path: Path) -> None:
    with Dataset(tmp_path / "z.nc", "w") as stored:
        stored.createDimension("x", 3)
        packed = stored.createVariable("z", "i2", ("x", "x"))
        packed.scale_factor, packed.add_offset = 0.5, 10.0
        packed[...] = 10.0 + 0.5 * np.arange(9).reshape(3, 3)
    assert np.array_equal(reading.read(tmp_path / "z.nc"), 10.0 + 0.5 * np.arange(9).reshape(3, 3))


HOLES = np.arange(20).reshape(5, 4) % 7 == 6  # at (1, 2) and (3, 1)
HOLED = np.where(HOLES, np.nan, HEIGHTS)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("z.npy", lambda path: np.save(path, HOLED)),
        ("z.txt", lambda path: path.write_text(_rows(HOLED))),
        ("z.asc", lambda path: path.write_text(_esri(np.nan_to_num(HOLED, nan=-9999.0)))),
        ("z.nc", lambda path: _write_netcdf(path, z=np.ma.masked_invalid(HOLED))),
        ("inf.npy", lambda path: np.save(path, np.where(np.isnan(HOLED), -np.inf, HOLED))),
    ],
)
def test_missing_heights_are_counted_and_located(tmp_path: Path, name: str, write: Callable[[Path], Any]) -> None:
    write(tmp_path / name)
    with pytest.raises(
        SurfaceError, match=rf"{name}: 2 heights are missing or not finite, the first in row 1, column 2"
    ):
        reading.read(tmp_path / name)


class _Trap:
    def __reduce__(self) -> tuple[Any, ...]:
        return (pytest.fail, ("a pickle was opened",))


BAD: dict[str, tuple[type[Exception], str, Callable[[Path], Any]]] = {
    "absent.npy": (DatasetError, "No such file", lambda path: None),
    "folder.npy": (DatasetError, "Is a directory", lambda path: path.mkdir()),
    "pickle.npy": (DatasetError, "cannot be read as .npy", lambda path: path.write_bytes(pickle.dumps(_Trap()))),
    "objects.npy": (DatasetError, "Object arrays", lambda path: np.save(path, np.full((3, 3), _Trap(), dtype=object))),
    "empty.npy": (DatasetError, "cannot be read", lambda path: path.touch()),
    "short.npy": (DatasetError, "cannot be read", lambda path: path.write_bytes(_npy_bytes(HEIGHTS)[:-3])),
    "petabytes.npy": (DatasetError, "at most", lambda path: path.write_bytes(_npy_header((5, 10**15)) + bytes(160))),
    "unclosed.npy": (
        DatasetError,
        "multi-line",
        lambda path: path.write_bytes(_npy_bytes(HEIGHTS).replace(b"4)", b"4 ")),
    ),
    "vector.npy": (SurfaceError, r"shape \(9,\)", lambda path: np.save(path, np.zeros(9))),
    "thin.npy": (SurfaceError, r"shape \(2, 9\)", lambda path: np.save(path, np.zeros((2, 9)))),
    "complex.npy": (SurfaceError, "type complex128", lambda path: np.save(path, np.zeros((3, 3), complex))),
    "mask.npy": (SurfaceError, "type bool, not numbers", lambda path: np.save(path, np.zeros((3, 3), bool))),
    "long.npy": (SurfaceError, "9 heights", lambda path: np.save(path, np.full((3, 3), np.longdouble("1e400")))),
    "text.npz": (DatasetError, "not a zip file", lambda path: path.write_text("1 2 3")),
    "none.npz": (DatasetError, "arrays in the file: none", lambda path: np.savez(path)),
    "text.nc": (DatasetError, "cannot be read as .nc", lambda path: path.write_text("1 2 3")),
    "words.nc": (SurfaceError, "not numbers", lambda path: _write_netcdf(path, z=np.full((3, 3), "a", dtype="S1"))),
    "nothing.txt": (SurfaceError, "holds no numbers", lambda path: path.write_text("# none yet\n")),
    "words.csv": (DatasetError, "line 1 is not understood: 'a,b,c'", lambda path: path.write_text("a,b,c\n1,2,3\n")),
    "ragged.txt": (
        DatasetError,
        "line 2 holds 2 numbers, most lines 3",
        lambda path: path.write_text("1 2 3\n1 2\n1 2 3\n"),
    ),
    "latin.txt": (
        DatasetError,
        r"line 1 is not understood: '# µm'",
        lambda path: path.write_bytes(b"# \xb5m\n1 2 3\n"),
    ),
    "count.asc": (
        SurfaceError,
        "16 heights; its header gives 4 x 5",
        lambda path: path.write_text(ESRI + _rows(HEIGHTS[1:])),
    ),
    "size.asc": (SurfaceError, "needed: ncols and nrows", lambda path: path.write_text("ncols 4\n" + _rows(HEIGHTS))),
}


@pytest.mark.parametrize("name", list(BAD))
def test_what_is_no_height_field_is_refused_by_name(tmp_path: Path, name: str) -> None:
    error, pattern, write = BAD[name]
    write(tmp_path / name)
    with pytest.raises(error, match=pattern) as caught:
        reading.read(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


def test_a_file_of_one_array_takes_no_variable(tmp_path: Path) -> None:
    np.save(tmp_path / "z.npy", HEIGHTS)
    with pytest.raises(DatasetError, match=r"z\.npy: holds one array, without a name; leave out the variable 'z'"):
        reading.read(tmp_path / "z.npy", "z")


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("z.npy", lambda path: np.save(path, HOLED)),
        ("inf.npy", lambda path: np.save(path, np.where(np.isnan(HOLED), np.inf, HOLED))),
        ("z.asc", lambda path: path.write_text(_esri(np.nan_to_num(HOLED, nan=-9999.0)))),
        ("z.nc", lambda path: _write_netcdf(path, z=np.ma.masked_invalid(HOLED))),
        ("packed.nc", lambda path: _write_netcdf(path, z=np.ma.masked_array(np.arange(20).reshape(5, 4), HOLES))),
    ],
)
def test_missing_heights_are_nan_for_a_caller_who_fills_them(
    tmp_path: Path, name: str, write: Callable[[Path], Any]
) -> None:
    write(tmp_path / name)
    heights = reading.read(tmp_path / name, holes=True)
    known = np.arange(20.0).reshape(5, 4) if name == "packed.nc" else HEIGHTS
    assert np.array_equal(heights, np.where(HOLES, np.nan, known), equal_nan=True)


@pytest.mark.parametrize("name", list(WRITERS))
def test_a_file_is_described_without_reading_its_heights(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name)
    description = reading.describe(tmp_path / name)
    assert description.shape == HEIGHTS.shape
    sides = {"grid.asc": (8.0, 6.0), "wrapped.asc": (8.0, 6.0), "points.xyz": (2.0, 1.5), "surfer.grd": (2.5, 4.0)}
    assert description.sides == sides.get(name)
    assert (description.unit, description.heights_unit) == (None, "um" if name == "blanks.txt" else None)
    assert description.reader


def test_other_endings_are_left_to_the_library_or_to_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)  # as if it were not installed
    path = tmp_path / "scan.al3d"
    path.touch()
    for call in (reading.read, reading.describe):
        with pytest.raises(DatasetError, match=r"scan\.al3d: .*not installed: pip install 'roughvol\[measured\]'"):
            call(path)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_an_array_beyond_measure_is_refused_by_its_header(tmp_path: Path, suffix: str) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (100_000, 100_000)})
    path = tmp_path / f"huge{suffix}"
    if suffix == ".npy":
        path.write_bytes(header.getvalue())
    else:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("heights.npy", header.getvalue())
    with pytest.raises(DatasetError, match=r"\(100000, 100000\); allowed: at most \d+ nodes"):
        reading.read(path)
