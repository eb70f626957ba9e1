"""Files of instruments: heights, holes, size and unit are kept, and a file without a map is refused by name."""

from __future__ import annotations

import contextlib
import random
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.io
from written import nms, wsxm

from roughvol.campaign import one_case
from roughvol.errors import DatasetError, RoughvolError, StudyError, SurfaceError
from roughvol.study import loads
from roughvol.surfaces import lattice
from roughvol.surfaces.files import instrument, reading

topography = pytest.importorskip("SurfaceTopography", reason="needs the extra roughvol[measured]")

HEIGHTS = np.random.default_rng(6).normal(size=(7, 5))
HOLES = np.arange(35).reshape(7, 5) % 11 == 8
PIXEL = 0.25  # of all maps, in um


def _write(
    path: Path, heights: np.ndarray = HEIGHTS, unit: str = "µm", pixel: tuple[float, float] = (PIXEL, PIXEL)
) -> Path:
    """Write heights as .x3p or .gwy."""
    sizes = heights.shape[0] * pixel[0], heights.shape[1] * pixel[1]
    getattr(topography.Topography(heights, sizes, unit=unit), f"to_{path.suffix[1:]}")(str(path))
    return path


def _write_sdf(path: Path, scale: str = "1.0e-6", cells: Any = None) -> Path:
    """Write heights as the text of ISO 25178-71: rows of constant y, lengths in metres, BAD where there is none."""
    cells = [["BAD" if np.isnan(z) else repr(float(z)) for z in row] for row in HEIGHTS.T] if cells is None else cells
    header = {
        "ManufacID": "roughvol",
        "CreateDate": "010120260000",
        "ModDate": "010120260000",
        "NumPoints": HEIGHTS.shape[0],
        "NumProfiles": HEIGHTS.shape[1],
        "Xscale": PIXEL * 1e-6,
        "Yscale": PIXEL * 1e-6,
        "Zscale": scale,
        "Zresolution": -1,
        "Compression": 0,
        "DataType": 7,
        "CheckType": 0,
    }
    lines = ["aISO-1.0", *(f"{name} = {value}" for name, value in header.items()), "*"]
    path.write_text("\n".join([*lines, *(" ".join(row) for row in cells), "*", "end", "*"]) + "\n", encoding="ascii")
    return path


@pytest.mark.parametrize("suffix", [".x3p", ".gwy"])
@pytest.mark.parametrize("holed", [False, True], ids=["whole", "holed"])
def test_heights_size_and_unit_come_back(tmp_path: Path, suffix: str, holed: bool) -> None:
    path = _write(tmp_path / f"scan{suffix}", np.ma.masked_array(HEIGHTS, HOLES) if holed else HEIGHTS)
    description = reading.describe(path)
    assert (description.unit, description.heights_unit) == ("m", "m")  # that of both formats
    assert description.shape == (7, 5)
    assert description.sides == pytest.approx((6 * PIXEL * 1e-6, 4 * PIXEL * 1e-6), rel=1e-12)
    expected = np.where(HOLES, np.nan, HEIGHTS) if holed else HEIGHTS
    heights = reading.read(path, holes=True) * 1e6
    assert np.array_equal(np.isnan(heights), np.isnan(expected))
    assert np.nanmax(np.abs(heights - expected)) < 1e-14
    assert np.array_equal(heights, reading.read(path, description.channel, holes=True) * 1e6, equal_nan=True)


def test_a_text_of_iso_25178_is_read(tmp_path: Path) -> None:
    path = _write_sdf(tmp_path / "scan.sdf")
    description = reading.describe(path)
    assert (description.shape, description.unit) == ((7, 5), "um")
    assert description.sides == pytest.approx((6 * PIXEL, 4 * PIXEL), rel=1e-12)
    assert np.abs(reading.read(path) - HEIGHTS).max() < 1e-14


def test_missing_heights_are_refused_unless_somebody_fills_them(tmp_path: Path) -> None:
    path = _write(tmp_path / "scan.x3p", np.ma.masked_array(HEIGHTS, HOLES))
    with pytest.raises(SurfaceError, match=r"scan\.x3p: 3 heights are missing .* first in row 1, column 3"):
        reading.read(path)


def test_a_channel_that_is_not_there_is_named_beside_those_that_are(tmp_path: Path) -> None:
    path = _write(tmp_path / "scan.gwy")
    with pytest.raises(
        DatasetError, match=r"scan\.gwy: has no channel 'z'; channels in the file: 0: Topography \(height\)"
    ):
        reading.describe(path, "z")


