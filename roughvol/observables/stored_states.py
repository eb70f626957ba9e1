"""Observables of a sweep that has been stored, for a study that records others of the same states; nothing is solved.

Numbers of every step are those stored. An observable stored at the same states is copied. Another is taken from the gap
and pressure fields at its state, to the same last bit. Where neither is stored, the sweep has to be computed.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np

from roughvol.contact.loading import Compliance, Contact
from roughvol.observables import regions, void
from roughvol.observables.levels import on_legs, reached
from roughvol.observables.recorded import AT_STATES, asked, asked_at_states
from roughvol.observables.reduction import OF_STATE, Reduction, Values
from roughvol.observables.regions import Within, window
from roughvol.study import Case, Level, Record
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array, Mask

FIELDS = ("gap", "pressure")


class Unanswerable(Exception):
    """An observable that the stored states cannot answer."""


class Fields:
    """A stored state: its fields on the whole surface."""

    def __init__(self, gap: Array, pressure: Array, *, periodic: bool) -> None:
        self._gap, self._pressure, self.periodic, self.shape = gap, pressure, periodic, gap.shape

    def gap(self) -> Array:
        """Return g/σ."""
        return self._gap.copy()

    def pressure(self) -> Array:
        """Return p L/(E* σ)."""
        return self._pressure.copy()

    def contact(self) -> Mask:
        """Return where p > 0."""
        return np.asarray(self._pressure > 0.0)


class Names(NamedTuple):
    """Stored names by the observable along the steps, and by the dimension of states."""

    along: Mapping[str, Sequence[str]]
    at: Mapping[str, Sequence[str]]


def of_stored(case: Case, surface: Surface, record: Record, stored: Mapping[str, Any], names: Names) -> Values:
    """Return the numbers of a sweep from those stored with another record.

    Parameters
    ----------
    case : Case
        Names what to record; its states are starred numbers.
    surface : Surface
        The whole surface.
    record : Record
        Record of the stored case, with the region of `case`.
    stored : mapping
        Values of the stored case by name, without the dimensions of the case.
    names : Names
        Which of them belong together.

    Returns
    -------
    dict
        Values by stored name, as `Reduction.values` returns them.

    Raises
    ------
    Unanswerable
        If the stored states do not have an observable.
    """
    return _Stored(case, surface, record, stored, names).values()


class _Stored:
    def __init__(self, case: Case, surface: Surface, record: Record, stored: Mapping[str, Any], names: Names) -> None:
        self._case, self._surface, self._record, self._stored = case, surface, record, stored
        self._names = names
        self._seconds = _seconds(stored)
        self._steps = case.sweep.steps

    def values(self) -> Values:
        """Return the values of the new record."""
        case, stored = self._case, self._stored
        nothing: Any = None  # nothing is solved
        reduction = Reduction(case, self._surface, cast("Compliance", nothing))
        state = reduction.state()
        per_step = {name: list(self._of(name)) for name in state["per_step"]}
        along, seconds = dict(state["along"]), {}
        for name in ("central_pressure_ratio", "residual_heights"):
            if name in stored:
                along[name] = stored[name]
        if case.record.residual_heights and "residual_heights" not in stored:
            message = "residual heights"
            raise Unanswerable(message)
        if not case.record.residual_heights:
            along.pop("residual_heights", None)
        if case.record.texture is not None and case.plastic:
            names = [name for name in stored if name.endswith("_residual")]
            if not names:
                message = "texture left by plastic displacement"
                raise Unanswerable(message)
            along |= {name: stored[name] for name in names}
        at_states = {name: on_legs(by_label, case) for name, by_label in asked_at_states(case.record).items()}
        for name, levels in asked(case.record).items():
            if name not in at_states:
                values, seconds[name] = self._along(name, levels)
                along |= values
        kept: dict[str, dict[str, tuple[int, Values]]] = {}
        at_seconds = {}
        for name, by_label in at_states.items():
            kept[name], at_seconds[name] = self._at_states(name, list(by_label))
        reduction.restore(
            {
                "per_step": per_step,
                "kept": kept,
                "seconds": at_seconds,
                "level_convolutions": float(stored.get("level_convolutions", 0.0)),
                "along": along,
                "left": {},
                "along_seconds": seconds,
            },
            [],
        )
        return reduction.values()

    def _of(self, name: str) -> Any:
        if name not in self._stored:
            raise Unanswerable(name)
        return self._stored[name]

    def _along(self, name: str, levels: Mapping[str, Level] | None) -> tuple[Values, float]:
        """Return a quantity along the steps: copied where all its steps are stored, else of fields."""
        before = asked(self._record)
        levels = None if levels is None else on_legs(levels, self._case)
        same_shares = name not in regions.QUANTITIES or self._shares(self._record) == self._shares(self._case.record)
        steps = (
            list(range(1, self._steps + 1)) if levels is None else sorted(set(map(self._first, levels.values())) - {0})
        )
        held: set[int] = set()
        if name in before and same_shares:
            had = before[name]
            every = range(1, self._steps + 1)
            held = set(every) if had is None else set(map(self._first, self._held(had).values()))
        if set(steps) <= held:
            rows = np.array(steps, dtype=int) - 1
            values: Values = {}
            for variable in self._names.along.get(name, ()) if steps else ():
                whole = np.asarray(self._of(variable), dtype=float)
                values[variable] = np.full_like(whole, np.nan)
                values[variable][rows] = whole[rows]
            return values | self._times(steps), self._seconds.get(name, 0.0)
        found: Values = {}
        started = time.perf_counter()
        for step in steps:
            for variable, value in self._quantity(name, self._fields_at_step(step)).items():
                found.setdefault(variable, np.full((self._steps, *np.shape(value)), np.nan))[step - 1] = value
        return found | self._times(steps), time.perf_counter() - started

    def _times(self, steps: list[int]) -> Values:
        """Return the stored seconds of the void along the steps, 0 where there were none."""
        if self._case.record.transport is None or not steps:
            return {}
        times = np.full(self._steps, np.nan)
        times[np.array(steps) - 1] = 0.0
        if "transport_time" in self._stored:
            stored = np.asarray(self._stored["transport_time"], dtype=float)
            times = np.where(np.isfinite(stored), stored, times)
        return {"transport_time": times}

    def _quantity(self, name: str, whole: Fields) -> Values:
        """Return a quantity along the steps of one state."""
        case, shape = self._case, self._surface.shape
        state: Any = whole if case.record.region is None else Within(cast("Contact", whole), window(case, shape))
        rows, columns = window(case, shape)
        if name in void.QUANTITIES:
            values, _ = void.of_state(state, [name], void.over_sigma(case.gas, case.height or self._surface.unit))
            del values["transport_time"]
            for variable in values:
                if variable.startswith("critical_position"):
                    origin = np.array([rows.start, columns.start])
                    values[variable] = (values[variable] + origin) / self._surface.intervals[0]
            return values
        if name not in regions.QUANTITIES:
            raise Unanswerable(name)
        windows = {
            w: regions.window_of(regions.central(w), shape, periodic=case.periodic) for w in self._shares(case.record)
        }
        return regions.of_state(cast("Contact", whole), [name], windows)[0]

    def _shares(self, record: Record) -> tuple[float, ...]:
        return record.region_widths.shares if record.region_widths is not None else ()

    def _first(self, level: Level) -> int:
        """Return the first step that reaches a level, 0 if none does."""
        for step in range(1, self._steps + 1):
            numbers = SimpleNamespace(**{name: float(self._of(name)[step - 1]) for name in OF_STATE})
            before = {name: float(self._of(name)[step - 2]) for name in OF_STATE} if step > 1 else None
            if reached(level, step, cast("Contact", numbers), self._case, before):
                return step
        return 0

    def _held(self, levels: Mapping[str, Level]) -> dict[str, Level]:
        """Return the levels of the stored record, on the legs that it takes."""
        return on_legs(levels, replace(self._case, record=self._record))

    def _fields_at_step(self, step: int) -> Fields:
        """Return the stored fields of a step."""
        for place, label in enumerate(self._labels("field_at")):
            if int(self._of("field_at_step")[place]) == step:
                exact = float(self._of("field_at_indentation")[place]) == float(self._of("indentation")[step - 1])
                if exact:
                    return self._fields(label)
        message = f"fields at step {step}"
        raise Unanswerable(message)

    def _fields(self, label: str) -> Fields:
        """Return the stored fields of a state."""
        place = self._labels("field_at").index(label)
        gap, pressure = (np.asarray(self._of(name)[place], dtype=float) for name in FIELDS)
        rows, columns = self._surface.shape
        return Fields(gap[:rows, :columns], pressure[:rows, :columns], periodic=self._case.periodic)

    def _labels(self, dim: str) -> list[str]:
        return [str(label) for label in self._stored.get(dim, ())]

    def _at_states(self, name: str, labels: list[str]) -> tuple[dict[str, tuple[int, Values]], float]:
        """Return the states of an observable of single states, each with its step and its values."""
        row, kept = AT_STATES[name], dict[str, tuple[int, Values]]()
        same = name in asked_at_states(self._record) and _options(self._record, name) == _options(
            self._case.record, name
        )
        seconds = self._seconds.get(name, 0.0) if same else 0.0
        for label in labels:
            dim = row.dim if same and label in self._labels(row.dim) else "field_at"
            if label not in self._labels(dim) or (row.solves and dim == "field_at"):
                message = f"{name} at {label}"
                raise Unanswerable(message)
            place = self._labels(dim).index(label)
            step = int(self._of(f"{dim}_step")[place])
            if step < 1:
                continue  # not reached
            own = {f"{row.dim}_{number}": float(self._of(f"{dim}_{number}")[place]) for number in OF_STATE}
            if dim == row.dim:
                from_store = {
                    variable: self._stored[variable][place]
                    for variable in self._variables(row.dim)
                    if variable not in own
                }
                kept[label] = step, own | from_store
                continue
            whole, started = self._fields(label), time.perf_counter()
            region = self._case.record.region
            shape = self._surface.shape
            state: Any = whole if region is None else Within(cast("Contact", whole), window(self._case, shape))
            kept[label] = step, own | row.of_state(self._case, self._surface, state)
            seconds += time.perf_counter() - started
        return kept, seconds

    def _variables(self, dim: str) -> list[str]:
        """Return the stored variables along a dimension of states."""
        return [name for name in self._names.at.get(dim, ()) if name not in (dim, f"{dim}_step")]


def _options(record: Record, name: str) -> Any:
    """Return what an observable of single states depends on beside its states."""
    section = getattr(record, AT_STATES[name].key.partition(".")[0])
    return {key: value for key, value in section.model_dump().items() if key != "at"} if name in _WITH_OPTIONS else None


_WITH_OPTIONS = ("volume_density", "box_counting", "fluid_pressure")


def _seconds(stored: Mapping[str, Any]) -> dict[str, float]:
    names = [str(name) for name in stored.get("observable", ())]
    return dict(zip(names, map(float, stored.get("observable_time", ())), strict=False))
