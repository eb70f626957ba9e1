"""Tables of numbers for a screen: all steps of a run, its chief states, and several runs at equal loads."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from xarray import DataArray, Dataset

from roughvol.analysis import leak
from roughvol.analysis.at import RULE, State, at, legs_of
from roughvol.analysis.average import average, is_flow
from roughvol.analysis.derived import check_pressed, derived, groups
from roughvol.analysis.legs import first_leg
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import Table, spread
from roughvol.analysis.units import in_units
from roughvol.errors import DatasetError
from roughvol.observables.conductance import stiffness_exponent
from roughvol.observables.stiffness import without_every_second
from roughvol.observables.variables import STATES, columns
from roughvol.report.run_facts import cell, closing, conventions, head
from roughvol.store.variants import parts_of
from roughvol.study import Level, Quantity, parse

STIFFNESS = "interfacial_stiffness"
P, A, V = "mean_pressure", "contact_area_fraction", "free_volume"
MANY = 14  # states of a sweep to listed loads that are all shown after a run
EQUAL = 5  # loads of a comparison
CASE = ("D", "m", "seed", "case")


def _named(run: Run, units: dict[str, str] | None = None) -> list[tuple[str, Dataset]]:
    """Return the groups of surfaces of a run by name, in common units where these are given."""
    ds = run.dataset
    check_pressed(ds, run.name)
    ready = derived(ds, run.study)
    return list(groups(ready if units is None else in_units(ready, units)))


def _columns(table: str, data: Sequence[Dataset]) -> list[str]:
    """Return the columns that any of the datasets has; in a short table a pressure with a unit replaces p*."""
    held = [name for name in columns(table) if any(name in ds and bool(ds[name].notnull().any()) for ds in data)]
    if table == "short" and all("nominal_pressure" in ds for ds in data) and P in held:
        held.remove(P)
    return held


def _row(columns: Sequence[str], data: Dataset) -> list[str]:
    return [cell(name, np.atleast_1d(data[name].values)) if name in data else "" for name in columns]


def _heads(columns: Sequence[str], data: Sequence[Dataset], surfaces: int) -> list[str]:
    return [head(next(ds[name] for ds in data if name in ds), surfaces) for name in columns]


def _most(states: Sequence[State]) -> int:
    """Return the largest number of surfaces of a row."""
    return max((state.surfaces for state in states), default=1)


def _fluids(rows: Sequence[tuple[str, Dataset]], columns: Sequence[str]) -> list[str]:
    """Return whose leak a table has, with pressure drop and viscosity, by name where they differ."""
    if not any(name.startswith("leak_rate") for name in columns):
        return []
    found: dict[str, dict[str, None]] = {}
    for name, data in rows:
        found.setdefault(leak.fluid_of(data), {})[name] = None
    each = [", ".join(names) + f": {fluid}" if len(found) > 1 else fluid for fluid, names in found.items() if fluid]
    return [f"Q is the leak of the patch, {'; '.join(each)}."] if each else []


def _note(rows: Sequence[tuple[str, State]], columns: Sequence[str], *more: str) -> str:
    states = [state for _, state in rows]
    counts, dry = [state.surfaces for state in states], any(leak.is_lifted(state.data) for state in states)
    notes = [conventions(columns, *counts, dry=dry)]
    notes += _fluids([(name, state.data) for name, state in rows], columns)
    if any(state.reached < state.surfaces for state in states):
        notes.append("Not all surfaces reach each state: the column 'surfaces' counts those that do.")
    if any(state.closed for state in states):
        notes.append("A surface that closed before a state has flows of 0 there, and no other number.")
    return " ".join(filter(None, [*notes, *more]))


def _table(title: str, rows: Sequence[tuple[str, State]], columns: Sequence[str], *notes: str) -> Table:
    """Return states as rows: group, state, number of surfaces where they differ, numbers."""
    datasets, states = [spread(state.data) for _, state in rows], [state for _, state in rows]
    grouped = len({name for name, _ in rows}) > 1
    counted = _most(states) > 1 or any(state.closed for state in states)
    first = [*(["surface"] if grouped else []), "state", *(["surfaces"] if counted else [])]
    lines = []
    for (name, state), data in zip(rows, datasets, strict=True):
        line = [*([name] if grouped else []), state.label, *([state.count] if counted else [])]
        lines.append((*line, *_row(columns, data)))
    heads = (*first, *_heads(columns, datasets, _most(states)))
    return Table(title, heads, tuple(lines), _note(rows, columns, *notes))


def summary(run: Run) -> list[Table]:
    """Return the table after a run: ends of legs and recorded levels, and where the ways through the gap close."""
    named = _named(run)
    rows = [(name, state) for name, group in named for state in _chief(run, group)]
    columns = _columns("short", [spread(state.data) for _, state in rows])
    tables = [_table("", rows, columns)]
    return [*tables, *closing([(name, first_leg(group)) for name, group in named])]


def _chief(run: Run, group: Dataset) -> Iterator[State]:
    """Yield the levels asked for that any surface reaches, then the end of each leg, or all listed loads."""
    labels = [str(label) for dim in STATES if dim in group.dims for label in group[dim].values.tolist()]
    for label in dict.fromkeys(labels):
        if "=" not in label or label.startswith("step"):
            continue
        try:
            yield at(run, group, parse(label))
        except DatasetError:
            continue  # the summary of a run names levels that no surface reaches
    legs = legs_of(group)
    sweeps = run.study.sweep.legs if run.study else ()
    solved = group[P].notnull().any("seed").values
    for leg in legs:
        steps = group["step"].values[solved & (group["leg"].values == leg if "leg" in group else True)]
        sweep = sweeps[leg - 1] if len(sweeps) >= leg else None
        listed = sweep is not None and getattr(sweep, "listed", None) is not None
        for step in steps.tolist() if listed and len(steps) <= MANY else steps[-1:].tolist():
            words = f"step {int(step)}" + (f", leg {leg}" if len(legs) > 1 else "")
            yield replace(at(run, group, Level("step", float(step), leg)), label=words)


def shown(run: Run, states: Sequence[Level] = ()) -> list[Table]:
    """Return the tables of ``roughvol show``: all steps of each group of surfaces, or the states asked for."""
    named = _named(run)
    if states:
        found = [row for state in states for row in _reaching(run, named, state)]
        shown_columns = _columns("steps", [spread(state.data) for _, state in found])
        notes = ["K is a difference between steps: the table of all steps has its error."] * (
            STIFFNESS in shown_columns
        )
        return [_table("", found, shown_columns, RULE, *notes)]
    tables = []
    for name, group in named:
        along = spread(group)
        columns, count = _columns("steps", [along]), group.sizes["seed"]
        rows: list[tuple[str, ...]] = []
        for k in np.flatnonzero(group[P].notnull().any("seed").values).tolist():
            data = along.isel(step=k)
            label = str(int(group["step"].values[k]))
            line = (label, *([str(int(group["leg"].values[k]))] if "leg" in group else []))
            held = [str(int(data[P].notnull().sum()))] if count > 1 else []
            rows.append((*line, *held, *_row(columns, data)))
        heads = ["step", *(["leg"] if "leg" in group else []), *(["surfaces"] if count > 1 else [])]
        words = [conventions(columns, count, dry=leak.is_lifted(group)), *_fluids([("", group)], columns)]
        note = " ".join(filter(None, [*words, *_exponent(group)]))
        tables.append(Table(name, (*heads, *_heads(columns, [along], count)), tuple(rows), note))
    return tables


def _exponent(group: Dataset) -> list[str]:
    """Return the error of the stiffness by the steps, and how it goes with the pressure; empty with too few states."""
    if STIFFNESS not in group:
        return []
    first = first_leg(group)
    pressure, gap, stiffness = (first[name].transpose("seed", "step").values for name in (P, V, STIFFNESS))
    fewer = without_every_second(pressure, gap)
    both = np.isfinite(stiffness) & np.isfinite(fewer) & (stiffness > 0.0)
    exponents = np.array(
        [[stiffness_exponent(p, k) for p, k in zip(pressure, values, strict=True)] for values in (stiffness, fewer)]
    )
    if not both.any() or not np.isfinite(exponents).any(axis=1).all():
        return ["K is a difference between steps; with so few its error is not known."]
    change = 100.0 * float(np.abs(fewer[both] / stiffness[both] - 1.0).max())
    every, half = np.nanmean(exponents, axis=1)
    return [
        f"K is a difference between steps: with every second step it changes by up to {change:.0f} %, and goes with "
        f"p^{half:.2f} in place of p^{every:.2f} over the first leg."
    ]


def _reaching(run: Run, named: Sequence[tuple[str, Dataset]], state: Level) -> list[tuple[str, State]]:
    """Return a state of every group with a surface that reaches it; raise `DatasetError` if there is none."""
    found, errors = [], []
    for name, group in named:
        try:
            found.append((name, at(run, group, state)))
        except DatasetError as error:
            errors.append(error)
    if not found:
        raise errors[0]
    return found


def records(run: Run, states: Sequence[Level] = ()) -> tuple[list[str], list[list[Any]], dict[str, str]]:
    """Return the numbers of every surface as plain rows, for CSV and JSON; the lists of a study make columns."""
    parts = parts_of(run.dataset)
    if not parts[0].words:
        return _records(run, states)
    units: dict[str, str] = {}
    tables = [(part, _records(Run.of(run.name, part.dataset), states, units)) for part in parts]
    columns = list(dict.fromkeys(name for _, (names, _, _) in tables for name in names))
    lines = [
        [
            *(_plain(label) for label in part.labels.values()),
            *(dict(zip(names, row, strict=True)).get(n) for n in columns),
        ]
        for part, (names, rows, _) in tables
        for row in rows
    ]
    held = {name: unit for _, (_, _, own) in tables for name, unit in own.items()}
    axes = {name: str(run.dataset[name].attrs.get("units", "1")) for name in parts[0].labels}
    return [*axes, *columns], lines, axes | held


def _records(
    run: Run, states: Sequence[Level], common: dict[str, str] | None = None
) -> tuple[list[str], list[list[Any]], dict[str, str]]:
    """Return the rows of one combination, in common units where these are given."""
    named = _named(run, common)
    case = [name for name in CASE if any(name in group.coords for _, group in named)]
    ds = spread(named[0][1])
    numbers = [
        str(name)
        for name, variable in ds.data_vars.items()
        if set(variable.dims) <= {"seed", "step"}
        and "step" in variable.dims
        and variable.dtype.kind in "fib"
        and str(name) != "leg"
    ]
    rows: list[list[Any]] = []
    if "leg" in ds and not states:
        numbers = ["leg", *numbers]

    def add(data: Dataset, steps: Sequence[tuple[int, Any]], reached: int | None = None) -> None:
        """Add a row for each surface and solved step, given as place and label; then those closed before a state."""
        count = data.sizes["seed"]
        labels = [
            np.broadcast_to(data[name].values, count).tolist() if name in data.coords else [None] * count
            for name in case
        ]
        arrays = {}
        for name in numbers:
            whole = data[name].broadcast_like(data[P]).transpose("seed", "step").values if name in data else None
            arrays[name] = whole.tolist() if whole is not None else None
        solved = data[P].transpose("seed", "step").notnull().values
        for k in range(count):
            own = [values[k] for values in labels]
            for place, label in steps:
                if solved[k, place] or (reached is not None and k >= reached):
                    columns = (arrays[name] for name in numbers)
                    rows.append([*own, label, *(None if one is None else _plain(one[k][place]) for one in columns)])

    for state in states:
        for _, found in _reaching(run, named, state):
            add(spread(found.data).expand_dims("step", axis=1), [(0, found.label)], found.reached)
    for _, group in () if states else named:
        add(spread(group), list(enumerate(group["step"].values.tolist())))
    names = [*case, "state" if states else "step", *numbers]
    units = {name: str(ds[name].attrs.get("units", "1")) for name in numbers if name in ds}
    return names, rows, units


def _plain(value: Any) -> Any:
    """Return a stored value for JSON: None for a missing one."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


