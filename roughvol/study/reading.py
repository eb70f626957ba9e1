"""From a study file to a `Study`, or to all its problems.

Text becomes plain data with line numbers (`yaml_text`), then records (pydantic). `validation` adds the
broken rules across sections. All problems are sorted by line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, RootModel, ValidationError

from roughvol.errors import Problem, StudyError
from roughvol.study.plain_data import plain
from roughvol.study.sections.strict import names, nearest
from roughvol.study.study import Places, Study
from roughvol.study.validation import RULE, plain_path
from roughvol.study.values.state_kinds import LISTS
from roughvol.study.yaml_text import (
    MAX_BYTES,
    TOO_LARGE,
    Arguments,
    KeyPath,
    Reading,
    UnreadableError,
    key_text,
    number_text,
    printable,
    show,
    write,
)

NO_FILES = ("<string>", "<stdin>")
SET = "--set"  # the option, in place of a file
RESULTS, RUNS = (".nc",), (".", "runs")  # suffix of results, and folders of runs
STUDY = Arguments("run", {"": "study"})


def load(path: str | Path, changes: Sequence[str] = ()) -> Study:
    """Read a study file.

    Parameters
    ----------
    path : str or Path
        A YAML file.
    changes : sequence of str
        Keys set to other values, as ``surface.m=6``.

    Returns
    -------
    Study
        The frozen study.

    Raises
    ------
    StudyError
        With all problems of the file in its order, or if the file cannot be read.

    Examples
    --------
    >>> import pathlib
    >>> import roughvol
    >>> _ = pathlib.Path("tiny.yaml").write_text("surface: {D: 2.5, m: 3, seeds: 2}")
    >>> roughvol.load("tiny.yaml", ["surface.m=4"]).surface.m
    (4,)
    """
    file = printable(str(path))
    content = b""
    try:
        with Path(path).open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise StudyError([Problem(TOO_LARGE, "", None, file)])
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if Path(path).suffix in RESULTS:
            raise StudyError([Problem(_holds_results(path), "", None, file)]) from error
        line = content[: error.start].count(b"\n") + 1
        raise StudyError([Problem("not text in UTF-8", "", line, file)]) from error
    except StudyError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        reason = getattr(error, "strerror", None) or error
        is_run = isinstance(error, FileNotFoundError | IsADirectoryError) and any(
            (Path(folder) / path / "study.yaml").is_file() for folder in RUNS
        )
        message = _holds_results(path) if is_run else f"cannot read the study: {reason}"
        raise StudyError([Problem(message, "", None, file)]) from error
    return _study(text, file, Path(path), changes=changes)


def _holds_results(path: str | Path) -> str:
    return f"holds results and is no study file: roughvol.open({str(path)!r}) returns them, roughvol show prints them"


def of_data(data: Mapping[str, Any], arguments: Arguments = STUDY) -> Study:
    """Return the study of Python data, as a dict with the keys of a study file.

    Parameters
    ----------
    data : mapping
        Keys of a study file. Values may be objects of numpy, pint, xarray and pathlib. Files are relative to the
        current folder.
    arguments : Arguments
        Names of the keys in messages. Default: ``study["surface"]["L"]``.

    Returns
    -------
    Study
        The frozen study.

    Raises
    ------
    StudyError
        With all problems of the data.
    """
    problems: dict[KeyPath, str] = {}
    try:
        text = write(plain(data, problems))
    except RecursionError as error:
        message = "nested too deep, or a mapping that contains itself"
        raise StudyError([Problem(message, argument=arguments.of(""))]) from error
    return _study(text, "", Path("study"), arguments=arguments, problems=problems)


def loads(text: str, file: str | Path = "<string>", *, stored: bool = False, changes: Sequence[str] = ()) -> Study:
    """Read a study from text.

    Parameters
    ----------
    text : str
        The study in YAML.
    file : str or Path
        Source of the text: its name in messages, its default name, and the folder of height files.
    stored : bool
        The text comes from a file of results, see `Study.stored`. Height files may be absent; such a study makes no
        cases.
    changes : sequence of str
        Keys set to other values, as ``surface.m=6``.

    Returns
    -------
    Study
        The frozen study.

    Raises
    ------
    StudyError
        With all problems of the text in its order.
    """
    path = Path("study" if file in NO_FILES else file)
    return _study(text, printable(str(file)), path, stored=stored, changes=changes)


def _study(
    text: str,
    file: str,
    path: Path,
    *,
    stored: bool = False,
    changes: Sequence[str] = (),
    arguments: Arguments | None = None,
    problems: Mapping[KeyPath, str] | None = None,
) -> Study:
    reading = Reading()
    try:
        data = reading.read(text)
    except UnreadableError as error:
        if arguments is not None:
            raise StudyError([Problem(str(error), argument=arguments.of(""))]) from error
        raise StudyError([Problem(str(error), "", error.line, file)]) from error
    changed = [_change(data, reading.marks, change) for change in changes]
    problems = {**reading.problems, **(problems or {})}
    try:
        name = re.sub(r"[^A-Za-z0-9_-]+", "_", path.stem)[:100].lstrip("-") or "study"
        study = Study.model_validate({"name": name, **data}, context={"folder": path.parent, "stored": stored})
    except ValidationError as error:
        for key, message in _translate(error, data):
            problems.setdefault(key, message)
        if not problems:  # a rule broken by rounding alone, as of 9007199254740993
            problems[()] = error.errors()[0]["msg"]
    if problems:
        # A missing key has the line of its mapping.
        marks = {key: _mark(reading.marks, key) for key in problems}
        ordered = sorted(problems, key=lambda key: marks[key])
        if arguments is not None:
            found = [(problems[key], key_text(key)) for key in ordered]
            raise StudyError([Problem(text, key, argument=arguments.of(key)) for text, key in found])
        set_here = {key for key in ordered if any(key[: len(path)] == path for path in changed)}
        raise StudyError(
            [
                Problem(problems[key], key_text(key), file=SET)
                if key in set_here
                else Problem(problems[key], key_text(key), marks[key][0], file)
                for key in ordered
            ]
        )
    lines = {key_text(key): line for key, (line, _) in reading.marks.items()}
    study._places = Places(file, lines, arguments)
    return study


def _change(data: dict[str, Any], marks: dict[KeyPath, tuple[int, int]], change: str) -> KeyPath:
    """Set a key of plain data, as ``surface.m=6``, and return its path; it has the line of its mapping."""
    name, equals, text = change.partition("=")
    parts = re.findall(r"\[(\d+)\]|([^.\[\]]+)", name.strip())
    keys: list[str | int] = [int(index) if index else word.strip() for index, word in parts]
    if not equals or not keys or key_text(tuple(keys)) != name.strip():
        raise StudyError([Problem(f"must be KEY=VALUE, as surface.m=6, given {show(change)}", file=SET)])
    try:
        value = Reading().read(f"value: {text.strip()}")["value"]
    except UnreadableError as error:
        raise StudyError([Problem(f"{text.strip()!r}: {error}", name.strip(), file=SET)]) from error
    here: Any = data
    for place, key in enumerate(keys):
        inside = isinstance(here, list) and isinstance(key, int) and key < len(here)
        if not inside and not (isinstance(here, dict) and isinstance(key, str)):
            where = key_text(tuple(keys[:place])) or "a study"
            wanted = "list" if isinstance(key, int) else "mapping"
            kind = f"has {len(here)} items" if isinstance(here, list) and isinstance(key, int) else f"is no {wanted}"
            raise StudyError([Problem(f"{where} {kind} in the study", name.strip(), file=SET)])
        if place == len(keys) - 1:
            here[key] = value
        else:
            here = here.setdefault(key, {}) if isinstance(here, dict) else here[key]
    for path in [path for path in marks if path[: len(keys)] == tuple(keys)]:
        del marks[path]
    marks[tuple(keys)] = _mark(marks, tuple(keys))
    return tuple(keys)


def _mark(marks: dict[KeyPath, tuple[int, int]], key: KeyPath) -> tuple[int, int]:
    """Return line and column of a key, or of the nearest mapping that holds it."""
    while key and key not in marks:
        key = key[:-1]
    return marks.get(key, (1, 0))


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
    """Return one error of pydantic in plain words, with the value given.

    Parameters
    ----------
    item : mapping
        Of `ValidationError.errors`.

    Returns
    -------
    str
        Message.
    """
    kind = item["type"]
    context = {k: number_text(v) if isinstance(v, int | float) else v for k, v in item.get("ctx", {}).items()}
    message = _PLAIN[kind].format(**context) if kind in _PLAIN else str(item["msg"])  # may hold braces
    return message if kind == "missing" else f"{message}, given {show(item['input'])}"


def _translate(error: ValidationError, data: Any) -> Iterator[tuple[KeyPath, str]]:
    """Yield the key path and a message in plain words for each error of pydantic."""
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
            message, meant = _unknown(path, data)
            misspelt |= {(*path[:-1], meant)} if meant else set()
        if isinstance(given, str) and (kind == "literal_error" or item["msg"].startswith("must be ")):
            meant = nearest(given, re.findall(r"'([^']*)'", item.get("ctx", {}).get("expected", item["msg"])))
            message += f"; did you mean '{meant}'?" if meant else ""
        messages.append((path, item["msg"], message + _about(path)))
    for path, reason, message in messages:
        # a value that another key follows from is wrong once: the last of `pressures` is the end of the sweep
        again = any(reason == same and path == where[: len(path)] != where for where, same, _ in messages)
        # a misspelt key is not missing as well; conflicts have no path, and are found by the caller
        if path and path not in misspelt and not again:
            yield path, message


def _about(path: KeyPath) -> str:
    """Return the description of a key in brackets, empty without one."""
    *section, name = [part for part in path if isinstance(part, str)] or [""]
    models = _MODELS.get(tuple(section), ())
    of_a_leg = len(path) > 1 and isinstance(path[1], int)  # its models follow those of a sweep without legs
    fields = (model.model_fields.get(name) for model in (reversed(models) if of_a_leg else models))
    return next((f" ({field.description})" for field in fields if field), "")


def _unknown(path: KeyPath, data: Any) -> tuple[str, str | None]:
    """Return the message for an unknown key, and the key probably meant."""
    key, models = str(path[-1]), _MODELS[tuple(part for part in path[:-1] if isinstance(part, str))]
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
    homes = [key_text(section) for section, others in _MODELS.items() if key in names(*others)]
    hint = f"did you mean '{meant}'? " if meant else f"a key of '{homes[0]}'; " if homes else ""
    return f"unknown key; {hint}allowed: {', '.join(known)}", meant


def _models(*models: type[BaseModel], path: KeyPath = ()) -> Iterator[tuple[KeyPath, tuple[type[BaseModel], ...]]]:
    """Yield the key path of every mapping with its possible models."""

    def inside(annotation: Any) -> Iterator[type[BaseModel]]:
        if isinstance(annotation, type) and issubclass(annotation, RootModel):
            yield from inside(annotation.model_fields["root"].annotation)
        elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
            yield annotation
        for argument in get_args(annotation):
            yield from inside(argument)

    yield path, models
    for model in models:
        for name, field in model.model_fields.items():
            nested = tuple(inside(field.annotation))
            if nested:
                yield from _models(*nested, path=(*path, name))


_MODELS: dict[KeyPath, tuple[type[BaseModel], ...]] = {}
for _path, _of_path in _models(Study):
    _MODELS[_path] = tuple(dict.fromkeys((*_MODELS.get(_path, ()), *_of_path)))
