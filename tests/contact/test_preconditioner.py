"""The approximate inverses of the solver against dense matrices, and the solver with each of them on small grids."""

from __future__ import annotations

import math
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from oracles import KERNELS, coefficients, dense_matrix

from roughvol.contact import far_field
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import influence_matrix
from roughvol.contact.loading import solve, sweep
from roughvol.contact.near_field import near_field
from roughvol.contact.options import Tuning
from roughvol.contact.preconditioner import approximate_inverse
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface

SHAPES = ((33, 33), (33, 65), (3, 120), (50, 19))


def grid(influence, periodic=False):
    """What the inverses see of a half space."""
    return SimpleNamespace(influence=influence, periodic=periodic)


@lru_cache
def contact_set(shape, seed=0, kernel="love"):
    """Elements in contact on a piece of a fractal surface, K between them, and t with K t = 1."""
    side = max(shape) - 1
    whole = random_midpoint_displacement(2.2, int(np.ceil(np.log2(side))), seed=seed).heights
    heights = whole[: shape[0], : shape[1]]
    surface = Surface(heights - heights.max(), 1.0)
    half_space = HalfSpace(shape, kernel)
    elements = np.flatnonzero(solve(surface, half_space, 3.0).contact())
    matrix = dense_matrix(coefficients(shape, kernel))[np.ix_(elements, elements)]
    return half_space.influence, elements, matrix, np.linalg.solve(matrix, np.ones(elements.size))


def dense(map_, size):
    return np.array([map_(unit) for unit in np.eye(size)], dtype=float).T


def eigenvalues(inverse, matrix):
    """Of M⁻¹ K, after checking that M⁻¹ is symmetric and positive definite."""
    np.testing.assert_allclose(inverse, inverse.T, rtol=0, atol=1e-5 * np.abs(inverse).max())
    factor = np.linalg.cholesky(0.5 * (inverse + inverse.T))  # fails unless it is positive definite
    return np.linalg.eigvalsh(factor.T @ matrix @ factor)


@pytest.mark.parametrize("shape", SHAPES)
def test_influence_matrix_is_k_of_the_offsets(shape):
    influence = coefficients(shape)
    elements = np.sort(np.random.Generator(np.random.PCG64(4)).choice(influence.size, 40, replace=False))
    wanted = dense_matrix(influence)[np.ix_(elements, elements)]
    assert np.array_equal(influence_matrix(influence, elements), wanted)
    every_eighth = influence[::8, ::8]  # a view, as blocks have it
    elements = np.arange(every_eighth.size)
    assert np.array_equal(influence_matrix(every_eighth, elements), dense_matrix(every_eighth))


# ---- near field


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("reach", [2.0**0.5, 5.0**0.5, 8.0**0.5])
def test_near_field_is_the_factor_of_its_definition(reach, kernel):
    shape = (33, 65)
    influence, elements, matrix, _ = contact_set(shape, kernel=kernel)
    row, column = np.divmod(elements, shape[1])
    factor = np.zeros_like(matrix)
    for i in range(elements.size):
        distance = np.hypot(row[: i + 1] - row[i], column[: i + 1] - column[i])
        beside = np.maximum(np.abs(row[: i + 1] - row[i]), np.abs(column[: i + 1] - column[i])) <= 2
        near = np.flatnonzero((distance <= reach + 1e-9) & beside)
        y = np.linalg.solve(matrix[np.ix_(near, near)], np.eye(near.size)[-1])
        factor[i, near] = y / np.sqrt(y[-1])
    got = dense(near_field(grid(influence), elements, Tuning(near_reach=reach)), elements.size)
    np.testing.assert_allclose(got, factor.T @ factor, rtol=0, atol=1e-6)


def test_near_field_of_neighbours_alone_is_the_inverse():
    shape = (9, 9)
    influence = coefficients(shape)
    elements = np.array([10, 11, 19, 20, 60])  # a square of four and one too far to be taken for a neighbour
    matrix = dense_matrix(influence)[np.ix_(elements, elements)]
    matrix[4, :4] = matrix[:4, 4] = 0.0
    got = dense(near_field(grid(influence), elements), 5)
    np.testing.assert_allclose(got, np.linalg.inv(matrix), rtol=0, atol=1e-6)


# ---- corrections for the far field


def corrected(influence, shape, elements, t, **constants):
    tuning = Tuning(**constants)
    near = near_field(grid(influence), elements, tuning)
    return near, far_field.by_blocks(near, grid(influence), elements, t, tuning)


