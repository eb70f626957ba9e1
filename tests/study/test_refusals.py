"""Studies that are refused: `refusals.toml` has a table for each section."""

import pytest

from tests.study.kit import FIRST, in_full, problems_of, table

TABLE = table("refusals.toml")
TABLE["large"] = [  # texts too large for the table
    ("a:\n " + "[" * 5000, 2, "", "nested more than 20 levels deep"),
    (FIRST + "#" * (1 << 20), 0, "", "larger than 1024 KiB"),
    (f"surface: {{D: 2.3, m: 4, L: {'9' * 5000}}}", 1, "surface.L", "must be a finite number, given 99"),
    (FIRST + "name: " + "a" * 101, 2, "name", "must have at most 100 characters"),
    (f"{FIRST}material: {{E: {list(range(1, 1002))}, nu: 0.5}}", 2, "material.E", "make 1001 combinations"),
]
JARGON = ("Input should", "pydantic", "Value error", "validation", "<", "Literal", "float_type")


@pytest.mark.parametrize("section", TABLE)
def test_a_bad_study_is_refused_with_place_and_advice(section: str) -> None:
    for text, line, key, said, *count in TABLE[section]:
        problems = problems_of(in_full(text))
        assert len(problems) == (count or [1])[0], (text, problems)  # one mistake is one problem
        (found,) = (problem for problem in problems if problem.key == key)
        assert said in found.message, text
        assert (found.line, found.file) == (line or None, "a.yaml"), text
        assert not [word for word in JARGON if word in found.message.replace("<=", "").replace(" < ", "")], text
