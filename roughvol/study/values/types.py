"""Types of a study: numbers in their intervals; a word, or a single item, in place of a value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, NoReturn, TypeVar

from pydantic import BaseModel, BeforeValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, PlainSerializer
from pydantic_core import PydanticCustomError, core_schema

T = TypeVar("T")

REFUSED = "refused"  # type of the error of a validator of a section


def refuse(message: str, **context: str) -> NoReturn:
    """Raise the error of a validator with this message."""
    raise PydanticCustomError(REFUSED, message, context)


def whole(value: Any) -> Any:
    """Return a number like 8.0 as an integer, other values unchanged."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _two(value: Any) -> Any:
    """Return a list of two as a tuple."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        refuse("must be a list of two, [from, to]")
    return tuple(value)


WHOLE = BeforeValidator(whole)  # behind the bounds: before them, pydantic leaves them out of the JSON schema
TWO = BeforeValidator(_two)
AS_TUPLE = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Dimension = Annotated[float, Field(gt=2, lt=3)]
Refinement = Annotated[int, Field(ge=1, le=13), WHOLE]
Seed = Annotated[int, Field(ge=0, lt=2**63), WHOLE]
Positive = Annotated[float, Field(gt=0)]
AreaFraction = Annotated[float, Field(gt=0, le=1)]
Fraction = Annotated[float, Field(ge=0, le=1)]
StepNumber = Annotated[int, Field(ge=1), WHOLE]


class Form:
    """Take other forms of a value, also in the JSON schema."""

    _read: Callable[[Any, Callable[[Any], Any]], Any]  # the value of any form
    _forms: Callable[[Any], list[Any]]  # the JSON schema of each form

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_wrap_validator_function(self._read, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        forms: list[dict[str, Any]] = self._forms(handler(schema["schema"]))
        return {"anyOf": forms} if len(forms) > 1 else forms[0]


class _OneOrMany(Form):
    """Take a value or a list of values."""

    def _forms(self, inner: Any) -> list[Any]:
        return [inner["items"], {**inner, "minItems": 1}]

    def _read(self, value: Any, inner: Callable[[Any], Any]) -> Any:
        if not isinstance(value, list | tuple):
            return inner((value,))
        if not value:
            refuse("must have at least one item")
        return inner(tuple(value))


@dataclass(frozen=True)
class Word(Form):
    """Take a word as short for a mapping. ``others`` are words that the key takes beside it, for messages."""

    word: str
    meaning: tuple[tuple[str, Any], ...] = ()
    others: tuple[str, ...] = ()

    def _forms(self, inner: Any) -> list[Any]:
        return [{"const": self.word}, inner]

    def _read(self, value: Any, inner: Callable[[Any], Any]) -> Any:
        if value == self.word:
            return inner(dict(self.meaning))
        if not isinstance(value, dict | BaseModel) or (value == {} and not self.meaning):
            words = " or ".join(f"'{word}'" for word in (*self.others, self.word))
            refuse("must be the word {words} or a mapping (key: value) that is not empty", words=words)
        return inner(value)


class _Auto(Form):
    """Take the word 'auto', which is read as no number at all."""

    def _forms(self, inner: Any) -> list[Any]:
        return [{"const": "auto"}, inner]

    def _read(self, value: Any, inner: Callable[[Any], Any]) -> Any:
        return () if value in ("auto", ()) else inner(value)


class Switch(Form):
    """Take true for the defaults of a mapping, and false for nothing."""

    def _forms(self, inner: Any) -> list[Any]:
        return [{"type": "boolean"}, inner]

    def _read(self, value: Any, inner: Callable[[Any], Any]) -> Any:
        if isinstance(value, bool):
            return inner({} if value else None)
        if not isinstance(value, dict | BaseModel | None):
            refuse("must be true, false or a mapping (key: value)")
        return inner(value)


Many = Annotated[tuple[T, ...], _OneOrMany()]
ManyOrAuto = Annotated[Many[T], _Auto(), PlainSerializer(lambda given: given or "auto")]
