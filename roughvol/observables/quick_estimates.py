"""Quick estimates of the flow through a gap: effective medium, and a single critical junction.

Conventions are those of `transport`. Neither solves a field.
"""

from __future__ import annotations

import numpy as np
from scipy import optimize

from roughvol.observables.clusters import check_exponent, check_gap
from roughvol.observables.transport import constriction
from roughvol.typing import Array


def effective_medium(gap: Array, exponent: float = 3.0) -> float:
    """Return Bruggeman's estimate of the coefficient of `conduction`, from the distribution of the gap alone.

    The root k of Σ (g^n - k)/(g^n + k) = 0 over all elements, contact included, over (mean g)^n. It is 0 where half of
    the elements or more are closed. In two dimensions, after Bruggeman, Annalen der Physik 416 (1935) 636-664. For the
    gap of a contact: Lorenz & Persson, Leak-rate of seals (2010), arXiv:0911.3019.

    Parameters
    ----------
    gap : ndarray
        Gap g ≥ 0 [any length].
    exponent : float
        n of the local conductance, > 0.

    Returns
    -------
    float
        Coefficient [1].

    Raises
    ------
    ContactError
        If the gap is no 2-D field of finite numbers ≥ 0, or the exponent not positive.
    """
    check_gap(gap)
    check_exponent(exponent)
    values = gap[gap > 0.0]
    if 2 * values.size <= gap.size:
        return 0.0
    log_k = exponent * (np.log(values) - np.log(values.max()))
    closed = gap.size - values.size

    def excess(log_effective: float) -> float:
        return float(np.tanh(0.5 * (log_k - log_effective)).sum()) - closed  # (a - b)/(a + b) in logarithms

    low = float(log_k.min()) - np.log(gap.size)  # where all open elements count as +1 to one part in their number
    while excess(low) < 0.0:
        low *= 2.0
    root = 0.0 if excess(0.0) >= 0.0 else optimize.brentq(excess, low, 0.0, xtol=1e-13, rtol=1e-13)
    return float(np.exp(root - exponent * np.log(np.mean(gap / values.max()))))


def single_junction(gap: Array, axis: int, exponent: float = 3.0, *, periodic: bool = False) -> float:
    """Return the estimate of the coefficient of `conduction` from the critical constriction alone.

    All pressure drops over one square junction of the gap h_c of `constriction`. The coefficient is (h_c/mean g)^n
    times the length of the field over its width. Persson & Yang, Journal of Physics: Condensed Matter 20 (2008)
    315011.

    Parameters
    ----------
    gap : ndarray
        Gap g ≥ 0 [any length].
    axis : int
        Direction of the flow, 0 for x, 1 for y.
    exponent : float
        n of the local conductance, > 0.
    periodic : bool
        Whether the field is one period: elements at opposite sides across the axis are neighbours.

    Returns
    -------
    float
        Coefficient [1].

    Raises
    ------
    ContactError
        If the gap is no 2-D field of finite numbers ≥ 0, or the exponent not positive.
    """
    check_exponent(exponent)
    critical = constriction(gap, axis, periodic=periodic).gap
    if critical == 0.0:
        return 0.0
    largest = gap.max()
    return (critical / largest / float(np.mean(gap / largest))) ** exponent * gap.shape[axis] / gap.shape[1 - axis]
