"""A mirrored surface is a quarter of the joint that it makes with its mirror images, in every number of a study."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.campaign.one_case import run_case
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Trials
from roughvol.contact.search import state_under
from roughvol.gap.clusters import connectivity
from roughvol.gap.fluid_pressure import FluidField
from roughvol.gap.gas import conduction_of_gas
from roughvol.gap.transport import conduction
from roughvol.observables.coupling import Coupling
from roughvol.observables.regions import window
from roughvol.study import loads
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface
from tests.observables.kit import answer

SPACING, SHAPE = 2.0, (17, 13)
RECORD = """
solver: {rtol: 1.0e-12}
record:
  transport:
    {percolation: every-step, constriction: every-step, transmissivity: every-step, diffusivity: every-step,
     accuracy: 1.0e-9}
  dimensional: {pressure: MPa, mean_gap: um, critical_gap: um, leak_rate: {pressure_drop: 1 mbar, viscosity: 1 mPa*s}}
"""
SWEEPS = {
    "loads": "{loads: [LOAD]}",
    "area": "{steps: 2, to: {contact_area: 0.3}}",
    "mean plane": "{steps: 2, to: mean-plane}",
    "closed": "{steps: 2, to: percolation}",
    "separation": "{steps: 2, to: {separation: 0.8}}",
    "indentation": "{steps: 2, to: {indentation: 1.2}}",
    "gap": "{steps: 2, to: {mean_gap: 0.3 um}}",
    "legs": "[{pressures: [0.1 MPa, 0.3 MPa]}, {pressures: [0.1 MPa, 0.02 MPa]}, {pressures: [0.4 MPa]}]",
}
ELASTIC, YIELDS = "{E: 10 MPa, nu: 0.5}", "{E: 10 MPa, nu: 0.5, hardness: 1.5 MPa}"
OF_STATE = {"contact_area_fraction", "free_volume", "separation", "indentation", "nominal_pressure", "mean_gap"}
OF_FLOW = {"critical_gap", "leak_rate", "transmissivity", "percolates", "diffusivity"}
OF_YIELD = {"plastic_volume", "plastic_area_fraction"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mirrored")
    z = random_midpoint_displacement(2.2, 4, seed=3).heights[: SHAPE[0], : SHAPE[1]]
    z = 0.5 * (z - z.mean()) / z.std()
    np.save(folder / "quarter.npy", z)
    np.save(folder / "joint.npy", np.pad(z, [(0, n) for n in SHAPE], mode="symmetric"))
    return folder


def states(folder, file, L, sides, sweep, material):
    text = f"surface: {{file: {file}.npy, L: {L} um, sides: {sides}}}\nmaterial: {material}\nsweep: {sweep}{RECORD}"
    return answer(text, folder / "study.yaml")


@pytest.mark.parametrize(
    ("kind", "material"),
    [*((kind, ELASTIC) for kind in SWEEPS), *((kind, YIELDS) for kind in ("area", "closed", "legs"))],
)
def test_every_number_is_that_of_the_joint(folder, kind, material):
    """Two patches in a row and two side by side leak as one. A force is that of four patches."""
    area = SHAPE[0] * SHAPE[1] * SPACING**2  # um²; 1 MPa um² is 1e-6 N
    sweep, of_all = (SWEEPS[kind].replace("LOAD", f"{share * 0.1e-6 * area!r} N") for share in (1, 4))
    quarter = states(folder, "quarter", SPACING * (SHAPE[0] - 1), "mirrored", sweep, material)
    joint = states(folder, "joint", SPACING * 2 * SHAPE[0], "periodic", of_all, material)
    for name in OF_STATE | OF_FLOW | (OF_YIELD if "hardness" in material else set()):
        # searches are right to 1e-6 of Δ, that of a closing to 1e-4, and p* rises with a power of Δ
        assert_allclose(quarter[name], joint[name], rtol=4e-4 if kind == "closed" else 1e-4, atol=1e-7, err_msg=name)
    assert (quarter.attrs["sides"], joint.attrs["sides"]) == ("mirrored", "periodic")


def test_a_coupled_state_is_one_of_the_doubled_period():
    """Total pressure and its mirror images displace the period; the fluid flows through the patch alone."""
    axis, z = 1, random_midpoint_displacement(2.2, 4, seed=2).heights[: SHAPE[0], : SHAPE[1]]
    surface, space = Surface(z, 1.0, sides="mirrored"), HalfSpace(SHAPE, sides="mirrored")
    load, inlet = 1.5, 0.8
    dry = state_under(Trials(surface, space, rtol=1e-10), load, 1.0)
    state = Coupling(surface, space, axis, inlet, rtol=1e-10).solve(load, dry)
    total = np.pad(state.pressure, [(0, n) for n in SHAPE], mode="symmetric") / (np.pi * surface.intervals[0])
    u = HalfSpace(total.shape, sides="periodic").displacement(total)[: SHAPE[0], : SHAPE[1]]
    gap = u - surface.heights / surface.unit
    touching = state.gap == 0.0
    assert touching.any()
    gap -= gap[touching].mean()
    assert_allclose(state.gap, np.where(touching, 0.0, gap), atol=1e-7)
    assert_allclose(gap[touching], 0.0, atol=1e-7)
    assert_allclose(state.fluid, inlet * FluidField(state.gap, axis).pressure, atol=2e-6)
    assert state.pressure.mean() == pytest.approx(load, rel=1e-8)


@pytest.mark.parametrize("region", ["", ", region: interior"])
def test_flows_and_regions_are_those_of_a_patch_with_closed_sides(region):
    (case,) = loads(f"""
surface: {{D: 2.2, m: 4, L: 100 um, Sq: 0.5 um, seeds: [2], sides: mirrored}}
material: {{E_star: 10 MPa}}
sweep: {{steps: 2, to: {{contact_area: 0.1}}}}
fluid: {{gas: helium, inlet: 1 bar, outlet: 0 bar}}
record: {{fields_at: last, transport: {{gas_flow: last, transmissivity: last, percolation: last}}{region}}}
""").cases()
    ds = run_case(case).squeeze()
    gap = ds["gap"].values[window(case, (17, 17))]
    assert gap.shape == ((9, 9) if region else (17, 17))
    path = case.gas.mean_free_path / 0.5
    for axis in (0, 1):
        gas = conduction_of_gas(gap, axis, case.gas.law, path, case.gas.outlet)
        assert float(ds["gas_transmissivity"][-1, axis]) == pytest.approx(gas.coefficient, rel=1e-3)
        assert float(ds["transmissivity"][-1, axis]) == pytest.approx(conduction(gap, axis).coefficient, rel=1e-3)
    connected = connectivity(gap, gap == 0.0)
    assert float(ds["trapped_volume_fraction"][-1]) == pytest.approx(connected.trapped, rel=1e-6)
