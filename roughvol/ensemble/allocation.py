"""The optimal number of samples on each level: least cost for a given accuracy of a multilevel estimator.

Symbols: C_l cost of one sample of level l; s_l² residual variance of a link (see `multilevel`); β_l product of the
slopes of the finer links. Level l contributes β_l² s_l²/n_l to the variance of the estimator. For a given sum of these
the cost Σ n_l C_l is least at n_l ∝ |β_l| s_l/√C_l (Giles, Oper. Res. 56 (2008) 607; Peherstorfer, Willcox &
Gunzburger, SIAM J. Sci. Comput. 38 (2016) A3163). Existing samples are free, and a lower bound.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roughvol.ensemble import multilevel
from roughvol.ensemble.multilevel import Link
from roughvol.typing import Array

NORMAL = 1.96  # Student's quantile for many degrees of freedom
AIM = 0.97  # planned half-width over the requested one
PAYS = 0.97  # least cost over that of a longer chain which is still preferred
MOST = 10**7  # largest planned number of samples


@dataclass(frozen=True)
class Plan:
    """A chain of levels and its samples."""

    levels: tuple[int, ...]  # indices, coarsest first
    samples: tuple[int, ...]
    cost: float  # of all samples, those of other levels included
    alone: int = 0  # surfaces without a solve


@dataclass(frozen=True)
class Alone:
    """Surfaces without a solve: their numbers, shape (N, k), and the cost of one."""

    values: Array
    cost: float


def plan(
    links: Mapping[tuple[int, int], Link],
    costs: Sequence[float],
    existing: Sequence[int],
    half_width: float,
    alone: Alone | None = None,
) -> Plan:
    """Return the cheapest chain that ends at the finest level, with no fewer samples than exist.

    All chains are compared, plain Monte Carlo on the finest level among them. Of chains with nearly the same cost, the
    longest is taken.
    """
    candidates = []
    for chain in _chains(links, len(costs) - 1):
        levels = tuple(link.level for link in chain)
        shares, chain_costs = _shares(chain), [costs[level] for level in levels]
        lower_bounds = [existing[level] for level in levels]
        if alone is None:
            samples, number, spent = _optimum(shares, chain_costs, lower_bounds, half_width), 0, 0.0
        else:
            shares.insert(0, multilevel.variance_alone(chain, alone.values))
            number, *rest = _optimum(shares, [alone.cost, *chain_costs], [len(alone.values), *lower_bounds], half_width)
            samples, spent = tuple(rest), number * alone.cost
        candidates.append(Plan(levels, samples, _cost(levels, samples, costs, existing) + spent, number))
    least = min(candidate.cost for candidate in candidates)
    cheap = [candidate for candidate in candidates if candidate.cost * PAYS <= least]
    return max(cheap, key=lambda candidate: (len(candidate.levels), -candidate.cost, candidate.levels))


def _chains(links: Mapping[tuple[int, int], Link], finest: int) -> Iterator[list[Link]]:
    """Yield all chains that end at the finest level, as links from coarse to fine."""
    for length in range(finest + 1):
        for coarser in itertools.combinations(range(finest), length):
            pairs = [(level, parent) for parent, level in itertools.pairwise((-1, *coarser, finest))]
            if all(pair in links for pair in pairs):
                yield [links[pair] for pair in pairs]


def allocated(
    links: Sequence[Link], costs: Sequence[float], existing: Sequence[int], half_width: float
) -> tuple[int, ...]:
    """Return the optimal samples of each level of a chain, decreasing from coarse to fine.

    Levels whose optimum is below their existing samples keep these, and the others are allocated anew (Giles 2008).
    """
    return _optimum(_shares(links), costs, existing, half_width)


def _shares(links: Sequence[Link]) -> list[float]:
    """Return the variances by level for one sample of each."""
    return [weight * link.variance for weight, link in zip(weights(links), links, strict=True)]


def _optimum(
    shares: Sequence[float], costs: Sequence[float], existing: Sequence[int], half_width: float
) -> tuple[int, ...]:
    allowed = (AIM * half_width / NORMAL) ** 2
    samples, free = list(existing), set(range(len(shares)))
    while free:
        fixed = sum(shares[k] / samples[k] for k in range(len(shares)) if k not in free)
        scale = sum(math.sqrt(shares[k] * costs[k]) for k in free) / (allowed - fixed)
        optimum = {k: scale * math.sqrt(shares[k] / costs[k]) for k in free}
        enough = {k for k in free if optimum[k] <= existing[k]}
        for k in free - enough:
            samples[k] = _whole(optimum[k])
        if not enough or enough == free:
            break
        free -= enough
    nested = np.maximum.accumulate(np.maximum(samples, existing)[::-1])[::-1]
    return tuple(int(n) for n in nested)


def predicted(links: Sequence[Link], samples: Sequence[int]) -> float:
    """Return the variance of the estimator for given samples of each level, Σ β_l² s_l²/n_l."""
    terms = zip(weights(links), links, samples, strict=True)
    return sum(weight * link.variance / number for weight, link, number in terms)


def weights(links: Sequence[Link]) -> list[float]:
    """Return the weights of the levels of a chain in the variance of the estimator, β_l²."""
    slopes = [link.slope for link in links]
    return [math.prod(slopes[k + 1 :]) ** 2 for k in range(len(links))]


def plain_cost(variance: float, cost: float, half_width: float) -> float:
    """Return the cost of plain Monte Carlo on one level, of at least one sample."""
    return max(variance * (NORMAL / half_width) ** 2, 1.0) * cost


def _whole(number: float) -> int:
    return math.ceil(min(number, MOST))


def _cost(levels: Sequence[int], samples: Sequence[int], costs: Sequence[float], existing: Sequence[int]) -> float:
    """Return the cost of all samples, the existing ones of unused levels included."""
    used = dict(zip(levels, samples, strict=True))
    return sum(used.get(level, existing[level]) * cost for level, cost in enumerate(costs))
