"""Texture and spectrum of a surface before load, of the deformed surface under load, and of the surface left by yield.

Conventions: heights z [length] are positive up, u ≥ 0 is the displacement, Δ the indentation, σ the root mean square
height of the whole surface before load. The gap is g = u - Δ + z_max - z, so the deformed surface is

    z - u = (z_max - Δ) - g,

a plane less the gap: the deformed shape of the paper's Fig. 8b. Texture does not depend on the height of the plane, so
it is taken of -g. E* is composite, and u is the sum of both deformations. If the smooth body deforms, the rough one
keeps its shape, and -g is the shape of the gap turned upside down: the valleys between the bodies are the same.

Numbers are those of `texture`, each normalised by the heights it is given. Svi under load times Sq under load over Sq
is the retained volume over σ, comparable with the free volume V*. Everything is of the region of the study, before load
as well.

The waves q of a spectrum are multiples of 2π over the length of the first axis of the region. A whole period has its
waves exactly. A patch, and a part of a period, are multiplied by a window (`surfaces.psd`).

The residual surface is z - u_pl, the heights without load less the plastic displacement u_pl ≥ 0.
"""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np

from roughvol.observables.regions import Values, View, is_period, window
from roughvol.study import Case
from roughvol.surfaces import psd, texture
from roughvol.surfaces.surface import Surface, intervals, with_neighbours
from roughvol.typing import Array, Index

LEVELS = np.arange(-50, 51) / 10.0  # of the material ratio, from the mean plane over σ
STORED_AS = {"nayak": "nayak_parameter"}
"""Names of stored variables where they differ from those of `surfaces.psd.Spectral`."""
STORED_ANYWAY = ("Sq", "Sdq", "hurst_measured")  # of the whole surface, whatever a study asks for


def numbers(heights: Array, spacing: float, *, periodic: bool = False) -> dict[str, float]:
    """Return the numbers of `texture` by stored name: lengths, and numbers without a unit. NaN where undefined."""
    names = ("Sq", "Sa", "Ssk", "Sku", "Sp", "Sv", "Sz", "Svi", "Sbi")
    return {name: getattr(texture, name)(heights) for name in names} | {
        "Sdq": texture.Sdq(with_neighbours(heights, periodic), spacing),
        "hurst_structure": texture.hurst_structure(heights, periodic=periodic),
        "hurst_measured": texture.hurst_spectrum(heights, periodic=periodic),
    }


def curves(z: Array, *, periodic: bool = False) -> Values:
    """Return material ratio at `LEVELS` and structure function at `lags` of heights over σ."""
    return {
        "material_ratio": texture.material_ratio(z, LEVELS + z.mean()),
        "structure_function": texture.structure_function(z, lags(z.shape, periodic=periodic), periodic=periodic),
    }


def lags(shape: tuple[int, ...], *, periodic: bool = False) -> Index:
    """Return the lags of the structure function, 1, 2, 4 … nodes up to half of the shorter axis."""
    return texture.dyadic_lags(intervals(min(shape), periodic) // 2)


def before_load(case: Case, surface: Surface) -> Values:
    """Return the texture of the undeformed surface in the region of the study, and the labels of its curves.

    Sq, Sdq and the exponent of the spectrum have the suffix ``_region``, where this is not the whole surface.
    """
    heights = surface.heights[window(case, surface.shape)]
    periodic = is_period(case)
    values: Values = dict(numbers(heights, surface.spacing, periodic=periodic))
    inside = {f"{name}_region": values.pop(name) for name in STORED_ANYWAY}
    if case.record.region is not None:
        values |= inside
    values |= curves((heights - surface.mean_height) / surface.unit, periodic=periodic)
    return values | {"material_level": LEVELS, "lag": lags(heights.shape, periodic=periodic)}


def under_load(view: View) -> Values:
    """Return the texture of the deformed surface at a state, by stored name with the suffix ``_loaded``."""
    z, periodic = -view.gap, view.periodic
    found = numbers(z * view.surface.unit, view.surface.spacing, periodic=periodic) | curves(z, periodic=periodic)
    return {f"{name}_loaded": value for name, value in found.items()}


def residual(view: View) -> Values:
    """Return the residual heights and their texture, with the suffix ``_residual``, where a study asks for them."""
    case, surface = view.case, view.surface
    if not case.plastic:
        return {}
    values: Values = {}
    heights = surface.heights - view.whole.plastic_displacement() * surface.unit
    if case.record.residual_heights:
        values["residual_heights"] = heights
    if case.record.texture is not None:
        inside = heights[window(case, surface.shape)]
        z = (inside - heights.mean()) / surface.unit
        periodic = is_period(case)
        found = numbers(inside, surface.spacing, periodic=periodic) | curves(z, periodic=periodic)
        values |= {f"{name}_residual": value for name, value in found.items()}
    return values


def spectrum_before_load(case: Case, surface: Surface) -> Values:
    """Return the spectrum of the undeformed surface in the region of the study."""
    part = _part(case, surface, surface.heights[window(case, surface.shape)])
    values = _spectrum(part)
    if case.record.region is not None:  # else L gives them
        values["wave_number"] = 2.0 * math.pi * values["wave"] / part.side
    return values


def spectrum_under_load(view: View) -> Values:
    """Return the spectrum of the deformed surface at a state, by stored name with the suffix ``_loaded``."""
    values = _spectrum(_part(view.case, view.surface, -view.gap * view.surface.unit))
    del values["wave"]
    return {f"{name}_loaded": value for name, value in values.items()}


def _part(case: Case, surface: Surface, heights: Array) -> Surface:
    return Surface(heights, surface.spacing, sides="periodic" if is_period(case) else "free")


def _spectrum(surface: Surface) -> Values:
    found = psd.spectral(surface)
    return {STORED_AS.get(field.name, field.name): getattr(found, field.name) for field in fields(found)}
