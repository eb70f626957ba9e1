"""ISO 25178-2 numbers against closed forms, indices against the Gaussian, exponents against the known surfaces."""

import math

import numpy as np
import pytest

from roughvol.errors import SurfaceError
from roughvol.surfaces import texture
from roughvol.surfaces.midpoint import random_midpoint_displacement

X, Y = np.meshgrid(np.arange(65), np.arange(65), indexing="ij")
HEIGHTS = {"Sq": 1, "Sa": 1, "Sp": 1, "Sv": 1, "Sz": 1, "Ssk": 0, "Sku": 0, "Svi": 0, "Sbi": 0}
FLAT = np.full((4, 5), 3.0)


def rough(seed=0, m=5, D=2.5, law="std"):
    return random_midpoint_displacement(D, m, seed=seed, law=law).heights


def gaussian(seed=0, nodes=600):
    return np.random.Generator(np.random.PCG64(seed)).standard_normal((nodes, nodes))


def test_numbers_of_a_two_level_field():
    z = np.array([[4.0, 0.0, 0.0, 0.0]] * 4)  # a quarter at +3 about the mean, the rest at -1
    assert texture.Sq(z) == pytest.approx(math.sqrt(3.0), rel=1e-15)
    assert texture.Sa(z) == pytest.approx(1.5, rel=1e-15)
    assert texture.Ssk(z) == pytest.approx(6.0 / 3.0**1.5, rel=1e-14)
    assert texture.Sku(z) == pytest.approx(21.0 / 9.0, rel=1e-14)
    assert (texture.Sp(z), texture.Sv(z), texture.Sz(z)) == (3.0, 1.0, 4.0)


@pytest.mark.parametrize("name", HEIGHTS)
def test_height_parameters_scale_with_their_power_and_ignore_position(name):
    number, z = getattr(texture, name), rough()
    for factor in (1e-250, 3.0, 1e250):
        assert number(z * factor) / factor ** HEIGHTS[name] == pytest.approx(number(z), rel=1e-12)
    assert number(z + 7.0) == pytest.approx(number(z), rel=1e-12)
    assert number(z.T[::-1]) == pytest.approx(number(z), rel=1e-12)


def test_flat_field():
    assert [getattr(texture, name)(FLAT) for name in ("Sq", "Sa", "Sp", "Sv", "Sz")] == [0.0] * 5
    assert texture.Sdq(FLAT, 1.0) == 0.0
    assert all(math.isnan(getattr(texture, name)(FLAT)) for name in ("Ssk", "Sku", "Svi", "Sbi"))
    assert math.isnan(texture.hurst_structure(FLAT))
    assert math.isnan(texture.hurst_spectrum(np.zeros((40, 40))))
    assert math.isnan(texture.hurst_spectrum(rough(m=4)))  # too small


def test_slope_is_exact_for_planes_and_scales():
    assert texture.Sdq(0.3 * X - 0.4 * Y, 0.1) == pytest.approx(5.0, rel=1e-13)
    slope = texture.Sdq(rough(), 0.5)
    assert texture.Sdq(rough(), 1.0) == pytest.approx(slope / 2, rel=1e-15)
    assert texture.Sdq(rough() * 1e-250, 0.5) == pytest.approx(slope * 1e-250, rel=1e-14, abs=0.0)
    assert texture.Sdq((-1.0) ** (X + Y), 1.0) == 0.0  # blind to the wave of the lattice


def summits_by_loops(z):
    found = np.zeros(z.shape, dtype=bool)
    for i in range(1, z.shape[0] - 1):
        for j in range(1, z.shape[1] - 1):
            around = [z[i + a, j + b] for a in (-1, 0, 1) for b in (-1, 0, 1) if (a, b) != (0, 0)]
            found[i, j] = z[i, j] > max(around)
    return found


@pytest.mark.parametrize("shape", [(3, 3), (3, 9), (16, 11)])
def test_summits_equal_plain_loops(shape):
    z = np.random.Generator(np.random.PCG64(4)).integers(0, 9, shape).astype(float)  # many ties
    np.testing.assert_array_equal(texture.summits(z), summits_by_loops(z))


def test_summit_plane_lies_above_the_mean_plane_and_needs_a_summit():
    assert rough().mean() < texture.summit_plane(rough()) <= rough().max()
    for number in (lambda z: texture.summit_plane(z), lambda z: texture.summit_radius(z, 1.0)):
        with pytest.raises(SurfaceError, match="4 × 5 nodes have no summit"):
            number(FLAT)


