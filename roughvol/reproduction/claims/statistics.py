"""Intervals over surfaces: Student's t for a mean, a seeded bootstrap for other statistics.

Every interval has 95 % coverage. The surfaces of a study are independent (one seed each); numbers of one seed at
several D or m are matched, and their differences are taken before the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from roughvol.ensemble.multilevel import COVERAGE, half_width, quantile
from roughvol.reproduction.claims.verdict import Number
from roughvol.typing import Array, Index

RESAMPLES = 2000
BOOTSTRAP_SEED = 336  # any number, fixed: the report must not change from one run to the next


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


def bootstrap(key: str, name: str, statistic: Callable[[Index], float], n: int) -> Number:
    """Return a statistic of n surfaces, given by their numbers (n,), with its percentile interval over resamples."""
    value = statistic(np.arange(n))
    if n < 2:
        return Number(key, name, value, value, value, n)
    draws = np.random.Generator(np.random.PCG64(BOOTSTRAP_SEED)).integers(0, n, (RESAMPLES, n))
    # A draw of one surface n times has no scatter and may have no statistic; it is as good as never drawn.
    resampled = _known([statistic(draw) for draw in draws])
    tail = 0.5 * (1.0 - COVERAGE)
    low, high = np.quantile(resampled, [tail, 1.0 - tail]) if resampled.size else (value, value)
    return Number(key, name, value, float(low), float(high), n, f"bootstrap, {RESAMPLES} resamples")


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
