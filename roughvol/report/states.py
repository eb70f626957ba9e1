"""The state of stored surfaces at a load, on a step or between two.

Between two steps, a number lies on the straight line over the quantity asked for; a leak rate, a flow or an opening on
that of its logarithm. Whether a way is open, and other counts, are those of the step beyond. A state before the first
step or after the last one is an error. A state that a study records is the one solved for it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from xarray import Dataset

from roughvol.errors import DatasetError
from roughvol.report.claims import Run
from roughvol.report.tables import number
from roughvol.store.variables import OF_STATE, STATES, VARIABLES
from roughvol.study import KINDS, STORED, Quantity, Scale, read
from roughvol.study.scale import ALWAYS
from roughvol.study.yaml_text import number_text

P, V = "mean_pressure", "free_volume"
BY_LOGARITHM = ("leak_rate", "transmissivity", "diffusivity", "critical_opening", "critical_gap")
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
