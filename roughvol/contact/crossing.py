"""The state at which a quantity crosses a value on a leg of a path, rising or falling, elastic or not.

The bounds of `search` need gaps that are convex in the indentation, and gaps are not while a surface yields. Here two
solved states bracket the value, and every trial is solved to the tolerance of the leg.
"""

from __future__ import annotations

from collections.abc import Callable

from roughvol.contact.loading import Contact, Trials
from roughvol.errors import ContactError

ACCURACY = 1e-6  # relative, of the indentation
SOLVES = 200  # most solves of a search
GROWTH = 1.1  # first trial over the start of the leg; the distance doubles until the value is bracketed


def state_crossing(
    trials: Trials,
    measure: Callable[[Contact], float],
    value: float,
    start: Contact,
    end: Contact | None = None,
    *,
    accuracy: float = ACCURACY,
) -> Contact:
    """Return the first state at which a quantity reaches a value, on the way from a solved state.

    Parameters
    ----------
    trials : Trials
        Solves on the leg.
    measure : callable
        Contact ↦ float that never falls with the indentation, such as A* or p*.
    value : float
        Value of the quantity.
    start : Contact
        State at which the leg begins.
    end : Contact, optional
        State at the value or beyond it. Default: the first touch where the value is below that of the start, and
        found by steps that double where it is above.
    accuracy : float
        Relative accuracy of the indentation.

    Returns
    -------
    Contact
        State at the value or beyond it, as seen from the start.

    Raises
    ------
    ContactError
        If the start has the value, or full contact does not reach it.
    ConvergenceError
        If a trial does not converge.
    """
    begin = measure(start)
    if begin == value:
        message = f"the leg begins at Δ/σ = {start.approach:g}, where the value {value:g} is reached already"
        raise ContactError(message)
    sign = 1.0 if value > begin else -1.0

    def excess(contact: Contact) -> float:
        return sign * (measure(contact) - value)

    near, far = start, trials.untouched if end is None and sign < 0.0 else end
    reach, solves = (GROWTH - 1.0) * (start.approach or start.separation), 0
    while far is None or excess(far) < 0.0:
        if far is not None:
            full = far.contact_area_fraction >= 1.0 and measure(far) <= measure(near)
            if full or solves == SOLVES:
                message = f"the value {value:g} is not reached up to Δ/σ = {far.approach:g}"
                raise ContactError(message)
            near = far
        far = trials.at(near.approach + reach, near)
        reach, solves = 2.0 * reach, solves + 1
    return _between(trials, excess, near, far, accuracy)


def _between(
    trials: Trials, excess: Callable[[Contact], float], near: Contact, far: Contact, accuracy: float
) -> Contact:
    """Return a state of excess ≥ 0 as near to the other side as asked for: regula falsi (Illinois) and bisection."""
    low, high = excess(near), excess(far)
    for trial in range(SOLVES):
        width = far.approach - near.approach
        if high == 0.0 or abs(width) <= accuracy * far.approach + 2.0 * (near.residual + far.residual):
            return far
        share = 0.5 if trial % 3 == 2 else min(max(low / (low - high), 0.01), 0.99)
        above, below = (far, near) if width > 0.0 else (near, far)
        middle = trials.at(near.approach + share * width, above, below)
        value = excess(middle)
        if value >= 0.0:
            far, high, low = middle, value, 0.5 * low
        else:
            near, low, high = middle, value, 0.5 * high
    message = f"no indentation found in {SOLVES} solves; the last was {far.approach:.9g}"
    raise ContactError(message)
