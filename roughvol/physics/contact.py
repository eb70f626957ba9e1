"""Frictionless contact of a rigid rough surface with an elastic half space, at imposed indentation.

Conventions
-----------
Heights z point out of the rough body, Δ ≥ 0 is the far-field closing displacement from first touch. With the rigid
overlap ū = Δ - (z_max - z) and the displacement u = H p the pressures solve the linear complementarity problem

    p ≥ 0,    g = u - ū ≥ 0,    p g = 0    on every element,

which has exactly one solution because H is positive definite. Inside this module all is scaled: heights by their
root mean square σ (h ≤ 0, highest point 0), pressures as q = p δ/(π E* σ), so that u/σ = K ∗ q with the lattice
kernel of `halfspace`; b = h + Δ/σ is the scaled overlap and w = K ∗ q - b the scaled gap. No unit gets further in.

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
bound of the next gap: the elements it leaves at p > 0 or w < 0 *contain* the next contact set, nearly exactly. On
this set conjugate gradients solve H p = ū with the approximate inverse of `precondition`; elements that turn
tensile leave the set, penetrating ones come back, and a last convolution verifies. For other kernels the same loop
runs without the guarantee: it then relies on the verification, which re-admits whatever penetrates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import linalg as scipy_linalg

from roughvol.errors import ContactError, ConvergenceError
from roughvol.physics.blocks import influence_matrix
from roughvol.physics.precondition import approximate_inverse
from roughvol.physics.superposition import Superposition
from roughvol.physics.surface import Surface

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Candidates up to which a factorisation costs less than a few iterations and their preconditioner: so many on small
# grids, where the iterations cost the time of Python, and from _DENSE_FROM nodes a side on in proportion to the nodes
_DENSE_UP_TO = 160
_DENSE_FROM = 257
_ROUNDING = 4e-16  # no residual η/σ below this share of the indentation survives the rounding of a convolution
_TENSILE = 1e-12  # a share of the largest pressure that counts as rounding, not as tension or contact
# Largest residual over the indentation. A state without any pressure has η = Δ; with η ≤ Δ/100 the highest element
# carries load, as F ≥ F(Δ - η) > 0, and p* is right to a few percent however loose the tolerance is.
_LIGHT = 0.01
_LIGHT_ROUGH = 0.5  # the same on the way of a search


class Compliance(Protocol):
    """What this module needs of a half space; a dense matrix can stand in for the FFT."""

    shape: tuple[int, int]
    influence: Array
    convolutions: float
    convolutions_fp32: float

    def displacement_above(self, heights: Array, elements: Index, pressure: NDArray[Any]) -> Array:
        """Return u - heights on every element, flat, in lattice units; the elements (increasing) carry the pressure."""
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
    convolutions, convolutions_fp32 : convolutions this state took, verification included, by precision, in units of one
        on the full grid (one over part of it counts by its share).
    residual : η/σ, see the module's docstring; it bounds the error of the free volume.
    mean_pressure_bound : bound of the relative error of p*: the residual times a bound of the stiffness of the contact;
        infinite if there is no pressure after the touch.
    converged : residual ≤ the tolerance asked for, and ≤ Δ/(100 σ).
    """

    indentation: float
    separation: float
    contact_area_fraction: float
    mean_pressure: float
    free_volume: float
    iterations: int
    convolutions: float
    convolutions_fp32: float
    residual: float
    mean_pressure_bound: float
    converged: bool
    shape: tuple[int, int]
    _elements: Index = field(repr=False)
    _pressure: Array = field(repr=False)  # q on the elements
    _state: _State = field(repr=False)

    def pressure(self) -> Array:
        """Return the pressure on every element, p L/(E* σ), of the surface's shape."""
        pressure = np.zeros(self.shape)
        pressure.flat[self._elements] = np.pi * (self.shape[0] - 1) * self._pressure
        return pressure

    def gap(self) -> Array:
        """Return the gap g/σ ≥ 0 on every element; exactly 0 in contact."""
        gap = np.maximum(self._state.gap(), 0.0)
        gap[self._elements] = 0.0
        return gap.reshape(self.shape)

    def contact(self) -> NDArray[np.bool_]:
        """Return the mask of the elements in contact, p > 0."""
        mask = np.zeros(self.shape, dtype=bool)
        mask.flat[self._elements] = True
        return mask

    def state(self) -> dict[str, Any]:
        """Return what `sweep` needs to go on from here (``resume``), as plain numbers and arrays."""
        return {name: getattr(self._state, name) for name in ("indentation", "elements", "pressure", "touch_at")}


