"""The section fluid: gases, pressures, units of throughput, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.analysis import read_off as ask
from roughvol.errors import StudyError
from roughvol.gap.gas import plate_flow
from roughvol.store.dataset import Dataset
from roughvol.study import Fluid, loads, throughput
from tests.campaign.kit import collected

TEXT = """
name: gas
surface: {D: 2.2, m: 4, L: 100 um, Sq: 0.4 um, seeds: 1}
material: {E_star: 10 MPa}
sweep: {steps: 4, to: {pressure: 1.0}}
fluid: {gas: helium, inlet: 2 bar, outlet: 1 bar}
record:
  transport: {percolation: every-step, constriction: every-step, transmissivity: every-step, gas_flow: every-step}
  dimensional: {pressure: MPa, gas_leak_rate: mbar*l/s}
"""


def fluid(text: str) -> Fluid:
    return loads(TEXT.replace("{gas: helium, inlet: 2 bar, outlet: 1 bar}", text)).fluid


@pytest.fixture(scope="module")
def results() -> Dataset:
    return collected(loads(TEXT))


@pytest.mark.parametrize(
    ("gas", "micro"),  # CRC Handbook of Chemistry and Physics, viscosity of gases at 300 K [µPa s]
    [("air", 18.6), ("argon", 22.9), ("carbon-dioxide", 15.0), ("helium", 20.0), ("hydrogen", 9.0), ("nitrogen", 17.9)],
)
def test_viscosities_are_those_of_a_handbook(gas: str, micro: float) -> None:
    one = fluid(f"{{gas: {gas}, inlet: 2 bar, outlet: 1 bar, temperature: 300 K}}")
    assert_allclose(one.viscosity * 1e6, micro, rtol=0.025)


def test_the_mean_free_path_of_air_is_the_known_one() -> None:
    one = fluid("{gas: air, inlet: 2 bar, outlet: 1 bar, temperature: 20 degC}")
    assert_allclose(one.mean_free_path(101325.0) * 1e9, 65.5, rtol=0.03)
    assert_allclose(one.mean_free_path(10.0) * 10.0, one.mean_free_path(1e5) * 1e5, rtol=1e-12)


def test_a_gas_of_ones_own_is_that_of_the_table() -> None:
    known = fluid("{gas: nitrogen, inlet: 2 bar, outlet: 0 bar, temperature: 300 K}")
    gas = f"{{viscosity: {known.viscosity * 1e6} uPa*s, molar_mass: 28.014 g/mol}}"
    own = fluid(f"{{gas: {gas}, inlet: 200 kPa, outlet: 0 Pa, temperature: 300 K}}")
    assert_allclose(own.mean_free_path(1.0), known.mean_free_path(1.0), rtol=1e-12)


@pytest.mark.parametrize(("text", "kelvin"), [("-20 degC", 253.15), ("-20 °C", 253.15), ("68 degF", 293.15)])
def test_a_temperature_may_be_below_the_zero_of_its_scale(text: str, kelvin: float) -> None:
    one = fluid(f"{{gas: air, inlet: 2 bar, outlet: 1 bar, temperature: {text}}}")
    assert_allclose(one.kelvin, kelvin, rtol=1e-12)


@pytest.mark.parametrize(
    ("given", "wanted", "factor"),
    [
        ("Pa*m^3/s", "mbar*l/s", 10.0),
        ("mbar·l/s", "Pa m^3/s", 0.1),
        ("sccm", "Pa*m^3/s", 101325e-6 / 60 * 293.15 / 273.15),  # warmer gas has more volume
        ("mbar*l/s", "sccm", 0.1 * 60e6 / 101325 * 273.15 / 293.15),
        ("sccs", "sccm", 60.0),
        ("msccm", "sccm", 1e-3),
        ("ksccm", "Pa*m^3/s", 1e3 * 101325e-6 / 60 * 293.15 / 273.15),
    ],
)
def test_units_of_throughput(given: str, wanted: str, factor: float) -> None:
    assert_allclose(throughput(2.0, given, wanted, 293.15), 2.0 * factor, rtol=1e-12)
    assert_allclose(throughput(throughput(2.0, given, wanted, 300.0), wanted, given, 300.0), 2.0, rtol=1e-12)


def test_the_leak_of_a_stored_gap_is_the_throughput_of_plates_times_its_coefficient(results: Dataset) -> None:
    one = results.isel(D=0, m=0, seed=0, step=0)
    gas = loads(TEXT).fluid
    gap = float(one.free_volume) * 0.4e-6
    plates = gap**3 * (2e5**2 - 1e5**2) / (24 * gas.viscosity)  # Pa m³/s of a square
    flow = float(one.gas_transmissivity.sel(axis="x")) * plates
    assert_allclose(one.gas_leak_rate.sel(axis="x"), flow * 10.0, rtol=1e-10)
    assert_allclose(one.knudsen_number * one.critical_gap * 0.4e-6, gas.mean_free_path(1.5e5), rtol=1e-9)
    assert results.gas_leak_rate.sel(axis="x").attrs["units"] == "mbar*l/s"


def test_a_gas_changes_neither_contact_nor_closing_nor_other_flows(results: Dataset) -> None:
    without = re.sub("fluid: .*|, gas_flow: every-step|, gas_leak_rate: mbar[*]l/s", "", TEXT)
    plain = collected(loads(without))
    for name in ("contact_area_fraction", "mean_pressure", "transmissivity", "percolates", "critical_gap"):
        np.testing.assert_array_equal(plain[name], results[name])


def test_a_file_without_unit_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "z.npy", np.zeros((9, 9)))
    text = TEXT.replace("D: 2.2, m: 4, L: 100 um, Sq: 0.4 um, seeds: 1", "file: z.npy, L: 4")
    with pytest.raises(StudyError, match="needs the unit of length"):
        loads(text, tmp_path / "s.yaml").cases()


# read-offs and the card


def test_a_leak_of_a_gas_is_asked_for_by_its_unit(results: Dataset) -> None:
    flows = results.gas_leak_rate.sel(axis="x").values.ravel()
    wanted = float(np.sqrt(flows[1] * flows[2]))
    assert ask.is_throughput("1e-4 mbar*l/s")
    assert ask.is_throughput("2 sccm")
    assert not ask.is_throughput("1e-4 mm^3/s")
    assert not ask.is_throughput("nonsense")
    run, kelvin = ask.of_gas(results, "pressure")
    found = ask.ask(run, wanted, "pressure")[0].value
    pressures = results.nominal_pressure.values.ravel()
    assert pressures[1] < found < pressures[2]
    assert kelvin == 293.15
    with pytest.raises(StudyError, match="mean free path over Sq"):
        ask.of_gas(results, "Sq")
    with pytest.raises(StudyError, match="no leak of a gas"):
        ask.of_gas(results.drop_vars("gas_leak_rate"), "pressure")


def test_plates_of_the_study_and_of_the_solver_are_the_same() -> None:
    assert_allclose(plate_flow("viscous", 2.0, 1.0, 0.5, 1.0), 8 * (1 - 0.25) / 2, rtol=1e-12)
