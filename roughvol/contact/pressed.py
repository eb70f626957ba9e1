"""The state of elastic contact under a given load, by the secant of the load over the indentation."""

from __future__ import annotations

import math

from roughvol.contact.loading import Trials
from roughvol.contact.state import Contact
from roughvol.errors import ConvergenceError

ACCURACY = 1e-10  # relative, of the load
SOLVES = 100
GROWTH = 1.5  # of the indentation, while no state carries enough


def state_under(trials: Trials, pressure: float, guess: float, *, accuracy: float = ACCURACY) -> Contact:
    """Return the state whose mean pressure is a given one.

    Parameters
    ----------
    trials : Trials
        Solves of the surface, elastic.
    pressure : float
        p* > 0 of the whole surface.
    guess : float
        Δ/σ near the state, on a periodic surface the approach Δ'/σ.
    accuracy : float
        Largest relative error of p*, beside that by the residual.

    Returns
    -------
    Contact
        The state.

    Raises
    ------
    ConvergenceError
        If a solve does not converge, or the load is not found.
    """
    below, above = trials.untouched, None
    start = trials.problem.touch
    near: list[Contact] = []
    indentation = guess if guess > start else start + 1e-3
    for _ in range(SOLVES):
        state = trials.at(indentation, *_pair(indentation, [trials.untouched, *near]))
        near = sorted([state, *near], key=lambda one: abs(one.mean_pressure - pressure))[:3]
        if abs(state.mean_pressure - pressure) <= accuracy * pressure:
            return state
        if state.mean_pressure < pressure:
            below = max(below, state, key=_approach)
        else:
            above = min(above or state, state, key=_approach)
        if above is not None and above.approach - below.approach <= 4e-15 * above.approach:
            return above
        indentation = _next(pressure, near, below, above)
    message = f"no state with p* = {pressure:.9g} found"
    raise ConvergenceError(message, indentation=indentation, iterations=SOLVES, residual=math.nan)


def _next(pressure: float, near: list[Contact], below: Contact, above: Contact | None) -> float:
    """Return the indentation on the line through the nearest two states, or between the bracket."""
    if len(near) > 1 and near[0].mean_pressure != near[1].mean_pressure:
        one, other = near[:2]
        rate = (other.approach - one.approach) / (other.mean_pressure - one.mean_pressure)
        wanted = one.approach + rate * (pressure - one.mean_pressure)
        least = below.approach
        most = above.approach if above is not None else GROWTH * near[0].approach + 1.0
        if least < wanted < most:
            return wanted
    if above is None:
        return GROWTH * below.approach + 1e-3
    if below.mean_pressure == 0.0:  # p* goes about with Δ²
        share = math.sqrt(pressure / above.mean_pressure)
        return below.approach + min(max(share, 0.01), 0.99) * (above.approach - below.approach)
    return 0.5 * (below.approach + above.approach)


def _pair(indentation: float, known: list[Contact]) -> tuple[Contact, Contact | None]:
    """Return the two states from which a solve starts: around the indentation, or below it."""
    known = sorted(known, key=_approach)
    below = [state for state in known if state.approach < indentation]
    above = [state for state in known if state.approach >= indentation]
    if above:
        return above[0], below[-1] if below else None
    return below[-1], below[-2] if len(below) > 1 else None


def _approach(state: Contact) -> float:
    return state.approach