@dataclass
class _State:
    """A solved indentation in scaled variables: what the next one starts from."""

    indentation: float
    elements: Index  # where q > 0, increasing
    pressure: Array  # q there
    touch_at: Array  # u - h on the whole grid, flat: the indentation at which an element touches as long as u stays
    _near: tuple[float, Index, Array] | None = None

    def gap(self, elements: Index | None = None) -> Array:
        """Return w, on the whole grid or on some elements of it."""
        return (self.touch_at if elements is None else self.touch_at[elements]) - self.indentation

    def within(self, reach: float) -> tuple[Index, Array]:
        """Return, in increasing order, all elements with w < reach and those with q > 0, maybe more, and their w.

        A pass over the grid, which is not made again for a shorter reach.
        """
        if self._near is None or self._near[0] < reach:
            near = self.touch_at < self.indentation + reach
            near[self.elements] = True
            elements = np.flatnonzero(near)
            self._near = reach, elements, self.gap(elements)
        return self._near[1:]


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
    precision: str = "mixed",
    pressure_error: float | None = None,
    resume: Iterable[Mapping[str, Any]] = (),
) -> Iterator[Contact]:
    """Yield the contact at each of the increasing indentations Δ/σ, every one started from those before.

    Arguments and errors as for `solve`. Each record owns its arrays.

    Parameters
    ----------
    precision : of the convolutions inside the iteration, "mixed" (single where it costs no digit) or "double"; the
        residual is the same certified one with both.
    pressure_error : bound on the relative error of p* at every state, in addition to `rtol`. The last two states tell
        the residual that the next one needs; where it turns out too large, that one is solved on.
    resume : `Contact.state` of the last two contacts of a sweep that broke off; this one then goes on as if it had not,
        to the last bit.
    """
    problem = _Problem(surface, half_space, rtol, precision)
    solve_one = _method(method)
    if pressure_error is not None and not 0 < pressure_error <= 0.1:
        message = f"pressure_error is {pressure_error}; allowed: 0 < pressure_error <= 0.1"
        raise ContactError(message)
    before: _State | None = None
    now = problem.untouched()
    last = -np.inf
    for state in resume:
        before, now = now, _State(**state)
        last = now.indentation
    for indentation in indentations:
        if not (np.isfinite(indentation) and indentation > last):
            before_it = f" (the last was {last:g})" if np.isfinite(last) else ""
            message = f"indentation is {indentation}; allowed: finite and increasing{before_it}"
            raise ContactError(message)
        problem.rtol = rtol
        if pressure_error is not None and indentation > 0:
            least = problem.least_pressure(float(indentation), now)
            problem.rtol = min(rtol, pressure_error * least / problem.expected_stiffness(now, before))
        problem.check_reachable(float(indentation))
        last = float(indentation)
        if indentation <= 0:
            yield problem.record(problem.untouched(indentation), problem.counts(), 0, 0.0)
            continue
        problem.rtol = min(problem.rtol, _LIGHT * last)
        counts = problem.counts()
        after, iterations, residual = solve_one(problem, float(indentation), now, before)
        contact = problem.record(after, counts, iterations, residual, now)
        while pressure_error is not None and contact.mean_pressure_bound > pressure_error:
            problem.rtol = 0.5 * residual * pressure_error / contact.mean_pressure_bound
            problem.check_reachable(last)
            after, more, residual = solve_one(problem, last, after, now)
            iterations += more
            contact = problem.record(after, counts, iterations, residual, now)
        yield contact
        before, now = now, after


