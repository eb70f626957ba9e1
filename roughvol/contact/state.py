"""States of contact: the solved state that a sweep goes on from, and the record of it that a caller keeps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from roughvol.typing import Array, Index, Mask


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
    _state: State = field(repr=False)

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

    def contact(self) -> Mask:
        """Return the mask of the elements in contact, p > 0."""
        mask = np.zeros(self.shape, dtype=bool)
        mask.flat[self._elements] = True
        return mask

    def state(self) -> dict[str, Any]:
        """Return what `sweep` needs to go on from here (``resume``), as plain numbers and arrays."""
        return {name: getattr(self._state, name) for name in ("indentation", "elements", "pressure", "touch_at")}


@dataclass
class State:
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
