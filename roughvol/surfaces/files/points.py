"""A map from points x y z on a regular grid, in any order.

Conventions: both axes ascend with the index. Nodes of the grid without a point are missing (NaN).
"""

from __future__ import annotations

import numpy as np

from roughvol.errors import SurfaceError
from roughvol.typing import Array, Index

_SAME = 1e-6  # largest difference of equal coordinates, over the span
_REGULAR = 0.02  # largest distance of a coordinate from its node, in spacings
_CROWDED = 4  # most nodes a point for which points on a node are counted
_COVERED = 0.5  # least share of nodes with a point


def grid(points: Array) -> tuple[Array, tuple[float, float], bool]:
    """Return the map of points, the spans of x and y, and whether both coordinates only count from 0 or 1."""
    if not np.isfinite(points[:, :2]).all():
        raise SurfaceError("a coordinate is missing")
    (i, nx, span_x, whole_x), (j, ny, span_y, whole_y) = (_nodes(points[:, axis], "xy"[axis]) for axis in (0, 1))
    node = i * ny + j
    shared = int((np.bincount(node) > 1).sum()) if nx * ny <= _CROWDED * len(node) else 0
    if shared:
        raise SurfaceError(f"{shared} nodes have several of the {len(node)} points")
    if len(node) < _COVERED * nx * ny:
        message = (
            f"{len(node)} points lie on a grid of {nx} x {ny} nodes; allowed: at least {_COVERED:.0%} of its nodes"
        )
        raise SurfaceError(message)
    heights = np.full(nx * ny, np.nan)
    heights[node] = points[:, 2]
    return heights.reshape(nx, ny), (span_x, span_y), whole_x and whole_y


def _nodes(values: Array, name: str) -> tuple[Index, int, float, bool]:
    """Return the node of each coordinate, the number of nodes, their span, and whether they only count."""
    order = np.unique(values)
    span = float(order[-1] - order[0])
    if not span > 0.0:
        raise SurfaceError(f"{name} is {order[0]:g} everywhere")
    steps = np.diff(order)
    steps = steps[steps > _SAME * span]
    count = round(span / float(np.median(steps)))
    if count < 2:
        raise SurfaceError(f"{name} takes {count + 1} values; allowed: at least 3")
    position = (values - order[0]) / (span / count)
    node = np.rint(position)
    off = float(np.abs(position - node).max())
    if off > _REGULAR:
        raise SurfaceError(f"{name} is not equidistant: a point lies {off:.2g} of a spacing off its node")
    whole = bool(order[0] in (0.0, 1.0) and count == span)
    return node.astype(np.int64), count + 1, span, whole
