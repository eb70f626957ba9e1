"""Units of datasets: Sq in that of L, what makes numbers starred, and several runs in the units of the first."""

from __future__ import annotations

import math
from collections.abc import MutableMapping

import numpy as np
from xarray import Dataset, Variable

from roughvol.analysis.stored_run import Run
from roughvol.store.dimensional import LEAKS
from roughvol.study import Scale, convert
from roughvol.study.sections.fluid import throughput
from roughvol.study.values.units import counts_substance
from roughvol.typing import Array

PLAIN = ("", "1")  # units of pure numbers
KELVIN = "temperature_K"  # attribute of the throughput of a gas
THROUGHPUT = "Pa*m^3/s"


def sigma(ds: Dataset) -> Variable:
    """Return Sq in the unit of L, whatever unit a dataset has it in."""
    Sq, unit = ds.variables["Sq"], str(ds.attrs.get("length_unit", ""))
    own = str(Sq.attrs.get("units", unit))
    return Sq if own == unit or not unit else Sq * convert(1.0, own, unit)


def scales(run: Run, surfaces: Dataset) -> list[Scale]:
    """Return what turns numbers with units into starred ones, for each surface along ``seed``."""
    ds, material = run.dataset, run.study.material if run.study else None
    L, unit = float(ds["L"]), ds.attrs.get("length_unit")
    modulus, modulus_unit = (material.contact_modulus, material.unit) if material else (math.nan, None)
    sizes = sigma(surfaces).values.tolist()
    nodes = [surfaces[name].values for name in ("nodes_x", "nodes_y") if name in surfaces]
    periodic = "periodic" in ds.attrs
    if len(nodes) < 2 and "m" in surfaces.coords:
        nodes = [np.full(len(sizes), 2.0 ** float(surfaces["m"]) + (not periodic))] * 2
    areas = [math.nan] * len(sizes)
    if len(nodes) == 2:
        areas = (nodes[0] * nodes[1] * (L / (nodes[0] - (not periodic))) ** 2).tolist()
    return [Scale(modulus, L, Sq, area, modulus_unit, unit) for Sq, area in zip(sizes, areas, strict=True)]


def in_units(ds: Dataset, units: MutableMapping[str, str]) -> Dataset:
    """Return a dataset with its variables in given units; a variable whose unit cannot be converted is unchanged.

    The unit of a variable without one is added to ``units``, so that later datasets follow. Leaks at recorded states,
    and those of the dry gap, have the unit of the leak along the steps. A range over surfaces has that of its number.
    """
    changed, kelvin = {}, _kelvin(ds)
    for given in list(units):
        units.setdefault(_along_steps(given), units[given])
    for name in ds.data_vars:
        variable = ds.variables[name]  # quicker than the array with its coordinates
        own = str(variable.attrs.get("units", "1"))
        wanted = units.get(str(name)) or units.setdefault(_along_steps(str(name)), own)
        if own == wanted or own in PLAIN or wanted in PLAIN:
            continue
        try:
            factor = _factor(own, wanted, kelvin)
        except (AttributeError, ValueError, TypeError):  # bases of pint's errors, as for the unit "length"
            continue
        changed[name] = variable * factor
        changed[name].attrs = variable.attrs | {"units": wanted}
    return ds.assign(changed) if changed else ds.copy()


def for_pint(ds: Dataset, name: str, wanted: str | None) -> tuple[Array, str]:
    """Return the values of a variable, and their unit, from which pint converts to a unit, or to none.

    Pint knows no temperature: standard volumes of a gas, as sccm, hold at 0 °C, other throughputs at that of the gas.
    """
    variable, kelvin = ds.variables[name], _kelvin(ds)
    own = given = str(variable.attrs.get("units", "1"))
    if kelvin is not None:
        if wanted is not None and _is_standard(wanted):
            given = wanted
        elif _is_standard(own):
            given = THROUGHPUT
    return (variable.values, own) if given == own else (variable.values * _factor(own, given, kelvin), given)


def _along_steps(name: str) -> str:
    """Return the leak along the steps, of a leak at recorded states or of the dry gap, and the number of a range."""
    number = name.removesuffix("_range")
    flow = number.removeprefix("flux_at_").removeprefix("fluid_").removesuffix("_dry")
    return flow if flow in LEAKS else number


def _kelvin(ds: Dataset) -> float | None:
    """Return the temperature of the gas of a dataset, None without a gas."""
    return next((float(v.attrs[KELVIN]) for v in ds.variables.values() if KELVIN in v.attrs), None)


def _factor(own: str, wanted: str, kelvin: float | None) -> float:
    """Return the factor from a unit to another; of a throughput with the temperature of its gas."""
    return convert(1.0, own, wanted) if kelvin is None else throughput(1.0, own, wanted, kelvin)


def _is_standard(unit: str) -> bool:
    """Return whether a unit counts standard volumes; pint may not know the unit of a user."""
    try:
        return counts_substance(unit)
    except (AttributeError, ValueError, TypeError):  # bases of pint's errors
        return False
