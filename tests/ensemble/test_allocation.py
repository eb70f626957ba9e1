"""Samples of levels: the optimum of a closed form, lower bounds, and levels that do not pay."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.ensemble import allocation
from roughvol.ensemble.allocation import AIM, NORMAL, Plan, optimum, plain_cost, shares_of
from roughvol.ensemble.cost import SURFACE
from roughvol.ensemble.multilevel import Link

COSTS = (1.0, 4.0, 16.0)


def _links(shares: tuple[float, ...] = (1.0, 0.01, 0.0001), slope: float = 1.0) -> dict[tuple[int, int], Link]:
    """Levels of variance about 1, each of which leaves a share of it to the finer one."""
    found = {(k, -1): Link(k, -1, 100, 0.0, 1.0, 99.0) for k in range(3)}
    found |= {(k, k - 1): Link(k, k - 1, 100, slope, shares[k], 98.0) for k in (1, 2)}
    return found | {(2, 0): Link(2, 0, 100, slope, shares[1] + shares[2], 98.0)}


SHARES = shares_of([_links()[pair] for pair in ((0, -1), (1, 0), (2, 1))])


def _plan(links: dict[tuple[int, int], Link], costs: tuple[float, ...], half: float) -> Plan:
    return allocation.plan(links, costs, [2, 2, 2], half, alone=np.zeros((2, 0)))


def _half_width(samples: Sequence[int]) -> float:
    return NORMAL * math.sqrt(sum(share / number for share, number in zip(SHARES, samples, strict=True)))


def test_the_optimum_is_that_of_lagrange() -> None:
    half = 1e-3
    found = np.array(optimum(SHARES, COSTS, [2, 2, 2], half))
    spread, costs = np.array([1.0, 0.1, 0.01]), np.array(COSTS)
    exact = spread / np.sqrt(costs) * (spread * np.sqrt(costs)).sum() / (AIM * half / NORMAL) ** 2
    assert_allclose(found, exact, atol=1.0)
    assert _half_width(found) <= half


def test_samples_on_hand_are_kept_and_relieve_the_others() -> None:
    free, held = optimum(SHARES, COSTS, [2, 2, 2], 0.05), optimum(SHARES, COSTS, [2, 2, 500], 0.05)
    assert held[2] == 500
    assert held[1] >= 500  # seeds are nested
    assert held[0] <= free[0]
    assert _half_width(held) <= 0.05


def test_slopes_weigh_the_coarser_levels() -> None:
    small = _plan(_links((1.0, 0.01, 1e-4), slope=0.5), COSTS, 0.02)
    large = _plan(_links((1.0, 0.01, 1e-4), slope=1.0), COSTS, 0.02)
    assert small.samples[0] < large.samples[0]


def test_levels_that_do_not_pay_are_left_out() -> None:
    alike = _plan(_links((1.0, 0.9, 0.9)), COSTS, 0.05)
    assert alike.levels == (2,)
    assert_allclose(alike.cost, 16.0 * alike.samples[0] + 2 * 4.0 + 2 * 1.0 + alike.alone * SURFACE)
    assert _plan(_links(), COSTS, 0.05).levels == (0, 1, 2)
    assert _plan(_links(), (20.0, 20.0, 16.0), 0.05).levels == (2,)


@pytest.mark.parametrize("half", [0.3, 0.03, 0.003])
def test_no_plan_is_dearer_than_plain_monte_carlo(half: float) -> None:
    for shares in ((1.0, 0.01, 1e-4), (1.0, 0.5, 0.3), (1.0, 0.9, 0.9)):
        found = _plan(_links(shares), COSTS, half)
        plain = plain_cost(1.0, COSTS[2], AIM * half) + COSTS[2]
        assert found.cost <= plain / allocation.PAYS + 2 * sum(COSTS)
