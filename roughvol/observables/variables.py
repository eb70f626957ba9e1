"""The table of observables and of the variables they store: `variables.toml`, read once.

A row of `VARIABLES` is all that the store needs: by it fields are compressed, heights scaled and states found.
"""

from __future__ import annotations

import importlib
import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from roughvol.tables import table

AXES = ("x", "y")
"""Labels of the dimension ``axis``, the directions of ways and flows."""


@dataclass(frozen=True)
class Variable:
    """A variable of study.nc, with the fields that `variables.toml` explains."""

    dims: str
    units: str
    long_name: str
    symbol: str
    kind: str = "real"
    height_power: int = 0
    source: str = ""
    observable: str = ""
    stored: bool = True
    column: int = 0
    tables: str = "short steps states"
    label: str = ""
    key: str = ""
    averaged: str = "mean"
    lifted_by: str = ""
    touch: float = math.nan


@dataclass(frozen=True)
class Observable:
    """What a study may record, and the function that gives it, with the fields that `variables.toml` explains."""

    of_state: str = ""
    key: str = ""
    states: str = "every-step"
    seconds: float = 0.0
    flow: bool = False
    parts: int = 1
    dim: str = ""
    labels: str = ""
    before: str = ""
    passes: str = ""
    fields: int = 0
    fields_if: str = ""


def function(name: str) -> Callable[..., dict[str, Any]]:
    """Return a function of this room, as ``void.percolation``."""
    module, _, attribute = name.partition(".")
    found: Callable[..., dict[str, Any]] = getattr(importlib.import_module(f"{__package__}.{module}"), attribute)
    return found


def variables(groups: Iterable[Mapping[str, Any]], bases: Mapping[str, Variable] | None = None) -> dict[str, Variable]:
    """Return the variables of all groups behind those they are made of."""
    table = dict(bases or {})
    for group in groups:
        common = {key: value for key, value in group.items() if key in Variable.__dataclass_fields__}
        of = group.get("of", ("",))
        for along, base, (template, row) in itertools.product(group.get("along", ("",)), of, group["rows"].items()):
            words = _inherited(table[base]) if base in table else {"units": "1"}
            words |= of[base] if isinstance(of, Mapping) else {}
            fields = dict(words)
            words |= {"base": base, "along": along, "inner": words.get("dims", "").removeprefix("...")}
            words["function"] = words.get("source", "").rpartition(".")[2]
            words["name"] = name = template.format_map(words)
            fields |= {key: _filled(value, words) for key, value in (common | row).items() if key != "label"}
            table[name] = Variable(**fields, label=row.get("label", ""))
    return table


def with_means(name: str, row: Variable) -> dict[str, Variable]:
    """Return the row of a quantity, and the rows of its mean over the surfaces of an ensemble."""
    means = next(group for group in _TABLE["group"] if "{base}_mean" in group["rows"])
    return variables([means | {"of": [name], "observable": row.observable}], {name: row})


def columns(table: str) -> tuple[str, ...]:
    """Return the columns of a table, where they are stored or follow from what is: short, steps or states."""
    shown = [name for name, row in QUANTITIES.items() if row.column and table in row.tables.split()]
    return tuple(itertools.chain(*(columns_of(name) for name in sorted(shown, key=lambda n: QUANTITIES[n].column))))


def columns_of(name: str) -> tuple[str, ...]:
    """Return the columns of a quantity in a table: one for each direction, as ``leak_rate_x``, or the name itself."""
    return tuple(f"{name}_{axis}" for axis in AXES) if "axis" in QUANTITIES[name].dims.split() else (name,)


def along(symbol: str, axis: str) -> str:
    """Return the symbol of a quantity along a direction, as ``Q_x`` of ``Q_i``."""
    return re.sub(r"(?<![A-Za-z])i(?![A-Za-z])", axis, symbol)


def named_by(head: str) -> str:
    """Return the quantity of a symbol or the head of a column, as ``median Q_x [mm^3/s]``; empty for another text."""
    symbol, dry = re.sub(r" \[.*\]$", "", head.removeprefix("median ")), ""
    if symbol.endswith(" dry"):
        symbol, dry = symbol.removesuffix(" dry"), "_dry"
    for name, row in sorted(QUANTITIES.items(), key=lambda item: not item[1].column):  # heads first
        if not name.endswith("_dry") and symbol in (row.symbol, *(along(row.symbol, axis) for axis in AXES)):
            return name + dry if name + dry in QUANTITIES else name
    return ""


def row_of(column: str) -> Variable | None:
    """Return the row of a quantity, or of its column along a direction; None for a name outside the table."""
    return QUANTITIES.get(column) or QUANTITIES.get(column.removesuffix("_x").removesuffix("_y"))


def _inherited(row: Variable) -> dict[str, Any]:
    """Return the fields that a row made of another takes from it."""
    taken = ("dims", "units", "long_name", "symbol", "kind", "height_power", "source", "observable")
    return {key: getattr(row, key) for key in taken}


def _filled(value: Any, words: Mapping[str, Any]) -> Any:
    return value.format_map(words) if isinstance(value, str) else value


_TABLE = table(__file__)

OBSERVABLES = {name: Observable(**row) for name, row in _TABLE["observable"].items()}
QUANTITIES = variables(_TABLE["group"])
VARIABLES = {name: row for name, row in QUANTITIES.items() if row.stored}
MEAN_ENDS = tuple(with_means("", Variable("", "1", "", "")))[1:]
"""Ends of the names of a mean over surfaces and its errors, as ``_mean`` and ``_interval``."""
OF_STATE = ("indentation", "separation", "contact_area_fraction", "mean_pressure", "free_volume")
"""Numbers that every state has, between two steps as well."""
SOLVED = "closing_pressure"
"""The solved loads p* at which ways close, by axis."""
OF_YIELD = ("plastic_volume", "plastic_area_fraction")
"""Numbers of every state of a surface that yields, and of no other."""
OF_TABLES = ("run", "state", "surfaces", "reached", "closed_before")
"""Columns of tables of states beside the numbers."""
STATES = tuple(name for name, row in VARIABLES.items() if row.source == "study.sections.sweep.Select.levels")
"""Dimensions along which recorded states are stored."""
FIELDS = frozenset(name for name, row in VARIABLES.items() if row.dims.endswith(" x y"))
"""The large variables, compressed on disk."""
HEIGHT_POWERS = {name: row.height_power for name, row in VARIABLES.items() if row.height_power}
"""Power of the heights in each number that changes when they are scaled and the plane is not; v = g δ²."""
ALONG: dict[str, str] = {}
"""The first variable of each observable along the steps."""
for _name, _row in VARIABLES.items():
    if _row.observable and " step" in _row.dims:
        ALONG.setdefault(_row.observable, _name)
LISTED = tuple(name for name, row in VARIABLES.items() if row.source == "study.axes.read")
"""Coordinates of the axes that the lists of a study make."""
DTYPES = {"real": np.float64, "count": np.float64, "index": np.int64, "flag": np.bool_, "text": object}
MISSING: dict[str, Any] = {"real": np.nan, "count": np.nan, "index": -1, "flag": False, "text": ""}
