"""The scaled contact problem: it convolves, verifies and records. It does not iterate."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from roughvol.contact.few_loads import Superposition
from roughvol.contact.state import Compliance, Contact, State
from roughvol.contact.tuning import TUNING, Tuning
from roughvol.errors import ContactError
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array, Index

PRECISIONS = ("mixed", "double")
ROUNDING = 4e-16  # no residual η/σ below this share of the indentation survives the rounding of a convolution
TENSILE = 1e-12  # a share of the largest pressure that counts as rounding, not as tension or contact
# Largest residual over the indentation. A state without any pressure has η = Δ; with η ≤ Δ/100 the highest element
# carries load, as F ≥ F(Δ - η) > 0, and p* is right to a few percent however loose the tolerance is.
LIGHT = 0.01
LIGHT_ROUGH = 0.5  # the same on the way of a search


def check_rtol(rtol: float) -> None:
    """Refuse a tolerance out of range."""
    if not 0 < rtol <= 1:
        message = f"rtol is {rtol}; allowed: 0 < rtol <= 1 (a bound on the residual η/σ)"
        raise ContactError(message)


class Problem:
    """One surface on one half space, scaled."""

    def __init__(
        self, surface: Surface, half_space: Compliance, precision: str = "mixed", tuning: Tuning = TUNING
    ) -> None:
        if surface.shape != half_space.shape:
            message = f"the surface has shape {surface.shape}, the half space {half_space.shape}"
            raise ContactError(message)
        if precision not in PRECISIONS:
            message = f"precision is {precision!r}; allowed: {', '.join(PRECISIONS)}"
            raise ContactError(message)
        self.half_space, self.shape, self.tuning = half_space, surface.shape, tuning
        self._mixed = precision == "mixed"
        self.superposition = Superposition(half_space.influence, tuning.sum_terms)
        self._place = np.full(surface.heights.size, -1, dtype=np.int32)  # as `places` leaves it
        # range first, then σ: the standard deviation of 1e-250 heights would underflow
        heights = surface.heights - surface.heights.max()
        height_range = -heights.min()
        heights = heights / (height_range or 1.0)
        self.heights = (heights / (heights.std() or 1.0)).ravel()
        self.mean_height = float(self.heights.mean())

    def single(self, rtol: float) -> bool:
        """Return whether directions are convolved in single precision."""
        return self._mixed and rtol >= self.tuning.single_from

    def counts(self) -> tuple[float, float]:
        """Return the convolutions done so far, by precision."""
        return self.half_space.convolutions, self.half_space.convolutions_fp32

    def check_reachable(self, indentation: float, rtol: float) -> None:
        """Refuse a residual that rounding alone exceeds: w is the difference of two numbers as large as Δ/σ."""
        best = ROUNDING * max(1.0, indentation)
        if rtol < best:
            message = (
                f"rtol is {rtol:g} at the indentation {indentation:g}; allowed: at least {best:.1g}, "
                f"the residual η/σ that double precision can reach there"
            )
            raise ContactError(message)

    def places(self, candidates: Index, *others: Index) -> list[NDArray[np.int32]]:
        """Return where other elements stand among the candidates, -1 for those that are none; any order."""
        self._place[candidates] = np.arange(candidates.size, dtype=np.int32)
        found = [self._place.take(elements) for elements in others]
        self._place[candidates] = -1
        return found

    def pressures(self, candidates: Index, *states: State) -> list[Array]:
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

    def stiffness_bound(self, state: State, residual: float, before: State) -> float:
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

    def expected_stiffness(self, now: State, before: State | None) -> float:
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

    def least_pressure(self, indentation: float, now: State) -> float:
        """Return a lower bound of p* at an indentation: that of the state before, or of the highest element alone."""
        alone = indentation / float(self.half_space.influence[0, 0])
        q = max(float(now.pressure.sum()) if now.pressure.size else 0.0, alone)
        # the pressure of the state before is itself in error by up to a tenth, see `sweep`
        return 0.9 * float(np.pi * (self.shape[0] - 1)) * q / self.heights.size

    def untouched(self, indentation: float = 0.0) -> State:
        """Return the state without contact."""
        return State(indentation, np.empty(0, dtype=np.intp), np.empty(0), -self.heights)

    def verified(self, indentation: float, elements: Index, q: Array, step: float) -> tuple[State, float]:
        """Return the state that these pressures make, by a convolution, and its residual η/σ on the whole grid.

        One pass over the grid finds all that matters here, for the bound of the stiffness and, if it is a step like the
        last, for the next prediction.
        """
        positive = q > 0.0
        elements, q = elements[positive], q[positive]
        state = State(indentation, elements, q, self.half_space.displacement_above(self.heights, elements, q))
        # where the overlap is not positive the gap is not negative, so its minimum is one over the overlap
        reach = abs(step) * (1.0 + 1e-6)  # the next step may be longer by rounding
        deepest = -float(state.within(reach)[1].min(initial=0.0))
        return state, max(float(np.abs(state.gap(elements)).max(initial=0.0)), deepest)

    def record(
        self,
        state: State,
        counts: tuple[float, float],
        iterations: int,
        residual: float,
        before: State | None = None,
    ) -> Contact:
        """Return the record of a state that a solve verified, with the counts since `counts`.

        The residual is not a number where nothing was solved; such a record has not converged.
        """
        touching = state.pressure > TENSILE * state.pressure.max(initial=0.0)
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
            converged=bool(np.isfinite(residual)),
            shape=self.shape,
            _elements=elements,
            _pressure=pressure,
            _state=state,
        )
