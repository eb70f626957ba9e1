"""M⁻¹ is symmetric and positive definite for every size of a grid and any contact, on a free patch and on a period."""

from __future__ import annotations

import numpy as np
import pytest

from roughvol.contact import far_field, preconditioner
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import influence_matrix
from roughvol.contact.loading import sweep
from roughvol.contact.near_field import dominant, near_field
from roughvol.contact.options import Tuning
from roughvol.surfaces.midpoint import random_midpoint_displacement

SIZES = range(9, 301)


def random_contact(shape, generator, wanted=150):
    """About so many elements: scattered, in clusters, in a lump around the corner, or in a band along the first row."""
    share = min(1.0, wanted / (shape[0] * shape[1]))
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


def inverse(half_space, elements, t, **constants):
    """M⁻¹ of the default constants, with other ones in their place."""
    tuning = Tuning(**constants)
    return far_field.by_blocks(near_field(half_space, elements, tuning), half_space, elements, t, tuning)


def check_dense(shape, periodic, kernel, generator):
    """All eigenvalues of M⁻¹ and of M⁻¹K, with one, two and three tiers of blocks."""
    half_space = HalfSpace(shape, kernel, periodic=periodic)
    elements = random_contact(shape, generator)
    matrix = influence_matrix(half_space.influence, elements)
    t = np.maximum(np.linalg.solve(matrix, np.ones(elements.size)), 0.0)
    if generator.random() < 0.3:
        t = generator.exponential(size=elements.size) ** 4
    for factorised_up_to in (256, 16, 3):
        of_units = inverse(half_space, elements, t, factorised_up_to=factorised_up_to)
        found = of_units(np.eye(elements.size, dtype=np.float32)).astype(float)
        case = f"{shape}, {periodic=}, {kernel}, {factorised_up_to=}"
        assert np.abs(found - found.T).max() <= 1e-5 * np.abs(found).max(), case
        try:
            factor = np.linalg.cholesky(0.5 * (found + found.T))
        except np.linalg.LinAlgError:
            pytest.fail(f"not positive definite: {case}")
        values = np.linalg.eigvalsh(factor.T @ matrix @ factor)
        assert values[-1] < 20.0 * values[0], case


@pytest.mark.parametrize("first", SIZES[::20])
def test_of_every_size(first):
    generator = np.random.Generator(np.random.PCG64(first))
    for rows in range(first, min(first + 20, SIZES.stop)):
        for periodic in (False, True):
            columns = rows if generator.random() < 0.5 else int(generator.choice(SIZES))
            check_dense((rows, columns), periodic, str(generator.choice(["love", "punch"])), generator)


@pytest.mark.slow
@pytest.mark.parametrize("kernel", ["love", "punch", "fourier"])
@pytest.mark.parametrize("first", SIZES[::20])
def test_of_every_size_square_and_oblong(first, kernel):
    generator = np.random.Generator(np.random.PCG64([first, 1]))
    for rows in range(first, min(first + 20, SIZES.stop)):
        for columns in (rows, *generator.choice(SIZES, 3).tolist()):
            for periodic in (True,) if kernel == "fourier" else (False, True):
                check_dense((rows, columns), periodic, kernel, generator)


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
LARGE = [(n, n) for n in (129, 130, 131, 133, 136, 137, 139, 144, 145, 207, 215, 258, 272)]
LARGE += [(116, 140), (117, 204), (174, 327), (187, 17), (250, 132), (268, 275), (328, 213), (17, 800)]


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("shape", LARGE)
def test_of_large_contacts(shape, periodic):
    generator = np.random.Generator(np.random.PCG64(shape))
    half_space = HalfSpace(shape, periodic=periodic)
    smooth = sum(np.roll(generator.random(shape), (i, j), (0, 1)) for i in range(4) for j in range(4))
    for share in (0.1, 0.5, 0.95):
        elements = np.flatnonzero(smooth.ravel() >= np.quantile(smooth, 1.0 - share))
        t = generator.exponential(size=elements.size)
        least, largest = least_and_largest(inverse(half_space, elements, t), elements.size, generator)
        assert 0.0 < least < largest < 3.0


# ---- the parts of the proof


