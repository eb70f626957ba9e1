"""Quick estimates of the flow through a gap: effective medium, and a single critical junction.

Conventions are those of `transport`. Neither solves a field.
"""

import numpy as np
import scipy

from roughvol.gap.constriction import constriction
from roughvol.typing import Array

CLOSES_AT = 0.415  # A* at the closing of isotropic roughness (Wang & Müser 2021)


def effective_medium(gap: Array, exponent: float = 3.0, *, closes_at: float = 0.5) -> float:
    """Return the effective-medium estimate of the coefficient of `conduction`, from the distribution of the gap alone.

    The root k of Σ (g^n - k)/(g^n + s k) = 0 over all elements, contact included, over (mean g)^n. It is 0 where a
    share c of the elements or more are closed, s = c/(1 - c). For c = 1/2 it is Bruggeman's equation in two dimensions,
    Annalen der Physik 416 (1935) 636-664; for the gap of a contact: Lorenz & Persson (2010), arXiv:0911.3019. Any other
    c is Kirkpatrick's effective medium with s in place of z/2 - 1, Reviews of Modern Physics 45 (1973) 574.
    Wang & Müser (2021), arXiv:2010.13470, find that roughness closes at `CLOSES_AT`.
    """
    values = gap[gap > 0.0]
    closed = gap.size - values.size
    if closed >= closes_at * gap.size:
        return 0.0
    log_k = exponent * (np.log(values) - np.log(values.max()))
    weight = closes_at / (1.0 - closes_at)

    def excess(log_effective: float) -> float:
        if weight == 1.0:
            return float(np.tanh(0.5 * (log_k - log_effective)).sum()) - closed  # (a - b)/(a + b) in logarithms
        # (a - b)/(a + s b) = 1 - (1 + s)/(a/b + s)
        ratio = np.exp(np.minimum(log_k - log_effective, 700.0))
        return float((1.0 - (1.0 + weight) / (ratio + weight)).sum()) - closed / weight

    low = float(log_k.min()) - np.log(gap.size)  # where all open elements count as +1 to one part in their number
    while excess(low) < 0.0:
        low *= 2.0
    root = 0.0 if excess(0.0) >= 0.0 else scipy.optimize.brentq(excess, low, 0.0, xtol=1e-13, rtol=1e-13)
    return float(np.exp(root - exponent * np.log(np.mean(gap / values.max()))))


def single_junction(
    gap: Array, axis: int, exponent: float = 3.0, *, periodic: bool = False, critical: float | None = None
) -> float:
    """Return the estimate of the coefficient of `conduction` from the critical constriction alone.

    All pressure drops over one square junction of the gap h_c of `constriction` (`critical`): the coefficient is
    (h_c/mean g)^n times length over width. Persson & Yang, Journal of Physics: Condensed Matter 20 (2008) 315011.
    """
    critical = constriction(gap, axis, periodic=periodic).gap if critical is None else critical
    if critical == 0.0:
        return 0.0
    largest = gap.max()
    return (critical / largest / float(np.mean(gap / largest))) ** exponent * gap.shape[axis] / gap.shape[1 - axis]
