"""A level beside stored states: how near is the level, and which step has it.

A stored step that misses a level by less than `REACHED` is that level. Searches end within 1e-6 of the indentation, and
a load grows with a power of the indentation: 4.2e-6 at most over 24 surfaces of m = 7.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from roughvol.study.sections.sweep import Legs, Sweep
from roughvol.study.values.state_kinds import Level

REACHED = 1e-5  # relative; of d/σ, which passes 0, a share of σ at least


def slack(kind: str, value: float, share: float = REACHED) -> float:
    """Return by how much a state may miss a starred level that it has reached."""
    return share * max(abs(value), 1.0 if kind == "separation" else 1e-12)


def step_at(level: Level, values: ArrayLike) -> int | None:
    """Return the first stored step that reaches a state to `REACHED`.

    Parameters
    ----------
    level : Level
        A starred state: kind and value.
    values : array, shape (steps,)
        The quantity of its kind at each step; NaN where nothing is known.

    Returns
    -------
    int or None
        Index of the step; None if no step lies there.

    Examples
    --------
    >>> step_at(Level("pressure", 0.2), [0.1, 0.2000002, 0.3])
    1
    """
    if level.value is None:
        return None
    near = np.abs(np.asarray(values, dtype=np.float64) - level.value) <= slack(level.kind, level.value)
    return int(np.argmax(near)) if near.any() else None


def defined_step(level: Level, sweep: Sweep | Legs) -> int | None:
    """Return the step that a sweep defines as a state: a listed state, or the end of the first leg.

    The solve of such a step may miss the state by more than `REACHED` where the residual asked for is large.

    Parameters
    ----------
    level : Level
        A state, with the unit of the sweep if it has one.
    sweep : Sweep or Legs
        The section of the study.

    Returns
    -------
    int or None
        Index of the step, from 0; None for other states.

    Examples
    --------
    >>> defined_step(Level("pressure", 0.2), Sweep(pressures=[0.1, 0.2]))
    1
    """
    first = sweep.legs[0]
    if first.listed is not None:
        return first.listed.index(level) if level in first.listed else None
    return first.steps - 1 if level == first.target else None