@pytest.mark.parametrize("off", [1.0006, 0.9994, 2.0, 0.5])
def test_pixels_that_are_not_square_are_refused_unless_they_are_resampled(tmp_path: Path, off: float) -> None:
    path = _write(tmp_path / "oblong.x3p", pixel=(PIXEL, off * PIXEL))
    assert reading.describe(path).sides == pytest.approx((6 * PIXEL * 1e-6, 4 * off * PIXEL * 1e-6), rel=1e-12)
    text = "surface: {file: oblong.x3p, unit: um%s}"
    with pytest.raises(
        StudyError, match=r"surface\.resample: missing: .*oblong\.x3p has pixels of 0\.25 by .* um"
    ) as caught:
        loads(text % "", tmp_path / "study.yaml").cases()
    assert "give resample: square" in str(caught.value)
    (case,) = loads(text % ", resample: square", tmp_path / "study.yaml").cases()
    surface = one_case.surface_of(case)
    assert surface.spacing == pytest.approx(PIXEL * min(1.0, off), rel=1e-12)
    assert surface.side == pytest.approx(case.L, rel=1e-15)
    assert np.abs(surface.heights - lattice.squared(HEIGHTS, off)).max() < 1e-8
    assert case.surface_text.startswith("heights interpolated onto square pixels of the finer spacing")
    with pytest.raises(StudyError, match=r"surface\.L: is 3 um, but .* gives 1\.5e-06 m"):
        loads(text % ", resample: square, L: 3 um", tmp_path / "study.yaml").cases()


def test_pixels_square_to_a_tenth_of_one_over_a_thousand_are_square(tmp_path: Path) -> None:
    _write(tmp_path / "nearly.x3p", pixel=(PIXEL, 1.00005 * PIXEL))
    (case,) = loads("surface: {file: nearly.x3p}", tmp_path / "study.yaml").cases()
    assert one_case.surface_of(case).shape == (7, 5)


def test_pixels_too_oblong_are_refused_whatever_is_asked(tmp_path: Path) -> None:
    _write(tmp_path / "oblong.x3p", pixel=(PIXEL, 3 * PIXEL))
    for keys in ("", ", resample: square"):
        with pytest.raises(StudyError, match=r"surface\.resample: .*allowed: one side up to 2 times the other"):
            loads(f"surface: {{file: oblong.x3p{keys}}}", tmp_path / "study.yaml").cases()


def test_the_same_surface_on_oblong_pixels_is_pressed_the_same(tmp_path: Path) -> None:
    def heights(pixel: tuple[float, float]) -> np.ndarray:
        x, y = np.meshgrid(pixel[0] * np.arange(33), pixel[1] * np.arange(33), indexing="ij")
        return np.cos(x) + np.sin(0.8 * y + 0.3 * x)

    pressures = []
    for name, pixel, keys in (("square", (0.25, 0.25), ""), ("oblong", (0.25, 0.2503), ", resample: square")):
        _write(tmp_path / f"{name}.x3p", heights(pixel), pixel=pixel)
        text = f"surface: {{file: {name}.x3p, unit: um{keys}}}\nsweep: {{steps: 1, to: {{indentation: 1}}}}"
        (case,) = loads(text, tmp_path / "study.yaml").cases()
        pressures.append(one_case.run_case(case).mean_pressure.item())
    assert pressures[1] == pytest.approx(pressures[0], rel=1e-3)


def test_two_bodies_on_oblong_pixels_are_resampled_each(tmp_path: Path) -> None:
    for name, heights in (("one", HEIGHTS), ("other", 2.0 * HEIGHTS), ("both", HEIGHTS + 2.0 * HEIGHTS[::-1])):
        _write(tmp_path / f"{name}.x3p", heights, pixel=(1.5 * PIXEL, PIXEL))
    added, both = (
        one_case.surface_of(loads(f"surface: {{{keys}, unit: um, resample: square}}", tmp_path / "s.yaml").cases()[0])
        for keys in ("file: one.x3p, against: {file: other.x3p, mirror: x}", "file: both.x3p")
    )
    assert added.shape == both.shape == (10, 5)
    assert np.abs(added.heights - both.heights).max() < 1e-13


def test_a_crop_in_lengths_counts_oblong_pixels(tmp_path: Path) -> None:
    _write(tmp_path / "oblong.x3p", np.random.default_rng(0).normal(size=(21, 21)), pixel=(PIXEL, 2 * PIXEL))
    crop = "crop: {x: [1 um, 3 um], y: [1 um, 3 um]}"
    (case,) = loads(f"surface: {{file: oblong.x3p, {crop}, resample: square}}", tmp_path / "s.yaml").cases()
    assert case.treatment.crop == ((4, 12), (2, 6))
    surface = one_case.surface_of(case)
    assert surface.shape == (9, 9)
    assert surface.side == pytest.approx(2e-6, rel=1e-12)


