"""Transport through the gap of a contact: the critical constriction, and flow.

Conventions
-----------
A gap field holds g ≥ 0 on square elements, axis 0 is x and axis 1 is y. An element is open where g > 0; contact is
closed. The void is 4-connected (through the sides of elements), the solid 8-connected (through corners as well). A
flow is then stopped by a chain of closed elements and by nothing less. Either void leads from side to side in x, or
solid does in y, and never both.

Flow along an axis obeys div(k grad P) = 0 with the local conductance k = g^n. n = 3 is the lubrication equation, and
its coefficient is the transmissivity. n = 1 is diffusion through the gap. P = 1 and P = 0 are imposed on the outer
edges of the first and the last line of elements, half an element from their centres. Nothing flows through the two
other sides or into closed elements. Finite volumes: two open neighbours are joined by the harmonic mean of their k, a
reservoir and its neighbour by 2k. Coefficients are over those of two smooth plates at the mean gap, contact included,
between the same reservoirs. Neither the unit of g nor the spacing enters.

Functions take the gap [any length], shape (rows, columns), and the axis of the flow, 0 for x, 1 for y. A gap that is
no 2-D field of finite numbers ≥ 0 is a `ContactError`. The exponent n is positive.

Of a periodic surface, one period lies between the reservoirs, and the two other sides are joined. `cell_conduction` has
no reservoirs: the pressure falls by the same mean gradient in every period, and flows are those of the endless plane.

Decades of conductance
----------------------
g³ easily spans more decades than a double has digits. With h_c the critical constriction, every path contains an
element of conductance ≤ h_c^n, and one path has none below. Conductances above `_WINDOW` times h_c^n
are set to that value. Elements that conduct less than 1/`_WINDOW` of h_c^n count as closed. Both lower the coefficient,
by up to 1/`_WINDOW` for each element along the stream or across it, and the stated error is without this. The matrix
gets a condition that a factorisation can bear. The coefficient is taken from the dissipation Σ k (δP)², because the
error of P enters it squared. P is solved for as the difference to the nearer of the two reservoirs. The flow in wide
waters before and behind a constriction then keeps its digits.
"""

from dataclasses import dataclass

import numpy as np

from roughvol.gap.clusters import SIDES, labelled, spanned
from roughvol.gap.compiled import compiled
from roughvol.gap.constriction import constriction, endless_constriction
from roughvol.gap.multigrid import Conductances
from roughvol.gap.network import ACCURACY, Flow, faces, flow_around, flow_through, harmonic
from roughvol.typing import Array

_WINDOW = 1e7


@dataclass(frozen=True)
class Conduction:
    """A stationary flow along an axis: its coefficient, which is too large by the estimated relative error."""

    coefficient: float
    error: float
    _axis: int
    _shape: tuple[int, int]
    _over_plates: float = 0.0
    _flow: Flow | None = None

    @property
    def conservation_error(self) -> float:
        """The larger of |inflow - flow| and |outflow - flow| over the flow, which the dissipation gives."""
        return 0.0 if self._flow is None else self._flow.conservation_error

    @property
    def pressure(self) -> Array | None:
        """Pressures from 1 to 0, shape (rows, columns), 0 where nothing flows; None without a flow."""
        return None if self._flow is None else self._turned(self._flow.pressure)

    @property
    def flux(self) -> Array:
        """Flux along x and y in the middle of each element, over that between the plates, shape (2, rows, columns)."""
        if self._flow is None:
            return np.zeros((2, *self._shape))
        down, east = self._flow.fluxes
        along, aside = 0.5 * (down[1:] + down[:-1]), 0.5 * (east + np.roll(east, 1, axis=1))
        turned = [self._over_plates * self._turned(flux) for flux in (along, aside)]
        return np.stack(turned if self._axis == 0 else turned[::-1])

    def _turned(self, field: Array) -> Array:
        return field if self._axis == 0 else field.T


def conduction(
    gap: Array,
    axis: int,
    exponent: float = 3.0,
    *,
    periodic: bool = False,
    accuracy: float = ACCURACY,
    start: Array | None = None,
    critical: float | None = None,
) -> Conduction:
    """Return the flow of div(g^n grad P) = 0 along an axis over that of two smooth plates at the mean gap.

    The two coefficients of Vallet et al. (2009): transmissivity with n = 3, diffusivity with n = 1. The accuracy is
    relative, `start` has pressures of a similar gap, and `critical` is the gap of `constriction`, if it is known.
    """
    along = gap if axis == 0 else np.ascontiguousarray(gap.T)
    critical = constriction(along, 0, periodic=periodic).gap if critical is None else critical
    if critical == 0.0:
        return Conduction(0.0, 0.0, axis, gap.shape)
    k = _conductance(along, critical, exponent)
    k[~spanned(k > 0.0, periodic)] = 0.0
    down, east = faces(k, periodic)
    del k
    flow = flow_through(down, east, accuracy, start if start is None or axis == 0 else start.T)
    # over the flux between the plates, as many elements apart, under the same drop of pressure
    over_plates = _over_plates(gap, critical, exponent) * along.shape[0]
    coefficient = flow.dissipation * over_plates / along.shape[1]
    return Conduction(coefficient, flow.error, axis, gap.shape, over_plates, flow)


def cell_conduction(gap: Array, axis: int, exponent: float = 3.0, *, accuracy: float = ACCURACY) -> float:
    """Return the flow through the endless plane of a periodic gap over that between two plates at the mean gap.

    The coefficient is the dissipation per element, Σ k (δP)²/N at one unit of mean gradient along the axis and none
    across, over (mean g)^n. It is 0 where no void leads on from period to period without end.
    """
    along = gap if axis == 0 else np.ascontiguousarray(gap.T)
    critical = endless_constriction(along)
    if critical == 0.0:
        return 0.0
    k = _conductance(along, critical, exponent)
    # P is free to a constant in every cluster: its first element is held by as much as it conducts
    labels, _ = labelled(k > 0.0, SIDES, (True, True))
    first = np.unique(labels, return_index=True)[1][int(not np.all(k > 0.0)) :]
    own = np.zeros(k.shape)
    own.ravel()[first] = k.ravel()[first]
    south, east = (harmonic(k, np.roll(k, -1, axis)) for axis in (0, 1))
    drop = flow_around(Conductances(south, east, own), accuracy)
    return drop / gap.size * _over_plates(gap, critical, exponent)


def _conductance(gap: Array, critical: float, exponent: float) -> Array:
    """Return k over its critical value in the window, 0 elsewhere; gaps are cut before a power could overflow."""
    widest = np.exp(min(np.log(_WINDOW) / exponent, 700.0))
    return _powers(gap, critical, exponent, float(widest))


@compiled
def _powers(gap: Array, critical: float, exponent: float, widest: float) -> Array:
    k = np.empty(gap.shape)
    for i in range(gap.shape[0]):
        for j in range(gap.shape[1]):
            ratio = min(gap[i, j] / critical, widest)
            power = ratio * ratio * ratio if exponent == 3.0 else ratio**exponent
            k[i, j] = min(power, _WINDOW) if ratio * widest >= 1.0 else 0.0
    return k


def _over_plates(gap: Array, critical: float, exponent: float) -> float:
    """Return the critical conductance over that of the mean gap."""
    largest = gap.max()
    log_mean = np.log(largest) - np.log(critical) + np.log(np.mean(gap / largest))
    return float(np.exp(-exponent * log_mean))
