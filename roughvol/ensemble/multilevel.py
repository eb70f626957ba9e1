"""Multilevel estimators of the mean over an ensemble of surfaces.

Symbols: Y_l is a quantity of one surface on level l, coarsest first; n_l is the number of samples of level l. A seed on
two levels is one surface.

The estimator is the best linear combination of nested samples, with the covariance estimated from the samples
(Schaden & Ullmann, SIAM/ASA J. Uncertainty Quantification 8 (2020) 601). Independent samples of each difference would
be multilevel Monte Carlo (Giles, Oper. Res. 56 (2008) 607).

**The chain.** Level l has the seeds 0 … n_l - 1, and a finer level has fewer. The parent of a level is the next coarser
level of the chain. The mean of each level follows by regression on the seeds in common with its parent:

    μ_l = mean(Y_l) + b_l (μ_parent - mean(Y_parent)),        means over the n_l seeds of level l.

For Gaussian samples this is the maximum likelihood (Anderson, J. Am. Stat. Assoc. 52 (1957) 200) if Y_l depends on
coarser levels through its parent only. With b_l = 1 it is the telescoping sum. A quantity that halves from level to
level has b_l = 1/2, with the same reduction of variance.

**Surfaces alone.** Numbers X of an undeformed surface, as z_max/Sq and Sq/(L Sdq), cost no solve. Their mean ξ is known
from far more seeds, N of them. Each level is regressed on them beside its parent (control variates):

    μ_l = mean(Y_l) + b_l (μ_parent - mean(Y_parent)) + c_l·(ξ - mean(X))

With the total coefficient g_l = c_l + b_l g_parent, they add g·Cov(X)·g/N to the variance of the last level. Residuals
are uncorrelated with X, so this sum is exact.

**Few samples.** The finest level has the fewest samples, and some of its sample variances are far too small by chance.
Four measures keep the coverage of the interval:

1. A level estimates its slope from `OWN_SLOPE` samples or more. With fewer it takes the slope of the next coarser link.
   A slope from other samples leaves the estimator unbiased. A level of fewer than `CONTROLLED` samples has c = 0.
2. The variance of a slope is part of the variance of the mean (Cochran, Sampling Techniques, 1977, section 12.7).
3. A residual variance of fewer than `POOLED_BELOW` degrees of freedom is pooled with `RESIDUAL_RATIO` times that of the
   next coarser link, if that is larger. Residual variances decrease faster than this, so the pooled
   variance is too large rather than too small. A variance above the coarser one is not pooled.
4. The interval is Student's, with the degrees of freedom of Welch and Satterthwaite for the sum of variances.

**Stopping.** A campaign ends at a narrow interval, hence sooner where the sample variance is too small by chance. For
one mean this is equivalent to a loss of a few samples, however many there are (Anscombe, Proc. Camb. Phil. Soc. 48
(1952) 600; Simons, Ann. Math. Stat. 39 (1968) 1946). The argument `stopping` of `chain` accounts for them: s²/n becomes
s² (1 + stopping/ν)/n. The choice among chains has the same effect. It is therefore restricted: a level of fewer than
`FREE_PARENT` samples has the next coarser level as its parent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import scipy

from roughvol.typing import Array

Scatter = TypeVar("Scatter", float, Array)
COVERAGE = 0.95  # probability that an interval contains the mean
OWN_SLOPE = 8  # fewest samples of a level with a slope of its own
POOLED_BELOW = 12  # degrees of freedom below which a variance is pooled; t(0.975; 12) = 2.18
RESIDUAL_RATIO = 0.5  # largest residual variance of a link over that of the next coarser link
FREE_PARENT = 60  # fewest samples of a level with a choice of its parent
CONTROLLED = 24  # fewest samples of a level that is regressed on surfaces alone
FEWEST = 2  # fewest samples of a level with a variance
FEWEST_PAIRS = 3  # fewest seeds in common for a correlation
NONE_ALONE = np.zeros((0, 0))  # numbers of no surfaces alone


@dataclass(frozen=True, eq=False)
class Link:
    """The regression of a level on its parent; the plain mean for the coarsest level of a chain."""

    level: int
    parent: int  # -1 for the coarsest level
    samples: int
    slope: float  # b; 0 for the coarsest level
    variance: float  # of the residual Y - b Y_parent; of Y for the coarsest level
    freedom: float
    gains: tuple[float, ...] = ()  # c; empty without a regression on surfaces alone
    alone: float = math.inf  # variance of the residual about the parent alone
    leverage: Array | None = None  # covariance of slope and gains over the variance; None if the slope is given
    shift: Array | None = None  # means of parent and surfaces alone, minus those over the seeds of the level

    @property
    def mean_variance(self) -> float:
        """Contribution of this level to the variance of its mean."""
        if self.leverage is None or self.shift is None or not self.shift.size:
            return self.variance / self.samples
        return self.variance * (1.0 / self.samples + float(self.shift @ self.leverage @ self.shift))


@dataclass(frozen=True)
class Mean:
    """An estimate of a mean: value, variance, degrees of freedom, and the links of its chain, coarsest first."""

    value: float
    variance: float
    freedom: float
    links: tuple[Link, ...] = ()

    @property
    def half_width(self) -> float:
        """Half-width of the 95 % interval."""
        return quantile(self.freedom) * math.sqrt(self.variance)


def quantile(freedom: float) -> float:
    """Return Student's quantile of 97.5 %, also for fractional degrees of freedom."""
    return float(scipy.special.stdtrit(freedom, 0.5 * (1.0 + COVERAGE)))


