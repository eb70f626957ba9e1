"""Contact laws: the pressures q and gaps w that an element may have, and what a step of the solver may change.

Rigid wall: q ≥ 0, w ≥ 0, q w = 0. A wall with a hardness Q has q ≤ Q as well, and w ≤ 0 where q = Q: equation (16) of
docs/explanation/solver.md. Another law is a class with these members; `active_set` and `problem` ask nothing else.
"""

import numpy as np

from roughvol.typing import Array, Index, Mask


class RigidWall:
    """The wall of elastic contact: q has no limit. If a law `yields`, gaps are not convex and overlaps may stay."""

    limit = np.inf
    yields = False

    def project(self, q: Array) -> Array:
        """Return the allowed pressures nearest to q."""
        return np.clip(q, 0.0, self.limit)

    def outside(self, q: Array) -> Index:
        """Return the positions of pressures that are not allowed."""
        return np.flatnonzero(q < 0.0)

    def free(self, q: Array, w: Array) -> Mask:
        """Return the elements that may change their pressure: q < 0 too, until the next projection."""
        return (q != 0.0) | (w < 0.0)

    def admits(self, q: Array, change: Array) -> Mask:
        """Return the elements that a change of pressure does not lead out of the bounds at once."""
        return (q > 0.0) | (change >= 0.0)

    def held(self, q: Array) -> Mask:
        """Return the elements at the limit: an overlap stays there, and is no error."""
        return np.zeros(q.size, dtype=bool)

    def residual(self, q: Array, w: Array) -> Array:
        """Return the gaps that should be zero, on elements with q > 0."""
        return w


class HardWall(RigidWall):
    """The wall of a surface that yields at a limit of its pressure."""

    yields = True

    def __init__(self, limit: float) -> None:
        self.limit = limit

    def outside(self, q: Array) -> Index:
        """Return the positions of pressures that are not allowed."""
        return np.flatnonzero((q < 0.0) | (q > self.limit))

    def free(self, q: Array, w: Array) -> Mask:
        """Return the elements that may change their pressure: at the limit where a gap opens."""
        return super().free(q, w) & ((q != self.limit) | (w > 0.0))

    def admits(self, q: Array, change: Array) -> Mask:
        """Return the elements that a change of pressure does not lead out of the bounds at once."""
        return super().admits(q, change) & ((q < self.limit) | (change <= 0.0))

    def held(self, q: Array) -> Mask:
        """Return the elements at the limit."""
        return q >= self.limit

    def residual(self, q: Array, w: Array) -> Array:
        """Return the gaps that should be zero: an overlap at the limit is left out."""
        return np.where(self.held(q), np.maximum(w, 0.0), w)


ELASTIC = RigidWall()
