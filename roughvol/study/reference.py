"""The keys of a study in words: values, default and description, from the JSON schema."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from roughvol.study.plain_data import number_text, write
from roughvol.study.study import json_schema

TYPES = {"boolean": "true or false", "number": "a number", "integer": "a whole number", "string": "text"}


@dataclass(frozen=True)
class Key:
    """A key of a study file, as ``surface.file``, with its allowed values and its meaning in words.

    ``default`` is as in a study; None where the key must be given. ``form`` is the form of its mapping, of several.
    """

    path: str
    values: str
    default: str | None
    description: str
    form: str = ""


@functools.cache
def keys() -> tuple[Key, ...]:
    """Return all keys of a study in the order of the schema, sections before their keys."""
    schema = json_schema()
    return tuple(dict.fromkeys(_keys(schema, schema["$defs"], "", "")))


def _keys(schema: Any, models: Any, path: str, form: str) -> Iterator[Key]:
    """Yield the keys of a mapping, each followed by those inside it."""
    required = schema.get("required", ())
    for name, value in schema.get("properties", {}).items():
        here = f"{path}.{name}".removeprefix(".")
        default = None if name in required else _default(value.get("default"))
        yield Key(here, _values(value, models), default, value.get("description", ""), form)
        found = list(_models(value, models))
        for _, model in found:
            words = model["description"].partition("\n")[0].rstrip(".")
            yield from _keys(model, models, here, words if len(found) > 1 else "")


def _models(schema: Any, models: Any) -> Iterator[tuple[str, Any]]:
    """Yield the mappings that a value may be, by name; one written in place has its description as name."""
    if "properties" in schema:
        yield schema.get("title") or schema.get("description", ""), schema
    for inner in _parts(schema, models):
        yield from _models(inner, models)
    if isinstance(schema.get("items"), dict):
        yield from _models(schema["items"], models)


def _parts(schema: Any, models: Any) -> list[Any]:
    """Return the schema that another one refers to, or the schemas of which a value fits one."""
    if "$ref" in schema:
        return [models[schema["$ref"].rpartition("/")[2]]]
    return [*schema.get("anyOf", ()), *schema.get("oneOf", ())]


def _values(schema: Any, models: Any) -> str:
    """Return the allowed values in words."""
    parts = list(dict.fromkeys(filter(None, _each(schema, models))))
    *single, last = parts or [""]
    if single and last == f"a list of {' or '.join(single)}":
        return f"{' or '.join(single)}; or a list of these"
    return " or ".join(parts)


def _each(schema: Any, models: Any) -> Iterator[str]:
    """Yield every form that a value may have."""
    kind = schema.get("type")
    if kind == "object":
        yield "a mapping"
    elif parts := _parts(schema, models):
        for part in parts:
            yield from _each(part, models)
    elif "const" in schema:
        yield f"'{schema['const']}'"
    elif "enum" in schema:
        yield " or ".join(f"'{value}'" for value in schema["enum"])
    elif kind == "array":
        each = [_values(inner, models) for inner in schema.get("prefixItems", ())]
        items = schema.get("items")
        yield f"[{', '.join(each)}]" if each else f"a list of {_values(items, models)}" if items else "a list"
    elif "examples" in schema:
        yield f"a number with a unit, as {schema['examples'][0]}"
    elif kind in TYPES:
        yield TYPES[kind] + _bounds(schema)


def _bounds(schema: Any) -> str:
    """Return the bounds of a number as text."""
    names = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
    bounds = [f"{sign} {number_text(schema[name])}" for name, sign in names.items() if name in schema]
    return f" {' and '.join(bounds)}" if bounds else ""


def _default(value: Any) -> str:
    """Return a default as in a study file."""
    if isinstance(value, dict):
        value = {name: inner for name, inner in value.items() if inner is not None and inner != []}
    if value is None or value in ([], {}):
        return "none"
    text = " ".join(write({"x": value}).split())
    return text.removeprefix("{").removesuffix("}").removeprefix("x: ") if text.startswith("{x:") else text[3:]
