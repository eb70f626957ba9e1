"""The key of a study file that stores a variable."""

from __future__ import annotations

from roughvol.observables.variables import OBSERVABLES, QUANTITIES
from roughvol.study import Record

ELSEWHERE = {
    "contact_conductance": "material.conductivity",  # made of the conductivities where it is read
    "plastic_volume": "material.hardness",
    "plastic_area_fraction": "material.hardness",
    "contact_above_hardness_fraction": "material.plastic",
    "load_above_hardness_fraction": "material.plastic",
    "seal_leak_rate": "seal",
    "seal_gas_leak_rate": "seal",
}
"""Keys of variables that no key of the section ``record`` stores."""


def record_key(variable: str) -> str:
    """Return the key that stores a variable, as ``record.transport.percolation`` for ``percolates``; empty for none.

    The variable is in the table or follows from a variable of the table.
    """
    if variable in ELSEWHERE:
        return ELSEWHERE[variable]
    name = variable.replace("_dry", "") if variable.endswith("_dry") else variable
    row = QUANTITIES.get(name)
    observable = OBSERVABLES.get(row.observable if row is not None and row.observable else name)
    key = (row.key if row is not None else "") or (observable.key.removesuffix(".at") if observable is not None else "")
    return f"record.{key or name}" if key or name in Record.model_fields else ""
