"""Closed forms for comparison: indenters, and rectangles under uniform pressure.

Conventions: E* = E / (1 - ν²) is the contact modulus, Δ ≥ 0 the indentation, r ≥ 0 the distance from the axis. The
pressure p ≥ 0 is compressive, and u > 0 is a displacement into the half space. "Johnson" is Contact Mechanics (1985).
Radii, sides, spacings and displacements are in one unit of length, E* and pressures in one of pressure.
Lengths, moduli and slopes must be finite and positive. Every function raises ContactError otherwise, naming the
argument.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from roughvol.errors import ContactError
from roughvol.typing import Array

# Δ E* L / F of a rigid square punch of side L, to 1e-5: 1 / (π · 0.36679), 0.36679 the capacitance of a unit square
# plate. Lattices of elements extrapolate to it (`python -m tests.bench.validation`).
SQUARE_PUNCH_COMPLIANCE = 0.86783


class Indenter(NamedTuple):
    """An axisymmetric contact: force F, contact radius a [length], mean pressure F / (π a²)."""

    force: float
    contact_radius: float
    mean_pressure: float


def hertz(indentation: float, radius: float, E_star: float = 1.0) -> Indenter:
    """Return the contact of a rigid paraboloid r²/(2R): F = 4/3 E* √R Δ^{3/2}, a = √(R Δ) (Johnson, Sec. 4.2)."""
    check_positive(indentation=indentation, radius=radius, E_star=E_star)
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
    """Return the contact of a rigid flat circular punch, F = 2 a E* Δ (Johnson, Sec. 3.4)."""
    check_positive(indentation=indentation, radius=radius, E_star=E_star)
    return _indenter(2.0 * radius * E_star * indentation, radius)


def circular_punch_pressure(r: ArrayLike, indentation: float, radius: float, E_star: float = 1.0) -> Array:
    """Return p(r) = E* Δ / (π √(a² - r²)) inside `circular_punch`, infinite at its edge, 0 outside (Johnson)."""
    check_positive(indentation=indentation, radius=radius, E_star=E_star)
    r = np.asarray(r, dtype=np.float64)
    root = np.sqrt(np.maximum(radius * radius - r * r, 0.0))
    pressure = np.where(r > radius, 0.0, np.inf)
    return np.divide(E_star * indentation / math.pi, root, out=pressure, where=root > 0.0)


def circular_punch_displacement(r: ArrayLike, indentation: float, radius: float) -> Array:
    """Return u(r) = (2 Δ / π) asin(a/r) outside `circular_punch`, Δ inside (Johnson, Sec. 3.4)."""
    check_positive(indentation=indentation, radius=radius)
    return 2.0 * indentation / math.pi * np.arcsin(radius / _split(r, radius)[1])


def cone(indentation: float, slope: float, E_star: float = 1.0) -> Indenter:
    """Return the contact of a rigid cone r s: F = 2 E* Δ² / (π s), a = 2 Δ / (π s) (Sneddon 1965)."""
    check_positive(indentation=indentation, slope=slope, E_star=E_star)
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

    u = p / (π E*) Σ± f(x ± a/2, y ± b/2),  f(ξ, η) = ξ asinh(η/|ξ|) + η asinh(ξ/|η|), to a relative ε (r/a)² far away.
    """
    check_positive(a=sides[0], b=sides[1], E_star=E_star)
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    right, left = x + 0.5 * sides[0], x - 0.5 * sides[0]
    top, bottom = y + 0.5 * sides[1], y - 0.5 * sides[1]
    corners = _corner(right, top) - _corner(left, top) - _corner(right, bottom) + _corner(left, bottom)
    return pressure / (math.pi * E_star) * corners


