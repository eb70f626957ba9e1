"""Statements judged by ten seeds and by an ensemble."""

import math
from pathlib import Path

import numpy as np
import pytest

from roughvol.analysis.stored_run import Run
from roughvol.ensemble.multilevel import half_width
from roughvol.report.run_facts import facts
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.ensemble_means import HEAD, answers
from roughvol.reproduction.judgement import judge
from roughvol.store import dataset
from roughvol.store.dataset import Dataset
from tests.reproduction import kit

TEXT = """
name: trial
surface: {D: [2.1, 2.9], m: 3}
sweep: {steps: 6, to: {separation: -0.1}}
ensemble: {accuracy: {free_volume: 12 %, contact_area: 0.1}, at: {pressure: 0.1, separation: 0}}
"""


@pytest.fixture(scope="module")
def file(few_samples: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return kit.stored(tmp_path_factory.mktemp("answers"), trial=TEXT)["trial"]


@pytest.fixture(scope="module")
def results(file: Path) -> Dataset:
    return dataset.read(file)


def test_a_statement_is_undecided_where_its_interval_contains_the_limit(results: Dataset) -> None:
    (found,) = answers([ClaimRun.of("trial", results)])
    rows = {row[0]: row for row in found.rows}
    assert all(len(row) == len(HEAD) for row in found.rows)
    row = rows["V* at d/σ = 0 grows from D = 2.1 to 2.9"]
    state = results.sel(ensemble_at="separation=0")
    low, high = (float(state.free_volume_mean.sel(D=D)) for D in (2.1, 2.9))
    assert math.isclose(float(row[1]), high - low, rel_tol=1e-3)
    for span, verdict in ((row[2], row[3]), (row[4], row[5])):
        ends = [float(end) for end in span.split(" to ")]
        assert verdict == ("holds" if ends[0] > 0.0 else "does not hold" if ends[1] <= 0.0 else "undecided")
    assert found.changed == sum(row[3] != row[5] for row in found.rows)


def test_the_exponent_of_the_area_is_that_of_its_last_levels(results: Dataset) -> None:
    (found,) = answers([ClaimRun.of("trial", results)])
    (row,) = [row for row in found.rows if row[0].startswith("n > 0") and row[0].endswith("D = 2.9")]
    means = results.contact_area_fraction_level_mean.sel(D=2.9, ensemble_at="pressure=0.1").values
    assert math.isclose(float(row[1]), math.log2(means[-2] / means[-1]), rel_tol=1e-3)


@pytest.mark.parametrize("known", [True, False])
def test_ten_common_seeds_scatter_about_the_ratio_of_two_levels(results: Dataset, known: bool) -> None:
    """A slope that is not known, as without scatter of a level, counts as 0."""
    coarse, noise = np.random.default_rng(1).standard_normal((2, 100_000))
    coarse, fine = 0.2 + 0.05 * coarse, 0.1 + 0.01 * coarse + 0.005 * noise
    related = np.corrcoef(coarse, fine)[0, 1]
    step = np.std(fine - fine.mean() / coarse.mean() * coarse) if known else math.hypot(0.005, 0.5 * 0.05)
    changed = results.copy(deep=True)
    levels = {"mean": (0.2, 0.1), "variance": (coarse.var(), fine.var())}
    levels |= {
        "correlation": (np.nan, related if known else np.nan),
        "residual": (np.nan, (1 - related**2) * fine.var()),
    }
    for name, values in levels.items():
        variable = changed[f"contact_area_fraction_level_{name}"].transpose("m", ...)
        variable[-2:] = np.reshape(values, (2, 1, 1))
    changed["ensemble_samples"].transpose("m", ...)[-2:] = np.reshape((100, 20), (2, 1))
    (found,) = answers([ClaimRun.of("trial", changed)])
    (row,) = [row for row in found.rows if row[0].startswith("n > 0") and row[0].endswith("D = 2.9")]
    apart = (0.5 - 0.2 * known) * 0.05  # slopes
    of_levels = math.hypot(half_width(0.005, 20), half_width(apart, 100))
    for interval, wanted in ((row[2], half_width(float(step), 10)), (row[4], of_levels)):
        low, high = map(float, interval.split(" to "))
        assert math.isclose(0.5 * (high - low), wanted / (0.1 * math.log(2.0)), rel_tol=0.01)


def test_the_report_has_every_sentence_of_an_ensemble(results: Dataset) -> None:
    lines = results.answer.splitlines()
    remarks = ["the error between steps of free_volume: take more sweep.steps", "stopped by the budget of 1 s"]
    found = facts(Run.of("trial", results.assign_attrs(answer="\n".join([*lines, *remarks]))))
    loading = dict(found.loading)
    assert lines[-1] == "6 steps a sweep; the errors between them are those of 8 trial surfaces with more steps"
    assert loading["Ensemble"] == "; ".join([lines[-1], *remarks])
    assert all(loading[line.split(": ")[0]] == line.split(": ", 1)[1] for line in lines[:-1])
    assert "Ensemble" not in dict(facts(Run.of("seeds", results.assign_attrs(answer=""))).loading)


def test_a_run_of_seeds_has_no_such_section(results: Dataset) -> None:
    assert not list(answers([ClaimRun.of("seeds", results.drop_vars("ensemble_samples"))]))


def test_the_page_of_an_ensemble_has_the_section(file: Path) -> None:
    page = kit.to_html(judge([file]))
    assert "Ten seeds and the ensemble (" in page
    assert "verdicts change when ten seeds become the ensemble" in page


def test_a_state_with_a_unit_has_no_star(results: Dataset) -> None:
    with_unit = results.assign_coords(ensemble_at=["pressure=0.1 MPa", "separation=5 nm"])
    (found,) = answers([ClaimRun.of("trial", with_unit)])
    statements = [str(row[0]) for row in found.rows]
    assert "V* at d = 5 nm grows from D = 2.1 to 2.9" in statements
    assert any("at p = 0.1 MPa, D = 2.1" in statement for statement in statements)
    assert not any("p* = " in statement for statement in statements)
