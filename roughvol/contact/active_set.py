"""One indentation: start from the secant through two states, iterate on the candidates, verify on the whole grid.

This is the page of the solver. Equation numbers are those of docs/solver.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from roughvol.contact.kernels import influence_matrix
from roughvol.contact.preconditioner import Rates, approximate_inverse
from roughvol.contact.problem import TENSILE, Problem
from roughvol.contact.state import State
from roughvol.errors import ConvergenceError
from roughvol.typing import Array, Index


class Mode(Enum):
    """How careful a round of iterations is. Each round starts from the true gap that the one before left."""

    SWIFT = "32-bit directions; the last step is not measured by a convolution"
    CAREFUL = "32-bit directions; every step is measured"
    EXACT = "64-bit directions; every step is measured"


@dataclass(frozen=True)
class Face:
    """The candidates for contact, and q, w and the rates of (q, K q) with indentation there."""

    elements: Index
    q: Array
    w: Array
    rates: Rates | None


def solve_indentation(
    problem: Problem, indentation: float, now: State, before: State | None, rtol: float
) -> tuple[State, int, float]:
    """Solve one indentation, started from two states, or from the rigid overlap alone.

    Returns
    -------
    state, iterations (a factorisation counts as one), residual η/σ ≤ rtol.

    Raises
    ------
    ConvergenceError
        The residual was not reached.
    """
    if before is None:
        now, before = _approach(problem, indentation, now, rtol)
    face = predict(problem, indentation, now, before, problem.single(rtol))  # (3), (4)
    iterations, residual = 0, np.inf
    rounds = problem.tuning.rounds
    for mode in [Mode.SWIFT, Mode.CAREFUL, *[Mode.EXACT] * rounds][:rounds]:
        if face.elements.size <= problem.tuning.dense_up_to:
            q, steps = dense_face(problem, indentation, face.elements), 1
        else:
            q, steps = conjugate_gradients(problem, indentation, face, rtol, mode)
        iterations += steps
        state, residual = problem.verified(indentation, face.elements, q, indentation - now.indentation)  # (2)
        if residual <= rtol:
            return state, iterations, residual
        face = _again(problem, state, now)
    message = f"contact not converged to {rtol:g}"
    raise ConvergenceError(message, indentation=indentation, iterations=iterations, residual=residual)


def conjugate_gradients(problem: Problem, indentation: float, face: Face, rtol: float, mode: Mode) -> tuple[Array, int]:
    """Return q ≥ 0 on the candidates and the iterations, by preconditioned conjugate gradients with bounds.

    Residuals and directions of 32 bits lose no digit of the result: their errors shrink with them, and the verification
    sees the rest.

    Raises
    ------
    ConvergenceError
        Too many iterations.
    """
    tuning, half_space, elements = problem.tuning, problem.half_space, face.elements
    single = problem.single(rtol) and mode is not Mode.EXACT
    tolerance = tuning.safety * rtol
    q, w = face.q.copy(), face.w.copy()
    inverse, free = approximate_inverse(half_space.influence, half_space.shape, elements, q, w, face.rates, tuning)
    direction: NDArray[Any] = np.zeros(q.size, dtype=np.float32 if single else np.float64)
    r_before, rz, step, residual = direction.copy(), 1.0, 0.0, np.inf
    for iteration in range(tuning.iterations):
        if iteration % tuning.cut_every == 0:
            cut(problem, elements, q, w, single)  # (5) project on q ≥ 0
        if iteration:
            free = (q != 0.0) | (w < 0.0)  # (6) free set
        r = np.negative(w, out=np.empty_like(direction), casting="same_kind")
        r *= free  # (7) residual
        residual_before, residual = residual, float(np.abs(r).max())
        if residual <= tolerance:
            if cut(problem, elements, q, w, single):
                continue
            return q, iteration
        z = inverse(r)  # (8) precondition
        z *= free & ((q > 0.0) | (z >= 0.0))  # (9) bounds
        rz_before, rz = rz, float(r @ z)
        direction *= max(0.0, (rz - float(r_before @ z)) / rz_before)
        direction += z  # (10) direction
        direction *= free
        trusted = tolerance * min(tuning.last_step, residual_before / residual)
        if mode is Mode.SWIFT and iteration and residual <= trusted:
            return np.maximum(q + step * direction, 0.0), iteration  # (12) last step, unmeasured
        response = half_space.displacement_at(elements, direction, single=single)
        step = float(r @ direction) / float(direction @ response)  # (11) exact step
        q += step * direction
        w += step * response
        r_before = r
    message = f"conjugate gradients not converged to {tolerance:g}"
    raise ConvergenceError(message, indentation=indentation, iterations=tuning.iterations, residual=residual)


def cut(problem: Problem, elements: Index, q: Array, w: Array, single: bool) -> bool:
    """Set negative pressures to zero and take their displacement out of the gap; return whether there were any."""
    if not q.min(initial=0.0) < 0.0:
        return False
    negative = np.flatnonzero(q < 0.0)
    displacement = problem.superposition.displacement(elements, negative, q[negative], single=single)
    if displacement is None:
        displacement = problem.half_space.displacement_at(elements, np.minimum(q, 0.0), single=single)
    w -= displacement
    q[negative] = 0.0
    return True


def dense_face(problem: Problem, indentation: float, elements: Index) -> Array:
    """Return q ≥ 0 on few elements by factorisation: tensile ones leave, penetrating ones come back.

    Raises
    ------
    ConvergenceError
        The contact set did not settle.
    """
    matrix = influence_matrix(problem.half_space.influence, elements)
    b = problem.heights[elements] + indentation
    q = np.zeros(b.size)
    active = np.ones(b.size, dtype=bool)
    for _ in range(100 + b.size):
        index = np.flatnonzero(active)
        q[:] = 0.0
        if index.size:
            those = matrix if index.size == b.size else matrix[np.ix_(index, index)]
            factor = linalg.cho_factor(those, lower=True, check_finite=False)
            q[index] = linalg.cho_solve(factor, b[index], check_finite=False)
        tensile = q < -TENSILE * q.max(initial=0.0)
        if tensile.any():
            active &= ~tensile
            continue
        w = matrix @ q - b
        penetrating = ~active & (w < -TENSILE * np.abs(b).max())
        if not penetrating.any():
            return np.maximum(q, 0.0)
        active |= penetrating
    message = f"the contact set of {b.size} candidates did not settle"
    raise ConvergenceError(
        message, indentation=indentation, iterations=100 + b.size, residual=float(np.abs(w[active]).max(initial=0.0))
    )


def predict(problem: Problem, indentation: float, now: State, before: State | None, single: bool) -> Face:
    """Return the candidates and q, w there, extrapolated along the secant through two states.

    Without a second state, the candidates are the rigid overlap, and q = 0.
    """
    if before is None:
        candidates = np.flatnonzero(problem.heights > -indentation)
        return Face(candidates, np.zeros(candidates.size), -indentation - problem.heights[candidates], None)
    step = indentation - now.indentation
    theta = step / (now.indentation - before.indentation)
    # Beyond both states no gap larger than the step can close, as none falls faster than the surfaces approach.
    # Between them, as in a search, the contact of the later one holds the contact asked for.
    candidates, gap = now.within(max(0.0, step))
    w = gap + theta * (gap - before.gap(candidates))
    predicted = (w if theta > 0.0 else gap) < 0.0
    predicted[problem.places(candidates, now.elements)[0]] = True  # (3) candidates
    candidates, w = candidates[predicted], w[predicted]
    q, rates = _rates(problem, candidates, now, before)
    q += step * rates[0]  # (4) secant
    cut(problem, candidates, q, w, single)  # (5)
    return Face(candidates, q, w, rates)


def _again(problem: Problem, state: State, now: State) -> Face:
    """Return the face of a further round, from a verified state: its contact, and all that penetrates."""
    candidates, w = state.within(0.0)
    again = w < 0.0
    again[problem.places(candidates, state.elements)[0]] = True
    candidates, w = candidates[again], w[again]
    if state.indentation > now.indentation:
        q, rates = _rates(problem, candidates, state, now)
        return Face(candidates, q, w, rates)
    (q,) = problem.pressures(candidates, state)
    return Face(candidates, q, w, None)


def _rates(problem: Problem, candidates: Index, now: State, before: State) -> tuple[Array, Rates]:
    """Return q on the candidates, and pressure and displacement per unit of indentation there, between two states."""
    q, earlier = problem.pressures(candidates, now, before)
    # where contacts are not nested (another kernel than Love's, or elements on the brink) only those in both
    pressure = np.where(q > 0.0, q - earlier, 0.0)
    displacement = now.touch_at[candidates] - before.touch_at[candidates]
    step = now.indentation - before.indentation
    return q, (pressure / step, displacement / step)


def _approach(problem: Problem, indentation: float, now: State, rtol: float) -> tuple[State, State | None]:
    """Return two rough states on the way to an indentation whose rigid overlap is too large a set to begin with.

    The overlap is up to fifty times the contact; the states on the way keep all vectors small.
    """
    tuning = problem.tuning
    stages = [indentation]
    while np.count_nonzero(problem.heights > -stages[-1]) > tuning.cold_up_to:
        stages.append(stages[-1] / tuning.cold_step)
        if len(stages) > 40:  # most of the surface is one plateau: there is no way around it
            return now, None
    before: State | None = None
    for stage in stages[:0:-1]:
        before, now = now, solve_indentation(problem, stage, now, before, max(rtol, tuning.cold_rtol))[0]
    return now, before
