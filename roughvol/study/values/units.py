"""Numbers with a unit, as ``100 um`` or ``1 mPa*s``: reading, check of the dimension, conversion.

pint is imported here only, at the first unit that is neither in `KINDS` nor in `FACTORS`. Lengths have the names of
`roughvol.surfaces.length_units`: stored lengths are labelled with the one unit of the study.
"""

from __future__ import annotations

import contextlib
import functools
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, Self

from pydantic import AfterValidator, GetCoreSchemaHandler, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from roughvol.errors import question
from roughvol.study.plain_data import number_text, printable
from roughvol.study.values.types import Form, Positive, refuse
from roughvol.surfaces.length_units import METRES, named
from roughvol.tables import table


class UnitKind(NamedTuple):
    """A kind of unit: its dimension in pint's notation, its units and a number with a unit for messages."""

    dimension: str
    units: str
    example: str = ""


_TABLE = table(__file__)
KINDS = {"length": UnitKind("[length]", ", ".join(METRES), "100 um")}
KINDS |= {kind: UnitKind(**row) for kind, row in _TABLE["kinds"].items()}
FACTORS: dict[str, dict[str, float]] = _TABLE["factors"]
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?![eE][-+]?\d)(\D.*)", re.ASCII | re.DOTALL)
# Words, small powers, products and quotients. Other arithmetic of pint is refused.
_POWER = r"(?:(?:\^|\*\*)-?[1-9]|⁻?[¹²³⁴-⁹])?"
_UNIT = re.compile(rf"°?[^\W\d_]{{1,30}}{_POWER}(?:(?: ?[*·/] ?|[. ])[^\W\d_]{{1,30}}{_POWER}){{0,5}}")
_MARK = re.compile(r"[,_'’]\d")  # behind digits: a decimal comma, or a mark between thousands
_PLAIN_POWER = re.compile(r"(?<=[^\W\d_])(?=[1-9])")  # as in mm2
_DOT = re.compile(r"\.(?=[^\W\d])")  # between units, a product
_STANDARD = re.compile(r"(?:sccm|sccs|standard_liter_per_minute)\b")  # pint's full names, behind a prefix
A_POINT = "; a number has a point and no other mark, as 1000.5"
LARGEST = 1e50  # in a study, in any unit: fourth powers, of spectra, are floats
ROUNDING = 1e-12  # relative, of two numbers in different units
_NOT_KNOWN = (AttributeError, ValueError, TypeError, AssertionError)  # bases of pint's errors beside PintError


class Written(float):
    """A number with a text beside it; a plain float in sums and comparisons."""

    text: str

    def __new__(cls, value: float, text: str) -> Self:
        """Return the number with its text."""
        new = super().__new__(cls, value)
        new.text = text
        return new

    def __getnewargs__(self) -> tuple[Any, ...]:
        """Pickle the text too."""
        return float(self), self.text

    def __str__(self) -> str:
        """Return the text."""
        return self.text


class Quantity(Written):
    """A number with the unit given in the study."""

    @property
    def unit(self) -> str:
        """The unit."""
        return self.text

    def __str__(self) -> str:
        """Return number and unit as in a study."""
        return f"{number_text(float(self))} {self.unit}"


def unit_of(value: Any) -> str | None:
    """Return the unit of a number, None without one."""
    return value.unit if isinstance(value, Quantity) else None


def convert(value: float, given: str, wanted: str) -> float:
    """Return a number in one unit as a number in another of the same dimension.

    Parameters
    ----------
    value : float
        Number in the unit ``given``.
    given, wanted : str
        Units of a study, or others of pint.

    Returns
    -------
    float
        Number in the unit ``wanted``.
    """
    if given == wanted:
        return value
    if (factor := FACTORS.get(wanted, {}).get(given)) is not None:
        return value * factor
    registry = _registry()
    return float(registry.Quantity(value, _spelled(given)).to(_spelled(wanted)).magnitude)


def quantity(values: Any, given: str, wanted: Any = None, registry: Any = None) -> Any:
    """Return stored values as a quantity of pint.

    Parameters
    ----------
    values : array_like
        Values in the unit ``given``.
    given : str
        A unit of a study, or 1.
    wanted : str or Unit, optional
        Another unit of the same dimension, known to the registry. Default: ``given``, or base units if the registry
        does not know it, as sccm.
    registry : pint.UnitRegistry, optional
        Registry of the quantity. Default: that of the application.

    Returns
    -------
    Quantity
        The values with their unit.
    """
    import pint

    registry = pint.get_application_registry() if registry is None else registry
    try:
        own = _registry().Quantity(1.0, _spelled(given))
        try:
            found = registry.Quantity(values, _spelled(given))
        except pint.UndefinedUnitError:
            found = registry.Quantity(values * own.to_base_units().magnitude, f"{own.to_base_units().units}")
        return found if wanted is None else found.to(_spelled(wanted) if isinstance(wanted, str) else wanted)
    except (pint.PintError, *_NOT_KNOWN) as error:
        if isinstance(error, pint.UndefinedUnitError) and given.startswith("length"):
            raise ValueError("the lengths have no unit; a study with one has surface: {L: 100 um}") from error
        raise ValueError(f"{error}") from error


