"""Limits of the model: each is held against laws and closed forms, named where it is passed, and silent elsewhere."""

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose

from roughvol.campaign import execution, validity
from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.one_case import run_case
from roughvol.campaign.validity import LIMITS, Finding, Setting
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import solve, sweep
from roughvol.observables import pressures
from roughvol.store import dataset
from roughvol.store.dataset import Dataset
from roughvol.study import Level, load, loads
from roughvol.surfaces.surface import Surface
from tests.campaign.kit import case_of, collected
from tests.kit import call

CONFIGS = Path(__file__).parents[2] / "configs"
SMALL = "surface: {D: 2.3, m: 4, seeds: 2, L: 50 um, Sq: 0.5 um}\nsweep: {steps: 4, to: {contact_area: 0.1}}\n"
ONE = SMALL.replace("seeds: 2", "seeds: [1]").replace("contact_area: 0.1", "indentation: 2")
METAL = "material: {E: 70 GPa, nu: 0.33, hardness: 1 GPa, plastic: false}\n"
RUBBER = "surface: {D: 2.3, m: 4, seeds: 1, L: 500 um, Sq: 0.8 um}\nmaterial: {E_star: 10 MPa}\n"
LEAK = "record: {{transport: {{transmissivity: every-step}}, dimensional: {{leak_rate: {{pressure_drop: {}, "
LEAK += "viscosity: 1 mPa*s}}}}}}\n"
GAS = "fluid: {{gas: helium, inlet: {}, outlet: {}}}\nrecord: {{transport: {{gas_flow: last}}}}"
HARD = ("contact_above_hardness_fraction", "load_above_hardness_fraction")


@functools.cache
def _computed(text: str) -> Dataset:
    return collected(loads(text))


def _after(text: str) -> dict[str, Finding]:
    return {found.key: found for found in validity.after(validity.setting(loads(text)), _computed(text))}


def _before(text: str) -> dict[str, Finding]:
    return {found.key: found for found in validity.foreseen(loads(text))}


def _states(*pressures: float, **values: list[float]) -> Dataset:
    """Make results of one surface from numbers."""
    still = [0.0] * len(pressures)
    states = {
        "mean_pressure": list(pressures),
        "separation": still,
        "indentation": still,
        "contact_area_fraction": still,
    }
    made = {name: (("case", "step"), np.array([value])) for name, value in (states | values).items()}
    if "leak_rate" in made:
        made["leak_rate"] = ("case", "step", "axis"), made["leak_rate"][1][..., np.newaxis]  # type: ignore[assignment]
    return xr.Dataset(made | {"Sq": ("case", [1.0]), "Sdq": ("case", [0.01])}, coords={"L": 100.0})


# Hardness


def test_shares_above_the_hardness_are_those_of_a_direct_count() -> None:
    pressure = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 0.0], [0.0, 0.0, 10.0]])
    assert pressures.above(pressure, 2.5) == (3 / 5, 17 / 20)
    assert pressures.above(pressure, 10.0) == (0.0, 0.0)  # above, not at
    assert pressures.above(np.zeros((3, 3)), 0.5) == (0.0, 0.0)


@pytest.mark.parametrize("region", ["", "record: {region: interior}\n"])
def test_shares_are_stored_for_every_step_from_the_pressure_field(region: str) -> None:
    case = case_of(ONE + METAL + region)
    values, surface = run_case(case), surface_of(case)
    part = slice(4, 13) if region else slice(None)
    scale = 70 / (1 - 0.33**2) * 0.5 / 50  # p* E* Sq/L in GPa with the Sq of the study
    states = sweep(surface, HalfSpace(surface.shape), 2.0 * np.arange(1, 5) / 4)
    expected = np.transpose([pressures.above(scale * state.pressure()[part, part], 1.0) for state in states])
    for name, shares in zip(HARD, expected, strict=True):
        assert_allclose(values[name].values.ravel(), shares, rtol=1e-12)
    assert values[HARD[1]].max() > 0.5


def test_a_very_hard_metal_is_not_named() -> None:
    assert "hardness" not in _after(SMALL + METAL.replace("1 GPa", "1000 GPa"))


