"""How many samples each level of resolution needs for an accuracy, at the least cost.

Symbols: C_l cost of one sample of level l; s_l² residual variance of a link (see `multilevel`); β_l the product of the
slopes of the finer links, so that β_l² s_l²/n_l is what level l adds to the variance of the answer. For a given sum of
these the cost Σ n_l C_l is least at n_l ∝ |β_l| s_l/√C_l (Giles 2008; Peherstorfer, Willcox & Gunzburger, SIAM J. Sci.
Comput. 38 (2016) A3163). Samples that exist cost nothing more, and count as a lower bound.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roughvol.observables.multilevel import Link

NORMAL = 1.96  # the t quantile of many degrees of freedom
AIM = 0.97  # of the accuracy, so that a last round is seldom short by a few samples
PAYS = 0.97  # cost of a chain over that of one with more levels, from which on a level is left out


@dataclass(frozen=True)
class Plan:
    """A chain of levels, the samples it needs on each of them, and the cost of all samples."""

    levels: tuple[int, ...]
    samples: tuple[int, ...]
    cost: float


def plan(links: Mapping[tuple[int, int], Link], costs: Sequence[float], have: Sequence[int], half_width: float) -> Plan:
    """Return the cheapest chain that ends at the finest level, with its samples.

    A level that does not pay is left out. The plain mean of the finest level is one of the chains.

    Parameters
    ----------
    links : mapping
        From `multilevel.links_of`.
    costs : sequence of float
        C of every level.
    have : sequence of int
        Samples that exist; the plan has no fewer.
    half_width : float
        Half-width of the 95 % interval asked for, > 0.

    Returns
    -------
    Plan
        Of the chain.
    """
    finest = len(costs) - 1
    found = []
    for count in range(finest + 1):
        for coarser in itertools.combinations(range(finest), count):
            levels = (*coarser, finest)
            pairs = [(level, parent) for parent, level in itertools.pairwise((-1, *levels))]
            if all(pair in links for pair in pairs):
                chosen = [links[pair] for pair in pairs]
                samples = allocated(chosen, [costs[level] for level in levels], [have[k] for k in levels], half_width)
                total = _cost(levels, samples, costs, have)
                found.append(Plan(levels, samples, total))
    least = min(one.cost for one in found)
    fitting = [one for one in found if one.cost * PAYS <= least]
    return max(fitting, key=lambda one: (len(one.levels), -one.cost, one.levels))


def allocated(links: Sequence[Link], costs: Sequence[float], have: Sequence[int], half_width: float) -> tuple[int, ...]:
    """Return the samples of each level of a chain for an accuracy, none fewer than exist or than a finer level has."""
    slopes = [link.slope for link in links]
    shares = [math.prod(slopes[k + 1 :]) ** 2 * link.variance for k, link in enumerate(links)]
    allowed = (AIM * half_width / NORMAL) ** 2
    samples, free = list(have), set(range(len(links)))
    while free:
        fixed = sum(shares[k] / samples[k] for k in range(len(links)) if k not in free)
        left = allowed - fixed
        scale = sum(math.sqrt(shares[k] * costs[k]) for k in free) / left
        wanted = {k: scale * math.sqrt(shares[k] / costs[k]) for k in free}
        enough = {k for k in free if wanted[k] <= have[k]}
        for k in free - enough:
            samples[k] = _whole(wanted[k])
        if not enough or enough == free:
            break
        free -= enough
    rising = np.maximum.accumulate(np.maximum(samples, have)[::-1])[::-1]
    return tuple(int(n) for n in rising)


def predicted(links: Sequence[Link], samples: Sequence[int]) -> float:
    """Return the variance of the answer that a chain would have with so many samples."""
    slopes = [link.slope for link in links]
    return sum(math.prod(slopes[k + 1 :]) ** 2 * link.variance / samples[k] for k, link in enumerate(links))


def plain_cost(variance: float, cost: float, half_width: float) -> float:
    """Return the cost of the plain mean of one level for an accuracy."""
    return max(variance * (NORMAL / half_width) ** 2, 1.0) * cost


MOST = 10**7


def _whole(number: float) -> int:
    return math.ceil(min(number, MOST))


def _cost(levels: Sequence[int], samples: Sequence[int], costs: Sequence[float], have: Sequence[int]) -> float:
    """Return the cost of all samples, those of unused levels included: nested seeds have them on hand."""
    used = dict(zip(levels, samples, strict=True))
    return sum(used.get(level, have[level]) * cost for level, cost in enumerate(costs))
