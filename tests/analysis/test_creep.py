"""The leak of a seal over time, from a stored sweep and a creep law."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

from roughvol.analysis import creep
from roughvol.campaign import running
from roughvol.cli import main
from roughvol.errors import StudyError
from roughvol.store.dataset import Dataset
from roughvol.study import Creep, load_creep, loads, read_times

TEXT = """name: rubber
surface: {D: 2.2, m: 6, seeds: 2, L: 200 um, Sq: 0.4 um}
material: {E_star: 10 MPa}
sweep: {steps: 24, to: {pressure: 2.0}}
record:
  transport: {transmissivity: every-step}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 1 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""
PRONY = "prony: {shares: [0.5, 0.5], times: [10 s, 1 h]}"
MATERIAL = loads(TEXT).material


def _law(text: str, folder: Path) -> Creep:
    (folder / "creep.yaml").write_text(text)
    return load_creep(folder / "creep.yaml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("creep") / "rubber"


@pytest.fixture(scope="module")
def run(folder: Path) -> Dataset:
    return running.run(loads(TEXT), jobs=1, out=folder)


# laws


def test_the_forms_of_a_law(tmp_path: Path) -> None:
    prony = _law(PRONY, tmp_path)
    assert prony.ratio(0.0, MATERIAL) == 1.0
    assert_allclose(prony.ratio(10.0, MATERIAL), 1 + 0.5 * (1 - math.exp(-1)) + 0.5 * (1 - math.exp(-10 / 3600)))
    assert_allclose(prony.ratio(1e9, MATERIAL), 2.0)
    power = _law("power: {exponent: 0.5, time: 1 min}", tmp_path)
    assert_allclose(power.ratio(240.0, MATERIAL), 3.0)
    table = _law("table: {times: [1 s, 100 s], ratios: [1, 4]}", tmp_path)
    assert_allclose(table.ratio(10.0, MATERIAL), 2.0)  # a line in logarithms
    moduli = _law("table: {times: [1 s, 1 h], moduli: [10 MPa, 5000 kPa]}", tmp_path)
    assert_allclose([moduli.ratio(time, MATERIAL) for time in (1.0, 3600.0)], [1.0, 2.0])
    with pytest.raises(StudyError, match="ends at 1 s and 1 h"):
        moduli.ratio(3601.0, MATERIAL)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("table: {times: [1 s, 2 s], ratios: [2, 1]}", "must not fall"),
        ("table: {times: [1 s, 2 s], moduli: [1 MPa, 2 MPa]}", "must not fall"),
        ("table: {times: [2 s, 1 s], ratios: [1, 2]}", "times must rise"),
        ("table: {times: [1 s, 2 s]}", "needs ratios or moduli"),
        ("prony: {shares: [0.1], times: [1 s, 2 s]}", "as many times"),
        ("prony: {shares: [-0.1], times: [1 s]}", "creep.yaml:1: prony.shares.0.: must be >= 0, given -0.1"),
        ("prony: {shares: [0.1], times: [1 m]}", "unit of length"),
        ("{}", "needs one of"),
        ("spring: 1", "creep.yaml:1: spring: unknown key; allowed: prony, power, table"),
        ("power: {n: 1, exponent: 1, time: 1 s}", "power.n: unknown key; allowed: exponent, time"),
        ("power: {exponent: 0.1,\n  time: 1}", "creep.yaml:2: power.time: must be a number with a unit of time"),
        ("prony: {shares: [.inf], times: [1 s]}", "must be a finite number, given .inf"),
        ("power: {exponent: 0.1, time: 1 s}\npower: {exponent: 0.2, time: 1 s}", "creep.yaml:2: power: "),
        ("table: {times: [1 s, 2 s], ratios: [0.5, 1]}", "allowed: >= 1"),
        ("[1]", "a creep law is a mapping"),
    ],
)
def test_what_is_no_law_is_refused(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=words):
        _law(text, tmp_path)


def test_times_are_a_range_or_a_list() -> None:
    assert_allclose(read_times("1 s..100 s"), np.logspace(0, 2, 9))
    assert_allclose(read_times("1 s, 1 min,1 day"), [1, 60, 86400])
    for wrong in ("", "1 MPa", "2 s, 1 s", "0 s..1 s", "1e400 s", "1 s..1e400 s"):
        with pytest.raises(StudyError, match="times are"):
            read_times(wrong)


