"""Public functions document every parameter and what they return; `make lint` checks the form of the sections."""

import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import roughvol
from roughvol.analysis.accessor import Accessor

ROOMS = ("", "surfaces", "study", "contact", "gap", "observables", "ensemble", "store", "campaign", "report")
SECTIONS = ("PR01", "RT01", "YD01")  # parameters, what is returned, what is yielded
PAGE = Path(__file__).parents[1] / "docs" / "reference" / "python.md"


def _public() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield the functions that a room names in its table of contents, by their full names."""
    for room in ROOMS:
        module = importlib.import_module(f"roughvol.{room}".rstrip("."))
        for name in module.__all__:
            if inspect.isfunction(function := getattr(module, name)):
                yield f"{function.__module__}.{function.__name__}", function


PUBLIC = dict(_public())


def test_public_functions_document_parameters_and_results() -> None:
    validate = pytest.importorskip("numpydoc.validate", reason="needs roughvol[dev]")
    errors = [(name, *error) for name in PUBLIC for error in validate.validate(name)["errors"]]
    assert [(name, text) for name, code, text in errors if code in SECTIONS] == []


def _on_the_page() -> Iterator[tuple[str, Any]]:
    """Yield the functions and classes that users call: of the package, of the reference page, of the accessor."""
    named = re.findall(r"^\.\. auto(?:function|class):: (\S+)", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    for name in sorted({f"roughvol.{name}" for name in roughvol.__all__} | set(named)):
        module, _, last = name.rpartition(".")
        thing = getattr(importlib.import_module(module), last)
        if callable(thing):
            yield name, thing
    for name, method in vars(Accessor).items():
        if not name.startswith("_"):
            yield f"ds.roughvol.{name}", method


def test_what_users_call_has_an_example_and_refers_to_its_neighbours() -> None:
    """`tests/test_examples.py` runs the examples."""
    for name, thing in _on_the_page():
        text = inspect.getdoc(thing) or ""
        assert [section for section in ("Examples", "See Also") if f"\n{section}\n---" not in text] == [], name
        assert text.count("\n>>> ") > 1, name


def test_the_page_has_every_function_of_the_package() -> None:
    text = PAGE.read_text(encoding="utf-8")
    public = {name for name in roughvol.__all__ if inspect.isfunction(getattr(roughvol, name))}
    assert {name for name in public if f".. autofunction:: roughvol.{name}\n" not in text} == set()


def test_the_records_of_the_page_have_the_attributes_that_it_names() -> None:
    row = re.compile(r"^\| (.*?) ?\| `([a-z_.]+\.[A-Z]\w+)` \| (.*) \|$", re.MULTILINE)
    text = PAGE.read_text(encoding="utf-8")
    rows = row.findall(text)
    functions, held_by = set(), dict[str, set[str]]()
    for function, path, names in rows:
        module, _, name = f"roughvol.{path}".rpartition(".")
        record = getattr(importlib.import_module(module), name)
        held = held_by[name] = {*dir(record), *record.__annotations__}
        assert set(re.findall(r"`(\w+)`", names)) <= held, path
        functions |= set(re.findall(r"`(\w+)`", function))
    assert functions < set(roughvol.__all__)
    assert len(rows) > 12
    meanings = re.findall(r"^\| (`[A-Z]\w+\.\w+.*?) \|", text, re.MULTILINE)
    explained = [pair for cell in meanings for pair in re.findall(r"`(\w+)\.(\w+)(?:\.\w+)?`", cell)]
    assert [pair for pair in explained if pair[1] not in held_by.get(pair[0], ())] == []
    assert len(explained) > 20


def test_a_function_without_its_sections_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    validate = pytest.importorskip("numpydoc.validate", reason="needs roughvol[dev]")
    monkeypatch.setattr(PUBLIC["roughvol.study.reading.load"], "__doc__", "Read a study file.")
    found = {code for code, _ in validate.validate("roughvol.study.reading.load")["errors"]}
    assert {"PR01", "RT01"} <= found
