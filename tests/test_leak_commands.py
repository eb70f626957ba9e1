"""The commands ask and creep, from an empty folder on."""

import contextlib
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import roughvol
from roughvol.analysis import leak_curve
from roughvol.analysis.tables import with_interval
from roughvol.campaign import card as card_runs
from roughvol.report import card_page, card_text
from roughvol.store import dataset
from roughvol.surfaces.midpoint import random_midpoint_displacement
from tests.kit import LEAKING, LEAKING_GAS, ROOT, answered, call, ran, refused, said, succeeded, twin

pytestmark = pytest.mark.usefixtures("here")
CREEP = ("--law", "creep.yaml", "--at")


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the run of the example scan, shortened."""
    with contextlib.chdir(folder := tmp_path_factory.mktemp("scan")):
        said("init", "scan")
        text = Path("scan.yaml").read_text(encoding="utf-8").replace("scan.txt,", "scan.txt, downsample: 4,")
        ran("scan", text.replace("{steps: 12, to: percolation}", "{steps: 3, to: {pressure: 0.1 MPa}}"))
    return folder


@pytest.fixture
def scan(stored: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(stored)
    monkeypatch.setattr(card_runs, "FEWEST_NODES", 8)


@pytest.mark.usefixtures("scan")
def test_a_stored_sweep_answers_with_a_pressure() -> None:
    asked = said("ask", "scan", "--leak-rate", "< 1e-6 mm^3/s")
    assert "along x: pressure 0.0" in asked
    assert re.search(r"MPa \(0\.\d+ to 0\.\d+\), between the known loads 0\.\d+ MPa and 0\.\d+ MPa", asked)
    least = said("ask", "scan", "--leak-rate", "1 m^3/s")
    assert re.search(r"along x: any pressure of 0\.\d+ MPa or more: the first known load leaks less", least)
    asked_for = ("ask", "scan", "--leak-rate", "1 m^3/s", "--for", "modulus", "--at", "pressure=1 kPa")
    match = re.search(r"any modulus up to E\* = (\S+) MPa: the first known load, p\* = ", said(*asked_for))
    first = answered(*asked_for)["answers"][0]["nominal_pressure_steps"][1]
    assert float(match[1]) * first == pytest.approx(1e-3 * 10.0 / (1.0 - 0.5**2), rel=1e-3)  # p* of the first step
    never = said("ask", "scan", "--leak-rate", "1e-30 mm^3/s", "--for", "modulus", "--at", "pressure=1 kPa")
    assert re.search(r"along y: no modulus within the stored loads, up to p\* = \d\.\d+$", never, re.MULTILINE)
    assert "scan: largest modulus for a leak up to 1e-30 mm^3/s" in never
    assert "least pressure for a leak up to 1e-4 mm^3/s" in said("ask", "scan", "--leak-rate", "1e-4")
    words = ("--leak-rate", "1e-6 mm^3/s", "--set", "name=scan")
    assert "or roughvol card runs/scan --set name=scan" in said("ask", "runs/scan", *words)
    for words in (("--leak-rate", "1e-4"), ("--closed",)):
        told = refused("ask", "scan", *words, "--at", "pressure=1 kPa")
        assert "the pressure is asked for; the load pressure=1 kPa belongs to: for modulus or Sq" in told


def test_the_limits_that_a_run_exceeds_are_said_beside_its_leaks() -> None:
    """The leak is that of the dry gap, and a fluid of this pressure opens the joint."""
    ran("pushed", LEAKING.replace("5 mbar", "5 bar"))
    limits = dataset.read(Path("runs/pushed/study.nc")).attrs["warnings"].splitlines()
    assert any("opens the joint" in line for line in limits)
    Path("creep.yaml").write_text("power: {exponent: 0.1, time: 1 s}", encoding="utf-8")
    for words in (
        ("show", "pushed", "--at", "last"),
        ("show", "pushed", "--csv"),
        ("ask", "pushed", "--leak-rate", "1e-6 mm^3/s"),
        ("creep", "pushed", *CREEP, "pressure=0.01MPa", "--times", "1 s", "--json"),
    ):
        assert call(*words).stderr.splitlines() == [f"warning: {line}" for line in limits]
    for words in (("--json",), ("--at", "p=0.1", "--at", "p=0.2")):
        assert call("card", "pushed", "--jobs", 1, *words).stderr.count("opens the joint") == 1
    compared = call("compare", "pushed", twin("pushed"), "--at", "last")
    both = ("pushed", "pushed_twin")
    assert compared.stderr.splitlines() == [f"warning: {name}: {line}" for name in both for line in limits]


@pytest.mark.usefixtures("scan")
def test_the_interval_with_a_budget_is_that_of_the_card_at_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the ends of the interval the stored leak is the value times, or over, the factors of the card."""
    stored = dataset.read(Path("runs/scan/study.nc"))
    largest = float(np.sqrt(np.prod(stored["leak_rate"].sel(axis="x").values.ravel()[:2])))
    words = ("scan", "--leak-rate", f"{largest} mm^3/s")
    read, whole = answered("ask", *words)["answers"], roughvol.ask("scan", leak_rate=words[2], budget=True)
    compared = 0
    for reading, answer in zip(read, whole.plain()["answers"], strict=True):
        assert answer["value"] == reading["value"]
        assert reading["errors"] == ["reading"]
        assert answer["errors"] == ["reading", "solver", "grid", "window", "levelling"]
        assert answer["interval"][0] < reading["interval"][0] < reading["interval"][1] < answer["interval"][1]
        at = f"pressure={answer['value']:.4g} MPa"
        ways = answered("card", "scan", "--at", at)["ways"]
        (way,) = (way for way in ways if way["axis"] == answer["axis"])
        (curve,) = leak_curve.curves(stored)[answer["axis"]]
        reading_there = curve.at(np.array([answer["value"]]))
        assert 0.99 * reading_there.low[0] < way["leak"] < 1.01 * reading_there.high[0]
        factors = [way["leak"] / end for end in way["leak_interval"]]
        for end, factor, side in zip(answer["interval"], factors, ("low", "high"), strict=True):
            if curve.begins < end < curve.closing.open_up_to:  # ends beyond the stored steps are open
                found = getattr(curve.at(np.array([end])), side)[0]
                assert found == pytest.approx(largest * factor, rel=0.05)
                compared += 1
    assert compared
    monkeypatch.setattr(roughvol, "ask", lambda *_, budget, **__: budget and whole)  # its cards take a second
    printed = said("ask", *words, "--budget")
    assert re.search(r"along x: pressure 0\.\d+ MPa \((?:up|0\.\d+) to (0\.\d+); \1 MPa with 95 %\)", printed)
    assert "errors of the leak: " in printed
    assert "not in these numbers" not in printed


