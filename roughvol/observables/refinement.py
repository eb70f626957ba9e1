"""Whether a mean converges under refinement, and how far it is from its limit: the weak error of multilevel sums.

Symbols: μ_l the mean on level l, e_l = μ_l - μ_{l-1}. If |e_l| ~ 2^(-α l), what is left beyond the finest level M is

    Σ e_l over l > M ≈ max over the last three levels of |e_l| 2^(-α (M - l)) / (2^α - 1)          (Giles 2008).

A quantity that falls by the same factor on every level, as A* does, has no limit but zero. Its e_l shrink as well, in
proportion to μ_l, and what is left is μ_M itself. So α is the rate of the *relative* steps |e_l/μ_l|, and a mean whose
estimated rest is a sizeable share of itself counts as one without a limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SIGNIFICANT = 2.0  # standard errors from which on a step is more than noise
LEAST_RATE = -0.25  # α below which the relative steps grow
SIZEABLE = 0.2  # share of the mean that the rest may be; A*, whose relative steps stay near 0.2, comes to 0.5
FLATTEST = 0.5  # α of the extrapolation at the least, as Giles takes it, so that noise cannot blow it up
WINDOW = 5  # of the finest steps; coarser ones are not yet in the regime of a power law
LOOKED_BACK = 3  # steps that the largest is taken of


@dataclass(frozen=True)
class WeakError:
    """What is left of the resolution.

    Attributes
    ----------
    bias : float
        Estimate of |μ_∞ - μ_M|; NaN if there is no limit.
    rate : float
        α of the relative steps; NaN where fewer than two steps rise above their noise.
    converges : bool
        Whether the steps shrink.
    """

    bias: float
    rate: float
    converges: bool


def weak_error(means: Sequence[float], steps: Sequence[float], noise: Sequence[float]) -> WeakError:
    """Return the error that the resolution leaves.

    Parameters
    ----------
    means : sequence of float, length levels
        μ, coarsest first.
    steps : sequence of float, length levels - 1
        e, from seeds that both levels have.
    noise : sequence of float, length levels - 1
        Standard error of each step.

    Returns
    -------
    WeakError
        Steps that are all noise count as converged: the bias is then that of the noise.
    """
    size = np.abs(np.asarray(steps, dtype=np.float64))[-WINDOW:]
    spread = np.asarray(noise, dtype=np.float64)[-WINDOW:]
    scale = np.abs(np.asarray(means, dtype=np.float64))[1:][-WINDOW:]
    if not size.size:
        return WeakError(math.nan, math.nan, False)
    seen = size > SIGNIFICANT * spread
    rate, converges = math.nan, True
    if seen.sum() >= 2 and np.all(scale[seen] > 0.0):
        place = np.flatnonzero(seen)
        logs = np.log2(size[seen] / scale[seen])
        weights = 1.0 / np.hypot(spread[seen] / size[seen] / math.log(2.0), 0.1)
        rate = -float(np.polyfit(place, logs, 1, w=weights)[0])
        converges = rate > LEAST_RATE
    alpha = max(rate, FLATTEST) if math.isfinite(rate) else 1.0
    back = np.arange(size.size)[::-1]
    recent = back < LOOKED_BACK
    known = np.where(seen, size, np.minimum(size + spread, SIGNIFICANT * spread))
    left = float(np.max((known * 2.0 ** (-alpha * back))[recent]) / (2.0**alpha - 1.0))
    if not converges or left > SIZEABLE * abs(means[-1]):
        return WeakError(math.nan, rate, False)
    return WeakError(left, rate, True)
