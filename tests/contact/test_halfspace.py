"""The convolution against sums, its windows, and the counters."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import KERNELS, coefficients, dense_matrix, half_space, love_influence, summed_displacement

from roughvol.contact import convolution
from roughvol.contact.halfspace import HalfSpace, transform_length
from roughvol.contact.options import Tuning
from roughvol.errors import ContactError
from roughvol.reproduction import closed_forms

SHAPES = [(1, 1), (1, 2), (1, 7), (2, 1), (2, 2), (3, 3), (3, 4), (5, 9), (17, 9), (12, 7), (23, 18), (3, 100), (33, 2)]
EPS = np.finfo(float).eps


def noise(shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


# ---- the convolution


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", SHAPES)
def test_displacement_is_the_sum_over_all_elements(shape, kernel):
    pressure = noise(shape)
    expected = (dense_matrix(coefficients(shape, kernel)) @ pressure.ravel()).reshape(shape)
    displacement = half_space(shape, kernel).displacement(pressure)
    assert displacement.dtype == np.float64
    np.testing.assert_allclose(displacement, expected, rtol=0, atol=2e-14 * np.abs(expected).max())


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(1, 40), st.integers(1, 40), st.sampled_from(sorted(KERNELS)), st.integers(0, 2**32 - 1))
def test_displacement_at_any_shape_is_the_padded_convolution(rows, columns, kernel, seed):
    pressure = noise((rows, columns), seed)
    expected = summed_displacement(pressure, kernel)
    displacement = HalfSpace((rows, columns), kernel).displacement(pressure)
    np.testing.assert_allclose(displacement, expected, rtol=0, atol=3e-14 * np.abs(expected).max())


@pytest.mark.parametrize("shape", [(257, 129), (130, 77), (3, 1000)])
def test_uniform_pressure_on_all_elements_is_the_loaded_rectangle(shape):
    x, y = (np.arange(n) - 0.5 * (n - 1) for n in shape)
    rectangle = math.pi * closed_forms.rectangle_displacement(x[:, None], y, shape)
    np.testing.assert_allclose(half_space(shape).displacement(np.ones(shape)), rectangle, rtol=1e-13)


@pytest.mark.parametrize("corner", [(0, 0), (0, -1), (-1, 0), (-1, -1)])
@pytest.mark.parametrize("shape", [(17, 33), (12, 7), (1, 5)])
def test_pressure_on_a_corner_brings_out_every_coefficient(shape, corner):
    # The farthest offsets share their place on the torus when its length is 2 (n - 1).
    pressure = np.zeros(shape)
    pressure[corner] = 1.0
    turned = half_space(shape).displacement(pressure)[:: corner[0] or 1, :: corner[1] or 1]
    np.testing.assert_allclose(turned, love_influence(shape), rtol=1e-12)


@pytest.mark.parametrize("shape", [(17, 33), (12, 7)])
def test_displacement_is_linear_and_reciprocal(shape):
    space = half_space(shape)
    a, b = noise(shape, 1), noise(shape, 2)
    u, v = space.displacement(a), space.displacement(b)
    np.testing.assert_allclose(space.displacement(2.0 * a - 3.0 * b), 2.0 * u - 3.0 * v, rtol=0, atol=1e-12)
    assert np.sum(a * v) == pytest.approx(np.sum(b * u), rel=1e-11)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("single", [False, True])
def test_displacement_at_elements_is_the_field_there(shape, kernel, single):
    space = half_space(shape, kernel)
    size = shape[0] * shape[1]
    for elements in ([0], [size - 1], np.arange(size), np.flatnonzero(noise(size, 3) > 0.5)):
        elements = np.asarray(elements, dtype=np.intp)
        pressure = np.zeros(size)
        pressure[elements] = noise(elements.size, 4)
        expected = space.displacement(pressure.reshape(shape)).ravel()[elements]
        got = space.displacement_at(elements, pressure[elements], single=single)
        assert got.dtype == (np.float32 if single else np.float64)
        tolerance = 1e-6 if single else 2e-14
        np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * np.abs(expected).max(initial=0.0))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("shape", [*SHAPES, (257, 129)])
def test_displacement_above_is_the_field_less_the_heights(shape, threads):
    space = HalfSpace(shape, threads=threads)
    size = shape[0] * shape[1]
    heights = noise(size, 5)
    for elements in ([], [0], [size - 1], np.arange(size), np.flatnonzero(noise(size, 3) > 0.5)):
        elements = np.asarray(elements, dtype=np.intp)
        pressure = np.zeros(size)
        pressure[elements] = noise(elements.size, 4)
        before = space.convolutions
        got = space.displacement_above(heights, elements, pressure[elements])
        assert space.convolutions == before + 1.0
        field = space.displacement(pressure.reshape(shape)).ravel()
        assert np.array_equal(got, field - heights)
        got[:] = 0.0
        assert np.array_equal(heights, noise(size, 5))


def test_single_precision_is_single_on_a_large_grid():
    shape = (129, 257)
    pressure = np.abs(noise(shape))
    exact = half_space(shape).displacement(pressure).ravel()
    got = half_space(shape).displacement_at(np.arange(exact.size), pressure.ravel(), single=True)
    assert 1e-9 < np.abs(got / exact - 1.0).max() < 1e-6


@pytest.mark.parametrize("value", [1e30, math.nan])
@pytest.mark.parametrize("shape", [(17, 17), (12, 7)])
def test_nothing_is_left_behind_by_earlier_calls(shape, value):
    spike, everything = np.zeros(shape), np.arange(shape[0] * shape[1])
    spike[1, 2] = 1.0
    some, ones, high = everything[::3], np.ones(everything[::3].size), np.full(everything.size, value)
    calls = [
        lambda space: space.displacement(spike),
        lambda space: space.displacement_above(spike.ravel(), some, ones),
        lambda space: space.displacement_at(some, ones),
        lambda space: space.displacement_at(some, ones, single=True),
    ]
    before = [
        lambda space: space.displacement(high.reshape(shape)),
        lambda space: space.displacement_above(high, everything, high),
        lambda space: space.displacement_at(everything, high),
        lambda space: space.displacement_at(everything, high.astype(np.float32), single=True),
    ]
    for dirty in before:
        for call in calls:
            used = HalfSpace(shape)
            with np.errstate(invalid="ignore"):
                dirty(used)
            assert np.array_equal(call(used), call(HalfSpace(shape)))


def test_results_belong_to_the_caller():
    space, elements = HalfSpace((9, 9)), np.arange(20)
    field = space.displacement(np.ones((9, 9)))
    values = space.displacement_at(elements, np.ones(20))
    single = space.displacement_at(elements, np.ones(20), single=True)
    kept = [array.copy() for array in (field, values, single)]
    space.displacement(np.zeros((9, 9)))
    space.displacement_at(elements, np.zeros(20))
    space.displacement_at(elements, np.zeros(20), single=True)
    for array, copy in zip((field, values, single), kept, strict=True):
        assert np.array_equal(array, copy)
        array[:] = 7.0  # writable
    assert np.array_equal(space.displacement(np.ones((9, 9))), kept[0])


def test_pressure_is_not_changed():
    pressure = noise((9, 9))
    kept = pressure.copy()
    half_space((9, 9)).displacement(pressure)
    half_space((9, 9)).displacement_at(np.arange(81), pressure.ravel())
    assert np.array_equal(pressure, kept)


def test_threads_change_no_bit():
    pressure = noise((65, 333))
    elements = np.flatnonzero(pressure > 1.0)
    one, two = (HalfSpace((65, 333), threads=threads) for threads in (1, 2))
    assert np.array_equal(one.displacement(pressure), two.displacement(pressure))
    for single in (False, True):
        for some in (elements, elements[: elements.size // 2]):
            few = pressure.ravel()[some]
            assert np.array_equal(
                one.displacement_at(some, few, single=single), two.displacement_at(some, few, single=single)
            )


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize(("together", "band", "cache"), [(1, 7, 2**18), (8, 64, 2**14), (1000, 1000, 2**16)])
def test_how_rows_and_columns_are_copied_changes_no_bit(together, band, cache, single, threads):
    pressure = noise((200, 333))
    elements = np.flatnonzero(pressure > 0.5)

    def displacements(threads, tuning):
        space = HalfSpace((200, 333), threads=threads, tuning=tuning)
        few = space.displacement_at(elements, pressure.ravel()[elements], single=single)
        return np.concatenate((space.displacement(pressure).ravel(), few))

    other = Tuning(columns_together=together, band=band, cache=cache)
    assert np.array_equal(displacements(threads, other), displacements(1, Tuning()))


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 129, 257, 1025, 4097])
@pytest.mark.parametrize("size", [16, 4096, 131072, 2**20])
@pytest.mark.parametrize("together", [1, 8])
def test_parts_cover_all_and_are_multiples(count, size, together):
    parts = convolution.parts(count, size, 2**18, together)
    assert np.array_equal(np.concatenate([np.arange(part.start, part.stop) for part in parts]), np.arange(count))
    lengths = [part.stop - part.start for part in parts]
    assert len(set(lengths[:-1])) <= 1
    assert all(length % together == 0 for length in lengths[:-1])
    assert max(lengths) <= 1.5 * max(together, 2 * 2**18 / size)


# ---- windows


@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    st.integers(1, 200), st.integers(1, 200), st.sampled_from(sorted(KERNELS)), st.booleans(), st.integers(0, 2**32 - 1)
)
def test_elements_anywhere_are_displaced_as_on_the_whole_grid(rows, columns, kernel, single, seed):
    space = HalfSpace((rows, columns), kernel, tuning=Tuning(windows_from=0))
    check_patches(space, single, np.random.Generator(np.random.PCG64(seed)))


def check_patches(space, single, generator):
    rows, columns = space.shape
    pressure = np.zeros((rows, columns))
    for _ in range(3):  # in turn: remains of one window would show in the next
        edges = [np.sort(generator.integers(0, n, 2)) for n in (rows, columns)]
        patch = tuple(slice(low, high + 1) for low, high in edges)
        pressure[:] = 0.0
        pressure[patch] = generator.standard_normal(pressure[patch].shape)
        elements = np.flatnonzero(pressure.ravel())
        expected = space.displacement(pressure).ravel()[elements]
        got = space.displacement_at(elements, pressure.ravel()[elements], single=single)
        tolerance = 3e-6 if single else 4e-14
        np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def test_a_window_counts_by_its_share_of_the_points():
    space = HalfSpace((257, 257), tuning=Tuning(windows_from=0))
    corners = np.array([0, 257 * 257 - 1])
    space.displacement_at(corners, np.ones(2))
    assert space.convolutions == 1.0
    row, column = np.divmod(np.arange(64 * 64), 64)
    space.displacement_at((row + 100) * 257 + column + 193, np.ones(64 * 64))
    assert space.convolutions == 1.0 + 1.0 / 16.0  # half lengths of 64 in place of 256, lags up to 63
    space.displacement_at((row + 100) * 257 + column * 2 + 50, np.ones(64 * 64), single=True)
    assert space.convolutions_fp32 == 1.0 / 8.0


def test_elements_that_change_are_not_mistaken_for_the_last():
    space, elements = HalfSpace((33, 33)), np.arange(40, 60)
    first = space.displacement_at(elements, np.ones(20))
    elements *= 2
    moved = space.displacement_at(elements, np.ones(20))
    assert not np.allclose(first, moved)
    assert np.array_equal(moved, HalfSpace((33, 33)).displacement_at(elements, np.ones(20)))


def test_windows_are_kept_within_bounds():
    space = HalfSpace((257, 257), tuning=Tuning(windows_from=0))
    for last in range(20, 257):
        elements = np.arange(last) * 258
        space.displacement_at(elements, np.ones(last), single=True)
        assert space.window_points <= 512 * 512
    assert space.window_points > 0


def test_counters_count_convolutions_by_precision():
    space = HalfSpace((5, 5))
    assert (space.convolutions, space.convolutions_fp32) == (0, 0)
    space.total_compliance  # noqa: B018  belongs to the grid, not to a case
    assert (space.convolutions, space.convolutions_fp32) == (0, 0)
    space.displacement(np.ones((5, 5)))
    space.displacement_at(np.arange(3), np.ones(3))
    space.displacement_at(np.arange(3), np.ones(3), single=True)
    assert (space.convolutions, space.convolutions_fp32) == (2, 1)


# ---- the whole grid as a spring


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", [(5, 9), (12, 7), (17, 17)])
def test_total_compliance_sums_any_displacement(shape, kernel):
    space, pressure = HalfSpace(shape, kernel), noise(shape, 5)
    total = space.total_compliance
    rows = dense_matrix(coefficients(shape, kernel)).sum(axis=1).reshape(shape)
    np.testing.assert_allclose(total, rows, rtol=1e-13)
    expected = space.displacement(pressure).sum()
    assert np.sum(total * pressure) == pytest.approx(expected, rel=1e-12)
    assert space.total_compliance is total


def test_what_the_half_space_lends_is_read_only():
    space = HalfSpace((5, 5))
    for lent in (space.influence, space.total_compliance):
        with pytest.raises(ValueError, match="read-only"):
            lent[0, 0] = 1.0


def test_mean_compliance_of_a_loaded_square():
    # Element centres sample the displacement; it is steep at the edges, so the mean converges like h² log h.
    exact = closed_forms.rectangle_mean_displacement((1.0, 1.0))
    errors = [half_space((n, n)).total_compliance.mean() / (math.pi * n) - exact for n in (9, 17, 33, 65, 129)]
    assert exact == pytest.approx(0.9464, abs=5e-5)
    assert 0.0 < errors[-1] < 5e-5
    assert all(coarse > 2.8 * fine for coarse, fine in pairwise(errors))


# ---- sizes


@pytest.mark.parametrize("m", range(14))
def test_fractal_grids_need_no_padding_beyond_a_power_of_two(m):
    assert transform_length(2**m + 1) == 2 ** (m + 1)


def test_transform_length_is_even_long_enough_and_smooth():
    for nodes in range(1, 600):
        length = transform_length(nodes)
        assert length % 2 == 0
        assert 2 * (nodes - 1) <= length <= 2.5 * max(nodes, 2)
        rest = length
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        assert rest == 1


@pytest.mark.parametrize("shape", [(0, 3), (3, 0), (-1, 3)])
def test_empty_grids_are_refused(shape):
    with pytest.raises(ContactError, match="at least 1 × 1 elements"):
        HalfSpace(shape)


@pytest.mark.parametrize("shape", [(5, 6), (6, 5), (30,), (1, 5, 6)])
def test_pressure_of_another_shape_is_refused(shape):
    space = HalfSpace((5, 7))
    with pytest.raises(ContactError, match=r"\(5, 7\)"):
        space.displacement(np.zeros(shape))
    assert space.convolutions == 0
