"""Pressure of a fluid in the gap of a contact, between an inlet and an outlet.

div(k grad P) = 0 with P = 1 on the side of the inlet and P = 0 on the side of the outlet, on the elements and with the
joints of `transport`. All elements take part:

    k = min(g³, MOST h³) + LEAST h³,    h = max(h_c, NARROW g_max),

where h_c is the critical constriction, 0 without an open way, and g_max the widest gap. A closed element conducts
nearly nothing. k is a continuous function of the gap, also where the last way closes. Three assumptions follow.

- Open elements joined to one reservoir alone have its pressure.
- A closed pocket has a mean of the pressures around it: the fluid had time to seep in.
- Under a contact the field passes smoothly from side to side. It is the pressure of a fluid that would enter there.

P is the sum of two numbers. In a wide pocket P is uniform to 16 digits, and the flow through its closed rim follows
from the differences that are left: the second number has them.
"""

import numpy as np

from roughvol.errors import ConvergenceError
from roughvol.gap.constriction import constriction
from roughvol.gap.network import Network, between_reservoirs, differences, faces, surplus
from roughvol.typing import Array

LEAST = 1e-8  # conductance of a closed element over that of the gap h
MOST = 1e6  # largest conductance over that of the gap h: the pressure drop in a wider gap is left out
NARROW = 1e-3  # least h over the widest gap
ACCURACY = 1e-12  # of P, the last correction
CORRECTIONS = 20  # random gaps need two to five


class FluidField:
    """The flow through a gap, from the first to the last line along an axis: its pressure, and the change with the gap.

    ``pressure`` is P (rows, columns). If `periodic`, the two other sides are joined. ``least`` is the conductance of a
    closed element over that of the gap h. A pressure not found to `ACCURACY` is a `ConvergenceError`.
    """

    def __init__(self, gap: Array, axis: int, *, periodic: bool = False, least: float = LEAST) -> None:
        self._axis = axis
        narrowest, widest = constriction(gap, axis, periodic=periodic), float(gap.max())
        flows = narrowest.gap > NARROW * widest
        # h and its change with the gap of a single element
        self._reference = narrowest.gap if flows else NARROW * widest or 1.0
        self._share = 1.0 if flows else NARROW
        self._at = narrowest.element if flows else np.unravel_index(int(gap.argmax()), gap.shape)
        relative = self._turned(gap) / self._reference
        cube = relative**3
        self._wide = cube >= MOST
        self._rate, self._cube = 3.0 * relative**2 / self._reference, cube
        self._k = np.minimum(cube, MOST) + least
        self._periodic = periodic
        self._down, self._east = faces(self._k, periodic)
        self._network = Network(between_reservoirs(self._down, self._east))
        self._falls = self._solved()

    def _solved(self) -> tuple[Array, Array]:
        """Set the pressure, and return its falls from row to row, ends included, and from column to column."""
        coarse, fine = np.zeros(self._k.shape), np.zeros(self._k.shape)
        for correction in range(CORRECTIONS):
            falls = differences(coarse, 1.0) + differences(fine, 0.0)
            across = (coarse - np.roll(coarse, -1, axis=1)) + (fine - np.roll(fine, -1, axis=1))
            more = self._network.solve(surplus(self._down * falls, self._east * across))
            whole = fine if correction else coarse
            whole += more
            last = float(np.abs(more).max())
            if last <= ACCURACY:
                self.pressure = self._turned(np.clip(coarse + fine, 0.0, 1.0))
                return falls, across
        message = f"the pressure of the fluid is not found: its last correction is {last:.2g}, allowed {ACCURACY:g}"
        raise ConvergenceError(message, indentation=np.nan, iterations=CORRECTIONS, residual=last)

    def change(self, gap_change: Array) -> Array:
        """Return the change of the pressure with a small change of the gap, to first order."""
        relative = self._share * float(gap_change[self._at]) / self._reference
        rate = self._rate * self._turned(gap_change) - 3.0 * relative * self._cube
        rate[self._wide] = 0.0
        falls, across = self._falls
        south, east = self._rate_between(rate, 0), self._rate_between(rate, 1)
        down = np.concatenate([2.0 * rate[:1], south[:-1], 2.0 * rate[-1:]])
        if not self._periodic:
            east[:, -1] = 0.0
        return self._turned(self._network.solve(surplus(down * falls, east * across)))

    def _rate_between(self, rate: Array, axis: int) -> Array:
        """Return the change of the conductances between successive lines, the last to the first included."""
        k, beyond = self._k, np.roll(self._k, -1, axis=axis)
        return 2.0 / (k + beyond) ** 2 * (beyond**2 * rate + k**2 * np.roll(rate, -1, axis=axis))

    def _turned(self, field: Array) -> Array:
        return field if self._axis == 0 else np.ascontiguousarray(field.T)
