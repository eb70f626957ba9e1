"""Means over an ensemble of surfaces, from samples on several levels of resolution.

Symbols: Y_l is a quantity of one surface on level l, coarsest first; n_l samples; seed s on two levels is one surface.

Three estimators of the mean μ of the finest level are here:

- `telescoping`: Σ mean(Y_l - Y_{l-1}), with samples of their own for each difference (Giles, Oper. Res. 56 (2008) 607);
- `best_linear`: the best linear unbiased one for any groups of levels, given their covariance (Schaden & Ullmann,
  SIAM/ASA J. Uncertainty Quantification 8 (2020) 601);
- `chain`: the same for nested seeds, with the covariance estimated from the samples. Campaigns use it.

**The chain.** Level l has the seeds 0 … n_l - 1, so the finer levels have fewer. The mean of each level follows from
that of its parent, the next coarser level of the chain, by regression on the seeds that both have:

    μ_l = mean(Y_l) + b_l (μ_parent - mean(Y_parent)),        means over the n_l seeds of level l.

For Gaussian samples this is the maximum likelihood (Anderson, J. Am. Stat. Assoc. 52 (1957) 200) if Y_l depends on
coarser levels through its parent. With b_l = 1 it is the telescoping sum. A quantity that halves from level to level
has b_l = 1/2, and gains as much as one that does not change.

**Few samples.** The finest level has the fewest samples, and chance makes some variances far too small. Four measures:

1. A slope of one's own needs `OWN_SLOPE` samples. Fewer take the slope of the next coarser link: any slope that does
   not come from the same samples leaves the estimate unbiased.
2. The variance of a slope is part of the variance of the mean (Cochran, Sampling Techniques, 1977, section 12.7).
3. A residual variance with fewer than `FULL` degrees of freedom is pooled with `SHRINK` times that of the next coarser
   link if that is larger. Residuals shrink to less than this from level to level (docs/ensemble.md), so the pooled
   variance errs on the large side. A larger variance of its own is never pooled: it keeps its few degrees of freedom
   and the wide t quantile that goes with them.
4. The interval is Student's, with the degrees of freedom of Welch and Satterthwaite for the sum of variances.

**Stopping.** A campaign ends when its interval is narrow, so it ends sooner where chance made a variance small. For one
mean that costs a few samples, however many there are (Anscombe, Proc. Camb. Phil. Soc. 48 (1952) 600; Simons, Ann.
Math. Stat. 39 (1968) 1946). The argument `stopping` of `chain` takes them off: s²/n becomes s² (1 + stopping/ν)/n. The
choice among chains has the same effect. Few levels have that choice: a parent other than the next coarser level needs
`MANY` samples.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from roughvol.typing import Array

COVERAGE = 0.95
OWN_SLOPE = 8  # samples from which on a level has a slope of its own
FULL = 12  # degrees of freedom up to which a variance is pooled; t(0.975; 12) = 2.18
SHRINK = 0.5  # residual variance of a link over that of the next coarser one, at the most
MANY = 60  # samples from which on a level may have another parent than the next coarser level
LEAST = 2  # samples without which a level has no variance


@dataclass(frozen=True)
class Link:
    """One level of a chain: its regression on its parent, or its plain mean at the coarsest level.

    Attributes
    ----------
    level, parent : int
        Places in the list of levels; the parent of the coarsest is -1.
    samples : int
        Number of seeds of the level.
    slope : float
        b; 0 at the coarsest level.
    variance : float
        Of the residual Y - b Y_parent, or of Y at the coarsest level.
    freedom : float
        Degrees of freedom of that variance.
    leverage : float
        Variance of the slope over the residual variance, 0 for a slope that is given.
    away : float
        Distance of the mean of the parent from its mean over the seeds of this level.
    """

    level: int
    parent: int
    samples: int
    slope: float
    variance: float
    freedom: float
    leverage: float = 0.0
    away: float = 0.0

    @property
    def of_mean(self) -> float:
        """Variance that this level alone adds to its mean."""
        return self.variance * (1.0 / self.samples + self.away**2 * self.leverage)


@dataclass(frozen=True)
class Mean:
    """An estimate of a mean: value, variance, degrees of freedom, and the links behind it, coarsest first."""

    value: float
    variance: float
    freedom: float
    links: tuple[Link, ...] = ()

    @property
    def half_width(self) -> float:
        """Half-width of the 95 % interval."""
        return quantile(self.freedom) * math.sqrt(self.variance)


@functools.lru_cache(maxsize=4096)
def quantile(freedom: float) -> float:
    """Return Student's quantile of 97.5 % for so many degrees of freedom, which need not be whole."""
    return float(student.ppf(0.5 * (1.0 + COVERAGE), freedom))


