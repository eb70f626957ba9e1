"""Tables of studies, cases of height files, and the problems of studies that are refused."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from roughvol.campaign import case_surface
from roughvol.errors import Problem, StudyError
from roughvol.study import Case, loads
from roughvol.surfaces import Surface

FIRST = "surface: {D: 2.3, m: 4}\n"
STARTS = {  # of the texts of tables
    "+ ": FIRST,
    "um+ ": "surface: {D: 2.3, m: 4, L: 100 um, Sq: 1 um}\n",
    "periodic+ ": "surface: {D: 2.3, m: 4, L: 100 um, Sq: 1 um, sides: periodic}\n",
}


def table(name: str) -> dict[str, Any]:
    return tomllib.loads((Path(__file__).parent / name).read_text(encoding="utf-8"))


def in_full(text: str) -> str:
    start, found, rest = text.partition("+ ")
    return STARTS[start + found] + rest if start + found in STARTS else text


def case_of(folder: Path, surface: str, rest: str = "") -> Case:
    (case,) = loads(f"surface: {{{surface}}}\n{rest}", folder / "study.yaml").cases()
    return case


def surface_of(folder: Path, surface: str) -> Surface:
    """Return the surface that is pressed, of as many nodes as its case has."""
    case = case_of(folder, surface)
    made = case_surface.surface_of(case)
    assert made.shape == case.shape
    return made


def problems_of(text: str, file: str | Path = "a.yaml") -> tuple[Problem, ...]:
    with pytest.raises(StudyError) as caught:
        loads(text, file)
    return caught.value.problems
