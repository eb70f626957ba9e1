"""The tables of the pages: each names the command and the version that made it, and agrees with what is stored."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.bench import solver
from tests.extremes.__main__ import HEAD, TAIL
from tests.extremes.matrix import CELLS

ROOT = Path(__file__).parents[1]
MARK = re.compile(r"<!-- made by: make ([\w-]+), roughvol (\d+\.\d+\.\d+) -->")
PAGES = {"README.md": 3, "docs/extremes.md": 1, "docs/tradeoff.md": 1}


def _text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.mark.parametrize(("page", "count"), PAGES.items())
def test_measured_tables_name_a_command_and_a_version_that_exist(page: str, count: int) -> None:
    marks = MARK.findall(_text(page))
    assert len(marks) == count
    for command, version in marks:
        assert re.search(rf"^{command}:", _text("Makefile"), re.MULTILINE)
        assert f"\n## {version} (" in _text("CHANGELOG.md")
        assert f"`make {command}`" in _text(page)


def test_versions_that_the_readme_names_are_those_of_its_marks() -> None:
    text = _text("README.md")
    marked = {version for _, version in MARK.findall(text)}
    assert set(re.findall(r"roughvol (\d+\.\d+\.\d+)", MARK.sub("", text))) <= marked
    assert "with roughvol " + MARK.findall(text)[-1][1] in text  # the peers were measured by an older one


def test_the_counts_of_the_readme_are_those_stored() -> None:
    text = _text("README.md")
    table = text[text.index("| m | η/σ ≤ |") :]
    rows = re.findall(r"^\| (\d+) \| (1e-\d\d) \| ([\d.]+) \| ([\d.]+) \|", table, re.MULTILINE)
    stored = json.loads(solver.BASELINE.read_text(encoding="utf-8"))
    assert len(rows) == 14
    for m, rtol, *counts in rows:
        same = [row for row in stored if (row["m"], row["rtol"]) == (int(m), float(rtol))]
        assert len(same) == 6  # D = 2.1, 2.5, 2.9 and two seeds
        assert counts == [f"{np.mean([row[kind] for row in same]):.2f}" for kind in ("fp64", "fp32")], (m, rtol)


def test_the_page_of_extremes_is_as_its_command_writes_it() -> None:
    page = MARK.sub("", _text("docs/extremes.md"))
    head = MARK.sub("", HEAD)
    assert page.startswith(head)
    assert page.endswith(TAIL)
    rows = page[len(head) : -len(TAIL)].splitlines()
    assert [tuple(row.split(" | ")[:2]) for row in rows] == [(f"| {cell.group}", cell.name) for cell in CELLS]


def test_what_the_readme_takes_from_the_page_of_the_tradeoff_is_there() -> None:
    page, text = _text("docs/tradeoff.md"), " ".join(_text("README.md").split())
    (saved,) = re.findall(r"\*\*Ten times less accuracy costs (\d+) per cent less time\.\*\*", page)
    assert f"**Ten times less accuracy costs {saved} per cent less time**" in text
    counts = dict(re.findall(r"^\| ([^|]+) \| (\d+) \|", page, re.MULTILINE))
    for name, sentence in {
        "the state at A* = 0.1, by search": "takes {} convolutions",
        "the state at p* = 1, by search": "that at p* = 1 takes {}",
        "the state where the void closes, by search": "the closing of the last channel {}",
        "60 states, numbers only": "60 states to d = 0 take {}",
    }.items():
        assert sentence.format(counts[name]) in text
