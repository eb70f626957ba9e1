"""The state of stored surfaces at a load, on a step or between two.

Between two steps, a number lies on the straight line over the quantity asked for; a leak rate, a flow or an opening on
that of its logarithm. Whether a way is open, and other counts, are those of the step beyond. A state before the first
step or after the last one is an error. A state that a study records is the one solved for it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from xarray import Dataset

from roughvol.errors import DatasetError
from roughvol.observables.levels import REACHED
from roughvol.report.claims import Run
from roughvol.report.tables import number
from roughvol.store.derived_variables import OF_STATE
from roughvol.store.variables import STATES, VARIABLES
from roughvol.study import KINDS, STORED, Quantity, Scale, convert, read
from roughvol.study.scale import ALWAYS
from roughvol.study.units import EXAMPLES
from roughvol.study.yaml_text import number_text
from roughvol.typing import Array

P, V = "mean_pressure", "free_volume"
BY_LOGARITHM = (
    "leak_rate",
    "gas_leak_rate",
    "gas_transmissivity",
    "transmissivity",
    "diffusivity",
    "critical_opening",
    "critical_gap",
)
MADE = {"nominal_pressure": P, "free_volume_per_area": V, "mean_gap": V}  # in units, of starred numbers
LEAK = "leak_rate"
RULE = "Between steps: straight lines over the quantity asked for, of the logarithm for flows and openings."


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
    if kind.startswith(LEAK) and not state.value > 0.0:
        message = f"{text}: allowed: a leak rate > 0; roughvol show has the load at which each way closes"
        raise DatasetError(message)
    if kind in ALWAYS and not isinstance(state.value, Quantity):
        message = f"{text}: needs its unit, as {kind}={EXAMPLES[KINDS[kind][0]].replace(' ', '')}"
        raise DatasetError(message)
    return state


def scales(run: Run, surfaces: Dataset) -> list[Scale]:
    """Return what turns numbers with units into starred ones, for each surface along ``seed``."""
    ds, material = run.dataset, run.study.material if run.study else None
    L, unit = float(ds["L"]), ds.attrs.get("length_unit")
    modulus, modulus_unit = (material.contact_modulus, material.unit) if material else (math.nan, None)
    sizes = surfaces["Sq"].values.tolist()
    nodes = [surfaces[name].values for name in ("nodes_x", "nodes_y") if name in surfaces]
    periodic = "periodic" in ds.attrs
    if len(nodes) < 2 and "m" in surfaces.coords:
        nodes = [np.full(len(sizes), 2.0 ** float(surfaces["m"]) + (not periodic))] * 2
    areas = [math.nan] * len(sizes)
    if len(nodes) == 2:
        areas = (nodes[0] * nodes[1] * (L / (nodes[0] - (not periodic))) ** 2).tolist()
    return [Scale(modulus, L, Sq, area, modulus_unit, unit) for Sq, area in zip(sizes, areas, strict=True)]


def place_of(values: Array, value: float, *, between: bool = True) -> float | None:
    """Return where on its path a surface reaches a value first, None if no two steps enclose it.

    Parameters
    ----------
    values : array (steps,)
        The quantity at each step; NaN where none was solved.
    value : float
        Its value.
    between : bool
        Whether places between two steps count.

    Returns
    -------
    float or None
        Position on the axis ``step``, from 0; 2.25 lies a quarter of the way from the third to the fourth.
    """
    slack = REACHED * max(abs(value), 1e-12)
    solved = np.flatnonzero(np.isfinite(values)).tolist()
    for k in solved:
        if abs(values[k] - value) <= slack:
            return float(k)
    for before, k in itertools.pairwise(solved) if between else ():
        low, high = float(values[before]), float(values[k])
        if min(low, high) < value < max(low, high):
            return float(before + (value - low) / (high - low) * (k - before))
    return None


def _between(group: Dataset, seeds: list[int], places: list[float]) -> Dataset:
    """Return the numbers of surfaces at places on their paths, without ``step``."""
    rows = np.array(seeds)
    low, high = np.floor(places).astype(int), np.ceil(places).astype(int)
    share = np.array(places) - low
    values: dict[str, Any] = {}
    for name, variable in group.data_vars.items():
        if set(variable.dims) == {"seed"}:
            values[str(name)] = ("seed", variable.values[rows], variable.attrs)
        if set(variable.dims) != {"seed", "step"}:
            continue
        array = variable.transpose("seed", "step").values
        before, after = array[rows, low], array[rows, high]
        row = VARIABLES.get(str(name))
        if (row is None or row.kind == "real") and not str(name).startswith("open_") and array.dtype.kind == "f":
            mixed = before + share * (after - before)
            if str(name).startswith(BY_LOGARITHM):
                positive = (before > 0.0) & (after > 0.0)
                one, other = np.where(positive, before, 1.0), np.where(positive, after, 1.0)
                mixed = np.where(positive, one * (other / one) ** share, after)
            after = np.where(share == 0.0, before, mixed)
        values[str(name)] = ("seed", after, variable.attrs)
    kept = {name: variable for name, variable in group.coords.items() if set(variable.dims) <= {"seed"}}
    coords = {name: variable[rows] if variable.dims else variable for name, variable in kept.items()}
    return Dataset(values, coords={name: (v.dims, v.values) for name, v in coords.items()})


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
    order = ("seed", "step")
    own = _recorded(group, state)
    seeds, places, ranges = list[int](), list[float](), list[float]()
    for k, scale in enumerate(scales(run, group)):
        kind, value = state.kind, float(state.value)
        if kind == "step":
            values = group["step"].values.astype(float)
        elif kind.startswith(LEAK):
            values, value = _leak(run, group, k, state)
            ranges += values[np.isfinite(values)].tolist()
            values, value = np.log(np.where(values > 0.0, values, np.nan)), math.log(value)
        else:
            try:
                kind, value = scale.starred(state.kind, state.value)
            except ValueError as error:
                message = f"{state.kind} {error}"
                raise DatasetError(message) from error
            values = group[STORED[kind]].transpose(*order).values[k]
            ranges += (values[np.isfinite(values)] * (float(state.value) / value if value else 1.0)).tolist()
            if own and math.isfinite(own[STORED[kind]][k]):
                value = own[STORED[kind]][k]
        if (place := place_of(values, value, between=kind != "step")) is not None:
            seeds.append(k)
            places.append(place)
    if not seeds:
        ranges = ranges or group["step"].values.astype(float).tolist()
        unit = f" {state.value.unit}" if isinstance(state.value, Quantity) else ""
        reach = f"{number(min(ranges))} to {number(max(ranges))}{unit}"
        message = f"{run.name} has no state at {state.label}: its steps have {state.kind} {reach}"
        raise DatasetError(message)
    data = _between(group, seeds, places)
    if own:
        beyond = _between(group, seeds, np.ceil(places).tolist())
        for name, of in MADE.items():
            if name in data and of in own:
                ratio = beyond[name].values / beyond[of].values
                own[name] = np.where(np.isfinite(own[of][seeds]), ratio * own[of][seeds], data[name].values)
        for name, numbers in own.items():
            there = numbers if name in MADE else numbers[seeds]
            data[name] = ("seed", np.where(np.isfinite(there), there, data[name].values), data[name].attrs)
    return State(state.label, data, group.sizes["seed"])


def _leak(run: Run, group: Dataset, k: int, state: Wanted) -> tuple[Array, float]:
    """Return the leak rate of a surface at each step, the larger along both axes if none is named, and that asked for.

    Both are in the unit of the state.
    """
    unit = state.value.unit if isinstance(state.value, Quantity) else ""
    names = [f"{LEAK}_{axis}" for axis in state.kind.removeprefix(LEAK).strip("_") or "xy"]
    if absent := [name for name in names if name not in group]:
        message = f"{run.name} has no {absent[0]}: add record.dimensional.leak_rate to its study"
        raise DatasetError(message)
    rows = [group[name].transpose("seed", "step").values[k] for name in names]
    values = np.max(rows, axis=0) * convert(1.0, str(group[names[0]].attrs["units"]), unit)
    return values, float(state.value)


def _recorded(group: Dataset, state: Wanted) -> dict[str, Array]:
    """Return the numbers of a recorded state by surface, NaN where it is not reached; empty without one."""
    stored = STORED.get(KINDS[state.kind][1]) if state.kind in KINDS else None
    if stored is None:
        return {}
    for dim in STATES:
        if dim in group.dims and state.label in group[dim].values.tolist():
            own = group.sel({dim: state.label})
            values = {name: own[f"{dim}_{name}"].values for name in OF_STATE if f"{dim}_{name}" in own}
            if stored in values:
                return {name: np.where(own[f"{dim}_step"].values >= 1, array, np.nan) for name, array in values.items()}
    return {}
