"""Surfaces with a spectrum: the density, the amplitude, the nested grids, the skewness, and moments in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

from roughvol.errors import SurfaceError
from roughvol.surfaces import texture, waves
from roughvol.surfaces.psd import spectral
from roughvol.surfaces.spectrum import Spectrum
from roughvol.surfaces.waves import density, power_law_surface
from tests.refused import refusals

LAW = Spectrum(rolloff=4.0, cut=32.0, Sq=2.0)
SIDE = 50.0


def made(spectrum=LAW, hurst=0.8, n=64, seed=0, side=SIDE):
    return power_law_surface(spectrum, hurst, n, side=side, seed=seed)


def waves_of(surface):
    """Amplitude of every wave of a periodic surface, one by one."""
    n = surface.shape[0]
    transform = np.fft.fft2(surface.heights) / surface.heights.size
    numbers = range(-n // 2, n // 2)
    return {(i, j): complex(transform[i, j]) for i in numbers for j in numbers}


def law_of(i, j, spectrum, hurst):
    """The law in words of its docstring, of one wave, in units of its plateau."""
    k = math.sqrt((spectrum.anisotropy * i) ** 2 + j**2)
    if (i, j) == (0, 0) or k >= spectrum.cut:
        return 0.0
    return 1.0 if k < spectrum.rolloff else (k / spectrum.rolloff) ** (-2.0 - 2.0 * hurst)


@pytest.mark.parametrize(("hurst", "rolloff", "anisotropy"), [(0.2, 4.0, 1.0), (0.8, 1.0, 1.0), (0.9, 4.0, 3.0)])
def test_with_random_phases_every_wave_has_the_amplitude_of_the_law(hurst, rolloff, anisotropy):
    spectrum = replace(LAW, rolloff=rolloff, cut=16.0, phases="random", anisotropy=anisotropy)
    waves = waves_of(made(spectrum, hurst, n=32))
    law = {k: law_of(*k, spectrum, hurst) for k in waves}
    scale = LAW.Sq**2 / sum(law.values())
    for k, wave in waves.items():
        assert abs(wave) ** 2 == pytest.approx(scale * law[k], rel=1e-9, abs=1e-28)
        if anisotropy == 1.0:
            isotropic = density(spectrum, hurst, SIDE, np.hypot(*k))
            assert abs(wave) ** 2 * SIDE**2 == pytest.approx(isotropic, rel=1e-9, abs=1e-25)


def test_the_mean_density_of_gaussian_fields_is_the_law():
    seeds, n = 200, 32
    spectrum = replace(LAW, cut=16.0)
    mean = np.mean([spectral(made(spectrum, n=n, seed=seed)).psd for seed in range(seeds)], axis=0)
    exact = spectral(made(replace(spectrum, phases="random"), n=n)).psd
    numbers = 2.0 * math.pi * np.arange(1, n // 2)  # about as many waves in a ring
    # scaling every surface to Sq takes part of the scatter of the low rings; five deviations of the mean are allowed
    assert np.all(np.abs(mean / exact - 1.0)[: n // 2 - 1] < 5.0 * np.sqrt(2.0 / (seeds * numbers)))


@pytest.mark.parametrize("phases", ["gaussian", "random"])
@pytest.mark.parametrize("Ssk", [None, -1.0])
def test_the_root_mean_square_is_exact(phases, Ssk):
    for hurst, seed in ((0.1, 0), (0.9, 5)):
        surface = made(replace(LAW, phases=phases, Ssk=Ssk), hurst, seed=seed)
        assert surface.Sq == pytest.approx(2.0, rel=1e-12)
        assert abs(surface.mean_height) < 1e-12


def test_the_slope_is_the_one_asked_for_and_that_of_a_gradient_by_waves():
    surface = made(replace(LAW, slope=0.3))
    q = 2.0 * math.pi * np.fft.fftfreq(64, surface.spacing)
    transform = np.fft.fft2(surface.heights)
    gradients = [np.fft.ifft2(1j * q[:, None] * transform), np.fft.ifft2(1j * q[None, :] * transform)]
    assert math.sqrt(sum(float(np.mean(np.abs(one) ** 2)) for one in gradients)) == pytest.approx(0.3, rel=1e-10)
    assert spectral(surface).rms_slope == pytest.approx(0.3, rel=1e-10)


def moment(spectrum, hurst, order):
    """Return a moment of the isotropic spectrum, ∫ k^order k C(k) dk from 1 to L/λ_s, in units of C0."""
    ends = {"a": 1.0, "b": spectrum.cut, "points": [spectrum.rolloff]}
    return integrate.quad(lambda k: k ** (order + 1) * law_of(0, k, spectrum, hurst), **ends)[0]


def test_the_slope_is_the_integral_of_the_density():
    spectrum = Spectrum(rolloff=16.0, cut=128.0, Sq=2.0, phases="random")
    for hurst in (0.3, 0.8):
        found = spectral(made(spectrum, hurst, n=256))
        m0, m2, m4 = (moment(spectrum, hurst, order) for order in (0, 2, 4))
        wanted = 2.0 * 2.0 * math.pi / SIDE * math.sqrt(m2 / m0)
        assert found.rms_slope == pytest.approx(wanted, rel=0.01)  # a sum over waves for an integral
        q = 2.0 * math.pi / SIDE * found.wave
        by_rings = math.sqrt(float(np.sum(q**3 * found.psd)) * (q[1] - q[0]) / (2.0 * math.pi))
        assert found.rms_slope == pytest.approx(by_rings, rel=0.01)
        np.testing.assert_allclose(found.psd[20:120], density(spectrum, hurst, SIDE, found.wave[20:120]), rtol=0.03)
        assert found.nayak == pytest.approx(1.5 * m0 * m4 / m2**2, rel=0.01)  # Nayak (1971)


@pytest.mark.parametrize("Ssk", [None, -0.8])
@pytest.mark.parametrize("phases", ["gaussian", "random"])
def test_coarse_grids_are_the_same_field_with_the_high_waves_cut(phases, Ssk):
    spectrum = replace(LAW, phases=phases, Ssk=Ssk, anisotropy=1.5)
    finest = waves_of(made(spectrum, n=128))
    for n in (8, 16, 32, 64):
        for (i, j), wave in waves_of(made(spectrum, n=n)).items():
            low = math.hypot(i, j) < n / 2
            assert abs(wave - (finest[i, j] if low else 0.0)) < 1e-12


def test_a_seed_has_the_same_low_waves_whatever_the_cut_and_the_exponent():
    """Matched pairs: phases and normal numbers are the same wave by wave."""
    few, many = waves_of(made(replace(LAW, cut=8.0), 0.8)), waves_of(made(LAW, 0.3))
    laws = {k: law_of(*k, LAW, 0.8) / law_of(*k, LAW, 0.3) for k in few if 0.0 < math.hypot(*k) < 8.0}
    relative = np.array([few[k] / many[k] / math.sqrt(ratio) for k, ratio in laws.items()])
    np.testing.assert_allclose(relative / relative[0].real, 1.0, rtol=1e-9)
    assert abs(many[1, 0] - waves_of(made(LAW, 0.3, seed=1))[1, 0]) > 1e-3


def test_the_stream_of_a_seed_does_not_change():
    """Digits of the random stream: a change here changes every surface of every seed."""
    normal = np.random.Generator(np.random.PCG64(7)).standard_normal((4, 2))
    spectrum = Spectrum(rolloff=1.0, cut=1.3)  # the four waves of the first ring that are inside, less their conjugates
    waves = waves_of(made(spectrum, n=8, seed=7))
    drawn = normal[:, 0] + 1j * normal[:, 1]
    # order of a ring: (i, r) for i = -r … r, then (r, j) for j = 0 … r - 1
    np.testing.assert_allclose(waves[0, 1] / waves[1, 0], drawn[1] / drawn[3], rtol=1e-12)


@pytest.mark.parametrize("Ssk", [-1.0, 0.0, 0.5])
def test_the_skewness_is_met_and_the_spectrum_is_kept(Ssk):
    kurtosis = []
    for seed in range(3):
        plain = made(replace(LAW, rolloff=8.0, cut=64.0), n=128, seed=seed)
        surface = made(replace(LAW, rolloff=8.0, cut=64.0, Ssk=Ssk), n=128, seed=seed)
        assert texture.Ssk(surface.heights) == pytest.approx(Ssk, abs=1e-8)
        moduli = [np.abs(np.fft.rfft2(one.heights, norm="forward")) for one in (plain, surface)]
        np.testing.assert_allclose(*moduli, atol=1e-13)
        kurtosis.append(texture.Sku(surface.heights))
    assert np.mean(kurtosis) == pytest.approx(3.0 + 1.5 * Ssk**2, rel=0.1)  # Pearson's type III


def test_the_translation_is_the_cube_of_wilson_and_hilferty():
    y = np.linspace(-4.0, 4.0, 9)
    for s in (-2.0, 0.8):
        cube = 2.0 / s * ((1.0 + s * y / 6.0 - s * s / 36.0) ** 3 - 1.0)
        np.testing.assert_allclose(waves._translation(y, s), cube, rtol=1e-12)
    np.testing.assert_array_equal(waves._translation(y, 0.0), y)


def test_a_patch_is_the_period_with_its_edge_repeated():
    period, patch = made(), made(replace(LAW, periodic=False))
    assert (period.periodic, patch.periodic) == (True, False)
    assert (period.shape, patch.shape) == ((64, 64), (65, 65))
    assert period.side == patch.side == pytest.approx(SIDE)
    np.testing.assert_array_equal(patch.heights[:-1, :-1], period.heights)
    np.testing.assert_array_equal(patch.heights[-1], patch.heights[0])
    np.testing.assert_array_equal(patch.heights[:, -1], patch.heights[:, 0])


test_what_lies_outside_its_interval_is_refused = refusals(
    SurfaceError,
    *(
        (lambda name=name: made(replace(LAW, **{name: "2"})), f"{name} must be a number, got '2'")
        for name in ("rolloff", "cut", "anisotropy", "Ssk")
    ),
    (lambda: made(replace(LAW, rolloff=0.5)), "rolloff = L/λ_r must be >= 1"),
    *((lambda cut=cut: made(replace(LAW, cut=cut)), "cut = L/λ_s must be > rolloff = 4") for cut in (4.0, math.inf)),
    (lambda: made(replace(LAW, anisotropy=0.5)), "anisotropy must be >= 1"),
    (lambda: made(replace(LAW, anisotropy=40.0)), "and < cut = 32"),
    (lambda: made(replace(LAW, phases="none")), "phases must be 'gaussian' or 'random'"),
    (lambda: made(replace(LAW, Sq=0.0)), "Sq must be finite and positive"),
    (lambda: made(replace(LAW, slope=-1.0)), "slope must be finite and positive"),
    (lambda: made(replace(LAW, Ssk=math.nan)), "Ssk must be finite"),
    (lambda: made(replace(LAW, rolloff=1.0, cut=3.0, Ssk=2.9)), r"Ssk = 2.9 is out of reach .*: -\d.\d\d to \d.\d\d"),
    *((lambda H=H: made(hurst=H), r"H must be in \(0, 1\)") for H in (0.0, 1.0)),
    (lambda: made(n=63), "n must be even"),
    (lambda: made(n=4), r"n must be an integer in \[8, 8192\]"),
    (lambda: made(seed=-1), "seed must be an integer >= 0"),
)


def test_whole_numbers_of_numpy_are_taken():
    spectrum = Spectrum(rolloff=2.0, cut=8.0)
    made = power_law_surface(spectrum, 0.8, np.int64(16), seed=np.int64(3))
    np.testing.assert_array_equal(made.heights, power_law_surface(spectrum, 0.8, 16, seed=3).heights)
