"""From patches to a seal: the leak of a seal, and the load that closes it, from those of patches of its joint.

The sheet conductance of a patch is G = Q/Δp · L_w/L_l, with L_w its side along the flow and L_l the other. A seal of
width w and length l is a sheet of w/L_w × l/L_l patches (`gap.sheet`), and leaks Q = G Δp l/w. Which patch lies where
is not known: patches are drawn from those computed, many times. The median of the draws is the answer.

**Interval.** Errors that all patches share multiply: grid, levelling and solver, as in `leak_budget`. What averages out
is the part ``window``. It has two sources, and their logarithms add in squares: the draws differ among each other
(2.5 to 97.5 %), and the scans are few. G is proportional to the level of its patches, so the second is the interval of
the mean of their logarithms, Student's, with the scans less one as degrees of freedom. Windows of one scan, and x and y
of one scan, are no further scans: their mean is one number.

**Few scans.** With one scan its quadrants stand in. Waves longer than a quadrant are then missing, and the interval has
them only where the surface has a roll-off.

**x and y.** Where the logarithms of x and y do not differ by more than Student's interval, a patch is turned as well as
it lies: both numbers are drawn for both directions.

**Closed patches** conduct nothing in a draw. The interval then begins at 0. It ends at what follows if a closed patch
conducts as much as the poorest open patch.

**Long seals.** Columns of patches differ among each other, and a stream seldom drifts farther sideways than the seal is
wide. More than 128 columns are taken as rings of 64 columns side by side, which have no ends: 300 rings are drawn. More
than 16 patches in a row are taken in blocks, each a patch of its own sheet.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from roughvol.ensemble.multilevel import COVERAGE, half_width
from roughvol.gap import sheet
from roughvol.typing import Array

DRAWS = 300
ROW, RING = 16, 64  # most patches in a row, and columns of a ring
SIDE_BY_SIDE = 4096  # rings whose mean is taken at most; a longer seal has the same mean
ENDS = (0.5 - 0.5 * COVERAGE, 0.5 + 0.5 * COVERAGE)


@dataclass(frozen=True)
class Estimate:
    """A number of a seal, from that of its patches.

    Attributes
    ----------
    value : float
        Median over draws.
    low, high : float
        Interval of what averages out; infinite or NaN where it is not known.
    """

    value: float
    low: float
    high: float


def is_isotropic(values: Array) -> bool:
    """Return whether patches are alike along x and y: by Student's interval of the mean logarithm of their ratio.

    Parameters
    ----------
    values : ndarray, shape (scans, windows, 2)
        Numbers > 0 along two axes; scans with a number 0 are left out.
    """
    logs = np.log(values[(values > 0.0).all(axis=(1, 2))])
    if len(logs) < 2:
        return False
    ratios = (logs[..., 0] - logs[..., 1]).mean(axis=1)
    return bool(abs(ratios.mean()) <= half_width(float(ratios.std(ddof=1)), len(ratios)))


def conductance_of(values: Array, patches: tuple[int, int], *, isotropic: bool) -> Estimate:
    """Return the sheet conductance of a seal.

    Parameters
    ----------
    values : ndarray, shape (scans, windows, 2)
        Sheet conductances ≥ 0 of patches along and across the flow.
    patches : (int, int)
        Patches in a row along the flow, and side by side.
    isotropic : bool
        Whether both numbers of a patch are drawn for both directions.
    """
    return _estimate(values, patches, isotropic, sheet.conductance, np.mean)


def closing_of(values: Array, patches: tuple[int, int], *, isotropic: bool) -> Estimate:
    """Return the load at which a seal closes, from those of its patches; arguments as for `conductance_of`."""
    return _estimate(values, patches, isotropic, sheet.closing, np.max)


def draws(
    along: Array,
    across: Array,
    patches: tuple[int, int],
    of: Callable[..., float] = sheet.conductance,
    together: Callable[..., Array] = np.mean,
    seed: int = 0,
) -> Array:
    """Return a number of many sheets whose patches are drawn from pools, shape (`DRAWS`,).

    Parameters
    ----------
    along, across : ndarray
        Numbers of the patches along and across the flow.
    patches : (int, int)
        Patches in a row, and side by side.
    of, together : callable
        Number of a sheet, as `sheet.closing`, and that of rings side by side, as `numpy.max`.
    seed : int
        Of the draws.
    """
    n, m = patches
    if n > ROW:
        side = math.ceil(n / ROW)
        blocks = [
            draws(*pools, (side, side), of, together, seed + k)
            for k, pools in enumerate(((along, across), (across, along)), 1)
        ]
        return draws(*blocks, (round(n / side), max(1, round(m / side))), of, together, seed)
    rng, ring = np.random.default_rng(seed), m > 2 * RING
    shape = (n, RING if ring else m)
    found = np.array(
        [of(rng.choice(along, shape), rng.choice(across, (n - 1, shape[1])), ring=ring) for _ in range(DRAWS)]
    )
    if not ring:
        return found
    rings = min(round(m / RING), SIDE_BY_SIDE)
    return np.asarray(together(rng.choice(found, (DRAWS, rings)), axis=1))


def _estimate(
    values: Array,
    patches: tuple[int, int],
    isotropic: bool,
    of: Callable[..., float],
    together: Callable[..., Array],
) -> Estimate:
    """Return a number of a seal with its interval."""

    def drawn(some: Array) -> Array:
        pools = (some.ravel(), some.ravel()) if isotropic else (some[..., 0].ravel(), some[..., 1].ravel())
        return draws(*pools, patches, of, together)

    found, open_ = drawn(values), values > 0.0
    value = float(np.median(found))
    if open_.all():
        few = _of_few(values, isotropic)
        low, high = (
            value * math.exp(sign * math.hypot(few, abs(math.log(end / value))))
            for sign, end in zip((-1.0, 1.0), np.quantile(found, ENDS), strict=True)
        )
        return Estimate(value, low, high)
    if not open_.any():
        return Estimate(0.0, 0.0, math.inf)
    filled = np.where(open_, values, values[open_].min())
    upper = drawn(filled)
    middle, end = float(np.median(upper)), float(np.quantile(upper, ENDS[1]))
    return Estimate(value, 0.0, middle * math.exp(math.hypot(_of_few(filled, isotropic), math.log(end / middle))))


def _of_few(values: Array, isotropic: bool) -> float:
    """Return the half-width of the mean logarithm over scans; infinite for one scan."""
    logs = np.log(values if isotropic else values[..., :1]).mean(axis=(1, 2))
    return half_width(float(logs.std(ddof=1)), len(logs)) if len(logs) > 1 else math.inf
