"""The sections of a study as strict, frozen records.

The description of each field goes into the JSON schema and into the error messages, so it says what is allowed.
Lengths (``L``, ``Sq``) come in any unit, the same as the heights; moduli and hardness in any unit, the same for both;
each may name its own (``100 um``, ``210 GPa``). Whatever
a sweep or a selector names is dimensionless: ``indentation`` Δ/σ, ``separation`` d/σ, ``contact_area`` A* (fraction of
the elements in contact), ``pressure`` p* = mean(p) L/(E* σ).
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NoReturn, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from roughvol.study.units import Length, UnitOf, unit_of
from roughvol.study.yaml_text import number_text
from roughvol.surfaces.length_units import factor

ACCURACY = {"draft": 1e-3, "standard": 1e-6, "reference": 1e-9}
"""Bound on the residual η/σ of each solve that an accuracy stands for."""

EXPECTED = {"draft": (4e-4, 8e-4, 9e-5), "standard": (2e-5, 2e-6, 3e-8), "reference": (0.0, 2e-9, 2e-10)}
"""Largest errors of A*, of p* (relative) and of V* that `roughvol tradeoff configs/tradeoff.yaml` finds at each,
rounded up; that of A* at standard to one element of m = 8.

Other surfaces and sweeps differ by a factor of a few; what is certain are the bounds, of V* the η/σ itself.
"""

LOOSEST = 1e-2  # residual η/σ beyond which a sweep costs more, not less: it starts every step from a poor state
PAPER_MAX_M = 6  # the paper's algorithm holds a dense matrix of 4^m rows
MAX_SEEDS = 10_000

T = TypeVar("T")


def refuse(message: str, **context: str) -> NoReturn:
    """Refuse a value from within a validator, in our own words."""
    kind = "refused"
    raise PydanticCustomError(kind, message, context)


def names(*models: type[BaseModel]) -> list[str]:
    """Return the keys that a mapping of one of these models may have."""
    return list(dict.fromkeys(name for model in models for name in model.model_fields))


def nearest(word: str, known: list[str]) -> str | None:
    """Return the known word that ``word`` probably means, whatever its case."""
    lower = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word.lower(), lower, n=1, cutoff=0.65)
    return lower[close[0]] if close else None


def without_unused(data: dict[str, Any], *later: str) -> dict[str, Any]:
    """Leave out of a section the keys that came later where they are not used, so that stored studies stay equal."""
    return {name: value for name, value in data.items() if value is not None or name not in later}


class _OneOrMany:
    """Accept one value where a list is meant, and say so in the JSON schema."""

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
    """Accept one word as short for a mapping, and say so in the JSON schema."""

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
    """Return the integer that a number like 8.0 is, anything else as it is."""
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
UNIT = "unit of L and of the heights, for the units of what is stored; they stay without one if left out"


class _Auto:
    """Accept the word 'auto', which is read as no number at all, and say so in the JSON schema."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_wrap_validator_function(
            lambda value, inner: () if value in ("auto", ()) else inner(value), handler(source)
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"const": "auto"}, handler(schema["schema"])]}


class Strict(BaseModel):
    """A frozen record that takes nothing it does not know."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


def _count_in_schema(schema: dict[str, Any]) -> None:
    schema["anyOf"][0] = {"type": "integer", "minimum": 1, "maximum": MAX_SEEDS}  # a number counts the seeds


class GeneratedSurface(Strict):
    """Surfaces made by random midpoint displacement: every combination of D, m and seed is a case."""

    D: Many[Dimension] = Field(description="fractal dimension of the generated surface, 2 < D < 3; a number or a list")
    m: Annotated[Many[Refinement], _Auto()] = Field(
        description="2^m + 1 nodes per side, whole, 1 <= m <= 13; a number or a list; 'auto' for an ensemble"
    )
    L: Length = Field(default=100.0, description="lateral size, L > 0, as 100 or with its unit as 100 um")
    seeds: Many[Seed] = Field(
        default=10,
        validate_default=True,
        json_schema_extra=_count_in_schema,
        description=f"how many seeds, 1 to {MAX_SEEDS} (10 means seeds 0 to 9), or a list of seeds >= 0",
    )
    midpoint_law: Literal["std", "variance"] = Field(
        default="std", description="what each half step divides by 2^((3-D)/2): 'std' or 'variance' of the displacement"
    )
    unit: LengthUnit | None = Field(default=None, description=UNIT)
    Sq: Length | None = Field(
        default=None,
        description="root mean square height > 0 to which the heights stored are scaled, with its unit or in that of L",
    )

    @property
    def length_unit(self) -> str | None:
        """Unit of L, of the heights and of all lengths stored; None for an arbitrary one."""
        return unit_of(self.L) or self.unit

    @property
    def height(self) -> float | None:
        """The Sq of the heights in the unit of L, None if it is as random midpoint displacement makes it."""
        given = unit_of(self.Sq)
        if self.Sq is None or given is None or self.length_unit is None:
            return self.Sq
        return float(self.Sq) * factor(given, self.length_unit)

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> dict[str, Any]:
        """Leave out what came later where it is not used."""
        data = without_unused(handler(self), "unit", "Sq")
        return data if self.m else data | {"m": "auto"}

    @field_validator("seeds", mode="before")
    @classmethod
    def _counted(cls, value: Any) -> Any:
        value = whole(value)
        if not isinstance(value, int) or isinstance(value, bool):
            return value
        if not 1 <= value <= MAX_SEEDS:
            refuse("must be 1 to {most} when it counts the seeds", most=str(MAX_SEEDS))
        return tuple(range(value))


@dataclass(frozen=True)
class Level:
    """A state of a sweep: ``last``, a plane (value None), a step, or where a number reaches a value."""

    kind: str
    value: float | None = None

    @property
    def label(self) -> str:
        """Name of the state in datasets: ``last``, ``step=60``, ``contact_area=0.1``."""
        return self.kind if self.value is None else f"{self.kind}={number_text(self.value)}"


class Choice(Strict):
    """A mapping of which only the keys given count."""

    @property
    def named(self) -> dict[str, Any]:
        """The keys given and their values."""
        return {name: value for name, value in self.__dict__.items() if value not in (None, ())}

    @model_serializer
    def _plain(self) -> Any:
        return self.named


class Target(Choice):
    """The state at which a sweep ends, by one of its starred values."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    percolation: Literal["x", "y", "both"] | None = Field(
        default=None, description="end where void leads no more from side to side: along 'x', along 'y', along 'both'"
    )
    indentation: Positive | None = Field(default=None, description="end at this Δ/σ > 0")
    contact_area: AreaFraction | None = Field(default=None, description="end at this A*, 0 < A* <= 1")
    pressure: Positive | None = Field(default=None, description="end at this p* > 0")
    separation: float | None = Field(default=None, description="end at this d/σ, negative beyond the mean plane")