def test_a_line_is_no_map(tmp_path: Path) -> None:
    path = tmp_path / "line.dat"
    path.write_text("\n".join(f"{x} {x * x}" for x in range(9)), encoding="ascii")
    with pytest.raises(SurfaceError, match=r"line\.dat: .*shape \(9, 2\); allowed: two dimensions of at least 3"):
        reading.describe(path)


@pytest.mark.parametrize("suffix", [".al3d", ".sur", ".x3p", ".png", ".hgt", ".nms", ""])
@pytest.mark.parametrize("size", [0, 1, 2, 512, 18, 20_000])
def test_what_no_instrument_wrote_is_refused_by_name(tmp_path: Path, suffix: str, size: int) -> None:
    path = tmp_path / f"noise{suffix}"
    path.write_bytes(np.random.default_rng(size).bytes(size))
    if suffix == ".hgt" and size in (18, 512, 20_000):  # a square of 16-bit numbers is all that this format is
        assert reading.describe(path).shape == (round((size / 2) ** 0.5),) * 2
        return
    for call in (reading.describe, reading.read):
        with pytest.raises(RoughvolError) as caught:
            call(path)
        assert str(path) in str(caught.value)
        assert len(str(caught.value)) < len(str(path)) + 250


@pytest.mark.parametrize("suffix", [".x3p", ".gwy", ".sdf"])
def test_a_damaged_file_is_read_or_refused(tmp_path: Path, suffix: str) -> None:
    path = _write_sdf(tmp_path / "scan.sdf") if suffix == ".sdf" else _write(tmp_path / f"scan{suffix}")
    whole = path.read_bytes()
    chance = random.Random(7)
    read = 0
    for _ in range(60):
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
    assert read < 60


def test_an_absent_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"none\.x3p: cannot be read as \.x3p: No such file"):
        reading.read(tmp_path / "none.x3p")


# In a study


def _study(tmp_path: Path, text: str) -> Any:
    return loads(text, tmp_path / "study.yaml")


def test_a_study_takes_length_and_unit_from_the_file(tmp_path: Path) -> None:
    _write_sdf(tmp_path / "scan.sdf")
    study = _study(tmp_path, "surface: {file: scan.sdf}")
    (case,) = study.cases()
    assert (case.L, case.length_unit, case.bodies[0].unit) == (pytest.approx(6 * PIXEL, rel=1e-12), "um", "um")
    assert loads(study.to_yaml()).cases() == (case,)


def test_the_unit_of_the_study_converts_that_of_the_file(tmp_path: Path) -> None:
    _write_sdf(tmp_path / "scan.sdf")
    texts = ["", ", unit: um", ", unit: nm", ", L: 0.0015 mm", ", L: 1.5, unit: um", ", L: 1.5"]
    cases = [_study(tmp_path, f"surface: {{file: scan.sdf{text}}}").cases()[0] for text in texts]
    assert cases[0].id == cases[1].id
    assert cases[4].id == cases[5].id
    assert [case.length_unit for case in cases] == ["um", "um", "nm", "mm", "um", "um"]
    assert [case.L for case in cases[2:]] == [pytest.approx(6000 * PIXEL, rel=1e-12), 0.0015, 1.5, 1.5]


def test_two_bodies_must_fit(tmp_path: Path) -> None:
    _write_sdf(tmp_path / "scan.sdf")
    _write(tmp_path / "same.x3p")
    _write(tmp_path / "coarse.x3p", pixel=(2 * PIXEL, 2 * PIXEL))
    np.save(tmp_path / "silent.npy", HEIGHTS)
    (case,) = _study(tmp_path, "surface: {file: scan.sdf, against: {file: same.x3p}}").cases()
    assert [body.unit for body in case.bodies] == ["um", "m"]
    with pytest.raises(StudyError, match=r"surface\.against\.file: the files differ in size, 1\.5 x 1 and 3 x 2 um"):
        _study(tmp_path, "surface: {file: scan.sdf, against: {file: coarse.x3p}}").cases()
    (case,) = _study(
        tmp_path, "surface: {file: scan.sdf, against: {file: coarse.x3p, header: ignore, heights_unit: m}}"
    ).cases()
    assert (case.L, case.bodies[1].numbers_in) == (pytest.approx(1.5), "m")
    with pytest.raises(StudyError, match=r"surface\.unit: missing: .*silent\.npy does not give its unit, .* is in um"):
        _study(tmp_path, "surface: {file: scan.sdf, against: {file: silent.npy}}").cases()
    (case,) = _study(tmp_path, "surface: {file: silent.npy, unit: nm, against: {file: scan.sdf}}").cases()
    assert (case.length_unit, case.L) == ("nm", pytest.approx(6000 * PIXEL, rel=1e-12))


