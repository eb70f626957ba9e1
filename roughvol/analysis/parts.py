"""Parts of the error of a number, of a leak or of a closing load.

Each part is a factor, and may reach farther up than down. Parts are independent, so their logarithms add in squares. If
a part is not known, the whole error is not known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Part:
    """A part of the error of a leak or of a closing load: its source, its size, and in words how it was found.

    The number may be ``factor`` times larger: ≥ 1, infinite or NaN where it is not known. It may be ``smaller`` times
    smaller: infinite where it may be 0, by default ``factor``.
    """

    name: str
    factor: float
    words: str
    smaller: float = math.nan

    def __post_init__(self) -> None:
        if math.isnan(self.smaller):
            object.__setattr__(self, "smaller", self.factor)

    @property
    def known(self) -> bool:
        """Whether the factor is known."""
        return math.isfinite(self.factor)


def together(parts: Sequence[Part]) -> tuple[float, float]:
    """Return how many times smaller and larger a number may be by all parts; NaN if a part is not known."""
    if not parts or not all(part.known for part in parts):
        return math.nan, math.nan
    sides = ([math.log(part.smaller) for part in parts], [math.log(part.factor) for part in parts])
    smaller, larger = (math.exp(math.hypot(*logs)) for logs in sides)
    return smaller, larger


def factors_of(value: float, interval: tuple[float, float]) -> tuple[float, float]:
    """Return the ends of an interval over its number > 0; NaN where they are not known."""
    if not (value > 0.0 and all(map(math.isfinite, interval))):
        return math.nan, math.nan
    return interval[0] / value, interval[1] / value


class WithParts:
    """A number with the parts of its error."""

    parts: tuple[Part, ...]

    @property
    def factor(self) -> float:
        """All parts together: the number may be as many times larger. NaN if a part is not known."""
        return together(self.parts)[1]

    @property
    def smaller(self) -> float:
        """All parts together: the number may be as many times smaller; infinite where it may be 0."""
        return together(self.parts)[0]

    @property
    def unknown(self) -> str:
        """The names of the parts that are not known."""
        return ", ".join(part.name for part in self.parts if not part.known)
