"""The list of observables: which states each is asked for at, its function, labels, and cost.

`AT_STATES` holds the observables of single states, each along its own dimension of states. Those along the steps are
rows of `void.QUANTITIES` and `regions.QUANTITIES`. The reduction of a sweep, the estimate of costs and the memory are
made from these rows. See docs/observables.md for how to add one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from roughvol.contact.search import TARGETS
from roughvol.gap import box_counting, free_volume
from roughvol.observables import coupling, deformed, regions, void, waves
from roughvol.observables.regions import State, window
from roughvol.study import Case, Level, Record, Select
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array

Values = dict[str, Any]


def _fields(case: Case, surface: Surface, state: State) -> Values:
    """Return g/σ and p L/(E* σ) on the whole surface, whatever the region."""
    whole = state.whole if isinstance(state, regions.Within) else state
    return {"gap": whole.gap(), "pressure": whole.pressure()}


def _flux(case: Case, surface: Surface, state: State) -> Values:
    """Return the flux on the nodes of the whole surface, NaN outside the region, and the transmissivities."""
    values = void.flux(state, void.over_sigma(case.gas, case.height or surface.unit))
    for name in ("flux_x", "flux_y"):
        inside, values[name] = values[name], np.full(surface.shape, np.nan)
        values[name][window(case, surface.shape)] = inside
    return values


def _density(case: Case, surface: Surface, state: State) -> Values:
    """Return f(v) and its edges."""
    assert case.record.volume_density is not None
    density = free_volume.volume_density(
        _volumes(surface, state),
        state.contact(),
        bins=case.record.volume_density.bins,
        include_contact=case.record.volume_density.include_contact,
    )
    return {"volume_density": density.density, "volume_density_edges": density.edges}


def _boxes(case: Case, surface: Surface, state: State) -> Values:
    """Return the largest v, box counts and local dimensions, thresholds along the first axis."""
    assert case.record.box_counting is not None
    volumes, mask = _volumes(surface, state), state.contact()
    largest = float(volumes.max())
    domains = [free_volume.domain(volumes, share * largest, mask) for share in case.record.box_counting.thresholds]
    counts = [box_counting.box_counts(domain, periodic=state.periodic) for domain in domains]
    dimensions = [box_counting.local_dimension(count).dimension for count in counts]
    return {"volume_max": largest, "box_count": [count.counts for count in counts], "local_dimension": dimensions}


def _volumes(surface: Surface, state: State) -> Array:
    """Return element volumes v = g δ² [length³]."""
    return free_volume.element_volumes(state.gap() * surface.unit, surface.spacing, state.contact())


def _bins(case: Case, surface: Surface) -> Values:
    assert case.record.volume_density is not None
    bins = case.record.volume_density.bins
    return {"bin": np.arange(bins), "edge": np.arange(bins + 1)}


def _box_sides(case: Case, surface: Surface) -> Values:
    assert case.record.box_counting is not None
    empty = box_counting.box_counts(np.zeros(surface.shape, dtype=np.bool_)[window(case, surface.shape)])
    dimension = box_counting.local_dimension(empty)
    return {"r": empty.r, "r_mid": dimension.r_mid, "threshold": list(case.record.box_counting.thresholds)}


@dataclass(frozen=True)
class AtStates:
    """An observable of single states.

    Attributes
    ----------
    dim : dimension along which its states are stored.
    key : key of the section ``record`` that selects its states, as ``box_counting.at``.
    of_state : case, surface, state in the region ↦ values by stored name; and the half space, if it ``solves``.
    seconds : per state and node, timed at m = 7 … 9.
    labels : case, surface ↦ coordinates of its values.
    parts : section ``record`` ↦ how often its function passes over the nodes.
    fields : section ``record`` ↦ how many fields it stores for each state.
    flow : whether it factorises, so that its cost grows faster than the nodes.
    solves : whether it solves contacts, and takes the half space as its last argument.
    """

    dim: str
    key: str
    of_state: Callable[..., Values]
    seconds: float
    labels: Callable[[Case, Surface], Values] = lambda case, surface: {}
    parts: Callable[[Record], int] = lambda record: 1
    fields: Callable[[Record], int] = lambda record: 0
    flow: bool = False
    solves: bool = False


AT_STATES = {
    "fields_at": AtStates("field_at", "fields_at", _fields, 1e-9, fields=lambda record: 2),
    "volume_density": AtStates("density_at", "volume_density.at", _density, 1.2e-8, labels=_bins),
    "box_counting": AtStates(
        "box_at",
        "box_counting.at",
        _boxes,
        2e-9,
        labels=_box_sides,
        parts=lambda record: len(record.box_counting.thresholds) if record.box_counting else 0,
    ),
    "flux_at": AtStates(
        "flux_at",
        "transport.flux_at",
        _flux,
        void.QUANTITIES["transmissivity"].seconds,
        fields=lambda record: 2,
        flow=True,
    ),
    "fluid_pressure": AtStates(
        "fluid_at",
        "fluid_pressure.at",
        coupling.of_state,
        8e-5,
        parts=lambda record: 8 if record.fluid_pressure and record.fluid_pressure.coupling == "full" else 1,
        fields=lambda record: 2 if record.fluid_pressure and record.fluid_pressure.fields else 0,
        flow=True,
        solves=True,
    ),
    "texture": AtStates("texture_at", "texture.at", deformed.under_load, 3e-7),
    "psd": AtStates("psd_at", "psd.at", waves.under_load, 2e-7),
}


def asked_at_states(record: Record) -> dict[str, dict[str, Level]]:
    """Return the levels by label of each observable of `AT_STATES` that is asked for.

    Parameters
    ----------
    record : Record
        The section ``record`` of a study.

    Returns
    -------
    dict
        Levels by label, by name of the observable.
    """
    selects = {name: _select(record, row.key) for name, row in AT_STATES.items()}
    return {name: {level.label: level for level in select.levels} for name, select in selects.items() if select}


def _select(record: Record, key: str) -> Select | None:
    part: Any = record
    for name in key.split("."):
        part = part and getattr(part, name)
    return part


def asked(record: Record) -> dict[str, dict[str, Level] | None]:
    """Return the levels by label of each observable that is asked for; None for every step.

    Parameters
    ----------
    record : Record
        The section ``record`` of a study.

    Returns
    -------
    dict
        Levels by label, or None, by name of the observable.
    """
    along = void.levels(record.transport) if record.transport else {}
    central = regions.levels(record.region_widths) if record.region_widths else {}
    return {**along, **central, **asked_at_states(record)}


def seconds_per_node(name: str) -> tuple[float, bool]:
    """Return the seconds that an observable takes a state, node and part, and whether it factorises.

    Parameters
    ----------
    name : str
        Name of the observable.

    Returns
    -------
    tuple of float and bool
        Seconds; whether it factorises.
    """
    row = (AT_STATES | void.QUANTITIES | regions.QUANTITIES)[name]
    return row.seconds, row.flow


def fields_of(record: Record) -> int:
    """Return how many fields of a case are stored.

    Parameters
    ----------
    record : Record
        The section ``record`` of a study.

    Returns
    -------
    int
        Number of fields, heights included.
    """
    asked_for = asked_at_states(record)
    return (
        record.heights
        + record.residual_heights
        + sum(AT_STATES[name].fields(record) * len(levels) for name, levels in asked_for.items())
    )


def searched_levels(case: Case) -> int:
    """Return for how many levels a state is searched for, each once.

    Parameters
    ----------
    case : Case
        Names what to record.

    Returns
    -------
    int
        Number of levels.
    """
    levels = {level for by_label in asked_at_states(case.record).values() for level in by_label.values()}
    searched = (*TARGETS, "mean_gap", "load", *(("indentation", "separation") if case.periodic else ()))
    return sum(level.kind in searched and level != case.sweep.target for level in levels)
