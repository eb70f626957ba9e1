"""Numbers of states as tables: a row a state, a column a stored number, the convention over surfaces in the note."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from xarray import Dataset, Variable

from roughvol.analysis import leak
from roughvol.analysis.at import RULE, RULE_OF_FLOWS, State
from roughvol.analysis.average import IN_WORDS, average, is_flow
from roughvol.analysis.derived import ROUNDING, P
from roughvol.analysis.seal import LEAKS, NO_LEAK, UNKNOWN
from roughvol.analysis.tables import Table, by_direction, number
from roughvol.observables.variables import QUANTITIES, columns
from roughvol.typing import Array

IN_PLACE: Mapping[str, Mapping[str, str]] = {
    table: {"nominal_pressure": P, "leak_rate_x": "transmissivity"} for table in ("short", "states")
}
"""By table: a column with a unit that stands in the place of starred columns, which stay in study.nc."""
STARRED = ("separation", "mean_plane_separation", "indentation", P)
ROUGH = 1.1  # factor between the flows of two steps, from which on a reading between them is noted
NO_FLOW = (
    "A flow is missing where a step around a state has none: roughvol show without --at lists the steps with flows."
)
NOT_REACHED = "Not all surfaces reach each state: the column 'surfaces' counts those that do."
SHEETS = "sheets drawn from the surfaces of a row, which have one load there. roughvol card has its interval."
CLOSED_BEFORE = "A surface that closed before a state has flows of 0 there, and no other number."


class Numbers(NamedTuple):
    """The numbers of the surfaces at a state, and what they are: the attributes of a variable."""

    values: Any
    attrs: Mapping[str, Any]


Columns = Mapping[str, Numbers | Variable]


class Row(NamedTuple):
    """A state: the words in front of its numbers, the numbers by direction, and the name of its run or group."""

    labels: tuple[str, ...]
    state: State
    data: Columns
    name: str = ""


@dataclass(frozen=True)
class States:
    """States row by row, and the stored numbers that any of them has."""

    heads: tuple[str, ...]
    rows: tuple[Row, ...]
    columns: tuple[str, ...]

    @classmethod
    def of(cls, table: str, heads: Sequence[str], rows: Sequence[Row]) -> States:
        """Return states with the columns of a table: short, steps or states."""
        every = [row.data for row in rows]
        held = [n for n in columns(table) if any(n in data and not np.isnan(data[n].values).all() for data in every)]
        for dimensional, starred in IN_PLACE.get(table, {}).items():
            if dimensional in held and all(dimensional in data for data in every):
                held = [name for name in held if not name.startswith(starred)]
        return cls(tuple(heads), tuple(rows), tuple(held))

    @classmethod
    def of_steps(cls, table: str, group: Dataset, *, counted: bool = False) -> States:
        """Return the steps of a group of surfaces, each behind its leg and, where they are counted, its surfaces."""
        legs, rows = ["leg"] * ("leg" in group), []
        for state, data in every_step(group, table):
            leg = [str(int(data["leg"].values))] if legs else []
            solved = [str(np.count_nonzero(np.isfinite(data[P].values)))] if counted else []
            rows.append(Row((state.label, *leg, *solved), state, data))
        return cls.of(table, ("step", *legs, *["surfaces"] * counted), rows)

    def table(self, title: str, *notes: str) -> Table:
        """Return the states as text, with the convention over surfaces in front of the notes."""
        most = max((row.state.surfaces for row in self.rows), default=1)
        heads = [
            next(head(name, row.data[name].attrs, most) for row in self.rows if name in row.data)
            for name in self.columns
        ]
        lines = []
        for row in self.rows:
            numbers, surfaces = row.data, row.state.surfaces
            held = (cell(n, numbers[n].values, surfaces) if n in numbers else "" for n in self.columns)
            lines.append((*row.labels, *held))
        note = " ".join(filter(None, [self._convention(), *notes]))
        return Table(title, (*self.heads, *heads), tuple(lines), note)

    def _convention(self) -> str:
        """Return means, medians, counts of surfaces by row, and which leak counts."""
        surfaces = [row.state.surfaces for row in self.rows]
        over = f"{surfaces[0]} surfaces" if len(set(surfaces)) == 1 else "the surfaces of a row"
        several = max(surfaces, default=1) > 1
        lifted = self._by_run(lambda row: leak.DRY_NOTE if leak.is_lifted(row.state.data) else "")
        return sentences(
            {
                f"Mean over {over}{'; open ways are counted' * self._has_ways}.": several,
                f"Flows: {IN_WORDS}.": several and any(map(is_flow, self.columns)),
                **{run + note: True for note, run in lifted.items()},
            }
        )

    def notes(self) -> Iterator[str]:
        """Yield the fluids of the leaks, run by run where they differ, and which surfaces count."""
        yield from self._fluids("leak_rate", leak.fluid_of, "Q is the leak of the patch")
        yield from self._fluids("gas_leak_rate", leak.gas_of, "Q_g is the throughput of the patch")
        yield from (run + seal for seal, run in self._by_run(self._seal).items())
        apart = max((row.state.apart for row in self.rows), default=1.0)
        if apart > ROUGH and any(map(is_flow, self.columns)):
            yield f"Flows of the steps around a state differ by a factor of up to {apart:.2g}: more steps narrow it."
        if any(map(_lacks_flow, self.rows)):
            yield NO_FLOW
        if any(row.state.reached < row.state.surfaces for row in self.rows):
            yield NOT_REACHED
        if any(row.state.closed for row in self.rows):
            yield CLOSED_BEFORE

    @property
    def rule(self) -> str:
        """How numbers between two steps are read."""
        return RULE_OF_FLOWS if self._has_ways else f"{RULE}."

    @property
    def _has_ways(self) -> bool:
        return any(name.startswith("open_") for name in self.columns)

    def _fluids(self, flow: str, words_of: Callable[[Dataset], str], leaks: str) -> Iterator[str]:
        """Yield what a flow is, and its fluid, run by run where fluids differ."""
        if not any(name.startswith(flow) for name in self.columns):
            return
        named = self._by_run(lambda row: words_of(row.state.data))
        if named:
            yield f"{leaks}, {'; '.join(run + fluid for fluid, run in named.items())}."

    def _seal(self, row: Row) -> str:
        """Return what the leak of a seal is, or why it is not known; empty without a seal."""
        reason = str(row.state.data.attrs.get(UNKNOWN, ""))
        for name in LEAKS.values():
            if name in row.data:
                seal, sheets = (row.data[name].attrs[key] for key in ("seal", "sheets"))
                if name in self.columns:
                    leak_of = f"{QUANTITIES[name].symbol} is the leak of the seal of {seal}"
                    return f"{leak_of}: the median of {sheets} {SHEETS}"
                reason = f"The leak of the seal of {seal.partition(', ')[0]} is not known: {NO_LEAK}."
        return reason

    def _by_run(self, words_of: Callable[[Row], str]) -> dict[str, str]:
        """Return the words that rows have, with the names of their runs and groups where rows differ."""
        found: dict[str, dict[str, None]] = {}
        for row in self.rows:
            found.setdefault(words_of(row), {})[row.name] = None
        named = shortest_names(found) if len(found) > 1 else dict.fromkeys(found, "")
        return {words: f"{name}: " * bool(name) for words, name in named.items() if words}


def shortest_names(found: Mapping[str, Iterable[str]]) -> dict[str, str]:
    """Return the names of rows with equal words; a run that has these words alone is named without its parts."""
    words_of: dict[str, set[str]] = {}  # of each beginning of a name: "oil", "oil, E = 4 MPa"
    for words, names in found.items():
        for name in names:
            for beginning in _beginnings(name):
                words_of.setdefault(beginning, set()).add(words)
    shortest = {
        words: dict.fromkeys(
            next((beginning for beginning in _beginnings(name) if len(words_of[beginning]) == 1), name)
            for name in names
        )
        for words, names in found.items()
    }
    return {words: " and ".join(names) for words, names in shortest.items()}


def _beginnings(name: str) -> list[str]:
    """Return a name cut after each of its parts, the shortest first."""
    parts = name.split(", ")
    return [", ".join(parts[: count + 1]) for count in range(len(parts))]


def every_step(group: Dataset, table: str | None = None) -> Iterator[tuple[State, dict[str, Numbers]]]:
    """Yield the states of surfaces along ``seed`` step by step, where any is solved, and their numbers by direction.

    The numbers are those of a table, short, steps or states, or all. The ``data`` of a state are those of all steps.
    """
    shown = {"leg", P, *columns(table)} if table else None
    fixed, along = dict[str, Numbers](), dict[str, Numbers]()  # arrays of all steps: a choice of each step takes longer
    for name, variable in by_direction(group).items():
        if "step" in variable.dims and (shown is None or name in shown):
            along[name] = Numbers(variable.transpose("step", ...).values, variable.attrs)
        elif name in group.coords:
            fixed[name] = Numbers(variable.values, variable.attrs)
    labels = group["step"].values.tolist()
    for k in np.flatnonzero(group[P].notnull().any("seed").values).tolist():
        state = State(str(int(labels[k])), group, group.sizes["seed"])
        yield state, fixed | {name: Numbers(every.values[k], every.attrs) for name, every in along.items()}


def _lacks_flow(row: Row) -> bool:
    """Return whether a flow is not known at a state at a level; `leak.DRY_NOTE` says it under fluid pressure."""
    if "=" not in row.state.label or not row.state.reached or leak.is_lifted(row.state.data):
        return False
    return any(is_flow(name) and bool(np.isnan(flow.values).all()) for name, flow in row.data.items())


def sentences(said: Mapping[str, bool]) -> str:
    """Return the sentences that hold."""
    return " ".join(words for words, holds in said.items() if holds)


def head(name: str, attrs: Mapping[str, Any], surfaces: int = 1) -> str:
    """Return the head of a column: symbol, unit where there is one, and ``median`` for a flow of several surfaces."""
    unit, symbol = str(attrs.get("units", "1")), str(attrs.get("symbol", name))
    median = "median " if surfaces > 1 and is_flow(name) else ""
    return f"{median}{symbol}" if unit == "1" else f"{median}{symbol} [{unit}]"


def of_all(values: Array, surfaces: int) -> Array:
    """Return the numbers of all surfaces, missing for those that are not at a state."""
    every = np.full(surfaces, np.nan)
    every[: values.size] = values
    return every


def cell(name: str, values: Array, surfaces: int) -> str:
    """Return the number of one surface or of several as text; of an open way, how many surfaces have one."""
    values = of_all(values, surfaces)
    found = average(name, np.where(np.abs(values) < ROUNDING, 0.0, values) if name in STARRED else values)
    if found.count == 0:
        return ""
    if name.startswith("open_"):
        open_ = int(np.nansum(values))
        return ("open" if open_ else "closed") if len(values) == 1 else f"{open_} of {found.count}"
    if is_flow(name) and found.count > 1 and np.isfinite(found.value):
        return f"{number(found.value)} ({number(found.low)} to {number(found.high)})"
    return number(found.value)