def test_a_broken_file_is_a_problem_of_the_study(tmp_path: Path) -> None:
    (tmp_path / "scan.sur").write_bytes(b"DIGITAL SURF" + bytes(10))
    with pytest.raises(StudyError, match=r"surface\.file: .*scan\.sur: is damaged, or in none of the formats"):
        _study(tmp_path, "surface: {file: scan.sur, L: 1}").cases()


# Several arrays or channels


def _hdf5(path: Path, **arrays: np.ndarray) -> Path:
    with pytest.importorskip("h5py").File(path, "w") as stored:
        for name, array in arrays.items():
            stored[name.replace("__", "/")] = array
    return path


def _matlab(path: Path, **arrays: np.ndarray) -> Path:
    scipy.io.savemat(path, arrays)
    return path


@pytest.mark.parametrize("write", [_hdf5, _matlab])
def test_of_several_arrays_one_must_be_named(tmp_path: Path, write: Any) -> None:
    suffix = ".h5" if write is _hdf5 else ".mat"
    path = write(tmp_path / f"several{suffix}", branch=np.zeros((17, 30)), z=HEIGHTS, L=np.full((1, 1), 2.0))
    with pytest.raises(
        DatasetError, match=r"several.*give the array of heights \(variable\); arrays in the file: .*z \(7, 5\)"
    ):
        reading.describe(path)
    with pytest.raises(StudyError, match=r"surface\.file: .*several.*variable.*branch \(17, 30\)"):
        loads(f"surface: {{file: {path.name}, L: 1 um}}", tmp_path / "study.yaml").cases()
    assert np.array_equal(reading.read(path, "z"), HEIGHTS)
    assert reading.describe(path, "z").channel == "z"
    with pytest.raises(DatasetError, match=r"has no array 'Z'; arrays in the file: .*z \(7, 5\)"):
        reading.describe(path, "Z")
    path = write(tmp_path / f"one{suffix}", z=HEIGHTS, dx=np.full((1, 1), 0.5), corners=np.zeros((2, 2)))
    assert np.array_equal(reading.read(path), HEIGHTS)
    path = write(tmp_path / f"none{suffix}", dx=np.full((1, 1), 0.5))
    with pytest.raises(DatasetError, match=r"holds no map of at least 3 x 3 nodes; arrays in the file: dx \(1, 1\)"):
        reading.describe(path)


def test_a_data_set_in_a_group_is_named_by_its_path(tmp_path: Path) -> None:
    path = _hdf5(tmp_path / "scan.h5", Channel_000__Error=np.zeros((64, 4)), Channel_000__Height=HEIGHTS)
    with pytest.raises(DatasetError, match=r"Channel_000/Error \(64, 4\), Channel_000/Height \(7, 5\)"):
        reading.describe(path)
    assert np.array_equal(reading.read(path, "Channel_000/Height"), HEIGHTS)
    with pytest.raises(SurfaceError, match=r"Channel_000/Error holds no heights, by its name"):
        reading.describe(path, "Channel_000/Error")


def _gwyddion(path: Path, *titles: str) -> Path:
    """Write channels i + 1 times the heights, each with a title of ten letters."""
    items = b""
    for number, title in enumerate(titles):
        _write(path, (number + 1.0) * HEIGHTS)
        content = path.read_bytes().replace(b"Topography\0", title.encode("ascii") + b"\0")
        start = content.index(b"GwyContainer\0") + len(b"GwyContainer\0")
        items += content[start + 4 :].replace(b"/0/data", f"/{number}/data".encode("ascii"))
    path.write_bytes(content[:start] + len(items).to_bytes(4, "little") + items)
    return path


@pytest.mark.parametrize("title", ["Deflection", "AmplError_1", "PhaseTrace", "Lock-In Am", "Modulus 12"])
def test_a_channel_that_is_no_heights_by_its_name_is_refused(tmp_path: Path, title: str) -> None:
    title = title[:10]
    path = _gwyddion(tmp_path / "scan.gwy", title, "Topography", "Height Ret")
    description = reading.describe(path)
    assert description.channel == "Topography"
    assert "2 maps (1: Topography, 2: Height Ret); 1 is read" in description.notes[0]
    assert np.allclose(reading.read(path) * 1e6, 2.0 * HEIGHTS)
    assert np.allclose(reading.read(path, "Height Ret") * 1e6, 3.0 * HEIGHTS)
    for named in (title, "0"):
        with pytest.raises(
            SurfaceError,
            match=rf"scan\.gwy: {title} holds no heights, by its name; channels of heights: 1: Topography, 2: Height",
        ):
            reading.describe(path, named)
    with pytest.raises(
        DatasetError, match=rf"has no channel 'z'; .*0: {title} \(no heights\), 1: Topography \(height\)"
    ):
        reading.describe(path, "z")
    _gwyddion(path, title)
    with pytest.raises(SurfaceError, match=rf"{title} holds no heights, by its name; channels of heights: none"):
        reading.describe(path)


