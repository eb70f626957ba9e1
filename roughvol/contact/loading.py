"""Frictionless contact of a rigid rough surface with an elastic half space, at imposed indentation.

Conventions
-----------
Heights z point out of the rough body, Δ ≥ 0 is the far-field closing displacement from first touch. With the rigid
overlap ū = Δ - (z_max - z) and the displacement u = H p the pressures solve the linear complementarity problem

    p ≥ 0,    g = u - ū ≥ 0,    p g = 0    on every element,

which has exactly one solution because H is positive definite. Inside `problem` all is scaled: heights by their
root mean square σ (h ≤ 0, highest point 0), pressures as q = p δ/(π E* σ), so that u/σ = K ∗ q with the lattice
kernel of `halfspace`; b = h + Δ/σ is the scaled overlap and w = K ∗ q - b the scaled gap. No unit gets further in.

The residual
------------
η/σ = max( max |w| where q > 0,  max -w where b > 0 ), evaluated on the whole grid by a convolution in double precision
after the iteration has ended. A pressure q ≥ 0 with residual η is the *exact* solution for a surface whose heights
differ by at most η, hence F(Δ - η) ≤ F ≤ F(Δ + η) for the load and |δV*| ≤ η/σ for the free volume. Iterations stop on
this number and on nothing else. Where b ≤ 0 there is a gap in any case, since all influence coefficients are positive.

The method
----------
H⁻¹ is an M-matrix for the Love kernel. Along increasing Δ, pressures therefore never decrease, contact sets are nested,
and every gap is a convex function of Δ. The secant through the last two states is then a lower bound of the next gap:
elements with p > 0 or a negative secant *contain* the next contact set, nearly exactly. `active_set` solves on these
elements. For other kernels the same loop runs without the guarantee: the verification re-admits every element that
penetrates. docs/solver.md has the equations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from roughvol.contact.active_set import solve_indentation
from roughvol.contact.paper_algorithm import solve_paper
from roughvol.contact.problem import LIGHT, LIGHT_ROUGH, PRECISIONS, TENSILE, Problem, check_rtol
from roughvol.contact.state import Compliance, Contact, State
from roughvol.contact.tuning import TUNING, Tuning
from roughvol.errors import ContactError
from roughvol.surfaces.surface import Surface

__all__ = ["METHODS", "PRECISIONS", "Compliance", "Contact", "Trials", "solve", "sweep"]

Method = Callable[[Problem, float, State, State | None, float], tuple[State, int, float]]
METHODS: dict[str, Method] = {"fast": solve_indentation, "paper": solve_paper}


def solve(
    surface: Surface,
    half_space: Compliance,
    indentation: float,
    *,
    rtol: float = 1e-6,
    method: str = "fast",
    tuning: Tuning = TUNING,
) -> Contact:
    """Return the contact at one indentation Δ/σ, started from nothing but the rigid overlap.

    Parameters
    ----------
    surface : heights and spacing.
    half_space : the compliance of the same grid shape.
    indentation : Δ/σ; at or below zero nothing touches.
    rtol : bound on the residual η/σ.
    method : "fast", or "paper" for the paper's Algorithm 1 on dense matrices (at most 65 × 65 elements).

    Raises
    ------
    ContactError : arguments out of range, shapes that differ.
    ConvergenceError : the residual was not reached.
    """
    return next(sweep(surface, half_space, [indentation], rtol=rtol, method=method, tuning=tuning))


def sweep(
    surface: Surface,
    half_space: Compliance,
    indentations: Iterable[float],
    *,
    rtol: float = 1e-6,
    method: str = "fast",
    precision: str = "mixed",
    pressure_error: float | None = None,
    resume: Iterable[Mapping[str, Any]] = (),
    tuning: Tuning = TUNING,
) -> Iterator[Contact]:
    """Yield the contact at each of the increasing indentations Δ/σ, every one started from those before.

    Arguments and errors as for `solve`. Each record owns its arrays.

    Parameters
    ----------
    precision : of the convolutions inside the iteration, "mixed" (single where it costs no digit) or "double"; the
        residual is the same certified one with both.
    pressure_error : bound on the relative error of p* at every state, in addition to `rtol`. The last two states tell
        the residual that the next one needs; where it turns out too large, that one is solved on.
    resume : `Contact.state` of the last two contacts of a sweep that broke off; this one then goes on as if it had not,
        to the last bit.
    """
    problem = Problem(surface, half_space, precision, tuning)
    check_rtol(rtol)
    solve_one = _method(method)
    if pressure_error is not None and not 0 < pressure_error <= 0.1:
        message = f"pressure_error is {pressure_error}; allowed: 0 < pressure_error <= 0.1"
        raise ContactError(message)
    before: State | None = None
    now = problem.untouched()
    last = -np.inf
    for state in resume:
        before, now = now, State(**state)
        last = now.indentation
    for indentation in indentations:
        if not (np.isfinite(indentation) and indentation > last):
            before_it = f" (the last was {last:g})" if np.isfinite(last) else ""
            message = f"indentation is {indentation}; allowed: finite and increasing{before_it}"
            raise ContactError(message)
        tolerance = rtol
        if pressure_error is not None and indentation > 0:
            least = problem.least_pressure(float(indentation), now)
            tolerance = min(rtol, pressure_error * least / problem.expected_stiffness(now, before))
        problem.check_reachable(float(indentation), tolerance)
        last = float(indentation)
        if indentation <= 0:
            yield problem.record(problem.untouched(indentation), problem.counts(), 0, 0.0)
            continue
        tolerance = min(tolerance, LIGHT * last)
        counts = problem.counts()
        after, iterations, residual = solve_one(problem, float(indentation), now, before, tolerance)
        contact = problem.record(after, counts, iterations, residual, now)
        while pressure_error is not None and contact.mean_pressure_bound > pressure_error:
            tolerance = 0.5 * residual * pressure_error / contact.mean_pressure_bound
            problem.check_reachable(last, tolerance)
            after, more, residual = solve_one(problem, last, after, now, tolerance)
            iterations += more
            contact = problem.record(after, counts, iterations, residual, now)
        yield contact
        before, now = now, after


class Trials:
    """Contacts of one surface at indentations in any order, each started from two others: what a search is made of.

    Parameters as for `solve` and `sweep`. ``least`` may be set to a contact at a smaller indentation than all others.
    """

    def __init__(
        self,
        surface: Surface,
        half_space: Compliance,
        *,
        rtol: float = 1e-6,
        method: str = "fast",
        pressure_error: float | None = None,
        tuning: Tuning = TUNING,
    ) -> None:
        check_rtol(rtol)
        self._problem = Problem(surface, half_space, tuning=tuning)
        self._solve = _method(method)
        self.rtol, self.pressure_error = rtol, pressure_error
        self.least: Contact | None = None
        self.untouched = self._problem.record(self._problem.untouched(), self._problem.counts(), 0, 0.0)

    def at(self, indentation: float, now: Contact, before: Contact | None = None, *, rtol: float = 0.0) -> Contact:
        """Return the contact at an indentation Δ/σ > 0, to the residual of the search or a looser one.

        It is started from the straight line through two contacts, of which `now` has the larger indentation: beyond
        both, as in a sweep, or between them, where the contact set of `now` contains the one looked for.
        """
        problem = self._problem
        problem.check_reachable(indentation, max(self.rtol, rtol))
        tolerance = max(self.tolerance(indentation), min(rtol, LIGHT_ROUGH * indentation))
        counts = problem.counts()
        earlier = before._state if before else None
        state, iterations, residual = self._solve(problem, indentation, now._state, earlier, tolerance)
        return problem.record(state, counts, iterations, residual)

    def known(self, state: Mapping[str, Any], residual: float) -> Contact:
        """Return a contact that was solved elsewhere, from its `Contact.state`; its arrays are only read."""
        return self._problem.record(State(**state), self._problem.counts(), 0, residual)

    def tolerance(self, indentation: float) -> float:
        """Return the bound of the residual of a state: that of the search, less at a slight indentation.

        An error of the pressure asked for makes it smaller: it is then the bound for the stiffest contact there is,
        under the pressure of `least` or of the highest element alone.
        """
        bound = min(self.rtol, LIGHT * indentation)
        if self.pressure_error is not None:
            pressure = self._problem.least_pressure(indentation, (self.least or self.untouched)._state)
            bound = min(bound, self.pressure_error * pressure / self._problem.stiffest)
        return bound

    def line(self, one: Contact, other: Contact) -> Callable[[float, float], Contact]:
        """Return (Δ/σ, less) ↦ the contact that the straight line through two others has at Δ; nothing is solved.

        The line is that of x = c q in contact and -w outside, with 1/c = (K⁻¹)_ii the stiffness of an element whose
        neighbours hold still. Where K⁻¹ is an M-matrix every x is a rising, concave function of Δ: between the two
        contacts the line has too little contact and pressure, beyond them too much. The x of a contact of residual η/σ
        is right to 2 η/σ; `less` is taken off all of them.
        """
        problem = self._problem
        start = problem.depth(one)
        rate = np.zeros_like(start)
        if other.indentation != one.indentation:
            rate = (problem.depth(other) - start) / (other.indentation - one.indentation)

        def at(indentation: float, less: float) -> Contact:
            x = start + (indentation - one.indentation) * rate - less
            elements = np.flatnonzero(x > 0.0)
            gap = np.maximum(-x, TENSILE * max(1.0, indentation))
            state = State(indentation, elements, x[elements] / problem.firmness, gap + indentation)
            return problem.record(state, problem.counts(), 0, np.nan)

        return at


def _method(name: str) -> Method:
    if name not in METHODS:
        message = f"method is {name!r}; allowed: {', '.join(METHODS)}"
        raise ContactError(message)
    return METHODS[name]
