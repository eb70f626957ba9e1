"""The leak card and read-offs: each part of the error where the truth is known, and answers against new runs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.analysis import leak_budget as card
from roughvol.campaign import card as card_runs
from roughvol.campaign import running
from roughvol.errors import StudyError
from roughvol.report import card_page
from roughvol.store.dataset import Dataset
from roughvol.study import Level, Study, load, loads
from roughvol.surfaces.midpoint import random_midpoint_displacement

DIMENSIONAL = "dimensional: {pressure: MPa, leak_rate: {pressure_drop: 10 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}"
TEXT = f"""name: seal
surface: {{D: 2.2, m: 7, seeds: 3, L: 200 um, Sq: 0.4 um}}
material: {{E_star: 10 MPa}}
sweep: {{steps: 4, to: {{pressure: 1.2}}}}
solver: {{rtol: 1.0e-4}}
record: {{transport: {{transmissivity: every-step}}, {DIMENSIONAL}}}
"""


@pytest.fixture(scope="module")
def study() -> Study:
    return loads(TEXT)


@pytest.fixture(scope="module")
def runs(study: Study, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Dataset]:
    return card_runs.compute(study, Level("pressure", 0.6), tmp_path_factory.mktemp("card"), jobs=1)


def test_a_card_has_the_grid_twice_and_four_times_as_coarse(study: Study) -> None:
    variants = card_runs.variants(study, Level("pressure", 0.6))
    assert [variant.surface.m for variant in variants.values()] == [(7,), (6,), (5,)]
    assert list(variants) == ["finest grid", "spacing × 2", "spacing × 4"]


def test_the_leak_is_that_of_the_state_in_the_unit_of_the_study(runs: dict[str, Dataset]) -> None:
    fine = runs["finest grid"]
    assert_allclose(fine.flux_at_mean_pressure.values, 0.6, rtol=1e-4)
    way = card.card_of(runs, "seal").ways[0]
    stored = (fine.leak_rate_x / (fine.transmissivity_x * fine.free_volume**3)).values
    expected = np.exp(np.log((fine.flux_at_transmissivity_x * fine.flux_at_free_volume**3).values).mean())
    assert_allclose(way.leak, expected * np.nanmean(stored), rtol=1e-9)
    assert way.unit == "mm^3/s"


def _finest(text: str, at: Level, folder: Path) -> card.Card:
    """The card of the finest grid alone."""
    fine = card_runs.variants(loads(text), at)[card_runs.FINE]
    return card.card_of({card_runs.FINE: running.run(fine, jobs=1, out=folder)}, "seal")


def test_the_part_of_the_solver_holds_the_leak_of_an_exact_solution(tmp_path: Path) -> None:
    text = TEXT.replace("seeds: 3", "seeds: 1").replace("m: 7", "m: 6")
    tolerances = ("1.0e-2", "1.0e-8")
    rough, exact = (_finest(text.replace("1.0e-4", rtol), Level("last"), tmp_path / rtol) for rtol in tolerances)
    for one, truth in zip(rough.ways, exact.ways, strict=True):
        part = next(part for part in one.parts if part.name == "solver")
        assert part.factor > 1.0
        assert 1.0 / part.factor <= truth.leak / one.leak <= part.factor


def test_the_part_of_the_grid_covers_the_leak_on_a_finer_one(runs: dict[str, Dataset], tmp_path: Path) -> None:
    finer = _finest(TEXT.replace("m: 7", "m: 8"), Level("pressure", 0.6), tmp_path)
    for here, beyond in zip(card.card_of(runs, "s").ways, finer.ways, strict=True):
        part = next(part for part in here.parts if part.name == "grid")
        assert abs(math.log(beyond.leak / here.leak)) <= math.log(part.factor)


def test_the_window_is_the_interval_over_surfaces(runs: dict[str, Dataset]) -> None:
    values = np.log(card.leaks(runs["finest grid"], "y"))
    part = next(part for part in card.card_of(runs, "s").ways[1].parts if part.name == "window")
    assert_allclose(math.log(part.factor), 4.302653 * values.std(ddof=1) / math.sqrt(3), rtol=1e-6)


VARIED = (
    TEXT.replace("m: 7", "m: 5")
    .replace(", Sq: 0.4 um", "")
    .replace("sweep: {steps: 4, to: {pressure: 1.2}}", "sweep: {steps: 8, to: percolation}")
)


@pytest.fixture(scope="module")
def varied(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Surfaces of different Sq that close at different loads."""
    study = card_runs.variants(loads(VARIED), Level("pressure", 0.6))[card_runs.FINE]
    return running.run(study, jobs=1, out=tmp_path_factory.mktemp("varied"))


