"""The error that the resolution leaves: a power law, a quantity that halves, and noise."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.ensemble.estimate import bias_of

LEVELS = np.arange(4, 10)


def _bias(means: np.ndarray) -> float:
    return bias_of(means.tolist(), np.diff(means).tolist(), [1e-9] * (means.size - 1))


@pytest.mark.parametrize("alpha", [0.7, 1.0, 2.0])
def test_the_rest_of_a_power_law_is_found(alpha: float) -> None:
    found = _bias(2.0 + 0.3 * 2.0 ** (-alpha * (LEVELS - 4.0)))
    assert_allclose(found, 0.3 * 2.0 ** (-alpha * 5.0), rtol=0.35)


@pytest.mark.parametrize("power", [-0.37, 0.5])
def test_a_quantity_that_changes_by_a_factor_on_every_level_has_no_limit(power: float) -> None:
    assert math.isnan(_bias(0.8 * 2.0 ** (power * LEVELS)))


def test_steps_within_their_noise_leave_no_more_than_the_noise() -> None:
    steps = 1e-3 * np.random.default_rng(4).standard_normal(5)
    assert 1e-4 < bias_of([1.0] * 6, steps.tolist(), [1e-3] * 5) < 6e-3


def test_one_level_shows_no_limit() -> None:
    assert math.isnan(bias_of([1.0], [], []))
