"""The section ``ensemble``: what may be asked for, and what does not go together with it."""

import pickle

import pytest

from roughvol.study import loads
from roughvol.study.values.units import in_unit

SURFACE = "surface: {D: 2.5, m: 7}\n"
ASKED = "ensemble: {accuracy: {free_volume: 1 %}, at: {pressure: [0.1, 0.3]}}\n"


def test_a_study_with_an_ensemble_reads_its_own_text() -> None:
    study = loads(SURFACE + "ensemble: {accuracy: {free_volume: 1 %, pressure: 0.02}, at: last, budget: 1 day}\n")
    assert loads(study.to_yaml()) == study
    assert loads(study.stored(), stored=True) == study
    assert pickle.loads(pickle.dumps(study)) == study
    assert in_unit(study.ensemble.budget, "s") == 86400.0
    asked = study.ensemble.accuracy.named
    assert (asked["free_volume"], asked["free_volume"].relative) == (0.01, True)
    assert (asked["pressure"], asked["pressure"].relative) == (0.02, False)
    assert asked["free_volume"].of(-3.0) == 0.03
    assert asked["pressure"].of(-3.0) == 0.02
    assert "seeds" not in study.to_yaml()


def test_cases_are_one_sample_of_each_level() -> None:
    study = loads(SURFACE + ASKED)
    assert [case.m for case in study.cases()] == [4, 5, 6, 7]
    assert study.sample(2.5, 6, 0) == study.cases()[2]
    assert [case.m for case in loads(SURFACE.replace("7", "3") + ASKED).cases()] == [1, 2, 3]
    assert [case.m for case in loads(SURFACE.replace("7", "auto") + ASKED).cases()] == [4, 5, 6, 7]


def test_an_ensemble_without_steps_takes_twenty() -> None:
    for sweep in ("", "sweep: {to: mean-plane}\n"):
        study = loads(SURFACE + sweep + ASKED)
        assert study.sweep.steps == 20
        assert loads(study.to_yaml()) == pickle.loads(pickle.dumps(study)) == study
    assert study.changed(**{"sweep.steps": 33}).sample(2.5, 6, 1).sweep.steps == 33
    assert loads(SURFACE + "sweep: {steps: 30}\n" + ASKED).sweep.steps == 30
    assert loads(SURFACE + "sweep: {pressures: [0.1, 0.3]}\n" + ASKED).sweep.steps == 2
    assert loads(SURFACE).sweep.steps == 60


@pytest.mark.parametrize(("accuracy", "rtol"), [("1 %", 1e-4), ("0.9 %", 1e-5), ("20 %", 1e-3), ("0.05", 1e-4)])
def test_the_solver_is_as_accurate_as_the_request_needs(accuracy: str, rtol: float) -> None:
    text = SURFACE + ASKED.replace("1 %", accuracy)
    assert loads(text).cases()[0].solver.tolerance == pytest.approx(rtol)
    assert loads(text + "solver: {rtol: 1.0e-8}").cases()[0].solver.tolerance == 1e-8
    punch = loads(text + "solver: {kernel: punch}")
    assert punch.cases()[0].solver.tolerance == pytest.approx(rtol)
    assert punch.cases()[0].solver.kernel == "punch"
    assert loads(punch.stored(), stored=True).cases() == punch.cases()


def test_stored_names_of_quantities_are_understood() -> None:
    names = ("contact_area_fraction", "contact_area")
    stored, plain = (loads(SURFACE + ASKED.replace("free_volume", name)).ensemble for name in names)
    assert stored == plain


WITH_UNIT = "surface: {D: 2.5, m: 7, L: 50 um, Sq: 0.5 um}\nmaterial: {E_star: 10 MPa}\n"


def test_states_with_a_unit_are_read_as_in_a_sweep() -> None:
    study = loads(WITH_UNIT + ASKED.replace("[0.1, 0.3]", "[0.05 MPa, 100 kPa], separation: 100 nm"))
    labels = [level.label for level in study.ensemble.at.levels]
    assert labels == ["pressure=0.05 MPa", "pressure=100 kPa", "separation=100 nm"]
    assert loads(study.to_yaml()) == study
    assert loads(study.stored(), stored=True) == study
    listed = "sweep: {pressures: [50 kPa, 0.1 MPa]}\n"
    loads(WITH_UNIT + listed + ASKED.replace("[0.1, 0.3]", "[0.05 MPa, 100 kPa]"))