class Trials:
    """Contacts of one surface at indentations in any order, each started from two others: what a search is made of.

    Parameters as for `solve` and `sweep`. ``least`` may be set to a contact at a smaller indentation than all others.
    """

    def __init__(
        self,
        surface: Surface,
        half_space: Compliance,
        *,
        rtol: float = 1e-6,
        method: str = "fast",
        pressure_error: float | None = None,
    ) -> None:
        self._problem = _Problem(surface, half_space, rtol)
        self._solve = _method(method)
        self.rtol, self.pressure_error = rtol, pressure_error
        self.least: Contact | None = None
        self.untouched = self._problem.record(self._problem.untouched(), self._problem.counts(), 0, 0.0)

    def at(self, indentation: float, now: Contact, before: Contact | None = None, *, rtol: float = 0.0) -> Contact:
        """Return the contact at an indentation Δ/σ > 0, to the residual of the search or a looser one.

        It is started from the straight line through two contacts, of which `now` has the larger indentation: beyond
        both, as in a sweep, or between them, where the contact set of `now` contains the one looked for.
        """
        problem = self._problem
        problem.rtol = max(self.rtol, rtol)
        problem.check_reachable(indentation)
        problem.rtol = max(self.tolerance(indentation), min(rtol, _LIGHT_ROUGH * indentation))
        counts = problem.counts()
        state, iterations, residual = self._solve(problem, indentation, now._state, before._state if before else None)
        return problem.record(state, counts, iterations, residual)

    def known(self, state: Mapping[str, Any], residual: float) -> Contact:
        """Return a contact that was solved elsewhere, from its `Contact.state`; its arrays are only read."""
        return self._problem.record(_State(**state), self._problem.counts(), 0, residual)

    def tolerance(self, indentation: float) -> float:
        """Return the bound of the residual of a state: that of the search, less at a slight indentation.

        An error of the pressure asked for makes it smaller: it is then the bound for the stiffest contact there is,
        under the pressure of `least` or of the highest element alone.
        """
        bound = min(self.rtol, _LIGHT * indentation)
        if self.pressure_error is not None:
            pressure = self._problem.least_pressure(indentation, (self.least or self.untouched)._state)
            bound = min(bound, self.pressure_error * pressure / self._problem.stiffest)
        return bound

    def line(self, one: Contact, other: Contact) -> Callable[[float, float], Contact]:
        """Return (Δ/σ, less) ↦ the contact that the straight line through two others has at Δ; nothing is solved.

        The line is that of x = c q in contact and -w outside, with 1/c = (K⁻¹)_ii the stiffness of an element whose
        neighbours hold still. Where K⁻¹ is an M-matrix every x is a rising, concave function of Δ: between the two
        contacts the line has too little contact and pressure, beyond them too much. The x of a contact of residual η/σ
        is right to 2 η/σ; `less` is taken off all of them.
        """
        problem = self._problem
        start = problem.depth(one)
        rate = np.zeros_like(start)
        if other.indentation != one.indentation:
            rate = (problem.depth(other) - start) / (other.indentation - one.indentation)

        def at(indentation: float, less: float) -> Contact:
            x = start + (indentation - one.indentation) * rate - less
            elements = np.flatnonzero(x > 0.0)
            gap = np.maximum(-x, _TENSILE * max(1.0, indentation))
            state = _State(indentation, elements, x[elements] / problem.firmness, gap + indentation)
            return problem.record(state, problem.counts(), 0, np.nan)

        return at


PRECISIONS = ("mixed", "double")


def _method(name: str) -> _Method:
    if name not in METHODS:
        message = f"method is {name!r}; allowed: {', '.join(METHODS)}"
        raise ContactError(message)
    return METHODS[name]


