"""Objects of Python to plain data (text, numbers, lists, mappings).

Numbers of numpy, decimals and fractions are numbers, arrays are lists, paths are text. A quantity of pint is the text
of its number and unit, as ``10 MPa``. Where a study does not know the unit, as an inch or a unit of the user, the text
has base units, but for L: its unit is that of heights without one. A number of xarray has the unit of its attribute
``units``. Attributes tell these types apart.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import math
import numbers
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from roughvol.errors import CHANGES, DatasetError, Problem, RoughvolError, StudyError
from roughvol.study.plain_data import KeyPath, key_text, number_text
from roughvol.study.values.units import is_known

if TYPE_CHECKING:
    from roughvol.typing import Changes

ALLOWED = "text, a number, a path, a list or a mapping"

NO_UNIT = ("", "1", "length")  # attributes `units` of numbers without a unit
TIMES = ("m", "M")  # kinds of the types of numpy: differences of times, and times
PERCENT = "%"  # a share of a mean in an ensemble, and no number
DIFFERENCE = "Δ"  # of temperatures
GIVES_UNIT = "surface.L"


def check_type(
    value: object,
    kinds: type | tuple[type, ...],
    words: str,
    error: Callable[[str], RoughvolError] = DatasetError,
    *,
    but: tuple[type, ...] = (),
) -> None:
    """Refuse an argument of a type without meaning.

    Parameters
    ----------
    value : object
        The argument.
    kinds : type or tuple of types
        Its types.
    words : str
        The argument and its types in words, as "a figure is text".
    error : callable
        Class of the error.
    but : tuple of types
        Types among ``kinds`` without meaning, as a text in place of a list of texts.
    """
    if not isinstance(value, kinds) or isinstance(value, but):
        raise error(f"{words}, given a value of the type {type(value).__name__}")


def refused(message: str, key: str = "", **place: Any) -> StudyError:
    """Return the error of a study with one problem.

    Parameters
    ----------
    message, key, **place
        The problem, as of `errors.Problem`.

    Returns
    -------
    StudyError
        The error.
    """
    return StudyError([Problem(message, key, **place)])


def plain(value: Any, problems: dict[KeyPath, str], path: KeyPath = ()) -> Any:
    """Return an object of Python as plain data; ``problems`` receives a message for each that is none."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str) or (isinstance(value, float) and hasattr(value, "unit")):
        return str(value)
    if isinstance(value, Mapping) and not hasattr(value, "coords"):
        return _plain_mapping(value, problems, path)
    if getattr(getattr(value, "dtype", None), "kind", "") in TIMES:
        problems[path] = f"must be {ALLOWED}, given times of numpy; a time has its unit, as 10 s"
        return None
    number, unit = measured(value, convert=key_text(path) != GIVES_UNIT)
    if unit:
        return _with_unit(plain(number, problems, path), unit)
    is_decimal = hasattr(number, "as_integer_ratio") and not isinstance(number, type)  # a decimal is no Real
    if isinstance(number, numbers.Real) or is_decimal:
        nearest = math.inf
        given: object = "a number beyond 1.8e308"
        with contextlib.suppress(OverflowError):  # a whole number, or a fraction, beyond all floats
            given = nearest = float(number)
        if math.isfinite(nearest):
            return int(number) if isinstance(number, numbers.Integral) else nearest
        problems[path] = f"must be a finite number, given {given}"
        return None
    if isinstance(number, os.PathLike) and isinstance(text := os.fspath(number), str):
        return text
    if getattr(number, "ndim", 0) > 1:
        message = f"must be {ALLOWED}, given an array of shape {number.shape}"
        problems[path] = f"{message}; heights in memory are surface.heights of the study itself"
        return None
    if hasattr(number, "dimensionality"):  # a unit of pint
        return f"{number:~C}"
    if hasattr(number, "tolist") and not isinstance(number, numbers.Number):
        return plain(number.tolist(), problems, path)
    if isinstance(number, Sequence) and not isinstance(number, bytes | bytearray | memoryview):
        return [plain(item, problems, (*path, index)) for index, item in enumerate(number)]
    is_code = inspect.isroutine(number) or inspect.isclass(number)
    hint = "; a function has its name here, as module:function" if is_code else ""
    problems[path] = f"must be {ALLOWED}, given a value of the type {type(number).__name__}{hint}"
    return None


def text_of_value(value: Any, name: str) -> Any:
    """Return a value, or a list of values, as the text of a command line.

    Parameters
    ----------
    value : object
        A number of Python or numpy, text, or a quantity of pint; a list or an array of them.
    name : str
        Its name in messages.

    Returns
    -------
    str or list of str
        As ``10 MPa``.
    """
    data = _plain_or_refused(value, name)
    return [_text(item) for item in data] if isinstance(data, list) else _text(data)


def _plain_or_refused(value: Any, name: str = "", file: str = "") -> Any:
    """Return an object of Python as plain data; a `StudyError` names an object that is none, and its place."""
    problems: dict[KeyPath, str] = {}
    data = plain(value, problems)
    if problems:
        raise StudyError([Problem(text, f"{name}{key_text(path)}", file=file) for path, text in problems.items()])
    return data


def _text(data: Any) -> str:
    return data if isinstance(data, str) else json.dumps(data, ensure_ascii=False)


def changes_of(changes: Changes) -> tuple[str, ...]:
    """Return changes of a study as the texts of ``--set``.

    Parameters
    ----------
    changes : mapping, str or sequence of str
        As ``{"surface.m": 6}`` or ``"surface.m=6"``.

    Returns
    -------
    tuple of str
        As ``surface.m=6``.
    """
    if isinstance(changes, str):
        return (changes,)
    if not isinstance(changes, Mapping):
        texts = tuple(changes) if isinstance(changes, Iterable) else (changes,)
        if not all(isinstance(text, str) for text in texts):
            check_type(changes, (), 'changes are a mapping, as {"surface.m": 6}, or texts, as "surface.m=6"', refused)
        return texts
    return tuple(f"{key}={_text(value)}" for key, value in _plain_or_refused(changes, file=CHANGES).items())


def measured(value: Any, *, convert: bool = True) -> tuple[Any, str]:
    """Return the number of an object and its unit, as ``MPa``; other objects unchanged, and an empty text."""
    unit = ""
    if hasattr(value, "coords") and hasattr(value, "attrs") and hasattr(value, "data"):  # a DataArray
        unit, value = str(value.attrs.get("units", "")).strip(), value.data
        unit = "" if unit in NO_UNIT else unit
    if hasattr(value, "magnitude") and hasattr(value, "units"):  # a quantity of pint, of any registry
        unit = f"{value.units:~C}"
        if convert and not (unit == PERCENT or unit.startswith(DIFFERENCE) or is_known(unit)):
            value = value.to_base_units()
            unit = f"{value.units:~C}"
        value = value.magnitude
    return value, unit


def _plain_mapping(value: Mapping[Any, Any], problems: dict[KeyPath, str], path: KeyPath) -> dict[str, Any]:
    data: dict[str, Any] = {}
    for key, inner in value.items():
        if isinstance(key, str):
            data[str(key)] = plain(inner, problems, (*path, str(key)))
        else:
            problems[(*path, str(key))] = f"a key must be text, given {key!r} of the type {type(key).__name__}"
    return data


def _with_unit(number: Any, unit: str) -> Any:
    """Return numbers with their unit as text, other values unchanged."""
    if isinstance(number, list):
        return [_with_unit(item, unit) for item in number]
    is_number = isinstance(number, int | float) and not isinstance(number, bool)
    return f"{number_text(number)} {unit}" if is_number else number
