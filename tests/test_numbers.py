"""Numbers on the screen: the table after a run, show, compare, ls, and figures of several runs."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest

from roughvol.store import dataset
from tests.kit import answered, call, ran, refused, said, succeeded, twin

WET = """
surface: {D: [2.2, 2.4], m: 4, L: 500 um, Sq: 2 um, seeds: 2}
material: {E_star: 10 MPa}
sweep: {steps: 8, to: {contact_area: 0.5}}
record:
  fields_at: {contact_area: 0.2}
  transport: {transmissivity: every-step, percolation: every-step}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 1 mbar, viscosity: 1 mPa*s}}
"""
DRY = "surface: {D: 2.2, m: 4, L: 500 um, Sq: 2 um, seeds: 1}\nmaterial: {E_star: 10 MPa}\nsweep: {steps: 6}\n"
PATH = "surface: {D: 2.2, m: 4, seeds: 1}\nsweep: [{steps: 4, to: {pressure: 1}}, {steps: 3, to: {pressure: 0.2}}]\n"


def _columns(text: str) -> list[list[str]]:
    """Return the cells of the lines of a table; two spaces separate columns."""
    return [[cell.strip() for cell in line.split("  ") if cell.strip()] for line in text.splitlines()]


@pytest.fixture(scope="module", autouse=True)
def printed(there: Path) -> dict[str, str]:
    """What the commands print that make three runs."""
    return {name: ran(name, text) for name, text in (("wet", WET), ("dry", DRY), ("path", PATH))}


def test_a_run_ends_with_its_chief_states_in_the_units_of_the_study(printed: dict[str, str]) -> None:
    head, *rows = _columns(printed["wet"])[1:6]
    assert head[:3] == ["surface", "state", "surfaces"]
    assert {"p [MPa]", "A*", "V*", "g_mean [um]", "median Q_x [mm^3/s]", "median Q_y [mm^3/s]"} <= set(head)
    assert "T_x*" not in " ".join(head)
    assert [row[1] for row in rows] == ["contact_area=0.2", "step 8"] * 2


def test_the_table_after_a_path_has_the_end_of_each_leg(printed: dict[str, str]) -> None:
    assert [row[0] for row in _columns(printed["path"])[2:4]] == ["step 4, leg 1", "step 7, leg 2"]


def test_a_load_acts_on_the_whole_period(here: Path) -> None:
    surface = "surface: {D: 2.3, m: 3, L: 100 um, Sq: 1 um, seeds: 1, sides: periodic}\n"
    ran("period", surface + "material: {E_star: 1 GPa}\nsweep: {loads: [20 mN, 50 mN]}\n")
    shown = answered("show", "period", "--at", "load=49.99mN")
    assert shown["rows"][0]["nominal_pressure"] == pytest.approx(4.999e-3, rel=1e-4)  # GPa: 50 mN on (100 um)²


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["show", "dry", "--at", "pressure=9MPa"], "its steps have pressure 0."),
        (["show", "dry", "--at", "pressure=900"], "its steps have pressure p* = "),
        (["show", "dry", "--at", "pressure=1um"], "is a unit of length, not of pressure"),
        (["show", "dry", "--at", "mean_gap=1"], "needs its unit"),
        (["show", "dry", "--at", "leak_rate=0 mm^3/s"], "allowed: a leak rate > 0"),
        (["show", "dry", "--at", "pressure=inf"], "must be a number"),
        (["show", "dry", "--at", "contact_area=1um"], "must be a number without a unit"),
        (["show", "path", "--at", "pressure=1MPa"], "the modulus has none"),
        (["show", "dry", "--csv", "--json"], "exclude each other"),
        (["compare", "dry"], "two runs or more"),
        (["compare", "wet", "dry", "runs/dry"], "compare takes each run once, given dry twice"),
        (["compare", "dry", "wet", "--at", "pressure=9MPa"], "has no state at"),
        (["ls", "nowhere"], "no folder nowhere"),
        (["ls", "dyr"], "no folder dyr; the state of a run: roughvol status dry"),
        (["plot", "wet", "dry", "runs/dry", "v_of_p"], "plot takes each run once, given dry twice"),
        (["plot", "dry", "v_of_q"], "did you mean 'v_of_p'"),
        (["plot", "dry", "v_of_p", "--size", "big"], "allowed: WxH"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_message(arguments: list[str], part: str) -> None:
    assert part in refused(*arguments)


def test_compare_tells_runs_of_one_name_apart_by_their_folders() -> None:
    moved = Path(twin("dry")).rename("dry")
    rows = answered("compare", "runs/dry", moved, "--at", "p=0.1")["rows"]
    assert [row["run"] for row in rows] == ["runs/dry", f"{Path().absolute().name}/dry"]


def test_the_loads_of_the_steps_are_in_the_unit_of_the_refused_load_also_of_none() -> None:
    none, little = (refused("show", "dry", "--at", f"pressure={load}") for load in ("0 MPa", "1e-9 MPa"))
    assert none.split("its steps have")[1] == little.split("its steps have")[1]


def test_show_names_the_combinations_that_do_not_reach_a_load(here: Path) -> None:
    moduli = DRY.replace("{E_star: 10 MPa}", "{E_star: [1 MPa, 10 MPa]}")
    ran("moduli", moduli)
    done = succeeded("show", "moduli", "--at", "pressure=0.02MPa")
    both = [call(word, "moduli", "--at", "p=0.1", "--at", "pressure=0.02MPa", "--json") for word in ("show", "compare")]
    assert "E_star = 10 MPa" in done.stdout
    assert "E_star = 1 MPa" not in done.stdout
    for answer in (done, *both):
        assert "moduli, E_star = 1 MPa has no state at pressure=0.02 MPa" in answer.stderr
    for answer in both:  # the softer surface reaches the first load
        assert [row["state"] for row in json.loads(answer.stdout)["rows"]].count("pressure=0.1") == 2


def test_show_and_compare_name_the_surfaces_that_do_not_reach_a_load() -> None:
    wet = dataset.read(Path("runs/wet/study.nc"))
    begins = wet["mean_pressure"].isel(step=0, m=0).min("seed").to_series().sort_values()
    reaches, later = (f"D = {D:g}, m = 4" for D in begins.index)
    at = f"--at=p={begins.mean():.4g}"
    shown, rows = call("show", "wet", at), call("show", "wet", at, "--json")
    assert shown.stdout.splitlines()[1].startswith(reaches)
    for text in (shown.stderr, rows.stderr, said("compare", "wet", twin("wet"), at)):
        assert f"wet, {later} has no state at pressure={begins.mean():.4g}: its steps have" in text


@pytest.mark.parametrize(("sweep", "load"), [("{pressures: [0.0123]}", 0.0123), ("{pressures: [0.2, 0.4]}", 0.2)])
def test_runs_of_one_common_load_are_compared_there(sweep: str, load: float, here: Path) -> None:
    for name, own in (("one", sweep), ("other", f"{{pressures: [0.01, {load}]}}")):
        ran(name, f"surface: {{D: 2.2, m: 3, seeds: 1}}\nsweep: {own}\n")
    rows = answered("compare", "one", "other")["rows"]
    assert [row["state"] for row in rows] == [f"pressure={load}"] * 2
    assert [row["mean_pressure"] for row in rows] == pytest.approx([load] * 2)


def test_listed_loads_at_the_ends_are_compared(here: Path) -> None:
    """Of a first step at 0.1 + 2e-8 the load 0.1 was left out."""
    ran("listed", "surface: {D: 2.2, m: 3, seeds: 1}\nsweep: {pressures: [0.1, 0.2]}\n")
    states = [row["state"] for row in answered("compare", "listed", twin("listed"))["rows"]]
    assert (states[0], states[-1]) == ("pressure=0.1", "pressure=0.2")


def test_a_single_step_is_one_step_and_has_no_stiffness(here: Path) -> None:
    ran("single", "surface: {D: 2.2, m: 3, seeds: 1}\nsweep: {steps: 1, to: {pressure: 0.5}}\n")
    shown, reported = said("show", "single"), said("report", "single")
    assert "K " not in shown
    assert "1 step to pressure=0.5" in reported


def test_an_unloaded_region_is_compared_at_no_load_and_stays_open(here: Path) -> None:
    z = np.zeros((9, 9))
    z[1, 1] = 1.0
    np.save("peak.npy", z)
    text = "surface: {file: peak.npy, L: 1.0, sides: free}\nsweep: {steps: 2, to: {indentation: 0.5}}\n"
    ran("peak", text + "record: {region: {x: [0.5, 1], y: [0.5, 1]}, transport: {percolation: every-step}}\n")
    words, ask = refused("compare", "peak", twin("peak")), answered("ask", "peak", "--closed")
    assert "none of their steps has a load" in words
    assert [way["value"] for way in ask["answers"]] == [None, None]  # the first step was called closed


def test_a_comparison_has_the_units_of_the_ranges_of_its_flows() -> None:
    units = answered("compare", "wet", "dry", "--at", "last")["units"]
    assert {units[f"leak_rate_x{end}"] for end in ("", "_low", "_high")} == {"mm^3/s"}


def test_compare_puts_runs_side_by_side_at_equal_loads() -> None:
    rows = list(csv.DictReader(io.StringIO(said("compare", "wet", "dry", "--csv"))))
    states = list(dict.fromkeys(row["state"] for row in rows))
    assert len(states) > 2
    assert all(state.endswith("MPa") for state in states)
    for state in states:
        pressures = [float(row["nominal_pressure"]) for row in rows if row["state"] == state]
        assert pressures == pytest.approx([float(state.removeprefix("pressure=").removesuffix("MPa"))] * len(pressures))
    assert {row["run"] for row in rows} == {"wet, D = 2.2, m = 4", "wet, D = 2.4, m = 4", "dry"}


def test_compare_has_the_transmissivity_where_no_leak_has_a_unit(here: Path) -> None:
    for name in ("bare", "other"):
        ran(name, "surface: {D: 2.2, m: 3, seeds: 1}\nrecord: {transport: {transmissivity: last}}\nsweep: {steps: 3}\n")
    assert "  T_x*  " in said("compare", "bare", "other", "--at", "last")


@pytest.mark.parametrize(
    ("runs", "words"), [(("wet", "dry"), "Mean over the surfaces of a row;"), (("wet",), "Mean over 2 surfaces;")]
)
def test_compare_counts_surfaces_in_its_note_only_where_all_rows_have_as_many(
    runs: tuple[str, ...], words: str
) -> None:
    assert words in said("compare", *runs, *(() if runs[1:] else (twin("wet"),)))


def test_ls_lists_the_latest_run_first_with_state_size_and_age() -> None:
    rows = _columns(said("ls"))
    assert rows[0] == ["run", "state", "size", "changed"]
    assert [row[:2] for row in rows[1:]] == [[name, "finished"] for name in ("path", "dry", "wet")]
    Path("runs/dry/study.nc").rename("kept")
    try:
        Path("runs/dry/cases").rename("runs/dry/away")
        assert ["dry", "0 of 1 finished"] in [row[:2] for row in _columns(said("ls", "runs"))]
    finally:
        Path("runs/dry/away").rename("runs/dry/cases")
        Path("kept").rename("runs/dry/study.nc")


def test_the_note_says_of_what_and_at_which_fluid_a_leak_is(printed: dict[str, str]) -> None:
    same = "Q is the leak of the patch, pressure drop 1 mbar, viscosity 1 mPa*s."
    assert same in printed["wet"]
    assert same in said("show", "wet")
    assert "pressure drop" not in said("show", "dry")
    said("run", "wet.yaml", "--set", "name=thick", "--set", "record.dimensional.leak_rate.viscosity=1 Pa*s")
    told = said("compare", "wet", "thick", "--at", "contact_area=0.2")
    assert same not in told
    for name, viscosity in (("wet", "1 mPa*s"), ("thick", "1 Pa*s")):
        assert f"{name}: pressure drop 1 mbar, viscosity {viscosity}" in told


def test_the_note_on_closing_loads_says_what_the_parentheses_are_and_which_leg(printed: dict[str, str]) -> None:
    closing = printed["wet"].partition("Where it closes")[2]
    assert "mean (smallest to largest)" in closing
    assert "leg 1" not in closing
    loops = "sweep=[{steps: 6, to: {contact_area: 0.5}}, {steps: 3, to: {pressure: 0.01 MPa}}]"
    assert "The loads are those of leg 1." in said("run", "wet.yaml", "--set", "name=loops", "--set", loops)
