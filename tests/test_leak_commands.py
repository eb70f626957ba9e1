"""The commands ask and creep, from an empty folder on."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from roughvol.analysis import leak_curve
from roughvol.store import dataset
from roughvol.surfaces.midpoint import random_midpoint_displacement
from tests.kit import call


@pytest.fixture
def scan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    assert call("init", "scan").exit_code == 0
    text = Path("scan.yaml").read_text().replace("{steps: 12, to: percolation}", "{steps: 4, to: {pressure: 0.1 MPa}}")
    Path("scan.yaml").write_text(text)
    return tmp_path


def test_a_stored_sweep_answers_with_a_pressure(scan: Path) -> None:
    assert call("run", "scan.yaml", "--jobs", "1").exit_code == 0
    asked = call("ask", "scan", "--leak-rate", "< 1e-6 mm^3/s")
    assert asked.exit_code == 0, asked.output
    assert "along x: pressure 0.0" in asked.output
    assert re.search(r"MPa \(0\.\d+ to 0\.\d+\), between the steps p\* = ", asked.output)
    least = call("ask", "scan", "--leak-rate", "1 m^3/s").output
    assert re.search(r"along x: any pressure of p\* = \d\.\d+ \(0\.\d+ MPa\) or more: the first step leaks less", least)
    never = call("ask", "scan", "--leak-rate", "1e-30 mm^3/s", "--for", "modulus", "--at", "pressure=1 kPa")
    assert re.search(r"along y: no modulus within the stored loads, up to p\* = \d\.\d+ \(0\.1 MPa\)", never.output)
    assert "scan: largest modulus for a leak up to 1e-30 mm^3/s" in never.output
    told = call("ask", "scan", "--leak-rate", "3 MPa")
    assert told.exit_code == 2
    assert "the leak rate is '3 MPa'" in told.output
    assert "least pressure for a leak up to 1e-4 mm^3/s" in call("ask", "scan", "--leak-rate", "1e-4").output


def test_the_interval_with_a_budget_is_that_of_the_card_at_the_answer(scan: Path) -> None:
    """At the ends of the interval the stored leak is the value times, or over, the factors of the card."""
    assert call("run", "scan.yaml", "--jobs", "1").exit_code == 0
    stored = dataset.read(Path("runs/scan/study.nc"))
    largest = float(np.sqrt(np.prod(stored["leak_rate"].sel(axis="x").values.ravel()[:2])))
    words = ("scan", "--leak-rate", f"{largest} mm^3/s")
    read, whole = (json.loads(call("ask", *words, *more, "--json").output)["answers"] for more in ((), ("--budget",)))
    compared = 0
    for reading, answer in zip(read, whole, strict=True):
        assert answer["value"] == reading["value"]
        assert reading["errors"] == ["reading"]
        assert answer["errors"] == ["reading", "solver", "grid", "window", "levelling"]
        assert answer["interval"][0] < reading["interval"][0] < reading["interval"][1] < answer["interval"][1]
        at = f"pressure={answer['value']:.4g} MPa"
        ways = json.loads(call("card", "scan", "--at", at, "--json").output)["ways"]
        (way,) = (way for way in ways if way["axis"] == answer["axis"])
        (curve,) = leak_curve.curves(stored, answer["axis"])
        reading_there = curve.at(np.array([answer["value"]]))
        assert 0.99 * reading_there.low[0] < way["leak"] < 1.01 * reading_there.high[0]
        factors = [way["leak"] / end for end in way["leak_interval"]]
        for end, factor, side in zip(answer["interval"], factors, ("low", "high"), strict=True):
            if curve.begins < end < curve.closing.open_up_to:  # ends beyond the stored steps are open
                found = getattr(curve.at(np.array([end])), side)[0]
                assert found == pytest.approx(largest * factor, rel=0.05)
                compared += 1
    assert compared
    printed = call("ask", *words, "--budget").output
    assert re.search(r"along x: pressure 0\.\d+ MPa \((?:up|0\.\d+) to (0\.\d+); \1 MPa with 95 %\)", printed)
    assert "errors of the leak: " in printed
    assert "not in these numbers" not in printed


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["card", "scan.yaml", "--at", "load=3"], "load=3: needs its unit, as load=20N"),
        (["card", "none.yaml"], "none.yaml"),
        (["ask", "none", "--leak-rate", "1 mm^3/s"], "none"),
    ],
)
def test_mistakes_are_one_message_and_exit_code_two(arguments: list[str], words: str, scan: Path) -> None:
    told = call(*arguments)
    assert told.exit_code == 2
    assert words in told.output
    assert "Traceback" not in told.output


def test_a_closing_with_a_budget_is_solved_and_has_the_interval_of_the_card(scan: Path) -> None:
    assert call("run", "scan.yaml", "--jobs", "1").exit_code == 0
    (bracket, found) = (
        json.loads(call("ask", "scan", "--closed", "--json", *more).output)["answers"] for more in ((), ("--budget",))
    )
    card = json.loads(call("card", "scan", "--json").output)
    for steps, answer, way in zip(bracket, found, card["ways"], strict=True):
        assert answer["value"] == pytest.approx(way["closing_pressure"], rel=1e-9)
        low, high = steps["interval"]
        assert low <= answer["value"]
        assert high is None or answer["value"] <= high  # a sweep that ends before this way closes
        assert way["closing_pressure_interval"] is not None
        assert answer["interval"] == pytest.approx(way["closing_pressure_interval"], rel=1e-9)
        assert answer["errors"][1:] == ["solver", "grid", "window", "levelling"]


GAS = """
name: gas
surface: {D: 2.2, m: 4, L: 100 um, Sq: 0.4 um, seeds: 1}
material: {E_star: 10 MPa}
sweep: {steps: 6, to: {pressure: 1.0}}
fluid: {gas: helium, inlet: 1 bar, outlet: 0 bar}
record:
  transport: {gas_flow: every-step}
  dimensional: {pressure: MPa, gas_leak_rate: sccm}