class _Problem:
    """One surface on one half space, scaled; knows how to convolve, verify and record, not how to iterate."""

    def __init__(self, surface: Surface, half_space: Compliance, rtol: float, precision: str = "mixed") -> None:
        if surface.shape != half_space.shape:
            message = f"the surface has shape {surface.shape}, the half space {half_space.shape}"
            raise ContactError(message)
        if not 0 < rtol <= 1:
            message = f"rtol is {rtol}; allowed: 0 < rtol <= 1 (a bound on the residual η/σ)"
            raise ContactError(message)
        if precision not in PRECISIONS:
            message = f"precision is {precision!r}; allowed: {', '.join(PRECISIONS)}"
            raise ContactError(message)
        self.half_space, self.rtol, self.shape = half_space, rtol, surface.shape
        self._mixed = precision == "mixed"
        self.superposition = Superposition(half_space.influence)
        self._place = np.full(surface.heights.size, -1, dtype=np.int32)  # as `places` leaves it
        # range first, then σ: the standard deviation of 1e-250 heights would underflow
        heights = surface.heights - surface.heights.max()
        height_range = -heights.min()
        heights = heights / (height_range or 1.0)
        self.heights = (heights / (heights.std() or 1.0)).ravel()
        self.mean_height = float(self.heights.mean())

    @property
    def single(self) -> bool:
        """Whether directions are convolved in single precision."""
        return self._mixed and self.rtol >= _SINGLE_DOWN_TO

    def counts(self) -> tuple[float, float]:
        return self.half_space.convolutions, self.half_space.convolutions_fp32

    def check_reachable(self, indentation: float) -> None:
        """Refuse a residual that rounding alone exceeds: w is the difference of two numbers as large as Δ/σ."""
        best = _ROUNDING * max(1.0, indentation)
        if self.rtol < best:
            message = (
                f"rtol is {self.rtol:g} at the indentation {indentation:g}; allowed: at least {best:.1g}, "
                f"the residual η/σ that double precision can reach there"
            )
            raise ContactError(message)

    def places(self, candidates: Index, *others: Index) -> list[NDArray[np.int32]]:
        """Return where other elements stand among the candidates, -1 for those that are none; any order."""
        self._place[candidates] = np.arange(candidates.size, dtype=np.int32)
        found = [self._place.take(elements) for elements in others]
        self._place[candidates] = -1
        return found

    def pressures(self, candidates: Index, *states: _State) -> list[Array]:
        """Return q of the states on the candidates, as far as it is there."""
        spread = []
        for place, state in zip(self.places(candidates, *(s.elements for s in states)), states, strict=True):
            q = np.zeros(candidates.size + 1)  # the last one takes what is elsewhere, at -1
            q[place] = state.pressure
            spread.append(q[:-1])
        return spread

    @cached_property
    def stiffest(self) -> float:
        """Return a bound of dp*/d(Δ/σ): the stiffness of a contact never exceeds that of the whole grid.

        For any positive definite K the stiffness 1ᵀ K_CC⁻¹ 1 grows with the contact set C, and with all pressures of
        the whole, K q = 1, not negative, Σq min(K ∗ 1) ≤ Σq (K ∗ 1) = number of elements.
        """
        return float(np.pi * (self.shape[0] - 1) / self.half_space.total_compliance.min())

    def stiffness_bound(self, state: _State, residual: float, before: _State) -> float:
        """Return a bound of dp*/d(Δ/σ) from a state up to Δ + η, from the state before it.

        The contact at Δ + η lies within S = {q > 0} ∪ {w ≤ 2 η}, and 1ᵀ K_SS⁻¹ 1 ≤ Σs for every s on S with K s ≥ 1
        there: with t = K_SS⁻¹ 1 ≥ 0, Σs = tᵀ K s ≥ Σt. The secant of the pressures has K s = 1 + δw/δΔ; on each element
        where that is less than 1, a pressure of (1 - K s)/K(0, 0) makes up for it. That t ≥ 0 is, like
        F(Δ - η) ≤ F ≤ F(Δ + η), proved for an M-matrix K⁻¹.
        """
        elements, gap = state.within(2.0 * residual)
        brink = np.flatnonzero(gap <= 2.0 * residual)
        elements, gap = elements[brink], gap[brink]
        if self.places(elements, before.elements)[0].min(initial=0) < 0:
            elements = np.union1d(elements, before.elements)
            gap = state.gap(elements)
        short = np.maximum(before.gap(elements) - gap, 0.0).sum()
        force = state.pressure.sum() - before.pressure.sum() + short / self.half_space.influence[0, 0]
        secant = self._starred(force / (state.indentation - before.indentation))
        return secant if secant <= self.stiffest else self.stiffest  # not a number, where a step is lost in rounding

    def expected_stiffness(self, now: _State, before: _State | None) -> float:
        """Return what `stiffness_bound` will be about, at the next step of a sweep."""
        if before is None or not before.pressure.size:
            return self.stiffest
        secant = (now.pressure.sum() - before.pressure.sum()) / (now.indentation - before.indentation)
        return min(self.stiffest, 1.5 * self._starred(secant))

    def _starred(self, force: float) -> float:
        """Return p* of a sum of pressures q."""
        return float(np.pi * (self.shape[0] - 1) * force / self.heights.size)

    @cached_property
    def firmness(self) -> float:
        """Return c, the displacement an element yields per unit of its own pressure while its neighbours hold theirs.

        1/c = (K⁻¹)_ii, by the 24 elements around one; more change the fourth digit.
        """
        row, column = np.indices([min(n, 5) for n in self.shape]).reshape(2, -1)
        near = self.half_space.influence[np.abs(row[:, None] - row), np.abs(column[:, None] - column)]
        return float(0.999 / np.linalg.inv(near).diagonal().max())

    def depth(self, contact: Contact) -> Array:
        """Return x: by how far each element is beyond touching (c q), or short of it (-w)."""
        x = -contact._state.gap()
        x[contact._elements] = self.firmness * contact._pressure
        return x

    def least_pressure(self, indentation: float, now: _State) -> float:
        """Return a lower bound of p* at an indentation: that of the state before, or of the highest element alone."""
        alone = indentation / float(self.half_space.influence[0, 0])
        q = max(float(now.pressure.sum()) if now.pressure.size else 0.0, alone)
        # the pressure of the state before is itself in error by up to a tenth, see `sweep`
        return 0.9 * float(np.pi * (self.shape[0] - 1)) * q / self.heights.size

    def untouched(self, indentation: float = 0.0) -> _State:
        return _State(indentation, np.empty(0, dtype=np.intp), np.empty(0), -self.heights)

    def verified(self, indentation: float, elements: Index, q: Array, step: float) -> tuple[_State, float]:
        """Return the state that these pressures make, by a convolution, and its residual η/σ on the whole grid.

        One pass over the grid finds all that matters here, for the bound of the stiffness and, if it is a step like the
        last, for the next prediction.
        """
        positive = q > 0.0
        elements, q = elements[positive], q[positive]
        state = _State(indentation, elements, q, self.half_space.displacement_above(self.heights, elements, q))
        # where the overlap is not positive the gap is not negative, so its minimum is one over the overlap
        reach = abs(step) * (1.0 + 1e-6)  # the next step may be longer by rounding
        deepest = -float(state.within(reach)[1].min(initial=0.0))
        return state, max(float(np.abs(state.gap(elements)).max(initial=0.0)), deepest)

    def record(
        self,
        state: _State,
        counts: tuple[float, float],
        iterations: int,
        residual: float,
        before: _State | None = None,
    ) -> Contact:
        touching = state.pressure > _TENSILE * state.pressure.max(initial=0.0)
        elements, pressure = state.elements[touching], state.pressure[touching]
        size = self.heights.size
        separation = -self.mean_height - state.indentation
        # mean(u) without a field: Σu = Σ (K ∗ 1) q
        mean_displacement = float(self.half_space.total_compliance.ravel()[elements] @ pressure) / size
        full = elements.size == size
        done = self.counts()
        stiffness = self.stiffness_bound(state, residual, before) if before else self.stiffest
        mean_pressure = float(np.pi * (self.shape[0] - 1) * (pressure.sum() / size))
        nothing = np.inf if state.indentation > 0.0 else 0.0  # no pressure is exact before the touch, unknown after it
        return Contact(
            indentation=state.indentation,
            separation=separation,
            contact_area_fraction=elements.size / size,
            mean_pressure=mean_pressure,
            free_volume=0.0 if full else max(separation + mean_displacement, 0.0),
            iterations=iterations,
            convolutions=done[0] - counts[0],
            convolutions_fp32=done[1] - counts[1],
            residual=residual,
            mean_pressure_bound=stiffness * residual / mean_pressure if mean_pressure > 0.0 else nothing,
            converged=residual <= self.rtol,
            shape=self.shape,
            _elements=elements,
            _pressure=pressure,
            _state=state,
        )


