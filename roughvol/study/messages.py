"""Errors of pydantic in plain words: the key, the value given, and what is allowed."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from roughvol.study.sections.strict import models_in, names, nearest
from roughvol.study.validation import RULE, plain_path
from roughvol.study.values.state_kinds import LISTS
from roughvol.study.yaml_text import KeyPath, key_text, number_text, show

Models = Mapping[KeyPath, tuple[type[BaseModel], ...]]  # of each mapping of a study, by its place

_PLAIN = {
    "missing": "missing",
    "float_type": "must be a number",
    "list_type": "must be a list",
    "int_type": "must be a whole number",
    "string_type": "must be text (in quotes if it looks like a number)",
    "bool_type": "must be true or false",
    "model_type": "must be a mapping (key: value)",
    "greater_than": "must be > {gt}",
    "greater_than_equal": "must be >= {ge}",
    "less_than": "must be < {lt}",
    "less_than_equal": "must be <= {le}",
    "finite_number": "must be a finite number",
    "literal_error": "must be {expected}",
    "string_pattern_mismatch": "allowed: letters, digits, _, - and dots, a letter, digit or _ first",
    "string_too_long": "must have at most {max_length} characters",
}


def in_words(item: Mapping[str, Any]) -> str:
    """Return one error of pydantic in plain words, with the value given."""
    kind = item["type"]
    context = {k: number_text(v) if isinstance(v, int | float) else v for k, v in item.get("ctx", {}).items()}
    message = _PLAIN[kind].format(**context) if kind in _PLAIN else str(item["msg"])  # may hold braces
    return message if kind == "missing" else f"{message}, given {show(item['input'])}"


def translated(error: ValidationError, data: Any, study: type[BaseModel]) -> Iterator[tuple[KeyPath, str]]:
    """Yield the key path and a message in plain words for each error of pydantic on plain data of a study."""
    known = models_of(study)
    messages: list[tuple[KeyPath, str, str]] = []
    misspelt: set[KeyPath] = set()
    for item in error.errors(include_url=False):
        kind, given = item["type"], item["input"]
        path = plain_path(item["loc"], data)
        if kind == RULE:
            messages.append((plain_path(item["loc"], data, missing=True), item["msg"], item["msg"]))
            continue
        message = in_words(item)
        if kind == "missing":
            path = (*path, item["loc"][-1])
        elif kind == "extra_forbidden":
            while isinstance(path[-1], int):  # an item of a list of combinations: the key is unknown
                path = path[:-1]
            message, meant = _unknown(path, data, known)
            misspelt |= {(*path[:-1], meant)} if meant else set()
        if isinstance(given, str) and (kind == "literal_error" or item["msg"].startswith("must be ")):
            meant = nearest(given, re.findall(r"'([^']*)'", item.get("ctx", {}).get("expected", item["msg"])))
            message += f"; did you mean '{meant}'?" if meant else ""
        messages.append((path, item["msg"], message + _about(path, known)))
    for path, reason, message in messages:
        # a value that another key follows from is wrong once: the last of `pressures` is the end of the sweep
        again = any(reason == same and path == where[: len(path)] != where for where, same, _ in messages)
        # a misspelt key is not missing as well
        if path and path not in misspelt and not again:
            yield path, message


def _about(path: KeyPath, known: Models) -> str:
    """Return the description of a key in brackets, empty without one."""
    *section, name = [part for part in path if isinstance(part, str)] or [""]
    models = known.get(tuple(section), ())
    of_a_leg = len(path) > 1 and isinstance(path[1], int)  # its models follow those of a sweep without legs
    fields = (model.model_fields.get(name) for model in (reversed(models) if of_a_leg else models))
    return next((f" ({field.description})" for field in fields if field), "")


def _unknown(path: KeyPath, data: Any, of: Models) -> tuple[str, str | None]:
    """Return the message for an unknown key, and the key probably meant."""
    key, models = str(path[-1]), of[tuple(part for part in path[:-1] if isinstance(part, str))]
    known = names(*models)
    if key in known:  # a key of the other form of the mapping
        for part in path[:-1]:
            data = data[part]
        owner = next(model for model in models if key in model.model_fields)
        rivals = [f"'{name}'" for name in data if name in known and name not in owner.model_fields]
        return f"excluded by {' and '.join(rivals)}", None
    if path[-2:-1] == ("to",) and key in LISTS:
        return f"'{key}' stands in place of 'to', as sweep: {{{key}: [...]}}", None
    meant = nearest(key, known)
    homes = [key_text(section) for section, others in of.items() if key in names(*others)]
    hint = f"did you mean '{meant}'? " if meant else f"a key of '{homes[0]}'; " if homes else ""
    return f"unknown key; {hint}allowed: {', '.join(known)}", meant


def _models(*models: type[BaseModel], path: KeyPath = ()) -> Iterator[tuple[KeyPath, tuple[type[BaseModel], ...]]]:
    """Yield the key path of every mapping with its possible models."""
    yield path, models
    for model in models:
        for name, field in model.model_fields.items():
            nested = tuple(models_in(field.annotation))
            if nested:
                yield from _models(*nested, path=(*path, name))


@functools.cache
def models_of(study: type[BaseModel]) -> Models:
    """Return the possible models of every mapping of a study."""
    found: dict[KeyPath, tuple[type[BaseModel], ...]] = {}
    for path, models in _models(study):
        found[path] = tuple(dict.fromkeys((*found.get(path, ()), *models)))
    return found
