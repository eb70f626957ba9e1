"""Pressures and flows on a grid of elements that are joined by conductances, to an accuracy that the caller asks for.

The pressures of the least dissipation Σ w (δP)² are those of the flow, and that dissipation is the flow. Any other
pressures with the same ends dissipate more (Dirichlet). Their excess is the square of their error in the norm of
energy, and it is the error of the flow. Conjugate gradients, preconditioned by multigrid, lower the dissipation step by
step. For a matrix A, its preconditioner M and the inflow r that is left, the excess is r A⁻¹ r ≤ r M r/λ with the
smallest eigenvalue λ of M A. The steps know λ as the smallest Ritz value (Strakoš & Tichý, Electronic Transactions on
Numerical Analysis 13 (2002) 56-80; Meurant & Tichý, Acta Numerica 33 (2024) 487-696). With the
largest eigenvalue Λ of M A, a step leaves at most ((Λ - λ)/(Λ + λ))² of the excess. This holds for steepest descent
(Quarteroni, Sacco & Saleri, Numerical Mathematics, Springer 2000, eq. 4.38). Conjugate gradients leave no more. A Ritz
value may still be too large, so the excess is an estimate. flow.md compares it with exact flows.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from roughvol.errors import ConvergenceError
from roughvol.gap import multigrid
from roughvol.gap.compiled import compiled
from roughvol.gap.multigrid import Conductances, Multigrid
from roughvol.typing import Array

ACCURACY = 1e-4  # of a flow, relative, unless a study asks for another
STEPS = 100  # of conjugate gradients. Most flows take 10, and what does not converge in 100 is factorised:
FACTORISED = 2_000_000  # elements at most; more are an error
REFINED = 1e-7  # accuracy from which on residuals are taken from the flows, and P from the nearer reservoir
LOST = 1e5  # fall of a dissipation, after which residuals have lost digits that count
ROUNDING = 1e-12  # least excess over the dissipation at the start of a solve; the next solve takes it off
SOLVES = 3  # the first solves, the second gives u the digits that P has not, the third takes rounding off
CAUTION = 3.0  # the smallest Ritz value is above the eigenvalue. flow.md has the errors with 1 and 3.
SMALLEST = 0.4  # eigenvalue of M A on wide gaps, until a step meets a smaller one.
LARGEST = 2.0  # eigenvalue of M A, where cycles alone converge.
TINY = np.finfo(np.float64).tiny
DIGITS = 1e-12  # of the energy of pressures that are wanted for themselves, six of the pressures
Whole = NDArray[Any]  # numbers 0 and 1


class Network:
    """Elements with conductances, and the pressures that bring the flow into them to 0."""

    def __init__(self, conductances: Conductances) -> None:
        self._conductances = conductances
        self._inverse = Multigrid(conductances)
        self.exact = self._inverse.exact
        self._smallest = SMALLEST  # eigenvalue of M A that the steps have met

    def start(self, inflow: Array) -> Array:
        """Return pressures to start from, which an inflow of each element drives nearly; 0 where factors follow."""
        return np.zeros(inflow.shape) if self.exact else self._inverse.nested(inflow)

    def solve(self, inflow: Array) -> Array:
        """Return the pressures that drive an inflow of each element, to the `DIGITS` of their energy.

        The array of the inflow is used up: it ends as the inflow that is left.
        """
        pressure = np.zeros(inflow.shape)
        self._descend(pressure, inflow, lambda fallen: DIGITS * fallen, factors_alone=False)
        return pressure

    def correct(self, pressure: Array, left: Array, dissipation: float, accuracy: float, least: float = 0.0) -> float:
        """Correct pressures that leave an inflow, and return the estimated error of the dissipation.

        The dissipation is that of the uncorrected pressures, the error over the dissipation of the corrected ones. An
        error of ``least`` times the uncorrected dissipation is allowed as well. The array ``left`` is used up.
        """
        to_come, fallen = self._descend(
            pressure, left, lambda fallen: max(accuracy * (dissipation - fallen), least * dissipation)
        )
        return to_come / (dissipation - fallen)

    def _descend(
        self, pressure: Array, left: Array, allowed: Callable[[float], float], *, factors_alone: bool = True
    ) -> tuple[float, float]:
        """Correct pressures; return how far the dissipation may still fall, and how far it fell.

        ``allowed`` maps the fall that was reached to the fall that may be left. Without convergence in `STEPS` steps
        the grid is factorised, or if it is too large, a `ConvergenceError` is raised. ``factors_alone`` are exact
        enough for a flow. Their rounding counts in a wide pocket with a closed rim, and gradients take it off.
        """
        direction, outflow = np.zeros(left.shape), np.empty(left.shape)
        fallen, product, steps, turns = 0.0, np.inf, list[float](), list[float]()
        while not (self.exact and factors_alone) and len(steps) < STEPS:
            towards = self._inverse(left)
            before, product = product, float(np.vdot(left, towards))
            if product <= 0.0:  # nothing is left, or the inverse has 32 bits and is not positive here
                to_come = CAUTION * -product / self._smallest
                if to_come <= allowed(fallen):
                    return to_come, fallen
                break
            turns.append(product / before)
            multigrid.turned(direction, towards, turns[-1], *self._conductances, outflow)
            steps.append(product / float(np.vdot(direction, outflow)))
            multigrid.stepped(pressure, left, direction, outflow, steps[-1])
            fallen += steps[-1] * product
            self._smallest = min(self._smallest, smallest(steps, turns))
            kept = ((LARGEST - self._smallest) / (LARGEST + self._smallest)) ** 2
            to_come = kept * CAUTION * product / self._smallest
            if to_come <= allowed(fallen):
                return to_come, fallen
        if not self.exact and left.size > FACTORISED:
            message = f"the flow through {left.size} elements did not converge in {len(steps)} steps"
            raise ConvergenceError(message, indentation=np.nan, iterations=len(steps), residual=to_come)
        if not self.exact:
            self._inverse, self.exact = Multigrid(self._conductances, left.size), True
        more = self._inverse(left)
        pressure += more
        return 0.0, fallen + float(np.vdot(more, left))


def smallest(steps: list[float], turns: list[float]) -> float:
    """Return the smallest Ritz value of the preconditioned matrix, from the steps and turns of conjugate gradients."""
    step, turn = np.array(steps), np.array(turns[1:])
    diagonal = 1.0 / step
    diagonal[1:] += turn / step[:-1]
    found: Array = linalg.eigvalsh_tridiagonal(diagonal, np.sqrt(turn) / step[:-1], select="i", select_range=(0, 0))
    return float(found[0])


class Flow(NamedTuple):
    """A flow for a drop of pressure from 1 to 0: conductances, pressures, their dissipation, and its relative error.

    ``down`` (rows + 1, columns) leads from the inlet to the outlet, ``east`` (rows, columns) from column to column, the
    last one to the first of a period, or 0. A pressure is ``whole``, 0 or 1, and ``fine``. The dissipation is the flow.
    """

    down: Array
    east: Array
    fine: Array
    whole: Whole
    dissipation: float
    error: float

    @property
    def pressure(self) -> Array:
        """Pressures of the elements, 0 where nothing flows."""
        return self.whole + self.fine

    @property
    def fluxes(self) -> tuple[Array, Array]:
        """Fluxes through the faces ``down`` and ``east``."""
        falls = differences(self.fine, 0.0) + differences(self.whole, 1.0)
        across = (self.fine - np.roll(self.fine, -1, axis=1)) + (self.whole - np.roll(self.whole, -1, axis=1))
        return self.down * falls, self.east * across

    @property
    def conservation_error(self) -> float:
        """The larger of |inflow - flow| and |outflow - flow| over the flow."""
        inflow = self.down[0] * ((1 - self.whole[0]) - self.fine[0])
        outflow = self.down[-1] * (self.fine[-1] + self.whole[-1])
        return max(abs(float(end.sum()) - self.dissipation) for end in (inflow, outflow)) / self.dissipation


def flow_through(down: Array, east: Array, accuracy: float = ACCURACY, start: Array | None = None) -> Flow:
    """Return the flow along axis 0 between P = 1 and P = 0, through faces of the shapes of `Flow`, reservoirs included.

    Unknown is u = P - R. After the first solve R = 0 or 1 is the nearer reservoir. Where P differs from a reservoir by
    less than rounding, u and the flux it drives still have all their digits. More solves follow where the accuracy or
    the contrast asks for them. ``start`` has pressures to start from.
    """
    network = Network(between_reservoirs(down, east))
    left = np.zeros(east.shape)
    left[0] = down[0]  # from the inlet, where all elements have P = 0
    u = network.start(left) if start is None else start.copy()
    nearer = np.zeros(east.shape, np.int8)
    dissipation = _inflow(left, down, east, u, nearer)
    for attempt in range(SOLVES):
        before = dissipation
        least = ROUNDING if attempt + 1 < SOLVES else 0.0
        error = network.correct(u, left, dissipation, accuracy, least)
        dissipation = _inflow(left, down, east, u, nearer)
        if accuracy > REFINED and not network.exact and before < LOST * dissipation:
            break
        if attempt == 0:
            nearer = (u > 0.5).astype(np.int8)
            u -= nearer
            dissipation = _inflow(left, down, east, u, nearer)
    return Flow(down, east, u, nearer, dissipation, error)


def between_reservoirs(down: Array, east: Array) -> Conductances:
    """Return the conductances of a grid whose first and last lines lead to reservoirs."""
    south, own = down[1:].copy(), np.zeros(east.shape)
    own[0], south[-1] = down[0], 0.0
    own[-1] += down[-1]
    return Conductances(south, east, own)


@compiled
def _inflow(left: Array, down: Array, east: Array, fine: Array, whole: Whole) -> float:
    """Write the flow into each element at the pressures ``fine`` + ``whole`` to ``left``; return their dissipation."""
    rows, columns = east.shape
    nothing, dissipation = np.zeros(columns), 0.0
    inlet, outlet = np.ones(columns, np.int8), np.zeros(columns, np.int8)
    for i in range(rows + 1):
        above, below = fine[i - 1] if i else nothing, fine[i] if i < rows else nothing
        high, low = whole[i - 1] if i else inlet, whole[i] if i < rows else outlet
        of_line = 0.0  # sums of lines keep the digits of a sum over millions
        for j in range(columns):
            fall = (above[j] - below[j]) + (high[j] - low[j])
            flux = down[i, j] * fall
            of_line += flux * fall
            if i > 0:
                left[i - 1, j] -= flux
            if i < rows:
                left[i, j] = flux
        if i < rows:
            for j in range(columns):
                on = j + 1 if j + 1 < columns else 0
                fall = (below[j] - below[on]) + (low[j] - low[on])
                flux = east[i, j] * fall
                of_line += flux * fall
                left[i, j] -= flux
                left[i, on] += flux
        dissipation += of_line
    return dissipation


def flow_around(conductances: Conductances, accuracy: float = ACCURACY) -> float:
    """Return the dissipation in one period, where P falls by one from row to row in the mean.

    ``own`` holds the pressure of one element of each cluster, whichever element this is.
    """
    south, east, _ = conductances
    network = Network(conductances)
    p = np.zeros(south.shape)

    def fluxes() -> tuple[Array, Array, float]:
        down, across = 1.0 + (p - np.roll(p, -1, axis=0)), p - np.roll(p, -1, axis=1)
        through, aside = south * down, east * across
        return through, aside, float(np.vdot(through, down) + np.vdot(aside, across))

    through, aside, dissipation = fluxes()
    for _ in range(SOLVES if accuracy <= REFINED or network.exact else 1):
        surplus = np.roll(through, 1, axis=0) - through + np.roll(aside, 1, axis=1) - aside
        network.correct(p, surplus, dissipation, accuracy)
        through, aside, dissipation = fluxes()
    return dissipation


def surplus(down: Array, east: Array) -> Array:
    """Return the flow into each element, from fluxes of the shapes of `Flow`."""
    inflow: Array = down[:-1] - down[1:] + np.roll(east, 1, axis=1) - east
    return inflow


def differences(field: Array, inlet: float) -> Array:
    """Return the differences from line to line, those from the inlet and to the outlet (0) included."""
    return np.concatenate([inlet - field[:1], field[:-1] - field[1:], field[-1:]])


@compiled
def faces(k: Array, periodic: bool) -> tuple[Array, Array]:
    """Return the conductances of the faces, of the shapes of `Flow`, from those of the elements.

    Neighbours are joined by the harmonic mean, a reservoir and its neighbour by 2k; the seam conducts in a period.
    """
    rows, columns = k.shape
    down, east = np.empty((rows + 1, columns)), np.empty(k.shape)
    for j in range(columns):
        down[0, j], down[rows, j] = 2.0 * k[0, j], 2.0 * k[rows - 1, j]
    for i in range(rows):
        for j in range(columns):
            on = j + 1 if j + 1 < columns else 0
            east[i, j] = _harmonic(k[i, j], k[i, on]) if on or periodic else 0.0
            if i + 1 < rows:
                down[i + 1, j] = _harmonic(k[i, j], k[i + 1, j])
    return down, east


@compiled
def harmonic(a: Array, b: Array) -> Array:
    """Return 2ab/(a + b) of two fields of the same shape, 0 where one of them is."""
    mean = np.empty(a.shape)
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            mean[i, j] = _harmonic(a[i, j], b[i, j])
    return mean


@compiled
def _harmonic(a: float, b: float) -> float:
    return 2.0 * a * b / max(a + b, TINY)
