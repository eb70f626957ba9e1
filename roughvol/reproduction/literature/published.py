"""The table of published numbers, `published.toml`: texts, criteria and the functions that answer its rows."""

from __future__ import annotations

import functools
import math
from typing import Any

from roughvol.reproduction.claims.evidence import Question, claim
from roughvol.reproduction.claims.verdict import Check, Number
from roughvol.tables import table

PUBLISHED: dict[str, Any] = table(__file__)
LITERATURE: dict[int, Question] = {}
cited = functools.partial(claim, among=LITERATURE, texts=PUBLISHED)


def judged(id: int, *numbers: Number) -> list[Check]:
    """Return the criteria of a row for its numbers, number by number."""
    criteria = PUBLISHED[str(id)]["criterion"]
    return [
        Check.within(row["words"], number, _limits(row), essential=row.get("essential", True))
        for number in numbers
        for row in criteria
        if number.key.startswith(row.get("number", ""))
    ]


def _limits(row: dict[str, Any]) -> tuple[float, float]:
    return row.get("above", -math.inf), row.get("below", math.inf)
