"""Frictionless contact of a rigid rough surface with an elastic half space, at imposed indentation.

Conventions
-----------
Heights z point out of the rough body, Δ ≥ 0 is the far-field closing displacement from first touch. With the rigid
overlap ū = Δ - (z_max - z) and the displacement u = H p the pressures solve the linear complementarity problem

    p ≥ 0,    g = u - ū ≥ 0,    p g = 0    on every element,

which has exactly one solution because H is positive definite. Inside this module all is scaled: heights by their
root mean square σ (h ≤ 0, highest point 0), pressures as q = p δ/(π E* σ), so that u/σ = K ∗ q with the lattice kernel
of `halfspace`; b = h + Δ/σ is the scaled overlap and w = K ∗ q - b the scaled gap. No unit, however odd, gets further in.

The residual
------------
η/σ = max( max |w| where q > 0,  max -w where b > 0 ), evaluated on the whole grid by a convolution in double precision
after the iteration has ended. A pressure q ≥ 0 with residual η is the *exact* solution for a surface whose heights
differ by at most η, hence F(Δ - η) ≤ F ≤ F(Δ + η) for the load and |δV*| ≤ η/σ for the free volume. Iterations stop on
this number and on nothing else. Where b ≤ 0 there is a gap in any case, since all influence coefficients are positive.

The method
----------
H⁻¹ is an M-matrix for the Love kernel. Along increasing Δ therefore pressures never decrease, contact sets are nested
and every gap is a convex function of Δ, so the secant through the last two states, w_k + θ (w_k - w_{k-1}), is a lower
bound of the next gap: the elements it leaves at p > 0 or w < 0 *contain* the next contact set, nearly exactly. On this set
conjugate gradients solve H p = ū, preconditioned by a sparse factorised inverse of the near field of K; elements that
turn tensile leave the set, penetrating ones come back, and a last convolution verifies. For other kernels the same
loop runs without the guarantee: it then relies on the verification, which re-admits whatever penetrates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import linalg as scipy_linalg
from scipy import sparse

from roughvol.errors import ContactError, ConvergenceError
from roughvol.physics.surface import Surface

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_DENSE_UP_TO = 160  # candidates; below this a Cholesky factorisation costs less than the Python of a few iterations
_TENSILE = 1e-12  # a share of the largest pressure that counts as rounding, not as tension or contact


class Compliance(Protocol):
    """What this module needs of a half space; a dense matrix can stand in for the FFT."""

    shape: tuple[int, int]
    influence: Array
    convolutions: int
    convolutions_fp32: int

    def displacement(self, pressure: Array) -> Array:
        """Return u on every element, in lattice units."""
        ...

    def displacement_at(self, elements: Index, pressure: NDArray[Any], *, single: bool = False) -> NDArray[Any]:
        """Return u on the elements that carry the pressure."""
        ...

    @property
    def total_compliance(self) -> Array:
        """Displacement under unit pressure everywhere."""
        ...


@dataclass(frozen=True, eq=False)
class Contact:
    """One equilibrium state; numbers are dimensionless (starred), arrays are made on demand and belong to the caller.

    Attributes
    ----------
    indentation : Δ/σ.
    separation : d/σ = (z_max - mean(z) - Δ)/σ, rigid and far-field.
    contact_area_fraction : A*, elements with p > 0 over all elements.
    mean_pressure : p* = mean(p) L/(E* σ), L the length of the first axis.
    free_volume : V* = mean(g)/σ.
    iterations : conjugate-gradient iterations (a factorisation counts as one).
    convolutions, convolutions_fp32 : full-grid convolutions this state took, verification included, by precision.
    residual : η/σ, see the module's docstring.
    converged : residual ≤ the tolerance asked for.
    """

    indentation: float
    separation: float
    contact_area_fraction: float
    mean_pressure: float
    free_volume: float
    iterations: int
    convolutions: int
    convolutions_fp32: int
    residual: float
    converged: bool
    shape: tuple[int, int]
    _elements: Index = field(repr=False)
    _pressure: Array = field(repr=False)  # q on the elements
    _gap: Array = field(repr=False)  # w on the whole grid, flat

    def pressure(self) -> Array:
        """Return the pressure on every element, p L/(E* σ), of the surface's shape."""
        pressure = np.zeros(self.shape)
        pressure.flat[self._elements] = np.pi * (self.shape[0] - 1) * self._pressure
        return pressure

    def gap(self) -> Array:
        """Return the gap g/σ ≥ 0 on every element; exactly 0 in contact."""
        gap = np.maximum(self._gap, 0.0)
        gap[self._elements] = 0.0
        return gap.reshape(self.shape)

    def contact(self) -> NDArray[np.bool_]:
        """Return the mask of the elements in contact, p > 0."""
        mask = np.zeros(self.shape, dtype=bool)
        mask.flat[self._elements] = True
        return mask


