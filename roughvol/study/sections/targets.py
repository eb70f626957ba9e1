"""Lists of states of a sweep, ``pressures: [0.1 MPa, 0.5 MPa]``: each is a step."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic_core import PydanticCustomError

from roughvol.errors import Problem, StudyError
from roughvol.study.sections.record import SELECTORS
from roughvol.study.values.scale import lacking
from roughvol.study.values.state_kinds import LISTS, STATE_KINDS
from roughvol.study.values.units import convert, has_unit, unit_of


def listed_of(sweep: Any) -> tuple[str, tuple[float, ...]]:
    """Return the kind and the values of the list of a sweep; empty ones without a list."""
    return next(((kind.name, getattr(sweep, name)) for name, kind in LISTS.items() if getattr(sweep, name)), ("", ()))


def spelled(data: Any) -> Any:
    """Return the data of a sweep with the number of steps and the last state that follow from its list.

    Raises
    ------
    PydanticCustomError
        If two lists are given, or steps or another end beside one.
    """
    given = [name for name in LISTS if data.get(name)] if isinstance(data, dict) else []
    if not given:
        return data
    name, *others = given
    beside = [*others, *(key for key in ("steps", "to", "equal", "first") if key in data)]
    if beside:
        kind, message = "refused", "'{name}' makes a step of each value: omit {others}"
        raise PydanticCustomError(kind, message, {"name": name, "others": ", ".join(f"'{key}'" for key in beside)})
    values = data[name] if isinstance(data[name], list | tuple) else [data[name]]
    return {**data, "steps": len(values), "to": {LISTS[name].name: values[-1]}}


def misplaced(levels: Sequence[Any], *, either: bool) -> tuple[int | None, str] | None:
    """Return the place of the first listed level out of order, and the rule it breaks; None if all are in order.

    The place is None where only some levels have a unit.

    Parameters
    ----------
    levels : sequence of Level
        The listed states.
    either : bool
        Whether they may also unload.
    """
    values, units = [level.value for level in levels], [unit_of(level.value) for level in levels]
    if any((unit is None) != (units[0] is None) for unit in units):
        return None, "either all values have a unit, or none"
    if (wanted := units[0]) is not None:
        values = [convert(float(value), unit or wanted, wanted) for value, unit in zip(values, units, strict=True)]
    falls = values[:2] != sorted(values[:2]) if either else STATE_KINDS[levels[0].kind].falls
    for index, (one, other) in enumerate(itertools.pairwise(values), start=1):
        if not (one > other if falls else one < other):
            if either:
                return index, "must rise or fall from value to value: give each way as a leg of its own"
            way = "fall" if falls else "rise"
            return index, f"must {way} from value to value, as on loading; a list of legs also unloads"
    return None


def sections_of(sweep: Any) -> list[tuple[tuple[str | int, ...], str, Any]]:
    """Return key path, kind and raw value of every state in the plain data of a sweep."""
    legs: list[tuple[tuple[str | int, ...], Any]] = [(("sweep",), sweep)]
    if isinstance(sweep, list):
        legs = [(("sweep", index), leg) for index, leg in enumerate(sweep)]
    found: list[tuple[tuple[str | int, ...], str, Any]] = []
    for path, leg in legs:
        if not isinstance(leg, dict):
            continue
        end = leg.get("to")
        for kind, value in end.items() if isinstance(end, dict) else ():
            found.append(((*path, "to", kind), kind, value))
        for name, kind in LISTS.items():
            values = leg.get(name)
            items = values if isinstance(values, list) else [values]
            found += [
                ((*path, name, index), kind.name, value) for index, value in enumerate(items) if value is not None
            ]
        if leg.get("first") is not None:
            found.append(((*path, "first"), "pressure", leg["first"]))
    return [row for row in found if row[1] in STATE_KINDS]


def levels_of(record: Any) -> list[tuple[tuple[str | int, ...], str, Any]]:
    """Return key path, kind and raw value of every level in the plain data of a record."""
    found: list[tuple[tuple[str | int, ...], str, Any]] = []
    for path in SELECTORS:
        here = record
        for part in path:
            here = here.get(part) if isinstance(here, dict) else None
        for kind, values in here.items() if isinstance(here, dict) else ():
            items = values if isinstance(values, list) else [values]
            found += [(("record", *path, kind, index), kind, value) for index, value in enumerate(items)]
    return [row for row in found if row[1] in STATE_KINDS]


def lacking_units(data: dict[str, Any], modulus: Any, *, has_length: bool) -> list[tuple[tuple[str | int, ...], str]]:
    """Return key path and message of each state with a unit that the study cannot turn into a starred number."""
    wrong = []
    for path, kind, value in (*sections_of(data.get("sweep")), *levels_of(data.get("record"))):
        if not has_unit(value):
            continue
        if kind in ("pressure", "load") and not has_unit(modulus):
            wrong.append((path, f"has a unit ({value}) and the modulus has none: as material: {{E_star: 10 MPa}}"))
        elif kind != "pressure" and not has_length:
            wrong.append((path, f"has a unit ({value}) and L has none: as surface: {{L: 100 um}}"))
    return wrong


def list_of(leg: dict[str, Any]) -> str | None:
    """Return the key of the list of states of a leg, None without one."""
    return next((name for name in LISTS if leg.get(name)), None)


def steps_of(leg: dict[str, Any]) -> Any:
    """Return the number of steps of a leg in plain data."""
    name = list_of(leg)
    if name is None:
        return leg.get("steps", 60)
    return len(leg[name]) if isinstance(leg[name], list) else 1


def end_of(leg: dict[str, Any]) -> dict[str, Any]:
    """Return the end of a leg as a mapping, empty for a plane."""
    name = list_of(leg)
    if name is not None:
        values = leg[name] if isinstance(leg[name], list) else [leg[name]]
        return {LISTS[name].name: values[-1]}
    return leg["to"] if isinstance(leg.get("to"), dict) else {}


def need_length(sweep: Any, record: Any, file: str) -> None:
    """Refuse states with a unit of length, or a load, on a surface whose file gives no unit."""
    states = [level for leg in sweep.legs for level in (leg.target, *(leg.listed or ()))]
    levels = [level for select in record.selects.values() for level in select.levels if level.kind in STATE_KINDS]
    for level in (*states, *levels):
        if level.value is not None and lacking(level.kind, level.value, "Pa", None):
            reason = f"needs the unit of length, and {Path(file).name} gives none: add surface: {{L: 100 um}}"
            message = f"{level.label} {reason}"
            raise StudyError([Problem(message, "sweep" if level in states else "record")])
