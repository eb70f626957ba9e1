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

The nodes are taken out one by one, until a single joint leads from the inlet to the outlet. Joints between all
neighbours of a node stand in its place, w_a w_b/Σw between the neighbours a and b (A. Rosen, J. Inst. Electr. Eng. 62
(1924) 916-918). Nothing is subtracted, so all digits stay where conductances span decades. Of closing loads a node
leaves the smaller one of two, and of parallel joints the larger one counts.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from roughvol.typing import Array


def conductance(along: Array, across: Array, *, ring: bool = False) -> Array:
    """Return the flow through sheets over that of a sheet whose patches all conduct 1, shape (...).

    ``along`` (..., n, m) and ``across`` (..., n - 1, m) are conductances ≥ 0, 0 of a closed patch. Across leads to the
    next column; from the last one to the first in a ring alone.
    """
    n, m = along.shape[-2:]
    return n / m * _from_end_to_end(along, across, np.add, _star, ring=ring)


def closing(along: Array, across: Array, *, ring: bool = False) -> Array:
    """Return the largest value such that patches of this value or more lead through a sheet; 0 without a way.

    Of the closing loads of the patches it is the load at which the sheet closes. Shapes are those of `conductance`.
    """
    return _from_end_to_end(along, across, np.maximum, lambda ways: np.minimum(ways[:, None], ways), ring=ring)


def _star(joints: Array) -> Array:
    """Return the conductances between the neighbours of a node that stand in the place of its own."""
    total = joints.sum(axis=0)
    return joints[:, None] * np.divide(joints, total, out=np.zeros(joints.shape), where=total > 0.0)


def _from_end_to_end(
    along: Array, across: Array, parallel: np.ufunc, star: Callable[[Array], Array], *, ring: bool
) -> Array:
    """Return the joint between inlet and outlet that is left without nodes.

    ``parallel`` adds joints between the same two nodes. ``star`` takes the joints of a node, shape (neighbours, ...),
    and returns those between its neighbours. Nodes 0 and 1 are the inlet and the outlet, then come those of a column,
    and in a ring those of its last column. From column to column, a node gives its number to the node beside it.
    """
    down, beside = (np.moveaxis(some, (-2, -1), (0, 1)) for some in (along, across))
    size, columns = len(beside), down.shape[1] - ring
    column = 2 + np.arange(size)
    last = column + size
    nodes = 2 + (1 + ring) * size
    joints = np.zeros((nodes, nodes, *down.shape[2:]))

    def join(one: Any, other: Any, values: Array) -> None:
        joints[one, other] = joints[other, one] = parallel(joints[one, other], values)

    def take_out(node: int, to_next: Any = 0.0) -> None:
        """Replace a node by the node beside it, which is joined to it alone so far; by none without such a joint."""
        own = joints[node].copy()
        own[node] = to_next
        joints[node] = joints[:, node] = 0.0
        parallel(joints, star(own), out=joints)

    if ring:
        join([0, *last], [*last, 1], down[:, -1])
        join(column, last, beside[:, -1])
    for j in range(columns):
        for i, (one, other) in enumerate(itertools.pairwise([0, *column, 1])):
            if j > 0 and i < size:
                take_out(other, beside[i, j - 1])
            join(one, other, down[i, j])
    if ring:
        join(column, last, beside[:, -2])
    for node in range(2, nodes):
        take_out(node)
    return np.asarray(joints[0, 1])