@dataclass
class _State:
    """A solved indentation in scaled variables, on the whole grid (flat): what the next one starts from."""

    indentation: float
    pressure: Array
    displacement: Array


def solve(
    surface: Surface, half_space: Compliance, indentation: float, *, rtol: float = 1e-6, method: str = "fast"
) -> Contact:
    """Return the contact at one indentation Δ/σ, started from nothing but the rigid overlap.

    Parameters
    ----------
    surface : heights and spacing.
    half_space : the compliance of the same grid shape.
    indentation : Δ/σ; at or below zero nothing touches.
    rtol : bound on the residual η/σ.
    method : "fast", or "paper" for the paper's Algorithm 1 on dense matrices (at most 65 × 65 elements).

    Raises
    ------
    ContactError : arguments out of range, shapes that differ.
    ConvergenceError : the residual was not reached.
    """
    return next(sweep(surface, half_space, [indentation], rtol=rtol, method=method))


def sweep(
    surface: Surface,
    half_space: Compliance,
    indentations: Iterable[float],
    *,
    rtol: float = 1e-6,
    method: str = "fast",
) -> Iterator[Contact]:
    """Yield the contact at each of the increasing indentations Δ/σ, every one started from those before.

    Arguments and errors as for `solve`. Each record owns its arrays.
    """
    problem = _Problem(surface, half_space, rtol)
    if method not in METHODS:
        message = f"method is {method!r}; allowed: {', '.join(METHODS)}"
        raise ContactError(message)
    before: _State | None = None
    now = problem.untouched()
    for indentation in indentations:
        if not np.isfinite(indentation) or (before is not None and indentation <= now.indentation):
            message = f"indentation is {indentation}; allowed: finite and increasing (the last was {now.indentation:g})"
            raise ContactError(message)
        if indentation <= 0:
            yield problem.record(problem.untouched(indentation), problem.counts(), 0, 0.0)
            continue
        counts = problem.counts()
        after, iterations, residual = METHODS[method](problem, float(indentation), now, before)
        yield problem.record(after, counts, iterations, residual)
        before, now = now, after


def indentation_for(
    surface: Surface,
    half_space: Compliance,
    target: str,
    value: float,
    *,
    rtol: float = 1e-6,
    method: str = "fast",
) -> float:
    """Return the indentation Δ/σ at which the contact area fraction or the mean pressure reaches a value.

    Both are non-decreasing functions of Δ. The pressure is continuous and met to a relative 1e-6; the area jumps from
    element to element, so the smallest indentation is returned (to 1e-6 of itself) at which it is at least the value.

    Parameters
    ----------
    target : "contact_area" (A*, 0 < value ≤ 1) or "pressure" (p*, value > 0).

    Raises
    ------
    ContactError : unknown target, or a value out of range.
    """
    measures = {"contact_area": "contact_area_fraction", "pressure": "mean_pressure"}
    if target not in measures:
        message = f"target is {target!r}; allowed: {', '.join(measures)}"
        raise ContactError(message)
    if not value > 0 or (target == "contact_area" and value > 1):
        message = f"{target} is {value}; allowed: {'0 < A* <= 1' if target == 'contact_area' else 'p* > 0'}"
        raise ContactError(message)

    def reached(indentation: float) -> float:
        contact = solve(surface, half_space, indentation, rtol=rtol, method=method)
        return float(getattr(contact, measures[target])) - value

    low, high = 0.0, 1.0
    f_low, f_high = -value, reached(1.0)
    while f_high < 0:
        low, f_low, high = high, f_high, 2 * high
        f_high = reached(high)
    # Illinois false position: superlinear where the curve is smooth, never worse than bisection by much on its steps
    side = 0
    for _ in range(200):
        if high - low <= 1e-6 * high or (target == "pressure" and abs(f_high) <= 1e-6 * value):
            break
        middle = high - f_high * (high - low) / (f_high - f_low) if side < 3 else 0.5 * (low + high)
        f_middle = reached(middle)
        if f_middle < 0:
            low, f_low = middle, f_middle
            side = side + 1 if side > 0 else 1
            f_high = 0.5 * f_high if side > 1 else f_high
        else:
            high, f_high = middle, f_middle
            side = 0
    return high


