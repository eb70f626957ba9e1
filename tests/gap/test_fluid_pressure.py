"""Pressure of a fluid in the gap: its flow is that of the conduction, and its change is a derivative."""

import itertools

import numpy as np
import pytest

from roughvol.gap import multigrid
from roughvol.gap.fluid_pressure import FluidField
from tests.gap.kit import any_gap, rough, smooth


@pytest.mark.parametrize(("axis", "periodic"), [(0, False), (1, False), (1, True)])
def test_the_change_of_the_pressure_is_its_derivative(axis, periodic):
    gap = smooth(1, 0.3) if periodic else rough(0.2, m=4)
    change = np.where(gap > 0.0, np.random.default_rng(0).uniform(-1.0, 1.0, gap.shape), 0.0) * gap.mean()
    above, below = (FluidField(gap + step * change, axis, periodic=periodic).pressure for step in (1e-5, -1e-5))
    found = FluidField(gap, axis, periodic=periodic).change(change)
    np.testing.assert_allclose(found, (above - below) / 2e-5, rtol=0, atol=1e-3 * np.abs(found).max())


def test_pressure_falls_evenly_between_plates_and_drops_at_a_wall_or_a_constriction():
    falls = np.outer(1.0 - (np.arange(10) + 0.5) / 10, np.ones(6))
    for (axis, expected), periodic in itertools.product(enumerate((falls, falls.T)), (False, True)):
        found = FluidField(np.ones(expected.shape), axis, periodic=periodic).pressure
        np.testing.assert_allclose(found, expected, atol=1e-9)
    for narrow, near in ((0.0, 1e-5), (0.01, 1e-4)):
        gap = np.ones((9, 4))
        gap[4] = narrow
        pressure = FluidField(gap, 0).pressure
        np.testing.assert_allclose(pressure[:4], 1.0, atol=near)
        np.testing.assert_allclose(pressure[5:], 0.0, atol=near)


@pytest.mark.parametrize(
    "seed", [0, 1, 3, 24, *(pytest.param(k, marks=pytest.mark.slow) for k in (8, *range(31, 120)))]
)
def test_the_pressure_by_gradients_is_that_of_a_factorisation(seed, monkeypatch):
    gap, axis, periodic = any_gap(seed)
    change = np.where(gap > 0.0, np.random.default_rng(seed).standard_normal(gap.shape), 0.0) * gap.mean()
    fields = []
    for direct in (200, gap.size):
        monkeypatch.setattr(multigrid, "DIRECT", direct)
        field = FluidField(gap, axis, periodic=periodic)
        fields.append((field.pressure, field.change(change)))
    (found, found_change), (exact, exact_change) = fields
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found_change, exact_change, rtol=0, atol=2e-3 * np.abs(exact_change).max())


def test_a_wide_pocket_with_a_closed_rim_has_the_mean_pressure_after_few_corrections(monkeypatch):
    monkeypatch.setattr("roughvol.gap.fluid_pressure.CORRECTIONS", 4)  # factors alone need 63
    pressure = FluidField(np.pad(np.ones((20, 20)), 10), 0).pressure
    assert pressure[10:30, 10:30] == pytest.approx(0.5, abs=1e-13)
