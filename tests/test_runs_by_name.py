"""Every command on a run takes its folder, its study.nc, its study file or its name."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

import roughvol
from roughvol.cli import main

TEXT = """
surface: {D: 2.3, m: 4, seeds: 2, L: 100 um, Sq: 1 um}
material: {E: [5 MPa, 10 MPa], nu: 0.5}
sweep: {pressures: [0.1 MPa, 0.2 MPa]}
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("named")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("tiny.yaml").write_text(TEXT, encoding="utf-8")
        roughvol.run("tiny.yaml", jobs=1)
    return folder


@pytest.mark.parametrize("run", ["tiny", "tiny.yaml", "runs/tiny"])
@pytest.mark.parametrize(
    "command", [["run"], ["check"], ["status"], ["show"], ["plot", "v_of_p"], ["report"], ["compare"]]
)
def test_a_command_takes_a_run_in_each_form(
    place: Path, monkeypatch: pytest.MonkeyPatch, command: list[str], run: str
) -> None:
    monkeypatch.chdir(place)
    done = CliRunner().invoke(main, [command[0], run, *command[1:]])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize("suffix", ["pdf", "svg", "csv"])
def test_figures_have_every_format_size_and_scale(place: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    monkeypatch.chdir(place)
    done = CliRunner().invoke(main, ["plot", "tiny", "--format", suffix, "--size", "90x70mm", "--log", "x"])
    assert done.exit_code == 0, done.output
    assert Path(f"runs/tiny/figures/v_of_p.{suffix}").stat().st_size > 200