def half_width(scatter: Scatter, samples: float) -> Scatter:
    """Return Student's half-width of the 95 % interval of a mean, from the standard deviation of its samples."""
    return quantile(samples - 1) * scatter / math.sqrt(samples)


def links_of(values: Sequence[Array], alone: Array = NONE_ALONE) -> dict[tuple[int, int], Link]:
    """Return the links of all pairs (level, parent) that a chain may use; parent -1 where a chain begins.

    ``values[l][s]`` is of level l, coarsest first, and seed s; ``alone`` are numbers of surfaces alone, shape (N, k).
    """
    links: dict[tuple[int, int], Link] = {}
    for level, fine in enumerate(values):
        if fine.size < FEWEST:
            continue
        links[level, -1] = _base(level, fine, alone)
        coarser_link = links.get((level - 1, level - 2)) if level > 1 else None
        for parent in range(level):
            eligible = parent == level - 1 or fine.size >= FREE_PARENT
            if eligible and values[parent].size >= fine.size:
                links[level, parent] = _link(level, parent, fine, values[parent], coarser_link, alone)
    return links


def nearest_chain(links: Mapping[tuple[int, int], Link], level: int) -> tuple[int, ...]:
    """Return the chain to a level in which every parent is the nearest possible, coarsest first."""
    levels = [level]
    while parents := [parent for child, parent in links if child == levels[0] and parent >= 0]:
        levels.insert(0, max(parents))
    return tuple(levels)


def level_variance(links: Mapping[tuple[int, int], Link], levels: Sequence[int], alone: Array = NONE_ALONE) -> float:
    """Return the variance over surfaces on the finest level of a chain from all levels: r_l + g_l·Cov(X)·g_l.

    Here r_l = s_l² + b_l² r_parent.
    """
    total, parent, used = 0.0, -1, []
    for level in levels:
        link = links[level, parent]
        total, parent = link.variance + link.slope**2 * total, level
        used.append(link)
    return total + variance_alone(used, alone)


def variance_alone(links: Sequence[Link], alone: Array) -> float:
    """Return the part of the variance of the last level that surfaces alone explain, g·Cov(X)·g."""
    if len(alone) < FEWEST:
        return 0.0
    total = np.zeros(alone.shape[1])
    for link in links:
        total = link.slope * total + (np.array(link.gains) if link.gains else 0.0)
    return float(np.var(alone @ total, ddof=1))


