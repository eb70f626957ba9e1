"""Quantities of the void at a state: values from the steps of a sweep, and requests that a sweep cannot answer."""

import functools
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.campaign.execution import run
from roughvol.campaign.one_case import run_case
from roughvol.ensemble.samples import SampleTable
from roughvol.ensemble.step_error import trial
from roughvol.ensemble.targets import PERCOLATION, Arrays, Series, error_at, series_of, targets_of, value_at
from roughvol.errors import StudyError
from roughvol.store import dataset
from roughvol.study import Case, Level, loads
from roughvol.study.values.units import Quantity

EVERY = "record: {transport: {percolation: every-step, transmissivity: every-step}}"


def _case(to: str, steps: int = 12, record: str = EVERY) -> Case:
    return loads(f"surface: {{D: 2.3, m: 4, seeds: 1}}\nsweep: {{steps: {steps}, to: {to}}}\n{record}").cases()[0]


@functools.cache
def _arrays(case: Case) -> Arrays:
    return dataset.arrays_of(run_case(case))


def _series(case: Case) -> Series:
    return series_of(_arrays(case))


def test_the_pressure_at_which_the_void_closes_is_that_of_a_sweep_to_percolation() -> None:
    for axis, name in (("both", ""), ("x", "_x"), ("y", "_y")):
        exact_case = _case(f"{{percolation: {axis}}}", 6, "")
        of_exact = (_series(exact_case), f"percolation_pressure{name}", PERCOLATION, exact_case)
        exact = value_at(*of_exact)
        case = _case("{pressure: 40}", 30)
        series = _series(case)
        of_case = (series, f"percolation_pressure{name}", PERCOLATION, case)
        middle = value_at(*of_case)
        steps = np.diff(series["mean_pressure"])
        assert error_at(*of_exact, 2) == 0.0
        assert abs(middle - exact) <= 0.5 * steps.max() * (1.0 + 1e-9)
        assert abs(error_at(*of_case, 2)) <= steps.max()


def test_a_solved_closing_pressure_is_the_pressure_at_which_the_void_closes() -> None:
    record = "record: {transport: {percolation: every-step, closing: true}}"
    for end in ("{pressure: 40}", "mean-plane"):  # closed between two steps, and still open at the last
        case = _case(end, 4, record)
        solved = _arrays(case)["closing_pressure"][1].ravel()
        for name, expected in (("", solved.max()), ("_x", solved[0]), ("_y", solved[1])):
            of_case = (_series(case), f"percolation_pressure{name}", PERCOLATION, case)
            assert value_at(*of_case) == expected
            assert error_at(*of_case, 2) == 0.0
    asked = "ensemble: {accuracy: {percolation_pressure_x: 5 %}}"
    assert not trial(loads(f"surface: {{D: 2.3, m: 4}}\nsweep: {{to: {{pressure: 40}}}}\n{record}\n{asked}"))


def test_the_last_step_is_the_end_of_its_sweep_even_if_its_solve_falls_short() -> None:
    case = _case("{separation: 0.3}", 12, "")
    series = dict(_series(case))
    series["separation"] = np.append(series["separation"][:-1], 0.3 + 1e-6)
    end = Level("separation", 0.3)
    assert value_at(series, "mean_pressure", end, case) == pytest.approx(series["mean_pressure"][-1], rel=1e-12)
    assert abs(error_at(series, "mean_pressure", end, case, 2)) < 1e-2
    with pytest.raises(StudyError, match="is not reached by"):
        value_at(series, "mean_pressure", Level("separation", 0.29), case)


def test_a_state_before_the_first_touch_is_no_reason_to_sweep_further() -> None:
    case = _case("mean-plane")
    touch = float(_series(case)["separation"][0])
    with pytest.raises(StudyError, match=rf"9 lies before the first touch of .*; allowed: below {touch:.4g}$"):
        value_at(_series(case), "mean_pressure", Level("separation", 9.0), case)


