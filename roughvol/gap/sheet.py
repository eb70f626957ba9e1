"""A sheet of patches: its conductance, and the load at which it closes, from those of its patches.

A patch of a joint is known by two numbers: what it conducts from side to side along the flow, and across. A sheet of
n × m patches, n in a row along the flow and m side by side, is the square lattice of joints

    along    n × m          each leads from one line of nodes to the next; the first and last lines are the reservoirs
    across   (n - 1) × m    each leads from a node to the node beside it

and each joint is a patch. Flow without sources in two dimensions has a dual: nodes become faces, a conductance becomes
its inverse, and a joint across becomes a joint along. The dual of this sheet is a sheet of m × n patches, exactly, and
the product of both conductances is 1 (Dykhne, Sov. Phys. JETP 32 (1971) 63). Hence

- one patch in a row: the arithmetic mean; one side by side: the harmonic mean;
- n × n patches, logarithms spread alike to both sides of their mean: the median is the geometric mean, at any n, and a
  large sheet conducts it (Matheron, Éléments pour une théorie des milieux poreux, 1967);
- closed patches close a large sheet at one half: the threshold of joints (bonds) of the square lattice (Kesten, Commun.
  Math. Phys. 74 (1980) 41). The gap itself has the same duality: void leads through a patch in x, or solid in y.

Elements joined by harmonic means, as the elements of `transport`, have none of the last two properties: their mean lies
below the geometric one, and they close at 0.407 closed elements (sites).
"""

from __future__ import annotations

import numpy as np

from roughvol.gap.clusters import spanned
from roughvol.gap.constriction import constriction
from roughvol.gap.network import flow_through
from roughvol.typing import Array

ACCURACY = 1e-6  # of the conductance of a sheet, relative
WINDOW = 1e7  # conductances beyond so many times that of the widest way, to either side, are wide open or closed


def conductance(along: Array, across: Array, *, ring: bool = False) -> float:
    """Return the flow through a sheet over that of a sheet whose patches all conduct 1.

    ``along`` (n, m) and ``across`` (n - 1, m) are conductances ≥ 0, 0 of a closed patch. Across leads to the next
    column; from the last one to the first in a ring alone.
    """
    n, m = along.shape
    if n == 1:
        return float(along.mean())
    joints = _lattice(along, across, ring=ring)
    most, least = joints.max(), along.min()
    if not least > most / WINDOW:  # closed patches, or decades between the widest way and others
        if np.any((along > 0.0) & (along < most / WINDOW)) or np.any((across > 0.0) & (across < most / WINDOW)):
            widest = constriction(joints, 0, periodic=ring).gap
            joints = np.minimum(joints, WINDOW * widest)
            joints[joints * WINDOW < widest] = 0.0
        joints[~spanned(joints > 0.0, ring)] = 0.0
    down, east = joints[::2, ::2], np.zeros(across.shape)
    if not down.any():
        return 0.0
    beside = joints[1::2, 1::2]
    east[:, : beside.shape[1]] = beside
    return n / m * flow_through(down, east, ACCURACY).dissipation


def closing(along: Array, across: Array, *, ring: bool = False) -> float:
    """Return the largest value such that patches of this value or more lead through a sheet; 0 without a way.

    Of the closing loads of the patches it is the load at which the sheet closes.
    """
    if along.shape[0] == 1:
        return float(along.max())
    return constriction(_lattice(along, across, ring=ring), 0, periodic=ring).gap


def _lattice(along: Array, across: Array, *, ring: bool) -> Array:
    """Return joints as elements of a field: along at (even, even), across at (odd, odd), open nodes between them."""
    n, m = along.shape
    field = np.zeros((2 * n - 1, 2 * m if ring else 2 * m - 1))
    field[1::2, ::2] = 2.0 * max(along.max(), across.max())
    field[::2, ::2] = along
    field[1::2, 1::2] = across if ring else across[:, :-1]
    return field
