"""The surface of a case of measured heights: each body read and treated by itself, two of them added.

Conventions: the heights of each body are positive out of it. Two bodies touch first where the sum of their heights is
largest, so they are pressed as one rough surface of height z1 + z2 against a plane. Levelling, filling and filtering
are linear, and what is done to each body could as well be done to the sum; only what is missing belongs to one of them.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from roughvol import heightfile, lengths
from roughvol.errors import SurfaceError
from roughvol.physics import levelling
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
    (total, filled), *others = (_treated(body, case) for body in case.bodies)
    for body, (heights, missing) in zip(case.bodies[1:], others, strict=True):
        if heights.shape != total.shape:
            message = f"{body.file}: has {heights.shape} nodes; allowed: {total.shape}, as {case.bodies[0].file} has"
            raise SurfaceError(message)
        total, filled = total + heights, filled | missing
    return Surface(total, case.L / (len(total) - 1), int(filled.sum()))


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


def _treated(body: Body, case: Case) -> tuple[Heights, NDArray[np.bool_]]:
    """Return the heights of one body as they are pressed, and which of them were missing."""
    treatment = case.treatment
    heights = heightfile.read(
        body.file,
        variable=body.variable,
        holes=treatment.missing != "refuse",
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
    missing = np.isnan(heights)
    try:
        if treatment.level != "none":
            heights = levelling.level(heights, treatment.level)
        if treatment.missing != "refuse":
            heights = levelling.fill(heights, treatment.missing)
        if treatment.low_pass is not None:
            heights = levelling.low_pass(heights, case.L / (len(heights) - 1), treatment.low_pass)
    except SurfaceError as error:
        message = f"{body.file}: {error}"
        raise SurfaceError(message) from error
    mirror = _MIRRORS[body.mirror]
    return heights[mirror], missing[mirror]
