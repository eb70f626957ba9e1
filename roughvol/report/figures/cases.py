"""Surfaces and states that a figure shows: all D, all m, or the single one nearest to D = 2.3, m = 7.

The rules hold for datasets (`families`) and for the cases of a study before a case is computed (`Figure.cases`). Cases
are left out, never parts of a case: records belong to the identity of a case, so that the study needs the same case
later.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TypeVar

from roughvol.study import Case

SHOWN_D, SHOWN_M = 2.3, 7  # of the single surface
FINEST = 1e9  # a wish for the largest m

Key = TypeVar("Key")
Rule = Callable[[Sequence[Case]], list[Case]]


def nearest(values: Iterable[float], wish: float) -> float:
    """Return the value nearest to a wish, the larger of two."""
    return min(values, key=lambda value: _distance(value, wish))


def nearest_surface(surfaces: Mapping[Key, tuple[float | None, float | None]]) -> Key:
    """Return the key of the (D, m) nearest to the single surface, first in D; None where a surface has none."""

    def distance(key: Key) -> list[tuple[float, float]]:
        wishes = zip(surfaces[key], (SHOWN_D, SHOWN_M), strict=True)
        return [(0.0, 0.0) if value is None else _distance(value, wish) for value, wish in wishes]

    return min(surfaces, key=distance)


def by_D(cases: Sequence[Case], wish: float = FINEST) -> list[Case]:
    """Return the cases of every D at the m nearest to a wish; all cases of height files."""
    levels = [case.m for case in cases if case.m is not None]
    m = nearest(levels, wish) if levels else None
    return [case for case in cases if m is None or case.m == m]


def by_m(cases: Sequence[Case]) -> list[Case]:
    """Return the cases of every m at the D nearest to that of the single surface; all cases of height files."""
    values = [case.D for case in cases if case.D is not None]
    D = nearest(values, SHOWN_D) if values else None
    return [case for case in cases if D is None or case.D == D]


def single(cases: Sequence[Case]) -> list[Case]:
    """Return the case nearest to the single surface."""
    return [cases[nearest_surface({k: (case.D, case.m) for k, case in enumerate(cases)})]]


def one_family(cases: Sequence[Case]) -> list[Case]:
    """Return the cases of the largest m at the D nearest to that of the single surface."""
    return by_m(by_D(cases))


def _distance(value: float, wish: float) -> tuple[float, float]:
    return abs(value - wish), -value


CASES: Mapping[str, Rule] = {
    "by_D": by_D,
    "by_D_at_7": partial(by_D, wish=SHOWN_M),
    "by_m": by_m,
    "one_family": one_family,
    "single": single,
    "all": list,
}
"""Rules by their names in tables of figures."""