def in_unit(value: float, wanted: str | None) -> float:
    """Return a number of a study in a unit; a plain number is in that unit already."""
    given = unit_of(value)
    return value if given is None or wanted is None else convert(float(value), given, wanted)


def same(one: Any, other: Any) -> bool:
    """Return whether two values of plain data are equal, numbers with a unit in one unit."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if one == other or not (isinstance(one, str) and isinstance(other, str)):
        return bool(one == other)
    first, second = _NUMBER.fullmatch(one), _NUMBER.fullmatch(other)
    if first is None or second is None:
        return False
    try:
        converted = convert(float(second[1]), second[2], first[2])
    except _NOT_KNOWN:  # units of two kinds
        return False
    return math.isclose(float(first[1]), converted, rel_tol=ROUNDING)


def counts_substance(unit: str) -> bool:
    """Return whether a unit of throughput is one of standard volume over time, as sccm, ksccm or slpm."""
    return _STANDARD.search(str(_registry().parse_units(_spelled(unit)))) is not None


def is_known(unit: str) -> bool:
    """Return whether a text is a unit that a study may name; of length, one of those of stored lengths."""
    if not unit or named(unit) or any(unit in _listed(kind) for kind in KINDS):
        return True
    return _dimension(unit) not in (None, "[length]")


def read(text: str, kind: str) -> float:
    """Return a number of a command line, with its unit or plain.

    Parameters
    ----------
    text : str
        As 0.5 or ``0.5MPa``.
    kind : str
        Kind of the unit, of `KINDS`; empty for a number without one.

    Returns
    -------
    float
        A `Quantity`, or a plain number.
    """
    with contextlib.suppress(ValueError):
        if math.isfinite(plain := float(text)):
            return plain
    match = _NUMBER.fullmatch(text.strip())
    if match is None or not kind or not math.isfinite(value := float(match[1])):
        unit = f", or a number with a unit of {kind}, as in {KINDS[kind].example}" if kind else " without a unit"
        raise ValueError(f"must be a number{unit}, given {text!r}")
    try:
        return Quantity(value, _checked(match[2], kind))
    except PydanticCustomError as error:
        raise ValueError(error.message()) from error


@dataclass(frozen=True)
class In(Form):
    """Accept a number with a unit of a kind, and a plain number unless the unit is ``needed``."""

    kind: str
    needed: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        schema: Any = super().__get_pydantic_core_schema__(source, handler)
        return {**schema, "serialization": core_schema.plain_serializer_function_ser_schema(text_of)}

    def _forms(self, inner: Any) -> list[Any]:
        """Return the schema of a plain number, and of text with a unit."""
        text = {"type": "string", "examples": [KINDS[self.kind].example]}
        return [text] if self.needed else [inner, text]

    def _read(self, value: Any, inner: Callable[[Any], Any]) -> Any:
        """Return a `Quantity`, or a plain number."""
        if isinstance(value, Quantity) or not (isinstance(value, str) or self.needed):
            return value if isinstance(value, Quantity) else _bounded(inner(value))
        match = _NUMBER.fullmatch(value.strip()) if isinstance(value, str) else None
        if match is None:
            plain = "" if self.needed else "a number, or "
            refuse(f"must be {plain}a number with a unit of {self.kind}, as in {KINDS[self.kind].example}")
        unit = _checked(match[2], self.kind)
        try:
            number = inner(float(match[1]))
        except ValidationError as error:  # of the number; the message has it with its unit
            wrong = [InitErrorDetails(type=e["type"], input=value, ctx=e.get("ctx", {})) for e in error.errors()]
            raise ValidationError.from_exception_data(error.title, wrong) from error
        return Quantity(_bounded(number), unit)


def _bounded(number: float) -> float:
    """Refuse a number whose powers are no floats."""
    if abs(number) > LARGEST:
        refuse("must be at most {largest} in size", largest=number_text(LARGEST))
    return number


def text_of(value: Any) -> Any:
    """Return a number with its unit as text, other values unchanged."""
    return str(value) if isinstance(value, Quantity) else value


def _rising(value: tuple[float, float]) -> tuple[float, float]:
    """Refuse two positions that do not rise; without a unit, a position is a share of the side."""
    units = [unit_of(position) for position in value]
    for position, unit in zip(value, units, strict=True):
        number = number_text(position)
        if unit is None and position > 1:
            refuse("{number} is no share of the side, 0 to 1; a length has a unit", number=number)
        if unit is None and any(units) and position not in (0.0, 1.0):
            refuse("{number} has no unit and the other position has one", number=number)
    if units[0] == units[1] and value[0] >= value[1]:
        refuse("must rise, from < to")
    return value


def unit_name(kind: str, *, counts: bool = False) -> AfterValidator:
    """Return a validator of units of a kind; with ``counts`` also of a number before it, the size of a count."""

    def read(text: str) -> str:
        match = _NUMBER.fullmatch(text.strip()) if counts else None
        if match is None:
            return _checked(text, kind)
        number, unit = float(match[1]), _checked(match[2], kind)
        if not 0.0 < number < math.inf:
            refuse("must be a unit, or a count of positive size, as in 0.95 {unit}", unit=unit)
        return unit if number == 1.0 else f"{number_text(number)} {unit}"

    return AfterValidator(read)


Conductivity = Annotated[Positive, In("conductivity", needed=True)]
Length = Annotated[Positive, In("length")]
Pressure = Annotated[Positive, In("pressure")]
Position = Annotated[float, In("length")]
Gap = Annotated[Positive, In("length", needed=True)]
Load = Annotated[Positive, In("force", needed=True)]
Viscosity = Annotated[Positive, In("viscosity", needed=True)]
Time = Annotated[Positive, In("time", needed=True)]
Flow = Annotated[Positive, In("flow", needed=True)]
RISING = AfterValidator(_rising)
LengthUnit = Annotated[str, unit_name("length")]
HeightsUnit = Annotated[str, unit_name("length", counts=True)]


def _checked(unit: str, kind: str) -> str:
    """Return a unit of a kind in its stored form; refuse others."""
    unit = _DOT.sub("*", unit.strip())
    if kind == "length" and (name := named(unit)):
        return name
    dimension, allowed, _ = KINDS[kind]
    found = _dimension(unit)
    if found is None and (of_power := _dimension(powers := _PLAIN_POWER.sub("^", unit))) not in (None, dimension):
        unit, found = powers, of_power
    if found is None:
        refuse(f"'{printable(unit)[:40]}' is no known unit{_hint(unit, kind)}; allowed for a {kind}: {allowed}")
    if found != dimension:
        other = next((name for name, row in KINDS.items() if row.dimension == found), "another quantity")
        refuse(f"'{unit}' is a unit of {other}, not of {kind}{_hint(unit, kind)}; allowed: {allowed}")
    if kind == "length":
        refuse(f"'{unit}' is no unit of length of a study; allowed: {allowed}")
    return unit


def _hint(unit: str, kind: str) -> str:
    """Return what was meant by an unknown unit or one of another kind, empty if that is not known."""
    if _MARK.match(unit):
        return A_POINT
    powers = _PLAIN_POWER.sub("^", unit)
    meant = [powers] if _dimension(powers) == KINDS[kind].dimension else []
    meant += [one for one in _listed(kind) if _joined(one) == _joined(unit)]
    return question(meant[:1])


def _joined(unit: str) -> str:
    """Return a unit without case and products: mpas of ``mPa*s``."""
    return unit.lower().replace("*", "")


def _listed(kind: str) -> list[str]:
    """Return the units of a kind that messages name."""
    return KINDS[kind].units.removesuffix(" and the like").split(", ")


def _dimension(unit: str) -> str | None:
    """Return the dimension of a unit as in `KINDS`, empty for other dimensions; None for an unknown unit."""
    for kind, row in KINDS.items():
        if unit in _listed(kind):
            return row.dimension
    import pint

    if not _UNIT.fullmatch(unit):
        return None
    try:
        measured, of = _registry().parse_units(_spelled(unit)).dimensionality, _registry().get_dimensionality
        return next((row.dimension for row in KINDS.values() if of(row.dimension) == measured), "")
    except (pint.PintError, *_NOT_KNOWN):
        return None


def _spelled(unit: str) -> str:
    return _DOT.sub("*", unit).replace("·", "*").replace("°", "deg")


@functools.cache
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("@alias torr = Torr")
    for name, time in (("sccm", "minute"), ("sccs", "second")):  # at 0 °C; see `fluid.throughput`
        registry.define(f"{name} = 101325 * pascal * centimeter**3 / {time}")
    return registry
