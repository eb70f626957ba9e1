"""Observables of a pressure field: hardness in the unit of p*, shares above it, yield, the pressure in the middle."""

from __future__ import annotations

import math

import numpy as np

from roughvol.contact.loading import Contact
from roughvol.observables import regions
from roughvol.observables.regions import Values, View
from roughvol.study import Case
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array


def starred_hardness(case: Case, surface: Surface) -> float | None:
    """Return the hardness in the unit of p*, H L/(E* σ); None without one."""
    return None if case.hardness is None else case.hardness * surface.side / (case.height or surface.unit)


def above_hardness(view: View) -> Values:
    """Return the shares above a hardness that is given for comparison alone."""
    hardness = None if view.case.plastic else starred_hardness(view.case, view.surface)
    if hardness is None:
        return {}
    contact, load = above(view.state.pressure(), hardness)
    return {"contact_above_hardness_fraction": contact, "load_above_hardness_fraction": load}


def above(pressure: Array, hardness: float) -> tuple[float, float]:
    """Return the share of the contact with a pressure above the hardness, and the share of the load there."""
    hard = pressure[pressure > hardness]
    if hard.size == 0:
        return 0.0, 0.0
    return hard.size / np.count_nonzero(pressure), float(hard.sum() / pressure.sum())


def central(view: View) -> Values:
    """Return the mean pressure in the middle over that of the whole; 3 nodes a side have one in the middle."""
    return {"central_pressure_ratio": central_pressure_ratio(view.whole)} if min(view.whole.shape) > 3 else {}


def central_pressure_ratio(whole: Contact) -> float:
    """Return the mean pressure in the central half of each side over that of the whole; NaN without contact."""
    pressure = whole.pressure()
    mean = float(pressure.mean())
    inside = regions.window_of(regions.central(0.5), whole.shape)
    return float(pressure[inside].mean()) / mean if mean > 0.0 else math.nan