@pytest.mark.usefixtures("scan")
def test_a_closing_with_a_budget_is_solved_and_has_the_interval_of_the_card() -> None:
    bracket, found = (answered("ask", "scan", "--closed", *more)["answers"] for more in ((), ("--budget",)))
    card = answered("card", "scan")
    for steps, answer, way in zip(bracket, found, card["ways"], strict=True):
        assert answer["value"] == pytest.approx(way["closing_pressure"], rel=1e-9)
        low, high = steps["interval"]
        assert low <= answer["value"]
        assert high is None or answer["value"] <= high  # a sweep that ends before this way closes
        assert answer["interval"] == pytest.approx(way["closing_pressure_interval"], rel=1e-9)
        assert answer["errors"][1:] == ["solver", "grid", "window", "levelling"]


def test_a_budget_is_of_the_height_file_of_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("scans").mkdir()
    np.save("scans/map.npy", 1e-3 * random_midpoint_displacement(2.2, 4, side=1.0, seed=1).heights)
    made, read = "D: 2.3, m: 4, seeds: 1, L: 100 um, Sq: 1 um", "file: map.npy, L: 200 um, heights_unit: mm"
    text = LEAKING.replace(made, read)
    Path("scans/map.yaml").write_text(text, encoding="utf-8")
    said("run", "scans/map.yaml", "--jobs", "1")
    words = ("--closed", "--budget", "--jobs", "1")
    assert "errors of the closing load" in said("ask", "scans/map.yaml", *words)
    monkeypatch.chdir("scans")
    assert "errors of the closing load" in said("ask", "../runs/map", *words)
    said("run", "../runs/map", "--set", "material.E=99 MPa", "--out", "../runs/map", "--fresh", "--jobs", "1")
    assert "to compute the budget anew, move ../runs/map_card away" in refused("ask", "../runs/map", *words)
    np.save("map.npy", np.load("map.npy")[::-1])
    assert "the content of map.npy has changed" in refused("ask", "../runs/map", *words)


