"""The spectrum of the undeformed surface by stored name."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from roughvol.surfaces import psd
from roughvol.surfaces.surface import Surface

STORED_AS = {"nayak": "nayak_parameter"}
"""Names of stored variables where they differ from those of `surfaces.psd.Spectral`."""


def of_surface(surface: Surface) -> dict[str, Any]:
    """Return the power spectral density of the whole surface, its root mean squares by scale, and Nayak's parameter.

    Parameters
    ----------
    surface : Surface
        The undeformed surface, periodic or a patch.

    Returns
    -------
    dict
        Values by stored name.
    """
    found = psd.spectral(surface)
    return {STORED_AS.get(field.name, field.name): getattr(found, field.name) for field in fields(found)}
