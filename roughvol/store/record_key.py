"""The key of a study file that stores a variable."""

from __future__ import annotations

import functools

from roughvol.observables.variables import VARIABLES

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
    """Return the key that stores a variable, as ``record.transport.percolation`` for ``percolates_x``.

    Parameters
    ----------
    variable : str
        Name in the table of variables, or of a derived one.

    Returns
    -------
    str
        Empty for variables of every study with a sweep.
    """
    base = variable.removesuffix("_x").removesuffix("_y").replace("_dry", "")
    if base in IN_UNITS:
        return f"record.dimensional.{IN_UNITS[base]}"
    row = VARIABLES.get(variable)
    name = row.observable if row is not None and row.observable else base
    if name == "region_transmissivity":
        return "record.region_widths.transmissivity"
    found = (f"record.{section}{name}" for section in ("", "transport."))
    return next((key for key in found if key in _keys()), "")


@functools.cache
def _keys() -> set[str]:
    from roughvol.study.reference import keys

    return {key.path for key in keys()}
