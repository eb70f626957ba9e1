"""Frictionless contact of a rigid rough surface with an elastic half space, at imposed indentation.

Conventions: heights z point out of the rough body. Δ ≥ 0 is the far-field closing displacement from first touch. With
the rigid overlap ū = Δ - (z_max - z) and the displacement u = H p, pressures solve the complementarity problem

    p ≥ 0,    g = u - ū ≥ 0,    p g = 0    on every element.

It has exactly one solution, as H is positive definite. `problem` scales all lengths by the root mean square height σ.

A surface of hardness p_m has p ≤ p_m as well. Where p = p_m, an overlap -g ≥ 0 may be left: it becomes a plastic
displacement of the surface, and stays (Almqvist et al., J. Tribol. 129 (2007) 499-507).

The residual is η/σ = max( max |w| where p > 0,  max -w where ū > 0 ), w the computed gap over σ, on the whole grid.
One convolution in double precision gives it after the iteration has ended. A pressure p ≥ 0 with residual η is the
*exact* solution for heights changed by at most η. Hence F(Δ - η) ≤ F ≤ F(Δ + η) for the load, and |δV*| ≤ η/σ for the
free volume. Solves end on this number and on nothing else.

docs/explanation/solver.md has the method and its equations.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from roughvol.contact.active_set import solve_indentation
from roughvol.contact.options import DEFAULT, Options
from roughvol.contact.paper_algorithm import solve_paper
from roughvol.contact.problem import LIGHT, LIGHT_ROUGH, ROUNDING, TENSILE, Problem
from roughvol.contact.state import Compliance, Contact, Estimated, Leg, State
from roughvol.errors import ContactError
from roughvol.surfaces.surface import Surface, real
from roughvol.typing import Array

SOLVERS = {"fast": solve_indentation, "paper": solve_paper}


def solve(
    surface: Surface, half_space: Compliance, indentation: float, options: Options = DEFAULT, **changed: Any
) -> Contact:
    """Return the contact at one indentation, started from the rigid overlap.

    Parameters
    ----------
    surface : Surface
        Heights and spacing [length].
    half_space : Compliance
        Half space of the same shape, such as `HalfSpace`.
    indentation : float
        Δ/σ. At or below zero nothing touches.
    options : Options
        Accuracy, method, hardness and constants.
    **changed
        Fields of `options` by name, as ``rtol=1e-8``.

    Returns
    -------
    Contact
        The state.

    Raises
    ------
    ContactError
        If an argument is out of range, or the shapes differ.
    ConvergenceError
        If the residual is not reached.

    See Also
    --------
    roughvol.contact.sweep : Yields the contacts along rising indentations.
    roughvol.contact.indentation_for : Returns the indentation of an area or a pressure.

    Examples
    --------
    >>> import numpy as np
    >>> from roughvol.contact import HalfSpace, solve
    >>> from roughvol.surfaces import Surface
    >>> x = np.linspace(-1.0, 1.0, 33)
    >>> dome = Surface(-(x[:, None] ** 2) - x**2, spacing=x[1] - x[0])
    >>> contact = solve(dome, HalfSpace(dome.shape), indentation=1.0, rtol=1e-8)
    >>> print(f"{contact.contact_area_fraction:.3f}")
    0.170
    """
    return next(sweep(surface, half_space, [indentation], options, **changed))


def sweep(
    surface: Surface,
    half_space: Compliance,
    indentations: Iterable[float],
    options: Options = DEFAULT,
    *,
    resume: Iterable[Mapping[str, Any]] = (),
    **changed: Any,
) -> Iterator[Contact]:
    """Yield the contact at each of several indentations, started from the last two.

    Where indentations turn from rising to falling, or back, a leg of the path ends. A surface with a hardness goes on
    with the plastic displacement left by this state.

    Parameters
    ----------
    surface, half_space
        As in `solve`.
    indentations : iterable of float
        Δ/σ, each different from the one before.
    options
        As in `solve`.
    resume : iterable of dict
        `Contact.state` of the last two contacts of an interrupted sweep with the same hardness. The states that follow
        are the same to the last bit.
    **changed
        As in `solve`.

    Yields
    ------
    Contact
        The state at each indentation. It owns its arrays.

    Raises
    ------
    ContactError
        If an argument is out of range, the shapes differ, or an indentation is that of the state before.
    ConvergenceError
        If the residual is not reached.

    See Also
    --------
    solve : Returns one state.

    Examples
    --------
    >>> import numpy as np
    >>> from roughvol.contact import HalfSpace, sweep
    >>> from roughvol.surfaces import Surface
    >>> x = np.linspace(-1.0, 1.0, 33)
    >>> dome = Surface(-(x[:, None] ** 2) - x**2, spacing=x[1] - x[0])
    >>> [round(contact.contact_area_fraction, 2) for contact in sweep(dome, HalfSpace(dome.shape), [0.5, 1.0])]
    [0.09, 0.17]
    """
    problem, latest, previous, error = _resumed(Problem(surface, half_space, replace(options, **changed)), resume)
    rising, last = previous is None or latest.indentation > previous.indentation, latest.indentation
    started = previous is not None
    for indentation in (real("indentation", given, ContactError) for given in indentations):
        if not np.isfinite(indentation) or (started and indentation == last):
            at_last = f" and not {last:g}, that of the state before" if started else ""
            raise ContactError(f"indentation is {indentation}; allowed: finite{at_last}")
        if started and rising != (indentation > last):  # a leg ends
            rising = not rising
            problem, latest, previous = _turned(problem, problem.leg.after(latest, error), latest, previous)
        started, last, counts = True, indentation, problem.counts()
        contact = _step(problem, indentation, latest, previous, counts)
        noise = error + contact.residual + ROUNDING * max(1.0, indentation)
        if problem.rebound(latest, contact._state) > noise:  # no M-matrix: the leg ends at the state before
            problem, latest, previous = _turned(problem, problem.leg.after(latest, error), latest, previous)
            contact = _step(problem, indentation, latest, previous, counts)
        yield contact
        latest, previous = contact._state, latest
        if indentation <= problem.touch:
            previous = None
        else:
            error = contact.residual


def _step(
    problem: Problem, indentation: float, latest: State, previous: State | None, counts: tuple[float, float]
) -> Contact:
    """Return the contact at the next indentation of a leg, to the bounds of the residual and of the pressure."""
    tolerance, pressure_error = problem.options.rtol, problem.options.pressure_error
    solve_one = SOLVERS[problem.options.method]
    if pressure_error is not None and indentation > problem.touch:
        least = problem.least_pressure(indentation, latest)
        stiffness = problem.expected_stiffness(latest, previous)
        if stiffness > 0.0:  # none where all of the contact has yielded; the bound of the state decides below
            tolerance = min(tolerance, pressure_error * least / stiffness)
    problem.check_reachable(indentation, tolerance)
    if indentation <= problem.touch:
        return problem.record(problem.untouched(indentation), counts)
    tolerance = min(tolerance, LIGHT * (indentation - problem.touch))
    solved = solve_one(problem, indentation, latest, previous, tolerance)
    contact = problem.record(solved, counts, latest)
    while pressure_error is not None and contact.mean_pressure_bound > pressure_error:
        left = contact.mean_pressure_bound * problem.leg.carried / contact.residual
        if left >= pressure_error:  # no solve of this state lowers it
            message = (
                f"the residual of the legs before leaves a relative error of {left:.2g} in p* = "
                f"{contact.mean_pressure:.3g}; allowed: {pressure_error:g}. A smaller rtol lowers it; in a study, "
                f"a smaller max_error.free_volume"
            )
            raise ContactError(message)
        tolerance = 0.5 * solved.residual * pressure_error / contact.mean_pressure_bound
        problem.check_reachable(indentation, tolerance)
        iterations, solved = solved.iterations, solve_one(problem, indentation, solved, latest, tolerance)
        solved.iterations += iterations
        contact = problem.record(solved, counts, latest)
    return contact


def _resumed(problem: Problem, states: Iterable[Mapping[str, Any]]) -> tuple[Problem, State, State | None, float]:
    """Return the problem on the last leg, its last two states, and the error of the last one."""
    latest, previous, error = problem.untouched(), None, 0.0
    for state in states:
        leg, held, error = _held(problem, state)
        problem, latest, _ = _turned(problem, leg, latest, None)
        previous, latest = latest, held
    return problem, latest, previous if latest.elements.size else None, error


def _held(problem: Problem, state: Mapping[str, Any]) -> tuple[Leg, State, float]:
    """Return the leg, the state and its error, from `Contact.state`."""
    held = dict(state)
    leg = Leg(problem.law, held.pop("plastic", None), held.pop("carried", 0.0))
    error = held.pop("residual", 0.0)
    return leg, State(**held), error


def _turned(problem: Problem, leg: Leg, latest: State, previous: State | None) -> tuple[Problem, State, State | None]:
    """Return the problem at the start of a leg, with the states before it."""
    if leg.plastic is problem.leg.plastic:
        return problem, latest, previous
    lowered = problem.on(leg)
    return lowered, lowered.moved(latest, problem), previous and lowered.moved(previous, problem)


class Trials:
    """Contacts of one surface at indentations in any order, each started from two others: the steps of a search.

    The trials may continue a path: `after` is `Contact.state` on their leg, `turned` if the leg begins at this state.
    `untouched` is the state at first touch on the leg. A caller may set `least`, a contact below all trials.
    """

    def __init__(
        self,
        surface: Surface,
        half_space: Compliance,
        options: Options = DEFAULT,
        *,
        after: Mapping[str, Any] | None = None,
        turned: bool = False,
        **changed: Any,
    ) -> None:
        self.options = replace(options, **changed)
        self.problem = Problem(surface, half_space, self.options)
        if after is not None:
            leg, state, error = _held(self.problem, after)
            self.problem = self.problem.on(leg.after(state, error) if turned else leg)
        self.least: Contact | None = None
        self.untouched = self.apart(self.problem.touch)

    def lowered(self, depth: Array) -> Trials:
        """Return the trials on the virgin surface with each element lower by a depth over σ (nodes,)."""
        trials = copy.copy(self)
        trials.problem, trials.least = self.problem.lowered(depth), None
        trials.untouched = trials.apart(trials.problem.touch)
        return trials

    def moved(self, contact: Contact, before: Trials) -> Contact:
        """Return a contact of the trials before, moved with the mean plane of the surface: a start, no solved state."""
        state = self.problem.moved(contact._state, before.problem)
        state.indentation += before.problem.mean_height - self.problem.mean_height
        return self.problem.record(state)

    def apart(self, indentation: float) -> Contact:
        """Return the state without contact at an indentation, at or below the first touch."""
        return self.problem.record(self.problem.untouched(indentation))

    def at(self, indentation: float, latest: Contact, previous: Contact | None = None, *, rtol: float = 0.0) -> Contact:
        """Return the contact at Δ/σ > 0, from the line through two contacts; `latest` has the larger indentation.

        `rtol` is the bound of the residual η/σ, if looser than that of the search.
        """
        problem = self.problem
        problem.check_reachable(indentation, max(self.options.rtol, rtol))
        tolerance = max(self.tolerance(indentation), min(rtol, LIGHT_ROUGH * (indentation - problem.touch)))
        counts = problem.counts()
        solve_one, earlier = SOLVERS[self.options.method], previous._state if previous else None
        return problem.record(solve_one(problem, indentation, latest._state, earlier, tolerance), counts)

    def known(self, state: Mapping[str, Any], residual: float) -> Contact:
        """Return the record of a contact solved elsewhere, from its `Contact.state` and its residual η/σ."""
        leg, held, _ = _held(self.problem, state)
        if leg.plastic is not None or self.problem.leg.plastic is not None:
            held = self.problem.moved(held, self.problem.on(leg))
        held.residual = residual - self.problem.leg.carried
        return self.problem.record(held)

    def tolerance(self, indentation: float) -> float:
        """Return the bound of the residual η/σ at an indentation: at most that of the options, and Δ/(100 σ).

        A bound of p* lowers it as for the stiffest contact, under the pressure of `least` or of the highest element.
        """
        bound = min(self.options.rtol, LIGHT * (indentation - self.problem.touch))
        if self.options.pressure_error is not None:
            pressure = self.problem.least_pressure(indentation, (self.least or self.untouched)._state)
            bound = min(bound, self.options.pressure_error * pressure / self.problem.stiffest)
        return bound

    def line(self, first: Contact, second: Contact) -> Callable[[float, float], Contact]:
        """Return the straight line through two contacts, perhaps the same, as estimates of contacts, without a solve.

        The line is that of x = c q in contact and x = -w outside, see `search`. The callable maps Δ/σ and a margin,
        subtracted from every x, to a contact.
        """
        problem = self.problem
        start = problem.depth(first)
        rate = np.zeros_like(start)
        if second.approach != first.approach:
            rate = (problem.depth(second) - start) / (second.approach - first.approach)

        def at(indentation: float, margin: float) -> Contact:
            x = (indentation - first.approach) * rate
            x += start
            x -= margin
            elements = np.flatnonzero(x > 0.0)
            pressure = problem.law.project(x[elements] / problem.firmness)
            return problem.record(Estimated(indentation, elements, pressure, x, TENSILE * max(1.0, indentation)))

        return at
