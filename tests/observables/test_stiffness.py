"""Interfacial stiffness: exact for an exponential, second order for a power; the contact conductance that follows."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.analysis.derived import derived
from roughvol.analysis.stored_run import Run
from roughvol.campaign import execution
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.errors import ContactError
from roughvol.observables.stiffness import (
    contact_conductance,
    harmonic_conductivity,
    interfacial_stiffness,
    stiffness_exponent,
    without_every_second,
)
from roughvol.report import screen
from roughvol.report.figures import content
from roughvol.study import loads
from roughvol.surfaces.surface import Surface
from tests.refused import refusals

TEXT = """name: heat
surface: {D: 2.3, m: 4, L: 100 um, Sq: 0.5 um, seeds: 2}
material: {E_star: 100 GPa, conductivity: [50 W/m/K, 0.5 W/cm/K]}
sweep: {steps: 12, to: mean-plane}
record: {dimensional: {pressure: MPa}}
"""


def test_the_stiffness_of_an_exponential_is_the_pressure_over_its_length():
    d = np.array([3.0, 2.5, 2.4, 1.0, 0.7])
    p = 0.3 * np.exp(-d / 0.4)
    assert_allclose(interfacial_stiffness(p, d), p / 0.4, rtol=1e-12)
    assert_allclose(interfacial_stiffness(p[::-1], d[::-1]), p[::-1] / 0.4, rtol=1e-12)  # unloading


def test_an_interface_that_no_longer_moves_is_infinitely_stiff_and_one_that_softens_has_a_negative_stiffness():
    found = interfacial_stiffness([1.0, 2.0, 3.0, 4.0, 5.0], [0.2, 0.1, 0.0, 0.0, 0.0])
    assert np.all(np.isinf(found[3:]))
    assert np.all(found[:2] > 0.0)
    assert np.all(interfacial_stiffness([1.0, 2.0, 3.0], [0.1, 0.2, 0.3]) < 0.0)


@pytest.mark.parametrize("order", [1, -1])
def test_an_end_beyond_a_kink_keeps_the_sign_of_its_last_step(order):
    p, d = np.array([1.3, 10.7, 23.2, 43.6])[::order], np.array([0.9, 0.072, 0.003, 0.0])[::order]
    found = interfacial_stiffness(p, d)[::order]
    assert np.all(found > 0.0)
    assert found[-1] == pytest.approx(43.6 / (0.003 / np.log(43.6 / 23.2)))


def test_an_end_of_a_parabola_that_nearly_turns_has_the_straight_line():
    found = interfacial_stiffness(np.exp([0.0, 1.0, 2.0]), [4.0, 3.0, 0.01])
    assert found[0] == pytest.approx(1.0)  # 200 by the parabola


def test_states_without_load_and_missing_cases_have_none():
    d = np.linspace(3.0, 1.0, 6)
    p = np.exp(-d)
    p[0] = 0.0
    both = interfacial_stiffness([p, np.full(6, np.nan)], [d, d])
    assert np.isnan(both[0, 0])
    assert_allclose(both[0, 1:], p[1:], rtol=1e-12)
    assert np.all(np.isnan(both[1]))


test_what_has_no_stiffness_is_refused = refusals(
    ContactError,
    (lambda: interfacial_stiffness([1.0, 3.0, 2.0], [3.0, 2.0, 1.0]), "one leg"),
)


def test_every_second_state_shows_the_error_by_the_steps():
    p = np.geomspace(0.01, 1.0, 17)
    d = -np.sqrt(p)  # K = 2 sqrt(p)
    found, fewer = interfacial_stiffness(p, d), without_every_second(p, d)
    error, change = np.abs(found / (2.0 * np.sqrt(p)) - 1.0), np.abs(fewer / found - 1.0)
    assert np.all(error <= change)
    assert_allclose(change[4:-4] / error[4:-4], 3.0, rtol=0.2)  # second order: four times the error, less the error
    assert_allclose(without_every_second(np.exp(-d), d), interfacial_stiffness(np.exp(-d), d), rtol=1e-9)


def test_the_conductance_of_a_round_spot_is_two_radii_times_the_conductivity():
    # a paraboloid: dF/dΔ = 2 E* a (Hertz), and a spot of radius a conducts 2 a k_s (Holm)
    n, side = 65, 1.0
    x = np.linspace(-0.5, 0.5, n) * side
    surface = Surface(-(x[:, None] ** 2 + x**2) / 2.0, side / (n - 1))  # radius of curvature 1
    ends = np.linspace(0.02, 0.06, 9) / surface.Sq  # Δ/σ
    states = list(sweep(surface, HalfSpace(surface.shape), ends))
    pressure = np.array([state.mean_pressure for state in states])
    stiffness = interfacial_stiffness(pressure, -ends)  # far-field displacement of a single spot
    conductance = contact_conductance(stiffness, 1.0, side) * (n * surface.spacing) ** 2
    radius = np.sqrt(ends * surface.Sq)  # a² = R Δ
    assert_allclose(conductance[1:-1], 2.0 * radius[1:-1], rtol=0.02)


def test_conductivities_are_in_series():
    assert harmonic_conductivity(50.0, 50.0) == 50.0
    assert_allclose(harmonic_conductivity(1.0, 1e9), 2.0)


def test_the_exponent_is_that_of_a_power_law():
    p = np.geomspace(0.01, 1.0, 9)
    assert_allclose(stiffness_exponent(p, 3.0 * p**0.7), 0.7)
    assert_allclose(stiffness_exponent([0.0, *p], [np.nan, *(3.0 * p**0.7)]), 0.7)
    assert np.isnan(stiffness_exponent(p[:3], p[:3]))


def test_a_run_shows_stiffness_and_conductance(tmp_path):
    study = loads(TEXT)
    results = execution.run(study, jobs=1, out=tmp_path)
    ready = derived(results, study)
    stiffness = ready.interfacial_stiffness
    assert_allclose(ready.contact_conductance, stiffness * (50.0 / 100e-6))
    assert ready.contact_conductance.attrs["units"] == "W/m^2/K"
    run = Run("heat", results, study)
    (table,) = screen.shown(run)
    assert {"K L/E*", "h [W/m^2/K]"} <= set(table.head)
    fewer = without_every_second(results.mean_pressure.values, results.free_volume.values)
    change = 100.0 * np.nanmax(np.abs(fewer / stiffness.values - 1.0))
    p = np.log(results.mean_pressure.values.reshape(2, -1))
    exponents = [
        np.mean([np.polyfit(x, np.log(y), 1)[0] for x, y in zip(p, k.reshape(2, -1), strict=True)])
        for k in (fewer, stiffness.values)
    ]
    assert f"K goes with p^{exponents[1]:.2f} over the first leg. " in table.note
    assert (
        f"with every second step it changes by up to {change:.0f} %, and goes with p^{exponents[0]:.2f}" in table.note
    )
    fig = content.draw("conductance_of_p", [content.Named("heat", results)])
    assert fig.axes[0].get_xscale() == fig.axes[0].get_yscale() == "log"


def test_a_surface_whose_pressure_stays_leaves_the_others_their_stiffness(tmp_path):
    """A few elements that have yielded carry the hardness, however far they are pressed."""
    results = execution.run(loads(TEXT), jobs=1, out=tmp_path).copy(deep=True)
    alone = derived(results.isel(seed=[0]), None).interfacial_stiffness
    results["mean_pressure"][0, 0, 1, 1] = results["mean_pressure"][0, 0, 1, 0]
    found = derived(results, None).interfacial_stiffness
    assert_allclose(found.isel(seed=[0]), alone)
    assert found.isel(seed=1).isnull().all()
    (several,), (one,) = (screen.shown(Run("heat", ds)) for ds in (results, results.isel(seed=[0])))
    assert one.note in several.note.replace("Mean over 2 surfaces. ", "")