def _solve_fast(problem: _Problem, indentation: float, now: _State, before: _State | None) -> tuple[_State, int, float]:
    """Solve one indentation from the secant through the last two states; see the module's docstring."""
    if before is None:
        now, before = _approach(problem, indentation, now)
    candidates, q, w, rate = _predict(problem, indentation, now, before)
    dense_up_to = _DENSE_UP_TO * max(1.0, problem.heights.size**0.5 / _DENSE_FROM)
    iterations = 0
    for attempt in range(_ROUNDS):
        if candidates.size <= dense_up_to:
            b = problem.heights[candidates] + indentation
            q, steps = _dense_face(problem.half_space.influence, candidates, b), 1
        else:
            q, steps = _conjugate_gradients(problem, candidates, q, w, rate, attempt)
        iterations += steps
        state, residual = problem.verified(indentation, candidates, q, indentation - now.indentation)
        if residual <= problem.rtol:
            return state, iterations, residual
        candidates, w = state.within(0.0)
        again = w < 0.0
        again[problem.places(candidates, state.elements)[0]] = True
        candidates, w = candidates[again], w[again]
        if indentation > now.indentation:
            q, rate = _rates(problem, candidates, state, now)
        else:
            (q,), rate = problem.pressures(candidates, state), None
    message = f"contact not converged to {problem.rtol:g}"
    raise ConvergenceError(message, indentation=indentation, iterations=iterations, residual=residual)


