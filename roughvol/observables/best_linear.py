"""The best linear unbiased estimator of means on several levels, for a given covariance, and a sample correlation.

Campaigns use the chains of `multilevel`, which need no covariance of all levels. This one is the reference for them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from roughvol.typing import Array

FEWEST_PAIRS = 3  # fewest seeds in common for a correlation


def best_linear(groups: Sequence[tuple[Sequence[int], Array]], covariance: Array) -> tuple[Array, Array]:
    """Return the best linear unbiased estimate of the means of all levels, and its covariance.

    The weights of all samples minimise the variance (Schaden & Ullmann 2020, eq. 2.10).

    Parameters
    ----------
    groups : sequence of (levels, values)
        Samples with common seeds: indices of their levels, and values of shape (n, len(levels)). Groups are
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
        rows = np.asarray(levels)
        inverse = np.linalg.inv(covariance[np.ix_(rows, rows)])
        information[np.ix_(rows, rows)] += len(values) * inverse
        right[rows] += inverse @ values.sum(axis=0)
    sampled = np.flatnonzero(information.diagonal() > 0.0)
    means, spread = np.full(size, np.nan), np.full((size, size), np.nan)
    inverse = np.linalg.inv(information[np.ix_(sampled, sampled)])
    means[sampled], spread[np.ix_(sampled, sampled)] = inverse @ right[sampled], inverse
    return means, spread


def correlation(fine: Array, coarse: Array) -> float:
    """Return Pearson's ρ of a quantity on two levels, over the seeds in common.

    Parameters
    ----------
    fine, coarse : array, shapes (n,), (N,)
        Samples from seed 0 on.

    Returns
    -------
    float
        NaN for fewer than `FEWEST_PAIRS` seeds, or no scatter.
    """
    n = min(fine.size, coarse.size)
    x, y = coarse[:n], fine[:n]
    if n < FEWEST_PAIRS or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return math.nan
    return float(np.corrcoef(x, y)[0, 1])
