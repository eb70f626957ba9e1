"""Edges between contact and void on the grid, and the contact area corrected by them.

The elements in contact overestimate the contact area, since an element counts as a whole where the contact ends inside
it. The excess is proportional to the length of the edges and to the spacing.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from roughvol.typing import Array, Mask

EXCESS = (math.pi - 1.0 + math.log(2.0)) / 24.0
"""Area by which an edge of the grid between contact and void is overestimated, over δ²; Yastrebov et al. (2017)."""


def contact_perimeter(contact: Mask, periodic: bool = False) -> float:
    """Return the length S_d of the edges between contact and void, as S_d L/A_n, with L = n δ of all elements.

    S_d is δ times the pairs of neighbours along x or y, one in contact and one not. The sides of a patch are no edges;
    elements at opposite sides of a period are neighbours.
    """
    edges = int(np.sum(contact[1:] != contact[:-1])) + int(np.sum(contact[:, 1:] != contact[:, :-1]))
    if periodic:
        edges += int(np.sum(contact[0] != contact[-1])) + int(np.sum(contact[:, 0] != contact[:, -1]))
    return edges / contact.shape[1]


def corrected_area(area_fraction: ArrayLike, perimeter: ArrayLike, nodes: ArrayLike) -> Array:
    """Return the contact area fraction corrected by `contact_perimeter`, A* - (π - 1 + ln 2)/24 S_d δ/A_n.

    ``nodes`` is the number n of elements along x in the region.

    V. A. Yastrebov, G. Anciaux & J.-F. Molinari, The role of the roughness spectral breadth in elastic contact of rough
    surfaces, J. Mech. Phys. Solids 107 (2017) 469-493; derived in the same authors' Tribology International 114 (2017)
    161-171.
    """
    area, edges, n = (np.asarray(values, dtype=np.float64) for values in (area_fraction, perimeter, nodes))
    return np.maximum(area - EXCESS * edges / n, 0.0)
