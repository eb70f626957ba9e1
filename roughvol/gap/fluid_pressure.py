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

from typing import Any

import numpy as np

from roughvol.errors import ConvergenceError
from roughvol.gap.clusters import check_gap
from roughvol.gap.network import harmonic, inverse
from roughvol.gap.transport import constriction
from roughvol.typing import Array

LEAST = 1e-8  # conductance of a closed element over that of the gap h
MOST = 1e6  # largest conductance over that of the gap h: the pressure drop in a wider gap is left out
NARROW = 1e-3  # least h over the widest gap
ACCURACY = 1e-12  # of P, the last correction
CORRECTIONS = 50


class FluidField:
    """The flow through a gap: its pressure, and the change of that with the gap.

    Parameters
    ----------
    gap : array (rows, columns)
        Gap g ≥ 0 [any length]; open is g > 0.
    axis : int
        Direction of the flow from the inlet at its first line to the outlet at its last, 0 for x, 1 for y.
    periodic : bool
        Whether the two other sides are joined.
    least : float
        Conductance of a closed element over that of the gap h.

    Attributes
    ----------
    pressure : array (rows, columns)
        P, from 1 at the inlet to 0 at the outlet.

    Raises
    ------
    ContactError
        If the gap is no 2-D field of finite numbers ≥ 0.
    ConvergenceError
        If the pressure is not found to `ACCURACY`.
    """

    def __init__(self, gap: Array, axis: int, *, periodic: bool = False, least: float = LEAST) -> None:
        check_gap(gap)
        self._axis = axis
        narrowest, widest = constriction(gap, axis, periodic=periodic), float(gap.max())
        flows = narrowest.gap > NARROW * widest
        # h and its change with the gap of a single element
        self._reference = narrowest.gap if flows else NARROW * widest or 1.0
        self._share = 1.0 if flows else NARROW
        self._at = narrowest.element if flows else np.unravel_index(int(gap.argmax()), gap.shape)
        relative = self._along(gap) / self._reference
        cube = relative**3
        self._wide = (cube >= MOST).ravel()
        self._rate, self._cube = 3.0 * (relative**2).ravel() / self._reference, cube.ravel()
        k = np.minimum(cube, MOST) + least
        columns = k.shape[1]
        self._shape, size = k.shape, k.size
        number = np.arange(size).reshape(k.shape)
        across = [beside[:, : columns - (not periodic)] for beside in (np.roll(number, -1, axis=1), number)]
        # the joints between elements, then those to the reservoirs: nodes `size` (inlet) and `size + 1` (outlet)
        self._inner = size - columns + across[0].size
        self._tail = np.concatenate([number[:-1].ravel(), across[1].ravel(), number[0], number[-1]])
        self._head = np.concatenate([number[1:].ravel(), across[0].ravel(), np.repeat((size, size + 1), columns)])
        self._k = k.ravel()
        inner_tail, inner_head = self._tail[: self._inner], self._head[: self._inner]
        ends = 2.0 * self._k[self._tail[self._inner :]]
        self._weight = np.concatenate([harmonic(self._k[inner_tail], self._k[inner_head]), ends])
        self._solve = inverse(self._tail, self._head, self._weight, size + 2, size)
        self._drops = self._solved(size)

    def _solved(self, size: int) -> Array:
        """Set the pressure, and return its drop along each joint."""
        coarse, fine = np.zeros(size + 2), np.zeros(size + 2)
        coarse[size] = 1.0
        for correction in range(CORRECTIONS):
            drops = (coarse[self._tail] - coarse[self._head]) + (fine[self._tail] - fine[self._head])
            more = self._solve(self._inflow(self._weight * drops))
            (fine if correction else coarse)[:size] += more
            last = float(np.abs(more).max())
            if last <= ACCURACY:
                self.pressure = self._turned(np.clip(coarse + fine, 0.0, 1.0)[:size])
                return drops
        message = f"the pressure of the fluid is not found: its last correction is {last:.2g}, allowed {ACCURACY:g}"
        raise ConvergenceError(message, indentation=np.nan, iterations=CORRECTIONS, residual=last)

    def change(self, gap_change: Array) -> Array:
        """Return the change of the pressure with a small change of the gap, to first order."""
        relative = self._share * float(gap_change[self._at]) / self._reference
        rate = self._rate * self._along(gap_change).ravel() - 3.0 * relative * self._cube
        rate[self._wide] = 0.0
        tail, head = self._k[self._tail[: self._inner]], self._k[self._head[: self._inner]]
        both = 2.0 / (tail + head) ** 2
        inner = both * (head**2 * rate[self._tail[: self._inner]] + tail**2 * rate[self._head[: self._inner]])
        weight = np.concatenate([inner, 2.0 * rate[self._tail[self._inner :]]])
        return self._turned(self._solve(self._inflow(weight * self._drops)))

    def _inflow(self, flow: Array) -> Array:
        """Return the sum of the flows into each node."""
        nodes = self._k.size + 2
        inflow: Any = np.bincount(self._head, flow, nodes) - np.bincount(self._tail, flow, nodes)
        return np.asarray(inflow, dtype=np.float64)

    def _along(self, field: Array) -> Array:
        return field if self._axis == 0 else field.T

    def _turned(self, field: Array) -> Array:
        field = field.reshape(self._shape)
        return field if self._axis == 0 else np.ascontiguousarray(field.T)


def fluid_pressure(gap: Array, axis: int, *, periodic: bool = False) -> Array:
    """Return the pressure of the fluid on every element, over that of the inlet."""
    return FluidField(gap, axis, periodic=periodic).pressure
