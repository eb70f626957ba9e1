"""The leak that counts: that of the gap as it stands, lifted by the pressure of the fluid where a study asks for it.

A study with ``record.fluid_pressure`` stores two leaks: along the steps the leak of the dry gap, and at its recorded
states the leak of the gap that the fluid lifts. The second is the leak. `counted` gives it the name ``leak_rate``
and the first the name ``leak_rate_dry``, so that no reader takes the dry leak for the leak. What is not stored under
fluid pressure is missing: a leak between the recorded states, and the leak of a gas.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from xarray import DataArray, Dataset, Variable

from roughvol.errors import DatasetError
from roughvol.observables.variables import AXES, QUANTITIES, VARIABLES
from roughvol.study.values.state_kinds import REACHED
from roughvol.typing import Array

STATE = "fluid_at"  # dimension of the states under fluid pressure
LIFTED = {name: row.lifted_by for name, row in QUANTITIES.items() if row.lifted_by}
"""Flows under fluid pressure, and their stored names."""
DRY = tuple(name.removesuffix("_dry") for name in QUANTITIES if name.endswith("_dry") and name not in VARIABLES)
"""Numbers along the steps that are those of the dry gap."""
FLOWS = tuple(name for name, row in QUANTITIES.items() if row.averaged == "median")
"""Flows, lifted and dry: 0 where a way is closed."""
OF_STATE = tuple(f"{STATE}_{name}" for name in ("step", "mean_pressure", "free_volume"))
OF_LIFTED = ("mean_pressure", *OF_STATE, "fluid_leak", "fluid_leak_dry")
"""Numbers that the leaks of the lifted and of the dry gap take at a recorded state."""
EVIDENCE = ("percolates", "critical_gap", "transmissivity", "diffusivity", "gas_transmissivity")
"""Numbers of the dry gap that are 0 where a way is closed, and only there."""
WITHOUT = ", without fluid pressure"
Flow = TypeVar("Flow", DataArray, Variable)
DRY_NOTE = (
    "record.fluid_pressure lifts the gap: Q is the leak of the lifted gap, known at the loads of fluid_pressure.at. "
    "Columns named dry and all other numbers are those without fluid pressure."
)


def fluid_of(ds: Dataset) -> str:
    """Return pressure drop and viscosity of the leak rates of a run in words; empty without leak rates."""
    found = (ds[name].attrs for name in ("leak_rate", "leak_rate_dry") if name in ds)
    given = next((words for words in found if "pressure_drop" in words), None)
    return f"pressure drop {given['pressure_drop']}, viscosity {given['viscosity']}" if given else ""


def gas_of(ds: Dataset) -> str:
    """Return the gas of the leak rates of a run, its state and the law of its flow in words; empty without a gas."""
    found = (ds[name].attrs for name in ("gas_leak_rate", "gas_leak_rate_dry") if name in ds)
    given = next((words for words in found if "gas" in words), None)
    return f"{given['gas']}, law {given['law']}" if given else ""


def is_lifted(ds: Dataset) -> bool:
    """Return whether a run has states under fluid pressure, so that the dry leak is not the leak."""
    return STATE in ds.dims or is_counted(ds)


def is_counted(ds: Dataset) -> bool:
    """Return whether flows under fluid pressure have the names of `counted`."""
    return "flow" in ds or any(f"{name}_dry" in ds for name in DRY)


def of_lifted_gap(ds: Dataset) -> tuple[str, ...]:
    """Return the numbers of the lifted gap, which are known at recorded states alone; none without fluid pressure."""
    return (*LIFTED, "open") if is_lifted(ds) else ()


def counted(ds: Dataset) -> Dataset:
    """Return a run whose flows are those that count; without fluid pressure, or counted before, the run itself.

    Under fluid pressure flows of the dry gap are named ``…_dry``. ``leak_rate``, or without units ``flow`` (T* V*³),
    has the lifted leak at the steps whose load is that of a recorded state, and is missing elsewhere.
    """
    if STATE not in ds.dims or is_counted(ds):
        return ds
    if _stored(ds) and (lost := [name for name in OF_LIFTED if name not in ds]):
        raise DatasetError(f"the dataset has no {lost[0]}; allowed: all variables of a run under fluid pressure")
    along = [name for name in DRY if name in ds and "step" in ds.variables[name].dims]
    found = {f"{name}_dry": _named_dry(name, ds.variables[name]) for name in along}
    for name in _stored(ds):
        found[name] = _at_steps(ds, name, found.get(f"{name}_dry"))
        found["open"] = is_open(found[name])
    return ds.drop_vars(along).assign(found)


def _named_dry(name: str, variable: Variable) -> Variable:
    """Return a number of the dry gap with words that say so."""
    words = {"symbol": f"{variable.attrs.get('symbol', name)} dry"}
    if "long_name" in variable.attrs:
        words["long_name"] = f"{variable.attrs['long_name'].removesuffix(WITHOUT)}{WITHOUT}"
    return Variable(variable.dims, variable.values, variable.attrs | words)


def recorded(group: Dataset, label: str, steps: Array) -> dict[str, Array]:
    """Return the flows (surfaces, axes) at a recorded state, by the names of `counted`; empty without one.

    Flows of the dry gap are named dry under fluid pressure. A flow is NaN where none of the steps has the state.
    """
    found: dict[str, Variable] = {}
    if "flux_at" in group.dims and "flux_at_step" in group and label in group["flux_at"].values.tolist():
        state, dry = group.sel(flux_at=label).variables, "_dry" if is_lifted(group) else ""
        stored = {f"{flow}{dry}": f"flux_at_{flow}" for flow in DRY}
        there = (step := state["flux_at_step"]).copy(data=np.isin(step, steps))
        found |= {name: state[own].where(there) for name, own in stored.items() if own in state and name in group}
        if f"open{dry}" in group and f"transmissivity{dry}" in found:
            found[f"open{dry}"] = is_open(found[f"transmissivity{dry}"])
    if STATE in group.dims and label in group[STATE].values.tolist():
        state = group.sel({STATE: label}).variables
        there = (step := state[f"{STATE}_step"]).copy(data=np.isin(step, steps))
        for name in _stored(group):
            lifted = {name: state[LIFTED[name]], "open": is_open(state[LIFTED[name]])}
            own = {flow: values.where(there) for flow, values in (_dry(group, state, name) | lifted).items()}
            found = own | found  # flows of ``flux_at`` have the accuracy that the study asks for
    return {name: values.transpose("seed", "axis").values.astype(float) for name, values in found.items()}


def _dry(group: Dataset, state: Mapping[Any, Variable], name: str) -> dict[str, Variable]:
    """Return the flows of the dry gap at a state under fluid pressure, as far as the steps have them."""
    dry, lifted = state["fluid_leak_dry"], state["fluid_leak"]  # T* V*³; no more passes the dry gap
    plates = state[f"{STATE}_free_volume"] ** 3
    flows = {
        name: dry * (state[LIFTED[name]] / lifted).where(lifted > 0.0, dry),
        "transmissivity": (dry / plates).where(plates > 0.0, dry),
        "open": is_open(dry),
    }
    return {f"{flow}_dry": values for flow, values in flows.items() if f"{flow}_dry" in group}


def _stored(ds: Dataset) -> list[str]:
    """Return the lifted flow that a run has: with units where they are stored, else T* V*³."""
    return [name for name, stored in LIFTED.items() if stored in ds][:1]


def _at_steps(ds: Dataset, name: str, dry: Variable | None) -> Variable:
    """Return a lifted flow at the steps whose load is that of a recorded state, missing at the others.

    Older runs may have the recorded state at the next step, where the search for a listed load ended short of it.
    """
    stored, load, loads = (ds.variables[key] for key in (LIFTED[name], "mean_pressure", f"{STATE}_mean_pressure"))
    later = ds.variables[f"{STATE}_step"] - ds.variables["step"]
    near = (abs(load - loads) <= REACHED * abs(loads)) & ((later == 0) | (later == 1))
    values = stored.where(near & stored.notnull()).max(STATE).transpose(*load.dims, "axis", missing_dims="ignore")
    values.attrs = ({} if dry is None else dry.attrs) | stored.attrs | {"symbol": QUANTITIES[name].symbol}
    return values


def is_open(flow: Flow) -> Flow:
    """Return 1 where something flows or a gap is open, 0 where nothing is, missing where the number is."""
    found = flow.copy(data=np.where(np.isnan(flow.values), np.nan, flow.values > 0.0))
    found.attrs = {"units": "1", "symbol": QUANTITIES["open"].symbol}
    return found


def with_closed(flow: DataArray, ds: Dataset) -> DataArray:
    """Return a flow of the dry gap, also 0 where another number of a dataset shows that the way is closed."""
    values = flow.values
    for name in EVIDENCE:
        if name in ds:
            closed = ds.variables[name].transpose(*flow.dims).values == 0.0
            values = np.where(np.isnan(values) & closed, 0.0, values)
    return flow.copy(data=values)


def zero_beyond(ds: Dataset) -> tuple[str, ...]:
    """Return the numbers that are 0 beyond the end of a closed sweep.

    Under fluid pressure the numbers of the dry gap alone are known there: the fluid may open the way again.
    """
    if is_lifted(ds):
        return tuple(name for name in (*FLOWS, "open_dry") if name.endswith("_dry"))
    return (*FLOWS, "open")


def ways(group: Dataset) -> str:
    """Return the variable that follows the ways through the dry gap, step by step; empty without one."""
    name = "open_dry" if is_lifted(group) else "open"
    return name if name in group else ""


def closed(group: Dataset) -> Array:
    """Return which surfaces (surfaces, axes) have no way along an axis at their last solved state: none is open beyond.

    False where the last state is open or not known, and where the leg unloads.
    """
    found = np.zeros((group.sizes["seed"], len(AXES)), dtype=bool)
    if not (name := ways(group)):
        return found
    states = group.variables[name].transpose("seed", "step", "axis").values
    loads = group.variables["mean_pressure"].transpose("seed", "step").values
    for k, (state, load) in enumerate(zip(states, loads, strict=True)):
        solved = np.flatnonzero(np.isfinite(load))
        if solved.size:
            found[k] = (state[solved[-1]] == 0.0) & (load[solved[-1]] >= load[solved[0]])
    return found