def test_coefficients_between_steps_are_those_of_the_steps_beside() -> None:
    case = _case("mean-plane")
    arrays = _arrays(case)
    series = series_of(arrays)
    p = arrays["mean_pressure"][1].ravel()
    both = arrays["transmissivity"][1].mean(axis=-1).ravel()
    at_step = value_at(series, "transmissivity", Level("pressure", float(p[5])), case)
    between = value_at(series, "transmissivity", Level("pressure", float(0.5 * (p[5] + p[6]))), case)
    assert_allclose(at_step, both[5])
    assert both[6] < between < both[5]
    leak = value_at(series, "log_leak_rate", Level("last"), case)
    T = arrays["transmissivity"][1][0, 0, 0, -1].tolist()
    V = float(arrays["free_volume"][1].ravel()[-1])
    assert_allclose(leak, 0.5 * np.log10(T[0] * T[1]) + 3.0 * np.log10(V))
    share = value_at(series, "connected_volume_fraction", Level("pressure", float(0.5 * p[0])), case)
    assert float(arrays["connected_volume_fraction"][1].ravel()[0]) <= share <= 1.0


@pytest.mark.parametrize("name", ["free_volume", "separation"])
def test_a_region_is_read_off_from_its_last_unloaded_step_on(name: str) -> None:
    surface = "surface: {D: 2.3, m: 4, seeds: [11]}\nrecord: {region: interior}\nsweep: "
    (case,) = loads(surface + "{steps: 8, to: {pressure: 1}}").cases()
    series = _series(case)
    loaded = int(np.argmax(series["mean_pressure"] > 0.0))
    assert loaded == 4
    light = 0.5 * float(series["mean_pressure"][loaded])
    (solved,) = loads(f"{surface}{{pressures: {light}}}").cases()
    found = value_at(series, name, Level("pressure", light), case)
    assert found == pytest.approx(_series(solved)[name][-1], rel=0.05)


SCALED = "surface: {D: 2.2, m: 4, L: 1 mm, Sq: 2 um, seeds: 1}\nsweep: {steps: 4, to: {separation: 0.5}}"
REGION = "surface: {D: 2.3, m: 4, seeds: [1]}\nrecord: {region: interior}\nsweep: {steps: 2, to: {pressure: 1}}"
ZERO, LIGHT = Level("separation", Quantity(0.0, "um")), Level("pressure", 1e-6)


@pytest.mark.parametrize(
    ("case", "name", "level", "words"),
    [
        (loads(SCALED).cases()[0], "mean_pressure", ZERO, "0 um is not reached .* at separation 1 um: sweep further"),
        (loads(REGION).cases()[0], "free_volume", LIGHT, r"has no value at pressure=\S+ on .*: the first step"),
        (_case("mean-plane"), "transmissivity", LIGHT, r"accuracy.transmissivity: has no value .*first step"),
        (_case("mean-plane"), "percolation_pressure", PERCOLATION, "_pressure: the void of .* is still open"),
        (_case("{percolation: both}", 6), "log_leak_rate", Level("last"), "has no value at last.*no way is left"),
    ],
)
def test_a_quantity_without_a_value_at_a_state_is_refused(case: Case, name: str, level: Level, words: str) -> None:
    with pytest.raises(StudyError, match=words):
        value_at(_series(case), name, level, case)


def test_a_quantity_without_a_state_has_a_state_of_its_own() -> None:
    for asked, states in (
        ("free_volume: 5 %, percolation_pressure: 5 %", ["last", "percolation"]),
        ("percolation_pressure: 5 %", ["percolation"]),
    ):
        study = loads(f"surface: {{D: 2.3, m: 4}}\nsweep: {{to: percolation}}\nensemble: {{accuracy: {{{asked}}}}}")
        assert [target.state.label for target in targets_of(study.ensemble)] == states


def test_the_mean_of_a_quantity_of_the_void_is_stored(tmp_path: Path, few_samples: None) -> None:
    text = "surface: {D: 2.3, m: 3}\nsweep: {steps: 2, to: percolation}\nrecord: {transport: {percolation: every-step}}"
    asked = "\nensemble: {accuracy: {percolation_pressure: 50 %}}"
    results = run(loads(text + asked), out=tmp_path, jobs=1)
    closing = results.sel(ensemble_at="percolation")
    assert float(closing.percolation_pressure_interval.diff("bound").item()) > 0.0
    last = results.mean_pressure.isel(step=-1, m=-1).squeeze("D").dropna("seed")
    assert abs(closing.percolation_pressure_mean.item() / float(last.mean()) - 1.0) < 0.5
    assert "mean p_c*, D = 2.3, m = 3" in results.attrs["answer"]


LISTED = """surface: {D: 2.3, m: 3, seeds: 3}
sweep: {pressures: [0.2, 0.4]}
record: {transport: {transmissivity: every-step}}
solver: {accuracy: ACCURACY}
"""