class _Problem:
    """One surface on one half space, scaled; knows how to convolve, verify and record, not how to iterate."""

    def __init__(self, surface: Surface, half_space: Compliance, rtol: float) -> None:
        if surface.shape != half_space.shape:
            message = f"the surface has shape {surface.shape}, the half space {half_space.shape}"
            raise ContactError(message)
        if not 0 < rtol <= 1:
            message = f"rtol is {rtol}; allowed: 0 < rtol <= 1 (a bound on the residual η/σ)"
            raise ContactError(message)
        self.half_space, self.rtol, self.shape = half_space, rtol, surface.shape
        # range first, then σ: the standard deviation of 1e-250 heights would underflow
        heights = surface.heights - surface.heights.max()
        height_range = -heights.min()
        heights = heights / (height_range or 1.0)
        self.heights = (heights / (heights.std() or 1.0)).ravel()
        self.mean_height = float(self.heights.mean())

    def counts(self) -> tuple[int, int]:
        return self.half_space.convolutions, self.half_space.convolutions_fp32

    def untouched(self, indentation: float = 0.0) -> _State:
        return _State(indentation, np.zeros(self.heights.size), np.zeros(self.heights.size))

    def overlap(self, indentation: float) -> Array:
        return self.heights + indentation

    def displacement(self, pressure: Array) -> Array:
        return self.half_space.displacement(pressure.reshape(self.shape)).ravel()

    def residual(self, pressure: Array, gap: Array, overlap: Array) -> float:
        """η/σ on the whole grid."""
        in_contact = np.abs(gap[pressure > 0]).max(initial=0.0)
        return float(max(in_contact, -gap[overlap > 0].min(initial=0.0)))

    def record(self, state: _State, counts: tuple[int, int], iterations: int, residual: float) -> Contact:
        elements = np.flatnonzero(state.pressure > _TENSILE * state.pressure.max(initial=0.0))
        pressure = state.pressure[elements]
        size = self.heights.size
        separation = -self.mean_height - state.indentation
        # mean(u) without a field: Σu = Σ (K ∗ 1) q
        mean_displacement = float(self.half_space.total_compliance.ravel()[elements] @ pressure) / size
        full = elements.size == size
        done = self.counts()
        return Contact(
            indentation=state.indentation,
            separation=separation,
            contact_area_fraction=elements.size / size,
            mean_pressure=float(np.pi * (self.shape[0] - 1) * (pressure.sum() / size)),
            free_volume=0.0 if full else max(separation + mean_displacement, 0.0),
            iterations=iterations,
            convolutions=done[0] - counts[0],
            convolutions_fp32=done[1] - counts[1],
            residual=residual,
            converged=residual <= self.rtol,
            shape=self.shape,
            _elements=elements,
            _pressure=pressure,
            _gap=state.displacement - self.overlap(state.indentation),
        )


def _solve_fast(problem: _Problem, indentation: float, now: _State, before: _State | None) -> tuple[_State, int, float]:
    """Solve one indentation from the secant through the last two states; see the module's docstring."""
    overlap = problem.overlap(indentation)
    if before is None:
        pressure, displacement = now.pressure.copy(), now.displacement.copy()
        candidates = np.flatnonzero(overlap > 0)
    else:
        theta = (indentation - now.indentation) / (now.indentation - before.indentation)
        pressure = np.maximum(now.pressure + theta * (now.pressure - before.pressure), 0.0)
        displacement = now.displacement + theta * (now.displacement - before.displacement)
        candidates = np.flatnonzero((overlap > 0) & ((pressure > 0) | (displacement < overlap)))
    tolerance = 0.7 * problem.rtol  # the rest is for what the verification finds beyond the recursive residual
    iterations = 0
    for _ in range(_ROUNDS):
        q, steps = _face(problem, candidates, overlap, pressure, displacement, tolerance)
        iterations += steps
        pressure = np.zeros_like(overlap)
        pressure[candidates] = q
        displacement = problem.displacement(pressure)
        gap = displacement - overlap
        residual = problem.residual(pressure, gap, overlap)
        if residual <= problem.rtol:
            return _State(indentation, pressure, displacement), iterations, residual
        candidates = np.flatnonzero((pressure > 0) | ((gap < 0) & (overlap > 0)))
    message = f"contact not converged to {problem.rtol:g}"
    raise ConvergenceError(message, indentation=indentation, iterations=iterations, residual=residual)


_ROUNDS = 60  # of solve and verify; one is the rule, two after an unlucky prediction