"""


def test_the_unit_of_a_leak_decides_between_liquid_and_gas(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("gas.yaml").write_text(GAS)
    assert call("run", "gas.yaml", "--jobs", "1").exit_code == 0
    shown = call("show", "gas")
    assert "Q_g,x [sccm]" in shown.output
    flows = dataset.read(Path("runs/gas/study.nc")).gas_leak_rate.sel(axis="x").values.ravel()
    rate = float(flows[2] * flows[3]) ** 0.5
    same = rate * 101325e-6 / 60 * 293.15 / 273.15 * 10  # from 0 °C to the temperature of the gas
    asked = [call("ask", "gas", "--leak-rate", one).output for one in (f"< {rate} sccm", f"{same} mbar·l/s")]
    assert "along x: pressure 0.0" in asked[0]
    first, second = (float(one.split("along x: pressure ")[1].split()[0]) for one in asked)
    assert abs(first / second - 1.0) < 1e-3
    liquid = call("ask", "gas", "--leak-rate", "1 sccm", "--budget")
    assert liquid.exit_code == 2
    assert "the budget of the error is that of a liquid" in liquid.output
    refused = call("ask", "gas", "--leak-rate", "1 sccm", "--for", "Sq", "--at", "pressure=1 kPa")
    assert refused.exit_code == 2
    assert "mean free path" in refused.output
    assert call("ask", "gas", "--leak-rate", "1 mm^3/s").exit_code == 2


def test_a_study_with_lists_is_refused_where_one_combination_is_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("lists.yaml").write_text(
        "surface: {D: 2.2, m: 4, L: 200 um, Sq: 0.5 um, seeds: [1]}\n"
        "material: {E_star: [5 MPa, 10 MPa]}\n"
        "sweep: {steps: 4, to: {pressure: 0.1 MPa}}\n"
        "record:\n  region: [none, interior]\n  transport: {transmissivity: every-step}\n"
        "  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa*s}}\n"
    )
    Path("creep.yaml").write_text("prony: {shares: [0.5], times: [10 s]}")
    assert call("run", "lists.yaml", "--jobs", "1").exit_code == 0
    for arguments, words in (
        (["ask", "lists.yaml", "--leak-rate", "1 mm^3/s"], "the run has several E_star (5 MPa, 10 MPa)"),
        (["creep", "lists.yaml", "--law", "creep.yaml", "--at", "pressure=1 kPa", "--times", "1 s"], "several E_star"),
    ):
        refused = call(*arguments)
        assert refused.exit_code == 2, refused.output
        assert words in refused.output


def test_several_height_files_are_said_to_be_samples_of_one_joint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for k in range(2):
        z = random_midpoint_displacement(2.2, 4, seed=k).heights
        np.savetxt(f"face{k}.txt", 0.5 * z / z.std())
    Path("faces.yaml").write_text(
        "surface: {files: [face0.txt, face1.txt], L: 200 um, unit: um}\n"
        "material: {E_star: 5 MPa}\nsweep: {steps: 6, to: {pressure: 0.1 MPa}}\n"
        "record:\n  transport: {transmissivity: every-step}\n"
        "  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa*s}}\n"
    )
    Path("creep.yaml").write_text("prony: {shares: [0.5], times: [10 s]}")
    assert call("run", "faces.yaml", "--jobs", "1").exit_code == 0
    leak = float(dataset.read(Path("runs/faces/study.nc")).leak_rate.sel(axis="x")[0, 1])
    for told in (
        call("ask", "faces", "--leak-rate", f"{leak} mm^3/s"),
        call("creep", "faces", "--law", "creep.yaml", "--at", "pressure=0.03MPa", "--times", "1 s, 1 h"),
    ):
        assert told.exit_code == 0, told.output
        assert "The 2 height files are taken as samples of one joint." in told.output


def test_creep_of_a_closed_seal_draws_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tight.yaml").write_text(
        "surface: {D: 2.2, m: 4, L: 200 um, Sq: 0.5 um, seeds: [1]}\n"
        "material: {E_star: 5 MPa}\n"
        "sweep: {pressures: [0.3 MPa, 1 MPa]}\n"
        "record:\n  transport: {transmissivity: every-step}\n"
        "  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa*s}}\n"
    )
    Path("creep.yaml").write_text("prony: {shares: [0.5], times: [10 s]}")
    assert call("run", "tight.yaml", "--jobs", "1").exit_code == 0
    shown = call("creep", "tight", "--law", "creep.yaml", "--at", "pressure=0.5 MPa", "--times", "1 s, 1 h")
    assert shown.exit_code == 0, shown.output
    assert "no figure is drawn" in shown.output
    assert not Path("runs/tight/creep.png").exists()