@pytest.mark.parametrize("periodic", [False, True])
def test_blocks_along_an_axis_hold_every_node_once(periodic):
    for nodes in range(1, 400):
        axis = far_field.cut(nodes, 8, periodic)
        lengths = np.bincount(axis.block)
        assert lengths.size == axis.blocks == -(-nodes // 8)
        assert (np.diff(axis.block) >= 0).all()
        assert np.array_equal(axis.within, np.concatenate([np.arange(n) for n in lengths]))
        if periodic:
            assert lengths.min() >= lengths.max() - 1
            assert lengths.max() <= 8
            assert np.array_equal(axis.spare, 8 - lengths[axis.block])
            starts = np.searchsorted(axis.block, np.arange(axis.blocks))
            assert np.abs(axis.distance - starts).max() <= 1
            short = np.minimum(axis.distance, nodes - axis.distance)
            assert np.array_equal(short[1:], short[:0:-1])  # the same both ways around
        else:
            assert (lengths[:-1] == 8).all()
            assert not axis.spare.any()


def test_dominant_rows_make_a_regular_factor():
    generator = np.random.Generator(np.random.PCG64(5))
    for _ in range(50):
        size = int(generator.integers(2, 40))
        rows = generator.standard_normal((size, size)).astype(np.float32) * generator.choice([0.01, 1.0, 100.0])
        np.fill_diagonal(rows, 0.0)
        before, diagonal = rows.copy(), generator.uniform(0.1, 2.0, size).astype(np.float32)
        others = rows.T
        dominant(others, diagonal)
        factor = others.T.astype(float) + np.diag(diagonal)
        assert np.linalg.norm(np.linalg.inv(factor), np.inf) <= 1001.0 / diagonal.min()
        kept = np.abs(before).sum(axis=1) <= 0.999 * diagonal
        assert np.array_equal(others.T[kept], before[kept])


@pytest.mark.parametrize("kernel", ["love", "punch", "fourier"])
@pytest.mark.parametrize("shape", [(5, 5), (5, 7), (6, 300), (40, 11), (129, 129)])
def test_near_field_around_a_period_is_positive_definite(shape, kernel):
    generator = np.random.Generator(np.random.PCG64(7))
    half_space = HalfSpace(shape, kernel, periodic=True)
    for share in (0.3, 0.7, 1.0):
        elements = np.flatnonzero(generator.random(shape).ravel() < min(share, share * 400 / (shape[0] * shape[1])))
        found = near_field(half_space, elements)(np.eye(elements.size))
        assert np.linalg.eigvalsh(found.astype(float)).min() > 1e-3 * np.abs(found).max()


# ---- a direction that gains nothing costs time, not the answer


WRONG = {
    "negative": lambda z: -z,
    "not a number": lambda z: np.nan * z,
    "overflow": lambda z: np.float32(3e38) * z,
    "noise": lambda z: np.random.Generator(np.random.PCG64(8)).standard_normal(z.size).astype(np.float32),
    "zero": np.zeros_like,
    "stalls": lambda z: z * np.logspace(-8, 8, z.size, dtype=np.float32),
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("parts", [("by_blocks",), ("by_blocks", "near_field")])
@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_inverse_costs_iterations_and_not_the_answer(monkeypatch, wrong, parts):
    surface = random_midpoint_displacement(2.3, 6, seed=0)
    half_space, steps = HalfSpace(surface.shape), surface.peak * np.arange(1, 5) / 4
    options = {"rtol": 1e-7, "tuning": Tuning(dense_up_to=0, iterations=200)}
    right = list(sweep(surface, half_space, steps, **options))
    for part in parts:
        made = getattr(preconditioner, part)

        def spoilt(*args, made=made, **kwargs):
            inverse = made(*args, **kwargs)
            return lambda r: WRONG[wrong](inverse(r))

        monkeypatch.setattr(preconditioner, part, spoilt)
    for one, other in zip(sweep(surface, half_space, steps, **options), right, strict=True):
        assert one.residual <= 1e-7
        assert abs(one.free_volume - other.free_volume) <= 2e-7
        assert one.iterations < (1000 if wrong == "stalls" else 60)
