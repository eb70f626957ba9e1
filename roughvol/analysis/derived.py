"""Numbers that follow from a stored run, and the surfaces that share a table."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator

import numpy as np
from xarray import Dataset, Variable

from roughvol.analysis.leak import EVIDENCE, counted, is_counted, is_open
from roughvol.analysis.units import sigma
from roughvol.errors import ContactError, DatasetError
from roughvol.observables.stiffness import contact_conductance, harmonic_conductivity, interfacial_stiffness
from roughvol.observables.variables import QUANTITIES
from roughvol.study import Study, convert
from roughvol.study.values.units import in_unit

P, V = "mean_pressure", "free_volume"
ROUNDING = 1e-12  # a starred number below is 0 to rounding: the mean plane, an unloaded surface
CONDUCTIVITY = "W/m/K"


def derived(ds: Dataset, study: Study | None) -> Dataset:
    """Return a dataset with mean gap, nominal pressure, open ways, stiffness, and the leak that counts.

    The loads and the contact area of an unloaded surface are 0.
    """
    found = _stiffness(ds, study)
    if P in ds and (unloaded := abs(ds.variables[P]) <= ROUNDING).any():  # an unloaded surface has p* of rounding
        numbers = {name: ds.variables[name] for name in (P, "nominal_pressure", "contact_area_fraction") if name in ds}
        ds = ds.assign({name: one.where(~unloaded, 0.0) for name, one in numbers.items()})
    if "mean_gap" not in ds and {"Sq", V} <= set(ds):
        gap = found["mean_gap"] = ds.variables[V] * sigma(ds)
        gap.attrs |= {"units": ds.attrs.get("length_unit", "length"), "symbol": "g_mean"}
    nominal = nominal_pressure(ds, study)
    if nominal is not None:
        found["nominal_pressure"] = nominal
    evidence = [ds.variables[name] for name in EVIDENCE if name in ds]
    known = [is_open(flow) for flow in evidence if not np.isnan(flow.values).all()]
    if known and not is_counted(ds):  # a record may have them at different steps
        values = [ways.transpose(*known[0].dims).values for ways in known]
        found["open"] = known[0].copy(data=functools.reduce(lambda a, b: np.where(np.isnan(a), b, a), values))
    return counted(ds.assign(found))


def nominal_pressure(ds: Dataset, study: Study | None) -> Variable | None:
    """Return the nominal pressure: the stored one, or in the unit of the modulus; None of a modulus without a unit."""
    if "nominal_pressure" in ds:
        return ds.variables["nominal_pressure"]
    if not {"Sq", P} <= set(ds) or study is None or not study.material.unit:
        return None
    nominal = ds.variables[P] * sigma(ds) * (study.material.contact_modulus / float(ds["L"]))
    nominal.attrs |= {"units": study.material.unit, "symbol": "p"}
    return nominal


def _attributes(name: str) -> dict[str, str]:
    row = QUANTITIES[name]
    return {"units": row.units, "long_name": row.long_name, "symbol": row.symbol}


def _stiffness(ds: Dataset, study: Study | None) -> dict[str, Variable]:
    """Return the interfacial stiffness on the first leg, and the conductance that follows."""
    try:
        pressure, gap = (ds.variables[name].transpose(..., "step") for name in (P, V))
        first = ds["leg"].values == 1 if "leg" in ds else slice(None)
        stiffness = np.full(pressure.shape, np.nan)
        stiffness[..., first] = interfacial_stiffness(pressure.values[..., first], gap.values[..., first])
    except (ContactError, KeyError, ValueError):  # pressures that do not rise throughout, as of a region; one step
        return {}
    found = {"interfacial_stiffness": Variable(pressure.dims, stiffness, _attributes("interfacial_stiffness"))}
    unit, bodies = ds.attrs.get("length_unit"), study.material.conductivity if study is not None else None
    # Barber's relation is that of elastic half spaces: not of metal that yields, and not of a layer.
    alike = study is not None and not study.material.yields and not study.kernel(unit).lengths
    if unit and bodies and alike:
        first_body, second = (in_unit(value, CONDUCTIVITY) or math.nan for value in bodies)
        length = convert(float(ds["L"]), unit, "m")
        value = contact_conductance(stiffness, harmonic_conductivity(first_body, second), length)
        found["contact_conductance"] = Variable(pressure.dims, value, _attributes("contact_conductance"))
    return found


def is_pressed(ds: Dataset) -> bool:
    """Return whether a dataset has states; a study with ``steps: 0`` has surfaces alone."""
    return "step" in ds.sizes and P in ds


def check_pressed(ds: Dataset, name: str) -> None:
    """Raise `DatasetError` for a dataset without states."""
    if not is_pressed(ds):
        raise DatasetError(f"{name} {lacks_states(ds)}")


def lacks_states(ds: Dataset) -> str:
    """Return why a dataset has no states: of a study with ``steps: 0``, or a choice of the numbers of a run."""
    if P in ds:
        return "has no dimension step, as numbers at a load; allowed: the states of a run"
    return f"has no {P}; allowed: all variables of a run" if "step" in ds.sizes else "has no state: nothing was pressed"


def groups(ds: Dataset) -> Iterator[tuple[str, Dataset]]:
    """Yield the surfaces that share a table, those computed along `seed`: each file, or each D at each m."""
    if "case" in ds.dims:
        for place, label in enumerate(ds["case"].values.tolist()):
            yield str(label), ds.isel(case=place).expand_dims("seed")
        return
    solved = ~np.isnan(ds.variables[P].transpose("D", "m", "seed", "step").values).all(axis=-1)
    for i, D in enumerate(ds["D"].values):
        for j, m in enumerate(ds["m"].values):
            if solved[i, j].any():
                group = ds.isel(D=i, m=j)
                yield f"D = {D:g}, m = {m}", group if solved[i, j].all() else group.isel(seed=solved[i, j])