def test_the_unit_of_a_leak_decides_between_liquid_and_gas() -> None:
    ran("gas", LEAKING_GAS)
    assert "Q_g,x [sccm]" in said("show", "gas")
    flows = dataset.read(Path("runs/gas/study.nc")).gas_leak_rate.sel(axis="x").values.ravel()
    rate = float(flows[2] * flows[3]) ** 0.5
    same = rate * 101325e-6 / 60 * 293.15 / 273.15 * 10  # from 0 °C to the temperature of the gas
    asked = [said("ask", "gas", "--leak-rate", one) for one in (f"< {rate} sccm", f"{same} mbar·l/s", f"{rate}")]
    assert "along x: pressure 0." in asked[0]
    assert asked[2] == asked[0]  # a plain number is in the unit of the run, as that of a liquid
    first, second = (float(one.split("along x: pressure ")[1].split()[0]) for one in asked[:2])
    assert abs(first / second - 1.0) < 1e-3
    for words, message in (
        (["1 sccm", "--for", "Sq", "--at", "pressure=1 kPa"], "mean free path"),
        (["1 mm^3/s"], "as in sccm ('mm^3/s' is a unit of flow, not of throughput; allowed: mbar*l/s, "),
        (["1 torrr*l/s"], "as in sccm ('torrr*l/s' is no known unit; allowed for a throughput: mbar*l/s, "),
    ):
        assert message in refused("ask", "gas", "--leak-rate", *words)
    ran("far", LEAKING_GAS.replace("every-step", "{contact_area: 0.99}"))
    assert "no state of record.transport.gas_flow was reached" in refused("ask", "far", "--leak-rate", "1 sccm")


