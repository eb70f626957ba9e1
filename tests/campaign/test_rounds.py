"""Ensembles in a folder: answers by stored numbers alone, whoever computes and whatever interrupts."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

from roughvol.analysis.stored_run import Run
from roughvol.campaign.batch import Progress
from roughvol.campaign.collected import collect
from roughvol.campaign.running import run
from roughvol.cli import main
from roughvol.errors import CampaignError
from roughvol.report.run_facts import facts
from roughvol.store import dataset
from roughvol.store.run_status import status
from roughvol.study import loads

TEXT = """
name: mean
surface: {D: 2.3, m: 4}
ensemble: {accuracy: {free_volume: 8 %}, at: {pressure: [0.1, 0.3]}}
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ensemble")
    run(loads(TEXT), out=folder, jobs=1)
    return folder


def test_the_answer_is_stored_beside_its_cases(finished: Path) -> None:
    results = dataset.read(finished / "study.nc")
    mean, interval = results.free_volume_mean, results.free_volume_interval
    assert mean.dims == ("D", "ensemble_at")
    assert interval.dims == ("D", "ensemble_at", "bound")
    assert results.ensemble_at.values.tolist() == ["pressure=0.1", "pressure=0.3"]
    assert results.bound.values.tolist() == ["lower", "upper"]
    assert bool((interval.sel(bound="lower") < mean).all() and (mean < interval.sel(bound="upper")).all())
    assert_allclose(0.5 * (interval.sel(bound="upper") + interval.sel(bound="lower")), mean)
    assert results.free_volume_bias.dims == ("D", "ensemble_at")
    counted = results.residual.notnull().any("step").sum("seed")
    assert_allclose(results.ensemble_samples, counted)
    assert all(results[name].attrs["units"] for name in results.data_vars)
    answer = results.attrs["answer"]
    assert "mean V* at pressure = 0.1, D = 2.3, m = 4" in answer
    assert CliRunner().invoke(main, ["show", str(finished)]).stdout.endswith(f"{answer}\n")
    loading = facts(Run.of("finished", results)).loading
    assert answer.splitlines()[0] in [f"{name}: {text}" for name, text in loading]


def test_no_number_depends_on_the_processes_or_on_an_interruption(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished / "cases", tmp_path / "two" / "cases")
    for number, path in enumerate(sorted((tmp_path / "two" / "cases").glob("*.nc"))):
        if number % 3 == 0:
            path.unlink()
    run(loads(TEXT), out=tmp_path / "two", jobs=2)
    one, two = (dataset.answers(dataset.read(folder / "study.nc")) for folder in (finished, tmp_path / "two"))
    assert one.identical(two)
    assert (
        dataset.read(finished / "study.nc").attrs["answer"]
        == dataset.read(tmp_path / "two" / "study.nc").attrs["answer"]
    )


def test_a_finished_ensemble_is_found_finished(finished: Path) -> None:
    told: list[Progress] = []
    before = (finished / "study.nc").read_bytes()
    run(loads(TEXT), out=finished, on_event=told.append)
    assert (finished / "study.nc").read_bytes() == before
    assert "V* at D = 2.3 ±" in told[-1].interval
    state = status(loads(TEXT), finished)
    assert not state.missing
    assert state.strange == 0
    assert state.collected
    assert collect(loads(TEXT), finished).free_volume.notnull().any("step").sum() == len(state.done)


def test_a_finished_ensemble_is_collected_with_its_answer(finished: Path, tmp_path: Path) -> None:
    stored = dataset.read(finished / "study.nc")
    assert dataset.answers(collect(loads(TEXT), finished)).identical(dataset.answers(stored))
    shutil.copytree(finished / "cases", tmp_path / "cases")
    shutil.copy(finished / "ensemble.json", tmp_path)
    from_cases = collect(loads(TEXT), tmp_path)
    assert not (tmp_path / "study.nc").exists()
    assert from_cases.attrs["answer"] == stored.attrs["answer"]
    assert_allclose(from_cases.free_volume_mean, stored.free_volume_mean)


def test_an_unfinished_ensemble_is_collected_without_an_answer(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished / "cases", tmp_path / "cases")
    shutil.copy(finished / "ensemble.json", tmp_path)
    last = sorted((tmp_path / "cases").glob("*_m2_*.nc"))[-1]
    last.unlink()
    results = collect(loads(TEXT), tmp_path)
    assert "free_volume_mean" not in results
    assert "no answer yet: 1 of " in results.attrs["answer"]
    assert results.free_volume.notnull().any("step").sum() == len(list((tmp_path / "cases").glob("*.nc")))


@pytest.mark.parametrize("level", ["²", "٣x", "-1", "1" * 5000, ""])
def test_a_plan_with_a_level_that_is_no_number_is_read_without_it(finished: Path, tmp_path: Path, level: str) -> None:
    shutil.copytree(finished, tmp_path / "run")
    plan = json.loads((finished / "ensemble.json").read_text(encoding="utf-8"))
    plan["2.3"][level] = 3
    (tmp_path / "run" / "ensemble.json").write_text(json.dumps(plan), encoding="utf-8")
    assert status(loads(TEXT), tmp_path / "run").done == status(loads(TEXT), finished).done


def test_fresh_computes_every_sample_again(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished, tmp_path / "run")
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "run" / "cases").glob("*.nc")}
    results = run(loads(TEXT), out=tmp_path / "run", jobs=1, fresh=True)
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "run" / "cases").glob("*.nc")}
    assert after.keys() == before.keys()
    assert all(after[name] > before[name] for name in after)
    assert dataset.answers(results).identical(dataset.answers(dataset.read(finished / "study.nc")))


@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_cluster_gives_the_same_answer(finished: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'roughvol[cluster]'")
    local = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0", protocol="tcp"
    )
    with local as cluster:
        results = run(loads(TEXT), out=tmp_path, scheduler=cluster.scheduler_address)
    stored = dataset.read(finished / "study.nc")
    assert dataset.answers(results).identical(dataset.answers(stored))
    assert results.attrs["answer"] == stored.attrs["answer"]


def test_figures_cannot_choose_the_cases_of_an_ensemble(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="an ensemble decides itself"):
        run(loads(TEXT), out=tmp_path, only=["x"])