def test_without_a_hardness_and_where_pressures_end_at_it_no_shares_are_stored() -> None:
    assert not set(HARD) & set(run_case(case_of(ONE)).data_vars)
    text = SMALL + METAL.replace(", plastic: false", "")
    assert "hardness" not in _before(text) | _after(text)
    results = _computed(text)
    assert not set(HARD) & set(results.data_vars)
    assert (results.plastic_volume.isel(step=-1) > 0.0).all()
    assert (results.plastic_area_fraction.isel(step=-1) <= results.contact_area_fraction.isel(step=-1)).all()


def test_a_run_names_the_shares_of_contact_and_load_above_the_hardness() -> None:
    found, results = _after(SMALL + METAL)["hardness"], _computed(SMALL + METAL)
    highest, beyond = int(results.mean_pressure.values.argmax()), results[HARD[1]] > LIMITS["hardness"].value
    for name in HARD:
        assert f"{100 * results[name].values.ravel()[highest]:.3g} %" in found.sentence
    assert "hardness 1 GPa" in found.sentence
    least = float((results.mean_pressure * results.Sq).where(beyond).min()) * 70 / (1 - 0.33**2) * 1e3 / 50
    assert f"at {int(beyond.sum())} of 8 states (2 of 2 cases), from {least:.3g} MPa on" in found.sentence


def test_the_share_foreseen_is_that_of_the_distribution_of_pressure() -> None:
    given = Setting(1.0, hardness=0.06, hardness_text="0.06", scaled=True)
    sentence = validity.before(given, [Level("mean-plane")], Sq=1.0, Sdq=0.1, L=100.0)[0].sentence
    p = np.linspace(0.0, 1.0, 400_001)
    density = p / 0.05**2 * np.exp(-0.5 * (p / 0.05) ** 2)
    contact, load = density[p > 0.06].sum() / density.sum(), (p * density)[p > 0.06].sum() / (p * density).sum()
    assert f"about {100 * contact:.3g} % of the contact" in sentence
    assert f"{100 * load:.3g} % of the load" in sentence


# Which studies exceed which limit


@pytest.mark.parametrize(
    ("material", "named"),
    [
        ("{E: 70 GPa, nu: 0.33}", True),
        ("{E_star: 2.1e+11 Pa}", True),
        ("{E: 3 GPa, nu: 0.4}", False),
        ("{E: 210 GPa, nu: 0.3, against: {E: 10 MPa, nu: 0.49}}", False),  # the rubber yields last
        ("{E_star: 100}", False),  # of no unit
        ("{E: 70 GPa, nu: 0.33, hardness: 1 GPa}", False),
    ],
)
def test_a_metal_without_a_hardness_is_named(material: str, named: bool) -> None:
    text = f"{SMALL}material: {material}\n"
    assert ("metal" in _before(text), "metal" in _after(text)) == (named, named)
    polished = text.replace("0.5 um", "0.1 nm")  # so that it stays elastic
    assert not {"metal", "slope"} & (_before(polished) | _after(polished)).keys()


def test_the_contact_pressure_foreseen_is_near_the_one_computed() -> None:
    text = "material: {E: 70 GPa, nu: 0.33}\n" + SMALL.replace("m: 4, seeds: 2", "m: 6, seeds: [0]")
    pressures = [float(found["metal"].sentence.split()[-2]) for found in (_before(text), _after(text))]
    assert 0.7 < pressures[0] / pressures[1] < 1.4


def test_slope_is_judged_where_heights_and_lengths_have_one_scale() -> None:
    raw = "surface: {D: 2.6, m: 4, seeds: 3, L: 5}\nsweep: {steps: 2, to: {indentation: 1}}\n"
    assert "slope" not in _before(raw) | _after(raw)  # by convention alone the heights are in the unit of L
    for changed in ("L: 5 um", "L: 5, Sq: 2", "L: 5 um, Sq: 2000 nm"):
        text = raw.replace("L: 5", changed)
        found = _after(text)["slope"]
        assert "slope" in _before(text)
        assert f"{_computed(text).Sdq.max().item():.2g} on 3 of 3 surfaces" in found.sentence
    flat = raw.replace("L: 5", "L: 5 um, Sq: 10 nm")
    assert "slope" not in _before(flat) | _after(flat)


