"""States of contact: the solved state that a sweep goes on from, and the record of it that a caller keeps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from roughvol.typing import Array, Index, Mask


class Compliance(Protocol):
    """The half space as the solver sees it. A dense matrix can replace the FFT.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of the grid.
    influence : array (rows, columns)
        K(i, j) of the non-negative offsets, in units δ/(π E*).
    convolutions, convolutions_fp32 : float
        Convolutions so far, by precision, in units of one on the full grid.
    """

    shape: tuple[int, int]
    influence: Array
    convolutions: float
    convolutions_fp32: float

    def displacement_above(self, heights: Array, elements: Index, pressure: NDArray[Any]) -> Array:
        """Return u - heights on every element, flat, for pressure on some elements in increasing order."""
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
    """One equilibrium state. Numbers have no unit (starred). Arrays are made on demand and belong to the caller.

    Attributes
    ----------
    indentation : float
        Δ/σ.
    separation : float
        d/σ = (z_max - mean(z) - Δ)/σ, rigid and far-field.
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
        η/σ, equation (2) of docs/solver.md; a bound of the error of the free volume. NaN in a state not solved.
    mean_pressure_bound : float
        Bound of the relative error of p*: the residual times a bound of the stiffness. Infinite without any pressure
        after the touch.
    converged : bool
        The residual is below the tolerance, and below Δ/(100 σ).
    shape : (int, int)
        Rows and columns of the grid.
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
        """Return the pressure p L/(E* σ) ≥ 0, shape of the surface."""
        pressure = np.zeros(self.shape)
        pressure.flat[self._elements] = np.pi * (self.shape[0] - 1) * self._pressure
        return pressure

    def gap(self) -> Array:
        """Return the gap g/σ ≥ 0, shape of the surface; exactly 0 in contact."""
        gap = np.maximum(self._state.gap(), 0.0)
        gap[self._elements] = 0.0
        return gap.reshape(self.shape)

    def contact(self) -> Mask:
        """Return the mask of the elements in contact, p > 0."""
        mask = np.zeros(self.shape, dtype=bool)
        mask.flat[self._elements] = True
        return mask

    def state(self) -> dict[str, Any]:
        """Return the numbers and arrays from which `sweep` goes on (``resume``)."""
        return {name: getattr(self._state, name) for name in ("indentation", "elements", "pressure", "touch_at")}


@dataclass
class State:
    """A solved indentation in scaled variables: the start of the next one.

    Attributes
    ----------
    indentation : float
        Δ/σ.
    elements : array (n,)
        Flat indices where q > 0, increasing.
    pressure : array (n,)
        q there.
    touch_at : array (nodes,)
        u - h on the whole grid, flat: the indentation at which an element touches if u stays.
    """

    indentation: float
    elements: Index
    pressure: Array
    touch_at: Array
    _near: tuple[float, Index, Array] | None = None

    def gap(self, elements: Index | None = None) -> Array:
        """Return w, on the whole grid or on some elements of it."""
        return (self.touch_at if elements is None else self.touch_at[elements]) - self.indentation

    def within(self, reach: float) -> tuple[Index, Array]:
        """Return all elements with w < reach or q > 0, in increasing order, and their w.

        The result of one pass over the grid is kept. A shorter reach gets the same elements.
        """
        if self._near is None or self._near[0] < reach:
            near = self.touch_at < self.indentation + reach
            near[self.elements] = True
            elements = np.flatnonzero(near)
            self._near = reach, elements, self.gap(elements)
        return self._near[1:]
