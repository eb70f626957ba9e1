"""Estimators of one period: numbers do not depend on the node at which the period begins."""

import math

import numpy as np
import pytest

from roughvol.campaign.case_surface import surface_of
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.observables import deformed
from roughvol.observables.regions import View
from roughvol.study import loads
from roughvol.surfaces import psd, texture, treatment
from roughvol.surfaces.spectrum import Spectrum
from roughvol.surfaces.surface import Surface
from roughvol.surfaces.waves import power_law_surface

SHIFTS = [(0, -3), (17, 29)]
SPACING = 0.3


@pytest.fixture(scope="module")
def heights():
    """One period of 48 × 32 nodes whose sides are far from equal in height to those of a patch."""
    x, y = np.meshgrid(np.arange(48) / 48, np.arange(32) / 32, indexing="ij")
    rough = np.random.default_rng(4).normal(size=x.shape)
    return np.sin(2 * np.pi * (x + 0.1)) + np.cos(2 * np.pi * (y + 2 * x)) + 0.3 * rough


def _texture(z):
    surface = Surface(z, SPACING, sides="periodic")
    found = psd.spectral(surface)
    curves = deformed.curves(z - z.mean(), periodic=True)
    return (
        deformed.numbers(z, SPACING, periodic=True)
        | curves
        | {"summit_plane": texture.summit_plane(surface.with_neighbours)}
        | {"summit_radius": texture.summit_radius(surface.with_neighbours, SPACING)}
        | {name: getattr(found, name) for name in ("psd", "rms_height", "rms_slope", "rms_curvature", "nayak")}
    )


@pytest.mark.parametrize("shift", SHIFTS)
def test_texture_and_spectrum(heights, shift):
    shifted = _texture(np.roll(heights, shift, (0, 1)))
    for name, value in _texture(heights).items():
        np.testing.assert_allclose(shifted[name], value, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("shift", SHIFTS)
def test_a_contact_and_the_texture_under_load(heights, shift):
    (case,) = loads("surface: {D: 2.3, m: 5, seeds: 1, sides: periodic}\nrecord: {texture: true}").cases()
    found = []
    for z in (heights, np.roll(heights, shift, (0, 1))):
        surface = Surface(z, SPACING, sides="periodic")
        half_space = HalfSpace(surface.shape, sides="periodic")
        (contact,) = sweep(surface, half_space, [1.0], rtol=1e-9)
        found.append(
            deformed.under_load(View(case, surface, contact, half_space)) | {"pressure": contact.mean_pressure}
        )
    for name, value in found[0].items():
        np.testing.assert_allclose(found[1][name], value, rtol=1e-5, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("rule", ["nearest", "interpolate"])
def test_filling_and_outliers_reach_into_the_next_period(heights, rule, shift):
    """Holes lie on the edges and the corner, and so do spikes."""
    z = heights.copy()
    z[0, 5:9] = z[-3:, 20:22] = z[10:14, 0] = z[30, -4:] = z[-2:, -2:] = z[0, 0] = np.nan
    moved = np.roll(z, shift, (0, 1))
    filled = treatment.fill(z, rule, periodic=True)
    np.testing.assert_allclose(
        treatment.fill(moved, rule, periodic=True), np.roll(filled, shift, (0, 1)), rtol=1e-9, atol=1e-12
    )
    assert np.isfinite(filled).all()
    z[0, 15] += 40.0
    z[25, -1] -= 40.0
    z[4, 4] += 40.0
    mask = treatment.outliers(z, 6.0, degree="mean", periodic=True)
    moved = treatment.outliers(np.roll(z, shift, (0, 1)), 6.0, degree="mean", periodic=True)
    np.testing.assert_array_equal(moved, np.roll(mask, shift, (0, 1)))
    assert {(0, 15), (25, 31), (4, 4)} == set(zip(*map(list, np.nonzero(mask)), strict=True))


@pytest.mark.parametrize("hurst", [0.2, 0.5, 0.8])
def test_the_exponent_of_a_generated_period_is_that_of_its_law(hurst):
    """Amplitudes are those of the law; without a window nothing but the width of the rings is left."""
    made = power_law_surface(Spectrum(rolloff=1.0, cut=64.0, phases="random"), hurst, 128, side=1.0, seed=1)
    assert texture.hurst_spectrum(made.heights, periodic=True) == pytest.approx(hurst, abs=0.01)


def test_structure_and_gradients_are_the_sums_over_the_waves_of_a_generated_period():
    made = power_law_surface(Spectrum(rolloff=1.0, cut=12.0), 0.7, 64, side=2.0, seed=3)
    power = np.abs(np.fft.fft2(made.heights, norm="forward")) ** 2
    waves = np.fft.fftfreq(64)
    lags = texture.dyadic_lags(32)
    along = [2.0 * (power * (1.0 - np.cos(2 * np.pi * waves * lag))[:, None]).sum() for lag in lags.tolist()]
    across = [2.0 * (power * (1.0 - np.cos(2 * np.pi * waves * lag))[None, :]).sum() for lag in lags.tolist()]
    found = texture.structure_function(made.heights, lags, periodic=True)
    np.testing.assert_allclose(found, 0.5 * (np.array(along) + across), rtol=1e-10)
    # central differences damp each wave by sinc
    q = np.sin(2 * np.pi * waves) / made.spacing
    slope = math.sqrt((power * (q[:, None] ** 2 + q[None, :] ** 2)).sum())
    assert texture.Sdq(made.with_neighbours, made.spacing) == pytest.approx(slope, rel=1e-10)


def test_a_study_joins_the_sides_of_a_period_and_not_those_of_a_region():
    text = "surface: {D: 2.3, m: 5, seeds: 1, sides: periodic}\nsweep: {steps: 0}\nrecord: {texture: true"
    (whole,), (part,) = (loads(f"{text}{more}}}").cases() for more in ("", ", region: interior"))
    surface = surface_of(whole)
    stored = deformed.before_load(whole, surface)
    assert stored["lag"].tolist() == [1, 2, 4, 8, 16]
    lags = np.asarray(stored["lag"])
    np.testing.assert_allclose(
        stored["structure_function"],
        texture.structure_function(surface.heights / surface.unit, lags, periodic=True),
    )
    inside = surface.heights[8:25, 8:25]
    assert deformed.before_load(part, surface)["hurst_structure"] == pytest.approx(texture.hurst_structure(inside))
