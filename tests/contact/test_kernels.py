"""Kernels against quadrature and sums over images, their laws, and the inverse that the prediction rests on."""

import itertools
import math

import numpy as np
import pytest

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import KERNELS, influence_matrix, kernel_of, layer, love_kernel, periodic_spectrum
from roughvol.contact.kernels import punch_kernel as punch
from roughvol.contact.loading import solve, sweep
from roughvol.contact.search import indentation_for
from roughvol.errors import ContactError
from tests.contact.kit import coefficients, dense, dense_matrix, every_body, fractal, half_space, random
from tests.refused import refusals

EPS = np.finfo(float).eps


def test_love_kernel_is_the_integral_over_the_element():
    nodes, weights = np.polynomial.legendre.leggauss(24)
    for x, y in (
        *[(1, 0), (0, 1), (1, 1), (2, 0), (3, 7), (7, 2), (0.25, 3), (17, 0), (44, 0)],  # and an offset between nodes
        *[(63, 0), (64, 0), (64, 1), (65, 0), (65, 1), (45, 45), (46, 46)],  # both sides of the change of form
        *[(200, 3), (8192, 0), (8192, 1), (8192, 8191), (1e6, 1e6)],
    ):
        distance = np.hypot(x - 0.5 * nodes[:, None], y - 0.5 * nodes)
        integral = np.sum(np.outer(weights, weights) / 4.0 / distance)
        assert float(love_kernel(x, y)) == pytest.approx(integral, rel=1e-13, abs=0.0), (x, y)
    assert float(love_kernel(0.0, 0.0)) == pytest.approx(4.0 * math.log(1.0 + math.sqrt(2.0)), rel=4 * EPS)


def test_punch_kernel_values():
    expected = [2.0, math.pi / 3, math.pi / 3, 2 * math.asin(math.sqrt(0.125)), 2 * math.asin(0.1)]
    np.testing.assert_allclose(punch([0, 1, 0, 1, 3], [0, 0, 1, 1, 4]), expected, rtol=4 * EPS)


def test_influence_matrix_is_k_of_the_offsets():
    influence = coefficients((17, 33))
    elements = np.sort(random(4).choice(influence.size, 40, replace=False))
    assert np.array_equal(influence_matrix(influence, elements), dense_matrix(influence)[np.ix_(elements, elements)])
    every_eighth = influence[::8, ::8]  # a view, as blocks have it
    assert np.array_equal(influence_matrix(every_eighth, np.arange(every_eighth.size)), dense_matrix(every_eighth))


