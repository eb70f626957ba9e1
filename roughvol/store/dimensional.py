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
from typing import TYPE_CHECKING

from roughvol.errors import Problem, StudyError
from roughvol.observables.variables import HEIGHT_POWERS, VARIABLES
from roughvol.study import Case, GeneratedSurface, Study, convert, throughput

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

LEAKS = ("leak_rate_x", "leak_rate_y", "gas_leak_rate_x", "gas_leak_rate_y")


def check(case: Case) -> None:
    """Refuse a study of lengths in units whose own unit of length is unknown.

    Raises
    ------
    StudyError
        If neither the study nor the height file gives the unit.
    """
    wanted = case.record.dimensional
    if wanted is None or case.length_unit is not None:
        return
    name = next((name for name in wanted.named if name != "pressure"), None)
    if name is not None:
        message = f"needs the unit of length, and {case.label} gives none: add surface: {{L: 100 um}}"
        raise StudyError([Problem(message, f"record.dimensional.{name}")])


def in_units(results: Dataset, study: Study, length_unit: str | None) -> Dataset:
    """Return the cases of a study with heights scaled to its Sq, and with its numbers in units.

    Parameters
    ----------
    results : Dataset
        All cases together, from `dataset.combine`.
    study : Study
        Gives Sq, the moduli, and ``record.dimensional``.
    length_unit : str or None
        Unit of the stored lengths.

    Returns
    -------
    Dataset
        The same cases, with further variables.
    """
    surface = study.surface
    if isinstance(surface, GeneratedSurface) and surface.height is not None:
        results = scaled(results, surface.height)
    made = {name: (values, unit) for name, values, unit in _made(results, study, length_unit)}
    results = results.assign({name: values for name, (values, _) in made.items()})
    for name, (_, unit) in made.items():
        row = VARIABLES[name]
        dry = ", without fluid pressure" if study.record.fluid_pressure is not None and name in LEAKS else ""
        results[name].attrs = {"units": unit, "long_name": row.long_name + dry, "symbol": row.symbol}
    wanted = study.record.dimensional
    if wanted is not None and (leak := wanted.leak_rate) is not None:
        for name in {"leak_rate_x", "leak_rate_y"} & made.keys():
            results[name].attrs |= {"pressure_drop": str(leak.pressure_drop), "viscosity": str(leak.viscosity)}
    if (fluid := study.fluid) is not None:
        words = {"gas": fluid.label, "law": fluid.law, "temperature_K": fluid.kelvin, "viscosity": fluid.viscosity}
        words["mean_free_path"] = f"{fluid.mean_free_path(101325.0) * 1e9:.4g} nm at 101325 Pa"
        for name in {"gas_leak_rate_x", "gas_leak_rate_y"} & made.keys():
            results[name].attrs |= words
    return results


def scaled(results: Dataset, height: float) -> Dataset:
    """Return generated surfaces with heights scaled to Sq = ``height``.

    Starred numbers stay. The others scale with a power of the heights (`variables.HEIGHT_POWERS`).
    """
    factor = height / results["Sq"]
    changed = {}
    for name in HEIGHT_POWERS.keys() & set(map(str, results.data_vars)):
        old = results[name]
        changed[name] = (old * factor ** HEIGHT_POWERS[name]).transpose(*old.dims).assign_attrs(old.attrs)
    return results.assign(changed)


def _made(results: Dataset, study: Study, length_unit: str | None) -> Iterator[tuple[str, DataArray, str]]:
    """Yield name, values and unit of each number of ``record.dimensional``."""
    wanted = study.record.dimensional
    if wanted is None:
        return
    sigma = results["Sq"].where(results["Sq"] > 0.0, 1.0)  # gaps of a flat surface are lengths already
    if wanted.pressure is not None and study.material.unit is not None:
        modulus = convert(study.material.contact_modulus, study.material.unit, wanted.pressure)
        yield "nominal_pressure", results["mean_pressure"] * sigma * (modulus / results["L"].item()), wanted.pressure
    if length_unit is None:
        return
    lengths = (
        (wanted.free_volume, "free_volume_per_area", "free_volume"),
        (wanted.mean_gap, "mean_gap", "free_volume"),
        (wanted.separation, "mean_plane_separation", "separation"),
        (wanted.critical_gap, "critical_opening_x", "critical_gap_x"),
        (wanted.critical_gap, "critical_opening_y", "critical_gap_y"),
    )
    for unit, name, starred in lengths:
        if unit is not None:
            yield name, _starred(results, starred) * sigma * convert(1.0, length_unit, unit), unit
    leak, gap = wanted.leak_rate, results["free_volume"] * sigma * convert(1.0, length_unit, "m")
    if wanted.gas_leak_rate is not None and study.fluid is not None:
        inlet, outlet = study.fluid.pressures
        drive = throughput(inlet**2 - outlet**2, "Pa*m^3/s", wanted.gas_leak_rate, study.fluid.kelvin)
        plates = gap**3 * (drive / (24.0 * study.fluid.viscosity))
        for axis, power in (("x", 1), ("y", -1)):
            flow = _starred(results, f"gas_transmissivity_{axis}") * plates * results["region_aspect"] ** power
            yield f"gas_leak_rate_{axis}", flow, wanted.gas_leak_rate
        at_state = (sigma * convert(1.0, length_unit, "m")) ** 3 * (drive / (24.0 * study.fluid.viscosity))
        yield from _at_states(results, "gas_", at_state, wanted.gas_leak_rate)
    if leak is None:
        return
    plates = gap**3 * (leak.drive / 12.0)
    yield "leak_rate_x", _starred(results, "transmissivity_x") * plates * results["region_aspect"], leak.unit
    yield "leak_rate_y", _starred(results, "transmissivity_y") * plates / results["region_aspect"], leak.unit
    yield from _at_states(results, "", (sigma * convert(1.0, length_unit, "m")) ** 3 * (leak.drive / 12.0), leak.unit)
    fluid = study.record.fluid_pressure
    if fluid is None or not fluid.has_units:
        return
    for axis, aspect in (("x", results["region_aspect"]), ("y", 1.0 / results["region_aspect"])):
        if f"fluid_leak_{axis}" in results:  # under the same drop
            plates = (sigma * convert(1.0, length_unit, "m")) ** 3 * (leak.drive / 12.0)
            yield f"fluid_leak_rate_{axis}", results[f"fluid_leak_{axis}"] * plates * aspect, leak.unit


def _at_states(results: Dataset, gas: str, plates: DataArray, unit: str) -> Iterator[tuple[str, DataArray, str]]:
    """Yield the leak rates at the states of ``flux_at``, from that between plates σ apart."""
    for axis, power in (("x", 1), ("y", -1)):
        if (name := f"flux_at_{gas}transmissivity_{axis}") in results:
            flow = results[name] * results["flux_at_free_volume"] ** 3
            yield f"flux_at_{gas}leak_rate_{axis}", flow * plates * results["region_aspect"] ** power, unit


def _starred(results: Dataset, name: str) -> DataArray:
    """Return a number of every step, NaN at all steps if no case reached a recorded state."""
    return results[name] if name in results else results["free_volume"] * math.nan
