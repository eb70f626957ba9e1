"""Contact with a largest pressure: against a dense oracle, and the laws of loading, unloading and reloading."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import DenseHalfSpace

from roughvol.contact.bracket import Target
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Trials, solve, sweep
from roughvol.contact.options import Tuning
from roughvol.contact.search import first_indentation, state_crossing
from roughvol.errors import ContactError
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface

RTOL = 1e-9


def gauss_seidel(matrix, b, limit):
    """The pressures 0 ≤ q ≤ limit of K q - b ⊥ q, one element at a time until none changes."""
    q = np.zeros(b.size)
    for _ in range(20_000):
        before = q.copy()
        for i in range(b.size):
            q[i] = min(max(q[i] + (b[i] - matrix[i] @ q) / matrix[i, i], 0.0), limit)
        if np.abs(q - before).max() < 1e-13:
            return q
    raise AssertionError


def stepwise(surface, indentations, hardness, kernel="love"):
    """p*, A*, V* and the mean plastic displacement of a path; the plastic displacement grows at every step."""
    shape = surface.shape
    matrix = DenseHalfSpace(shape, kernel).matrix
    factor = np.pi * (shape[0] - 1)
    h = ((surface.heights - surface.heights.max()) / surface.Sq).ravel()
    plastic = np.zeros(h.size)
    for indentation in indentations:
        b = h + indentation - plastic
        q = gauss_seidel(matrix, b, hardness / factor)
        w = matrix @ q - b
        plastic += np.where(q >= hardness / factor, np.maximum(-w, 0.0), 0.0)
        yield factor * q.mean(), (q > 0.0).mean(), np.maximum(w, 0.0).mean(), plastic.mean()


def rough(seed, shape=(6, 7)):
    return Surface(np.random.default_rng(seed).normal(size=shape), 1.0)


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    hardness=st.floats(0.5, 60.0),
    path=st.lists(st.floats(0.2, 4.0), min_size=2, max_size=5, unique=True),
    dense=st.sampled_from([0, 240]),
    kernel=st.sampled_from(["love", "punch"]),
)
def test_paths_are_those_of_steps_with_dense_matrices(seed, hardness, path, dense, kernel):
    surface = rough(seed)
    tuning = Tuning(dense_up_to=dense)
    contacts = sweep(surface, HalfSpace(surface.shape, kernel), path, rtol=RTOL, hardness=hardness, tuning=tuning)
    steps = stepwise(surface, path, hardness, kernel)
    for contact, (pressure, area, volume, plastic) in zip(contacts, steps, strict=True):
        assert contact.mean_pressure == pytest.approx(pressure, abs=1e-6)
        assert contact.free_volume == pytest.approx(volume, abs=contact.residual + 1e-10)
        assert contact.plastic_volume == pytest.approx(plastic, abs=contact.residual + 1e-10)
        assert abs(contact.contact_area_fraction - area) <= 1.01 / surface.heights.size  # one element on the brink


UNDONE = [*np.linspace(0.3, 3.0, 6), *np.linspace(2.5, 1.0, 3), *np.linspace(1.5, 3.5, 4)]


@pytest.fixture(scope="module")
def noise():
    """A surface on which overlaps fall within a leg with the kernel of the punch, which has no M-matrix."""
    generator = np.random.default_rng(0)
    for _ in range(14):
        heights = generator.normal(size=(6, 7))
        hardness = float(np.exp(generator.uniform(np.log(0.5), np.log(60))))
    return Surface(heights, 1.0), hardness


def test_plastic_displacement_stays_without_an_m_matrix(noise):
    surface, hardness = noise
    space = HalfSpace(surface.shape, "punch")
    contacts = list(sweep(surface, space, UNDONE, rtol=RTOL, hardness=hardness))
    for before, after in itertools.pairwise(contacts):
        fallen = before.plastic_displacement() - after.plastic_displacement()
        assert fallen.max() <= before.residual + after.residual + 1e-14
    for contact, (pressure, _, volume, plastic) in zip(
        contacts, stepwise(surface, UNDONE, hardness, "punch"), strict=True
    ):
        assert contact.mean_pressure == pytest.approx(pressure, abs=1e-9)
        assert contact.free_volume == pytest.approx(volume, abs=contact.residual + 1e-11)
        assert contact.plastic_volume == pytest.approx(plastic, abs=contact.residual + 1e-11)


@pytest.mark.parametrize("kept", range(1, len(UNDONE)))
def test_a_path_with_overlaps_undone_goes_on_with_the_same_bits(noise, kept):
    surface, hardness = noise
    space = HalfSpace(surface.shape, "punch")
    whole = list(sweep(surface, space, UNDONE, hardness=hardness))
    states = [contact.state() for contact in whole[:kept]][-2:]
    rest = sweep(surface, space, UNDONE[kept:], hardness=hardness, resume=states)
    for one, other in zip(whole[kept:], rest, strict=True):
        assert np.array_equal(one.pressure(), other.pressure())
        assert (one.free_volume, one.residual) == (other.free_volume, other.residual)


@pytest.fixture(scope="module")
def surface():
    return random_midpoint_displacement(2.3, 5, side=100.0, seed=3)


@pytest.fixture(scope="module")
def half_space(surface):
    return HalfSpace(surface.shape)


UP = np.linspace(0.0, 2.6, 9)[1:]
DOWN = UP[-2::-1]


def test_a_hardness_that_no_pressure_reaches_changes_no_bit(surface, half_space):
    for soft, hard in zip(sweep(surface, half_space, UP), sweep(surface, half_space, UP, hardness=1e9), strict=True):
        assert np.array_equal(soft.pressure(), hard.pressure())
        assert (soft.free_volume, soft.convolutions, soft.residual) == (
            hard.free_volume,
            hard.convolutions,
            hard.residual,
        )
        assert hard.plastic_volume == hard.plastic_area_fraction == 0.0


def test_without_hardness_the_contact_is_the_bearing_area(surface, half_space):
    for contact in sweep(surface, half_space, UP, hardness=1e-9):
        bearing = surface.heights > surface.heights.max() - contact.indentation * surface.Sq
        assert np.array_equal(contact.contact(), bearing)
        assert contact.plastic_volume == pytest.approx(
            np.where(bearing, contact.indentation + (surface.heights - surface.heights.max()) / surface.Sq, 0.0).mean()
        )
        assert contact.mean_pressure == pytest.approx(1e-9 * bearing.mean())


@pytest.mark.parametrize("hardness", [None, 40.0, 8.0, 2.0])
def test_elastic_contact_retraces_and_yielded_contact_unloads_below(surface, half_space, hardness):
    contacts = list(sweep(surface, half_space, [*UP, *DOWN], rtol=RTOL, hardness=hardness))
    rising, falling = contacts[: len(UP) - 1][::-1], contacts[len(UP) :]
    yielded = contacts[len(UP) - 1].plastic_volume > 0.0
    for up, down in zip(rising, falling, strict=True):
        if not yielded:
            assert down.mean_pressure == pytest.approx(up.mean_pressure, rel=1e-6)
            assert down.contact_area_fraction == up.contact_area_fraction
        else:
            assert down.mean_pressure <= up.mean_pressure + 1e-6
        assert down.plastic_volume == pytest.approx(contacts[len(UP) - 1].plastic_volume, abs=1e-8)


@pytest.mark.parametrize("hardness", [40.0, 8.0, 2.0])
def test_reloading_to_the_largest_indentation_returns_to_the_state(surface, half_space, hardness):
    turn = len(UP) - 1
    contacts = list(sweep(surface, half_space, [*UP, *DOWN, *UP[1:]], rtol=RTOL, hardness=hardness))
    for name in ("mean_pressure", "free_volume", "plastic_volume"):
        assert getattr(contacts[-1], name) == pytest.approx(getattr(contacts[turn], name), abs=1e-7)
    assert np.abs(contacts[-1].pressure() - contacts[turn].pressure()).max() < 1e-5 * hardness


def test_reloading_beyond_the_largest_indentation_is_loading_of_the_virgin_surface(surface, half_space):
    *_, path = sweep(surface, half_space, [1.0, 2.0, 1.4, 2.6], rtol=RTOL, hardness=5.0)
    direct = solve(surface, half_space, 2.6, rtol=RTOL, hardness=5.0)
    assert path.mean_pressure == pytest.approx(direct.mean_pressure, rel=1e-7)
    assert np.abs(path.plastic_displacement() - direct.plastic_displacement()).max() < 4 * RTOL


def test_the_work_of_a_closed_loop_is_not_negative(surface, half_space):
    fine = np.linspace(0.0, 2.6, 41)
    contacts = list(sweep(surface, half_space, [*fine[1:], *fine[-2::-1]], rtol=RTOL, hardness=5.0))
    path = np.array([0.0, *fine[1:], *fine[-2::-1]])
    force = np.array([0.0, *(contact.mean_pressure for contact in contacts)])
    loop = np.trapezoid(force, path)
    assert loop > 0.1 * np.trapezoid(force[:41], fine)


def pressure(value):
    return Target(lambda contact: contact.mean_pressure, value)


def test_unloading_to_no_pressure_leaves_a_surface_that_touches_nothing(surface, half_space):
    *_, top = sweep(surface, half_space, UP, rtol=RTOL, hardness=5.0)
    trials = Trials(surface, half_space, rtol=RTOL, hardness=5.0, after=top.state(), turned=True)
    state = state_crossing(trials, pressure(0.0), trials.known(top.state(), top.residual))
    assert state.mean_pressure == state.contact_area_fraction == 0.0
    left = (surface.heights - surface.heights.max()) / surface.Sq - top.plastic_displacement()
    assert left.max() + state.indentation == pytest.approx(0.0, abs=1e-12)
    assert state.gap().min() >= 0.0
    assert state.indentation > 0.5
    *_, unloaded = sweep(surface, half_space, [*UP, state.indentation], rtol=RTOL, hardness=5.0)
    assert unloaded.mean_pressure == 0.0


@pytest.mark.parametrize("hardness", [None, 5.0])
@pytest.mark.parametrize("value", [0.1, 0.6])
def test_a_pressure_is_found_on_the_way_down_and_up_again(surface, half_space, hardness, value):
    *_, top = sweep(surface, half_space, UP, rtol=1e-8, hardness=hardness)
    trials = Trials(surface, half_space, rtol=1e-8, hardness=hardness, after=top.state(), turned=True)
    start = trials.known(top.state(), top.residual)
    state = state_crossing(trials, pressure(value * top.mean_pressure), start)
    assert state.mean_pressure == pytest.approx(value * top.mean_pressure, rel=1e-4)
    again = state_crossing(trials, pressure(0.9 * top.mean_pressure), state)
    assert again.mean_pressure == pytest.approx(0.9 * top.mean_pressure, rel=1e-4)
    assert again.indentation > state.indentation


@pytest.mark.parametrize("start", ["touch", "unloaded"])
def test_the_first_state_of_a_condition_that_stays_true_is_found(surface, half_space, start):
    def closed(contact):
        return float(contact.contact_area_fraction > 0.25)

    first = first_indentation(surface, half_space, lambda contact: closed(contact) > 0.0, accuracy=1e-6)
    trials = Trials(surface, half_space, hardness=1e6)
    begin = trials.untouched
    if start == "unloaded":
        begin = list(sweep(surface, half_space, [0.5, 0.3], hardness=1e6))[-1]
    state = state_crossing(trials, Target(closed, 1.0, elements=True), begin)
    assert state.indentation == pytest.approx(first, rel=1e-4)
    again = solve(surface, half_space, state.indentation)
    assert closed(again) == 1.0


def test_a_pressure_above_the_hardness_is_refused(surface, half_space):
    trials = Trials(surface, half_space, hardness=2.0)
    with pytest.raises(ContactError, match="not reached"):
        state_crossing(trials, pressure(2.1), trials.untouched)


@pytest.mark.parametrize("kept", range(1, len(UP) + len(DOWN)))
def test_an_interrupted_path_goes_on_with_the_same_bits(surface, half_space, kept):
    path = [*UP, *DOWN, 2.0, 2.7]
    whole = list(sweep(surface, half_space, path, hardness=5.0))
    states = [contact.state() for contact in whole[:kept]][-2:]
    rest = sweep(surface, half_space, path[kept:], hardness=5.0, resume=states)
    for one, other in zip(whole[kept:], rest, strict=True):
        assert np.array_equal(one.pressure(), other.pressure())
        assert (one.free_volume, one.residual, one.plastic_volume) == (
            other.free_volume,
            other.residual,
            other.plastic_volume,
        )


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), hardness=st.floats(0.5, 30.0))
def test_loading_keeps_contact_and_yield_and_the_free_volume_has_its_bound(seed, hardness):
    surface = rough(seed, (9, 9))
    half_space = HalfSpace(surface.shape)
    path = np.linspace(0.0, 3.0, 7)[1:]
    exact = list(sweep(surface, half_space, path, rtol=1e-11, hardness=hardness))
    for before, after in itertools.pairwise(exact):
        assert not (before.contact() & ~after.contact()).any()
        assert ((after.plastic_displacement() - before.plastic_displacement()) >= -1e-10).all()
        assert (after.pressure() - before.pressure() >= -1e-7).all()
    for rough_one, fine in zip(sweep(surface, half_space, path, rtol=1e-3, hardness=hardness), exact, strict=True):
        assert abs(rough_one.free_volume - fine.free_volume) <= rough_one.residual + 1e-10
        assert abs(rough_one.plastic_volume - fine.plastic_volume) <= rough_one.residual + 1e-10
        bound = rough_one.mean_pressure_bound * rough_one.mean_pressure
        assert abs(rough_one.mean_pressure - fine.mean_pressure) <= bound + 1e-9


@pytest.mark.parametrize("hardness", [0.0, -1.0, float("nan")])
def test_a_hardness_out_of_range_is_refused(surface, half_space, hardness):
    with pytest.raises(ContactError, match="hardness"):
        solve(surface, half_space, 1.0, hardness=hardness)


def test_the_algorithm_of_the_paper_takes_no_hardness(surface, half_space):
    with pytest.raises(ContactError, match="'paper' has no hardness"):
        solve(surface, half_space, 1.0, hardness=1.0, method="paper")


REFERENCE = Path(__file__).parents[3] / "shared" / "reference" / "plastic_65.npz"


@pytest.mark.skipif(not REFERENCE.is_file(), reason="solved cases of other codes are not part of the repository")
@pytest.mark.parametrize("hardness", [np.inf, 0.2, 0.05])
def test_paths_solved_by_another_code_are_met(hardness):
    with np.load(REFERENCE) as case:
        surface, rows = Surface(case["z"], float(case["dx"])), case["rows"]
    rows = rows[rows[:, 0] == hardness]
    side, height = surface.side, surface.Sq
    limit = None if np.isinf(hardness) else hardness * side / height
    contacts = sweep(surface, HalfSpace(surface.shape), rows[:, 2], rtol=1e-10, hardness=limit)
    for contact, (*_, pressure, area, plastic, gap, largest) in zip(contacts, rows, strict=True):
        assert contact.mean_pressure * height / side == pytest.approx(pressure, rel=1e-7)
        assert contact.contact_area_fraction == pytest.approx(area, rel=1e-10)
        assert contact.plastic_volume * height == pytest.approx(-plastic, rel=1e-7, abs=1e-11)
        assert contact.free_volume * height == pytest.approx(gap, rel=1e-7)
        assert contact.pressure().max() * height / side == pytest.approx(largest, rel=1e-7)