def test_surfaces_of_different_sq_have_the_geometric_mean_of_their_leaks(varied: Dataset) -> None:
    assert np.ptp(varied.Sq.values) > 0.1 * varied.Sq.values.mean()
    way = card.card_of({card_runs.FINE: varied}, "seal").ways[1]
    gaps = (varied.flux_at_free_volume.values * varied.Sq.values[..., None] * 1e-6).ravel()  # m
    rates = varied.flux_at_transmissivity_y.values.ravel() * gaps**3 * 1e3 / (12 * 1e-3) * 1e9  # mm³/s
    assert_allclose(way.leak, np.exp(np.log(rates).mean()), rtol=1e-9)
    part = next(part for part in way.parts if part.name == "window")
    spread = math.log(part.factor) * math.sqrt(3) / np.log(rates).std(ddof=1)
    assert_allclose(spread, 4.3027, rtol=1e-4)  # t of two degrees of freedom


def test_a_load_beyond_some_surfaces_is_that_of_the_others(tmp_path: Path) -> None:
    ends = running.run(loads(VARIED), jobs=1, out=tmp_path / "sweep").mean_pressure.max("step").values.ravel()
    text, beyond = VARIED, float(np.sort(ends)[-2:].mean())
    seed = int(np.argsort(ends)[0])
    assert ends[seed] < beyond
    made = _finest(
        text.replace("seeds: 3", f"seeds: [{seed}, {int(np.argmax(ends))}]"), Level("pressure", beyond), tmp_path
    )
    assert ("Surface", "2 generated surfaces, 1 of them pressed to this load") in made.facts


def test_surfaces_that_close_and_that_do_not_are_counted(tmp_path: Path) -> None:
    ends = running.run(loads(VARIED), jobs=1, out=tmp_path / "sweep").mean_pressure.max("step").values.ravel()
    few, many = int(np.argmin(ends)), int(np.argmax(ends))
    load = float(ends[many] + ends[few]) / 2
    text = VARIED.replace("seeds: 3", f"seeds: [{few}, {many}]").replace("to: percolation", f"to: {{pressure: {load}}}")
    closing = [way.closing for way in _finest(text, Level("last"), tmp_path / "card").ways]
    assert any(line.startswith("1 of 2 surfaces between ") and "the others open up to " in line for line in closing)
    text = text.replace(DIMENSIONAL, "heights: true")
    assert "p* = " in _finest(text, Level("last"), tmp_path / "starred").ways[0].closing


def test_a_load_that_no_surface_reaches_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"at pressure=99 is not reached: .* have pressure 0\.\d+ to \d"):
        card_runs.compute(loads(VARIED), Level("pressure", 99.0), tmp_path, jobs=1)


def test_a_periodic_surface_is_certified_with_its_ways_across_the_edge(tmp_path: Path) -> None:
    text = VARIED.replace("seeds: 3", "seeds: [2], periodic: true").replace("to: percolation", "to: {pressure: 3.0}")
    way = _finest(text, Level("last"), tmp_path).ways[0]  # its only way along x passes the edge
    part = next(part for part in way.parts if part.name == "solver")
    assert 1.0 < part.factor < 1.01