def _face(
    problem: _Problem, candidates: Index, overlap: Array, pressure: Array, displacement: Array, tolerance: float
) -> tuple[Array, int]:
    """Solve the complementarity problem restricted to the candidates; return q on them and the iterations."""
    b = overlap[candidates]
    if candidates.size <= _DENSE_UP_TO:
        return _dense_face(problem.half_space.influence, problem.shape[1], candidates, b), 1
    q = pressure[candidates]
    w = displacement[candidates] - b
    return _conjugate_gradients(problem.half_space, candidates, q, w, tolerance)


def _dense_face(influence: Array, columns: int, elements: Index, b: Array) -> Array:
    """Solve on few elements by factorisation, removing the tensile ones until none is left and penetrating ones return."""
    matrix = _dense(influence, columns, elements)
    q = np.zeros(b.size)
    active = np.ones(b.size, dtype=bool)
    for _ in range(100 + b.size):
        index = np.flatnonzero(active)
        q[:] = 0.0
        if index.size:
            factor = scipy_linalg.cho_factor(matrix[np.ix_(index, index)], lower=True, check_finite=False)
            q[index] = scipy_linalg.cho_solve(factor, b[index], check_finite=False)
        tensile = q < -_TENSILE * q.max(initial=0.0)
        if tensile.any():
            active &= ~tensile
            continue
        penetrating = ~active & (matrix @ q < b - 1e-12 * np.abs(b).max())
        if not penetrating.any():
            break
        active |= penetrating
    return np.maximum(q, 0.0)


def _dense(influence: Array, columns: int, elements: Index) -> Array:
    """Return the matrix K(i - j) of the elements."""
    row, column = np.divmod(elements, columns)
    matrix: Array = influence[np.abs(row[:, None] - row), np.abs(column[:, None] - column)]
    return matrix


def _conjugate_gradients(
    half_space: Compliance, elements: Index, q: Array, w: Array, tolerance: float
) -> tuple[Array, int]:
    """Bound-constrained preconditioned conjugate gradients (Polak-Ribière⁺) on the elements; q and w are updated."""
    precondition = near_field_inverse(half_space.influence, half_space.shape[1], elements)
    direction = old = None
    product = 0.0
    for iteration in range(_ITERATIONS):
        if iteration % 2 == 0:  # every time costs more than it saves
            _truncate(half_space, elements, q, w)
        free = (q != 0.0) | (w < 0.0)
        r = np.where(free, -w, 0.0)
        if max(r.max(), -r.min()) <= tolerance:
            if not _truncate(half_space, elements, q, w):
                return q, iteration
            continue
        z = np.where(free, precondition(r), 0.0)
        last, product = product, float(r @ z)
        if direction is None or old is None:
            direction = z
        else:
            direction = np.where(free, z + max(0.0, (product - old @ z) / last) * direction, 0.0)
        old = r
        response = half_space.displacement_at(elements, direction)
        length = float(r @ direction) / float(direction @ response)
        q += length * direction
        w += length * response
    return np.maximum(q, 0.0), _ITERATIONS


_ITERATIONS = 2000


def _truncate(half_space: Compliance, elements: Index, q: Array, w: Array) -> bool:
    """Set negative pressures to zero and take their share out of the gap; say whether there were any.

    Few of them are summed directly, many go through a convolution.
    """
    negative = np.flatnonzero(q < 0.0)
    if negative.size == 0:
        return False
    if negative.size <= _SUMMED_UP_TO:
        row, column = np.divmod(elements, half_space.shape[1])
        near = half_space.influence[np.abs(row[:, None] - row[negative]), np.abs(column[:, None] - column[negative])]
        w -= near @ q[negative]
    else:
        removed = np.zeros_like(q)
        removed[negative] = q[negative]
        w -= half_space.displacement_at(elements, removed)
    q[negative] = 0.0
    return True


_SUMMED_UP_TO = 24  # sources; at m = 8 a sum over so many costs a tenth of a convolution


# The 12 of 24 neighbours in a 5 × 5 square that come before an element in memory: the pattern of the factor G
_BEFORE = tuple((i, j) for i in range(-2, 1) for j in range(-2, 3) if (i, j) < (0, 0))


