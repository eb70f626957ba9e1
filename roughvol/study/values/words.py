"""Types of a study that take a word, or a single item, in place of a value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, NoReturn, TypeVar

from pydantic import BaseModel, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import PydanticCustomError, core_schema

T = TypeVar("T")


def refuse(message: str, **context: str) -> NoReturn:
    """Raise the error of a validator with this message."""
    raise PydanticCustomError("refused", message, context)


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


class Auto:
    """Accept the word 'auto', which is read as no number at all, and say so in the JSON schema."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_wrap_validator_function(
            lambda value, inner: () if value in ("auto", ()) else inner(value), handler(source)
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"const": "auto"}, handler(schema["schema"])]}


class Switch:
    """Accept true for the defaults of a mapping and false for nothing, and show both in the JSON schema."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(self._spelled_out, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"type": "boolean"}, handler(schema["schema"])]}

    @staticmethod
    def _spelled_out(value: Any) -> Any:
        if isinstance(value, bool):
            return {} if value else None
        if not isinstance(value, dict | BaseModel | None):
            refuse("must be true, false or a mapping (key: value)")
        return value


Many = Annotated[tuple[T, ...], _OneOrMany()]