def test_parts_add_in_squares_of_their_logarithms() -> None:
    parts = tuple(card.Part(name, factor, "") for name, factor in (("a", 2.0), ("b", 3.0), ("c", math.nan)))
    way = card.Way("x", 1.0, "", "", parts)
    assert_allclose(math.log(way.factor), math.hypot(math.log(2), math.log(3)))
    assert_allclose(way.interval, (1 / way.factor, way.factor))


def test_a_card_of_a_file_has_levelling_and_quadrants_at_one_nominal_pressure(tmp_path: Path) -> None:
    heights = random_midpoint_displacement(2.2, 7, side=100.0, seed=5).heights
    tilted = heights / heights.std() * 0.4 + np.linspace(0, 0.3, 129)
    np.savetxt(tmp_path / "scan.txt", tilted, header="heights in um")
    text = TEXT.replace("{D: 2.2, m: 7, seeds: 3, L: 200 um, Sq: 0.4 um}", "{file: scan.txt, L: 200 um, level: tilt}")
    (tmp_path / "s.yaml").write_text(text)
    study = load(tmp_path / "s.yaml")
    made = card_runs.compute(study, Level("pressure", 0.6), tmp_path / "card", jobs=1)
    assert list(made) == ["finest grid", "spacing × 2", "spacing × 4", "level: quadratic"]
    nominal = [run.flux_at_mean_pressure.item() * run.Sq.item() / run.L.item() for run in made.values()]
    assert_allclose(nominal, nominal[0], rtol=1e-4)
    names = [part.name for part in card.card_of(made, "scan").ways[0].parts]
    assert names == ["solver", "grid", "window", "levelling"]
    page = card_page.write(made, "scan", tmp_path / "out")
    text = page.read_text()
    assert "Leak card: scan" in text
    assert "quadratic" in text
    assert (tmp_path / "out" / "card.pdf").read_bytes().startswith(b"%PDF")
    assert "://" not in text.replace("http://www.w3.org", "")  # one file without links to others


def test_the_lines_for_a_terminal_hold_every_part(runs: dict[str, Dataset]) -> None:
    lines = "\n".join(card_page.lines_of(runs, "seal"))
    for words in ("Load: ", "along x: ", "along y: ", "closes: ", "solver: ", "grid: ", "window: ", "certified"):
        assert words in lines


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("D: 2.2", "D: [2.2, 2.4]", "one D and one m"),
        ("steps: 4, to: {pressure: 1.2}", "steps: 0", "sweep.steps is 0"),
    ],
)
def test_what_is_no_card_is_refused(old: str, new: str, words: str) -> None:
    text = TEXT.replace(old, new).replace("record: {transport: {transmissivity: every-step}, ", "record: {")
    text = text.replace(DIMENSIONAL, "heights: true")
    with pytest.raises(StudyError, match=words):
        card_runs.variants(loads(text), Level("last"))


@pytest.mark.parametrize(
    "text", ["pressure", "pressure=", "load=3", "pressure=nan", "", "pressure=1 um", "contact_area=1 um", "leak_rate=1"]
)
def test_a_load_that_is_none_is_refused(text: str, study: Study) -> None:
    with pytest.raises(StudyError, match=r"allowed: last, or one of|roughvol ask"):
        card_runs.level_of(text, study)


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("pressure=0.02 MPa", "pressure", 1.0),  # p* = p L/(E* Sq)
        ("pressure=20kPa", "pressure", 1.0),
        ("mean_gap=400 nm", "free_volume", 1.0),
        ("separation=0.2 um", "separation", 0.5),
        ("contact_area=0.1", "contact_area", 0.1),
    ],
)
def test_a_load_may_have_a_unit(text: str, kind: str, value: float, study: Study) -> None:
    level = card_runs.level_of(text, study)
    assert level.kind == kind
    assert_allclose(level.value, value, rtol=1e-12)


def test_surfaces_of_different_heights_have_no_common_load_with_a_unit() -> None:
    with pytest.raises(StudyError, match="differ in Sq"):
        card_runs.level_of("pressure=0.02 MPa", loads(TEXT.replace(", Sq: 0.4 um", "")))
