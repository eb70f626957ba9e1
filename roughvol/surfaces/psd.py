"""Power spectral density of a height field, root mean squares by scale, and Nayak's parameter.

Conventions (Jacobs, Junge & Pastewka 2017): z(x) are heights about their mean on an area A, q are wave vectors. The
transform is z̃(q) = ∫ z exp(-i q·x) d²x, the density C(q) = |z̃|²/A [length⁴], and C^iso(q) its mean over directions.

    h_rms² = ∫ q C^iso dq/(2π),   h'_rms² = ∫ q³ C^iso dq/(2π),   h''_rms² = ∫ q⁵ C^iso dq/(8π)

h'_rms is the root mean square of |∇z|, h''_rms that of the mean curvature ∇²z/2. Here the integrals are sums over all
waves of the grid, and C^iso is a mean over rings k - ½ ≤ q L/(2π) < k + ½ with L the length of the first axis.

A periodic field has these waves exactly. Another field is multiplied by a Hann window first, of unit mean square: its
numbers are estimates, since the rim counts little and neighbouring waves mix.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from roughvol.surfaces.surface import Surface
from roughvol.typing import Array, Index

ROUNDING = 1e-9  # of a wave number q L/(2π)


@dataclass(frozen=True, eq=False)
class Spectral:
    """The radial spectrum of a surface, and what follows from it."""

    wave: Index  # q L/(2π) of the rings, 1 … L/(2δ)
    psd: Array  # C^iso [length⁴] of the rings; NaN for a ring without a wave
    rms_height: float  # h_rms [length]
    rms_slope: float  # h'_rms [1]
    rms_curvature: float  # h''_rms [1/length]
    rms_height_below: Array  # of the waves up to each ring: of the surface seen at a resolution
    rms_slope_below: Array
    rms_curvature_below: Array
    nayak: float  # α = m₀ m₄/m₂² = 6 (h_rms h''_rms)²/h'_rms⁴ [1] of an isotropic surface; NaN if flat


def spectral(surface: Surface) -> Spectral:
    """Return the radial power spectral density of a surface, its root mean squares by scale, and Nayak's parameter."""
    (rows, columns), spacing, unit = surface.shape, surface.spacing, surface.unit
    power, conjugates = _powers(surface)
    wave = np.hypot(np.fft.fftfreq(rows, spacing)[:, None], np.fft.rfftfreq(columns, spacing)[None, :])
    ring = _rings(wave, surface.side).ravel()
    counts = np.broadcast_to(conjugates, power.shape)
    moments = [np.bincount(ring, (power * counts * (2.0 * math.pi * wave) ** order).ravel()) for order in (0, 2, 4)]
    numbers = np.bincount(ring, counts.ravel())
    last = math.floor(surface.side / (2.0 * spacing) + ROUNDING)  # the shortest wave along an axis
    shown = slice(1, last + 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        density = moments[0][shown] / numbers[shown] * (rows * columns * spacing * spacing) * unit * unit
    shares = zip(moments, (1.0, 1.0, 0.25), strict=True)
    below = [unit * np.sqrt(np.cumsum(moment)[shown] * share) for moment, share in shares]
    m0, m2, m4 = (float(moment.sum()) for moment in moments)
    return Spectral(
        wave=np.arange(1, last + 1, dtype=np.intp),
        psd=density,
        rms_height=unit * math.sqrt(m0),
        rms_slope=unit * math.sqrt(m2),
        rms_curvature=unit * 0.5 * math.sqrt(m4),
        rms_height_below=below[0],
        rms_slope_below=below[1],
        rms_curvature_below=below[2],
        nayak=1.5 * m0 * m4 / (m2 * m2) if m2 > 0.0 else math.nan,
    )


def octaves(surface: Surface) -> Array:
    """Return the share of the variance of the heights in each octave of waves, along x and along y.

    The octave j has the rings k = 2^j to 2^(j+1) - 1, whole octaves up to the shortest wave along the axis. Waves along
    an axis are counted by their number on the side along this axis. Waves that run more along x than along y are in the
    first row, the others in the second. Waves in between are in both.
    """
    power, conjugates = _powers(surface)
    shares = power * conjugates / float((power * conjugates).sum() or 1.0)
    along_x = np.abs(np.fft.fftfreq(surface.shape[0], surface.spacing))[:, None]
    along_y = np.fft.rfftfreq(surface.shape[1], surface.spacing)[None, :]
    wave, rows = np.hypot(along_x, along_y), []
    for run_along, nodes in zip((along_x >= along_y, along_y >= along_x), surface.intervals, strict=True):
        ring = _rings(wave, nodes * surface.spacing)
        octave = np.floor(np.log2(np.maximum(ring, 1.0))).astype(np.int64)
        inside = run_along & (ring > 0) & (2.0 ** (octave + 2) <= nodes)
        rows.append(np.bincount(octave[inside], shares[inside]))
    found = np.zeros((2, max(1, *map(len, rows))))
    for row, of_axis in zip(found, rows, strict=True):
        row[: len(of_axis)] = of_axis
    return found


def waves(surface: Surface) -> Array:
    """Return the mean number of waves on the sides along x and along y, weighted by their variance; NaN if flat."""
    power, conjugates = _powers(surface)
    shares, (along_x, along_y) = power * conjugates, surface.intervals
    numbers = (
        shares.sum(axis=1) @ np.abs(np.fft.fftfreq(surface.shape[0], 1.0 / along_x)),
        shares.sum(axis=0) @ np.fft.rfftfreq(surface.shape[1], 1.0 / along_y),
    )
    with np.errstate(invalid="ignore"):
        return np.array(numbers) / shares.sum()


def _rings(wave: Array, side: float) -> Index:
    """Return the ring k of each wave, k - ½ ≤ q L/(2π) < k + ½; halves are waves of a period of two sides."""
    ring: Index = np.floor(wave * side + 0.5 + ROUNDING).astype(np.intp)
    return ring


def _powers(surface: Surface) -> tuple[Array, Array]:
    """Return |z̃|² of the waves of one half plane over `Surface.unit`², and how often each column of them counts."""
    (rows, columns), unit = surface.shape, surface.unit
    z = (surface.heights - surface.mean_height) / unit  # of any scale, so that no square underflows
    if not surface.periodic:
        window = np.outer(_hann(rows), _hann(columns))
        window /= math.sqrt(float(np.mean(window**2)))
        z = window * (z - float((window * z).sum() / window.sum()))
    power = np.abs(np.fft.rfft2(z, norm="forward")) ** 2
    power[0, 0] = 0.0
    conjugates = np.full(power.shape[1], 2.0)  # waves of the other half plane have the same power
    conjugates[0] = 1.0
    if columns % 2 == 0:
        conjugates[-1] = 1.0
    return power, conjugates


def _hann(nodes: int) -> Array:
    """Return the Hann window on nodes, with its zeros half a spacing outside of them."""
    return np.sin(math.pi * (np.arange(nodes) + 0.5) / nodes) ** 2
