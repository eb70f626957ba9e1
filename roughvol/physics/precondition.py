"""Preconditioners for the contact solver: cheap approximations of K⁻¹ on a set of elements.

The inverse of the influence matrix has a near and a far character. Near: the entries of K⁻¹ fall off as 1/r³, so a
sparse factor from the nearest neighbours catches most of it (`near_field`). Far: what is left are collective modes, in
which whole regions of the contact shift load among each other, and their number is what makes plain iterations slow on
large grids. These modes have the shape t(x) c(x): the pressure t that answers a uniform further indentation, K t = 1,
times a smooth function c. t costs nothing, the sweep having just done that experiment. On small grids a few smooth
functions on the whole of it are enough (`two_level`), on large ones c has every scale from a few elements to the whole
(`blocks.by_blocks`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from roughvol.physics.blocks import Inverse, by_blocks

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Map = Callable[[Array], Array]
Rates = tuple[Array, Array]

_SHORT, _LONG = 2.0**0.5, 5.0**0.5  # reach of the near field in spacings: 2⁴ or 2¹⁰ neighbourhoods
_SMALLEST = 48  # nodes along the longer side below which there is nothing collective worth a correction
_BLOCKS_FROM = 400  # nodes; below, hats are the cheaper correction
LARGE = 2000  # nodes from which on longer reaches, among elements and blocks, and balancing save more than they cost
_LIFTED_FROM = 800  # nodes; below, finding those that will be lifted clear hardly saves the time it takes
_AGAIN = 2  # times; each costs half a convolution and saves more than one
_LIFTED = 0.001  # share of the elements that has to be lifted clear to make another inverse worth its time
_BORDERED = 4096  # elements left out that may take part with their neighbours; the more, the longer it takes
_HATS = 0.25  # intervals of the coarse grid along the longer side, times √nodes: where the gain meets the cost
_CELLS_PER_HAT = 5  # along each axis: how finely the response to a hat is resolved
_MODES_ABOVE = 0.05  # coarse modes this much softer than uniform indentation are left to the near field


def near_field(influence: Array, columns: int, elements: Index, reach: float) -> Map:
    """Return r ↦ Gᵀ G r ≈ K⁻¹ r on the elements, G a sparse triangular factor from the near field.

    Row i of G solves K_PP y = e_i on P = element i and those of its preceding neighbours that belong to the set, and
    G_i = y/√y_i: the factorised sparse approximate inverse, symmetric positive definite whenever K is. Few neighbours
    make few neighbourhoods, so all the small systems of all surfaces are solved once.

    Parameters
    ----------
    influence : K(i, j) of the non-negative offsets.
    columns : columns of the grid.
    elements : flat indices, increasing.
    reach : distance of the farthest neighbours, at most √8: √2 takes 4 preceding ones, √5 takes 10.

    References
    ----------
    L. Yu. Kolotilina, A. Yu. Yeremin, SIAM J. Matrix Anal. Appl. 14 (1993) 45-58.
    """
    offsets, table = _near_field_rows(tuple(map(tuple, influence[:5, :5].tolist())), reach)
    size = elements.size
    row, column = np.divmod(elements.astype(np.int32), np.int32(columns))
    row -= row[0]
    column -= column.min()
    width = int(column.max()) + 5
    place = (row + 2).astype(np.intp) * width + column + 2
    # where there is no element: ~i of some i below the size, which spreads the zeros of absent neighbours, see below
    places, below = (int(row[-1]) + 3) * width, 1 << (size.bit_length() - 1)
    repeated = np.empty((-(-places // below), below), dtype=np.int32)
    repeated[:] = ~np.arange(below, dtype=np.int32)
    number = repeated.ravel()
    number[place] = np.arange(size, dtype=np.int32)
    shifts = offsets @ (width, 1)
    neighbours = number.take(np.add.outer(shifts, place))  # this way round: loops over few are slow
    present = neighbours >= 0
    bits = (1 << np.arange(shifts.size)) * (shifts != 0)
    with np.errstate(invalid="ignore"):  # some BLAS raise the flag on what lies beyond the end of an array
        # as a product of floating-point numbers, which is exact and the fastest way
        code = (bits.astype(np.float32) @ present.astype(np.float32)).astype(np.intp)
    # Rows of one length, with zeros for neighbours that are absent, are faster than shorter ones of different lengths,
    # unless all zeros are at one place, where each addition waits for the one before. From ~i to i, the rest unchanged:
    neighbours ^= neighbours >> 31
    start = np.arange(0, neighbours.size + 1, shifts.size, dtype=np.int32)
    factor = sparse.csr_array((table.take(code, axis=0).ravel(), neighbours.T.ravel(), start), shape=(size, size))
    transposed = factor.T
    return lambda r: transposed @ (factor @ r.astype(np.float32, copy=False))


@lru_cache(maxsize=8)
def _near_field_rows(
    influence: tuple[tuple[float, ...], ...], reach: float
) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return the offsets of preceding neighbours and the element itself, and the row of G for each set of them.

    Rows are numbered by bits, one per neighbour, and zero where there is none.
    """
    kernel = np.zeros((5, 5))
    given = np.array(influence)
    kernel[: given.shape[0], : given.shape[1]] = given
    square = [(i, j) for i in (-2, -1, 0) for j in (-2, -1, 0, 1, 2)]
    offsets = np.array([(i, j) for i, j in square if (i, j) <= (0, 0) and i * i + j * j <= reach**2 + 0.1])
    matrix = kernel[np.abs(offsets[:, None, 0] - offsets[:, 0]), np.abs(offsets[:, None, 1] - offsets[:, 1])]
    before = len(offsets) - 1
    codes = np.arange(1 << before)
    present = np.ones((codes.size, before + 1), dtype=bool)
    present[:, :-1] = (codes[:, None] >> np.arange(before)) & 1
    # absent neighbours become rows of the identity, so that all systems have one size
    systems = np.where(present[:, :, None] & present[:, None, :], matrix, np.eye(before + 1))
    unit = np.zeros((before + 1, 1))
    unit[-1] = 1.0
    rows = np.linalg.solve(systems, unit)[:, :, 0]
    return offsets, (rows / np.sqrt(rows[:, -1:])).astype(np.float32)


