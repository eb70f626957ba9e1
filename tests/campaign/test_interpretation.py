"""Numbers that may be meant in another way: both readings are given, by `check`, by `run` and in Python."""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import roughvol
from roughvol.campaign import interpretation
from roughvol.errors import CampaignError, RoughvolWarning
from roughvol.study import loads
from tests.campaign.kit import noise
from tests.kit import call, said

pytestmark = pytest.mark.usefixtures("here")

UNITS = "surface: {D: 2.3, m: 4, seeds: 1, L: 100 um, Sq: 1 um}\nmaterial: {E_star: 10 MPa}\n"  # p = p* 0.1 MPa
BARE = "surface: {D: 2.3, m: 4, seeds: 1, L: 100, Sq: 1}\n"
DOUBTS = tomllib.loads((Path(__file__).parent / "doubts.toml").read_text(encoding="utf-8"))
HEIGHTS = 1e-6 * noise(0, 9, 9)


def _doubts(text: str) -> list[str]:
    return interpretation.doubts(loads(text))


@pytest.mark.parametrize(("text", "expected"), DOUBTS["readings"])
def test_a_bare_number_beside_units_is_given_in_both_readings(text: str, expected: str) -> None:
    study = text.replace("units+ ", UNITS).replace("bare+ ", BARE)
    assert [line.replace("about ", "") for line in _doubts(study)] == [expected] * bool(expected)


def test_each_material_of_a_list_has_its_own_reading_in_check_and_run() -> None:
    text = UNITS.replace("10 MPa", "[10 MPa, 20 MPa]") + "sweep: {steps: 2, to: {pressure: 0.1}}"
    Path("s.yaml").write_text(text, encoding="utf-8")
    for command in (["check", "s.yaml"], ["run", "s.yaml", "--jobs", "1"]):
        done = call(*command)
        found = re.findall(r"^warning: .*pressure .* that is (?:about )?(\S+) MPa.* \((.*)\)$", done.stderr, re.M)
        assert (done.exit_code, found) == (0, [("0.01", "E_star = 10 MPa"), ("0.02", "E_star = 20 MPa")])


def test_several_surfaces_have_a_range() -> None:
    text = UNITS.replace("seeds: 1, L: 100 um, Sq: 1 um", "seeds: 3, L: 100 um") + "sweep: {to: {pressure: 0.1}}"
    with pytest.warns(RoughvolWarning) as seen:
        ds = roughvol.run(loads(text, "many.yaml"), jobs=1)
    nominal = 0.1 * 10.0 * ds.Sq.values.ravel() / 100.0  # p* E* Sq/L
    (line,) = (str(one.message) for one in seen if str(one.message).startswith("pressure"))
    assert f"that is {nominal.min():.3g} to {nominal.max():.3g} MPa" in line


def test_press_gives_both_readings_of_a_bare_pressure() -> None:
    """A map in metres with a modulus in Pa: the contact was full, where 0.1 MPa has A* = 0.13."""
    options: dict[str, Any] = {"L": 100e-6, "nu": 0.5, "steps": 2}
    starred = 1e5 * 10e6 / 0.75 * float(HEIGHTS.std()) / 100e-6
    with pytest.warns(RoughvolWarning, match=r"pressure 100000 is p\* = 100000, that is .* in the unit of E") as seen:
        ds = roughvol.press(HEIGHTS, E=10e6, to={"pressure": 1e5}, **options)
    assert f"that is {starred:.3g} in" in next(str(one.message) for one in seen if "is p*" in str(one.message))
    assert "is p* = 100000" in ds.attrs["warnings"]
    given = roughvol.press(HEIGHTS, E="10 MPa", to={"pressure": "0.1 MPa"}, **options)
    assert "p*" not in given.attrs["warnings"]
    assert float(given.nominal_pressure[-1]) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("hardness", "doubtful"), [("0.0001 Pa", True), ("1 MPa", False), ("0.5 GPa", True), ("1e-5", True), ("2", False)]
)
def test_a_hardness_out_of_proportion_is_doubtful(hardness: str, doubtful: bool) -> None:
    found = _doubts(UNITS.replace("10 MPa", f"10 MPa, hardness: {hardness}, plastic: false") + "sweep: {steps: 2}")
    assert bool(found) == doubtful
    assert all(re.match(r"hardness .* of the contact modulus, .* is its unit right\?", line) for line in found)


