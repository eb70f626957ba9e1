"""The spectrum of a surface by stored name: before load, and of the deformed surface under load.

Everything is of the region of the study, whose waves q are multiples of 2π over the length of its first axis. A whole
period has its waves exactly. A patch, and a part of a period, are multiplied by a window (`surfaces.psd`). The deformed
surface is a plane less the gap, as in `deformed`.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

from roughvol.observables.regions import State, is_period, window
from roughvol.study import Case
from roughvol.surfaces import psd
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array

STORED_AS = {"nayak": "nayak_parameter"}
"""Names of stored variables where they differ from those of `surfaces.psd.Spectral`."""


def before_load(case: Case, surface: Surface) -> dict[str, Any]:
    """Return the spectrum of the undeformed surface in the region of the study.

    Parameters
    ----------
    case : Case
        Names the region.
    surface : Surface
        The whole undeformed surface, periodic or a patch.

    Returns
    -------
    dict
        Power spectral density, root mean squares by scale, Nayak's parameter, and the wave numbers of a region.
    """
    part = _part(case, surface, surface.heights[window(case, surface.shape)])
    values = _values(part)
    if case.record.region is not None:  # else L gives them
        values["wave_number"] = 2.0 * math.pi * values["wave"] / part.side
    return values


def under_load(case: Case, surface: Surface, state: State) -> dict[str, Any]:
    """Return the spectrum of the deformed surface at a state, by stored name with the suffix ``_loaded``.

    Parameters
    ----------
    case : Case
        Names the region.
    surface : Surface
        The whole surface; its Sq is the unit of the gap.
    state : Contact or Within
        The state in the region of the study.

    Returns
    -------
    dict
        Values by stored name.
    """
    values = _values(_part(case, surface, -state.gap() * surface.unit))
    del values["wave"]
    return {f"{name}_loaded": value for name, value in values.items()}


def _part(case: Case, surface: Surface, heights: Array) -> Surface:
    return Surface(heights, surface.spacing, periodic=is_period(case))


def _values(surface: Surface) -> dict[str, Any]:
    found = psd.spectral(surface)
    return {STORED_AS.get(field.name, field.name): getattr(found, field.name) for field in fields(found)}
