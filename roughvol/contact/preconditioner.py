"""The approximate inverse of K on the elements that are expected in contact."""

from __future__ import annotations

from collections.abc import Iterator
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
    free: Mask,
    rates: Rates | None,
    tuning: Tuning = TUNING,
    *,
    periodic: bool = False,
) -> tuple[Map, Mask]:
    """Return r ↦ M⁻¹ r ≈ K⁻¹ r, equations (13) to (15) of docs/solver.md, and the elements expected in contact.

    Neighbours lift an element without pressure clear if the step M⁻¹(-w) gives it none. The inverse is made without
    these elements. One that comes into contact takes part by the near field around it (`near_field.border`).

    M⁻¹ is positive definite on the elements that take part. `far_field` has the proof for the elements kept. An element
    x that comes into contact adds (gᵀr)² to rᵀM⁻¹r, which is y_x r_x² if r is zero on the elements kept.

    `pressure` and `gap` are q and w at the start. `rates` are pressure and displacement per unit of further
    indentation; without them the far field is not corrected.
    """
    reach = tuning.near_reach_periodic if periodic else tuning.near_reach
    if rates is None:
        return near_field(influence, shape[1], elements, reach, periodic=periodic), free
    rate, displacement = rates

    def both_fields(near: Map, kept: Index) -> Map:
        # t of equation (14); the near field mends it on new elements, K t = 1
        t = np.maximum(rate[kept] + near(1.0 - displacement[kept]), 0.0)
        return by_blocks(near, influence, shape, elements[kept], t, tuning, periodic=periodic)

    kept = np.flatnonzero(free) if free.any() else np.arange(free.size)
    near = near_field(influence, shape[1], elements[kept], reach, periodic=periodic)
    inverse = near
    searches = tuning.lifted_rounds if shape[0] * shape[1] >= tuning.lifted_again_from else 1
    for _ in range(searches):
        lifted = (pressure[kept] <= 0.0) & (inverse(-gap[kept]) <= 0.0)
        if not tuning.lifted_share * kept.size < np.count_nonzero(lifted) < kept.size:
            break
        kept = kept[~lifted]
        del near, inverse  # before the memory of the next ones
        near = near_field(influence, shape[1], elements[kept], reach, periodic=periodic)
        inverse = both_fields(near, kept)
    if inverse is near:
        inverse = both_fields(near, kept)
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
            members, rows = border(influence, shape[1], elements, left_out, entered[first : first + at_once])
            np.add.at(z, members, rows * (rows * r[members]).sum(axis=1, keepdims=True))
        return z

    return apply, ~left_out


def weaker_inverses(
    influence: Array, shape: tuple[int, int], elements: Index, tuning: Tuning = TUNING, *, periodic: bool = False
) -> Iterator[Map]:
    """Yield maps in place of an M⁻¹ that gives no descent: the near field alone, then r itself.

    They take more iterations to the same answer. The last one is repeated without end: r descends.
    """
    reach = tuning.near_reach_periodic if periodic else tuning.near_reach
    yield near_field(influence, shape[1], elements, reach, periodic=periodic)
    while True:
        yield lambda r: r
