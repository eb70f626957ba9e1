"""The section ``ensemble``: how accurate the mean over all surfaces is to be, instead of how many seeds to take."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, model_serializer, model_validator
from pydantic_core import core_schema

from roughvol.study.sections import AreaFraction, Choice, Level, Many, Positive, Seed, Word, refuse
from roughvol.study.yaml_text import number_text

STORED_AS = {"contact_area": "contact_area_fraction", "pressure": "mean_pressure"}
"""Names of stored variables where they differ from those of quantities in a study."""

SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "days": 86400.0}
TIGHTEST, WIDEST = 1e-5, 0.5  # of an accuracy: beyond, no campaign ends; and no interval means anything
PER_REQUEST = 1e-2  # residual of the solver over the accuracy asked for
LOOSEST, TIGHTEST_RTOL = 1e-3, 1e-9
COARSEST = 4  # level on which a sweep takes as long as its file: a coarser one would save nothing
FEWEST_LEVELS = 3  # beside and below a coarse m, to see whether its means converge
AUTO_FROM, AUTO_TO = 7, 12  # resolutions that `m: auto` looks at


class Accuracy(float):
    """A half-width that is absolute, or relative to the mean as 1 %."""

    relative: bool

    def __new__(cls, value: float, relative: bool) -> Accuracy:
        """Return the number, 0.01 for 1 %."""
        new = super().__new__(cls, value)
        new.relative = relative
        return new

    def __getnewargs__(self) -> tuple[Any, ...]:
        """Survive pickling."""
        return float(self), self.relative

    def __str__(self) -> str:
        """Return it as it would be in a study."""
        return f"{number_text(round(100.0 * self, 12))} %" if self.relative else number_text(float(self))

    def of(self, mean: float) -> float:
        """Return the half-width that is asked for about a mean."""
        return float(self) * abs(mean) if self.relative else float(self)


@dataclass(frozen=True)
class _Text:
    """Read a number, or text of a number and a unit, and say so in the JSON schema."""

    units: tuple[str, ...]
    bare: bool

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self._read, serialization=core_schema.plain_serializer_function_ser_schema(self._written)
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        text = {"type": "string", "pattern": rf"^[0-9.]+(e-?[0-9]+)? *({'|'.join(self.units)})$"}
        return {"anyOf": [{"type": "number", "exclusiveMinimum": 0}, text]} if self.bare else text

    @staticmethod
    def _written(value: Any) -> Any:
        return str(value) if not isinstance(value, Accuracy) or value.relative else float(value)

    def _parts(self, value: Any) -> tuple[float, str | None]:
        if self.bare and isinstance(value, int | float) and not isinstance(value, bool):
            return float(value), None
        found = (
            re.fullmatch(r"([0-9]+\.?[0-9]*(?:e[-+]?[0-9]+)?)\s*(\S+)", value.strip())
            if isinstance(value, str)
            else None
        )
        if found is None or found[2] not in self.units:
            refuse("must be {form}", form=self._form)
        return float(found[1]), found[2]

    @property
    def _form(self) -> str:
        units = f"a number > 0 with {' or '.join(self.units)} behind it"
        return f"a number > 0, or {units}" if self.bare else units

    def _read(self, value: Any) -> Any:
        return value


class _AccuracyText(_Text):
    def _read(self, value: Any) -> Accuracy:
        if isinstance(value, Accuracy):
            return value
        number, unit = self._parts(value)
        if unit is not None:
            number = round(number / 100.0, 15)
            if not TIGHTEST <= number <= WIDEST:
                refuse("must be {low} % to {high} %", low=number_text(100 * TIGHTEST), high=number_text(100 * WIDEST))
        if not (math.isfinite(number) and number > 0.0):
            refuse("must be > 0")
        return Accuracy(number, unit is not None)


class Budget(float):
    """Seconds, with the text that they were given as."""

    text: str

    def __new__(cls, value: float, text: str) -> Budget:
        """Return the seconds."""
        new = super().__new__(cls, value)
        new.text = text
        return new

    def __getnewargs__(self) -> tuple[Any, ...]:
        """Survive pickling."""
        return float(self), self.text

    def __str__(self) -> str:
        """Return it as it would be in a study."""
        return self.text


class _BudgetText(_Text):
    def _read(self, value: Any) -> Budget:
        if isinstance(value, Budget):
            return value
        number, unit = self._parts(value)
        if not (math.isfinite(number) and number > 0.0):
            refuse("must be > 0")
        return Budget(number * SECONDS[str(unit)], f"{number_text(number)} {unit}")


HalfWidth = Annotated[Accuracy, _AccuracyText(("%",), bare=True)]
_HOW = "half-width of the 95 % interval of its mean, relative as 1 % or absolute as 0.01"


class Asked(Choice):
    """The quantities whose means are asked for, each with its accuracy."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    free_volume: HalfWidth | None = Field(default=None, description=f"V*: {_HOW}")
    contact_area: HalfWidth | None = Field(default=None, description=f"A*: {_HOW}")
    pressure: HalfWidth | None = Field(default=None, description=f"p*: {_HOW}")
    separation: HalfWidth | None = Field(default=None, description=f"d/σ: {_HOW}")
    indentation: HalfWidth | None = Field(default=None, description=f"Δ/σ: {_HOW}")

    @model_validator(mode="before")
    @classmethod
    def _by_stored_name(cls, value: Any) -> Any:
        """Accept the names of the stored variables as well."""
        if not isinstance(value, dict):
            return value
        short = {stored: name for name, stored in STORED_AS.items() if name not in value}
        return {short.get(name, name): accuracy for name, accuracy in value.items()}

    @model_validator(mode="after")
    def _asks_for_something(self) -> Asked:
        if not self.named:
            refuse("names no quantity: {known}", known=", ".join(type(self).model_fields))
        return self

    @model_serializer
    def _plain(self) -> Any:
        return {name: str(value) if value.relative else float(value) for name, value in self.named.items()}


