"""Intervals over surfaces: Student's t for a mean, the jackknife for other statistics.

Every interval has 95 % coverage. The surfaces of a study are independent (one seed each); numbers of one seed at
several D or m are matched, and their differences are taken before the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from roughvol.ensemble.multilevel import half_width, quantile
from roughvol.reproduction.claims.verdict import Number
from roughvol.typing import Array, Index


def mean(key: str, name: str, values: ArrayLike) -> Number:
    """Return the mean over surfaces with its t interval, x̄ ± t(0.975; n-1) s/√n; NaN are left out."""
    return _with_interval(key, name, values, "t", half_width)


def single(key: str, name: str, values: ArrayLike) -> Number:
    """Return the interval in which one more surface falls, x̄ ± t(0.975; n-1) s √(1 + 1/n), for a paper with one."""

    def of_one(scatter: float, n: float) -> float:
        return quantile(n - 1) * scatter * math.sqrt(1.0 + 1.0 / n)

    return _with_interval(key, name, values, "t, one surface", of_one)


def ratio(key: str, name: str, values: ArrayLike) -> Number:
    """Return the geometric mean of positive ratios, its t interval taken on their logarithms."""
    logs = mean(key, name, np.log(_known(values)))
    low, value, high = (math.exp(number) for number in (logs.low, logs.value, logs.high))
    return Number(key, name, value, low, high, logs.n, logs.method and "t of the logarithm")


def jackknife(key: str, name: str, statistic: Callable[[Index], float], n: int) -> Number:
    """Return a positive statistic of n surfaces, given by their numbers (n,), with the t interval of its logarithm.

    The scatter is that of the statistic without each surface in turn (Tukey, Ann. Math. Stat. 29 (1958) 614).
    Percentiles of resamples are too high for a ratio over a scatter: surfaces drawn twice scatter less.
    """
    every = np.arange(n)
    value = statistic(every)
    if n < 2:
        return Number(key, name, value, value, value, n)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # a statistic of 0 has no interval
        scatter = np.std(np.log([statistic(np.delete(every, k)) for k in every]), ddof=1)
        factor = float(np.exp(half_width((n - 1) * float(scatter), n)))
    return Number(key, name, value, value / factor, value * factor, n, "jackknife and t of the logarithm")


def exact(key: str, name: str, value: float, n: int = 1) -> Number:
    """Return a number that has no interval: a count, an extreme, an identity."""
    return Number(key, name, float(value), float(value), float(value), n)


def slope(x: ArrayLike, y: ArrayLike) -> float:
    """Return the slope of the least-squares line through (x, y), pairs with a NaN left out; NaN for fewer than two."""
    abscissa, ordinate = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    mask = np.isfinite(abscissa) & np.isfinite(ordinate)
    abscissa, ordinate = abscissa[mask], ordinate[mask]
    if abscissa.size < 2 or np.ptp(abscissa) == 0.0:
        return math.nan
    centred = abscissa - abscissa.mean()
    return float(centred @ ordinate / (centred @ centred))


def straightness(x: ArrayLike, y: ArrayLike) -> float:
    """Return R², the share of the variance of y that the least-squares line explains."""
    abscissa, ordinate = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    centred = ordinate - ordinate.mean()
    rest = centred - slope(abscissa, ordinate) * (abscissa - abscissa.mean())
    total = float(centred @ centred)
    return 1.0 - float(rest @ rest) / total if total > 0.0 else 1.0


def _known(values: ArrayLike) -> Array:
    numbers = np.asarray(values, dtype=np.float64).ravel()
    return numbers[np.isfinite(numbers)]


def _with_interval(
    key: str, name: str, values: ArrayLike, method: str, half_of: Callable[[float, float], float]
) -> Number:
    finite = _known(values)
    n = int(finite.size)
    value = float(finite.mean()) if n else math.nan
    if n < 2:
        return Number(key, name, value, value, value, n)
    half = half_of(float(finite.std(ddof=1)), n)
    return Number(key, name, value, value - half, value + half, n, method)
