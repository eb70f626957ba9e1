"""The kinds of a state (pressure, separation, contact area and others); a state by kind and value; its starred value.

Conventions: σ = Sq. A pressure p is p* = p L/(E* σ), a length h is h/σ. A load F acts on all elements: its mean
pressure is F/A with A the area of the elements, nodes times spacing squared. A leak rate Q under ΔP of a fluid of
viscosity μ is Q 12 μ/(ΔP σ³): T* V*³ times width over length of the region.

A stored step that misses a level by less than `REACHED` is that level. Searches end within 1e-6 of the indentation, and
a load grows with a power of the indentation: 4.2e-6 at most over 24 surfaces of m = 7.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from roughvol.errors import DatasetError, meant
from roughvol.study.plain_data import number_text
from roughvol.study.python_data import text_of_value
from roughvol.study.values.units import KINDS, ROUNDING, Quantity, Written, convert, in_unit, read, unit_of
from roughvol.tables import table

if TYPE_CHECKING:
    from roughvol.typing import Load, Loads


LOAD_OF_REGION = "is a load on the whole surface, and states are those of record.region: give a pressure"


@dataclass(frozen=True)
class StateKind:
    """A quantity that names a state of a sweep, as ``pressure`` in ``to: {pressure: 0.5}``.

    - ``plural``: key of a list of states in the section ``sweep``; empty without one
    - ``unit``: kind of its unit, of `units.KINDS`; empty where it has none
    - ``symbol``: symbol of the starred quantity
    - ``stored``: name of the stored, starred variable; empty for a leak rate
    - ``fixes``: name of the starred quantity that a value with a unit fixes
    - ``falls``: whether it falls while the load grows
    - ``search``: whether the indentation of a state is searched for on a free patch
    - ``needs_unit``: whether a value has a unit in any case
    """

    name: str
    plural: str = ""
    unit: str = ""
    symbol: str = ""
    stored: str = ""
    fixes: str = ""
    falls: bool = False
    search: bool = True
    needs_unit: bool = False


STATE_KINDS = {name: StateKind(name, **row) for name, row in table(__file__).items()}
"""All kinds by name."""
LISTS = {kind.plural: kind for kind in STATE_KINDS.values() if kind.plural}
"""Kinds by the keys of lists in a sweep."""
STARRED = {kind.name: kind for kind in STATE_KINDS.values() if kind.stored and kind.fixes == kind.name}
"""Kinds that are themselves starred quantities."""
OF_ALL = "a load is the nominal pressure times N^2 δ^2, on a free patch of N = 33 nodes a side 6 % more than L^2"
"""The area that a load acts on, in words."""
REACHED = 1e-5  # relative; of d/σ, which passes 0, a share of σ at least
SYMBOLS = {kind.symbol[0]: kind.name for kind in STARRED.values()}
"""Kinds by their symbols."""

_LEG = re.compile(r",\s*leg\s*=?\s*(\d+)\s*$")


def stored_name(quantity: str) -> str:
    """Return the name of the stored variable of a quantity of a study, as ``mean_pressure`` of ``pressure``."""
    return STARRED[quantity].stored if quantity in STARRED else quantity


class Starred(Written):
    """A starred number of a surface; its text is the label of the state in the study, as ``pressure=0.5 MPa``."""


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
            return self.value.text
        return f"{self.kind}={self.written}"

    @property
    def written(self) -> str:
        """The value as in a study, with its unit; empty without a value."""
        if self.value is None:
            return ""
        return str(self.value) if isinstance(self.value, Quantity) else number_text(self.value)

    def same(self, other: Level) -> bool:
        """Return whether another level is this state of a study, perhaps in another unit; starred numbers have none."""
        if (self.kind, self.leg) != (other.kind, other.leg) or self.value is None or other.value is None:
            return self == other
        unit = unit_of(self.value)
        if (unit is None) != (unit_of(other.value) is None):
            return False
        return math.isclose(self.value, in_unit(other.value, unit), rel_tol=ROUNDING)

    def searched(self, *, endless: bool) -> bool:
        """Return whether the indentation of the state is searched for. On a free patch, lengths and planes give it."""
        kind = STATE_KINDS.get(self.kind)
        return self.kind.startswith("percolation") or (kind is not None and (kind.search or endless))

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
    """
    found = _LEG.search(text)
    leg, rest = (int(found[1]), text[: found.start()]) if found else (None, text)
    if leg == 0:
        raise DatasetError(f"no leg 0 in {text!r}; allowed: legs from 1")
    name, equals, value = (part.strip() for part in rest.partition("="))
    if name == "last" and not equals:
        return Level("last", leg=leg)
    name = SYMBOLS.get(name, name)
    kinds = (*STATE_KINDS, "step")
    if not equals or name not in kinds:
        hint = "" if name in kinds else meant(name, (*kinds, "last"))
        raise DatasetError(
            f"no state {text!r}{hint}; allowed: last, or KIND=VALUE with a KIND of "
            f"{', '.join(kinds)}, as pressure=0.5MPa; then a leg of a path, as pressure=0.5MPa, leg 2"
        )
    kind = STATE_KINDS.get(name, StateKind(name))
    try:
        level = Level(name, read(value, kind.unit), leg)
    except ValueError as error:
        raise DatasetError(f"{text}: {error}") from error
    if kind.unit == "flow" and not float(level.value or 0.0) > 0.0:
        raise DatasetError(f"{text}: allowed: a leak rate > 0; roughvol show has the load at which each way closes")
    if name == "contact_area" and float(level.value or 0.0) > 1.0:
        raise DatasetError(f"{text}: allowed: a share of the nominal area, at most 1")
    if kind.needs_unit and not isinstance(level.value, Quantity):
        raise DatasetError(f"{text}: needs its unit, as {name}={KINDS[kind.unit].example.replace(' ', '')}")
    return level


