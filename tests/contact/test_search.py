"""Searches for an indentation: they find the smallest one, with few solves, between bounds that hold."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from oracles import fractal, half_space, mean_plane

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Trials, solve, sweep
from roughvol.contact.options import SearchTuning
from roughvol.contact.search import first_indentation, indentation_for
from roughvol.errors import ContactError
from roughvol.surfaces.surface import Surface

peaks = np.full((17, 17), -1.0)
peaks[[3, 3, 13, 13], [3, 13, 3, 13]] = 0.0
MEASURE = {"contact_area": "contact_area_fraction", "pressure": "mean_pressure"}


# ---- answers


@pytest.mark.parametrize("elements", [2, 9, 29, 100, 250, 289])
def test_indentation_for_an_area_is_the_smallest(elements):
    surface, space = fractal(4), half_space((17, 17))
    indentation = indentation_for(surface, space, "contact_area", elements / 289, rtol=1e-9)
    at, before = (solve(surface, space, indentation * f, rtol=1e-11).contact().sum() for f in (1.0, 1.0 - 1e-5))
    assert before < elements <= at


@pytest.mark.parametrize("pressure", [1e-9, 1e-3, 0.7, 20.0, 1e4])
def test_indentation_for_a_pressure_meets_it(pressure):
    surface, space = fractal(4), half_space((17, 17))
    indentation = indentation_for(surface, space, "pressure", pressure, rtol=1e-10)
    assert solve(surface, space, indentation, rtol=1e-11).mean_pressure == pytest.approx(pressure, rel=2e-6)


@pytest.mark.parametrize("D", [2.1, 2.9])
@pytest.mark.parametrize(("target", "value"), [("contact_area", 0.1), ("contact_area", 0.02), ("pressure", 1.5)])
def test_where_it_is_does_not_depend_on_how_it_is_looked_for(target, value, D):
    surface = fractal(6, D)
    usual = indentation_for(surface, half_space(surface.shape), target, value, rtol=1e-8)
    for first, later in ((0.5, 0.5), (1e-8, 1e-8)):  # rough states must not decide, good ones need not
        steering = SearchTuning(first=first, following=later)
        other = indentation_for(surface, half_space(surface.shape), target, value, rtol=1e-8, search=steering)
        assert other == pytest.approx(usual, rel=3e-6)


@pytest.mark.parametrize("kernel", ["love", "punch"])
@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
@pytest.mark.parametrize("value", [0.05, 0.6, 1.0])
def test_a_sweep_to_the_area_reaches_it(value, rtol, kernel):
    surface = fractal(5, 2.5, seed=3)
    space = half_space(surface.shape, kernel)
    end = indentation_for(surface, space, "contact_area", value, rtol=rtol)
    *before, last = sweep(surface, space, end * np.arange(1, 31) / 30, rtol=rtol)
    assert last.contact_area_fraction >= value
    assert before[-1].contact_area_fraction < value
    if kernel == "love":  # nor is it reached much earlier: within the residual, the last element is on the brink
        trials = Trials(surface, space, rtol=1e-10)
        exact = trials.at(end, trials.untouched)
        assert trials.line(exact, exact)(end, 10 * rtol + 2e-6 * end).contact_area_fraction < value


def test_full_contact_is_a_target():
    for surface in (fractal(4), fractal(6, 2.1), Surface(np.zeros((17, 17)), 1.0)):
        indentation = indentation_for(surface, half_space(surface.shape), "contact_area", 1.0)
        assert solve(surface, half_space(surface.shape), indentation).contact_area_fraction == 1.0
        *_, last = sweep(surface, half_space(surface.shape), indentation * np.arange(1, 11) / 10)
        assert last.contact_area_fraction == 1.0


def test_area_that_the_first_touch_exceeds_is_reached_at_once():
    for heights in (fractal(4).heights, np.zeros((17, 17)), peaks):
        space = HalfSpace((17, 17))
        indentation = indentation_for(Surface(heights, 1.0), space, "contact_area", 1e-3)
        assert 0.0 < indentation < 1e-3
        assert solve(Surface(heights, 1.0), space, indentation).contact_area_fraction >= 1e-3
        assert space.convolutions < 30


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
    surface, space = Surface(heights, 1.0), half_space(heights.shape, kernel)
    indentation = indentation_for(surface, space, target, value, rtol=rtol)
    found = getattr(solve(surface, space, indentation, rtol=rtol), MEASURE[target])
    if target == "contact_area":
        assert found >= value
    else:  # by the search and by the residual, which is at most a hundredth of the indentation
        stiffest = Trials(surface, space).problem.stiffest
        noise = 4.0 * min(rtol, 0.01 * indentation) + 1e-5 * indentation
        assert abs(found - value) <= stiffest * noise


@pytest.mark.parametrize("kernel", ["love", "punch"])
@pytest.mark.parametrize("rtol", [1e-3, 1e-8])
@pytest.mark.parametrize("kind", ODD)
def test_odd_surfaces_are_searched_to_the_end(kind, rtol, kernel):
    """One pit that closes late, and targets below one element or below the tolerance."""
    rng = np.random.Generator(np.random.PCG64(3))
    for n, target, value in [(5, "contact_area", 1.0), (9, "contact_area", 1e-9), (17, "pressure", 1e-7)]:
        is_met(odd_heights(kind, n, rng), target, value, rtol, kernel)


@pytest.mark.slow
def test_six_hundred_odd_surfaces_are_searched_to_the_end():
    rng = np.random.Generator(np.random.PCG64(17))
    for trial in range(600):
        heights = odd_heights(ODD[trial % 8], int(rng.choice([5, 7, 9, 12, 17, 33])), rng)
        target = str(rng.choice(["contact_area", "contact_area", "pressure"]))
        area = float(rng.choice([1e-9, 1e-5, 1e-3, 0.01, 0.1, 0.5, 0.9, 1.0]))
        value = area if target == "contact_area" else float(10 ** rng.uniform(-9, 2))
        is_met(heights, target, value, float(rng.choice([1e-3, 1e-6, 1e-8])), str(rng.choice(["love", "punch"])))


@pytest.mark.parametrize("rtol", [1e-3, 1e-8])
def test_a_pit_is_closed_whatever_the_condition(rtol):
    heights = np.zeros((9, 9))
    heights[2, 6] = -3.0
    surface, space = Surface(heights, 1.0), half_space((9, 9))
    found = first_indentation(surface, space, lambda state: bool(state.contact()[2, 6]), rtol=rtol)
    assert found == pytest.approx(indentation_for(surface, space, "contact_area", 1.0, rtol=rtol), rel=2e-3)


def test_full_contact_takes_few_solves(monkeypatch):
    solves, at = [], Trials.at
    monkeypatch.setattr(Trials, "at", lambda *a, **k: solves.append(at(*a, **k)) or solves[-1])
    indentation_for(fractal(6, 2.1), half_space((65, 65)), "contact_area", 1.0)
    assert len(solves) <= 30


def test_the_paper_s_method_finds_the_same():
    surface, space = fractal(3), half_space((9, 9))
    for target, value in (("contact_area", 0.3), ("pressure", 1.0)):
        fast, paper = (indentation_for(surface, space, target, value, method=method) for method in ("fast", "paper"))
        assert paper == pytest.approx(fast, rel=1e-5)


@pytest.mark.parametrize("D", [2.1, 2.6])
def test_what_is_found_for_a_condition_is_where_it_begins(D):
    """The middle of the surface comes into contact: a condition on single elements, as percolation is."""
    surface = fractal(5, D)
    space = half_space(surface.shape)
    centre = (slice(14, 19), slice(14, 19))

    def touched(contact):
        return bool(contact.contact()[centre].any())

    found = first_indentation(surface, space, touched, accuracy=1e-6)
    at, short = (solve(surface, space, found * f, rtol=1e-10) for f in (1.0, 1.0 - 1e-4))
    assert touched(at)
    assert not touched(short)


def test_a_condition_that_never_holds_ends_at_full_contact():
    with pytest.raises(ContactError, match="full contact"):
        first_indentation(fractal(4), half_space((17, 17)), lambda _: False)


# ---- cost


@pytest.mark.parametrize("D", [2.1, 2.5, 2.9])
@pytest.mark.parametrize(("target", "value"), [("contact_area", 0.1), ("contact_area", 0.03), ("pressure", 1.0)])
def test_few_solves_are_needed(target, value, D, monkeypatch):
    surface = fractal(7, D)
    space = HalfSpace(surface.shape)
    solves = []
    at = Trials.at
    monkeypatch.setattr(Trials, "at", lambda *a, **k: solves.append(at(*a, **k)) or solves[-1])
    end = indentation_for(surface, space, target, value)
    searched = space.convolutions + space.convolutions_fp32
    before = space.convolutions + space.convolutions_fp32
    list(sweep(surface, space, end * np.arange(1, 61) / 60))
    assert searched <= 0.5 * (space.convolutions + space.convolutions_fp32 - before)
    assert len(solves) <= 15
    assert sum(state.residual <= 1e-6 for state in solves) <= 7  # the others are as rough as they may be


# ---- the reason: straight lines bracket the truth


def states(surface, kernel="love"):
    at = mean_plane(surface) * np.array([0.1, 0.3, 0.5, 0.9, 1.3, 2.0, 4.0, 8.0, 40.0])
    return list(sweep(surface, half_space(surface.shape, kernel), at, rtol=1e-11))


@pytest.mark.parametrize("D", [2.05, 2.5, 2.95])
@pytest.mark.parametrize("m", [4, 5])
def test_depth_of_every_element_rises_and_is_concave(m, D):
    surface = fractal(m, D, seed=m)
    trials = Trials(surface, half_space(surface.shape))
    contacts = [trials.untouched, *states(surface)]

    def depth(contact):
        c = trials.problem.firmness
        lattice = contact.pressure() / (math.pi * (surface.shape[0] - 1))
        return c * lattice - contact.gap()

    x, at = np.array([depth(contact) for contact in contacts]), np.array([c.indentation for c in contacts])
    slopes = np.diff(x, axis=0) / np.diff(at)[:, None, None]
    assert slopes.min() > -1e-9
    assert np.diff(slopes, axis=0).max() < 1e-8


@pytest.mark.parametrize("D", [2.05, 2.5, 2.95])
def test_lines_have_too_little_contact_between_two_states_and_too_much_beyond(D):
    surface = fractal(5, D, seed=2)
    trials = Trials(surface, half_space(surface.shape))
    contacts = states(surface)
    for (one, truth), other in zip(pairwise(contacts), contacts[2:], strict=False):
        between = trials.line(one, other)(truth.indentation, 1e-10)
        assert not (between.contact() & ~truth.contact()).any()
        assert between.mean_pressure <= truth.mean_pressure
        beyond = trials.line(one, truth)(other.indentation, -1e-10)
        before = trials.line(truth, other)(one.indentation, -1e-10)
        for line, state in ((beyond, other), (before, one)):
            assert not (state.contact() & ~line.contact()).any()
            assert line.mean_pressure >= state.mean_pressure * (1 - 1e-9)


def test_the_line_through_one_state_is_that_state():
    surface = fractal(5)
    trials = Trials(surface, half_space(surface.shape), rtol=1e-9)
    contact = trials.at(2.0, trials.untouched)
    same = trials.line(contact, contact)(2.0, 0.0)
    assert np.array_equal(same.contact(), contact.contact())
    assert same.mean_pressure == pytest.approx(contact.mean_pressure, rel=1e-14)
    np.testing.assert_allclose(same.gap(), contact.gap(), rtol=0, atol=1e-11)
    assert trials.line(contact, contact)(2.0, 1e-2).contact_area_fraction < contact.contact_area_fraction


def test_trials_between_states_are_the_solutions():
    surface = fractal(6)
    trials = Trials(surface, half_space(surface.shape), rtol=1e-9)
    one = trials.at(1.0, trials.untouched)
    two = trials.at(3.0, one, trials.untouched, rtol=1e-3)
    between = trials.at(2.2, two, one)
    alone = solve(surface, half_space(surface.shape), 2.2, rtol=1e-9)
    assert between.residual <= 1e-9 < two.residual <= 1e-3
    assert np.array_equal(between.contact(), alone.contact())
    assert between.mean_pressure == pytest.approx(alone.mean_pressure, rel=1e-8)


# ---- errors


def test_a_surface_that_yields_is_refused_by_searches_of_elastic_contact():
    with pytest.raises(ContactError, match=r"hardness is 2\.0; allowed: none"):
        indentation_for(fractal(3), half_space((9, 9)), "pressure", 1.0, hardness=2.0)
    with pytest.raises(ContactError, match=r"hardness is 2\.0; allowed: none"):
        first_indentation(fractal(3), half_space((9, 9)), lambda contact: True, hardness=2.0)


def test_unknown_target_and_method_are_refused_with_the_known_ones():
    with pytest.raises(ContactError, match=r"'gap'.*contact_area, pressure"):
        indentation_for(fractal(3), half_space((9, 9)), "gap", 1.0)
    with pytest.raises(ContactError, match=r"'slow'.*fast, paper"):
        indentation_for(fractal(3), half_space((9, 9)), "pressure", 1.0, method="slow")


@pytest.mark.parametrize(
    ("target", "value"),
    [*(("contact_area", v) for v in (0.0, -0.1, 1.01, math.nan)), *(("pressure", v) for v in (0.0, -2.0, math.nan))],
)
def test_target_out_of_range_is_refused(target, value):
    allowed = {"contact_area": r"A\* <= 1", "pressure": r"p\* > 0"}[target]
    with pytest.raises(ContactError, match=rf"{target} is {value}.*{allowed}"):
        indentation_for(fractal(3), half_space((9, 9)), target, value)


@pytest.mark.parametrize("noise", [0.0, 1e-17])
def test_a_flat_surface_closes_at_once(noise):
    heights = noise * np.random.Generator(np.random.PCG64(1)).standard_normal((9, 9))
    surface, space = Surface(heights, 1.0), HalfSpace((9, 9))
    closed = first_indentation(surface, space, lambda contact: contact.contact_area_fraction == 1.0)
    assert next(sweep(surface, space, [closed])).contact_area_fraction == 1.0
    if not noise:
        assert closed < 1e-3  # pressure beyond the brink everywhere, and no more
