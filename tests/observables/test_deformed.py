"""Texture and spectrum before load and under load: the deformed surface, its region, and what a study asks for."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.one_case import run_case
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import solve
from roughvol.errors import StudyError
from roughvol.observables import deformed
from roughvol.observables.regions import View, check
from roughvol.observables.variables import VARIABLES
from roughvol.store import dataset
from roughvol.study import loads
from roughvol.surfaces import texture
from roughvol.surfaces.psd import spectral
from roughvol.surfaces.surface import Surface
from tests.observables.kit import answer

TEXT = """
surface: {D: 2.3, m: 5, seeds: [1], L: 100}
sweep: {steps: 4, to: {indentation: 3}}
record: {texture: WHICH, fields_at: {contact_area: [0.02, 0.05]}, heights: true}
"""
AT = "{at: {contact_area: [0.02, 0.05]}}"
NUMBERS = ("Sa", "Ssk", "Sku", "Sp", "Sv", "Sz", "Svi", "Sbi", "hurst_structure")


def _case(which=AT, *, region=""):
    text = TEXT.replace("WHICH", which)
    return loads(text.replace("heights: true", f"heights: true, region: {region}") if region else text).cases()[0]


def test_the_deformed_surface_is_the_rough_one_less_the_displacement():
    surface = surface_of(_case())
    half_space = HalfSpace(surface.shape)
    contact = solve(surface, half_space, 2.0, rtol=1e-9)
    view = View(_case(), surface, contact, half_space)
    scaled = contact.pressure() / (np.pi * (surface.shape[0] - 1))
    shape = surface.heights - surface.Sq * half_space.displacement(scaled)
    stored = deformed.under_load(view)
    for name, number in deformed.numbers(shape, surface.spacing).items():
        assert_allclose(stored[f"{name}_loaded"], number, rtol=1e-6, err_msg=name)
    z = shape / surface.Sq
    assert_allclose(stored["structure_function_loaded"], texture.structure_function(z, deformed.lags(z.shape)))


def test_the_material_ratio_under_load_drops_from_the_contact_to_zero_at_the_plane():
    result = run_case(_case()).squeeze(("D", "m", "seed"))
    for state in (result.isel(texture_at=0), result.isel(texture_at=1)):
        plane, area = float(state.texture_at_free_volume), float(state.texture_at_contact_area_fraction)
        ratio = state.material_ratio_loaded
        assert np.all(ratio[state.material_level > plane] == 0.0)
        assert np.all(ratio[state.material_level < plane] >= area)
        assert ratio[0] == 1.0
        assert np.all(np.diff(ratio) <= 0.0)
    assert result.material_ratio.sel(material_level=0.0) == (result.heights >= result.heights.mean()).mean()


@pytest.mark.parametrize("region", ["{x: [0, 0.5]}", "{x: [0.4, 0.44], y: [0.4, 0.44]}"])
def test_texture_is_of_the_region(region):
    case = _case("{at: {indentation: 2}}", region=region)
    surface = surface_of(case)
    result = run_case(case).squeeze(("D", "m", "seed", "texture_at"))
    x, y = case.record.region.x, case.record.region.y
    inside = tuple(slice(int(np.ceil(a * 32)), int(b * 32) + 1) for a, b in (x, y))
    assert result.Sa == texture.Sa(surface.heights[inside])
    assert result.Sq_region == texture.Sq(surface.heights[inside])
    assert_array_equal(result.Sdq_region, texture.Sdq(surface.heights[inside], surface.spacing))
    assert result.Sq == surface.Sq
    gap = solve(surface, HalfSpace(surface.shape), 2.0).gap()[inside]
    assert_allclose(result.Sa_loaded, texture.Sa(-gap * surface.Sq), rtol=1e-4)


def test_curves_of_several_sizes_are_one_dataset():
    text = TEXT.replace("WHICH", "true").replace("m: 5", "m: [3, 5]").replace("[0.02, 0.05]", "0.02")
    study = dataset.combine([run_case(case) for case in loads(text).cases()], {}).squeeze(("D", "seed"))
    assert study.lag.values.tolist() == [1, 2, 4, 8, 16]
    assert_array_equal(study.structure_function.isnull().sum("lag"), [2, 0])
    assert study.material_ratio.sizes["material_level"] == 101
    assert not study.material_ratio.isnull().any()
    assert study.lag.dtype.kind == "i"


def test_a_measured_surface_has_its_texture(tmp_path):
    heights = np.random.default_rng(3).normal(size=(20, 33)).cumsum(0).cumsum(1)
    np.save(tmp_path / "z.npy", heights)
    text = "surface: {file: z.npy, L: 2 mm}\nsweep: {steps: 3}\nrecord: {texture: true, region: {x: [0, 0.8]}}"
    stored = answer(text, tmp_path / "a.yaml")
    assert stored.Svi == texture.Svi(heights[:16])
    assert stored.Sa.attrs == {"units": "mm", "long_name": VARIABLES["Sa"].long_name, "symbol": "Sa"}
    assert stored.Sa_loaded < stored.Sa


def test_without_contact_there_are_texture_and_spectrum_before_load():
    text = PERIOD + "sweep: {steps: 0}\nrecord: {texture: true, psd: true}"
    (case,) = loads(text).cases()
    result = run_case(case)
    assert {*NUMBERS, "material_ratio", "structure_function"} <= set(result.data_vars)
    assert_array_equal(result["psd"].squeeze(), spectral(surface_of(case)).psd)
    assert not [name for name in result.variables if "_loaded" in str(name) or "texture_at" in str(name)]


def test_a_flat_surface_has_no_ratios(tmp_path):
    np.save(tmp_path / "z.npy", np.full((9, 9), 2.5))
    text = "surface: {file: z.npy, L: 1, sides: free}\nsweep: {steps: 2, to: {indentation: 1}}\nrecord: {texture: true}"
    result = run_case(loads(text, tmp_path / "a.yaml").cases()[0])
    for suffix in ("", "_loaded"):
        assert all(np.isnan(result[name + suffix]).all() for name in ("Ssk", "Sku", "Svi", "Sbi", "hurst_structure"))
        assert result["Sz" + suffix].item() == 0.0
        assert not np.isnan(result["structure_function" + suffix]).any()


# the spectrum


PERIOD = "surface: {D: 2.3, m: 5, L: 4.0, seeds: [3], sides: periodic}\n"
WAVES_SWEEP = "sweep: {steps: 3, to: {pressure: 2.0}}\n"
WAVES_AT = "record: {psd: {at: {pressure: [0.5, 2.0]}}, fields_at: {pressure: [0.5, 2.0]}"


@pytest.mark.parametrize("surface", [PERIOD, PERIOD.replace(", sides: periodic", "")], ids=["period", "patch"])
def test_under_load_it_is_that_of_the_gap_in_the_units_of_the_heights(surface):
    (case,) = loads(surface + WAVES_SWEEP + WAVES_AT + "}").cases()
    data, made = run_case(case).squeeze(), surface_of(case)
    for number in (0, 1):
        gap = data["gap"].values[number] * made.unit
        wanted = spectral(Surface(gap, made.spacing, sides=made.sides))  # a sign changes no power
        assert_allclose(data["psd_loaded"].values[number], wanted.psd, rtol=1e-9)
        assert float(data["rms_slope_loaded"][number]) == pytest.approx(wanted.rms_slope, rel=1e-9)
        assert float(data["nayak_parameter_loaded"][number]) == pytest.approx(wanted.nayak, rel=1e-9)
    assert data["psd_loaded"].attrs["units"] == "length^4"
    assert "wave_number" not in data
    heights = [float(data["rms_height"]), *data["rms_height_loaded"].values.tolist()]
    assert heights == sorted(heights, reverse=True)  # load flattens
    assert data["psd_at"].values.tolist() == ["pressure=0.5", "pressure=2"]
    if case.periodic:  # no window takes part
        exact = data["gap"].std(("x", "y")).values * made.unit
        assert_allclose(data["rms_height_loaded"], exact, rtol=1e-9)


def test_a_region_is_a_patch_with_its_own_wave_numbers():
    (case,) = loads(PERIOD + WAVES_SWEEP + WAVES_AT + ", region: interior}").cases()
    data, made = run_case(case).squeeze(), surface_of(case)
    inside = np.s_[8:25, 8:25]
    wanted = spectral(Surface(made.heights[inside], made.spacing))
    assert_allclose(data["psd"], wanted.psd, rtol=1e-9)
    assert_allclose(data["wave_number"], 2.0 * math.pi * wanted.wave / (16 * made.spacing))
    loaded = spectral(Surface(data["gap"].values[0][inside] * made.unit, made.spacing))
    assert_allclose(data["psd_loaded"].values[0], loaded.psd, rtol=1e-9)


def test_full_contact_leaves_no_waves():
    (case,) = loads(PERIOD + "sweep: {steps: 2}\nrecord: {psd: {at: last}}").cases()
    data = run_case(case).squeeze()
    assert float(data["rms_height_loaded"]) < 1e-9 * float(data["rms_height"])


def test_a_region_of_two_elements_is_refused():
    (case,) = loads(PERIOD + WAVES_SWEEP + "record: {psd: true, region: {x: [0, 0.05]}}").cases()
    with pytest.raises(StudyError, match=r"record\.region.*2 × 32 elements; record\.psd needs 3 × 3"):
        check(case)