_ROUNDS = 60  # of solve and verify; one is the rule, two after an unlucky prediction


def _approach(problem: _Problem, indentation: float, now: _State) -> tuple[_State, _State | None]:
    """Return two rough states below an indentation whose rigid overlap is too large a set to begin with, if it is.

    The overlap is up to fifty times the contact; states to 10⁻³ on the way keep all vectors, and memory, small.
    """
    stages = [indentation]
    while np.count_nonzero(problem.heights > -stages[-1]) > _COLD_UP_TO:
        stages.append(stages[-1] / _STAGE)
        if len(stages) > 40:  # most of the surface is one plateau: there is no way around it
            return now, None
    wanted, problem.rtol = problem.rtol, max(problem.rtol, 1e-3)
    before: _State | None = None
    for stage in stages[:0:-1]:
        state = _solve_fast(problem, stage, now, before)[0]
        before, now = now, state
    problem.rtol = wanted
    return now, before


_COLD_UP_TO = 20_000  # elements; below, stages take more convolutions than they save on vectors
_STAGE = 1.15


def _predict(
    problem: _Problem, indentation: float, now: _State, before: _State | None
) -> tuple[Index, Array, Array, _Rate | None]:
    """Return the candidates for contact, q and w on them, and the rates there, from the secant through two states."""
    if before is None:
        candidates = np.flatnonzero(problem.heights > -indentation)
        return candidates, np.zeros(candidates.size), -indentation - problem.heights[candidates], None
    step = now.indentation - before.indentation
    theta = (indentation - now.indentation) / step
    # Beyond both states: w + θ (w - w_before) < 0, which no gap larger than the step can be, as none falls faster than
    # the surfaces approach. Between them, as in a search: all that is in contact at the later one.
    candidates, gap = now.within(max(0.0, indentation - now.indentation))
    w = gap + theta * (gap - before.gap(candidates))
    predicted = (w if theta > 0.0 else gap) < 0.0
    predicted[problem.places(candidates, now.elements)[0]] = True
    candidates, w = candidates[predicted], w[predicted]
    q, rate = _rates(problem, candidates, now, before)
    q += (indentation - now.indentation) * rate[0]
    _truncate(problem, candidates, q, w, _REMOVAL * problem.rtol)
    return candidates, q, w, rate


