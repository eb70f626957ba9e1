"""What yielding leaves: the hardness in the unit of p*, and the residual surface with its texture.

The residual surface is z - u_pl, the heights without load less the plastic displacement u_pl ≥ 0. Elastic displacements
are gone there.
"""

from __future__ import annotations

from typing import Any

from roughvol.contact.loading import Contact
from roughvol.observables import deformed
from roughvol.observables.regions import is_period, window
from roughvol.study import Case
from roughvol.surfaces.surface import Surface

Values = dict[str, Any]


def starred_hardness(case: Case, surface: Surface) -> float | None:
    """Return the hardness in the unit of p*, H L/(E* σ).

    Parameters
    ----------
    case : Case
        Its hardness over E*, and the Sq to which heights are scaled.
    surface : Surface
        The surface pressed.

    Returns
    -------
    float or None
        Hardness [1]; None without one.
    """
    return None if case.hardness is None else case.hardness * surface.side / (case.height or surface.unit)


def largest_pressure(case: Case, surface: Surface) -> float | None:
    """Return the largest pressure of a contact that yields, in the unit of p*; None in elastic contact.

    Parameters
    ----------
    case, surface
        As in `starred_hardness`.

    Returns
    -------
    float or None
        Largest pressure [1].
    """
    return starred_hardness(case, surface) if case.plastic else None


def residual(case: Case, surface: Surface, last: Contact) -> Values:
    """Return the residual heights and their texture, where a study asks for them.

    Parameters
    ----------
    case : Case
        Names what to record, and the region.
    surface : Surface
        The whole surface.
    last : Contact
        The last state of the path.

    Returns
    -------
    dict
        Values by stored name; those of the texture have the suffix ``_residual``.
    """
    values: Values = {}
    heights = surface.heights - last.plastic_displacement() * surface.unit
    if case.record.residual_heights:
        values["residual_heights"] = heights
    if case.record.texture is not None:
        inside = heights[window(case, surface.shape)]
        z = (inside - heights.mean()) / surface.unit
        periodic = is_period(case)
        texture = deformed.numbers(inside, surface.spacing, periodic=periodic) | deformed.curves(z, periodic=periodic)
        values |= {f"{name}_residual": value for name, value in texture.items()}
    return values
