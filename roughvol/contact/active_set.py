"""One indentation: predict from the secant through two states, iterate on the candidates, verify on the whole grid.

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
    """Precision of a round of iterations. Each round starts from the true gap that the last one left."""

    SWIFT = "32-bit directions; the last step is not measured by a convolution"
    CAREFUL = "32-bit directions; every step is measured"
    EXACT = "64-bit directions; every step is measured"


@dataclass(frozen=True)
class Face:
    """The candidates for contact, with q, w and the rates of (q, K q) with indentation there."""

    elements: Index
    q: Array
    w: Array
    rates: Rates | None


def solve_indentation(
    problem: Problem, indentation: float, latest: State, previous: State | None, rtol: float
) -> tuple[State, int, float]:
    """Solve one indentation, started from two states, or from the rigid overlap alone.

    Parameters
    ----------
    problem : Problem
        Scaled problem.
    indentation : float
        Δ/σ.
    latest, previous : State
        States of the secant; ``previous`` has the smaller indentation, or is None.
    rtol : float
        Bound of the residual η/σ.

    Returns
    -------
    state : State
        The verified state.
    iterations : int
        Iterations; a factorisation counts as one.
    residual : float
        η/σ ≤ `rtol`, equation (2) of docs/solver.md.

    Raises
    ------
    ConvergenceError
        If the residual is not reached.
    """
    if previous is None:
        latest, previous = _approach(problem, indentation, latest, rtol)
    face = _predict(problem, indentation, latest, previous, problem.single(rtol))  # (3), (4)
    iterations, residual = 0, np.inf
    rounds = problem.tuning.rounds
    for mode in [Mode.SWIFT, Mode.CAREFUL, *[Mode.EXACT] * rounds][:rounds]:
        if face.elements.size <= problem.tuning.dense_up_to:
            q, steps = _dense_face(problem, indentation, face.elements), 1
        else:
            q, steps = conjugate_gradients(problem, indentation, face, rtol, mode)
        iterations += steps
        state, residual = problem.verified(indentation, face.elements, q, indentation - latest.indentation)  # (2)
        if residual <= rtol:
            return state, iterations, residual
        face = _corrected(problem, state, latest)
    message = f"contact not converged to {rtol:g}"
    raise ConvergenceError(message, indentation=indentation, iterations=iterations, residual=residual)


def conjugate_gradients(problem: Problem, indentation: float, face: Face, rtol: float, mode: Mode) -> tuple[Array, int]:
    """Minimise the energy over q ≥ 0 on the candidates, by preconditioned conjugate gradients with bounds.

    Residuals and directions of 32 bits lose no digit of the result: their errors shrink with the residual.

    Parameters
    ----------
    problem, indentation, rtol
        As in `solve_indentation`; the indentation is for errors alone.
    face : Face
        Candidates and the start.
    mode : Mode
        Precision of the round.

    Returns
    -------
    q : array (n,)
        Scaled pressures ≥ 0 on the candidates.
    iterations : int
        Iterations taken.

    Raises
    ------
    ConvergenceError
        After `Tuning.iterations` iterations.
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
            _cut(problem, elements, q, w, single)  # (5) project on q ≥ 0
        if iteration:
            free = (q != 0.0) | (w < 0.0)  # (6) free set
        r = np.negative(w, out=np.empty_like(direction), casting="same_kind")
        r *= free  # (7) residual
        residual_before, residual = residual, float(np.abs(r).max())
        if residual <= tolerance:
            if _cut(problem, elements, q, w, single):
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


def _cut(problem: Problem, elements: Index, q: Array, w: Array, single: bool) -> bool:
    """Set negative pressures to zero, take their displacement out of the gap, and return whether there were any."""
    if not q.min(initial=0.0) < 0.0:
        return False
    negative = np.flatnonzero(q < 0.0)
    displacement = problem.superposition.displacement(elements, negative, q[negative], single=single)
    if displacement is None:
        displacement = problem.half_space.displacement_at(elements, np.minimum(q, 0.0), single=single)
    w -= displacement
    q[negative] = 0.0
    return True