@pytest.mark.parametrize(
    ("name", "kind", "unit", "reason"),
    [
        ("Height", "height", "nm", ""),
        ("ZSensor", "height", "nm", ""),
        ("Scan forward (Z-Axis)", "height", "m", ""),
        ("Amplitude of the height", "height", "m", ""),
        ("Default", "height", None, ""),
        ("Phase", "height", ("nm", None), "its unit is no length"),
        ("Sensor", "voltage", "m", "holds voltage, not heights"),
        ("HeightError", "height", "nm", "by its name"),
        ("AmplitudeTrace", "height", "m", "by its name"),
        ("AmplitudeError", "height", "nm", "by its name"),
        ("Lock-In Amplitude", "height", "m", "by its name"),
        ("lockInPhase", "height", "m", "by its name"),
    ],
)
def test_kind_unit_and_name_tell_heights_from_other_channels(name: str, kind: str, unit: Any, reason: str) -> None:
    data = SimpleNamespace(name=name, data_kind=SimpleNamespace(value=kind), unit=unit)
    found = instrument._no_heights(data)
    assert reason in found
    assert bool(found) == bool(reason)


# Formats whose library is at odds with other readers


@pytest.mark.parametrize(("dx", "dy", "keys"), [(312.5, 312.5, ""), (312.5, 250.0, ", resample: square")])
def test_the_size_in_nms_has_no_unit_and_is_that_of_the_study(tmp_path: Path, dx: float, dy: float, keys: str) -> None:
    path = tmp_path / "scan.nms"
    path.write_bytes(nms(HEIGHTS, dx, dy))
    description = reading.describe(path)
    assert (description.shape, description.unit, description.heights_unit) == ((7, 5), None, "um")
    assert np.abs(reading.read(path) - HEIGHTS).max() < 1e-4 * np.ptp(HEIGHTS)
    for keys_without_L in ("", ", unit: um", ", unit: nm"):
        with pytest.raises(StudyError, match=r"surface\.L: missing: .*scan\.nms.* pixels are 312\.5 by .*unknown unit"):
            loads(f"surface: {{file: scan.nms{keys_without_L}{keys}}}", tmp_path / "study.yaml").cases()
    (case,) = loads(f"surface: {{file: scan.nms, L: 1.875 um{keys}}}", tmp_path / "study.yaml").cases()
    surface = one_case.surface_of(case)
    assert surface.side == pytest.approx(1.875 if dx == dy else 7 * 0.25, rel=1e-12)
    assert surface.shape == ((7, 5) if dx == dy else (8, 5))
    assert not case.notes
    if dx != dy:
        with pytest.raises(StudyError, match=r"surface\.resample: missing: .*pixels of 0\.3125 by 0\.25 um"):
            loads("surface: {file: scan.nms, L: 1.875 um}", tmp_path / "study.yaml").cases()


def test_nms_is_not_taken_for_another_format(tmp_path: Path) -> None:
    """The first bytes of a file may be those of a MATLAB file of version 4."""
    path = tmp_path / "scan.nms"
    content = bytearray(nms(HEIGHTS, 312.5, 312.5))
    content[:16] = bytes.fromhex("02000000010000000000000000ff0000")
    path.write_bytes(content)
    assert reading.describe(path).reader == "SurfaceTopography nms"


@pytest.mark.parametrize("kind", ["double", "float", "short"])
def test_wsxm_stores_falling_x_and_rising_y(tmp_path: Path, kind: str) -> None:
    """The library turns the image by 180 degrees, as the description of the format has it and Gwyddion does."""
    path = tmp_path / "scan.stp"
    path.write_bytes(wsxm(HEIGHTS[:, ::-1], kind, (7 * PIXEL, 5 * PIXEL)))  # lines of the image run down y
    assert reading.describe(path).sides == pytest.approx((6 * PIXEL * 1e3, 4 * PIXEL * 1e3))
    heights = 1e-3 * reading.read(path)
    assert np.abs(heights - heights.mean() - (HEIGHTS - HEIGHTS.mean())).max() < 1e-3
