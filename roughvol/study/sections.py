"""The sections of a study as strict, frozen records.

The description of a field has its allowed values: the JSON schema and error messages show it. Lengths and heights have
one unit, moduli and hardness another; a number may have its own (``100 um``, ``210 GPa``). Levels of a sweep are
dimensionless: ``indentation`` Δ/σ, ``separation`` d/σ, ``contact_area`` A*, ``pressure`` p* = mean(p) L/(E* σ).
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NoReturn, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from roughvol.study.units import Length, Quantity, Starred, UnitOf, unit_of
from roughvol.study.yaml_text import KeyPath, number_text
from roughvol.surfaces.length_units import factor

ACCURACY = {"draft": 1e-3, "standard": 1e-6, "reference": 1e-9}
"""Bound of the residual η/σ for each accuracy."""

EXPECTED = {"draft": (4e-4, 8e-4, 9e-5), "standard": (2e-5, 2e-6, 3e-8), "reference": (0.0, 2e-9, 2e-10)}
"""Largest errors of A*, p* (relative) and V*, rounded up, from `roughvol tradeoff configs/tradeoff.yaml`.

That of A* at standard is one element of m = 8. Other surfaces differ by a factor of a few. η/σ is a bound for V*.
"""

LOOSEST = 1e-2  # residual η/σ; a sweep with a looser one costs more, since its steps start from poor states
PAPER_MAX_M = 6  # the paper's algorithm has a dense matrix of 4^m rows
MAX_SEEDS = 10_000

T = TypeVar("T")


def refuse(message: str, **context: str) -> NoReturn:
    """Raise the error of a validator with this message."""
    raise PydanticCustomError("refused", message, context)


def refuse_at(path: KeyPath, given: Any, message: str, **context: str) -> NoReturn:
    """Raise the error of a validator with this message at a key inside its own, with the value given there."""
    kind, title = "refused", "Study"
    details = InitErrorDetails(type=PydanticCustomError(kind, message, context), loc=path, input=given)
    raise ValidationError.from_exception_data(title, [details])


def names(*models: type[BaseModel]) -> list[str]:
    """Return the keys of these models."""
    return list(dict.fromkeys(name for model in models for name in model.model_fields))


def nearest(word: str, known: list[str]) -> str | None:
    """Return the known word most similar to ``word``, ignoring case; None without one."""
    lower = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word.lower(), lower, n=1, cutoff=0.65)
    return lower[close[0]] if close else None


class _OneOrMany:
    """Accept a value or a list of values, also in the JSON schema."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(self._listed, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        many = handler(schema["schema"])
        return {"anyOf": [many["items"], {**many, "minItems": 1}]}

    @staticmethod
    def _listed(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple):
            return (value,)
        if not value:
            refuse("must have at least one item")
        return tuple(value)


@dataclass(frozen=True)
class Word:
    """Accept one word as short for a mapping, also in the JSON schema."""

    word: str
    meaning: tuple[tuple[str, Any], ...] = ()

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(self._spelled_out, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"const": self.word}, handler(schema["schema"])]}

    def _spelled_out(self, value: Any) -> Any:
        if value == self.word:
            return dict(self.meaning)
        if not isinstance(value, dict | BaseModel) or (value == {} and not self.meaning):
            refuse("must be the word '{word}' or a mapping (key: value) that is not empty", word=self.word)
        return value


def whole(value: Any) -> Any:
    """Return a number like 8.0 as an integer, other values unchanged."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


Whole = Annotated[int, BeforeValidator(whole)]
Many = Annotated[tuple[T, ...], _OneOrMany()]
Dimension = Annotated[float, Field(gt=2, lt=3)]
Refinement = Annotated[Whole, Field(ge=1, le=13)]
Seed = Annotated[Whole, Field(ge=0, lt=2**63)]
Positive = Annotated[float, Field(gt=0)]
AreaFraction = Annotated[float, Field(gt=0, le=1)]
Fraction = Annotated[float, Field(ge=0, le=1)]
StepNumber = Annotated[Whole, Field(ge=1)]
LengthUnit = Annotated[str, UnitOf("length")]
HeightsUnit = Annotated[str, UnitOf("length", counts=True)]
UNIT = "unit of L, of the heights and of stored lengths; default: none"


class Auto:
    """Accept the word 'auto', which is read as no number at all, and say so in the JSON schema."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_wrap_validator_function(
            lambda value, inner: () if value in ("auto", ()) else inner(value), handler(source)
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"const": "auto"}, handler(schema["schema"])]}