def approximate_inverse(
    influence: Array,
    shape: tuple[int, int],
    elements: Index,
    pressure: Array,
    gap: Array,
    rates: Rates | None,
) -> tuple[Inverse, NDArray[np.bool_]]:
    """Return (r, balanced) ↦ M⁻¹ r ≈ K⁻¹ r, and which elements it expects to be in contact.

    Balanced it is symmetric and positive definite on the elements where r is not zero, and takes more time.

    An element without pressure that the near field would not make carry any is lifted clear by its neighbours. An
    inverse that counts on it is the wrong one for these, so it is made without. Should such an element come into
    contact after all, it takes part with the near field around it. On grids below `_LIFTED_FROM` there are few, and
    nobody looks for them.

    Parameters
    ----------
    influence, shape : the kernel and the grid.
    elements : flat indices, increasing.
    pressure, gap : the state to begin with, on the elements.
    rates : pressure and displacement per unit of further indentation, on the elements, if they are known.
    """
    longer = max(shape)
    free = (pressure > 0.0) | (gap < 0.0)
    if rates is None or longer < _BLOCKS_FROM:
        near = near_field(influence, shape[1], elements, _LONG)
        if rates is None or longer < _SMALLEST:
            return lambda r, _: near(r), free
        return two_level(near, influence, shape, elements, _uniform(near, *rates)), free
    reach = _SHORT if longer < LARGE else _LONG

    def made(kept: Index, near: Map | None = None) -> Inverse:
        near = near or near_field(influence, shape[1], elements[kept], reach)
        t = _uniform(near, rates[0][kept], rates[1][kept])
        inverse = by_blocks(near, influence, shape, elements[kept], t, eight=longer >= LARGE)
        return lambda r, balanced: inverse(r, balanced or longer >= LARGE)

    kept = np.flatnonzero(free) if free.any() else np.arange(free.size)
    fewer = False
    near = near_field(influence, shape[1], elements[kept], reach)
    if longer >= _LIFTED_FROM:
        kept, fewer = _without_lifted(kept, pressure, near(-gap[kept]))
    inverse = made(kept, None if fewer else near)
    for _ in range(_AGAIN if fewer and longer >= LARGE else 0):
        # many come into reach in one step there: once more, by what the inverse itself says
        kept, more = _without_lifted(kept, pressure, inverse(-gap[kept], True))
        if not more:
            break
        inverse = made(kept)
    if kept.size == elements.size:
        return inverse, free
    left_out = np.ones(elements.size, dtype=bool)
    left_out[kept] = False

    def apply(r: Array, balanced: bool) -> Array:
        z = np.zeros_like(r)
        z[kept] = inverse(r[kept], balanced)
        some = np.flatnonzero(left_out & (r != 0.0))
        if 0 < some.size <= _BORDERED:
            members, rows = _border(influence, shape[1], elements, left_out, some)
            np.add.at(z, members, rows * (rows * r[members]).sum(axis=1, keepdims=True))
        else:
            z[some] = r[some] / influence[0, 0]
        return z

    free = np.zeros(elements.size, dtype=bool)
    free[kept] = True
    return apply, free


