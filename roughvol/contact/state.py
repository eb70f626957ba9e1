"""States of contact: the solved state that a sweep goes on from, and the record of it that a caller keeps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from roughvol.contact.kernels import Kernel
from roughvol.contact.law import ELASTIC, Wall
from roughvol.spellings import arguments
from roughvol.surfaces.surface import Sided
from roughvol.typing import Array, Index, Mask, Sides


class Compliance(Protocol):
    """The half space as the solver sees it, with the attributes of `HalfSpace`. A dense matrix can replace the FFT."""

    sides: Sides
    shape: tuple[int, int]
    kernel: Kernel
    influence: Array
    convolutions: float
    convolutions_fp32: float

    def between(self, elements: Index) -> Array:
        """Return the matrix K (n, n) between elements, by their flat indices."""

    def displacement_above(self, heights: Array, elements: Index, pressure: NDArray[Any]) -> Array:
        """Return u - heights on every element, flat, for pressure on some elements in increasing order."""

    def displacement_at(self, elements: Index, pressure: NDArray[Any], *, single: bool = False) -> NDArray[Any]:
        """Return u on the elements that carry the pressure."""

    @property
    def total_compliance(self) -> Array:
        """Displacement under unit pressure everywhere."""


@arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Contact(Sided):
    """One equilibrium state. Numbers have no unit (starred). Arrays are made on demand and belong to the caller.

    Attributes
    ----------
    indentation : float
        Δ/σ. On an endless surface that of the mean planes, (z_max - mean(z) - d)/σ: at most z_max - mean(z).
    separation : float
        d/σ = (z_max - mean(z) - Δ)/σ, rigid and far-field. On an endless surface the mean gap, less the plastic volume.
    approach : float
        Δ'/σ, the number that `sweep` takes: Δ/σ. On an endless surface (Δ + mean(u))/σ, see `kernels`.
    contact_area_fraction : float
        A*, elements with p > 0 over all elements.
    mean_pressure : float
        p* = mean(p) L/(E* σ), L the length of the first axis.
    free_volume : float
        V* = mean(g)/σ.
    iterations : int
        Iterations of the solve; a factorisation counts as one.
    convolutions, convolutions_fp32 : float
        Convolutions of the solve, verification included, by precision. Unit: one on the full grid. A convolution over
        a part of the grid counts by its share.
    residual : float
        η/σ, equation (2) of solver.md; a bound of the error of the free volume. NaN in a state not solved. On a
        surface that has yielded before, the residuals of the states that left it are added.
    mean_pressure_bound : float
        Bound of the relative error of p*: the residual times a bound of the stiffness. Infinite without any pressure
        after the touch.
    shape : (int, int)
        Rows and columns of the grid.
    plastic_volume : float
        Mean plastic displacement over σ, ≥ 0; 0 in elastic contact.
    plastic_area_fraction : float
        Elements that have yielded, now or before, over all elements.
    sides : {"free", "mirrored", "periodic"}
        What follows beyond the sides of the surface.

    See Also
    --------
    roughvol.contact.solve : Returns the contact at one indentation.

    Examples
    --------
    >>> from roughvol.contact import HalfSpace, solve
    >>> from roughvol.surfaces import random_midpoint_displacement
    >>> surface = random_midpoint_displacement(2.3, 4, seed=1)
    >>> contact = solve(surface, HalfSpace(surface.shape), indentation=1.0)
    >>> round(float(contact.gap().mean()) / contact.free_volume, 6), contact.converged
    (1.0, True)
    """

    indentation: float
    separation: float
    contact_area_fraction: float
    mean_pressure: float
    free_volume: float
    approach: float
    iterations: int
    convolutions: float
    convolutions_fp32: float
    residual: float
    mean_pressure_bound: float
    shape: tuple[int, int]
    plastic_volume: float
    plastic_area_fraction: float
    _elements: Index = field(repr=False)
    _pressure: Array = field(repr=False)  # q on the elements
    _state: State = field(repr=False)
    _leg: Leg = field(repr=False)
    _intervals: int = field(repr=False)
    sides: Sides = "free"

    @property
    def converged(self) -> bool:
        """Whether the state was solved: its residual is below the tolerance, and below Δ/(100 σ)."""
        return bool(np.isfinite(self.residual))

    def pressure(self) -> Array:
        """Return the pressure p L/(E* σ) ≥ 0, shape of the surface."""
        pressure = np.zeros(math.prod(self.shape))
        pressure[self._elements] = np.pi * self._intervals * self._pressure
        return pressure.reshape(self.shape)

    def gap(self) -> Array:
        """Return the gap g/σ ≥ 0, shape of the surface; exactly 0 in contact."""
        gap = self._state.gap()
        np.maximum(gap, 0.0, out=gap)
        gap[self._elements] = 0.0
        return gap.reshape(self.shape)

    def contact(self) -> Mask:
        """Return the mask of the elements in contact, p > 0."""
        mask = np.zeros(math.prod(self.shape), dtype=bool)
        mask[self._elements] = True
        return mask.reshape(self.shape)

    def void(self) -> Mask:
        """Return the mask of the elements with a gap, g > 0."""
        mask = self._state.void()
        mask[self._elements] = False
        return mask.reshape(self.shape)

    def state(self) -> dict[str, Any]:
        """Return the numbers and arrays from which `sweep` goes on (``resume``)."""
        state = {name: getattr(self._state, name) for name in ("indentation", "elements", "pressure", "touch_at")}
        if not self._leg.law.yields:
            return state
        return state | {"plastic": self._leg.plastic, "carried": self._leg.carried, "residual": self.residual}

    def yielded(self) -> Mask:
        """Return the mask of the elements that have yielded, now or before."""
        plastic = self._leg.plastic
        mask = np.zeros(self.shape, dtype=bool) if plastic is None else plastic.reshape(self.shape) > 0.0
        mask.flat[self._leg.overlap(self._state)[0]] = True
        return mask

    def plastic_displacement(self) -> Array:
        """Return the plastic displacement over σ ≥ 0, shape of the surface: its depth below the virgin heights."""
        plastic = self._leg.plastic_under(self._state)
        return np.zeros(self.shape) if plastic is None else plastic.reshape(self.shape).copy()


@dataclass(frozen=True, eq=False)
class Leg:
    """What a leg of a path begins with: the law, the plastic displacement over σ (nodes,), and a bound of its error."""

    law: Wall = ELASTIC
    plastic: Array | None = None
    carried: float = 0.0

    def after(self, state: State, error: float) -> Leg:
        """Return the leg that begins at a state of this one, with a bound of the error of its plastic displacement."""
        return Leg(self.law, self.plastic_under(state), error)

    def overlap(self, state: State) -> tuple[Index, Array]:
        """Return the elements at the limit of a state, and their overlaps ≥ 0."""
        elements = state.elements[self.law.held(state.pressure)]
        return elements, np.maximum(-state.gap(elements), 0.0)

    def plastic_under(self, state: State) -> Array | None:
        """Return the plastic displacement under a state: that of the leg, and the overlaps of elements at the limit."""
        elements, overlap = self.overlap(state)
        if not elements.size:
            return self.plastic
        plastic = np.zeros(state.touch_at.size) if self.plastic is None else self.plastic.copy()
        plastic[elements] += overlap
        return plastic

    def yielded(self, state: State) -> tuple[float, float]:
        """Return the mean plastic displacement under a state, and the share of elements that have yielded."""
        if not self.law.yields:
            return 0.0, 0.0
        before = np.zeros(state.touch_at.size) if self.plastic is None else self.plastic
        elements, overlap = self.overlap(state)
        area = np.count_nonzero(before) + np.count_nonzero(before[elements] == 0.0)
        return float(before.sum() + overlap.sum()) / before.size, area / before.size


@dataclass
class State:
    """A solved indentation Δ/σ in scaled variables: the start of the next one.

    `pressure` is q on the `elements` with q > 0 (flat, increasing). `touch_at` is u - h on the whole grid, flat: the
    indentation at which an element touches if u stays. The residual η/σ is that of this state alone; NaN if not solved.
    """

    indentation: float
    elements: Index
    pressure: Array
    touch_at: Array
    residual: float = 0.0
    iterations: int = 0
    _near: tuple[float, Index, Array] | None = None

    def gap(self, elements: Index | None = None) -> Array:
        """Return w, on the whole grid or on some elements of it."""
        return (self.touch_at if elements is None else self.touch_at[elements]) - self.indentation

    def void(self) -> Mask:
        """Return where w > 0 on the whole grid, without the field w."""
        return self.touch_at > self.indentation

    def within(self, reach: float) -> tuple[Index, Array]:
        """Return all elements with w < reach or q > 0, in increasing order, and their w.

        The result of one pass over the grid is kept until `forget`. A shorter reach gets the same elements.
        """
        if self._near is None or self._near[0] < reach:
            near = self.touch_at < self.indentation + reach
            near[self.elements] = True
            elements = np.flatnonzero(near)
            self._near = reach, elements, self.gap(elements)
        return self._near[1:]

    def forget(self) -> None:
        """Free the memory of what `within` has kept."""
        self._near = None


class Estimated(State):
    """A state that is not solved, from x on the whole grid: q > 0 where x > 0, and elsewhere w = -x or `least`."""

    def __init__(self, indentation: float, elements: Index, pressure: Array, x: Array, least: float) -> None:
        self.indentation, self.elements, self.pressure = indentation, elements, pressure
        self.residual, self._x, self._least = np.nan, x, least

    @cached_property
    def touch_at(self) -> Array:  # type: ignore[override]
        """Return u - h on the whole grid, made where it is asked for."""
        touch_at = np.maximum(-self._x, self._least)
        touch_at += self.indentation
        return touch_at

    def void(self) -> Mask:
        """Return where w > 0: where q is not."""
        return np.ones(self._x.size, dtype=bool)
