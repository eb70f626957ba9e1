"""The scaled contact problem: convolution, verification and record of a state, without any iteration.

The overlap that the law leaves on elements at its limit is a plastic displacement of the surface, ≥ 0, that stays. All
states of a leg have the heights of its start.

Symbols and equations are those of docs/explanation/solver.md.
"""

from __future__ import annotations

import copy
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from roughvol.contact.convolution import Superposition
from roughvol.contact.law import ELASTIC, Wall
from roughvol.contact.options import DEFAULT, Options
from roughvol.contact.state import Compliance, Contact, Leg, State
from roughvol.errors import ContactError
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array, Index

ROUNDING = 4e-16  # least residual η/σ over the indentation: the rounding of a convolution
TENSILE = 1e-12  # largest pressure that counts as rounding, as a share of the largest pressure of the state
# Largest residual over the indentation. A state without pressure has η = Δ. With η ≤ Δ/100 the highest element carries
# load, as F ≥ F(Δ - η) > 0, and p* is right to a few per cent at any tolerance.
LIGHT = 0.01
LIGHT_ROUGH = 0.5  # the same for rough states of a search


class Problem:
    """One surface on one half space, scaled: heights h = (z - z_max)/σ, pressures q = p δ/(π E* σ).

    `heights` (nodes,) are flat, less the plastic displacement at the start of the `leg`.
    """

    def __init__(self, surface: Surface, half_space: Compliance, options: Options = DEFAULT) -> None:
        if not isinstance(surface, Surface):
            raise ContactError(f"the surface is of the type {type(surface).__name__}; allowed: a Surface")
        if surface.shape != half_space.shape:
            raise ContactError(f"the surface has shape {surface.shape}, the half space {half_space.shape}")
        if surface.sides != half_space.sides:
            message = f"the surface is {surface.sides}, the half space {half_space.sides}; allowed: the same sides"
            raise ContactError(message)
        self.half_space, self.shape, self.options, self.tuning = half_space, surface.shape, options, options.tuning
        self.intervals, self.sides = surface.intervals[0], surface.sides
        hardness = options.hardness
        self.law = ELASTIC if hardness is None else Wall(hardness / (np.pi * self.intervals))
        self.leg = Leg(self.law)
        self.superposition = Superposition(half_space.influence, self.tuning, mirrored=surface.sides == "mirrored")
        self._position = np.full(surface.heights.size, -1, dtype=np.int32)  # restored by `positions`
        # The range first, then σ: the standard deviation of heights of 1e-250 underflows.
        heights = surface.heights - surface.heights.max()
        height_range = -heights.min()
        heights = heights / (height_range or 1.0)
        self.heights = self._virgin = (heights / (heights.std() or 1.0)).ravel()
        self.mean_height = float(self.heights.mean())

    @cached_property
    def touch(self) -> float:
        """Δ/σ at the first touch: 0 before any plastic displacement."""
        return 0.0 - float(self.heights.max())

    def on(self, leg: Leg) -> Problem:
        """Return the problem on the virgin surface less the plastic displacement of a leg."""
        problem = copy.copy(self)
        problem.__dict__.pop("touch", None)
        problem.leg, problem.heights = leg, self._virgin if leg.plastic is None else self._virgin - leg.plastic
        return problem

    def lowered(self, depth: Array) -> Problem:
        """Return the problem on a surface whose elements lie lower by a depth over σ (nodes,), σ as it is."""
        problem = copy.copy(self)
        problem.__dict__.pop("touch", None)
        heights = self._virgin - depth
        problem.heights = problem._virgin = heights - heights.max()
        problem.mean_height = float(problem.heights.mean())
        return problem

    def moved(self, state: State, before: Problem) -> State:
        """Return a state of the problem before with its gaps to the heights of this one."""
        touch_at = state.touch_at + (before.heights - self.heights)
        return State(state.indentation, state.elements, state.pressure, touch_at)

    def rebound(self, before: State, state: State) -> float:
        """Return the largest fall of an overlap at the limit from one state to a later one: none for an M-matrix."""
        if not self.law.yields:
            return 0.0
        yielded, overlap = self.leg.overlap(before)
        (q,) = self.pressures(yielded, state)
        left = np.where(self.law.held(q), np.maximum(-state.gap(yielded), 0.0), 0.0)
        return float((overlap - left).max(initial=0.0))

    def single(self, rtol: float) -> bool:
        """Return whether directions are convolved in single precision."""
        return self.options.precision == "mixed" and rtol >= self.tuning.single_from

    def counts(self) -> tuple[float, float]:
        """Return the convolutions done so far, by precision."""
        return self.half_space.convolutions, self.half_space.convolutions_fp32

    def check_reachable(self, indentation: float, rtol: float) -> None:
        """Refuse a residual below rounding: w is the difference of two numbers as large as Δ/σ."""
        best = ROUNDING * max(1.0, indentation)
        if rtol < best:
            allowed = f"at least {best:.1g}, the residual η/σ that double precision can reach there"
            raise ContactError(f"rtol is {rtol:g} at the indentation {indentation:g}; allowed: {allowed}")

    def positions(self, candidates: Index, *others: Index) -> list[NDArray[np.int32]]:
        """Return the positions of other elements among the candidates; -1 for elements outside."""
        self._position[candidates] = np.arange(candidates.size, dtype=np.int32)
        positions = [self._position.take(elements) for elements in others]
        self._position[candidates] = -1
        return positions

    def pressures(self, candidates: Index, *states: State) -> list[Array]:
        """Return q of each state on the candidates."""
        pressures = []
        for position, state in zip(self.positions(candidates, *(s.elements for s in states)), states, strict=True):
            q = np.zeros(candidates.size + 1)  # the last one takes the pressure elsewhere, at -1
            q[position] = state.pressure
            pressures.append(q[:-1])
        return pressures

    @cached_property
    def stiffest(self) -> float:
        """Bound of dp*/d(Δ/σ) for every contact: that of the whole grid.

        For any positive definite K the stiffness 1ᵀ K_CC⁻¹ 1 grows with the contact set C. The whole grid has
        pressures K q = 1. If none is negative, Σq min(K ∗ 1) ≤ Σq (K ∗ 1) = number of elements.
        """
        return float(np.pi * self.intervals / self.half_space.total_compliance.min())

    def stiffness_bound(self, state: State, residual: float, previous: State) -> float:
        """Return a bound of dp*/d(Δ/σ) from a state up to Δ + η, by the secant from the previous state.

        The contact at Δ + η lies within S = {q > 0} ∪ {w ≤ 2 η}. Let t = K_SS⁻¹ 1 ≥ 0, which holds for an M-matrix
        K⁻¹. Every s on S with K s ≥ 1 there has Σs = tᵀ K s ≥ Σt, the stiffness. The secant of the pressures has
        K s = 1 + δw/δΔ. Where this is below 1, a pressure of (1 - K s)/K(0, 0) is added.
        """
        elements, gap = state.within(2.0 * residual)
        brink = gap <= 2.0 * residual
        if self.law.yields:  # no stiffness left at the limit
            brink[self.positions(elements, self.leg.overlap(state)[0])[0]] = False
        elements, gap = elements[brink], gap[brink]
        if self.positions(elements, previous.elements)[0].min(initial=0) < 0:
            elements = np.union1d(elements, previous.elements)
            gap = state.gap(elements)
        advance = state.indentation - previous.indentation
        short = np.maximum(np.copysign(1.0, advance) * (previous.gap(elements) - gap), 0.0).sum()
        force = abs(state.pressure.sum() - previous.pressure.sum()) + short / self.half_space.influence[0, 0]
        secant = self._starred(force / abs(advance))
        return secant if secant <= self.stiffest else self.stiffest  # also where it is NaN: a step lost in rounding

    def expected_stiffness(self, latest: State, previous: State | None) -> float:
        """Return an estimate of `stiffness_bound` at the next step of a sweep."""
        if previous is None or not previous.pressure.size:
            return self.stiffest
        secant = (latest.pressure.sum() - previous.pressure.sum()) / (latest.indentation - previous.indentation)
        return min(self.stiffest, 1.5 * self._starred(secant))

    def _starred(self, force: float) -> float:
        """Return p* of a sum of pressures q."""
        return float(np.pi * self.intervals * force / self.heights.size)

    @cached_property
    def firmness(self) -> float:
        """Displacement c of an element per unit of its own pressure, at fixed displacements around it; 1/c = (K⁻¹)_ii.

        From the 24 elements around one. More elements change the fourth digit, hence 0.999.
        """
        row, column = np.indices([min(n, 5) for n in self.shape]).reshape(2, -1)
        near = self.half_space.influence[np.abs(row[:, None] - row), np.abs(column[:, None] - column)]
        return float(0.999 / np.linalg.inv(near).diagonal().max())

    def depth(self, contact: Contact) -> Array:
        """Return x on every element, flat: c q in contact, -w elsewhere; c q - w at the limit of the law."""
        x = -contact._state.gap()
        overlap = np.where(self.law.held(contact._pressure), x[contact._elements], 0.0)
        x[contact._elements] = self.firmness * contact._pressure + overlap
        return x

    def least_pressure(self, indentation: float, latest: State) -> float:
        """Return a lower bound of p* at an indentation: that of the latest state, or of the highest element alone."""
        largest = float(self.half_space.between(np.zeros(1, dtype=np.intp))[0, 0])  # at a corner, near its images
        alone = min((indentation - self.touch) / largest, self.law.limit)
        rising = latest.pressure.size and indentation >= latest.indentation
        q = max(float(latest.pressure.sum()) if rising else 0.0, alone)
        # the pressure of the latest state has an error of up to a tenth, see `sweep`
        return 0.9 * float(np.pi * self.intervals) * q / self.heights.size

    def untouched(self, indentation: float = 0.0) -> State:
        """Return the state without contact."""
        return State(indentation, np.empty(0, dtype=np.intp), np.empty(0), -self.heights)

    def verified(self, indentation: float, elements: Index, q: Array, next_advance: float) -> State:
        """Return the state under given pressures, by one convolution, with its residual η/σ on the whole grid (2).

        The pass over the grid also serves the bound of the stiffness, and a next prediction up to `next_advance`.
        """
        positive = q > 0.0
        elements, q = elements[positive], q[positive]
        state = State(indentation, elements, q, self.half_space.displacement_above(self.heights, elements, q))
        # w < 0 only where b > 0, as K is positive
        reach = abs(next_advance) * (1.0 + 1e-6)  # the next one may be larger by rounding
        near, gap = state.within(reach)
        loaded = self.law.residual(q, state.gap(elements))
        if self.law.yields:
            gap = gap.copy()
            gap[self.positions(near, elements)[0]] = loaded
        state.residual = max(float(np.abs(loaded).max(initial=0.0)), -float(gap.min(initial=0.0)))
        return state

    def record(self, state: State, counts: tuple[float, float] | None = None, previous: State | None = None) -> Contact:
        """Return the record of a state, with the convolutions since `counts` (default: none) and a bound of p*."""
        touching = state.pressure > TENSILE * state.pressure.max(initial=0.0)
        elements, pressure = state.elements, state.pressure
        if not touching.all():
            elements, pressure = elements[touching], pressure[touching]
        size = self.heights.size
        separation = -self.mean_height - state.indentation
        # mean(u) without a field: Σu = Σ (K ∗ 1) q
        mean_displacement = float(self.half_space.total_compliance.take(elements) @ pressure) / size
        full = elements.size == size
        done = self.counts()
        begun = done if counts is None else counts
        residual = state.residual + self.leg.carried
        stiffness = self.stiffness_bound(state, residual, previous) if previous else self.stiffest
        mean_pressure = float(np.pi * self.intervals * (pressure.sum() / size))
        unloaded = np.inf if state.indentation > self.touch else 0.0  # p* = 0 is exact before the touch alone
        plastic_volume, plastic_area = self.leg.yielded(state)
        free_volume = 0.0 if full else max(separation + mean_displacement + plastic_volume, 0.0)
        indentation = state.indentation
        if self.sides != "free" and state.pressure.size:  # displacements have no mean there
            separation = free_volume - plastic_volume
            indentation = -self.mean_height - separation
        return Contact(
            indentation=indentation,
            separation=separation,
            contact_area_fraction=elements.size / size,
            mean_pressure=mean_pressure,
            free_volume=free_volume,
            approach=state.indentation,
            iterations=state.iterations,
            convolutions=done[0] - begun[0],
            convolutions_fp32=done[1] - begun[1],
            residual=residual,
            mean_pressure_bound=stiffness * residual / mean_pressure if mean_pressure > 0.0 else unloaded,
            shape=self.shape,
            plastic_volume=plastic_volume,
            plastic_area_fraction=plastic_area,
            _elements=elements,
            _pressure=pressure,
            _state=state,
            _leg=self.leg,
            _intervals=self.intervals,
            sides=self.sides,
        )