@pytest.mark.parametrize("levels", ["factorised", "two", "three"])
@pytest.mark.parametrize("guess", ["t", "noise", "nothing", "one element"])
@pytest.mark.parametrize("shape", SHAPES)
def test_any_guess_of_t_leaves_it_positive_definite(shape, guess, levels):
    influence, elements, matrix, t = contact_set(shape)
    noise = np.random.Generator(np.random.PCG64(1)).exponential(size=t.size) ** 4
    t = {"t": np.maximum(t, 0.0), "noise": noise, "nothing": 0.0 * t, "one element": 1.0 * (noise == noise.max())}[
        guess
    ]
    up_to = {"factorised": 256, "two": 9, "three": 1}[levels]
    _, inverse = corrected(influence, shape, elements, t, factorised_up_to=up_to)
    eigenvalues(dense(inverse, elements.size), matrix)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("factorised_up_to", [256, 9])
def test_blocks_leave_nothing_for_the_iteration_to_find(seed, factorised_up_to):
    shape = (65, 65)
    influence, elements, matrix, t = contact_set(shape, seed)
    near, inverse = corrected(influence, shape, elements, t, factorised_up_to=factorised_up_to)
    alone, found = (eigenvalues(dense(map_, elements.size), matrix) for map_ in (near, inverse))
    assert found[0] > 0.5
    assert found[-1] < 1.8
    assert found[-1] / found[0] < 0.5 * alone[-1] / alone[0]


def blocks_along(nodes, periodic):
    """Block of each node of an axis: eight nodes each and a shorter last one, or equal shares of a period."""
    node = np.arange(nodes)
    return node * -(-nodes // 8) // nodes if periodic else node // 8


def between_blocks(tier, shape, elements, t):
    """P of the definition, and the number of the block of each element."""
    row, column = np.divmod(elements, shape[1])
    block_row, block_column = (blocks_along(nodes, tier.periodic) for nodes in shape)
    code = block_row[row] * tier.influence.shape[1] + block_column[column]
    assert np.array_equal(tier.numbers, np.unique(code))
    block = np.searchsorted(tier.numbers, code)
    spread = np.zeros((elements.size, tier.numbers.size))
    spread[np.arange(elements.size), block] = t
    np.testing.assert_allclose(tier.mass, spread.sum(axis=0), rtol=1e-5)
    spread /= spread.sum(axis=0)
    np.testing.assert_allclose(tier.spread.toarray(), spread, rtol=1e-5, atol=0)
    return spread, block


def beside(tier):
    """Return which blocks are near one another, also across the seam of a period of three blocks or more."""
    near = True
    for place, blocks in zip(np.divmod(tier.numbers, tier.influence.shape[1]), tier.influence.shape, strict=True):
        apart = np.abs(place[:, None] - place)
        near &= (apart <= 1) | ((apart == blocks - 1) & (tier.periodic and blocks > 2))
    return near


def operator(tier):
    """The matrix between blocks as the tier has it: points for distant blocks."""
    x, y = np.divmod(tier.numbers, tier.influence.shape[1])
    matrix = tier.influence[np.abs(x[:, None] - x), np.abs(y[:, None] - y)]
    here, k = np.nonzero(tier.neighbours < x.size)
    matrix[here, tier.neighbours[here, k]] = tier.near[here, k]
    return matrix


def period(shape, kernel="love"):
    """Elements in contact at random, some of them beside each other, and K and t as in `contact_set`."""
    influence = HalfSpace(shape, kernel, periodic=True).influence
    generator = np.random.Generator(np.random.PCG64(2))
    elements = np.flatnonzero(generator.random(shape) < 600 / math.prod(shape))
    return influence, elements, influence_matrix(influence, elements), generator.exponential(size=elements.size)


PERIODS = ((17, 17), (64, 40), (33, 70), (9, 150), (61, 16), (5, 129))


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", [(65, 65), (50, 100), (3, 250), *(("periodic", *shape) for shape in PERIODS)])
def test_operator_between_blocks_is_exact_nearby(shape, kernel):
    periodic, shape = shape[0] == "periodic", shape[-2:]
    influence, elements, matrix, t = period(shape, kernel) if periodic else contact_set(shape, kernel=kernel)
    t = np.maximum(t, 1e-3)
    tier = far_field.Tier(grid(influence, periodic), elements, t)
    spread, block = between_blocks(tier, shape, elements, t)
    moved = matrix @ spread
    exact = spread.T @ moved
    count = tier.numbers.size
    got = np.zeros((count, count))
    here, k = np.nonzero(tier.neighbours < count)
    got[here, tier.neighbours[here, k]] = tier.near[here, k]
    near = beside(tier)
    np.testing.assert_allclose(got, np.where(near, exact, 0.0), rtol=0, atol=1e-6)
    departure = np.where(near[block], moved - exact[block], 0.0)
    both = tier.moved.toarray()
    np.testing.assert_allclose(both[:, :count], departure, rtol=0, atol=2e-6)
    assert np.array_equal(both[:, count:], np.eye(count)[block])
    assert np.abs(operator(tier) / exact - 1.0).max() < 0.5  # points for blocks


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("kernel", KERNELS)
def test_operator_between_blocks_of_blocks_is_exact_nearby(kernel, periodic):
    shape = (133, 133)
    influence = HalfSpace(shape, kernel, periodic=periodic).influence
    generator = np.random.Generator(np.random.PCG64(3))
    elements = np.flatnonzero(generator.random(shape) < 0.01)
    t = generator.exponential(size=elements.size)
    below = far_field.Tier(grid(influence, periodic), elements, t)
    tier = far_field.Tier(below, below.numbers, below.mass)
    matrix = operator(below)
    spread, block = between_blocks(tier, below.influence.shape, below.numbers, below.mass)
    moved = matrix @ spread
    exact = spread.T @ moved
    here, k = np.nonzero(tier.neighbours < tier.numbers.size)
    np.testing.assert_allclose(tier.near[here, k], exact[here, tier.neighbours[here, k]], rtol=0, atol=1e-6)
    departure = (moved - exact[block])[:, tier.neighbours[here, k]]
    got = tier.moved.toarray()[:, tier.neighbours[here, k]]
    mine = block[:, None] == here
    np.testing.assert_allclose(got[mine], departure[mine], rtol=0, atol=1e-6)


@pytest.mark.parametrize("shape", [(65, 65), *(("periodic", *shape) for shape in PERIODS)])
def test_near_field_of_blocks_is_the_factor_of_its_definition(shape):
    periodic, shape = shape[0] == "periodic", shape[-2:]
    influence, elements, _, t = period(shape) if periodic else contact_set(shape)
    tier = far_field.Tier(grid(influence, periodic), elements, t)
    x, y = np.divmod(tier.numbers, tier.influence.shape[1])
    wraps = [periodic and blocks > 2 for blocks in tier.influence.shape]
    number = {place: i for i, place in enumerate(zip(x.tolist(), y.tolist(), strict=True))}
    matrix = operator(tier)
    factor = np.zeros_like(matrix)
    for i in range(x.size):
        around = [(x[i] + a, y[i] + b) for a, b in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 0))]
        around = [
            tuple(p % n if w else p for p, n, w in zip(a, tier.influence.shape, wraps, strict=True)) for a in around
        ]
        near = [number[place] for place in around if place in number]
        row = np.linalg.solve(matrix[np.ix_(near, near)], np.eye(len(near))[-1])
        factor[i, near] = row / np.sqrt(row[-1])
    got = dense(lambda r: far_field.near_field_of_blocks(tier)(r.astype(np.float32)), x.size)
    np.testing.assert_allclose(got, factor.T @ factor, rtol=0, atol=3e-6 * np.abs(got).max())


