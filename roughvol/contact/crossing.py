"""The state at which a quantity crosses a value on a leg of a path, rising or falling, elastic or not.

The bounds of `search` need gaps that are convex in the indentation, and gaps are not while a surface yields. Here two
solved states bracket the value, and every trial is solved to the tolerance of the leg.
"""

from __future__ import annotations

from collections.abc import Callable

from roughvol.contact.loading import Contact, Trials
from roughvol.contact.tuning import SEARCH_TUNING
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
    elements: bool = False,
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
    elements : bool
        Whether the quantity jumps with single elements, as A* does. On loading, elements on the brink of contact do not
        count then, as in `search`: any other solve of this accuracy finds the value reached too.

    Returns
    -------
    Contact
        State at the value or beyond it, as seen from the start.

    Raises
    ------
    ContactError
        If the start has the value, or neither full contact nor a state without contact reaches it.
    ConvergenceError
        If a trial does not converge.
    """
    begin = measure(start)
    if begin == value:
        raise ContactError(f"the leg begins at Δ/σ = {start.approach:g}, where the value {value:g} is reached already")
    sign = 1.0 if value > begin else -1.0

    def excess(contact: Contact) -> float:
        if elements and sign > 0.0:
            contact = trials.line(contact, contact)(contact.approach, SEARCH_TUNING.sure * trials.options.rtol)
        return sign * (measure(contact) - value)

    touch = trials.untouched
    far = touch if end is None and sign < 0.0 else end
    before = sign > 0.0 and start.approach < touch.approach
    if (far is touch and excess(far) < 0.0) or (before and excess(touch) >= 0.0):
        return _apart(trials, measure, value)
    near = touch if before else start  # nothing to solve before the first touch
    reach, solves = (GROWTH - 1.0) * (near.approach or near.separation), 0
    while far is None or excess(far) < 0.0:
        if far is not None:
            full = not elements and far.contact_area_fraction >= 1.0 and measure(far) <= measure(near)
            if full or solves == SOLVES:
                raise ContactError(f"the value {value:g} is not reached up to Δ/σ = {far.approach:g}")
            near = far
        far = trials.at(near.approach + reach, near)
        reach, solves = 2.0 * reach, solves + 1
    if far is touch and excess(far) == 0.0:
        return far  # contact is lost there and not before
    return _between(trials, excess, near, far, accuracy)


def _apart(trials: Trials, measure: Callable[[Contact], float], value: float) -> Contact:
    """Return the state without contact that has a value of a quantity that moves with the surface, as a volume does."""
    touch = trials.untouched
    state = trials.apart(touch.approach - (measure(touch) - value))
    if abs(measure(state) - value) > ACCURACY * max(1.0, abs(value)):
        raise ContactError(f"the value {value:g} is not reached in contact, which begins at Δ/σ = {touch.approach:g}")
    return state


def _between(
    trials: Trials, excess: Callable[[Contact], float], near: Contact, far: Contact, accuracy: float
) -> Contact:
    """Return a state of excess ≥ 0 as near to the other side as asked for: regula falsi (Illinois) and bisection."""
    low, high = excess(near), excess(far)
    for trial in range(SOLVES):
        width = far.approach - near.approach
        if abs(width) <= accuracy * far.approach + 2.0 * (near.residual + far.residual):
            return far
        plateau = high == 0.0  # as of percolation and of whole elements: it begins before this state
        share = 0.5 if plateau or trial % 3 == 2 else min(max(low / (low - high), 0.01), 0.99)
        above, below = (far, near) if width > 0.0 else (near, far)
        middle = trials.at(near.approach + share * width, above, below)
        value = excess(middle)
        if value >= 0.0:
            far, high, low = middle, value, 0.5 * low
        else:
            near, low, high = middle, value, 0.5 * high
    raise ContactError(f"no indentation found in {SOLVES} solves; the last was {far.approach:.9g}")
