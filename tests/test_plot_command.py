"""The command `plot`: what does not apply is named and stops nothing, points have the labels of their surfaces."""

import csv
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from drawn import labels_are_apart
from matplotlib.figure import Figure

import roughvol
from roughvol.cli.plot import _check_room, _shaped
from roughvol.errors import DatasetError
from roughvol.report.figures import yielding
from roughvol.report.figures.style import DASHES, STYLE, axes
from tests.kit import LEAKING, LEAKING_GAS, call, ran, refused, said, succeeded

TWO = LEAKING.replace("seeds: 1", "seeds: [2, 5]")
LOOPS = TWO.replace(
    "{steps: 8, to: {pressure: 0.5 MPa}}", "[{steps: 4, to: {pressure: 1}}, {steps: 2, to: {pressure: 0}}]"
)

PLAIN = """
surface: {D: [2.2, 2.4], m: 4, seeds: [3, 7]}
sweep: {steps: 6}
"""

LIFTED_LOOPS = """
surface: {D: 2.2, m: 4, L: 1 mm, Sq: 1 um, seeds: 1, sides: mirrored}
material: {E: 200 MPa, nu: 0.49}
sweep: [{pressures: [0.4 MPa, 2 MPa]}, {pressures: [1 MPa, 0.3 MPa]}]
record:
  fluid_pressure: {at: {pressure: [0.4 MPa, 2 MPa]}, inlet: 1 bar, outlet: 0 bar}
  transport: {transmissivity: every-step, closing: true}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 1 bar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""


@pytest.fixture(scope="module", autouse=True)
def _runs(there: Path) -> None:
    ran("plain", PLAIN)
    ran("loops", LOOPS)
    ran("leaking", TWO)


@pytest.mark.parametrize("suffix", [pytest.param("png", marks=pytest.mark.layout), "pdf", "svg"])
def test_figures_have_every_format_size_and_scale(tmp_path: Path, suffix: str) -> None:
    said("plot", "plain", "v_of_p", "--format", suffix, "--size", "127x50.8mm", "--log", "x", "--out", tmp_path)
    content = (tmp_path / f"v_of_p.{suffix}").read_bytes()
    assert len(content) > 200
    assert suffix != "png" or np.frombuffer(content[16:24], ">u4").tolist() == [1500, 600]


@pytest.mark.layout
def test_a_figure_that_has_no_room_is_not_drawn(tmp_path: Path) -> None:
    told = refused("plot", "leaking", "seal_leak_rate", "--size", "1x1in", "--out", tmp_path)
    assert "seal_leak_rate: legend and labels leave no room for the axes in 1 x 1 in; allowed: a larger --size" in told
    fig, ax = axes(9.0)
    ax.plot([0.0, 1.0], label="a face whose name is longer than three inches are wide, in the size of a legend")
    fig.legend(loc="outside upper center")
    _check_room(fig, "faces")
    fig.set_size_inches(3.0, 3.0)
    with pytest.raises(DatasetError, match="faces: legend and labels leave no room"):  # the legend is cut off
        _check_room(fig, "faces")
    assert not any(tmp_path.iterdir())


def test_a_logarithmic_axis_leaves_rounding_out() -> None:
    fig = Figure()
    fig.subplots().plot([1e-16, 0.5, 3.0], [1.0, 2.0, 4.0])  # d/σ at the mean plane
    _shaped(fig, None, "x")
    assert fig.axes[0].get_xlim() == (0.5, 3.0)
    fig = roughvol.plot("plain", "fig05")
    _shaped(fig, None, "xy")
    (same, *_), low = fig.axes[0].get_lines(), fig.axes[0].get_xlim()[0]
    assert np.count_nonzero(same.get_xdata() > low) > 30  # V* = d/σ is seen


def test_all_figures_of_the_latest_run_are_drawn_without_a_name() -> None:
    drawn = [Path(line) for line in said("plot").splitlines()]
    names = {path.stem for path in drawn}
    assert {"v_of_p", "leak_of_p", "fig05", "seal_leak_rate"} <= names
    assert "fig08" not in names  # it needs fields
    for path in drawn:
        assert path.read_bytes().startswith(b"\x89PNG")
        assert (path.parent.name == "paper") == path.stem.startswith("fig")


def test_the_leak_of_a_gas_is_drawn_where_no_leak_of_a_liquid_is_stored() -> None:
    ran("helium", LEAKING_GAS)
    figure = roughvol.plot("helium", "leak_of_p")
    along_x, *_ = (line for line in figure.axes[0].get_lines() if figure.sources.get(line, {}).get("axis") == "x")
    run = roughvol.open("helium")
    stored = run.gas_leak_rate.sel(axis="x").values.ravel()
    assert along_x.get_ydata().tolist() == stored[stored > 0.0].tolist()
    beside = run.assign(leak_rate=(np.nan * run.gas_leak_rate).assign_attrs(units="mm^3/s"))  # at a state not reached
    assert roughvol.plot(beside, "leak_of_p").axes[0].get_ylabel() == figure.axes[0].get_ylabel()
    assert "leak_rate or gas_leak_rate in different units" in refused("plot", "helium", "leaking", "leak_of_p")


@pytest.mark.layout
def test_colour_bars_stay_linear_and_an_axis_from_zero_begins_at_its_first_number(tmp_path: Path) -> None:
    ran("maps", f"{PLAIN}record: {{fields_at: last, volume_density: {{bins: 9}}}}\n")
    assert not call("plot", "maps", "fig09", "fig12a", "--log", "xy", "--out", tmp_path).stderr
    for name, logarithmic in (("fig09", False), ("fig12a", True)):
        figure = roughvol.plot("maps", name)
        _shaped(figure, None, "xy")
        assert {ax.get_xscale() == "log" for ax in figure.axes} == {logarithmic}
        assert all(ax.get_xlim()[0] > 0.0 for ax in figure.axes if logarithmic)


def test_a_curve_on_a_logarithmic_axis_ends_at_its_last_positive_number() -> None:
    fig = Figure()
    (line,) = fig.subplots().plot([2.0, 1.0, -1.0], [0.1, 0.2, 0.3])
    assert _shaped(fig, None, "x") == []
    ends = line.get_transform().transform(line.get_xydata())
    assert np.isfinite(ends).all(axis=1).tolist() == [True, True, False]


@pytest.mark.parametrize("last", [0.03, 0.1, 0.6, 20.0, 1e5])
def test_the_numbers_of_a_logarithmic_axis_do_not_overlap(last: float) -> None:
    with mpl.rc_context(STYLE):
        fig = axes()[0]
        fig.axes[0].plot(np.geomspace(0.015, last), np.linspace(1.0, 2.0))
        _shaped(fig, None, "x")
        assert labels_are_apart(fig)


def test_the_numbers_of_the_stiffness_over_the_load_do_not_overlap() -> None:
    assert labels_are_apart(roughvol.plot("leaking", "stiffness_of_p"))
    with pytest.raises(DatasetError, match=r"value of each; it takes rising p\* at three steps of leg 1"):
        roughvol.plot(roughvol.open("leaking").isel(step=slice(2)), "stiffness_of_p")


@pytest.mark.layout
def test_the_numbers_of_the_pressure_on_top_of_a_logarithmic_axis_do_not_overlap() -> None:
    with mpl.rc_context(STYLE):
        fig = roughvol.plot(roughvol.open("leaking").isel(step=slice(2, None)), "seal_leak_rate")
        assert _shaped(fig, None, "x") == []
        assert labels_are_apart(fig, fig.axes[0].child_axes[0].xaxis)


@pytest.mark.parametrize("suffix", ["png", "csv"])
def test_a_figure_that_does_not_apply_is_named_and_the_others_are_drawn(tmp_path: Path, suffix: str) -> None:
    names = ("fig09", "v_of_p", "leak_of_p", "fig05", "seal_percolation")
    done = succeeded("plot", "plain", *names, "--format", suffix, "--out", tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"fig05.{suffix}", f"v_of_p.{suffix}"]
    told = done.stderr.splitlines()
    keys = ("record.fields_at", "record.dimensional.leak_rate", "record.transport.percolation")
    for line, name, key in zip(told, ("fig09", "leak_of_p", "seal_percolation"), keys, strict=True):
        assert line.startswith("not drawn: ")
        assert name in line
        assert key in line


def test_nothing_drawn_is_an_error(tmp_path: Path) -> None:
    told = refused("plot", "plain", "fig09", "leak_of_p", "--out", tmp_path)
    assert "record.fields_at" in told
    assert "record.dimensional.leak_rate" in told
    assert not list(tmp_path.iterdir())


def test_a_figure_that_any_of_several_quantities_would_do_names_each_key_once() -> None:
    told = refused("plot", "plain", "flow_of_p")
    assert told.count("record.transport.transmissivity") == told.count("which the run does not have") == 1
    told = refused("plot", "plain", "leak_of_p")
    assert "needs leak_rate or gas_leak_rate, which the run does not have" in told
    assert "(record.dimensional.leak_rate or record.dimensional.gas_leak_rate)" in told


def test_a_figure_of_one_run_does_not_stop_those_of_two(tmp_path: Path) -> None:
    done = succeeded("plot", "plain", "leaking", "fig05", "v_of_a", "--out", tmp_path)
    assert "fig05 shows one run" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["v_of_a.png"]


def _points(run: str, name: str, folder: Path) -> list[dict[str, str]]:
    said("plot", run, name, "--format", "csv", "--out", folder)
    return list(csv.DictReader((folder / f"{name}.csv").read_text(encoding="utf-8").splitlines()))


def test_points_have_the_D_m_and_seed_of_their_surface_and_no_tex(tmp_path: Path) -> None:
    """Their numbers: crossing/test_crossing.py."""
    rows = _points("plain", "v_of_a", tmp_path)
    assert not any(sign in cell for row in rows for cell in row.values() for sign in "$\\{}")
    seeds = {(D, "4", seed) for D in ("2.2", "2.4") for seed in ("3", "7", "")}
    assert {(row["D"], row["m"], row["seed"]) for row in rows} == seeds
    labels = ("real contact area fraction A*", "dimensionless free volume V*")
    assert {(row["x_label"], row["y_label"]) for row in rows} == {labels}


def test_points_of_many_files_have_the_file_of_their_surface(tmp_path: Path) -> None:
    """More than six files of a run share a curve."""
    for k in range(7):
        np.save(tmp_path / f"face{k}.npy", np.random.default_rng(k).standard_normal((9, 9)))
    files = "files: " + str(tmp_path / "face*.npy")
    ran("faces", f"surface: {{{files}, L: 1.0, sides: free}}\nsweep: {{steps: 2, to: {{contact_area: 0.3}}}}\n")
    rows = _points("faces", "v_of_p", tmp_path)
    ds = roughvol.open("faces")
    for name in ds["case"].values.tolist():
        own = [float(row["y"]) for row in rows if row["case"] == name]
        assert own == pytest.approx(ds["free_volume"].sel(case=name).values.tolist(), rel=1e-12)


def test_points_of_a_path_have_their_leg_and_direction(tmp_path: Path) -> None:
    rows = _points("loops", "path_loops", tmp_path)
    curves = {(row["panel"], row["D"], row["axis"], row["curve"]) for row in rows if "leg" in row["curve"]}
    legs = ("D = 2.3, leg 1", "D = 2.3, leg 2")
    directions = enumerate(("", "", "x", "y"), start=1)
    assert curves == {(f"{panel}", "2.3", axis, leg) for panel, axis in directions for leg in legs}
    assert not any(row["curve"].startswith("line") for row in rows)


def test_more_legs_than_dash_patterns_can_be_told_apart() -> None:
    ds = roughvol.open("loops")
    each = ds.assign_coords(leg=("step", np.arange(1, ds.sizes["step"] + 1)))
    assert ds.sizes["step"] > len(DASHES)
    lines = {str(line.get_label()): line for line in roughvol.plot(each, "path_loops").legends[0].get_lines()}
    assert lines[f"leg {1 + len(DASHES)}"].get_linewidth() > lines["leg 1"].get_linewidth()


def test_points_are_those_of_curves_and_not_of_lines_across_the_axes(tmp_path: Path) -> None:
    ran("boxes", PLAIN.replace("[2.2, 2.4]", "2.2") + "record: {box_counting: {at: {separation: 1}}}\n")
    rows = _points("boxes", "fig11b", tmp_path)  # a dashed line is at dimension 2
    assert min(float(row["x"]) for row in rows) > 1.0
    assert not any(row["curve"].startswith("line") for row in rows)


def _note(run: str, name: str, changes: Sequence[str] = ()) -> str:
    return " ".join(roughvol.plot(run, name, changes=changes).get_supxlabel().split())


def _title(run: str, name: str) -> str:
    return roughvol.plot(run, name).axes[0].get_legend().get_title().get_text()


LIFTED = (
    TWO.replace("1 um}", "1 um, sides: periodic}")
    .replace("  dimensional", "  fluid_pressure: {inlet: 1 bar, at: last, coupling: one-way}\n  dimensional")
    .replace("5 mbar", "1 bar")
)


def test_a_figure_says_which_gap_it_shows_and_of_what_its_points_are() -> None:
    ran("lifted", LIFTED)
    assert "The gap without fluid pressure." in _note("lifted", "v_of_p")
    assert "without fluid pressure" not in _note("leaking", "v_of_p")
    (legend,) = (ax.get_legend() for ax in roughvol.plot("lifted", "leak_of_p").axes)
    wanted = {f"along ${axis}$ without fluid pressure, each surface" for axis in "xy"}
    assert wanted <= {text.get_text() for text in legend.get_texts()}
    titles = {run: _title(run, "leak_of_p") for run in ("lifted", "leaking")}
    assert "each of 2 surfaces" in titles["lifted"]  # one state has no curve
    assert "median" not in titles["lifted"]
    assert "median of 2 surfaces" in titles["leaking"]


def test_a_leak_under_fluid_pressure_is_drawn_at_its_recorded_states_alone(tmp_path: Path) -> None:
    ran("recorded", LIFTED.replace("at: last", "at: {pressure: [0.3 MPa, 0.4 MPa]}"))
    rows = [row for row in _points("recorded", "leak_of_p", tmp_path) if "without" not in row["curve"]]
    leak = roughvol.open("recorded")["fluid_leak_rate"]
    assert len({row["x"] for row in rows}) == 2 * leak.sizes["seed"]
    drawn = sorted(float(row["y"]) for row in rows if row["y"])  # a closed state has no y
    np.testing.assert_allclose(drawn, np.sort(leak.values[leak.values > 0.0]))
    (ax,) = roughvol.plot("recorded", "leak_of_p").axes
    lifted = [line for line in ax.get_lines() if line.get_marker() != "None"]
    assert {line.get_linestyle() for line in lifted} == {"None"}
    both = {run: run for run in ("recorded", "leaking")}
    for runs, joined in (
        ("recorded", {"along $x$": "None"}),
        (both, {"recorded, each surface": "None", "leaking": "-"}),
    ):
        shown = {line.get_label(): line for line in roughvol.plot(runs, "leak_of_p").axes[0].get_legend().get_lines()}
        assert {name: shown[name].get_linestyle() for name in joined} == joined
        assert shown["along $x$"].get_markerfacecolor() != shown["along $y$"].get_markerfacecolor() == "none"


def test_a_leak_in_a_figure_has_its_pressure_drop_and_viscosity() -> None:
    title = roughvol.plot("loops", "path_loops").legends[0].get_title().get_text()
    assert "pressure drop 5 mbar, viscosity 1 mPa s" in title
    assert "Pressure drop 5 mbar, viscosity 1 mPa s." in _note("leaking", "leak_of_p")
    assert "ressure drop" not in _note("leaking", "flow_of_p")


def test_a_figure_of_leaks_says_that_they_are_those_of_a_patch_of_a_seal() -> None:
    seal = ["seal={length: 12 mm, width: 1 mm}"]  # no part of a case
    title = roughvol.plot("loops", "path_loops", changes=seal).legends[0].get_title().get_text()
    assert title.endswith("; the leak of a patch, not of the seal")
    for name in ("leak_of_p", "seal_leak_rate"):
        assert "The leak of a patch, not of the seal." in _note("leaking", name, seal)
        assert "seal." not in _note("leaking", name)
    assert "seal." not in _note("leaking", "flow_of_p", seal)


def test_every_figure_of_the_first_leg_of_a_path_says_so() -> None:
    for name in ("v_of_p", "fig04a", "seal_leak_rate"):
        assert "Leg 1 of a path" in _note("loops", name)
        assert "Leg 1" not in _note("leaking", name)
    assert "Leg 1" not in _note("loops", "path_loops")


def test_a_figure_of_a_path_marks_where_each_leg_closes_and_opens() -> None:
    load, flow = np.arange(6.0), np.array([0.0, 0.0, 3.0, 2.0, 1.0, 0.0])
    assert list(yielding._ends(load, flow, np.nan)) == [((2.0, 3.0), 1.0), ((4.0, 1.0), 5.0)]
    assert not list(yielding._ends(load, flow + 1.0, 4.2))


def _marks(run: str, name: str) -> set[float]:
    lines = [line for ax in roughvol.plot(run, name).axes for line in ax.get_lines()]
    return {float(line.get_xdata()[0]) for line in lines if line.get_label() == "_closed"}


def test_a_solved_closing_load_is_marked_at_one_place_in_all_figures() -> None:
    ran("solved", LOOPS.replace("every-step", "every-step, closing: true").replace("pressure: 1}", "pressure: 4 MPa}"))
    assert len(_marks("solved", "leak_of_p")) == 2
    assert _marks("solved", "path_loops") == _marks("solved", "leak_of_p")


def test_the_solved_closing_load_of_the_dry_gap_is_no_mark_of_the_lifted_gap() -> None:
    ran("lifted_loops", LIFTED_LOOPS)
    assert [*_marks("lifted_loops", "path_loops")] == pytest.approx([2.0])


def test_the_elements_of_a_map_of_yield_have_their_nodes_at_the_centre() -> None:
    heights = np.random.Generator(np.random.PCG64(2)).normal(size=(6, 9))
    record = {"heights": True, "residual_heights": True}
    ds = roughvol.press(heights, L=1.0, E_star=1.0, hardness=0.5, to={"pressure": 0.2}, steps=2, record=record)
    ax, _ = roughvol.plot(ds, "yielded_map").axes
    (image,) = ax.images
    assert image.get_extent() == pytest.approx([-0.1, 1.1, -0.1, 1.7])
    ds["residual_heights"] = ds["heights"]
    assert len(roughvol.plot(ds, "yielded_map").axes) == 1  # without yield no scale of colours
