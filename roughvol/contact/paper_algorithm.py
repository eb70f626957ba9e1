"""The paper's Algorithm 1 (Paggi and He, Wear 336 (2015) 86-95), a reference on small grids."""

import numpy as np
from scipy import linalg

from roughvol.contact.problem import Problem
from roughvol.contact.state import State
from roughvol.errors import ContactError, ConvergenceError

LARGEST = 65  # elements along a side: the matrix is dense


def solve_paper(problem: Problem, indentation: float, latest: State, _previous: State | None, rtol: float) -> State:
    """Solve one indentation by Algorithm 1: tensile elements leave the rigid overlap, Gauss-Seidel solves the others.

    An element that leaves does not come back; for the Love kernel no element has to. At most 65 × 65 elements.
    """
    if max(problem.shape) > LARGEST:
        message = f"method 'paper' takes grids up to {LARGEST} × {LARGEST} (m = 6); this one is {problem.shape}"
        raise ContactError(message)
    elements = np.flatnonzero(problem.heights > -indentation)
    sweeps = 0
    while True:
        matrix = problem.half_space.between(elements)
        lower, upper = np.tril(matrix), np.triu(matrix, 1)
        b = problem.heights[elements] + indentation
        p = np.zeros(b.size)
        for _ in range(problem.tuning.gauss_seidel):
            w = matrix @ p - b
            if np.abs(w).max(initial=0.0) <= 0.1 * rtol:
                break
            p = linalg.solve_triangular(lower, b - upper @ p, lower=True, check_finite=False)
            sweeps += 1
        else:
            message = f"Gauss-Seidel not converged to {0.1 * rtol:g}"
            residual = float(np.abs(w).max())
            raise ConvergenceError(message, indentation=indentation, iterations=sweeps, residual=residual)
        tensile = p < 0.0
        if not tensile.any():
            break
        elements = elements[~tensile]
    state = problem.verified(indentation, elements, p, indentation - latest.indentation)
    state.iterations = sweeps
    if state.residual > rtol:
        message = f"Algorithm 1 not converged to {rtol:g}"
        raise ConvergenceError(message, indentation=indentation, iterations=sweeps, residual=state.residual)
    return state
