"""Objects of Python as plain data of a study: text, numbers, lists and mappings.

Numbers of numpy, decimals and fractions are numbers, arrays are lists, paths are text. A quantity of pint is the text
of its number and unit, as ``10 MPa``. A number of xarray has the unit of its attribute ``units``. Attributes tell these
types apart: no library is imported.
"""

from __future__ import annotations

import numbers
import os
from collections.abc import Mapping, Sequence
from typing import Any

from roughvol.study.values.units import Quantity
from roughvol.study.yaml_text import KeyPath, number_text

ALLOWED = "text, a number, a path, a list or a mapping"
LONGEST = 1024  # bits of a whole number; floats end there
NO_UNIT = ("", "1", "length")  # attributes `units` of numbers without a unit


def plain(value: Any, problems: dict[KeyPath, str], path: KeyPath = ()) -> Any:
    """Return an object of Python as plain data; ``problems`` receives a message for each that is none."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str | Quantity):
        return str(value)
    if isinstance(value, Mapping) and not hasattr(value, "coords"):
        return _mapping(value, problems, path)
    number, unit = measured(value)
    if unit:
        return _with_unit(plain(number, problems, path), unit)
    if isinstance(number, numbers.Integral):
        whole = int(number)
        if whole.bit_length() <= LONGEST:
            return whole
        problems[path] = f"must be a finite number, given a whole number of {whole.bit_length()} bits"
        return None
    if isinstance(number, numbers.Real):
        return float(number)
    if isinstance(number, os.PathLike) and isinstance(text := os.fspath(number), str):
        return text
    if getattr(number, "ndim", 0) > 1:
        message = f"must be {ALLOWED}, given an array of shape {number.shape}"
        problems[path] = f"{message}; heights in memory are surface.heights"
        return None
    if hasattr(number, "dimensionality"):  # a unit of pint
        return f"{number:~C}"
    if hasattr(number, "tolist") and not isinstance(number, numbers.Number):
        return plain(number.tolist(), problems, path)
    if isinstance(number, Sequence) and not isinstance(number, bytes | bytearray | memoryview):
        return [plain(item, problems, (*path, index)) for index, item in enumerate(number)]
    problems[path] = f"must be {ALLOWED}, given a value of the type {type(number).__name__}"
    return None


def measured(value: Any) -> tuple[Any, str]:
    """Return the number of an object and its unit, as ``MPa``; other objects unchanged, and an empty text."""
    unit = ""
    if hasattr(value, "coords") and hasattr(value, "attrs") and hasattr(value, "data"):  # a DataArray
        unit, value = str(value.attrs.get("units", "")).strip(), value.data
        unit = "" if unit in NO_UNIT else unit
    if hasattr(value, "magnitude") and hasattr(value, "units"):  # a quantity of pint
        value, unit = value.magnitude, f"{value.units:~C}"
    return value, unit


def _mapping(value: Mapping[Any, Any], problems: dict[KeyPath, str], path: KeyPath) -> dict[str, Any]:
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
