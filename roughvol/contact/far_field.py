"""The far field of K⁻¹: corrections of the near field by blocks of elements and blocks of blocks.

Equation (15) of docs/explanation/solver.md, with its symbols. B is the near field on the elements:

    M⁻¹ = P C Pᵀ + (1 - P Xᵀ) B (1 - X Pᵀ),        X = E + N C.

P spreads the force of a block over its elements in proportion to t, the pressure with K t = 1 on the contact. Pᵀ takes
the mean over a block, weighted by t. C ≈ (Pᵀ K P)⁻¹ is the same problem between blocks, solved in the same way.

M⁻¹ is symmetric and positive definite for any sides of the grid, any contact, any t ≥ 0 and any N:

- With m = Pᵀr and s = r - X m, rᵀM⁻¹r = mᵀC m + sᵀB s. For positive definite C and B this is zero only if m = 0 and
  s = 0, and then r = s + X m = 0.
- C of the last tier is the inverse of a matrix with a Cholesky factor, or else the near field of the blocks. C of any
  other tier is an M⁻¹ of the blocks, so induction applies.
- B = GᵀG, and G is invertible. On a free patch G is triangular with a positive diagonal. Around a period, and between
  blocks on either grid, the rows of G are strictly dominant (`near_field.dominant`).

Numbers have 32 bits, so the proof also needs a C that is not large. C becomes large if the matrix between blocks is
nearly singular or indefinite. That happens where blocks that touch have the coefficient of two distant points. An
endless plane is therefore cut into blocks of equal length, up to one element. Blocks at the seam of a period count as
neighbours. At a mirrored side the image of a block beside it has an exact coefficient; images farther away are points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

from roughvol.contact.kernels import influence_matrix, short_way
from roughvol.contact.near_field import dominant
from roughvol.contact.options import TUNING, Tuning
from roughvol.contact.state import Compliance
from roughvol.typing import Array, Index, Map, Shape, Sides, Single

_AROUND = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1))  # offsets to the blocks around a block, and itself
_CENTRE = _AROUND.index((0, 0))
_Images = Callable[[list[Single], int], Single]


def by_blocks(near: Map, half_space: Compliance, elements: Index, t: NDArray[Any], tuning: Tuning = TUNING) -> Map:
    """Return r ↦ M⁻¹ r on the elements, in 32 bits, from r ↦ B r (`near`) and t ≥ 0.

    J. M. Tang, R. Nabben, C. Vuik, Y. A. Erlangga, J. Sci. Comput. 39 (2009) 340-370 ("BNN", two levels).
    """
    return _corrected(near, Tier(half_space, elements, t, tuning), tuning)


def _corrected(near: Map, blocks: Tier, tuning: Tuning) -> Map:
    """Return M⁻¹ for the elements that make up the blocks."""
    solved = _between_blocks(blocks, tuning)
    spread, moved, count = blocks.spread, blocks.moved, blocks.numbers.size
    mean, moments = spread.T, moved.T

    def apply(r: NDArray[Any]) -> NDArray[Any]:
        r = r.astype(np.float32, copy=False)
        means = mean @ r  # Pᵀ r
        forces = solved(means)  # C Pᵀ r
        z = near(r - moved @ np.concatenate((forces, means)))  # B (1 - X Pᵀ) r; N and E side by side
        back = moments @ z  # Nᵀ z and Eᵀ z
        forces -= solved(back[:count])
        forces -= back[count:]
        z += spread @ forces
        return z

    return apply


def _between_blocks(blocks: Tier, tuning: Tuning) -> Map:
    """Return C, the inverse of the operator between blocks: a factorisation, or the same method for many blocks."""
    if blocks.numbers.size > tuning.factorised_up_to:
        above = Tier(blocks, blocks.numbers, blocks.mass, tuning)
        return _corrected(near_field_of_blocks(blocks, tuning), above, tuning)
    try:
        factor = linalg.cho_factor(blocks.matrix(), lower=True, check_finite=False)
    except linalg.LinAlgError:  # points in place of blocks are too rough
        return near_field_of_blocks(blocks, tuning)
    return lambda r: linalg.cho_solve(factor, r, check_finite=False).astype(np.float32)


@dataclass(frozen=True)
class Cut:
    """The blocks along one axis: the `block` of each node, its place `within`, and the nodes `spare` of a short block.

    `distance` (blocks,) is the number of nodes between the starts of blocks 0, 1, 2 … apart. With `closed`, the last
    block is beside the first one. Fewer than three blocks around a period have coefficients that hold all images.
    """

    blocks: int
    closed: bool
    block: NDArray[np.int32]
    within: NDArray[np.int32]
    spare: NDArray[np.int32]
    distance: Index

    def around(self, offset: Any) -> Any:
        """Return offsets between blocks the short way around a period, as far as -1."""
        return (offset + 1) % self.blocks - 1 if self.closed else offset


@lru_cache(maxsize=16)
def cut(nodes: int, side: int, sides: Sides) -> Cut:
    """Cut an axis into blocks of a side: on an endless plane of lengths that differ by one node at most."""
    blocks = -(-nodes // side)
    node, apart = np.arange(nodes), np.arange(blocks + (sides == "mirrored"))
    if sides != "free":
        block = node * blocks // nodes
        start = -(-np.arange(blocks + 1) * nodes // blocks)
        within, spare = node - start[block], side - np.diff(start)[block]
        distance = (2 * nodes * apart + blocks) // (2 * blocks)  # rounded, the same both ways around
        if sides == "periodic":
            distance = np.where(2 * apart > blocks, nodes - distance[-apart], distance)
    else:
        block, within, spare, distance = node // side, node % side, np.zeros_like(node), apart * side
    small = [array.astype(np.int32) for array in (block, within, spare)]
    return Cut(blocks, sides == "periodic" and blocks >= 3, small[0], small[1], small[2], distance)


@dataclass(frozen=True)
class _Frames:
    """Places of elements in the frames of their blocks, side × side places a block.

    A block shorter than its frame lies at the start of the frame, or at the end where the block beside it comes next:
    all frames beside each other are then one side apart. `end` is 2 for the end along rows, plus 1 for that along
    columns. `ends` is 1 if no block is short.
    """

    side: int
    rows: Cut
    columns: Cut
    row: NDArray[np.int32]
    column: NDArray[np.int32]
    of_element: NDArray[np.int32]

    @cached_property
    def ends(self) -> int:
        return 4 if self.rows.spare.any() or self.columns.spare.any() else 1

    @cached_property
    def position(self) -> Index:
        """Flat places of elements in frames whose blocks lie at the start."""
        within = self.rows.within.take(self.row) * self.side + self.columns.within.take(self.column)
        return self.of_element.astype(np.intp) * self.side**2 + within

    def places(self, some: slice, end: int) -> Index:
        """Return flat places of some elements in frames whose blocks lie at an end."""
        if not end:
            return self.position[some]
        low, far = divmod(end, 2)
        along_rows: NDArray[Any] = low * self.side * self.rows.spare.take(self.row[some])
        return self.position[some] + along_rows + far * self.columns.spare.take(self.column[some])

    def shapes(self, t: NDArray[Any], count: int) -> Single:
        """Return t in the frames of blocks (count + 1, side²); the last frame is that of an absent block."""
        shapes = np.zeros((count + 1, self.side**2), dtype=np.float32)
        shapes.ravel()[self.position] = np.maximum(t, 1e-9 * t.max()) if t.any() else 1.0  # no block without force
        return shapes

    def moved(self, shape: Shape, share: Single, end: int) -> Single:
        """Return shares of elements in frames whose blocks lie at an end."""
        shapes = np.zeros(shape, dtype=np.float32)
        shapes.ravel()[self.places(slice(None), end)] = share
        return shapes


class Tier:
    """Elements in blocks, and the operator Pᵀ K P between blocks; the elements may be the blocks of another tier.

    `numbers` are the flat indices of the blocks that hold elements, and `mass` the sum of t over each. `neighbours`
    (blocks, 9) are positions in `numbers`, or `numbers.size` for none; `near` has the exact coefficients with them,
    and with images that touch. `influence` is the kernel between distant blocks. `spread` is P, `moved` N beside E.
    """

    def __init__(self, grid: Compliance | Tier, elements: Index, t: NDArray[Any], tuning: Tuning = TUNING) -> None:
        side = tuning.block_side
        self.sides: Sides = grid.sides
        self.rows, self.columns = (cut(nodes, side, self.sides) for nodes in grid.shape)
        self.shape: Shape = (self.rows.blocks, self.columns.blocks)
        self.influence: Array = grid.influence[np.ix_(self.rows.distance, self.columns.distance)]
        row, column = np.divmod(elements.astype(np.int32), np.int32(grid.shape[1]))
        block_row, block_column = self.rows.block.take(row), self.columns.block.take(column)
        block: NDArray[np.int32] = block_row * np.int32(self.columns.blocks) + block_column
        self.numbers: Index = np.flatnonzero(np.bincount(block))
        count = self.numbers.size
        number = np.full(self.rows.blocks * self.columns.blocks, count, dtype=np.int32)
        number[self.numbers] = np.arange(count, dtype=np.int32)
        of_element = number[block]
        around, images = self._around(number.reshape(self.shape), side)
        self.neighbours: NDArray[np.int32] = np.minimum(around, count)

        frames = _Frames(side, self.rows, self.columns, row, column, of_element)
        shapes = frames.shapes(t, count)
        self.mass: Single = shapes[:count].sum(axis=1)
        shapes[:count] /= self.mass[:, None]
        share = shapes.ravel().take(frames.position)
        start = np.arange(elements.size + 1, dtype=np.int32)
        self.spread = sparse.csr_array((share, of_element, start), shape=(elements.size, count))

        acting = [shapes, *(frames.moved(shapes.shape, share, end) for end in range(1, frames.ends))]
        if images:
            acting = [np.vstack((shapes, images(acting, end))) for end, shapes in enumerate(acting)]
        pieces = _whole_rows(block_row, self.numbers // self.columns.blocks, tuning.cache // 64)  # in cache
        data = _displacements(frames, acting, around, _near(grid, side, images=images is not None), pieces)
        if images:
            self._fold(data, block_row, block_column)
        if isinstance(grid, Tier):
            data += self._excess(grid, share, block_row, block_column)
        self._set_moments(data, of_element, pieces)

    def _around(self, number: NDArray[np.int32], side: int) -> tuple[NDArray[np.int32], _Images | None]:
        """Return the numbers of the blocks around each block, (blocks, 9), and the shapes of images among them."""
        absent = self.numbers.size
        for axis, blocks in enumerate((self.rows, self.columns)):
            ends = [(1, 1) if k == axis else (0, 0) for k in range(2)]
            number = np.pad(number, ends, "wrap") if blocks.closed else np.pad(number, ends, constant_values=absent)
        images = _images(number, absent, side) if self.sides == "mirrored" else None
        row, column = np.divmod(self.numbers[:, None], self.columns.blocks)
        down, right = np.transpose(_AROUND)
        return number[row + 1 + down, column + 1 + right], images

    def _excess(self, grid: Tier, share: Single, block_row: NDArray[Any], block_column: NDArray[Any]) -> NDArray[Any]:
        """Return what the exact coefficients of elements that are blocks add to displacements: as `_displacements`."""
        target, k = np.nonzero(grid.neighbours < share.size)
        source = grid.neighbours[target, k]
        excess = (grid.near[target, k] - grid.points[target, k]) * share[source]
        down = self.rows.around(block_row[source] - block_row[target])
        right = self.columns.around(block_column[source] - block_column[target])
        size = len(_AROUND) + 1
        place = target * size + (down + 1) * 3 + right + 1
        added: NDArray[Any] = np.bincount(place, excess, share.size * size).reshape(share.size, size)
        return added

    def _set_moments(self, data: Single, of_element: NDArray[np.int32], pieces: list[tuple[slice, slice]]) -> None:
        """Set `near`, means of displacements over blocks, and `moved`, the rest, which takes the place of `data`."""
        count = self.numbers.size
        means = self.spread.T @ data
        self.near: Single = means[:, :-1].copy()
        means[:, -1] = 0.0
        of_block = np.empty((count, data.shape[1]), dtype=np.int32)
        of_block[:, :-1] = np.minimum(self.neighbours, count - 1)
        of_block[:, -1] = np.arange(count, 2 * count)
        into = np.empty(data.shape, dtype=np.int32)
        for some, _ in pieces:
            data[some] -= means.take(of_element[some], axis=0)
            of_block.take(of_element[some], axis=0, out=into[some], mode="clip")
        start = np.arange(0, data.size + 1, data.shape[1], dtype=np.int32)
        self.moved = sparse.csr_array((data.ravel(), into.ravel(), start), shape=(len(data), 2 * count))

    @cached_property
    def points(self) -> Array:
        """Coefficients between points in place of the blocks, for `near`."""
        points = np.tile([_at(self.influence, i, j) for i, j in _AROUND], (self.numbers.size, 1))
        if self.sides == "mirrored":
            self._fold(points, *np.divmod(self.numbers, self.shape[1]))
        return points

    def matrix(self) -> Array:
        """Return the operator between blocks, exact for blocks that touch."""
        here, k = np.nonzero(self.neighbours < self.numbers.size)
        there, mirrored = self.neighbours[here, k], self.sides == "mirrored"
        matrix = influence_matrix(self.influence, self.numbers, mirrored=mirrored)
        # Images that do not touch a block act on it as points.
        matrix[here, there] = (
            matrix[here, there] - self.points[here, k] + self.near[here, k] if mirrored else self.near[here, k]
        )
        return matrix

    def _fold(self, values: NDArray[Any], row: NDArray[Any], column: NDArray[Any]) -> None:
        """Add what comes from the images around blocks, (n, 9 …), to the blocks themselves, in place."""
        number = np.arange(len(_AROUND)).reshape(3, 3)
        for place, blocks, lines in ((row, self.shape[0], number), (column, self.shape[1], number.T)):
            for end, outer in ((0, lines[0]), (blocks - 1, lines[2]))[: min(blocks, 2)]:
                some = np.flatnonzero(place == end)[:, None]
                values[some, lines[1]] += values[some, outer]
                values[some, outer] = 0.0


def _displacements(
    frames: _Frames, acting: list[Single], around: NDArray[np.int32], tables: Single, pieces: list[tuple[slice, slice]]
) -> Single:
    """Return displacements of elements by a unit force on each block around, and E as last column, (elements, 10)."""
    data = np.empty((frames.row.size, len(_AROUND) + 1), dtype=np.float32)
    data[:, -1] = 1.0
    for some, blocks in pieces:
        at = [frames.places(some, end) - blocks.start * frames.side**2 for end in range(frames.ends)]
        for j, (down, right) in enumerate(_AROUND):
            force = (2 * (down < 0) + (right < 0)) % frames.ends
            moved = (2 * (down > 0) + (right > 0)) % frames.ends
            field = acting[force][around[blocks, j]] @ tables[j]
            data[some, j] = field.ravel().take(at[moved])
    return data


def _near(grid: Compliance | Tier, side: int, *, images: bool) -> Single:
    """Return the tables of displacements by blocks around."""
    influence = grid.influence[: 2 * side, : 2 * side]
    if images:
        apart = (short_way(np.arange(2 * min(side, nodes)), nodes) for nodes in grid.shape)
        influence = grid.influence[np.ix_(*apart)]
    return _tables(influence.tobytes(), influence.shape[0], side)


def _images(numbers: NDArray[np.int32], absent: int, side: int) -> _Images:
    """Return the shapes of the images of blocks along mirrored sides, as a function of those of the blocks.

    The function takes the shapes by the ends of their frames, and the end at which an image lies. Images get numbers
    from `absent` + 1 on in `numbers`, a grid with one line of absent blocks on each side. A single block along an axis
    has an image on one side of it; the one on the other side belongs to the next period.
    """
    whole = np.pad(numbers[1:-1, 1:-1], 1, mode="symmetric")
    flips = np.zeros((2, *numbers.shape), dtype=bool)
    flips[0, [0, -1]] = flips[1, :, [0, -1]] = True
    found = flips.any(axis=0) & (whole < absent)
    found[-1] &= numbers.shape[0] > 3
    found[:, -1] &= numbers.shape[1] > 3
    numbers[found] = absent + 1 + np.arange(np.count_nonzero(found), dtype=np.int32)
    source, (up, left) = whole[found], flips[:, found]

    def shapes(frames: list[Single], end: int) -> Single:
        images = np.empty((source.size, side, side), dtype=np.float32)
        for down, right in ((0, 1), (1, 0), (1, 1)):
            some = (up == down) & (left == right)
            other = frames[(end ^ (2 * down + right)) % len(frames)]  # an image lies at the other end of its frame
            block = other[source[some]].reshape(-1, side, side)
            images[some] = block[:, :: 1 - 2 * down, :: 1 - 2 * right]
        return images.reshape(source.size, side**2)

    return shapes


@lru_cache(maxsize=16)
def _tables(influence: bytes, rows: int, side: int) -> Single:
    """Return the displacement by each element of a block around (rows) of each element of a block (columns)."""
    given = np.frombuffer(influence).reshape(rows, -1)
    kernel = np.zeros((2 * side, 2 * side))
    kernel[: given.shape[0], : given.shape[1]] = given
    node = np.arange(side)
    tables = np.empty((len(_AROUND), side**2, side**2), dtype=np.float32)
    for k, (i, j) in enumerate(_AROUND):
        row = np.abs(node[:, None] + i * side - node)
        column = np.abs(node[:, None] + j * side - node)
        tables[k] = kernel[row[:, None, :, None], column[None, :, None, :]].reshape(side**2, side**2)
    return tables


def _whole_rows(block_row: NDArray[Any], rows: NDArray[Any], count: int) -> list[tuple[slice, slice]]:
    """Return pieces of whole rows of blocks, about `count` elements each, and their blocks; both arrays increase."""
    until = np.searchsorted(block_row, np.arange(1, rows[-1] + 2))
    ends = np.flatnonzero(np.diff(until // count, append=-1)) + 1
    edges = [0, *until[ends - 1].tolist()], [0, *np.searchsorted(rows, ends).tolist()]
    return list(zip(*([slice(*pair) for pair in pairwise(edge)] for edge in edges), strict=True))


def _at(influence: Array, row: int, column: int) -> float:
    """Return K at an offset, or an unused coefficient where the grid does not reach so far."""
    return float(influence[min(abs(row), influence.shape[0] - 1), min(abs(column), influence.shape[1] - 1)])


def near_field_of_blocks(blocks: Tier, tuning: Tuning = TUNING) -> Map:
    """Return the near field of the operator between blocks, from the preceding blocks around each.

    Coefficients differ from block to block: one Cholesky factorisation solves all systems, with vectors over blocks.
    """
    before = _AROUND[: _CENTRE + 1]
    count, size = blocks.numbers.size, len(before)
    members = [blocks.neighbours[:, k] for k in range(size)]
    present = np.array([member < count for member in members])
    near = np.vstack((blocks.near, np.zeros((1, len(_AROUND)), dtype=np.float32)))
    factor = np.zeros((size, size, count), dtype=np.float32)
    for i, (row, column) in enumerate(before):
        factor[i, i] = np.where(present[i], near[members[i], _CENTRE], 1.0)
        for j, (other_row, other_column) in enumerate(before[:i]):
            offset = blocks.rows.around(other_row - row), blocks.columns.around(other_column - column)
            if offset in _AROUND:
                factor[i, j] = near[members[i], _AROUND.index(offset)] * present[j]
            else:
                factor[i, j] = _at(blocks.influence, *offset) * (present[i] & present[j])
    least = tuning.least_pivot * np.diagonal(factor).T
    for j in range(size):
        factor[j, j] = np.sqrt(np.maximum(factor[j, j], least[j]))
        factor[j + 1 :, j] /= factor[j, j]
        for i in range(j + 1, size):
            factor[i, j + 1 : i + 1] -= factor[i, j] * factor[j + 1 : i + 1, j]
    rows = np.zeros((size, count), dtype=np.float32)
    rows[-1] = 1.0 / factor[-1, -1]
    for i in range(size - 2, -1, -1):
        rows[i] = -(factor[i + 1 :, i] * rows[i + 1 :]).sum(axis=0) / factor[i, i]
    rows *= present
    dominant(rows[:-1], rows[-1])
    start = np.arange(0, rows.size + 1, size, dtype=np.int32)
    columns = np.minimum(members, count - 1).T.ravel()
    inverse = sparse.csr_array((rows.T.ravel(), columns, start), shape=(count, count))
    transposed = inverse.T
    return lambda r: transposed @ (inverse @ r)
