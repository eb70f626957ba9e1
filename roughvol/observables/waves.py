"""The spectrum of a surface by stored name: before load, and of the deformed surface under load.

Everything is of the region of the study, whose waves q are multiples of 2π over the length of its first axis. A whole
period has its waves exactly. A patch, and a part of a period, are multiplied by a window (`surfaces.psd`). The deformed
surface is a plane less the gap, as in `deformed`.
"""

from __future__ import annotations

import math
from dataclasses import fields

from roughvol.observables.regions import is_period, window
from roughvol.observables.view import Values, View
from roughvol.study import Case
from roughvol.surfaces import psd
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array

STORED_AS = {"nayak": "nayak_parameter"}
"""Names of stored variables where they differ from those of `surfaces.psd.Spectral`."""


def before_load(case: Case, surface: Surface) -> Values:
    """Return the spectrum of the undeformed surface in the region of the study."""
    part = _part(case, surface, surface.heights[window(case, surface.shape)])
    values = _values(part)
    if case.record.region is not None:  # else L gives them
        values["wave_number"] = 2.0 * math.pi * values["wave"] / part.side
    return values


def under_load(view: View) -> Values:
    """Return the spectrum of the deformed surface at a state, by stored name with the suffix ``_loaded``."""
    values = _values(_part(view.case, view.surface, -view.gap * view.surface.unit))
    del values["wave"]
    return {f"{name}_loaded": value for name, value in values.items()}


def _part(case: Case, surface: Surface, heights: Array) -> Surface:
    return Surface(heights, surface.spacing, periodic=is_period(case))


def _values(surface: Surface) -> Values:
    found = psd.spectral(surface)
    return {STORED_AS.get(field.name, field.name): getattr(found, field.name) for field in fields(found)}
