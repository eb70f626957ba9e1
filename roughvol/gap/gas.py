"""The flow of a gas through the gap of a contact, from viscous to free molecular flow.

Conventions are those of `transport`. Pressures p are over that of the inlet, lengths over one unit, λ is the mean free
path at the inlet, so that the local one is λ/p. The gas is ideal and isothermal, and conserves div(f(g, p) grad p) = 0,
where f is the throughput per width and gradient of pressure, over 1/(12 μ):

    viscous   f = g³ p                       flow is linear in p²
    slip      f = g³ p + 6 λ g²              first-order slip at walls of diffuse reflection (Maxwell 1879)
    kinetic   f = (12 λ/√π) g² Q(D)          D = √π g p/(2 λ), the inverse Knudsen number of the element

Q(D) is the flow rate of the linearised Boltzmann equation (BGK) between plane plates, fitted by Fukui & Kaneko, Journal
of Tribology 112 (1990) 78-83: D/6 + 1.0162 + … for D ≥ 5, with a minimum of 1.54 at D = 1. Below D = 0.01 it goes on as
-ln(D)/√π + const, the free molecular limit. There a plane gap without end has no finite flow: molecules that fly along
the plates never meet them. A rough gap cuts the logarithm off at the length of its channels, which the local f cannot
know. Where λ exceeds that length, Q is an upper estimate.

The flux between two points of an element is linear in Φ(p) = ∫ f dp. For f = g³ p + 6 λ g² one part is linear in p² and
one in p, and where g varies no potential is common to all elements. Then the problem is nonlinear. `conduction_of_gas`
solves it by iteration: each turn is a linear problem in s = p²/2 + β p, where the conductance of a face is its exact
throughput at the last pressures over its drop of s. A fixed point has the exact throughputs.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from roughvol.errors import ContactError, ConvergenceError
from roughvol.gap.clusters import check_gap, spanned
from roughvol.gap.compiled import compiled
from roughvol.gap.constriction import constriction
from roughvol.gap.network import ACCURACY, flow_through, harmonic
from roughvol.typing import Array

LAWS = ("kinetic", "slip", "viscous")
WINDOW = 1e7  # of conductances over that of the critical constriction, as in `transport`
TURNS = 60  # largest number of iterations
CAUTION = 2.0  # the last change is no bound of the changes to come
LAST, INNER = 0.1, 0.01  # over the accuracy: relative change of the flow at the last turn; error of the flow of a turn
SLIP = 6.0  # of Maxwell's slip velocity λ du/dz, walls of diffuse reflection
# Q = a D + b + c/D + d/D² from each D on (Fukui & Kaneko 1990)
FREE = 0.01
STARTS = (FREE, 0.15, 5.0)
PIECES = (
    (-2.22919, 2.10673, 0.01653, -0.0000694),
    (0.13852, 1.25087, 0.15653, -0.00969),
    (1.0 / 6.0, 1.0162, 1.0653, -2.1354),
)
VACUUM = 1e-12  # least pressure of an element: conductances for s stay finite at an outlet without gas
NEAR = 0.02  # relative difference of two pressures, below which their mean conductance is a quadrature


class GasFlow(NamedTuple):
    """A flow of a gas along an axis: throughput over that of viscous flow between plates, relative error, iterations.

    The error is that of the last two changes and of the last flow. ``knudsen`` is λ at the mean of both pressures over
    the critical constriction, infinite without a way.
    """

    coefficient: float
    error: float
    knudsen: float
    conservation_error: float
    turns: int


def kinetic_flow_rate(inverse_knudsen: Array) -> Array:
    """Return Q(D), the flow rate between plane plates by kinetic theory, for D = √π g/(2 λ) > 0."""
    D = np.asarray(inverse_knudsen, dtype=float)
    return _rates(D.ravel()).reshape(D.shape)


def kinetic_integral(inverse_knudsen: Array) -> Array:
    """Return ∫ Q dD from 0 to D ≥ 0."""
    D = np.asarray(inverse_knudsen, dtype=float)
    return _integrals(D.ravel()).reshape(D.shape)


@compiled
def _rates(D: Array) -> Array:
    """Return Q of each D."""
    rate = np.empty(D.size)
    for k in range(D.size):
        x, piece = max(D[k], FREE), 0
        while piece + 1 < len(STARTS) and x >= STARTS[piece + 1]:
            piece += 1
        a, b, c, d = PIECES[piece]
        rate[k] = a * x + b + c / x + d / x**2
        if D[k] < FREE:
            rate[k] -= math.log(D[k] / FREE) / math.sqrt(math.pi)
    return rate


@compiled
def _integrals(D: Array) -> Array:
    """Return ∫ Q dD up to each D."""
    total = np.zeros(D.size)
    a, b, c, d = PIECES[0]
    free = a * FREE + b + c / FREE + d / FREE**2
    for k in range(D.size):
        low = min(D[k], FREE)
        if low > 0.0:
            total[k] = low * (free + (1.0 - math.log(low / FREE)) / math.sqrt(math.pi))
        for piece in range(len(STARTS)):
            start, end = STARTS[piece], STARTS[piece + 1] if piece + 1 < len(STARTS) else np.inf
            if D[k] > start:
                a, b, c, d = PIECES[piece]
                x = min(D[k], end)
                total[k] += 0.5 * a * (x**2 - start**2) + b * (x - start)
                total[k] += c * math.log(x / start) - d * (1.0 / x - 1.0 / start)
    return total


def local_flow(law: str, gap: Array | float, pressure: Array | float, path: float) -> Array:
    """Return f(g, p) [length³] of the table above; the path is λ at the inlet."""
    if law == "kinetic":
        D = np.asarray(0.5 * math.sqrt(math.pi) / path * gap * pressure)
        return np.asarray(12.0 * path / math.sqrt(math.pi) * gap**2 * kinetic_flow_rate(np.maximum(D, 1e-300)))
    return np.asarray(gap**3 * pressure + (SLIP * path if law == "slip" else 0.0) * gap**2)


def plate_flow(law: str, gap: Array | float, inlet: Array | float, outlet: Array | float, path: float) -> Array:
    """Return ∫ f(g, p) dp from the outlet to the inlet: the throughput of plates per width over length, times 12 μ."""
    if law == "kinetic":
        per = np.asarray(0.5 * math.sqrt(math.pi) / path * gap)
        difference = kinetic_integral(per * inlet) - kinetic_integral(per * outlet)
        return np.asarray(24.0 * path**2 / math.pi * gap * difference)
    slip = SLIP * path if law == "slip" else 0.0
    return np.asarray((inlet - outlet) * (0.5 * gap**3 * (inlet + outlet) + slip * gap**2))


def conduction_of_gas(
    gap: Array, axis: int, law: str, path: float, outlet: float, *, periodic: bool = False, accuracy: float = ACCURACY
) -> GasFlow:
    """Return the throughput of a gas along an axis over that of viscous flow between plates at the mean gap.

    The path is λ at the inlet; the outlet pressure is 0 ≤ outlet < 1. A flow that still changes by a tenth of the
    accuracy after `TURNS` iterations is a `ConvergenceError`.
    """
    check_gap(gap)
    if law not in LAWS or not 0.0 <= outlet < 1.0 or not 0.0 <= path < math.inf or (law == "kinetic" and path == 0.0):
        given = f"law {law!r}, mean free path {path}, outlet {outlet}"
        raise ContactError(f"{given}; allowed: {', '.join(LAWS)}, > 0, 0 <= outlet < 1")
    critical = constriction(gap, axis, periodic=periodic).gap
    if critical == 0.0:
        return GasFlow(0.0, 0.0, math.inf, 0.0, 0)
    along, free = (gap if axis == 0 else np.ascontiguousarray(gap.T)), path / critical
    wide = np.minimum(along / critical, math.sqrt(WINDOW))  # in free molecular flow g² counts
    middle = 0.5 * (1.0 + outlet)
    at_critical = float(local_flow(law, 1.0, middle, free))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(wide > 0.0, local_flow(law, wide, middle, free), 0.0) / at_critical
    flowing = spanned(share >= 1.0 / WINDOW, periodic)
    problem = _Turn(law, free, outlet)
    throughput, error, unequal, turns = _iterated(np.where(flowing, wide, 0.0), problem, periodic, accuracy)
    (rows, columns), largest = along.shape, float(gap.max())
    mean = largest / critical * float(np.mean(gap / largest))
    plates = mean**3 * 0.5 * (1.0 - outlet**2) * columns / rows
    return GasFlow(throughput / plates, error, free / middle, unequal, turns)


@dataclass(frozen=True)
class _Turn:
    """The linear problem of a turn: s of pressures, and conductances for s, (conductance, pressure) of faces."""

    law: str
    path: float
    outlet: float

    @cached_property
    def slip(self) -> float:
        """β of s = p²/2 + β p."""
        return {"viscous": 0.0, "slip": SLIP, "kinetic": 1.5 * SLIP}[self.law] * self.path

    @cached_property
    def drop(self) -> float:
        """The drop of s from inlet to outlet."""
        return 0.5 + self.slip - self._at_outlet

    @cached_property
    def _at_outlet(self) -> float:
        return self.outlet * (0.5 * self.outlet + self.slip)

    def pressure_of(self, share: Array) -> Array:
        """Return p of s, as a share of its drop: 0 at the outlet, 1 at the inlet."""
        s = self._at_outlet + self.drop * np.clip(share, 0.0, 1.0)
        root = self.slip + np.sqrt(self.slip**2 + 2.0 * s)
        return np.maximum(np.divide(2.0 * s, root, out=np.zeros_like(s), where=root > 0.0), VACUUM)

    def mean(self, g: Array, first: Array, second: Array) -> Array:
        """Return the mean of f over the pressures between two."""
        if self.law != "kinetic":
            return 0.5 * g**3 * (first + second) + self.slip * g**2
        high, low = np.maximum(first, second), np.minimum(first, second)
        far = (g > 0.0) & (high - low > NEAR * high)
        close = (g > 0.0) & ~far
        mean = np.zeros_like(g)
        mean[far] = plate_flow(self.law, g[far], high[far], low[far], self.path) / (high[far] - low[far])
        centre, half = 0.5 * (high[close] + low[close]), 0.5 * (high[close] - low[close])
        points = ((5 / 18, -math.sqrt(0.6)), (8 / 18, 0.0), (5 / 18, math.sqrt(0.6)))  # Gauss
        mean[close] = sum(
            weight * local_flow(self.law, g[close], np.maximum(centre + half * at, 1e-300), self.path)
            for weight, at in points
        )
        return mean

    def inner(self, p: Array, faces: Array, gaps: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return conductances and pressures of the faces between two elements of pressures `p`, from those of faces."""
        front, back = self.mean(gaps[0], p[0], faces), self.mean(gaps[1], p[1], faces)
        total = front + back
        faces = np.divide(front * p[0] + back * p[1], total, out=0.5 * (p[0] + p[1]), where=total > 0.0)
        front, back = self.mean(gaps[0], p[0], faces), self.mean(gaps[1], p[1], faces)
        return self._in_window(harmonic(front, back), 0.5 * (p[0] + p[1]), WINDOW), faces

    def outer(self, p: Array, reservoir: float, gap: Array) -> Array:
        """Return conductances between elements and the reservoir beside them."""
        ends = np.full(p.size, reservoir)
        return self._in_window(2.0 * self.mean(gap, ends, p), 0.5 * (ends + p), 2.0 * WINDOW)

    def _in_window(self, flow: Array, mean: Array, most: float) -> Array:
        """Return the conductance for s of a flow at a mean pressure."""
        through = flow / np.maximum(mean + self.slip, 1e-300)
        return np.clip(through, np.where(through > 0.0, 1.0 / WINDOW, 0.0), most)


