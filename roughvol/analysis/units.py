"""Datasets of several runs in the units of the first that has each variable, as MPa beside kPa."""

from __future__ import annotations

from collections.abc import MutableMapping

from xarray import DataArray, Dataset

from roughvol.study import convert
from roughvol.study.sections.fluid import throughput

PLAIN = ("", "1")  # units of pure numbers


def sigma(ds: Dataset) -> DataArray:
    """Return Sq in the unit of L, whatever unit a dataset has it in."""
    Sq, unit = ds["Sq"], str(ds.attrs.get("length_unit", ""))
    own = str(Sq.attrs.get("units", unit))
    return Sq if own == unit or not unit else Sq * convert(1.0, own, unit)


def in_units(ds: Dataset, units: MutableMapping[str, str]) -> Dataset:
    """Return a dataset with its variables in given units; a variable whose unit cannot be converted is unchanged.

    The unit of a variable without one is added to ``units``, so that later datasets follow.
    """
    changed = {}
    for name, variable in ds.data_vars.items():
        own = str(variable.attrs.get("units", "1"))
        wanted = units.setdefault(str(name), own)
        if own == wanted or own in PLAIN or wanted in PLAIN:
            continue
        try:
            kelvin = variable.attrs.get("temperature_K")
            factor = convert(1.0, own, wanted) if kelvin is None else throughput(1.0, own, wanted, float(kelvin))
        except (AttributeError, ValueError, TypeError):  # bases of pint's errors, as for the unit "length"
            continue
        changed[name] = (variable * factor).assign_attrs(variable.attrs | {"units": wanted})
    return ds.assign(changed)
