"""The figure of an ensemble: one line for each D, beside that of plain Monte Carlo."""

from typing import Any

import numpy as np
import pytest
from xarray import Dataset

from roughvol.errors import DatasetError
from roughvol.report.figures import content
from roughvol.report.figures.registry import FIGURES
from roughvol.store.variants import widened

LEVELS, ROUNDS = 3, 4


@pytest.fixture
def results() -> Dataset:
    dims = ("D", "ensemble_at")
    half = 0.1 / np.arange(1, ROUNDS + 1) ** 0.5
    return Dataset(
        {
            "ensemble_samples": (("D", "m"), [[400.0, 50.0, 5.0], [300.0, 60.0, 9.0]]),
            "ensemble_sample_cost": (("D", "m"), [[0.02, 0.03, 0.1]] * 2),
            "ensemble_plain_cost": (("D",), [90.0, 60.0]),
            "ensemble_round_cost": (("D", "round"), [np.arange(1.0, ROUNDS + 1)] * 2),
            "free_volume_mean": (dims, [[1.5], [1.7]]),
            "free_volume_accuracy_asked": (dims, [[0.05], [0.05]]),
            "free_volume_interval": ((*dims, "bound"), [[[1.45, 1.55]], [[1.65, 1.75]]]),
            "free_volume_level_mean": (("D", "m", "ensemble_at"), [[[1.8], [1.6], [1.5]], [[2.0], [1.8], [1.7]]]),
            "free_volume_bias": (dims, [[0.03], [np.nan]]),
            "free_volume_solver_error": (dims, [[1e-3], [0.0]]),
            "free_volume_level_variance": (("D", "m", "ensemble_at"), np.full((2, LEVELS, 1), 0.04)),
            "free_volume_round_half_width": ((*dims, "round"), [[half], [half]]),
        },
        coords={
            "D": [2.2, 2.5],
            "m": [4, 5, 6],
            "bound": ["lower", "upper"],
            "ensemble_at": np.array(["pressure=0.3"], dtype=object),
        },
    )


def test_samples_and_costs_are_those_of_the_dataset(results: Dataset) -> None:
    samples, costs, narrowing = FIGURES["ensemble_cost"](results).axes
    np.testing.assert_allclose(samples.lines[0].get_ydata(), [400.0, 50.0, 5.0])
    np.testing.assert_allclose(costs.lines[0].get_ydata(), [8.0, 1.5, 0.5])
    widths, plain, _ = narrowing.lines[:3]
    np.testing.assert_allclose(widths.get_ydata()[0], 100.0 * 0.1 / 1.5)
    np.testing.assert_allclose(plain.get_ydata() * plain.get_xdata() ** 0.5, 100 * 1.96 * (0.04 * 0.1) ** 0.5 / 1.5)


def test_plain_monte_carlo_is_a_line_where_it_is_cheaper(results: Dataset) -> None:
    cheap = results.isel(round=[0]).assign(ensemble_plain_cost=("D", [0.5, 0.5]))
    plain = FIGURES["ensemble_cost"](cheap).axes[2].lines[1].get_xdata()
    np.testing.assert_allclose(plain[[0, -1]], [0.5, 1.0])


def test_the_legend_names_each_line_of_the_right_panel(results: Dataset) -> None:
    (legend,) = FIGURES["ensemble_cost"](results).legends
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts == ["$D = 2.2$", "$D = 2.5$", "plain Monte Carlo", "accuracy asked for"]


def test_the_points_of_each_panel_name_their_fractal_dimension(results: Dataset) -> None:
    found = {(point["panel"], point["curve"]) for point in content.data(FIGURES["ensemble_cost"](results))}
    named = {(panel, f"D = {D}") for panel in (1, 2, 3) for D in (2.2, 2.5)}
    assert found == named | {(3, f"D = {D}, plain Monte Carlo") for D in (2.2, 2.5)}


def test_an_axis_of_less_than_a_decade_has_plain_labels(results: Dataset) -> None:
    results["ensemble_samples"] = ("D", "m"), [[60.0, 50.0, 25.0], [60.0, 40.0, 24.0]]
    figure = FIGURES["ensemble_cost"](results)
    figure.draw_without_rendering()
    axis = figure.axes[0].yaxis
    low, high = axis.get_view_interval()
    major = [tick.label1.get_text() for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
    minor = [tick.label1.get_text() for tick in axis.get_minor_ticks()]
    assert major == ["30", "40", "50", "60"]
    assert not any(minor)


def test_the_note_has_the_samples_of_each_level(results: Dataset) -> None:
    note = FIGURES["ensemble_cost"](results.assign_coords(L=100.0)).get_supxlabel()
    assert note.replace("\n", " ").endswith("samples by m: 400, 50, 5 (D = 2.2); 300, 60, 9 (D = 2.5).")


def test_it_is_found_by_name_and_needs_an_ensemble(results: Dataset) -> None:
    assert FIGURES["ensemble_cost"].missing(results) is None
    with pytest.raises(DatasetError, match="section 'ensemble'"):
        FIGURES["ensemble_cost"](Dataset())


def test_the_right_panel_names_its_mean_and_is_empty_where_every_mean_is_zero(results: Dataset) -> None:
    right = FIGURES["ensemble_cost"](results).axes[2]
    assert right.get_title() == "free_volume at pressure=0.3"
    results["free_volume_mean"][0] = 0.0  # of D = 2.2
    assert len(FIGURES["ensemble_cost"](results).axes[2].lines) == 3
    results["free_volume_mean"][:] = 0.0
    right = FIGURES["ensemble_cost"](results).axes[2]
    assert (len(right.lines), right.get_title()) == (0, "every mean is 0")


@pytest.mark.parametrize("chosen", [{"m": 6}, {"ensemble_at": "pressure=0.3"}])
def test_a_choice_by_labels_keeps_the_means_of_all_surfaces(results: Dataset, chosen: dict[str, Any]) -> None:
    ends = ("mean", "accuracy_asked", "interval", "level_mean")
    every = results.assign({f"rms_gap_{end}": results[f"free_volume_{end}"] for end in ends})
    one = widened(every.assign(gap_mean=results["ensemble_plain_cost"]).sel(chosen))  # of surfaces, by its name alone
    for name in every.data_vars:
        assert set(one[name].dims) == set(every[name].dims), name
    drawn = [FIGURES["ensemble_cost"](data).axes[2].lines for data in (results, widened(results.sel(chosen)))]
    for whole, part in zip(*drawn, strict=True):
        np.testing.assert_array_equal(whole.get_xydata(), part.get_xydata())
    with pytest.raises(DatasetError, match=r"ensemble_\w+ along seed, as after ds.where; allowed: the dimensions of"):
        widened(results.expand_dims(seed=[0]))