def test_without_a_factorisation_the_near_field_does(monkeypatch):
    influence, elements, matrix, t = contact_set((65, 65))

    def fails(*_, **__):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(far_field.linalg, "cho_factor", fails)
    _, inverse = corrected(influence, (65, 65), elements, t)
    found = eigenvalues(dense(inverse, elements.size), matrix)
    assert found[-1] / found[0] < 20.0


# ---- who is expected in contact


@lru_cache
def lifted(**constants):
    """Return a contact with elements around it that hardly penetrate, and the inverse for both."""
    shape = (65, 65)
    influence, elements, _, t = contact_set(shape)
    around = np.unique((elements[:, None] + np.array([-66, -65, -1, 0, 1, 65, 66])).clip(0, 65 * 65 - 1))
    inside = np.isin(around, elements)
    pressure, gap = np.where(inside, 1.0, 0.0), np.where(inside, -0.01, -1e-6)
    rates = np.zeros(around.size), np.ones(around.size)
    rates[0][inside] = t
    free = (pressure > 0) | (gap < 0)
    inverse, free = approximate_inverse(HalfSpace(shape), around, pressure, gap, free, rates, Tuning(**constants))
    assert free[inside].all()
    assert free[~inside].mean() < 0.1
    matrix = dense_matrix(coefficients(shape))[np.ix_(around, around)]
    return around, inverse, free, matrix, influence


@pytest.mark.parametrize("again_from", [0, 10**9])
def test_elements_that_neighbours_lift_clear_are_left_out_and_right_for_the_others(again_from):
    around, inverse, free, matrix, _ = lifted(lifted_again_from=again_from)
    kept = np.flatnonzero(free)
    found = eigenvalues(dense(inverse, around.size)[np.ix_(kept, kept)], matrix[np.ix_(kept, kept)])
    assert found[0] > 0.4
    assert found[-1] < 2.0


