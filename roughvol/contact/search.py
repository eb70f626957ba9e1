"""States at which a quantity reaches a value: one bracket of solved states, and three ways to the next trial.

`state_reaching` loads elastic contact between bounds that cost no solve (below). `state_crossing` takes regula falsi on
any leg of a path, also while a surface yields. `state_under` takes the secant of the load, to ten digits.

Let x_i = c q_i where element i is in contact and x_i = -w_i elsewhere, c = 1/(K⁻¹)_ii. Where K⁻¹ is an M-matrix (the
Love kernel), gaps are convex in the indentation Δ, and pressures after the touch are concave. With this c the slope of
x does not rise at the touch. Every x_i is therefore a rising, *concave* function of Δ. A straight line through two
solved states lies below it between the two, and above it outside. This brackets any condition that stays true under
more contact, such as an area, a load or a closed channel:

    on the line between a state below and one above, it is reached too late:     an upper bound of Δ;
    on the lines through two states below, and through two above, too early:     lower bounds of Δ.

The error of both is the product of the distances to two solved states: the bracket shrinks with its square. A solve has
no more digits than its bracket can use. The x of a state with residual η is right to 2 η, so a rough state decides
nothing closer than this. An element counts as in contact where x > 4 η/σ, η being the accuracy of the search: any other
solve of this accuracy then finds it in contact too. For other kernels the bounds are good guesses only. The state
returned is always solved, and reaches the value.
"""

import itertools
import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from roughvol.contact.bracket import Bracket, Target
from roughvol.contact.loading import Compliance, Contact, Trials
from roughvol.contact.options import DEFAULT, Options
from roughvol.errors import ContactError, ConvergenceError
from roughvol.surfaces.surface import Surface, real

TARGETS = {"contact_area": "contact_area_fraction", "pressure": "mean_pressure", "free_volume": "free_volume"}
CROSSING = 1e-6  # relative accuracy of the indentation of a crossing
LOAD = 1e-10  # relative accuracy of a load
TOUCH = 1e-150  # an indentation below it is that of the first touch
SOLVES = 200  # most solves of a crossing; half of them for a load
CROSSING_GROWTH = 1.1  # first trial over the start of the leg; the distance doubles until the value is bracketed
LOAD_GROWTH = 1.5  # of the indentation, while no state carries enough

Line = Callable[[float, float], Contact]
_indentation = operator.attrgetter("approach")


