"""Numbers of a pressure field: the shares above the hardness, and the pressure in the middle."""

from __future__ import annotations

import math

import numpy as np

from roughvol.contact.loading import Contact
from roughvol.observables import regions
from roughvol.typing import Array


def above(pressure: Array, hardness: float) -> tuple[float, float]:
    """Return the share of the contact with a pressure above the hardness, and the share of the load there.

    Parameters
    ----------
    pressure : ndarray
        Pressure of every element, 0 outside the contact, in any unit.
    hardness : float
        Hardness in the same unit.

    Returns
    -------
    tuple of float
        Share of the contact and share of the load, 0 to 1.
    """
    hard = pressure[pressure > hardness]
    if hard.size == 0:
        return 0.0, 0.0
    return hard.size / np.count_nonzero(pressure), float(hard.sum() / pressure.sum())


def central_pressure_ratio(whole: Contact) -> float:
    """Return the mean pressure in the central half of each side over that of the whole; NaN without contact.

    Parameters
    ----------
    whole : Contact
        A state of the whole surface, of at least 4 elements a side.

    Returns
    -------
    float
        The ratio [1].
    """
    pressure = whole.pressure()
    mean = float(pressure.mean())
    inside = regions.window_of(regions.central(0.5), whole.shape)
    return float(pressure[inside].mean()) / mean if mean > 0.0 else math.nan
