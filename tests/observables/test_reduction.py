"""What is kept of a sweep: the right state for every level, and numbers that belong to that state."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from roughvol.campaign.case_surface import surface_of
from roughvol.observables import reduction
from tests.observables.kit import case_of, reduced, states_of

STEPS = 8
STUDY = """
sweep: {steps: 8, to: {indentation: 4.0}}
record:
  heights: true
  fields_at: {step: [3, 8], contact_area: [0.01], separation: [-50]}
  box_counting: {at: {indentation: 2.0}, thresholds: [0, 0.5, 1]}
  volume_density: {bins: 7, at: last}
"""


@pytest.fixture(scope="module")
def case():
    return case_of(STUDY)


@pytest.fixture(scope="module")
def contacts(case):
    return states_of(case, np.arange(1, STEPS + 1) / 2)


@pytest.fixture(scope="module")
def values(case, contacts):
    return reduced(case, contacts)


def test_a_level_is_the_first_state_that_reaches_it(values, contacts):
    areas = np.array([contact.contact_area_fraction for contact in contacts])
    first = 1 + int(np.argmax(areas >= 0.01))
    found = dict(zip(values["field_at"], values["field_at_step"], strict=True))
    assert found == {"step=3": 3, "step=8": 8, "contact_area=0.01": first, "separation=-50": -1}
    assert values["box_at_step"] == [4]
    assert values["density_at_step"] == [STEPS]


def test_density_is_one_in_all_and_its_mean_is_the_free_volume(values, contacts, case):
    surface, last = surface_of(case), contacts[-1]
    density, edges = values["volume_density"][0], values["volume_density_edges"][0]
    assert_allclose(np.sum(density * np.diff(edges)), 1.0, rtol=1e-12)
    # Σ v over the elements not in contact, from the bins, to half a bin; the rest has none
    open_share = 1.0 - last.contact_area_fraction
    mean_volume = np.sum(density * np.diff(edges) * 0.5 * (edges[1:] + edges[:-1])) * open_share
    exact = last.free_volume * surface.Sq * surface.spacing**2
    assert abs(mean_volume - exact) <= 0.5 * (edges[1] - edges[0]) * open_share


def test_box_counts_run_from_the_contact_to_the_whole(values, contacts):
    counts, state = values["box_count"][0], contacts[3]
    assert_array_equal(values["r"], [1, 2, 4, 8, 16])
    assert counts[0, 0] == np.count_nonzero(state.contact()[:-1, :-1])
    assert_array_equal(counts[-1], 4.0 ** np.arange(4, -1, -1))
    assert_allclose(values["local_dimension"][0, -1], 2.0, rtol=1e-14)
    assert np.all(np.diff(counts, axis=0) >= 0)


def test_nothing_that_was_not_asked_for_is_kept(contacts):
    case = case_of("sweep: {steps: 8}")
    kept, of_surface = set(reduced(case, contacts)), set(reduction.of_surface(case, surface_of(case)))
    assert kept == {*reduction.OF_STATE, *reduction.OF_SOLVER, "step", "central_pressure_ratio"}
    assert of_surface == {"Sq", "Sdq", "z_max", "hurst_measured", "nodes_x", "nodes_y"}
    case = case_of("sweep: {steps: 8}\nrecord: {transport: {constriction: last}}")
    more = {"axis", "coordinate", "transport_time", "observable", "observable_time"}
    assert set(reduced(case, contacts)) - kept == more | {"critical_gap", "critical_position"}