def _tag_to(value: Any) -> str:
    return "<state>" if isinstance(value, dict | Target) or value == "percolation" else "<plane>"


# Which form of a mapping is meant, so that only that form's problems are reported.


def tag_surface(value: Any) -> str:
    """Return the tag of `measured.HeightFile` if the keys speak of a file, else that of `GeneratedSurface`."""
    if not isinstance(value, dict):
        return "<generated>" if isinstance(value, GeneratedSurface) else "<file>"
    hints = not {"D", "m"} & value.keys() and any(nearest(key, ["file", "variable"]) for key in value)
    return "<file>" if "file" in value or hints else "<generated>"


class Sweep(Strict):
    """How far the half space is pressed down, in how many equal steps of indentation."""

    steps: Annotated[Whole, Field(ge=0, le=10_000)] = Field(
        default=60, description="number of equal steps of indentation, 0 to 10000; 0 means no contact at all"
    )
    to: Annotated[
        Annotated[Literal["mean-plane", "summit-plane"], Tag("<plane>")]
        | Annotated[Target, Word("percolation", (("percolation", "both"),)), Tag("<state>")],
        Discriminator(_tag_to),
    ] = Field(
        default="mean-plane",
        description="where the sweep ends: mean-plane, summit-plane, percolation (no open way left), or one of "
        "{percolation: x|y|both}, {indentation: x}, {contact_area: x}, {pressure: x}, {separation: x}",
    )

    @property
    def target(self) -> Level:
        """Where the sweep ends: a plane or the end of percolation (value None), or a starred value."""
        if isinstance(self.to, str):
            return Level(self.to)
        kind, value = next(iter(self.to.named.items()))
        return Level(f"{kind}-{value}") if kind == "percolation" else Level(kind, value)


class MaxError(Choice):
    """Errors that no state may exceed; the solver goes as far as it must to certify them, and no further."""

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
    """How, and how accurately, the contact is solved."""

    accuracy: Literal["draft", "standard", "reference"] = Field(
        default="standard",
        description=f"bound on the residual η/σ: {', '.join(f'{k} {v:g}' for k, v in ACCURACY.items())}",
    )
    rtol: Annotated[float, Field(ge=1e-12, le=1e-1)] | None = Field(
        default=None, description="bound on the residual η/σ, 1e-12 to 1e-1, in place of that of accuracy"
    )
    max_error: MaxError | None = Field(
        default=None, description="{free_volume, mean_pressure}: errors to stay below, in place of an accuracy"
    )
    kernel: Literal["love", "punch"] = Field(
        default="love",
        description="influence of an element: 'love' (uniform pressure) or 'punch' (rigid circular punch)",
    )
    method: Literal["fast", "paper"] = Field(
        default="fast", description=f"'fast', or 'paper': the paper's dense Algorithm 1, for m <= {PAPER_MAX_M}"
    )

    @property
    def tolerance(self) -> float:
        """The bound on η/σ in force: ``rtol``, else what ``max_error`` asks of V*, else that of ``accuracy``.

        η/σ bounds the error of V* itself, so the largest residual allowed is the error allowed.
        """
        if self.rtol is not None:
            return self.rtol
        if self.max_error is not None:
            return min(self.max_error.free_volume or LOOSEST, LOOSEST)
        return ACCURACY[self.accuracy]

    @property
    def pressure_error(self) -> float | None:
        """The bound on the relative error of p*, if one is asked for."""
        return self.max_error.mean_pressure if self.max_error else None

    @model_validator(mode="after")
    def _one_of(self) -> Solver:
        if self.max_error is not None and {"rtol", "accuracy"} & self.model_fields_set:
            given = self.rtol is not None or self.accuracy != "standard"
            if given:
                refuse("give one of accuracy, rtol and max_error")
        if self.max_error is not None and self.method == "paper" and self.max_error.mean_pressure is not None:
            refuse("max_error.mean_pressure is certified by method fast only")
        return self

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> dict[str, Any]:
        """Leave out what came later where it is not used."""
        return without_unused(handler(self), "max_error")
