"""Studies that are refused: `refusals.toml` has a table for each section."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from tests.study.kit import problems_of

FIRST = "surface: {D: 2.3, m: 4}\n"
TABLE = tomllib.loads((Path(__file__).parent / "refusals.toml").read_text(encoding="utf-8"))
LARGE = [  # texts too large for the table
    ("a:\n " + "[" * 5000, 2, "", "nested more than 20 levels deep"),
    (FIRST + "#" * (1 << 20), 0, "", "larger than 1024 KiB"),
    (f"surface: {{D: 2.3, m: 4, L: {'9' * 5000}}}", 1, "surface.L", "must be a finite number, given 99"),
    (FIRST + "name: " + "a" * 101, 2, "name", "must have at most 100 characters"),
]
JARGON = ("Input should", "pydantic", "Value error", "validation", "<", "Literal", "float_type")


@pytest.mark.parametrize(("text", "line", "key", "said", "count"), [
    (row[0].replace("+ ", FIRST, 1) if row[0].startswith("+ ") else row[0], *row[1:4], row[4] if len(row) > 4 else 1)
    for row in (*(row for rows in TABLE.values() for row in rows), *LARGE)
])  # fmt: skip
def test_a_bad_study_is_refused_with_place_and_advice(text: str, line: int, key: str, said: str, count: int) -> None:
    problems = problems_of(text)
    assert len(problems) == count, problems  # one mistake is one problem
    (found,) = (problem for problem in problems if problem.key == key)
    assert said in found.message
    assert (found.line, found.file) == (line or None, "a.yaml")
    assert not [word for word in JARGON if word in found.message.replace("<=", "").replace(" < ", "")]
