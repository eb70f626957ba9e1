"""Ensembles in a folder: answers by stored numbers alone, whoever computes and whatever interrupts."""

import json
import shutil
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from roughvol.analysis.stored_run import Run
from roughvol.campaign import rounds
from roughvol.campaign.execution import collect, run
from roughvol.errors import CampaignError
from roughvol.report.run_facts import facts
from roughvol.store import dataset
from roughvol.store.run_status import status
from roughvol.study import loads
from tests.campaign.kit import Events, files_of, values_of
from tests.kit import said

TEXT = """
name: mean
surface: {D: 2.3, m: 2}
sweep: {pressures: [0.1, 0.3]}
ensemble: {accuracy: {free_volume: 20 %}, at: {pressure: [0.1, 0.3]}}
"""
STUDY = loads(TEXT)


pytestmark = pytest.mark.usefixtures("few_samples")


@pytest.fixture(scope="module")
def seen() -> Events:
    """The progress of the run."""
    return Events()


@pytest.fixture(scope="module")
def finished(few_samples: None, seen: Events, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ensemble")
    run(STUDY, out=folder, jobs=1, on_event=seen)
    return folder


@pytest.fixture
def cases(finished: Path, tmp_path: Path) -> Path:
    """A folder with the cases and the plan of a finished ensemble, without its dataset."""
    shutil.copytree(finished / "cases", tmp_path / "cases")
    shutil.copy(finished / "ensemble.json", tmp_path)
    return tmp_path


@pytest.mark.usefixtures("finished")
def test_the_work_of_earlier_rounds_is_done(seen: Events) -> None:
    assert sum(now.event.endswith("samples") for now in seen) > 1
    first = next(k for k, now in enumerate(seen) if now.event.endswith("samples"))
    assert min(now.work for now in seen[first:]) > 0.0


def test_the_answer_is_stored_beside_its_cases(finished: Path) -> None:
    results = dataset.read(finished / "study.nc")
    mean, interval = results.free_volume_mean, results.free_volume_interval
    assert (mean.dims, interval.dims) == (("D", "ensemble_at"), ("D", "ensemble_at", "bound"))
    assert results.ensemble_at.values.tolist() == ["pressure=0.1", "pressure=0.3"]
    lower, upper = interval.sel(bound="lower"), interval.sel(bound="upper")
    assert bool((lower < mean).all() and (mean < upper).all())
    assert_allclose(0.5 * (upper + lower), mean)
    assert results.free_volume_bias.dims == ("D", "ensemble_at")
    assert_allclose(results.ensemble_samples, results.residual.notnull().any("step").sum("seed"))
    assert all(results[name].attrs["units"] for name in results.data_vars)
    answer = results.attrs["answer"]
    assert "mean V* at pressure = 0.1, D = 2.3, m = 2" in answer
    assert said("show", finished).endswith(f"{answer}\n")
    loading = facts(Run.of("finished", results)).loading
    assert answer.splitlines()[0] in [f"{name}: {text}" for name, text in loading]


@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_workers_change_no_number(finished: Path, cases: Path, scheduler: str) -> None:
    later = list((cases / "cases").glob("*_s00[89]-*.nc"))  # the first round has seeds 0 to 7
    for path in later:
        path.unlink()
    assert later
    events = Events()
    run(STUDY, out=cases, on_event=events, scheduler=scheduler)
    assert values_of(cases).identical(values_of(finished))
    answers = [dataset.read(folder / "study.nc").attrs["answer"] for folder in (cases, finished)]
    assert answers[0] == answers[1]
    assert "V* at D = 2.3 ±" in events[-1].interval


def test_a_finished_ensemble_is_found_finished_and_collected(
    finished: Path, cases: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events, before = Events(), (finished / "study.nc").read_bytes()
    with monkeypatch.context() as patched:
        patched.setattr(rounds, "Design", None)  # nothing is estimated or solved again
        run(STUDY, out=finished, on_event=events)
    assert (finished / "study.nc").read_bytes() == before
    samples = len(files_of(finished))
    assert (events[-1].cases, events[-1].kept, events[-1].work) == (samples, samples, 1.0)
    state, stored = status(STUDY, finished), dataset.read(finished / "study.nc")
    assert (state.missing, state.strange, state.collected) == ((), 0, True)
    assert values_of(collect(STUDY, finished)).identical(values_of(stored))
    from_cases = collect(STUDY, cases)
    assert not (cases / "study.nc").exists()
    assert from_cases.attrs["answer"] == stored.attrs["answer"]
    assert_allclose(from_cases.free_volume_mean, stored.free_volume_mean)


def test_an_answer_that_a_budget_ended_is_collected_as_stored(tmp_path: Path) -> None:
    study = loads(TEXT.replace("20 %", "0.1 %").replace("ensemble: {", "ensemble: {budget: 0.001 s, "))
    answer = run(study, out=tmp_path, jobs=1).attrs["answer"]
    assert "budget of 0.001 s" in answer
    assert collect(study, tmp_path).attrs["answer"] == answer


def test_an_unfinished_ensemble_is_collected_without_an_answer(cases: Path) -> None:
    sorted((cases / "cases").glob("*_m1_*.nc"))[-1].unlink()
    results = collect(STUDY, cases)
    assert "free_volume_mean" not in results
    assert "no answer yet: 1 of " in results.attrs["answer"]
    assert results.free_volume.notnull().any("step").sum() == len(files_of(cases))


def test_a_plan_that_makes_no_sense_is_read_without_it(finished: Path, cases: Path) -> None:
    plan = json.loads((cases / "ensemble.json").read_text(encoding="utf-8"))["2.3"]
    more = dict.fromkeys(("²", "-1", "1" * 5000, ""), 3)
    for changed, found in ((plan | more, files_of(cases)), *((one, [1]) for one in ({"3": "x"}, {"3": 0}, [1], None))):
        (cases / "ensemble.json").write_text(json.dumps({"2.3": changed}), encoding="utf-8")
        assert len(status(STUDY, cases).done) == len(found), changed


def test_figures_cannot_choose_the_cases_of_an_ensemble(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="an ensemble decides itself"):
        run(STUDY, out=tmp_path, only=["x"])
