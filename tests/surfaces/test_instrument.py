"""Files of instruments: heights, holes, size and unit are kept, and a file without a map is refused by name."""

import contextlib
import logging
import random
import struct
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.io
import xarray as xr
from height_files import HEIGHTS, HOLED, HOLES, PIXEL, SDF, library, nms, put, refused, rows, same

from roughvol.campaign import case_surface
from roughvol.errors import RoughvolError, StudyError, SurfaceError
from roughvol.surfaces import length_units, treatment
from roughvol.surfaces.files import instrument, reading
from tests.study.kit import case_of, surface_of

pytest.importorskip("SurfaceTopography", reason="needs the extra roughvol[measured]")

ISO = SDF + rows(HEIGHTS.T) + "*\nend\n*\n"


@pytest.mark.parametrize(("suffix", "unit"), [(".x3p", "m"), (".gwy", "m"), (".sdf", "um")])
def test_heights_size_unit_and_holes_come_back(tmp_path, suffix, unit):
    path = tmp_path / f"scan{suffix}"
    if suffix == ".sdf":
        put(path, SDF + rows(HOLED.T, hole="BAD") + "*\nend\n*\n")
    else:
        library(path, np.ma.masked_array(HEIGHTS, HOLES))
    found = reading.describe(path)
    assert (found.unit, found.heights_unit, found.shape) == (unit, unit, (6, 5))
    scale = length_units.factor(unit, "um")
    assert [scale * side for side in found.sides or ()] == pytest.approx((2.5, 2.0), rel=1e-12)
    np.testing.assert_allclose(scale * reading.read(path, holes=True), HOLED, rtol=0.0, atol=1e-14)
    refused(path, "3 heights are missing or not finite, the first in row 1, column 2")


@pytest.mark.parametrize("suffix", [".al3d", ".sur", ".x3p", ".hgt", ".nms", ""])
@pytest.mark.parametrize("size", [0, 2, 512])
def test_what_no_instrument_wrote_is_refused_by_name(tmp_path, suffix, size):
    path = put(tmp_path / f"noise{suffix}", np.random.default_rng(size).bytes(size))
    if suffix == ".hgt" and size == 512:  # a square of 16-bit numbers is all that this format is
        assert reading.describe(path).shape == (round((size / 2) ** 0.5),) * 2
        return
    refused(path, r"^.{1,400}$")


@pytest.mark.parametrize("suffix", [".x3p", ".gwy", ".sdf"])
def test_a_damaged_file_is_read_or_refused(tmp_path, suffix):
    path = tmp_path / f"scan{suffix}"
    whole = (put(path, ISO) if suffix == ".sdf" else library(path)).read_bytes()
    chance = random.Random(7)
    read = 0
    for _ in range(25):
        damaged = bytearray(whole)
        if chance.random() < 0.3:
            del damaged[chance.randrange(len(damaged)) :]
        else:
            for _ in range(chance.randrange(1, 20)):
                damaged[chance.randrange(len(damaged))] = chance.randrange(256)
        path.write_bytes(damaged)
        with contextlib.suppress(RoughvolError):  # anything else would be a bare error of the library
            heights = reading.read(path, holes=True)
            assert (heights.dtype, heights.ndim) == (np.float64, 2)
            read += 1
    assert read < 25


@pytest.mark.parametrize(
    ("name", "remedy"), [("scan.txt.GZ", "packed; unpack it"), ("scan.xlsx", "a spreadsheet; save its table as .csv")]
)
def test_a_packed_file_and_a_spreadsheet_have_a_remedy(tmp_path, name, remedy):
    refused(put(tmp_path / name, b"PK" + bytes(99)), f"is {remedy}")


