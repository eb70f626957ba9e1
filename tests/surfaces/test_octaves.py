"""Variance of the heights by octave of waves, along x and along y."""

import itertools

import numpy as np
from numpy.testing import assert_allclose

from roughvol.surfaces import Spectrum, Surface, power_law_surface
from roughvol.surfaces.psd import octaves


def test_a_wave_is_in_its_octave_along_its_axis():
    x = np.arange(64) * 2.0 * np.pi / 64
    for (k, octave), aside in itertools.product(((1, 0), (2, 1), (3, 1), (4, 2), (9, 3)), (64, 16)):
        z = np.cos(k * x)[:, np.newaxis] * np.ones(aside)
        for field, row in ((z, 0), (z.T, 1)):
            expected = np.zeros((2, 5))
            expected[row, octave] = 1.0
            assert_allclose(octaves(Surface(field, 1.0, sides="periodic")), expected, atol=1e-12)


def test_octaves_of_a_turned_surface_are_those_of_the_surface():
    surface = power_law_surface(Spectrum(rolloff=4.0, cut=16.0, anisotropy=2.0), 0.8, 64, seed=1)
    turned = Surface(surface.heights.T, surface.spacing, sides="periodic")
    assert_allclose(octaves(turned), octaves(surface)[::-1], atol=1e-12)
