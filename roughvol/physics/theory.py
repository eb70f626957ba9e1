"""Closed forms to compare with: indenters, loaded rectangles, and the free volume without a contact solver.

Conventions: E* = E / (1 - ν²) is the contact modulus, Δ ≥ 0 the indentation, r ≥ 0 the distance from the axis, p ≥ 0
pressure in compression, u the displacement of the half space, positive into it. Starred quantities have no unit:
d/σ (separation), p* = p L / (E* σ), A*, V*. Equations and sections without a name are the paper's (Paggi & He, Wear 336
(2015) 86-95), "Johnson" is Contact Mechanics (1985). Lengths, moduli and slopes must be finite and positive: every
function here raises ContactError otherwise, naming the argument.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf, ndtr

from roughvol.errors import ContactError, SurfaceError
from roughvol.typing import Array

# Δ E* L / F of a rigid square punch of side L, to 1e-5: 1 / (π · 0.36679), 0.36679 being the capacitance of a unit
# square plate; lattices of 17² … 513² elements, extrapolated in 1/N, give the same digits.
SQUARE_PUNCH_COMPLIANCE = 0.86783


class Indenter(NamedTuple):
    """An axisymmetric contact: ``force`` F, ``contact_radius`` a [length], ``mean_pressure`` F / (π a²)."""

    force: float
    contact_radius: float
    mean_pressure: float


def hertz(indentation: float, radius: float, E_star: float = 1.0) -> Indenter:
    """Return the contact of a rigid paraboloid r²/(2R): F = 4/3 E* √R Δ^{3/2}, a = √(R Δ) (Johnson, Sec. 4.2).

    Δ = ``indentation`` and R = ``radius`` [length], E* = ``E_star`` [pressure].
    """
    _check_positive(indentation=indentation, radius=radius, E_star=E_star)
    return _indenter(4.0 / 3.0 * E_star * math.sqrt(radius) * indentation**1.5, math.sqrt(radius * indentation))


def hertz_pressure(r: ArrayLike, indentation: float, radius: float, E_star: float = 1.0) -> Array:
    """Return p(r) = (2 E* / π R) √(a² - r²) inside the contact of `hertz`, 0 outside (Johnson, Sec. 3.4)."""
    a = hertz(indentation, radius, E_star).contact_radius
    r = np.asarray(r, dtype=np.float64)
    return 2.0 * E_star / (math.pi * radius) * np.sqrt(np.maximum(a * a - r * r, 0.0))


def hertz_displacement(r: ArrayLike, indentation: float, radius: float) -> Array:
    """Return u(r) = [(2a² - r²) asin(a/r) + a √(r² - a²)] / (π R) outside, Δ - r²/(2R) inside (Johnson, Sec. 3.4)."""
    a = hertz(indentation, radius).contact_radius
    r, outside = _split(r, a)
    beyond = ((2.0 * a * a - outside**2) * np.arcsin(a / outside) + a * np.sqrt(outside**2 - a * a)) / math.pi / radius
    return np.where(r <= a, indentation - r * r / (2.0 * radius), beyond)


def circular_punch(indentation: float, radius: float, E_star: float = 1.0) -> Indenter:
    """Return the contact of a rigid flat circular punch: F = 2 a E* Δ (Johnson, Sec. 3.4).

    Δ = ``indentation`` and a = ``radius`` [length], E* = ``E_star`` [pressure].
    """
    _check_positive(indentation=indentation, radius=radius, E_star=E_star)
    return _indenter(2.0 * radius * E_star * indentation, radius)


def circular_punch_pressure(r: ArrayLike, indentation: float, radius: float, E_star: float = 1.0) -> Array:
    """Return p(r) = E* Δ / (π √(a² - r²)) inside `circular_punch`, infinite at its edge, 0 outside (Johnson)."""
    _check_positive(indentation=indentation, radius=radius, E_star=E_star)
    r = np.asarray(r, dtype=np.float64)
    root = np.sqrt(np.maximum(radius * radius - r * r, 0.0))
    pressure = np.where(r > radius, 0.0, np.inf)
    return np.divide(E_star * indentation / math.pi, root, out=pressure, where=root > 0.0)


def circular_punch_displacement(r: ArrayLike, indentation: float, radius: float) -> Array:
    """Return u(r) = (2 Δ / π) asin(a/r) outside `circular_punch`, Δ inside (Johnson, Sec. 3.4)."""
    _check_positive(indentation=indentation, radius=radius)
    return 2.0 * indentation / math.pi * np.arcsin(radius / _split(r, radius)[1])


def square_punch(indentation: float, side: float, E_star: float = 1.0) -> float:
    """Return the force of a rigid flat square punch, F = E* Δ L / 0.86783 (good to 1e-5).

    Δ = ``indentation`` and L = ``side`` [length], E* = ``E_star`` [pressure].
    """
    _check_positive(indentation=indentation, side=side, E_star=E_star)
    return E_star * indentation * side / SQUARE_PUNCH_COMPLIANCE


def cone(indentation: float, slope: float, E_star: float = 1.0) -> Indenter:
    """Return the contact of a rigid cone r s: F = 2 E* Δ² / (π s), a = 2 Δ / (π s) (Sneddon 1965).

    Δ = ``indentation`` [length], s = ``slope``, the tangent of the angle between cone and surface [1].
    """
    _check_positive(indentation=indentation, slope=slope, E_star=E_star)
    return _indenter(2.0 * E_star * indentation**2 / (math.pi * slope), 2.0 * indentation / (math.pi * slope))


def cone_pressure(r: ArrayLike, indentation: float, slope: float, E_star: float = 1.0) -> Array:
    """Return p(r) = ½ E* s acosh(a/r) inside `cone`, infinite on the axis, 0 outside (Sneddon 1965)."""
    a = cone(indentation, slope, E_star).contact_radius
    r = np.asarray(r, dtype=np.float64)
    ratio = np.divide(a, r, out=np.full(r.shape, np.inf), where=r > 0.0)
    return 0.5 * E_star * slope * np.arccosh(np.maximum(ratio, 1.0))


def cone_displacement(r: ArrayLike, indentation: float, slope: float) -> Array:
    """Return u(r) = s [a asin(a/r) + √(r² - a²) - r] outside `cone`, Δ - s r inside (Sneddon 1965)."""
    a = cone(indentation, slope).contact_radius
    r, outside = _split(r, a)
    beyond = slope * (a * np.arcsin(a / outside) + np.sqrt(outside**2 - a * a) - outside)
    return np.where(r <= a, indentation - slope * r, beyond)


def rectangle_displacement(
    x: ArrayLike, y: ArrayLike, sides: tuple[float, float], pressure: float = 1.0, E_star: float = 1.0
) -> Array:
    """Return the displacement under and around a uniformly loaded rectangle (Love 1929; Johnson, Sec. 3.3).

    u = p / (π E*) Σ± f(x ± a/2, y ± b/2),  f(ξ, η) = ξ asinh(η/|ξ|) + η asinh(ξ/|η|)

    Relative accuracy is ε (r/a)²: the four corners cancel far away.

    Parameters
    ----------
    x, y : array_like
        Points relative to the centre [length], broadcast together.
    sides : (float, float)
        Sides a along x and b along y [length], positive.
    pressure, E_star : float
        p and E* [pressure].

    Returns
    -------
    ndarray
        u [length].
    """
    _check_positive(a=sides[0], b=sides[1], E_star=E_star)
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    right, left = x + 0.5 * sides[0], x - 0.5 * sides[0]
    top, bottom = y + 0.5 * sides[1], y - 0.5 * sides[1]
    corners = _corner(right, top) - _corner(left, top) - _corner(right, bottom) + _corner(left, bottom)
    return pressure / (math.pi * E_star) * corners


def rectangle_mean_displacement(sides: tuple[float, float], pressure: float = 1.0, E_star: float = 1.0) -> float:
    """Return the displacement averaged over a uniformly loaded rectangle (the integral of `rectangle_displacement`).

    ū = p / (π E* a b) { 2 [a² b asinh(b/a) + a b² asinh(a/b)] + ⅔ [a³ + b³ - (a² + b²)^{3/2}] }

    For a square it is 0.9464 p L / E*: the compliance of the specimen as a whole, V* - d/σ ≈ 0.95 p*.

    Parameters
    ----------
    sides : (float, float)
        Sides a and b [length], positive.
    pressure, E_star : float
        p and E* [pressure].
    """
    a, b = sides
    _check_positive(a=a, b=b, E_star=E_star)
    pairs = 2.0 * (a * a * b * math.asinh(b / a) + a * b * b * math.asinh(a / b))
    pairs += 2.0 / 3.0 * (a**3 + b**3 - math.hypot(a, b) ** 3)
    return pressure * pairs / (math.pi * E_star * a * b)


def single_element_pressure(indentation: float, spacing: float, E_star: float = 1.0) -> float:
    """Return the pressure of one element in contact, p = Δ / H₀, H₀ = 4 ln(1+√2) δ / (π E*).

    Δ = ``indentation`` and δ = ``spacing`` [length], E* = ``E_star`` [pressure].
    """
    _check_positive(indentation=indentation, spacing=spacing, E_star=E_star)
    return indentation * math.pi * E_star / (4.0 * math.asinh(1.0) * spacing)


def bearing_area_volume(
    separation: ArrayLike, heights: ArrayLike | str = "gaussian", area_fraction: ArrayLike | None = None
) -> Array:
    """Return V* from the bearing area curve, the volume under a plane that cuts the undeformed heights (Eq. 4).

    V* = (1 - A*) ∫_{-∞}^{d/σ} (d/σ - ζ) Φ(ζ) dζ,   Gaussian: (1 - A*) [t Φ(t) + φ(t)], t = d/σ

    The integral counts open points only; the factor (1 - A*) of the paper counts them a second time. It is left out
    unless ``area_fraction`` is given.

    Parameters
    ----------
    separation : array_like
        d/σ, height of the plane above the mean plane over σ.
    heights : ndarray or "gaussian"
        Heights z [length] whose own distribution is used, or the Gaussian one.
    area_fraction : array_like, optional
        A* in [0, 1], broadcast with ``separation``.

    Raises
    ------
    SurfaceError
        If the heights are flat or not finite.
    ContactError
        If A* lies outside [0, 1], or ``heights`` is another word.
    """
    t = np.asarray(separation, dtype=np.float64)
    if isinstance(heights, str):
        if heights != "gaussian":
            message = f'heights must be an array or "gaussian", got {heights!r}'
            raise ContactError(message)
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
        message = f"area_fraction must be in [0, 1], got {area_fraction!r}"
        raise ContactError(message)
    return (1.0 - covered) * volume


def boxes_of_dimension(dimension: ArrayLike, length: float, spacing: float) -> Array:
    """Return the number of elements in a domain of dimension 𝒟, N(δ) = (l/δ)^𝒟 (Eq. 6; Eq. 5 with r for δ, R for l).

    Parameters
    ----------
    dimension : array_like
        𝒟 [1].
    length, spacing : float
        l (a free parameter) and δ [length], positive.
    """
    _check_positive(length=length, spacing=spacing)
    return (length / spacing) ** np.asarray(dimension, dtype=np.float64)


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

    n_k = (l/δ)^{𝒟_{k+1}} - (l/δ)^{𝒟_k} (Eq. 8), and V* = Σ w_k n_k / (σ A_n) (Eqs. 9 and 10) with

        weight "width":   w_k = v_{k+1} - v_k          as printed; tends to 0 with growing K
        weight "volume":  w_k = (v_{k+1} + v_k) / 2    the volume of an element in the bin; converges

    Parameters
    ----------
    thresholds : ndarray, shape (K + 1,)
        Thresholds v_th [length³], not decreasing.
    dimensions : ndarray, shape (K + 1,)
        Dimensions 𝒟 of the domains D(v ≤ v_th) [1].
    length, spacing : float
        l (a free parameter) and δ [length], positive.
    Sq, area : float
        σ [length] and A_n [length²], positive.
    weight : {"width", "volume"}
        What each element of a bin contributes.

    Raises
    ------
    ContactError
        If the shapes differ, the thresholds decrease, or an argument lies outside its interval.
    """
    _check_positive(Sq=Sq, area=area)
    if thresholds.shape != dimensions.shape or thresholds.ndim != 1 or thresholds.size < 2:
        message = f"thresholds and dimensions must be K + 1 >= 2 each, got {thresholds.shape} and {dimensions.shape}"
        raise ContactError(message)
    widths = np.diff(thresholds)
    if np.any(widths < 0.0):
        message = f"thresholds must not decrease, got {thresholds}"
        raise ContactError(message)
    weights = {"width": widths, "volume": 0.5 * (thresholds[1:] + thresholds[:-1])}
    if weight not in weights:
        message = f"weight must be 'width' or 'volume', got {weight!r}"
        raise ContactError(message)
    return float(np.diff(boxes_of_dimension(dimensions, length, spacing)) @ weights[weight]) / (Sq * area)


