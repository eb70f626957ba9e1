"""The approximate inverse of K on the elements that are expected in contact."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.contact.far_field import by_blocks
from roughvol.contact.near_field import border, near_field
from roughvol.contact.options import Tuning
from roughvol.contact.state import Compliance
from roughvol.typing import Array, Index, Map, Mask

Rates = tuple[Array, Array]


def approximate_inverse(
    half_space: Compliance, elements: Index, q: Array, w: Array, free: Mask, rates: Rates | None, tuning: Tuning
) -> tuple[Map, Mask]:
    """Return r ↦ M⁻¹ r ≈ K⁻¹ r, equations (13) to (15) of solver.md, and the elements expected in contact.

    Neighbours lift an element without pressure clear if the step M⁻¹(-w) gives it none. M⁻¹ is made without these
    elements and is positive definite on the others (`far_field`). An element x that comes into contact takes part by
    `near_field.border`: it adds (gᵀr)² to rᵀM⁻¹r, which is y_x r_x² if r is zero on the others. `rates` are those of q
    and K q with indentation; without them the far field of a free patch or a period is not corrected.
    """
    mirrored = half_space.sides == "mirrored"
    if rates is None and not mirrored:
        return near_field(half_space, elements, tuning), free
    rate, displacement = rates or np.zeros((2, elements.size))

    def both_fields(near: Map, kept: Index) -> Map:
        # t of equation (14); the near field mends it on new elements, K t = 1
        t = np.maximum(rate[kept] + near(1.0 - displacement[kept]), 0.0)
        return by_blocks(near, half_space, elements[kept], t, tuning)

    kept = np.flatnonzero(free) if free.any() else np.arange(free.size)
    inverse = near = near_field(half_space, elements[kept], tuning)
    # On a mirrored patch the mean pressure lifts all elements, which the near field alone does not show.
    again = math.prod(half_space.shape) * (4 if mirrored else 1) >= tuning.lifted_again_from
    searches = tuning.lifted_rounds * (2 if mirrored else 1) if again else 1
    for _ in range(searches):
        lifted = (q[kept] <= 0.0) & (inverse(-w[kept]) <= 0.0)
        if not tuning.lifted_share * kept.size < np.count_nonzero(lifted) < kept.size:
            break
        kept = kept[~lifted]
        del near, inverse  # before the memory of the next ones
        near = near_field(half_space, elements[kept], tuning)
        inverse = both_fields(near, kept)
    if inverse is near:
        inverse = both_fields(near, kept)
    if kept.size == elements.size:
        return inverse, free
    left_out = np.ones(elements.size, dtype=bool)
    left_out[kept] = False
    return _with_entering(inverse, half_space, elements, left_out, tuning), ~left_out


def _with_entering(inverse: Map, half_space: Compliance, elements: Index, left_out: Mask, tuning: Tuning) -> Map:
    """Return M⁻¹ with the elements that come into contact, by `near_field.border`, from M⁻¹ without those left out."""
    kept = np.flatnonzero(~left_out)
    row_of = np.full(elements.size, -1)  # of elements that have entered: their rows stay the same
    members, rows = border(half_space, elements, left_out, np.empty(0, dtype=np.intp))
    at_once = tuning.cache // 64  # small systems at a time

    def apply(r: NDArray[Any]) -> NDArray[Any]:
        nonlocal members, rows
        z = np.zeros_like(r)
        z[kept] = inverse(r[kept])
        entered = np.flatnonzero(left_out & (r != 0.0))
        new = entered[row_of[entered] < 0]
        row_of[new] = len(rows) + np.arange(new.size)
        for first in range(0, new.size, at_once):
            around, found = border(half_space, elements, left_out, new[first : first + at_once])
            members, rows = np.concatenate((members, around)), np.concatenate((rows, found))
        for first in range(0, entered.size, at_once):
            some = row_of[entered[first : first + at_once]]
            around, row = members[some], rows[some]
            np.add.at(z, around, row * (row * r[around]).sum(axis=1, keepdims=True))
        return z

    return apply


def weaker_inverses(half_space: Compliance, elements: Index, tuning: Tuning) -> Iterator[Map]:
    """Yield maps in place of an M⁻¹ that gives no descent: the near field alone, then r itself, without end."""
    yield near_field(half_space, elements, tuning)
    while True:
        yield lambda r: r
