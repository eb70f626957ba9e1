"""Numbers in units: closed forms, laws of scaling, and nothing solved for them."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from roughvol.campaign import execution
from roughvol.campaign.one_case import run_case
from roughvol.errors import StudyError
from roughvol.observables.variables import HEIGHT_POWERS, VARIABLES
from roughvol.store import dataset, dimensional
from roughvol.store.dataset import Dataset
from roughvol.study import loads
from tests.campaign.kit import collected, files_of

LEAK = "leak_rate: {pressure_drop: 2 bar, viscosity: 3 mPa*s, unit: mm^3/s}"
WANTED = f"""
  dimensional:
    pressure: MPa
    free_volume: mm^3/m^2
    mean_gap: um
    separation: um
    critical_gap: nm
    {LEAK}
"""
TEXT = """
name: units
surface: {D: 2.3, m: 4, seeds: 2, L: 100 um}
material: {E_star: 2 GPa}
sweep: {steps: 4, to: {indentation: 2}}
record:
  heights: true
  fields_at: {step: [1, 2]}
  volume_density: {}
  box_counting: {}
  texture: {at: {step: [1, 4]}}
  transport: {transmissivity: every-step, constriction: every-step}
"""
MADE = {
    "nominal_pressure",
    "free_volume_per_area",
    "mean_gap",
    "mean_plane_separation",
    "critical_opening",
    "leak_rate",
}


@pytest.fixture(scope="module")
def plain() -> list[Dataset]:
    return [run_case(case) for case in loads(TEXT).cases()]


@pytest.fixture(scope="module")
def results(plain: list[Dataset]) -> Dataset:
    return collected(loads(TEXT + WANTED), plain)


def test_two_parallel_plates_leak_by_the_closed_form(results: Dataset) -> None:
    # 5 um apart, 100 um long; W_y/W_x = 2. Q = h³ ΔP w/(12 μ l) by hand, in SI.
    plates = results.drop_vars(MADE).isel(seed=[0]).copy(deep=True)
    plates = plates.assign(Sq=plates.Sq * 0 + 2.5, free_volume=plates.free_volume * 0 + 2.0)
    plates = plates.assign(transmissivity=plates.transmissivity.fillna(0.0) * 0 + 1.0)
    plates["region_aspect"] = plates.region_aspect * 0 + 2.0
    found = dimensional.in_units(plates, loads(TEXT + WANTED), "um")
    along = (5e-6) ** 3 * 2e5 * 200e-6 / (12 * 3e-3 * 100e-6) * 1e9
    across = (5e-6) ** 3 * 2e5 * 100e-6 / (12 * 3e-3 * 200e-6) * 1e9
    assert_allclose(found.leak_rate.sel(axis="x"), along, rtol=1e-12)
    assert_allclose(found.leak_rate.sel(axis="y"), across, rtol=1e-12)
    assert_allclose(found.mean_gap, 5.0, rtol=1e-12)
    assert_allclose(found.free_volume_per_area, 5e-6 * 1e9, rtol=1e-12)  # m³/m² in mm³/m²


def test_pressure_volume_and_gaps_are_the_starred_ones_times_their_scales(results: Dataset) -> None:
    sigma = results.Sq  # um
    assert_allclose(results.nominal_pressure, results.mean_pressure * sigma / 100 * 2000, rtol=1e-12)
    assert_allclose(results.mean_plane_separation, results.separation * sigma, rtol=1e-12)
    assert_allclose(results.critical_opening, results.critical_gap * sigma * 1000, rtol=1e-12)
    assert_allclose(results.free_volume_per_area, results.mean_gap * 1e3, rtol=1e-12)


def test_what_is_asked_for_at_a_state_that_no_case_reaches_is_missing_and_told(results: Dataset) -> None:
    never = TEXT.replace("every-step", "{contact_area: 0.99}")
    made = collected(loads(never + WANTED))
    for name in ("leak_rate", "critical_opening"):
        assert made[name].isnull().all()
        assert made[name].sizes == {**made.free_volume.sizes, "axis": 2}
    assert made.mean_gap.notnull().all()
    assert dataset.unreached(made) == {"transmissivity": 2, "constriction": 2}
    assert dataset.unreached(results) == {}


def test_what_is_added_is_described_with_the_units_asked_for(results: Dataset) -> None:
    units = {"nominal_pressure": "MPa", "free_volume_per_area": "mm^3/m^2", "mean_gap": "um", "leak_rate": "mm^3/s"}
    units |= {"critical_opening": "nm", "mean_plane_separation": "um"}
    assert {name: results[name].attrs["units"] for name in units} == units
    assert {name: results[name].attrs["symbol"] for name in MADE} == {name: VARIABLES[name].symbol for name in MADE}
    assert results.leak_rate.attrs["pressure_drop"] == "2 bar"
    assert results.leak_rate.attrs["viscosity"] == "3 mPa*s"
    assert results.leak_rate.dims == ("D", "m", "seed", "step", "axis")


def test_the_same_study_in_other_units_gives_the_same_numbers() -> None:
    small = (TEXT + WANTED).replace("m: 4, seeds: 2, ", "m: 3, seeds: 1, Sq: 1.5 um, ")
    first = collected(loads(small))
    for length, modulus in (("0.1 mm", "2000 MPa"), ("1.0e+5 nm", "20 kbar")):
        other = collected(loads(small.replace("100 um", length).replace("2 GPa", modulus)))
        for name in MADE:
            assert_allclose(other[name], first[name], rtol=1e-9)


def test_without_Sq_the_heights_are_those_of_the_generator_in_the_unit_of_L(results: Dataset) -> None:
    other = collected(loads((TEXT + WANTED).replace("100 um", "100 mm")))
    assert_allclose(other.mean_gap, results.mean_gap * 1e3, rtol=1e-9)
    assert_allclose(other.leak_rate, results.leak_rate * 1e9, rtol=1e-9)
    assert_allclose(other.nominal_pressure, results.nominal_pressure, rtol=1e-9)


# Heights scaled to an Sq


def test_scaled_heights_are_those_of_a_rougher_surface(plain: list[Dataset], results: Dataset, tmp_path: Path) -> None:
    scaled = collected(loads((TEXT + WANTED).replace("L: ", "Sq: 0.7 um, L: ")), plain[:1])
    heights = scaled.heights.isel(D=0, m=0, seed=0).transpose("x", "y").values
    np.save(tmp_path / "z.npy", heights)
    text = (TEXT + WANTED).replace("D: 2.3, m: 4, seeds: 2,", "file: z.npy, sides: free,")
    pressed = collected(loads(text, tmp_path / "study.yaml"))
    assert_allclose(heights.std(), 0.7, rtol=1e-12)
    one, other = scaled.isel(D=0, m=0, seed=0), pressed.isel(case=0)
    names = set(map(str, pressed.data_vars)) - {"iterations", "convolutions", "convolutions_fp32", "residual"}
    names -= {name for name in names if VARIABLES[name].kind == "text" or VARIABLES[name].units == "s"}
    for name in names - {"mean_pressure_bound", "transmissivity_conservation_error"}:
        assert_allclose(one[name].astype(float), other[name].astype(float), rtol=2e-5, atol=1e-6, err_msg=name)
    starred = ("mean_pressure", "free_volume", "contact_area_fraction", "transmissivity", "box_count")
    for name in starred:
        assert_array_equal(scaled[name], results[name].isel(seed=[0]))


def test_every_stored_number_with_a_length_has_its_power_of_the_heights() -> None:
    made = MADE | {"fluid_leak_rate", "flux_at_leak_rate"}
    lengths = {name for name, row in VARIABLES.items() if "length" in row.units} - made - {"L", "wave_number"}
    assert lengths == {name for name in HEIGHT_POWERS if not name.startswith(("Sdq", "rms_slope"))}


# What it costs


def test_units_and_Sq_make_no_case_anew(tmp_path: Path) -> None:
    small = TEXT.replace("m: 4, seeds: 2", "m: 3, seeds: 1")
    execution.run(loads(small.replace(" um", "").replace(" GPa", "")), out=tmp_path, jobs=1)
    before = files_of(tmp_path)
    wanted = loads(small.replace("L: ", "Sq: 1 um, L: ") + WANTED)
    stored = execution.run(wanted, out=tmp_path, jobs=1)
    assert files_of(tmp_path) == before
    assert set(stored.data_vars) >= MADE
    assert stored.Sq.item() == pytest.approx(1.0, rel=1e-14)
    assert (stored.mean_gap.attrs["units"], stored.Sq.attrs["units"]) == ("um", "um")


# What is refused


def test_lengths_of_a_file_that_tells_no_unit_cannot_be_given_one(tmp_path: Path) -> None:
    np.save(tmp_path / "z.npy", heights := np.random.default_rng(0).random((5, 5)))
    np.savetxt(tmp_path / "z.txt", heights)
    for name, named in (("z.npy", "$"), ("z.txt", r"; z\.txt has no unit of length, surface\.unit gives it$")):
        text = f"surface: {{file: {name}, L: 4}}\nrecord: {{dimensional: {{mean_gap: um}}}}"
        with pytest.raises(StudyError, match=rf"dimensional\.mean_gap: needs the unit of length, .* um}}{named}"):
            execution.run(loads(text, tmp_path / "s.yaml"), out=tmp_path / "run", jobs=1)
    assert not (tmp_path / "run").exists()
