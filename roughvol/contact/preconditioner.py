"""The approximate inverse of K on the elements that are expected in contact."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.contact.far_field import by_blocks
from roughvol.contact.near_field import border, near_field
from roughvol.contact.tuning import TUNING, Tuning
from roughvol.typing import Array, Index, Map, Mask

Rates = tuple[Array, Array]


def approximate_inverse(
    influence: Array,
    shape: tuple[int, int],
    elements: Index,
    pressure: Array,
    gap: Array,
    rates: Rates | None,
    tuning: Tuning = TUNING,
) -> tuple[Map, Mask]:
    """Return r ↦ M⁻¹ r ≈ K⁻¹ r, and the elements that it expects in contact.

    An element without pressure is lifted clear by its neighbours if the step M⁻¹(-w) gives it none. An inverse that
    counts on it is the wrong one for its neighbours, so the inverse is made without it. If it comes into contact
    nevertheless, it takes part with the near field around it (`near_field.border`).

    Parameters
    ----------
    influence : array
        K(i, j) of the non-negative offsets.
    shape : tuple of int
        Rows and columns of the grid.
    elements : array (n,)
        Flat indices, increasing.
    pressure, gap : array (n,)
        q and w at the start.
    rates : pair of array (n,), optional
        Pressure and displacement per unit of further indentation. Without them there is no correction by blocks.
    tuning : Tuning
        Constants.

    Returns
    -------
    inverse : callable
    free : array (n,) of bool
    """
    free = (pressure > 0.0) | (gap < 0.0)
    if rates is None:
        return near_field(influence, shape[1], elements, tuning.near_reach), free
    kept = np.flatnonzero(free) if free.any() else np.arange(free.size)
    near = near_field(influence, shape[1], elements[kept], tuning.near_reach)
    inverse = near
    looked_for = tuning.lifted_rounds if shape[0] * shape[1] >= tuning.lifted_again_from else 1
    for _ in range(looked_for):
        lifted = (pressure[kept] <= 0.0) & (inverse(-gap[kept]) <= 0.0)
        if not tuning.lifted_share * kept.size < np.count_nonzero(lifted) < kept.size:
            break
        kept = kept[~lifted]
        near = near_field(influence, shape[1], elements[kept], tuning.near_reach)
        inverse = _corrected(near, influence, shape, elements[kept], rates[0][kept], rates[1][kept], tuning)
    if inverse is near:
        inverse = _corrected(near, influence, shape, elements[kept], rates[0][kept], rates[1][kept], tuning)
    if kept.size == elements.size:
        return inverse, free
    left_out = np.ones(elements.size, dtype=bool)
    left_out[kept] = False

    def apply(r: NDArray[Any]) -> NDArray[Any]:
        z = np.zeros_like(r)
        z[kept] = inverse(r[kept])
        entered = np.flatnonzero(left_out & (r != 0.0))
        at_once = tuning.cache // 64  # small systems at a time
        for first in range(0, entered.size, at_once):
            some = entered[first : first + at_once]
            members, rows = border(influence, shape[1], elements, left_out, some)
            np.add.at(z, members, rows * (rows * r[members]).sum(axis=1, keepdims=True))
        return z

    return apply, ~left_out


def _corrected(
    near: Map,
    influence: Array,
    shape: tuple[int, int],
    elements: Index,
    rate: Array,
    displacement: Array,
    tuning: Tuning,
) -> Map:
    """Return the near field corrected by blocks, with t from the last step.

    t is mended by one application of the near field where elements have just come into reach: K t = 1.
    """
    t = np.maximum(rate + near(1.0 - displacement), 0.0)
    return by_blocks(near, influence, shape, elements, t, tuning)
