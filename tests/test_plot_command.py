"""The command `plot`: what does not apply is named and stops nothing, points have the labels of their surfaces."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

import roughvol
from roughvol.store import dataset
from tests.kit import call

PLAIN = """
surface: {D: [2.2, 2.4], m: 4, seeds: [3, 7]}
sweep: {steps: 6}
"""
LEAKING = """
surface: {D: 2.3, m: 4, seeds: [2, 5], L: 100 um, Sq: 1 um}
material: {E: 10 MPa, nu: 0.5}
sweep: {steps: 8, to: {pressure: 0.5 MPa}}
record:
  transport: {transmissivity: every-step}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""


@pytest.fixture(scope="module", autouse=True)
def _place(tmp_path_factory: pytest.TempPathFactory) -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("plotted"))
        for name, text in (("plain", PLAIN), ("leaking", LEAKING)):
            Path(f"{name}.yaml").write_text(text, encoding="utf-8")
            roughvol.run(f"{name}.yaml", jobs=1)
        yield


def _plot(*arguments: str) -> Result:
    return call("plot", *arguments)


@pytest.mark.parametrize("suffix", ["pdf", "svg"])
def test_figures_have_every_format_size_and_scale(tmp_path: Path, suffix: str) -> None:
    done = _plot("plain", "v_of_p", "--format", suffix, "--size", "90x70mm", "--log", "x", "--out", str(tmp_path))
    assert done.exit_code == 0, done.output
    assert (tmp_path / f"v_of_p.{suffix}").stat().st_size > 200


@pytest.mark.parametrize("suffix", ["png", "csv"])
def test_a_figure_that_does_not_apply_is_named_and_the_others_are_drawn(tmp_path: Path, suffix: str) -> None:
    names = ("fig09", "v_of_p", "leak_of_p", "fig05", "seal_percolation")
    done = _plot("plain", *names, "--format", suffix, "--out", str(tmp_path))
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"fig05.{suffix}", f"v_of_p.{suffix}"]
    told = done.stderr.splitlines()
    keys = ("record.fields_at", "record.dimensional.leak_rate", "record.transport.percolation")
    for line, name, key in zip(told, ("fig09", "leak_of_p", "seal_percolation"), keys, strict=True):
        assert line.startswith("not drawn: ")
        assert name in line
        assert key in line


def test_nothing_drawn_is_an_error(tmp_path: Path) -> None:
    done = _plot("plain", "fig09", "leak_of_p", "--out", str(tmp_path))
    assert done.exit_code == 2
    assert "record.fields_at" in done.stderr
    assert "record.dimensional.leak_rate" in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_figure_of_one_run_does_not_stop_those_of_two(tmp_path: Path) -> None:
    done = _plot("plain", "leaking", "fig05", "v_of_a", "--out", str(tmp_path))
    assert done.exit_code == 0, done.output
    assert "fig05 shows one run" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["v_of_a.png"]


def test_points_have_the_D_m_and_seed_of_their_surface_and_no_tex(tmp_path: Path) -> None:
    assert _plot("plain", "v_of_a", "--format", "csv", "--out", str(tmp_path)).exit_code == 0
    rows = list(csv.DictReader((tmp_path / "v_of_a.csv").read_text(encoding="utf-8").splitlines()))
    assert not any(sign in cell for row in rows for cell in row.values() for sign in "$\\{}")
    assert {(row["D"], row["m"], row["seed"]) for row in rows} == {
        (D, "4", seed) for D in ("2.2", "2.4") for seed in ("3", "7", "")
    }
    assert {(row["x_label"], row["y_label"]) for row in rows} == {
        ("real contact area fraction A*", "dimensionless free volume V*")
    }
    stored = dataset.read(Path("runs/plain/study.nc"))
    for D in (2.2, 2.4):
        for seed in (3, 7):
            one = stored.sel(D=D, m=4, seed=seed)
            points = [
                (float(row["x"]), float(row["y"])) for row in rows if (row["D"], row["seed"]) == (f"{D}", f"{seed}")
            ]
            expected = np.stack([one.contact_area_fraction, one.free_volume], axis=1)
            np.testing.assert_array_equal(points, expected[np.argsort(expected[:, 0], kind="stable")])


def test_points_of_a_leak_have_their_direction(tmp_path: Path) -> None:
    assert _plot("leaking", "leak_of_p", "--format", "csv", "--out", str(tmp_path)).exit_code == 0
    rows = list(csv.DictReader((tmp_path / "leak_of_p.csv").read_text(encoding="utf-8").splitlines()))
    assert {row["axis"] for row in rows} == {"x", "y"}
    assert {row["D"] for row in rows} == {"2.3"}
    assert not any("surface" in row["curve"] for row in rows)


def _note(run: str, name: str) -> str:
    return " ".join(roughvol.plot(run, name).get_supxlabel().split())


def _title(run: str, name: str) -> str:
    return roughvol.plot(run, name).axes[0].get_legend().get_title().get_text()


LIFTED = """
surface: {D: 2.3, m: 4, seeds: [2, 5], L: 100 um, Sq: 1 um, sides: periodic}
material: {E: 10 MPa, nu: 0.5}
sweep: {steps: 4, to: {pressure: 0.5 MPa}}
record:
  transport: {transmissivity: every-step}
  fluid_pressure: {inlet: 1 bar, at: last, coupling: one-way}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 1 bar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""


def test_a_figure_says_which_gap_it_shows_and_of_what_its_points_are() -> None:
    Path("lifted.yaml").write_text(LIFTED, encoding="utf-8")
    roughvol.run("lifted.yaml", jobs=1)
    assert "The gap without fluid pressure." in _note("lifted", "v_of_p")
    assert "without fluid pressure" not in _note("leaking", "v_of_p")
    titles = {run: _title(run, "leak_of_p") for run in ("lifted", "leaking")}
    assert "each of 2 surfaces" in titles["lifted"]  # one state has no curve
    assert "median" not in titles["lifted"]
    assert "median of 2 surfaces" in titles["leaking"]


def test_a_leak_in_a_figure_has_its_pressure_drop_and_viscosity() -> None:
    Path("loops.yaml").write_text(
        LEAKING.replace(
            "{steps: 8, to: {pressure: 0.5 MPa}}", "[{steps: 4, to: {pressure: 1}}, {steps: 2, to: {pressure: 0}}]"
        ),
        encoding="utf-8",
    )
    roughvol.run("loops.yaml", jobs=1)
    title = roughvol.plot("loops", "path_loops").legends[0].get_title().get_text()
    assert "pressure drop 5 mbar, viscosity 1 mPa s" in title
    assert "Pressure drop 5 mbar, viscosity 1 mPa*s." in _note("leaking", "leak_of_p")
    assert "ressure drop" not in _note("leaking", "flow_of_p")
