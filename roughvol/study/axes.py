"""Lists in keys that take one value: each is an axis of the study, and every combination is a study of its own.

The axis has the name of the key, as ``E`` for ``material: {E: [5 MPa, 10 MPa]}``. Combinations with equal cases share
them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from pydantic import ValidationError
from pydantic_core import InitErrorDetails

from roughvol.study.file import StudyFile
from roughvol.study.plain_data import KeyPath, given, inline, number_text, show
from roughvol.study.sections.record import INTERIOR
from roughvol.study.sections.strict import models_in, refuse_at
from roughvol.study.validation import details_of
from roughvol.study.values.units import Quantity, convert, same

S = TypeVar("S")  # `study.Study`
T = TypeVar("T")
Label = float | str

AXES: dict[str, tuple[str, ...]] = {
    "level": ("surface", "level"),
    "low_pass": ("surface", "low_pass"),
    "material": ("material",),
    "E_star": ("material", "E_star"),
    "E": ("material", "E"),
    "nu": ("material", "nu"),
    "thickness": ("material", "thickness"),
    "hardness": ("material", "hardness"),
    "to": ("sweep", "to"),
    "region": ("record", "region"),
}
"""Key path of each axis, in the order of the dimensions of a dataset."""
LABELS_OF_NONE: dict[str, Label] = {"low_pass": 0.0, "thickness": math.inf, "hardness": math.inf, "region": "whole"}
"""Label of the item 'none', of each axis that takes this item."""
MOST = 1000  # combinations
NONE = "none"


@dataclass(frozen=True)
class Axis:
    """An axis of a study: a name of `AXES`, the labels of its coordinate, and their unit."""

    name: str
    labels: tuple[Label, ...]
    unit: str | None = None

    def words(self, label: Label) -> str:
        """Return a label in words, as ``E = 5 MPa``."""
        if isinstance(label, str):
            return label if self.name in ("material", "to") else f"{self.name} = {label}"
        none = label == LABELS_OF_NONE.get(self.name)
        text = NONE if none else f"{number_text(label)} {self.unit or ''}".strip()
        return f"{self.name} = {text}"


@dataclass(frozen=True)
class Variant(Generic[S]):
    """One combination of the lists of a study: labels by axis, words as ``E = 5 MPa, nu = 0.5``, and its study."""

    labels: Mapping[str, Label]
    words: str
    study: S


def lists(data: Any) -> dict[str, list[Any]]:
    """Return the items of each axis that plain data has as a list."""
    return {name: list(here) for name in AXES if isinstance(here := _value(name, data), list | tuple)}


def _value(name: str, data: Any) -> Any:
    """Return the value or the list that plain data has on an axis; None without one."""
    for part in AXES[name]:
        data = data.get(part) if isinstance(data, dict) else None
    return _ends(data) if name == "to" else data


def _ends(to: Any) -> Any:
    """Return ``{pressure: [a, b]}`` as a list of ends, other values unchanged."""
    if isinstance(to, dict) and len(to) == 1:
        kind, values = next(iter(to.items()))
        if isinstance(values, list | tuple):
            return [{kind: value} for value in values]
    return to


def without_none(data: Any) -> Any:
    """Return plain data without lists, with no value in place of the word 'none' in each key that takes it."""
    for name in LABELS_OF_NONE:
        if _value(name, data) == NONE:
            data = _with(data, AXES[name], None)
    return data


def _with(data: dict[str, Any], path: tuple[str, ...], value: Any) -> dict[str, Any]:
    """Return plain data with another value at a path."""
    first, *rest = path
    return {**data, first: _with(data[first], tuple(rest), value) if rest else value}


def _indexed(path: KeyPath, places: Mapping[KeyPath, int]) -> KeyPath:
    """Return a key path of a combination as one of the whole study, with the place in the list of each key."""
    for key, place in places.items():
        keys = [index for index, part in enumerate(path) if not str(part).startswith("<")]
        if tuple(path[index] for index in keys)[: len(key)] == key:
            end = keys[len(key) - 1] + 1
            path = (*path[:end], place, *path[end:])
    return path


def _along(combinations: Sequence[T], sizes: Sequence[int]) -> list[list[T]]:
    """Return, for each axis, the combinations with the first item of all other axes; the last axis is fastest."""
    strides = [math.prod(sizes[k + 1 :]) for k in range(len(sizes))]
    return [list(combinations[: size * stride : stride]) for size, stride in zip(sizes, strides, strict=True)]


def read(data: dict[str, Any], read_one: Callable[[Any], S]) -> tuple[tuple[Axis, ...], list[S]]:
    """Return the axes of plain data with lists, and the studies of all combinations, the last axis fastest.

    ``read_one`` makes the study of plain data without lists. A `ValidationError` has the problems of all combinations,
    each once. Empty lists and too many combinations are problems.
    """
    items = lists(data)
    lists_at: list[KeyPath] = [AXES[name] for name in items]
    if "to" in items and isinstance(data["sweep"]["to"], dict):  # {pressure: [a, b]}
        lists_at[list(items).index("to")] = (*AXES["to"], *data["sweep"]["to"])
    for name, values in items.items():
        if not values:
            refuse_at(AXES[name], values, "must have at least one item")
    if (number := math.prod(map(len, items.values()))) > MOST:
        longest, keys = max(items, key=lambda name: len(items[name])), (".".join(AXES[name]) for name in items)
        message = f"the lists of {', '.join(keys)} make {number} combinations; allowed: at most {MOST}"
        refuse_at(AXES[longest], [None], message)
    made: list[S] = []
    wrong: dict[Any, InitErrorDetails] = {}
    for places in itertools.product(*(range(len(values)) for values in items.values())):
        combination = data
        for (name, values), place in zip(items.items(), places, strict=True):
            combination = _with(combination, AXES[name], values[place])
        try:
            made.append(read_one(combination))
        except ValidationError as error:
            for fault in error.errors(include_url=False):
                where = _indexed(fault["loc"], dict(zip(lists_at, places, strict=True)))
                wrong.setdefault((where, fault["msg"]), details_of(fault, where))
    if wrong:
        raise ValidationError.from_exception_data("Study", list(wrong.values()))
    along = _along(made, [len(values) for values in items.values()])
    return tuple(_axis(name, items[name], studies) for name, studies in zip(items, along, strict=True)), made


def _axis(name: str, given: Sequence[Any], studies: Sequence[Any]) -> Axis:
    """Return the axis of a list, given as plain data, from the study of each item."""
    items = [_item(name, study) for study in studies]
    unit = next((item.unit for item in items if isinstance(item, Quantity)), None)
    for k, item in enumerate(items):
        if unit is not None and isinstance(item, float) and not isinstance(item, Quantity):
            refuse_at((*AXES[name], k), given[k], "either all items have a unit, or none")
    labels = [_label(name, item, unit) for item in items]
    for k, label in enumerate(labels):
        if (first := labels.index(label)) < k:
            refuse_at((*AXES[name], k), given[k], "is item {first} of the list again", first=str(first + 1))
    return Axis(name, tuple(labels), unit)


def _label(name: str, item: Any, unit: str | None) -> Label:
    """Return the label of an item: a number in the unit of the axis, or text."""
    if item is None:
        return LABELS_OF_NONE[name]
    if isinstance(item, str):
        return item
    if not isinstance(item, Quantity) or unit is None:
        return float(item)
    return float(f"{convert(float(item), item.unit, unit):.12g}")


def _item(name: str, study: Any) -> Any:
    """Return the value of a study on an axis: a number, None, or text."""
    if name == "material":
        given = study.material.model_dump(mode="json", exclude_defaults=True)
        other = given.pop("against", {})
        flat = {**given, **{f"against {key}": value for key, value in other.items()}}
        return ", ".join(f"{key} = {value if isinstance(value, str) else show(value)}" for key, value in flat.items())
    if name == "to":
        return study.sweep.target.label
    if name == "region":
        region = study.record.region
        if region is None:
            return None
        return "interior" if (("x", region.x), ("y", region.y)) == INTERIOR else region.label
    return getattr(getattr(study, AXES[name][0]), name)


def listable(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON schema of a study with a list allowed at each axis."""
    models, sections = schema["$defs"], schema["properties"]
    for name, (section, *rest) in AXES.items():
        forms = dict.fromkeys(models_in(StudyFile.model_fields[section].annotation))
        holders = [models[form.__name__]["properties"] for form in forms] if rest else [sections]
        key = rest[0] if rest else section
        for holder in holders:
            if key in holder:
                for ends in _mappings(holder[key]) if name == "to" else ():
                    ends |= {kind: _or_list(end, optional=False) for kind, end in ends.items()}
                holder[key] = _or_list(holder[key], optional=name in LABELS_OF_NONE)
    return schema


