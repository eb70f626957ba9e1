"""Fluid pressure that lifts a seal: laws of the coupled state, and the wavy channel."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Trials
from roughvol.contact.search import state_under
from roughvol.errors import ContactError, ConvergenceError
from roughvol.gap.clusters import percolates
from roughvol.gap.fluid_pressure import FluidField
from roughvol.gap.transport import conduction
from roughvol.observables import coupling
from roughvol.observables.coupling import Coupling
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface
from tests.bench.wavy_channel import Channel
from tests.observables.kit import answer

LOAD = 1.0


def joint(m, seed, load=LOAD, *, periodic=True):
    """Return a surface, its half space, and its dry state under a load."""
    surface = random_midpoint_displacement(2.2, m, seed=seed, periodic=periodic)
    half_space = HalfSpace(surface.shape, sides=surface.sides)
    return surface, half_space, state_under(Trials(surface, half_space, rtol=1e-9), load, 1.0)


@pytest.fixture(scope="module")
def pressed():
    return joint(4, 3)


def _flow(gap):
    return conduction(gap, 0, periodic=True).coefficient * float(gap.mean()) ** 3


# the pressure of the fluid


def test_a_dead_end_has_the_pressure_of_its_reservoir_and_a_pocket_one_between():
    gap = np.zeros((11, 11))
    gap[:, 0] = 0.01  # the way
    gap[:4, 3] = gap[8:, 3] = 1.0  # joined to inlet or outlet
    gap[5, 7] = 1.0  # a pocket
    pressure = FluidField(gap, 0).pressure
    assert_allclose(pressure[:4, 3], 1.0, atol=1e-3)
    assert_allclose(pressure[8:, 3], 0.0, atol=1e-3)
    assert 0.1 < pressure[5, 7] < 0.9


# contact and flow together


def test_the_load_is_kept_and_pressures_balance(pressed):
    surface, half_space, dry = pressed
    both = Coupling(surface, half_space, 0, 0.5)
    state = both.solve(LOAD, dry)
    assert_allclose(state.pressure.mean(), LOAD, rtol=1e-8)
    assert_allclose(state.fluid, both.fluid_in(state.gap), atol=0.5 * coupling.ACCURACY)
    open_ = state.gap > 0.0
    assert_allclose(state.pressure[open_], state.fluid[open_])
    assert np.all(state.pressure >= state.fluid - 1e-12)
    # the gap is that of an elastic half space under these pressures
    q = state.pressure / (np.pi * surface.intervals[0])
    u = half_space.displacement(q)
    misfit = state.gap - u + surface.heights / surface.unit
    assert np.ptp(misfit) < 1e-6
    assert 0.0 < state.fluid_share < 0.5
    assert (state.gap == 0.0).mean() < dry.contact_area_fraction
    assert _flow(state.gap) > _flow(dry.gap())


@pytest.mark.parametrize("stiffness", [None, 1.0])
def test_the_contact_under_a_fluid_pressure_is_that_of_the_lowered_surface(pressed, stiffness):
    surface, half_space, dry = pressed
    both = Coupling(surface, half_space, 0, 0.5)
    fluid = both.fluid_in(dry.gap())
    lift = half_space.displacement(fluid / (np.pi * surface.intervals[0])) * surface.unit
    lowered = Surface(surface.heights - lift, surface.spacing, sides=surface.sides)
    ratio = lowered.unit / surface.unit
    cold = state_under(Trials(lowered, half_space, rtol=1e-11), (LOAD - float(fluid.mean())) / ratio, 1.0)
    without = both.without_fluid(dry)
    first = both.under(0.5 * fluid, LOAD, without)
    for near in (without, first):
        state = both.under(fluid, LOAD, near, stiffness)  # a wrong stiffness costs solves alone
        assert_allclose(state.gap, cold.gap() * ratio, atol=1e-8)
        assert_allclose(state.pressure, fluid + cold.pressure() * ratio, atol=1e-5)
        assert state.contact.free_volume == pytest.approx(float(state.gap.mean()), rel=1e-9)


def test_one_way_is_the_first_order_of_the_coupling(pressed):
    surface, half_space, dry = pressed
    dry_gap = float(dry.gap().mean())
    apart = []
    for inlet in (0.02, 0.01):
        both = Coupling(surface, half_space, 0, inlet)
        one, full = (float(state.gap.mean()) - dry_gap for state in (both.one_way(LOAD, dry), both.solve(LOAD, dry)))
        assert one > 0.0
        apart.append((full - one) / one)
    assert apart[1] < 0.05
    assert_allclose(apart[1] / apart[0], 0.5, rtol=0.3)  # the difference is of second order


def test_the_same_pressure_on_both_sides_only_adds_to_the_load(pressed):
    surface, half_space, dry = pressed
    one = Coupling(surface, half_space, 0, 0.3, 0.0).solve(LOAD, dry)
    more = Coupling(surface, half_space, 0, 0.8, 0.5).solve(LOAD + 0.5, dry)
    assert_allclose(more.gap, one.gap, atol=2e-5)


def test_a_fluid_that_carries_the_whole_load_is_refused(pressed):
    surface, half_space, dry = pressed
    with pytest.raises(ContactError, match="the joint opens"):
        Coupling(surface, half_space, 0, 3.0).solve(LOAD, dry)
    for coupled in (Coupling.solve, Coupling.one_way):
        with pytest.raises(ContactError, match=r"the joint opens: it is pressed to p\* = 0\. Allowed: a load above 0"):
            coupled(Coupling(surface, half_space, 0, 0.1), 0.0, dry)


@pytest.mark.parametrize(
    ("periodic", "seed", "load"),
    [(True, 1, 1.0), (False, 2, 1.0), *(pytest.param(True, seed, 4.0, marks=pytest.mark.slow) for seed in (1, 2))],
)
def test_a_joint_pressed_first_and_pressurised_then_has_a_state(periodic, seed, load):
    surface, half_space, dry = joint(4, seed, load, periodic=periodic)
    for axis, share in ((0, 0.5), (1, 0.8)):
        coupled = Coupling(surface, half_space, axis, share * load)
        state = coupled.solve(load, dry)
        assert np.abs(coupled.fluid_in(state.gap) - state.fluid).max() <= 2e-6 * share * load
        assert_allclose(state.pressure.mean(), load, rtol=1e-8)
        assert state.gap.mean() > dry.gap().mean()
        assert np.all(state.pressure[state.gap == 0.0] > -1e-6 * load)
        assert state.fluid.mean() < load


def test_an_inlet_above_the_load_may_leave_a_joint_in_contact():
    surface, half_space, dry = joint(4, 1, 4.0, periodic=False)
    coupled = Coupling(surface, half_space, 0, 4.8)
    state = coupled.solve(4.0, dry)  # an iterate of a plain fixed point carries the whole load
    assert state.fluid.mean() < 4.0
    assert 0.0 < (state.gap == 0.0).mean() < dry.contact_area_fraction
    assert np.abs(coupled.fluid_in(state.gap) - state.fluid).max() <= 2e-6 * 4.8


def test_a_step_solves_the_linear_equations_for_every_drag():
    surface, half_space, dry = joint(4, 1)
    coupled = Coupling(surface, half_space, 0, 0.5 * LOAD)
    near = coupled.without_fluid(dry)
    begin = coupling.Round(coupled, coupled.under(coupled.fluid_in(near.gap), LOAD, near), coupling.LEAST)
    found = []
    for drag in (0.0, 4.0, 1.0, 0.0):
        change, left = begin.step(drag)
        of_flow = begin._change(change.ravel()[begin._open]).reshape(change.shape)
        wrong = begin.left - (1.0 + drag) * change + of_flow
        assert np.linalg.norm(wrong) <= 2.0 * coupling.LINEAR * begin.norm
        assert np.linalg.norm(left - (begin.left - change + of_flow)) <= 2.0 * coupling.LINEAR * begin.norm
        found.append(change)
    assert_array_equal(found[0], found[-1])


def test_what_does_not_settle_is_an_error(monkeypatch):
    surface, half_space, dry = joint(3, 3)
    monkeypatch.setattr(coupling, "ROUNDS", 1)
    monkeypatch.setattr(coupling, "SOFTER", (0.1,))
    with pytest.raises(ConvergenceError, match="not shown that the joint opens"):
        Coupling(surface, half_space, 0, 0.5).solve(LOAD, dry)


def test_a_softened_joint_settles_in_few_rounds_in_the_state_that_many_rounds_find(monkeypatch):
    surface, half_space, dry = joint(4, 2, 4.0)
    assert not percolates(dry.gap() > 0.0, 0, periodic=True)
    coupled = Coupling(surface, half_space, 0, 2.5)
    fluid = coupled.fluid_in(dry.gap())
    state = coupled._softened(fluid, 4.0, coupled.without_fluid(dry))
    assert state.rounds <= 60
    monkeypatch.setattr(coupling, "_on_line", lambda known, at: known[-1][1])  # each state from the last alone
    slow = coupled._softened(fluid, 4.0, coupled.without_fluid(dry))
    assert slow.rounds > 100
    assert_allclose(state.gap, slow.gap, atol=1e-6)


def test_no_rise_is_tried_twice_from_a_state(monkeypatch):
    surface, half_space, dry = joint(3, 3)
    tried = []

    def settle(at, fluid, load, near):
        tried.append((at.inlet, load))
        raise ConvergenceError("no state", indentation=1.0, iterations=1, residual=1.0)

    monkeypatch.setattr(coupling, "RISES", tuple((rise, settle) for rise in (1.0, 0.5, 0.25)))
    with pytest.raises(ConvergenceError, match="no state"):
        Coupling(surface, half_space, 0, 0.1).solve(LOAD, dry)
    assert tried == [(0.1, LOAD), (0.0625, LOAD)]


# the wavy channel of Shvarts & Yastrebov, Tribol. Int. 126 (2018) 116: a sine across, flow along


@pytest.fixture(scope="module")
def channel():
    return Channel(32, 8)


def test_a_dry_channel_closes_at_the_pressure_of_westergaard(channel):
    trials = Trials(channel.surface, channel.half_space, rtol=1e-9)
    for load, open_ in ((0.99, True), (1.01, False)):
        gap = state_under(trials, load * channel.closed, channel.near.approach).gap()
        assert percolates(gap > 0.0, 0, periodic=True) is open_


@pytest.mark.slow
def test_the_closing_load_is_affine_in_the_inlet_pressure(channel):
    inlets = np.array([0.1, 0.2, 0.4])
    closing = np.array([channel.closing(inlet) for inlet in inlets])
    slope, dry = np.polyfit(inlets, closing, 1)
    assert_allclose(closing, dry + slope * inlets, atol=0.01)
    assert_allclose(dry, 1.0, atol=0.015)
    assert 0.5 < slope < 1.0


# in a study


TEXT = """name: lift
surface: {D: 2.2, m: 4, L: 100 um, Sq: 0.5 um, seeds: 1, sides: periodic}
material: {E_star: 10 MPa}
sweep: {steps: 3, to: {pressure: 1.0}}
record:
  transport: {transmissivity: every-step}
  fluid_pressure: {inlet: 0.2 bar, at: last, fields: true}
  dimensional: {leak_rate: {pressure_drop: 0.2 bar, viscosity: 1 mPa*s}}
