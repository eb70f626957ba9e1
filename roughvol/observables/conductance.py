"""Contact conductance of a rough interface, from its stiffness.

Barber, Proc. R. Soc. A 459 (2003) 53-66: for elastic bodies the incremental stiffness of a contact and its conductance
obey the same boundary value problem. With conductivities k₁ and k₂,

    h = 2 K/(E* (1/k₁ + 1/k₂)) = k_s K/E*,    k_s = 2 k₁ k₂/(k₁ + k₂),                               (1)

where h is the conductance and K the stiffness, both per nominal area. Hence h L/k_s = K L/E*: one starred number holds
both. (1) is that of heat or current through the contact alone: no gas, no film, no radiation. A circular spot of radius
a has dF/dΔ = 2 E* a and 2 a k_s, as (1) says. Barber's bounds: roughness finer than the grid, of height s from its
lowest to its highest point, moves the load curve by at most s in separation. Paggi & Barber, Int. J. Heat Mass
Transfer 54 (2011) 4664-4672, use (1) for midpoint surfaces.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from roughvol.errors import ContactError
from roughvol.typing import Array

FEWEST = 4  # states of an exponent


def harmonic_conductivity(first: float, second: float) -> float:
    """Return k_s = 2 k₁ k₂/(k₁ + k₂).

    Parameters
    ----------
    first, second : float
        Conductivities of the two bodies, > 0, in one unit.

    Returns
    -------
    float
        k_s in that unit.

    Raises
    ------
    ContactError
        If one is not positive.
    """
    if not (first > 0.0 and second > 0.0):
        raise ContactError(f"conductivities are {first:g} and {second:g}; allowed: > 0")
    return 2.0 * first * second / (first + second)


def contact_conductance(stiffness: ArrayLike, conductivity: float, length: float) -> Array:
    """Return the conductance per nominal area, h = (K L/E*) k_s/L, equation (1).

    Parameters
    ----------
    stiffness : array
        K L/E* [1].
    conductivity : float
        k_s, see `harmonic_conductivity`.
    length : float
        L in the length of the conductivity.

    Returns
    -------
    array
        h, conductivity over length.
    """
    conductance: Array = np.asarray(stiffness, dtype=np.float64) * (conductivity / length)
    return conductance


def stiffness_exponent(pressure: ArrayLike, stiffness: ArrayLike) -> float:
    """Return α of K ~ p^α, the slope of the straight line through the logarithms of all states.

    Parameters
    ----------
    pressure, stiffness : array, shape (steps,)
        p and K in any units; states where one is not finite or not positive are left out.

    Returns
    -------
    float
        α; NaN with fewer than four states.
    """
    p, k = np.asarray(pressure, dtype=np.float64).ravel(), np.asarray(stiffness, dtype=np.float64).ravel()
    held = np.isfinite(p) & np.isfinite(k) & (p > 0.0) & (k > 0.0)
    if np.count_nonzero(held) < FEWEST or np.ptp(p[held]) == 0.0:
        return float("nan")
    return float(np.polyfit(np.log(p[held]), np.log(k[held]), 1)[0])
