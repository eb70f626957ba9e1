"""Displacement by few loaded elements against the convolution."""

from __future__ import annotations

import numpy as np
import pytest

from roughvol.physics import superposition
from roughvol.physics.halfspace import HalfSpace
from roughvol.physics.superposition import ERROR, Superposition

SHAPES = ((33, 65), (129, 129), (300, 1000), (7, 900))


def loaded(shape, count, seed=0):
    """Return elements, the numbers of some of them, and pressures there."""
    generator = np.random.Generator(np.random.PCG64(seed))
    size = shape[0] * shape[1]
    elements = np.sort(generator.choice(size, size // 5, replace=False))
    some = np.sort(generator.choice(elements.size, count, replace=False))
    elements[[0, -1]] = 0, size - 1
    some[[0, -1]] = 0, elements.size - 1  # in the corners, where windows leave the grid
    return elements, some, -generator.random(count)


def convolved(half_space, elements, some, pressure):
    whole = np.zeros(elements.size)
    whole[some] = pressure
    return half_space.displacement_at(elements, whole)


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("kernel", ["love", "punch"])
@pytest.mark.parametrize("shape", SHAPES)
def test_direct_sums_are_the_convolution(shape, kernel, single, monkeypatch):
    monkeypatch.setattr(superposition, "_DIRECT", np.inf)
    half_space = HalfSpace(shape, kernel)
    elements, some, pressure = loaded(shape, 20)
    got = Superposition(half_space.influence).displacement(elements, some, pressure, single=single, error=0.0)
    assert got.dtype == (np.float32 if single else np.float64)
    wanted = convolved(half_space, elements, some, pressure)
    np.testing.assert_allclose(got, wanted, rtol=3e-6 if single else 1e-12)


@pytest.mark.parametrize("kernel", ["love", "punch"])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_split_kernel_is_as_exact_as_it_says(shape, kernel):
    half_space = HalfSpace(shape, kernel)
    split = superposition._SplitKernel(half_space.influence)
    for seed, count in enumerate((2, 2, 2, 2, 60, 2)):  # the last finds the field as the first did
        elements, some, pressure = loaded(shape, count, seed)
        got = split.displacement(elements, elements[some], pressure)
        wanted = convolved(half_space, elements, some, pressure)
        assert np.abs(got - wanted).max() <= ERROR * np.abs(pressure).sum()
    worst = 0.0
    for place in range(0, shape[0] * shape[1], shape[0] * shape[1] // 20):
        elements = np.arange(shape[0] * shape[1])
        got = split.displacement(elements, np.array([place]), np.ones(1))
        worst = max(worst, float(np.abs(got - convolved(half_space, elements, [place], 1.0)).max()))
    assert 0.3 * ERROR < worst <= ERROR


def test_each_way_is_taken_where_it_is_the_cheapest_that_is_exact_enough(monkeypatch):
    shape = (300, 1000)
    half_space = HalfSpace(shape)
    sums = Superposition(half_space.influence)
    split = []
    true = superposition._SplitKernel.displacement
    monkeypatch.setattr(superposition._SplitKernel, "displacement", lambda *given: split.append(1) or true(*given))

    def ways(count, **how):
        elements, some, pressure = loaded(shape, count)
        before = len(split)
        got = sums.displacement(elements, some, pressure, **how)
        if got is None:
            return "convolution"
        np.testing.assert_allclose(got, convolved(half_space, elements, some, pressure), atol=ERROR * count)
        return "split" if len(split) > before else "direct"

    monkeypatch.setattr(superposition, "_DIRECT", 12.0)
    assert ways(15, single=True, error=1e-3) == "direct"  # as few
    assert ways(50, single=True, error=1e-3) == "split"
    assert ways(50, single=False, error=1e-3) == "direct"
    assert ways(50, single=True, error=1e-5) == "direct"
    assert ways(200, single=True, error=1e-3) == "convolution"
    assert ways(70, single=True, error=1e-5) == "convolution"