@pytest.mark.parametrize(("kernel", "shape"), [("love", (5, 6)), ("punch", (5, 5))])
def test_coefficients_of_a_period_are_sums_over_images(kernel, shape):
    """Rectangles of images, equal but for a constant. The rest falls as 1/reach, and is extrapolated."""

    def images(reach):
        number = np.arange(-reach, reach + 1)
        total = np.zeros(shape)
        for i, j in itertools.product(range(shape[0] // 2 + 1), range(shape[1] // 2 + 1)):
            row, column = np.abs(i + shape[0] * number), np.abs(j + shape[1] * number)
            total[np.ix_([i, -i], [j, -j])] = KERNELS[kernel].coefficients(row[:, None], column).sum()
        return total - total.mean()

    ours = half_space(shape, kernel, "periodic").influence
    half, whole = images(100), images(200)
    assert np.abs(2.0 * whole - half - (ours - ours.mean())).max() < 1e-5
    assert np.abs(whole - (ours - ours.mean())).max() < 1e-1


def test_spectrum_is_that_of_uniform_pressure_on_elements():
    """The sum over aliases, by brute force along both axes, for waves of all directions."""
    n, spectrum = 16, periodic_spectrum((16, 16))
    alias = np.arange(-1000, 1001)
    for k, n_y in ((0, 1), (3, 5), (8, 8)):
        row, column = (k / n + alias)[:, None], n_y / n + alias
        total = (np.sinc(row) * np.sinc(column) / np.hypot(row, column)).sum()
        assert spectrum[k, n_y] == pytest.approx(total, rel=2e-9)


def aliases_of(thickness, nu, n, reach):
    """Sum over aliases of the waves of a layer spread over elements, as a slow counterpart; waves with i ≥ j."""
    k, m = 3.0 - 4.0 * nu, np.arange(-reach, reach + 1)
    total = np.zeros((n // 2 + 1, n // 2 + 1))
    for i, j in zip(*np.tril_indices(len(total)), strict=True):
        row, column = i / n + m[:, None], j / n + m
        f = np.hypot(row, column)
        f[f == 0.0] = np.inf
        x = np.minimum(4.0 * np.pi * f * thickness, 100.0)
        over_half_space = (k * np.sinh(x) - x) / (k * np.cosh(x) + x * x / 2.0 + (1.0 + k * k) / 2.0)
        total[i, j] = (np.sinc(row) * np.sinc(column) * over_half_space / f).sum()
    return total


@pytest.mark.parametrize(("thickness", "nu"), [(0.25, 0.3), (1.0, 0.5), (20.0, -0.5)])
def test_elements_on_a_layer_are_the_sum_over_its_aliases(thickness, nu):
    spectrum, total = periodic_spectrum((5, 5), layer(thickness, nu)), aliases_of(thickness, nu, 5, 200)
    np.testing.assert_allclose(spectrum, spectrum.T, rtol=1e-12)
    np.testing.assert_allclose(np.tril(spectrum).ravel()[1:], total.ravel()[1:], rtol=1e-6)


@pytest.mark.parametrize("elements", [False, True])
def test_a_thin_layer_is_stiffer_and_a_thick_one_is_the_half_space(elements):
    half = periodic_spectrum((16, 16), KERNELS["love" if elements else "fourier"])[1:, 1:]
    spectra = [periodic_spectrum((16, 16), layer(h, 0.5, elements))[1:, 1:] for h in (1.0, 3.0, 1e3)]
    assert (np.diff([*spectra, half * (1.0 + 1e-12)], axis=0) > 0.0).all()
    np.testing.assert_allclose(spectra[-1], half, rtol=1e-12)


@pytest.mark.parametrize(("nu", "shape"), [(-0.5, (256, 5)), (0.3, (5, 256))])
def test_long_waves_press_a_layer_as_a_mattress_of_springs(nu, shape):
    thickness = 0.25
    spectrum = periodic_spectrum(shape, layer(thickness, nu))
    springs = np.pi * thickness * (1.0 - 2.0 * nu) / (1.0 - nu) ** 2
    assert spectrum.ravel()[3 if shape[0] > 5 else 1] == pytest.approx(springs, rel=1e-4)


def test_long_waves_press_an_incompressible_layer_as_the_flow_in_it():
    """λ → 2ζ³/(3 f): the layer is squeezed sideways, p - p₀ falls off with the square of the wave."""
    thickness, f = 0.5, 1.0 / 512
    zeta = 2.0 * np.pi * f * thickness
    spectrum = periodic_spectrum((512, 5), layer(thickness, 0.5, elements=False))
    assert spectrum[1, 0] == pytest.approx(2.0 * zeta**3 / 3.0 / f, rel=5.0 * zeta**2)


@pytest.mark.parametrize(("thickness", "nu", "elements"), [(0.5, 0.5, False), (0.5, 0.3, True), (5.0, 0.5, True)])
def test_contact_of_a_layer_converges_up_to_full_contact(thickness, nu, elements):
    surface = fractal(4, 2.3, sides="periodic")
    space = HalfSpace(surface.shape, layer(thickness, nu, elements), sides="periodic")
    states = list(sweep(surface, space, np.linspace(0.5, 4.0, 8), rtol=1e-9))
    assert all(state.residual <= 1e-9 for state in states)
    assert np.diff([state.free_volume for state in states]).max() <= 0.0
    nearly = solve(surface, space, indentation_for(surface, space, "contact_area", 0.97, rtol=1e-9), rtol=1e-9)
    assert nearly.contact_area_fraction >= 0.97 > states[-1].contact_area_fraction


def test_a_kernel_carries_its_parameters():
    assert layer(2.0, 0.5) == layer(2.0, 0.5) != layer(2.0 + 1e-12, 0.5) != layer(2.0, 0.4) != layer(2.0, 0.4, False)
    assert hash(layer(2.0, 0.5)) == hash(layer(2.0, 0.5))
    assert kernel_of(layer(2.0, 0.5)).parameters == (2.0, 0.5, 1.0)
    assert kernel_of("love") is KERNELS["love"]


# ---- positive definite, and the inverse that the solver's prediction rests on


@every_body
def test_operator_is_positive_definite_and_that_of_love_has_an_m_matrix_for_inverse(sides, kernel):
    for shape in [(16, 16), (8, 24), (13, 6)] + [(1, 9), (3, 40)] * (sides == "free"):
        matrix = dense(shape, kernel, sides)
        assert np.linalg.eigvalsh(matrix)[0] > {"love": 1.8, "punch": 0.25, "fourier": 1.4}[kernel]
        everything = np.arange(matrix.shape[0])
        some = np.flatnonzero(random(0).standard_normal(everything.size) > 0)
        for kept in (everything, some):
            inverse = np.linalg.inv(matrix[np.ix_(kept, kept)])
            off = inverse - np.diag(inverse.diagonal())
            if KERNELS[kernel].m_matrix:
                assert off.max() <= 1e-14
                assert inverse.sum(axis=1).min() > 0.0
            elif kept is everything and min(shape) > 3:
                assert off.max() > 1e-3


@pytest.mark.parametrize("nodes", [2, 5, 129])
@pytest.mark.parametrize("kernel", ["love", "punch"])
def test_kernel_on_the_torus_is_positive_definite(kernel, nodes):
    # The operator of the grid is a block of the circulant one, with eigenvalues from the mirrored quadrant.
    torus = np.pad(coefficients((nodes, nodes), kernel), ((0, nodes - 2), (0, nodes - 2)), mode="reflect")
    eigenvalues = np.fft.fft2(torus)
    np.testing.assert_allclose(eigenvalues.imag, 0.0, atol=1e-12 * eigenvalues.real.max())
    assert eigenvalues.real.min() > {"love": 1.8, "punch": 0.25}[kernel]


test_refused = refusals(
    ContactError,
    (lambda: kernel_of("boussinesq"), r"'boussinesq'.*allowed: love, punch, fourier"),
    (lambda: HalfSpace((8, 8), "hertz", sides="periodic"), r"'hertz'.*allowed: love, punch, fourier"),
    (lambda: HalfSpace((9, 9), "fourier"), "allowed on a free patch: love, punch"),
    (lambda: HalfSpace((9, 9), layer(2.0, 0.5)), "kernel is 'layer'; allowed on a free patch"),
    (lambda: layer(0.0, 0.5, False), "thickness of 0 spacings.*allowed: thickness > 0"),
    (lambda: layer(math.inf, 0.3), "thickness of inf spacings"),
    (lambda: HalfSpace((9, 9), "layer"), "kernel is 'layer'; allowed: roughvol.contact.kernels.layer"),
    (lambda: HalfSpace((9, 9), threads=0), "threads is 0; allowed: whole numbers, at least 1"),
    (lambda: HalfSpace((9, 9), threads="2"), "threads is '2'; allowed: whole numbers"),
    (lambda: HalfSpace((9.7, 9.2)), r"shape is \(9.7, 9.2\); allowed: two whole numbers"),
    (lambda: HalfSpace(9), "shape is 9; allowed: two whole numbers"),
    (lambda: layer(0.2, 0.5), "thickness of 0.2 spacings.*allowed: thickness >= 0.25"),
    (lambda: layer(1.0, 0.6), "nu = 0.6"),
)
