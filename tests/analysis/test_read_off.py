"""Read-offs from a stored sweep: of the leakiest surface, with an interval, against new runs at the value."""

import math
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import roughvol
from roughvol.analysis import read_off
from roughvol.analysis.leak_curve import Curve
from roughvol.analysis.tables import rounded
from roughvol.campaign import execution
from roughvol.cli.ask import _words
from roughvol.errors import StudyError
from roughvol.observables.at_state import at_state
from roughvol.store.dataset import Dataset
from roughvol.study import loads, parse
from tests.analysis.kit import RUBBER
from tests.bench.read_off import measured
from tests.kit import LEAKING, answered, ran, refused, said

TEXT = RUBBER + "solver: {rtol: 1.0e-9}\n"
ALONE = TEXT.replace("seeds: 2", "seeds: 1")
CLOSES = TEXT.replace("seeds: 2", "seeds: 3").replace("steps: 20, to: {pressure: 1.2}", "steps: 10, to: percolation")
CREEP = {"power": {"exponent": 0.1, "time": "1 s"}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ask") / "seal"


@pytest.fixture(scope="module")
def swept(folder: Path) -> Dataset:
    return execution.run(loads(TEXT), jobs=1, out=folder)


@pytest.fixture(scope="module")
def largest(swept: Dataset) -> float:
    """A leak between two steps."""
    middle = swept.leak_rate.sel(axis="x").isel(step=slice(10, 12)).values
    return float(np.exp(np.log(middle).mean()))


@pytest.fixture(scope="module")
def closing(folder: Path) -> Dataset:
    """Three surfaces, each pressed until its own ways close."""
    return execution.run(loads(CLOSES), jobs=1, out=folder.parent / "closing")


# against new runs


def _leaks_at(text: str, pressure: float, tmp_path: Path) -> np.ndarray:
    """The leaks along x of a new run that ends at a nominal pressure [MPa], one for each surface."""
    text = text.replace("steps: 20, to: {pressure: 1.2}", f"steps: 2, to: {{pressure: {pressure!r} MPa}}")
    end = execution.run(loads(text), jobs=1, out=tmp_path).isel(step=-1)
    assert_allclose(end.nominal_pressure, pressure, rtol=2e-6)  # the accuracy of the search for the end
    return np.asarray(end.leak_rate.sel(axis="x").values.ravel())


def _at(text: str, unknown: str, value: float) -> str:
    """The study at a value of the modulus [MPa] or of Sq [um]."""
    return {
        "pressure": text,
        "modulus": text.replace("E_star: 10 MPa", f"E_star: {value!r} MPa"),
        "Sq": text.replace("Sq: 0.4 um", f"Sq: {value!r} um"),
    }[unknown]


@pytest.mark.parametrize("unknown", ["pressure", "modulus", "Sq"])
def test_the_leakiest_surface_leaks_the_value_within_the_interval(
    unknown: str, swept: Dataset, largest: float, tmp_path: Path
) -> None:
    pressure = float(swept.nominal_pressure.isel(step=8).mean())
    answer = read_off.ask(swept, largest, unknown, pressure=pressure)[0]
    assert answer.low < answer.value < answer.high < 1.1 * answer.low
    assert answer.unit == {"pressure": "MPa", "modulus": "MPa", "Sq": "um"}[unknown]
    of_study = {"pressure": answer.value, "modulus": 10.0, "Sq": 0.4}[unknown]
    assert_allclose(answer.value, of_study * answer.times, rtol=1e-12)
    found = []
    for number, value in enumerate((answer.low, answer.high)):
        there = value if unknown == "pressure" else pressure
        found.append(_leaks_at(_at(TEXT, unknown, value), there, tmp_path / str(number)))
    assert min(leaks.max() for leaks in found) < largest < max(leaks.max() for leaks in found)
    assert [f"seed {leaks.argmax()}" for leaks in found] == [answer.surface] * 2


def test_a_refined_run_by_the_printed_command_narrows_the_answer(
    swept: Dataset, folder: Path, largest: float, here: Path
) -> None:
    printed = said("ask", folder, "--leak-rate", f"{largest} mm^3/s")
    command = shlex.split(printed.splitlines()[-1].partition("narrow the interval: ")[2])
    assert command[:3] == ["roughvol", "run", str(folder)]
    said(*command[1:], "--jobs", "1")
    asked = "--leak-rate", f"{largest} mm^3/s"
    wide, narrow = (answered("ask", name, *asked)["answers"] for name in (folder, "seal_closer"))
    for one, other in zip(wide, narrow, strict=True):
        low, high = one["interval"]
        below, above = other["interval"]
        assert low * (1 - 1e-4) <= below <= above <= high * (1 + 1e-4)
        assert above / below - 1.0 < 0.2 * (high / low - 1.0)


# several surfaces, of which some close


def test_a_closed_joint_is_asked_for_by_its_loads(closing: Dataset, folder: Path) -> None:
    found = answered("ask", folder.parent / "closing", "--closed")
    assert found["leak_rate"] is None
    assert found["answers"][0]["closes_inside"]
    printed = said("ask", folder.parent / "closing", "--closed", "--for", "modulus", "--at", "pressure=1kPa")
    assert "where the last way closes" in printed
    assert "times the E* of the study" in printed
    assert "for the leakiest of 3 surfaces (seed " in printed


def test_a_closed_joint_without_units_is_asked_for_by_p_star(here: Path) -> None:
    text = "surface: {D: 2.3, m: 4, seeds: 3}\nsweep: {steps: 8, to: {pressure: 8}}\n"
    ran("plain", text + "record: {transport: {percolation: every-step}}\n")
    ds = roughvol.open("plain").isel(D=0, m=0)
    last = [np.flatnonzero(row)[-1] for row in ds.percolates.sel(axis="x").values > 0]
    low = max(float(p[k]) for p, k in zip(ds.mean_pressure.values, last, strict=True))
    assert f"\nalong x: p* = {rounded(low, low, low, upwards=False)} to " in said("ask", "plain", "--closed")
    assert "needs pressures with units" in refused("ask", "plain", "--closed", "--for", "Sq", "--at", "p=0.3")
    for both in ((), ("--closed", "--leak-rate", "1 mm^3/s")):
        assert "either --leak-rate VALUE or --closed" in refused("ask", "plain", *both)


@pytest.mark.parametrize(
    ("end", "states", "seals", "words"),
    [
        ("pressure: 0.5", "{contact_area: 0.9}", (False, True), "no stored leak along x"),
        ("pressure: 0.5", "{contact_area: 0.15}", (False, True), "no stored leak of seed 0 along x"),
        ("contact_area: 0.25", "last", (True,), r"known from 0.*, and up to 0"),  # such leaks were taken as 0
    ],
)
def test_surfaces_without_known_leaks_are_refused(
    end: str, states: str, seals: tuple[bool, ...], words: str, tmp_path: Path
) -> None:
    text = TEXT.replace("m: 4", "m: 3").replace("steps: 20, to: {pressure: 1.2}", f"steps: 2, to: {{{end}}}")
    for seal in seals:
        study = loads(text.replace("every-step", states) + "seal: {length: 20 mm, width: 2 mm}\n" * seal)
        ds = roughvol.run(study, jobs=1, out=tmp_path / str(seal))
        with pytest.raises(StudyError, match=words):
            roughvol.ask(ds, leak_rate="1e-6 mm^3/s")
        with pytest.raises(StudyError, match=words):
            roughvol.creep(ds, CREEP, at="pressure=0.01 MPa", times=["1 s"])


def test_unknown_errors_leave_no_end_where_a_way_closes(closing: Dataset) -> None:
    unknown = read_off.Errors((), (np.nan, np.nan), (), (np.nan, np.nan), ())
    wanted = float(closing.leak_rate.min("axis").isel(step=3).min())
    for answer in read_off.ask(closing, wanted, "pressure", errors=dict.fromkeys("xy", unknown)):
        assert 0.0 < answer.value < np.inf
        assert (answer.low, answer.high) == (0.0, np.inf)


def test_pressures_that_no_record_names_are_in_the_unit_of_the_modulus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # without a run of this name
    text = CLOSES.replace("seeds: 3", "seeds: 1").replace("solver: {rtol: 1.0e-9}\n", "").replace("m: 4", "m: 3")
    named = roughvol.run(loads(text), jobs=1, out=tmp_path / "named")
    silent = roughvol.run(loads(text.replace("pressure: MPa, ", "")), jobs=1, out=tmp_path / "silent")
    assert "nominal_pressure" not in silent
    at = {"unknown": "modulus", "at": "pressure=0.01 MPa"}
    for wanted in ({}, at, {"leak_rate": "1e-6 mm^3/s"}, {"leak_rate": "1e-6 mm^3/s"} | at):
        found, expected = (roughvol.ask(ds, **wanted) for ds in (silent, named))
        assert found.plain() == expected.plain() | {"run": found.run.name, "narrower": None}  # no run has this name
        assert all(answer.unit == "MPa" for answer in found.answers)
    history = [roughvol.creep(ds, CREEP, at="pressure=0.01 MPa", times=["1 s"]).plain() for ds in (silent, named)]
    assert history[0] == history[1]
    plain = roughvol.run(loads(text.replace("pressure: MPa, ", "").replace("10 MPa", "10")), jobs=1, out=tmp_path / "p")
    with pytest.raises(StudyError, match="needs pressures with units: give material a unit"):
        roughvol.ask(plain, leak_rate="1e-6 mm^3/s")


@pytest.mark.parametrize(
    "elsewhere", ["transmissivity: every-step", "diffusivity: every-step", "gas_flow: every-step", ""]
)
def test_ways_are_open_where_any_record_has_them_open(here: Path, elsewhere: str) -> None:
    text = "surface: {D: 2.3, m: 3, seeds: 1, L: 100 um}\nsweep: {steps: 5, to: percolation}\n"
    text += "fluid: {gas: helium, inlet: 2 bar, outlet: 1 bar}\n" * elsewhere.startswith("gas")
    ran("last", f"{text}record: {{transport: {{percolation: last, {elsewhere}}}}}\n")
    low, high = roughvol.open("last").mean_pressure.values.ravel()[-2:]
    low, high = rounded(low, low, low, upwards=False), rounded(high, high, high, upwards=True)
    closes = f"p* = {low} to {high}, where the last way closes" if elsewhere else f"any pressure of p* = {high}"
    assert f"\nalong x: {closes}" in said("ask", "last", "--closed")


# one curve


@pytest.mark.slow
def test_the_interval_of_a_reading_contains_the_truth_in_95_percent(tmp_path: Path) -> None:
    found = [point for point in measured([0, 1, 3, 6, 9, 10, 13], tmp_path) if point.kind == "liquid"]
    assert len({point.way for point in found}) > 10
    for read in ("leak", "load"):
        holds = [point.holds for point in found if point.read == read]
        assert np.mean(holds) >= 0.95
    inner = [point.stated for point in found if point.place == "inner"]
    assert np.median(inner) < 0.1  # and is not wide


def _curve(pressure: Any, leak: Any) -> Curve:
    values = [np.asarray(array, dtype=float) for array in (pressure, leak, pressure)]
    return Curve("seed 0", values[0], values[1], values[2], 1.0)


def test_a_reading_is_exact_at_a_step() -> None:
    curve = _curve([1.0, 2.0, 4.0, 8.0, 9.0], [8.0, 7.0, 3.0, 0.01, 0.0])
    on_step = curve.at(np.array([1.0, 2.0, 4.0, 8.0, 4.0 * (1 + 1e-7)]))
    assert_allclose(on_step.value, [8.0, 7.0, 3.0, 0.01, 3.0])
    assert_allclose(on_step.low, on_step.high)


@pytest.mark.parametrize("steps", [3, 4, 7, 8, 9])
def test_the_error_between_two_steps_is_that_of_the_nearest_inner_steps_read_off_without_themselves(steps: int) -> None:
    random = np.random.default_rng(steps)
    x, y = np.cumsum(random.uniform(0.2, 0.6, steps)), -np.cumsum(random.uniform(0.2, 1.0, steps))
    without = {k: abs(at_state(np.delete(x, k), np.delete(y, k), x[k])[0] - y[k]) for k in range(1, steps - 1)}
    middles = 0.5 * (x[1:] + x[:-1])
    reading = _curve(np.exp(x), np.exp(y)).at(np.exp(middles))
    for i, middle in enumerate(middles):
        cubic, straight = (at_state(x, y, np.array([middle]), straight=way)[0] for way in (False, True))
        nearest = sorted(without, key=lambda k: abs(k - i - 0.5))[:2]
        error = max([without[k] for k in nearest] + [abs(cubic - straight)])
        assert_allclose(np.log(reading.value[i]), cubic, rtol=1e-12)
        assert_allclose(np.log(reading.high[i]), min(cubic + error, y[i]), rtol=1e-12)
        assert_allclose(np.log(reading.low[i]), max(cubic - error, y[i + 1]), rtol=1e-12)


@pytest.mark.parametrize("leak", [3.0 * (1 - 1e-9), 3.0, 3.0 * (1 + 1e-9)], ids=["below", "equal", "above"])
def test_the_load_of_the_leak_of_a_step_is_that_of_the_step(leak: float) -> None:
    curve = _curve([1.0, 2.0, 4.0, 8.0], [8.0, 7.0, 3.0, 0.01])
    found = curve.load_where(lambda logs: np.full(len(logs), np.log(leak)))
    assert_allclose([found.value, found.low, found.high], 4.0, rtol=1e-8)


def test_where_a_way_closes_the_leak_is_between_nothing_and_the_last_one() -> None:
    curve = _curve([1.0, 2.0, 4.0, 8.0], [5.0, 3.0, 1.0, 0.0])
    reading = curve.at(np.array([0.5, 5.0, 8.0, 20.0]))
    assert_allclose(reading.value, [math.nan, 0.75, 0.0, 0.0])
    assert_allclose(reading.low, [math.nan, 0.0, 0.0, 0.0])
    assert_allclose(reading.high, [math.nan, 1.0, 0.0, 0.0])
    assert curve.ends == math.inf
    still_open = _curve([1.0, 2.0], [5.0, 3.0])
    assert still_open.ends == 2.0
    assert math.isnan(still_open.at(np.array([3.0])).value[0])
    two = still_open.at(np.array([1.5]))
    assert_allclose((two.low[0], two.high[0]), (3.0, 5.0), rtol=1e-12)


def test_a_modulus_whose_study_cannot_be_read_again_is_in_units_of_that_of_the_study(
    swept: Dataset, largest: float
) -> None:
    pressure = float(swept.nominal_pressure.isel(step=8).mean())
    known = read_off.ask(swept, largest, "modulus", pressure=pressure)[0]
    answer = read_off.ask(swept.assign_attrs(study="later: words"), largest, "modulus", pressure=pressure)[0]
    assert (answer.value, answer.unit) == (known.times, "times the E* of the study")
    assert (answer.low, answer.high) == pytest.approx((known.low / 10.0, known.high / 10.0))


# outside the stored loads


def test_a_value_beyond_the_stored_loads_is_infinite_and_one_above_all_is_zero(swept: Dataset) -> None:
    assert read_off.ask(swept, 1e-30, "pressure")[0].value == math.inf
    assert read_off.ask(swept, 1e30, "pressure")[0].value == 0.0
    assert read_off.ask(swept, 1e-30, "modulus", pressure=0.1)[0].value == 0.0
    assert read_off.ask(swept, 1e30, "Sq", pressure=1e-2)[0].value == math.inf
    record = read_off.record(read_off.ask(swept, 1e-30, "pressure")[0], "pressure")
    assert record["value"] is None
    assert record["interval"][1] is None


def test_without_an_answer_the_sweep_goes_on(swept: Dataset, largest: float) -> None:
    answers = read_off.ask(swept, 1e-30, "pressure")
    assert read_off.narrower(swept, answers, closed=False)[1] == "sweep.to=percolation"
    assert read_off.narrower(swept, answers, closed=True)[1] == "record.transport.closing=true"
    yields = swept.assign(plastic_volume=0.0 * swept.free_volume)  # its closing is not solved beyond the sweep
    assert read_off.narrower(yields, answers, closed=True) == read_off.narrower(swept, answers, closed=False)
    solved = swept.assign(closing_pressure=((*swept.Sq.dims, "axis"), np.full((*swept.Sq.shape, 2), np.inf)))
    assert not read_off.narrower(solved, answers, closed=True)
    listed = swept.assign_attrs(study=loads(TEXT, changes=["sweep={pressures: [0.1 MPa]}"]).to_yaml())
    assert read_off.narrower(listed, answers, closed=False)[1] == "sweep={steps: 20, to: percolation}"
    one = [read_off.ask(swept, largest, "pressure")[0], answers[1]]
    assert [read_off.is_beyond(answer) for answer in one] == [False, True]
    assert read_off.narrower(swept, one, closed=False)[1] == "sweep.to=percolation"
    assert not read_off.narrower(swept, read_off.ask(swept, 1e30, "pressure"), closed=False)


# refused


NO_FLOW = "the run has no transmissivity, so the leak at another Sq is not known"


def _without_ways(ds: Dataset) -> Dataset:
    """The flow and the ways of one surface are not known."""
    return ds.assign({name: ds[name].where(ds["seed"] > 0) for name in ds.data_vars if "axis" in ds[name].dims})


@pytest.mark.parametrize(
    ("question", "words"),
    [
        (lambda ds: read_off.ask(ds, 1.0, "E"), "allowed: pressure"),
        (lambda ds: read_off.ask(ds, 0.0, "pressure"), "> 0"),
        (lambda ds: read_off.ask(ds, 1.0, "Sq"), "the load is needed, .* as pressure="),
        (lambda ds: read_off.ask(ds.drop_vars("transmissivity"), 1.0, "Sq", pressure=0.1), NO_FLOW),
        (lambda ds: read_off.checked(ds.isel(D=[0, 0])), r"several D \(2\.2, 2\.2\); .* single D takes"),
        (lambda ds: read_off.ask(_without_ways(ds), None, "pressure"), "no stored way of seed 0 along x; record"),
        (lambda ds: read_off.nominal_of(ds, parse("pressure=-1 MPa")), "pressure=-1 MPa: allowed: a load > 0"),
        (lambda ds: read_off.nominal_of(ds, parse("contact_area=0.1")), r"as pressure=0\.5MPa, load=20N or last"),
    ],
)
def test_questions_without_answer_are_refused(
    question: Callable[[Dataset], object], words: str, swept: Dataset
) -> None:
    with pytest.raises(StudyError, match=words):
        question(swept)


LIFT = (
    LEAKING.replace("seeds: 1", "seeds: [1], sides: periodic")
    .replace("every-step}", "every-step, gas_flow: every-step}\n  fluid_pressure: {FLUID}")
    .replace("FLUID", "inlet: 5 mbar, outlet: 0 bar, at: {pressure: [0.05 MPa, 0.1 MPa]}")
    .replace("unit: mm^3/s}", "unit: mm^3/s}, gas_leak_rate: sccm")
    + "fluid: {gas: helium, inlet: 1 bar, outlet: 0.5 bar}\n"
)


def test_the_leak_under_fluid_pressure_is_not_read_off_the_dry_leak(here: Path) -> None:
    """Other questions: crossing/test_crossing.py."""
    ran("lift", LIFT)
    for question in (("1e-6 mm^3/s", "--for", "modulus", "--at", "pressure=0.05MPa"), ("1e-3 sccm",)):
        message = refused("ask", "lift", "--leak-rate", *question)
        known = "the leak under fluid pressure is known at recorded states alone (pressure=0.05 MPa; pressure=0.1 MPa)"
        assert known in message
        assert "record.fluid_pressure.at" in message


def test_a_choice_of_a_list_is_read_off_with_the_material_of_its_label(tmp_path: Path) -> None:
    text = ALONE.replace("steps: 20, to: {pressure: 1.2}", "steps: 8, to: {pressure: 0.05 MPa}")
    several = text.replace("{E_star: 10 MPa}", "{E_star: [5 MPa, 10 MPa]}")
    every, alone = (roughvol.run(loads(one), jobs=1, out=tmp_path / str(k)) for k, one in enumerate((several, text)))
    chosen = every.sel(E_star=10.0)
    for load in ("pressure=0.02 MPa", "load=0.8 mN"):
        wanted = {"leak_rate": f"{float(alone.leak_rate.median())} mm^3/s", "unknown": "modulus", "at": load}
        found, expected = (roughvol.ask(ds, **wanted) for ds in (chosen, alone))
        for answer, true in zip(found.answers, expected.answers, strict=True):
            assert (answer.value, answer.low, answer.high) == pytest.approx((true.value, true.low, true.high))
        assert expected.narrower
        assert not found.narrower
        over_time = [roughvol.creep(ds, CREEP, at=load, times=["1 s"]) for ds in (chosen, alone)]
        assert over_time[0].equivalent == pytest.approx(over_time[1].equivalent)


def test_a_leak_ends_at_a_step_that_any_record_shows_closed(tmp_path: Path) -> None:
    record = "percolation: every-step, transmissivity: {pressure: [0.02 MPa]}"
    text = CLOSES.replace("transmissivity: every-step", record).replace("seeds: 3", "seeds: 1")
    ds = roughvol.run(loads(text), jobs=1, out=tmp_path)
    for answer, closes in zip(
        roughvol.ask(ds, leak_rate="1e-30 mm^3/s").answers, roughvol.ask(ds).answers, strict=True
    ):
        assert (answer.value, answer.nominal.closing) == (closes.value, True)
        assert 0.02 <= answer.low < closes.low < closes.high == answer.high


def test_a_dataset_saved_by_itself_has_no_study_to_run(swept: Dataset, largest: float, here: Path) -> None:
    swept.to_netcdf("saved.nc")
    leak = ("--leak-rate", f"{largest} mm^3/s")
    assert said("ask", "saved.nc", *leak).endswith("Errors of the grid and of the window are not in these numbers.\n")
    assert "allowed: a study file, or the name of a run" in refused("ask", "saved.nc", *leak, "--budget")


def test_of_a_path_the_first_leg_answers_and_says_so(here: Path) -> None:
    Path("law.yaml").write_text("prony: {shares: [0.5], times: [10 s]}")
    legs = "[{steps: 4, to: {pressure: 1.2}}, {steps: 2, to: {pressure: 0.2}}]"
    ran("seal", ALONE.replace("{steps: 20, to: {pressure: 1.2}}", legs))
    rate = float(roughvol.open("seal").leak_rate.sel(axis="x").values.ravel()[2])
    question = ("ask", "seal", "--leak-rate", f"{rate} mm^3/s")
    assert said(*question).startswith("seal, leg 1 of 2: ")
    assert answered(*question)["leg"] == 1
    creep = ("creep", "seal", "--law", "law.yaml", "--times", "1 s", "--at")
    assert "seal, leg 1 of 2: at 0.002 MPa" in said(*creep, "pressure=2kPa, leg 1")
    for other in (
        (*question, "--for", "modulus", "--at", "pressure=0.01MPa, leg 2"),
        (*creep, "pressure=2kPa, leg 2"),
        (*creep, "last"),
    ):
        assert "read-offs are from leg 1" in refused(*other)


def test_a_load_is_a_pressure_or_a_force_or_the_last_one(swept: Dataset) -> None:
    assert_allclose(read_off.nominal_of(swept, parse("pressure=20kPa")), 0.02)
    area = 17**2 * (200e-6 / 16) ** 2
    assert_allclose(read_off.nominal_of(swept, parse("load=1mN")), 1e-3 / area * 1e-6)
    assert_allclose(read_off.nominal_of(swept, parse("p=0.3")), 0.3 * 10.0 * 0.4 / 200.0)
    assert_allclose(read_off.nominal_of(swept, parse("last")), 1.2 * 10.0 * 0.4 / 200.0, rtol=1e-6)


def test_a_load_that_is_another_pressure_on_each_surface_is_refused(closing: Dataset) -> None:
    with pytest.raises(StudyError, match="last: another pressure on each surface"):
        read_off.nominal_of(closing, parse("last"))


# the command


def test_the_command_prints_digits_of_the_error_and_what_is_not_in_it(
    swept: Dataset, folder: Path, largest: float
) -> None:
    printed = said("ask", folder, "--leak-rate", f"< {largest} mm^3/s")
    row = next(line for line in printed.splitlines() if line.startswith("along x: "))
    value = row.split()[3]
    assert len(value.replace(".", "").lstrip("0")) <= 5
    assert "for the leakiest of 2 surfaces (seed " in row
    assert "Errors of the grid and of the window are not in these numbers; with them: --budget, or" in printed
    modulus = said("ask", folder, "--leak-rate", f"{largest} mm^3/s", "--for", "modulus", "--at", "p=1 kPa")
    assert "modulus E* = " in modulus
    assert " MPa (" in modulus
    sq = said("ask", folder, "--leak-rate", f"{largest} mm^3/s", "--for", "Sq", "--at", "pressure=1 kPa")
    assert " um (" in sq
    assert "times the Sq of the study" in sq


def test_the_json_has_the_unit_of_the_pressure_at_the_study(swept: Dataset, folder: Path, largest: float) -> None:
    question = ("--leak-rate", f"{largest} mm^3/s", "--for", "modulus", "--at", "p=1 kPa")
    for answer in answered("ask", folder, *question)["answers"]:
        assert answer["nominal_pressure_unit"] == swept["nominal_pressure"].attrs["units"]
        assert set(answer["nominal_pressure_steps"]) <= set(swept["nominal_pressure"].values.ravel())


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (0.0279432, 0.0276, 0.0282, "0.0279"),
        (0.0279432, 0.02793, 0.02796, "0.02794"),
        (0.0279432, 0.01, 0.05, "0.028"),
        (1.23456789, 1.2345, 1.2346, "1.23457"),
        (2.5e-7, 2.4e-7, 2.6e-7, "2.5e-7"),
        (2.0e-7, 1.9e-7, 2.1e-7, "2.0e-7"),
        (0.02, 0.019, 0.022, "0.020"),
        (1234.5, 1100.0, 1400.0, "1200"),
        (9.3e12, 0.0, 2e13, "9.3e12"),
        (0.5, 0.5, 0.5, "0.5"),
        (0.0, 0.0, 0.0, "0"),
    ],
)
def test_digits_follow_the_interval(value: float, low: float, high: float, text: str) -> None:
    assert rounded(value, low, high) == text