def _mappings(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the keys of each mapping that a schema allows, by name."""
    if "properties" in schema:
        yield schema["properties"]
    for inner in (*schema.get("oneOf", ()), *schema.get("anyOf", ())):
        yield from _mappings(inner)


def _or_list(schema: dict[str, Any], *, optional: bool) -> dict[str, Any]:
    """Return the schema of a value or a list of values."""
    kept: dict[str, Any] = {key: schema[key] for key in ("description", "default", "title") if key in schema}
    single = {key: value for key, value in schema.items() if key not in kept}
    forms = [single, {"const": NONE}] if optional else [single]
    items = {"anyOf": forms} if optional else single
    return {**kept, "anyOf": [*forms, {"type": "array", "items": items, "minItems": 1}]}


def write_lists(data: dict[str, Any], of: Sequence[Axis], studies: Sequence[Any], context: Any) -> None:
    """Put the lists of a study in place of their first items, in its plain data; ``studies`` are all combinations."""
    for axis, along in zip(of, _along(studies, [len(axis.labels) for axis in of]), strict=True):
        section, *key = AXES[axis.name]
        items = [getattr(study, section).model_dump(mode="json", context=context) for study in along]
        if key:
            data[section][key[0]] = [item.get(key[0]) for item in items]
        else:
            data[section] = items


def choices(study: Any) -> dict[str, dict[Label, str]]:
    """Return the change of a study that chooses each label of its lists, as ``material.E=5 MPa``, by axis."""
    items, found = lists(study.model_dump(mode="json")), {}
    for axis in study.axes:
        texts = (NONE if item is None else inline(given(item)) for item in items[axis.name])
        key = ".".join(AXES[axis.name])
        found[axis.name] = {label: f"{key}={text}" for label, text in zip(axis.labels, texts, strict=True)}
    return found


def spelled_as(data: Any, other: Any) -> dict[str, Any]:
    """Return the keys of plain data whose values are in lists of other data in another unit, with the values there."""
    found: dict[str, Any] = {}
    for name, known in lists(other).items():
        here = _value(name, data)
        items = here if isinstance(here, list | tuple) else [here]
        spelled = [next((one for one in known if same(one, item)), item) for item in items]
        if spelled != list(items):
            found[".".join(AXES[name])] = spelled if items is here else spelled[0]
    return found


def variants_of(of: Sequence[Axis], studies: Sequence[S]) -> tuple[Variant[S], ...]:
    """Return the studies of all combinations with their labels."""
    made = []
    for labels, study in zip(itertools.product(*(axis.labels for axis in of)), studies, strict=True):
        words = ", ".join(map(Axis.words, of, labels))
        made.append(Variant({axis.name: label for axis, label in zip(of, labels, strict=True)}, words, study))
    return tuple(made)


def with_endings(every: Sequence[tuple[str, Sequence[T]]]) -> Iterator[tuple[T, str]]:
    """Yield what combinations have, once and without an ending where all have it, else with the words of each."""
    for one in dict.fromkeys(itertools.chain(*(own for _, own in every))):
        having = [words for words, own in every if one in own]
        yield from [(one, "")] if len(having) == len(every) else [(one, f" ({words})") for words in having]
