"""The kinds of a state: pressure, separation, contact area and the others, and a state by its kind and value."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from roughvol.errors import DatasetError
from roughvol.study.values.units import EXAMPLES, Quantity, read, unit_of
from roughvol.study.yaml_text import number_text


@dataclass(frozen=True)
class StateKind:
    """A quantity that names a state of a sweep.

    Attributes
    ----------
    name : str
        As in ``to: {pressure: 0.5}``.
    plural : str
        Key of a list of states in the section ``sweep``; empty without one.
    unit : str
        Kind of its unit, of `units.KINDS`; empty where it has none.
    symbol : str
        Of the starred quantity.
    stored : str
        Name of the stored, starred variable; empty for a leak rate.
    fixes : str
        Name of the starred quantity that a value with a unit fixes.
    falls : bool
        Whether it falls while the load grows.
    search : bool
        Whether the indentation of a state is searched for on a free patch.
    needs_unit : bool
        Whether a value has a unit in any case.
    """

    name: str
    plural: str
    unit: str = ""
    symbol: str = ""
    stored: str = ""
    fixes: str = ""
    falls: bool = False
    search: bool = True
    needs_unit: bool = False

    @property
    def is_starred(self) -> bool:
        """Whether the kind is itself the starred quantity."""
        return self.fixes == self.name and bool(self.stored)


_P, _V, _Q = ("mean_pressure", "pressure"), ("free_volume", "free_volume"), "flow"
STATE_KINDS = {
    kind.name: kind
    for kind in (
        StateKind("pressure", "pressures", "pressure", "p*", *_P),
        StateKind("load", "loads", "force", "p*", *_P, needs_unit=True),
        StateKind("separation", "separations", "length", "d/σ", "separation", "separation", falls=True, search=False),
        StateKind("indentation", "indentations", "length", "Δ/σ", "indentation", "indentation", search=False),
        StateKind("mean_gap", "mean_gaps", "length", "V*", *_V, falls=True, needs_unit=True),
        StateKind("contact_area", "contact_areas", "", "A*", "contact_area_fraction", "contact_area"),
        StateKind("free_volume", "free_volumes", "", "V*", *_V, falls=True),
        StateKind("leak_rate", "leak_rates", _Q, fixes="leak_rate", falls=True, needs_unit=True),
        StateKind("leak_rate_x", "", _Q, fixes="leak_rate_x", falls=True, needs_unit=True),
        StateKind("leak_rate_y", "", _Q, fixes="leak_rate_y", falls=True, needs_unit=True),
    )
}
"""All kinds by name."""
LISTS = {kind.plural: kind for kind in STATE_KINDS.values() if kind.plural}
"""Kinds by the keys of lists in a sweep."""
STARRED = {kind.name: kind for kind in STATE_KINDS.values() if kind.is_starred}
"""Kinds that are starred quantities."""
_SHORT = {kind.symbol[0]: kind.name for kind in STARRED.values()}
_LEG = re.compile(r",\s*leg\s*=?\s*(\d+)\s*$")


def stored_name(quantity: str) -> str:
    """Return the name of the stored variable of a quantity of a study, as ``mean_pressure`` of ``pressure``."""
    return STARRED[quantity].stored if quantity in STARRED else quantity


class Starred(float):
    """A starred number of a surface with the label of the state in the study, as ``pressure=0.5 MPa``."""

    label: str

    def __new__(cls, value: float, label: str) -> Starred:
        """Return the number with its label."""
        new = super().__new__(cls, value)
        new.label = label
        return new

    def __getnewargs__(self) -> tuple[Any, ...]:
        """Survive pickling."""
        return float(self), self.label


@dataclass(frozen=True)
class Level:
    """A state of a sweep: ``last``, a plane, a step, or a quantity and its value."""

    kind: str
    value: float | None = None
    leg: int | None = None  # of a path, from 2; None for the first that reaches it

    @property
    def label(self) -> str:
        """Name of the state in datasets: ``last``, ``step=60``, ``contact_area=0.1``, ``pressure=0.5, leg 2``."""
        if self.leg is not None:
            return f"{Level(self.kind, self.value).label}, leg {self.leg}"
        if self.value is None:
            return self.kind
        if isinstance(self.value, Starred):
            return self.value.label
        return f"{self.kind}={self.value if isinstance(self.value, Quantity) else number_text(self.value)}"

    @property
    def searched(self) -> bool:
        """Whether the indentation of the state is searched for on a free patch."""
        kind = STATE_KINDS.get(self.kind)
        return self.kind.startswith("percolation") or (kind is not None and kind.search)

    def lacking(self, modulus_unit: str | None, length_unit: str | None) -> str:
        """Return which unit of the study the value with its unit needs and the study lacks, empty if none."""
        if unit_of(self.value) is None:
            return ""
        if STATE_KINDS[self.kind].fixes == "pressure" and modulus_unit is None:
            return f"has a unit ({self.value}) and the modulus has none: give it, as material: {{E_star: 10 MPa}}"
        if self.kind != "pressure" and length_unit is None:
            return f"has a unit ({self.value}) and L has none: give it, as surface: {{L: 100 um}}"
        return ""


def parse(text: str) -> Level:
    """Return the level that a text names, as ``pressure=0.5MPa`` or ``last, leg 1``.

    Parameters
    ----------
    text : str
        ``last``, or a kind of `STATE_KINDS` or ``step`` with its value, joined by ``=``. ``, leg 2`` names the leg of
        a path. p, A, V, d and Δ stand for pressure, contact_area, free_volume, separation and indentation.

    Returns
    -------
    Level
        The level; its value is a `Quantity` where it has a unit.

    Raises
    ------
    DatasetError
        If the kind is unknown, or the value is no number with a fitting unit.
    """
    found = _LEG.search(text)
    leg, rest = (int(found[1]), text[: found.start()]) if found else (None, text)
    if leg == 0:
        raise DatasetError(f"no leg 0 in {text!r}; allowed: legs from 1")
    name, equals, value = (part.strip() for part in rest.partition("="))
    if name == "last" and not equals:
        return Level("last", leg=leg)
    name = _SHORT.get(name, name)
    if not equals or name not in (*STATE_KINDS, "step"):
        allowed = ", ".join((*STATE_KINDS, "step"))
        message = (
            f"no state {text!r}; allowed: last, or KIND=VALUE with a KIND of {allowed}, as pressure=0.5MPa; then a leg "
            "of a path, as pressure=0.5MPa, leg 2"
        )
        raise DatasetError(message)
    kind = STATE_KINDS.get(name, StateKind(name, ""))
    try:
        level = Level(name, read(value, kind.unit), leg)
    except ValueError as error:
        raise DatasetError(f"{text}: {error}") from error
    if kind.unit == _Q and not float(level.value or 0.0) > 0.0:
        raise DatasetError(f"{text}: allowed: a leak rate > 0; roughvol show has the load at which each way closes")
    if kind.needs_unit and not isinstance(level.value, Quantity):
        raise DatasetError(f"{text}: needs its unit, as {name}={EXAMPLES[kind.unit].replace(' ', '')}")
    return level
