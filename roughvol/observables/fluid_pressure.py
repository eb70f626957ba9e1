"""Pressure of a fluid in the gap of a contact, between an inlet and an outlet.

div(g³ grad P) = 0 with P = 1 on the side of the inlet and P = 0 on the side of the outlet, on the elements and with the
conductances of `transport`. All elements take part, with a least conductance of `LEAST` times that of the critical
constriction: closed elements conduct nearly nothing. Three assumptions follow.

- Open elements joined to one reservoir alone have its pressure.
- A closed pocket has a mean of the pressures around it: the fluid had time to seep in.
- Under a contact the field passes smoothly from side to side. It is the pressure of a fluid that would enter there.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import linalg as sparse_linalg

from roughvol.observables.clusters import check_gap
from roughvol.observables.transport import constriction
from roughvol.typing import Array

LEAST = 1e-8  # conductance of a closed element over that of the critical constriction, or of the widest gap
MOST = 1e8


def fluid_pressure(gap: Array, axis: int, *, periodic: bool = False) -> Array:
    """Return the pressure of the fluid on every element, over that of the inlet.

    Parameters
    ----------
    gap : array (rows, columns)
        Gap g ≥ 0 [any length]; open is g > 0.
    axis : int
        Direction of the flow from the inlet at its first line to the outlet at its last, 0 for x, 1 for y.
    periodic : bool
        Whether the two other sides are joined.

    Returns
    -------
    array (rows, columns)
        P, from 1 at the inlet to 0 at the outlet.

    Raises
    ------
    ContactError
        If the gap is no 2-D field of finite numbers ≥ 0.
    """
    check_gap(gap)
    along = gap if axis == 0 else gap.T
    critical = constriction(gap, axis, periodic=periodic).gap or float(gap.max()) or 1.0
    k = np.clip((along / critical) ** 3, LEAST, MOST)
    rows, columns = k.shape
    number = np.arange(k.size).reshape(k.shape)
    across = [np.roll(number, -1, axis=1), number]
    if not periodic:
        across = [beside[:, : columns - 1] for beside in across]
    tail = np.concatenate([number[:-1].ravel(), across[1].ravel()])
    head = np.concatenate([number[1:].ravel(), across[0].ravel()])
    flat = k.ravel()
    w = 2.0 * flat[tail] * flat[head] / (flat[tail] + flat[head])
    ends = np.zeros(k.shape)
    ends[0] += 2.0 * k[0]
    inlet = ends.copy().ravel()
    ends[-1] += 2.0 * k[-1]
    scale = 1.0 / np.sqrt(np.bincount(tail, w, k.size) + np.bincount(head, w, k.size) + ends.ravel())
    off = -w * scale[tail] * scale[head]
    diagonal = np.arange(k.size)
    places = np.concatenate([diagonal, tail, head]), np.concatenate([diagonal, head, tail])
    matrix = sparse.csc_matrix((np.concatenate([np.ones(k.size), off, off]), places))
    factor = sparse_linalg.splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    right = scale * inlet
    solution = factor.solve(right)
    solution += factor.solve(right - matrix @ solution)
    pressure = np.clip((scale * solution).reshape(rows, columns), 0.0, 1.0)
    return pressure if axis == 0 else np.ascontiguousarray(pressure.T)