@pytest.mark.parametrize(("height", "named"), [("", False), ("Sq: 0.01", False), ("Sq: 0.5", True)])
def test_a_layer_is_judged_where_heights_and_lengths_have_one_scale(height: str, named: bool) -> None:
    text = f"surface: {{D: 2.2, m: 3, L: 5, seeds: 1, sides: periodic, {height}}}\n"
    text += "material: {E: 1, nu: 0.3, thickness: 1}\nsweep: {steps: 2, to: {indentation: 2}}\n"
    assert ("thickness" in _after(text)) == named
    ends = ("{indentation: 2}", "{separation: 0.5}", "mean-plane", "{pressure: 1}")
    for end, expected in zip(ends, (named, named, named, False), strict=True):
        assert ("thickness" in _before(text.replace("{indentation: 2}", end))) == expected


def test_the_limit_of_the_slope_is_where_the_neglected_area_reaches_a_twentieth() -> None:
    x = np.arange(65) / 64
    wave = np.sin(2 * np.pi * (x[:, None] + 2 * x))
    wave *= LIMITS["slope"].value / math.sqrt(0.5 * (4 * np.pi**2) * 5)  # of that rms gradient
    gradient = np.gradient(wave, x, x)
    assert 0.04 < np.sqrt(1 + gradient[0] ** 2 + gradient[1] ** 2).mean() - 1 < 0.05


FLOW = {"unit": "GPa", "drop_text": "2 bar"}
STILL = _states(1.0, 5.0, 20.0, np.nan)
LEAKY = _states(0.01, 0.1, 1.0, leak_rate=[2.0, 1.0, 0.5])


@pytest.mark.parametrize(
    ("given", "states", "expected", "words"),
    [
        ({"scaled": True}, STILL, [("nominal_pressure", 1, 3, 20.0)], "0.2 E*"),  # p/E* = p*/100
        ({}, STILL, [], ""),
        # Sq = 1
        ({"thickness": 100.0}, _states(1.0, 5.0, indentation=[9.0, 30.0]), [("thickness", 1, 2, 5.0)], "0.3 of its"),
        # p = 0.1, 1, 10 MPa; 0.2 MPa is small at the last alone
        ({"drop": 0.2e-3}, LEAKY, [("pressure_drop", 2, 3, 0.01)], "1 MPa"),
        ({"drop": 1e-7}, LEAKY, [], ""),
        *(
            ({"drop": 1e-9, "fluid": mean}, LEAKY, [("fluid", opened, 3, 0.01)] * (opened > 0), "opens the joint")
            for mean, opened in ((0.05e-3, 0), (0.5e-3, 1), (0.02, 3), (math.nan, 0))
        ),
        # a fluid opens and widens no unloaded joint
        (
            {"drop": 1e-30, "fluid": 2e-3},
            _states(1e-17, 0.1, 1.0, leak_rate=[2.0, 1.0, 0.5]),
            [("fluid", 1, 3, 0.1)],
            "",
        ),
        ({"drop": 0.2e-5}, _states(1e-17, 1.0, leak_rate=[2.0, 1.0]), [], ""),
        # a limit that is reached is kept, to the error of a search; a fluid that carries the load opens the joint
        ({"scaled": True}, _states(5.0, 10.0 * (1 + 2e-6)), [], ""),
        ({"scaled": True}, _states(5.0, 10.0 * (1 + 2e-5)), [("nominal_pressure", 1, 2, 10.0)], ""),
        ({"thickness": 100.0}, _states(5.0, indentation=[10.0]), [], ""),
        ({"drop": 1e-4}, _states(0.1, leak_rate=[1.0]), [], ""),
        ({"drop": 1e-30, "fluid": 1e-3}, _states(0.1 * (1 + 2e-6), leak_rate=[1.0]), [("fluid", 1, 1, 0.1)], ""),
        # a state without a leak rate does not count
        ({"drop": 0.2e-3}, _states(0.01, 0.1, leak_rate=[np.nan, 1.0]), [("pressure_drop", 1, 1, 0.1)], ""),
    ],
)
def test_states_beyond_a_limit_are_counted_from_the_least_load(
    given: dict[str, Any], states: Dataset, expected: list[tuple[str, int, int, float]], words: str
) -> None:
    found = validity.after(Setting(1.0, **(FLOW if "drop" in given else {}), **given), states)
    assert [one.key for one in found] == [key for key, *_ in expected]
    for one, (_, beyond, of, first) in zip(found, expected, strict=True):
        assert f"at {beyond} of {of} states" in one.sentence
        assert f"from p* = {first:g} on" in one.sentence or " on:" not in one.sentence
        assert words in one.sentence


