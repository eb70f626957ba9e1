"""The number of samples on each level in the next round: pilot, growth, and the limit of a budget."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from roughvol.ensemble import allocation
from roughvol.ensemble.estimate import RELIABLE, MeanEstimate
from roughvol.ensemble.samples import Counts

PILOT = 24  # pilot samples of a level coarser than those of `COSTLY`
COSTLY = {8: 10, 9: 4}  # pilot samples of the levels m = 8 and m = 9
FEWEST = 3  # pilot samples of a level finer than those of `COSTLY`
GROWTH = 4  # largest factor between the samples of a level in successive rounds
PART = 0.6  # share of the planned samples added to a level of fewer than `RELIABLE`
MOST_SURFACES = 100_000  # largest number of surfaces without a solve
MORE = 1.25  # growth of one level where the plan adds none


def pilot(levels: Sequence[int]) -> dict[int, int]:
    """Return the samples of the pilot by m."""
    return {m: COSTLY.get(m, PILOT if m < min(COSTLY) else FEWEST) for m in levels}


def next_counts(estimates: Sequence[MeanEstimate], levels: Sequence[int], existing: Sequence[int]) -> dict[int, int]:
    """Return the samples of each m after the next round; those that exist if all estimates are reached."""
    counts = _goal(estimates, existing)
    counts = [_approached(number, before) for number, before in zip(counts, existing, strict=True)]
    used = sorted({level for estimate in estimates for level in estimate.plan.levels}, reverse=True)
    for finer, coarser in itertools.pairwise(used):  # nested: a used coarser level has all seeds of a finer one
        counts[coarser] = max(counts[coarser], counts[finer])
    return dict(zip(levels, counts, strict=True))


def goal(estimates: Sequence[MeanEstimate], planned: Mapping[int, int]) -> dict[int, int]:
    """Return the samples of each m that the estimates require in the end, for the time left."""
    return dict(zip(planned, _goal(estimates, list(planned.values())), strict=True))


def _goal(estimates: Sequence[MeanEstimate], existing: Sequence[int]) -> list[int]:
    """Return the samples of each level that the estimates not yet reached require in the end."""
    counts = list(existing)
    for estimate in estimates:
        if not estimate.reached:
            counts = [max(pair) for pair in zip(counts, _required(estimate, existing), strict=True)]
    return counts


def _required(estimate: MeanEstimate, existing: Sequence[int]) -> list[int]:
    """Return the samples of each level that one estimate requires, at least one more than exist.

    Surfaces without a solve are made before the next round, and may suffice.
    """
    required = list(existing)
    for level, samples in zip(estimate.plan.levels, estimate.plan.samples, strict=True):
        required[level] = max(required[level], samples)
    lacking = len(estimate.alone.values) < min(estimate.plan.alone, MOST_SURFACES)
    if required == list(existing) and not lacking:  # Student's quantile is wider than the plan assumes
        level = _most_effective_level(estimate)
        required[level] = math.ceil(MORE * existing[level])
    return required


def _most_effective_level(estimate: MeanEstimate) -> int:
    """Return the level of the chain with the largest share of the variance for its cost."""
    links = estimate.mean.links
    shares = [
        weight * link.mean_variance / (link.samples * estimate.costs[link.level])
        for weight, link in zip(allocation.weights(links), links, strict=True)
    ]
    return links[int(np.argmax(shares))].level


def _approached(planned: int, existing: int) -> int:
    """Return the samples after the next round: part of the plan, where few samples make the variance uncertain."""
    if existing < RELIABLE and planned > MORE * existing:
        planned = existing + math.ceil(PART * (planned - existing))
    return min(planned, GROWTH * max(existing, 1))


def within_budget(
    left: float, spent: float, counts: Counts, planned: Counts, costs: Mapping[float, Sequence[float]]
) -> tuple[Counts, bool]:
    """Return the plan of a round that fits into the measured seconds left of a budget, and whether it is reduced."""
    done = _modelled(counts, costs)
    rate = spent / done if done > 0.0 else 1.0  # measured seconds over modelled ones
    needed = rate * (_modelled(planned, costs) - done)
    if needed <= left:
        return planned, False
    share = max(left, 0.0) / needed
    reduced = {
        D: {m: counts[D][m] + int(share * (number - counts[D][m])) for m, number in levels.items()}
        for D, levels in planned.items()
    }
    return reduced, True


def _modelled(counts: Counts, costs: Mapping[float, Sequence[float]]) -> float:
    """Return the modelled seconds of samples."""
    return sum(
        number * cost for D, levels in counts.items() for number, cost in zip(levels.values(), costs[D], strict=True)
    )