def test_summit_radius_of_paraboloids():
    z = -((X - 32.0) ** 2 + (Y - 32.0) ** 2) * 0.25 / (2 * 7.0) + 1000.0
    assert texture.summit_radius(z, 0.5) == pytest.approx(7.0, rel=1e-9)


def test_material_ratio_counts():
    z = rough()
    levels = np.array([z.min() - 1, z.min(), np.median(z), z.max(), z.max() + 1])
    ratio = texture.material_ratio(z, levels)
    np.testing.assert_array_equal(ratio, [(z >= level).mean() for level in levels])
    assert (ratio[0], ratio[1], ratio[-1]) == (1.0, 1.0, 0.0)
    assert np.all(np.diff(texture.material_ratio(z, np.linspace(z.min(), z.max(), 99))) <= 0.0)


def test_indices_of_a_gaussian_field():
    # Svi = φ(t) + tΦ(t) at Φ(t) = 0.2, Sbi = 1/1.6449; 360 000 nodes: standard errors are about 4e-4 and 2e-3.
    assert texture.Svi(gaussian()) == pytest.approx(0.11156, abs=1.6e-3)
    assert texture.Sbi(gaussian()) == pytest.approx(1 / 1.6448536, abs=8e-3)


@pytest.mark.parametrize("shape", [(3, 3), (3, 50), (33, 40)])
def test_structure_of_a_plane_has_exponent_one(shape):
    plane = np.add.outer(np.arange(shape[0]), 2.0 * np.arange(shape[1]))
    assert texture.hurst_structure(plane) == pytest.approx(1.0, abs=1e-12)


def test_exponents_of_white_noise():
    # S does not depend on the lag (H = 0) and C not on q (H = -1); standard errors of the means 2e-4 and 1.4e-2.
    fields = [gaussian(seed, 300) for seed in range(6)]
    assert np.mean([texture.hurst_structure(z) for z in fields]) == pytest.approx(0.0, abs=6e-4)
    assert np.mean([texture.hurst_spectrum(z) for z in fields]) == pytest.approx(-1.0, abs=3.5e-2)


@pytest.mark.parametrize(("shape", "periodic"), [((65, 65), True), ((64, 40), False)])
def test_the_exponent_of_a_spectrum_has_no_direction(shape, periodic):
    z = rough(m=6)[: shape[0], : shape[1]]
    turned = [texture.hurst_spectrum(field, periodic=periodic) for field in (z, z.T, z[::-1], z[:, ::-1])]
    assert turned == pytest.approx([turned[0]] * 4, rel=1e-10)


@pytest.mark.parametrize("function", [texture.hurst_structure, texture.hurst_spectrum])
def test_exponents_ignore_units(function):
    z = rough(m=6)
    assert function(z * 1e-250) == pytest.approx(function(z), rel=1e-10)


def test_the_longest_wave_of_the_exponent_counts_on_every_period():
    for nodes in range(32, 100):
        z = np.resize(rough(m=7), (nodes, nodes))
        wave = 10.0 * np.cos(2.0 * np.pi * 4.0 * np.arange(nodes) / nodes)
        plain, *longer = (texture.hurst_spectrum(z + more, periodic=True) for more in (0.0, wave, wave[:, None]))
        assert min(longer) > plain + 0.1, nodes


@pytest.mark.parametrize(("law", "share"), [("std", 1.0), ("variance", 0.5)])
@pytest.mark.parametrize("D", [2.2, 2.5])
def test_midpoint_surfaces_have_the_exponent_of_their_law(D, law, share):
    """Mean over 6 seeds at m = 8; the wrong law would be off by 0.25 (D = 2.5) or 0.4 (D = 2.2).

    Spectrum: bias -0.05, standard error 0.016. Structure function: the bias is -0.13 at H = 0.8 and less below.
    """
    fields = [rough(seed, 8, D, law) for seed in range(6)]
    hurst = share * (3.0 - D)
    assert np.mean([texture.hurst_spectrum(z) for z in fields]) == pytest.approx(hurst, abs=0.09)
    assert np.mean([texture.hurst_structure(z) for z in fields]) == pytest.approx(hurst, abs=0.15)
