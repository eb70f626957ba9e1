"""Tables of numbers for a screen: all steps of a run, its chief states, and several runs at equal loads."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from xarray import Dataset

from roughvol.analysis import leak
from roughvol.analysis.at import State, at, recorded_labels
from roughvol.analysis.average import average, is_flow
from roughvol.analysis.derived import P, check_pressed, derived, groups
from roughvol.analysis.legs import first_leg, legs_of
from roughvol.analysis.seal import with_leaks
from roughvol.analysis.stored_run import Run, answers
from roughvol.analysis.tables import Table, by_direction
from roughvol.analysis.units import in_units
from roughvol.errors import DatasetError, warn
from roughvol.observables.stiffness import stiffness_exponent, without_every_second
from roughvol.observables.variables import STATES
from roughvol.report.run_facts import closing
from roughvol.report.states import Columns, Row, States, every_step, of_all
from roughvol.store.variants import parts_of
from roughvol.study import Level, Quantity, parse
from roughvol.study.plain_data import finite
from roughvol.study.values.state_kinds import REACHED

if TYPE_CHECKING:
    from pandas import DataFrame

STIFFNESS, NOMINAL = "interfacial_stiffness", "nominal_pressure"
BETWEEN_STEPS = "K is a difference between steps: the table of all steps has its error."
MANY = 14  # states of a sweep to listed loads that are all shown after a run
EQUAL = 5  # loads of a comparison
CASE = ("D", "m", "seed", "case")


class Records(NamedTuple):
    """Numbers as rows under stored names, with units by name, for CSV, JSON and pandas; None for a missing number."""

    names: list[str]
    rows: list[list[Any]]
    units: dict[str, str]

    def frame(self) -> DataFrame:
        """Return the rows as a DataFrame of pandas; its ``attrs["units"]`` has the units."""
        import pandas as pd

        frame = pd.DataFrame(self.rows, columns=self.names)
        frame.attrs["units"] = self.units
        return frame


def _named(
    run: Run, units: dict[str, str] | None = None, *, steps: bool = False, recorded: bool = True
) -> list[tuple[str, Dataset]]:
    """Return the groups of surfaces of a run by name, in common units where these are given.

    With ``steps`` the leak of the seal of the study stands at each step. Without ``recorded`` the states beside the
    steps are left out.
    """
    check_pressed(run.dataset, run.name)
    dims = {*CASE, "step", "axis", *(STATES if recorded else (leak.STATE,))}  # of what a table shows
    ready = derived(run.dataset.drop_dims(set(run.dataset.dims) - dims), run.study)
    named = list(groups(ready if units is None else in_units(ready, units)))
    return [(name, with_leaks(run.study, group, group)) for name, group in named] if steps else named


def _at_levels(table: str, heads: Sequence[str], rows: Sequence[Row]) -> States:
    """Return states at levels, with the number of surfaces where it is not one."""
    if any(row.state.surfaces > 1 or row.state.closed for row in rows):
        heads = (*heads, "surfaces")
        rows = [row._replace(labels=(*row.labels, row.state.count)) for row in rows]
    return States.of(table, heads, rows)


def _of_groups(table: str, found: Sequence[tuple[str, State]], *, grouped: bool) -> States:
    """Return states of the groups of a run, which are named where they are several."""
    rows = [
        Row((name, state.label) if grouped else (state.label,), state, by_direction(state.data), name)
        for name, state in found
    ]
    return _at_levels(table, ("surface", "state") if grouped else ("state",), rows)


def summary(run: Run) -> list[Table]:
    """Return the table after a run: ends of legs and recorded levels, and where the ways through the gap close."""
    named = _named(run)
    states = [(name, state) for name, group in named for state in _chief(run, group)]
    found = _of_groups("short", states, grouped=len(named) > 1)
    notes = list(found.notes())
    if any("=" in row.state.label for row in found.rows):  # else flows are those of the steps
        notes.append(found.rule)
    table = found.table("", *notes)
    return [table, *closing([(name, first_leg(group)) for name, group in named])]


def _chief(run: Run, group: Dataset) -> Iterator[State]:
    """Yield the levels asked for that any surface reaches, then the end of each leg, or all listed loads."""
    for label in recorded_labels(group):
        if "=" in label and not label.startswith("step"):
            with contextlib.suppress(DatasetError):  # the summary of a run names levels that no surface reaches
                yield at(run, group, parse(label))
    legs = legs_of(group)
    sweeps = run.study.sweep.legs if run.study else ()
    solved = group[P].notnull().any("seed").values
    for leg in legs:
        steps = group["step"].values[solved & (group["leg"].values == leg if "leg" in group else True)]
        listed = len(sweeps) >= leg and sweeps[leg - 1].listed is not None
        for step in steps.tolist() if listed and len(steps) <= MANY else steps[-1:].tolist():
            words = f"step {int(step)}" + (f", leg {leg}" if len(legs) > 1 else "")
            yield replace(at(run, group, Level("step", float(step), leg)), label=words)


def shown_at(run: Run, levels: Sequence[Level]) -> tuple[list[Table], list[str]]:
    """Return the states asked for, a table for each combination of lists, and sentences on what does not reach them."""
    named = [(part, _named(part)) for part in run.parts]
    absent = list[str]()
    states = [row for level in levels for row in _reaching(named, level, absent)]
    tables = []
    for part, some in named:
        if own := [(name, state) for of, name, state in states if of is part]:
            found = _of_groups("steps", own, grouped=len(some) > 1)
            notes = (*found.notes(), found.rule, *[BETWEEN_STEPS] * (STIFFNESS in found.columns))
            tables.append(found.table(part.name.removeprefix(run.name).removeprefix(", "), *notes))
    return tables, absent


def shown(run: Run) -> list[Table]:
    """Return the tables of ``roughvol show``: all steps of each group of surfaces."""
    named = _named(run, steps=True, recorded=False)
    tables = []
    for name, group in named:
        found = States.of_steps("steps", group, counted=group.sizes["seed"] > 1)
        exponent = _exponent(group) if STIFFNESS in found.columns else []
        tables.append(found.table(name, *found.notes(), *exponent))
    return tables


def _exponent(group: Dataset) -> list[str]:
    """Return the error of the stiffness by the steps, and how it goes with the pressure."""
    first = first_leg(group)
    pressure, gap, stiffness = (first[name].transpose("seed", "step").values for name in (P, "free_volume", STIFFNESS))
    fewer = without_every_second(np.where(np.isnan(stiffness), math.nan, pressure), gap)
    both = np.isfinite(stiffness) & np.isfinite(fewer) & (stiffness > 0.0)
    exponents = np.array(
        [[stiffness_exponent(p, k) for p, k in zip(pressure, values, strict=True)] for values in (stiffness, fewer)]
    )
    if not both.any() or not np.isfinite(exponents).any(axis=1).all():
        return ["K is a difference between steps; with so few its error is not known."]
    change = 100.0 * float(np.abs(fewer[both] / stiffness[both] - 1.0).max())
    every, half = np.nanmean(exponents, axis=1)
    return [
        f"K goes with p^{every:.2f} over the first leg. It is a difference between steps: with every second step it "
        f"changes by up to {change:.0f} %, and goes with p^{half:.2f}."
    ]


def _reaching(
    named: Sequence[tuple[Run, Sequence[tuple[str, Dataset]]]], level: Level, absent: list[str]
) -> list[tuple[Run, str, State]]:
    """Return a state of every group of the combinations of a run that reaches a level; an error if there is none.

    Sentences on the other groups are added to ``absent``. The only group of a combination has no name.
    """

    def state_of(part: tuple[Run, str, Dataset]) -> State:
        run, name, group = part
        return at(replace(run, name=_full(run, name)), group, level)

    every = [(run, name if len(some) > 1 else "", group) for run, some in named for name, group in some]
    found, errors = answers(every, state_of)
    absent += [f"{error}." for error in errors]
    return [(run, name, state) for (run, name, _), state in found]


def _full(run: Run, group: str) -> str:
    """Return the name of a run with that of a group of its surfaces."""
    return ", ".join(filter(None, (run.name, group)))


def records(run: Run, levels: Sequence[Level] = ()) -> Records:
    """Return the numbers of every surface as plain rows; the lists of a study make columns.

    What does not reach a level is a `RoughvolWarning`.
    """
    common: dict[str, str] = {}
    labels = [part.labels for part in parts_of(run.dataset)]
    units = {name: str(run.dataset[name].attrs.get("units", "1")) for name in labels[0]}
    named = [(part, _named(part, common, steps=True, recorded=bool(levels))) for part in run.parts]
    rows, absent = list[dict[str, Any]](), list[str]()
    states = [row for level in levels for row in _reaching(named, level, absent)]
    for of, name, state in states:
        if beyond := state.surfaces - state.data.sizes["seed"]:
            counts = f"{beyond} of {state.surfaces} surfaces"
            absent.append(f"{_full(of, name)}: {counts} do not reach {state.label}, and have no row.")
    every: list[list[tuple[State, Columns]]]
    for own, (part, some) in zip(labels, named, strict=True):
        if levels:
            every = [[(state, by_direction(state.data))] for of, _, state in states if of is part]
        else:
            every = [list(every_step(group)) for _, group in some]
        names, units_of_part = _columns(some, "state" if levels else "step")
        rows += [own | row for step_by_step in every for row in _of_each_surface(step_by_step, names)]
        units |= units_of_part
    warn(absent)
    return _plain_rows(rows, units)


def _columns(named: Sequence[tuple[str, Dataset]], state: str) -> tuple[list[str], dict[str, str]]:
    """Return the names of the columns of a combination, the word for a state among them, and the units of numbers."""
    first = named[0][1]
    ds = by_direction(first)
    numbers = [name for name, variable in ds.items() if name not in first.coords and _is_of_steps(variable)]
    case = [name for name in CASE if any(name in group.coords for _, group in named)]
    names = [*case, state, *["leg"] * (state == "step" and "leg" in ds), *numbers]
    return names, {name: str(ds[name].attrs.get("units", "1")) for name in names[len(case) + 1 :]}


def _is_of_steps(variable: Any) -> bool:
    """Return whether a variable has one number a step, of each surface or of all."""
    return "step" in variable.dims and set(variable.dims) <= {"seed", "step"} and variable.dtype.kind in "fib"


def _of_each_surface(states: Sequence[tuple[State, Columns]], names: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the numbers of each surface at the states that it reaches or has closed before."""
    surfaces = states[0][0].data.sizes["seed"]
    values = []
    for state, data in states:
        held: dict[str, Any] = {n: data[n].values for n in names if n in data} | {"state": state.label}
        values.append({name: np.broadcast_to(held.get(name, np.array(None)), surfaces).tolist() for name in names})
    for k in range(surfaces):
        for (state, _), columns in zip(states, values, strict=True):
            if not math.isnan(columns[P][k]) or k >= state.reached:
                yield {name: column[k] for name, column in columns.items()}


