"""Formulas of the paper and of the literature for area and free volume, without a contact solver."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf, ndtr

from roughvol.errors import ContactError, SurfaceError
from roughvol.reproduction.closed_forms import check_positive
from roughvol.surfaces import texture
from roughvol.typing import Array


def bearing_area_volume(
    separation: ArrayLike, heights: ArrayLike | str = "gaussian", area_fraction: ArrayLike | None = None
) -> Array:
    """Return V* from the bearing area curve, the volume under a plane that cuts the undeformed heights (Eq. 4).

    V* = (1 - A*) ∫_{-∞}^{d/σ} (d/σ - ζ) Φ(ζ) dζ,   Gaussian: (1 - A*) [t Φ(t) + φ(t)], t = d/σ

    The integral counts open points only, so the factor (1 - A*) of the paper is left out unless ``area_fraction`` is
    given. ``heights`` are z [length] with their own distribution, or "gaussian".
    """
    t = np.asarray(separation, dtype=np.float64)
    if isinstance(heights, str):
        if heights != "gaussian":
            raise ContactError(f'heights must be an array or "gaussian", got {heights!r}')
        volume = t * ndtr(t) + np.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi)
    else:
        ordered = np.sort(_standardised(heights), axis=None)
        below = np.searchsorted(ordered, t)
        sums = np.concatenate([[0.0], np.cumsum(ordered)])
        volume = (below * t - sums[below]) / ordered.size
    if area_fraction is None:
        return volume
    covered = np.asarray(area_fraction, dtype=np.float64)
    if not np.all((covered >= 0.0) & (covered <= 1.0)):
        raise ContactError(f"area_fraction must be in [0, 1], got {area_fraction!r}")
    return (1.0 - covered) * volume


def volume_from_dimension(
    thresholds: Array,
    dimensions: Array,
    *,
    length: float,
    spacing: float,
    Sq: float,
    area: float,
    weight: str = "width",
) -> float:
    """Return V* from the dimension of the free volume domains, with K bins between K + 1 thresholds (Eqs. 7-10).

    n_k = (l/δ)^{𝒟_{k+1}} - (l/δ)^{𝒟_k} (Eqs. 6 and 8), and V* = Σ w_k n_k / (σ A_n) (Eqs. 9 and 10) with

        weight "width":   w_k = v_{k+1} - v_k          as printed; tends to 0 with growing K
        weight "volume":  w_k = (v_{k+1} + v_k) / 2    the volume of an element in the bin; converges

    Thresholds v_th [length³] do not decrease; ``dimensions`` are those of the domains v ≤ v_th. l is free.
    """
    check_positive(length=length, spacing=spacing, Sq=Sq, area=area)
    if thresholds.shape != dimensions.shape or thresholds.ndim != 1 or thresholds.size < 2:
        message = f"thresholds and dimensions must be K + 1 >= 2 each, got {thresholds.shape} and {dimensions.shape}"
        raise ContactError(message)
    widths = np.diff(thresholds)
    if np.any(widths < 0.0):
        raise ContactError(f"thresholds must not decrease, got {thresholds}")
    weights = {"width": widths, "volume": 0.5 * (thresholds[1:] + thresholds[:-1])}
    if weight not in weights:
        raise ContactError(f"weight must be 'width' or 'volume', got {weight!r}")
    elements = (length / spacing) ** dimensions
    return float(np.diff(elements) @ weights[weight]) / (Sq * area)


def persson_area(mean_pressure: ArrayLike, Sdq: float, *, Sq: float, side: float) -> Array:
    """Return the area fraction of Persson's theory, A* = erf(√2 p / (E* h')), p / E* = p* σ / L (Persson 2001).

    Linear at first, A* ≈ √(8/π) p / (E* h'). With h' ~ δ^{-(D-2)} it gives A*/p* ~ δ^{D-2} (Section 3.1).
    p* = p L/(E* σ), h' = ``Sdq``, σ = ``Sq`` and L = ``side`` [length].
    """
    check_positive(Sdq=Sdq, Sq=Sq, side=side)
    return np.asarray(erf(math.sqrt(2.0) * np.asarray(mean_pressure, dtype=np.float64) * Sq / (side * Sdq)))


def area_of_pressure(pressure: ArrayLike, slope: float, kappa: float = 2.0) -> Array:
    """Return the area fraction A* = erf(√π κ p/(2 E* h')), with A* ≈ κ p/(E* h') at light load.

    κ = √(8/π) is Persson's theory (`persson_area`). κ = 2 is the light-load limit of numerical solutions: N. Prodanov,
    W. B. Dapp & M. H. Müser, Tribology Letters 53 (2014) 433-448. ``pressure`` is p/E*, and h' = ``slope``.
    """
    check_positive(slope=slope, kappa=kappa)
    return np.asarray(erf(0.5 * math.sqrt(math.pi) * kappa / slope * np.asarray(pressure, dtype=np.float64)))


def westergaard_mean_gap(ratio: ArrayLike) -> Array:
    """Return the mean gap over 2h of Westergaard's wave, (1 - s² + s² ln s²)/2 with s = sin(π a/λ).

    The integral of -dp/K: strips of width 2a, one a period λ, yield by (2λ/(π E*)) ln(1/s) under a mean pressure
    (Johnson 1985, Section 13.2), and dp = (2π E* h/λ) s ds (`closed_forms.westergaard`).
    """
    a = np.asarray(ratio, dtype=np.float64)
    if not np.all((a > 0.0) & (a <= 0.5)):
        raise ContactError(f"ratio is {ratio!r}; allowed: 0 < a/λ <= 1/2")
    square = np.sin(math.pi * a) ** 2
    return np.asarray(0.5 * (1.0 - square + square * np.log(square)))


def plasticity_index(Sq: float, radius: float, E_star: float, hardness: float) -> float:
    """Return Greenwood and Williamson's index, ψ = √(σ/ρ) E*/H, ρ the mean radius of the asperities (Section 2).

    Asperities yield from ψ = 1 on.
    """
    check_positive(Sq=Sq, radius=radius, E_star=E_star, hardness=hardness)
    return math.sqrt(Sq / radius) * E_star / hardness


def critical_radius(Sq: float, E_star: float, hardness: float) -> float:
    """Return the radius of curvature at which ψ = 1, ρ_c = σ (E*/H)² [length] (Section 2). Sharper asperities yield."""
    check_positive(Sq=Sq, E_star=E_star, hardness=hardness)
    return Sq * (E_star / hardness) ** 2


def _standardised(heights: ArrayLike) -> Array:
    """Return `texture.standardised` heights, or refuse flat ones."""
    z = np.asarray(heights, dtype=np.float64)
    span = float(np.ptp(z))
    if not (math.isfinite(span) and span > 0.0):
        raise SurfaceError(f"heights must be finite and not flat, got a range of {span}")
    return texture.standardised(z)
