"""The weak error of a multilevel estimator: the bias by the resolution, and whether a mean converges at all.

Symbols: μ_l mean on level l; e_l = μ_l - μ_{l-1}. If |e_l| ~ 2^(-α l), the bias of the finest level M is

    Σ e_l over l > M ≈ max over the last three levels of |e_l| 2^(-α (M - l)) / (2^α - 1)          (Giles 2008).

A quantity that falls by the same factor on every level, as A* does, has no limit but zero. Its e_l decrease in
proportion to μ_l, and its bias is μ_M itself. Hence α is the rate of the *relative* steps |e_l/μ_l|. A mean with a bias
above a share `SIZEABLE` of itself is taken as divergent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SIGNIFICANT = 2.0  # standard errors above which a step is significant
LEAST_RATE = -0.25  # smallest α of a mean that converges
SIZEABLE = 0.2  # largest bias of a mean that converges, as a share of it; A* has 0.5
FLATTEST = 0.5  # smallest α of the extrapolation, as in Giles (2008)
UNKNOWN_RATE = 1.0  # α of the extrapolation without a fit
WINDOW = 5  # number of steps fitted, the finest ones
LOOKED_BACK = 3  # number of steps extrapolated, the finest ones
FIT_NOISE = 0.1  # error added in the fit to log2 of each step, for departures from a power law


@dataclass(frozen=True)
class WeakError:
    """The bias by the resolution."""

    bias: float  # |μ_∞ - μ_M|; NaN without a limit
    rate: float  # α of the relative steps; NaN for fewer than two significant steps
    converges: bool  # whether the mean has a limit


def weak_error(means: Sequence[float], steps: Sequence[float], noise: Sequence[float]) -> WeakError:
    """Return the bias by the resolution from the means, their steps on common seeds, and the noise of each step.

    Without a significant step the mean counts as converged, and the bias is that of the noise.
    """
    size = np.abs(np.asarray(steps, dtype=np.float64))[-WINDOW:]
    spread = np.asarray(noise, dtype=np.float64)[-WINDOW:]
    scale = np.abs(np.asarray(means, dtype=np.float64))[1:][-WINDOW:]
    if not size.size:
        return WeakError(math.nan, math.nan, False)
    significant = size > SIGNIFICANT * spread
    rate, converges = math.nan, True
    if significant.sum() >= 2 and np.all(scale[significant] > 0.0):
        logs = np.log2(size[significant] / scale[significant])
        weights = 1.0 / np.hypot(spread[significant] / size[significant] / math.log(2.0), FIT_NOISE)
        rate = -float(np.polyfit(np.flatnonzero(significant), logs, 1, w=weights)[0])
        converges = rate > LEAST_RATE
    alpha = max(rate, FLATTEST) if math.isfinite(rate) else UNKNOWN_RATE
    levels_above = np.arange(size.size)[::-1]
    bound = np.where(significant, size, np.minimum(size + spread, SIGNIFICANT * spread))
    at_finest = (bound * 2.0 ** (-alpha * levels_above))[levels_above < LOOKED_BACK]
    bias = float(np.max(at_finest) / (2.0**alpha - 1.0))
    if not converges or bias > SIZEABLE * abs(means[-1]):
        return WeakError(math.nan, rate, False)
    return WeakError(bias, rate, True)
