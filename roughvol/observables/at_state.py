"""Quantities of a sweep at a given state, interpolated between its steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from roughvol.typing import Array


def at_state(state: ArrayLike, quantity: ArrayLike, values: ArrayLike, *, straight: bool = False) -> Array:
    """Return a quantity at given values of the state, by monotone cubic interpolation.

    The curve is the piecewise cubic of Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300. It has no extremum
    between two steps. Steps that do not advance the state are omitted. Nothing is extrapolated.

    Parameters
    ----------
    state : array, shape (steps,)
        State at each step, as p*, rising or falling; NaN are omitted.
    quantity : array, shape (steps,)
        Quantity at each step; NaN are omitted.
    values : array, shape (n,)
        Values of the state.
    straight : bool
        Straight lines between two steps in place of the cubic, with steps of equal state kept: for curves in steps,
        as V* over A* near first touch.

    Returns
    -------
    array, shape (n,)
        Quantity at each value; NaN outside the sweep.
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
    interpolated: Array = PchipInterpolator(x, y, extrapolate=False)(points)
    return interpolated


def error_between_steps(state: ArrayLike, quantity: ArrayLike, values: ArrayLike) -> Array:
    """Return an estimate of the error of `at_state`: its change without every second step, over three.

    An interpolation of second order changes by three times its error. The cubic has a higher order except near an
    extremum, so the estimate is rather too large. The last step is always kept.

    Parameters
    ----------
    state, quantity, values
        As for `at_state`.

    Returns
    -------
    array, shape (n,)
        Signed errors; their mean over surfaces is the error of the mean.
    """
    x, y = np.asarray(state, dtype=np.float64), np.asarray(quantity, dtype=np.float64)
    half = slice((x.size - 1) % 2, None, 2)
    kept = np.unique(np.concatenate([[0], np.arange(x.size)[half]])) if x.size else np.arange(0)
    change: Array = (at_state(x, y, values) - at_state(x[kept], y[kept], values)) / 3.0
    return change