@pytest.mark.parametrize(
    ("fluid", "mean", "sides"),
    [
        (LEAK.format("4 bar"), 2e5, "inlet 4 bar over the outlet at the ambient"),
        (GAS.format("10 bar", "9.9 bar"), 9.95e5 - 101325.0, "inlet 10 bar, outlet 9.9 bar"),
        (GAS.format("1 bar", "0 bar"), 0.5e5 - 101325.0, ""),
        (
            "record: {fluid_pressure: {inlet: 10 bar, outlet: 9.9 bar, at: last}}",
            9.95e5,
            "inlet 10 bar, outlet 9.9 bar",
        ),
    ],
)
def test_the_pressure_of_a_fluid_is_taken_over_the_ambient(fluid: str, mean: float, sides: str) -> None:
    text = f"{RUBBER}sweep: {{steps: 2, to: {{pressure: 0.19 MPa}}}}\n{fluid}\n"
    assert validity.setting(loads(text)).fluid == pytest.approx(mean / 1e7)
    found = _before(text)
    assert ("fluid" in found) is (mean > 1.9e5)
    assert "fluid" not in found or sides in found["fluid"].sentence


LIQUID, HELIUM = LEAK.format("10 bar"), GAS.format("10 bar", "1 bar")
BOTH = GAS.format("11 bar", "1 bar").partition("record")[0] + LIQUID.replace("port: {", "port: {gas_flow: last, ")
LIFTED = HELIUM[:-1] + ", fluid_pressure: {inlet: 10 mbar, at: last}}"
YIELDS = ", hardness: 1 MPa"


@pytest.mark.parametrize(
    ("material", "fluid", "alone"),
    [
        *(("", LIQUID, ""), (YIELDS, LIQUID, " for elastic contact alone"), ("", HELIUM, " for liquids alone")),
        (YIELDS, HELIUM, " for liquids and elastic contact alone"),
        *(("", BOTH, ""), ("", LIFTED, " for liquids alone")),
    ],
)
def test_a_pressure_drop_is_said_to_be_computed_where_it_can_be(material: str, fluid: str, alone: str) -> None:
    rubber = RUBBER.replace("10 MPa", f"10 MPa{material}")
    found = _before(f"{rubber}sweep: {{steps: 2, to: {{pressure: 0.19 MPa}}}}\n{fluid}\n")
    assert found["pressure_drop"].sentence.endswith(f"widen the gap; record.fluid_pressure computes it{alone}")


@pytest.mark.parametrize(
    ("inlet", "law", "named"),  # L is 0.5 mm, the mean free path at half of the inlet 0.39 m over its pressure in ubar
    [("1 mbar", "kinetic", False), ("0.7 mbar", "kinetic", True), ("0.7 mbar", "slip", False)],
)
def test_a_free_path_longer_than_the_surface_is_named(inlet: str, law: str, named: bool) -> None:
    gas = GAS.format(inlet, "0 bar").replace("0 bar}", f"0 bar, law: {law}}}")
    text = f"{RUBBER}sweep: {{steps: 2, to: {{pressure: 0.19 MPa}}}}\n{gas}\n"
    given, results = validity.setting(loads(text)), _computed(text).assign_attrs(length_unit="um")
    after = {found.key for found in validity.after(given, results)}
    assert ("free_path" in _before(text), "free_path" in after) == (named, named)
    kept = {limit.key for limit in validity.kept(given, results)}
    assert ("free_path" in kept) is (law == "kinetic" and not named)


def test_a_free_path_is_compared_with_the_longer_side() -> None:
    text = f"{RUBBER}sweep: {{steps: 2, to: {{pressure: 0.19 MPa}}}}\n{GAS.format('0.7 mbar', '0 bar')}\n"
    given, results = validity.setting(loads(text)), _computed(text).assign_attrs(length_unit="um")
    for x, y, named in (([17], [17], True), ([17], [65], False), ([65, 17], [33, 129], True)):  # any of several
        nodes = {"nodes_x": ("surface", x), "nodes_y": ("surface", y)}
        found = {one.key: one.sentence for one in validity.after(given, results.drop_vars(nodes).assign(nodes))}
        assert ("free_path" in found) == named
        assert not named or "is 550 um, and the surface 500 um long" in found["free_path"]


