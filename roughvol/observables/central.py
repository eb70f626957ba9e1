"""Observables of central squares of several widths."""

from __future__ import annotations

from roughvol.gap import transport
from roughvol.observables.regions import Window, central, window_of
from roughvol.observables.variables import AXES
from roughvol.observables.view import Values, View
from roughvol.study import Case
from roughvol.surfaces.surface import Surface


def widths(case: Case, surface: Surface) -> Values:
    """Return the widths over that of the surface."""
    assert case.record.region_widths is not None
    return {"region_width": list(case.record.region_widths.shares)}


def _windows(view: View) -> list[Window]:
    shares = widths(view.case, view.surface)["region_width"]
    return [window_of(central(share), view.whole.shape, periodic=view.case.periodic) for share in shares]


def means(view: View) -> Values:
    """Return A*, p* and V* inside each square."""
    contact, pressure, gap = view.whole.contact(), view.whole.pressure(), view.whole.gap()
    return {
        "contact_area_fraction_within": [contact[inside].mean() for inside in _windows(view)],
        "mean_pressure_within": [pressure[inside].mean() for inside in _windows(view)],
        "free_volume_within": [gap[inside].mean() for inside in _windows(view)],
    }


def transmissivity(view: View) -> Values:
    """Return the flow with g³ through each square over that of plates."""
    gap = view.whole.gap()
    axes = range(len(AXES))
    flows = [[transport.conduction(gap[inside], axis).coefficient for axis in axes] for inside in _windows(view)]
    return {"transmissivity_within": flows}