def test_an_element_left_out_takes_part_with_the_near_field_around_it():
    around, inverse, free, matrix, _ = lifted()
    row, column = np.divmod(around, 65)
    whole = dense(inverse, around.size)
    for one in np.flatnonzero(~free):
        near = free & (np.abs(row - row[one]) <= 2) & (np.abs(column - column[one]) <= 2)
        near[one] = True
        near = np.flatnonzero(near)
        wanted = np.zeros(around.size)
        wanted[near] = np.linalg.solve(matrix[np.ix_(near, near)], (near == one).astype(float))
        np.testing.assert_allclose(whole[:, one], wanted, rtol=0, atol=3e-6 * wanted.max())


def test_elements_left_out_that_are_in_contact_after_all_are_as_well_served_as_the_rest():
    around, inverse, free, matrix, _ = lifted()
    row, column = np.divmod(around, 65)
    apart = np.flatnonzero(~free & (row % 8 == 0) & (column % 8 == 0))
    assert apart.size > 4
    together = np.union1d(np.flatnonzero(free), apart)
    # linear only while the same elements take part: the ones with r ≠ 0
    all_of_them = np.isin(np.arange(around.size), together).astype(float)
    some = dense(lambda r: inverse(all_of_them + r) - inverse(all_of_them), around.size)[np.ix_(together, together)]
    found = eigenvalues(some, matrix[np.ix_(together, together)])
    assert found[0] > 0.65  # alone: 0.58
    assert found[-1] < 1.5


def test_many_that_take_part_again_are_handled_piece_by_piece():
    _, inverse, free, _, _ = lifted()
    _, pieces, _, _, _ = lifted(cache=64 * 3)
    r = np.where(free, 0.0, 1.0)
    np.testing.assert_allclose(pieces(r), inverse(r), rtol=0, atol=1e-6)


# ---- the solver with every kind, on grids small enough to compare


KINDS = {
    "factorised blocks": {},
    "blocks of blocks": {"factorised_up_to": 5},
    "smaller blocks": {"block_side": 4},
    "nothing left out": {"lifted_rounds": 0, "lifted_again_from": 0},
    "left out again": {"lifted_again_from": 0},
    "short reach": {"near_reach": 2.0**0.5},
    "cut always": {"cut_every": 1},
    "every step measured": {"last_step": 0.0},
}


@lru_cache
def factorised(D, kernel):
    """Return a sweep by factorisations alone: exact, and nothing of the iteration."""
    surface = random_midpoint_displacement(D, 6, seed=5)
    half_space = HalfSpace(surface.shape, kernel)
    steps = np.linspace(0.0, (surface.z_max - surface.mean_height) / surface.Sq, 7)[1:]
    return surface, half_space, steps, list(sweep(surface, half_space, steps, tuning=Tuning(dense_up_to=10**6)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("D", [2.1, 2.8])
def test_sweep_does_not_depend_on_the_constants(D, kernel, kind):
    surface, half_space, steps, exact = factorised(D, kernel)
    iterated = Tuning(dense_up_to=0, **KINDS[kind])
    for one, other in zip(sweep(surface, half_space, steps, rtol=1e-9, tuning=iterated), exact, strict=True):
        assert one.residual <= 1e-9
        np.testing.assert_allclose(one.pressure(), other.pressure(), rtol=0, atol=1e-7 * other.pressure().max())
        assert np.array_equal(one.contact(), other.contact())


@pytest.mark.parametrize("precision", ["mixed", "double"])
@pytest.mark.parametrize("D", [2.1, 2.5, 2.9])
def test_rough_states_do_not_stall_the_next(D, precision):
    surface = random_midpoint_displacement(D, 8, seed=1)
    last = (surface.z_max - surface.mean_height) / surface.Sq
    steps = last * np.arange(1, 61) / 60
    contacts = list(sweep(surface, HalfSpace(surface.shape), steps, rtol=0.1, precision=precision))
    assert max(c.iterations for c in contacts) < 200  # 2000 is where an iteration is given up


@pytest.mark.slow
def test_iterations_hardly_grow_with_the_grid():
    means = []
    for m in (9, 10):
        surface = random_midpoint_displacement(2.5, m, seed=1)
        last = (surface.z_max - surface.mean_height) / surface.Sq
        contacts = list(sweep(surface, HalfSpace(surface.shape), last * np.arange(1, 61) / 60))
        means.append(np.mean([c.iterations for c in contacts[40:]]))
    assert means[0] < 5.5
    assert means[1] < 1.1 * means[0]