# the leak over time


@pytest.mark.parametrize("seconds", [1.0, 60.0, 7200.0])
def test_the_leak_at_a_time_is_that_of_a_new_run_with_its_modulus(seconds: float, run: Dataset, tmp_path: Path) -> None:
    law, pressure = _law(PRONY, tmp_path), 0.016
    over_time = creep.history(run, law, pressure, [seconds])
    text = TEXT.replace("E_star: 10 MPa", f"E_star: {10 / law.ratio(seconds, MATERIAL)!r} MPa")
    text = text.replace("steps: 24, to: {pressure: 2.0}", f"steps: 2, to: {{pressure: {pressure} MPa}}")
    end = running.run(loads(text), jobs=1, out=tmp_path / "then").isel(step=-1)
    for axis in ("x", "y"):
        leak = float(np.exp(np.log(end[f"leak_rate_{axis}"]).mean()))
        assert abs(math.log(over_time.leak[axis][0] / leak)) <= over_time.error[axis][0] + 1e-5
        assert_allclose(over_time.leak[axis][0], leak, rtol=0.02)
    assert_allclose(over_time.area[0], float(end.contact_area_fraction.mean()), rtol=0.01)


def test_the_leak_falls_while_the_rubber_creeps(run: Dataset, tmp_path: Path) -> None:
    over_time = creep.history(run, _law(PRONY, tmp_path), 0.01, read_times("1 s..1 day"))
    assert np.all(np.diff(over_time.leak["x"]) < 0.0)
    assert np.all(np.diff(over_time.area) > 0.0)
    assert_allclose(over_time.equivalent, 0.01 * over_time.ratio)


@pytest.mark.parametrize(
    ("pressure", "words"), [(0.03, "sweep ends at .* reached up to"), (0.1, "reached at no time"), (1e-6, "begins at")]
)
def test_nothing_is_extrapolated(pressure: float, words: str, run: Dataset, tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=words):
        creep.history(run, _law(PRONY, tmp_path), pressure, [1.0, 1e6])


def test_a_contact_that_recedes_is_refused(run: Dataset, tmp_path: Path) -> None:
    falling = run.assign(contact_area_fraction=-run.contact_area_fraction)
    with pytest.raises(StudyError, match="contact area falls"):
        creep.history(falling, _law(PRONY, tmp_path), 0.01, [1.0])
    with pytest.raises(StudyError, match="yields"):
        creep.history(run.assign(plastic_volume=run.free_volume), _law(PRONY, tmp_path), 0.01, [1.0])


def test_the_command_writes_a_table_and_a_figure(run: Dataset, folder: Path, tmp_path: Path) -> None:
    _law(PRONY, tmp_path)
    arguments = [str(folder), "--law", str(tmp_path / "creep.yaml"), "--pressure", "10 kPa", "--times", "1 s, 1 h"]
    done = CliRunner().invoke(main, ["creep", *arguments, "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "estimated error" in done.output
    with (tmp_path / "out" / "creep.csv").open() as stream:
        head, *rows = csv.reader(stream)
    assert head[:5] == ["time [s]", "J(t)/J(0)", "p J(t)/J(0) [MPa]", "A*", "leak x [mm^3/s]"]
    assert [float(row[0]) for row in rows] == [1.0, 3600.0]
    assert (tmp_path / "out" / "creep.png").stat().st_size > 10_000
    late = CliRunner().invoke(main, ["creep", *arguments[:-4], "--pressure", "1 MPa", "--times", "1 s"])
    assert late.exit_code == 2
    assert "the sweep ends at" in late.output


def test_a_seal_that_is_closed_has_no_error_of_its_leak(run: Dataset, tmp_path: Path) -> None:
    over_time = creep.history(run, _law(PRONY, tmp_path), 0.016, [1.0])
    closed = {axis: np.full(1, math.nan) for axis in "xy"}
    assert creep.lines_of(replace(over_time, leak=closed, error=closed))[-1] == "read off the stored sweep"
