"""What yielding leaves: the hardness in the unit of p*, and the residual surface with its texture.

The residual surface is z - u_pl, the heights without load less the plastic displacement u_pl ≥ 0. Elastic displacements
are gone there.
"""

from __future__ import annotations

from roughvol.observables import deformed
from roughvol.observables.regions import is_period, window
from roughvol.observables.view import Values, View
from roughvol.study import Case
from roughvol.surfaces.surface import Surface


def starred_hardness(case: Case, surface: Surface) -> float | None:
    """Return the hardness in the unit of p*, H L/(E* σ); None without one."""
    return None if case.hardness is None else case.hardness * surface.side / (case.height or surface.unit)


def largest_pressure(case: Case, surface: Surface) -> float | None:
    """Return the largest pressure of a contact that yields, in the unit of p*; None in elastic contact."""
    return starred_hardness(case, surface) if case.plastic else None


def shares(view: View) -> Values:
    """Return plastic volume and yielded area."""
    names = ("plastic_volume", "plastic_area_fraction") if view.case.plastic else ()
    return {name: getattr(view.state, name) for name in names}


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
        texture = deformed.numbers(inside, surface.spacing, periodic=periodic) | deformed.curves(z, periodic=periodic)
        values |= {f"{name}_residual": value for name, value in texture.items()}
    return values