def near_field_inverse(influence: Array, columns: int, elements: Index) -> Callable[[Array], Array]:
    """Return r ↦ Gᵀ G r ≈ K⁻¹ r on the elements, G a sparse triangular factor from the near field.

    Row i of G solves K_PP y = e_i on P = element i and those of its 12 preceding neighbours that belong to the set, and
    G_i = y/√y_i: the factorised sparse approximate inverse, symmetric positive definite whenever K is. An element has
    only 2¹² possible neighbourhoods, so all the small systems of all surfaces are solved once, by `_near_field_rows`.

    Parameters
    ----------
    influence : K(i, j) of the non-negative offsets.
    columns : columns of the grid.
    elements : flat indices, increasing.

    References
    ----------
    L. Yu. Kolotilina, A. Yu. Yeremin, SIAM J. Matrix Anal. Appl. 14 (1993) 45-58.
    """
    table = _near_field_rows(tuple(map(tuple, influence[:5, :5].tolist())))
    row, column = np.divmod(elements, columns)
    width = columns + 4
    place = (row - row[0] + 2) * width + column + 2
    number = np.full((row[-1] - row[0] + 3) * width, -1, dtype=np.int32)
    number[place] = np.arange(elements.size, dtype=np.int32)
    shifts = np.array([i * width + j for i, j in _BEFORE] + [0])
    neighbours = number[place[:, None] + shifts]
    present = neighbours >= 0
    code = present[:, :-1] @ (1 << np.arange(len(_BEFORE)))
    start = np.concatenate(([0], np.cumsum(present.sum(axis=1))))
    factor = sparse.csr_array((table[code][present], neighbours[present], start), shape=(elements.size, elements.size))
    transposed = factor.T.tocsr()
    return lambda r: transposed @ (factor @ r)


@lru_cache(maxsize=8)
def _near_field_rows(influence: tuple[tuple[float, ...], ...]) -> Array:
    """Return the row of G for each of the 2¹² sets of preceding neighbours (zeros where there is none)."""
    kernel = np.zeros((5, 5))
    given = np.array(influence)
    kernel[: given.shape[0], : given.shape[1]] = given
    offsets = np.array([*_BEFORE, (0, 0)])
    matrix = kernel[np.abs(offsets[:, None, 0] - offsets[:, 0]), np.abs(offsets[:, None, 1] - offsets[:, 1])]
    codes = np.arange(1 << len(_BEFORE))
    present = np.ones((codes.size, len(offsets)), dtype=bool)
    present[:, :-1] = (codes[:, None] >> np.arange(len(_BEFORE))) & 1
    # absent neighbours become rows of the identity, so that all systems have one size
    systems = np.where(present[:, :, None] & present[:, None, :], matrix, np.eye(len(offsets)))
    unit = np.zeros((len(offsets), 1))
    unit[-1] = 1.0
    rows: Array = np.linalg.solve(systems, unit)[:, :, 0]
    return rows / np.sqrt(rows[:, -1:])


def _solve_paper(
    problem: _Problem, indentation: float, now: _State, before: _State | None
) -> tuple[_State, int, float]:
    """Solve by the paper's Algorithm 1: greedy removal of tensile elements, Gauss-Seidel inside, from the rigid overlap.

    A reference for small grids: the matrix is dense, every indentation starts anew, and an element that has left does
    not come back (for the Love kernel none has to).
    """
    if max(problem.shape) > _PAPER_UP_TO:
        message = (
            f"method 'paper' takes grids up to {_PAPER_UP_TO} × {_PAPER_UP_TO} (m = 6); this one is {problem.shape}"
        )
        raise ContactError(message)
    overlap = problem.overlap(indentation)
    elements = np.flatnonzero(overlap > 0)
    sweeps = 0
    while True:
        matrix = _dense(problem.half_space.influence, problem.shape[1], elements)
        lower = np.tril(matrix)
        upper = np.triu(matrix, 1)
        b = overlap[elements]
        p = np.zeros(b.size)
        for _ in range(100_000):
            w = matrix @ p - b
            if np.abs(w).max(initial=0.0) <= 0.1 * problem.rtol:
                break
            p = scipy_linalg.solve_triangular(lower, b - upper @ p, lower=True, check_finite=False)
            sweeps += 1
        tensile = p < 0.0
        if not tensile.any():
            break
        elements = elements[~tensile]
    pressure = np.zeros_like(overlap)
    pressure[elements] = p
    displacement = problem.displacement(pressure)
    residual = problem.residual(pressure, displacement - overlap, overlap)
    if residual > problem.rtol:
        message = f"Algorithm 1 not converged to {problem.rtol:g}"
        raise ConvergenceError(message, indentation=indentation, iterations=sweeps, residual=residual)
    return _State(indentation, pressure, displacement), sweeps, residual


_PAPER_UP_TO = 65

METHODS = {"fast": _solve_fast, "paper": _solve_paper}
