"""Estimates of the means of an ensemble: intervals from all levels, errors besides, and the optimal samples.

**Bias by the resolution.** Symbols: μ_l mean on level l; e_l = μ_l - μ_{l-1}. If |e_l| ~ 2^(-α l), the bias of the
finest level M is

    Σ e_l over l > M ≈ max over the last three levels of |e_l| 2^(-α (M - l)) / (2^α - 1)          (Giles 2008).

A quantity that falls by the same factor on every level, as A* does, has no limit but zero. Its e_l decrease in
proportion to μ_l, and its bias is μ_M itself. Hence α is the rate of the *relative* steps |e_l/μ_l|. A mean with a bias
above a share `SIZEABLE` of itself is taken as divergent.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from roughvol.ensemble import allocation, multilevel
from roughvol.ensemble.allocation import Plan
from roughvol.ensemble.multilevel import Link, Mean
from roughvol.ensemble.samples import SampleTable
from roughvol.ensemble.step_error import SHARE
from roughvol.ensemble.targets import Target
from roughvol.typing import Array

STOPPING = 3.0  # samples lost by stopping at a narrow interval (see `multilevel`)
RELIABLE = 60  # samples of a level that determine its variance to 20 %
SIGNIFICANT = 2.0  # standard errors above which a step is significant
LEAST_RATE = -0.25  # smallest α of a mean that converges
SIZEABLE = 0.2  # largest bias of a mean that converges, as a share of it; A* has 0.5
FLATTEST = 0.5  # smallest α of the extrapolation, as in Giles (2008)
UNKNOWN_RATE = 1.0  # α of the extrapolation without a fit
WINDOW = 5  # number of steps fitted, the finest ones
LOOKED_BACK = 3  # number of steps extrapolated, the finest ones
FIT_NOISE = 0.1  # error added in the fit to log2 of each step, for departures from a power law


@dataclass(frozen=True)
class MeanEstimate:
    """The estimate of one mean at one D."""

    target: Target
    mean: Mean  # on the finest level
    plan: Plan  # optimal chain of levels and its samples
    costs: tuple[float, ...]  # mean modelled seconds of a sample, by level
    level_means: tuple[float, ...]
    level_variances: tuple[float, ...]  # over surfaces
    residual_variances: tuple[float, ...]  # about the regression on the coarser level; all of it on the coarsest
    correlations: tuple[float, ...]  # Pearson's ρ of each level with the next coarser one
    interpolation_error: float  # between steps
    solver_error: float  # certified bound; 0 without one
    bias: float  # by the resolution, |μ_∞ - μ_M|; NaN for a mean without a limit
    alone: Array  # numbers of surfaces without a solve

    @property
    def requested(self) -> float:
        """Half-width that the study requests."""
        return self.target.accuracy.of(self.mean.value)

    @property
    def reached(self) -> bool:
        """Whether the interval is as narrow as requested."""
        return self.mean.half_width <= self.requested

    @property
    def converges(self) -> bool:
        """Whether the mean has a limit."""
        return math.isfinite(self.bias)

    @property
    def steps_suffice(self) -> bool:
        """Whether the error between steps is at most a tenth of the accuracy."""
        return self.interpolation_error <= SHARE * self.requested

    @property
    def plain_cost(self) -> float:
        """Modelled seconds of plain Monte Carlo on the finest level, for the same accuracy."""
        return allocation.plain_cost(self.level_variances[-1], self.costs[-1], self.target.half_width(self.mean.value))


def estimates_of(table: SampleTable, D: float, step_errors: Sequence[float]) -> list[MeanEstimate]:
    """Return the estimates of all means at one D, from samples on every level and the errors between steps."""
    costs = tuple(table.costs(D))
    return [_estimate(table, D, number, costs, error) for number, error in enumerate(step_errors)]


def _estimate(table: SampleTable, D: float, number: int, costs: tuple[float, ...], step_error: float) -> MeanEstimate:
    target, values, alone = table.targets[number], table.values(D, number), table.alone(D)
    links = multilevel.links_of(values, alone)
    chains = [multilevel.nearest_chain(links, level) for level in range(len(values))]
    level_means = tuple(multilevel.chain(values, levels, links, alone=alone).value for levels in chains)
    mean, plan = _mean_and_plan(values, links, costs, target.half_width(level_means[-1]), alone)
    return MeanEstimate(
        target,
        mean,
        plan,
        costs,
        level_means,
        tuple(multilevel.level_variance(links, chain, alone) for chain in chains),
        tuple(links[chain[-1], chain[-2] if len(chain) > 1 else -1].alone for chain in chains),
        tuple(multilevel.correlation(fine, coarse) for coarse, fine in itertools.pairwise(values)),
        step_error * target.accuracy.of(mean.value),
        float(np.max([sample.solver_errors[number] for level in table.of(D) for sample in level])),
        _bias(values, level_means),
        alone,
    )


def _mean_and_plan(
    values: Sequence[Array],
    links: Mapping[tuple[int, int], Link],
    costs: Sequence[float],
    half_width: float,
    alone: Array,
) -> tuple[Mean, Plan]:
    """Return the mean by the optimal chain of levels, and the samples of that chain for a half-width."""
    existing = [level.size for level in values]
    reliable = _with_reliable_bases(links, existing, alone)
    plan = allocation.plan(reliable, costs, existing, half_width, alone)
    mean = multilevel.chain(values, plan.levels, links, STOPPING, alone)
    as_planned = plan.samples == tuple(existing[level] for level in plan.levels) and plan.alone == len(alone)
    if mean.half_width > half_width and as_planned:
        # The plan uses the normal quantile, the interval Student's, which is larger: plan for a narrower interval.
        shares = zip(allocation.shares_of(mean.links), mean.links, strict=True)
        variance = sum(share / link.samples for share, link in shares)
        variance += multilevel.variance_alone(mean.links, alone) / len(alone)
        quantile = max(mean.half_width / math.sqrt(variance), allocation.NORMAL)
        plan = allocation.plan(reliable, costs, existing, half_width * allocation.NORMAL / quantile, alone)
    return mean, plan


def _with_reliable_bases(
    links: Mapping[tuple[int, int], Link], samples: Sequence[int], alone: Array
) -> dict[tuple[int, int], Link]:
    """Return links in which a coarsest level of few samples has the variance by regression on coarser levels.

    A variance of ten samples is often too small by chance, and would attract the optimal chain.
    """
    reliable = dict(links)
    for level, number in enumerate(samples):
        if number < RELIABLE and (level, -1) in links:
            base, nearest = links[level, -1], multilevel.nearest_chain(links, level)
            variance = multilevel.level_variance(links, nearest, multilevel.NONE_ALONE if base.gains else alone)
            reliable[level, -1] = replace(base, variance=variance)
    return reliable


def _bias(values: Sequence[Array], level_means: Sequence[float]) -> float:
    """Return the bias by the resolution, from the differences of adjacent levels on common seeds."""
    differences = [fine[: coarse.size] - coarse[: fine.size] for coarse, fine in itertools.pairwise(values)]
    steps = [float(difference.mean()) for difference in differences]
    return bias_of(level_means, steps, [float(each.std(ddof=1)) / math.sqrt(each.size) for each in differences])


def bias_of(means: Sequence[float], steps: Sequence[float], noise: Sequence[float]) -> float:
    """Return the bias by the resolution from the means, their steps on common seeds, and the noise of each step.

    NaN for a mean without a limit. Without a significant step the bias is that of the noise.
    """
    size = np.abs(np.asarray(steps, dtype=np.float64))[-WINDOW:]
    spread = np.asarray(noise, dtype=np.float64)[-WINDOW:]
    scale = np.abs(np.asarray(means, dtype=np.float64))[1:][-WINDOW:]
    if not size.size:
        return math.nan
    significant = size > SIGNIFICANT * spread
    rate = math.nan
    if significant.sum() >= 2 and np.all(scale[significant] > 0.0):
        logs = np.log2(size[significant] / scale[significant])
        weights = 1.0 / np.hypot(spread[significant] / size[significant] / math.log(2.0), FIT_NOISE)
        rate = -float(np.polyfit(np.flatnonzero(significant), logs, 1, w=weights)[0])
        if rate <= LEAST_RATE:
            return math.nan
    alpha = max(rate, FLATTEST) if math.isfinite(rate) else UNKNOWN_RATE
    levels_above = np.arange(size.size)[::-1]
    bound = np.where(significant, size, np.minimum(size + spread, SIGNIFICANT * spread))
    at_finest = (bound * 2.0 ** (-alpha * levels_above))[levels_above < LOOKED_BACK]
    bias = float(np.max(at_finest) / (2.0**alpha - 1.0))
    return bias if bias <= SIZEABLE * abs(means[-1]) else math.nan
