"""Displacement by few loaded elements against the convolution."""

from __future__ import annotations

import numpy as np
import pytest

from roughvol.contact.convolution import Superposition
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.options import Tuning

SHAPES = ((33, 65), (129, 129), (300, 1000), (7, 900))


def loaded(shape, count, seed=0):
    """Return elements, the numbers of some of them, and pressures there."""
    generator = np.random.Generator(np.random.PCG64(seed))
    size = shape[0] * shape[1]
    elements = np.sort(generator.choice(size, size // 5, replace=False))
    some = np.sort(generator.choice(elements.size, count, replace=False))
    elements[[0, -1]] = 0, size - 1
    some[[0, -1]] = 0, elements.size - 1  # in the corners
    return elements, some, -generator.random(count)


def convolved(half_space, elements, some, pressure):
    whole = np.zeros(elements.size)
    whole[some] = pressure
    return half_space.displacement_at(elements, whole)


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("kernel", ["love", "punch"])
@pytest.mark.parametrize("shape", SHAPES)
def test_sums_are_the_convolution(shape, kernel, single):
    half_space = HalfSpace(shape, kernel)
    elements, some, pressure = loaded(shape, 20)
    got = Superposition(half_space.influence, Tuning(sum_terms=np.inf)).displacement(
        elements, some, pressure, single=single
    )
    assert got.dtype == (np.float32 if single else np.float64)
    wanted = convolved(half_space, elements, some, pressure)
    np.testing.assert_allclose(got, wanted, rtol=3e-6 if single else 1e-12)


def test_a_sum_is_made_only_where_it_has_few_enough_terms():
    shape = (300, 1000)
    sums = Superposition(HalfSpace(shape).influence, Tuning(sum_terms=3.0))  # a fifth of the nodes are elements
    for count, summed in ((2, True), (15, True), (16, False), (200, False)):
        elements, some, pressure = loaded(shape, count)
        assert (sums.displacement(elements, some, pressure, single=True) is not None) == summed


def test_sums_do_not_depend_on_the_pieces_they_are_made_in():
    half_space = HalfSpace((33, 65))
    elements, some, pressure = loaded((33, 65), 20)
    whole, pieces = (
        Superposition(half_space.influence, Tuning(cache=cache)).displacement(elements, some, pressure, single=False)
        for cache in (2**18, 32 * 100)
    )
    assert np.array_equal(whole, pieces)