def test_a_free_path_is_foreseen_of_any_of_several_files(here: Path) -> None:
    heights = np.random.default_rng(0).normal(size=(17, 65))
    np.save("long.npy", heights)
    np.save("short.npy", heights[:, :17])
    surface = "surface: {files: [long.npy, short.npy], L: 500 um, heights_unit: um}\nmaterial: {E_star: 10 MPa}"
    text = f"{surface}\nsweep: {{steps: 2, to: {{pressure: 0.19 MPa}}}}\n{GAS.format('0.7 mbar', '0 bar')}\n"
    assert "free_path" in {found.key for found in validity.foreseen(loads(text))}


def test_metal_beyond_the_reach_of_perfect_plasticity_is_named() -> None:
    metal = "surface: {D: 2.3, m: 4, seeds: 1, L: 50 um, Sq: 0.5 um}\nmaterial: {E_star: 78 GPa, hardness: 1 GPa}\n"
    for share, named in ((0.25, False), (0.3, False), (0.31, True), (0.9, True)):
        text = f"{metal}sweep: {{steps: 3, to: {{pressure: {share} GPa}}}}\n"
        assert ("persistence" in _before(text), "persistence" in _after(text)) == (named, named)
    assert "up to 0.9 of the hardness" in _after(text)["persistence"].sentence


def test_the_highest_load_of_a_path_is_foreseen() -> None:
    highest, ends = "{steps: 2, to: {pressure: 2 MPa}}", "{steps: 2, to: {separation: 1}}"
    listed = "{pressures: [2 MPa, 1 MPa]}"  # its last state is not the highest
    for legs in (highest, f"[{ends}, {highest}, {{steps: 2, to: {{pressure: 0}}}}]", f"[{ends}, {listed}]"):
        sentence = _before(f"{RUBBER}sweep: {legs}\n")["nominal_pressure"].sentence
        assert "will be about 0.2 E* at the highest load" in sentence


@pytest.mark.parametrize(("drop", "named"), [("1 bar", True), ("1 mbar", False)])
def test_check_foresees_a_pressure_drop_that_lifts_the_joint(drop: str, named: bool) -> None:
    for end in ("percolation", "{contact_area: 0.2}", "{pressure: 2}"):
        assert ("pressure_drop" in _before(f"{RUBBER}sweep: {{to: {end}}}\n{LEAK.format(drop)}")) is named
    assert "pressure_drop" not in _before(f"{RUBBER}sweep: {{to: mean-plane}}\n{LEAK.format(drop)}")  # not known


def test_a_drop_that_cannot_be_compared_is_named() -> None:
    text = SMALL + LEAK.format("1 bar")
    assert "has no unit" in _before(text)["pressure_drop"].sentence
    assert "has no unit" in _after(text)["pressure_drop"].sentence


def test_a_flat_map_is_looked_at_without_trouble(tmp_path: Path) -> None:
    np.save(tmp_path / "z.npy", np.zeros((9, 9)))
    text = "surface: {file: z.npy, L: 1 mm}\nmaterial: {E: 210 GPa, nu: 0.3, hardness: 2 GPa}\n" + LEAK.format("1 bar")
    for end in ("{contact_area: 0.2}", "{indentation: 1}"):
        assert validity.foreseen(loads(f"{text}sweep: {{to: {end}}}", tmp_path / "s.yaml")) == []


# The rim of a free patch


def test_a_rigid_square_carries_its_load_at_the_rim_and_a_dome_in_its_middle() -> None:
    half_space = HalfSpace((33, 33))
    flat = solve(Surface(np.zeros((33, 33)), 1.0), half_space, 1.0)
    assert 0.4 < pressures.central_pressure_ratio(flat) < 0.6
    x = np.arange(33) - 16.0
    dome = solve(Surface(-(x[:, None] ** 2 + x**2), 1.0), half_space, 0.01)
    assert pressures.central_pressure_ratio(dome) == pytest.approx(33**2 / 17**2)
    assert math.isnan(pressures.central_pressure_ratio(solve(Surface(np.zeros((33, 33)), 1.0), half_space, 0.0)))


