"""Figures of the flow draw what the dataset holds, and say what they miss."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from roughvol import dataset, dimensional, figures
from roughvol.campaign import run_case
from roughvol.dataset import Dataset
from roughvol.errors import DatasetError
from roughvol.seal_figures import FIGURES, NEEDS, missing, sample
from roughvol.study import loads

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


@pytest.fixture(scope="module")
def ds() -> Dataset:
    study = loads(TEXT)
    together = dataset.combine([run_case(case) for case in study.cases()], {"format": dataset.FORMAT})
    return dimensional.in_units(together, study, "um")


def _render(fig: Figure) -> int:
    stream = io.BytesIO()
    fig.savefig(stream, dpi=40)
    return len(stream.getvalue())


def test_names_do_not_clash_and_every_figure_is_explained() -> None:
    assert not set(FIGURES) & set(figures.FIGURES)
    assert set(FIGURES) == set(NEEDS)
    assert all(name.startswith("seal_") and FIGURES[name].__doc__ for name in FIGURES)


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_drawn(name: str, ds: Dataset) -> None:
    assert missing(name, ds) is None
    assert _render(FIGURES[name](ds)) > 1000


@pytest.mark.parametrize("name", ["seal_transmissivity", "seal_percolation"])
def test_one_surface_is_enough(name: str, ds: Dataset) -> None:
    assert _render(FIGURES[name](ds.isel(D=[0], seed=[0]))) > 1000


@pytest.mark.parametrize("name", ["seal_transmissivity", "seal_estimates"])
def test_a_single_state_is_no_curve_and_no_error(name: str, ds: Dataset) -> None:
    once = ds.step == 2
    few = ds.assign({f"transmissivity_{axis}": ds[f"transmissivity_{axis}"].where(once) for axis in "xy"})
    assert _render(FIGURES[name](few)) > 1000


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_says_what_it_lacks(name: str, ds: Dataset) -> None:
    lacking = NEEDS[name][-1]
    with pytest.raises(DatasetError, match=f"{name} needs {lacking}, which the study did not record"):
        FIGURES[name](ds.drop_vars(lacking))
    assert "no case" in str(missing(name, ds.assign({lacking: ds[lacking].astype(float) * np.nan})))


def test_transmissivity_is_the_median_of_the_ways(ds: Dataset) -> None:
    ax = FIGURES["seal_transmissivity"](ds).axes[1]
    line = next(line for line in ax.lines if "2.2" in str(line.get_label()))
    area = np.asarray(line.get_xdata(), dtype=float)
    flows = []
    for seed in range(3):
        one = ds.sel(D=2.2, m=4).isel(seed=seed)
        for axis in "xy":
            flow = one[f"transmissivity_{axis}"].values
            known = flow > 0.0
            x = one.contact_area_fraction.values[known]
            flows.append(np.where(area <= x[-1], np.exp(np.interp(area, x, np.log(flow[known]))), 0.0))
    median = np.median(flows, axis=0)
    assert_allclose(np.nan_to_num(np.asarray(line.get_ydata(), dtype=float)), median, rtol=1e-10)


def test_the_leak_rate_is_that_stored_in_its_unit(ds: Dataset) -> None:
    one = ds.isel(D=[0], seed=[0])
    fig = FIGURES["seal_leak_rate"](one)
    assert fig.axes[0].get_ylabel() == "leak rate [mm$^{3}$/s]"
    assert "1 bar" in fig.get_suptitle()
    line = fig.axes[1].lines[0]
    area, leak = one.contact_area_fraction.values.ravel(), one.leak_rate_x.values.ravel()
    other = one.leak_rate_y.values.ravel()
    drawn = dict(zip(*(np.asarray(values, dtype=float).tolist() for values in line.get_data()), strict=True))
    first = min(drawn)
    assert_allclose(first, area[0], rtol=1e-12)
    assert_allclose(drawn[first], 0.5 * (leak[0] + other[0]), rtol=1e-10)  # the median of two ways


def test_pressure_stands_in_its_unit_above_p_star_where_one_factor_holds(ds: Dataset) -> None:
    fig = FIGURES["seal_transmissivity"](ds)
    assert _render(fig) > 1000  # limits follow each other when they are drawn
    ax = fig.axes[0]
    (top,) = ax.child_axes
    assert top.get_xlabel() == "nominal pressure [MPa]"
    assert_allclose(top.get_xlim(), np.array(ax.get_xlim()) * 0.5 / 100 * 10, rtol=1e-9)
    several = ds.assign(nominal_pressure=ds.nominal_pressure * (1 + ds.seed))
    assert not FIGURES["seal_transmissivity"](several).axes[0].child_axes
    assert not FIGURES["seal_transmissivity"](ds.drop_vars("nominal_pressure")).axes[0].child_axes


def test_regions_are_drawn_over_the_whole(ds: Dataset) -> None:
    axes = FIGURES["seal_region"](ds).axes
    family = ds.sel(D=2.2, m=4)
    for ax, name in zip(axes, ("contact_area_fraction", "mean_pressure", "free_volume"), strict=False):
        line = next(line for line in ax.lines if len(np.asarray(line.get_xdata())) == 3)
        assert_allclose(np.asarray(line.get_ydata(), dtype=float)[-1], 1.0, rtol=1e-12)
        expected = (family[f"{name}_within"] / family[name]).sel(step=1).mean("seed")
        assert_allclose(np.asarray(line.get_ydata(), dtype=float), expected, rtol=1e-12)


def test_percolation_falls_from_one_to_zero(ds: Dataset) -> None:
    for ax in FIGURES["seal_percolation"](ds).axes:
        for line in ax.lines:
            share = np.asarray(line.get_ydata(), dtype=float)
            falls = np.diff(share) if "V" not in ax.get_xlabel() else -np.diff(share)
            assert np.all(falls <= 0.0)
            assert {share.min(), share.max()} == {0.0, 1.0}


def test_volumes_connected_and_trapped_are_those_stored(ds: Dataset) -> None:
    one = ds.isel(D=[0], seed=[0])
    axes = FIGURES["seal_volume"](one).axes
    area = one.contact_area_fraction.values.ravel()
    for ax, fraction in ((axes[1], one.connected_volume_fraction), (axes[4], one.trapped_volume_fraction)):
        x, y = (np.asarray(values, dtype=float) for values in ax.lines[0].get_data())
        expected = np.interp(x, area, (one.free_volume * fraction).values.ravel())
        assert_allclose(y, expected, rtol=1e-12, atol=1e-15)


def test_the_map_shows_contact_and_flux_and_the_place_of_the_constriction(ds: Dataset) -> None:
    fig = FIGURES["seal_map"](ds)
    case = ds.sel(D=2.2, m=4).isel(seed=0)
    panel = fig.axes[0]
    flux, contact = (np.ma.filled(image.get_array().astype(float), np.nan) for image in panel.images)
    stored = case.flux_x.sel(flux_at="step=2").values
    assert_allclose(flux.T, np.maximum(stored / stored.mean(), 1e-2), rtol=1e-12)
    assert np.array_equal(np.nan_to_num(contact.T) == 1.0, case.gap.sel(field_at="step=2").values == 0.0)
    marked = np.ravel([line.get_data() for line in panel.lines[:1]])
    assert_allclose(marked, case.critical_position_x.sel(step=2))


def test_sampling_keeps_to_what_is_known() -> None:
    grid = np.linspace(0.0, 5.0, 6)
    members = [(np.array([1.0, 2.0, 4.0]), np.array([1e-2, 1e-4, 0.0])), (np.array([4.0, 1.0]), np.array([4.0, 1.0]))]
    rising = sample(members[:1], grid, log=True, closed=0.0)[0]
    assert_allclose(rising, [np.nan, 1e-2, 1e-4, 0.0, 0.0, 0.0], rtol=1e-12)
    falling = sample(members[1:], grid, log=False, closed=None)[0]
    assert_allclose(falling, [np.nan, 1.0, 2.0, 3.0, 4.0, np.nan], rtol=1e-12)


def test_the_command_line_draws_them(ds: Dataset, tmp_path: Path) -> None:
    from click.testing import CliRunner

    from roughvol.cli import main

    dataset.write(ds, tmp_path / "study.nc")
    result = CliRunner().invoke(main, ["plot", str(tmp_path), "seal_map"])
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"seal_map.png"}
