"""Central regions of several widths: what is inside them, from one solution; and the cost of what is recorded."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from roughvol.campaign.one_case import run_case
from roughvol.gap import transport
from roughvol.surfaces.psd import waves
from roughvol.surfaces.surface import Surface
from tests.observables.kit import case_of, states_of

WIDTHS = "record: {region_widths: {shares: [1, 0.5, 0.75], transmissivity: {step: [2, 4]}}"


def _case(text):
    return case_of("sweep: {steps: 4, to: {indentation: 3}}\n" + text)


@pytest.fixture(scope="module")
def result():
    return run_case(_case(WIDTHS + ", transport: {transmissivity: every-step}}")).squeeze(("D", "m", "seed"))


def test_the_widest_region_is_the_whole(result):
    whole = result.sel(region_width=1.0)
    for name in ("contact_area_fraction", "mean_pressure", "free_volume"):
        assert_allclose(whole[f"{name}_within"], result[name], rtol=1e-12)
    inside = whole["transmissivity_within"]
    assert_array_equal(inside.notnull().all("axis"), [False, True, False, True])
    assert_allclose(inside[1::2], result["transmissivity"][1::2], rtol=1e-12)  # one starts from the state before


def test_a_region_holds_what_its_elements_do(result):
    *_, state = states_of(_case(WIDTHS + "}"), result.indentation.values)
    for width, inside in ((0.5, slice(4, 13)), (0.75, slice(2, 15))):
        found = result.sel(region_width=width).isel(step=-1)
        assert float(found.contact_area_fraction_within) == state.contact()[inside, inside].mean()
        assert_allclose(found.mean_pressure_within, state.pressure()[inside, inside].mean(), rtol=1e-6)
        assert_allclose(found.free_volume_within, state.gap()[inside, inside].mean(), rtol=1e-6)
        flow = transport.conduction(state.gap()[inside, inside], 1).coefficient
        assert_allclose(found.transmissivity_within.sel(axis="y"), flow, rtol=1e-5)


@pytest.mark.parametrize("width", [0.25, 0.9])
def test_a_central_region_is_that_of_its_corners(width):
    corner = f"[{0.5 - width / 2}, {0.5 + width / 2}]"
    named = run_case(_case(f"record: {{region: {{x: {corner}, y: {corner}}}}}"))
    inside = run_case(_case(f"record: {{region_widths: {{shares: {width}, at: last}}}}")).isel(region_width=0)
    for name in ("contact_area_fraction", "mean_pressure", "free_volume"):
        assert_allclose(inside[f"{name}_within"].isel(step=-1), named[name].isel(step=-1), rtol=1e-12)
        assert inside[f"{name}_within"].isel(step=slice(-1)).isnull().all()


def test_regions_do_not_change_what_is_solved(result):
    plain = run_case(_case("")).squeeze(("D", "m", "seed"))
    for name in ("indentation", "contact_area_fraction", "mean_pressure", "free_volume", "residual"):
        assert_array_equal(plain[name], result[name])


# What was recorded, and what it took


def test_the_seconds_of_everything_recorded_are_told(result):
    assert result.observable.values.tolist() == ["transmissivity", "region_widths", "region_transmissivity"]
    taken = result.observable_time
    assert (taken > 0).all()
    assert float(taken.sum()) < float(result.wall_time)
    assert float(taken.sel(observable="transmissivity")) == pytest.approx(float(result.transport_time.sum()), rel=1e-9)


def test_each_observable_that_was_asked_for_has_its_name():
    text = "record: {fields_at: last, box_counting: {}, volume_density: {}, texture: true, "
    text += "transport: {flux_at: last, percolation: last}}"
    names = ["fields_at", "box_counting", "volume_density", "texture", "flux_at", "percolation"]
    assert sorted(run_case(_case(text)).observable.values) == sorted(names)
    assert "observable" not in run_case(_case("")).variables


def test_the_aspect_is_that_of_the_region():
    text = "record: {region: {x: [0, 0.5]}, transport: {transmissivity: last}}"
    assert float(run_case(_case(text)).region_aspect.item()) == 17 / 9
    assert "region_aspect" not in run_case(_case("record: {transport: {percolation: last}}"))


def test_a_region_of_two_rows_has_its_flow_and_no_number_of_waves():
    found = run_case(_case("record: {region: {x: [0, 0.07]}, transport: {transmissivity: last}}"))
    assert found.region_aspect.item() == 17 / 2
    assert np.isfinite(found.transmissivity).any()
    assert np.isnan(found.region_waves).all()


def test_the_waves_of_a_whole_period_are_those_without_a_window():
    text = "surface: {H: 0.8, n: 16, rolloff: 2, cut: 4, sides: periodic}\nsweep: {steps: 1, to: {contact_area: 0.2}}\n"
    found = run_case(case_of(f"{text}record: {{heights: true, transport: {{transmissivity: last}}}}", ""))
    period = Surface(found.heights.squeeze().values, 1.0, sides="periodic")
    assert_allclose(found.region_waves.squeeze(), waves(period), rtol=1e-9)