def indentation_for(
    surface: Surface, half_space: Compliance, target: str, value: float, options: Options = DEFAULT, **changed: Any
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
    **changed
        As in `roughvol.contact.solve`.

    Returns
    -------
    float
        Δ/σ, right to a relative 10⁻⁶ and to the residual. On an endless surface the approach Δ'/σ, see `kernels`.

    Raises
    ------
    ContactError
        If the target or the method is unknown, or the value out of range.
    ConvergenceError
        If a solve does not converge.

    See Also
    --------
    first_indentation : Returns the indentation of any condition.

    Examples
    --------
    >>> import numpy as np
    >>> from roughvol.contact import HalfSpace, indentation_for
    >>> from roughvol.surfaces import Surface
    >>> x = np.linspace(-1.0, 1.0, 33)
    >>> dome = Surface(-(x[:, None] ** 2) - x**2, spacing=x[1] - x[0])
    >>> round(indentation_for(dome, HalfSpace(dome.shape), "contact_area", 0.1), 2)
    0.57
    """
    if target not in TARGETS:
        raise ContactError(f"target is {target!r}; allowed: {', '.join(TARGETS)}")
    area, value = target == "contact_area", real("value", value, ContactError)
    if not 0 < value < np.inf or (area and value > 1):
        allowed = {"contact_area": "0 < A* <= 1", "pressure": "p* > 0", "free_volume": "V* > 0"}[target]
        raise ContactError(f"{target} is {value}; allowed: {allowed}")
    trials = Trials(surface, half_space, options, **changed)
    if target == "free_volume":
        most = (surface.z_max - surface.mean_height) / surface.unit
        if value >= min(most, float(trials.untouched.gap().mean())):  # the two differ by rounding
            raise ContactError(f"{target} is {value}; allowed: 0 < V* < {most:.6g}, that of the first touch")
        start = most - value
        # The volume closed so far, from the gaps. On a line between two states gaps are too large, as they are convex,
        # so it is a bound as A* and p* are.
        goal = Target(lambda contact: most - float(contact.gap().mean()), start)
    else:
        start = _mean_plane(surface) * min(1.0, value * (5.0 if area else 1.0)) ** 0.5
        goal = Target(lambda contact: float(getattr(contact, TARGETS[target])), value, elements=area)
    return _search(trials, goal, start, brink=area).approach


def first_indentation(
    surface: Surface,
    half_space: Compliance,
    reached: Callable[[Contact], bool],
    options: Options = DEFAULT,
    *,
    accuracy: float = 1e-4,
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
        Relative accuracy of the indentation, 0 < accuracy < 1.
    **changed
        As in `roughvol.contact.solve`.

    Returns
    -------
    float
        Δ/σ. The condition holds there. It is 0 for a condition that always holds.

    Raises
    ------
    ContactError
        If the accuracy is out of range, or the condition holds nowhere.
    ConvergenceError
        If a solve does not converge.

    See Also
    --------
    indentation_for : Returns the indentation of an area, a pressure or a free volume.

    Examples
    --------
    >>> import numpy as np
    >>> from roughvol.contact import HalfSpace, first_indentation
    >>> from roughvol.surfaces import Surface
    >>> x = np.linspace(-1.0, 1.0, 33)
    >>> dome = Surface(-(x[:, None] ** 2) - x**2, spacing=x[1] - x[0])
    >>> round(first_indentation(dome, HalfSpace(dome.shape), lambda c: c.contact_area_fraction >= 0.1), 2)
    0.57
    """
    if not 0.0 < real("accuracy", accuracy, ContactError) < 1.0:
        raise ContactError(f"accuracy is {accuracy}; allowed: 0 < accuracy < 1")
    options = replace(options, search=replace(options.search, accuracy=accuracy))
    target = Target(lambda contact: float(reached(contact)), 1.0, elements=True, power=False)
    trials = Trials(surface, half_space, options, **changed)
    return _search(trials, target, _mean_plane(surface), brink=True).approach


def state_reaching(trials: Trials, target: Target, between: list[Contact], *, below: bool = False) -> Contact:
    """Return the smallest state of elastic contact that reaches a value, its indentation right to a relative 10⁻⁶.

    `between` has the solved contacts before and after the value: the one after alone, if nothing has touched before, or
    the one before alone, with `below`. A value that jumps with elements, and is reached at first touch, is found at the
    least indentation above the tolerance.
    """
    if target.elements and len(between) == 1 and not below:
        touch = trials.at(min(trials.options.rtol, 0.5 * between[0].approach), trials.untouched)
        if target.reached(touch):
            return touch
        between = [touch, *between]
    return _search(trials, target, 0.0, brink=False, between=between)


def _search(trials: Trials, target: Target, start: float, *, brink: bool, between: Sequence[Contact] = ()) -> Contact:
    """Return the state at the smallest indentation that reaches the target, from bounds on straight lines.

    With `brink`, elements on the brink of contact do not count. States on either side (`between`) replace the start.
    """
    tuning, hardness = trials.options.search, trials.options.hardness
    if hardness is not None:  # the straight lines are no bounds
        raise ContactError(f"hardness is {hardness}; allowed: none. This search takes elastic contact")
    margin = tuning.sure * trials.options.rtol if brink else 0.0

    def holds(line: Line, indentation: float, noise: float = 0.0) -> bool:
        return target.reached(line(indentation, margin + noise))

    bracket = Bracket([trials.untouched])
    below, above = bracket.short, bracket.beyond
    indentation, tolerance, growth = start, tuning.first, tuning.least_growth
    solved = list(between)
    for trial in range(tuning.solves):
        if not solved:
            pair = _least_error(indentation, [*below[::-1], *above], tuning.clear)
            solved = [trials.at(indentation, *pair, rtol=tolerance)]
        for contact in solved:
            reached = holds(trials.line(contact, contact), contact.approach)
            full = not reached and contact.contact_area_fraction >= 1.0 and math.isinf(target.guess([contact]))
            # A flat surface is in contact everywhere at once: reached with elements on the brink.
            if full and not target.reached(contact):
                raise ContactError(f"not reached at full contact (Δ/σ = {contact.approach:g}) either")
            bracket.add(contact, reached)
        solved = []
        low = below[0].approach
        if not above:
            most = tuning.most_growth if target.power else tuning.most_growth**0.5
            growth = min(growth**2, most) if trial >= tuning.patience else growth
            indentation = min(max(target.guess(below[::-1]), growth * low), most * low)
            tolerance = min(tuning.following, 0.01 * (indentation - low))
            continue
        high = above[0].approach
        if high < TOUCH:
            return trials.untouched
        finest = trials.tolerance(high)
        goal = tuning.accuracy * high + 2.0 * min(finest, below[0].residual + above[0].residual)
        first, last = _bounds(trials, holds, bracket, 0.1 * goal)
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
            proposed = target.guess([below[0], above[0]])
            proposed = proposed if math.isfinite(proposed) else 0.5 * (first + last)
            indentation = min(max(proposed, first + tuning.inside * width), last - tuning.inside * width)
    raise ContactError(f"no indentation found in {tuning.solves} solves; the last was {indentation:.9g}")


def _bounds(trials: Trials, holds: Callable[..., bool], bracket: Bracket, fine: float) -> tuple[float, float]:
    """Return bounds of the root from straight lines, right to `fine` or to a share of their distance to the states."""
    share = trials.options.search.line_accuracy

    def root(first: Contact, second: Contact, start: float, end: float, sign: float) -> tuple[float, float]:
        line, distance = trials.line(first, second), second.approach - first.approach
        rough = [max(0.0, state.residual - trials.tolerance(state.approach)) / distance for state in (first, second)]
        while end - start > max(fine, share * min(end - low, high - start)):
            middle = 0.5 * (start + end)
            noise = rough[0] * abs(second.approach - middle) + rough[1] * abs(middle - first.approach)
            start, end = (start, middle) if holds(line, middle, 2.0 * sign * noise) else (middle, end)
        return start, end

    low, high = bracket.short[0].approach, bracket.beyond[0].approach
    last = root(bracket.short[0], bracket.beyond[0], low, high, 1.0)[1]
    sides = [sorted(side, key=_indentation) for side in (bracket.short, bracket.beyond) if len(side) == 2]
    return max([low, *(root(first, second, low, last, -1.0)[0] for first, second in sides)]), last


def _least_error(indentation: float, states: list[Contact], clear: float) -> tuple[Contact, Contact | None]:
    """Return the later and the earlier of the two states with the least error of their straight line."""
    if len(states) == 1:
        return states[0], None

    def error(pair: tuple[Contact, Contact]) -> float:
        earlier, later = pair
        noise = max(earlier.residual, later.residual) / abs(later.approach - earlier.approach)
        return math.prod(abs(indentation - state.approach) for state in pair) * (1.0 + noise / clear)

    earlier, later = min(itertools.combinations(states, 2), key=error)
    return later, earlier


def state_crossing(
    trials: Trials, target: Target, start: Contact, end: Contact | None = None, *, brink: bool = True
) -> Contact:
    """Return the first state at which a quantity reaches a value, on the way from a solved state: up or down.

    The start has another value. `end` is a state at the value or beyond it. By default it is the first touch where the
    value is below that of the start, and is found by steps that double where it is above. With `brink`, elements on the
    brink of contact do not count on loading in a quantity that jumps with elements. Such a quantity may jump at first
    touch, at no indentation: the state is found to the tolerance.
    """
    begin, value = target.measure(start), target.value
    sign = 1.0 if value > begin else -1.0

    def excess(contact: Contact) -> float:
        if target.elements and sign > 0.0 and brink:
            contact = trials.line(contact, contact)(contact.approach, trials.options.search.sure * trials.options.rtol)
        return sign * (target.measure(contact) - value)

    touch = trials.untouched
    lost = sign < 0.0 and (end is None or end.approach < touch.approach)  # no contact is left at the end
    far = touch if lost else end
    before = sign > 0.0 and start.approach < touch.approach
    if (far is touch and excess(far) < 0.0) or (before and excess(touch) >= 0.0):
        return _apart(trials, target)
    near = touch if before else start  # nothing to solve before the first touch
    reach, solves = (CROSSING_GROWTH - 1.0) * (near.approach or near.separation or 1.0), 0  # 1 on a flat surface
    while far is None or excess(far) < 0.0:
        if far is not None:
            full = not target.elements and far.contact_area_fraction >= 1.0
            if solves == SOLVES or (full and target.measure(far) <= target.measure(near)):
                raise ContactError(f"the value {value:g} is not reached up to Δ/σ = {far.approach:g}")
            near = far
        far = trials.at(near.approach + reach, near)
        reach, solves = 2.0 * reach, solves + 1
    if far is touch and excess(far) == 0.0:
        return far  # contact is lost there and not before
    return _between(trials, excess, near, far, trials.options.rtol if target.elements else 0.0)


def _apart(trials: Trials, target: Target) -> Contact:
    """Return the state without contact that has a value of a quantity that moves with the surface, as a volume does."""
    touch, value = trials.untouched, target.value
    state = trials.apart(touch.approach - (target.measure(touch) - value))
    if abs(target.measure(state) - value) > CROSSING * max(1.0, abs(value)):
        raise ContactError(f"the value {value:g} is not reached in contact, which begins at Δ/σ = {touch.approach:g}")
    return state


def _between(trials: Trials, excess: Callable[[Contact], float], near: Contact, far: Contact, least: float) -> Contact:
    """Return a state of excess ≥ 0 as near to the other side as asked for: regula falsi (Illinois) and bisection."""
    low, high = excess(near), excess(far)
    bracket = Bracket([near], falls=far.approach < near.approach)
    bracket.beyond.append(far)
    for trial in range(SOLVES):
        near, far, width = bracket.short[0], bracket.beyond[0], bracket.width
        if abs(width) <= max(least, CROSSING * far.approach + 2.0 * (near.residual + far.residual)):
            return far
        plateau = high == 0.0  # as of percolation and of whole elements: it begins before this state
        share = 0.5 if plateau or trial % 3 == 2 else min(max(low / (low - high), 0.01), 0.99)
        middle = trials.at(near.approach + share * width, *sorted((near, far), key=_indentation, reverse=True))
        value = excess(middle)
        bracket.add(middle, value >= 0.0)
        low, high = (0.5 * low, value) if value >= 0.0 else (value, 0.5 * high)
    raise ContactError(f"no indentation found in {SOLVES} solves; the last was {far.approach:.9g}")


def state_under(
    trials: Trials, pressure: float, guess: float, begin: Contact | None = None, stiffness: float | None = None
) -> Contact:
    """Return the state of elastic contact with a mean pressure p* > 0, from a guess of its indentation (Δ'/σ).

    The first solve starts from `begin`, the second indentation follows from the stiffness dp*/d(Δ'/σ), where known.
    """
    bracket, near, start = Bracket([trials.untouched]), list[Contact](), trials.problem.touch
    indentation = guess if guess > start else start + 1e-3
    for _ in range(SOLVES // 2):
        known = near or [begin] if begin is not None else near
        state = trials.at(indentation, *_around(indentation, [trials.untouched, *known]))
        near = sorted([state, *near], key=lambda known: abs(known.mean_pressure - pressure))[:3]
        if abs(state.mean_pressure - pressure) <= LOAD * pressure:
            return state
        bracket.add(state, state.mean_pressure >= pressure)
        if bracket.beyond and bracket.width <= 4e-15 * bracket.beyond[0].approach:
            return bracket.beyond[0]
        indentation = _secant(pressure, near, bracket, stiffness)
    message = f"no state with p* = {pressure:.9g} found"
    raise ConvergenceError(message, indentation=indentation, iterations=SOLVES // 2, residual=math.nan)


def _secant(pressure: float, near: list[Contact], bracket: Bracket, stiffness: float | None) -> float:
    """Return the indentation on the line through the nearest two states, or between the bracket."""
    below, above = bracket.short[0], bracket.beyond[0] if bracket.beyond else None
    nearest, rate = near[0], 1.0 / stiffness if stiffness else None
    if len(near) > 1 and near[0].mean_pressure != near[1].mean_pressure:
        rate = (near[1].approach - nearest.approach) / (near[1].mean_pressure - nearest.mean_pressure)
    if rate is not None:
        wanted = nearest.approach + rate * (pressure - nearest.mean_pressure)
        most = above.approach if above is not None else LOAD_GROWTH * near[0].approach + 1.0
        if below.approach < wanted < most:
            return wanted
    if above is None:
        return LOAD_GROWTH * below.approach + 1e-3
    if below.mean_pressure == 0.0:  # p* goes about with Δ²
        share = math.sqrt(pressure / above.mean_pressure)
        return below.approach + min(max(share, 0.01), 0.99) * (above.approach - below.approach)
    return 0.5 * (below.approach + above.approach)


def _around(indentation: float, known: list[Contact]) -> tuple[Contact, Contact | None]:
    """Return the two states from which a solve starts: around the indentation, or below it."""
    known = sorted(known, key=_indentation)
    below = [state for state in known if state.approach < indentation]
    above = [state for state in known if state.approach >= indentation]
    if above:
        return above[0], below[-1] if below else None
    return below[-1], below[-2] if len(below) > 1 else None


def _mean_plane(surface: Surface) -> float:
    """Return Δ/σ at d = 0, or 1 on a flat surface."""
    return surface.peak if surface.Sq > 0.0 else 1.0
