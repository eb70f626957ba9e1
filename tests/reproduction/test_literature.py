"""Rows of the literature: every judge tells data that hold from data that do not, and a page shows every row."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.errors import ContactError
from roughvol.report import page
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims import assess
from roughvol.reproduction.claims import statistics as stats
from roughvol.reproduction.claims.evidence import Evidence
from roughvol.reproduction.claims.verdict import ABSENT, FAILS, HOLDS, QUALIFIED, Check, Claim, Number
from roughvol.reproduction.closed_forms import westergaard
from roughvol.reproduction.formulas import area_of_pressure, persson_area, westergaard_mean_gap
from roughvol.reproduction.judgement import Judgement, judge
from roughvol.reproduction.literature import LITERATURE
from roughvol.reproduction.literature import given_surfaces as given
from roughvol.reproduction.literature import random_surfaces as rough
from roughvol.reproduction.literature.published import judged
from roughvol.reproduction.needs import Files, Rolled
from roughvol.store import dataset
from roughvol.study import loads
from tests.bench import framework_surface
from tests.reproduction import kit

CONFIGS = Path(__file__).parents[2] / "configs" / "literature"
RANDOM = np.random.default_rng(7)


def _verdict(checks: list[Check] | Check) -> str:
    checks = checks if isinstance(checks, list) else [checks]
    return Claim(1, "", "", "", checks=tuple(checks)).verdict


def _scattered(value: float, scatter: float = 1e-3, n: int = 10) -> np.ndarray:
    return value + scatter * RANDOM.standard_normal(n)


# judges


def _judged(id: int, value: float, key: str) -> str:
    return _verdict(judged(id, stats.mean(key, "", _scattered(value, 1e-7))))


@pytest.mark.parametrize(
    ("id", "key", "true", "false"),
    [
        (1, "elements_love", 1.0, 3.0),
        (2, "gap_love_1024", 1e-6, 1e-2),
        (3, "order_love", 2.1, 1.0),
        (3, "order_punch", 1.1, 2.0),
        (4, "corrected_16", 2.2, 1.6),
        (4, "corrected_16", 2.2, 2.6),
        (6, "closing", 0.42, 0.45),
        (6, "closing", 0.41, 0.37),
        (7, "closing", 0.41, 0.46),
        (8, "exponent", 1.05, 1.2),
        (8, "exponent", 0.95, 0.8),
        (10, "R2", 0.998, 0.95),
        (11, "difference", 0.02, 0.05),
        (17, "kappa", 2.2, 1.5),
        (17, "slope", 0.99, 0.8),
    ],
)
def test_a_criterion_tells_true_from_false(id: int, key: str, true: float, false: float) -> None:
    assert _judged(id, true, key) == HOLDS
    assert _judged(id, false, key) == FAILS


def test_a_criterion_that_is_not_essential_qualifies() -> None:
    good = stats.mean("R2", "", _scattered(0.998, 1e-4))
    assert _verdict(judged(10, good, stats.mean("length", "", _scattered(0.5)))) == HOLDS
    assert _verdict(judged(10, good, stats.mean("length", "", _scattered(0.8)))) == QUALIFIED


def test_scatter_that_contains_a_limit_decides_nothing() -> None:
    wide = Number("closing", "", 0.415, 0.3, 0.5, 5)
    kappa = stats.mean("corrected_16", "", _scattered(2.2))
    assert _verdict(judged(6, wide)) == ABSENT
    assert _verdict([*judged(4, kappa), *judged(6, wide)]) == QUALIFIED


def test_a_correction_must_be_three_times_nearer() -> None:
    assert _verdict(rough.judged_correction(8.0, _scattered(0.06), _scattered(0.005))) == HOLDS
    assert _verdict(rough.judged_correction(8.0, _scattered(0.12), _scattered(0.035))) == QUALIFIED  # more than 2 %
    assert _verdict(rough.judged_correction(8.0, _scattered(0.06), _scattered(0.04))) == FAILS
    assert _verdict(rough.judged_correction(8.0, _scattered(0.06), _scattered(-0.06))) == FAILS
    assert _verdict(rough.judged_correction(8.0, _scattered(-0.06), _scattered(0.0))) == FAILS


def test_exponents_of_fractals_follow_the_line() -> None:
    line = {D: _scattered(0.51 + 0.26 * (D - 2.0)) for D in (2.1, 2.5, 2.9)}
    assert _verdict(rough.judged_fractals(line)) == HOLDS
    assert _verdict(rough.judged_fractals({D: _scattered(0.6) for D in line})) != HOLDS
    assert _verdict(rough.judged_fractals(dict(zip(line, reversed(line.values()), strict=True)))) == FAILS
    assert _verdict(rough.judged_fractals({D: values + 0.3 for D, values in line.items()})) == FAILS
    off = {2.1: _scattered(0.62), 2.5: _scattered(0.64), 2.9: _scattered(0.66)}
    assert _verdict(rough.judged_fractals(off)) == QUALIFIED


def _solved(**changed: float) -> list[np.ndarray]:
    """Return states 0.1 % around each pressure that two codes have solved, with laws smooth in the pressure."""
    solved = np.array(given.SOLVED)
    p, area, gap, largest = (np.repeat(column, 3) for column in solved.T)
    shift = np.tile([0.999, 1.0 + 1e-6, 1.001], len(solved))
    states = {"pressure": p * shift, "area": area, "gap": gap * shift**-0.6, "largest": largest * shift**0.3}
    return [states[name] * changed.get(name, 1.0) for name in states]


def test_two_codes_are_met_to_their_digits() -> None:
    assert _verdict(judged(12, *given.differences(*_solved()))) == HOLDS
    for name, factor in (("area", 1.001), ("gap", 1.0 + 1e-7), ("largest", 1.0 - 1e-7)):
        assert _verdict(judged(12, *given.differences(*_solved(**{name: factor})))) == FAILS


def test_a_framework_case_needs_its_iteration_area_and_pressure() -> None:
    published = given.FRAMEWORK["sup2"]
    pressure = published.pressure * np.array([0.9, 0.97, 0.995, 1.0])
    rule = published.Delta + np.append(0.0, pressure[:-1]) * given.WHOLE * published.alpha / given.MODULUS

    def verdict(indentation=rule, p=pressure, area=published.area) -> str:
        return _verdict(given.judged_framework(published, indentation, p, area))

    assert verdict() == HOLDS
    assert verdict(indentation=rule * (1 + 1e-6)) == FAILS
    assert verdict(p=pressure * (1 + 1e-7)) == FAILS
    assert verdict(area=published.area + 0.04) == FAILS
    assert _verdict(given.judged_framework(published, rule[:2], pressure[:2], published.area)) == FAILS


# what rows are made of


def test_closing_lies_between_the_last_open_state_and_the_next() -> None:
    area = np.array([[0.3, 0.4, 0.5, 0.6]] * 3)
    ways = np.array([[1, 1, 0, 0], [1, 0, 1, 0], [1, 1, 1, 1]])
    assert_allclose(rough.closing_areas(area, ways), [0.45, 0.55, np.nan])


def test_exponents_are_those_of_the_states_in_the_range() -> None:
    p = np.geomspace(0.01, 10.0, 40)[np.newaxis]
    d = -np.where(p < 1.0, np.log(p), 2.0 * np.sqrt(p) - 2.0)  # K = p below 1, √p beyond
    assert_allclose(rough.exponents_of_stiffness(p, d, p < 0.8), 1.0, atol=1e-3)
    assert_allclose(rough.exponents_of_stiffness(p, d, p > 1.5), 0.5, atol=2e-2)


def test_the_error_function_has_both_factors() -> None:
    p = np.linspace(0.0, 2.0, 9)
    assert_allclose(area_of_pressure(p, 0.7, rough.PERSSON), persson_area(p, 0.7, Sq=2.0, side=2.0), rtol=1e-12)
    assert_allclose(area_of_pressure(1e-6, 0.5), 2.0 * 1e-6 / 0.5, rtol=1e-6)
    assert rough.largest_error(area_of_pressure(p, 1.0)[np.newaxis], p[np.newaxis], 2.0) == 0.0


@pytest.mark.parametrize("ratio", [0.05, 0.25, 0.45, 0.5])
def test_the_mean_gap_of_a_wave_is_the_mean_of_its_gaps(ratio: float) -> None:
    x = (np.arange(200_000) + 0.5) / 200_000
    assert float(westergaard_mean_gap(ratio)) == pytest.approx(westergaard(x, ratio, 0.5, 1.0).gap.mean(), abs=1e-9)
    with pytest.raises(ContactError, match="a/λ"):
        westergaard_mean_gap(0.0)


# studies


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_study_of_the_literature_has_the_name_of_its_file(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    study = loads(text, file=str(path), stored=True)
    assert study.name == path.stem
    assert text.startswith("# ")


def test_shipped_waves_are_waves() -> None:
    paths = sorted((CONFIGS / "waves").glob("*.npy"))
    assert tuple(path.name for path in paths) == given.WAVES
    for path in paths:
        heights = np.load(path)
        n = len(heights)
        exact = 0.01 * np.cos(2.0 * np.pi * np.arange(n) / n)
        assert_allclose(heights, np.repeat(exact[:, None], 5, axis=1), atol=1e-17)


def test_every_row_argues_its_criterion() -> None:
    assert sorted(LITERATURE) == list(range(1, 18))
    for row in assess(Evidence(()), LITERATURE):
        assert row.verdict == ABSENT
        assert row.lacking
        assert row.place
        assert row.sentence
        assert "Essential" in row.method


ROUGH = """
name: rough
surface: {H: 0.8, rolloff: 2, cut: 4, n: [8, 16, 32], L: 1.0, slope: 0.1, sides: periodic, seeds: 2}
sweep: {contact_areas: [0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.8]}
solver: {kernel: fourier}
record: {psd: true, contact_perimeter: true, transport: {percolation: every-step}}
"""
FREE = """
name: free
surface: {D: [2.1, 2.9], m: 4, seeds: 2}
sweep: {pressures: [0.01, 0.02, 0.05, 0.1, 0.2]}
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return stored runs: small random surfaces, and the published case that names a seed."""
    folder = tmp_path_factory.mktemp("literature")
    (folder / "files").mkdir()
    np.save(folder / "files" / "mirco_seed95.npy", framework_surface.surface())
    mirco = (CONFIGS / "literature_mirco_sup7.yaml").read_text(encoding="utf-8")
    return kit.stored(folder, rough=ROUGH, free=FREE, mirco=mirco)


@pytest.fixture(scope="module")
def report(runs: dict[str, Path]) -> Judgement:
    return judge(list(runs.values()), any_size=True)


def test_small_runs_answer_the_rows_where_size_does_not_count(report: Judgement) -> None:
    rows = {row.id: row for row in report.literature}
    assert rows[16].verdict == HOLDS  # the published case is met in full
    for id in (4, 5, 8, 9, 10, 11):
        assert rows[id].source
        assert all(math.isfinite(check.number.value) for check in rows[id].checks if check.number)
    assert "challenge.dat" in rows[17].why


def test_small_runs_are_refused_with_a_reason(runs: dict[str, Path]) -> None:
    stored = [ClaimRun.of(name, dataset.read(path)) for name, path in runs.items()]
    rows = {row.id: row for row in assess(stored, LITERATURE)}
    assert {row.id for row in rows.values() if row.verdict != ABSENT} == {16}
    assert "L/λ_r = 2, needs 16" in dict(rows[6].refused)["rough"]
    assert "λ_s/δ = 2, 4, 8, needs 2, 4, 8, 16" in dict(rows[4].refused)["rough"]
    assert dict(rows[6].refused)["free"] == "no surfaces with a spectrum"


def test_needs_see_what_a_run_is(runs: dict[str, Path]) -> None:
    run = ClaimRun.of("rough", dataset.read(runs["rough"]))
    assert Rolled().unfit(run) == ()
    assert Rolled(area=(0.1, 0.8)).unfit(run) == ()
    assert Rolled(area=(0.1, 0.9)).unfit(run) == ("needs steps from A* = 0.1 to 0.9",)
    assert Rolled(("critical_gap",)).unfit(run) == ("no h_c,i/σ recorded",)
    fewer = dataclasses.replace(run, dataset=run.dataset.isel(seed=[0]))
    assert Rolled(seeds=2).unfit(fewer) == ("1 surface of D = 2.2, m = 3 computed, needs 2",)


def test_needs_see_what_is_pressed_and_observed(runs: dict[str, Path]) -> None:
    results, needs = dataset.read(runs["rough"]), Rolled()

    def unfit(change: str) -> str:
        study = loads(str(results.attrs["study"]), stored=True, changes=[change]).to_yaml()
        return "; ".join(needs.unfit(ClaimRun.of("rough", results.assign_attrs(study=study))))

    assert unfit("comment=the same") == ""
    assert unfit("record.region=interior").endswith("needs the whole surface")
    assert unfit("material={E: 1, nu: 0.3, thickness: 10}") == "presses a layer, needs a half space"


def test_a_file_is_pressed_elastically_in_one_sweep(runs: dict[str, Path]) -> None:
    results = dataset.read(runs["mirco"])
    needs = Files(names=tuple(map(str, results["case"].values)), sides="free")
    assert needs.unfit(ClaimRun.of("mirco", results)) == ()
    yields = results.assign(plastic_volume=0.0 * results.free_volume)
    assert needs.unfit(ClaimRun.of("mirco", yields)) == ("pressures end at a hardness, needs elastic contact",)


def test_another_surface_under_the_name_fails(runs: dict[str, Path]) -> None:
    run = ClaimRun.of("mirco", dataset.read(runs["mirco"]))
    pressure = run.dataset["mean_pressure"] * (1.0 + 1e-6)
    changed = dataclasses.replace(run, dataset=run.dataset.assign(mean_pressure=pressure))
    rows = {row.id: row for row in assess([changed], LITERATURE)}
    assert rows[16].verdict == FAILS


def test_the_page_has_every_row(report: Judgement) -> None:
    html, markdown = kit.to_html(report), kit.to_markdown(report)
    for row in report.literature:
        assert row.title in markdown
        assert f"<td class='n'>{row.id}</td>" in html
        assert (f"id='literature-{row.id}'" in html) == (row.verdict != ABSENT)
    assert "challenge.dat" in html
    assert "17 numbers of the literature" in page.summary(kit.bare(report))


def test_a_page_of_the_literature_alone_asks_about_it(runs: dict[str, Path]) -> None:
    html = kit.to_html(judge([runs["mirco"]]))
    assert "Do the published numbers hold?" in html
    assert "Verdicts</h2>" not in html
    assert "<section id='run-1'" not in html


def test_runs_of_ones_own_keep_their_section(runs: dict[str, Path]) -> None:
    alone = judge([runs["rough"]])
    assert [run.name for run in alone.own] == ["rough"]
    assert alone.literature == ()
    assert "Numbers of the literature" not in kit.to_html(alone)
