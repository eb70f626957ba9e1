"""The run of a name, a folder, a study.nc or a study file: the numbers are those of the study, or they are refused."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

import roughvol
from roughvol.store import StoredRun
from tests.kit import refused, said

TEXT = """
surface: {D: 2.3, m: 4, seeds: 1, L: 100 um, Sq: 1 um}
material: {E: 10 MPa, nu: 0.5}
sweep: {pressures: [0.1 MPa, 0.2 MPa]}
record:
  transport: {transmissivity: every-step}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""
SCAN = TEXT.replace("{D: 2.3, m: 4, seeds: 1, L: 100 um, Sq: 1 um}", "{file: heights.txt, L: 100 um, heights_unit: um}")


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("computed")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("tiny.yaml").write_text(TEXT, encoding="utf-8")
        roughvol.run("tiny.yaml", jobs=1)
        np.savetxt("heights.txt", _heights(0))
        Path("scan.yaml").write_text(SCAN, encoding="utf-8")
        roughvol.run("scan.yaml", jobs=1)
    return folder


@pytest.fixture
def place(computed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(computed, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


def _heights(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(9, 9))


@pytest.mark.parametrize(
    ("old", "new", "difference"),
    [
        ("m: 4", "m: 3", "surface.m: 4 → 3"),
        ("E: 10 MPa", "E: 20 GPa", 'material.E: "10 MPa" → "20 GPa"'),
        ("seeds: 1", "seeds: 2", "surface.seeds: [0] → [0, 1]"),
        ("1 mPa*s", "2 mPa*s", '→ "2 mPa*s"'),
    ],
)
def test_changed_studies_are_refused(place: Path, old: str, new: str, difference: str) -> None:
    Path("tiny.yaml").write_text(TEXT.replace(old, new), encoding="utf-8")
    message = refused("show", "tiny.yaml")
    assert difference in message
    assert "roughvol run tiny.yaml" in message
    assert "runs/tiny" in message


def test_the_run_advised_for_a_changed_study_computes_it(place: Path) -> None:
    text = TEXT.replace("0.2 MPa]", "0.3 MPa]")
    Path("tiny.yaml").write_text(text, encoding="utf-8")
    assert "roughvol run tiny.yaml --set name=OTHER, or --fresh" in refused("show", "tiny.yaml")
    said("run", "tiny.yaml", "--set", "name=OTHER", "--jobs", "1")
    said("show", "tiny.yaml", "--set", "name=OTHER")
    Path("tiny.yaml").write_text(TEXT.replace("seeds: 1", "seeds: 2"), encoding="utf-8")
    assert "roughvol run tiny.yaml; to see" in refused("show", "tiny.yaml")  # which keeps the cases of the run
    said("run", "tiny.yaml", "--jobs", "1")
    said("show", "tiny.yaml")


LISTED = TEXT.replace("E: 10 MPa", "E: [10 MPa, 20 MPa]").replace("L: 100", "sides: mirrored, L: 100")
LISTED = LISTED.replace("nu: 0.5", "nu: 0.5, thickness: [none, 50 um]").replace("0.2 MPa]", "0.2 MPa, 0.4 MPa]")


@pytest.mark.parametrize("thickness", ["none", "50 um"])
def test_a_study_with_values_of_the_lists_of_a_run_opens_their_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, thickness: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("listed.yaml").write_text(LISTED, encoding="utf-8")
    roughvol.run("listed.yaml", jobs=1)
    changes = ["material.E=20 MPa", f"material.thickness={thickness}"]
    alone = roughvol.run("listed.yaml", changes=[*changes, "name=alone"], jobs=1)
    for run in ("listed", "listed.yaml"):
        found = roughvol.open(run, changes=changes)
        assert (found.sizes["E"], found.sizes["thickness"]) == (1, 1)
        for name in ("nominal_pressure", "leak_rate", "free_volume", "Sq"):
            np.testing.assert_array_equal(found[name].squeeze(), alone[name].squeeze())
    half = roughvol.open("listed", changes=["material.E=[20 MPa]"])
    assert (half.sizes["E"], half.sizes["thickness"]) == (1, 2)
    leak = f"{float(alone['leak_rate'].sel(axis='x')[..., 1].item())!r} mm^3/s"
    asked, exact = roughvol.ask("listed", leak_rate=leak, changes=changes), roughvol.ask("alone", leak_rate=leak)
    assert asked.plain()["answers"] == exact.plain()["answers"]
    assert asked.plain()["answers"][0]["value"] == pytest.approx(0.2)
    given = [word for change in changes for word in ("--set", change)]
    texts = [said("ask", "listed", "--leak-rate", leak, *given), said("ask", "alone", "--leak-rate", leak)]
    first, second = (text.splitlines()[1:3] for text in texts)  # along x and y
    assert first == second
    assert texts[0].startswith(f"listed, E = 20 MPa, thickness = {thickness}: ")
    assert f"roughvol card listed --set 'material.E=20 MPa' --set {shlex.quote(changes[1])}" in texts[0]
    for change in ("material.E=30 MPa", "material.E=[20 MPa, 30 MPa]", "surface.m=3"):
        with pytest.raises(roughvol.errors.FolderError, match="does not hold the results of listed"):
            roughvol.open("listed", changes=[*changes, change])
    message = refused("ask", "listed", "--leak-rate", leak)
    assert "the run has several E (10 MPa, 20 MPa)" in message
    assert "one combination opens by --set material.E=… --set material.thickness=…" in message


def test_a_changed_height_file_does_not_get_the_numbers_of_the_old_one(place: Path) -> None:
    np.savetxt("heights.txt", _heights(1))
    message = refused("compare", "scan.yaml", "tiny")
    assert "surface.file: the content of heights.txt" in message
    assert "roughvol run scan.yaml" in message


def test_a_run_from_another_folder_does_not_take_heights_of_equal_name(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("elsewhere").mkdir()
    monkeypatch.chdir("elsewhere")
    np.savetxt("heights.txt", _heights(1))
    for command in ("card", "check", "tradeoff"):
        for changes in ((), ("--set", "name=other", "--set", "sweep.pressures=[0.1 MPa]")):
            assert "the content of heights.txt has changed" in refused(command, "../runs/scan", *changes)
    assert "heights.txt" in said("check", "../runs/scan", "--set", "surface.file=heights.txt")
    assert "heights.txt" in said("check", "../scan.yaml")


@pytest.mark.parametrize("run", ["scan", "runs/scan/study.nc"])
def test_a_run_opens_by_its_name_without_its_height_file(place: Path, run: str) -> None:
    Path("heights.txt").unlink()
    said("show", run)
    assert StoredRun.open(run).name == "scan"


@pytest.mark.parametrize("run", ["tiny", "runs/tiny/study.nc", "tiny.yaml"])
def test_an_interrupted_extension_is_not_shown(place: Path, monkeypatch: pytest.MonkeyPatch, run: str) -> None:
    Path("tiny.yaml").write_text(TEXT.replace("seeds: 1", "seeds: 3"), encoding="utf-8")
    asked = iter([False, False, True])
    with pytest.raises(KeyboardInterrupt):
        roughvol.run("tiny.yaml", jobs=1, stopping=lambda: next(asked, True))
    message = refused("show", run)
    assert "surface.seeds: [0] → [0, 1, 2]" in message
    assert "roughvol run" in message


@pytest.mark.parametrize("run", ["tiny", "runs/tiny/study.nc", "tiny.yaml"])
def test_the_results_of_another_run_are_not_shown_as_those_of_this_one(place: Path, run: str) -> None:
    shutil.copy("runs/scan/study.nc", "runs/tiny/study.nc")
    message = refused("show", run)
    assert "surface.file" in message
    assert "runs/tiny" in message


def test_the_results_of_a_run_of_equal_settings_and_other_heights_are_not_those_of_this_one(place: Path) -> None:
    Path("other").mkdir()
    np.savetxt("other/heights.txt", _heights(1))
    shutil.copy("scan.yaml", "other/scan.yaml")
    roughvol.run("other/scan.yaml", out="runs/other", jobs=1)
    shutil.copy("runs/other/study.nc", "runs/scan/study.nc")
    assert "heights-" in refused("show", "scan")


def test_words_of_a_study_file_change_no_number(place: Path) -> None:
    Path("tiny.yaml").write_text(f"# a comment\nname: tiny\n{TEXT}comment: measured twice\n", encoding="utf-8")
    said("show", "tiny.yaml")


def test_a_copied_study_nc_opens_in_a_folder_of_its_own(place: Path) -> None:
    Path("elsewhere").mkdir()
    for name in ("study.nc", "kept.nc"):
        shutil.copy("runs/tiny/study.nc", f"elsewhere/{name}")
    assert [StoredRun.open(run).name for run in ("elsewhere", "elsewhere/kept.nc")] == ["elsewhere", "kept"]


def test_a_run_by_name_with_another_name_is_the_run_of_that_name(place: Path) -> None:
    changes = ["--set", "surface.m=3", "--set", "name=coarse"]
    assert said("run", "tiny", *changes, "--jobs", "1").endswith("runs/coarse/study.nc\n")
    assert said("show", "tiny", *changes) == said("show", "coarse")
    absent = refused("show", "tiny", "--set", "surface.m=3", "--set", "name=other")
    assert "to compute them: roughvol run tiny --set surface.m=3 --set name=other" in absent


def test_commands_in_messages_have_paths_as_words_of_a_shell(place: Path) -> None:
    shutil.copy("tiny.yaml", "my tiny.yaml")
    assert "roughvol run 'my tiny.yaml' --set name=other" in refused("show", "my tiny.yaml", "--set", "name=other")
    shutil.copytree("runs/tiny", "my run")
    Path("my run/study.nc").unlink()
    assert "roughvol status 'my run'" in refused("show", "my run")


def test_a_problem_of_a_stored_study_is_placed_in_its_file(place: Path) -> None:
    Path("heights.txt").rename("moved.txt")
    assert "runs/scan/study.yaml:2: surface.file: no such file" in refused("check", "scan")
    Path("runs/tiny/study.yaml").write_text("name: [\n", encoding="utf-8")
    assert "runs/tiny/study.yaml:2: not YAML" in refused("status", "tiny")


def test_the_status_of_a_finished_run_needs_no_height_file(place: Path) -> None:
    there = said("status", "scan")
    assert "runs/scan: 1 of 1 cases finished, collected" in there
    Path("heights.txt").rename("moved.txt")
    assert said("status", "scan") == there == said("status", "runs/scan/study.nc")
    assert "no such file" in refused("status", "scan", "--set", "sweep.steps=2")
    next(Path("runs/scan/cases").glob("*.nc")).unlink()
    assert "no such file" in refused("status", "scan")


def test_a_name_longer_than_any_file_has_no_results(place: Path) -> None:
    for command in ("show", "status", "plot"):
        refused(command, "n" * 300)
