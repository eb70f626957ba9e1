"""Contact conductance from the stiffness of an interface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.analysis.derived import derived
from roughvol.analysis.stored_run import Run
from roughvol.campaign import execution
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.errors import ContactError, StudyError
from roughvol.observables.conductance import contact_conductance, harmonic_conductivity, stiffness_exponent
from roughvol.observables.stiffness import interfacial_stiffness, without_every_second
from roughvol.report import screen
from roughvol.report.figures import content
from roughvol.study import loads
from roughvol.surfaces.surface import Surface

TEXT = """name: heat
surface: {D: 2.3, m: 5, L: 100 um, Sq: 0.5 um, seeds: 2}
material: {E_star: 100 GPa, conductivity: [50 W/m/K, 0.5 W/cm/K]}
sweep: {steps: 12, to: mean-plane}
record: {dimensional: {pressure: MPa}}
"""


def test_the_conductance_of_a_round_spot_is_two_radii_times_the_conductivity() -> None:
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


def test_conductivities_are_in_series() -> None:
    assert harmonic_conductivity(50.0, 50.0) == 50.0
    assert_allclose(harmonic_conductivity(1.0, 1e9), 2.0)
    with pytest.raises(ContactError, match="> 0"):
        harmonic_conductivity(0.0, 1.0)


def test_the_exponent_is_that_of_a_power_law() -> None:
    p = np.geomspace(0.01, 1.0, 9)
    assert_allclose(stiffness_exponent(p, 3.0 * p**0.7), 0.7)
    assert_allclose(stiffness_exponent([0.0, *p], [np.nan, *(3.0 * p**0.7)]), 0.7)
    assert np.isnan(stiffness_exponent(p[:3], p[:3]))


def test_a_run_shows_stiffness_and_conductance(tmp_path: Path) -> None:
    study = loads(TEXT)
    results = execution.run(study, jobs=1, out=tmp_path)
    ready = derived(results, study)
    stiffness = ready.interfacial_stiffness
    steps = -np.diff(results.mean_pressure.values) / np.diff(results.free_volume.values)
    between = 0.5 * (stiffness.values[..., 1:] + stiffness.values[..., :-1])
    assert_allclose(between[..., 4:], steps[..., 4:], rtol=0.05)
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
    assert f"by up to {change:.0f} %, and goes with p^{exponents[0]:.2f} in place of p^{exponents[1]:.2f}" in table.note
    fig = content.draw("conductance_of_p", [content.Named("heat", results)])
    assert fig.axes[0].get_xscale() == fig.axes[0].get_yscale() == "log"


def test_conductivities_are_checked() -> None:
    for wrong, words in (("[50 W/m/K]", "at least 2"), ("[50 W/m/K, 1 MPa]", "pressure"), ("[50, 50]", "with a unit")):
        with pytest.raises(StudyError, match=words):
            loads(TEXT.replace("[50 W/m/K, 0.5 W/cm/K]", wrong))
