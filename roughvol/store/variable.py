"""A row of the table of stored variables."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Variable:
    """One row of the table.

    Attributes
    ----------
    dims : names of the dimensions; ``...`` for those of the case.
    units : units, ``length`` for that of the study.
    long_name : the variable in words.
    symbol : as in the paper or in ISO 25178-2.
    kind : "real", "count" (missing: NaN), "index" (missing: -1), "flag" (missing: False) or "text".
    height_power : power of the heights in it, where they are scaled and the plane is not.
    source : function, method or attribute in the package that gives the value, as ``surfaces.texture.Sq``.
    observable : label of the observable it belongs to, as ``percolation``; empty where every study stores it.
    """

    dims: str
    units: str
    long_name: str
    symbol: str
    kind: str = "real"
    height_power: int = 0
    source: str = ""
    observable: str = ""


def rows(source: str, observable: str = "", /, **variables: Variable) -> dict[str, Variable]:
    """Return rows of one source and observable.

    Parameters
    ----------
    source : str
        As in `Variable`; ``{name}`` is the name of the row.
    observable : str
        As in `Variable`.
    **variables : Variable
        Rows by name.

    Returns
    -------
    dict
        The rows with source and observable.
    """
    return {
        name: replace(row, source=source.format(name=name), observable=observable) for name, row in variables.items()
    }
