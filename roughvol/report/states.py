"""Numbers of a run on a screen: its steps, the state at a load between two steps, and several runs at equal loads.

Between two steps, a number lies on the straight line over the quantity asked for; a leak rate, a flow or an opening on
that of its logarithm. Whether a way is open, and other counts, are those of the step beyond. A state before the first
step or after the last one is an error. A state that a study records is the one solved for it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from xarray import Dataset

from roughvol.errors import DatasetError
from roughvol.report.claims import Run
from roughvol.report.legs import first_leg
from roughvol.report.run_facts import cell, closing, derived, groups, head
from roughvol.report.tables import Table, number
from roughvol.store.variables import OF_STATE, STATES, VARIABLES
from roughvol.study import KINDS, STORED, Quantity, Scale, read
from roughvol.study.scale import ALWAYS
from roughvol.study.yaml_text import number_text

P, A, V = "mean_pressure", "contact_area_fraction", "free_volume"
SHORT = (  # columns after a run and in a comparison, where they are stored or follow from what is
    "nominal_pressure",
    P,
    A,
    V,
    "mean_gap",
    "plastic_volume",
    "open_x",
    "open_y",
    "critical_opening_x",
    "critical_opening_y",
    "leak_rate_x",
    "leak_rate_y",
)
FULL = (  # columns of all steps
    *SHORT[:5],
    "separation",
    "mean_plane_separation",
    "indentation",
    "load_above_hardness_fraction",
    *SHORT[5:10],
    "transmissivity_x",
    "transmissivity_y",
    *SHORT[10:],
)
BY_LOGARITHM = ("leak_rate", "transmissivity", "diffusivity", "critical_opening", "critical_gap")
MANY = 14  # states of a sweep to listed loads that are all shown after a run
EQUAL = 5  # loads of a comparison
RULE = "Between steps: straight lines over the quantity asked for, of the logarithm for flows and openings."
CASE = ("D", "m", "seed", "case")


@dataclass(frozen=True)
class Wanted:
    """A state asked for: a kind of `study.KINDS` or ``step``, and its value, a `Quantity` where it has a unit."""

    kind: str
    value: float

    @property
    def label(self) -> str:
        """The state in words, as ``pressure=0.5 MPa``."""
        text = str(self.value) if isinstance(self.value, Quantity) else number_text(self.value)
        return f"{self.kind}={text}"


def wanted(text: str) -> Wanted:
    """Return the state that a text names, as ``pressure=0.5MPa``.

    Parameters
    ----------
    text : str
        Kind and value, joined by ``=``.

    Returns
    -------
    Wanted
        The state.

    Raises
    ------
    DatasetError
        If the kind is unknown, or the value is no number with a fitting unit.
    """
    kind, equals, value = (part.strip() for part in text.partition("="))
    if not equals or kind not in (*KINDS, "step"):
        message = (
            f"no state {text!r}; allowed: KIND=VALUE with a KIND of {', '.join((*KINDS, 'step'))}, as pressure=0.5MPa"
        )
        raise DatasetError(message)
    try:
        state = Wanted(kind, read(value, KINDS[kind][0] if kind in KINDS else ""))
    except ValueError as error:
        message = f"{text}: {error}"
        raise DatasetError(message) from error
    if kind in ALWAYS and not isinstance(state.value, Quantity):
        message = f"{text}: needs its unit, as {kind}={'20N' if kind == 'load' else '1um'}"
        raise DatasetError(message)
    return state


def scales(run: Run, surfaces: Dataset) -> list[Scale]:
    """Return what turns numbers with units into starred ones, for each surface along ``seed``."""
    ds, material = run.dataset, run.study.material if run.study else None
    L = float(ds["L"])
    unit = ds.attrs.get("length_unit")
    found = []
    for k in range(surfaces.sizes["seed"]):
        one = surfaces.isel(seed=k)
        nodes = [float(one[name]) for name in ("nodes_x", "nodes_y") if name in one]
        if len(nodes) < 2 and "m" in one:
            nodes = [2.0 ** float(one["m"]) + 1.0] * 2
        area = math.prod(nodes) * (L / (nodes[0] - 1.0)) ** 2 if len(nodes) == 2 else math.nan
        modulus = material.contact_modulus if material else math.nan
        found.append(Scale(modulus, L, float(one["Sq"]), area, material.unit if material else None, unit))
    return found


def at_step(surface: Dataset, place: float) -> Dataset:
    """Return one surface at a step, or between two steps.

    Parameters
    ----------
    surface : Dataset
        Variables along ``step``.
    place : float
        Position on the axis ``step``, from 0; 2.25 lies a quarter of the way from the third to the fourth.

    Returns
    -------
    Dataset
        Numbers of that state, without ``step``.
    """
    beyond = math.ceil(place)
    share = place - math.floor(place)
    after = surface.isel(step=beyond, drop=True)
    if share == 0.0:
        return after
    before = surface.isel(step=beyond - 1, drop=True)
    values = {}
    for name in map(str, after.data_vars):
        row = VARIABLES.get(name)
        along = "step" in surface[name].dims
        if not along or (row is not None and row.kind != "real") or name.startswith("open_"):
            continue
        low, high = before[name], after[name]
        mixed = low + share * (high - low)
        if name.startswith(BY_LOGARITHM):
            positive = (low > 0.0) & (high > 0.0)
            one, other = low.where(positive, 1.0), high.where(positive, 1.0)
            mixed = (one * (other / one) ** share).where(positive, high)
        values[name] = mixed.assign_attrs(surface[name].attrs)
    return after.assign(values)


def place_of(surface: Dataset, kind: str, value: float) -> float | None:
    """Return where on its path one surface reaches a starred value first, None if no two steps enclose it.

    Parameters
    ----------
    surface : Dataset
        One surface along ``step``.
    kind : str
        A starred quantity of `study.STORED`, or ``step``.
    value : float
        Its value.

    Returns
    -------
    float or None
        Position on the axis ``step``, from 0.
    """
    values = surface["step"].values if kind == "step" else surface[STORED[kind]].values
    slack = 1e-6 * max(abs(value), 1e-12)
    solved = [k for k in range(len(values)) if math.isfinite(float(values[k]))]
    for k in solved:
        if abs(values[k] - value) <= slack:
            return float(k)
    for before, k in itertools.pairwise(solved) if kind != "step" else ():
        low, high = float(values[before]), float(values[k])
        if min(low, high) < value < max(low, high):
            return before + (value - low) / (high - low) * (k - before)
    return None


@dataclass(frozen=True)
class State:
    """A state of the surfaces that share a row.

    Attributes
    ----------
    label : str
        The state in words.
    data : Dataset
        Its numbers, the surfaces that reach it along ``seed``.
    surfaces : int
        Number of all surfaces.
    """

    label: str
    data: Dataset
    surfaces: int


def at(run: Run, group: Dataset, state: Wanted) -> State:
    """Return the surfaces of a group at a state.

    Parameters
    ----------
    run : Run
        Their run, which has the units.
    group : Dataset
        Surfaces along ``seed``, of `run_facts.groups`.
    state : Wanted
        The state asked for.

    Returns
    -------
    State
        The surfaces that reach it.

    Raises
    ------
    DatasetError
        If no surface reaches it, or it has a unit and the run has none.
    """
    found: list[Dataset] = []
    number_of = group.sizes["seed"]
    ranges: list[float] = []
    for k, scale in enumerate(scales(run, group)):
        surface = group.isel(seed=k)
        kind, value = state.kind, state.value
        if kind != "step":
            try:
                kind, value = scale.starred(kind, value)
            except ValueError as error:
                message = f"{state.kind} {error}"
                raise DatasetError(message) from error
            stored = surface[STORED[kind]].values
            ratio = float(state.value) / value if value else 1.0
            ranges += (stored[np.isfinite(stored)] * ratio).tolist()
        else:
            ranges += surface["step"].values.astype(float).tolist()
        if (recorded := _recorded(surface, state)) is not None:
            found.append(recorded)
        elif (place := place_of(surface, kind, value)) is not None:
            found.append(at_step(surface, place))
    if not found:
        unit = f" {state.value.unit}" if isinstance(state.value, Quantity) else ""
        reach = f"{number(min(ranges))} to {number(max(ranges))}{unit}" if ranges else "no step at all"
        message = f"{run.name} has no state at {state.label}: its steps have {state.kind} {reach}"
        raise DatasetError(message)
    return State(state.label, _together(found), number_of)


def _together(surfaces: Sequence[Dataset]) -> Dataset:
    """Return states of several surfaces along ``seed``."""
    import xarray as xr

    return xr.concat(list(surfaces), "seed", data_vars="all", coords="minimal", compat="override", join="override")


def _recorded(surface: Dataset, state: Wanted) -> Dataset | None:
    """Return a state that the study records, with its own numbers over those of the steps around; None without it."""
    if isinstance(state.value, Quantity) or state.kind not in STORED:
        return None
    for dim in STATES:
        if dim not in surface.dims or state.label not in surface[dim].values.tolist():
            continue
        own = surface.sel({dim: state.label})
        values = {name: own[f"{dim}_{name}"] for name in OF_STATE if f"{dim}_{name}" in own}
        stored = values.get(STORED[state.kind])
        if int(own[f"{dim}_step"]) < 1 or stored is None or not math.isfinite(float(stored)):
            continue
        place = place_of(surface, state.kind, float(stored))
        base = at_step(surface, math.ceil(place)) if place is not None else None
        if base is None or place is None:
            return None
        near = at_step(surface, place)
        made = (("nominal_pressure", P), ("free_volume_per_area", V), ("mean_gap", V))
        scaled = {
            name: (base[name] / base[of] * values[of]).assign_attrs(surface[name].attrs)
            for name, of in made
            if name in base and of in values
        }
        return near.assign({name: value.assign_attrs(surface[name].attrs) for name, value in values.items()} | scaled)
    return None


def _named(run: Run) -> list[tuple[str, Dataset]]:
    ds = run.dataset
    if "step" not in ds.sizes or P not in ds:
        message = f"{run.name} has no state: nothing was pressed"
        raise DatasetError(message)
    return list(groups(derived(ds, run.study)))


def _columns(names: Sequence[str], data: Sequence[Dataset]) -> list[str]:
    """Return the columns that any of the datasets has; a pressure with a unit replaces p*."""
    held = [name for name in names if any(name in ds and bool(ds[name].notnull().any()) for ds in data)]
    if names is SHORT and all("nominal_pressure" in ds for ds in data):
        held.remove(P)
    return held


def _row(columns: Sequence[str], data: Dataset) -> list[str]:
    return [cell(name, np.atleast_1d(data[name].values)) if name in data else "" for name in columns]


def _heads(columns: Sequence[str], data: Sequence[Dataset]) -> list[str]:
    return [head(next(ds[name] for ds in data if name in ds)) for name in columns]


def _note(states: Sequence[State], *more: str) -> str:
    most = max((state.data.sizes["seed"] for state in states), default=1)
    less = any(state.data.sizes["seed"] < state.surfaces for state in states)
    notes = ["Mean over surfaces; open ways are counted." if most > 1 else ""]
    notes += ["Not all surfaces reach each state: the column 'surfaces' counts those that do." if less else ""]
    return " ".join(filter(None, [*notes, *more]))


def _table(title: str, rows: Sequence[tuple[str, State]], columns: Sequence[str], *notes: str) -> Table:
    """Return states as rows: group, state, number of surfaces where they differ, numbers."""
    datasets = [state.data for _, state in rows]
    grouped = len({name for name, _ in rows}) > 1
    counted = any(state.surfaces > 1 for _, state in rows)
    first = [*(["surface"] if grouped else []), "state", *(["surfaces"] if counted else [])]
    lines = []
    for name, state in rows:
        line = [name] if grouped else []
        line.append(state.label)
        if counted:
            reached = state.data.sizes["seed"]
            line.append(str(reached) if reached == state.surfaces else f"{reached} of {state.surfaces}")
        lines.append((*line, *_row(columns, state.data)))
    note = _note([state for _, state in rows], *notes)
    return Table(title, (*first, *_heads(columns, datasets)), tuple(lines), note)


def summary(run: Run) -> list[Table]:
    """Return the table after a run: ends of legs and recorded levels, and where the ways through the gap close.

    Parameters
    ----------
    run : Run
        A stored run with states.

    Returns
    -------
    list of Table
        The states; then the closing loads, where the study follows the ways through the gap.
    """
    named = _named(run)
    rows = [(name, state) for name, group in named for state in _chief(run, group)]
    columns = _columns(SHORT, [state.data for _, state in rows])
    tables = [_table("", rows, columns)]
    return [*tables, *closing([(name, first_leg(group)) for name, group in named])]


def _chief(run: Run, group: Dataset) -> Iterator[State]:
    """Yield the levels asked for that any surface reaches, then the end of each leg, or all listed loads."""
    surfaces = group.sizes["seed"]
    labels = [str(label) for dim in STATES if dim in group.dims for label in group[dim].values.tolist()]
    for label in dict.fromkeys(labels):
        if "=" not in label or label.startswith("step"):
            continue
        try:
            yield at(run, group, wanted(label))
        except DatasetError:
            continue  # `cli_text.summary` names levels that no surface reaches
    legs = group["leg"].values if "leg" in group else np.ones(group.sizes["step"])
    sweeps = run.study.sweep.legs if run.study else ()
    for number_of_leg in dict.fromkeys(legs.tolist()):
        steps = np.flatnonzero(legs == number_of_leg)
        sweep = sweeps[int(number_of_leg) - 1] if len(sweeps) >= number_of_leg else None
        listed = sweep is not None and getattr(sweep, "listed", None) is not None
        shown = steps if listed and len(steps) <= MANY else steps[-1:]
        for k in shown.tolist():
            several = len(set(legs.tolist())) > 1
            label = f"step {int(group['step'].values[k])}" + (f", leg {int(number_of_leg)}" if several else "")
            held = np.flatnonzero(group[P].isel(step=k).notnull().values)
            if held.size:
                data = group.isel(step=k, seed=held)
                yield State(label, data.drop_vars("step"), surfaces)


def shown(run: Run, states: Sequence[Wanted] = ()) -> list[Table]:
    """Return the tables of ``roughvol show``: all steps of each group of surfaces, or the states asked for.

    Parameters
    ----------
    run : Run
        A stored run.
    states : sequence of Wanted
        States asked for. Default: every step.

    Returns
    -------
    list of Table
        One table of states asked for, or one for each D and m or file.

    Raises
    ------
    DatasetError
        If no surface of any group reaches a state.
    """
    named = _named(run)
    if states:
        found = [row for state in states for row in _reaching(run, named, state)]
        return [_table("", found, _columns(FULL, [state.data for _, state in found]), RULE)]
    tables = []
    for name, group in named:
        columns = _columns(FULL, [group])
        rows: list[tuple[str, ...]] = []
        for k in np.flatnonzero(group[P].notnull().any("seed").values).tolist():
            data = group.isel(step=k)
            label = str(int(group["step"].values[k]))
            line = (label, *([str(int(group["leg"].values[k]))] if "leg" in group else []))
            rows.append((*line, *_row(columns, data)))
        heads = ("step", *(["leg"] if "leg" in group else []), *_heads(columns, [group]))
        count = group.sizes["seed"]
        note = f"Mean over {count} surfaces; open ways are counted." if count > 1 else ""
        tables.append(Table(name, heads, tuple(rows), note))
    return tables


def _reaching(run: Run, named: Sequence[tuple[str, Dataset]], state: Wanted) -> list[tuple[str, State]]:
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


def records(run: Run, states: Sequence[Wanted] = ()) -> tuple[list[str], list[list[Any]], dict[str, str]]:
    """Return the numbers of every surface as plain rows, for CSV and JSON.

    Parameters
    ----------
    run : Run
        A stored run.
    states : sequence of Wanted
        States asked for. Default: every step.

    Returns
    -------
    (list of str, list of list, dict)
        Names of the columns, rows of values (None: missing), and units by name.
    """
    named = _named(run)
    case = [name for name in CASE if any(name in group.coords for _, group in named)]
    ds = named[0][1]
    numbers = [
        str(name)
        for name, variable in ds.data_vars.items()
        if set(variable.dims) <= {"seed", "step"}
        and "step" in variable.dims
        and variable.dtype.kind in "fib"
        and str(name) != "leg"
    ]
    rows: list[list[Any]] = []

    def add(surface: Dataset, label: Any) -> None:
        labels = [surface[name].item() if name in surface.coords else None for name in case]
        rows.append([*labels, label, *(_plain(surface[name].item()) if name in surface else None for name in numbers)])

    legs = "leg" in ds
    if states:
        for state in states:
            for _, found in _reaching(run, named, state):
                for k in range(found.data.sizes["seed"]):
                    add(found.data.isel(seed=k), found.label)
    else:
        numbers = ["leg", *numbers] if legs else numbers
        for _, group in named:
            for k in range(group.sizes["seed"]):
                surface = group.isel(seed=k)
                for step in np.flatnonzero(surface[P].notnull().values).tolist():
                    add(surface.isel(step=step), int(surface["step"].values[step]))
    names = [*case, "state" if states else "step", *numbers]
    units = {name: str(ds[name].attrs.get("units", "1")) for name in numbers if name in ds}
    return names, rows, units


def _plain(value: Any) -> Any:
    """Return a stored value for JSON: None for a missing one."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def compared(runs: Sequence[Run], states: Sequence[Wanted] = ()) -> Table:
    """Return numbers of several runs side by side at equal loads.

    Parameters
    ----------
    runs : sequence of Run
        Two or more stored runs.
    states : sequence of Wanted
        States to compare at. Default: `EQUAL` nominal pressures that all runs reach, or p* where one has no unit.

    Returns
    -------
    Table
        A row for each state, run and group of surfaces.

    Raises
    ------
    DatasetError
        If no load is common to all runs, or a state asked for is not reached in one of them.
    """
    named = [(run, _named(run)) for run in runs]
    rows = []
    for state in states or _equal_loads(named):
        for run, some in named:
            for name, found in _reaching(run, some, state):
                rows.append((f"{run.name}, {name}" if len(some) > 1 else run.name, found))
    datasets = [found.data for _, found in rows]
    columns = _columns(SHORT, datasets)
    for name in columns:
        units = {str(ds[name].attrs.get("units", "1")) for ds in datasets if name in ds}
        if len(units) > 1:
            message = f"the runs have {name} in different units: {', '.join(sorted(units))}"
            raise DatasetError(message)
    lines = [(found.label, name, *_row(columns, found.data)) for name, found in rows]
    note = _note([found for _, found in rows], RULE)
    return Table("", ("state", "run", *_heads(columns, datasets)), tuple(lines), note)


def _equal_loads(named: Sequence[tuple[Run, list[tuple[str, Dataset]]]]) -> list[Wanted]:
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
        message = (
            f"no load is common to these runs: the largest first step has {name} {low:.4g}, the smallest end {high:.4g}"
        )
        raise DatasetError(message)
    rounded = dict.fromkeys(float(f"{value:.2g}") for value in np.geomspace(low, high, EQUAL))
    inside = [value for value in rounded if low <= value <= high] or [0.5 * (low + high)]
    unit = units.pop() if name != P else ""
    return [Wanted("pressure", Quantity(value, unit) if unit else value) for value in inside]
