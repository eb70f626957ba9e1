"""One indentation: predict from the secant through two states, iterate on the candidates, verify on the whole grid.

This is the page of the solver. Equation numbers are those of solver.md. With pressures q, overlap b = h + Δ, gap
w = K q - b and all lengths over σ, the contact is the solution of q ≥ 0, w ≥ 0, q w = 0 on every element.
The law of the problem (`law`) says which pressures are allowed and which elements are free; a hardness is in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from roughvol.contact.preconditioner import Rates, approximate_inverse, weaker_inverses
from roughvol.contact.problem import TENSILE, Problem
from roughvol.contact.state import State
from roughvol.errors import ConvergenceError
from roughvol.typing import Array, Index

_NONE: Index = np.empty(0, dtype=np.intp)


@dataclass(frozen=True)
class Start:
    """The candidates for contact and the start of the iteration on them; w counts the pressure of the elements held."""

    candidates: Index
    q: Array
    w: Array
    rates: Rates | None
    held: Index

    def with_held(self, q: Array, limit: float) -> tuple[Index, Array]:
        """Return the candidates and the elements held at the limit in increasing order, with q."""
        if not self.held.size:
            return self.candidates, q
        elements = np.concatenate((self.candidates, self.held))
        order = np.argsort(elements)
        return elements[order], np.concatenate((q, np.full(self.held.size, limit)))[order]


def solve_indentation(
    problem: Problem, indentation: float, latest: State, previous: State | None, rtol: float
) -> State:
    """Solve one indentation, started from two states, or from the rigid overlap alone.

    `previous` has the smaller indentation, or is None. The state returned is verified: its η/σ (2) is at most `rtol`.
    """
    if previous is None:
        latest, previous = _approach(problem, indentation, latest, rtol)
    start = _predict(problem, indentation, latest, previous, problem.single(rtol))  # (3), (4)
    iterations, residual = 0, np.inf
    for number in range(problem.tuning.rounds):
        q = _factorised(problem, indentation, start) if start.candidates.size <= problem.tuning.dense_up_to else None
        steps = 1
        if q is None:
            q, steps = conjugate_gradients(problem, indentation, start, rtol, number)
        iterations += steps
        elements, q = start.with_held(q, problem.law.limit)
        state = problem.verified(indentation, elements, q, next_advance=indentation - latest.indentation)  # (2)
        state.iterations, residual = iterations, state.residual
        if residual <= rtol:
            return state
        start = _corrected(problem, state, latest)
        del state
    message = f"contact not converged to {rtol:g}"
    raise ConvergenceError(message, indentation=indentation, iterations=iterations, residual=residual)


def conjugate_gradients(
    problem: Problem, indentation: float, start: Start, rtol: float, number: int
) -> tuple[Array, int]:
    """Minimise the energy over the pressures that the law allows, by preconditioned conjugate gradients, in place.

    Round 0 ends with a step that no convolution measures (12). Round 1 measures every step, in case that one failed.
    q and w have 64 bits. Before round 2, residuals, directions and their convolutions have 32, at the tolerances of
    `Problem.single`: the error of a step is a share of the step, and the verification measures their sum in w.
    """
    tuning, half_space, elements = problem.tuning, problem.half_space, start.candidates
    single = problem.single(rtol) and number < 2
    tolerance, law = tuning.safety * rtol, problem.law
    q, w = start.q, start.w
    # First free set: (6) without the elements that M⁻¹ expects lifted clear. The verification finds a wrong guess.
    inverse, free = approximate_inverse(half_space, elements, q, w, law.free(q, w), start.rates, tuning)
    weaker = weaker_inverses(half_space, elements, tuning)
    direction: NDArray[Any] = np.zeros(q.size, dtype=np.float32 if single else np.float64)
    r_before, rz, step, residual = direction.copy(), 1.0, 0.0, np.inf  # without effect: the first direction is z
    for iteration in range(3 * tuning.iterations):
        if iteration % tuning.cut_every == 0:
            _project(problem, elements, q, w, single)  # (5) project on the pressures allowed: may cost a convolution
        if iteration:
            free = law.free(q, w)  # (6) free set: q < 0 stays in it until the next projection
        r = np.negative(w, out=np.empty_like(direction), casting="same_kind")
        r *= free  # (7) residual
        residual_before, residual = residual, float(np.abs(r).max())
        if residual <= tolerance:
            if _project(problem, elements, q, w, single):
                continue  # w has changed
            return q, iteration
        z = inverse(r)  # (8) precondition
        z *= free & law.admits(q, z)  # (9) bounds: no tensile direction at q ≤ 0
        rz_before, rz = rz, float(r @ z)
        direction *= max(0.0, (rz - float(r_before @ z)) / rz_before)
        direction += z  # (10) direction
        direction *= free
        reduction = residual_before / residual  # by the previous step
        if number == 0 and iteration and residual <= tolerance * min(tuning.last_step, reduction):
            return law.project(q + step * direction), iteration  # (12) one more step of the previous length
        response = half_space.displacement_at(elements, direction, single=single)
        curvature = float(direction @ response)
        descends = 0.0 < rz < np.inf and 0.0 < curvature < np.inf
        if not descends or (iteration + 1) % tuning.iterations == 0:  # rounding has spoilt M⁻¹
            inverse, rz = next(weaker), 1.0
            direction[:] = 0.0
            continue
        step = float(r @ direction) / curvature  # (11) exact step
        q += step * direction
        w += step * response
        r_before = r
    message = f"conjugate gradients not converged to {tolerance:g}"
    raise ConvergenceError(message, indentation=indentation, iterations=iteration + 1, residual=residual)


def _project(problem: Problem, elements: Index, q: Array, w: Array, single: bool) -> bool:
    """Project q on the pressures allowed and change w accordingly, in place; return whether any q has changed."""
    outside = problem.law.outside(q)
    if not outside.size:
        return False
    allowed = problem.law.project(q[outside])
    excess = q[outside] - allowed
    displacement = problem.superposition.displacement(elements, outside, excess, single=single)
    if displacement is None:  # too many for a sum
        field = np.zeros(q.size)
        field[outside] = excess
        displacement = problem.half_space.displacement_at(elements, field, single=single)
    w -= displacement
    q[outside] = allowed
    return True


def _factorised(problem: Problem, indentation: float, start: Start) -> Array | None:
    """Return the pressures of few elements, by Cholesky factorisations, or None if the contact set goes in circles.

    None too if rounding leaves K not positive definite. Elements above the limit are set to it, and freed where a gap
    opens. Circles need a limit, or K⁻¹ no M-matrix.
    """
    elements, limit = start.candidates, problem.law.limit
    matrix = problem.half_space.between(elements)
    b = matrix @ start.q - start.w if start.held.size else problem.heights[elements] + indentation
    q = np.zeros(b.size)
    active, yielded = np.ones(b.size, dtype=bool), np.zeros(b.size, dtype=bool)
    for _ in range(100 + b.size):
        index = np.flatnonzero(active)
        q[:] = 0.0
        q[yielded] = limit
        if index.size:
            block = matrix if index.size == b.size else matrix[np.ix_(index, index)]
            right = b[index] - limit * matrix[np.ix_(index, yielded)].sum(axis=1) if yielded.any() else b[index]
            _, q[index], fault = linalg.lapack.dposv(block, right, lower=True)  # quicker than cho_factor
            if fault:
                return None
        tensile, over = q < -TENSILE * q.max(initial=0.0), active & (q > limit)
        if (leaves := tensile | over).any():
            active &= ~leaves
            yielded |= over
            continue
        w = matrix @ q - b
        margin = TENSILE * np.abs(b).max(initial=0.0)
        back = (~active & ~yielded & (w < -margin)) | (yielded & (w > margin))
        if not back.any():
            return problem.law.project(q)
        active |= back
        yielded &= ~back
    return None


def _predict(problem: Problem, indentation: float, latest: State, previous: State | None, single: bool) -> Start:
    """Return the candidates with q and w there, extrapolated along the secant through two states (3), (4).

    ``latest`` has the larger indentation of the two; the one to solve is beyond both, or between them in a search.
    Without a second state the candidates are the rigid overlap, and q = 0.
    """
    if previous is None:
        candidates = np.flatnonzero(problem.heights > -indentation)
        return Start(candidates, np.zeros(candidates.size), -indentation - problem.heights[candidates], None, _NONE)
    if latest.indentation < min(previous.indentation, indentation):  # indentations have turned
        latest, previous = previous, latest
    advance = indentation - latest.indentation
    theta = advance / (latest.indentation - previous.indentation)
    # Beyond both states a gap larger than the advance stays open: no gap falls faster than the surfaces approach.
    # Between them, as in a search, the contact of the latest state holds the contact at this indentation.
    # Where Δ falls, the contact of the state before takes part: the secant has tension on the elements that have left.
    falls = previous.indentation > latest.indentation
    candidates, gap = latest.within(max(0.0, advance, previous.indentation - latest.indentation))
    latest.forget()
    w = gap + theta * (gap - previous.gap(candidates))
    # Gaps are not convex while a surface yields: elements near contact take part as well.
    margin = problem.tuning.yield_margin * max(0.0, advance) if problem.law.yields else 0.0
    predicted = (w if theta > 0.0 else gap) < margin
    contact = previous if falls else latest
    predicted[problem.positions(candidates, contact.elements)[0]] = True  # (3) contact is among the candidates
    candidates, w = candidates[predicted], w[predicted]
    candidates, w, held = _without_held(problem, candidates, w, latest, previous)
    q, rates = _rates(problem, candidates, latest, previous)
    q += advance * rates[0]  # (4) secant
    _project(problem, candidates, q, w, single)  # (5)
    return Start(candidates, q, w, rates, held)


def _corrected(problem: Problem, state: State, latest: State) -> Start:
    """Return the start of a further round, from a verified state: its contact, and every element that penetrates."""
    candidates, w = state.within(0.0)
    state.forget()
    mask = w < 0.0  # `within` may return more
    mask[problem.positions(candidates, state.elements)[0]] = True
    candidates, w = candidates[mask], w[mask]
    candidates, w, held = _without_held(problem, candidates, w, state)
    if state.indentation > latest.indentation:  # rates need two states in order
        q, rates = _rates(problem, candidates, state, latest)
        return Start(candidates, q, w, rates, held)
    (q,) = problem.pressures(candidates, state)
    return Start(candidates, q, w, None, held)


def _without_held(problem: Problem, candidates: Index, w: Array, *states: State) -> tuple[Index, Array, Index]:
    """Return the candidates that take part with their w, and those that overlap at the limit in every state."""
    if not problem.law.yields:
        return candidates, w, _NONE
    stay = w < 0.0
    for q in problem.pressures(candidates, *states):
        stay &= problem.law.held(q)
    return candidates[~stay], w[~stay], candidates[stay]


def _rates(problem: Problem, candidates: Index, latest: State, previous: State) -> tuple[Array, Rates]:
    """Return q on the candidates, and the rates of pressure and displacement with indentation there."""
    q, earlier = problem.pressures(candidates, latest, previous)
    # Contacts may fail to be nested: for another kernel than Love's, or by rounding. An element that has lost contact
    # gets the rate 0, and the extrapolated w differs from K q - b there until the verification.
    falls = previous.indentation > latest.indentation
    pressure = q - earlier if falls else np.where(q > 0.0, q - earlier, 0.0)
    displacement = latest.touch_at[candidates] - previous.touch_at[candidates]
    advance = latest.indentation - previous.indentation
    return q, (pressure / advance, displacement / advance)


def _approach(problem: Problem, indentation: float, latest: State, rtol: float) -> tuple[State, State | None]:
    """Return two rough states on the way to an indentation whose rigid overlap is up to fifty times the contact.

    They keep all vectors small. Their iterations are not counted, their convolutions are.
    """
    tuning = problem.tuning
    stages = [indentation]
    while np.count_nonzero(problem.heights > -stages[-1]) > tuning.cold_up_to:
        stages.append(stages[-1] / tuning.cold_step)
        if len(stages) > 40:  # a plateau larger than this comes into contact at once
            return latest, None
    previous: State | None = None
    for stage in stages[:0:-1]:  # increasing, without the last: that one is solved by the caller
        previous, latest = latest, solve_indentation(problem, stage, latest, previous, max(rtol, tuning.cold_rtol))
    return latest, previous
