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
from typing import NamedTuple

import numpy as np

from roughvol.errors import ContactError, ConvergenceError
from roughvol.gap.clusters import spanned
from roughvol.gap.compiled import compiled
from roughvol.gap.constriction import constriction
from roughvol.gap.network import ACCURACY, flow_through
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
AT_FREE = PIECES[0][0] * FREE + PIECES[0][1] + PIECES[0][2] / FREE + PIECES[0][3] / FREE**2  # Q there
VACUUM = 1e-12  # least pressure of an element: conductances for s stay finite at an outlet without gas
NEAR = 0.02  # relative difference of two pressures, below which their mean conductance is a quadrature
LONGEST = 1e100  # mean free path over the constriction; a shorter one than its inverse gives the same flow to rounding
APART = 1e-9  # relative distance of a pressure from an end of the fit; nearer ones have no digits in their integrals


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


class Law(NamedTuple):
    """A law of the table above: kinetic or not, the mean free path λ, 6 λ in slip flow, and β of s."""

    kinetic: bool
    path: float
    slip: float
    beta: float


def _law(name: str, path: float) -> Law:
    slip = SLIP * path
    return Law(
        name == "kinetic", path, *{"viscous": (0.0, 0.0), "slip": (slip, slip), "kinetic": (0.0, 1.5 * slip)}[name]
    )


def local_flow(law: str, gap: float, pressure: float, path: float) -> float:
    """Return f(g, p) [length³] of the table above; the path is λ at the inlet."""
    return _local(_law(law, path), gap, pressure)


def plate_flow(law: str, gap: float, inlet: float, outlet: float, path: float) -> float:
    """Return ∫ f(g, p) dp from the outlet to the inlet: the throughput of plates per width over length, times 12 μ."""
    return _integral(_law(law, path), gap, inlet, outlet)


@compiled
def kinetic_flow_rate(D: float) -> float:
    """Return Q(D), the flow rate between plane plates by kinetic theory, for D = √π g/(2 λ) > 0."""
    x, piece = max(D, FREE), 0
    while piece + 1 < len(STARTS) and x >= STARTS[piece + 1]:
        piece += 1
    a, b, c, d = PIECES[piece]
    rate = a * x + b + c / x + d / x**2
    if D < FREE:
        rate -= math.log(D / FREE) / math.sqrt(math.pi)
    return rate


@compiled
def kinetic_integral(D: float) -> float:
    """Return ∫ Q dD from 0 to D ≥ 0."""
    if D <= FREE:
        return D * (AT_FREE + (1.0 - math.log(D / FREE)) / math.sqrt(math.pi)) if D > 0.0 else 0.0
    total = FREE * (AT_FREE + 1.0 / math.sqrt(math.pi))
    for piece in range(len(STARTS)):
        start, (a, b, c, d) = STARTS[piece], PIECES[piece]
        x = min(D, STARTS[piece + 1]) if piece + 1 < len(STARTS) else D
        if start < x:
            total += (x - start) * (0.5 * a * (x + start) + b + d / (x * start)) + c * math.log(x / start)
    return total


@compiled
def _local(law: Law, g: float, p: float) -> float:
    """Return f(g, p)."""
    if law.kinetic:
        D = max(0.5 * math.sqrt(math.pi) / law.path * g * p, 1e-300)
        return 12.0 * law.path / math.sqrt(math.pi) * g**2 * kinetic_flow_rate(D)
    return g**3 * p + law.slip * g**2


@compiled
def _integral(law: Law, g: float, high: float, low: float) -> float:
    """Return ∫ f dp from a low to a high pressure."""
    if law.kinetic:
        per = 0.5 * math.sqrt(math.pi) / law.path * g
        return 24.0 * law.path**2 / math.pi * g * (kinetic_integral(per * high) - kinetic_integral(per * low))
    return (high - low) * (0.5 * g**3 * (high + low) + law.slip * g**2)


@compiled
def _mean(law: Law, g: float, one: float, other: float) -> float:
    """Return the mean of f over the pressures between two."""
    high, low = max(one, other), min(one, other)
    if not law.kinetic:
        return 0.5 * g**3 * (high + low) + law.slip * g**2
    D = 0.5 * math.sqrt(math.pi) / law.path * g  # of the pressure 1
    jumps = False  # f between the pressures, by up to 0.3 %: a quadrature would jump with it
    for start in STARTS[1:]:
        jumps = jumps or D * low * (1.0 + APART) < start < D * high * (1.0 - APART)
    if jumps or high - low > NEAR * high:
        return _integral(law, g, high, low) / (high - low)
    centre, half = 0.5 * (high + low), 0.5 * (high - low) * math.sqrt(0.6)  # Gauss, three points
    ends = _local(law, g, centre - half) + _local(law, g, centre + half)
    return (5.0 * ends + 8.0 * _local(law, g, centre)) / 18.0


@compiled
def _inner(law: Law, p: Array, beside: Array, gap: Array, gap_beside: Array, faces: Array) -> Array:
    """Return conductances for s of the faces between elements and those beside them; `faces` get their pressures."""
    through = np.zeros(p.shape)
    for i in range(p.shape[0]):
        for j in range(p.shape[1]):
            g, h, one, other = gap[i, j], gap_beside[i, j], p[i, j], beside[i, j]
            if g > 0.0 and h > 0.0:
                front, back = _mean(law, g, one, faces[i, j]), _mean(law, h, other, faces[i, j])
                faces[i, j] = (front * one + back * other) / (front + back)
                front, back = _mean(law, g, one, faces[i, j]), _mean(law, h, other, faces[i, j])
                through[i, j] = _in_window(law, 2.0 * front * back / (front + back), one, other, WINDOW)
    return through


