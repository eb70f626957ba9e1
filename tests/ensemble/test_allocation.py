"""Samples of levels: the optimum of a closed form, lower bounds, and levels that do not pay."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.ensemble import allocation
from roughvol.ensemble.allocation import AIM, NORMAL, allocated, plain_cost, plan, predicted
from roughvol.ensemble.multilevel import Link

COSTS = (1.0, 4.0, 16.0)


def _links(shares: tuple[float, ...] = (1.0, 0.01, 0.0001), slope: float = 1.0) -> dict[tuple[int, int], Link]:
    """Levels of variance about 1, each of which leaves a share of it to the finer one."""
    found = {(k, -1): Link(k, -1, 100, 0.0, 1.0, 99.0) for k in range(3)}
    found |= {(k, k - 1): Link(k, k - 1, 100, slope, shares[k], 98.0) for k in (1, 2)}
    return found | {(2, 0): Link(2, 0, 100, slope, shares[1] + shares[2], 98.0)}


def test_the_optimum_is_that_of_lagrange() -> None:
    links = [_links()[pair] for pair in ((0, -1), (1, 0), (2, 1))]
    half = 1e-3
    found = np.array(allocated(links, COSTS, [2, 2, 2], half))
    spread, costs = np.array([1.0, 0.1, 0.01]), np.array(COSTS)
    exact = spread / np.sqrt(costs) * (spread * np.sqrt(costs)).sum() / (AIM * half / NORMAL) ** 2
    assert_allclose(found, exact, atol=1.0)
    assert NORMAL * math.sqrt(predicted(links, found)) <= half


def test_samples_on_hand_are_kept_and_relieve_the_others() -> None:
    links = [_links()[pair] for pair in ((0, -1), (1, 0), (2, 1))]
    free, held = allocated(links, COSTS, [2, 2, 2], 0.05), allocated(links, COSTS, [2, 2, 500], 0.05)
    assert held[2] == 500
    assert held[1] >= 500  # seeds are nested
    assert held[0] <= free[0]
    assert NORMAL * math.sqrt(predicted(links, held)) <= 0.05


def test_slopes_weigh_the_coarser_levels() -> None:
    small = plan(_links((1.0, 0.01, 1e-4), slope=0.5), COSTS, [2, 2, 2], 0.02)
    large = plan(_links((1.0, 0.01, 1e-4), slope=1.0), COSTS, [2, 2, 2], 0.02)
    assert small.samples[0] < large.samples[0]


def test_levels_that_do_not_pay_are_left_out() -> None:
    alike = plan(_links((1.0, 0.9, 0.9)), COSTS, [2, 2, 2], 0.05)
    assert alike.levels == (2,)
    assert_allclose(alike.cost, 16.0 * alike.samples[0] + 2 * 4.0 + 2 * 1.0)
    assert plan(_links(), COSTS, [2, 2, 2], 0.05).levels == (0, 1, 2)
    assert plan(_links(), (20.0, 20.0, 16.0), [2, 2, 2], 0.05).levels == (2,)


@pytest.mark.parametrize("half", [0.3, 0.03, 0.003])
def test_no_plan_is_dearer_than_plain_monte_carlo(half: float) -> None:
    for shares in ((1.0, 0.01, 1e-4), (1.0, 0.5, 0.3), (1.0, 0.9, 0.9)):
        found = plan(_links(shares), COSTS, [2, 2, 2], half)
        plain = plain_cost(1.0, COSTS[2], AIM * half) + COSTS[2]
        assert found.cost <= plain / allocation.PAYS + 2 * sum(COSTS)
