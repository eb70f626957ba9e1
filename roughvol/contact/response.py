"""Linear response of a solved contact: pressures and gaps change a little, and the elements in contact stay.

On the elements I in contact, K_II q = u gives the pressures q that displace them by u. Under further indentation u = 1
and the pressures are t = K_II⁻¹ 1; Σt is the stiffness. All numbers are in lattice units (`halfspace`).

Few elements are solved by a Cholesky factorisation, more by conjugate gradients with the approximate inverse of the
solver (solver.md) on the set I. Where K⁻¹ is an M-matrix, t ≥ 0, so a residual of t of at most η on every element
bounds the relative error of Σt by η: 1ᵀ K_II⁻¹ (1 - K_II t) = t_exactᵀ (1 - K_II t).
"""

from functools import cached_property

import numpy as np
from scipy import linalg

from roughvol.contact.options import TUNING, Tuning
from roughvol.contact.preconditioner import approximate_inverse
from roughvol.contact.state import Compliance
from roughvol.errors import ConvergenceError
from roughvol.typing import Array, Index, Map

ACCURACY = 1e-8  # largest residual on an element over the largest displacement asked for


class Response:
    """Pressures on a fixed set of elements that displace them as asked."""

    def __init__(self, half_space: Compliance, elements: Index, *, tuning: Tuning = TUNING) -> None:
        self._half_space, self._elements, self._tuning = half_space, elements, tuning

    def pressure(self, displacement: Array) -> Array:
        """Return q with K_II q = u."""
        if self._elements.size <= self._tuning.dense_up_to:
            dense: Array = linalg.cho_solve(self._factor, displacement, check_finite=False)
            return dense
        return self._conjugate_gradients(displacement)

    @cached_property
    def rates(self) -> Array:
        """Pressures t per unit of further indentation."""
        return self.pressure(np.ones(self._elements.size))

    @cached_property
    def _factor(self) -> tuple[Array, bool]:
        matrix = self._half_space.between(self._elements)
        factor: tuple[Array, bool] = linalg.cho_factor(matrix, lower=True, check_finite=False)
        return factor

    @cached_property
    def _inverse(self) -> Map:
        """M⁻¹ of the solver for a set that stays; its far field is weighted by the near field of t."""
        zero, every = np.zeros(self._elements.size), np.ones(self._elements.size, dtype=bool)
        q = every.astype(np.float64)
        return approximate_inverse(self._half_space, self._elements, q, zero, every, (zero, zero), self._tuning)[0]

    def _conjugate_gradients(self, right: Array) -> Array:
        """Solve by conjugate gradients; directions are made conjugate by the formula that bears an inexact inverse.

        M⁻¹ has numbers of 32 bits: displacements are brought to the order of 1, by a power of two.
        """
        order = int(np.frexp(np.abs(right).max())[1])
        right = np.ldexp(right, -order)
        tolerance = ACCURACY * float(np.abs(right).max())
        q, r = np.zeros(right.size), right
        direction, r_before, rz = np.zeros(right.size), r, 1.0
        for iteration in range(self._tuning.iterations):
            if float(np.abs(r).max()) <= tolerance:
                r = right - self._half_space.displacement_at(self._elements, q)  # rounding adds up in r
                if float(np.abs(r).max()) <= tolerance:
                    scaled: Array = np.ldexp(q, order)
                    return scaled
            z = self._inverse(r).astype(np.float64)
            rz_before, rz = rz, float(r @ z)
            direction *= max(0.0, (rz - float(r_before @ z)) / rz_before) if iteration else 0.0
            direction += z
            response = self._half_space.displacement_at(self._elements, direction)
            step = float(r @ direction) / float(direction @ response)
            q += step * direction
            r_before, r = r, r - step * response
        residual = float(np.abs(r).max() / np.abs(right).max())
        message = f"the linear response of {right.size} elements did not converge to {ACCURACY:g}"
        raise ConvergenceError(message, indentation=np.nan, iterations=iteration + 1, residual=residual)
