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
from roughvol.ensemble.cost import SURFACE
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
    alone: int  # surfaces without a solve
    cost: float  # of all samples, those of other levels included


def plan(
    links: Mapping[tuple[int, int], Link],
    costs: Sequence[float],
    existing: Sequence[int],
    half_width: float,
    alone: Array,
) -> Plan:
    """Return the cheapest chain that ends at the finest level, with no fewer samples than exist.

    Plain Monte Carlo is among the chains. Of chains with nearly the same cost, the longest is taken. ``alone`` are the
    numbers of surfaces without a solve.
    """
    candidates = []
    for chain in _chains(links, len(costs) - 1):
        levels = tuple(link.level for link in chain)
        shares = [multilevel.variance_alone(chain, alone), *shares_of(chain)]
        prices, numbers = [SURFACE, *(costs[k] for k in levels)], [len(alone), *(existing[k] for k in levels)]
        number, *samples = optimum(shares, prices, numbers, half_width)
        used = dict(enumerate(existing)) | dict(zip(levels, samples, strict=True))  # also those of unused levels
        cost = number * SURFACE + sum(used[level] * each for level, each in enumerate(costs))
        candidates.append(Plan(levels, tuple(samples), number, cost))
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


def weights(links: Sequence[Link]) -> list[float]:
    """Return the weights of the levels of a chain in the variance of the estimator, β_l²."""
    slopes = [link.slope for link in links]
    return [math.prod(slopes[k + 1 :]) ** 2 for k in range(len(links))]


def shares_of(links: Sequence[Link]) -> list[float]:
    """Return the variances by level for one sample of each, β_l² s_l²."""
    return [weight * link.variance for weight, link in zip(weights(links), links, strict=True)]


def optimum(
    shares: Sequence[float], costs: Sequence[float], existing: Sequence[int], half_width: float
) -> tuple[int, ...]:
    """Return the optimal samples of each level of a chain, decreasing from coarse to fine, no fewer than exist."""
    allowed = (AIM * half_width / NORMAL) ** 2
    samples, free = list(existing), set(range(len(shares)))
    while free:
        fixed = sum(shares[k] / samples[k] for k in range(len(shares)) if k not in free)
        scale = sum(math.sqrt(shares[k] * costs[k]) for k in free) / (allowed - fixed)
        wanted = {k: scale * math.sqrt(shares[k] / costs[k]) for k in free}
        enough = {k for k in free if wanted[k] <= existing[k]}
        for k in free - enough:
            samples[k] = math.ceil(min(wanted[k], MOST))
        if not enough or enough == free:
            break
        free -= enough
    nested = np.maximum.accumulate(np.maximum(samples, existing)[::-1])[::-1]
    return tuple(int(n) for n in nested)


def plain_cost(variance: float, cost: float, half_width: float) -> float:
    """Return the cost of plain Monte Carlo on one level, of at least one sample."""
    return max(variance * (NORMAL / half_width) ** 2, 1.0) * cost
