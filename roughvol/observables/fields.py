"""Observables of fields: gap and pressure themselves, and density and box counting of the element volumes."""

from __future__ import annotations

import numpy as np

from roughvol.gap import box_counting, free_volume
from roughvol.observables.regions import window
from roughvol.observables.view import Values, View
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
    asked = view.case.record.volume_density
    assert asked is not None
    found = free_volume.volume_density(_volumes(view), view.contact, asked.bins, asked.include_contact)
    return {"volume_density": found.density, "volume_density_edges": found.edges}


def bins(case: Case, surface: Surface) -> Values:
    """Return the labels of a density."""
    assert case.record.volume_density is not None
    number = case.record.volume_density.bins
    return {"bin": np.arange(number), "edge": np.arange(number + 1)}


def boxes(view: View) -> Values:
    """Return the largest v, box counts and local dimensions, thresholds along the first axis."""
    assert view.case.record.box_counting is not None
    volumes = _volumes(view)
    largest = float(volumes.max())
    thresholds = view.case.record.box_counting.thresholds
    domains = [free_volume.domain(volumes, share * largest, view.contact) for share in thresholds]
    counts = [box_counting.box_counts(domain, periodic=view.periodic) for domain in domains]
    dimensions = [box_counting.local_dimension(count).dimension for count in counts]
    return {"volume_max": largest, "box_count": [count.counts for count in counts], "local_dimension": dimensions}


def box_sides(case: Case, surface: Surface) -> Values:
    """Return the labels of box counts."""
    assert case.record.box_counting is not None
    empty = box_counting.box_counts(np.zeros(surface.shape, dtype=np.bool_)[window(case, surface.shape)])
    dimension = box_counting.local_dimension(empty)
    return {"r": empty.r, "r_mid": dimension.r_mid, "threshold": list(case.record.box_counting.thresholds)}
