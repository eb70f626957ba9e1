"""The convolution: its parts and copies, which change no bit; and sums of few loaded elements in place of it."""

import math

import numpy as np
import pytest

from roughvol.contact.convolution import Superposition
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.options import Tuning
from tests.contact.kit import SIDES, half_space, random


@pytest.mark.parametrize(
    ("sides", "other", "threads"),
    [
        ("free", Tuning(columns_together=1, band=7), 2),
        ("free", Tuning(columns_together=8, band=64, cache=2**14), 1),
        ("free", Tuning(columns_together=1000, band=1000, cache=2**16), 2),
        ("mirrored", Tuning(), 2),
        ("mirrored", Tuning(cache=2**13), 2),
    ],
)
def test_neither_threads_nor_copies_of_rows_and_columns_change_a_bit(sides, other, threads):
    shape = (65, 133)
    pressure = random(0).standard_normal(shape)
    elements = np.flatnonzero(pressure > 0.5)

    def displacements(threads, tuning):
        space = HalfSpace(shape, threads=threads, tuning=tuning, sides=sides)
        few = [space.displacement_at(elements, pressure.ravel()[elements], single=single) for single in (False, True)]
        return np.concatenate((space.displacement(pressure).ravel(), *few))

    plain = Tuning() if sides == "free" else other
    assert np.array_equal(displacements(threads, other), displacements(1, plain))


def loaded(shape, count):
    """Return elements, the numbers of some of them, and pressures there."""
    generator, size = random(0), math.prod(shape)
    elements = np.sort(generator.choice(size, size // 5, replace=False))
    some = np.sort(generator.choice(elements.size, count, replace=False))
    elements[[0, -1]] = 0, size - 1
    some[[0, -1]] = 0, elements.size - 1  # in the corners
    return elements, some, -generator.random(count)


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize(("shape", "kernel"), [((33, 65), "love"), ((7, 300), "punch")])
def test_sums_are_the_convolution(shape, kernel, sides, single):
    space = half_space(shape, kernel, sides)
    elements, some, pressure = loaded(shape, 20)
    whole = np.zeros(elements.size)
    whole[some] = pressure
    wanted = space.displacement_at(elements, whole)
    for cache in (2**18, 32 * 100):  # in pieces, too
        tuning = Tuning(sum_terms=np.inf, cache=cache)
        sums = Superposition(space.influence, tuning, mirrored=sides == "mirrored")
        got = sums.displacement(elements, some, pressure, single=single)
        assert got.dtype == (np.float32 if single else np.float64)
        np.testing.assert_allclose(got, wanted, rtol=3e-6 if single else 1e-12)


def test_a_sum_is_made_only_where_it_has_few_enough_terms():
    shape = (60, 100)
    sums = Superposition(half_space(shape).influence, Tuning(sum_terms=3.0))  # a fifth of the nodes are elements
    for count, summed in ((2, True), (15, True), (16, False), (200, False)):
        assert (sums.displacement(*loaded(shape, count), single=True) is not None) == summed
