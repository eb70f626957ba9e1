"""Kernels against quadrature, their own laws, and the inverse that the prediction of the solver rests on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from oracles import KERNELS, coefficients, dense_matrix

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import kernel_of, love_kernel, punch_kernel
from roughvol.errors import ContactError

SHAPES = [(1, 1), (1, 2), (1, 7), (2, 1), (2, 2), (3, 3), (3, 4), (5, 9), (17, 9), (12, 7), (23, 18), (3, 100), (33, 2)]
EPS = np.finfo(float).eps


def noise(shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


def test_element_under_its_own_pressure():
    assert float(love_kernel(0.0, 0.0)) == pytest.approx(4.0 * math.log(1.0 + math.sqrt(2.0)), rel=4 * EPS)


@pytest.mark.parametrize(
    ("x", "y"),
    [
        *[(1, 0), (1, 1), (2, 0), (3, 7), (0.25, 3), (44, 0)],  # neighbours, an offset between nodes
        *[(63, 0), (64, 0), (64, 1), (65, 0), (65, 1), (45, 45), (46, 46)],  # both sides of the change of form
        *[(200, 3), (8192, 0), (8192, 1), (8192, 8191), (1e6, 1e6)],
    ],
)
def test_love_kernel_is_the_integral_over_the_element(x, y):
    nodes, weights = np.polynomial.legendre.leggauss(24)
    distance = np.hypot(x - 0.5 * nodes[:, None], y - 0.5 * nodes)
    integral = np.sum(np.outer(weights, weights) / 4.0 / distance)
    assert float(love_kernel(x, y)) == pytest.approx(integral, rel=1e-13)


@pytest.mark.parametrize("x", [0, 3, 60, 66, 150, 190, 192, 195])
@pytest.mark.parametrize("slope", [0.0, 1 / 3, 1.0])
def test_nine_elements_are_one_of_three_times_the_side(x, slope):
    # At 66 … 190 the nine lie in the range of the series and the large one in that of the closed form.
    x, y = float(x), float(round(x * slope))
    around = np.arange(-1.0, 2.0)
    nine = love_kernel(np.abs(x + around)[:, None], np.abs(y + around))
    assert nine.sum() == pytest.approx(3.0 * float(love_kernel(x / 3.0, y / 3.0)), rel=1e-13)


@pytest.mark.parametrize("kernel", KERNELS)
def test_kernel_is_symmetric_positive_and_falls_off(kernel):
    quadrant = coefficients((120, 120), kernel)
    np.testing.assert_allclose(quadrant, quadrant.T, rtol=1e-13)
    assert quadrant.min() > 0.0
    assert np.diff(quadrant, axis=0).max() < 0.0


@pytest.mark.parametrize("x", [10.0, 63.0, 65.0, 1000.0])
def test_far_kernel_is_a_point_force_with_the_moment_of_the_element(x):
    # Love: r K - 1 → 1/(24 r²), half the second moment of the square; punch: asin(s) - s → s³/6, the same
    for kernel in (love_kernel, punch_kernel):
        assert x * x * (x * float(kernel(x, 0.0)) - 1.0) == pytest.approx(1 / 24, abs=0.03 / x**2 + 2 * EPS * x * x)


def test_punch_kernel_values():
    x = np.array([0.0, 1.0, 0.0, 1.0, 3.0])
    y = np.array([0.0, 0.0, 1.0, 1.0, 4.0])
    expected = [2.0, math.pi / 3, math.pi / 3, 2 * math.asin(math.sqrt(0.125)), 2 * math.asin(0.1)]
    np.testing.assert_allclose(punch_kernel(x, y), expected, rtol=4 * EPS)


@pytest.mark.parametrize(("x", "y"), [(-1.0, 0.0), (0.0, -1.0), ([0.0, 1.0], [[2.0], [-1e-9]])])
def test_negative_offsets_are_refused(x, y):
    with pytest.raises(ContactError, match=r">= 0"):
        love_kernel(x, y)


@pytest.mark.parametrize("kernel", KERNELS)
def test_quadrant_lists_the_kernel_by_offset(kernel):
    quadrant = coefficients((4, 3), kernel)
    assert quadrant.shape == (4, 3)
    for (i, j), value in np.ndenumerate(quadrant):
        assert value == float(kernel_of(kernel).coefficients(float(i), float(j)))


def test_unknown_kernel_is_refused_with_the_known_ones():
    for make in (coefficients, HalfSpace):
        with pytest.raises(ContactError, match=r"'boussinesq'.*love, punch"):
            make((3, 3), "boussinesq")


# ---- positive definite, and the inverse that the solver's prediction rests on


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("nodes", [2, 3, 5, 33, 129])
def test_kernel_on_the_torus_is_positive_definite(kernel, nodes):
    # The operator of the grid is a block of the circulant one, with eigenvalues from the mirrored quadrant.
    quadrant = coefficients((nodes, nodes), kernel)
    torus = np.pad(quadrant, ((0, nodes - 2), (0, nodes - 2)), mode="reflect")
    eigenvalues = np.fft.fft2(torus)
    np.testing.assert_allclose(eigenvalues.imag, 0.0, atol=1e-12 * eigenvalues.real.max())
    assert eigenvalues.real.min() > {"love": 1.8, "punch": 0.25}[kernel]


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", [(1, 9), (9, 9), (13, 6), (3, 40)])
def test_grid_operator_is_positive_definite(kernel, shape):
    lowest = np.linalg.eigvalsh(dense_matrix(coefficients(shape, kernel)))[0]
    assert lowest > {"love": 1.8, "punch": 0.25}[kernel]


@pytest.mark.parametrize("shape", [(9, 9), (13, 6), (3, 40), (17, 17)])
def test_inverse_of_love_is_an_m_matrix_and_that_of_punch_is_not(shape):
    def inverse(kernel, kept):
        return np.linalg.inv(dense_matrix(coefficients(shape, kernel))[np.ix_(kept, kept)])

    everything = np.arange(shape[0] * shape[1])
    some = np.flatnonzero(noise(everything.size) > 0)
    for kept in (everything, some):
        love = inverse("love", kept)
        assert (love - np.diag(np.diag(love))).max() <= 1e-14
        assert love.sum(axis=1).min() > 0.0
    punch = inverse("punch", everything)
    assert (punch - np.diag(np.diag(punch))).max() > 1e-3