def chain(
    values: Sequence[Array],
    levels: Sequence[int],
    links: Mapping[tuple[int, int], Link] | None = None,
    stopping: float = 0.0,
    alone: Array = NONE_ALONE,
) -> Mean:
    """Return the mean of the finest level of a chain from nested seeds; ``stopping`` as in the module's docstring."""
    links = links_of(values, alone) if links is None else links
    terms: list[tuple[float, float]] = []
    used: list[Link] = []
    mean, parent = 0.0, -1
    for level in levels:
        link, fine = links[level, parent], values[level]
        shift = [] if parent < 0 else [mean - float(values[parent][: fine.size].mean())]
        if link.gains:
            shift += [float(x) for x in alone.mean(axis=0) - alone[: fine.size].mean(axis=0)]
        slopes = [link.slope] * (parent >= 0) + list(link.gains)
        mean = float(fine.mean()) + sum(slope * each for slope, each in zip(slopes, shift, strict=True))
        link = replace(link, shift=np.array(shift))
        terms = [(link.slope**2 * variance, freedom) for variance, freedom in terms]
        terms.append(((1.0 + stopping / link.freedom) * link.mean_variance, link.freedom))
        used.append(link)
        parent = level
    if len(alone) >= FEWEST:
        terms.append((variance_alone(used, alone) / len(alone), len(alone) - 1.0))
    return Mean(mean, *_summed(terms), tuple(used))


def _base(level: int, values: Array, alone: Array) -> Link:
    """Return the level at which a chain begins: its plain mean, or its regression on surfaces alone."""
    n = values.size
    variance = float(values.var(ddof=1))
    if len(alone) >= n >= CONTROLLED:
        gains, residual, freedom, leverage = _regression(values, alone[:n])
        return Link(level, -1, n, 0.0, residual, freedom, tuple(gains), variance, leverage)
    return Link(level, -1, n, 0.0, variance, n - 1.0, alone=variance)


def _link(level: int, parent: int, fine: Array, coarse: Array, coarser_link: Link | None, alone: Array) -> Link:
    """Return the regression of a level on its parent; measures 1 and 3 of the module's docstring."""
    n = fine.size
    x, y = coarse[:n] - coarse[:n].mean(), fine - fine.mean()
    spread = float(x @ x)
    leverage: Array | None = None
    if n >= OWN_SLOPE and spread > 0.0:
        slope, freedom, leverage = float(x @ y) / spread, n - 2.0, np.array([[1.0 / spread]])
    else:
        slope, freedom = coarser_link.slope if coarser_link else 1.0, n - 1.0
    residual = y - slope * x
    variance = float(residual @ residual) / freedom
    if len(alone) >= n >= CONTROLLED and spread > 0.0:
        slopes, controlled, freedom, leverage = _regression(fine, np.column_stack([coarse[:n], alone[:n]]))
        return Link(level, parent, n, slopes[0], controlled, freedom, tuple(slopes[1:]), variance, leverage)
    pooled = variance
    if coarser_link is not None and freedom < POOLED_BELOW:
        bound = RESIDUAL_RATIO * coarser_link.alone
        if bound > variance:
            added = min(POOLED_BELOW - freedom, coarser_link.freedom)
            pooled = (freedom * variance + added * bound) / (freedom + added)
            freedom += added
    return Link(level, parent, n, slope, pooled, freedom, alone=pooled, leverage=leverage)


def _regression(y: Array, predictors: Array) -> tuple[list[float], float, float, Array]:
    """Return slopes, residual variance, its degrees of freedom, and the covariance of the slopes over the variance."""
    centred, target = predictors - predictors.mean(axis=0), y - y.mean()
    leverage = np.linalg.pinv(centred.T @ centred)
    slopes = leverage @ centred.T @ target
    residual = target - centred @ slopes
    freedom = float(y.size - 1 - predictors.shape[1])
    return slopes.tolist(), float(residual @ residual) / freedom, freedom, leverage


def _summed(terms: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the sum of pairs of a variance and its degrees of freedom (Satterthwaite, Biometrics 2 (1946) 110)."""
    total = sum(variance for variance, _ in terms)
    if not math.isfinite(total):
        return total, 1.0
    denominator = sum(variance**2 / freedom for variance, freedom in terms)
    return total, total**2 / denominator if denominator else math.inf


def correlation(fine: Array, coarse: Array) -> float:
    """Return Pearson's ρ of a quantity on two levels over common seeds; NaN for too few, or without scatter."""
    n = min(fine.size, coarse.size)
    x, y = coarse[:n], fine[:n]
    if n < FEWEST_PAIRS or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return math.nan
    return float(np.corrcoef(x, y)[0, 1])
