"""The leak of a seal over time, from a stored sweep and a creep law."""

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pint
import pytest
from numpy.testing import assert_allclose

import roughvol
from roughvol.analysis import creep
from roughvol.analysis.average import average
from roughvol.analysis.closing import Closing
from roughvol.analysis.leak_card import Way
from roughvol.analysis.parts import Part
from roughvol.campaign import card as card_runs
from roughvol.campaign import execution
from roughvol.errors import StudyError
from roughvol.report.figures.creep import drawing_of
from roughvol.store.dataset import Dataset
from roughvol.study import Creep, load_creep, loads, read_times
from tests.analysis.kit import RUBBER
from tests.kit import answered, refused, said

TEXT = RUBBER.replace("name: seal", "name: rubber").replace("m: 4", "m: 6").replace("10 mbar", "1 mbar")
TEXT = TEXT.replace("steps: 20, to: {pressure: 1.2}", "steps: 24, to: {pressure: 2.0}")
PRONY = "prony: {shares: [0.5, 0.5], times: [10 s, 1 h]}"
MATERIAL = loads(TEXT).material


def _law(text: str, folder: Path) -> Creep:
    (folder / "creep.yaml").write_text(text)
    return load_creep(folder / "creep.yaml")


def _asked(run: Path, law: Path, *words: str, at: str = "pressure=10 kPa", times: str = "1 s, 1 h") -> tuple[str, ...]:
    """The arguments of a command."""
    return ("creep", str(run), "--law", str(law / "creep.yaml"), "--at", at, "--times", times, *words)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("creep") / "rubber"


@pytest.fixture(scope="module")
def run(folder: Path) -> Dataset:
    return execution.run(loads(TEXT), jobs=1, out=folder)


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


def test_a_law_of_python_is_that_of_its_file_and_names_its_argument(tmp_path: Path) -> None:
    minute = pint.Quantity(1.0, "min")
    of_file = _law("power: {exponent: 0.2, time: 1 min}", tmp_path)
    assert load_creep({"power": {"exponent": 0.2, "time": minute}}) == of_file
    assert_allclose(read_times([1, "1 min", minute * 2]), [1, 60, 120])
    assert_allclose(read_times(np.array([1.0, 60.0])), [1, 60])
    with pytest.raises(StudyError, match=r'creep: argument law\["power"\]\["time"\]: .m. is a unit of length'):
        load_creep({"power": {"exponent": 0.2, "time": "1 m"}})
    with pytest.raises(StudyError, match=r"""argument law\["powr"\]: unknown key; did you mean 'power'\?"""):
        load_creep({"powr": {}})


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
        ("spring: 1", "creep.yaml:1: spring: unknown key; allowed: prony, power, table, body, share"),
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


def test_a_law_that_is_absent_or_no_text_is_named_once(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"creep\.yaml: cannot read the creep law: No such file or directory$"):
        load_creep(tmp_path / "creep.yaml")
    (tmp_path / "creep.yaml").write_bytes(b"\xff")
    with pytest.raises(StudyError, match=r"creep\.yaml:1: not text in UTF-8$"):
        load_creep(tmp_path / "creep.yaml")


def test_times_are_a_range_or_a_list() -> None:
    assert_allclose(read_times("1 s..100 s"), np.logspace(0, 2, 9))
    assert_allclose(read_times("1 s, 1 min,1 day"), [1, 60, 86400])
    times = read_times("1e-300 s..1e300 s")
    assert (times[0], times[-1]) == (1e-300, 1e300)
    for wrong in ("", "1 s...1 h", "1 MPa", "2 s, 1 s", "0 s..1 s", "1e400 s", "1 s..1e400 s"):
        with pytest.raises(StudyError, match="times are"):
            read_times(wrong)


# the leak over time


