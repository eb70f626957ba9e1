"""What a study asks for: its observables with their states, and what they take of time and memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from roughvol.gap.network import ACCURACY
from roughvol.observables.variables import AXES, OBSERVABLES, Observable
from roughvol.study import EVERY_STEP, Case, Level, Record, Select

PASSES = {"full": 40, "one-way": 1}
"""Solves of a contact under fluid pressure, by the coupling, for the cost. Near closing an axis may take 320."""


def value_of(record: Record, key: str) -> Any:
    """Return the value of a key of the section ``record``, as ``box_counting.at``; None where nothing is asked for."""
    part: Any = record
    for name in key.split("."):
        part = part and getattr(part, name)
    return part


def asked(record: Record) -> dict[str, tuple[Level, ...] | None]:
    """Return, for each requested observable, its levels; None for every step."""
    states = {
        name: value_of(record, row.key) if row.key else row.states for name, row in OBSERVABLES.items() if row.of_state
    }
    return {name: _levels(some) for name, some in states.items() if some}


def _levels(states: Any) -> tuple[Level, ...] | None:
    if states is True or states == EVERY_STEP or isinstance(states, Mapping):
        return None
    return states.levels if isinstance(states, Select) else (Level(states),)


def timed(record: Record) -> dict[str, tuple[Level, ...] | None]:
    """Return the requested observables that take time worth a line."""
    return {name: levels for name, levels in asked(record).items() if OBSERVABLES[name].seconds}


def passes(row: Observable, record: Record) -> list[float]:
    """Return the share of the nodes that each pass of the function takes."""
    if row.key.startswith("region_widths"):
        return [share**2 for share in value_of(record, "region_widths.shares")]
    region = record.region
    inside = 1.0 if region is None else (region.x[1] - region.x[0]) * (region.y[1] - region.y[0])
    often = value_of(record, row.passes) if row.passes else (1,)
    return [inside] * (PASSES[often] if isinstance(often, str) else len(often))


def flow_accuracy(record: Record) -> float:
    """Return the allowed relative error of the flows."""
    return value_of(record, "transport.accuracy") or ACCURACY


def fields_of(record: Record) -> int:
    """Return how many fields of a case are stored, heights included."""
    fields = record.heights + record.residual_heights
    for name, levels in asked(record).items():
        row = OBSERVABLES[name]
        if row.fields and (not row.fields_if or value_of(record, row.fields_if)):
            fields += row.fields * len(levels or ())
    return fields


def searched_levels(case: Case) -> list[Level]:
    """Return the levels whose state is searched for, each once, and those at which ways close."""
    states = (levels for name, levels in asked(case.record).items() if OBSERVABLES[name].dim)
    levels = dict.fromkeys(level for some in states for level in some or ())
    closing = [Level("percolation")] * len(AXES) if value_of(case.record, "transport.closing") else []
    return closing + [level for level in levels if level.searched(endless=case.endless) and level != case.sweep.target]
