"""Quantities of a sweep at a given state, between its steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from roughvol.typing import Array


def at_state(state: ArrayLike, quantity: ArrayLike, values: ArrayLike) -> Array:
    """Return a quantity where the state of a sweep has given values, by monotone cubic interpolation.

    Between two steps the curve is the cubic of Fritsch & Butland (1984), which has no extremum that the steps lack.
    Steps that do not take the state further are left out. Outside the sweep the quantity is NaN: nothing is
    extrapolated.

    Parameters
    ----------
    state : array, shape (steps,)
        The state at each step, as p*. It may rise or fall; NaN are left out.
    quantity : array, shape (steps,)
        The quantity at each step.
    values : array, shape (n,)
        Values of the state.

    Returns
    -------
    Array
        Shape (n,).
    """
    x, y = np.asarray(state, dtype=np.float64), np.asarray(quantity, dtype=np.float64)
    wanted = np.atleast_1d(np.asarray(values, dtype=np.float64))
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if x.size < 2:
        return np.where(np.isin(wanted, x), y[:1] if x.size else np.nan, np.nan)
    if x[-1] < x[0]:
        x, wanted = -x, -wanted
    further = np.concatenate([[True], x[1:] > np.maximum.accumulate(x)[:-1]])
    x, y = x[further], y[further]
    if x.size < 2:
        return np.where(wanted == x[0], y[0], np.nan)
    found: Array = PchipInterpolator(x, y, extrapolate=False)(wanted)
    return found


def error_between_steps(state: ArrayLike, quantity: ArrayLike, values: ArrayLike) -> Array:
    """Return an estimate of the error of `at_state`: its change when every second step is left out, over three.

    An interpolation of second order would change by three times its error. The cubic has a higher order except near
    an extremum, so the estimate is on the large side. The last step is always kept.

    Parameters
    ----------
    state, quantity, values
        As for `at_state`.

    Returns
    -------
    Array
        Shape (n,), signed: the mean over surfaces is the error of the mean.
    """
    x, y = np.asarray(state, dtype=np.float64), np.asarray(quantity, dtype=np.float64)
    half = slice((x.size - 1) % 2, None, 2)
    rows = np.unique(np.concatenate([[0], np.arange(x.size)[half]])) if x.size else np.arange(0)
    change: Array = (at_state(x, y, values) - at_state(x[rows], y[rows], values)) / 3.0
    return change
