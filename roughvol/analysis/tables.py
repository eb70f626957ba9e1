"""Tables of a report: rows of text under a head, and numbers in four digits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

SMALLEST, LARGEST = 1e-4, 1e6  # numbers between them have no exponent


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


def number(value: float, digits: int = 4) -> str:
    """Return a number in four digits, as 0.06103 or 2.2e-5; a dash where there is none."""
    return f"{value:.{digits}g}".replace("e-0", "e-").replace("e+0", "e") if math.isfinite(value) else "–"


def rounded(value: float, low: float, high: float) -> str:
    """Return a number in the digits that its interval leaves: two to six of them."""
    half = 0.5 * (high - low)
    if not (math.isfinite(value) and value != 0.0 and math.isfinite(half) and half > 0.0):
        return number(value)
    size = math.floor(math.log10(abs(value)))
    digits = min(max(size - math.floor(math.log10(half)) + 1, 2), 6)
    if not SMALLEST <= abs(value) < LARGEST:
        return f"{value:.{digits - 1}e}".replace("e-0", "e-").replace("e+0", "e")
    decimals = digits - 1 - size
    return f"{round(value, decimals):.{max(decimals, 0)}f}"
