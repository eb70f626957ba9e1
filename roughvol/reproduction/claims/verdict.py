"""Contents of a claim: numbers with intervals, criteria that they meet or not, and the verdict that follows by rule.

The verdict is never written down, it follows from the checks:

* **holds**: every check is met;
* **holds with a qualification**: no essential check fails, but some other does, or some check is undecided;
* **does not hold**: an essential check fails;
* **not computed**: the datasets lack what an essential check needs, or they decide no essential check.

A check of a number against a limit is met if the whole interval lies on the right side, fails if the whole interval
lies on the wrong side, and is undecided if the interval contains the limit: too few surfaces prove nothing either way.

*Essential* is what the paper's sentence says in the reading that the studies are run in; *other* is how far it
reaches: the literal wording where another reading is the default, or the adverbs ("linear", "straight", "every D").
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

HOLDS = "holds"
QUALIFIED = "holds with a qualification"
FAILS = "does not hold"
ABSENT = "not computed"
VERDICTS = (HOLDS, QUALIFIED, FAILS, ABSENT)


@dataclass(frozen=True)
class Number:
    """A computed number with its 95 % interval over n surfaces; low = high = value where there is one surface."""

    key: str
    name: str
    value: float
    low: float
    high: float
    n: int = 1
    method: str = ""

    def reaches(self, value: float, slack: float = 0.0) -> bool:
        """Return whether the interval contains a value to within its rounding."""
        return self.low <= value + slack and self.high >= value - slack

    def __str__(self) -> str:
        """Return value and interval with the digits that the interval leaves."""
        if not math.isfinite(self.value):
            return "–"
        if not self.low < self.high:
            return _text(self.value, 4)
        width = self.high - self.low
        places = max(0, 1 - math.floor(math.log10(width)))
        if places > 5 or abs(self.value) >= 1e5:
            return f"{_text(self.value, 4)} [{_text(self.low, 4)}, {_text(self.high, 4)}]"
        return f"{self.value:.{places}f} [{self.low:.{places}f}, {self.high:.{places}f}]"


@dataclass(frozen=True)
class Check:
    """One criterion in words, whether it is met (None: undecided), its number, and whether it is essential."""

    criterion: str
    met: bool | None
    number: Number | None = None
    essential: bool = True

    @property
    def has_value(self) -> bool:
        """Whether there was anything to test: a number that is one, or a criterion that needs none."""
        return self.number is None or math.isfinite(self.number.value)

    @classmethod
    def above(cls, criterion: str, number: Number, limit: float, *, essential: bool = True) -> Check:
        """Return the criterion that a number lies above a limit, undecided if its interval contains the limit."""
        return cls(criterion, above(number, limit), number, essential)

    @classmethod
    def below(cls, criterion: str, number: Number, limit: float, *, essential: bool = True) -> Check:
        """Return the criterion that a number lies below a limit, undecided if its interval contains the limit."""
        return cls(criterion, below(number, limit), number, essential)

    @classmethod
    def within(cls, criterion: str, number: Number, limits: tuple[float, float], *, essential: bool = True) -> Check:
        """Return the criterion that a number lies between two limits, undecided if its interval contains one."""
        sides = above(number, limits[0]), below(number, limits[1])
        met = False if False in sides else None if None in sides else True
        return cls(criterion, met, number, essential)

    def tested(self) -> Check:
        """Return the check, undecided where its number has no value: nothing was tested then."""
        return self if self.has_value else replace(self, met=None)


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper beside the computed numbers, the method, and one sentence (``why``) with the verdict.

    ``source`` names the runs that were used, ``refused`` the others with reasons, ``lacking`` what no run had.
    """

    id: int
    title: str
    place: str
    sentence: str
    method: str = ""
    checks: tuple[Check, ...] = ()
    numbers: tuple[Number, ...] = ()
    why: str = ""
    source: tuple[str, ...] = ()
    figures: tuple[str, ...] = ()
    lacking: str = ""
    refused: tuple[tuple[str, str], ...] = ()

    @property
    def untested(self) -> str:
        """Reason why the essential checks decide nothing, empty if there is none."""
        essential = [check for check in self.checks if check.essential]
        for check in essential:
            if not check.has_value:
                return f'no value for the criterion "{check.criterion}"'
        if essential and all(check.met is None for check in essential):
            return "the 95 % interval of every essential criterion contains its limit, more surfaces are needed"
        return ""

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`, by the rule of the module."""
        if self.lacking or self.untested or not any(check.essential for check in self.checks):
            return ABSENT
        if any(check.met is False for check in self.checks if check.essential):
            return FAILS
        return HOLDS if all(check.met for check in self.checks) else QUALIFIED

    @property
    def all_numbers(self) -> dict[str, Number]:
        """Every number by its key, those of the checks first."""
        numbers = [check.number for check in self.checks if check.number is not None]
        return {number.key: number for number in (*numbers, *self.numbers)}


@dataclass(frozen=True)
class Row:
    """One reading of an ambiguous passage, and whether its number is the paper's; None where the paper has none."""

    reading: str
    number: Number
    agrees: bool | None = None


@dataclass(frozen=True)
class Reading:
    """An ambiguity of the text: the quantity by which the readings differ, the paper's value, and a row for each."""

    topic: str
    passage: str
    quantity: str
    paper: str
    rows: tuple[Row, ...]
    decided: str


def above(number: Number, limit: float) -> bool | None:
    """Return whether a number lies above a limit, None if its interval contains the limit or there is no number."""
    if number.low > limit:
        return True
    return False if number.high <= limit else None


def below(number: Number, limit: float) -> bool | None:
    """Return whether a number lies below a limit, None if its interval contains the limit or there is no number."""
    if number.high < limit:
        return True
    return False if number.low >= limit else None


def plain(thing: Any) -> Any:
    """Return a number, check, claim or reading as plain data for JSON; a number that is not finite becomes None."""
    if isinstance(thing, Claim):
        data = {field.name: plain(getattr(thing, field.name)) for field in fields(thing)}
        numbers = plain(tuple(thing.all_numbers.values()))
        return data | {"verdict": thing.verdict, "numbers": numbers, "refused": dict(thing.refused)}
    if isinstance(thing, Check):
        key = thing.number.key if thing.number else None
        return {"criterion": thing.criterion, "met": thing.met, "essential": thing.essential, "number": key}
    if isinstance(thing, Number | Reading | Row):
        return {field.name: plain(getattr(thing, field.name)) for field in fields(thing)}
    if isinstance(thing, list | tuple):
        return [plain(item) for item in thing]
    return None if isinstance(thing, float) and not math.isfinite(thing) else thing


def _text(value: float, digits: int) -> str:
    return f"{value:.{digits}g}".replace("e-0", "e-").replace("e+0", "e")
