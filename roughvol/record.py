"""What a study keeps: each state of a sweep reduced at once to stored numbers, and fields only at the states it names.

Everything returned is a mapping from names of `dataset.VARIABLES` to arrays without the dimensions of the case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from roughvol.physics import fractal, freevolume, texture
from roughvol.physics.contact import Contact
from roughvol.physics.surface import Surface
from roughvol.study import Case, Level

Values = dict[str, Any]

PER_STEP = (
    "indentation",
    "separation",
    "contact_area_fraction",
    "mean_pressure",
    "free_volume",
    "iterations",
    "convolutions",
    "convolutions_fp32",
    "residual",
    "converged",
)
LAST = Level("last")
ROUNDING = 1e-9  # by which a state may miss a level and still count as reaching it


def of_surface(case: Case, surface: Surface) -> Values:
    """Return the numbers of the undeformed surface, its heights if asked for, and the labels of its nodes."""
    values: Values = {"Sq": surface.Sq, "Sdq": texture.Sdq(surface.heights, surface.spacing), "z_max": surface.z_max}
    values["hurst_measured"] = texture.hurst_spectrum(surface.heights, surface.spacing)
    if case.record.heights or case.record.fields_at:
        rows, columns = surface.shape
        values |= {"x": np.arange(rows) / (rows - 1), "y": np.arange(columns) / (rows - 1)}
    if case.record.heights:
        values["heights"] = surface.heights
    return values


def of_sweep(
    case: Case, surface: Surface, contacts: Iterable[Contact], on_step: Callable[[int], None] | None = None
) -> Values:
    """Return the numbers of every step, and what is recorded of the first state that reaches each level selected.

    Parameters
    ----------
    case : Case
        Names the levels and what to record there.
    surface : Surface
        The surface pressed.
    contacts : iterable of Contact
        The states in the order of the sweep; none is held longer than its turn.
    on_step : callable, optional
        Called with the number of each step that has been reduced.
    """
    per_step: dict[str, list[Any]] = {name: [] for name in PER_STEP}
    levels = _levels(case)
    kept: dict[str, dict[str, tuple[int, Values]]] = {dim: {} for dim in levels}
    for step, contact in enumerate(contacts, start=1):
        for name in PER_STEP:
            per_step[name].append(getattr(contact, name))
        for dim, by_label in levels.items():
            for label, level in by_label.items():
                if label not in kept[dim] and reached(level, step, contact, case):
                    kept[dim][label] = step, _AT[dim](case, surface, contact)
        if on_step is not None:
            on_step(step)
    values: Values = {**per_step, "step": np.arange(1, case.sweep.steps + 1), **_labels(case, surface)}
    for dim, by_label in levels.items():
        values[dim] = list(by_label)
        values[f"{dim}_step"] = [kept[dim][label][0] if label in kept[dim] else -1 for label in by_label]
        values |= _stacked(list(by_label), {label: arrays for label, (_, arrays) in kept[dim].items()})
    return values


def reached(level: Level, step: int, contact: Contact, case: Case) -> bool:
    """Return whether a state is at or beyond a level.

    The last step reaches the level that the sweep was asked to end at, though a solve to a finite residual may put it
    one element or a few digits short.
    """
    if step == case.sweep.steps and level in (LAST, case.sweep.target):
        return True
    if level.value is None:
        return False
    slack = ROUNDING * max(1.0, abs(level.value))
    match level.kind:
        case "step":
            return step == level.value
        case "separation":
            return contact.separation <= level.value + slack
        case "indentation":
            return contact.indentation >= level.value - slack
        case "contact_area":
            return contact.contact_area_fraction >= level.value - slack
        case "pressure":
            return contact.mean_pressure >= level.value - slack
    message = f"no such level: {level.label}"
    raise ValueError(message)


def _levels(case: Case) -> dict[str, dict[str, Level]]:
    """Levels by label, for each dimension that runs over states."""
    record = case.record
    selects = {
        "field_at": record.fields_at,
        "density_at": record.volume_density.at if record.volume_density else None,
        "box_at": record.box_counting.at if record.box_counting else None,
    }
    return {dim: {level.label: level for level in select.levels} for dim, select in selects.items() if select}


def _fields(case: Case, surface: Surface, contact: Contact) -> Values:
    return {"gap": contact.gap(), "pressure": contact.pressure()}


def _density(case: Case, surface: Surface, contact: Contact) -> Values:
    assert case.record.volume_density is not None
    mask = contact.contact()
    density = freevolume.volume_density(
        _volumes(surface, contact),
        mask,
        bins=case.record.volume_density.bins,
        include_contact=case.record.volume_density.include_contact,
    )
    return {"volume_density": density.density, "volume_density_edges": density.edges}


def _boxes(case: Case, surface: Surface, contact: Contact) -> Values:
    assert case.record.box_counting is not None
    volumes, mask = _volumes(surface, contact), contact.contact()
    largest = float(volumes.max())
    domains = [freevolume.domain(volumes, share * largest, mask) for share in case.record.box_counting.thresholds]
    counts = [fractal.box_counts(domain) for domain in domains]
    dimensions = [fractal.local_dimension(count).dimension for count in counts]
    return {"volume_max": largest, "box_count": [count.counts for count in counts], "local_dimension": dimensions}


_AT = {"field_at": _fields, "density_at": _density, "box_at": _boxes}


def _volumes(surface: Surface, contact: Contact) -> freevolume.Field:
    """Element volumes v = g δ² [length³]; a flat surface has Sq = 0 and its gap is in lengths already."""
    return freevolume.element_volumes(contact.gap() * (surface.Sq or 1.0), surface.spacing, contact.contact())


def _labels(case: Case, surface: Surface) -> Values:
    """Labels of bins, edges, thresholds and boxes."""
    values: Values = {}
    if case.record.volume_density is not None:
        bins = case.record.volume_density.bins
        values |= {"bin": np.arange(bins), "edge": np.arange(bins + 1)}
    if case.record.box_counting is not None:
        empty = fractal.box_counts(np.zeros(surface.shape, dtype=np.bool_))
        values |= {"r": empty.r, "r_mid": fractal.local_dimension(empty).r_mid}
        values["threshold"] = list(case.record.box_counting.thresholds)
    return values


def _stacked(labels: list[str], kept: Mapping[str, Values]) -> Values:
    """Arrays of all states along a new first axis, NaN where one was not reached; nothing where none was."""
    stacked: Values = {}
    for name, example in next(iter(kept.values()), {}).items():
        absent = np.full(np.shape(example), np.nan)
        arrays = [kept[label][name] if label in kept else absent for label in labels]
        stacked[name] = np.stack([np.asarray(array, dtype=float) for array in arrays])
    return stacked
