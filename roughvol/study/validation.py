"""Validation of a study: the faults of its sections and the broken rules across them, all together."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from roughvol.study.sections.ensemble import Ensemble
from roughvol.study.sections.fluid import Fluid
from roughvol.study.sections.height_file import ABSENT, HeightFile, is_absent
from roughvol.study.sections.material import ContactModulus, YoungPoisson
from roughvol.study.sections.record import Record
from roughvol.study.sections.solver import Solver
from roughvol.study.sections.spectral import SpectralSurface
from roughvol.study.sections.surface import GeneratedSurface
from roughvol.study.sections.sweep import Legs, Sweep
from roughvol.study.values.state_kinds import stored_name
from roughvol.study.yaml_text import KeyPath

RULE = "rule"  # type of the error of a broken rule
ANY_SURFACE = {"D": 2.5, "m": 2}  # in place of a faulty one
MOST_REPAIRS = 20

S = TypeVar("S")
Problems = Iterator[tuple[KeyPath, str]]


@dataclass(frozen=True)
class Sections:
    """The sections of a study without lists."""

    surface: GeneratedSurface | SpectralSurface | HeightFile
    material: ContactModulus | YoungPoisson
    sweep: Sweep | Legs
    solver: Solver
    record: Record
    ensemble: Ensemble | None
    fluid: Fluid | None

    @property
    def length_unit(self) -> str | None:
        """Unit of length; of a file that may have its own, any unit."""
        return self.surface.length_unit or ("m" if isinstance(self.surface, HeightFile) else None)

    @property
    def yields(self) -> bool:
        """Whether a hardness acts."""
        return self.material.hardness is not None and self.material.plastic


@dataclass(frozen=True)
class Rule:
    """A rule across sections.

    Attributes
    ----------
    reads : tuple of key paths
        Keys without which the rule would find false problems.
    problems : callable
        Sections ↦ place and message of each problem.
    """

    reads: tuple[KeyPath, ...]
    problems: Callable[[Sections], Problems]

    def applies(self, faulty: Iterable[KeyPath]) -> bool:
        """Return whether all keys that the rule needs are sound."""
        pairs = itertools.product(self.reads, faulty)
        return not any(read[: len(wrong)] == wrong[: len(read)] for read, wrong in pairs)


def validated(data: Any, read: Callable[[Any], S], rules: Sequence[Rule], context: dict[str, Any] | None) -> S:
    """Return the study of plain data without lists; its ValidationError has all faults and broken rules."""
    wrong: list[InitErrorDetails] = []
    repair = _Repair(data, context)
    study: Any = None
    try:
        study = read(data)
    except ValidationError as error:
        wrong = [details_of(item, item["loc"]) for item in error.errors(include_url=False)]
        study = _sound_part(read, error, repair)
    if study is not None:
        sections = Sections(**{field.name: getattr(study, field.name) for field in fields(Sections)})
        for rule in rules:
            if rule.applies(repair.keys):
                wrong += [_broken(repair.place(path), message) for path, message in rule.problems(sections)]
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


def _broken(path: KeyPath, message: str) -> InitErrorDetails:
    kind, text = RULE, "{reason}"
    return InitErrorDetails(type=PydanticCustomError(kind, text, {"reason": message}), loc=path, input=None)


def details_of(item: Any, where: tuple[int | str, ...]) -> InitErrorDetails:
    """Return an error of pydantic at another place."""
    of_pydantic = item["type"] not in ("refused", RULE, "assertion_error", "value_error")
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
        """Leave out all faults of an error; return False if nothing is left."""
        faults = {plain_path(item["loc"], self.data): item for item in error.errors(include_url=False)}
        for path, item in sorted(faults.items(), key=lambda pair: [str(part) for part in pair[0]], reverse=True):
            if is_absent(item) and self.context is not None:
                continue
            if not path:
                return False
            if isinstance(path[-1], int):
                of_list = self.items.setdefault(path[:-1], list(range(len(self._at(path[:-1])))))
                del of_list[path[-1]]
            elif item["type"] != "extra_forbidden":
                self.keys.add(path)
            self.data = _without(self.data, path)
        return True

    def _at(self, path: KeyPath) -> Any:
        return functools.reduce(lambda here, part: here[part], path, self.data)

    def place(self, path: KeyPath) -> KeyPath:
        """Return a place in the repaired data as a place in the given data."""
        *key, last = path
        left = self.items.get(tuple(key))
        return (*key, left[last]) if left is not None and isinstance(last, int) else path


def _sound_part(read: Callable[[Any], S], error: ValidationError, repair: _Repair) -> S | None:
    """Return the study without its faults; None if nothing sound is left."""
    if repair.context is not None:
        repair.context[ABSENT] = True
    for _ in range(MOST_REPAIRS):
        if not repair.leave_out(error):
            return None
        try:
            return read(repair.data)
        except ValidationError as again:
            error = again
    return None


def _without(data: Any, path: KeyPath) -> Any:
    """Return plain data without a key or an item; a surface is replaced."""
    first, *rest = path
    new = data.copy()
    if rest:
        new[first] = _without(data[first], tuple(rest))
    else:
        del new[first]
        if first == "surface":
            new[first] = ANY_SURFACE
    return new
