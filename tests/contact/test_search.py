"""Searches for an indentation: they find the smallest one, with few solves, between bounds that hold."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from roughvol.contact.bracket import Target
from roughvol.contact.loading import Trials, solve, sweep
from roughvol.contact.search import first_indentation, indentation_for, state_crossing, state_reaching, state_under
from roughvol.errors import ContactError
from roughvol.surfaces.surface import Surface
from tests.contact import kit
from tests.refused import refusals

MEASURE = {"contact_area": "contact_area_fraction", "pressure": "mean_pressure", "free_volume": "free_volume"}


def pressure(value):
    return Target(lambda contact: contact.mean_pressure, value)


def area(value):
    return Target(lambda contact: contact.contact_area_fraction, value, elements=True)


@pytest.fixture
def solves(monkeypatch):
    """The states that searches solve."""
    found, at = [], Trials.at
    monkeypatch.setattr(Trials, "at", lambda *a, **k: found.append(at(*a, **k)) or found[-1])
    return found


# ---- answers


@pytest.mark.parametrize("elements", [2, 250, 289])
def test_indentation_for_an_area_is_the_smallest(elements):
    surface, space = kit.fractal(4), kit.half_space((17, 17))
    indentation = indentation_for(surface, space, "contact_area", elements / 289, rtol=1e-9)
    at, before = (solve(surface, space, indentation * f, rtol=1e-11).contact().sum() for f in (1.0, 1.0 - 1e-5))
    assert before < elements <= at


@kit.every_body
def test_indentation_for_a_pressure_meets_it(sides, kernel):
    surface = kit.fractal(4, sides=sides)
    space = kit.half_space(surface.shape, kernel, sides)
    for value, guess in ((1e-9, -1.0), (0.7, 30.0), (5e3, 1.0)):
        found = indentation_for(surface, space, "pressure", value, rtol=1e-10)
        assert solve(surface, space, found, rtol=1e-11).mean_pressure == pytest.approx(value, rel=2e-6)
        state = state_under(Trials(surface, space, rtol=1e-11), value, guess)
        assert state.mean_pressure == pytest.approx(value, rel=1e-9)


def test_the_state_under_a_load_does_not_depend_on_how_low_the_whole_surface_lies():
    surface, space = kit.fractal(4), kit.half_space((17, 17))
    trials = Trials(surface, space, rtol=1e-11)
    for depth in (-5.0, -0.3, 50.0):
        lowered = trials.lowered(np.full(surface.heights.size, depth))
        for value, guess in ((1e-3, -0.299), (1e-3, 2.0), (1.0, 0.001)):
            found, wanted = (state_under(at, value, guess) for at in (lowered, trials))
            assert found.approach == pytest.approx(wanted.approach, rel=1e-9)
            assert found.free_volume == pytest.approx(wanted.free_volume, rel=1e-9)


@kit.every_side
def test_search_for_a_free_volume_next_to_that_of_the_first_touch(sides):
    """0.11.1 went on to an indentation of 1e-322 where the difference was that of rounding."""
    surface = Surface(kit.self_affine((23, 31), 4.0, seed=0), 1.0, sides=sides)
    space = kit.half_space(surface.shape, sides=sides)
    most = Trials(surface, space).untouched.gap().mean()
    with pytest.raises(ContactError, match="that of the first touch"):
        indentation_for(surface, space, "free_volume", most)
    for ulps in (1, 10**6):
        value = most - ulps * np.spacing(most)
        found = indentation_for(surface, space, "free_volume", value)
        assert found >= 0.1 * (most - value)
        assert solve(surface, space, found).free_volume == pytest.approx(value, abs=2e-15)
    for value in (0.5, 0.05):
        found = indentation_for(surface, space, "free_volume", value)
        assert solve(surface, space, found).free_volume == pytest.approx(value, abs=3e-6)


@pytest.mark.parametrize(
    ("value", "rtol", "kernel"),
    [(0.05, 1e-6, "love"), (0.6, 1e-3, "love"), (1.0, 1e-6, "love"), (0.05, 1e-3, "punch"), (1.0, 1e-6, "punch")],
)
def test_a_sweep_to_the_area_reaches_it(value, rtol, kernel):
    surface = kit.fractal(4, 2.5, seed=3)
    space = kit.half_space(surface.shape, kernel)
    end = indentation_for(surface, space, "contact_area", value, rtol=rtol)
    *before, last = sweep(surface, space, end * np.arange(1, 31) / 30, rtol=rtol)
    assert last.contact_area_fraction >= value
    assert before[-1].contact_area_fraction < value
    if kernel == "love":  # nor is it reached much earlier: within the residual, the last element is on the brink
        trials = Trials(surface, space, rtol=1e-10)
        exact = trials.at(end, trials.untouched)
        assert trials.line(exact, exact)(end, 10 * rtol + 2e-6 * end).contact_area_fraction < value


def test_full_contact_is_a_target_that_takes_few_solves(solves):
    for surface in (Surface(np.zeros((17, 17)), 1.0), kit.fractal(5, 2.1)):
        solves.clear()
        indentation = indentation_for(surface, kit.half_space(surface.shape), "contact_area", 1.0)
        assert len(solves) <= 30
        *_, last = kit.swept(surface, (0.5 * indentation, indentation))
        assert last.contact_area_fraction == 1.0


def test_area_that_the_first_touch_exceeds_is_reached_at_once():
    peaks = np.full((17, 17), -1.0)
    peaks[[3, 3, 13, 13], [3, 13, 3, 13]] = 0.0
    for heights in (kit.fractal(4).heights, np.zeros((17, 17)), peaks):
        surface, space = Surface(heights, 1.0), kit.half_space((17, 17))
        before = space.convolutions
        indentation = indentation_for(surface, space, "contact_area", 1e-3)
        assert 0.0 < indentation < 1e-3
        assert solve(surface, space, indentation).contact_area_fraction >= 1e-3
        assert space.convolutions - before < 30


def odd_heights(kind, n, rng):
    x, y = np.indices((n, n))
    flat, (row, column) = np.zeros((n, n)), rng.integers(0, n, 2)
    size = 10 ** rng.uniform(-2, 1)
    if kind in ("pit", "spike"):
        flat[row, column] = size if kind == "spike" else -size
        return flat
    return {
        "tilt": rng.uniform(-1, 1) * x / n + rng.uniform(-1, 1) * y / n,
        "ramp": x / n,
        "checkers": (x + y) % 2 * 1.0,
        "levels": rng.integers(0, 2, (n, n)) * 1.0,
        "step": (x > n // 2) * 1.0,
        "noise": rng.standard_normal((n, n)),
    }[kind]


ODD = ("pit", "tilt", "ramp", "checkers", "levels", "spike", "step", "noise")


def is_met(heights, target, value, rtol, kernel):
    surface, space = Surface(heights, 1.0), kit.half_space(heights.shape, kernel)
    indentation = indentation_for(surface, space, target, value, rtol=rtol)
    found = getattr(solve(surface, space, indentation, rtol=rtol), MEASURE[target])
    if target == "contact_area":
        assert found >= value
    else:  # by the search and by the residual, which is at most a hundredth of the indentation
        noise = 4.0 * min(rtol, 0.01 * indentation) + 1e-5 * indentation
        assert abs(found - value) <= Trials(surface, space).problem.stiffest * noise


@pytest.mark.parametrize("kind", ODD)
def test_odd_surfaces_are_searched_to_the_end(kind):
    """One pit that closes late, and targets below one element or below the tolerance."""
    rng, (rtol, kernel) = kit.random(3), [(1e-3, "love"), (1e-8, "punch")][ODD.index(kind) % 2]
    for n, target, value in [(5, "contact_area", 1.0), (9, "contact_area", 1e-9), (9, "pressure", 1e-7)]:
        is_met(odd_heights(kind, n, rng), target, value, rtol, kernel)


@pytest.mark.slow
def test_six_hundred_odd_surfaces_are_searched_to_the_end():
    rng = kit.random(17)
    for trial in range(600):
        heights = odd_heights(ODD[trial % 8], int(rng.choice([5, 7, 9, 12, 17, 33])), rng)
        target = str(rng.choice(["contact_area", "contact_area", "pressure"]))
        share = float(rng.choice([1e-9, 1e-5, 1e-3, 0.01, 0.1, 0.5, 0.9, 1.0]))
        value = share if target == "contact_area" else float(10 ** rng.uniform(-9, 2))
        is_met(heights, target, value, float(rng.choice([1e-3, 1e-6, 1e-8])), str(rng.choice(["love", "punch"])))


def test_the_paper_s_method_finds_the_same():
    for target, value in (("contact_area", 0.3), ("pressure", 1.0)):
        methods = [{"method": method} for method in ("fast", "paper")]
        fast, paper = (
            indentation_for(kit.fractal(3), kit.half_space((9, 9)), target, value, **each) for each in methods
        )
        assert paper == pytest.approx(fast, rel=1e-5)


# ---- on a leg of a path


UP = tuple(np.linspace(0.0, 2.6, 7)[1:])
SURFACE, FLAT = kit.fractal(4, 2.3, 3), Surface(np.zeros((7, 7)), 1.0)


def on_the_way_back(hardness, rtol):
    top = kit.swept(SURFACE, UP, rtol=rtol, hardness=hardness)[-1]
    trials = Trials(SURFACE, kit.half_space((17, 17)), rtol=rtol, hardness=hardness, after=top.state(), turned=True)
    return top, trials, trials.known(top.state(), top.residual)


@kit.every_side
@pytest.mark.parametrize("target", [pressure(2.0), area(1.0)])
def test_a_flat_surface_that_yields_reaches_a_value(sides, target):
    surface = replace(FLAT, sides=sides)
    trials = Trials(surface, kit.half_space(surface.shape, sides=sides), hardness=10.0)
    assert target.measure(state_crossing(trials, target, trials.untouched)) == pytest.approx(target.value, rel=1e-5)


def test_unloading_to_no_pressure_leaves_a_surface_that_touches_nothing():
    top, trials, start = on_the_way_back(5.0, 1e-9)
    state = state_crossing(trials, pressure(0.0), start)
    assert state.mean_pressure == state.contact_area_fraction == 0.0
    left = (SURFACE.heights - SURFACE.heights.max()) / SURFACE.Sq - top.plastic_displacement()
    assert left.max() + state.indentation == pytest.approx(0.0, abs=1e-12)
    assert state.gap().min() >= 0.0
    assert state.indentation > 0.5
    *_, unloaded = kit.swept(SURFACE, (*UP, state.indentation), rtol=1e-9, hardness=5.0)
    assert unloaded.mean_pressure == 0.0


@pytest.mark.parametrize(("hardness", "value"), [(None, 0.6), (5.0, 0.1)])
def test_a_pressure_is_found_on_the_way_down_and_up_again(hardness, value):
    top, trials, start = on_the_way_back(hardness, 1e-8)
    state = state_crossing(trials, pressure(value * top.mean_pressure), start)
    assert state.mean_pressure == pytest.approx(value * top.mean_pressure, rel=1e-4)
    again = state_crossing(trials, pressure(0.9 * top.mean_pressure), state)
    assert again.mean_pressure == pytest.approx(0.9 * top.mean_pressure, rel=1e-4)
    assert again.indentation > state.indentation


@pytest.mark.parametrize("start", ["touch", "unloaded"])
def test_the_first_state_of_a_condition_that_stays_true_is_found(start):
    space, share = kit.half_space((17, 17)), 0.25
    first = first_indentation(SURFACE, space, lambda contact: contact.contact_area_fraction > share, accuracy=1e-6)
    trials = Trials(SURFACE, space, hardness=1e6)
    begin = trials.untouched if start == "touch" else kit.swept(SURFACE, (0.5, 0.3), hardness=1e6)[-1]
    closed = Target(lambda contact: float(contact.contact_area_fraction > share), 1.0, elements=True)
    state = state_crossing(trials, closed, begin)
    assert state.indentation == pytest.approx(first, rel=1e-4)
    assert solve(SURFACE, space, state.indentation).contact_area_fraction > share


def test_a_condition_that_always_holds_has_no_indentation():
    assert first_indentation(SURFACE, kit.half_space((17, 17)), lambda contact: True) == 0.0


@pytest.mark.parametrize(("low", "high"), [(0.0, 6.0), (0.3, 6.0), (0.3, None)])
def test_a_search_between_solved_states_finds_the_same(low, high):
    """Between a state before and a state after, after the touch alone, and from the state before alone."""
    trials, space = Trials(SURFACE, kit.half_space((17, 17)), rtol=1e-9), kit.half_space((17, 17))
    between = [trials.at(at, trials.untouched) for at in (low, high) if at]
    for target, name, value in ((area, "contact_area", 0.15), (pressure, "pressure", 0.5)):
        found = state_reaching(trials, target(value), between, below=high is None)
        assert found.approach == pytest.approx(indentation_for(SURFACE, space, name, value, rtol=1e-9), rel=3e-6)
    if not low:
        assert state_reaching(trials, area(1e-3), between).approach <= 1e-9


# ---- cost


@pytest.mark.parametrize(("target", "value", "D"), [("contact_area", 0.1, 2.1), ("pressure", 1.0, 2.9)])
def test_few_solves_are_needed(target, value, D, solves):
    surface = kit.fractal(6, D)
    space = kit.half_space(surface.shape)
    before = space.convolutions + space.convolutions_fp32
    end = indentation_for(surface, space, target, value)
    searched = space.convolutions + space.convolutions_fp32 - before
    contacts = kit.swept(surface, tuple(end * np.arange(1, 61) / 60))
    assert searched <= 0.5 * sum(contact.convolutions + contact.convolutions_fp32 for contact in contacts)
    assert len(solves) <= 15
    assert sum(state.residual <= 1e-6 for state in solves) <= 7  # the others are as rough as they may be


# ---- the reason: straight lines bracket the truth


def states(surface):
    return kit.swept(
        surface, tuple(kit.mean_plane(surface) * np.array([0.1, 0.3, 0.5, 0.9, 1.3, 2.0, 8.0, 40.0])), rtol=1e-11
    )


@pytest.mark.parametrize("D", [2.05, 2.95])
def test_lines_have_too_little_contact_between_two_states_and_too_much_beyond(D):
    """The depth of every element rises and is concave."""
    surface = kit.fractal(4, D, seed=4)
    trials, contacts = Trials(surface, kit.half_space(surface.shape)), states(surface)
    one_after_another, c = [trials.untouched, *contacts], trials.problem.firmness
    x = np.array([c * kit.lattice_pressure(contact) - contact.gap() for contact in one_after_another])
    slopes = np.diff(x, axis=0) / np.diff([contact.indentation for contact in one_after_another])[:, None, None]
    assert slopes.min() > -1e-9
    assert np.diff(slopes, axis=0).max() < 1e-8
    for (one, truth), other in zip(pairwise(contacts), contacts[2:], strict=False):
        between = trials.line(one, other)(truth.indentation, 1e-10)
        assert not (between.contact() & ~truth.contact()).any()
        assert between.mean_pressure <= truth.mean_pressure
        beyond = trials.line(one, truth)(other.indentation, -1e-10)
        before = trials.line(truth, other)(one.indentation, -1e-10)
        for line, state in ((beyond, other), (before, one)):
            assert not (state.contact() & ~line.contact()).any()
            assert line.mean_pressure >= state.mean_pressure * (1 - 1e-9)


def test_trials_between_states_are_the_solutions_and_the_line_through_one_state_is_that_state():
    surface = kit.fractal(5)
    trials = Trials(surface, kit.half_space(surface.shape), rtol=1e-9)
    one = trials.at(1.0, trials.untouched)
    two = trials.at(3.0, one, trials.untouched, rtol=1e-3)
    between, (alone,) = trials.at(2.2, two, one), kit.swept(surface, (2.2,), rtol=1e-9)
    assert between.residual <= 1e-9 < two.residual <= 1e-3
    assert np.array_equal(between.contact(), alone.contact())
    assert between.mean_pressure == pytest.approx(alone.mean_pressure, rel=1e-8)
    same = trials.line(one, one)(1.0, 0.0)
    assert np.array_equal(same.contact(), one.contact())
    assert same.mean_pressure == pytest.approx(one.mean_pressure, rel=1e-14)
    np.testing.assert_allclose(same.gap(), one.gap(), rtol=0, atol=1e-11)
    assert not same.converged
    assert trials.line(one, one)(1.0, 1e-2).contact_area_fraction < one.contact_area_fraction


# ---- errors


def looked_for(target, value, **options):
    return lambda: indentation_for(kit.fractal(3), kit.half_space((9, 9)), target, value, **options)


def crossed(value, hardness):
    trials = Trials(kit.fractal(3), kit.half_space((9, 9)), hardness=hardness)
    return lambda: state_crossing(trials, pressure(value), trials.untouched)


def never(**options):
    return lambda: first_indentation(kit.fractal(3), kit.half_space((9, 9)), lambda _: False, **options)


test_refused = refusals(
    ContactError,
    (looked_for("pressure", 1.0, hardness=2.0), r"hardness is 2\.0; allowed: none"),
    (never(hardness=2.0), r"hardness is 2\.0; allowed"),
    (never(), "full contact"),
    *((never(accuracy=a), f"accuracy is {a}; allowed: 0 < accuracy < 1") for a in (-1.0, 0.0, 1.0, math.nan)),
    (looked_for("gap", 1.0), r"'gap'.*contact_area, pressure"),
    (looked_for("pressure", 1.0, method="slow"), r"'slow'.*fast, paper"),
    *((looked_for("contact_area", v), rf"contact_area is {v}.*A\* <= 1") for v in (0.0, -0.1, 1.01, math.nan)),
    *((looked_for("pressure", v), rf"pressure is {v}.*p\* > 0") for v in (0.0, -2.0, math.nan)),
    (looked_for("pressure", "1"), "value must be a number, got '1'"),
    (looked_for("free_volume", 99.0), r"allowed: 0 < V\* <"),
    (crossed(2.1, 2.0), "not reached"),  # a pressure above the hardness
)
