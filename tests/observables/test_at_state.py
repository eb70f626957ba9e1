"""Quantities between the steps of a sweep."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.interpolate import PchipInterpolator

from roughvol.observables.at_state import at_state, error_of_fewer_steps, kept_steps


def test_the_cubics_are_those_of_scipy():
    """With falling, equal and reversing numbers, at steps, between them, and on two steps alone."""
    random = np.random.default_rng(5)
    for steps in (2, 3, 4, 9):
        x = np.cumsum(random.uniform(0.1, 3.0, steps))
        at = np.append(np.linspace(x[0], x[-1], 50), x)
        for y in (
            random.normal(size=steps),
            -np.exp(x),
            np.round(random.uniform(0, 2, steps)),
            np.arange(steps) * 1e-300,
        ):
            assert_allclose(at_state(x, y, at), PchipInterpolator(x, y)(at), rtol=1e-12, atol=1e-13)
            assert (at_state(x, y, x) == y).all()


def test_nothing_is_extrapolated():
    x = np.linspace(0.2, 1.0, 5)
    assert np.isnan(at_state(x, x, [0.1, 1.01])).all()
    assert np.isnan(at_state([], [], 0.3)).all()
    assert_allclose(at_state([0.3], [7.0], [0.3, 0.4]), [7.0, np.nan])


def test_a_state_may_fall_or_rest():
    falling = np.array([3.0, 2.0, 2.0, 1.0, 0.0])
    assert_allclose(at_state(falling, [0.0, 1.0, 1.0, 2.0, 3.0], [2.5, 1.0]), [0.5, 2.0])
    assert_allclose(at_state([0.0, np.nan, 1.0], [0.0, 5.0, 1.0], 0.5), 0.5)


def test_the_error_of_fewer_steps_is_that_at_the_omitted_ones():
    x = np.linspace(0.0, 2.0, 61)
    for every in (2, 3, 6):
        sparse = x[::every]
        true = at_state(sparse, np.exp(-3.0 * sparse), x) - np.exp(-3.0 * x)
        near = [float(error_of_fewer_steps(x, np.exp(-3.0 * x), value, every)) for value in (0.05, 1.0, 1.9)]
        assert np.abs(near).max() <= np.abs(true).max()
        assert abs(near[0]) > abs(near[2]) > 0.0
        assert abs(error_of_fewer_steps(x, 2.0 * x, 1.0, every)) < 1e-12


def test_fewer_steps_that_do_not_reach_a_state_have_no_finite_error():
    x = np.linspace(0.0, 1.0, 13)
    y = np.where(x > 0.0, 1.0 - x, np.nan)  # unknown at first touch
    assert error_of_fewer_steps(x, y, 0.02, 2) == np.inf
    assert np.isfinite(error_of_fewer_steps(x, y, 0.5, 2))
    assert kept_steps(6, 2).tolist() == [0, 1, 3, 5]
    assert error_of_fewer_steps([], [], 0.3, 2) == np.inf


def test_a_curve_ends_at_the_first_of_several_steps_of_equal_state_and_goes_on_from_the_last():
    state, quantity = [0.0, 1.0, 1.0, 1.0, 2.0], [4.0, 3.0, 2.0, 1.0, 0.0]
    assert_allclose(at_state(state, quantity, [0.5, 1.0, 1.5]), [3.5, 3.0, 0.5])
    assert_allclose(at_state(state[::-1], quantity[::-1], [0.5, 1.0, 1.5]), [3.5, 1.0, 0.5])


def test_straight_lines_keep_the_steps_of_equal_state():
    state, quantity = [0.0, 1.0, 1.0, 2.0], [4.0, 3.0, 1.0, 0.0]
    assert_allclose(at_state(state, quantity, [0.5, 1.5], straight=True), [3.5, 0.5])
    assert_allclose(at_state(state[::-1], quantity[::-1], [0.5], straight=True), [3.5])
    assert np.isnan(at_state(state, quantity, [-0.1, 2.1], straight=True)).all()
