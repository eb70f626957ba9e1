"""Figures of the flow draw what the dataset holds, and say what they miss."""

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from drawn import labels_are_apart, shown
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.testing import assert_allclose

import roughvol
from roughvol.analysis.average import average
from roughvol.campaign.one_case import run_case
from roughvol.errors import DatasetError
from roughvol.report.figures import ways
from roughvol.report.figures.families import Family
from roughvol.report.figures.origin import origin
from roughvol.report.figures.registry import FIGURES as ALL
from roughvol.reproduction.figures import registry as paper
from roughvol.store import dataset, dimensional
from roughvol.store.dataset import Dataset
from roughvol.study import loads

pytestmark = pytest.mark.layout  # every figure is saved once with its layout

TEXT = """
name: tiny_seal
surface: {D: [2.2, 2.5], m: 4, seeds: 3, L: 100 um, Sq: 0.5 um}
material: {E_star: 10 MPa}
sweep: {steps: 8, to: percolation}
record:
  fields_at: {step: [2, 5]}
  transport:
    percolation: every-step
    constriction: every-step
    estimates: every-step
    transmissivity: {step: [1, 2, 4, 5, 6, 8]}
    diffusivity: {step: [2, 4, 6, 8]}
    flux_at: {step: [2, 5]}
  region_widths: {shares: [0.5, 0.75, 1], transmissivity: {step: [1, 2, 4]}}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 1 bar, viscosity: 1 mPa*s}}
"""

FIGURES = {name: figure for name, figure in ALL.items() if name.startswith("seal_")}


@pytest.fixture(scope="module")
def ds() -> Dataset:
    study = loads(TEXT)
    together = dataset.combine([run_case(case) for case in study.cases()], {"format": dataset.FORMAT})
    return dimensional.in_units(together, study, "um")


@pytest.fixture(scope="module")
def drawn(ds: Dataset) -> Callable[[str], Figure]:
    """Return what draws a figure of all surfaces, once."""
    return functools.cache(lambda name: FIGURES[name](ds))


@pytest.fixture(scope="module")
def one(ds: Dataset) -> Dataset:
    """Return one surface."""
    return ds.isel(D=[0], seed=[0])


def test_names_do_not_clash_and_every_figure_is_explained() -> None:
    assert not set(ALL) & set(paper.FIGURES)
    assert all(figure.draw.__doc__ for figure in ALL.values())


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_drawn(name: str, ds: Dataset, drawn: Callable[[str], Figure]) -> None:
    assert FIGURES[name].missing(ds) is None
    assert shown(drawn(name)) > 1


@pytest.mark.parametrize(
    ("name", "flow", "change"),
    [
        ("seal_transmissivity", "transmissivity", lambda ds: ds.transmissivity.where(ds.step == 2)),
        ("seal_estimates", "transmissivity", lambda ds: ds.transmissivity.where(ds.step == 2)),
        ("seal_volume", "connected_volume_fraction", lambda ds: ds.connected_volume_fraction.where(ds.step == 2)),
        ("seal_volume", "connected_volume_fraction", lambda ds: 0.0 * ds.connected_volume_fraction),
    ],
    ids=["one state", "estimates of one state", "no common state", "no way to the sides"],
)
def test_surfaces_without_a_curve_have_a_figure(name: str, flow: str, change: Callable[[Dataset], object], ds: Dataset):
    several = ds.isel(D=[0])
    assert shown(FIGURES[name](several.assign({flow: change(several)})), layout=False) > 1


@pytest.mark.parametrize(("steps", "at"), [(1, "every-step"), (2, "last")])
def test_a_surface_in_full_contact_at_every_state_with_a_flow_is_drawn(steps: int, at: str, tmp_path: Path) -> None:
    text = TEXT.replace("{steps: 8, to: percolation}", f"{{steps: {steps}}}")
    text = text.replace("D: [2.2, 2.5], m: 4, seeds: 3", "D: 2.2, m: 3, sides: mirrored, seeds: 1")
    record = f"record: {{transport: {{percolation: {at}, transmissivity: {at}}}}}"
    ds = roughvol.run(loads(text[: text.index("record:")] + record), out=tmp_path, jobs=1)
    for name in ("seal_percolation", "seal_transmissivity"):
        shown(FIGURES[name](ds), layout=False)


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_says_what_it_lacks(name: str, ds: Dataset) -> None:
    lacking = FIGURES[name].needs[-1]
    with pytest.raises(DatasetError, match=f"{name} needs {lacking}, which the run does not have"):
        FIGURES[name](ds.drop_vars(lacking))
    assert "no case" in str(FIGURES[name].missing(ds.assign({lacking: ds[lacking].astype(float) * np.nan})))