@pytest.mark.parametrize(
    ("value", "low", "high", "texts"),
    [
        (0.0279432, 0.0276, 0.0282, ("0.0279", "0.0280")),
        (0.5647, 0.5, 0.5647, ("0.56", "0.57")),
        (0.50000002, 0.5, 0.56, ("0.50", "0.50")),  # as near as a search comes
        (0.49999998, 0.49, 0.56, ("0.50", "0.50")),
        (2.51e-7, 2.4e-7, 2.6e-7, ("2.5e-7", "2.6e-7")),
        (1234.5, 1100.0, 1400.0, ("1200", "1300")),
        (0.5, 0.5, 0.5, ("0.5", "0.5")),
        (0.20863, 0.20863, 0.20863, ("0.2086", "0.2087")),
        (0.1149, 0.0, math.inf, ("0.11", "0.12")),
    ],
)
def test_a_number_is_rounded_to_its_safe_side(value: float, low: float, high: float, texts: tuple[str, str]) -> None:
    assert tuple(rounded(value, low, high, upwards=upwards) for upwards in (False, True)) == texts


def test_an_answer_is_rounded_to_where_the_leak_is_smaller(closing: Dataset) -> None:
    wanted = f"{float(closing.leak_rate.isel(step=3).min())!r} mm^3/s"
    for unknown, at in (("pressure", None), ("modulus", "pressure=0.01 MPa"), ("Sq", "pressure=0.01 MPa")):
        found = roughvol.ask(closing, leak_rate=wanted, unknown=unknown, at=at)
        for answer in found.answers:
            words = _words(answer, unknown, closed=False)
            printed = [float(text) for text in re.findall(r"(?<![\w.])\d+\.?\d*(?:e-?\d+)?", words)][:3]
            slack = 0.002 * answer.value
            assert printed[0] >= answer.value - slack if unknown == "pressure" else printed[0] <= answer.value + slack
            if "(" in words:
                assert printed[1] <= answer.low + slack <= answer.high <= printed[2] + slack
            if unknown != "pressure":
                (times,) = re.findall(r"([\d.e-]+) times the", words)
                assert float(times) <= answer.times * 1.0001


