"""The periodic half space against sums over images, its laws, Westergaard's wave, and two other codes."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from oracles import dense_matrix, exact_pressure, scaled_overlap

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import KERNELS, layer, periodic_spectrum
from roughvol.contact.loading import Trials, solve, sweep
from roughvol.contact.search import indentation_for
from roughvol.errors import ContactError
from roughvol.reproduction import closed_forms
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface

REFERENCE = Path(__file__).parents[3] / "shared" / "reference" / "periodic_64.npz"
SHAPES = [(5, 5), (5, 8), (16, 16), (15, 22), (9, 31), (40, 24)]


@lru_cache
def half_space(shape, kernel="love"):
    return HalfSpace(shape, kernel, periodic=True)


def rough(m=4, D=2.4, seed=0):
    return random_midpoint_displacement(D, m, side=1.0, seed=seed, periodic=True)


def lattice(contact):
    """q = p δ/(π E* σ) of a record."""
    return contact.pressure().ravel() / (math.pi * contact.shape[0])


# ---- the operator


@pytest.mark.parametrize("kernel", ["love", "punch"])
@pytest.mark.parametrize("shape", [(5, 5), (5, 8), (7, 6)])
def test_coefficients_are_sums_over_images(kernel, shape):
    """Rectangles of images, equal but for a constant. The rest falls as 1/reach, and is extrapolated."""

    def images(reach):
        number = np.arange(-reach, reach + 1)
        total = np.zeros(shape)
        for i, j in itertools.product(range(shape[0]), range(shape[1])):
            row, column = np.abs(i + shape[0] * number), np.abs(j + shape[1] * number)
            total[i, j] = KERNELS[kernel].coefficients(row[:, None], column).sum()
        return total - total.mean()

    ours = half_space(shape, kernel).influence
    ours = ours - ours.mean()
    half, whole = images(100), images(200)
    assert np.abs(2.0 * whole - half - ours).max() < 1e-5
    assert np.abs(whole - ours).max() < 1e-1


def test_spectrum_is_that_of_uniform_pressure_on_elements():
    """The sum over aliases, by brute force along both axes, for waves of all directions."""
    n, spectrum = 16, periodic_spectrum((16, 16))
    alias = np.arange(-1500, 1501)
    for k, n_y in ((0, 1), (1, 0), (1, 1), (3, 5), (8, 8), (0, 8)):
        row, column = (k / n + alias)[:, None], n_y / n + alias
        total = (np.sinc(row) * np.sinc(column) / np.hypot(row, column)).sum()
        assert spectrum[k, n_y] == pytest.approx(total, rel=5e-10)


def test_long_waves_see_the_half_space():
    """λ → 1/|f| for long waves: 2/(E* q)."""
    love, fourier = (periodic_spectrum((512, 512), KERNELS[kernel]) for kernel in ("love", "fourier"))
    assert love[1, 0] == pytest.approx(fourier[1, 0], rel=1e-4)
    assert love[2, 3] == pytest.approx(fourier[2, 3], rel=1e-3)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", SHAPES)
def test_convolution_is_the_matrix_of_the_coefficients(shape, kernel):
    space = half_space(shape, kernel)
    matrix = dense_matrix(space.influence)
    assert np.abs(matrix - matrix.T).max() <= 1e-13 * matrix.max()
    pressure = np.random.default_rng(1).random(shape)
    u = matrix @ pressure.ravel()
    scale = np.abs(u).max()
    assert space.displacement(pressure).ravel() == pytest.approx(u, abs=1e-13 * scale)
    some = np.flatnonzero(pressure.ravel() > 0.4)
    loaded = pressure.ravel()[some]
    heights = np.random.default_rng(2).random(pressure.size)
    above = space.displacement_above(heights, some, loaded)
    assert above == pytest.approx(matrix[:, some] @ loaded - heights, abs=1e-13 * scale)
    near = matrix[np.ix_(some, some)] @ loaded
    assert space.displacement_at(some, loaded) == pytest.approx(near, abs=1e-13 * scale)
    assert space.displacement_at(some, loaded, single=True) == pytest.approx(near, abs=1e-5 * scale)
    assert space.total_compliance.ravel() == pytest.approx(matrix.sum(axis=1), rel=1e-12)


@pytest.mark.parametrize("shape", [(16, 16), (24, 24), (15, 15), (8, 24), (24, 8)])
def test_love_has_the_inverse_of_an_m_matrix(shape):
    inverse = np.linalg.inv(dense_matrix(half_space(shape).influence))
    off = inverse - np.diag(inverse.diagonal())
    assert off.max() <= 0.0
    assert inverse.sum(axis=1).min() > 0.0
    assert half_space(shape).influence.min() > 0.0


def test_fourier_on_the_grid_has_not():
    inverse = np.linalg.inv(dense_matrix(half_space((16, 16), "fourier").influence))
    assert (inverse - np.diag(inverse.diagonal())).max() > 1e-3


def test_what_cannot_be_is_refused():
    with pytest.raises(ContactError, match="kernel is 'hertz'; allowed: love, punch, fourier"):
        HalfSpace((8, 8), "hertz", periodic=True)
    with pytest.raises(ContactError, match="at least 5 × 5 elements"):
        HalfSpace((2, 8), periodic=True)
    with pytest.raises(ContactError, match="pressure has shape"):
        half_space((16, 16)).displacement(np.ones((3, 3)))
    with pytest.raises(ContactError, match="the surface is periodic, the half space free"):
        solve(rough(), HalfSpace((16, 16)), 1.0)
    with pytest.raises(ContactError, match="the surface is free, the half space periodic"):
        solve(Surface(rough().heights, 1.0), half_space((16, 16)), 1.0)


def test_a_kernel_with_a_length_is_one_function():
    """An elastic layer presses as the dense oracle says, is stiffer than the half space, and tends to it with depth."""
    surface = rough(m=4)
    states = []
    for kernel in (layer(2.0, 0.5), layer(6.0, 0.5), layer(1e3, 0.5), KERNELS["fourier"]):
        space = HalfSpace(surface.shape, kernel, periodic=True)
        states.append(solve(surface, space, 1.5, rtol=1e-10))
        exact = exact_pressure(dense_matrix(space.influence), scaled_overlap(surface, 1.5).ravel())
        np.testing.assert_allclose(lattice(states[-1]), exact, atol=1e-8 * exact.max())
    thin, thicker, thick, half = (state.mean_pressure for state in states)
    assert thin > thicker > half
    assert thick == pytest.approx(half, rel=1e-9)
    assert layer(2.0, 0.5) == layer(2.0, 0.5) != layer(3.0, 0.5)
    with pytest.raises(ContactError, match="allowed on a free patch: love, punch"):
        HalfSpace((9, 9), layer(2.0, 0.5))


# ---- states


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("approach", [0.05, 0.8, 2.5, 20.0])
def test_contact_is_that_of_the_dense_oracle(kernel, approach):
    surface = rough()
    space = half_space(surface.shape, kernel)
    exact = exact_pressure(dense_matrix(space.influence), scaled_overlap(surface, approach).ravel())
    contact = solve(surface, space, approach, rtol=1e-11)
    assert lattice(contact) == pytest.approx(exact, abs=1e-9 * exact.max())


@pytest.mark.parametrize("kernel", KERNELS)
def test_mean_gap_is_the_separation(kernel):
    """V* = d/σ exactly, Δ is that of the mean planes, and the approach exceeds it by p*."""
    surface = rough(5)
    for contact in sweep(surface, half_space(surface.shape, kernel), [0.3, 1.0, 3.0, 10.0, 40.0]):
        assert contact.free_volume == contact.separation
        assert contact.gap().mean() == pytest.approx(contact.free_volume, abs=1e-6)
        assert contact.indentation == pytest.approx(surface.peak - contact.separation, abs=1e-12)
        assert contact.approach == pytest.approx(contact.indentation + contact.mean_pressure, abs=1e-6)
        assert contact.indentation <= surface.peak + 1e-12


def test_answer_does_not_depend_on_the_constant_of_the_zero_mode(monkeypatch):
    """Another constant relabels the approach: the state at equal pressure is the same."""
    surface = rough()
    space = HalfSpace(surface.shape, periodic=True)
    one = solve(surface, space, 2.0, rtol=1e-11)
    monkeypatch.setattr("roughvol.contact.kernels.math.pi", 3.0 * math.pi)
    other = HalfSpace(surface.shape, periodic=True)
    monkeypatch.undo()
    same = solve(surface, other, one.indentation + 3.0 * one.mean_pressure, rtol=1e-11)
    assert same.pressure() == pytest.approx(one.pressure(), abs=1e-8)
    assert same.indentation == pytest.approx(one.indentation, abs=1e-9)


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_rolled_surface_has_rolled_pressures(kernel):
    surface = rough(5)
    shift = (11, 20)
    rolled = Surface(np.roll(surface.heights, shift, (0, 1)), surface.spacing, periodic=True)
    one, other = (solve(each, half_space(surface.shape, kernel), 1.5, rtol=1e-11) for each in (surface, rolled))
    assert other.pressure() == pytest.approx(np.roll(one.pressure(), shift, (0, 1)), abs=1e-8)


def test_two_periods_are_one_twice():
    surface = rough()
    double = Surface(np.tile(surface.heights, (2, 1)), surface.spacing, periodic=True)
    one = solve(surface, half_space(surface.shape), 1.5, rtol=1e-11)
    # p* is over L, which is twice as long; the zero mode is that of the longer side
    two = solve(double, half_space(double.shape), one.indentation + 2.0 * one.mean_pressure, rtol=1e-11)
    assert two.pressure() == pytest.approx(2.0 * np.tile(one.pressure(), (2, 1)), abs=1e-8)
    assert two.free_volume == pytest.approx(one.free_volume, abs=1e-9)


@pytest.mark.parametrize("kernel", ["love", "fourier"])
def test_sweep_to_full_contact(kernel):
    """To A* = 0.99 and on to full contact, where the mean gap is exactly zero and Δ stays at z_max."""
    surface = rough(6, 2.3)
    space = half_space(surface.shape, kernel)
    end = indentation_for(surface, space, "contact_area", 0.99)
    contacts = list(sweep(surface, space, end * np.arange(1, 31) / 30))
    assert contacts[-1].contact_area_fraction == pytest.approx(0.99, abs=2e-3)
    for name, sign in (("contact_area_fraction", 1), ("mean_pressure", 1), ("free_volume", -1), ("indentation", 1)):
        values = [sign * getattr(contact, name) for contact in contacts]
        assert all(before <= after + 1e-6 for before, after in itertools.pairwise(values))
    full = solve(surface, space, 3.0 * end)
    assert full.contact_area_fraction == 1.0
    assert full.free_volume == full.separation == 0.0
    assert full.indentation == pytest.approx(surface.peak, abs=1e-12)


def self_affine(shape, longest=1.0, hurst=0.8, seed=3):
    """Heights of one period of any sides; waves longer than the longest side over `longest` have equal power."""
    waves = [np.fft.fftfreq(n) * max(shape) for n in shape]
    k = np.hypot(waves[0][:, None], waves[1])
    noise = np.random.Generator(np.random.PCG64(seed)).standard_normal(shape)
    return np.fft.ifft2(np.fft.fft2(noise) / np.maximum(k, longest) ** (1.0 + hurst)).real


@pytest.mark.parametrize("shape", [(64, 64), (75, 50), (128, 24), (37, 96), (61, 17), (25, 130)])
def test_seams_take_no_more_iterations_than_the_middle(shape):
    """Sides that are multiples of 8, of 64, or neither; the surface is rolled so that its peak lies on the corner."""
    heights = self_affine(shape)
    top = np.unravel_index(heights.argmax(), shape)
    iterations = []
    for shift in (-top[0], -top[1]), (shape[0] // 2 - top[0], shape[1] // 2 - top[1]):
        surface = Surface(np.roll(heights, shift, (0, 1)), 1.0, periodic=True)
        contacts = list(sweep(surface, half_space(shape), np.linspace(0.0, 8.0, 21)[1:]))
        iterations.append(sum(contact.iterations for contact in contacts))
    assert iterations[0] <= 1.3 * iterations[1] + 20


# 0.11.1 ended without convergence on all of these: one or two thousand iterations, or a residual that was no number
@pytest.mark.parametrize("shape", [(17, 17), (61, 17), (74, 15), (129, 129), (133, 133), (137, 137), (116, 140)])
def test_periods_of_any_sides_converge_wherever_they_begin(shape):
    heights = self_affine(shape, longest=4.0, hurst=0.3, seed=1)
    surface = Surface(heights, 1.0, periodic=True)
    rolled = Surface(np.roll(heights, (5, 3), (0, 1)), 1.0, periodic=True)
    for kernel, area in (("love", 0.5), ("fourier", 0.9)):
        space = half_space(shape, kernel)
        approach = indentation_for(surface, space, "contact_area", area)
        one, other = (solve(each, space, approach) for each in (surface, rolled))
        assert max(one.residual, other.residual) <= 1e-6
        assert one.contact_area_fraction >= area
        assert one.free_volume == pytest.approx(other.free_volume, abs=2e-6)
        assert max(one.iterations, other.iterations) < 60


@pytest.mark.parametrize("value", [0.5, 0.05])
def test_search_for_a_free_volume(value):
    surface = rough(6)
    space = half_space(surface.shape)
    approach = indentation_for(surface, space, "free_volume", value)
    assert solve(surface, space, approach).separation == pytest.approx(value, abs=3e-6)
    with pytest.raises(ContactError, match=r"allowed: 0 < V\* <"):
        indentation_for(surface, space, "free_volume", 99.0)


def test_search_for_a_free_volume_of_a_free_patch():
    surface = random_midpoint_displacement(2.4, 5, seed=1)
    space = HalfSpace(surface.shape)
    approach = indentation_for(surface, space, "free_volume", 1.0)
    assert solve(surface, space, approach).free_volume == pytest.approx(1.0, abs=3e-6)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_search_for_a_free_volume_next_to_that_of_the_first_touch(periodic, seed):
    """0.11.1 went on to an indentation of 1e-322 where the difference was that of rounding."""
    surface = Surface(self_affine((85, 31), 4.0, seed=seed), 1.0, periodic=periodic)
    space = HalfSpace(surface.shape, periodic=periodic)
    most = Trials(surface, space).untouched.gap().mean()
    for ulps in (0, 1, 3, 100, 10**6):
        value = most - ulps * np.spacing(most)
        if not ulps:
            with pytest.raises(ContactError, match="that of the first touch"):
                indentation_for(surface, space, "free_volume", value)
            continue
        approach = indentation_for(surface, space, "free_volume", value)
        assert approach >= 0.1 * (most - value)
        assert solve(surface, space, approach).free_volume == pytest.approx(value, abs=2e-15)


def test_a_limit_of_the_pressure_holds():
    """Plastic displacement: V* = d/σ + plastic volume, and pressures end at the hardness."""
    surface = rough(5)
    for contact in sweep(surface, half_space(surface.shape), [1.0, 4.0, 8.0, 5.0], hardness=15.0):
        assert contact.pressure().max() <= 15.0 + 1e-9
        assert contact.free_volume == pytest.approx(contact.separation + contact.plastic_volume, abs=1e-12)
        assert contact.gap().mean() == pytest.approx(contact.free_volume, abs=1e-5)
    assert contact.plastic_volume > 0.0


# ---- closed forms, and other codes


GAPS = {0.1: 0.34011294, 0.2: 0.14366227, 0.25: 0.07671320, 0.3: 0.03403226, 0.4: 0.00235590, 0.45: 0.00015095}


@pytest.mark.parametrize(("ratio", "mean_gap"), GAPS.items())
def test_westergaards_mean_gap(ratio, mean_gap):
    x = (np.arange(200_000) + 0.5) / 200_000
    wave = closed_forms.westergaard(x, ratio, 0.01, 1.0)
    assert wave.gap.mean() / 0.02 == pytest.approx(mean_gap, abs=2e-8)
    assert wave.pressure.mean() == pytest.approx(wave.mean_pressure, rel=1e-6)


def wave_errors(n, kernel, ratio=0.25):
    """Errors of p and of the mean gap of a wave of n elements under Westergaard's mean pressure."""
    x = np.arange(n) / n
    surface = Surface(np.repeat(np.cos(2.0 * np.pi * x)[:, None], 5, axis=1), 1.0 / n, periodic=True)
    exact = closed_forms.westergaard(x, ratio, 1.0, 1.0)
    space = HalfSpace(surface.shape, kernel, periodic=True)
    unit = surface.Sq
    approach = indentation_for(surface, space, "pressure", exact.mean_pressure / unit, rtol=1e-9)
    contact = solve(surface, space, approach, rtol=1e-9)
    return (
        float(np.sqrt(np.mean((contact.pressure()[:, 0] * unit - exact.pressure) ** 2))),
        abs(contact.free_volume * unit / 2.0 - GAPS[ratio]),
    )


