"""The error that the resolution leaves: a power law, a quantity that halves, and noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.ensemble.refinement import weak_error

LEVELS = np.arange(4, 10)


def _weak(means: np.ndarray, noise: float = 1e-9):
    return weak_error(means, np.diff(means), np.full(means.size - 1, noise))


@pytest.mark.parametrize("alpha", [0.7, 1.0, 2.0])
def test_the_rest_of_a_power_law_is_found(alpha: float) -> None:
    found = _weak(2.0 + 0.3 * 2.0 ** (-alpha * (LEVELS - 4.0)))
    assert found.converges
    assert_allclose(found.rate, alpha, atol=0.1)
    assert_allclose(found.bias, 0.3 * 2.0 ** (-alpha * 5.0), rtol=0.35)


def test_a_quantity_that_falls_by_a_factor_on_every_level_has_no_limit() -> None:
    found = _weak(0.8 * 2.0 ** (-0.37 * LEVELS))
    assert not found.converges
    assert math.isnan(found.bias)
    assert_allclose(found.rate, 0.0, atol=0.05)


def test_a_quantity_that_grows_has_no_limit() -> None:
    assert not _weak(2.0 ** (0.5 * LEVELS)).converges


def test_steps_within_their_noise_leave_no_more_than_the_noise() -> None:
    random = np.random.default_rng(4)
    found = weak_error(np.ones(6), 1e-3 * random.standard_normal(5), np.full(5, 1e-3))
    assert found.converges
    assert 1e-4 < found.bias < 6e-3
