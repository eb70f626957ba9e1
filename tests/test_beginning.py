"""The first hour: examples of the package, keys and variables in words, and the page made from them."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from roughvol.observables.variables import VARIABLES
from roughvol.study import load
from roughvol.study.reference import keys
from tests.kit import call

ROOT = Path(__file__).parents[1]
EXAMPLES = ("ensemble", "metal", "reproduce", "scan", "seal")


@pytest.fixture(autouse=True)
def _empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("arguments", [["init"], ["init", "--list"], ["init", "seal", "--list"]])
def test_init_lists_the_examples_and_writes_nothing(arguments: list[str]) -> None:
    shown = call(*arguments)
    assert shown.exit_code == 0
    assert [line.split()[0] for line in shown.stdout.splitlines()[1:-1]] == list(EXAMPLES)
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize("example", EXAMPLES)
def test_init_writes_a_study_that_is_understood(example: str) -> None:
    written = call("init", example)
    assert written.exit_code == 0, written.output
    study = load(f"{example}.yaml")
    assert study.name == example
    assert study.cases()
    assert f"roughvol run {example}.yaml" in written.stdout


@pytest.mark.parametrize("example", ["seal", "scan", "metal"])
def test_examples_with_units_run_without_a_warning(example: str) -> None:
    assert call("init", example).exit_code == 0
    done = call("run", f"{example}.yaml", "--jobs", "1")
    assert done.exit_code == 0, done.output
    assert "warning" not in done.output


def test_the_study_of_a_height_map_says_its_sides() -> None:
    np.savetxt("face.txt", np.random.default_rng(0).normal(size=(9, 9)))
    given = ["--set", "surface.L=9 um", "--set", "surface.heights_unit=nm"]
    for more, sides in (
        ([], "mirrored"),
        (["--set", "surface.sides=free"], "free"),
        (["--set", "surface.sides=periodic", "--set", "surface.level=none"], "periodic"),
    ):
        assert call("init", "face.txt", *given, *more).exit_code == 0
        assert load("face.yaml").surface.sides == sides
        assert f"sides {sides}: " in call("check", "face.yaml").output
        assert "# sides: mirrored, the map is a part of a joint" in Path("face.yaml").read_text(encoding="utf-8")
        Path("face.yaml").unlink()


def test_init_overwrites_nothing() -> None:
    Path("scan.txt").write_text("mine", encoding="utf-8")
    refused = call("init", "scan")
    assert refused.exit_code == 2
    assert "scan.txt; nothing was written" in refused.stderr
    assert [path.name for path in Path().iterdir()] == ["scan.txt"]
    assert Path("scan.txt").read_text(encoding="utf-8") == "mine"


def test_init_of_no_example_names_the_nearest() -> None:
    refused = call("init", "sael")
    assert refused.exit_code == 2
    assert "did you mean seal?" in refused.stderr


def test_three_commands_print_a_leak_rate() -> None:
    for arguments in (
        ["init", "scan"],
        ["run", "scan.yaml", "--jobs", "1"],
        ["show", "scan", "--at", "pressure=10kPa"],
    ):
        done = call(*arguments)
        assert done.exit_code == 0, done.output
    head, row = (line.split("  ") for line in done.stdout.splitlines()[:2])
    assert any("Q_x [mm^3/s]" in cell for cell in head)
    assert row[0] == "pressure=10 kPa"


def test_help_points_to_what_a_wheel_has() -> None:
    shown = call("--help").output
    assert "roughvol init" in shown
    assert "configs/" not in shown


def test_explain_gives_values_default_and_meaning_of_a_key() -> None:
    shown = call("explain", "surface.file").stdout
    assert "must be given" in shown
    assert "height field" in shown
    shown = call("explain", "sweep").stdout
    assert "sweep.steps" in shown
    assert "{steps: 60, to: mean-plane, equal: indentation}" in shown


def test_explain_gives_units_and_meaning_of_a_variable() -> None:
    shown = call("explain", "leak_rate").stdout
    assert "length^3/time" in shown
    assert "volume flow along the axis" in shown
    for name in VARIABLES:
        assert call("explain", name).exit_code == 0
    column = call("explain", "transmissivity_x").stdout  # of the tables
    assert call("explain", "transmissivity").stdout.startswith(column)


def test_explain_of_an_unknown_name_proposes_others() -> None:
    refused = call("explain", "surface.fiel")
    assert refused.exit_code == 2
    assert "did you mean surface.file" in refused.stderr


def test_every_key_has_a_description_and_values() -> None:
    found = keys()
    assert {"surface.D", "surface.file", "sweep.to.pressure", "material.E", "solver.rtol", "record.transport"} <= {
        key.path for key in found
    }
    assert [key.path for key in found if not key.description or not key.values] == []


def test_the_page_of_the_reference_is_as_its_command_writes_it() -> None:
    page = (ROOT / "docs" / "reference" / "keys-and-variables.md").read_text(encoding="utf-8")
    assert page == runpy.run_path(str(ROOT / "docs" / "keys_and_variables.py"))["page"](), "run: make reference"
    assert all(f"`{name}`" in page for name in VARIABLES)


@pytest.mark.processes
@pytest.mark.parametrize("seeds", [4])
def test_small_cases_take_about_a_second_of_cpu(seeds: int) -> None:
    Path("t.yaml").write_text(f"surface: {{D: 2.3, m: 4, seeds: {seeds}}}\nsweep: {{steps: 10}}\n", encoding="utf-8")
    code = (
        "import os, sys\nfrom roughvol.cli import main\n"
        "main(['run', 't.yaml'], standalone_mode=False)\n"
        "heavy = {'matplotlib', 'scipy.stats', 'distributed'} & set(sys.modules)\n"
        "t = os.times()\nprint(heavy or '', t.user + t.system + t.children_user + t.children_system)"
    )
    there = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, env=there)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) < 5.0
    assert "{" not in done.stdout.splitlines()[-1]