def _plain_rows(rows: Sequence[dict[str, Any]], units: dict[str, str]) -> Records:
    """Return the names of rows, their values in this order, and units."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    return Records(names, finite([[row.get(name) for name in names] for row in rows]), units)


@dataclass(frozen=True)
class Compared:
    """Numbers of several runs at equal loads, run by run and state by state."""

    states: States = field(repr=False)
    left_out: tuple[str, ...] = ()  # why numbers and surfaces are not compared

    def table(self) -> Table:
        """Return the rows as text."""
        return self.states.table("", *self.states.notes(), *self.left_out, self.states.rule)

    def records(self) -> Records:
        """Return names, rows of numbers, and units by name, for CSV and JSON.

        A flow of several surfaces has its 16 to 84 % range as ``…_low`` and ``…_high``; ``open_…`` is the number of
        surfaces with an open way.
        """
        rows, units = [], dict[str, str]()
        for _, state, data, name in self.states.rows:
            row: dict[str, Any] = {"state": state.label, "run": name, "surfaces": state.surfaces}
            row |= {"reached": state.reached, "closed_before": state.closed}
            for column in self.states.columns:
                values = of_all(data[column].values, state.surfaces) if column in data else np.array([np.nan])
                over = average(column, values)
                numbers: dict[str, Any] = {column: over.value}
                if column.startswith("open_"):
                    numbers[column] = int(np.nansum(values)) if over.count else None
                elif is_flow(column):
                    numbers |= {f"{column}_low": over.low, f"{column}_high": over.high}
                row |= numbers
                if column in data:
                    units |= dict.fromkeys(numbers, str(data[column].attrs.get("units", "1")))
            rows.append(row)
        return _plain_rows(rows, units)


def compared(runs: Sequence[Run], levels: Sequence[Level] = ()) -> Compared:
    """Return numbers of several runs side by side at equal loads."""
    common: dict[str, str] = {}
    every = [[(part, _named(part, common)) for part in run.parts] for run in runs]
    rows, absent = [], list[str]()
    for level in levels or _equal_loads([group for named in every for _, some in named for _, group in some]):
        for named in every:
            for part, group, state in _reaching(named, level, absent):
                name = _full(part, group)
                rows.append(Row((state.label, name), state, by_direction(state.data), name))
    found = _at_levels("short", ("state", "run"), rows)
    notes = dict[str, str]()
    for name in found.columns:
        units = {str(row.data[name].attrs.get("units", "1")) for row in rows if name in row.data}
        if len(units) > 1:
            notes[name] = f"{name} is left out: its units are {' and '.join(sorted(units))}."
    return Compared(
        replace(found, columns=tuple(n for n in found.columns if n not in notes)), (*absent, *notes.values())
    )


def _equal_loads(every: Sequence[Dataset]) -> list[Level]:
    """Return loads that all groups of all runs reach, in equal ratios and rounded to two digits."""
    units = {str(group[NOMINAL].attrs.get("units")) if NOMINAL in group else "" for group in every}
    unit = units.pop() if len(units) == 1 else ""
    name = NOMINAL if unit else P
    spans = []
    for group in every:
        for row in first_leg(group)[name].transpose("seed", "step").values:
            positive = row[np.isfinite(row) & (row > 0.0)]
            if positive.size:
                spans.append((positive.min(), positive.max()))
    if not spans:
        raise DatasetError("no load is common to these runs: none of their steps has a load")
    low, high = max(span[0] for span in spans), min(span[1] for span in spans)
    if low > high * (1.0 + REACHED):
        words = f" {unit}" if unit else ""
        found = f"the largest first step has {name} {low:.4g}{words}, the smallest end {high:.4g}{words}"
        raise DatasetError(f"no load is common to these runs: {found}")
    rounded = dict.fromkeys(float(f"{value:.2g}") for value in np.geomspace(low, high, EQUAL))
    least, most = low / (1.0 + REACHED), high * (1.0 + REACHED)
    inside = [value for value in rounded if least <= value <= most] or [float(f"{0.5 * (low + high):.6g}")]
    return [Level("pressure", Quantity(value, unit) if unit else value) for value in inside]
