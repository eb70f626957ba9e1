"""Numbers that follow from a stored run, and the surfaces that share a table."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator

import numpy as np
from xarray import DataArray, Dataset

from roughvol.analysis.leak import EVIDENCE, counted, is_open
from roughvol.analysis.legs import first_leg
from roughvol.analysis.units import sigma
from roughvol.errors import ContactError, DatasetError
from roughvol.observables.stiffness import contact_conductance, harmonic_conductivity, interfacial_stiffness
from roughvol.observables.variables import QUANTITIES
from roughvol.study import Study, convert
from roughvol.study.values.units import in_unit

P, V = "mean_pressure", "free_volume"
ROUNDING = 1e-12
CONDUCTIVITY = "W/m/K"


def derived(ds: Dataset, study: Study | None) -> Dataset:
    """Return a dataset with mean gap, nominal pressure, open ways, stiffness, and the leak that counts."""
    found = _stiffness(ds, study)
    if "mean_gap" not in ds and {"Sq", V} <= set(ds):
        gap = ds[V] * sigma(ds)
        found["mean_gap"] = gap.assign_attrs(units=ds.attrs.get("length_unit", "length"), symbol="g_mean")
    nominal = with_nominal(ds, study).get("nominal_pressure")
    if nominal is not None and P in ds:  # an unloaded surface has p* of rounding
        found["nominal_pressure"] = nominal.where(abs(ds[P]) > ROUNDING, 0.0 * nominal).assign_attrs(nominal.attrs)
    known = [is_open(ds[name]) for name in EVIDENCE if name in ds and bool(ds.variables[name].notnull().any())]
    if known:  # a record may have them at different steps
        values = [ways.transpose(*known[0].dims).values for ways in known]
        found["open"] = known[0].copy(data=functools.reduce(lambda a, b: np.where(np.isnan(a), b, a), values))
    return counted(ds.assign(found))


def with_nominal(ds: Dataset, study: Study | None) -> Dataset:
    """Return a dataset with its nominal pressure: the stored one, or in the unit of the modulus where it has one."""
    if "nominal_pressure" in ds or not {"Sq", P} <= set(ds) or study is None or not study.material.unit:
        return ds
    nominal = ds[P] * sigma(ds) * (study.material.contact_modulus / float(ds["L"]))
    return ds.assign(nominal_pressure=nominal.assign_attrs(units=study.material.unit, symbol="p"))


def _attributes(name: str) -> dict[str, str]:
    row = QUANTITIES[name]
    return {"units": row.units, "symbol": row.symbol, "long_name": row.long_name}


def _stiffness(ds: Dataset, study: Study | None) -> dict[str, DataArray]:
    """Return the interfacial stiffness on the first leg, and the conductance that follows."""
    try:
        first = first_leg(ds)
        pressure, gap = (first[name].transpose(..., "step") for name in (P, V))
        stiffness = pressure.copy(data=interfacial_stiffness(pressure.values, gap.values)).reindex(step=ds["step"])
    except (ContactError, KeyError, ValueError):  # pressures that do not rise throughout, as of a region; one step
        return {}
    found = {"interfacial_stiffness": stiffness.assign_attrs(_attributes("interfacial_stiffness"))}
    unit, bodies = ds.attrs.get("length_unit"), study.material.conductivity if study is not None else None
    # Barber's relation is that of elastic half spaces: not of metal that yields, and not of a layer.
    alike = study is not None and not study.material.yields and not study.kernel(unit).lengths
    if unit and bodies and alike:
        first_body, second = (in_unit(value, CONDUCTIVITY) or math.nan for value in bodies)
        length = convert(float(ds["L"]), unit, "m")
        value = contact_conductance(stiffness.values, harmonic_conductivity(first_body, second), length)
        found["contact_conductance"] = stiffness.copy(data=value).assign_attrs(_attributes("contact_conductance"))
    return found


def is_pressed(ds: Dataset) -> bool:
    """Return whether a dataset has states; a study with ``steps: 0`` has surfaces alone."""
    return "step" in ds.sizes and P in ds


def check_pressed(ds: Dataset, name: str) -> None:
    """Raise `DatasetError` for a dataset without states."""
    if not is_pressed(ds):
        raise DatasetError(f"{name} has no state: nothing was pressed")


def groups(ds: Dataset) -> Iterator[tuple[str, Dataset]]:
    """Yield the surfaces that share a table, those computed along `seed`: each file, or each D at each m."""
    if "case" in ds.dims:
        for place, label in enumerate(ds["case"].values.tolist()):
            yield str(label), ds.isel(case=place).expand_dims("seed")
        return
    for D in ds["D"].values:
        for m in ds["m"].values:
            group = ds.sel(D=D, m=m)
            computed = np.flatnonzero(group[P].notnull().any("step").values)
            if computed.size:
                some = group if computed.size == group.sizes["seed"] else group.isel(seed=computed)
                yield f"D = {D:g}, m = {m}", some
