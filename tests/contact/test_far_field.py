"""The far field of the approximate inverse: positive definite on any grid and contact, and against dense matrices."""

import math
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from roughvol.contact import far_field
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import influence_matrix
from roughvol.contact.near_field import near_field
from roughvol.contact.options import Tuning
from tests.contact.kit import KERNELS, SIDES, contact_set, half_space, of_units, random, spectrum_of

SIZES = range(9, 301)
PERIODS = [(17, 17), (64, 40), (9, 150), (61, 16)]


def inverse(space, elements, t, **constants):
    """M⁻¹ of the default constants, with other ones in their place."""
    tuning = Tuning(**constants)
    return far_field.by_blocks(near_field(space, elements, tuning), space, elements, t, tuning)


def random_contact(shape, generator, wanted=120):
    """About so many elements: scattered, in clusters, in a lump around the corner, or in a band along the first row."""
    share = min(1.0, wanted / math.prod(shape))
    row, column = (np.minimum(x, n - x) for x, n in zip(np.indices(shape), shape, strict=True))
    field = generator.random(shape)
    kind = generator.integers(4)
    if kind == 1:
        field = sum(np.roll(field, (i, j), (0, 1)) for i in range(3) for j in range(3))
    elif kind == 2:
        field = -(row + column) - 0.5 * field
    elif kind == 3:
        field = -np.minimum(row, 3) - 0.5 * field
    return np.flatnonzero(field.ravel() >= np.quantile(field, 1.0 - share))


def check_dense(shape, sides, kernel, generator, tiers=(256, 16, 3)):
    """All eigenvalues of M⁻¹ and of M⁻¹K, with one, two and three tiers of blocks."""
    space = HalfSpace(shape, kernel, sides=sides)
    elements = random_contact(shape, generator)
    matrix = space.between(elements)
    t = np.maximum(np.linalg.solve(matrix, np.ones(elements.size)), 0.0)
    if generator.random() < 0.3:
        t = generator.exponential(size=elements.size) ** 4
    for factorised_up_to in tiers:
        found = of_units(inverse(space, elements, t, factorised_up_to=factorised_up_to), elements.size)
        try:
            values = spectrum_of(found, matrix)
        except np.linalg.LinAlgError:
            values = np.array([0.0, 1.0])
        assert values[-1] < 20.0 * values[0], f"{shape}, {sides=}, {kernel}, {factorised_up_to=}"


