"""The near field of the approximate inverse against its definition, and its dominant rows."""

import math

import numpy as np
import pytest

from roughvol.contact.near_field import dominant, near_field
from roughvol.contact.options import Tuning
from tests.contact.kit import contact_set, half_space, of_units, random


@pytest.mark.parametrize(("reach", "kernel"), [(2.0**0.5, "love"), (5.0**0.5, "punch"), (8.0**0.5, "love")])
def test_near_field_is_the_factor_of_its_definition(reach, kernel):
    space, elements, matrix, _ = contact_set((33, 65), kernel=kernel)
    row, column = np.divmod(elements, 65)
    factor = np.zeros_like(matrix)
    for i in range(elements.size):
        down, across = np.abs(row[: i + 1] - row[i]), np.abs(column[: i + 1] - column[i])
        near = np.flatnonzero((np.hypot(down, across) <= reach + 1e-9) & (np.maximum(down, across) <= 2))
        y = np.linalg.solve(matrix[np.ix_(near, near)], np.eye(near.size)[-1])
        factor[i, near] = y / np.sqrt(y[-1])
    got = of_units(near_field(space, elements, Tuning(near_reach=reach, cache=64 * 50)), elements.size)
    np.testing.assert_allclose(got, factor.T @ factor, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("shape", "kernel"), [((5, 5), "love"), ((6, 150), "fourier"), ((40, 11), "punch"), ((64, 64), "love")]
)
def test_near_field_around_a_period_is_positive_definite(shape, kernel):
    for share in (0.3, 0.7, 1.0):
        elements = np.flatnonzero(random(7).random(math.prod(shape)) < min(share, share * 120 / math.prod(shape)))
        found = of_units(near_field(half_space(shape, kernel, "periodic"), elements), elements.size)
        assert np.linalg.eigvalsh(found).min() > 1e-3 * np.abs(found).max()


def test_dominant_rows_make_a_regular_factor():
    generator = random(5)
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
