"""Legs of a path in a dataset."""

from __future__ import annotations

import numpy as np
from xarray import Dataset

from roughvol.observables.variables import STATES
from roughvol.typing import Index


def legs_of(ds: Dataset) -> list[int]:
    """Return the legs of a path with a solved state; ``[1]`` without legs."""
    return [int(leg) for leg in dict.fromkeys(ds["leg"].values.tolist())] if "leg" in ds else [1]


def steps_of(ds: Dataset, leg: int) -> Index:
    """Return the places of the steps of a leg on the axis ``step``; all without legs."""
    return np.flatnonzero(ds["leg"].values == leg) if "leg" in ds else np.arange(ds.sizes["step"])


def first_leg(ds: Dataset) -> Dataset:
    """Return the steps of the first leg and the states recorded there, where a dataset has a path of several."""
    if "leg" not in ds:
        return ds
    first = ds.isel(step=ds["leg"].values == 1)
    last = int(first["step"].values.max(initial=0))
    for dim in (dim for dim in STATES if f"{dim}_step" in first):
        first = _states_until(last, first, dim)
    return first


def along(ds: Dataset, leg: int) -> Dataset:
    """Return the steps of a leg, from the state in which it begins; all steps of a dataset without legs."""
    steps = steps_of(ds, leg)
    return ds.isel(step=slice(max(int(steps[0]) - 1, 0), int(steps[-1]) + 1))


def _states_until(last: int, ds: Dataset, dim: str) -> Dataset:
    """Return a dataset without the states along one dimension that lie beyond a step."""
    name = f"{dim}_step"
    inside = ds[name] <= last
    ds = ds.isel({dim: inside.any([other for other in inside.dims if other != dim]).values})
    beyond = ds[name] > last
    if not bool(beyond.any()):
        return ds
    # other cases have such a state on the first leg
    held = {str(key): ds[key] for key in ds.data_vars if dim in ds[key].dims and ds[key].dtype.kind == "f"}
    masked = {key: variable.where(~beyond).assign_attrs(variable.attrs) for key, variable in held.items()}
    return ds.assign(masked | {name: ds[name].where(~beyond, -1).assign_attrs(ds[name].attrs)})
