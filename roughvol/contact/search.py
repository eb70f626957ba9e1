"""The indentation at which a condition is reached, between bounds that cost no solve.

Let x_i = c q_i where element i is in contact and x_i = -w_i elsewhere, c = 1/(K⁻¹)_ii. Where K⁻¹ is an M-matrix (the
Love kernel), gaps are convex in the indentation Δ, and pressures after the touch are concave. With this c the slope of
x does not rise at the touch. Every x_i is therefore a rising, *concave* function of Δ. A straight line through two
solved states lies below it between the two, and above it outside. This brackets any condition that stays true under
more contact, such as an area, a load or a closed channel:

    on the line between a state below and one above, it is reached too late:     an upper bound of Δ;
    on the lines through two states below, and through two above, too early:     lower bounds of Δ.

The error of both is the product of the distances to two solved states: the bracket shrinks with its square. A solve
starts from the line through the two nearest states, with no more digits than its bracket can use.

The x of a state with residual η is right to 2 η, so a rough state decides nothing closer than this. An element counts
as in contact where x > 4 η/σ, η being the accuracy of the search: any other solve of this accuracy then finds it in
contact too. For other kernels the bounds are good guesses only. The state returned is always solved, and reaches the
value.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from roughvol.contact.loading import Compliance, Contact, Trials
from roughvol.contact.options import DEFAULT, Options
from roughvol.contact.tuning import SEARCH_TUNING, SearchTuning
from roughvol.errors import ContactError
from roughvol.surfaces.surface import Surface

TARGETS = {"contact_area": "contact_area_fraction", "pressure": "mean_pressure", "free_volume": "free_volume"}

Guess = Callable[[list[Contact]], float]
Line = Callable[[float, float], Contact]


def indentation_for(
    surface: Surface,
    half_space: Compliance,
    target: str,
    value: float,
    options: Options = DEFAULT,
    *,
    tuning: SearchTuning = SEARCH_TUNING,
    **changed: Any,
) -> float:
    """Return the smallest indentation at which contact area fraction, mean pressure or free volume reach a value.

    Area and pressure never fall with Δ, the free volume never rises. The area jumps from element to element, the others
    are continuous. A solve at the indentation returned, to the same residual, reaches the area.

    Parameters
    ----------
    surface, half_space
        As in `roughvol.contact.solve`.
    target : {"contact_area", "pressure", "free_volume"}
        A*, p* or V*.
    value : float
        0 < A* ≤ 1, p* > 0, or V* > 0 below that of the first touch.
    options
        As in `roughvol.contact.solve`; elastic contact.
    tuning : SearchTuning
        Constants.
    **changed
        As in `roughvol.contact.solve`.

    Returns
    -------
    float
        Δ/σ, right to a relative 10⁻⁶ and to the residual. On a periodic surface the approach Δ'/σ, see `periodic`.

    Raises
    ------
    ContactError
        If the target or the method is unknown, or the value out of range.
    ConvergenceError
        If a solve does not converge.
    """
    if target not in TARGETS:
        raise ContactError(f"target is {target!r}; allowed: {', '.join(TARGETS)}")
    area = target == "contact_area"
    if not 0 < value < np.inf or (area and value > 1):
        message = (
            f"{target} is {value}; allowed: {'0 < A* <= 1' if area else 'p* > 0' if target == 'pressure' else 'V* > 0'}"
        )
        raise ContactError(message)

    trials = Trials(surface, half_space, options, **changed)
    if target == "free_volume":
        most = (surface.z_max - surface.mean_height) / surface.unit
        if value >= min(most, float(trials.untouched.gap().mean())):  # the two differ by rounding
            raise ContactError(f"{target} is {value}; allowed: 0 < V* < {most:.6g}, that of the first touch")
        closed = most - value
        return _search(
            trials, *_reaching(closed_of(surface), closed), closed, tuning.accuracy, tuning, elements=False
        ).approach

    def measure(contact: Contact) -> float:
        return float(getattr(contact, TARGETS[target]))

    start = _mean_plane(surface) * min(1.0, value * (5.0 if area else 1.0)) ** 0.5
    return _search(trials, *_reaching(measure, value), start, tuning.accuracy, tuning, elements=area).approach


def closed_of(surface: Surface) -> Callable[[Contact], float]:
    """Return the free volume closed since the first touch, over σ, as a function of a contact.

    It is taken from the gaps. Those of an estimate on a straight line between two states are too large, as gaps are
    convex, so it is a bound as A* and p* are.

    Parameters
    ----------
    surface : Surface
        The surface pressed.

    Returns
    -------
    callable
        Contact ↦ (z_max - mean(z))/σ - V*, which never falls under more contact.
    """
    depth = (surface.z_max - surface.mean_height) / surface.unit
    return lambda contact: depth - float(contact.gap().mean())


def state_reaching(
    trials: Trials,
    measure: Callable[[Contact], float],
    value: float,
    between: list[Contact],
    *,
    elements: bool,
    below: bool = False,
    tuning: SearchTuning = SEARCH_TUNING,
) -> Contact:
    """Return the smallest state at which a quantity reaches a value.

    Parameters
    ----------
    trials : Trials
        Solves of the surface. Their tolerance is that of the state returned.
    measure : callable
        Contact ↦ float that never falls under more contact, such as A* or p* of a part of the surface.
    value : float
        Value of the quantity, > 0.
    between : list of Contact
        The solved contacts before and after the value, from `Trials.known`. The one after alone, if nothing has
        touched before; with ``below``, the one before alone.
    elements : bool
        Whether the quantity jumps with single elements, as A* does. A value reached at first touch is then found at
        the least indentation above the tolerance.
    below : bool
        Whether all contacts given lie before the value.
    tuning : SearchTuning
        Constants.

    Returns
    -------
    Contact
        The state, its indentation right to a relative 10⁻⁶ and to the residual.

    Raises
    ------
    ContactError
        If full contact does not reach the value.
    ConvergenceError
        If a solve does not converge.
    """
    if elements and len(between) == 1 and not below:
        touch = trials.at(min(trials.options.rtol, 0.5 * between[0].approach), trials.untouched)
        if measure(touch) >= value:
            return touch
        between = [touch, *between]
    reached, guess = _reaching(measure, value)
    return _search(trials, reached, guess, 0.0, tuning.accuracy, tuning, elements=False, between=between)


def first_indentation(
    surface: Surface,
    half_space: Compliance,
    reached: Callable[[Contact], bool],
    options: Options = DEFAULT,
    *,
    accuracy: float = 1e-4,
    tuning: SearchTuning = SEARCH_TUNING,
    **changed: Any,
) -> float:
    """Return the smallest indentation at which a condition holds that stays true under more contact.

    Contact sets are nested along the loading. Examples are a share of a region in contact, and the end of percolation
    of the void.

    Parameters
    ----------
    surface, half_space
        As in `roughvol.contact.solve`.
    reached : callable
        Contact ↦ bool, the condition. Estimates of states are passed as well.
    options
        As in `roughvol.contact.solve`; elastic contact.
    accuracy : float
        Relative accuracy of the indentation.
    tuning : SearchTuning
        Constants.
    **changed
        As in `roughvol.contact.solve`.

    Returns
    -------
    float
        Δ/σ. The condition holds there.

    Raises
    ------
    ContactError
        If the method is unknown, or the condition does not hold at full contact.
    ConvergenceError
        If a solve does not converge.
    """
    trials = Trials(surface, half_space, options, **changed)
    return _search(trials, reached, lambda _: math.inf, _mean_plane(surface), accuracy, tuning).approach


def _reaching(measure: Callable[[Contact], float], value: float) -> tuple[Callable[[Contact], bool], Guess]:
    """Return the condition that a quantity reaches a value, and a guess of its indentation."""

    def guess(states: list[Contact]) -> float:
        """Return Δ on the power law through the last two states; from one state, A* and p* go about with Δ²."""
        power, last = 2.0, states[-1]
        if not measure(last) > 0.0:
            return math.inf
        if len(states) > 1 and states[-2].approach > 0.0 and 0.0 < measure(states[-2]) != measure(last):
            power = math.log(measure(last) / measure(states[-2])) / math.log(last.approach / states[-2].approach)
        return last.approach * float((value / measure(last)) ** (1.0 / max(power, 0.5)))

    return lambda contact: measure(contact) >= value, guess


def _mean_plane(surface: Surface) -> float:
    """Return Δ/σ at d = 0, or 1 on a flat surface."""
    return surface.peak if surface.Sq > 0.0 else 1.0


def _search(
    trials: Trials,
    reached: Callable[[Contact], bool],
    guess: Guess,
    start: float,
    accuracy: float,
    tuning: SearchTuning,
    elements: bool = True,
    between: Sequence[Contact] = (),
) -> Contact:
    """Return the state at the smallest indentation at which a condition holds.

    The guess maps states on either side, or the last two below, to an indentation. It is infinite where there is none.
    If single elements matter, elements on the brink of contact do not count. States on either side (`between`) replace
    the start. States without contact may be among them.
    """
    brink = tuning.sure * trials.options.rtol if elements else 0.0

    def holds(line: Line, indentation: float, noise: float = 0.0) -> bool:
        return reached(line(indentation, brink + noise))

    below, above = [trials.untouched], list[Contact]()  # two of each, the nearest first
    indentation, tolerance, growth = start, tuning.first, tuning.least_growth
    solved = list(between)
    for trial in range(tuning.solves):
        if not solved:
            pair = _nearest(indentation, [*below[::-1], *above], tuning.clear)
            solved = [trials.at(indentation, *pair, rtol=tolerance)]
        for contact in solved:
            below, above = ([s for s in side if s.approach != contact.approach] for side in (below, above))
            if holds(trials.line(contact, contact), contact.approach):
                above = sorted([contact, *above], key=_indentation)[:2]
            elif contact.contact_area_fraction < 1.0 or math.isfinite(guess([contact])) or reached(contact):
                # The last: reached with elements on the brink, as a flat surface is in contact everywhere at once.
                below = sorted([contact, *below], key=_indentation, reverse=True)[:2]
            else:
                raise ContactError(f"not reached at full contact (Δ/σ = {contact.approach:g}) either")
        solved = []
        low = below[0].approach
        if not above:
            growth = min(growth**2, tuning.most_growth) if trial >= tuning.patience else growth
            indentation = min(max(guess(below[::-1]), growth * low), tuning.most_growth * low)
            tolerance = min(tuning.following, 0.01 * (indentation - low))
            continue
        high = above[0].approach
        finest = trials.tolerance(high)
        goal = accuracy * high + 2.0 * min(finest, below[0].residual + above[0].residual)
        first, last = _bounds(trials, holds, below, above, 0.1 * goal, tuning.line_accuracy)
        width = last - first
        tolerance = tuning.useful * width
        doubtful = [
            state.approach
            for state, end in ((above[0], first), (below[0], last))
            if state.residual > max(finest, tolerance) and abs(state.approach - end) <= tuning.sure * state.residual
        ]
        if doubtful:  # a rough state so near the root may lie on the other side of it
            indentation = doubtful[0]
        elif high - first <= goal and above[0].residual <= finest:
            return above[0]
        elif width <= goal:
            indentation, tolerance = last, 0.0
        else:
            proposed = guess([below[0], above[0]])
            proposed = proposed if math.isfinite(proposed) else 0.5 * (first + last)
            indentation = min(max(proposed, first + tuning.inside * width), last - tuning.inside * width)
    raise ContactError(f"no indentation found in {tuning.solves} solves; the last was {indentation:.9g}")


def _bounds(
    trials: Trials,
    holds: Callable[[Line, float, float], bool],
    below: list[Contact],
    above: list[Contact],
    fine: float,
    share: float,
) -> tuple[float, float]:
    """Return a lower and an upper bound of the root between two states, from straight lines.

    They are right to `fine`, or to a share of their distance to the states.
    """

    def root(one: Contact, other: Contact, start: float, end: float, sign: float) -> tuple[float, float]:
        line, distance = trials.line(one, other), other.approach - one.approach
        rough = [max(0.0, state.residual - trials.tolerance(state.approach)) / distance for state in (one, other)]
        while end - start > max(fine, share * min(end - low, high - start)):
            middle = 0.5 * (start + end)
            noise = rough[0] * abs(other.approach - middle) + rough[1] * abs(middle - one.approach)
            start, end = (start, middle) if holds(line, middle, 2.0 * sign * noise) else (middle, end)
        return start, end

    low, high = below[0].approach, above[0].approach
    last = root(below[0], above[0], low, high, 1.0)[1]
    sides = [sorted(side, key=_indentation) for side in (below, above) if len(side) == 2]
    return max([low, *(root(one, other, low, last, -1.0)[0] for one, other in sides)]), last


def _indentation(contact: Contact) -> float:
    return contact.approach


def _nearest(indentation: float, states: list[Contact], clear: float) -> tuple[Contact, Contact | None]:
    """Return the later and the earlier of the two states with the least error of their straight line."""
    if len(states) == 1:
        return states[0], None

    def error(pair: tuple[Contact, Contact]) -> float:
        one, other = pair
        noise = max(one.residual, other.residual) / abs(other.approach - one.approach)
        return math.prod(abs(indentation - state.approach) for state in pair) * (1.0 + noise / clear)

    one, other = min(itertools.combinations(states, 2), key=error)
    return other, one