def plain(values: Array) -> Mean:
    """Return the mean of independent samples of one level, shape (n,), with its t interval."""
    link = _base(0, values)
    return Mean(float(values.mean()), link.of_mean, link.freedom, (link,))


def telescoping(differences: Sequence[Array]) -> Mean:
    """Return the multilevel estimate from independent samples of each difference (Giles 2008).

    Parameters
    ----------
    differences : sequence of arrays
        Samples of Y_0, of Y_1 - Y_0, of Y_2 - Y_1 …, each of shape (n_l,), each from seeds of its own.

    Returns
    -------
    Mean
        Sum of the means; variances add up.
    """
    links = tuple(_base(level, each) for level, each in enumerate(differences))
    terms = [(link.of_mean, link.freedom) for link in links]
    return Mean(float(sum(each.mean() for each in differences)), *_summed(terms), links)


def best_linear(groups: Sequence[tuple[Sequence[int], Array]], covariance: Array) -> tuple[Array, Array]:
    """Return the best linear unbiased estimate of the means of all levels, and its covariance.

    Minimises the variance over all weights of all samples (Schaden & Ullmann 2020, eq. 2.10).

    Parameters
    ----------
    groups : sequence of (levels, values)
        Samples that share seeds: the levels they are on, and values of shape (n, number of these levels). Groups are
        independent.
    covariance : array, shape (levels, levels)
        Covariance of one surface on all levels.

    Returns
    -------
    means : array, shape (levels,)
        Estimates; NaN for levels without a group.
    covariance : array, shape (levels, levels)
        Covariance of the means; NaN for levels without a group.
    """
    size = len(covariance)
    information, right = np.zeros((size, size)), np.zeros(size)
    for levels, values in groups:
        place = np.asarray(levels)
        inverse = np.linalg.inv(covariance[np.ix_(place, place)])
        information[np.ix_(place, place)] += len(values) * inverse
        right[place] += inverse @ values.sum(axis=0)
    held = np.flatnonzero(information.diagonal() > 0.0)
    means, spread = np.full(size, np.nan), np.full((size, size), np.nan)
    inverse = np.linalg.inv(information[np.ix_(held, held)])
    means[held], spread[np.ix_(held, held)] = inverse @ right[held], inverse
    return means, spread


def links_of(values: Sequence[Array]) -> dict[tuple[int, int], Link]:
    """Return the links of all pairs (level, parent) that a chain may have; parent -1 for a level as the coarsest.

    Parameters
    ----------
    values : sequence of arrays
        Samples of every level, coarsest first, shape (n_l,); values[l][s] is of seed s. A parent has all seeds of its
        level. Levels with fewer than `MANY` samples are linked to their neighbour only.

    Returns
    -------
    dict
        Links by (level, parent).
    """
    found: dict[tuple[int, int], Link] = {}
    for level, own in enumerate(values):
        if own.size < LEAST:
            continue
        found[level, -1] = _base(level, own)
        for parent in range(level):
            borrowed = found.get((level - 1, level - 2)) if level > 1 else None
            enough = parent == level - 1 or own.size >= MANY
            if enough and values[parent].size >= own.size:
                found[level, parent] = _link(level, parent, own, values[parent], borrowed)
    return found


