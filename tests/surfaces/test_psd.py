"""The measured density: of a period exactly, of a patch under a window."""

import math

import numpy as np
import pytest

from roughvol.surfaces.psd import spectral, waves
from roughvol.surfaces.spectrum import Spectrum
from roughvol.surfaces.surface import Surface
from roughvol.surfaces.waves import power_law_surface


def test_a_single_wave_has_its_power_in_its_ring():
    x = 2.0 * math.pi * np.arange(32) / 32
    surface = Surface(3.0 * np.cos(4.0 * x)[:, None] + np.zeros((32, 48)), 0.5, sides="periodic")
    found, q = spectral(surface), 2.0 * math.pi * 4.0 / 16.0
    assert found.rms_height == pytest.approx(3.0 / math.sqrt(2.0))
    assert found.rms_slope == pytest.approx(q * 3.0 / math.sqrt(2.0))
    assert found.rms_curvature == pytest.approx(0.5 * q * q * 3.0 / math.sqrt(2.0))
    assert found.nayak == pytest.approx(1.5)
    assert np.flatnonzero(found.psd > 1e-12).tolist() == [3]
    assert (found.rms_height_below > 1.0).tolist() == [False] * 3 + [True] * 13
    np.testing.assert_allclose(found.rms_slope_below[3:], found.rms_slope)


def test_waves_are_counted_along_each_side_by_their_variance():
    x, y = (2.0 * math.pi * np.arange(n) / n for n in (32, 45))
    heights = np.cos(np.add.outer(3.0 * x, 5.0 * y)) + 2.0 * np.cos(np.add.outer(4.0 * x, 0.0 * y))
    np.testing.assert_allclose(waves(Surface(heights, 0.5, sides="periodic")), [(3 + 4 * 4) / 5, 5 / 5])
    assert np.isnan(waves(Surface(np.ones((4, 5)), 1.0))).all()


@pytest.mark.parametrize("shape", [(15, 16), (16, 15), (9, 30), (8, 16)])
def test_the_density_is_the_mean_over_directions_of_a_plain_sum(shape):
    heights = np.random.default_rng(1).standard_normal(shape)
    surface, spacing = Surface(heights, 0.25, sides="periodic"), 0.25
    rings = {}
    area = heights.size * spacing**2
    for i in range(-(shape[0] // 2), (shape[0] + 1) // 2):
        for j in range(-(shape[1] // 2), (shape[1] + 1) // 2):
            phase = np.add.outer(i * np.arange(shape[0]) / shape[0], j * np.arange(shape[1]) / shape[1])
            amplitude = spacing**2 * np.sum((heights - heights.mean()) * np.exp(-2j * np.pi * phase))
            ring = math.floor(math.hypot(i, j * shape[0] / shape[1]) + 0.5)  # k - ½ ≤ q L/(2π) < k + ½
            rings.setdefault(ring, []).append(abs(amplitude) ** 2 / area)
    found = spectral(surface)
    for ring, value in zip(found.wave.tolist(), found.psd, strict=True):
        if ring in rings:
            assert value == pytest.approx(np.mean(rings[ring]), rel=1e-9)
        else:
            assert math.isnan(value)
    assert found.rms_height == pytest.approx(surface.Sq)


def test_a_window_gives_the_density_of_a_patch():
    """White noise is flat, and of the same level, under a window; a tilt of the rim does not leak into short waves."""
    noise = np.random.default_rng(2).standard_normal((129, 129))
    patch, period = Surface(noise, 1.0), Surface(noise, 1.0, sides="periodic")
    assert np.mean(spectral(patch).psd[8:]) == pytest.approx(np.mean(spectral(period).psd[8:]), rel=0.06)
    ramp = np.linspace(0.0, 1.0, 129)[:, None] + np.zeros((129, 129))
    leaks = [spectral(Surface(ramp, 1.0, sides=sides)).psd[30] for sides in ("free", "periodic")]
    assert leaks[0] < 1e-4 * leaks[1]


@pytest.mark.parametrize("scale", [1e-200, 1e140])
def test_heights_of_any_scale_have_a_spectrum(scale):
    surface = power_law_surface(Spectrum(rolloff=4.0, cut=32.0), 0.8, 64)
    other = Surface(surface.heights * scale, surface.spacing, sides="periodic")
    assert spectral(other).rms_slope == pytest.approx(scale * spectral(surface).rms_slope, rel=1e-12, abs=0.0)
    assert spectral(other).nayak == pytest.approx(spectral(surface).nayak, rel=1e-12)


def test_a_flat_surface_has_no_waves():
    found = spectral(Surface(np.ones((8, 8)), 1.0))
    assert (found.rms_height, found.rms_slope, found.rms_curvature) == (0.0, 0.0, 0.0)
    assert math.isnan(found.nayak)
