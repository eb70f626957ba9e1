"""The surface of measured heights: each body read and treated by itself, two of them added.

Conventions: the heights of each body are positive out of it. Two bodies touch first where the sum of their heights is
largest. They are pressed as one rough surface of height z1 + z2 against a plane. Missing heights and outliers belong to
one body. Every other treatment is linear, so that of the sum is the sum of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from roughvol.errors import SurfaceError
from roughvol.surfaces import length_units
from roughvol.surfaces.body import Body, Treatment, digest
from roughvol.surfaces.files import reading
from roughvol.surfaces.surface import Surface, intervals
from roughvol.surfaces.treatment import block_means, fill, level, low_pass, outliers, squared
from roughvol.typing import Array, Mask, Sides

_FLATTEST = 1e-7  # of the side: a nanometre on a centimetre
_MIRRORS = {"none": np.s_[:, :], "x": np.s_[::-1, :], "y": np.s_[:, ::-1]}


def surface(
    bodies: Sequence[Body], treatment: Treatment, L: float, unit: str | None, *, sides: Sides = "free"
) -> Surface:
    """Return the surface whose heights come from files: one body, or the sum of two."""
    periodic = sides == "periodic"
    measured = [_measured(body, treatment, unit) for body in bodies]
    total, filled, removed = _pressed(bodies, measured, treatment, L, periodic)
    peak_before = None
    if treatment.outliers is not None:
        before = _pressed(bodies, measured, replace(treatment, outliers=None), L, periodic)[0] if removed else total
        peak_before = Surface(before, 1.0).peak
    return Surface(total, L / intervals(len(total), periodic), filled, removed, peak_before, sides)


def _pressed(
    bodies: Sequence[Body], measured: Sequence[Array], treatment: Treatment, L: float, periodic: bool
) -> tuple[Array, int, int]:
    """Return the heights that are pressed, the number of filled ones, and the number of outliers taken out."""
    pairs = zip(measured, bodies, strict=True)
    (total, filled, removed), *others = (_treated(*pair, treatment, L, periodic) for pair in pairs)
    for heights, missing, count in others:
        total, filled, removed = total + heights, filled | missing, removed + count
    return total, int(filled.sum()), removed


def notes(surface: Surface, unit: str | None) -> tuple[str, ...]:
    """Return a note where the heights are absurd for the length of the surface."""
    span, side = float(np.ptp(surface.heights)), surface.spacing * min(surface.intervals)
    if span == 0.0 or _FLATTEST * side <= span <= side:
        return ()
    name = f" {unit}" if unit else ""
    than = f"more than the shorter side, {side:.3g}{name}" if span > side else f"{span / side:.1g} of the shorter side"
    return (f"the heights span {span:.3g}{name}, {than}: is heights_unit right?",)


def _measured(body: Body, treatment: Treatment, unit: str | None) -> Array:
    """Return the heights of one body as its file holds them, in the unit of the study."""
    holes, ignored = treatment.missing != "refuse", body.header == "ignore"
    heights = reading.read(body.file, body.variable, holes=holes, columns=body.columns, ignore_header=ignored)
    if digest(body.file) != body.sha256:
        raise SurfaceError(f"{body.file} has changed since the study was loaded; run the study again")
    own = body.numbers_in
    if own is not None and unit is not None and own != unit:
        heights = heights * length_units.factor(own, unit)
    return heights


def _treated(heights: Array, body: Body, treatment: Treatment, L: float, periodic: bool) -> tuple[Array, Mask, int]:
    """Return the heights of one body as they are pressed, which of them were filled, and the number of outliers."""
    mirror, removed = _MIRRORS[body.mirror], 0
    try:
        heights = heights[mirror]  # a crop, blocks and new nodes are those of the first body, on both
        if treatment.crop is not None:
            (left, right), (front, back) = treatment.crop
            heights = heights[left : right + 1, front : back + 1]
        if treatment.outliers is not None:
            degree = "mean" if periodic else treatment.level if treatment.level == "quadratic" else "tilt"
            mask = outliers(heights, *treatment.outliers, degree=degree, periodic=periodic)
            heights, removed = np.where(mask, np.nan, heights), int(mask.sum())
        if treatment.downsample != 1:
            heights = block_means(heights, treatment.downsample)
        if treatment.resample != "none" and body.pixel_ratio is not None:
            heights = squared(heights, body.pixel_ratio)
        heights = heights[mirror]
        missing = np.isnan(heights)
        if treatment.level != "none":
            heights = level(heights, treatment.level)
        if treatment.filling is not None:
            heights = fill(heights, treatment.filling, periodic=periodic)
        if treatment.low_pass is not None:
            heights = low_pass(heights, L / (len(heights) - 1), treatment.low_pass)
    except SurfaceError as error:
        raise SurfaceError(f"{body.file}: {error}") from error
    return heights[mirror], missing[mirror], removed
