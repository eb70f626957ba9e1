"""Tables of studies, and the problems of studies that are refused."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from roughvol.errors import Problem, StudyError
from roughvol.study import loads

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


def problems_of(text: str, file: str | Path = "a.yaml") -> tuple[Problem, ...]:
    with pytest.raises(StudyError) as caught:
        loads(text, file)
    return caught.value.problems