def _iterated(gap: Array, problem: _Turn, periodic: bool, accuracy: float) -> tuple[float, float, float, int]:
    """Return the throughput along axis 0 times 12 μ, both errors, and iterations; lengths are over the constriction."""
    rows = gap.shape[0]
    share = np.repeat((1.0 - (np.arange(rows) + 0.5) / rows)[:, None], gap.shape[1], axis=1)
    beside = np.roll(gap, -1, axis=1)
    p = problem.pressure_of(share)
    down_faces, across_faces = 0.5 * (p[:-1] + p[1:]), 0.5 * (p + np.roll(p, -1, axis=1))
    before = change = math.nan
    for turn in range(1, TURNS + 1):
        inner, down_faces = problem.inner(np.stack([p[:-1], p[1:]]), down_faces, (gap[:-1], gap[1:]))
        across, across_faces = problem.inner(np.stack([p, np.roll(p, -1, axis=1)]), across_faces, (gap, beside))
        if not periodic:
            across[:, -1] = 0.0
        outer = [problem.outer(p[line], end, gap[line]) for line, end in ((0, 1.0), (-1, problem.outlet))]
        flow = flow_through(np.vstack([outer[0], inner, outer[1]]), across, INNER * accuracy, share)
        change, last = abs(flow.dissipation / before - 1.0), change
        error = CAUTION * np.fmax(change, LAST * last) + flow.error  # a change may be small by chance
        if change <= LAST * accuracy and error <= accuracy:
            unequal = max(abs(float(flow.down[line].sum()) - flow.dissipation) for line in (0, -1))
            return flow.dissipation * problem.drop, float(error), unequal / flow.dissipation, turn
        before, share = flow.dissipation, flow.pressure
        p = problem.pressure_of(np.where(gap > 0.0, share, 0.5))
    message = f"the flow of the gas still changes after {TURNS} iterations"
    raise ConvergenceError(message, indentation=math.nan, iterations=TURNS, residual=math.nan)
