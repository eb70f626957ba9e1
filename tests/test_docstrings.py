"""Public functions document every parameter and what they return; `make lint` checks the form of the sections."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterator
from typing import Any

import pytest

ROOMS = ("", "surfaces", "study", "contact", "gap", "observables", "ensemble", "store", "campaign", "report")
SECTIONS = ("PR01", "RT01", "YD01")  # parameters, what is returned, what is yielded
NOT_YET: tuple[str, ...] = ()


def _public() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield the functions that a room names in its table of contents, by their full names."""
    for room in ROOMS:
        module = importlib.import_module(f"roughvol.{room}".rstrip("."))
        for name in module.__all__:
            if inspect.isfunction(function := getattr(module, name)):
                yield f"{function.__module__}.{function.__name__}", function


PUBLIC = dict(_public())


@pytest.mark.parametrize("name", sorted(PUBLIC.keys() - set(NOT_YET)))
def test_public_functions_document_parameters_and_results(name: str) -> None:
    validate = pytest.importorskip("numpydoc.validate", reason="needs roughvol[dev]")
    errors = validate.validate(name)["errors"]
    assert [text for code, text in errors if code in SECTIONS] == []


def test_a_function_without_its_sections_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    validate = pytest.importorskip("numpydoc.validate", reason="needs roughvol[dev]")
    monkeypatch.setattr(PUBLIC["roughvol.study.reading.load"], "__doc__", "Read a study file.")
    found = {code for code, _ in validate.validate("roughvol.study.reading.load")["errors"]}
    assert {"PR01", "RT01"} <= found