class States(Choice):
    """The states at which the accuracy must hold: the last one, or levels of one or more quantities."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    pressure: Many[Positive] = Field(default_factory=tuple, description="levels of p* > 0")
    separation: Many[float] = Field(default_factory=tuple, description="levels of d/σ")
    contact_area: Many[AreaFraction] = Field(default_factory=tuple, description="levels of A*, 0 < A* <= 1")
    indentation: Many[Positive] = Field(default_factory=tuple, description="levels of Δ/σ > 0")

    @model_serializer
    def _plain(self) -> Any:
        return {kind: list(values) for kind, values in self.named.items()} or "last"

    @property
    def levels(self) -> tuple[Level, ...]:
        """The states one by one; ``Level("last")`` alone if none is named."""
        levels = (Level(kind, value) for kind, values in self.named.items() for value in values)
        return tuple(levels) or (Level("last"),)


class Ensemble(Choice):
    """The mean over all surfaces, to an accuracy; the campaign decides how many seeds on which levels."""

    accuracy: Asked = Field(description="{free_volume: 1 %}: each quantity with the half-width of its 95 % interval")
    at: Annotated[States, Word("last")] = Field(
        default=States(),
        description="'last', or levels of pressure, separation, contact_area, indentation at which it must hold",
    )
    budget: Annotated[Budget, _BudgetText(tuple(SECONDS), bare=False)] | None = Field(
        default=None, description="time after which no further samples begin, as 10 min; what was reached is reported"
    )
    first_seed: Seed = Field(default=0, description="first seed; another one gives an independent answer")

    @model_serializer
    def _plain(self) -> Any:
        given = dict(self.named)
        return given if self.budget is None else given | {"budget": str(self.budget)}

    @property
    def tolerance(self) -> float:
        """The residual η/σ that suffices: a hundredth of the accuracy, as a power of ten.

        The power of ten lets a request that is a little tighter use the samples of another.
        """
        least = PER_REQUEST * min(self.accuracy.named.values())
        return min(max(10.0 ** math.floor(math.log10(least) + 1e-9), TIGHTEST_RTOL), LOOSEST)


def levels_below(m: int) -> tuple[int, ...]:
    """Return the resolutions that an ensemble may use.

    Parameters
    ----------
    m : int
        Finest resolution.

    Returns
    -------
    tuple of int
        Resolutions, coarsest first.
    """
    return tuple(range(max(1, min(COARSEST, m - FEWEST_LEVELS + 1)), m + 1))
