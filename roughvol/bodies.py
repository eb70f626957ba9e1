"""The surface of a case of measured heights: each body read and treated by itself, two of them added.

Conventions: the heights of each body are positive out of it. Two bodies touch first where the sum of their heights is
largest, so they are pressed as one rough surface of height z1 + z2 against a plane. Apart from missing heights and
outliers, which belong to one of them, what is done to each body is linear and could as well be done to the sum.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from roughvol import heightfile, lengths
from roughvol.errors import SurfaceError
from roughvol.physics import lattice, levelling, outliers
from roughvol.physics.surface import Surface
from roughvol.study import Body, Case

Heights = NDArray[np.float64]

_FLATTEST = 1e-7  # of the side: a nanometre on a centimetre
_MIRRORS = {"none": np.s_[:, :], "x": np.s_[::-1, :], "y": np.s_[:, ::-1]}


def surface(case: Case) -> Surface:
    """Return the surface of a case whose heights come from files.

    Raises
    ------
    SurfaceError, DatasetError
        If a file cannot be read, has changed since the study was loaded, holds no heights or not those of a lattice of
        the same shape as the other; if heights are missing and the study does not say how to fill them, or if they
        cannot be treated as it says.
    """
    measured = [_measured(body, case) for body in case.bodies]
    total, filled, removed = _pressed(measured, case)
    peak_before = None
    if case.treatment.outliers is not None:
        whole = replace(case, treatment=replace(case.treatment, outliers=None))
        before = _pressed(measured, whole)[0] if removed else total
        peak_before = Surface(before, 1.0).peak
    return Surface(total, case.L / (len(total) - 1), filled, removed, peak_before)


def _pressed(measured: list[Heights], case: Case) -> tuple[Heights, int, int]:
    """Return the heights that are pressed, how many of them were filled, and how many outliers were taken out."""
    (total, filled, removed), *others = (
        _treated(heights, body, case) for heights, body in zip(measured, case.bodies, strict=True)
    )
    for body, (heights, missing, count) in zip(case.bodies[1:], others, strict=True):
        if heights.shape != total.shape:
            message = f"{body.file}: has {heights.shape} nodes; allowed: {total.shape}, as {case.bodies[0].file} has"
            raise SurfaceError(message)
        total, filled, removed = total + heights, filled | missing, removed + count
    return total, int(filled.sum()), removed


def notes(case: Case, surface: Surface) -> tuple[str, ...]:
    """Return what the user should look at: the notes of the case, and heights that are absurd for its length.

    Parameters
    ----------
    case : Case
        Case whose heights come from files.
    surface : Surface
        Its surface, as `surface` returns it.
    """
    unit = case.length_unit or ""
    span, side = float(np.ptp(surface.heights)), surface.spacing * (min(surface.heights.shape) - 1)
    said = f"the heights span {span:.3g} {unit}".rstrip()
    found = []
    if span > side:
        found.append(f"{said}, more than the shorter side, {side:.3g} {unit}".rstrip() + ": is heights_unit right?")
    elif 0.0 < span < _FLATTEST * side:
        found.append(f"{said}, {span / side:.1g} of the shorter side: is heights_unit right?")
    return (*case.notes, *found)


def _measured(body: Body, case: Case) -> Heights:
    """Return the heights of one body as its file holds them, in the unit of the study."""
    heights = heightfile.read(
        body.file,
        variable=body.variable,
        holes=case.treatment.missing != "refuse",
        columns=body.columns,
        ignore_header=body.header == "ignore",
    )
    with body.file.open("rb") as stream:
        sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    if sha256 != body.sha256:
        message = f"{body.file} has changed since the study was loaded; run the study again"
        raise SurfaceError(message)
    unit = body.numbers_in
    if unit is not None and case.length_unit is not None and unit != case.length_unit:
        heights = heights * lengths.factor(unit, case.length_unit)
    return heights


def _treated(heights: Heights, body: Body, case: Case) -> tuple[Heights, NDArray[np.bool_], int]:
    """Return the heights of one body as they are pressed, which of them were filled, and the number of outliers."""
    treatment, mirror, removed = case.treatment, _MIRRORS[body.mirror], 0
    try:
        heights = heights[mirror]  # a crop, blocks and new nodes are those of the first body, on both
        if treatment.crop is not None:
            (left, right), (front, back) = treatment.crop
            heights = heights[left : right + 1, front : back + 1]
        if treatment.outliers is not None:
            degree = treatment.level if treatment.level == "quadratic" else "tilt"
            found = outliers.outliers(heights, *treatment.outliers, degree=degree)
            heights, removed = np.where(found, np.nan, heights), int(found.sum())
        if treatment.downsample != 1:
            heights = lattice.block_means(heights, treatment.downsample)
        if treatment.resample != "none" and body.pixel_ratio is not None:
            heights = lattice.squared(heights, body.pixel_ratio)
        heights = heights[mirror]
        missing = np.isnan(heights)
        if treatment.level != "none":
            heights = levelling.level(heights, treatment.level)
        if treatment.filling is not None:
            heights = levelling.fill(heights, treatment.filling)
        if treatment.low_pass is not None:
            heights = levelling.low_pass(heights, case.L / (len(heights) - 1), treatment.low_pass)
    except SurfaceError as error:
        message = f"{body.file}: {error}"
        raise SurfaceError(message) from error
    return heights[mirror], missing[mirror], removed
