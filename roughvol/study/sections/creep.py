"""A creep law: the compliance of a body over time under constant stress, over that of the study's modulus.

J(t)/J(0) is what a load held for the time t deforms, over what it deforms at once. One of three forms is given:

    prony: {shares: [0.3, 0.2], times: [10 s, 1 h]}           1 + Σ shares (1 - exp(-t/times))
    power: {exponent: 0.1, time: 1 s}                         1 + (t/time)^exponent
    table: {times: [1 s, 1 h, 1 day], ratios: [1, 1.2, 1.5]}  log-log lines between the times; or moduli: [10 MPa, …]

The modulus of the study belongs to J(0). Poisson's ratio is constant.

A study with ``material: {E, nu, against: {E, nu}}`` has two elastic bodies, and the law names the body that creeps:

    body: first                                               E and nu creep, against does not; second: the other way
    body: both                                                both creep by this law

The compliance of the contact is the sum of both, 1/E* = (1-ν₁²)/E₁ + (1-ν₂²)/E₂. A body that creeps has its term times
J(t)/J(0). A study with ``material: {E_star}`` has the sum alone, and all of it creeps, or a part that the law gives:

    share: 0.6                                                the term of the body that creeps over 1/E*
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

from pydantic import Field, model_validator

from roughvol.study.plain_data import Arguments, KeyPath, Places, Reading, UnreadableError, printable, text_in, write
from roughvol.study.python_data import check_type, plain, refused, text_of_value
from roughvol.study.sections.material import ContactModulus, YoungPoisson
from roughvol.study.sections.strict import Strict, optional
from roughvol.study.validation import read_as
from roughvol.study.values.types import Positive, refuse
from roughvol.study.values.units import In, Time, convert, in_unit, read, unit_of

Modulus = Annotated[Positive, In("pressure", needed=True)]
ARGUMENTS = Arguments("creep", {"": "argument law"})
_PER_DECADE = 4  # times of a range, each decade
_MOST = 1000


class Prony(Strict):
    """A sum of exponential approaches."""

    shares: list[Annotated[float, Field(ge=0)]] = Field(min_length=1, description="final shares of J over J(0), >= 0")
    times: list[Time] = Field(min_length=1, description="retardation times, as 10 s")

    @model_validator(mode="after")
    def _pairs(self) -> Prony:
        if len(self.shares) != len(self.times):
            refuse("needs as many times as shares")
        return self


class Power(Strict):
    """A power of time."""

    exponent: Annotated[float, Field(gt=0, le=1)] = Field(description="exponent, 0 < n <= 1")
    time: Time = Field(description="time at which J has doubled, as 1 s")


class Table(Strict):
    """Compliances or moduli at given times."""

    times: list[Time] = Field(min_length=2, description="times, rising, as 1 s")
    ratios: list[Positive] | None = optional("J(t)/J(0), >= 1, not falling")
    moduli: list[Modulus] | None = optional("1/J(t), not rising, with units")

    @model_validator(mode="after")
    def _orders(self) -> Table:
        given = self.ratios if self.ratios is not None else self.moduli
        if (self.ratios is None) == (self.moduli is None) or given is None:
            refuse("needs ratios or moduli")
        if len(given) != len(self.times):
            refuse("needs one value for each time")
        seconds = [_seconds(time) for time in self.times]
        if any(later <= earlier for earlier, later in itertools.pairwise(seconds)):
            refuse("times must rise")
        if self.ratios is not None and self.ratios[0] < 1.0:
            refuse("ratios are J(t)/J(0), which is 1 at once; allowed: >= 1")
        values = given if self.ratios is not None else [-in_unit(value, "Pa") for value in given]
        if any(later < earlier for earlier, later in itertools.pairwise(values)):
            refuse("the compliance must not fall: the contact would recede")
        return self


class Creep(Strict):
    """A creep law."""

    prony: Prony | None = optional("{shares, times}: 1 + sum of shares (1 - exp(-t/times))")
    power: Power | None = optional("{exponent, time}: 1 + (t/time)^exponent")
    table: Table | None = optional("{times, ratios} or {times, moduli}")
    body: Literal["first", "second", "both"] | None = optional(
        "the body that creeps, of two; second is material.against"
    )
    share: Annotated[float, Field(gt=0, le=1)] | None = optional(
        "share of 1/E* that creeps, 0 < share <= 1, for a study with material.E_star; default: 1"
    )

    @model_validator(mode="after")
    def _one_form(self) -> Creep:
        if sum(form is not None for form in (self.prony, self.power, self.table)) != 1:
            refuse("needs one of prony, power, table")
        return self

    def ratio(self, seconds: float, material: ContactModulus | YoungPoisson) -> float:
        """Return the compliance 1/E* of the contact after a time under load [s] over that at once.

        It is J(t)/J(0) of one body, or of E*. With a second body it is 1 + share (J(t)/J(0) - 1), where the share of
        1/E* is that of the body that creeps. It is ≥ 1 but for moduli above that of the study. A `StudyError`: a table
        does not hold the time, moduli cannot be compared, or ``body`` does not fit the material.
        """
        return 1.0 + self._share(material) * (self._of_body(seconds, material) - 1.0)

    def words(self, material: ContactModulus | YoungPoisson) -> str:
        """Return which body creeps and its share, as ``the first body (E, nu) creeps, 0.62 of 1/E*``."""
        share = self._share(material)
        if isinstance(material, ContactModulus):
            return f"{share:.3g} of 1/E* creeps" if share < 1.0 else "all of 1/E* creeps"
        if material.against is None:
            return "the body of E and nu creeps, against a rigid face"
        if self.body == "both":
            return "both bodies creep"
        own = "first body (E, nu)" if self.body == "first" else "second body (against)"
        return f"the {own} creeps, {share:.3g} of 1/E*"

    def _share(self, material: ContactModulus | YoungPoisson) -> float:
        """Return the share of 1/E* that creeps."""
        two = isinstance(material, YoungPoisson) and material.against is not None
        if self.share is not None and not isinstance(material, ContactModulus):
            _refuse("is for a study with material.E_star; of E and nu, the share follows from them", "share")
        if two and self.body is None:
            _refuse("missing: both bodies are elastic; allowed: first (E, nu), second (against), both", "body")
        if not two and self.body == "second":
            _refuse("is second, and the study has no material.against; allowed: none, first", "body")
        if not two or self.body == "both":
            return self.share or 1.0
        assert isinstance(material, YoungPoisson)
        first = material.contact_modulus * (1.0 - material.nu**2) / float(material.E)
        return first if self.body == "first" else 1.0 - first

    def _of_body(self, seconds: float, material: ContactModulus | YoungPoisson) -> float:
        """Return J(t)/J(0) of the body that creeps."""
        if self.prony is not None:
            pairs = zip(self.prony.shares, self.prony.times, strict=True)
            return 1.0 - math.fsum(share * math.expm1(-seconds / _seconds(time)) for share, time in pairs)
        if self.power is not None:
            return 1.0 + float((seconds / _seconds(self.power.time)) ** self.power.exponent)
        assert self.table is not None
        return self._of_table(self.table, seconds, material)

    def _of_table(self, table: Table, seconds: float, material: ContactModulus | YoungPoisson) -> float:
        times = [_seconds(time) for time in table.times]
        if not times[0] * (1 - 1e-12) <= seconds <= times[-1] * (1 + 1e-12):
            message = f"the creep table ends at {table.times[0]} and {table.times[-1]}; the time is {seconds:.6g} s"
            _refuse(message, "table.times")
        if table.ratios is not None:
            ratios = [float(value) for value in table.ratios]
        else:
            own = self._modulus_at_once(material)
            ratios = [own / in_unit(value, "Pa") for value in table.moduli or ()]
        k = max(1, next((n for n, time in enumerate(times) if time >= seconds), len(times) - 1))
        share = math.log(max(seconds, times[0]) / times[k - 1]) / math.log(times[k] / times[k - 1])
        return math.exp((1.0 - share) * math.log(ratios[k - 1]) + share * math.log(ratios[k]))

    def _modulus_at_once(self, material: ContactModulus | YoungPoisson) -> float:
        """Return the modulus of the body that creeps, as the study has it [Pa]."""
        own = getattr(material, material.MODULUS)
        if isinstance(material, YoungPoisson) and self.body == "second" and material.against is not None:
            own = material.against.E
        unit = unit_of(own) or material.unit
        if unit is None or self.body == "both":
            _refuse("moduli are those of one body whose modulus has a unit; allowed: ratios", "table.moduli")
        return convert(float(own), unit, "Pa")


def _refuse(message: str, key: str) -> NoReturn:
    """Raise the problem of a key of a law beside the study."""
    raise refused(message, key, file="creep law")


def load_creep(given: str | Path | Mapping[str, Any]) -> Creep:
    """Return the creep law of a YAML file, or of a mapping with its keys.

    Parameters
    ----------
    given : path or mapping
        The file, or the law.

    Returns
    -------
    Creep
        The law.
    """
    check_type(given, (str, os.PathLike, Mapping), "a creep law is a mapping or the path of its file", refused)
    reading = Reading("a creep law is a mapping (key: value) with one of prony, power, table")
    problems: dict[KeyPath, str] = {}
    file, arguments = ("", ARGUMENTS) if isinstance(given, Mapping) else (str(given), None)
    try:
        text = write(plain(given, problems)) if isinstance(given, Mapping) else text_in(given, "the creep law")
        data = reading.read(text)
    except UnreadableError as error:
        raise refused(str(error), line=error.line, file=printable(file)) from error
    return read_as(Creep, data, problems | reading.problems, Places(file, reading.marks, arguments))


def read_times(times: Any) -> list[float]:
    """Return times in seconds.

    Parameters
    ----------
    times : str, sequence or Quantity
        A range, as ``1 s..10 day``, or a list, as ``1 s, 1 h, 1 day`` or ``["1 s", "1 h"]``.

    Returns
    -------
    list of float
        Times [s], rising; four each decade of a range, with its ends.
    """
    listed = text_of_value(times, "times")
    text = ", ".join(listed) if isinstance(listed, list) else listed
    first, dots, last = text.rpartition("..")
    try:
        given = [_seconds(read(part.strip(), "time")) for part in ((first, last) if dots else text.split(","))]
    except ValueError as error:
        message = f"times are {text!r}; allowed: a range as '1 s..10 day', or a list as '1 s, 1 h' ({error})"
        raise refused(message) from error
    if min(given) <= 0.0 or any(later <= earlier for earlier, later in itertools.pairwise(given)):
        raise refused(f"times are {text!r}; allowed: > 0, rising")
    if not dots:
        return given
    decades = math.log10(given[1]) - math.log10(given[0])
    count = min(_MOST, max(2, math.ceil(_PER_DECADE * decades) + 1))
    inner = (10.0 ** (math.log10(given[0]) + decades * k / (count - 1)) for k in range(1, count - 1))
    return [given[0], *inner, given[1]]


def _seconds(time: float) -> float:
    """Return a time in seconds; a plain number is one already."""
    return float(in_unit(time, "s"))
