"""Numbers with units in Python: quantities of pint of any registry in, quantities out, and loads in every form."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pint
import pytest
import xarray as xr

import roughvol
from roughvol.errors import DatasetError, StudyError
from roughvol.observables.variables import VARIABLES
from roughvol.study import Level, Quantity, changes_of, convert, levels, loads, of_data, parse

HEIGHTS = 0.5 * np.random.default_rng(0).normal(size=(9, 9))  # um
OF_A_STUDY = {"length": "um", "time": "s", "pressure": "N/mm²", "throughput": "mbar·l/s"}  # for kinds in the table
STUDY = """
name: units
surface: {D: 2.3, m: 3, L: 0.1 mm, Sq: 0.001 mm, seeds: 1, sides: mirrored}
material: {E: 10 N/mm², nu: 0.5}
sweep: {steps: 4, to: {pressure: 0.1 MPa}}
fluid: {gas: helium, inlet: 2 bar, outlet: 1 bar, temperature: 20 °C}
record:
  transport: {transmissivity: every-step, percolation: every-step, gas_flow: every-step}
  dimensional:
    {pressure: N/mm², mean_gap: µm, free_volume: ml/m^2, gas_leak_rate: sccm,
     leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa·s, unit: mm³/s}}
"""


@pytest.fixture(scope="module")
def units() -> "pint.UnitRegistry[float]":
    registry: pint.UnitRegistry[float] = pint.UnitRegistry()
    registry.define("hair = 80 um")
    registry.define("push = 3 bar")
    return registry


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """A run with every kind of unit, spelled as users spell them."""
    return roughvol.run(loads(STUDY), jobs=1, out=tmp_path_factory.mktemp("units") / "run")


def test_the_unit_of_every_row_of_the_table_is_one_of_pint(units: "pint.UnitRegistry[float]") -> None:
    for name, row in VARIABLES.items():
        text = row.units
        for kind, unit in OF_A_STUDY.items():
            text = text.replace(kind, unit)
        assert units.Quantity(1.0, text).magnitude == 1.0, name


def test_every_variable_is_a_quantity_with_the_values_that_are_stored(
    run: xr.Dataset, units: "pint.UnitRegistry[float]"
) -> None:
    ds = run.roughvol.derived()
    for name, variable in ds.variables.items():
        if variable.dtype.kind not in "fi":
            continue
        found = ds.roughvol.quantity(name, registry=units)
        if variable.attrs.get("units") != "sccm":  # in Pa m^3/s at the temperature of the gas
            np.testing.assert_array_equal(found.magnitude, variable.values)
            assert found.units == units.Quantity(1.0, variable.attrs.get("units", "1")).units
    leak = ds["leak_rate"].values * convert(1.0, "mm^3/s", "ml/min")
    np.testing.assert_allclose(ds.roughvol.quantity("leak_rate", "ml/min").magnitude, leak, rtol=1e-12)
    assert ds.roughvol.in_units(nominal_pressure=1 * units.kPa)["nominal_pressure"].attrs["units"] == "kPa"


def test_a_throughput_is_at_the_temperature_of_the_gas_and_a_standard_volume_at_0_degrees(
    run: xr.Dataset, units: "pint.UnitRegistry[float]"
) -> None:
    in_sccm = run["gas_leak_rate"].values
    at_0 = in_sccm * 101325e-6 / 60.0  # Pa m^3/s of a standard cm^3 per minute
    warm = at_0 * 293.15 / 273.15
    in_mbar = run.roughvol.in_units(gas_leak_rate="mbar*l/s")
    for ds in (run, in_mbar):
        for unit in ("Pa*m^3/s", units.Unit("mbar*l/s"), None):
            found = ds.roughvol.quantity("gas_leak_rate", unit, units)
            np.testing.assert_allclose(found.to("Pa*m^3/s").magnitude, warm, rtol=1e-12)
        np.testing.assert_allclose(ds.roughvol.quantity("gas_leak_rate", "slpm", units).magnitude, 1e-3 * in_sccm)


def test_what_has_no_such_unit_is_refused_by_name(run: xr.Dataset) -> None:
    for call, words in (
        (lambda: run.roughvol.quantity("leak"), "no variable 'leak'"),
        (lambda: run.roughvol.quantity("leak_rate", "kPa"), "leak_rate: Cannot convert"),
        (lambda: run.roughvol.quantity("leak_rate", "apples"), "leak_rate: 'apples' is not defined"),
        (lambda: roughvol.press(HEIGHTS, L=10.0, steps=1).roughvol.quantity("Sq"), "Sq: the lengths have no unit"),
    ):
        with pytest.raises(DatasetError, match=words):
            call()


def test_a_press_takes_quantities_of_the_registry_of_the_user(units: Any) -> None:
    text = {"L": "80 um", "E": "30 MPa", "to": {"pressure": "0.3 MPa"}}
    other = {"L": 80 * units.micron, "E": 100 * units.push, "to": {"pressure": 1 * units.push}}
    first = roughvol.press(HEIGHTS, nu=0.5, steps=2, jobs=1, **text)
    for heights in (HEIGHTS, HEIGHTS / 80.0 * units.hair, HEIGHTS * units.micron):
        found = roughvol.press(heights, nu=np.float32(0.5), steps=np.int64(2), jobs=1, **other)
        for name in ("contact_area_fraction", "free_volume"):
            np.testing.assert_allclose(found[name], first[name], rtol=1e-9)
        pressure, expected = (one.roughvol.quantity("nominal_pressure", "Pa") for one in (found, first))
        np.testing.assert_allclose(pressure.magnitude, expected.magnitude, rtol=1e-9)


def test_the_unit_of_L_is_that_of_heights_without_one_and_is_not_converted(units: Any) -> None:
    for call in (
        lambda: roughvol.press(HEIGHTS, L=1 * units.hair),
        lambda: of_data({"surface": {"D": 2.3, "m": 3, "seeds": 1, "L": 1 * units.hair}}),
        lambda: roughvol.check({"surface": {"D": 2.3, "m": 3, "seeds": 1}}, changes={"surface.L": 1 * units.hair}),
    ):
        with pytest.raises(StudyError, match="'hair' is no known unit; allowed for a length: pm"):
            call()


@pytest.mark.parametrize(
    ("section", "key", "value", "unit"),
    [("material", "E", 10, "mm"), ("surface", "L", 3, "MPa"), ("surface", "Sq", 1, "s"), ("material", "nu", 1, "mm")],
)
def test_a_wrong_dimension_has_the_message_of_the_file(
    section: str, key: str, value: float, unit: str, units: Any
) -> None:
    data: dict[str, Any] = {"surface": {"D": 2.3, "m": 3, "seeds": 1}, "material": {"E": "1 MPa", "nu": 0.5}}
    data[section] |= {key: f"{value} {unit}"}
    with pytest.raises(StudyError) as of_file:
        loads(json.dumps(data))
    data[section] |= {key: units.Quantity(value, unit)}
    with pytest.raises(StudyError) as of_python:
        of_data(data)
    file, python = ([(p.key, p.message) for p in error.value.problems] for error in (of_file, of_python))
    assert file == python


def test_a_load_is_a_text_a_mapping_or_several(units: Any) -> None:
    wanted = [parse("pressure=0.5 MPa, leg 2")]
    assert levels("pressure=0.5 MPa, leg 2") == wanted
    assert levels({"pressure": 0.5 * units.MPa, "leg": 2}) == wanted
    assert levels({"pressure": [0.5, 1.0] * units.MPa}) == [parse("pressure=0.5 MPa"), parse("pressure=1 MPa")]
    assert levels([{"contact_area": np.float64(0.1)}, "last"]) == [Level("contact_area", 0.1), Level("last")]
    assert levels({"pressure": Quantity(0.5, "MPa")}) == [parse("pressure=0.5 MPa")]
    wrongs = (0.5, {}, [0.5], "force=1", {"pressure": "1 mm"}, {"pressure": 1 * units.mm}, {"pressure": 1, "load": 2})
    for wrong in wrongs:
        with pytest.raises(DatasetError):
            levels(wrong)  # type: ignore[arg-type]


def test_answers_at_a_load_are_those_of_its_text(run: xr.Dataset, units: Any) -> None:
    text = run.roughvol.at("pressure=0.05 N/mm²")
    for found in (run.roughvol.at(pressure=0.5 * units.bar), run.roughvol.at({"pressure": "0.05 MPa"}, leg=1)):
        np.testing.assert_allclose(found["leak_rate"], text["leak_rate"], rtol=1e-9)
    leak = float(text["leak_rate"].sel(axis="x").squeeze()) * units.mm**3 / units.s
    answers = [roughvol.ask(run, leak_rate=given).answers[0].value for given in (leak, f"{leak.magnitude!r} mm^3/s")]
    assert answers[0] == pytest.approx(answers[1], rel=1e-9)
    assert answers[0] == pytest.approx(0.05, rel=0.05)  # read off a curve, not off straight lines
    with pytest.raises(StudyError, match="'mm' is a unit of length, not of flow"):
        roughvol.ask(run, leak_rate=1 * units.mm)


def test_changes_are_texts_or_a_mapping(units: Any) -> None:
    for given in ("surface.m=6", ["surface.m=6"], {"surface.m": np.int64(6)}):
        assert changes_of(given) == ("surface.m=6",)
    two = {"material.E": 2 * units.MPa, "surface.D": [2.2, 2.3]}
    assert changes_of(two) == ("material.E=2 MPa", "surface.D=[2.2, 2.3]")
    study = {"name": "changed", "surface": {"D": 2.3, "m": 3, "seeds": 1}, "sweep": {"steps": 2}}
    for given in (study, of_data(study)):
        assert roughvol.check(given, jobs=1, changes={"surface.m": 4}).surface.shape == (17, 17)  # type: ignore[union-attr]


@pytest.mark.usefixtures("here")
def test_a_run_of_changes_opens_by_them() -> None:
    text = "surface: {D: 2.3, m: 3, seeds: 1}\nsweep: {steps: 2}"
    Path("tiny.yaml").write_text(text, encoding="utf-8")
    changes = {"surface.m": 4, "name": "finer"}
    ds = roughvol.run("tiny.yaml", jobs=1, changes=changes)
    assert ds["m"].values.tolist() == [4]
    xr.testing.assert_equal(roughvol.open("tiny.yaml", changes=changes), ds)
    xr.testing.assert_equal(roughvol.run(loads(text), jobs=1, changes=changes), ds)
    with pytest.raises(DatasetError, match="no results"):
        roughvol.open("tiny.yaml")