_Rate = tuple[Array, Array]


def _rates(problem: _Problem, candidates: Index, now: _State, before: _State) -> tuple[Array, _Rate]:
    """Return q on the candidates, and pressure and displacement per unit of indentation there, between two states."""
    q, earlier = problem.pressures(candidates, now, before)
    # where contacts are not nested (another kernel than Love's, or elements on the brink) only what is in both counts
    pressure = np.where(q > 0.0, q - earlier, 0.0)
    displacement = now.touch_at[candidates] - before.touch_at[candidates]
    step = now.indentation - before.indentation
    return q, (pressure / step, displacement / step)


def _dense_face(influence: Array, elements: Index, b: Array) -> Array:
    """Solve on few elements by factorisation: tensile ones leave, penetrating ones come back, until neither is left."""
    matrix = influence_matrix(influence, elements)
    q = np.zeros(b.size)
    active = np.ones(b.size, dtype=bool)
    for _ in range(100 + b.size):
        index = np.flatnonzero(active)
        q[:] = 0.0
        if index.size:
            those = matrix if index.size == b.size else matrix[np.ix_(index, index)]
            factor = scipy_linalg.cho_factor(those, lower=True, check_finite=False)
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


def _conjugate_gradients(
    problem: _Problem, elements: Index, q: Array, w: Array, rate: _Rate | None, attempt: int
) -> tuple[Array, int]:
    """Bound-constrained preconditioned conjugate gradients (Polak-Ribière⁺) on the elements; q and w are updated.

    Directions and residuals are of single precision: their errors shrink with them, and what remains is seen by the
    verification, which starts another attempt from the true gap; from the third on all is double precision. The first
    attempt also leaves out the last product with K: lengths of steps hardly change from one to the next, so a last one
    without a line search ends it, and the verification sees whether it did.
    """
    half_space = problem.half_space
    tolerance = _SAFETY * problem.rtol
    error = _REMOVAL * problem.rtol if attempt < 2 else 0.0
    precondition, free = approximate_inverse(half_space.influence, half_space.shape, elements, q, w, rate)
    single = problem.single and attempt < 2
    direction: NDArray[Any] = np.zeros(q.size, dtype=np.float32 if single else np.float64)
    old = direction.copy()
    product = length = 1.0
    balanced = False
    for iteration in range(_ITERATIONS):
        if iteration % 2 == 0 or elements.size > _CUT_ALWAYS_FROM:  # always, on few, costs more than it saves
            _truncate(problem, elements, q, w, error)
        if iteration:
            free = (q != 0.0) | (w < 0.0)
        r = np.negative(w, out=np.empty_like(direction), casting="same_kind")
        r *= free  # much faster than to set some of the numbers to zero
        residual = float(np.abs(r).max())
        if residual <= tolerance:
            if _truncate(problem, elements, q, w, error):
                continue
            return q, iteration
        z = precondition(r, balanced)
        if not balanced and float(r @ z) <= _DESCENT * float((r @ r) * (z @ z)) ** 0.5:
            balanced = True
            z = precondition(r, balanced)
        # an element without pressure that its neighbours will lift clear (z < 0) is left alone, not made tensile first
        z *= free & ((q > 0.0) | (z >= 0.0))
        last, product = product, float(r @ z)
        direction *= max(0.0, (product - float(old @ z)) / last)
        direction += z
        direction *= free
        if residual <= _LAST * tolerance and iteration and length > _WELL_PRECONDITIONED and attempt == 0:
            return np.maximum(q + length * direction, 0.0), iteration
        old = r
        response = half_space.displacement_at(elements, direction, single=single)
        length = float(r @ direction) / float(direction @ response)
        q += length * direction
        w += length * response
    return np.maximum(q, 0.0), _ITERATIONS