def _border(
    influence: Array, columns: int, elements: Index, left_out: NDArray[np.bool_], some: Index
) -> tuple[Index, NDArray[np.float32]]:
    """Return, for some of those left out, who is around them (numbers, theirs included) and the rows g of their border.

    With one more element x, the inverse of K is the sum of that without it and g gᵀ, g = y/√y_x, K y = e_x. Here y is
    found on the element and those around it that are not left out, within two spacings along each axis.
    """
    square = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3)])
    here = len(square) // 2
    given = influence[:5, :5]
    kernel = np.zeros((5, 5))
    kernel[: given.shape[0], : given.shape[1]] = given
    away = np.abs(square[:, None] - square)
    matrix = kernel[away[..., 0], away[..., 1]]
    wanted = elements[some, None] + square @ (columns, 1)
    members = np.minimum(np.searchsorted(elements, wanted), elements.size - 1)
    column = elements[some, None] % columns + square[:, 1]
    present = (elements[members] == wanted) & (column >= 0) & (column < columns) & ~left_out[members]
    present[:, here] = True
    systems = np.where(present[:, :, None] & present[:, None, :], matrix, np.eye(len(square)))
    unit = np.zeros((len(square), 1))
    unit[here] = 1.0
    rows = np.linalg.solve(systems, unit)[:, :, 0]
    return members, (rows / np.sqrt(rows[:, here, None])).astype(np.float32)


def _without_lifted(kept: Index, pressure: Array, step: Array) -> tuple[Index, bool]:
    """Return those of the elements that a step of the pressure leaves in contact, all of them if it lifts but few."""
    lifted = (pressure[kept] <= 0.0) & (step <= 0.0)
    many = bool(_LIFTED * kept.size < np.count_nonzero(lifted) < kept.size)
    return (kept[~lifted] if many else kept), many


def _uniform(near: Map, rate: Array, displacement: Array) -> Array:
    """Return t, K t = 1: what the last steps tell, corrected once for the elements that have just come into reach."""
    t: Array = np.maximum(rate + near(1.0 - displacement), 0.0)
    return t