ORDERS = {"love": (1.0, 2.0), "fourier": (1.0, 2.0), "punch": (0.75, 1.0)}  # of pressures, and of the mean gap


@pytest.mark.parametrize(("kernel", "orders"), ORDERS.items())
def test_wave_converges_to_westergaard(kernel, orders):
    """Order of convergence by kernel, over an eightfold refinement."""
    for before, after, order in zip(wave_errors(64, kernel), wave_errors(512, kernel), orders, strict=True):
        assert math.log(before / after) / math.log(8.0) == pytest.approx(order, abs=0.35)
        assert after < {1.0: 5e-3, 2.0: 1e-6, 0.75: 2e-2}[order]


@pytest.mark.skipif(not REFERENCE.exists(), reason="no reference files here")
def test_two_other_codes_find_the_same():
    """periodic_64.npz: Fourier kernel, mean pressure imposed. A* exact, mean gap and largest pressure to 1e-8."""
    with np.load(REFERENCE) as stored:
        surface, rows = Surface(stored["z"], float(stored["L"]) / 64, periodic=True), stored["rows"]
    space, unit = HalfSpace((64, 64), "fourier", periodic=True), surface.Sq
    for pressure, area, gap, largest in rows:
        # the pressure of a search has a relative error of 1e-6: two secant steps
        at = [indentation_for(surface, space, "pressure", pressure / unit, rtol=1e-11)]
        at.append(at[0] * (1.0 + 1e-6))
        contacts = [solve(surface, space, approach, rtol=1e-13 * 4.0**2) for approach in at]
        for _ in range(2):
            (p, q), (a, b) = ([each.mean_pressure * unit for each in contacts[-2:]], at[-2:])
            if p == q:
                break
            at.append(b + (pressure - q) * (b - a) / (q - p))
            contacts.append(solve(surface, space, at[-1], rtol=1e-13 * 4.0**2))
        last = contacts[-1]
        assert last.mean_pressure * unit == pytest.approx(pressure, rel=1e-10)
        assert last.contact_area_fraction == area
        assert last.free_volume * unit == pytest.approx(gap, rel=1e-8)
        assert last.pressure().max() * unit == pytest.approx(largest, rel=1e-8)