def volume_from_density(edges: Array, density: Array, *, elements: int, Sq: float, area: float) -> float:
    """Return V* from the density of element volumes, V* = Σ n_k v_k / (σ A_n), n_k = n f_k Δv_k.

    What Eq. 7 means: v_k is the centre of bin k, so that the error is at most half a bin per element, whatever K.

    Parameters
    ----------
    edges, density : ndarray, shapes (K + 1,) and (K,)
        Edges [length³] and density f [1/length³] of the element volumes.
    elements : int
        Number n of elements that the density is over (the open ones, if contact was left out).
    Sq, area : float
        σ [length] and A_n [length²], positive; A_n = δ² times all elements gives mean(g)/σ, L² the paper's V*.
    """
    _check_positive(Sq=Sq, area=area)
    numbers = elements * density * np.diff(edges)
    return float(numbers @ (0.5 * (edges[1:] + edges[:-1]))) / (Sq * area)


def persson_area(mean_pressure: ArrayLike, Sdq: float, *, Sq: float, side: float) -> Array:
    """Return the area fraction of Persson's theory, A* = erf(√2 p / (E* h')), p / E* = p* σ / L (Persson 2001).

    Linear at first, A* ≈ √(8/π) p / (E* h'). With h' ~ δ^{-(D-2)} it gives A*/p* ~ δ^{D-2} (Section 3.1).

    Parameters
    ----------
    mean_pressure : array_like
        p* = p L / (E* σ) [1].
    Sdq : float
        Root mean square slope h' [1], positive.
    Sq, side : float
        σ and L [length], positive.
    """
    _check_positive(Sdq=Sdq, Sq=Sq, side=side)
    return np.asarray(erf(math.sqrt(2.0) * np.asarray(mean_pressure, dtype=np.float64) * Sq / (side * Sdq)))


