"""The key of a study file that stores a variable."""

from __future__ import annotations

from roughvol.observables.variables import OBSERVABLES, VARIABLES
from roughvol.study import Record

IN_UNITS = {  # variables of the section ``dimensional``
    "nominal_pressure": "pressure",
    "free_volume_per_area": "free_volume",
    "mean_gap": "mean_gap",
    "mean_plane_separation": "separation",
    "critical_opening": "critical_gap",
    "leak_rate": "leak_rate",
    "gas_leak_rate": "gas_leak_rate",
    "fluid_leak_rate": "leak_rate",
}


def record_key(variable: str) -> str:
    """Return the key that stores a variable, as ``record.transport.percolation`` for ``percolates``; empty for none.

    The variable is in the table or follows from a variable of the table.
    """
    base = variable.replace("_dry", "")
    if base in IN_UNITS:
        return f"record.dimensional.{IN_UNITS[base]}"
    row = VARIABLES.get(variable)
    name = row.observable if row is not None and row.observable else base
    if name in OBSERVABLES and OBSERVABLES[name].key:
        return f"record.{OBSERVABLES[name].key.removesuffix('.at')}"
    return f"record.{name}" if name in Record.model_fields else ""
