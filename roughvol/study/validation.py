"""Validation of a study: the faults of its sections and the broken rules across them, all together, in plain words.

A message has the key, the value given, and the allowed values.
"""

from __future__ import annotations

import copy
import functools
import itertools
import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from roughvol.errors import Problem, StudyError, meant, nearest_word, question
from roughvol.study.plain_data import KeyPath, Places, inline, key_text, number_text, show
from roughvol.study.python_data import plain
from roughvol.study.sections.height_file import ABSENT, is_absent
from roughvol.study.sections.strict import models_in, names
from roughvol.study.values.state_kinds import LISTS, stored_name
from roughvol.study.values.types import REFUSED
from roughvol.study.values.units import A_POINT
from roughvol.tables import table

RULE = "rule"  # type of the error of a broken rule
LONGEST = 60  # letters of a mapping or a list in a message
ANY_SURFACE = {"D": 2.5, "m": 2}  # in place of a faulty one
MOST_REPAIRS = 20

Models = Mapping[KeyPath, tuple[type[BaseModel], ...]]  # of each mapping of a study, by its place

_PLAIN = table(__file__)

B = TypeVar("B", bound=BaseModel)
S = TypeVar("S")
Problems = Iterator[tuple[KeyPath, str]]


@dataclass(frozen=True)
class Rule:
    """A rule across sections: the keys that it needs, and study ↦ place and message of each problem."""

    reads: tuple[KeyPath, ...]
    problems: Callable[[Any], Problems]

    def applies(self, faulty: Iterable[KeyPath]) -> bool:
        """Return whether all keys that the rule needs are sound."""
        pairs = itertools.product(self.reads, faulty)
        return not any(read[: len(wrong)] == wrong[: len(read)] for read, wrong in pairs)


def validated(data: Any, read: Callable[[Any], S], rules: Sequence[Rule], context: dict[str, Any] | None) -> S:
    """Return the study of plain data without lists; its ValidationError has all faults and broken rules."""
    wrong: list[InitErrorDetails] = []
    repair = _Repair(data, context)
    study: Any = None
    for _ in range(MOST_REPAIRS + 1):
        try:
            study = read(repair.data)
            break
        except ValidationError as error:
            wrong = wrong or [details_of(item, item["loc"]) for item in error.errors(include_url=False)]
            if not repair.leave_out(error):
                break
    for rule in rules if study is not None else ():
        if rule.applies(repair.keys):
            for path, message in rule.problems(study):
                wrong.append(details_of({"type": RULE, "msg": message, "input": None}, repair.place(path)))
    if wrong:
        raise ValidationError.from_exception_data("Study", wrong)
    return study


def plain_path(place: Sequence[int | str], data: Any, *, missing: bool = False) -> KeyPath:
    """Return the place of an error in plain data, without tags of unions and indices of single values.

    ``missing``: keep keys that the data lack.
    """
    path: KeyPath = ()
    for part in place:
        if isinstance(data, dict):
            part = part if part in data else stored_name(str(part))
            inside = part in data
        else:
            inside = isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)
        if inside or (missing and isinstance(part, str)):
            path, data = (*path, part), data[part] if inside else None
    return path


def details_of(item: Any, where: tuple[int | str, ...]) -> InitErrorDetails:
    """Return an error of pydantic at another place."""
    of_pydantic = item["type"] not in (REFUSED, RULE, "assertion_error", "value_error")
    kind = item["type"] if of_pydantic else PydanticCustomError(item["type"], "{reason}", {"reason": item["msg"]})
    return InitErrorDetails(type=kind, loc=where, input=item["input"], ctx=item.get("ctx", {}))


@dataclass
class _Repair:
    """Plain data without faulty keys and items, and what was left out."""

    data: Any
    context: dict[str, Any] | None
    keys: set[KeyPath] = field(default_factory=set)
    items: dict[KeyPath, list[int]] = field(default_factory=dict)  # by list: the places that are left

    def leave_out(self, error: ValidationError) -> bool:
        """Leave out all faults of an error; return False if nothing is left. From then on files need not exist."""
        if self.context is not None:
            self.context[ABSENT] = True
        faults = {plain_path(item["loc"], self.data): item for item in error.errors(include_url=False)}
        self.data = copy.deepcopy(self.data)
        for path in sorted(faults, key=lambda path: [(isinstance(part, int), part) for part in path], reverse=True):
            item = faults[path]
            if is_absent(item) and self.context is not None:
                continue
            if not path:
                return False
            *holders, last = path
            holder = functools.reduce(operator.getitem, holders, self.data)
            if isinstance(last, int):
                del self.items.setdefault(self.place(path[:-1]), list(range(len(holder))))[last]
            elif item["type"] != "extra_forbidden":
                self.keys.add(path)
            del holder[last]
            if path == ("surface",):
                holder[last] = ANY_SURFACE
        return True

    def place(self, path: KeyPath) -> KeyPath:
        """Return a place in the repaired data as a place in the given data."""
        given: KeyPath = ()
        for part in path:
            left = self.items.get(given)
            given = (*given, left[part] if left is not None and isinstance(part, int) else part)
        return given