def test_inverse_is_positive_definite_on_grids_of_any_size():
    generator = random(1)
    for number, rows in enumerate(range(9, 150, 12)):
        shape = (rows, rows if number % 3 else int(generator.choice(SIZES[:140])))
        check_dense(shape, SIDES[number % 3], KERNELS[number // 3 % 2], generator, ((256, 16, 3)[number // 6 % 3],))


@pytest.mark.slow
@pytest.mark.parametrize("kernel", ["love", "punch", "fourier"])
@pytest.mark.parametrize("first", SIZES[::20])
def test_inverse_is_positive_definite_on_grids_of_every_size_square_and_oblong(first, kernel):
    generator = random([first, 1])
    for rows in range(first, min(first + 20, SIZES.stop)):
        for columns in (rows, *generator.choice(SIZES, 3).tolist()):
            for sides in SIDES[1:] if kernel == "fourier" else SIDES:
                check_dense((rows, columns), sides, kernel, generator)


def least_and_largest(inverse, size, generator, steps=8):
    """Rayleigh-Ritz values of M⁻¹ in a Krylov space."""
    basis, r = np.zeros((size, 0)), generator.standard_normal(size)
    images = []
    for _ in range(steps):
        r -= basis @ (basis.T @ r)
        basis = np.column_stack((basis, r / np.linalg.norm(r)))
        images.append(inverse(basis[:, -1].astype(np.float32)).astype(float))
        r = images[-1].copy()
    small = basis.T @ np.column_stack(images)
    np.testing.assert_allclose(small, small.T, rtol=0, atol=1e-5 * np.abs(small).max())
    return np.linalg.eigvalsh(0.5 * (small + small.T))[[0, -1]]


# 0.11.1 was indefinite on 129, 133 and 137: a last block of a few elements on a period of three blocks of blocks
LARGE = [(129, 129), (133, 133), (137, 137), (116, 140), (17, 400)]
LARGER = [(n, n) for n in (130, 131, 136, 139, 144, 145, 207, 215, 258, 272)]
LARGER += [(187, 17), (117, 204), (174, 327), (250, 132), (268, 275), (328, 213), (17, 800)]


@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("shape", LARGE + [pytest.param(shape, marks=pytest.mark.slow) for shape in LARGER])
def test_inverse_is_positive_definite_on_large_contacts(shape, sides):
    generator, space = random(shape), HalfSpace(shape, sides=sides)
    smooth = sum(np.roll(generator.random(shape), (i, j), (0, 1)) for i in range(4) for j in range(4))
    for share in (0.1, 0.95):
        elements = np.flatnonzero(smooth.ravel() >= np.quantile(smooth, 1.0 - share))
        t = generator.exponential(size=elements.size)
        least, largest = least_and_largest(inverse(space, elements, t), elements.size, generator)
        assert 0.0 < least < largest < 3.0


@pytest.mark.parametrize(("shape", "factorised_up_to"), [((33, 33), 256), ((33, 33), 1), ((3, 120), 9)])
def test_any_guess_of_t_leaves_it_positive_definite(shape, factorised_up_to):
    space, elements, matrix, t = contact_set(shape)
    noise = random(1).exponential(size=t.size) ** 4
    for guess in (np.maximum(t, 0.0), noise, 0.0 * t, 1.0 * (noise == max(noise))):
        found = inverse(space, elements, guess, factorised_up_to=factorised_up_to)
        spectrum_of(of_units(found, elements.size), matrix)


@pytest.mark.parametrize("factorised_up_to", [256, 9])
def test_blocks_leave_nothing_for_the_iteration_to_find(factorised_up_to):
    space, elements, matrix, t = contact_set((65, 65), 1)
    maps = near_field(space, elements), inverse(space, elements, t, factorised_up_to=factorised_up_to)
    alone, found = (spectrum_of(of_units(map_, elements.size), matrix) for map_ in maps)
    assert found[0] > 0.5
    assert found[-1] < 1.8
    assert found[-1] / found[0] < 0.5 * alone[-1] / alone[0]


def test_without_a_factorisation_the_near_field_does(monkeypatch):
    monkeypatch.setattr(far_field.linalg, "cho_factor", Mock(side_effect=np.linalg.LinAlgError))
    space, elements, matrix, t = contact_set((65, 65), 1)
    found = spectrum_of(of_units(inverse(space, elements, t), elements.size), matrix)
    assert found[-1] / found[0] < 20.0


# ---- the parts of the proof


@pytest.mark.parametrize("sides", ["mirrored", "periodic"])
def test_blocks_of_a_plane_are_as_far_apart_as_they_begin_to_a_node(sides):
    for nodes in (*range(1, 80), 129, 399):
        axis = far_field.cut(nodes, 8, sides)
        starts = np.searchsorted(axis.block, np.arange(axis.distance.size))
        assert np.abs(axis.distance - starts).max() <= 1
        if sides == "periodic":
            short = np.minimum(axis.distance, nodes - axis.distance)
            assert np.array_equal(short[1:], short[:0:-1])  # the same both ways around


def seen(sides, shape, kernel="love"):
    """A half space of a tier. That of mirrored sides has a kernel that ends where no image is beside its element.

    A tier has points in place of the images beyond.
    """
    space = half_space(shape, kernel, sides)
    if sides != "mirrored":
        return space
    nearby = np.indices(space.influence.shape).max(axis=0) < 5
    return SimpleNamespace(shape=shape, sides=sides, influence=np.where(nearby, space.influence, 0.0))


def scattered(shape, sides, kernel="love", share=0.1):
    """A half space and elements in contact: in clusters on a free patch, at random on a plane; with their t."""
    if sides == "free":
        space, elements, matrix, t = contact_set(shape, kernel=kernel)
        return space, elements, matrix, np.maximum(t, 1e-3)
    space, generator = seen(sides, shape, kernel), random(2)
    elements = np.flatnonzero(generator.random(math.prod(shape)) < min(share, 600 / math.prod(shape)))
    matrix = influence_matrix(space.influence, elements, mirrored=sides == "mirrored")
    return space, elements, matrix, generator.exponential(size=elements.size)


def between_blocks(tier, shape, elements, t):
    """P of the definition, and the number of the block of each element."""
    code = 0  # blocks of eight nodes and a shorter last one, or equal shares of a period
    for place, nodes, blocks in zip(np.divmod(elements, shape[1]), shape, tier.shape, strict=True):
        code = code * blocks + (place * -(-nodes // 8) // nodes if tier.sides != "free" else place // 8)
    assert np.array_equal(tier.numbers, np.unique(code))
    block = np.searchsorted(tier.numbers, code)
    spread = np.zeros((elements.size, tier.numbers.size))
    spread[np.arange(elements.size), block] = t
    np.testing.assert_allclose(tier.mass, spread.sum(axis=0), rtol=1e-5)
    spread /= spread.sum(axis=0)
    np.testing.assert_allclose(tier.spread.toarray(), spread, rtol=1e-5, atol=0)
    return spread, block


def beside(tier):
    """Which blocks are near one another, also across the seam of a period of three blocks or more."""
    near = True
    for place, blocks in zip(np.divmod(tier.numbers, tier.shape[1]), tier.shape, strict=True):
        apart = np.abs(place[:, None] - place)
        near &= (apart <= 1) | ((apart == blocks - 1) & ((tier.sides == "periodic") and blocks > 2))
    return near


def check_tier(tier, shape, matrix, elements, t):
    """Near and moved of a tier against P, K P and Pᵀ K P. Return the operator between its blocks, and the exact one."""
    spread, block = between_blocks(tier, shape, elements, t)
    moved = matrix @ spread
    exact = spread.T @ moved
    here, k = np.nonzero(tier.neighbours < tier.numbers.size)
    there = tier.neighbours[here, k]
    np.testing.assert_allclose(tier.near[here, k], exact[here, there], rtol=0, atol=1e-6)
    mine = block[:, None] == here
    both = tier.moved.toarray()
    np.testing.assert_allclose(both[:, there][mine], (moved - exact[block])[:, there][mine], rtol=0, atol=2e-6)
    assert np.array_equal(both[:, tier.numbers.size :], np.eye(tier.numbers.size)[block])
    return tier.matrix(), exact


GRIDS = [("free", shape) for shape in ((50, 100), (3, 250))]
GRIDS += [(sides, shape) for sides in ("mirrored", "periodic") for shape in PERIODS]


@pytest.mark.parametrize(
    ("sides", "shape", "kernel"), [(*grid, KERNELS[number % 2]) for number, grid in enumerate(GRIDS)]
)
def test_operator_between_blocks_is_exact_nearby(sides, shape, kernel):
    space, elements, matrix, t = scattered(shape, sides, kernel)
    tier = far_field.Tier(space, elements, t)
    found, exact = check_tier(tier, shape, matrix, elements, t)
    near = np.zeros(exact.shape, dtype=bool)
    here, k = np.nonzero(tier.neighbours < tier.numbers.size)
    near[here, tier.neighbours[here, k]] = True
    assert np.array_equal(near, beside(tier))
    if sides != "mirrored":
        assert np.abs(found / exact - 1.0).max() < 0.5  # points for blocks


@pytest.mark.parametrize("sides", SIDES)
def test_operator_between_blocks_of_blocks_is_exact_nearby(sides):
    shape, generator = (133, 133), random(3)
    elements = np.flatnonzero(generator.random(shape) < 0.01)
    below = far_field.Tier(seen(sides, shape), elements, generator.exponential(size=elements.size))
    tier = far_field.Tier(below, below.numbers, below.mass)
    check_tier(tier, below.shape, below.matrix(), below.numbers, below.mass)


@pytest.mark.parametrize(("sides", "shape"), GRIDS[1:])
def test_near_field_of_blocks_is_the_factor_of_its_definition(sides, shape):
    space, elements, _, t = scattered(shape, sides)
    tier = far_field.Tier(space, elements, t)
    blocks = tier.shape
    x, y = np.divmod(tier.numbers, blocks[1])
    number = {place: i for i, place in enumerate(zip(x.tolist(), y.tolist(), strict=True))}
    matrix = tier.matrix()
    factor = np.zeros_like(matrix)
    for i in range(x.size):
        around = [(x[i] + a, y[i] + b) for a, b in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 0))]
        if sides == "periodic":
            around = [tuple(p % n if n > 2 else p for p, n in zip(place, blocks, strict=True)) for place in around]
        near = [number[place] for place in around if place in number]
        row = np.linalg.solve(matrix[np.ix_(near, near)], np.eye(len(near))[-1])
        factor[i, near] = row / np.sqrt(row[-1])
    got = of_units(far_field.near_field_of_blocks(tier), x.size)
    np.testing.assert_allclose(got, factor.T @ factor, rtol=0, atol=3e-6 * np.abs(got).max())
