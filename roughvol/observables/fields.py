"""Observables of fields: gap and pressure, density and box counting of element volumes, numbers of central squares."""

from __future__ import annotations

import numpy as np

from roughvol.gap import box_counting, free_volume, transport
from roughvol.observables.regions import MEANS, Values, View, Window, central, window, window_of
from roughvol.observables.requests import flow_accuracy, value_of
from roughvol.observables.variables import AXES
from roughvol.study import Case
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array


def gap_and_pressure(view: View) -> Values:
    """Return g/σ and p L/(E* σ) on the whole surface, whatever the region."""
    return {"gap": view.whole.gap(), "pressure": view.whole.pressure()}


def _volumes(view: View) -> Array:
    """Return element volumes v = g δ² [length³]."""
    return free_volume.element_volumes(view.gap * view.surface.unit, view.surface.spacing, view.contact)


def density(view: View) -> Values:
    """Return f(v) and its edges."""
    asked = value_of(view.case.record, "volume_density")
    found = free_volume.volume_density(_volumes(view), view.contact, asked.bins, asked.include_contact)
    return {"volume_density": found.density, "volume_density_edges": found.edges}


def bins(case: Case, surface: Surface) -> Values:
    """Return the labels of a density."""
    number = value_of(case.record, "volume_density.bins")
    return {"bin": np.arange(number), "edge": np.arange(number + 1)}


def boxes(view: View) -> Values:
    """Return the largest v, box counts and local dimensions, thresholds along the first axis."""
    volumes = _volumes(view)
    largest = float(volumes.max())
    thresholds = value_of(view.case.record, "box_counting.thresholds")
    domains = [free_volume.domain(volumes, share * largest, view.contact) for share in thresholds]
    counts = [box_counting.box_counts(domain, periodic=view.periodic) for domain in domains]
    dimensions = [box_counting.local_dimension(count).dimension for count in counts]
    return {"volume_max": largest, "box_count": [count.counts for count in counts], "local_dimension": dimensions}


def box_sides(case: Case, surface: Surface) -> Values:
    """Return the labels of box counts."""
    empty = box_counting.box_counts(np.zeros(surface.shape, dtype=np.bool_)[window(case, surface.shape)])
    dimension = box_counting.local_dimension(empty)
    return {"r": empty.r, "r_mid": dimension.r_mid, "threshold": list(value_of(case.record, "box_counting.thresholds"))}


def widths(case: Case, surface: Surface) -> Values:
    """Return the widths over that of the surface."""
    return {"region_width": list(value_of(case.record, "region_widths.shares"))}


def _windows(view: View) -> list[Window]:
    shares = widths(view.case, view.surface)["region_width"]
    return [window_of(central(share), view.whole.shape, periodic=view.case.periodic) for share in shares]


def means(view: View) -> Values:
    """Return A*, p* and V* inside each square."""
    names, windows = ("contact_area_fraction", "mean_pressure", "free_volume"), _windows(view)
    fields = {name: getattr(view.whole, MEANS[name])() for name in names}
    return {f"{name}_within": [field[inside].mean() for inside in windows] for name, field in fields.items()}


def transmissivity_within(view: View) -> Values:
    """Return the flow with g³ through each square over that of plates; a square of a whole period is the period."""
    gap, accuracy, flows = view.whole.gap(), flow_accuracy(view.case.record), []
    for part in (gap[inside] for inside in _windows(view)):
        whole = view.case.periodic and part.shape == gap.shape
        both = [transport.conduction(part, axis, periodic=whole, accuracy=accuracy) for axis in range(len(AXES))]
        flows.append([flow.coefficient for flow in both])
    return {"transmissivity_within": flows}
