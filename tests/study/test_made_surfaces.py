"""The section ``surface`` with a spectrum or a period: what is read, which cases come out, and what they store."""

import itertools
import json
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.one_case import run_case
from roughvol.contact.kernels import KERNELS
from roughvol.errors import StudyError
from roughvol.store import same_study
from roughvol.study import loads
from roughvol.study.sections.solver import FreeKernel, PeriodicKernel
from roughvol.surfaces.spectrum import Spectrum
from tests.kit import said

STUDY = "surface: {H: 0.8, rolloff: 4, n: 32, seeds: 2}\n"


def test_the_keys_of_the_issue_are_read() -> None:
    text = (
        "surface: {H: 0.8, rolloff: 8, shortest: 0.01, Sq: 1 um, Ssk: -1.0, anisotropy: 2.0, phases: random, "
        "seeds: 10, n: 1024, L: 100 um, sides: periodic}\nsweep: {steps: 0}"
    )
    study = loads(text)
    assert study.surface.spectrum == Spectrum(8.0, 100.0, 1.0, None, -1.0, 2.0, "random", True)
    first, *others = study.cases()
    assert (first.D, first.m, first.seed, first.L, first.length_unit) == (2.2, 10, 0, 100.0, "um")
    assert len(others) == 9
    assert loads(study.to_yaml()) == study
    assert loads(study.stored(), stored=True) == study


def test_every_combination_is_a_case_with_D_and_m() -> None:
    made = loads("surface: {H: [0.2, 0.8], rolloff: 2, n: [16, 64], seeds: [5, 3]}").cases()
    assert [(case.D, case.m, case.seed) for case in made] == list(itertools.product((2.8, 2.2), (4, 6), (5, 3)))
    assert len({case.id for case in made}) == 8
    assert {case.spectrum.cut for case in made if case.spectrum} == {32.0}  # of the finest grid: levels are nested
    assert made[0].id.startswith("D2.80_m4_s005-")
    assert loads("surface: {H: 0.8, n: 64}\nsolver: paper").solver.method == "paper"


def test_an_ensemble_has_nested_levels_of_one_spectrum() -> None:
    text = "surface: {H: 0.8, rolloff: 4, n: 64}\nsweep: {steps: 4, to: {pressure: 0.3}}\n"
    study = loads(text + "ensemble: {accuracy: {free_volume: 20 %}, at: {pressure: [0.2]}}")
    assert [case.m for case in study.cases()] == [4, 5, 6]
    coarse, fine = (surface_of(study.sample(2.2, m, 7)) for m in (5, 6))
    transforms = [np.fft.rfft2(one.heights[:-1, :-1], norm="forward") for one in (coarse, fine)]
    np.testing.assert_allclose(transforms[0][:10, :10], transforms[1][:10, :10], atol=1e-14)


AUTO = "surface: {H: 0.8, cut: 20, n: auto, sides: periodic}\n"


def test_auto_is_read_back_and_has_the_levels_of_its_first_grid() -> None:
    study = loads(AUTO + "ensemble: {accuracy: {free_volume: 20 %}}\n")
    assert "n: auto" in study.to_yaml()
    assert loads(study.to_yaml()) == study
    assert [case.m for case in study.cases()] == [4, 5, 6, 7]
    assert {case.spectrum.cut for case in study.cases() if case.spectrum} == {20.0}


# What is stored


def test_a_periodic_surface_is_stored_with_its_exact_spectrum() -> None:
    text = "surface: {H: 0.8, rolloff: 4, n: 32, Sq: 2 um, L: 100 um, seeds: 1, sides: periodic}\nsweep: {steps: 0}\n"
    study = loads(text + "record: {psd: true, heights: true, texture: true}")
    result = run_case(study.cases()[0]).squeeze()
    assert float(result["Sq"]) == pytest.approx(2.0, rel=1e-12)
    assert float(result["rms_height"]) == pytest.approx(2.0, rel=1e-12)
    assert result["wave"].values.tolist() == list(range(1, 17))
    assert result["psd"].attrs["units"] == "um^4"
    assert result["rms_curvature"].attrs["units"] == "um^-1"
    assert result["x"].values[-1] == pytest.approx(31 / 32)
    q = 2.0 * np.pi * result["wave"].values / 100.0
    assert float(np.sum(q * result["psd"]) * q[0] / (2.0 * np.pi)) == pytest.approx(4.0, rel=0.1)
    assert json.loads(result.attrs["case"])["surface"]["spectrum"]["periodic"] is True


