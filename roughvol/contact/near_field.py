"""The near field of K⁻¹: a sparse factor made of the nearest neighbours of each element.

Entries of K⁻¹ fall off as 1/r³. A factor G with few neighbours per row therefore has GᵀG ≈ K⁻¹, except for smooth
pressures; `far_field` handles these.

n neighbours make 2ⁿ neighbourhoods. Their small systems are solved once per kernel, and rows of G are looked up.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from roughvol.contact.options import TUNING, Tuning
from roughvol.contact.state import Compliance
from roughvol.typing import Array, Index, Map, Mask, Single

_SQUARE = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3)])  # offsets within two spacings along each axis
_CENTRE = len(_SQUARE) // 2


def near_field(half_space: Compliance, elements: Index, tuning: Tuning = TUNING) -> Map:
    """Return r ↦ Gᵀ G r ≈ K⁻¹ r on the elements, G sparse and triangular: equation (13) of docs/explanation/solver.md.

    GᵀG is positive definite whenever K is, as G is invertible: on a free patch as a triangular matrix with a positive
    diagonal, around a period by `dominant` rows, where the last rows precede the first ones. Neighbours are at most
    `near_reach` ≤ √8 spacings apart. L. Yu. Kolotilina, A. Yu. Yeremin, SIAM J. Matrix Anal. Appl. 14 (1993) 45-58.
    """
    influence, periodic, size = half_space.influence, half_space.sides == "periodic", elements.size
    reach = tuning.near_reach_periodic if periodic else tuning.near_reach
    offsets, table = _rows(tuple(map(tuple, influence[:5, :5].tolist())), reach, periodic)
    row, column = np.divmod(elements.astype(np.int32), np.int32(half_space.shape[1]))
    if not periodic:
        row -= row[0]
        column -= column.min()
    last = (influence.shape[0] - 1, influence.shape[1] - 1) if periodic else (int(row[-1]), int(column.max()))
    width = last[1] + 5
    node = (row + 2).astype(np.intp) * width + column + 2
    # Absent neighbours are ~i of some i below the size. Their zeros then have many column numbers, see below.
    nodes, below = (last[0] + 3) * width, 1 << (size.bit_length() - 1)
    repeated = np.empty((-(-nodes // below), below), dtype=np.int32)
    repeated[:] = ~np.arange(below, dtype=np.int32)
    number = repeated.ravel()
    number[node] = np.arange(size, dtype=np.int32)
    if periodic:
        grid = number[:nodes].reshape(last[0] + 3, width)
        grid[:2] = grid[-2:]
        grid[:, :2], grid[:, -2:] = grid[:, -4:-2], grid[:, 2:4].copy()
    shifts = offsets @ (width, 1)
    bits = ((1 << np.arange(shifts.size)) * (shifts != 0)).astype(np.float32)
    # Rows of one length, zeros included, are faster than rows of several lengths.
    data = np.empty((size, shifts.size), dtype=np.float32)
    neighbours = np.empty((size, shifts.size), dtype=np.int32)
    piece = min(size, tuning.cache // 64)  # elements at a time, to stay in cache
    position, of_piece = (np.empty((shifts.size, piece), dtype=kind) for kind in (np.intp, np.int32))
    for first in range(0, size, piece):
        some = slice(first, min(first + piece, size))
        position, of_piece = (buffer[:, : some.stop - first] for buffer in (position, of_piece))
        number.take(np.add(shifts[:, None], node[some], out=position), out=of_piece, mode="clip")
        # A product of floating-point numbers is exact here, and the fastest way.
        with np.errstate(invalid="ignore"):  # some BLAS raise the flag on memory beyond the end of an array
            code = bits @ (of_piece >= 0).astype(np.float32)
        table.take(code.astype(np.intp), axis=0, out=data[some], mode="clip")
        # With all zeros in one column, each addition would wait for the last one. ~i becomes i, the rest is left.
        of_piece ^= of_piece >> 31
        neighbours[some] = of_piece.T
    start = np.arange(0, data.size + 1, shifts.size, dtype=np.int32)
    factor = sparse.csr_array((data.ravel(), neighbours.ravel(), start), shape=(size, size))
    transposed = factor.T
    return lambda r: transposed @ (factor @ r.astype(np.float32, copy=False))


@lru_cache(maxsize=8)
def _rows(influence: tuple[tuple[float, ...], ...], reach: float, periodic: bool) -> tuple[NDArray[np.intp], Single]:
    """Return the offsets of preceding neighbours and the element itself, and the row of G for each set of them.

    Each bit of the number of a set is one neighbour. A row is zero where there is no neighbour.
    """
    near = np.hypot(*_SQUARE.T) <= reach + 0.01
    offsets = _SQUARE[: _CENTRE + 1][near[: _CENTRE + 1]]
    before = len(offsets) - 1
    present = np.ones((1 << before, before + 1), dtype=bool)
    present[:, :-1] = (np.arange(1 << before)[:, None] >> np.arange(before)) & 1
    rows = _scaled_rows(np.array(influence), offsets, present, before)
    if periodic:
        dominant(rows[:, :-1].T, rows[:, -1])
    return offsets, rows


def dominant(others: Single, diagonal: Single) -> None:
    """Shrink the rows of a factor G, in place, to strict dominance: Σ|others| ≤ 0.999 g with the diagonal g.

    G is then invertible, and GᵀG positive definite, whichever neighbours a row has. For x_k, the largest entry of x,
    row k has |(G x)_k| ≥ g |x_k| - Σ|others| |x_k| ≥ 0.001 g |x_k| > 0. Most rows are dominant already and are kept.
    """
    share = np.abs(others).sum(axis=0) / diagonal
    others *= np.minimum(1.0, 0.999 / np.maximum(share, 0.999))


def border(half_space: Compliance, elements: Index, left_out: Mask, entered: Index) -> tuple[Index, Single]:
    """Return the rows g by which elements that were left out take part in the inverse, of shape (k, 25).

    With one more element x, the inverse of K is the one without it plus g gᵀ, g = y/√y_x, K y = e_x. Here K is taken on
    x and the elements up to two spacings around it that are not left out. Their positions come with g.
    """
    columns, influence = half_space.shape[1], half_space.influence
    wanted = elements[entered, None] + _SQUARE @ (columns, 1)
    members = np.minimum(np.searchsorted(elements, wanted), elements.size - 1)
    column = elements[entered, None] % columns + _SQUARE[:, 1]
    present = (elements[members] == wanted) & (column >= 0) & (column < columns) & ~left_out[members]
    present[:, _CENTRE] = True
    return members, _scaled_rows(influence[:5, :5], _SQUARE, present, _CENTRE)


def _scaled_rows(influence: Array, offsets: NDArray[np.intp], present: Mask, unit: int) -> Single:
    """Return y/√y_x with K y = e_x on each set of elements, x being number `unit`; zero where none is present."""
    kernel = np.zeros((5, 5))  # zero where the grid does not reach so far
    kernel[: influence.shape[0], : influence.shape[1]] = influence
    distance = np.abs(offsets[:, None] - offsets)
    matrix = kernel[distance[..., 0], distance[..., 1]]
    # Absent members become rows of the identity, so that all systems have one size.
    systems = np.where(present[:, :, None] & present[:, None, :], matrix, np.eye(len(matrix)))
    right = np.zeros((len(matrix), 1))
    right[unit] = 1.0
    rows = np.linalg.solve(systems, right)[:, :, 0]
    return (rows / np.sqrt(rows[:, unit, None])).astype(np.float32)