def _lines(fig: Figure, panel: int, words: str) -> list[Line2D]:
    return [line for line in fig.axes[panel].lines if words in str(line.get_label())]


def _known(one: Dataset, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return A* and a flow at its computed states, also 0 where percolation shows that nothing flows."""
    area, values = one.contact_area_fraction.values, one[name].values
    values = np.where(np.isnan(values) & (one["percolates"].values == 0.0), 0.0, values)
    return area[np.isfinite(values)], values[np.isfinite(values)]


@pytest.mark.parametrize("name", ["leak_rate", "transmissivity", "diffusivity"])
def test_one_surface_is_drawn_at_its_states_by_direction(one: Dataset, name: str) -> None:
    fig = FIGURES[f"seal_{name}"](one)
    looks = {}
    for axis in "xy":
        (line,) = _lines(fig, 1, f"along ${axis}$")
        area, values = _known(one.sel(axis=axis).squeeze(), name)
        open_ = values > 0.0
        assert np.array_equal(line.get_xydata(), np.array([area[open_], values[open_]]).T)
        assert line.get_marker() != "None"
        looks[axis] = (line.get_linestyle(), line.get_color())
    assert looks["x"] != looks["y"]
    assert not fig.axes[1].collections  # no band
    words = str(fig.legends[0].get_title().get_text())
    assert not any(word in words for word in ("median", "mean", "band", "%"))


def test_a_sealed_direction_is_drawn_where_it_closes(one: Dataset) -> None:
    fig = FIGURES["seal_transmissivity"](one)
    for axis in "xy":
        area, values = _known(one.sel(axis=axis).squeeze(), "transmissivity")
        marks = [line for line in fig.axes[1].lines if line.get_marker() == {"x": "x", "y": "+"}[axis]]
        assert [line.get_xdata()[0] for line in marks] == [area[values == 0.0][0]]
        assert marks[0].get_ydata()[0] == fig.axes[1].get_ylim()[0]
    labels = {text.get_text() for text in fig.legends[0].get_texts()}
    assert {"first state closed along $x$", "first state closed along $y$"} <= labels


@pytest.mark.parametrize("name", ["seal_transmissivity", "seal_estimates"])
def test_a_direction_closed_from_the_start_does_not_vanish(one: Dataset, name: str) -> None:
    flows = ("transmissivity", "percolates", "critical_gap", "diffusivity")
    fig = FIGURES[name](one.assign({each: one[each].where(one["axis"] == "x", 0.0 * one[each]) for each in flows}))
    assert any(line.get_marker() == "+" for ax in fig.axes for line in ax.lines)


def test_an_axis_of_flows_has_no_numbers_where_nothing_flows(one: Dataset) -> None:
    fig = FIGURES["seal_transmissivity"](one.assign({"transmissivity": 0.0 * one["transmissivity"]}))
    fig.set_layout_engine(None)
    fig.draw_without_rendering()
    assert not [text for text in fig.axes[0].get_yticklabels(which="both") if text.get_text()]
    assert any(line.get_marker() == "x" for line in fig.axes[0].lines)


def test_the_numbers_of_free_volumes_of_three_decades_do_not_overlap(one: Dataset) -> None:
    volumes = one["free_volume"]
    fig = FIGURES["seal_volume"](one.assign(free_volume=volumes * 1e-3 ** (volumes["step"] / volumes["step"].max())))
    assert labels_are_apart(fig, fig.axes[-1].xaxis)


def test_closing_loads_that_are_nearly_equal_have_an_axis_of_few_digits(one: Dataset) -> None:
    loads_ = xr.DataArray([3.0, 3.00006], {"axis": ["x", "y"]})
    closed = one.assign(leak_rate=0.0 * one.leak_rate, closing_pressure=loads_ * xr.ones_like(one.Sq))
    ax = FIGURES["seal_leak_rate"](closed).axes[0]
    assert [line.get_xdata()[0] for line in ax.lines if line.get_label() == "_closed"] == [3.0, 3.00006]
    low, high = ax.get_xlim()
    assert 0.01 < high / low - 1.0 < 0.1


def test_a_way_closes_over_every_quantity_at_its_solved_closing_load(tmp_path: Path) -> None:
    flows = "record: {transport: {percolation: every-step, transmissivity: every-step, closing: true}}"
    study = loads(f"surface: {{D: 2.2, m: 4, seeds: [1]}}\nsweep: {{pressures: [0.2, 3]}}\n{flows}")
    ds = roughvol.run(study, jobs=1, out=tmp_path / "run")
    flows, open_ = (FIGURES[name](ds) for name in ("seal_transmissivity", "seal_percolation"))
    assert "solved closing load" in open_.legends[0].get_title().get_text()
    for axis, marker in {"x": "x", "y": "+"}.items():
        end = ds.closing_pressure.sel(axis=axis).item()
        at = ds.roughvol.at(pressure=end)
        marks = [next(line for line in ax.lines if line.get_marker() == marker).get_xdata()[0] for ax in flows.axes[:3]]
        assert_allclose(marks, [at[name].item() for name in ("mean_pressure", "contact_area_fraction", "free_volume")])
        assert f"closed along ${axis}$" in {text.get_text() for text in flows.legends[0].get_texts()}
        (line,) = _lines(open_, 0, f"along ${axis}$")
        assert line.get_xdata()[line.get_ydata() == 0.0][0] == pytest.approx(end)


@pytest.mark.parametrize("kind", ["contact_area", "free_volume", "indentation"])
def test_a_flow_falls_to_its_solved_closing_load_as_in_show(kind: str, tmp_path: Path) -> None:
    flows = "record: {transport: {transmissivity: every-step, closing: true}}"
    study = loads(f"surface: {{D: 2.2, m: 4, seeds: [1]}}\nsweep: {{pressures: [0.2, 1, 3, 5]}}\n{flows}")
    ds = roughvol.run(study, jobs=1, out=tmp_path / "run")
    x = {"contact_area": "contact_area_fraction"}.get(kind, kind)
    family = Family("", 0.0, {}, ds.isel(D=0, m=0))
    for axis in "xy":
        (member,) = ways.ways(family, x, "transmissivity", axis)
        assert_allclose(member.closed, ds.roughvol.at(pressure=ds.closing_pressure.sel(axis=axis).item())[x])
        for share in (0.2, 0.5, 0.8):
            place = member.load[-1] + share * (member.closed - member.load[-1])
            flow = ds.roughvol.at(**{kind: place}).transmissivity.sel(axis=axis).item()
            assert_allclose(ways.sample([member], np.array([place])), flow, rtol=1e-4)


def test_the_connected_volume_ends_at_its_last_state_above_zero(one: Dataset) -> None:
    share = one.connected_volume_fraction.where(one.step < 6, 0.0)
    line = FIGURES["seal_volume"](one.assign(connected_volume_fraction=share)).axes[0].lines[0]
    assert np.isfinite(line.get_ydata()).tolist() == [True] * 5 + [False] * 3


def test_full_contact_has_no_share_of_the_free_volume(one: Dataset) -> None:
    full = {name: 0.0 * one[name] for name in ("free_volume", "free_volume_within")}
    *states, _ = FIGURES["seal_region"](one.assign(full)).axes[2].lines
    assert all(np.isnan(line.get_ydata()).all() for line in states)


def test_a_way_that_closes_in_full_contact_has_no_mark_over_free_volume() -> None:
    ds = _study(np.array([0.1, 1.0, 5.0]), {"x": 2, "y": 2})
    fig = FIGURES["seal_transmissivity"](ds.assign(free_volume=ds["free_volume"].where(ds["step"] < 3, 0.0)))
    assert [len([line for line in ax.lines if line.get_label() == "_closed"]) for ax in fig.axes[:3]] == [2, 2, 0]
    shown(fig, layout=False)


def test_the_leak_rate_is_that_stored_in_its_unit(one: Dataset) -> None:
    fig = FIGURES["seal_leak_rate"](one)
    assert fig.axes[0].get_ylabel() == "leak rate [mm³/s]"
    assert "pressure drop 1 bar, viscosity 1 mPa s" in fig.legends[0].get_title().get_text()


def test_pressure_stands_in_its_unit_above_p_star_where_one_factor_holds(ds: Dataset) -> None:
    ds = ds.isel(D=[0])
    fig = FIGURES["seal_transmissivity"](ds)
    fig.set_layout_engine(None)
    fig.draw_without_rendering()  # limits follow each other when they are drawn
    ax = fig.axes[0]
    (top,) = ax.child_axes
    assert top.get_xlabel() == "nominal pressure [MPa]"
    assert_allclose(top.get_xlim(), np.array(ax.get_xlim()) * 0.5 / 100 * 10, rtol=1e-9)
    several = ds.assign(nominal_pressure=ds.nominal_pressure * (1 + ds.seed))
    assert not FIGURES["seal_transmissivity"](several).axes[0].child_axes
    assert not FIGURES["seal_transmissivity"](ds.drop_vars("nominal_pressure")).axes[0].child_axes


def test_regions_are_drawn_over_the_whole(ds: Dataset, drawn: Callable[[str], Figure]) -> None:
    axes = drawn("seal_region").axes
    assert axes[0].get_ylabel().endswith("of the whole")
    region = ds.assign_attrs(region="x/L_x 0.25 to 0.75, y/L_y 0.25 to 0.75")
    assert FIGURES["seal_region"](region).axes[0].get_ylabel().endswith("of the region")
    assert ", region x/L_x 0.25 to 0.75, y/L_y" in origin(region, {})
    assert "region" not in origin(ds, {})
    whole = ds.assign_attrs(region="x/L_x 0 to 1, y/L_y 0 to 1")  # as every run of a whole surface has it
    assert "region" not in origin(whole, {})
    assert FIGURES["seal_region"](whole).axes[0].get_ylabel().endswith("of the whole")
    family = ds.sel(D=2.2, m=4)
    for ax, name in zip(axes, ("contact_area_fraction", "mean_pressure", "free_volume"), strict=False):
        line = next(line for line in ax.lines if len(np.asarray(line.get_xdata())) == 3)
        assert_allclose(np.asarray(line.get_ydata(), dtype=float)[-1], 1.0, rtol=1e-12)
        expected = (family[f"{name}_within"] / family[name]).sel(step=1).mean("seed")
        assert_allclose(np.asarray(line.get_ydata(), dtype=float), expected, rtol=1e-12)


def test_regions_of_one_surface_have_no_band(one: Dataset) -> None:
    fig = FIGURES["seal_region"](one)
    assert not any(ax.collections for ax in fig.axes)
    assert fig.legends[0].get_title().get_text() == "$D = 2.2$"
    state = one.squeeze().sel(step=1)
    drawn = [line.get_ydata() for line in fig.axes[3].lines]
    for axis in "xy":
        assert any(np.array_equal(values, state["transmissivity_within"].sel(axis=axis)) for values in drawn)


def test_regions_whose_flow_is_on_another_leg_are_drawn_without_it(one: Dataset) -> None:
    fig = FIGURES["seal_region"](one.assign(transmissivity_within=np.nan * one["transmissivity_within"]))
    assert len(fig.axes) == 3
    assert all(ax.lines for ax in fig.axes)


def test_percolation_falls_from_one_to_zero(drawn: Callable[[str], Figure]) -> None:
    for panel in range(6):
        lines = _lines(drawn("seal_percolation"), panel, f"along ${'xy'[panel // 3]}$")
        assert lines
        for line in lines:
            share = np.asarray(line.get_ydata(), dtype=float)
            assert np.all(np.diff(share) <= 0.0)
            assert {share[0], share[-1]} == {0.0, 1.0}


def _study(load: np.ndarray, shut: dict[str, int]) -> Dataset:
    """Make the record of one surface whose ways close at the places given of the loads given."""
    dims, step = ("case", "step"), np.arange(load.size)
    values = {
        "mean_pressure": load,
        "contact_area_fraction": 0.04 * load,
        "free_volume": 2.0 / (1.0 + load),
        "nominal_pressure": 0.02 * load,
    }
    open_ = np.transpose([step < place for place in shut.values()])
    values["percolates"] = open_.astype(float)
    values["transmissivity"] = np.where(open_, np.exp(-load)[:, np.newaxis], 0.0)
    coordinates = {"case": ["scan.npy"], "step": step + 1, "axis": list(shut), "L": 500.0}
    along = {name: ((*dims, "axis")[: each.ndim + 1], each[None]) for name, each in values.items()}
    made = xr.Dataset(along, coordinates).set_coords("L")
    made["nominal_pressure"].attrs["units"] = "MPa"
    return made


def _falls(line: Line2D) -> float:
    """Return where a step line, whose value holds up to the next point, leaves 1."""
    x, y = (np.asarray(values, dtype=float) for values in line.get_data())
    assert line.get_drawstyle() == "steps-post"
    return float(x[np.argmax(y < 1.0)])


def test_a_way_closes_at_the_first_state_computed_closed() -> None:
    load = np.array([0.05, 0.3, 0.8, 1.7, 2.7, 3.8, 5.0, 6.2, 7.5, 8.7, 10.0, 11.3])
    ds = _study(load, {"x": 11, "y": 8})
    fig = FIGURES["seal_percolation"](ds)
    for panel, name in enumerate(("mean_pressure", "contact_area_fraction", "free_volume")):
        for axis, place in (("x", 11), ("y", 8)):
            (line,) = _lines(fig, panel, f"along ${axis}$")
            stored = ds[name].values[0]
            assert _falls(line) == stored[place]
            at = np.abs(np.asarray(line.get_xdata()) - stored[place - 1]).argmin()
            assert line.get_ydata()[at] == 1.0  # the last state known open
            (states,) = [each for each in fig.axes[panel].lines if each.get_marker() == {"x": "o", "y": "s"}[axis]]
            assert np.sort(states.get_ydata()).tolist() == np.sort(ds["percolates"].sel(axis=axis).values[0]).tolist()


def test_an_open_end_is_not_closed() -> None:
    load = np.linspace(0.1, 5.0, 8)
    ds = _study(load, {"x": 99, "y": 5})
    fig = FIGURES["seal_percolation"](ds)
    (line,) = _lines(fig, 0, "along $x$")
    assert set(line.get_ydata()) == {1.0}
    assert line.get_xdata()[-1] == load[-1]
    flows = FIGURES["seal_transmissivity"](ds)
    assert not any(line.get_marker() == "x" for line in flows.axes[0].lines)
    assert any(line.get_marker() == "+" for line in flows.axes[0].lines)


def test_volumes_connected_and_trapped_are_those_stored(one: Dataset) -> None:
    axes = FIGURES["seal_volume"](one).axes
    area = one.contact_area_fraction.values.ravel()
    for ax, fraction in ((axes[1], one.connected_volume_fraction), (axes[4], one.trapped_volume_fraction)):
        x, y = (np.asarray(values, dtype=float) for values in ax.lines[0].get_data())
        expected = np.interp(x, area, (one.free_volume * fraction).values.ravel())
        assert_allclose(y, expected, rtol=1e-12, atol=1e-15)


def test_the_map_shows_contact_and_flux_and_the_place_of_the_constriction(
    ds: Dataset, drawn: Callable[[str], Figure]
) -> None:
    fig = drawn("seal_map")
    case = ds.sel(D=2.2, m=4).isel(seed=0)
    panel = fig.axes[0]
    flux, contact = (np.ma.filled(image.get_array().astype(float), np.nan) for image in panel.images)
    stored = case.flux.sel(axis="x", flux_at="step=2").values
    assert_allclose(flux.T, np.maximum(stored / stored.mean(), 1e-2), rtol=1e-12)
    assert np.array_equal(np.nan_to_num(contact.T) == 1.0, case.gap.sel(field_at="step=2").values == 0.0)
    marked = np.ravel([line.get_data() for line in panel.lines[:1]])
    assert_allclose(marked, case.critical_position.sel(axis="x", step=2))


def test_the_map_of_a_period_marks_the_constriction_of_a_flow_across_its_sides() -> None:
    text = "surface: {D: 2.2, m: 4, seeds: [0], sides: periodic}\nsweep: {steps: 3, to: {contact_area: 0.2}}\n"
    flows = "{constriction: every-step, transmissivity: last, flux_at: last}"
    period = run_case(loads(f"{text}record: {{fields_at: last, transport: {flows}}}").cases()[0])
    fig = FIGURES["seal_map"](period)
    marked = np.ravel([line.get_data() for line in fig.axes[0].lines[:1]])
    assert_allclose(marked, period.critical_position.sel(axis="x").isel(step=-1).values.ravel())
    assert fig.get_size_inches()[0] < 5.0  # one map takes no page


def test_the_map_of_a_region_lies_at_the_place_of_the_region() -> None:
    text = "surface: {D: 2.2, m: 4, seeds: [0]}\nsweep: {steps: 3, to: {contact_area: 0.2}}\n"
    flows = "{constriction: every-step, transmissivity: last, flux_at: last}"
    region = run_case(loads(f"{text}record: {{region: interior, fields_at: last, transport: {flows}}}").cases()[0])
    for image in FIGURES["seal_map"](region).axes[0].images:
        assert_allclose(image.get_extent(), [0.25 - 1 / 32, 0.75 + 1 / 32] * 2)


def test_the_map_of_a_closed_way_has_no_flow() -> None:
    text = "surface: {D: 2.2, m: 4, seeds: [0]}\nsweep: {steps: 3, to: percolation}\n"
    flows = "{constriction: every-step, transmissivity: last, flux_at: last}"
    closed = run_case(loads(f"{text}record: {{fields_at: last, transport: {flows}}}").cases()[0])
    fig = FIGURES["seal_map"](closed)
    assert fig.axes[0].get_title().splitlines()[1] == r"$T_x^{\ast} = 0$"
    assert not fig.axes[0].lines  # and no constriction


def test_a_map_without_flux_and_gap_at_one_state_is_refused(ds: Dataset) -> None:
    apart = ds.assign_coords(flux_at=["step=3", "step=6"])
    unreached = ds.assign(flux_at_step=-1 * xr.ones_like(ds.flux_at_step))
    for fields in (apart, unreached):
        with pytest.raises(DatasetError, match="seal_map needs flux and gap at one state"):
            FIGURES["seal_map"](fields)


def test_sampling_keeps_to_what_is_known() -> None:
    points = np.linspace(0.0, 5.0, 11)
    closing = ways.way(np.array([1.0, 2.0, 4.0]), np.array([1e-2, 1e-4, 0.0]))
    assert closing.closed == 4.0
    row = ways.sample([closing], points)[0]
    assert np.isnan(row[points < 1.0]).all()
    assert_allclose(row[[2, 3, 4]], [1e-2, 1e-3, 1e-4], rtol=1e-12)
    assert_allclose(row[[5, 6, 7]], [0.75e-4, 0.5e-4, 0.25e-4], rtol=1e-12)  # open until computed closed
    assert np.array_equal(row[points >= 4.0], np.zeros(3))
    assert ways.sample([closing], np.array([3.9]), hold=True)[0][0] == 1e-4
    assert np.isinf(ways.sample([closing], np.array([4.0]), beyond=np.inf)[0][0])


def test_an_open_way_is_unknown_beyond_its_last_state() -> None:
    falling = ways.way(np.array([4.0, 1.0]), np.array([1.0, 0.1]))  # V* falls along the loading
    assert np.isnan(falling.closed)
    row = ways.sample([falling], np.array([5.0, 4.0, 1.0, 0.5]))[0]
    assert np.array_equal(np.isnan(row), [True, False, False, True])
    assert np.array_equal(np.isnan(ways.is_open([falling], np.array([5.0, 1.0, 0.5]))[0]), [False, False, True])


def test_a_way_that_opens_again_closes_after_its_last_open_state() -> None:
    one = ways.way(np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 0.0, 0.5, 0.0]))
    assert one.closed == 4.0
    assert np.array_equal(one.load, [1.0, 3.0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_points_hold_the_closing_loads(sign: float) -> None:
    loads = [sign * np.array([1.0, 2.0, 3.0]) + 5.0, sign * np.array([1.5, 2.5, 4.0]) + 5.0]
    members = [ways.way(load, np.array([1.0, 0.5, 0.0])) for load in loads]
    at = ways.grid(members)
    assert {one.closed for one in members} <= set(at.tolist())
    assert at[0] == loads[1][0]
    assert np.all(np.diff(sign * at) > 0.0)
    assert not np.isnan(ways.sample(members, at)).any()
    still = [*members, ways.way(loads[0], np.array([1.0, 0.9, 0.8]))]
    assert ways.grid(still)[-1] == loads[0][-1]


@pytest.mark.parametrize("count", [2, 10])
def test_a_band_has_the_range_of_the_tables(count: int) -> None:
    rows = np.random.default_rng(count).random((count, 4))
    centre, low, high = ways.centre_and_band(rows)
    found = [average("leak_rate", column) for column in rows.T]
    assert_allclose([low, centre, high], np.transpose([(one.low, one.value, one.high) for one in found]))


@pytest.mark.parametrize(
    ("counts", "words"), [([1, 1], ""), ([1, 3], "median of 3 surfaces, band 16 to 84 %"), ([2, 5], "median of 2-5")]
)
def test_one_surface_has_no_words_of_statistics(counts: list[int], words: str) -> None:
    assert ways.band_words(counts).startswith(words)
    assert bool(ways.band_words(counts)) == bool(words)


def test_what_shows_that_a_way_is_closed_counts_for_its_flow() -> None:
    ds = _study(np.arange(1.0, 6.0), {"x": 3, "y": 9})
    ds["transmissivity"] = ds["transmissivity"].where(ds["step"] < 4)  # not computed where it is closed
    values = ways.flow(ds, "transmissivity", "x").values[0]
    assert np.array_equal(values[3:], [0.0, 0.0])
    assert isinstance(ways.way(ds["mean_pressure"].values[0], values), ways.Way)
    assert ways.way(ds["mean_pressure"].values[0], values).closed == 4.0


def test_volumes_of_several_surfaces_hold_both_in_the_band(ds: Dataset) -> None:
    two = ds.isel(D=[0], seed=[0, 1])
    ax = FIGURES["seal_volume"](two).axes[1]
    (line,) = [each for each in ax.lines if each.get_label() == "$D = 2.2$"]
    assert line.get_marker() == "None"
    at = float(line.get_xdata()[100])
    values = []
    for seed in range(2):
        one = two.isel(D=0, seed=seed).sel(m=4)
        connected = (one.free_volume * one.connected_volume_fraction).values
        values.append(np.interp(at, one.contact_area_fraction.values, connected))
    vertices = ax.collections[0].get_paths()[0].vertices
    ends = vertices[np.isclose(vertices[:, 0], at, rtol=1e-12), 1]
    assert ends.min() <= min(values) <= max(values) <= ends.max()


def test_a_median_is_drawn_up_to_the_last_step_and_led_to_a_solved_closing_load() -> None:
    ax = Figure().add_subplot()
    ax.set(ylim=(1e-3, 10.0), yscale="log")
    members = [ways.Way(np.array([1.0, 2.0]), np.array([4.0, 1.0]), closed, 2.0) for closed in (5.0, 6.0)]
    family = Family("", 0.0, {"color": "k"}, Dataset({"Sq": ("seed", [1.0, 1.0])}))
    assert ways.draw_flow(ax, family, members, "x", alone=True)
    drawn, lead, mark = ax.get_lines()
    assert np.max(drawn.get_xdata()) == pytest.approx(2.0, abs=0.03)
    assert np.isfinite(np.asarray(drawn.get_ydata(), dtype=float)).all()
    assert lead.get_linestyle() == ":"
    assert np.asarray(mark.get_xdata()).tolist() == [6.0]


def test_over_a_falling_quantity_every_state_is_computed() -> None:
    members = [ways.Way(np.array([3.0, 2.0]), np.array([4.0, 1.0]), closed, closed) for closed in (1.5, 0.5)]
    assert ways.is_computed(members, np.linspace(3.0, 0.1, 30)).all()