@compiled
def _outer(law: Law, p: Array, reservoir: float, gap: Array) -> Array:
    """Return conductances for s between elements and the reservoir beside them."""
    through = np.zeros(p.size)
    for j in range(p.size):
        if gap[j] > 0.0:
            flow = 2.0 * _mean(law, gap[j], reservoir, p[j])
            through[j] = _in_window(law, flow, reservoir, p[j], 2.0 * WINDOW)
    return through


@compiled
def _in_window(law: Law, flow: float, one: float, other: float, most: float) -> float:
    """Return the conductance for s of a flow between two pressures."""
    return min(max(flow / max(0.5 * (one + other) + law.beta, 1e-300), 1.0 / WINDOW), most)


@compiled
def _over_critical(law: Law, wide: Array, pressure: float) -> Array:
    """Return f of gaps over that of a gap of 1."""
    share, critical = np.zeros(wide.shape), _local(law, 1.0, pressure)
    for i in range(wide.shape[0]):
        for j in range(wide.shape[1]):
            if wide[i, j] > 0.0:
                share[i, j] = _local(law, wide[i, j], pressure) / critical
    return share


def conduction_of_gas(
    gap: Array, axis: int, law: str, path: float, outlet: float, *, periodic: bool = False, accuracy: float = ACCURACY
) -> GasFlow:
    """Return the throughput of a gas along an axis over that of viscous flow between plates at the mean gap.

    The path is λ at the inlet; the outlet pressure is 0 ≤ outlet < 1. A flow that still changes by a tenth of the
    accuracy after `TURNS` iterations is a `ConvergenceError`.
    """
    if law not in LAWS or not 0.0 <= outlet < 1.0 or not 0.0 <= path < math.inf or (law == "kinetic" and path == 0.0):
        given = f"law {law!r}, mean free path {path}, outlet {outlet}"
        raise ContactError(f"{given}; allowed: {', '.join(LAWS)}, > 0, 0 <= outlet < 1")
    critical = constriction(gap, axis, periodic=periodic).gap
    if critical == 0.0:
        return GasFlow(0.0, 0.0, math.inf, 0.0, 0)
    along, free = (gap if axis == 0 else np.ascontiguousarray(gap.T)), path / critical
    if free > LONGEST:
        raise ContactError(
            f"mean free path {path} is {free:.3g} times the critical gap; allowed: up to {LONGEST:g} times"
        )
    wide = np.minimum(along / critical, math.sqrt(WINDOW))  # in free molecular flow g² counts
    middle, of_law = 0.5 * (1.0 + outlet), _law(law, max(free, 1.0 / LONGEST))
    flowing = spanned(_over_critical(of_law, wide, middle) >= 1.0 / WINDOW, periodic)
    throughput, error, unequal, turns = _iterated(np.where(flowing, wide, 0.0), of_law, outlet, periodic, accuracy)
    (rows, columns), largest = along.shape, float(gap.max())
    mean = largest / critical * float(np.mean(gap / largest))
    plates = mean**3 * 0.5 * (1.0 - outlet**2) * columns / rows
    return GasFlow(throughput / plates, error, free / middle, unequal, turns)


def _iterated(gap: Array, law: Law, outlet: float, periodic: bool, accuracy: float) -> tuple[float, float, float, int]:
    """Return the throughput along axis 0 times 12 μ, both errors, and iterations; lengths are over the constriction."""
    rows = gap.shape[0]
    share = np.repeat((1.0 - (np.arange(rows) + 0.5) / rows)[:, None], gap.shape[1], axis=1)
    gap_beside, s_outlet = np.roll(gap, -1, axis=1), outlet * (0.5 * outlet + law.beta)
    drop = 0.5 + law.beta - s_outlet
    p = _pressures(law, share, s_outlet, drop)
    beside = np.roll(p, -1, axis=1)
    down_faces, across_faces = 0.5 * (p[:-1] + p[1:]), 0.5 * (p + beside)
    before = change = math.nan
    for turn in range(1, TURNS + 1):
        down = np.empty((rows + 1, gap.shape[1]))
        down[0], down[-1] = _outer(law, p[0], 1.0, gap[0]), _outer(law, p[-1], outlet, gap[-1])
        down[1:-1] = _inner(law, p[:-1], p[1:], gap[:-1], gap[1:], down_faces)
        across = _inner(law, p, beside, gap, gap_beside, across_faces)
        if not periodic:
            across[:, -1] = 0.0
        flow = flow_through(down, across, INNER * accuracy, share)
        change, last = abs(flow.dissipation / before - 1.0), change
        error = CAUTION * np.fmax(change, LAST * last) + flow.error  # a change may be small by chance
        if change <= LAST * accuracy and error <= accuracy:
            return flow.dissipation * drop, float(error), flow.conservation_error, turn
        before, share = flow.dissipation, flow.pressure
        p = _pressures(law, np.where(gap > 0.0, share, 0.5), s_outlet, drop)
        beside = np.roll(p, -1, axis=1)
    message = f"the flow of the gas still changes after {TURNS} iterations"
    raise ConvergenceError(message, indentation=math.nan, iterations=TURNS, residual=math.nan)


def _pressures(law: Law, share: Array, s_outlet: float, drop: float) -> Array:
    """Return p of s, as a share of its drop: 0 at the outlet, 1 at the inlet."""
    s = s_outlet + drop * np.clip(share, 0.0, 1.0)
    root = law.beta + np.sqrt(law.beta**2 + 2.0 * s)
    return np.maximum(2.0 * s / np.where(root > 0.0, root, 1.0), VACUUM)