@dataclass(frozen=True)
class Compared:
    """Numbers of several runs at equal loads: runs and states row by row, and the columns that they have."""

    rows: tuple[tuple[str, State], ...]
    columns: tuple[str, ...]

    def table(self) -> Table:
        """Return the rows as text."""
        states = [state for _, state in self.rows]
        datasets = [spread(state.data) for state in states]
        counted = _most(states) > 1 or any(state.closed for state in states)
        lines = [
            (state.label, name, *([state.count] if counted else []), *_row(self.columns, data))
            for (name, state), data in zip(self.rows, datasets, strict=True)
        ]
        heads = ("state", "run", *(["surfaces"] if counted else []), *_heads(self.columns, datasets, _most(states)))
        return Table("", heads, tuple(lines), _note(self.rows, self.columns, RULE))

    def records(self) -> tuple[list[str], list[list[Any]], dict[str, str]]:
        """Return names, rows of numbers, and units by name, for CSV and JSON.

        A flow of several surfaces has its 16 to 84 % range as ``…_low`` and ``…_high``; ``open_…`` is the number of
        surfaces with an open way.
        """
        names = ["state", "run", "surfaces", "reached", "closed_before"]
        for column in self.columns:
            names += [column, *([f"{column}_low", f"{column}_high"] if is_flow(column) else [])]
        rows, held = [], dict[str, DataArray]()
        for name, state in self.rows:
            data = spread(state.data)
            held |= {column: data[column] for column in self.columns if column in data}
            row: list[Any] = [state.label, name, state.surfaces, state.reached, state.closed]
            for column in self.columns:
                values = data[column].values if column in data else np.array([np.nan])
                found = average(column, values)
                if column.startswith("open_"):
                    row.append(int(np.nansum(values)) if found.count else None)
                    continue
                row += [_plain(found.value), *([_plain(found.low), _plain(found.high)] if is_flow(column) else [])]
            rows.append(row)
        return names, rows, {name: str(variable.attrs.get("units", "1")) for name, variable in held.items()}