class Strict(BaseModel):
    """A frozen record without unknown keys."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


def count_in_schema(schema: dict[str, Any]) -> None:
    """Write the bounds of a number of seeds into a JSON schema."""
    schema["anyOf"][0] = {"type": "integer", "minimum": 1, "maximum": MAX_SEEDS}  # a number of seeds


def counted(value: Any) -> Any:
    """Return the seeds 0 … n - 1 for a number n of seeds, other values unchanged."""
    value = whole(value)
    if not isinstance(value, int) or isinstance(value, bool):
        return value
    if not 1 <= value <= MAX_SEEDS:
        refuse("a number of seeds must be 1 to {most}", most=str(MAX_SEEDS))
    return tuple(range(value))


class GeneratedSurface(Strict):
    """Surfaces by random midpoint displacement; every combination of D, m and seed is a case."""

    D: Many[Dimension] = Field(description="fractal dimension of the generated surface, 2 < D < 3; a number or a list")
    m: Annotated[Many[Refinement], Auto()] = Field(
        description="2^m + 1 nodes per side, whole, 1 <= m <= 13; a number or a list; 'auto' for an ensemble"
    )
    L: Length = Field(default=100.0, description="lateral size, L > 0, as 100 or 100 um")
    seeds: Many[Seed] = Field(
        default=10,
        validate_default=True,
        json_schema_extra=count_in_schema,
        description=f"number of seeds, 1 to {MAX_SEEDS} (10: seeds 0 to 9), or a list of seeds >= 0",
    )
    midpoint_law: Literal["std", "variance"] = Field(
        default="std", description="quantity divided by 2^((3-D)/2) in each half step: 'std' or 'variance'"
    )
    periodic: bool = Field(
        default=False,
        description="true: the surface is one period of a plane, without a repeated edge, on a periodic half space; "
        "L is the period; 2^m nodes per side",
    )
    unit: LengthUnit | None = Field(default=None, description=UNIT)
    Sq: Length | None = Field(
        default=None,
        description="root mean square of the stored heights, > 0, with its unit or in that of L; default: not scaled",
    )

    @property
    def length_unit(self) -> str | None:
        """Unit of all lengths; None for an arbitrary one."""
        return unit_of(self.L) or self.unit

    @property
    def height(self) -> float | None:
        """Sq of the scaled heights in the unit of L; None if they are not scaled."""
        given = unit_of(self.Sq)
        if self.Sq is None or given is None or self.length_unit is None:
            return self.Sq
        return float(self.Sq) * factor(given, self.length_unit)

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> dict[str, Any]:
        """Write 'auto' where an ensemble chooses m."""
        data: dict[str, Any] = handler(self)
        return data if self.m else data | {"m": "auto"}

    @property
    def dimensions(self) -> tuple[float, ...]:
        """All D."""
        return self.D

    _count = field_validator("seeds", mode="before")(counted)


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


class Choice(Strict):
    """A mapping with optional keys."""

    @property
    def named(self) -> dict[str, Any]:
        """Given keys and their values."""
        return {name: value for name, value in self.__dict__.items() if value not in (None, ())}

    @model_serializer
    def _plain(self) -> Any:
        return {name: str(value) if isinstance(value, Quantity) else value for name, value in self.named.items()}


# The form of a mapping: only its problems are reported.


def tag_surface(value: Any) -> str:
    """Return the tag of `height_file.HeightFile` for keys of a file, else that of `GeneratedSurface`."""
    if not isinstance(value, dict):
        return "<generated>" if isinstance(value, GeneratedSurface) else "<file>"
    hints = not {"D", "m"} & value.keys() and any(nearest(key, ["file", "variable"]) for key in value)
    return "<file>" if {"file", "files"} & value.keys() or hints else "<generated>"


class MaxError(Choice):
    """Largest allowed errors of any state. The solver ends each state as soon as they are certified."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    free_volume: Annotated[float, Field(ge=1e-12, le=1e-1)] | None = Field(
        default=None, description="largest error of V* at any state, 1e-12 to 1e-1"
    )
    mean_pressure: Annotated[float, Field(ge=1e-9, le=1e-1)] | None = Field(
        default=None, description="largest relative error of p* at any state, 1e-9 to 1e-1"
    )

    @model_validator(mode="after")
    def _not_empty(self) -> MaxError:
        if not self.named:
            refuse("must name free_volume or mean_pressure")
        return self


class Solver(Strict):
    """Accuracy, kernel and method of the solver."""

    accuracy: Literal["draft", "standard", "reference"] = Field(
        default="standard",
        description=f"bound on the residual η/σ: {', '.join(f'{k} {v:g}' for k, v in ACCURACY.items())}",
    )
    rtol: Annotated[float, Field(ge=1e-12, le=1e-1)] | None = Field(
        default=None, description="bound on the residual η/σ, 1e-12 to 1e-1; overrides accuracy"
    )
    max_error: MaxError | None = Field(
        default=None, description="{free_volume, mean_pressure}: largest errors allowed; instead of accuracy and rtol"
    )
    kernel: Literal["love", "punch", "fourier"] = Field(
        default="love",
        description="influence of an element: 'love' (uniform pressure) or 'punch' (rigid circular punch); 'fourier' "
        "(waves of the grid alone) on a periodic surface",
    )
    method: Literal["fast", "paper"] = Field(
        default="fast", description=f"'fast', or 'paper': the paper's dense Algorithm 1, for m <= {PAPER_MAX_M}"
    )

    @property
    def tolerance(self) -> float:
        """Bound of η/σ: ``rtol``, else the error of V* in ``max_error``, else that of ``accuracy``.

        η/σ bounds the error of V*, so the largest residual allowed is the error allowed.
        """
        if self.rtol is not None:
            return self.rtol
        if self.max_error is not None:
            return min(self.max_error.free_volume or LOOSEST, LOOSEST)
        return ACCURACY[self.accuracy]

    @property
    def pressure_error(self) -> float | None:
        """Bound of the relative error of p*; None without one."""
        return self.max_error.mean_pressure if self.max_error else None

    @model_validator(mode="after")
    def _one_of(self) -> Solver:
        if self.max_error is not None and (self.rtol is not None or self.accuracy != "standard"):
            refuse("give only one of accuracy, rtol and max_error")
        if self.max_error is not None and self.method == "paper" and self.max_error.mean_pressure is not None:
            refuse("max_error.mean_pressure needs method fast")
        return self
