"""Transport in studies: what is asked for, at its steps, of its region; and sweeps that end where the void closes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.one_case import run_case
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import solve
from roughvol.contact.search import first_indentation
from roughvol.gap import clusters, transport
from roughvol.observables import levels, void
from roughvol.observables.variables import AXES
from roughvol.study import loads
from tests.observables.kit import case_of, states_of

ALL = """
sweep: {steps: 8, to: percolation}
record:
  transport:
    percolation: every-step
    constriction: every-step
    transmissivity: {step: [2, 5], contact_area: [0.1]}
    diffusivity: last
    estimates: {step: 3}
    flux_at: {step: 5}
"""


@pytest.fixture(scope="module")
def case():
    return case_of(ALL)


@pytest.fixture(scope="module")
def result(case):
    return run_case(case).squeeze(("D", "m", "seed"))


@pytest.fixture(scope="module")
def states(case, result):
    return states_of(case, result.indentation.values.ravel())


def test_every_step_holds_what_its_gap_says(result, states):
    for step, state in enumerate(states):
        found = clusters.connectivity(state.gap(), state.contact())
        stored = result.isel(step=step)
        assert stored.percolates.values.tolist() == [found.percolates_x, found.percolates_y]
        assert float(stored.connected_volume_fraction + stored.trapped_volume_fraction) == pytest.approx(1, abs=1e-14)
        assert stored.contact_clusters == found.contact_clusters.size
        assert stored.trapped_pockets_by_size.sum() == stored.trapped_pockets
        for axis, name in enumerate(AXES):
            narrowest = transport.constriction(state.gap(), axis)
            assert_allclose(stored["critical_gap"].sel(axis=name), narrowest.gap, rtol=1e-9)
            if narrowest.element:
                assert_allclose(stored["critical_position"].sel(axis=name) * 16, narrowest.element, rtol=1e-15)


def test_sizes_are_counted_by_powers_of_two(result, states):
    sizes = clusters.connectivity(states[5].gap(), states[5].contact()).contact_clusters
    counted = result.contact_clusters_by_size.isel(step=5)
    assert_array_equal(counted["size"], [1, 2, 4, 8, 16, 32, 64, 128, 256])
    for size, count in zip(counted["size"].values, counted.values, strict=True):
        assert count == np.count_nonzero((sizes >= size) & (sizes < 2 * size))


def test_a_quantity_is_computed_at_its_states_and_nowhere_else(result, states):
    first = next(n for n, state in enumerate(states) if state.contact_area_fraction >= 0.1)
    asked = {
        "transmissivity": {1, 4, first},
        "diffusivity": {7},
        "estimate_medium_transmissivity": {2},
        "percolates": set(range(8)),
    }
    for name, steps in asked.items():
        assert set(np.nonzero(result[name].notnull().values)[0]) == steps
    assert float(result.transmissivity_conservation_error.max()) < 1e-10
    flux = np.hypot(*transport.conduction(states[4].gap(), 0).flux)
    assert_allclose(result.flux.sel(axis="x").squeeze("flux_at"), flux, rtol=1e-8)


@pytest.mark.parametrize("shape", [(8, 8), (9, 9), (9, 12), (1, 1)])
def test_quadrants_of_a_mirrored_map_are_the_mirrored_quadrants(shape):
    gap = np.random.default_rng(0).random(shape)
    turned = [part[::-1, ::-1] for part in void.quarters(gap)]
    for part, other in zip(void.quarters(gap[::-1, ::-1]), reversed(turned), strict=True):
        assert_array_equal(part, other)


# Sweeps to the end of percolation


@pytest.mark.parametrize("axes", ["x", "y", "both"])
def test_a_sweep_to_percolation_ends_where_the_void_closes(axes):
    case = case_of(f"sweep: {{steps: 4, to: {{percolation: {axes}}}}}")
    surface = surface_of(case)
    half_space = HalfSpace(surface.shape)
    end = first_indentation(surface, half_space, levels.end_of(case) or (lambda _: False))

    def open_along(indentation):
        clear = solve(surface, half_space, indentation).gap() > 0.0
        return {name for axis, name in enumerate(AXES) if clusters.percolates(clear, axis)}

    closing = set(axes) if axes != "both" else {"x", "y"}
    assert not open_along(end) & closing
    assert open_along(end * (1 - 2e-4)) & closing
    assert float(run_case(case).indentation.max()) == end


@pytest.mark.slow
def test_the_corrected_medium_is_nearer_to_the_flow_than_that_of_bruggeman_beyond_a_tenth_of_contact():
    text = (
        "surface: {D: [2.2, 2.4], m: 6, seeds: 2}\nsweep: {steps: 12, to: percolation}\nsolver: {accuracy: draft}\n"
        "record: {region: interior, transport: {transmissivity: every-step, estimates: every-step}}"
    )
    off = {"medium": [], "corrected": []}
    for case in loads(text).cases():
        run = run_case(case).squeeze()
        for axis in "xy":
            flow = run["transmissivity"].sel(axis=axis).values
            both = (flow > 0.0) & (run.estimate_corrected_transmissivity.values > 0.0)
            both &= run.contact_area_fraction.values > 0.1
            for name, errors in off.items():
                errors += list(np.abs(np.log(run[f"estimate_{name}_transmissivity"].values[both] / flow[both])))
    assert len(off["medium"]) > 20
    assert np.median(off["corrected"]) < 0.8 * np.median(off["medium"])


def test_the_flow_of_a_gas_starts_from_the_state_before_and_that_of_its_flux_from_none(monkeypatch):
    starts, flows, solved = [], [], void.conduction_of_gas

    def recorded(*of, start, **options):
        starts.append(start)
        flows.append(solved(*of, start=start, **options))
        return flows[-1]

    monkeypatch.setattr(void, "conduction_of_gas", recorded)
    run_case(
        case_of(
            "sweep: {steps: 3, to: {indentation: 2}}\nfluid: {gas: helium, inlet: 1 bar, outlet: 0 bar}\n"
            "record: {transport: {gas_flow: every-step, flux_at: {step: 2}}}",
            "surface: {D: 2.4, m: 4, seeds: [7], L: 3.0 um}\n",
        )
    )
    x = [start if start is None else [flow.pressure is start for flow in flows[::2]] for start in starts[::2]]
    assert x == [None, [True, False, False, False], None, [False, True, False, False]]
