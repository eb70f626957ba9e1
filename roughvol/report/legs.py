"""Legs of a path in a dataset."""

from __future__ import annotations

from xarray import Dataset


def first_leg(ds: Dataset) -> Dataset:
    """Return the steps of the first leg, where a dataset has a path of several."""
    return ds.isel(step=ds["leg"].values == 1) if "leg" in ds else ds
