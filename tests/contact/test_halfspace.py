"""The half space against the matrix of its coefficients, its windows, and its counters."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roughvol.contact.halfspace import HalfSpace, transform_length
from roughvol.contact.options import Tuning
from roughvol.errors import ContactError
from tests.contact.kit import BODIES, KERNELS, coefficients, dense, random, summed_displacement
from tests.refused import refusals

SHAPES = [(1, 1), (1, 7), (2, 1), (3, 4), (17, 9), (3, 100)]
PERIODS = [(5, 5), (16, 16), (9, 22)]


@pytest.mark.parametrize(
    ("sides", "kernel", "shape"), [(s, k, shape) for s, k in BODIES for shape in (SHAPES if s == "free" else PERIODS)]
)
def test_convolution_is_the_matrix_of_the_coefficients(sides, kernel, shape):
    space, matrix = HalfSpace(shape, kernel, sides=sides), dense(shape, kernel, sides)
    assert sides != "free" or np.array_equal(space.influence, coefficients(shape, kernel))
    pressure, heights = random(1).random((2, math.prod(shape)))
    u = matrix @ pressure
    near = 1e-13 * np.abs(u).max()
    assert space.displacement(pressure.reshape(shape).tolist()).ravel() == pytest.approx(u, abs=near)
    assert space.total_compliance.ravel() == pytest.approx(matrix.sum(axis=1), rel=1e-12)
    everything = np.arange(pressure.size)
    for some in (everything[:0], everything[:1], everything[-1:], everything, np.flatnonzero(pressure > 0.4)):
        loaded = pressure[some]
        before = space.convolutions, space.convolutions_fp32
        above = space.displacement_above(heights, some, loaded)
        assert above == pytest.approx(matrix[:, some] @ loaded - heights, abs=near)
        at = matrix[np.ix_(some, some)] @ loaded
        assert space.displacement_at(some, loaded) == pytest.approx(at, abs=near)
        single = space.displacement_at(some, loaded, single=True)
        assert single.dtype == np.float32
        assert single == pytest.approx(at, abs=1e8 * near)
        assert (space.convolutions, space.convolutions_fp32) == (before[0] + 2.0, before[1] + 1.0)
    for lent in (space.influence, space.total_compliance):
        with pytest.raises(ValueError, match="read-only"):
            lent[0, 0] = 1.0


def test_arguments_and_results_belong_to_the_caller():
    space, pressure = HalfSpace((9, 9)), random(0).random(81)
    elements, kept = np.arange(40, 60), pressure.copy()
    results = [
        space.displacement(pressure.reshape(9, 9)),
        space.displacement_at(elements, pressure[:20]),
        space.displacement_at(elements, pressure[:20], single=True),
    ]
    copies = [array.copy() for array in results]
    space.displacement(np.zeros((9, 9)))
    elements += 7  # elements that change are not mistaken for the last
    moved = space.displacement_at(elements, pressure[:20])
    assert np.array_equal(moved, HalfSpace((9, 9)).displacement_at(elements, pressure[:20]))
    for array, copy in zip(results, copies, strict=True):
        assert np.array_equal(array, copy)
        array[:] = 7.0  # writable
    assert np.array_equal(pressure, kept)


# ---- windows


@settings(max_examples=15, derandomize=True)
@given(st.integers(1, 120), st.integers(1, 120), st.sampled_from(KERNELS), st.booleans(), st.integers(0, 2**32 - 1))
def test_elements_anywhere_are_displaced_as_on_the_whole_grid(rows, columns, kernel, single, seed):
    space = HalfSpace((rows, columns), kernel, tuning=Tuning(windows_from=0))
    generator, pressure = random(seed), np.zeros((rows, columns))
    for _ in range(3):  # in turn: remains of one window would show in the next
        edges = [np.sort(generator.integers(0, n, 2)) for n in (rows, columns)]
        patch = tuple(slice(low, high + 1) for low, high in edges)
        pressure[:] = 0.0
        pressure[patch] = generator.standard_normal(pressure[patch].shape)
        elements = np.flatnonzero(pressure.ravel())
        expected = summed_displacement(pressure, kernel).ravel()[elements]
        got = space.displacement_at(elements, pressure.ravel()[elements], single=single)
        np.testing.assert_allclose(got, expected, rtol=0, atol=(3e-6 if single else 4e-14) * np.abs(expected).max())


def test_a_window_counts_by_its_share_of_the_points():
    space = HalfSpace((257, 257), tuning=Tuning(windows_from=0))
    space.displacement_at(np.array([0, 257 * 257 - 1]), np.ones(2))
    assert space.convolutions == 1.0
    row, column = np.divmod(np.arange(64 * 64), 64)
    space.displacement_at((row + 100) * 257 + column + 193, np.ones(64 * 64))
    assert space.convolutions == 1.0 + 1.0 / 16.0  # half lengths of 64 in place of 256, lags up to 63
    space.displacement_at((row + 100) * 257 + column * 2 + 50, np.ones(64 * 64), single=True)
    assert space.convolutions_fp32 == 1.0 / 8.0


def test_windows_are_kept_within_bounds():
    space = HalfSpace((129, 129), tuning=Tuning(windows_from=0))
    for last in range(20, 129, 3):
        space.displacement_at(np.arange(last) * 130, np.ones(last), single=True)
        assert 0 <= space.window_points <= 256 * 256
    assert space.window_points > 0


# ---- sizes


def test_transform_length_is_even_long_enough_and_smooth():
    assert all(transform_length(2**m + 1) == 2 ** (m + 1) for m in range(14))
    for nodes in range(1, 600):
        length = transform_length(nodes)
        assert length % 2 == 0
        assert 2 * (nodes - 1) <= length <= 2.5 * max(nodes, 2)
        assert 2**60 * 3**40 * 5**30 % length == 0


test_refused = refusals(
    ContactError,
    *((lambda shape=shape: HalfSpace(shape), "at least 1 × 1") for shape in ((0, 3), (-1, 3))),
    (lambda: HalfSpace((2, 8), sides="mirrored"), "at least 3 × 3"),
    (lambda: HalfSpace((8, 4), sides="periodic"), "at least 5 × 5"),
    *((lambda p=p: HalfSpace((5, 7)).displacement(np.zeros(p)), r"\(5, 7\)") for p in ((5, 6), (30,), (1, 5, 6))),
)