"""


@pytest.fixture(scope="module")
def run():
    return answer(TEXT)


def test_a_study_stores_leaks_under_pressure_with_their_unit(run):
    assert_allclose(run.fluid_at_inlet, 0.02 * 100 / (10 * 0.5), rtol=1e-12)  # P L/(E* Sq), 0.2 bar = 0.02 MPa
    last = run.isel(step=-1)
    for axis in ("x", "y"):
        dry = (last["transmissivity"].sel(axis=axis) * last.free_volume**3).item()
        assert_allclose(run["fluid_leak_dry"].sel(axis=axis).item(), dry, rtol=1e-4)
        assert run["fluid_leak"].sel(axis=axis).item() > run["fluid_leak_one_way"].sel(axis=axis).item() > dry
        rate = last["leak_rate"].sel(axis=axis).item() * run["fluid_leak"].sel(axis=axis).item() / dry
        assert_allclose(run["fluid_leak_rate"].sel(axis=axis).item(), rate, rtol=1e-6)


def test_the_lifted_gap_of_a_study_passes_its_leak(run):
    state = run
    for axis, name in enumerate("xy"):
        gap = state["fluid_gap"].sel(axis=name).transpose("x", "y").values
        assert_allclose(gap.mean(), state["fluid_free_volume"].sel(axis=name), rtol=1e-12)
        leak = conduction(gap, axis, periodic=True).coefficient * gap.mean() ** 3
        assert_allclose(leak, state["fluid_leak"].sel(axis=name))


def test_a_pressure_in_the_unit_of_p_gives_the_same_state_and_fields_are_stored_where_asked_for(run):
    text = TEXT.replace("inlet: 0.2 bar", "inlet: 0.4").replace(", fields: true", "").split("  dimensional")[0]
    again = answer(text)
    assert_allclose(again.fluid_leak, run.fluid_leak, rtol=1e-9)
    assert "fluid_gap" not in again
