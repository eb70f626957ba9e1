"""Quantities between the steps of a sweep."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from roughvol.observables.at_state import at_state, error_between_steps


def test_steps_are_met_and_curves_followed() -> None:
    x = np.linspace(0.0, 1.0, 31)
    assert_allclose(at_state(x, np.exp(-x), x), np.exp(-x))
    between = 0.5 * (x[1:] + x[:-1])
    assert_allclose(at_state(x, np.exp(-x), between), np.exp(-between), atol=2e-5)


def test_nothing_is_extrapolated() -> None:
    x = np.linspace(0.2, 1.0, 5)
    assert np.isnan(at_state(x, x, [0.1, 1.01])).all()
    assert np.isnan(at_state([], [], 0.3)).all()
    assert_allclose(at_state([0.3], [7.0], [0.3, 0.4]), [7.0, np.nan])


def test_a_state_may_fall_or_rest() -> None:
    falling = np.array([3.0, 2.0, 2.0, 1.0, 0.0])
    assert_allclose(at_state(falling, [0.0, 1.0, 1.0, 2.0, 3.0], [2.5, 1.0]), [0.5, 2.0])
    assert_allclose(at_state([0.0, np.nan, 1.0], [0.0, 5.0, 1.0], 0.5), 0.5)


def test_the_error_between_steps_is_no_smaller_than_the_true_one() -> None:
    for steps in (10, 20, 41):
        x = np.linspace(0.0, 2.0, steps + 1)
        points = np.linspace(0.01, 1.99, 97)  # at a single point the two curves may cross
        true = at_state(x, np.exp(-x), points) - np.exp(-points)
        assert np.linalg.norm(error_between_steps(x, np.exp(-x), points)) >= np.linalg.norm(true)
        assert error_between_steps(x, x, points).max() < 1e-12


def test_straight_lines_keep_the_steps_of_equal_state() -> None:
    state, quantity = [0.0, 1.0, 1.0, 2.0], [4.0, 3.0, 1.0, 0.0]
    assert_allclose(at_state(state, quantity, [0.5, 1.5], straight=True), [3.5, 0.5])
    assert_allclose(at_state(state[::-1], quantity[::-1], [0.5], straight=True), [3.5])
    assert np.isnan(at_state(state, quantity, [-0.1, 2.1], straight=True)).all()