@pytest.mark.parametrize(
    ("surface", "more", "patch"),
    [
        ("{D: 2.3, m: 4}", "", False),
        ("{D: 2.3, m: 4}", "record: {transport: {percolation: last}}", True),
        ("{D: 2.3, m: 4}", "material: {E_star: 3 MPa}", True),
        ("{D: 2.3, m: 4, sides: periodic}", "material: {E_star: 3 MPa}", False),
        ("{D: 2.3, m: 4, sides: mirrored}", "record: {transport: {percolation: last}}", False),
        ("{H: 0.8, n: 16, sides: periodic}", "record: {transport: {percolation: last}}", False),
        ("{D: 2.3, m: 4}", "record: {transport: {percolation: last}, region: interior}", False),
        ("{D: 2.3, m: 4}", "record: {transport: {percolation: last}, region_widths: {}}", False),
    ],
)
def test_the_rim_is_judged_in_studies_of_a_joint_alone(surface: str, more: str, patch: bool) -> None:
    given, states = validity.setting(loads(f"surface: {surface}\n{more}")), _states(0.1)
    assert given.patch is patch
    for ratio, named in ((0.55, patch), (0.9, False)):
        states["central_pressure_ratio"] = ("case", [ratio])
        assert [found.key for found in validity.after(given, states)] == ["rim"] * named


def test_the_rim_is_judged_by_the_median_of_the_cases() -> None:
    made = xr.concat([_states(0.1)] * 3, "case")
    made["central_pressure_ratio"] = ("case", [0.1, 0.7, 1.9])
    (found,) = validity.after(Setting(1.0, patch=True), made)
    assert "has 0.70 of the mean pressure at the last state, median of 3 cases" in found.sentence
    made["central_pressure_ratio"] = ("case", [0.1, 0.9, 1.9])
    assert validity.after(Setting(1.0, patch=True), made) == []


@pytest.mark.parametrize(("cleaned", "word"), [("", "see surface.outliers"), (", outliers: {}", "removed already")])
def test_the_highest_point_of_a_scan_alone_is_judged(tmp_path: Path, cleaned: str, word: str) -> None:
    np.save(tmp_path / "z.npy", np.zeros((4, 4)))
    states = _states(0.1, separation=[4.0], indentation=[3.0])
    scan = loads(f"surface: {{file: z.npy, L: 3{cleaned}}}", tmp_path / "study.yaml")
    sentences = {found.key: found.sentence for found in validity.after(validity.setting(scan), states)}
    assert "7 Sq" in sentences["peak"]
    assert word in sentences["peak"]
    made = validity.after(validity.setting(loads("surface: {D: 2.3, m: 3}")), states)
    assert "peak" not in [found.key for found in made]


def test_filled_heights_are_judged_before_and_after_a_run() -> None:
    given, states = Setting(1.0), _states(0.1)
    for share, named in ((0.1, []), (0.104, ["up to 10.4% of the heights of a map were missing"])):
        states["filled_fraction"] = share
        findings = [*validity.after(given, states), *validity.before(given, [], Sq=1.0, Sdq=0.1, L=9.0, filled=share)]
        assert [found.sentence[:48] for found in findings] == 2 * named
        assert ("filled" in [limit.key for limit in validity.kept(given, states)]) == (not named)


# Stored and printed sentences


def test_a_run_stores_and_prints_its_findings_and_goes_well(tmp_path: Path) -> None:
    (tmp_path / "metal.yaml").write_text(SMALL + METAL, encoding="utf-8")
    for command in (["check"], ["run", "--jobs", "1", "--out", tmp_path / "out"]):
        told = call(command[0], tmp_path / "metal.yaml", *command[1:])
        lines = [line for line in told.stderr.splitlines() if line.startswith("warning: ")]
        assert (told.exit_code, len(lines)) == (0, len(set(lines)))
        assert any("hardness 1 GPa" in line for line in lines)
        assert "warning" not in told.stdout
    stored = dataset.read(tmp_path / "out" / "study.nc").attrs["warnings"].splitlines()
    assert [f"warning: {sentence}" for sentence in stored] == lines


def test_a_run_within_the_model_stores_no_sentence(tmp_path: Path) -> None:
    study = loads("surface: {D: 2.3, m: 3, seeds: 1}\nsweep: {steps: 2, to: {indentation: 1}}\n")
    results = execution.run(study, out=tmp_path, jobs=1)
    assert results.attrs["warnings"] == dataset.read(tmp_path / "study.nc").attrs["warnings"] == ""


def test_notes_come_first_and_nothing_twice() -> None:
    found = Finding("slope", "too steep")
    assert validity.sentences([found, found], ["width is 160 m"]) == ["width is 160 m", "too steep"]


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_no_shipped_study_but_two_is_known_to_leave_the_model(path: Path) -> None:
    known = {"metal_seal_elastic": ["hardness"], "metal_seal": ["persistence"]}  # elastic for comparison; at the limit
    assert [found.key for found in validity.foreseen(load(path))] == known.get(path.stem, [])