def test_another_spectrum_is_another_study() -> None:
    old, more = loads(STUDY), loads(STUDY.replace("seeds: 2", "seeds: 3"))
    assert same_study.differences(old, more) == []
    (line,) = same_study.differences(old, loads(STUDY.replace("rolloff: 4", "rolloff: 5")))
    assert line == "surface.rolloff: 4.0 → 5.0"
    lines = same_study.differences(old, loads(STUDY.replace("H: 0.8", "H: 0.7")))
    assert lines[0] == "surface.H: 0.8 → 0.7"
    finest = loads(STUDY.replace("n: 32", "n: [32, 64]"))  # the default of the cut follows the largest n
    assert same_study.differences(finest, old) == ["surface.n: [32, 64] → [32]"]
    number, word = (
        loads(f"surface: {{D: 2.3, m: {m}}}\nensemble: {{accuracy: {{free_volume: 5 %}}}}") for m in (8, "auto")
    )
    assert same_study.differences(number, word) == ['surface.m: [8] → "auto"']
    assert same_study.differences(word, number) == ['surface.m: "auto" → [8]']


def test_a_surface_that_cannot_have_the_skewness_is_named() -> None:
    study = loads("surface: {H: 0.8, n: 16, cut: 3, Ssk: 2.9, seeds: [7]}")
    with pytest.raises(StudyError, match=r"^surface\.Ssk: D = 2\.20, m = 4, seed 7: Ssk = 2\.9 is out of reach"):
        surface_of(study.cases()[0])


def test_check_and_report_describe_a_spectrum(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(STUDY + "sweep: {steps: 1, to: {pressure: 0.1}}\nrecord: {psd: true}\n")
    assert "surface 33 x 33 nodes" in said("check", tmp_path / "s.yaml")
    said("run", tmp_path / "s.yaml", "--out", tmp_path / "run", "--jobs", "1")
    said("report", tmp_path / "run", "--out", tmp_path / "report")
    assert "power-law spectrum" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")


# Sides

MADE = ("surface: {D: 2.3, m: 4, seeds: 1%s}", "surface: {H: 0.8, n: 16, seeds: 1%s}")
FILE = "surface: {file: z.npy, L: 1%s}"


@pytest.mark.parametrize("text", [*MADE, FILE])
def test_sides_are_those_given(text: str, here: Path) -> None:
    """Files are mirrored and made surfaces free by default."""
    np.save("z.npy", np.random.default_rng(0).random((12, 12)))
    words = {"": "mirrored" if text == FILE else "free"}
    words |= {f", sides: {sides}": sides for sides in ("free", "mirrored", "periodic")}
    for word, sides in words.items():
        study = loads(text % word)
        (case,) = study.cases()
        surface = surface_of(case)
        assert (study.surface.sides, case.sides, surface.sides) == (sides, sides, sides)
        assert case.shape == surface.shape
        if sides != "periodic":  # a mirrored patch has the heights of the free patch
            assert np.array_equal(surface.heights, surface_of(loads(text % ", sides: free").cases()[0]).heights)
        assert study.surface.periodic == case.periodic == surface.periodic == (sides == "periodic")
        assert loads(study.to_yaml()) == study
        assert loads(study.stored(), stored=True).surface.sides == sides
        assert study.changed(**{"sweep.steps": 3}).surface.sides == sides
        assert study.changed(**{"surface.sides": "mirrored"}).surface.sides == "mirrored"


def test_a_mirrored_scan_may_be_treated(here: Path) -> None:
    np.save("z.npy", np.random.default_rng(0).random((12, 10)))
    (case,) = loads(FILE % ", level: tilt, downsample: 2, low_pass: 0.5, crop: {x: [0, 1], y: [0, 0.9]}").cases()
    surface = surface_of(case)
    assert (surface.sides, surface.spacing) == ("mirrored", pytest.approx(case.L / (surface.shape[0] - 1)))


def test_a_stored_study_without_sides_has_those_of_its_version() -> None:
    for word, sides in (("", "free"), (", periodic: false", "free"), (", periodic: true", "periodic")):
        assert loads(f"surface: {{file: z.npy, L: 1.0{word}}}", stored=True).surface.sides == sides


def test_a_period_is_one_pixel_longer_than_its_nodes(tmp_path: Path) -> None:
    """A text with coordinates gives the length between the outer nodes."""
    z = np.random.default_rng(0).random((6, 6))
    rows = [f"{0.5 * i} {0.5 * j} {z[i, j]}" for i in range(6) for j in range(6)]
    (tmp_path / "z.xyz").write_text("\n".join(rows))
    text = "surface: {{file: z.xyz, periodic: {}}}"
    assert pytest.approx(2.5) == loads(text.format("false"), tmp_path / "s.yaml").cases()[0].L
    assert pytest.approx(3.0) == loads(text.format("true"), tmp_path / "s.yaml").cases()[0].L
    with pytest.raises(StudyError, match="a period of 3"):
        loads("surface: {file: z.xyz, L: 2.5, sides: periodic}", tmp_path / "s.yaml").cases()


def test_the_kernels_of_a_study_are_those_of_the_half_spaces():
    assert set(get_args(FreeKernel) + get_args(PeriodicKernel)) == set(KERNELS)
    assert set(get_args(FreeKernel)) == {name for name, kernel in KERNELS.items() if kernel.coefficients}
