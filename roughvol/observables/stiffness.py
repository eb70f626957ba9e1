"""Interfacial stiffness: the pressure that one step of separation takes; and the contact conductance that follows.

Pressure and separation are in any units. With the stored p* and d/σ the stiffness is K L/E* [1].

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

FEWEST = 3  # states of a derivative of second order
OF_EXPONENT = 4  # states of an exponent
LEAST = 1.0 / 3.0  # slope of d over ln p at an end, over that to the neighbour; ln 2 for p ~ Δ^n at the steps Δ and 2Δ


def interfacial_stiffness(pressure: ArrayLike, separation: ArrayLike) -> Array:
    """Return the interfacial stiffness K = -dp/dd at the stored states (..., steps) of a loading or unloading.

    K = -p/(dd/d ln p). The derivative of d over ln p is taken from three neighbouring states: centred differences on
    unequal steps, of second order, one-sided at both ends. Where such a parabola turns before its end or soon after, as
    at a kink before full contact, the straight line to the neighbour is taken there: the parabola has less than a third
    of its slope. For p ~ exp(-d/u) these differences are exact. K is infinite where d no longer moves, and NaN where p
    is 0 or NaN, or with fewer than three states. A surface whose pressure neither rises nor falls throughout has NaN.
    If no surface has a K for that reason, it is a `ContactError`. For K of rough interfaces: Pastewka
    et al., Physical Review E 87 (2013) 062809.
    """
    p, d = np.asarray(pressure, dtype=np.float64), np.asarray(separation, dtype=np.float64)
    stiffness, turns = np.full(p.shape, np.nan), False
    for row in np.ndindex(p.shape[:-1]):
        states = np.flatnonzero((p[row] > 0.0) & np.isfinite(p[row]) & np.isfinite(d[row]))
        if states.size < FEWEST:
            continue
        logarithm = np.log(p[row][states])
        steps = np.diff(logarithm)
        if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            turns = True
            continue
        gaps = d[row][states]
        slope = np.gradient(gaps, logarithm, edge_order=2)
        straight = np.diff(gaps) / steps
        for end in (0, -1):
            steep = slope[end] * straight[end] > LEAST * straight[end] ** 2
            slope[end] = slope[end] if steep else straight[end]
        with np.errstate(divide="ignore"):
            stiffness[(*row, states)] = p[row][states] / np.abs(slope) * np.where(slope > 0.0, -1.0, 1.0)
    if turns and np.isnan(stiffness).all():
        raise ContactError("pressure must rise or fall throughout: give one leg of a path at a time")
    return stiffness


def without_every_second(pressure: ArrayLike, separation: ArrayLike) -> Array:
    """Return K at each state from every second state around it; NaN where fewer than three states are left.

    The difference from `interfacial_stiffness` is about three times the error by the steps.
    """
    p, d = np.asarray(pressure, dtype=np.float64), np.asarray(separation, dtype=np.float64)
    stiffness = np.full(p.shape, np.nan)
    for row in np.ndindex(p.shape[:-1]):
        states = np.flatnonzero((p[row] > 0.0) & np.isfinite(p[row]) & np.isfinite(d[row]))
        for half in (states[::2], states[1::2]):
            stiffness[(*row, half)] = interfacial_stiffness(p[row][half], d[row][half])
    return stiffness


def harmonic_conductivity(first: float, second: float) -> float:
    """Return k_s = 2 k₁ k₂/(k₁ + k₂) of the conductivities of two bodies, in their unit."""
    return 2.0 * first * second / (first + second)


def contact_conductance(stiffness: ArrayLike, conductivity: float, length: float) -> Array:
    """Return the conductance per nominal area, h = (K L/E*) k_s/L, equation (1), from K L/E*, k_s and L."""
    conductance: Array = np.asarray(stiffness, dtype=np.float64) * (conductivity / length)
    return conductance


def stiffness_exponent(pressure: ArrayLike, stiffness: ArrayLike) -> float:
    """Return α of K ~ p^α, by least squares of the logarithms of all positive states; NaN with fewer than four."""
    p, k = np.asarray(pressure, dtype=np.float64).ravel(), np.asarray(stiffness, dtype=np.float64).ravel()
    held = np.isfinite(p) & np.isfinite(k) & (p > 0.0) & (k > 0.0)
    if np.count_nonzero(held) < OF_EXPONENT or np.ptp(p[held]) == 0.0:
        return float("nan")
    return float(np.polyfit(np.log(p[held]), np.log(k[held]), 1)[0])