def test_a_solved_closing_load_ends_the_reading(tmp_path: Path) -> None:
    """Between two far steps, and beyond the last one; no other study that solves the closing load is suggested."""
    text = ALONE.replace("solver: {rtol: 1.0e-9}\n", "")
    text = text.replace("transmissivity", "closing: true, percolation: every-step, transmissivity")
    for listed in ("[0.02 MPa, 9 MPa]", "[0.01 MPa, 0.02 MPa]"):
        study = loads(text.replace("steps: 20, to: {pressure: 1.2}", f"pressures: {listed}"))
        ds = roughvol.run(study, jobs=1, out=tmp_path / listed)
        answers = roughvol.ask(ds, leak_rate="1e-30 mm^3/s").answers
        for answer, end in zip(answers, roughvol.ask(ds).answers, strict=True):
            assert answer.value == pytest.approx(end.value)
            assert answer.low == pytest.approx(0.02)
            assert answer.nominal.closing
        assert "sweep=" in read_off.narrower(ds, answers, closed=False)[1]
    study = loads(text.replace("steps: 20, to: {pressure: 1.2}", "pressures: [9 MPa]"))
    ds = roughvol.run(study, jobs=1, out=tmp_path / "closed")
    assert "closes, before the first known load, 9 MPa" in said("ask", tmp_path / "closed", "--closed")
    before = [answer.high for answer in roughvol.ask(ds, leak_rate="1e-30 mm^3/s").answers]
    assert before == pytest.approx([answer.value for answer in roughvol.ask(ds).answers])
    folder = tmp_path / listed  # the closing load lies beyond its last step
    printed = said("ask", folder, "--leak-rate", "1e-30 mm^3/s")
    value, last = answers[1].value, answers[1].steps[0]
    words = "from the last open step to the closing of the last way"
    assert f"along y: pressure 0.02 to {rounded(value, value, value, upwards=True)} MPa, {words}\n" in printed
    assert f"where the last way closes, beyond {last:.4g} MPa" in said("ask", folder, "--closed")
    assert "where the last way closes" in said("ask", folder, "--leak-rate", "1e-30 mm^3/s", "--budget", "--jobs", "1")