@pytest.mark.parametrize("seconds", [1.0, 7200.0])
def test_the_leak_at_a_time_is_that_of_a_new_run_with_its_modulus(seconds: float, run: Dataset, tmp_path: Path) -> None:
    law, pressure = _law(PRONY, tmp_path), 0.016
    over_time = creep.history(run, law, pressure, [seconds])
    text = TEXT.replace("E_star: 10 MPa", f"E_star: {10 / law.ratio(seconds, MATERIAL)!r} MPa")
    text = text.replace("steps: 24, to: {pressure: 2.0}", f"steps: 2, to: {{pressure: {pressure} MPa}}")
    end = execution.run(loads(text), jobs=1, out=tmp_path / "then").isel(step=-1)
    for axis in ("x", "y"):
        leaks = end["leak_rate"].sel(axis=axis).values.ravel()
        read = over_time.leak[axis]
        assert read.low[0] * (1 - 1e-5) <= np.median(leaks) <= read.high[0] * (1 + 1e-5)
        assert read.high[0] < 1.1 * read.low[0]
        assert_allclose(read.value[0], np.median(leaks), rtol=0.02)
        assert_allclose([read.least[0], read.most[0]], np.quantile(leaks, [0.16, 0.84]), rtol=0.02)
        assert (read.open[0], read.closing[0], read.surfaces) == (2, 0, 2)
    assert_allclose(over_time.area[0], float(end.contact_area_fraction.mean()), rtol=0.01)


@pytest.mark.layout
def test_the_command_writes_a_table_and_a_figure(run: Dataset, folder: Path, tmp_path: Path) -> None:
    _law(PRONY, tmp_path)
    printed = said(*_asked(folder, tmp_path, "--out", str(tmp_path / "out")))
    assert "error of the reading up to a factor of 1." in printed
    assert "Errors of the grid and of the window are not in these numbers; with them: --budget, or" in printed
    with (tmp_path / "out" / "creep.csv").open() as stream:
        head, *rows = csv.reader(stream)
    assert head[:5] == ["time [s]", "J(t)/J(0)", "p J(t)/J(0) [MPa]", "A*", "leak x [mm^3/s]"]
    assert [float(row[0]) for row in rows] == [1.0, 3600.0]
    assert (tmp_path / "out" / "creep.png").stat().st_size > 10_000
    assert "the leak is known up to" in refused(*_asked(folder, tmp_path, at="pressure=1 MPa"))
    without = refused("creep", folder, "--law", tmp_path / "creep.yaml", "--times", "1 s")
    assert "needs its constant load, as --at pressure=0.1MPa" in without


def test_the_band_is_the_range_of_several_surfaces_and_the_error_of_one(run: Dataset, tmp_path: Path) -> None:
    law = _law(PRONY, tmp_path)
    for ds, ends, words in (
        (run, ("least", "most"), "16 to 84 %"),
        (run.isel(seed=[0]), ("low", "high"), "error of the"),
    ):
        over_time = creep.history(ds, law, 0.01, [1.0, 60.0, 3600.0])
        (ax,) = drawing_of(over_time, ds).axes
        for leak, band in zip(over_time.leak.values(), ax.collections, strict=True):
            drawn = {float(y) for _, y in band.get_paths()[0].vertices}
            assert {*getattr(leak, ends[0]).tolist(), *getattr(leak, ends[1]).tolist()} <= drawn
            assert (leak.low < leak.value).all()
        assert words in ax.get_legend().get_title().get_text()


def test_json_has_units_intervals_and_counts(run: Dataset, folder: Path, tmp_path: Path) -> None:
    law = _law(PRONY, tmp_path)
    found, over_time = answered(*_asked(folder, tmp_path)), creep.history(run, law, 0.01, [1.0, 3600.0])
    assert (found["pressure"], found["unit"], found["leak_unit"], found["leg"]) == (0.01, "MPa", "mm^3/s", 1)
    for k, row in enumerate(found["times"]):
        assert row["seconds"] == over_time.seconds[k]
        for way in row["leak"]:
            leak = over_time.leak[way["axis"]]
            assert way["value"] == leak.value[k]
            assert way["interval"] == [leak.low[k], leak.high[k]]
            assert way["range_of_surfaces"] == [leak.least[k], leak.most[k]]
            assert (way["open"], way["surfaces"]) == (2, 2)
    _, rows = creep.rows_of(replace(over_time, area=np.full(2, math.nan)))
    assert [row[3] for row in rows] == [None, None]  # empty in the file, as in other files of numbers


