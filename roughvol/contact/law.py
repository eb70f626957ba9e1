"""Contact law: the pressures q and gaps w that an element may have, and what a step of the solver may change.

Rigid wall: q ≥ 0, w ≥ 0, q w = 0. A wall with a hardness Q has q ≤ Q as well, and w ≤ 0 where q = Q: equation (16) of
docs/explanation/solver.md. Another law is a class with these members; `active_set` and `problem` ask nothing else.
"""

import numpy as np

from roughvol.typing import Array, Index, Mask


class Wall:
    """A rigid wall with a limit of q: that of the hardness, infinite in elastic contact.

    If a law `yields`, gaps are not convex and overlaps may stay.
    """

    def __init__(self, limit: float = np.inf) -> None:
        self.limit, self.yields = limit, limit < np.inf

    def project(self, q: Array) -> Array:
        """Return the allowed pressures nearest to q."""
        return np.clip(q, 0.0, self.limit)

    def outside(self, q: Array) -> Index:
        """Return the positions of pressures that are not allowed."""
        return np.flatnonzero((q < 0.0) | (q > self.limit))

    def free(self, q: Array, w: Array) -> Mask:
        """Return the elements that may change their pressure: q < 0 until the next projection; q = Q at a gap."""
        return ((q != 0.0) | (w < 0.0)) & ((q != self.limit) | (w > 0.0))

    def admits(self, q: Array, change: Array) -> Mask:
        """Return the elements that a change of pressure does not lead out of the bounds at once."""
        return ((q > 0.0) | (change >= 0.0)) & ((q < self.limit) | (change <= 0.0))

    def held(self, q: Array) -> Mask:
        """Return the elements at the limit: an overlap stays there, and is no error."""
        return q >= self.limit

    def residual(self, q: Array, w: Array) -> Array:
        """Return the gaps that should be zero, on elements with q > 0: an overlap at the limit is left out."""
        return np.where(self.held(q), np.maximum(w, 0.0), w)


ELASTIC = Wall()
