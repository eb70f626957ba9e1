"""Messages on studies that a user is likely to write: the word that is meant, one message for one mistake."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.campaign.checks import check_surfaces
from roughvol.errors import StudyError
from roughvol.study import loads
from roughvol.study.rules import RULES
from roughvol.study.sections.fluid import SUBSTANCES
from tests.kit import refused, said
from tests.study.kit import problems_of


def test_missing_files_of_a_list_are_named_once(tmp_path: Path) -> None:
    found = problems_of("surface: {files: [a.npy, b.npy], L: 1}", tmp_path / "s.yaml")
    assert [problem.key for problem in found] == ["surface.files[0]", "surface.files[1]"]


@pytest.mark.parametrize("gas", SUBSTANCES)
def test_explain_describes_a_gas_by_its_stored_data(gas: str) -> None:
    shown, row = said("explain", gas), SUBSTANCES[gas]
    assert f"{1e6 * row.viscosity:.4g} uPa*s at {row.reference:g} K" in shown
    assert f"{1e3 * row.molar_mass:.5g} g/mol" in shown


def test_explain_gives_the_mean_free_path() -> None:
    """Of the viscosity, (μ/p) √(π R T/(2 M)), with Sutherland's viscosity of nitrogen at 293.15 K."""
    (line,) = [line for line in said("explain", "nitrogen").splitlines() if "path" in line]
    viscosity = 1.663e-5 * (293.15 / 273.0) ** 1.5 * (273.0 + 107.0) / (293.15 + 107.0)
    expected = viscosity / 1e5 * math.sqrt(0.5 * math.pi * 8.314462618 * 293.15 / 28.014e-3)
    assert_allclose(float(line.split()[2]), 1e9 * expected, rtol=5e-3)


def test_names_that_explain_proposes_differ() -> None:
    error = refused("explain", "materal")
    assert "did you mean 'material' or 'material.E' or " in error
    assert "material or material or" not in error
    assert "did you mean 'helium'" in refused("explain", "heliu")


@pytest.mark.parametrize("name", ["sweep.to.load", "sweep.loads"])
def test_explain_gives_the_area_of_a_load(name: str) -> None:
    text = " ".join(said("explain", name).split())
    assert "nominal pressure times N^2 δ^2, on a free patch of N = 33 nodes a side 6 % more than L^2" in text


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("surface: {D: 2.3, m: 4}\nsweep: {steps: []}\nrecord: {fields_at: last}", "sweep.steps"),
        ("surface: {D: 2.3, m: 4, sides: 1}\nsolver: {kernel: fourier}", "surface.sides"),
        ("surface: {D: [2.3, 9, 2.3], m: 4}\nsolver: {kernel: fourier}", "solver.kernel surface.D[1] surface.D[2]"),
        ("surface: {D: 2.3}\nmaterial: {E_star: 1, hardness: 1 GPa}", "material.hardness surface.m"),
        ("surface: {file: no.npy, variable: z}", "surface.L surface.file surface.variable"),
        ("surface: {D: 2.3, m: 4}\nsweep: [{to: {pressure: 1}, steps: x}, {to: {pressure: 1}}]", "sweep[0].steps"),
    ],
)
def test_a_faulty_key_hides_the_rules_that_need_it_and_no_others(text: str, keys: str) -> None:
    assert sorted(problem.key for problem in problems_of(text)) == keys.split()


def test_a_rule_needs_keys_of_a_study() -> None:
    sections = {"surface", "material", "sweep", "solver", "record", "ensemble", "fluid", "seal"}
    assert {key[0] for rule in RULES for key in rule.reads} <= sections


def test_a_changed_value_is_placed_at_the_argument_in_python_and_at_the_option_of_a_command(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("surface: {D: 2.3, m: 4}\n", encoding="utf-8")
    with pytest.raises(StudyError, match=r"^changes: surface\.m: must be"):
        loads("surface: {D: 2.3, m: 4}", changes={"surface.m": "x"})
    assert "  --set: surface.m: must be" in refused("check", tmp_path / "s.yaml", "--set", "surface.m=x")


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("material.thickness", "1 um", "the layer has a thickness of"),
        ("surface.low_pass", "1 um", r".*z\.npy: low_pass is 1 in the unit of L; allowed: 133\.333 "),
        ("sweep.to.indentation", "50", "a sweep to indentation=50 would end at .*, full contact"),
        ("surface.outliers", "{sigma: 3}", r".*z\.npy: outliers: "),
    ],
)
def test_a_changed_value_that_does_not_fit_the_surface_is_placed_at_the_change(
    tmp_path: Path, key: str, value: str, said: str
) -> None:
    heights = np.random.default_rng(0).normal(size=(16, 16))
    heights[:2] *= 100.0  # more than a twentieth of the heights
    np.save(tmp_path / "z.npy", heights)
    sides = "periodic" if key.startswith("material") else "mirrored"
    material = "material: {E: 1 MPa, nu: 0.5, thickness: 1 mm}"
    text = f"surface: {{file: z.npy, L: 1000, unit: um, sides: {sides}}}\n{material}"
    study = loads(text, file=tmp_path / "study.yaml", changes=[f"{key}={value}"])
    with pytest.raises(StudyError, match=rf"^changes: {key}: {said}"):
        check_surfaces(study)


def test_a_sweep_of_generated_surfaces_beyond_full_contact_is_refused_at_its_step() -> None:
    text = "surface: {D: [2.1, 2.9], m: 4, sides: mirrored, seeds: [1, 3]}\nsweep: {indentations: [1, 2.5]}"
    said = r":2: sweep\.indentations\[1\]: a sweep to indentation=2.5 would end at .* up to 2.14995, full contact"
    with pytest.raises(StudyError, match=said):
        check_surfaces(loads(text, file="study.yaml"))
