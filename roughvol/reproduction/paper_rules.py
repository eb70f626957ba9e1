"""The paper's single surface and state, and its slope A*/p*, for figures and claims."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from roughvol.report.figures import cases
from roughvol.typing import Array

PAPER_D, PAPER_M = cases.SHOWN_D, cases.SHOWN_M  # Figs. 4b and 7 to 12b
PAPER_A = cases.SHOWN_A  # contact area in Figs. 8 to 11

Key = TypeVar("Key")


def area_slopes(curves: Mapping[Key, tuple[Array, Array]]) -> tuple[dict[Key, Array], float]:
    """Return A*/p* of every surface by key, and the pressure up to which it is taken: the rule of Fig. 4b.

    Slope of the least-squares line through the origin over 0 < p* ≤ limit. The limit is the largest pressure that all
    surfaces reach. Where some begin later it is the largest of the first pressures, so that each has a step below it.
    ``curves`` are (p*, A*), arrays of shape (surfaces, steps), NaN where a state is missing.
    """
    limit = min(float(np.nanmax(p, axis=1).min()) for p, _ in curves.values())
    limit = max(limit, *(float(np.nanmin(p, axis=1).max()) for p, _ in curves.values()))
    slopes = {}
    for key, (p, area) in curves.items():
        used = np.where(p <= limit, p, 0.0)
        slopes[key] = np.nansum(used * area, axis=1) / np.nansum(used * p, axis=1)
    return slopes, limit
