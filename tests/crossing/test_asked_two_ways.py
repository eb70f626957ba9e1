"""One question asked in two ways has one answer, or is refused both times."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from xarray import Dataset

import roughvol
from roughvol.analysis.derived import derived
from roughvol.campaign import execution, validity
from roughvol.errors import DatasetError, StudyError
from roughvol.study import loads
from roughvol.surfaces import random_midpoint_displacement
from tests.kit import call

SURFACE = "surface: {D: 2.3, m: 4, L: 100 um, Sq: 0.7 um, seeds: [3], sides: mirrored}\n"
RUBBER = "material: {E: 10 MPa, nu: 0.4}\n"
PRESSED = "sweep: {pressures: [0.01 MPa, 0.03 MPa, 0.05 MPa]}\n"
LIQUID = "{pressure: MPa, leak_rate: {pressure_drop: 1 mbar, viscosity: 1 mPa*s}}"
RECORD = f"record: {{transport: {{transmissivity: every-step}}, dimensional: {LIQUID}}}\n"
HELIUM = "fluid: {gas: helium, inlet: 5 bar, outlet: 1 bar}\n"
OWN = """
def largest(state):
    return state.gap.max() * state.Sq

largest.units = "length"

def highest(state):
    return state.pressure.max() * state.E_star

def half(state):
    return state.mean_pressure
