"""The leak that counts: that of the gap as it stands, lifted by the pressure of the fluid where a study asks for it.

A study with ``record.fluid_pressure`` stores two leaks: along the steps the leak of the dry gap, and at its recorded
states the leak of the gap that the fluid lifts. The second is the leak. `counted` gives it the name ``leak_rate_x``
and the first the name ``leak_rate_dry_x``, so that no reader takes the dry leak for the leak. What is not stored under
fluid pressure is missing: a leak between the recorded states, and the leak of a gas.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from xarray import DataArray, Dataset

from roughvol.typing import Array

AXES = ("x", "y")
STATE = "fluid_at"  # dimension of the states under fluid pressure
DRY_FLOWS = ("leak_rate", "transmissivity", "gas_leak_rate", "gas_transmissivity")
DRY = (*DRY_FLOWS, "open", "critical_opening")
"""Numbers along the steps that are those of the dry gap."""
LIFTED = {"leak_rate": "fluid_leak_rate", "flow": "fluid_leak"}
"""Flows under fluid pressure, and their stored names."""
SYMBOLS = {"leak_rate": "Q_{axis}", "flow": "Q_{axis}*", "open": "open along {axis}"}
WITHOUT = ", without fluid pressure"
NEAR = 1e-6  # relative: a step at the load of a recorded state is this state
DRY_NOTE = (
    "record.fluid_pressure lifts the gap: Q is the leak of the lifted gap, known at the loads of fluid_pressure.at. "
    "Columns named dry and all other numbers are those without fluid pressure."
)


def fluid_of(ds: Dataset) -> str:
    """Return pressure drop and viscosity of the leak rates of a run in words; empty without leak rates."""
    names = (f"{name}_{AXES[0]}" for name in ("leak_rate", "leak_rate_dry"))
    found = (ds[name].attrs for name in names if name in ds and "pressure_drop" in ds[name].attrs)
    return next((f"pressure drop {given['pressure_drop']}, viscosity {given['viscosity']}" for given in found), "")


def is_lifted(ds: Dataset) -> bool:
    """Return whether a run has states under fluid pressure, so that the dry leak is not the leak."""
    return STATE in ds.dims or f"leak_rate_dry_{AXES[0]}" in ds or f"transmissivity_dry_{AXES[0]}" in ds


def counted(ds: Dataset) -> Dataset:
    """Return a run whose flows are those that count.

    Parameters
    ----------
    ds : Dataset
        A stored run, or a part of it.

    Returns
    -------
    Dataset
        The run itself without fluid pressure. With it, flows of the dry gap are named ``…_dry_x``; ``leak_rate_x``
        (mm³/s and the like) or ``flow_x`` (T* V*³, without units) have the lifted leak at the steps whose load is
        that of a recorded state, and are missing elsewhere.
    """
    if STATE not in ds.dims:
        return ds
    dry = {}
    for name in (f"{flow}_{axis}" for flow in DRY for axis in AXES):
        if name in ds and "step" in ds[name].dims:
            variable = ds[name]
            words = {"symbol": f"{variable.attrs.get('symbol', name)} dry"}
            if "long_name" in variable.attrs:
                words["long_name"] = f"{variable.attrs['long_name'].removesuffix(WITHOUT)}{WITHOUT}"
            dry[f"{name[:-2]}_dry{name[-2:]}"] = variable.assign_attrs(variable.attrs | words)
    old = [f"{flow}_{axis}" for flow in DRY for axis in AXES]
    ds = ds.drop_vars([name for name in old if name in ds and "step" in ds[name].dims]).assign(dry)
    found = {f"{new}_{axis}": _at_steps(ds, new, axis) for new in _stored(ds) for axis in AXES}
    return ds.assign(found | _open(found))


def recorded(group: Dataset, label: str) -> dict[str, Array]:
    """Return the flows of each surface at a recorded state, by the names of `counted`; empty without one.

    Parameters
    ----------
    group : Dataset
        Surfaces along ``seed``.
    label : str
        Label of the state, as ``pressure=0.5 MPa``.

    Returns
    -------
    dict of array (surfaces,)
        Flows of the states of ``flux_at``, named dry under fluid pressure, and those of the lifted gap; NaN where the
        state was not reached.
    """
    found: dict[str, DataArray] = {}
    if "flux_at" in group.dims and label in group["flux_at"].values.tolist():
        state, dry = group.sel(flux_at=label), "_dry" if is_lifted(group) else ""
        stored = {f"{flow}{dry}_{axis}": f"flux_at_{flow}_{axis}" for flow in DRY_FLOWS for axis in AXES}
        found |= {name: state[own] for name, own in stored.items() if own in state and name in group}
        ways = {name: found[name] for axis in AXES if (name := f"transmissivity{dry}_{axis}") in found}
        opened = {name.replace("transmissivity", "open"): _is_open(flow) for name, flow in ways.items()}
        found |= {name: way for name, way in opened.items() if name in group}
    if STATE in group.dims and label in group[STATE].values.tolist():
        state = group.sel({STATE: label})
        flows = {f"{new}_{axis}": state[f"{LIFTED[new]}_{axis}"] for new in _stored(group) for axis in AXES}
        found |= flows | _open(flows)
    return {name: np.asarray(values, dtype=float) for name, values in found.items()}


def _stored(ds: Dataset) -> list[str]:
    """Return the lifted flow that a run has: with units where they are stored, else T* V*³."""
    return [name for name, stored in LIFTED.items() if f"{stored}_{AXES[0]}" in ds][:1]


def _at_steps(ds: Dataset, name: str, axis: str) -> DataArray:
    """Return a lifted flow at the steps whose load is that of a recorded state, missing at the others."""
    stored = ds[f"{LIFTED[name]}_{axis}"]
    load, loads = ds["mean_pressure"], ds[f"{STATE}_mean_pressure"]
    near = (abs(load - loads) <= NEAR * abs(loads)) & (ds["step"] == ds[f"{STATE}_step"])
    at: Any = near & stored.notnull()
    values = stored.where(at).max(STATE)
    ordered = values.transpose(*load.dims)
    fluid = ds[dry].attrs if (dry := f"{name}_dry_{axis}") in ds else {}
    return ordered.assign_attrs(fluid | stored.attrs | {"symbol": SYMBOLS[name].format(axis=axis)})


def _open(flows: dict[str, DataArray]) -> dict[str, DataArray]:
    """Return where the lifted gap is open, 1 or 0, missing where the flow is."""
    return {
        f"open_{axis}": _is_open(flow).assign_attrs(units="1", symbol=symbol)
        for axis in AXES
        for name, flow in flows.items()
        if name.endswith(axis)
        for symbol in [SYMBOLS["open"].format(axis=axis)]
    }


def _is_open(flow: DataArray) -> DataArray:
    """Return 1 where something flows, 0 where nothing does, missing where the flow is."""
    return (flow > 0.0).astype(float).where(flow.notnull())


def zero_beyond(ds: Dataset) -> tuple[str, ...]:
    """Return the numbers that are 0 beyond the end of a closed sweep, by their names without the axis.

    Under fluid pressure the numbers of the dry gap alone are known there: the fluid may open the way again.
    """
    return tuple(f"{name}_dry" for name in (*DRY_FLOWS, "open")) if is_lifted(ds) else (*DRY_FLOWS, "flow", "open")


def ways(group: Dataset, axis: str) -> str:
    """Return the variable that follows the way along an axis through the dry gap, step by step; empty without one."""
    return next((name for name in (f"open_dry_{axis}", f"open_{axis}") if name in group), "")


def closed(group: Dataset, axis: str) -> Array:
    """Return which surfaces have no way along an axis at their last solved state, so that none is open beyond.

    Parameters
    ----------
    group : Dataset
        Surfaces along ``seed`` and states along ``step`` of one leg.
    axis : {"x", "y"}
        Direction.

    Returns
    -------
    array of bool (surfaces,)
        True where the last state is closed; False where it is open or not known, and where the leg unloads.
    """
    found = np.zeros(group.sizes["seed"], dtype=bool)
    if not (name := ways(group, axis)):
        return found
    states, loads = (group[key].transpose("seed", "step").values for key in (name, "mean_pressure"))
    for k, (state, load) in enumerate(zip(states, loads, strict=True)):
        solved = np.flatnonzero(np.isfinite(load))
        if solved.size:
            found[k] = state[solved[-1]] == 0.0 and load[solved[-1]] >= load[solved[0]]
    return found