def compared(runs: Sequence[Run], states: Sequence[Level] = ()) -> Compared:
    """Return numbers of several runs side by side at equal loads."""
    common: dict[str, str] = {}
    named = [(run, _named(run, common)) for run in runs]
    rows = []
    for state in states or _equal_loads(named):
        for run, some in named:
            for name, found in _reaching(run, some, state):
                rows.append((f"{run.name}, {name}" if len(some) > 1 else run.name, found))
    datasets = [spread(found.data) for _, found in rows]
    columns = _columns("short", datasets)
    for name in columns:
        units = {str(ds[name].attrs.get("units", "1")) for ds in datasets if name in ds}
        if len(units) > 1:
            raise DatasetError(f"the runs have {name} in different units: {', '.join(sorted(units))}")
    return Compared(tuple(rows), tuple(columns))


def _equal_loads(named: Sequence[tuple[Run, list[tuple[str, Dataset]]]]) -> list[Level]:
    """Return loads that all groups of all runs reach, in equal ratios and rounded to two digits."""
    every = [group for _, some in named for _, group in some]
    units = {
        str(group["nominal_pressure"].attrs.get("units")) if "nominal_pressure" in group else "" for group in every
    }
    name = "nominal_pressure" if len(units) == 1 and units != {""} else P
    spans = []
    for group in every:
        values = first_leg(group)[name].transpose("seed", "step").values
        for row in values:
            positive = row[np.isfinite(row) & (row > 0.0)]
            if positive.size:
                spans.append((positive.min(), positive.max()))
    low, high = max(span[0] for span in spans), min(span[1] for span in spans)
    if not low < high:
        unit = "" if name == P else f" {next(iter(units))}"
        found = f"the largest first step has {name} {low:.4g}{unit}, the smallest end {high:.4g}{unit}"
        raise DatasetError(f"no load is common to these runs: {found}")
    rounded = dict.fromkeys(float(f"{value:.2g}") for value in np.geomspace(low, high, EQUAL))
    inside = [value for value in rounded if low <= value <= high] or [0.5 * (low + high)]
    unit = units.pop() if name != P else ""
    return [Level("pressure", Quantity(value, unit) if unit else value) for value in inside]