"""


def run(text: str, folder: Path) -> Dataset:
    execution.run(loads(text, file=folder / "study.yaml"), jobs=1, out=folder / "out")
    return roughvol.open(folder / "out")


def test_a_force_on_a_region_is_refused_after_the_run_as_before(tmp_path: Path) -> None:
    record = f"record: {{region: interior, transport: {{transmissivity: every-step}}, dimensional: {LIQUID}}}\n"
    ds = run(SURFACE + RUBBER + PRESSED + record, tmp_path)
    said = "load=0.0003 N is a load on the whole surface, and states are those of record.region: give a pressure"
    with pytest.raises(DatasetError, match=said):
        ds.roughvol.at("load=0.0003 N")
    with pytest.raises(DatasetError, match=said):
        roughvol.creep(ds, at="load=0.0003 N", law="log", times=["1 h"])


def test_a_gas_without_units_has_the_limit_of_its_pressure_drop(tmp_path: Path) -> None:
    record = "record: {transport: {gas_flow: every-step}, dimensional: {pressure: MPa}}\n"
    study = loads(SURFACE + RUBBER + PRESSED + record + HELIUM)
    ds = execution.run(study, jobs=1, out=tmp_path)
    given = validity.setting(study)
    assert "pressure_drop" in {finding.key for finding in validity.after(given, ds)}
    assert "pressure_drop" not in {limit.key for limit in validity.kept(given, ds)}
    without = ds.drop_vars("gas_transmissivity")
    assert "pressure_drop" not in {limit.key for limit in validity.kept(given, without)}  # compared with no state


def test_a_seal_of_maps_of_different_shapes_is_refused(tmp_path: Path) -> None:
    z = random_midpoint_displacement(2.3, 4, seed=5).heights
    np.save(tmp_path / "a.npy", z)
    np.save(tmp_path / "b.npy", np.concatenate([z, z[:, ::-1]], axis=1))
    text = f"surface: {{files: [a.npy, b.npy], L: 100 um, sides: mirrored}}\n{RUBBER}{PRESSED}{RECORD}"
    words = r"patches of one shape, and the surfaces are 1 to 2\.\d* times as long"
    path = tmp_path / "maps.yaml"
    path.write_text(text + "seal: {length: 1 mm, width: 0.1 mm}\n", encoding="utf-8")
    for question in (roughvol.run, roughvol.check, roughvol.card):
        with pytest.raises(StudyError, match=rf"maps\.yaml:1: surface\.files: a seal takes {words}"):
            question(path)
    stored = run(text, tmp_path).assign_attrs(study=loads(path.read_text(), path).stored())  # of an older version
    with pytest.raises(DatasetError, match=words):
        roughvol.ask(stored, leak_rate="1e-5 mm^3/s")


def test_own_functions_see_the_heights_and_the_modulus_of_their_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own_two_ways.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    own = "{largest: own_two_ways:largest, highest: own_two_ways:highest, open_half: own_two_ways:half}"
    text = SURFACE + RUBBER.replace("10 MPa", "[5 MPa, 20 MPa]")
    text += f"sweep: {{pressures: [0.5, 2]}}\nrecord: {{fields_at: last, own: {own}}}\n"
    ds = run(text, tmp_path)
    last = ds.isel(step=-1)
    assert_allclose(
        last["largest"], (ds["gap"].max(("x", "y")) * ds["Sq"]).isel(field_at=0).broadcast_like(last.largest)
    )
    by_modulus = last["highest"].squeeze()
    assert_allclose(by_modulus[1] / by_modulus[0], 4.0, rtol=1e-12)
    middle = ds.sel(E=[5.0]).roughvol.at("pressure=1")
    assert_allclose(middle["open_half"], 1.0, rtol=1e-6)  # straight, though its name begins as that of a way


def test_standard_volumes_of_a_gas_are_those_of_its_temperature(tmp_path: Path) -> None:
    flows = "{gas_flow: every-step, flux_at: last}"
    record = f"record: {{transport: {flows}, dimensional: {{pressure: MPa, gas_leak_rate: UNIT}}}}\n"
    made = [
        run(SURFACE + RUBBER + PRESSED + record.replace("UNIT", unit) + HELIUM, tmp_path / str(k))
        for k, unit in enumerate(("sccm", "mbar*l/s"))
    ]
    for one, other, unit in ((*made, "mbar*l/s"), (*made[::-1], "sccm")):
        changed = one.roughvol.in_units(gas_leak_rate=unit, flux_at_gas_leak_rate=unit)
        for name in ("gas_leak_rate", "flux_at_gas_leak_rate"):
            assert_allclose(changed[name], other[name], rtol=1e-9)


@pytest.mark.parametrize("more", ["", ", hardness: 1 GPa", ", thickness: 500 um"])
def test_conductance_is_that_of_elastic_half_spaces_alone(more: str, tmp_path: Path) -> None:
    material = f"material: {{E: 70 GPa, nu: 0.3, conductivity: [50 W/m/K, 15 W/m/K]{more}}}\n"
    text = SURFACE.replace("mirrored", "periodic") + material + "sweep: {steps: 4, to: {contact_area: 0.1}}\n"
    study = loads(text)
    found = derived(execution.run(study, jobs=1, out=tmp_path), study)
    assert ("contact_conductance" in found) == (not more)
    assert "interfacial_stiffness" in found


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Dataset]:
    """A run with lengths in um, and the same in mm."""
    in_mm = SURFACE.replace("100 um", "0.1 mm").replace("0.7 um", "0.0007 mm")
    return [
        run(f"name: {name}\n" + surface + RUBBER + PRESSED + RECORD, tmp_path_factory.mktemp(name))
        for name, surface in (("um", SURFACE), ("mm", in_mm))
    ]


@pytest.mark.parametrize("level", ["pressure=0.02 MPa", "load=0.0002 N", "mean_gap=0.9 um", "leak_rate=3e-6 mm^3/s"])
def test_runs_are_compared_at_one_load_whatever_unit_their_lengths_have(level: str, runs: list[Dataset]) -> None:
    alone = runs[0].roughvol.at(level)
    for order in (runs, runs[::-1]):
        found = roughvol.compare(order, level).records()
        rows = [dict(zip(found.names, row, strict=True)) for row in found.rows]
        for row in rows:
            assert row["reached"] == 1
            for name in ("free_volume", "leak_rate_x", "nominal_pressure"):
                expected = alone.sel(axis="x")[name.removesuffix("_x")].item()
                assert row[name] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    "more",
    [
        "transport: {transmissivity: every-step, flux_at: {pressure: 0.02 MPa}}",
        "fluid_pressure: {inlet: 1 mbar, at: last}",
    ],
)
def test_leaks_at_recorded_states_are_compared_in_the_unit_of_the_leak(
    more: str, tmp_path: Path, runs: list[Dataset]
) -> None:
    flows = "" if "transport" in more else "transport: {transmissivity: every-step}, "
    record = f"record: {{{flows}{more}, dimensional: {LIQUID.replace('}', ', unit: ul/h}', 1)}}}\n"
    other = run("name: other\n" + SURFACE + RUBBER + PRESSED + record, tmp_path)
    level = "pressure=0.02 MPa" if flows == "" else "last"
    alone = other.roughvol.at(level)["leak_rate"].sel(axis="x").item() / 3600.0  # mm³/s
    found = roughvol.compare([runs[0], other], level).records()
    row = dict(zip(found.names, found.rows[1], strict=True))
    assert found.units["leak_rate_x"] == "mm^3/s"
    assert row["leak_rate_x"] == pytest.approx(alone, rel=1e-9)
    in_mm = other.roughvol.in_units(leak_rate="mm^3/s").roughvol.at(level)["leak_rate"]
    assert in_mm.sel(axis="x").item() == pytest.approx(alone, rel=1e-9)
    recorded = next(name for name in ("fluid_leak_rate", "flux_at_leak_rate") if name in other)
    both = other.roughvol.in_units(**{"leak_rate": "ml/min", recorded: "mm^3/s"})
    assert [both[name].attrs["units"] for name in ("leak_rate", recorded)] == ["ml/min", "mm^3/s"]


def test_a_number_without_a_common_unit_is_left_out_of_a_comparison(tmp_path: Path) -> None:
    plain = SURFACE.replace("L: 100 um, Sq: 0.7 um", "L: 100.0") + "sweep: {steps: 4, to: {pressure: 2}}\n"
    runs = [
        run(f"name: {name}\n{text}", tmp_path / name)
        for name, text in (("plain", plain), ("units", SURFACE + RUBBER + "sweep: {steps: 4, to: {pressure: 2}}\n"))
    ]
    found = roughvol.compare(runs, "p=1")
    names, (one, other), units = found.records()
    assert "mean_gap" not in units
    volume = names.index("free_volume")
    assert one[volume] == pytest.approx(other[volume], rel=1e-6)
    words = "mean_gap is left out: its units are length and um."
    assert words in found.table().note
    for form in ("--csv", "--json"):
        stored = (tmp_path / name / "out" for name in ("plain", "units"))
        assert call("compare", *stored, "--at", "p=1", form).stderr.endswith(f"\nwarning: {words}\n")
