"""Numbers that may be meant in another way: both readings are given, by `check`, by `run` and in Python."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import roughvol
from roughvol.cli import main
from roughvol.errors import CampaignError, RoughvolWarning
from roughvol.study import loads

UNITS = "surface: {D: 2.3, m: 4, seeds: 1, L: 100 um, Sq: 1 um}\nmaterial: {E_star: 10 MPa}\n"  # p = p* 0.1 MPa
BARE = "surface: {D: 2.3, m: 4, seeds: 1, L: 100, Sq: 1}\n"


@pytest.fixture(autouse=True)
def _empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def _doubts(text: str, command: str = "run") -> list[str]:
    """Return the warnings of a command on numbers that may be meant in another way."""
    Path("s.yaml").write_text(text, encoding="utf-8")
    options = ["--jobs", "1", "--fresh"] if command == "run" else []
    done = CliRunner().invoke(main, [command, "s.yaml", *options])
    assert done.exit_code == 0, done.output
    lines = re.findall(r"^warning: (.*)$", done.stderr, re.MULTILINE)
    return [
        line
        for line in lines
        if re.match(r"(fluid )?pressures? |separations? |indentations? |hardness |accuracy ", line)
    ]


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            UNITS + "sweep: {steps: 2, to: {pressure: 0.1}}",
            "pressure 0.1 is p* = 0.1, that is 0.01 MPa; write '0.1 MPa' for a nominal pressure",
        ),
        (
            UNITS + "sweep: {pressures: [0.1, 0.2, 0.5]}\nrecord: {fields_at: {pressure: 0.3}}",
            "pressures 0.1, 0.2, 0.3, 0.5 are p*, that is 0.01, 0.02, 0.03, 0.05 MPa; "
            "write '0.1 MPa' for a nominal pressure",
        ),
        (
            UNITS.replace("10 MPa", "0.01 GPa")
            + "sweep: [{steps: 2, to: {pressure: 2}}, {steps: 1, to: {pressure: 0}}]\n"
            + "record: {dimensional: {pressure: bar}}",
            "pressure 2 is p* = 2, that is 2 bar; write '2 bar' for a nominal pressure",
        ),
        (
            UNITS + "sweep: {steps: 2, to: {indentation: 0.5}}",
            "indentation 0.5 is Δ/σ = 0.5, that is 0.5 um; write '0.5 um' for a length",
        ),
        (
            UNITS + "sweep: {steps: 2}\nrecord: {fields_at: {separation: [0, 1]}}",
            "separation 1 is d/σ = 1, that is 1 um; write '1 um' for a length",
        ),
        (
            BARE + "material: {E: 7.5, nu: 0.5}\nsweep: {steps: 2, to: {pressure: 0.2}}",
            "pressure 0.2 is p* = 0.2, that is 0.02 in the unit of E; "
            "for a nominal pressure give both with units, as E: 10 MPa and 0.1 MPa",
        ),
        (
            UNITS + "sweep: {steps: 2, to: {pressure: 0.05 MPa}}\n"
            "record: {fluid_pressure: {inlet: 0.1, coupling: one-way}}",
            "fluid pressure 0.1 is p* = 0.1, that is 0.01 MPa; write '0.1 MPa' for a nominal pressure",
        ),
    ],
)
def test_a_bare_number_beside_units_is_given_in_both_readings(command: str, text: str, expected: str) -> None:
    assert [line.replace("about ", "") for line in _doubts(text, command)] == [expected]


@pytest.mark.parametrize(
    "text",
    [
        UNITS + "sweep: {steps: 2, to: {pressure: 0.01 MPa}}",
        UNITS + "sweep: [{steps: 2, to: {pressure: 0.01 MPa}}, {steps: 1, to: {pressure: 0}}]",
        UNITS + "sweep: {steps: 2, to: {separation: 0}}",
        UNITS + "sweep: {steps: 2, to: {contact_area: 0.01}}\nrecord: {fields_at: {free_volume: 2}}",
        BARE + "sweep: {steps: 2, to: {pressure: 0.2}}",
        BARE + "material: {E_star: 1, hardness: 0.1}\nsweep: {steps: 2, to: {pressure: 0.2}}",
        BARE + "material: {E: 7.5, nu: 0.5}\nsweep: {steps: 2, to: {indentation: 0.2}}",
    ],
)
def test_what_has_one_reading_raises_no_doubt(text: str) -> None:
    assert _doubts(text) == []
    assert _doubts(text, "check") == []


def test_several_surfaces_have_a_range() -> None:
    text = UNITS.replace("seeds: 1, L: 100 um, Sq: 1 um", "seeds: 3, L: 100 um") + "sweep: {to: {pressure: 0.1}}"
    with pytest.warns(RoughvolWarning) as seen:
        ds = roughvol.run(loads(text, "many.yaml"), jobs=1)
    nominal = 0.1 * 10.0 * ds.Sq.values.ravel() / 100.0  # p* E* Sq/L
    (line,) = (str(one.message) for one in seen if str(one.message).startswith("pressure"))
    assert f"that is {nominal.min():.3g} to {nominal.max():.3g} MPa" in line


def test_each_material_of_a_list_has_its_own_reading() -> None:
    text = UNITS.replace("10 MPa", "[10 MPa, 20 MPa]") + "sweep: {steps: 2, to: {pressure: 0.1}}"
    found = _doubts(text)
    assert [re.search(r"that is (\S+) MPa", line)[1] for line in found] == ["0.01", "0.02"]  # type: ignore[index]
    assert all("E_star = " in line for line in found)


def test_press_gives_both_readings_of_a_bare_pressure() -> None:
    """A map in metres with a modulus in Pa: the contact was full, where 0.1 MPa has A* = 0.13."""
    heights = 1e-6 * np.random.default_rng(0).normal(size=(9, 9))
    options: dict[str, Any] = {"L": 100e-6, "nu": 0.5, "steps": 2}
    starred = 1e5 * 10e6 / 0.75 * float(heights.std()) / 100e-6
    with pytest.warns(RoughvolWarning, match=r"pressure 100000 is p\* = 100000, that is .* in the unit of E") as seen:
        ds = roughvol.press(heights, E=10e6, to={"pressure": 1e5}, **options)
    assert f"that is {starred:.3g} in" in next(str(one.message) for one in seen if "is p*" in str(one.message))
    assert "is p* = 100000" in ds.attrs["warnings"]
    with pytest.warns(RoughvolWarning, match=r"pressure 0\.1 is p\* = 0\.1, that is \S+ MPa; write '0\.1 MPa'"):
        roughvol.press(heights, E="10 MPa", to={"pressure": 0.1}, **options)
    given = roughvol.press(heights, E="10 MPa", to={"pressure": "0.1 MPa"}, **options)
    assert "p*" not in given.attrs["warnings"]
    assert float(given.nominal_pressure[-1]) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("hardness", "doubtful"), [("0.0001 Pa", True), ("1 MPa", False), ("0.5 GPa", True), ("1e-5", True), ("2", False)]
)
def test_a_hardness_out_of_proportion_is_doubtful(hardness: str, doubtful: bool) -> None:
    text = UNITS.replace("10 MPa", f"10 MPa, hardness: {hardness}, plastic: false") + "sweep: {steps: 2}"
    for command in ("check", "run"):
        found = _doubts(text, command)
        assert bool(found) == doubtful
        assert all(re.match(r"hardness .* of the contact modulus, .* is its unit right\?", line) for line in found)


def test_an_accuracy_that_looks_like_a_percentage_is_doubtful() -> None:
    text = BARE.replace("seeds: 1, ", "") + "sweep: {to: {pressure: 0.2}}\nensemble: {accuracy: {free_volume: 1}}"
    expected = "accuracy of free_volume is 1 in units of free_volume itself, no share: write '1 %' for a percentage"
    assert _doubts(text, "check") == [expected]
    assert _doubts(text) == [expected]
    assert _doubts(text.replace("volume: 1", "volume: 50 %"), "check") == []


def test_a_run_that_fails_names_its_doubtful_numbers() -> None:
    """A load above the hardness by its other reading: 0.1 MPa is below it, p* = 0.1 is not reached."""
    heights = 1e-6 * np.random.default_rng(0).normal(size=(9, 9))
    options: dict[str, Any] = {"L": 100e-6, "E": "10 MPa", "nu": 0.5, "hardness": "1.1 kPa", "steps": 2}
    with pytest.warns(RoughvolWarning, match=r"^pressure 0\.1 is p\* = 0\.1, that is "), pytest.raises(CampaignError):
        roughvol.press(heights, to={"pressure": 0.1}, **options)
    text = UNITS.replace("10 MPa", "10 MPa, hardness: 1.1 kPa") + "sweep: {steps: 2, to: {pressure: 0.1}}"
    Path("s.yaml").write_text(text, encoding="utf-8")
    done = CliRunner().invoke(main, ["run", "s.yaml", "--jobs", "1"])
    assert done.exit_code == 1
    assert len(re.findall(r"^warning: pressure 0\.1 is p\* = 0\.1", done.stderr, re.MULTILINE)) == 1
