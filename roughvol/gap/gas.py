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

The flux between two points of an element is linear in its potential Φ(p) = ∫ f dp (Kirchhoff's transformation). For
f = g³ p + 6 λ g² one part is linear in p² and one in p, and where g varies no potential is common to all elements. Then
the problem is nonlinear. `conduction_of_gas` solves it by turns. Each turn is a linear problem in the potential s of
the critical constriction. The conductance of a face is its exact throughput at the last pressures over its drop of s. A
fixed point has the exact throughputs. Gaps near the constriction decide the flow, and their conductances hardly depend
on the pressures.
"""

import itertools
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
CAUTION = 3.0  # the last change is no bound of the changes to come
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
NEWTON = 2  # steps to the pressure of a potential, in a turn; the next turn makes up for what they leave
CLOSE = 1e-7  # relative difference of two pressures, whose drop of s has lost its digits
NEAR = 0.02  # relative difference of two pressures, below which their mean conductance is a quadrature
LONGEST = 1e100  # mean free path over the constriction; a shorter one than its inverse gives the same flow to rounding
APART = 1e-9  # relative distance of a pressure from an end of the fit; nearer ones have no digits in their integrals


def _from_start(piece: int, D: float) -> float:
    """Return ∫ Q dD from the start of a piece to D."""
    start, (a, b, c, d) = STARTS[piece], PIECES[piece]
    return (D - start) * (0.5 * a * (D + start) + b + d / (D * start)) + c * math.log(D / start)


_within = compiled(_from_start)
TO_FREE = FREE * (AT_FREE + 1.0 / math.sqrt(math.pi))  # ∫ Q dD
TO_STARTS = tuple(itertools.accumulate(map(_from_start, range(2), STARTS[1:]), initial=TO_FREE))


class GasFlow(NamedTuple):
    """A flow of a gas along an axis: throughput over that of viscous flow between plates, relative error, iterations.

    The error is that of the last two changes and of the last flow. ``knudsen`` is λ at the mean of both pressures over
    the critical constriction, infinite without a way. ``pressure`` has the pressures of the elements, shape (rows,
    columns), any number where nothing flows; None without a way.
    """

    coefficient: float
    error: float
    knudsen: float
    conservation_error: float
    turns: int
    pressure: Array | None = None


class Law(NamedTuple):
    """A law of the table above: kinetic or not, D of a gap of 1 at the inlet, and 6 λ in slip flow."""

    kinetic: bool
    D: float
    slip: float


def _law(name: str, path: float) -> Law:
    dense = 0.5 * math.sqrt(math.pi) / path if name == "kinetic" else math.inf
    return Law(name == "kinetic", dense, SLIP * path if name == "slip" else 0.0)


def local_flow(law: str, gap: float, pressure: float, path: float) -> float:
    """Return f(g, p) [length³] of the table above; the path is λ at the inlet."""
    return _local(_law(law, path), gap, pressure)


def plate_flow(law: str, gap: float, inlet: float, outlet: float, path: float) -> float:
    """Return ∫ f(g, p) dp from the outlet to the inlet: the throughput of plates per width over length, times 12 μ."""
    return _integral(_law(law, path), gap, inlet, outlet)


@compiled
def kinetic_flow_rate(D: float) -> float:
    """Return Q(D), the flow rate between plane plates by kinetic theory, for D = √π g/(2 λ) > 0."""
    x = max(D, FREE)
    a, b, c, d = PIECES[_piece(x)]
    rate = a * x + b + (c + d / x) / x
    if D < FREE:
        rate -= math.log(D / FREE) / math.sqrt(math.pi)
    return rate


@compiled
def kinetic_integral(D: float) -> float:
    """Return ∫ Q dD from 0 to D ≥ 0."""
    if D <= FREE:
        return D * (AT_FREE + (1.0 - math.log(D / FREE)) / math.sqrt(math.pi)) if D > 0.0 else 0.0
    piece = _piece(D)
    return TO_STARTS[piece] + _within(piece, D)


@compiled
def _piece(D: float) -> int:
    """Return the piece of the fit for D ≥ `FREE`."""
    return (STARTS[1] <= D) + (STARTS[2] <= D)


@compiled
def _local(law: Law, g: float, p: float) -> float:
    """Return f(g, p)."""
    if law.kinetic:
        return 6.0 / law.D * g**2 * kinetic_flow_rate(max(law.D * g * p, 1e-300))
    return g**3 * p + law.slip * g**2


@compiled
def _integral(law: Law, g: float, high: float, low: float) -> float:
    """Return ∫ f dp from a low to a high pressure."""
    if law.kinetic:
        per = law.D * g
        return 6.0 / law.D**2 * g * (kinetic_integral(per * high) - kinetic_integral(per * low))
    return (high - low) * (0.5 * g**3 * (high + low) + law.slip * g**2)


@compiled
def _mean(law: Law, g: float, one: float, other: float) -> float:
    """Return the mean of f over the pressures between two."""
    high, low = max(one, other), min(one, other)
    if not law.kinetic:
        return 0.5 * g**3 * (high + low) + law.slip * g**2
    D = law.D * g  # of the pressure 1
    jumps = False  # f between the pressures, by up to 0.3 %: a quadrature would jump with it
    for start in STARTS[1:]:
        jumps = jumps or D * low * (1.0 + APART) < start < D * high * (1.0 - APART)
    if jumps or high - low > NEAR * high:
        return _integral(law, g, high, low) / (high - low)
    centre, half = 0.5 * (high + low), 0.5 * (high - low) * math.sqrt(0.6)  # Gauss, three points
    ends = _local(law, g, centre - half) + _local(law, g, centre + half)
    return (5.0 * ends + 8.0 * _local(law, g, centre)) / 18.0


@compiled
def _potentials(law: Law, p: Array) -> Array:
    """Return the potentials s of the constriction, a gap of 1, at pressures of a field."""
    s = np.empty(p.shape)
    for i in range(p.shape[0]):
        for j in range(p.shape[1]):
            s[i, j] = _integral(law, 1.0, p[i, j], 0.0)
    return s


@compiled
def _follow(law: Law, p: Array, s: Array, towards: Array) -> None:
    """Change pressures and their potentials s towards other potentials, by steps of Newton."""
    for i in range(p.shape[0]):
        for j in range(p.shape[1]):
            if law.kinetic:
                for _ in range(NEWTON):
                    step = (towards[i, j] - s[i, j]) / _local(law, 1.0, p[i, j])
                    p[i, j] = min(max(p[i, j] + step, 0.1 * p[i, j], VACUUM), 1.0)
                    s[i, j] = _integral(law, 1.0, p[i, j], 0.0)
            else:
                s[i, j] = max(towards[i, j], _integral(law, 1.0, VACUUM, 0.0))
                p[i, j] = 2.0 * s[i, j] / (law.slip + math.sqrt(law.slip**2 + 2.0 * s[i, j]))


@compiled
def _inner(law: Law, s: Array, p: Array, gap: Array, axis: int, shares: Array) -> Array:
    """Return conductances for s of the faces between elements and the next ones along an axis, the last with the first.

    ``shares`` holds, for each face, by how much its pressure follows that of the element rather than of the next one.
    """
    through, (rows, columns) = np.zeros(p.shape), p.shape
    for i in range(rows):
        for j in range(columns):
            k, n = (i + 1 if i + 1 < rows else 0, j) if axis == 0 else (i, j + 1 if j + 1 < columns else 0)
            g, h, share = gap[i, j], gap[k, n], shares[i, j]
            if g > 0.0 and h > 0.0:
                face = share * p[i, j] + (1.0 - share) * p[k, n]
                at = _integral(law, 1.0, face, 0.0)
                one, other = _mean(law, g, p[i, j], face), _mean(law, h, p[k, n], face)
                shares[i, j] = one / (one + other)
                front = _conductance(law, one, s[i, j] - at, p[i, j], face)
                back = _conductance(law, other, s[k, n] - at, p[k, n], face)
                through[i, j] = min(max(2.0 * front * back / (front + back), 1.0 / WINDOW), WINDOW)
    return through


@compiled
def _outer(law: Law, s: Array, p: Array, at: float, reservoir: float, gap: Array) -> Array:
    """Return conductances for s between elements and the reservoir beside them, of a potential ``at``."""
    through = np.zeros(p.size)
    for j in range(p.size):
        if gap[j] > 0.0:
            flow = 2.0 * _conductance(law, _mean(law, gap[j], p[j], reservoir), s[j] - at, p[j], reservoir)
            through[j] = min(max(flow, 1.0 / WINDOW), 2.0 * WINDOW)
    return through


@compiled
def _conductance(law: Law, mean: float, drop: float, one: float, other: float) -> float:
    """Return a mean of f between two pressures over that of the constriction, of a drop of s between them."""
    return mean * ((one - other) / drop if abs(one - other) > CLOSE * one else 1.0 / _local(law, 1.0, one))


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
    gap: Array,
    axis: int,
    law: str,
    path: float,
    outlet: float,
    *,
    periodic: bool = False,
    accuracy: float = ACCURACY,
    start: Array | None = None,
) -> GasFlow:
    """Return the throughput of a gas along an axis over that of viscous flow between plates at the mean gap.

    The path is λ at the inlet; the outlet pressure is 0 ≤ outlet < 1. `start` has pressures of a similar gap. A flow
    that still changes by a tenth of the accuracy after `TURNS` iterations is a `ConvergenceError`.
    """
    if law not in LAWS or not 0.0 <= outlet < 1.0 or not 0.0 <= path < math.inf or (law == "kinetic" and path == 0.0):
        given = f"law {law!r}, mean free path {path}, outlet {outlet}"
        raise ContactError(f"{given}; allowed: {', '.join(LAWS)}, > 0, 0 <= outlet < 1")
    along = gap if axis == 0 else np.ascontiguousarray(gap.T)
    critical = constriction(along, 0, periodic=periodic).gap
    if critical == 0.0:
        return GasFlow(0.0, 0.0, math.inf, 0.0, 0)
    free = path / critical
    if free > LONGEST:
        raise ContactError(
            f"mean free path {path} is {free:.3g} times the critical gap; allowed: up to {LONGEST:g} times"
        )
    wide = np.minimum(along / critical, math.sqrt(WINDOW))  # in free molecular flow g² counts
    middle, of_law = 0.5 * (1.0 + outlet), _law(law, max(free, 1.0 / LONGEST))
    flowing = spanned(_over_critical(of_law, wide, middle) >= 1.0 / WINDOW, periodic)
    (rows, columns), turned = along.shape, axis == 1
    if start is None:
        start = np.repeat((1.0 - (1.0 - outlet) * (np.arange(rows) + 0.5) / rows)[:, None], columns, axis=1)
    else:
        start = start.T.copy() if turned else start.copy()
    found = _iterated(np.where(flowing, wide, 0.0), of_law, outlet, periodic, accuracy, start)
    largest = float(gap.max())
    plates = (largest / critical * float(np.mean(gap / largest))) ** 3 * 0.5 * (1.0 - outlet**2) * columns / rows
    pressure = start.T if turned else start
    return GasFlow(found[0] / plates, found[1], free / middle, *found[2:], pressure)


def _iterated(
    gap: Array, law: Law, outlet: float, periodic: bool, accuracy: float, p: Array
) -> tuple[float, float, float, int]:
    """Return the throughput along axis 0 times 12 μ, both errors, and iterations; lengths are over the constriction.

    The pressures ``p`` to start from end as those of the flow.
    """
    rows, columns = gap.shape
    inlet, least = _potentials(law, np.array([[1.0, outlet]]))[0]
    drop, s, shares = inlet - least, _potentials(law, p), np.full((2, rows, columns), 0.5)
    linear = not law.kinetic and law.slip == 0.0  # in s: viscous flow
    before, last = math.nan, 0.0 if linear else math.inf
    for turn in range(1, TURNS + 1):
        down = np.empty((rows + 1, columns))
        down[1:] = _inner(law, s, p, gap, 0, shares[0])
        down[0] = _outer(law, s[0], p[0], inlet, 1.0, gap[0])
        down[-1] = _outer(law, s[-1], p[-1], least, outlet, gap[-1])
        across = _inner(law, s, p, gap, 1, shares[1])
        if not periodic:
            across[:, -1] = 0.0
        flow = flow_through(down, across, INNER * accuracy, (s - least) / drop)
        change = 0.0 if linear else abs(flow.dissipation / before - 1.0)
        error = CAUTION * max(change, LAST * last) + flow.error  # a change may be small by chance
        if change <= LAST * accuracy and error <= accuracy:
            return flow.dissipation * drop, float(error), flow.conservation_error, turn
        before, last = flow.dissipation, change if turn > 1 else last
        _follow(law, p, s, least + drop * np.clip(np.where(gap > 0.0, flow.pressure, 0.5), 0.0, 1.0))
    message = f"the flow of the gas still changes after {TURNS} iterations"
    raise ConvergenceError(message, indentation=math.nan, iterations=TURNS, residual=math.nan)
