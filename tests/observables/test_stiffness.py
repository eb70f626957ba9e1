"""Interfacial stiffness: exact for an exponential, second order for a power, infinite at full contact."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.errors import ContactError
from roughvol.observables.stiffness import interfacial_stiffness, without_every_second


def test_the_stiffness_of_an_exponential_is_the_pressure_over_its_length() -> None:
    d = np.array([3.0, 2.5, 2.4, 1.0, 0.7])
    p = 0.3 * np.exp(-d / 0.4)
    assert_allclose(interfacial_stiffness(p, d), p / 0.4, rtol=1e-12)
    assert_allclose(interfacial_stiffness(p[::-1], d[::-1]), p[::-1] / 0.4, rtol=1e-12)  # unloading


@pytest.mark.parametrize("exponent", [1.5, 2.0])
def test_the_error_for_a_power_falls_with_the_square_of_the_step(exponent: float) -> None:
    def error(steps: int) -> float:
        depth = np.linspace(0.5, 2.0, steps)
        found = interfacial_stiffness(depth**exponent, -depth)
        return float(np.abs(found / (exponent * depth ** (exponent - 1.0)) - 1.0)[1:-1].max())

    assert error(81) < error(41) / 3.5
    assert error(81) < 1e-3


def test_an_interface_that_no_longer_moves_is_infinitely_stiff() -> None:
    found = interfacial_stiffness([1.0, 2.0, 3.0, 4.0, 5.0], [0.2, 0.1, 0.0, 0.0, 0.0])
    assert np.all(np.isinf(found[3:]))
    assert np.all(found[:2] > 0.0)


@pytest.mark.parametrize("order", [1, -1])
def test_an_end_beyond_a_kink_keeps_the_sign_of_its_last_step(order: int) -> None:
    p, d = np.array([1.3, 10.7, 23.2, 43.6])[::order], np.array([0.9, 0.072, 0.003, 0.0])[::order]
    found = interfacial_stiffness(p, d)[::order]
    assert np.all(found > 0.0)
    assert found[-1] == pytest.approx(43.6 / (0.003 / np.log(43.6 / 23.2)))


def test_a_softer_interface_under_more_load_has_a_negative_stiffness() -> None:
    assert np.all(interfacial_stiffness([1.0, 2.0, 3.0], [0.1, 0.2, 0.3]) < 0.0)


def test_states_without_load_and_missing_cases_have_none() -> None:
    d = np.linspace(3.0, 1.0, 6)
    p = np.exp(-d)
    p[0] = 0.0
    both = interfacial_stiffness([p, np.full(6, np.nan)], [d, d])
    assert np.isnan(both[0, 0])
    assert_allclose(both[0, 1:], p[1:], rtol=1e-12)
    assert np.all(np.isnan(both[1]))


@pytest.mark.parametrize(
    ("pressure", "separation", "words"),
    [
        ([1.0, 2.0], [1.0], "one shape"),
        ([1.0, 3.0, 2.0], [3.0, 2.0, 1.0], "one leg"),
        ([-1.0, 1.0, 2.0], [3, 2, 1], "0"),
    ],
)
def test_what_has_no_stiffness_is_refused(pressure: list[float], separation: list[float], words: str) -> None:
    with pytest.raises(ContactError, match=words):
        interfacial_stiffness(pressure, separation)


def test_every_second_state_shows_the_error_by_the_steps() -> None:
    p = np.geomspace(0.01, 1.0, 17)
    d = -np.sqrt(p)  # K = 2 sqrt(p)
    found, fewer = interfacial_stiffness(p, d), without_every_second(p, d)
    error, change = np.abs(found / (2.0 * np.sqrt(p)) - 1.0), np.abs(fewer / found - 1.0)
    assert np.all(error <= change)
    assert_allclose(change[4:-4] / error[4:-4], 3.0, rtol=0.2)  # second order: four times the error, less the error
    assert_allclose(without_every_second(np.exp(-d), d), interfacial_stiffness(np.exp(-d), d), rtol=1e-9)