def rectangle_mean_displacement(sides: tuple[float, float], pressure: float = 1.0, E_star: float = 1.0) -> float:
    """Return the displacement averaged over a uniformly loaded rectangle.

    ū = p / (π E* a b) { 2 [a² b asinh(b/a) + a b² asinh(a/b)] + ⅔ [a³ + b³ - (a² + b²)^{3/2}] }

    This integral of `rectangle_displacement` is 0.9464 p L / E* for a square: V* - d/σ ≈ 0.95 p* of a whole surface.
    """
    a, b = sides
    check_positive(a=a, b=b, E_star=E_star)
    pairs = 2.0 * (a * a * b * math.asinh(b / a) + a * b * b * math.asinh(a / b))
    pairs += 2.0 / 3.0 * (a**3 + b**3 - math.hypot(a, b) ** 3)
    return pressure * pairs / (math.pi * E_star * a * b)


def single_element_pressure(indentation: float, spacing: float, E_star: float = 1.0) -> float:
    """Return the pressure of one element in contact, p = Δ / H₀, H₀ = 4 ln(1+√2) δ / (π E*)."""
    check_positive(indentation=indentation, spacing=spacing, E_star=E_star)
    return indentation * math.pi * E_star / (4.0 * math.asinh(1.0) * spacing)


class Wave(NamedTuple):
    """Contact of a rigid wave h cos(2π x/λ) over strips of width 2a: p [pressure] and g [length] at places."""

    mean_pressure: float
    pressure: Array
    gap: Array


def westergaard(x: ArrayLike, ratio: float, amplitude: float, wavelength: float, E_star: float = 1.0) -> Wave:
    """Return the contact of a rigid wave with a half space, in plane strain (Westergaard, J. Appl. Mech. 6 (1939) A49).

    With s = sin(π x/λ) and s_a = sin(π a/λ), mean p = π E* h s_a²/λ (Johnson, eq. 13.7), and::

        p = (2π E* h/λ) cos(π x/λ) √(s_a² - s²)                                       in contact, s < s_a
        g = 2h [s √(s² - s_a²) - s_a² ln((s + √(s² - s_a²))/s_a)]                      elsewhere
    """
    check_positive(ratio=ratio, amplitude=amplitude, wavelength=wavelength, E_star=E_star)
    if ratio > 0.5:
        raise ContactError(f"ratio is {ratio}; allowed: 0 < a/λ <= 1/2")
    angle = np.pi * np.asarray(x, dtype=np.float64) / wavelength
    s, s_a = np.abs(np.sin(angle)), math.sin(math.pi * ratio)
    scale = math.pi * E_star * amplitude / wavelength
    root = np.sqrt(np.maximum(s * s - s_a * s_a, 0.0))
    gap = 2.0 * amplitude * (s * root - s_a * s_a * np.log1p((np.maximum(s, s_a) - s_a + root) / s_a))
    pressure = 2.0 * scale * np.abs(np.cos(angle)) * np.sqrt(np.maximum(s_a * s_a - s * s, 0.0))
    return Wave(scale * s_a * s_a, pressure, gap)


def _indenter(force: float, contact_radius: float) -> Indenter:
    return Indenter(force, contact_radius, force / (math.pi * contact_radius**2))


def _split(r: ArrayLike, a: float) -> tuple[Array, Array]:
    """Return r, and max(r, a), where the outer formula is valid."""
    r = np.asarray(r, dtype=np.float64)
    return r, np.maximum(r, a)


def _corner(x: Array, y: Array) -> Array:
    """Return f(x, y) of `rectangle_displacement`, with its limit 0 where an argument is 0."""
    x, y = np.broadcast_arrays(x, y)
    off_x, off_y = x != 0.0, y != 0.0
    first = np.arcsinh(np.divide(y, np.abs(x), out=np.zeros(x.shape), where=off_x))
    second = np.arcsinh(np.divide(x, np.abs(y), out=np.zeros(x.shape), where=off_y))
    return x * first + y * second


def check_positive(**values: float) -> None:
    """Refuse values that are not finite and positive."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise ContactError(f"{name} must be finite and positive, got {value!r}")
