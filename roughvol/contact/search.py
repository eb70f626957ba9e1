"""Where along the loading something is reached: an indentation bracketed by bounds that cost no solve.

Let x_i = c q_i where element i is in contact and x_i = -w_i where it is not, c = 1/(K⁻¹)_ii. Where K⁻¹ is an M-matrix
(the Love kernel), gaps are convex in the indentation Δ, and so are, with the opposite sign, the pressures after the
touch; the choice of c keeps the slope from rising at the touch. Every x_i is therefore a rising, *concave* function of
Δ, and a straight line through two solved states lies below it between the two and above it outside. Whatever is true of
a state and stays true under more contact (an area, a load, a closed channel) is thereby bracketed:

    on the line between a state below and one above it is reached too late:      an upper bound of Δ;
    on the lines through two states below, and through two above, too early:     lower bounds of Δ.

Both are off by the product of the distances to two solved states, so that the bracket shrinks with its square. A solve
is started from the line through the two states nearest to it, to no more digits than its bracket has use for.

Residuals: the x of a state with residual η is right to 2 η, by which a rough state is kept from deciding anything; an
element counts as in contact where x > 4 η/σ (of the accuracy asked for), so that any other solve of that accuracy finds
it in contact too. For other kernels the bounds are only good guesses: what is returned has been solved and does reach
the value, and it is the smallest as far as the states that were solved tell.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from roughvol.contact.loading import Compliance, Contact, Trials
from roughvol.errors import ContactError
from roughvol.surfaces.surface import Surface

TARGETS = {"contact_area": "contact_area_fraction", "pressure": "mean_pressure"}

Guess = Callable[[list[Contact]], float]
Line = Callable[[float, float], Contact]

FIRST_RESIDUAL = 1e-1  # of the first solve, which only has to be near
NEXT_RESIDUAL = 3e-2  # of the solves before the bracket
_USEFUL = 3e-4  # residual over the width of the bracket: looser ones take more solves, and as many convolutions
_INSIDE = 0.05  # share of the bracket that a trial keeps from its ends
_BEYOND, _GROWTH = 1.02, 2.0  # of the indentation, at least and at most, while what is looked for is not reached
_PATIENCE = 3  # such steps; from there on the least is squared each time, as an area may wait for one deep pit
_FINE = 2.0**-4  # share of the distance to a state to which the roots on the lines are found
_CLEAR = 0.1  # residual over distance up to which the line through two states is a good start
_SURE = 4.0  # residuals by which an element must be in contact to be so in any other solve
_DOUBT = 4.0  # residuals of a rough state within which the root may be on its other side
_TRIALS = 200
_ACCURACY = 1e-6  # of an indentation, relative


def indentation_for(
    surface: Surface,
    half_space: Compliance,
    target: str,
    value: float,
    *,
    rtol: float = 1e-6,
    method: str = "fast",
) -> float:
    """Return the smallest indentation Δ/σ at which the contact area fraction or the mean pressure reaches a value.

    Both are non-decreasing functions of Δ. The pressure is continuous; the area jumps from element to element. The
    indentation is right to a relative 1e-6 and to what the residual can tell; a solve there to the same residual finds
    the area reached.

    Parameters
    ----------
    target : "contact_area" (A*, 0 < value ≤ 1) or "pressure" (p*, value > 0).

    Raises
    ------
    ContactError : unknown target or method, or a value out of range.
    ConvergenceError : a solve on the way did not converge.
    """
    if target not in TARGETS:
        message = f"target is {target!r}; allowed: {', '.join(TARGETS)}"
        raise ContactError(message)
    if not 0 < value < np.inf or (target == "contact_area" and value > 1):
        message = f"{target} is {value}; allowed: {'0 < A* <= 1' if target == 'contact_area' else 'p* > 0'}"
        raise ContactError(message)

    def measure(contact: Contact) -> float:
        return float(getattr(contact, TARGETS[target]))

    start = _mean_plane(surface) * min(1.0, value * (5.0 if target == "contact_area" else 1.0)) ** 0.5
    trials = Trials(surface, half_space, rtol=rtol, method=method)
    found = _search(trials, *_reaching(measure, value), start, _ACCURACY, target == "contact_area")
    return found.indentation


def state_reaching(
    trials: Trials, measure: Callable[[Contact], float], value: float, between: list[Contact], *, elements: bool
) -> Contact:
    """Return the smallest state at which a number reaches a value, to a relative 1e-6 and to what the residual tells.

    Parameters
    ----------
    trials : of the surface; their tolerance is that of the state returned.
    measure : contact ↦ number that never falls under more contact, as A* or p* of a part of the surface.
    value : of the number, > 0.
    between : the contacts before and after it that are solved already, as `Trials.known` makes them, in order; the one
        after alone, if nothing has touched before.
    elements : whether the number jumps with single elements, as A*. What the first touch reaches is found at the
        indentation that the tolerance of the trials can tell from none.

    Raises
    ------
    ContactError : it is not reached at full contact either.
    ConvergenceError : a solve on the way did not converge.
    """
    if elements and len(between) == 1:
        touch = trials.at(min(trials.rtol, 0.5 * between[0].indentation), trials.untouched)
        if measure(touch) >= value:
            return touch
        between = [touch, *between]
    return _search(trials, *_reaching(measure, value), 0.0, _ACCURACY, elements=False, between=between)


def _reaching(measure: Callable[[Contact], float], value: float) -> tuple[Callable[[Contact], bool], Guess]:
    """Return the condition that a number reaches a value, and the guess where it does."""

    def guess(known: list[Contact]) -> float:
        """Δ from the power law through the last two states; from one, A* and p* go about with Δ²."""
        power, last = 2.0, known[-1]
        if not measure(last) > 0.0:
            return math.inf
        if len(known) > 1 and 0.0 < measure(known[-2]) != measure(last):
            power = math.log(measure(last) / measure(known[-2])) / math.log(last.indentation / known[-2].indentation)
        return last.indentation * float((value / measure(last)) ** (1.0 / max(power, 0.5)))

    return lambda contact: measure(contact) >= value, guess


def first_indentation(
    surface: Surface,
    half_space: Compliance,
    reached: Callable[[Contact], bool],
    *,
    rtol: float = 1e-6,
    method: str = "fast",
    accuracy: float = 1e-4,
) -> float:
    """Return the first indentation Δ/σ at which something holds that, once true, stays true under more contact.

    Contact sets are nested along the loading, so this finds where a share of a region is in contact, or where the void
    stops percolating.

    Parameters
    ----------
    reached : says of a state whether it holds; it is also asked about estimates of states.
    accuracy : of the indentation returned, relative; it holds there.

    Raises
    ------
    ContactError : unknown method, or it does not hold at full contact either.
    ConvergenceError : a solve on the way did not converge.
    """
    trials = Trials(surface, half_space, rtol=rtol, method=method)
    return _search(trials, reached, lambda known: math.inf, _mean_plane(surface), accuracy).indentation


def _mean_plane(surface: Surface) -> float:
    """Return Δ/σ at d = 0, or 1 on a flat surface."""
    return (surface.z_max - surface.mean_height) / surface.Sq if surface.Sq > 0.0 else 1.0


def _search(
    trials: Trials,
    reached: Callable[[Contact], bool],
    guess: Guess,
    start: float,
    accuracy: float,
    elements: bool = True,
    between: Sequence[Contact] = (),
) -> Contact:
    """Return the state at the smallest indentation at which it holds.

    Parameters
    ----------
    guess : proposes an indentation from the states on either side, or the last two below; infinite if it cannot.
    start : where to look first.
    between : states on either side to begin with, instead; untouched ones may be among them.
    elements : whether single elements matter, so that those on the brink must not count.
    """
    brink = _SURE * trials.rtol if elements else 0.0

    def holds(line: Line, indentation: float, noise: float = 0.0) -> bool:
        return reached(line(indentation, brink + noise))

    below, above = [trials.untouched], list[Contact]()  # two of each, the nearest first
    indentation, tolerance, least = start, FIRST_RESIDUAL, _BEYOND
    known = list(between)
    for trial in range(_TRIALS):
        if not known:
            known = [trials.at(indentation, *_nearest(indentation, [*below[::-1], *above]), rtol=tolerance)]
        for contact in known:
            below, above = ([s for s in side if s.indentation != contact.indentation] for side in (below, above))
            if holds(trials.line(contact, contact), contact.indentation):
                above = sorted([contact, *above], key=_indentation)[:2]
            elif contact.contact_area_fraction < 1.0 or math.isfinite(guess([contact])) or reached(contact):
                # the last: it holds, but with elements on the brink (a flat surface is in contact everywhere at once)
                below = sorted([contact, *below], key=_indentation, reverse=True)[:2]
            else:
                message = f"not reached at full contact (Δ/σ = {contact.indentation:g}) either"
                raise ContactError(message)
        known = []
        low = below[0].indentation
        if not above:
            least = min(least**2, _GROWTH) if trial >= _PATIENCE else least
            indentation = min(max(guess(below[::-1]), least * low), _GROWTH * low)
            tolerance = min(NEXT_RESIDUAL, 0.01 * (indentation - low))
            continue
        high = above[0].indentation
        finest = trials.tolerance(high)
        goal = accuracy * high + 2.0 * min(finest, below[0].residual + above[0].residual)
        first, last = _bounds(trials, holds, below, above, 0.1 * goal)
        width = last - first
        tolerance = _USEFUL * width
        doubtful = [
            state.indentation
            for state, end in ((above[0], first), (below[0], last))
            if state.residual > max(finest, tolerance) and abs(state.indentation - end) <= _DOUBT * state.residual
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
            indentation = min(max(proposed, first + _INSIDE * width), last - _INSIDE * width)
    message = f"no indentation found in {_TRIALS} solves; the last was {indentation:.9g}"
    raise ContactError(message)


def _bounds(
    trials: Trials, holds: Callable[[Line, float, float], bool], below: list[Contact], above: list[Contact], fine: float
) -> tuple[float, float]:
    """Return a lower and an upper bound of the root between two states, from straight lines.

    They are found to `fine`, or to a share of their distance to those states.
    """

    def root(one: Contact, other: Contact, start: float, end: float, sign: float) -> tuple[float, float]:
        line, distance = trials.line(one, other), other.indentation - one.indentation
        rough = [max(0.0, state.residual - trials.tolerance(state.indentation)) / distance for state in (one, other)]
        while end - start > max(fine, _FINE * min(end - low, high - start)):
            middle = 0.5 * (start + end)
            noise = rough[0] * abs(other.indentation - middle) + rough[1] * abs(middle - one.indentation)
            start, end = (start, middle) if holds(line, middle, 2.0 * sign * noise) else (middle, end)
        return start, end

    low, high = below[0].indentation, above[0].indentation
    last = root(below[0], above[0], low, high, 1.0)[1]
    sides = [sorted(side, key=_indentation) for side in (below, above) if len(side) == 2]
    return max([low, *(root(one, other, low, last, -1.0)[0] for one, other in sides)]), last


def _indentation(contact: Contact) -> float:
    return contact.indentation


def _nearest(indentation: float, known: list[Contact]) -> tuple[Contact, Contact | None]:
    """Return the later and the earlier of the two states whose straight line is nearest to the truth there."""
    if len(known) == 1:
        return known[0], None

    def error(pair: tuple[Contact, Contact]) -> float:
        return math.prod(abs(indentation - state.indentation) for state in pair) * (1.0 + _noise(*pair) / _CLEAR)

    one, other = min(itertools.combinations(known, 2), key=error)
    return other, one


def _noise(one: Contact, other: Contact) -> float:
    """Return the residuals of two states over their distance: how little their straight line means."""
    return max(one.residual, other.residual) / abs(other.indentation - one.indentation)
