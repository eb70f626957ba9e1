"""Quantities of a user: functions of a solved state that a study names, as ``my_module:my_function``.

A function takes a `observables.own.SolvedState` and returns a number, or an array whose dimensions it names. What it is
stands on it as attributes, all optional:

``units``        text; default "1". "length" is the unit of the study
``symbol``       as "f(g)"; default: the name in the study
``label``        what it is, in words; default: the first line of its docstring
``coordinates``  {dimension: labels} of an array, in the order of its dimensions; "axis" has the labels x and y
``touch``        the number at first touch, for the mean of an ensemble before the first step; default: unknown
``version``      text; a new one makes studies compute their cases anew
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Annotated, Any

from pydantic import BeforeValidator, PlainSerializer, PlainValidator, WithJsonSchema

from roughvol.study.values.types import refuse

GROUP = "roughvol.observables"
"""Entry points of installed packages; a study takes one by its name, in place of ``module:function``."""
_NAME = re.compile(r"[a-z][a-z0-9_]*")
_TARGET = re.compile(r"[A-Za-z_][\w.]*(:[A-Za-z_]\w*)?")


@dataclass(frozen=True)
class OwnQuantity:
    """A quantity of a user: ``module:function`` or the name of an entry point, and the version of the function."""

    target: str
    version: str = ""

    @property
    def function(self) -> Callable[[Any], Any]:
        """The function, imported where it has not been yet."""
        return function_of(self.target)


def offered() -> list[str]:
    """Return the names of the entry points that installed packages offer."""
    return sorted(entry_points(group=GROUP).names)


@functools.cache
def function_of(target: str) -> Callable[[Any], Any]:
    """Return the function of a target, from an installed module, or a module in the current folder.

    A script that ends the program where it is imported is an error of the import.
    """
    module, _, name = target.partition(":")
    sys.path.append("")  # modules of the current folder, behind installed ones
    try:
        if name:
            found = getattr(importlib.import_module(module), name)
        else:
            points = list(entry_points(group=GROUP, name=target))
            if not points:
                known = ", ".join(offered()) or "none is installed"
                raise ImportError(f"no entry point of {GROUP}; allowed: module:function, or an entry point ({known})")
            found = points[0].load()
    except SystemExit as error:
        raise ImportError(f"{module} ends the program when it is imported: {error}") from error
    finally:
        sys.path.remove("")
    if not callable(found):
        raise AttributeError(f"{target} is no function")
    function: Callable[[Any], Any] = found
    return function


def _some(value: Any) -> Any:
    """Refuse plain data that names no quantity."""
    if not isinstance(value, dict) or not value:
        refuse("must be a mapping of names to functions, as {example}", example="{my_number: my_module:my_function}")
    return value


def _name(value: Any) -> str:
    if not isinstance(value, str) or not _NAME.fullmatch(value):
        refuse("is no name; allowed: small letters, digits and _, a letter first")
    return value


def _quantity(target: Any) -> OwnQuantity:
    """Return the quantity of a target."""
    if not isinstance(target, str) or not _TARGET.fullmatch(target):
        refuse("is no function; allowed: module:function")
    with contextlib.suppress(Exception):  # a stored run is read without its functions; a run needs them
        return OwnQuantity(target, str(getattr(function_of(target), "version", "")))
    return OwnQuantity(target)


Own = Annotated[
    dict[
        Annotated[str, PlainValidator(_name)],
        Annotated[OwnQuantity, PlainValidator(_quantity), PlainSerializer(lambda quantity: quantity.target)],
    ],
    BeforeValidator(_some),
    WithJsonSchema({"type": "object", "minProperties": 1, "additionalProperties": {"type": "string"}}),
]
"""The quantities of a study by name."""
