"""Rules that figures and claims share: the paper's single surface and state, the nearest to them, and A*/p*."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeVar

import numpy as np

from roughvol.typing import Array

PAPER_D, PAPER_M = 2.3, 7  # the paper's single surface, Figs. 4b and 7 to 12b
PAPER_A = 0.1  # its contact area in Figs. 8 to 11

Key = TypeVar("Key")


def nearest(values: Iterable[float], wish: float) -> float:
    """Return the value nearest to a wish, the larger of two.

    Parameters
    ----------
    values : iterable of float
        The values.
    wish : float
        The wish.

    Returns
    -------
    float
        One of the values.
    """
    return min(values, key=lambda value: _distance(value, wish))


def nearest_surface(surfaces: Mapping[Key, tuple[float | None, float | None]]) -> Key:
    """Return the key of the surface nearest to the paper's: first in D, then in m.

    Parameters
    ----------
    surfaces : mapping of key to (D, m)
        None where a surface has none. The first of equally near ones is taken.

    Returns
    -------
    key
        That of the nearest surface.
    """

    def distance(key: Key) -> list[tuple[float, float]]:
        wishes = zip(surfaces[key], (PAPER_D, PAPER_M), strict=True)
        return [(0.0, 0.0) if value is None else _distance(value, wish) for value, wish in wishes]

    return min(surfaces, key=distance)


def nearest_state(areas: Mapping[Key, float]) -> Key:
    """Return the key of the state whose A* is nearest to the paper's, the first of two.

    Parameters
    ----------
    areas : mapping of key to float
        A* of each state.

    Returns
    -------
    key
        That of the nearest state.
    """
    return min(areas, key=lambda key: abs(areas[key] - PAPER_A))


def area_slopes(curves: Mapping[Key, tuple[Array, Array]]) -> tuple[dict[Key, Array], float]:
    """Return A*/p* of every surface, and the pressure up to which it is taken: the rule of Fig. 4b.

    Slope of the least-squares line through the origin over 0 < p* ≤ limit. The limit is the largest pressure that all
    surfaces reach. Where some begin later it is the largest of the first pressures, so that each has a step below it.

    Parameters
    ----------
    curves : mapping of key to (p*, A*)
        Arrays of shape (surfaces, steps), NaN where a state is missing.

    Returns
    -------
    dict
        A*/p* by key, shape (surfaces,).
    float
        The limit.
    """
    limit = min(float(np.nanmax(p, axis=1).min()) for p, _ in curves.values())
    limit = max(limit, *(float(np.nanmin(p, axis=1).max()) for p, _ in curves.values()))
    slopes = {}
    for key, (p, area) in curves.items():
        used = np.where(p <= limit, p, 0.0)
        slopes[key] = np.nansum(used * area, axis=1) / np.nansum(used * p, axis=1)
    return slopes, limit


def _distance(value: float, wish: float) -> tuple[float, float]:
    return abs(value - wish), -value