def levels(loads: Loads | Level) -> list[Level]:
    """Return the levels of loads in the forms of Python.

    Parameters
    ----------
    loads : str, mapping, Level, or sequence
        A text of `parse`, a mapping as ``{"pressure": "0.5 MPa", "leg": 2}``, or several of them. A value may be a
        quantity of pint; a list or an array of values is as many levels.

    Returns
    -------
    list of Level
        The levels.
    """
    if isinstance(loads, Level):
        return [loads]
    if hasattr(loads, "tolist"):  # an array of numpy
        return levels(loads.tolist())
    if isinstance(loads, Mapping):
        return [parse(text) for text in _texts(loads)]
    if isinstance(loads, Sequence) and not isinstance(loads, str):
        return [level for load in loads for level in levels(load)]
    return [parse(str(loads))]


def level(load: Load | Level) -> Level:
    """Return the level of one load.

    Parameters
    ----------
    load : str, mapping or Level
        As for `levels`.

    Returns
    -------
    Level
        The level.
    """
    found = levels(load)
    if len(found) != 1:
        raise DatasetError(f"one load is taken, given {len(found)}; as 'last' or {{'pressure': '0.5 MPa'}}")
    return found[0]


def _texts(load: Mapping[str, object]) -> list[str]:
    """Return a mapping of one kind, and of a leg, as texts of `parse`."""
    kinds = [kind for kind in load if kind != "leg"]
    if len(kinds) != 1:
        words = ", ".join(map(str, kinds)) or "none"
        raise DatasetError(f"a load has one kind, given {words}; as {{'pressure': '0.5 MPa'}}")
    values = text_of_value(load[kinds[0]], kinds[0])
    if values == []:
        raise DatasetError(f"{kinds[0]} has no value; allowed: a value or a list, as {{'pressure': ['0.1 MPa']}}")
    if (leg := load.get("leg")) is not None and not str(leg).isdecimal():
        raise DatasetError(f"leg is {leg!r}; allowed: a whole number from 1")
    leg = "" if leg is None else f", leg {leg}"
    return [f"{kinds[0]}={value}{leg}" for value in (values if isinstance(values, list) else [values])]


def slack(kind: str, value: float, share: float = REACHED) -> float:
    """Return by how much a state may miss a starred level that it has reached."""
    return share * max(abs(value), 1.0 if kind == "separation" else 1e-12)


def step_at(kind: str, value: float, values: Iterable[float]) -> int | None:
    """Return the index of the first stored step that reaches a starred state to `REACHED`, None without one.

    ``values`` has the quantity of the kind at each step; NaN where nothing is known.

    Examples
    --------
    >>> step_at("pressure", 0.2, [0.1, 0.2000002, 0.3])
    1
    """
    return next((step for step, one in enumerate(values) if abs(one - value) <= slack(kind, value)), None)


@dataclass(frozen=True)
class Scale:
    """What turns numbers with units into starred ones, see the conventions above.

    ``E_star`` is in ``modulus_unit``, ``L`` and ``Sq`` in ``length_unit``, the area of all elements in its square; None
    stands for arbitrary units. ``drive`` is ΔP/μ of the fluid [1/s].
    """

    E_star: float
    L: float
    Sq: float
    area: float
    modulus_unit: str | None = None
    length_unit: str | None = None
    drive: float | None = None

    def starred(self, kind: str, value: float) -> tuple[str, float]:
        """Return the starred quantity that a `Quantity` or a starred number fixes, and its starred value [1].

        A flat surface, or a unit that is needed and unknown, is a `ValueError`.
        """
        quantity = STATE_KINDS[kind].fixes
        if (unit := unit_of(value)) is None:
            return quantity, float(value)
        if not self.Sq > 0.0:
            raise ValueError(f"{kind} {value}: the surface is flat, Sq is 0, and has no starred numbers")
        if message := Level(kind, value).lacking(self.modulus_unit, self.length_unit):
            raise ValueError(message)
        if quantity == "pressure":
            assert self.modulus_unit is not None
            modulus = convert(self.E_star, self.modulus_unit, "Pa")
            if kind == "pressure":
                pressure = convert(float(value), unit, "Pa")
            else:
                pressure = convert(float(value), unit, "N") / (self.area * self._metre**2)
            return quantity, pressure * self.L / (modulus * self.Sq)
        assert self.length_unit is not None
        if kind.startswith("leak_rate"):
            if self.drive is None:
                raise ValueError(f"{kind} {value}: needs the fluid, record.dimensional.leak_rate")
            return quantity, convert(float(value), unit, "m^3/s") * 12.0 / (self.drive * (self.Sq * self._metre) ** 3)
        return quantity, convert(float(value), unit, self.length_unit) / self.Sq

    @property
    def _metre(self) -> float:
        """The unit of length in metres."""
        assert self.length_unit is not None
        return convert(1.0, self.length_unit, "m")
