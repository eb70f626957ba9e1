"""Numbers with units, made from the starred ones when the cases of a study are collected.

Conventions: σ = Sq, all lengths in the unit of the study, p* = p L/(E* σ), V* = g_mean/σ. The liquid is incompressible,
its flow that between plates (Reynolds). The pressure drop over the region is ΔP, its length along the flow W_x, its
width W_y. Plates at the mean gap pass g_mean³ ΔP W_y/(12 μ W_x); the gap passes T_x* times as much. The numbers belong
to the patch: k patches side by side pass k times as much, k in a row one k-th.

A gas is ideal and isothermal. Its throughput p V̇ is the same in every cross section. Viscous flow between plates at
the mean gap has g_mean³ (p_in² - p_out²) W_y/(24 μ W_x); the gap passes T_g,x* times as much. It is given at the
temperature of the gas, and as sccm at 0 °C and 101325 Pa.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from roughvol.observables.variables import AXES, HEIGHT_POWERS, VARIABLES
from roughvol.study import GeneratedSurface, Study, convert, throughput

if TYPE_CHECKING:
    from xarray import Dataset, Variable

LEAKS = ("leak_rate", "gas_leak_rate")


def in_units(results: Dataset, study: Study, length_unit: str | None) -> Dataset:
    """Return the cases of a study with heights scaled to its Sq, and with the numbers of ``record.dimensional``."""
    surface = study.surface
    if isinstance(surface, GeneratedSurface) and surface.height is not None:
        results = scaled(results, surface.height)
    made: dict[str, Any] = {}
    for name, values, unit in _made(results, study, length_unit):
        row = VARIABLES[name]
        dry = ", without fluid pressure" if study.record.fluid_pressure is not None and name in LEAKS else ""
        values.attrs = {"units": unit, "long_name": row.long_name + dry, "symbol": row.symbol}
        made[name] = values
        if "axis" in values.dims and "axis" not in results:  # no case reached a flow
            made["axis"] = ("axis", list(AXES))
    wanted = study.record.dimensional
    if wanted is not None and (leak := wanted.leak_rate) is not None and "leak_rate" in made:
        made["leak_rate"].attrs |= {"pressure_drop": str(leak.pressure_drop), "viscosity": str(leak.viscosity)}
    if (fluid := study.fluid) is not None and "gas_leak_rate" in made:
        words = {"gas": fluid.label, "law": fluid.law, "temperature_K": fluid.kelvin, "viscosity": fluid.viscosity}
        words["mean_free_path"] = f"{fluid.mean_free_path(101325.0) * 1e9:.4g} nm at 101325 Pa"
        made["gas_leak_rate"].attrs |= words
    return results.assign(made)


def scaled(results: Dataset, height: float) -> Dataset:
    """Return generated surfaces with heights scaled to Sq = ``height``.

    Starred numbers stay. The others scale with a power of the heights (`variables.HEIGHT_POWERS`).
    """
    factor = height / results.variables["Sq"]
    changed = {}
    for name in HEIGHT_POWERS.keys() & set(map(str, results.data_vars)):
        old = results.variables[name]
        changed[name] = (old * factor ** HEIGHT_POWERS[name]).transpose(*old.dims)
        changed[name].attrs = old.attrs
    return results.assign(changed)


def _made(results: Dataset, study: Study, length_unit: str | None) -> Iterator[tuple[str, Variable, str]]:
    """Yield name, values and unit of each number of ``record.dimensional``."""
    wanted = study.record.dimensional
    if wanted is None:
        return
    numbers = results.variables  # quicker than arrays with their coordinates
    sigma = numbers["Sq"].where(numbers["Sq"] > 0.0, 1.0)  # gaps of a flat surface are lengths already
    if wanted.pressure is not None and study.material.unit is not None:
        modulus = convert(study.material.contact_modulus, study.material.unit, wanted.pressure)
        yield "nominal_pressure", numbers["mean_pressure"] * sigma * (modulus / float(numbers["L"])), wanted.pressure
    if length_unit is None:
        return
    lengths = (
        (wanted.free_volume, "free_volume_per_area", "free_volume"),
        (wanted.mean_gap, "mean_gap", "free_volume"),
        (wanted.separation, "mean_plane_separation", "separation"),
        (wanted.critical_gap, "critical_opening", "critical_gap"),
    )
    for unit, name, starred in lengths:
        if unit is not None:
            yield name, _starred(results, starred) * sigma * convert(1.0, length_unit, unit), unit
    meters = convert(1.0, length_unit, "m")
    if wanted.gas_leak_rate is not None and study.fluid is not None:
        inlet, outlet = study.fluid.pressures
        drive = throughput(inlet**2 - outlet**2, "Pa*m^3/s", wanted.gas_leak_rate, study.fluid.kelvin)
        drive = drive / (24.0 * study.fluid.viscosity)
        for name, flow in _flows(results, "gas_", sigma, meters, drive):
            yield name, flow, wanted.gas_leak_rate
    if (leak := wanted.leak_rate) is None:
        return
    for name, flow in _flows(results, "", sigma, meters, leak.drive / 12.0):
        yield name, flow, leak.unit
    fluid = study.record.fluid_pressure
    if fluid is not None and fluid.has_units and "fluid_leak" in results:  # under the same drop
        plates = (sigma * meters) ** 3 * (leak.drive / 12.0)
        yield "fluid_leak_rate", _over_region(results, numbers["fluid_leak"] * plates), leak.unit


def _flows(results: Dataset, gas: str, sigma: Variable, meters: float, drive: float) -> Iterator[tuple[str, Variable]]:
    """Yield the leak rates along the steps and at the states of ``flux_at``; plates g [m] apart pass g³ ``drive``."""
    numbers = results.variables
    plates = (numbers["free_volume"] * sigma * meters) ** 3 * drive
    yield f"{gas}leak_rate", _over_region(results, _starred(results, f"{gas}transmissivity") * plates)
    if (name := f"flux_at_{gas}transmissivity") in results:
        flow = numbers[name] * numbers["flux_at_free_volume"] ** 3 * ((sigma * meters) ** 3 * drive)
        yield f"flux_at_{gas}leak_rate", _over_region(results, flow)


def _over_region(results: Dataset, flow: Variable) -> Variable:
    """Return a flow times the width of the region over its length, W_y/W_x along x and W_x/W_y along y."""
    from xarray import Variable  # its import takes a second; who has results has it loaded

    aspect, along = results.variables["region_aspect"], Variable("axis", [axis == "x" for axis in AXES])
    return (flow * aspect.where(along, 1.0) / aspect.where(~along, 1.0)).transpose(*flow.dims)


def _starred(results: Dataset, name: str) -> Variable:
    """Return a number of every step, NaN at all steps if no case reached a recorded state."""
    if name in results:
        return results.variables[name]
    absent = results.variables["free_volume"] * math.nan
    return absent.set_dims({**absent.sizes, "axis": len(AXES)}) if "axis" in VARIABLES[name].dims else absent
