"""Quantities of a sweep at a given state, interpolated between its steps."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from roughvol.typing import Array


def at_state(state: ArrayLike, quantity: ArrayLike, values: ArrayLike, *, straight: bool = False) -> Array:
    """Return a quantity (steps,) at values (n,) of the state, rising or falling, by monotone cubic interpolation.

    The curve is the piecewise cubic of Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300. It has no extremum
    between two steps. Steps that do not advance the state are omitted, as are NaN. Nothing is extrapolated: NaN outside
    the sweep. ``straight`` takes straight lines, with steps of equal state kept: for curves in steps, as V* over A*
    near first touch.
    """
    x, y = np.asarray(state, dtype=np.float64), np.asarray(quantity, dtype=np.float64)
    points = np.atleast_1d(np.asarray(values, dtype=np.float64))
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if x.size < 2:
        return np.where(np.isin(points, x), y[:1] if x.size else np.nan, np.nan)
    if x[-1] < x[0]:
        x, points = -x, -points
    if straight:
        order = np.argsort(x, kind="stable")
        return np.interp(points, x[order], y[order], left=np.nan, right=np.nan)
    advancing = np.concatenate([[True], x[1:] > np.maximum.accumulate(x)[:-1]])
    x, y = x[advancing], y[advancing]
    if x.size < 2:
        return np.where(points == x[0], y[0], np.nan)
    interpolated: Array = scipy.interpolate.PchipInterpolator(x, y, extrapolate=False)(points)
    return interpolated


def error_of_fewer_steps(state: ArrayLike, quantity: ArrayLike, value: float, every: int) -> float:
    """Return the signed error of `at_state` with every k-th step alone, as a mean over the omitted steps near a value.

    The omitted steps are solved, so that the error there is known. The steps within k ≥ 2 of the value are taken: their
    mean depends less on the place of the value between two steps. The mean of this error over surfaces is the error of
    their mean. It is 0 without an omitted step, and infinite where the kept steps do not reach the value.
    """
    x, y = np.asarray(state, dtype=np.float64), np.asarray(quantity, dtype=np.float64)
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    kept = kept_steps(x.size, every) if x.size else np.arange(0)
    if not np.isfinite(at_state(x[kept], y[kept], value)).all():
        return float("inf")
    nearest = int(np.argmin(np.abs(x - value)))
    near = np.arange(max(nearest - every, 0), min(nearest + every, x.size - 1) + 1)
    omitted = np.setdiff1d(near, kept)
    changes = at_state(x[kept], y[kept], x[omitted]) - y[omitted]
    known = changes[np.isfinite(changes)]
    return float(known.mean()) if known.size else 0.0


def kept_steps(steps: int, every: int) -> Array:
    """Return the indices of every k-th step, counted from the last one, and of the first step."""
    return np.unique(np.append(np.arange(steps - 1, -1, -every), 0))