def in_words(item: Mapping[str, Any]) -> str:
    """Return one error of pydantic in plain words, with the value given."""
    kind = item["type"]
    context = {k: number_text(v) if isinstance(v, int | float) else v for k, v in item.get("ctx", {}).items()}
    message = _PLAIN[kind].format(**context) if kind in _PLAIN else str(item["msg"])  # may hold braces
    given = item["input"]
    if kind == "missing" or (kind == REFUSED and ", given " in message):
        return message
    return f"{message}, given {_contents(given) if kind == REFUSED else show(given)}"


def _contents(value: Any) -> str:
    """Return a value as in a study file; a long mapping or list, or one of records, by its kind alone."""
    unknown: dict[KeyPath, str] = {}
    text = inline(plain(value, unknown)) if value and isinstance(value, dict | list) else ""
    return text if text and len(text) <= LONGEST and not unknown else show(value)


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
            message, near = _unknown(path, data, known)
            misspelt |= {(*path[:-1], near)} if near else set()
        if isinstance(given, str) and (kind == "literal_error" or item["msg"].startswith("must be ")):
            allowed = re.findall(r"'([^']*)'", item.get("ctx", {}).get("expected", item["msg"]))
            message += meant(given, allowed)
        messages.append((path, item["msg"], message + _about(path, known)))
    for path, reason, message in messages:
        # a value that another key follows from is wrong once: the last of `pressures` is the end of the sweep
        again = any(reason == same and path == where[: len(path)] != where for where, same, _ in messages)
        # a misspelt key is not missing as well
        if path and path not in misspelt and not again:
            yield path, message


def read_as(
    record: type[B], data: Any, problems: dict[KeyPath, str], places: Places, context: dict[str, Any] | None = None
) -> B:
    """Return plain data as a record; a `StudyError` has its faults and the given problems, in the order of the file."""
    try:
        read = record.model_validate(data, context=context)
    except ValidationError as error:
        unread = list(problems)  # their values are None here, which is no fault of the mapping around
        for key, message in translated(error, data, record):
            if not any(key == path[: len(key)] for path in unread):
                problems.setdefault(key, message)
        if not problems:  # a rule broken by rounding alone, as of 9007199254740993
            problems[()] = error.errors()[0]["msg"]
    if problems:
        in_order = sorted(problems, key=places.mark)
        raise StudyError([places.of(Problem(problems[key], key_text(key))) for key in in_order])
    return read


def _about(path: KeyPath, known: Models) -> str:
    """Return the description of a key in brackets, empty without one."""
    *section, name = [part for part in path if isinstance(part, str)] or [""]
    fields = (model.model_fields.get(name) for model in known.get(tuple(section), ()))
    return next((f" ({field.description})" for field in fields if field), "")


def _unknown(path: KeyPath, data: Any, of: Models) -> tuple[str, str | None]:
    """Return the message for an unknown key, and the key probably meant."""
    key, models = str(path[-1]), of[tuple(part for part in path[:-1] if isinstance(part, str))]
    known = names(*models)
    if key in known:  # a key of the other form of the mapping
        holder = functools.reduce(operator.getitem, path[:-1], data)
        owner = next(model for model in models if key in model.model_fields)
        rivals = [f"'{name}'" for name in holder if name in known and name not in owner.model_fields]
        needed = [f"'{name}'" for name, field in owner.model_fields.items() if field.is_required()]
        return f"excluded by {' and '.join(rivals)}" if rivals else f"needs {' and '.join(needed)}", None
    if path[-2:-1] == ("to",) and key in LISTS:
        return f"'{key}' stands in place of 'to', as sweep: {{{key}: [...]}}", None
    near = nearest_word(key, known)
    homes = [key_text(section) for section, others in of.items() if key in names(*others)]
    comma = A_POINT if key[:1].isdigit() else ""  # {nu: 0,5} has the key 5
    hint = question([near]) if near else f"; a key of '{homes[0]}'" if homes else comma
    return f"unknown key{hint}; allowed: {', '.join(known)}", near


@functools.cache
def models_of(*models: type[BaseModel], path: KeyPath = ()) -> Models:
    """Return the possible models of every mapping inside a mapping of these models, as a study."""
    found: dict[KeyPath, tuple[type[BaseModel], ...]] = {path: models}
    for name, key in ((name, key) for model in models for name, key in model.model_fields.items()):
        if nested := tuple(models_in(key.annotation)):
            for place, inner in models_of(*nested, path=(*path, name)).items():
                found[place] = tuple(dict.fromkeys((*found.get(place, ()), *inner)))
    return found
