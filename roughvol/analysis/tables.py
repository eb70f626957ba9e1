"""Tables of a report: rows of text under a head, and numbers in four digits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Table:
    """Rows of text under a head, with a sentence above."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def under(self, words: str) -> Table:
        """Return the table with words in front of its title."""
        return replace(self, title=", ".join(filter(None, (words, self.title))))


def number(value: float) -> str:
    """Return a number in four digits, as 0.06103 or 2.2e-05; a dash where there is none."""
    return f"{value:.4g}".replace("e-0", "e-").replace("e+0", "e") if math.isfinite(value) else "–"
