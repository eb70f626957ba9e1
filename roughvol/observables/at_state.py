"""Quantities of a sweep at a given state, interpolated between its steps."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike

from roughvol.typing import Array


def at_state(state: ArrayLike, quantity: ArrayLike, values: ArrayLike, *, straight: bool = False) -> Array:
    """Return a quantity (steps,) at values (n,) of the state, rising or falling, by monotone cubic interpolation.

    The curve is the piecewise cubic of Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300. It has no extremum
    between two steps. Where several steps have one state, as unloaded steps of a region, a curve ends at the first
    step, and the next curve begins at the last one. At this state the quantity is that of the first step. Steps that
    fall behind are omitted, as are NaN. Nothing is extrapolated: NaN outside the sweep. ``straight`` takes straight
    lines, with steps of equal state kept: for curves in steps, as V* over A* near first touch.
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
    advancing = x >= np.maximum.accumulate(x)
    x, y = x[advancing], y[advancing]
    found = np.full(points.shape, np.nan)
    edges = [0, *(np.flatnonzero(np.diff(x) == 0.0) + 1).tolist(), x.size]
    for first, end in itertools.pairwise(edges):
        found = np.where(np.isnan(found), _monotone_cubic(x[first:end], y[first:end], points), found)
    return found


def _monotone_cubic(x: Array, y: Array, points: Array) -> Array:
    """Return the cubics of Fritsch & Butland through y at rising x; the slope at an end is that of a parabola there.

    A single step has no curve but itself. The cubics are those of ``scipy.interpolate.PchipInterpolator``. Its import
    would add 0.2 s to each command that reads a state (``python -X importtime -c "import scipy.interpolate"``).
    """
    if x.size == 1:
        return np.where(points == x, y, np.nan)
    widths, chords = np.diff(x), np.diff(y) / np.diff(x)
    slopes = np.zeros_like(y)
    before, after = chords[:-1], chords[1:]
    alike = before * after > 0.0
    first, second = 2.0 * widths[1:] + widths[:-1], widths[1:] + 2.0 * widths[:-1]
    slopes[1:-1][alike] = (first + second)[alike] / (first[alike] / before[alike] + second[alike] / after[alike])
    slopes[0] = _end_slope(widths, chords)
    slopes[-1] = _end_slope(widths[::-1], chords[::-1])
    k = np.clip(np.searchsorted(x, points, side="right") - 1, 0, x.size - 2)
    t, width = (points - x[k]) / widths[k], widths[k]
    from_left = (1.0 - t) ** 2 * ((1.0 + 2.0 * t) * y[k] + t * width * slopes[k])
    from_right = t**2 * ((3.0 - 2.0 * t) * y[k + 1] - (1.0 - t) * width * slopes[k + 1])
    return np.where((points >= x[0]) & (points <= x[-1]), from_left + from_right, np.nan)


def _end_slope(widths: Array, chords: Array) -> float:
    """Return the slope of a parabola at an end, by the chords from there on, limited so that the cubic is monotone."""
    if chords.size == 1:
        return float(chords[0])
    slope = float(((2.0 * widths[0] + widths[1]) * chords[0] - widths[0] * chords[1]) / (widths[0] + widths[1]))
    if slope * chords[0] <= 0.0:
        return 0.0
    return float(3.0 * chords[0]) if chords[0] * chords[1] <= 0.0 and abs(slope) > abs(3.0 * chords[0]) else slope


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
