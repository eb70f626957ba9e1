"""Measured bodies: read, treated and added as a study says, and pressed as the surface that comes out."""

import pickle

import numpy as np
import pytest
import xarray as xr

from roughvol.campaign import case_surface, one_case
from roughvol.errors import SurfaceError
from roughvol.store import dataset, provenance
from roughvol.surfaces.midpoint import random_midpoint_displacement
from tests.campaign.kit import values_of
from tests.study.kit import case_of

FIRST = random_midpoint_displacement(2.3, 3, seed=1).heights
SECOND = random_midpoint_displacement(2.5, 3, seed=2).heights
TILT = 4.0 + 0.5 * np.arange(9)[:, np.newaxis] - 0.25 * np.arange(9)
HOLES = np.zeros((9, 9), dtype=bool)
HOLES[2, 3] = HOLES[0, 0] = HOLES[5:7, 5] = True


@pytest.fixture
def folder(tmp_path):
    np.save(tmp_path / "a.npy", FIRST)
    np.save(tmp_path / "b.npy", SECOND)
    np.save(tmp_path / "holed.npy", np.where(HOLES, np.nan, FIRST + TILT))
    return tmp_path


def _case(folder, surface, rest=""):
    return case_of(folder, f"{surface}, L: 2", rest)


def test_an_untreated_file_is_pressed_bit_for_bit(folder):
    surface = case_surface.surface_of(_case(folder, "file: a.npy"))
    assert np.array_equal(surface.heights, FIRST)
    assert (surface.spacing, surface.filled) == (0.25, 0)


def test_holes_of_both_bodies_are_counted_once(folder):
    text = "file: holed.npy, missing: nearest, against: {file: holed.npy, mirror: x}"
    surface = case_surface.surface_of(_case(folder, text))
    assert surface.filled == pickle.loads(pickle.dumps(surface)).filled == (HOLES | HOLES[::-1]).sum()


@pytest.mark.parametrize(
    ("surface", "said"),
    [
        ("file: holed.npy", r"holed\.npy: 4 heights are missing"),
        ("file: a.npy, against: {file: holed.npy}", r"holed\.npy: 4 heights are missing"),
        ("file: a.npy, low_pass: 0.4", r"a\.npy: low_pass is 0\.4 in the unit of L; allowed: 0\.5 .* to 2 "),
    ],
)
def test_what_cannot_be_pressed_is_refused_by_name(folder, surface, said):
    with pytest.raises(SurfaceError, match=said):
        case_surface.surface_of(_case(folder, surface))


def test_a_file_that_changes_after_the_study_was_loaded_is_refused(folder):
    case = _case(folder, "file: a.npy, against: {file: b.npy}")
    np.save(folder / "b.npy", 2.0 * SECOND)
    with pytest.raises(SurfaceError, match=r"b\.npy has changed since the study was loaded"):
        case_surface.surface_of(case)


# Pressed


def test_units_and_treatment_are_in_the_file_of_the_case(folder):
    text = "file: holed.npy, unit: um, level: tilt, missing: nearest"
    case = _case(folder, text, "sweep: {steps: 2}\nrecord: {volume_density: {bins: 4}, heights: true}")
    stored = one_case.run_case(case)
    lengths = dict.fromkeys(("L", "Sq", "z_max", "heights"), "um")
    units = lengths | {"volume_density": "um^-3", "volume_density_edges": "um^3", "free_volume": "1"}
    assert {name: stored[name].units for name in units} == units
    assert stored.attrs["length_unit"] == "um"
    words = "least-squares tilt of the known heights subtracted; missing heights filled with the nearest known one"
    assert stored.attrs["surface"] == words
    assert stored["filled_fraction"].item() == 4 / 81
    together = dataset.combine([stored], stored.attrs)
    assert together["Sq"].units == "um"


def test_the_treatment_of_several_files_names_unit_and_crop_of_each(folder):
    for unit, step in (("um", 1), ("mm", 2)):
        np.savetxt(folder / f"{unit}.txt", FIRST[::step, ::step], header=f"heights in {unit}")
    cases = [_case(folder, f"file: {unit}.txt, unit: um, level: tilt, crop: {{x: [0, 0.5]}}") for unit in ("um", "mm")]
    told = provenance.provenance("", fft={}, cases=cases)["surface"].split("; ")
    assert told[0] == "um.txt: cropped to nodes 0 to 4 along x and 0 to 8 along y"
    assert told[1].endswith("subtracted")
    assert told[2:4] == ["numbers of um.txt are in um", "mm.txt: cropped to nodes 0 to 2 along x and 0 to 4 along y"]
    assert told[4:] == ["numbers of mm.txt are in mm"]


@pytest.mark.parametrize(("keys", "cut_off"), [("unit: mm, low_pass: 800 um", "0.8 mm"), ("low_pass: 0.8", "0.8")])
def test_the_cut_off_is_told_in_the_unit_of_the_study(folder, keys, cut_off):
    told = _case(folder, f"file: a.npy, {keys}").surface_text
    assert told.startswith(f"waves shorter than {cut_off} removed")


def test_the_unit_changes_no_number(folder):
    cases = (_case(folder, f"file: a.npy{unit}", "sweep: {steps: 2}") for unit in ("", ", unit: nm"))
    plain, named = map(one_case.run_case, cases)
    xr.testing.assert_equal(values_of(plain), values_of(named))
    assert plain["Sq"].units == "length"
    assert not {"length_unit", "surface"} & plain.attrs.keys()
    assert "filled_fraction" not in plain