def test_the_leak_of_a_gas_has_the_factors_of_the_liquid(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the card, and of ask and creep with its budget; they were refused for a gas."""
    monkeypatch.setattr(card_runs, "FEWEST_NODES", 8)
    study = LEAKING_GAS.replace("1 um}", "1 um, sides: mirrored}")
    study = study.replace("outlet: 0 bar", "outlet: 0 bar, law: viscous")
    ran("gas", study.replace("8, to: {pressure: 0.5 MPa", "3, to: {pressure: 40 kPa"))
    load = "pressure=0.02 MPa"
    card = roughvol.card("gas", load, jobs=1)
    (found,) = card.cards.values()
    (gas,), way = found.beside, found.ways[0]
    factors = np.array(way.interval) / way.leak.value
    assert 0.0 <= factors[0] < 1.0 < factors[1] < np.inf
    leak, low, high = gas.leaks[0].value, *gas.intervals[0]
    assert_allclose([low, high], leak * factors, rtol=1e-12)
    assert card.plain()["beside"][0]["x_interval"] == [low, high]
    (row,) = (row for row in card_page.numbers_of(card.pages) if row[5:7] == (gas.words, "x"))
    assert row[7:10] == (leak, low, high)
    fact = dict(card_text.load_facts(found))[f"L{gas.words[1:]}"]
    assert fact.startswith("x {} ({} to {}), ".format(*map(card_text.short, (leak, low, high))))
    value, *ends = with_interval(leak, low, high)
    words = f"{value} sccm of the gas, between {' and '.join(ends)}; of a liquid T* V*³ = "
    assert card_text.answer(found, way).startswith(words)
    read, whole = (roughvol.ask("gas", leak_rate=leak, budget=budget, jobs=1).answers[0] for budget in (False, True))
    assert whole.value == read.value
    assert whole.budget is not None
    of_less = roughvol.ask("gas", leak_rate=leak / whole.budget.leak[1]).answers[0]
    assert whole.high == of_less.high > 1.1 * read.high
    law = {"table": {"times": ["1 s", "1 h"], "ratios": [1.0, 1.2]}}
    first, errors = (
        roughvol.creep("gas", law, at=load, times=["1 s"], budget=budget, jobs=1).leak["x"] for budget in (False, True)
    )
    assert_allclose([errors.low[0], errors.high[0]], factors * [first.low[0], first.high[0]], rtol=1e-12)


def test_a_leak_of_neither_fluid_is_refused_with_the_units_of_both() -> None:
    liquid = "sccm, leak_rate: {pressure_drop: 1 bar, viscosity: 1 cP}"
    ran("both", LEAKING_GAS.replace("{gas_flow:", "{transmissivity: every-step, gas_flow:").replace("sccm", liquid))
    assert "as in mm^3/s, or of the gas as in sccm" in refused("ask", "both", "--leak-rate", "1 kg/s")


def test_the_note_has_the_gas_of_a_leak_run_by_run_where_gases_differ() -> None:
    ran("helium", LEAKING_GAS)
    helium = "helium, 1 bar to 0 bar, 293.15 K, law kinetic"
    assert f"Q_g is the throughput of the patch, {helium}." in said("show", "helium")
    ran("slip", LEAKING_GAS.replace("0 bar}", "0.5 bar, law: slip}"))
    told = said("compare", "helium", "slip", "--at", "pressure=0.02 MPa")
    assert f"Q_g is the throughput of the patch, helium: {helium}; slip: helium, 1 bar to 0.5 bar" in told
    assert "law slip" in told


@pytest.fixture
def _creeping(here: Path) -> None:
    Path("creep.yaml").write_text("prony: {shares: [0.5], times: [10 s]}")


@pytest.mark.usefixtures("_creeping")
def test_several_height_files_are_said_to_be_samples_of_one_joint() -> None:
    for k in range(2):
        z = random_midpoint_displacement(2.2, 4, seed=k).heights
        np.savetxt(f"face{k}.txt", 0.5 * z / z.std())
    surface = "{files: [face0.txt, face1.txt], L: 200 um, unit: um}"
    ran("faces", LEAKING.replace("{D: 2.3, m: 4, seeds: 1, L: 100 um, Sq: 1 um}", surface))
    leak = float(dataset.read(Path("runs/faces/study.nc")).leak_rate.sel(axis="x")[0, 0])
    for told in (
        said("ask", "faces", "--leak-rate", f"{leak} mm^3/s"),
        said("creep", "faces", *CREEP, "pressure=0.1MPa", "--times", "1 s, 1 h"),
    ):
        assert "The 2 height files are taken as samples of one joint." in told


@pytest.mark.usefixtures("_creeping")
def test_creep_of_a_closed_seal_draws_nothing() -> None:
    ran("tight", LEAKING.replace("{steps: 8, to: {pressure: 0.5 MPa}}", "{pressures: [1 MPa, 3 MPa]}"))
    shown = succeeded("creep", "tight", *CREEP, "pressure=1.5 MPa", "--times", "1 s, 1 h")
    assert "no figure is drawn" in shown.output
    assert not Path("runs/tight/creep.png").exists()


@pytest.mark.slow
def test_the_page_of_read_offs_has_what_its_commands_print() -> None:
    page = (ROOT / "docs/how-to/read-offs.md").read_text(encoding="utf-8")
    law = re.search(r"^prony: [^#]*", page, re.MULTILINE)
    Path("creep.yaml").write_text(law[0], encoding="utf-8")
    for example in ("seal", "scan"):
        said("init", example)
        said("run", f"{example}.yaml", "--jobs", "1")
    shown = re.findall(r"^\$ roughvol ([^\n]*)\n(.*?)\n```", page, re.MULTILINE | re.DOTALL)
    assert [command.split()[0] for command, _ in shown] == ["ask", "ask", "creep"]
    for command, text in shown:
        printed = said(*shlex.split(command))
        number = r"(?<![\w.])\d+(?:\.\d+)?(?:e-?\d+)?"
        assert re.sub(number, "", text).split() == re.sub(number, "", printed).split()
        there, now = (list(map(float, re.findall(number, some))) for some in (text, printed))
        assert there == pytest.approx(now, rel=0.02)
