"""The region that a study observes: its numbers, its levels, and regions of too few elements."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.campaign import execution
from roughvol.campaign.one_case import run_case
from roughvol.errors import StudyError
from roughvol.gap import clusters
from roughvol.observables import regions
from roughvol.study import loads
from tests.observables.kit import answer, case_of, states_of

INTERIOR = "record: {region: interior, fields_at: last, box_counting: {at: last}, transport: {percolation: last}}"


def test_observables_are_those_of_the_region():
    case = case_of("sweep: {steps: 3, to: {indentation: 3}}\n" + INTERIOR)
    found = run_case(case).squeeze(("D", "m", "seed"))
    state = states_of(case, found.indentation.values)[-1]
    inside = (slice(4, 13), slice(4, 13))
    last = found.isel(step=-1)
    assert float(last.contact_area_fraction) == state.contact()[inside].mean()
    assert_allclose(last.mean_pressure, state.pressure()[inside].mean(), rtol=1e-9)
    assert_allclose(last.free_volume, state.gap()[inside].mean(), rtol=1e-9)
    assert found.gap.shape == (1, 17, 17)
    assert_allclose(found.gap[0], state.gap(), rtol=1e-9, atol=1e-12)
    assert int(found.box_count.sel(threshold=1.0, r=1)[0]) == 64
    connected = clusters.connectivity(state.gap()[inside], state.contact()[inside]).connected
    assert_allclose(last.connected_volume_fraction, connected, rtol=1e-12)
    assert "0.25 to 0.75" in found.attrs["region"]


def test_a_sweep_to_a_contact_area_means_that_of_the_region():
    case = case_of("sweep: {steps: 2, to: {contact_area: 0.2}}\nrecord: {region: {x: [0.5, 1], y: [0, 0.5]}}")
    found = run_case(case).contact_area_fraction.values.ravel()
    assert 0.2 <= found[-1] < 0.2 + 3 / 81
    assert found[0] < 0.2


@pytest.mark.parametrize(
    ("kind", "value", "name", "sides"),
    [("pressure", 0.5, "mean_pressure", ""), ("free_volume", 0.6, "free_volume", "sides: periodic")],
)
def test_a_sweep_in_a_region_ends_at_its_value(kind, value, name, sides):
    text = f"surface: {{D: 2.3, m: 4, seeds: [1], {sides}}}\nsweep: {{steps: 3, to: {{{kind}: {value}}}}}\n"
    found = answer(text + "record: {region: interior}")[name].values
    assert found[-1] == pytest.approx(value, rel=5e-6)
    assert abs(found[0] / value - 1.0) > 0.1


def test_a_level_of_free_volume_is_found_in_a_region_below_the_mean_plane():
    text = "surface: {D: 2.3, m: 4, seeds: [8]}\nsweep: {steps: 2, to: {indentation: 2}}\n"
    record = "record: {region: interior, fields_at: {free_volume: 2.5}}"  # at first touch 2.81, of the whole 2.21
    found = answer(text + record)
    assert found.free_volume[0] < 2.5
    assert float(found.field_at_free_volume) == pytest.approx(2.5, rel=5e-6)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_region_of_a_rectangle_is_measured_on_its_own_sides(axis):
    case = case_of(f"record: {{region: {{{axis}: [0.5, 1]}}}}")
    rows, columns = regions.window(case, (9, 5))
    expected = {"x": (slice(4, 9), slice(0, 5)), "y": (slice(0, 9), slice(2, 5))}
    assert (rows, columns) == expected[axis]


def test_the_flow_through_the_widest_square_of_a_period_is_that_of_the_period():
    record = "record: {transport: {transmissivity: every-step}, region_widths: {transmissivity: every-step}}"
    found = answer("surface: {D: 2.3, m: 4, seeds: [1], sides: periodic}\nsweep: {contact_areas: 0.2}\n" + record)
    widest = found.transmissivity_within.sel(region_width=1.0)
    assert (found.transmissivity > 0.0).all()
    assert_allclose(widest.transpose(*found.transmissivity.dims), found.transmissivity, rtol=1e-4)


def test_a_region_that_is_the_whole_period_is_that_period():
    text = "surface: {D: 2.3, m: 4, seeds: [1], sides: periodic}\nsweep: {steps: 1, to: {indentation: 2}}\nrecord: {"
    transport = "psd: true, texture: true, transport: {percolation: every-step, transmissivity: every-step}}"
    found = [answer(f"{text}{region}{transport}") for region in ("", "region: {x: [0, 1]}, ")]
    for name in found[0].data_vars:
        if not name.endswith("_time"):
            assert_allclose(found[1][name], found[0][name], err_msg=name)


def test_fluxes_outside_the_region_are_missing():
    found = run_case(case_of("sweep: {steps: 1}\nrecord: {region: interior, transport: {flux_at: last}}"))
    known = found.flux.sel(axis="y").squeeze().notnull().values
    assert known[4:13, 4:13].all()
    assert known.sum() == 81


@pytest.mark.parametrize(
    ("surface", "recorded", "key"),
    [
        ("{D: 2.2, m: [2, 5]}", "{region: {x: [0.51, 0.6]}}", "record.region"),  # of the coarse ones alone
        ("{D: 2.2, m: 4}", "{region_widths: {shares: [1, 1e-300]}}", "record.region_widths.shares"),
        ("{file: z.npy, L: 4}", "{region: {y: [0.4, 0.6]}}", "record.region"),
    ],
)
def test_a_study_of_a_region_without_elements_is_refused_before_it_runs(surface, recorded, key, tmp_path):
    np.save(tmp_path / "z.npy", np.random.default_rng(0).random((9, 4)))
    study = loads(f"surface: {surface}\nrecord: {recorded}", tmp_path / "s.yaml")
    with pytest.raises(StudyError, match="fewer than 2 × 2") as refused:
        execution.run(study, out=tmp_path / "run", jobs=1)
    assert {problem.key for problem in refused.value.problems} == {key}
    assert not (tmp_path / "run").exists()