@pytest.mark.parametrize("accuracy", ["standard", "draft"])
def test_a_listed_load_is_a_step_although_a_level_falls_beside_it(accuracy: str) -> None:
    """A listed load is solved: its numbers are those of the step, also of the first one, before which nothing is."""
    for case in loads(LISTED.replace("ACCURACY", accuracy)).cases():
        arrays = _arrays(case)
        series = series_of(arrays)
        for step, pressure in enumerate((0.2, 0.4)):
            T = arrays["transmissivity"][1][0, 0, 0, step]
            assert value_at(series, "transmissivity", Level("pressure", pressure), case) == np.mean(T)
            volume = value_at(series, "free_volume", Level("pressure", pressure), case)
            assert volume == arrays["free_volume"][1].ravel()[step]


@pytest.mark.parametrize("missed", [-9e-6, 0.0, 9e-6])
def test_a_step_that_reaches_a_state_to_the_tolerance_is_that_state(missed: float) -> None:
    case = _case("{pressure: 0.4}", 4)
    series = dict(_series(case))
    series["mean_pressure"] = np.array([0.0, 0.1 * (1.0 + missed), 0.2, 0.3, 0.4])
    assert value_at(series, "transmissivity", Level("pressure", 0.1), case) == series["transmissivity"][1]


def test_a_region_without_contact_has_a_pressure_without_error() -> None:
    outside = "record: {region: {x: [0, 0.1], y: [0, 0.1]}}\n"
    study = loads(
        f"surface: {{D: 2.3, m: 4}}\nsweep: {{steps: 1, to: {{indentation: 0.1}}}}\n{outside}"
        "ensemble: {accuracy: {pressure: 0.1}}"
    )
    table = SampleTable(study, 4)
    table.add(study.sample(2.3, 4, 0), _arrays(study.sample(2.3, 4, 0)))
    (sample,) = table.of(2.3)[-1]
    assert (sample.values[0], sample.solver_errors[0]) == (0.0, 0.0)


@pytest.mark.parametrize("height", ["", "Sq: 0.5 um, "])
def test_a_state_with_a_unit_is_the_starred_state_of_each_surface(height: str) -> None:
    text = f"surface: {{D: 2.3, m: 4, {height}L: 50 um}}\nmaterial: {{E_star: 10 MPa}}\n"
    text += "sweep: {steps: 6, to: {contact_area: 0.3}}\n"
    text += "ensemble: {accuracy: {free_volume: 5 %}, at: {AT}}"
    for seed in (0, 1):
        case = loads(text.replace("AT", "pressure: [0.05 MPa]")).sample(2.3, 4, seed)
        series = _series(case)
        Sq = case.height or float(series["Sq"][0])
        for kind, written, starred in (
            ("pressure", "0.05 MPa", 0.05 * 50 / (10 * Sq)),
            ("separation", "100 nm", 0.1 / Sq),
        ):
            study = loads(text.replace("AT", f"{kind}: [{written}]"))
            (target,) = targets_of(study.ensemble)
            assert target.state.label == f"{kind}={written}"
            value = value_at(series, "free_volume", Level(kind, starred), case)
            assert target.value(series, case) == pytest.approx(value, rel=1e-9)
            errors = [error_at(series, "free_volume", state, case, 2) for state in (target.state, Level(kind, starred))]
            assert errors[0] == pytest.approx(errors[1], rel=1e-6)


def test_a_starred_state_is_not_the_end_of_a_sweep_to_the_same_number_with_a_unit() -> None:
    text = "surface: {D: 2.3, m: 4, L: 50 um, Sq: 0.5 um}\nmaterial: {E_star: 10 MPa}\n"
    text += (
        "sweep: {steps: 6, to: {pressure: 0.1 MPa}}\nensemble: {accuracy: {free_volume: 5 %}, at: {pressure: [0.1]}}"
    )
    case = loads(text).sample(2.3, 4, 0)
    series = _series(case)
    assert value_at(series, "free_volume", Level("pressure", 0.1), case) > 1.5 * series["free_volume"][-1]
    assert case.sweep.legs[0].step_of(Level("pressure", Quantity(100.0, "kPa"))) == 5
    with pytest.raises(StudyError, match=r"2 MPa is not reached .* sweep ends at pressure 0\.1 MPa"):
        value_at(series, "free_volume", Level("pressure", Quantity(2.0, "MPa")), case)
