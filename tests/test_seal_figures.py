"""Figures of the flow draw what the dataset holds, and say what they miss."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from roughvol import dataset, figures
from roughvol.campaign import run_case
from roughvol.dataset import Dataset
from roughvol.errors import DatasetError
from roughvol.seal_figures import FIGURES, NEEDS, missing, sample
from roughvol.study import loads

TEXT = """
name: tiny_seal
surface: {D: [2.2, 2.5], m: 4, seeds: 3}
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
"""


@pytest.fixture(scope="module")
def ds() -> Dataset:
    return dataset.combine([run_case(case) for case in loads(TEXT).cases()], {"format": dataset.FORMAT})


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
