"""Calls of the command line in this process, and studies that several files of tests run."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from click.testing import CliRunner, Result

from roughvol.cli import main

ROOT = Path(__file__).parents[1]
LEAKING = """
surface: {D: 2.3, m: 4, seeds: 1, L: 100 um, Sq: 1 um}
material: {E: 10 MPa, nu: 0.5}
sweep: {steps: 8, to: {pressure: 0.5 MPa}}
record:
  transport: {transmissivity: every-step}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""
LEAKING_GAS = f"""{LEAKING.partition("record:")[0]}fluid: {{gas: helium, inlet: 1 bar, outlet: 0 bar}}
record: {{transport: {{gas_flow: every-step}}, dimensional: {{pressure: MPa, gas_leak_rate: sccm}}}}
"""


def call(*arguments: object, **options: Any) -> Result:
    """Return the end of a command: exit code, output, errors."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments], **options)


def succeeded(*arguments: object, **options: Any) -> Result:
    """Return the end of a command that succeeds."""
    done = call(*arguments, **options)
    assert done.exit_code == 0, done.output
    return done


def said(*arguments: object) -> str:
    """Return the output of a command that succeeds."""
    return succeeded(*arguments).stdout


def answered(*arguments: object) -> Any:
    """Return the JSON of a command that succeeds."""
    return json.loads(said(*arguments, "--json"))


def refused(*arguments: object) -> str:
    """Return the message of a command that refuses its input."""
    done = call(*arguments)
    assert done.exit_code == 2, done.output
    assert "Traceback" not in done.output
    return done.stderr


def ran(name: str, text: str) -> str:
    """Write a study to the current folder and run it; return the output."""
    Path(f"{name}.yaml").write_text(text, encoding="utf-8")
    return said("run", f"{name}.yaml", "--jobs", "1")


@contextmanager
def without_figures() -> Iterator[None]:
    """Leave the figures out of reports: they take seconds, and are tested once."""
    of_claims, of_runs = "roughvol.reproduction.sections.drawings", "roughvol.report.page.drawings_of"
    with mock.patch(of_claims, return_value=()), mock.patch(of_runs, return_value=()):
        yield


def twin(name: str) -> str:
    """Return the folder of a copy of a run."""
    return str(shutil.copytree(f"runs/{name}", f"twins/{name}_twin", dirs_exist_ok=True))


def python(*words: object, first: Path = ROOT, **options: Any) -> subprocess.CompletedProcess[str]:
    """Return the end of Python in a process of its own that succeeds; modules of a folder come first."""
    there = os.environ | {"PYTHONPATH": f"{first}{os.pathsep}{ROOT}"}
    call = [sys.executable, *map(str, words)]
    done = subprocess.run(call, env=there, capture_output=True, text=True, timeout=290, **options)
    assert done.returncode == 0, done.stderr
    return done
