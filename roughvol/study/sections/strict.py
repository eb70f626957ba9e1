"""Strict, frozen records with the keys of a section."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar, NoReturn, Self, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, RootModel, ValidationError, model_serializer, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from roughvol.study.plain_data import KeyPath
from roughvol.study.values.types import REFUSED, refuse

T = TypeVar("T")


def refuse_at(path: KeyPath, given: Any, message: str, **context: str) -> NoReturn:
    """Raise the error of a validator with this message at a key inside its own, with the value given there."""
    details = InitErrorDetails(type=PydanticCustomError(REFUSED, message, context), loc=path, input=given)
    raise ValidationError.from_exception_data("Study", [details])


def names(*models: type[BaseModel]) -> list[str]:
    """Return the keys of these models."""
    return list(dict.fromkeys(name for model in models for name in model.model_fields))


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the records that an annotation holds, in unions and behind ``Annotated``."""
    if isinstance(annotation, type) and issubclass(annotation, RootModel):
        yield from models_in(annotation.model_fields["root"].annotation)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from models_in(argument)


def default(value: T, description: str) -> T:
    """Return the field of a key with a default."""
    return Field(default=value, description=description)


def optional(description: str) -> Any:
    """Return the field of a key that a study may leave out."""
    return Field(default=None, description=description)


class Strict(BaseModel):
    """A frozen record without unknown keys."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


class Choice(Strict):
    """A mapping with optional keys."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})
    EMPTY: ClassVar[str] = ""
    """Message for a mapping that names no key; empty where it may name none."""

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if self.EMPTY and not self.named:
            refuse(self.EMPTY, known=", ".join(names(type(self))))
        return self

    @property
    def named(self) -> dict[str, Any]:
        """Given keys and their values."""
        given = self.__dict__ | (self.model_extra or {})
        return {name: value for name, value in given.items() if value not in (None, ())}

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> Any:
        """Write the given keys alone."""
        return {name: value for name, value in handler(self).items() if name in self.named}