def two_level(near: Map, influence: Array, shape: tuple[int, int], elements: Index, t: Array) -> Inverse:
    r"""Return the near-field inverse corrected for the collective modes of the contact.

    .. math:: M^{-1} = Q + (1 - Q \hat H)\, B, \qquad Q = Z\,(Z^T \hat H Z)^{-1} Z^T

    B is the near-field inverse, the columns of Z are t times bilinear hats on a coarse grid, and Ĥ is an approximation
    of K used on Z alone. It uses the one thing known exactly, H t = 1: for a smooth factor c,
    (H t c)(x) = c(x) + ∫ K(x - y) (c(y) - c(x)) t(y) dy, in which the singular part of the kernel drops out, so that
    the integral may be taken over cells of many elements. As in `blocks`, M⁻¹ is not symmetric, unless it is balanced
    by a factor (1 - ĤQ) on the right.

    Parameters
    ----------
    near : B.
    influence, shape, elements : the kernel, the grid and the set.
    t : pressure on the elements under uniform further indentation.

    References
    ----------
    J. M. Tang, R. Nabben, C. Vuik, Y. A. Erlangga, J. Sci. Comput. 39 (2009) 340-370 ("A-DEF2", and "BNN", the balanced
    one).
    """
    longer = max(shape)
    hats = round(_HATS * longer**0.5)
    cells = hats * _CELLS_PER_HAT
    size = longer / cells
    row, column = np.divmod(elements, shape[1])
    code = (row / size).astype(np.intp) * cells + (column / size).astype(np.intp)
    occupied = np.flatnonzero(np.bincount(code))
    count = occupied.size
    cell = np.empty(occupied[-1] + 1, dtype=np.intp)
    cell[occupied] = np.arange(count)
    cell = cell[code]
    x, y = np.divmod(occupied, cells)
    # K between cells, by one table of both signs of the offset: a plain two-index lookup takes three times as long
    reach = np.abs(np.arange(1 - cells, cells))
    rows, columns = (min(cells, n) for n in shape)
    table = influence[np.minimum(reach, rows - 1)[:, None], np.minimum(reach, columns - 1)] / size
    number = (x * (2 * cells - 1) + y).astype(np.int32)
    in_cells = table.astype(np.float32).ravel().take(np.subtract.outer(number, number) + (cells - 1) * 2 * cells)
    mass = np.bincount(cell, weights=t, minlength=count)
    hat = _hats(x, y, hats)
    hat = hat[:, mass @ hat > 1e-3 * mass.sum() / hat.shape[1]]
    # Ĥ Z by cells, the self term such that Ĥ t = 1; rounded to 32 bits, which is far closer than cells are
    sources = np.column_stack((mass[:, None] * hat, mass)).astype(np.float32)
    moved = (in_cells @ sources).astype(np.float64)
    moved = moved[:, :-1] + (1.0 - moved[:, -1:]) * hat
    coarse = hat.T @ (mass[:, None] * moved)
    weight = 1.0 / np.sqrt(mass @ hat)
    stiffness, modes = np.linalg.eigh(0.5 * (coarse + coarse.T) * weight[:, None] * weight)
    keep = stiffness > _MODES_ABOVE
    modes = weight[:, None] * modes[:, keep] / np.sqrt(stiffness[keep])
    moved, hat = moved @ modes, hat @ modes  # from here Q = Z Zᵀ

    def apply(r: Array, balanced: bool) -> Array:
        s = hat.T @ np.bincount(cell, weights=t * r, minlength=count)
        z = near(r - (moved @ s)[cell] if balanced else r)
        s -= moved.T @ np.bincount(cell, weights=z, minlength=count)
        return z + t * (hat @ s)[cell]

    return apply


def _hats(x: NDArray[Any], y: NDArray[Any], intervals: int) -> Array:
    """Return the bilinear hats at the cell centres, shape (cells, (intervals + 1)²); they add to one."""
    position = np.arange(intervals * _CELLS_PER_HAT) + 0.5
    tent = np.maximum(0.0, 1.0 - np.abs(position[:, None] / _CELLS_PER_HAT - np.arange(intervals + 1)))
    return (tent[x][:, :, None] * tent[y][:, None, :]).reshape(x.size, -1)