def plasticity_index(Sq: float, radius: float, E_star: float, hardness: float) -> float:
    """Return Greenwood and Williamson's index, ψ = √(σ/ρ) E*/H; asperities yield from ψ = 1 on (Section 2).

    σ = ``Sq`` and ρ = ``radius``, the mean radius of curvature of the asperities [length]; H = ``hardness`` [pressure].
    """
    _check_positive(Sq=Sq, radius=radius, E_star=E_star, hardness=hardness)
    return math.sqrt(Sq / radius) * E_star / hardness


def critical_radius(Sq: float, E_star: float, hardness: float) -> float:
    """Return the radius of curvature at which ψ = 1, ρ_c = σ (E*/H)² [length] (Section 2).

    Sharper asperities yield. σ = ``Sq`` [length]; E* = ``E_star`` and H = ``hardness`` [pressure].
    """
    _check_positive(Sq=Sq, E_star=E_star, hardness=hardness)
    return Sq * (E_star / hardness) ** 2


def _indenter(force: float, contact_radius: float) -> Indenter:
    return Indenter(force, contact_radius, force / (math.pi * contact_radius**2))


def _split(r: ArrayLike, a: float) -> tuple[Array, Array]:
    """Return r, and r kept outside the contact so that the outer formula has no invalid points."""
    r = np.asarray(r, dtype=np.float64)
    return r, np.maximum(r, a)


def _corner(x: Array, y: Array) -> Array:
    """Return f(x, y) of `rectangle_displacement`, with its limit 0 where an argument is 0."""
    x, y = np.broadcast_arrays(x, y)
    off_x, off_y = x != 0.0, y != 0.0
    first = np.arcsinh(np.divide(y, np.abs(x), out=np.zeros(x.shape), where=off_x))
    second = np.arcsinh(np.divide(x, np.abs(y), out=np.zeros(x.shape), where=off_y))
    return x * first + y * second


def _standardised(heights: ArrayLike) -> Array:
    """Return heights about their mean over their root mean square, brought to unit range first (tiny and huge ones)."""
    z = np.asarray(heights, dtype=np.float64)
    span = float(np.ptp(z))
    if not (math.isfinite(span) and span > 0.0):
        message = f"heights must be finite and not flat, got a range of {span}"
        raise SurfaceError(message)
    z = (z - z.max()) / span
    z = z - z.mean()
    return z / math.sqrt(float(np.mean(z * z)))


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            message = f"{name} must be finite and positive, got {value!r}"
            raise ContactError(message)