_SINGLE_DOWN_TO = 2e-9  # η/σ; below, what 32 bits leave takes more further attempts than they save (`make tradeoff`)
_SAFETY = 0.7  # share of the tolerance left to the recursive residual; the verification finds a little more
_LAST = 3.0  # what a step of the length of the one before takes off the residual of a rough contact
_WELL_PRECONDITIONED = 0.3  # a length, below which the next may be anything: the first steps on compact contacts
_DESCENT = 0.2  # cosine between r and M⁻¹ r below which M⁻¹ is balanced: the states before are rough, and so is t
_ITERATIONS = 2000
_CUT_ALWAYS_FROM = 100_000  # elements, from which on negative pressures are cut in every iteration
# share of the tolerance that the displacement by one removed pressure may be wrong by; should those of many add up, the
# verification sees it, and from the third attempt on nothing is summed with such an error
_REMOVAL = 0.1


def _truncate(problem: _Problem, elements: Index, q: Array, w: Array, error: float) -> bool:
    """Set negative pressures to zero and take their share out of the gap; say whether there were any.

    Where they are few this takes less than a convolution. The error is what one of them may cause in the gap.
    """
    if not q.min(initial=0.0) < 0.0:  # in this form also where they are no numbers
        return False
    negative = np.flatnonzero(q < 0.0)
    displacement = problem.superposition.displacement(
        elements, negative, q[negative], single=problem.single, error=error
    )
    if displacement is None:
        removed = np.zeros_like(q)
        removed[negative] = q[negative]
        displacement = problem.half_space.displacement_at(elements, removed, single=problem.single)
    w -= displacement
    q[negative] = 0.0
    return True


def _solve_paper(
    problem: _Problem, indentation: float, now: _State, before: _State | None
) -> tuple[_State, int, float]:
    """Solve by the paper's Algorithm 1: from the rigid overlap, removal of tensile elements, Gauss-Seidel inside.

    A reference for small grids: the matrix is dense, every indentation starts anew, and an element that has left does
    not come back (for the Love kernel none has to).
    """
    if max(problem.shape) > _PAPER_UP_TO:
        message = (
            f"method 'paper' takes grids up to {_PAPER_UP_TO} × {_PAPER_UP_TO} (m = 6); this one is {problem.shape}"
        )
        raise ContactError(message)
    elements = np.flatnonzero(problem.heights > -indentation)
    sweeps = 0
    while True:
        matrix = influence_matrix(problem.half_space.influence, elements)
        lower = np.tril(matrix)
        upper = np.triu(matrix, 1)
        b = problem.heights[elements] + indentation
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
    state, residual = problem.verified(indentation, elements, p, indentation - now.indentation)
    if residual > problem.rtol:
        message = f"Algorithm 1 not converged to {problem.rtol:g}"
        raise ConvergenceError(message, indentation=indentation, iterations=sweeps, residual=residual)
    return state, sweeps, residual


_PAPER_UP_TO = 65

_Method = Callable[[_Problem, float, _State, "_State | None"], tuple[_State, int, float]]
METHODS: dict[str, _Method] = {"fast": _solve_fast, "paper": _solve_paper}