def test_an_accuracy_that_looks_like_a_percentage_is_doubtful() -> None:
    text = BARE.replace("seeds: 1, ", "") + "sweep: {to: {pressure: 0.2}}\nensemble: {accuracy: {free_volume: 1}}"
    expected = "accuracy of free_volume is 1 in units of free_volume itself, no share: write '1 %' for a percentage"
    assert _doubts(text) == [expected]
    assert _doubts(text.replace("volume: 1", "volume: 50 %")) == []
    leak = text.replace("free_volume: 1", "log_leak_rate: 1")  # a factor of ten
    assert _doubts(f"{leak}\nrecord: {{transport: {{transmissivity: every-step}}}}") == []


@pytest.mark.parametrize(("more", "unused"), [("", 0), (", hardness: 1 GPa", 1), (", thickness: 5 um", 1)])
def test_conductivities_of_no_elastic_half_spaces_are_not_used(more: str, unused: int) -> None:
    material = f"material: {{E: 70 GPa, nu: 0.3, conductivity: [200 W/m/K, 50 W/m/K]{more}}}"
    found = _doubts(f"surface: {{D: 2.2, m: 4, L: 100 um, Sq: 1 um, sides: mirrored}}\n{material}")
    assert len([sentence for sentence in found if "material.conductivity is not used" in sentence]) == unused


def test_a_first_pressure_that_is_not_used_is_doubtful() -> None:
    legs = "sweep: [{steps: 2, to: {pressure: 2}, %s}, {steps: 2, to: {pressure: 0.1}, %s}]"
    given, left_out = "equal: log pressure, first: 0.3", "equal: log pressure"
    (found,) = _doubts(BARE + legs % (left_out, given))
    assert found.startswith("sweep[1].first is not used")
    assert _doubts(BARE + legs % (given, left_out)) == []


def test_a_run_that_fails_names_its_doubtful_numbers() -> None:
    """A load above the hardness by its other reading: 0.1 MPa is below it, p* = 0.1 is not reached."""
    options: dict[str, Any] = {"L": 100e-6, "E": "10 MPa", "nu": 0.5, "hardness": "1.1 kPa", "steps": 2}
    with pytest.warns(RoughvolWarning, match=r"^pressure 0\.1 is p\* = 0\.1, that is "), pytest.raises(CampaignError):
        roughvol.press(HEIGHTS, to={"pressure": 0.1}, **options)


def test_a_fine_generated_surface_is_shown_by_numbers_alone() -> None:
    fine, coarse = (loads(f"surface: {{D: 2.3, m: {m}, L: 1 um, Sq: 2 nm}}") for m in (11, 4))
    assert interpretation.shown(fine, None) is None
    surface = interpretation.shown(coarse, None)
    np.testing.assert_allclose(surface.Sq, 2e-3)


def test_the_file_that_is_shown_of_several_is_named() -> None:
    for name in ("a", "b"):
        np.save(f"{name}.npy", HEIGHTS)
    for files, named in (("[a.npy]", False), ("[a.npy, b.npy]", True)):
        Path("of.yaml").write_text(f"surface: {{files: {files}, L: 1 mm, heights_unit: m}}\n")
        assert ("a.npy, the first of 2 cases" in said("check", "of.yaml")) == named


def test_doubts_of_each_file_are_given_and_a_spacing_of_another_file_is_one() -> None:
    """Doubts of the first file alone were given: an L of two sizes of maps made two spacings without a word."""
    np.save("a.npy", HEIGHTS)
    np.save("b.npy", HEIGHTS[:6])
    study = {"surface": {"files": ["a.npy", "b.npy"], "L": "1 mm", "heights_unit": "m"}, "sweep": {"steps": 1}}
    expected = "b.npy has 6 nodes along x and a.npy 9, on the L of the study: their spacings differ"
    with pytest.warns(RoughvolWarning, match=expected):
        ds = roughvol.run(study, jobs=1)
    assert expected in ds.attrs["warnings"].splitlines()
    assert expected in roughvol.check(study).warnings
