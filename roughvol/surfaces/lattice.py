"""Measured heights on another lattice: means of blocks of nodes, and pixels that are off square made square.

Conventions: heights z on a lattice, axis 0 is x and axis 1 is y; a height that is not known is NaN. Node [0, 0] of what
comes out is the first node, or the first block of nodes, of what goes in. Nothing is changed in place.
"""

from __future__ import annotations

import numpy as np
from scipy import interpolate

from roughvol.surfaces import levelling
from roughvol.typing import Array

AT_NODE = 1e-9  # of an axis: a place as near to a node is at the node


def block_means(heights: Array, side: int) -> Array:
    """Return the means of the known heights in blocks of nodes, k times as far apart as the nodes.

    The mean of a plane over a block is the plane in the middle of the block. A mean is NaN where more than half of its
    block is not known. Rows and columns at the end that fill no block are left out.
    """
    rows, columns = (nodes // side for nodes in heights.shape)
    blocks = heights[: rows * side, : columns * side].reshape(rows, side, columns, side)
    count = (~np.isnan(blocks)).sum(axis=(1, 3))
    total = np.nansum(blocks, axis=(1, 3))
    return np.where(2 * count >= side**2, total / np.maximum(count, 1), np.nan)


def squared(heights: Array, ratio: float) -> Array:
    """Return the heights on square pixels of the finer of the two spacings, by cubic splines along the coarser axis.

    The ratio is the side of the pixels along y over that along x. A node between two others is NaN if one of them is.
    Interpolation onto the finer spacing leaves every wave that the map holds. A cubic spline keeps waves of four pixels
    and more to 3 % of their amplitude, wherever the new nodes fall between the old. Linear interpolation takes off up
    to 1 - cos(π/4) = 29 %, and nothing where old and new nodes meet, so roughness would vary over the map. Planes are
    exact.
    """
    axis = 1 if ratio > 1.0 else 0
    finer = ratio if ratio > 1.0 else 1.0 / ratio
    nodes = heights.shape[axis]
    last = (nodes - 1) * finer
    position = np.arange(int(np.floor(last + AT_NODE * nodes)) + 1) / finer
    nearest = np.rint(position)
    position = np.where(np.abs(position - nearest) < AT_NODE * nodes, nearest, position)
    missing = np.isnan(heights)
    filled = levelling.fill(heights, "interpolate") if missing.any() else heights
    spline = interpolate.make_interp_spline(np.arange(nodes), filled, k=min(3, nodes - 1), axis=axis)
    between = np.floor(position).astype(int), np.ceil(position).astype(int)
    gone = missing.take(between[0], axis=axis) | missing.take(between[1], axis=axis)
    return np.where(gone, np.nan, spline(position))
