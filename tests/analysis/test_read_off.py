"""Read-offs from a stored sweep, and their refinement by solves, against new runs at the value."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

from roughvol.analysis import read_off as ask
from roughvol.campaign import inverse, running
from roughvol.cli import main
from roughvol.errors import StudyError
from roughvol.store.dataset import Dataset
from roughvol.study import Study, loads

TEXT = """name: seal
surface: {D: 2.2, m: 6, seeds: 2, L: 200 um, Sq: 0.4 um}
material: {E_star: 10 MPa}
sweep: {steps: 20, to: {pressure: 1.2}}
solver: {rtol: 1.0e-9}
record:
  transport: {transmissivity: every-step}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 10 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""


@pytest.fixture(scope="module")
def study() -> Study:
    return loads(TEXT)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ask") / "seal"


@pytest.fixture(scope="module")
def swept(study: Study, folder: Path) -> Dataset:
    return running.run(study, jobs=1, out=folder)


@pytest.fixture(scope="module")
def largest(swept: Dataset) -> float:
    """A leak between two steps."""
    middle = swept.leak_rate_x.isel(step=slice(10, 12)).values
    return float(np.exp(np.log(middle).mean()))


def _leak_at(text: str, pressure: float, tmp_path: Path) -> float:
    """The mean leak along x of a new run that ends at a nominal pressure [MPa]."""
    text = text.replace("steps: 20, to: {pressure: 1.2}", f"steps: 2, to: {{pressure: {pressure!r} MPa}}")
    end = running.run(loads(text), jobs=1, out=tmp_path / "there").isel(step=-1)
    assert_allclose(end.nominal_pressure, pressure, rtol=2e-6)  # the accuracy of the search for the end
    return float(np.exp(np.log(end.leak_rate_x).mean()))


def _at(text: str, unknown: str, value: float) -> str:
    """The study at a value of the modulus or of Sq, given over that of the study."""
    return {
        "pressure": text,
        "modulus": text.replace("E_star: 10 MPa", f"E_star: {10 * value!r} MPa"),
        "Sq": text.replace("Sq: 0.4 um", f"Sq: {0.4 * value!r} um"),
    }[unknown]


@pytest.mark.parametrize("unknown", ["pressure", "modulus", "Sq"])
def test_an_answer_equals_a_new_run_at_that_value(
    unknown: str, study: Study, swept: Dataset, largest: float, tmp_path: Path
) -> None:
    pressure = float(swept.nominal_pressure.isel(step=8).mean())
    answer = ask.ask(swept, largest, unknown, pressure=pressure)[0]
    scaled_from = pressure if unknown == "Sq" else None
    refined = inverse.refine(study, swept, "x", largest, answer.nominal, scaled_from=scaled_from)
    value = refined.nominal if unknown == "pressure" else pressure / refined.nominal
    read_off = abs(answer.value / value - 1.0)
    assert 0.0 < read_off <= answer.error
    there = value if unknown == "pressure" else pressure
    leak = _leak_at(_at(TEXT, unknown, value), there, tmp_path)
    assert_allclose(leak, largest, rtol=1e-6)
    assert refined.solves <= 20


def test_an_answer_next_to_the_closing_is_found(study: Study, folder: Path, tmp_path: Path) -> None:
    text = TEXT.replace("seeds: 2", "seeds: 1").replace("{pressure: 1.2}", "percolation")
    run = running.run(loads(text), jobs=1, out=tmp_path / "closing")
    open_ = run.leak_rate_x.values.ravel() > 0.0
    last = int(np.flatnonzero(open_)[-1])
    pressures = run.nominal_pressure.values.ravel()
    largest = 1e-9 * float(run.leak_rate_x.values.ravel()[last])  # less than the last open step leaks
    answer = ask.ask(run, largest, "pressure")[0]
    assert answer.value == pressures[last + 1]
    refined = inverse.refine(loads(text), run, "x", largest, answer.nominal)
    assert pressures[last] < refined.nominal <= pressures[last + 1]


def test_the_answer_of_a_periodic_surface_starts_from_its_stored_states(tmp_path: Path) -> None:
    text = TEXT.replace("seeds: 2", "seeds: 1, periodic: true").replace("m: 6", "m: 5")
    run = running.run(loads(text), jobs=1, out=tmp_path / "periodic")
    largest = float(run.leak_rate_y.values.ravel()[9]) * 0.9
    answer = ask.ask(run, largest, "pressure")[1]
    refined = inverse.refine(loads(text), run, "y", largest, answer.nominal)
    assert_allclose(refined.nominal, answer.value, rtol=answer.error)
    assert refined.solves <= 6


def test_a_value_beyond_the_stored_loads_is_infinite_and_one_above_all_is_zero(swept: Dataset) -> None:
    assert ask.ask(swept, 1e-30, "pressure")[0].value == math.inf
    assert ask.ask(swept, 1e30, "pressure")[0].value == 0.0
    assert ask.ask(swept, 1e-30, "modulus", pressure=0.1)[0].value == 0.0
    assert ask.ask(swept, 1e30, "Sq", pressure=1e-2)[0].value == math.inf


@pytest.mark.parametrize(
    ("largest", "unknown", "pressure", "words"),
    [(1.0, "E", None, "allowed: pressure"), (0.0, "pressure", None, "> 0"), (1.0, "Sq", None, "must be given")],
)
def test_questions_without_answer_are_refused(
    largest: float, unknown: str, pressure: float | None, words: str, swept: Dataset
) -> None:
    with pytest.raises(StudyError, match=words):
        ask.ask(swept, largest, unknown, pressure=pressure)


def test_several_kinds_of_surfaces_have_no_common_leak(tmp_path: Path) -> None:
    text = TEXT.replace("D: 2.2, m: 6, seeds: 2", "D: [2.2, 2.4], m: 3, seeds: 1").replace("steps: 20", "steps: 2")
    run = running.run(loads(text.replace("rtol: 1.0e-9", "rtol: 1.0e-6")), jobs=1, out=tmp_path)
    with pytest.raises(StudyError, match=r"several D \(2.2, 2.4\)"):
        ask.ask(run, 1.0, "pressure")


def _call(*arguments: str) -> str:
    done = CliRunner().invoke(main, ["ask", *arguments])
    assert done.exit_code == 0, done.output
    return done.output


def test_the_command_prints_the_read_off_and_the_exact_answer(swept: Dataset, folder: Path, largest: float) -> None:
    quick = _call(str(folder), "--leak-rate", f"< {largest} mm^3/s", "--no-solve")
    assert "read off to about" in quick
    assert "solves" not in quick
    exact = _call(str(folder), "--leak-rate", f"{largest} mm^3/s", "--for", "modulus", "--pressure", "0.001 MPa")
    assert quick.count("along") == 2
    assert exact.count("to 1e-6 by") == 2
    assert "modulus" in exact
    assert "solves" in exact


def test_the_command_keeps_the_read_off_of_a_run_that_cannot_be_made_again(
    swept: Dataset, folder: Path, largest: float, tmp_path: Path
) -> None:
    (tmp_path / "study.nc").write_bytes((folder / "study.nc").read_bytes())
    said = _call(str(tmp_path / "study.nc"), "--leak-rate", f"{largest} mm^3/s")
    assert "error of the read-off" in said