def test_intervals_with_a_budget_are_those_of_cards_at_the_states(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(card_runs, "FEWEST_NODES", 9)
    folder = tmp_path / "rubber"
    steps = "pressures: [0.25, 0.48, 0.52, 0.72, 0.78, 1.0]"  # few, near the states that are read
    text = TEXT.replace("steps: 24, to: {pressure: 2.0}", steps).replace("m: 6, seeds: 2", "m: 4, seeds: 1")
    execution.run(loads(text), jobs=1, out=folder)
    _law("table: {times: [1 s, 1 h], ratios: [1, 1.5]}", tmp_path)
    reading, words = answered(*_asked(folder, tmp_path))["times"], {"at": "pressure=10 kPa", "times": "1 s, 1 h"}
    history = roughvol.creep(folder, tmp_path / "creep.yaml", **words, budget=True)
    for before, after in zip(reading, history.plain()["times"], strict=True):
        at = f"pressure={after['equivalent_pressure']} MPa"
        card = answered("card", folder, "--at", at, "--out", f"{folder}_card")
        for read, leak, way in zip(before["leak"], after["leak"], card["ways"], strict=True):
            assert leak["value"] == read["value"] == pytest.approx(way["leak"], rel=0.02)
            low, high = (end / way["leak"] for end in way["leak_interval"])
            assert low < 1.0 < high
            assert_allclose(leak["interval"], [read["interval"][0] * low, read["interval"][1] * high], rtol=1e-6)
    monkeypatch.setattr(roughvol, "creep", lambda *_, budget, **__: budget and history)  # its cards take a second
    printed = said(*_asked(folder, tmp_path, "--budget"))
    assert "rubber: at 0.01 MPa; all of 1/E* creeps" in printed
    assert "with errors" in printed
    assert "not in these numbers" not in printed


def test_a_history_between_cards_has_their_factors_on_a_line_and_none_beside_a_closed_way(
    run: Dataset, tmp_path: Path
) -> None:
    over_time = creep.history(run, _law("power: {exponent: 0.2, time: 1 s}", tmp_path), 0.005, read_times("1 s..1 min"))
    loads_ = creep.loads_of_cards(over_time)
    assert len(loads_) == creep.CARDS < over_time.equivalent.size
    assert_allclose([loads_[0], loads_[-1]], over_time.equivalent[[0, -1]], rtol=1e-4)

    def card(leak: float, factor: float) -> Any:
        found, parts = average("leak_rate", leak), (Part("window", factor, ""),)
        ways = tuple(Way(axis, found, 1, "mm^3/s", Closing((), "MPa"), (), "", parts) for axis in "xy")
        return SimpleNamespace(ways=ways, seal=None)

    factors = [2.0, 2.0, 8.0, math.nan]
    found = creep.with_errors(over_time, {at: card(1.0, one) for at, one in zip(loads_, factors, strict=True)})
    for axis, leak in found.leak.items():
        wider = leak.high / over_time.leak[axis].high
        assert_allclose(wider[over_time.equivalent < loads_[1]], 2.0, rtol=1e-6)
        between = (over_time.equivalent > loads_[1]) & (over_time.equivalent < loads_[2])
        assert np.all((wider[between] > 2.0) & (wider[between] < 8.0))
        assert np.isnan(wider[over_time.equivalent > loads_[2]]).all()


# several surfaces


def _swept(leaks: Sequence[Sequence[float]], run: Dataset) -> Dataset:
    """A run of surfaces with the leaks along x and y at the loads 1, 2, 4 and 8 kPa; missing ones are not solved."""
    values = np.array(leaks)[np.newaxis, np.newaxis]
    loads_of = np.where(np.isfinite(values), np.array([1.0, 2.0, 4.0, 8.0]) * 1e-3, np.nan)
    dims = ("D", "m", "seed", "step")
    of_steps = {"nominal_pressure": loads_of, "mean_pressure": 10.0 * loads_of, "contact_area_fraction": loads_of}
    new = {name: (dims, array, run[name].attrs) for name, array in of_steps.items()}
    new["leak_rate"] = (*dims, "axis"), np.stack([values, values], axis=-1), run.leak_rate.attrs
    new["free_volume"] = dims, loads_of, {}
    new["Sq"] = dims[:3], np.full(values.shape[:3], 0.4), {}
    coords = {"D": [2.2], "m": [6], "seed": range(len(leaks)), "step": [1, 2, 3, 4], "axis": ["x", "y"], "L": 200.0}
    return Dataset(new, coords=coords, attrs=run.attrs)


@pytest.fixture
def law(tmp_path: Path) -> Creep:
    """J goes with time."""
    return _law("table: {times: [1 s, 8 s], ratios: [1, 8]}", tmp_path)


def test_some_closed_surfaces_do_not_close_the_seal(run: Dataset, law: Creep) -> None:
    ended = math.nan
    rows = [[9.0, 8.0, 7.0, 6.0], [9.0, 6.0, 5.0, 4.0], [9.0, 5.0, 3.0, 2.0], [9.0, 0.5, 0.0, 0.0]]
    ds = _swept([*rows, [9.0, 0.0, ended, ended]], run)
    over_time = creep.history(ds, law, 1e-3, [1.0, 2.0, 3.0, 4.0, 8.0])
    leak = over_time.leak["x"]
    assert_allclose(leak.value[[0, 1, 3, 4]], [9.0, 5.0, 3.0, 2.0])  # the median, closed surfaces counted as 0
    assert leak.open.tolist() == [5, 4, 4, 3, 3]
    assert leak.closing.tolist() == [0, 0, 1, 0, 0]
    text = creep.table_of(over_time).rows
    assert [row[6] for row in text] == ["5 of 5", "4 of 5", "4 of 5 (1 closing)", "3 of 5", "3 of 5"]
    assert [row[3].partition(" ")[2] for row in text] == ["", "", *["(4 of 5)"] * 3]
    assert creep.table_of(over_time).note.endswith("A* is the mean over the surfaces whose sweep reaches the state")
    assert not any("closed" in cell for row in text for cell in row)
    mostly = creep.table_of(creep.history(ds.isel(seed=[2, 3, 4]), law, 1e-3, [8.0])).rows[0]
    assert mostly[4] == "0"
    assert mostly[6] == "1 of 3"
    shut = creep.table_of(creep.history(ds.isel(seed=[3, 4]), law, 1e-3, [8.0])).rows[0]
    assert (shut[4], shut[6]) == ("closed", "0 of 2")
    one = creep.history(ds.isel(seed=[3]), law, 1e-3, [3.0])
    assert creep.table_of(one).rows[0][4] == "closing, < 0.5"
    assert_allclose(one.leak["x"].value[0], 0.25)  # on the straight line to 0


UNKNOWN_FIRST = [[math.nan, 8.0, 7.0, 6.0]]
OPEN_AT_LAST = [[9.0, 8.0, 7.0, 6.0], [9.0, 6.0, math.nan, math.nan]]


@pytest.mark.parametrize(
    ("change", "pressure", "words"),
    [
        (lambda run: run, 0.03, "known up to .* reached up to"),
        (lambda run: run, 0.1, "reached at no time"),
        (lambda run: run, 1e-6, "known from"),
        (lambda run: _swept(UNKNOWN_FIRST, run), 1e-3, r"that of 0\.001 MPa; the leak is known from 0\.002 MPa on"),
        (lambda run: _swept(OPEN_AT_LAST, run), 1e-3, r"the leak is known up to 0\.002 MPa, reached up to 2 s"),
        (lambda run: run.assign(contact_area_fraction=-run.contact_area_fraction), 0.01, "contact area falls"),
        (lambda run: run.drop_vars("contact_area_fraction"), 0.01, "contact_area_fraction is not in the dataset"),
        (lambda run: run.assign(plastic_volume=run.free_volume), 0.01, "yields"),
    ],
)
def test_a_leak_that_the_sweep_does_not_show_is_refused(
    change: Callable[[Dataset], Dataset], pressure: float, words: str, run: Dataset, law: Creep
) -> None:
    with pytest.raises(StudyError, match=words):
        creep.history(change(run), law, pressure, [1.0, 2.0, 4.0])


def test_times_stand_in_the_largest_unit(run: Dataset, tmp_path: Path) -> None:
    law = _law("prony: {shares: [0.5], times: [1 s]}", tmp_path)
    times = ["0.5 s", "90 s", "2 h", "1 day", "1 year", "10 year", "1000 year"]
    over_time = creep.history(run, law, 0.016, read_times(", ".join(times)))
    shown = [row[0] for row in creep.table_of(over_time).rows]
    assert shown == ["0.5 s", "1.5 min", "2 h", "1 day", "1 year", "10 year", "1e+03 year"]


def test_a_seal_that_is_closed_has_no_error_of_its_leak(run: Dataset, law: Creep) -> None:
    closed = creep.history(_swept([[9.0, 0.0, 0.0, 0.0]], run), law, 1e-3, [2.0, 8.0])
    assert creep.table_of(closed).note == "read off the stored sweep"


def test_a_joint_that_closes_before_its_first_step_is_known_from_its_closing_load_on(run: Dataset, law: Creep) -> None:
    closed = _swept([[0.0, 0.0, 0.0, 0.0]], run)
    closed["closing_pressure"] = (*closed.Sq.dims, "axis"), np.full((1, 1, 1, 2), 5e-3)  # p*, that is 0.0005 MPa
    assert creep.history(closed, law, 6e-4, [1.0]).leak["x"].value == 0.0
    with pytest.raises(StudyError, match=r"that of 0\.0002 MPa; the leak is known from 0\.0005 MPa on"):
        creep.history(closed, law, 2e-4, [1.0])


# two elastic bodies

TWO = loads(TEXT.replace("E_star: 10 MPa", "E: 8 MPa, nu: 0.5, against: {E: 30 MPa, nu: 0.2}")).material
FIRST, SECOND = (1 - 0.5**2) / 8.0, (1 - 0.2**2) / 30.0  # compliances in 1/MPa


@pytest.mark.parametrize(
    ("body", "compliance"),
    [
        ("first", lambda J: FIRST * J + SECOND),
        ("second", lambda J: FIRST + SECOND * J),
        ("both", lambda J: FIRST * J + SECOND * J),
    ],
)
def test_the_compliance_of_two_bodies_is_the_sum_of_both(
    body: str, compliance: Callable[[float], float], tmp_path: Path
) -> None:
    law, one = _law(f"{PRONY}\nbody: {body}", tmp_path), _law(PRONY, tmp_path)
    for seconds in (1.0, 60.0, 1e5):
        J = one.ratio(seconds, MATERIAL)  # of E* alone
        assert_allclose(law.ratio(seconds, TWO), compliance(J) / (FIRST + SECOND), rtol=1e-12)


@pytest.mark.parametrize(("body", "own"), [("first", 8.0), ("second", 30.0)])
def test_moduli_are_those_of_the_body_that_creeps(body: str, own: float, tmp_path: Path) -> None:
    half = _law(f"table: {{times: [1 s, 1 h], moduli: [{own} MPa, {own / 2} MPa]}}\nbody: {body}", tmp_path)
    twice = _law(f"table: {{times: [1 s, 1 h], ratios: [1, 2]}}\nbody: {body}", tmp_path)
    assert_allclose(half.ratio(3600.0, TWO), twice.ratio(3600.0, TWO), rtol=1e-12)
    both = _law("table: {times: [1 s, 1 h], moduli: [8 MPa, 4 MPa]}\nbody: both", tmp_path)
    with pytest.raises(StudyError, match=r"^creep law: table\.moduli: moduli are those of one body"):
        both.ratio(1.0, TWO)


def test_a_law_names_the_body_where_the_study_has_two(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"^creep law: body: missing: .* allowed: first .*, second .*, both"):
        _law(PRONY, tmp_path).ratio(1.0, TWO)
    rigid = loads(TEXT.replace("material: {E_star: 10 MPa}", "material: {E: 8 MPa, nu: 0.5}")).material
    assert _law(f"{PRONY}\nbody: first", tmp_path).ratio(60.0, rigid) == _law(PRONY, tmp_path).ratio(60.0, MATERIAL)
    with pytest.raises(StudyError, match=r"body: is second, and the study has no material\.against"):
        _law(f"{PRONY}\nbody: second", tmp_path).ratio(1.0, rigid)
    with pytest.raises(StudyError, match=r"creep\.yaml:2: body: .*'first', 'second' or 'both'"):
        _law(f"{PRONY}\nbody: upper", tmp_path)


def test_a_share_of_the_compliance_creeps_as_that_body_would(tmp_path: Path) -> None:
    """E* of two bodies, and their moduli, have the same compliance over time where the share is that of the body."""
    two = loads("material: {E: 8 MPa, nu: 0.49, against: {E: 30 MPa, nu: 0.3}}\nsurface: {D: 2.2, m: 3}")
    first = two.material.contact_modulus * (1.0 - 0.49**2) / 8.0
    of_body = _law(f"{PRONY}\nbody: first", tmp_path)
    of_share = _law(f"{PRONY}\nshare: {first!r}", tmp_path)
    for seconds in (1.0, 1e3, 1e9):
        assert_allclose(of_share.ratio(seconds, MATERIAL), of_body.ratio(seconds, two.material), rtol=1e-14)
    assert of_body.words(two.material) == f"the first body (E, nu) creeps, {first:.3g} of 1/E*"
    assert of_share.words(MATERIAL) == f"{first:.3g} of 1/E* creeps"
    with pytest.raises(StudyError, match=r"share: is for a study with material\.E_star"):
        of_share.ratio(1.0, two.material)
