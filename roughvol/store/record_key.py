"""The key of a study file that stores a variable."""

from __future__ import annotations

from roughvol.observables.variables import OBSERVABLES, QUANTITIES
from roughvol.study import Record, Study


def record_key(variable: str) -> str:
    """Return the key that stores a variable, as ``record.transport.percolation`` for ``percolates``; empty for none.

    The variable is in the table or follows from a variable of the table.
    """
    name = variable.replace("_dry", "") if variable.endswith("_dry") else variable
    row = QUANTITIES.get(name)
    observable = OBSERVABLES.get(row.observable if row is not None and row.observable else name)
    key = (row.key if row is not None else "") or (observable.key.removesuffix(".at") if observable is not None else "")
    if key.partition(".")[0] in Study.model_fields:
        return key
    return f"record.{key or name}" if key or name in Record.model_fields else ""