def test_a_library_prints_nothing_about_a_damaged_file(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(logging.root, "handlers", [])
    wyko = b"\1\0" + b"Directory".ljust(16, b"\0") + struct.pack("<hlH", 1, 48, 0)
    wyko += b"RAW_DATA".ljust(16, b"\0") + struct.pack("<hlH", 3, 10**6, 1) + bytes(10**4)
    refused(put(tmp_path / "scan.opd", wyko), "is damaged, or in none of the formats")
    assert capsys.readouterr() == ("", "")


# In a study


def _refused(folder, surface, pattern):
    with pytest.raises(StudyError, match=pattern):
        case_of(folder, surface)


@pytest.mark.parametrize("off", [1.0006, 0.5])
def test_pixels_that_are_not_square_are_refused_unless_they_are_resampled(tmp_path, off):
    library(tmp_path / "oblong.x3p", pixel=(PIXEL, off * PIXEL))
    file = "file: oblong.x3p, unit: um"
    _refused(tmp_path, file, r"surface\.resample: missing: .*x3p has pixels of 0\.5 by .* um.*give resample: square")
    case = case_of(tmp_path, f"{file}, resample: square")
    surface = case_surface.surface_of(case)
    assert surface.spacing == pytest.approx(PIXEL * min(1.0, off), rel=1e-12)
    assert surface.side == pytest.approx(case.L, rel=1e-15)
    assert np.abs(surface.heights - treatment.squared(HEIGHTS, off)).max() < 1e-8
    assert case.surface_text.startswith("heights interpolated onto square pixels of the finer spacing")
    _refused(tmp_path, f"{file}, resample: square, L: 3 um", r"surface\.L: is 3 um, but .* gives 2\.5e-06 m")


def test_pixels_nearly_square_are_square_and_too_oblong_ones_are_refused_whatever_is_asked(tmp_path):
    library(tmp_path / "nearly.x3p", pixel=(PIXEL, 1.00005 * PIXEL))
    assert surface_of(tmp_path, "file: nearly.x3p").shape == (6, 5)
    library(tmp_path / "oblong.x3p", pixel=(PIXEL, 3 * PIXEL))
    for keys in ("", ", resample: square"):
        _refused(tmp_path, f"file: oblong.x3p{keys}", r"surface\.resample: .*allowed: one side up to 2 times the other")


def test_a_crop_in_lengths_counts_oblong_pixels(tmp_path):
    library(tmp_path / "oblong.x3p", np.random.default_rng(0).normal(size=(21, 21)), pixel=(0.25, 0.5))
    case = case_of(tmp_path, "file: oblong.x3p, crop: {x: [1 um, 3 um], y: [1 um, 3 um]}, resample: square")
    assert case.treatment.crop == ((4, 12), (2, 6))
    assert case_surface.surface_of(case).shape == (9, 9)
    assert pytest.approx(2e-6, rel=1e-12, abs=0.0) == case.L


def test_two_bodies_must_fit(tmp_path):
    put(tmp_path / "scan.sdf", ISO)
    library(tmp_path / "same.x3p")
    library(tmp_path / "coarse.x3p", pixel=(2 * PIXEL, 2 * PIXEL))
    np.save(tmp_path / "silent.npy", HEIGHTS)
    case = case_of(tmp_path, "file: scan.sdf, against: {file: same.x3p}")
    assert [body.unit for body in case.bodies] == ["um", "m"]
    coarse = "file: scan.sdf, against: {file: coarse.x3p%s}"
    _refused(tmp_path, coarse % "", r"surface\.against\.file: the files differ in size, 2\.5 x 2 and 5 x 4 um")
    case = case_of(tmp_path, coarse % ", header: ignore, heights_unit: m")
    assert (case.L, case.bodies[1].numbers_in) == (pytest.approx(2.5), "m")
    silent = "file: scan.sdf, against: {file: silent.npy}"
    _refused(tmp_path, silent, r"surface\.unit: missing: .*sdf are in um, and .*silent\.npy does not give its unit")
    case = case_of(tmp_path, "file: silent.npy, unit: nm, against: {file: scan.sdf}")
    assert (case.length_unit, case.L) == ("nm", pytest.approx(2500.0, rel=1e-12))


# Several arrays or channels


def _hdf5(path, arrays):
    with pytest.importorskip("h5py").File(path, "w") as stored:
        for name, array in arrays.items():
            stored[name] = array


def test_of_several_arrays_one_must_be_named(tmp_path):
    arrays = {"branch": np.zeros((17, 30)), "z": HEIGHTS, "L": np.full((1, 1), 2.0)}
    for write, path in ((scipy.io.savemat, tmp_path / "z.mat"), (_hdf5, tmp_path / "z.h5")):
        write(path, arrays)
        refused(path, r"give the array of heights \(variable\); arrays in the file: .*z \(6, 5\)")
    _refused(tmp_path, "file: z.h5, L: 1 um", r"surface\.file: .*variable.*branch \(17, 30\)")
    same(path, HEIGHTS, "z")
    assert reading.describe(path, "z").channel == "z"
    refused(path, r"has no array 'Z'; arrays in the file: .*z \(6, 5\)", "Z")
    _hdf5(path, {"z": HEIGHTS, "dx": np.full((1, 1), 0.5), "corners": np.zeros((2, 2))})
    same(path, HEIGHTS)
    assert not reading.describe(path).notes  # of one map there is no other to name
    _hdf5(path, {"dx": np.full((1, 1), 0.5)})
    refused(path, r"holds no map of at least 3 x 3 nodes; arrays in the file: dx \(1, 1\)")
    refused(path, r"dx has nodes \(1, 1\); allowed: a map of equidistant nodes, at least 3 x 3", "dx")


@pytest.mark.parametrize(("key", "unit"), [("units", "nm"), ("unit", np.bytes_("nm")), ("units", np.array([b"nm"]))])
def test_an_array_of_hdf5_has_the_unit_of_its_attribute(tmp_path, key, unit):
    _hdf5(path := tmp_path / "z.h5", {"z": HEIGHTS})
    with pytest.importorskip("h5py").File(path, "a") as stored:
        stored["z"].attrs[key] = unit
    assert reading.describe(path).heights_unit == "nm"
    assert reading.describe(path, ignore_header=True).heights_unit is None


@pytest.mark.parametrize("ignored", [False, True])
def test_netcdf_named_as_hdf5_is_refused(tmp_path, ignored):
    path = tmp_path / "z.h5"
    packed = {"z": {"dtype": "int16", "scale_factor": 1e-3, "_FillValue": -1}}
    xr.Dataset({"z": (("y", "x"), HEIGHTS)}).to_netcdf(path, encoding=packed, engine="netcdf4")
    with pytest.raises(SurfaceError, match=r"is a netCDF file: name it \.nc"):
        reading.describe(path, ignore_header=ignored)


def _gwyddion(path, *titles):
    """Write channels i + 1 times the heights, each with a title of ten letters."""
    items = b""
    for number, title in enumerate(titles):
        content = library(path, (number + 1.0) * HEIGHTS).read_bytes()
        content = content.replace(b"Topography\0", title.encode("ascii") + b"\0")
        start = content.index(b"GwyContainer\0") + len(b"GwyContainer\0")
        items += content[start + 4 :].replace(b"/0/data", f"/{number}/data".encode("ascii"))
    path.write_bytes(content[:start] + len(items).to_bytes(4, "little") + items)
    return path


def test_a_channel_that_is_no_heights_by_its_name_is_refused(tmp_path):
    path = _gwyddion(tmp_path / "scan.gwy", "Deflection", "Topography", "Height Ret")
    found = reading.describe(path)
    assert found.channel == "Topography"
    assert "2 maps (1: Topography, 2: Height Ret); 1 is read" in found.notes[0]
    assert np.allclose(reading.read(path) * 1e6, 2.0 * HEIGHTS)
    assert np.allclose(reading.read(path, "Height Ret") * 1e6, 3.0 * HEIGHTS)
    for named in ("Deflection", "0"):
        refused(path, "Deflection holds no heights, by its name; channels of heights: 1: Topography, 2: Height", named)
    refused(path, r"has no channel 'z'; channels .*0: Deflection \(no heights\), 1: Topography \(height\)", "z")
    refused(_gwyddion(path, "Deflection"), "holds no heights, by its name; channels of heights: none")
    _gwyddion(path, "Topography", "Topography")  # told apart by number
    refused(path, r"several channels 'Topography', give the number; .*0: Topo.*1: Topo", "Topography")
    assert np.allclose(reading.read(path, "1") * 1e6, 2.0 * HEIGHTS)


HEIGHT_NAMES = ("Height", "ZSensor", "Scan forward (Z-Axis)", "Amplitude of the height", "Default")
OTHER_NAMES = ("HeightError", "AmplitudeTrace", "Lock-In Amplitude", "lockInPhase", "Modulus 12", "Deflection")


@pytest.mark.parametrize(
    ("kind", "unit", "names", "reason"),
    [
        ("height", "nm", HEIGHT_NAMES, ""),
        ("height", None, OTHER_NAMES, "holds no heights, by its name"),
        ("height", ("nm", None), HEIGHT_NAMES, "holds no heights: its unit is no length"),
        ("voltage", "nm", HEIGHT_NAMES, "holds voltage, not heights"),
    ],
)
def test_kind_unit_and_name_tell_heights_from_other_channels(kind, unit, names, reason):
    channels = [SimpleNamespace(name=name, data_kind=SimpleNamespace(value=kind), unit=unit) for name in names]
    assert {instrument._no_heights(channel) for channel in channels} == {reason}


# Formats whose library is at odds with other readers


def test_the_size_in_nms_has_no_unit_and_is_that_of_the_study(tmp_path):
    matlab = bytes.fromhex("02000000010000000000000000ff0000")  # also the first bytes of a MATLAB file of version 4
    path = put(tmp_path / "scan.nms", matlab + nms(HEIGHTS, 312.5, 250.0)[16:])
    found = reading.describe(path)
    assert (found.shape, found.unit, found.heights_unit) == ((6, 5), None, "um")
    assert found.reader == "SurfaceTopography nms"
    missing = r"surface\.L: missing: .* are 312\.5 by .*unknown unit"
    for more in ("", ", unit: um", ", unit: nm"):
        _refused(tmp_path, f"file: scan.nms{more}, resample: square", missing)
    case = case_of(tmp_path, "file: scan.nms, L: 1.5625 um, resample: square")
    surface = case_surface.surface_of(case)
    assert surface.spacing == pytest.approx(0.25, rel=1e-12)
    assert (surface.shape, case.notes) == ((7, 5), ())
    _refused(tmp_path, "file: scan.nms, L: 1.5625 um", r"resample: missing: .*pixels of 0\.3125 by 0\.25 um")