def test_an_interval_that_another_surface_ends_is_not_said_to_end_at_the_closing(tmp_path: Path) -> None:
    text = """
surface: {D: 2.2, m: 4, L: 100 um, Sq: 0.5 um, seeds: [0, 3]}
material: {E_star: 10 MPa}
sweep: {steps: 4, to: percolation}
record:
  transport: {transmissivity: every-step, closing: true}
  dimensional: {leak_rate: {pressure_drop: 1 mbar, viscosity: 1 mPa*s}}
"""
    x = roughvol.ask(roughvol.run(loads(text), jobs=1, out=tmp_path), leak_rate="1e-8 mm^3/s").answers[0]
    assert (x.nominal.closing, x.surface) == (True, "seed 3")
    assert x.high > 1.1 * x.value  # of seed 0
    words = "along x: pressure 0.098 MPa (0.077 to 0.13), where the last way closes, between the known loads"
    assert words in said("ask", tmp_path, "--leak-rate", "1e-8 mm^3/s")


def test_a_solved_closing_load_needs_no_record_of_the_ways(tmp_path: Path) -> None:
    """A way without a solved closing load is open at the last step, as a surface that yields may have."""
    text = """
surface: {D: 2.2, m: 4, L: 100 um, Sq: 0.5 um, seeds: [1, 2]}
material: {E_star: 10 MPa, hardness: 1 MPa}
sweep: [{steps: 4, to: {pressure: 0.11 MPa}}, {steps: 2, to: {pressure: 0.02 MPa}}]
record: {transport: {closing: true}}
"""
    found = []
    for name, recorded in (("alone", text), ("followed", text.replace("true}", "true, percolation: every-step}"))):
        ds = roughvol.run(loads(recorded), jobs=1, out=tmp_path / name)
        found.append([(answer.value, answer.low, answer.high) for answer in roughvol.ask(ds).answers])
    assert found[0] == found[1]
    (x, *_), (y, *_) = found[0]
    assert 0.05 < x < 0.11 < y == math.inf


def test_the_elastic_combination_of_several_hardnesses_is_asked_as_an_elastic_run(tmp_path: Path) -> None:
    text = ALONE.replace("steps: 20, to: {pressure: 1.2}", "pressures: [0.008 MPa, 0.02 MPa, 0.036 MPa]")
    alone = roughvol.run(loads(text), jobs=1, out=tmp_path / "alone")
    yielding = text.replace("E_star: 10 MPa", "E_star: 10 MPa, hardness: [none, 1 MPa]")
    several = roughvol.run(loads(yielding), jobs=1, out=tmp_path / "several")
    elastic, yields = (several.sel(hardness=[label]) for label in (math.inf, 1.0))
    largest = f"{float(alone.leak_rate.sel(step=2, axis='x').item()):.6g} mm^3/s"
    asked: dict[str, Any] = {"leak_rate": largest, "unknown": "modulus", "at": "pressure=0.02 MPa"}
    with pytest.raises(StudyError, match="allowed: for pressure"):
        roughvol.ask(yields, **asked)
    expected, found = (roughvol.ask(ds, **asked).answers for ds in (alone, elastic))
    assert [answer.value for answer in found] == [answer.value for answer in expected]