def _dense_face(problem: Problem, indentation: float, elements: Index) -> Array:
    """Return q ≥ 0 on few elements, by Cholesky factorisations.

    Tensile elements leave the contact set, penetrating ones come back, until neither is left.

    Raises
    ------
    ConvergenceError
        If the contact set does not settle.
    """
    matrix = influence_matrix(problem.half_space.influence, elements)
    b = problem.heights[elements] + indentation
    q = np.zeros(b.size)
    active = np.ones(b.size, dtype=bool)
    for _ in range(100 + b.size):
        index = np.flatnonzero(active)
        q[:] = 0.0
        if index.size:
            block = matrix if index.size == b.size else matrix[np.ix_(index, index)]
            factor = linalg.cho_factor(block, lower=True, check_finite=False)
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


def _predict(problem: Problem, indentation: float, latest: State, previous: State | None, single: bool) -> Face:
    """Return the candidates with q and w there, extrapolated along the secant through two states.

    Without a second state the candidates are the rigid overlap, and q = 0.
    """
    if previous is None:
        candidates = np.flatnonzero(problem.heights > -indentation)
        return Face(candidates, np.zeros(candidates.size), -indentation - problem.heights[candidates], None)
    step = indentation - latest.indentation
    theta = step / (latest.indentation - previous.indentation)
    # Beyond both states no gap closes that is larger than the step: no gap falls faster than the surfaces approach.
    # Between them, as in a search, the contact of the latest state holds the contact at this indentation.
    candidates, gap = latest.within(max(0.0, step))
    w = gap + theta * (gap - previous.gap(candidates))
    predicted = (w if theta > 0.0 else gap) < 0.0
    predicted[problem.positions(candidates, latest.elements)[0]] = True  # (3) candidates
    candidates, w = candidates[predicted], w[predicted]
    q, rates = _rates(problem, candidates, latest, previous)
    q += step * rates[0]  # (4) secant
    _cut(problem, candidates, q, w, single)  # (5)
    return Face(candidates, q, w, rates)


def _corrected(problem: Problem, state: State, latest: State) -> Face:
    """Return the face of a further round, from a verified state: its contact, and all that penetrates."""
    candidates, w = state.within(0.0)
    mask = w < 0.0
    mask[problem.positions(candidates, state.elements)[0]] = True
    candidates, w = candidates[mask], w[mask]
    if state.indentation > latest.indentation:
        q, rates = _rates(problem, candidates, state, latest)
        return Face(candidates, q, w, rates)
    (q,) = problem.pressures(candidates, state)
    return Face(candidates, q, w, None)


def _rates(problem: Problem, candidates: Index, latest: State, previous: State) -> tuple[Array, Rates]:
    """Return q on the candidates, and the rates of pressure and displacement with indentation there."""
    q, earlier = problem.pressures(candidates, latest, previous)
    # Contacts may fail to be nested: for another kernel than Love's, or by rounding. Elements in both count there.
    pressure = np.where(q > 0.0, q - earlier, 0.0)
    displacement = latest.touch_at[candidates] - previous.touch_at[candidates]
    step = latest.indentation - previous.indentation
    return q, (pressure / step, displacement / step)


def _approach(problem: Problem, indentation: float, latest: State, rtol: float) -> tuple[State, State | None]:
    """Return two rough states on the way to an indentation with a large rigid overlap.

    The overlap is up to fifty times the contact. The states on the way keep all vectors small.
    """
    tuning = problem.tuning
    stages = [indentation]
    while np.count_nonzero(problem.heights > -stages[-1]) > tuning.cold_up_to:
        stages.append(stages[-1] / tuning.cold_step)
        if len(stages) > 40:  # a plateau larger than this comes into contact at once
            return latest, None
    previous: State | None = None
    for stage in stages[:0:-1]:
        rough = solve_indentation(problem, stage, latest, previous, max(rtol, tuning.cold_rtol))[0]
        previous, latest = latest, rough
    return latest, previous