def ladder(links: Mapping[tuple[int, int], Link], level: int) -> tuple[int, ...]:
    """Return the chain to a level on which each has the nearest parent that it can have."""
    found = [level]
    while parents := [parent for own, parent in links if own == found[0] and parent >= 0]:
        found.insert(0, max(parents))
    return tuple(found)


def variance_of(links: Mapping[tuple[int, int], Link], levels: Sequence[int]) -> float:
    """Return the variance over surfaces on the finest level of a chain: its residual, and what it has of its parent."""
    total, parent = 0.0, -1
    for level in levels:
        link = links[level, parent]
        total, parent = link.variance + link.slope**2 * total, level
    return total


def chain(
    values: Sequence[Array],
    levels: Sequence[int],
    links: Mapping[tuple[int, int], Link] | None = None,
    stopping: float = 0.0,
) -> Mean:
    """Return the mean of the finest level of a chain, from nested seeds.

    Parameters
    ----------
    values : sequence of arrays
        As for `links_of`.
    levels : sequence of int
        Places of the levels used, rising.
    links : dict, optional
        `links_of` the same values.
    stopping : float
        Samples that it costs to stop at a narrow interval; 0 for numbers of samples that are given.

    Returns
    -------
    Mean
        Value, variance and degrees of freedom.
    """
    links = links_of(values) if links is None else links
    terms: list[tuple[float, float]] = []
    used: list[Link] = []
    mean, parent = 0.0, -1
    for level in levels:
        link, own = links[level, parent], values[level]
        if parent < 0:
            mean = float(own.mean())
        else:
            before = float(values[parent][: own.size].mean())
            away = mean - before
            mean = float(own.mean()) + link.slope * away
            link = replace(link, away=away)
        terms = [(link.slope**2 * variance, freedom) for variance, freedom in terms]
        terms.append(((1.0 + stopping / link.freedom) * link.of_mean, link.freedom))
        used.append(link)
        parent = level
    return Mean(mean, *_summed(terms), tuple(used))


def correlation(fine: Array, coarse: Array) -> float:
    """Return Pearson's ρ of one quantity on two levels, over the seeds that both have; NaN for fewer than three."""
    n = min(fine.size, coarse.size)
    x, y = coarse[:n], fine[:n]
    if n < 3 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return math.nan
    return float(np.corrcoef(x, y)[0, 1])


def _base(level: int, values: Array) -> Link:
    n = values.size
    return Link(level, -1, n, 0.0, float(values.var(ddof=1)) if n > 1 else math.inf, max(n - 1.0, 1.0))


def _link(level: int, parent: int, fine: Array, coarse: Array, borrowed: Link | None) -> Link:
    """Return the regression of a level on its parent; measures 1 and 3 of the module's docstring."""
    n = fine.size
    x, y = coarse[:n] - coarse[:n].mean(), fine - fine.mean()
    spread = float(x @ x)
    leverage = 0.0
    if n >= OWN_SLOPE and spread > 0.0:
        slope, freedom, leverage = float(x @ y) / spread, n - 2.0, 1.0 / spread
    else:
        slope, freedom = borrowed.slope if borrowed else 1.0, n - 1.0
    residual = y - slope * x
    variance = float(residual @ residual) / freedom
    guess = SHRINK * borrowed.variance if borrowed is not None else 0.0
    if borrowed is not None and freedom < FULL and guess > variance:
        more = min(FULL - freedom, borrowed.freedom)
        variance = (freedom * variance + more * guess) / (freedom + more)
        freedom += more
    return Link(level, parent, n, slope, variance, freedom, leverage)


def _summed(terms: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return a sum of variances and its degrees of freedom (Satterthwaite, Biometrics 2 (1946) 110)."""
    total = sum(variance for variance, _ in terms)
    below = sum(variance**2 / freedom for variance, freedom in terms)
    if not math.isfinite(total) or below == 0.0:
        return total, 1.0 if not math.isfinite(total) else math.inf
    return total, total**2 / below
