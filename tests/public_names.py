"""The public names of this version, from the tables that the program reads: `make public` writes them beside this file.

A name is what a user writes or reads: see docs/reference/promise.md.
"""

import contextlib
import dataclasses
import importlib
import inspect
import json
import re
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import click

import roughvol
from roughvol import plotting, spellings
from roughvol.campaign import signals
from roughvol.cli import group, main
from roughvol.observables.variables import VARIABLES
from roughvol.store import licences
from roughvol.study import STATE_KINDS
from roughvol.study.reference import keys
from roughvol.study.values import own
from roughvol.study.values.state_kinds import SYMBOLS
from tests.kit import said, twin, without_figures

FILE = Path(__file__).with_suffix(".toml")
PYTHON = Path(__file__).parents[1] / "docs" / "reference" / "python.md"  # its names are public
STUDY = """
surface: {D: 2.2, m: 3, L: 100 um, Sq: 0.5 um, seeds: [1]}
material: {E_star: 10 MPa}
sweep: {steps: 3, to: {pressure: 0.2 MPa}}
fluid: {gas: helium, inlet: 100 mbar, outlet: 0 mbar}
record:
  transport: {percolation: every-step, constriction: every-step, transmissivity: every-step, gas_flow: every-step}
  dimensional:
    {pressure: MPa, mean_gap: um, critical_gap: um, gas_leak_rate: mbar*l/s,
     leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa*s}}
seal: {length: 5 mm, width: 0.1 mm}
"""
LEAK = "1e-6 mm^3/s"
ASKED = {  # words of each command with --json, behind its name
    "ask": ["seal", "--leak-rate", LEAK],
    "card": ["seal", "--at", "pressure=0.1 MPa", "--jobs", "1"],
    "check": ["seal.yaml"],
    "compare": ["seal", "twins/seal_twin"],
    "creep": ["seal", "--law", "law.yaml", "--at", "pressure=0.05 MPa", "--times", "1 s"],
    "licences": [],
    "ls": [],
    "report": ["seal"],
    "run": ["seal.yaml"],
    "show": ["seal"],
    "status": ["seal"],
    "tradeoff": ["small.yaml"],
}
IN_WORDS = {  # parts of answers whose keys are words, or those of a study
    "check: study",
    "licences: rows[].parts",
    "report: claims[].refused",
    "report: counts",
    "report: runs[].libraries",
    "report: surfaces[].loading",
    "report: surfaces[].surface",
    "status: versions",
}


def public() -> dict[str, list[str]]:
    """Return all public names by their kind, as in the table of former spellings."""
    paths = keys()
    codes = (0, group.FAILED, group.BAD_INPUT, *(group.BY_SIGNAL + number for number in map(int, signals.ALL)))
    without_parts = mock.patch.object(licences, "_parts", return_value=())  # their search takes a second
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), without_figures(), without_parts:
        attributes, answers = _of_runs()
    found: dict[spellings.Kind, set[str]] = {
        "key": {key.path for key in paths}
        | {f"{key.path}={word}" for key in paths for word in re.findall(r"'([^']+)'", key.values)},
        "load": {*STATE_KINDS, *SYMBOLS, "last", "step"},
        "variable": {f"{name} ({row.dims})".replace(" ()", "") + f" [{row.units}]" for name, row in VARIABLES.items()},
        "attribute": attributes,
        "figure": set(plotting.NAMES),
        "option": set(_options()),
        "answer": answers,
        "exit code": set(map(str, codes)),
        "name": set(_names()),
        "entry point": {own.GROUP},
    }
    return {kind: sorted(names) for kind, names in found.items()}


def stored() -> dict[str, list[str]]:
    """Return the public names as `make public` wrote them last."""
    return tomllib.loads(FILE.read_text(encoding="utf-8"))


def gone(before: dict[str, list[str]], now: dict[str, list[str]]) -> list[str]:
    """Return the names that are public no more, without a row in the table of former spellings."""
    lost = [(kind, name) for kind, names in before.items() for name in sorted({*names} - {*now.get(kind, ())})]
    return [f"{kind}: {name}" for kind, name in lost if spellings.former(kind, name) is None]


def _commands() -> dict[str, click.Command]:
    """Return the commands by name."""
    context = click.Context(main)
    found = {name: main.get_command(context, name) for name in main.list_commands(context)}
    return {name: command for name, command in found.items() if command is not None}


def _options() -> Iterator[str]:
    """Yield the commands, each with its arguments and its options."""
    for name, command in _commands().items():
        yield name
        for parameter in command.params:
            words = parameter.opts if isinstance(parameter, click.Option) else [parameter.human_readable_name]
            yield from (f"{name} {word}" for word in words)


def _names() -> Iterator[str]:
    """Yield the names of the Python page, each with its parameters or members."""
    text = PYTHON.read_text(encoding="utf-8")
    documented = re.findall(r"^\.\. auto(?:function|class):: ([\w.]+)", text, re.MULTILINE)
    for name in dict.fromkeys([*(f"roughvol.{name}" for name in roughvol.__all__), *documented]):
        module, _, last = name.rpartition(".")
        value = getattr(importlib.import_module(module), last)
        yield name
        if inspect.isclass(value):
            yield from (f"{name}.{member}" for member in _members(value))
        if callable(value) and not (inspect.isclass(value) and issubclass(value, Exception)):
            yield from (
                f"{name}({one})" for one in inspect.signature(value).parameters if one[0] != "_" and one != "self"
            )


def _members(kind: type) -> Iterator[str]:
    """Yield methods, properties and fields of a class of this package."""
    fields = {field.name for field in dataclasses.fields(kind)} if dataclasses.is_dataclass(kind) else set()
    for one in kind.__mro__:
        if one.__module__.startswith("roughvol"):
            fields |= {name for name, value in vars(one).items() if callable(value) or isinstance(value, property)}
    yield from sorted(name for name in fields if not name.startswith("_"))


def _of_runs() -> tuple[set[str], set[str]]:
    """Return the attributes of a dataset, and the keys of the answers of all commands."""
    Path("seal.yaml").write_text(STUDY, encoding="utf-8")
    Path("small.yaml").write_text("surface: {D: 2.3, m: 2, seeds: 1}\nsweep: {steps: 2}\n", encoding="utf-8")
    Path("law.yaml").write_text("power: {exponent: 0.1, time: 1 s}\n", encoding="utf-8")
    said("run", "seal.yaml")
    twin("seal")
    answers = set[str]()
    for name, command in _commands().items():
        if any("--json" in parameter.opts for parameter in command.params):
            text = said(name, *ASKED[name], "--json")
            answers |= set(_paths(json.loads(text), f"{name}: "))
    return set(roughvol.open("seal").attrs), answers


def _paths(value: Any, before: str) -> Iterator[str]:
    """Yield the dotted keys of JSON; items of lists are alike."""
    if isinstance(value, list):
        for item in value:
            yield from _paths(item, f"{before}[]")
    elif isinstance(value, dict) and before not in IN_WORDS:
        for name, inner in value.items():
            here = f"{before}.{name}".replace(": .", ": ")
            yield here
            yield from _paths(inner, here)


def write() -> None:
    """Write the public names; refuse to drop one that has no row in the table of former spellings."""
    now = public()
    if FILE.exists() and (lost := gone(stored(), now)):
        raise SystemExit("public no more, without a row in roughvol/spellings.py:\n" + "\n".join(lost))
    lines = ["# Public names; `make public` writes this file."]
    for kind, names in now.items():
        lines += [f'"{kind}" = [', *(f"  {json.dumps(name, ensure_ascii=False)}," for name in names), "]"]
    FILE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write()
