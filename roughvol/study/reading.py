"""From a study file to a `Study`, or to everything that is wrong with it in plain words.

The order of the work: text to plain data with places (`yamltext`), data to records (pydantic), rules across sections
(`conflicts`, on the plain data, so that they are reported beside other problems), then all problems sorted by place.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from roughvol.errors import Problem, StudyError
from roughvol.study.cases import Places, Study, conflicts
from roughvol.study.sections import names, nearest
from roughvol.study.yaml_text import (
    MAX_BYTES,
    TOO_LARGE,
    KeyPath,
    Reading,
    UnreadableError,
    key_text,
    number_text,
    printable,
    show,
)


def load(path: str | Path) -> Study:
    """Read a study file.

    Raises
    ------
    StudyError
        With every problem of the file, in its order; also if there is no such file or it cannot be read as text.
    """
    place = printable(str(path))
    content = b""
    try:
        with Path(path).open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise StudyError([Problem(TOO_LARGE, "", None, place)])
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise StudyError([Problem("this is not text in UTF-8", "", line, place)]) from error
    except StudyError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        reason = getattr(error, "strerror", None) or error
        raise StudyError([Problem(f"cannot read the study: {reason}", "", None, place)]) from error
    return _study(text, place, Path(path))


def loads(text: str, file: str | Path = "<string>", *, stored: bool = False) -> Study:
    """Read a study from text; ``file`` names it in messages, gives its default name and the folder of height files.

    Parameters
    ----------
    text : str
        The study.
    file : str or path
        Where the text comes from.
    stored : bool
        The text is that of a file of results, see `Study.stored`: height files are not looked for, and such a study
        makes no cases.

    Raises
    ------
    StudyError
        With every problem of the text, in its order.
    """
    return _study(text, printable(str(file)), Path("study" if file == "<string>" else file), stored=stored)


def _study(text: str, place: str, path: Path, *, stored: bool = False) -> Study:
    reading = Reading()
    try:
        data = reading.read(text)
    except UnreadableError as error:
        raise StudyError([Problem(str(error), "", error.line, place)]) from error
    problems = dict(reading.problems)
    try:
        name = re.sub(r"[^A-Za-z0-9_-]+", "_", path.stem)[:100].lstrip("-") or "study"
        study = Study.model_validate({"name": name, **data}, context={"folder": path.parent, "stored": stored})
    except ValidationError as error:
        for key, message in itertools.chain(_translate(error, data), conflicts(data)):
            problems.setdefault(key, message)
        if not problems:  # a rule broken only by the rounding of numbers as long as 9007199254740993
            problems[()] = error.errors()[0]["msg"]
    if problems:
        # A missing key stands where its mapping begins.
        marks = {key: reading.marks.get(key) or reading.marks[key[:-1]] for key in problems}
        ordered = sorted(problems, key=lambda key: marks[key])
        raise StudyError([Problem(problems[key], key_text(key), marks[key][0], place) for key in ordered])
    study._places = Places(place, {key_text(key): line for key, (line, _) in reading.marks.items()})
    return study


_PLAIN = {
    "missing": "missing",
    "float_type": "must be a number",
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
    "string_pattern_mismatch": "must be made of letters, digits, _ and - (and dots, not first), and not begin with -",
    "string_too_long": "must have at most {max_length} characters",
}


def _translate(error: ValidationError, data: Any) -> Iterator[tuple[KeyPath, str]]:
    """Yield the key path and a message in plain words for each error of pydantic."""
    found: list[tuple[KeyPath, str]] = []
    misspelt: set[KeyPath] = set()
    for item in error.errors(include_url=False):
        kind, given, here = item["type"], item["input"], data
        path: KeyPath = ()
        for part in item["loc"]:  # skips the branch of a union, and the index of a value given without a list
            inside = part in here if isinstance(here, dict) else isinstance(here, list) and isinstance(part, int)
            if inside:
                path, here = (*path, part), here[part]
        context = {k: number_text(v) if isinstance(v, int | float) else v for k, v in item.get("ctx", {}).items()}
        message = _PLAIN[kind].format(**context) if kind in _PLAIN else item["msg"]  # which may hold braces of its own
        if kind == "missing":
            path = (*path, item["loc"][-1])
        elif kind == "extra_forbidden":
            message, meant = _unknown(path, data)
            misspelt |= {(*path[:-1], meant)} if meant else set()
        else:
            message += f", given {show(given)}"
        if kind == "literal_error" and isinstance(given, str):
            meant = nearest(given, re.findall(r"'([^']*)'", context["expected"]))
            message += f"; did you mean '{meant}'?" if meant else ""
        found.append((path, message + _about(path)))
    # No conflicts: the caller looks for those also where other things are wrong. A misspelt key is not also missing.
    yield from ((path, message) for path, message in found if path and path not in misspelt)


def _about(path: KeyPath) -> str:
    """Return the description of a key in brackets, or nothing if it has none."""
    *place, name = [part for part in path if isinstance(part, str)] or [""]
    fields = (model.model_fields.get(name) for model in _PLACES.get(tuple(place), ()))
    return next((f" ({field.description})" for field in fields if field), "")


def _unknown(path: KeyPath, data: Any) -> tuple[str, str | None]:
    """Return what to say of a key that is not allowed, and the key probably meant."""
    key, models = str(path[-1]), _PLACES[path[:-1]]
    known = names(*models)
    if key in known:  # it belongs to the other form of the mapping
        for part in path[:-1]:
            data = data[part]
        owner = next(model for model in models if key in model.model_fields)
        rivals = [f"'{name}'" for name in data if name in known and name not in owner.model_fields]
        return f"cannot stand beside {' and '.join(rivals)}", None
    meant = nearest(key, known)
    homes = [key_text(place) for place, others in _PLACES.items() if key in names(*others)]
    hint = f"did you mean '{meant}'? " if meant else f"it belongs under '{homes[0]}'; " if homes else ""
    return f"unknown key; {hint}known here: {', '.join(known)}", meant


def _models(*models: type[BaseModel], path: KeyPath = ()) -> Iterator[tuple[KeyPath, tuple[type[BaseModel], ...]]]:
    """Yield every key path that holds a mapping, with the models it may be."""

    def inside(annotation: Any) -> Iterator[type[BaseModel]]:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            yield annotation
        for argument in get_args(annotation):
            yield from inside(argument)

    yield path, models
    for model in models:
        for name, field in model.model_fields.items():
            nested = tuple(inside(field.annotation))
            if nested:
                yield from _models(*nested, path=(*path, name))


_PLACES = dict(_models(Study))
