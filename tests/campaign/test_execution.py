"""The run of a study: a study is its cases, whoever computes them, and whatever interrupted or preceded them."""

import itertools
import os
import random
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from roughvol.campaign import batch, cost, workers
from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.execution import collect, run
from roughvol.campaign.one_case import run_case
from roughvol.errors import CampaignError, DatasetError, FolderError, RoughvolError
from roughvol.store import checkpoint, dataset, lock
from roughvol.store.run_folder import checkpoint_file
from roughvol.store.run_status import status
from roughvol.study import Study, loads
from tests.bench import scale
from tests.campaign.kit import OF_DASK, Events, at_work, command, files_of, noise, values_of

pytestmark = OF_DASK

TEXT = """
name: tiny
surface: {D: [2.2, 2.7], m: [2, 3], seeds: 2, L: 10.0}
sweep: {steps: 6, to: mean-plane}
record:
  heights: true
  fields_at: {step: 3}
  box_counting: {at: last}
  volume_density: {bins: 9}
"""
FEW = "name: few\nsurface: {D: 2.3, m: 3, seeds: 4}\nsweep: {steps: 3}\n"
# Long enough to be killed in the midst of, short enough to be finished afterwards.
LONG = "name: long\nsurface: {D: 2.5, m: 5, seeds: 16}\nsweep: {steps: 60}\n"


@pytest.fixture(scope="module")
def study() -> Study:
    return loads(TEXT)


@pytest.fixture(scope="module")
def finished(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    run(study, out=folder)
    return folder


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    """A finished run to be spoilt."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


@pytest.fixture(params=["here", "cluster"])
def place(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Where a run computes, as options of `run`."""
    return {"jobs": 1} if request.param == "here" else {"scheduler": request.getfixturevalue("scheduler")}


# Who computes


def test_the_place_changes_no_bit_and_no_progress(
    place: dict[str, Any], study: Study, finished: Path, tmp_path: Path
) -> None:
    events = Events()
    results = run(study, out=tmp_path, on_event=events, **place)
    xr.testing.assert_identical(values_of(results), values_of(finished))
    case = study.cases()[-1]
    alone = results.sel(D=[case.D], m=[case.m], seed=[case.seed])
    xr.testing.assert_identical(values_of(alone), values_of(run_case(case)).reindex_like(alone))
    for name in ("done", "steps_done", "work"):
        values = [getattr(event, name) for event in events]
        assert values == sorted(values)
    assert (events[-1].done, events[-1].steps_done, events[-1].work) == (8, 48, 1.0)
    assert sum(bool(event.event) for event in events) == 8


def test_a_stopped_run_is_finished_later(place: dict[str, Any], study: Study, finished: Path, tmp_path: Path) -> None:
    events = Events()
    with pytest.raises(KeyboardInterrupt):
        run(study, out=tmp_path, on_event=events, stopping=lambda: bool(events) and events[-1].done >= 2, **place)
    before = files_of(tmp_path)
    assert 2 <= len(before) < 8
    assert (status(study, tmp_path).damaged, status(study, tmp_path).failed) == ({}, {})
    again = run(study, out=tmp_path, jobs=1)
    assert before.items() <= files_of(tmp_path).items()
    assert not list(tmp_path.rglob(".*"))
    xr.testing.assert_identical(values_of(again), values_of(finished))


def test_a_failing_case_is_named_and_costs_no_other(place: dict[str, Any], tmp_path: Path) -> None:
    surfaces = [surface_of(case) for case in loads(FEW).cases()]
    peaks = [(surface.z_max - surface.mean_height) / surface.Sq for surface in surfaces]
    between = float(np.median(peaks))  # two surfaces are lower than the end of this sweep
    study = loads(f"{FEW[: FEW.index('sweep')]}sweep: {{steps: 2, to: {{separation: {between}}}}}")
    events = Events()
    with pytest.raises(CampaignError, match="2 of 4 cases failed; the others are kept") as caught:
        run(study, out=tmp_path, on_event=events, **place)
    failing = [case for case, peak in zip(study.cases(), peaks, strict=True) if peak < between]
    assert all(case.id in str(caught.value) for case in failing)
    assert isinstance(caught.value.__cause__, ExceptionGroup)
    assert (events[-1].done, events[-1].failed, len(files_of(tmp_path))) == (2, 2, 2)
    assert not (tmp_path / "study.nc").exists()
    assert set(status(study, tmp_path).failed) == {case.id for case in failing}
    assert collect(study, tmp_path).sizes["seed"] == 2


def test_a_callback_that_raises_ends_the_run(place: dict[str, Any], study: Study, tmp_path: Path) -> None:
    def stop(progress: batch.Progress) -> None:
        if progress.done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(study, out=tmp_path, on_event=stop, **place)
    assert 1 <= len(files_of(tmp_path)) < 8
    assert not list((tmp_path / "cases").glob(".*"))


@pytest.mark.parametrize(
    ("jobs", "short", "small", "expected"),
    [
        (1, 0.0, 0.25, True),
        (None, 3.0, 0.25, True),
        (None, 0.0, 0.25, False),
        (2, 3.0, 0.25, False),
        (1, 3.0, 0.0, True),
    ],
)
def test_one_job_and_short_runs_are_computed_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jobs: int | None, short: float, small: float, expected: bool
) -> None:
    monkeypatch.setattr(batch, "SHORT", short)
    monkeypatch.setattr(batch, "SMALL", small)
    monkeypatch.setattr(batch.machine, "cores", lambda: 4)
    told = []
    monkeypatch.setattr(workers, "each", lambda *_, here, **__: told.append(here))
    with pytest.raises(KeyboardInterrupt):  # nothing is computed
        run(loads(FEW), out=tmp_path, jobs=jobs)
    assert told == [expected]


def test_cores_left_over_by_memory_work_in_convolutions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "limited", lambda *_: (1, "memory for one process"))
    given = []
    monkeypatch.setattr(
        workers, "each", lambda work, tasks, *, jobs, **_: given.append((jobs, tasks[0].context.threads))
    )
    with pytest.raises(KeyboardInterrupt):
        run(loads(FEW), out=tmp_path, jobs=4)
    assert given == [(1, 4)]


# Which cases


def test_a_run_has_every_case_and_its_provenance(study: Study, finished: Path) -> None:
    with xr.open_dataset(finished / "study.nc") as results:
        assert results.free_volume.sizes == {"D": 2, "m": 2, "seed": 2, "step": 6}
        assert bool(results.converged.all())
        assert results.attrs["study"] == study.to_yaml() == (finished / "study.yaml").read_text()
    assert set(files_of(finished)) == {f"{case.id}.nc" for case in study.cases()}


def test_a_finished_study_is_not_computed_again(study: Study, folder: Path) -> None:
    before, stored, events = files_of(folder), (folder / "study.nc").stat().st_ino, Events()
    for name in ("study.nc", "study.yaml"):
        os.utime(folder / name, (1, 1))
    results = run(study, out=folder, on_event=events)
    assert (files_of(folder), (folder / "study.nc").stat().st_ino) == (before, stored)
    assert min((folder / name).stat().st_mtime for name in ("study.nc", "study.yaml")) > 1  # newer, for make
    assert [(event.kept, event.cases, event.work) for event in events] == [(8, 8, 1.0)]
    shutil.rmtree(folder)
    assert float(results.free_volume.min()) > 0.0  # the dataset outlives its file


def test_damaged_and_wrong_case_files_are_computed_again_and_no_other(study: Study, folder: Path) -> None:
    before, values, events = files_of(folder), values_of(folder), Events()
    truncated, foreign, swapped, gone, flipped, *kept = sorted(before)
    (folder / "cases" / truncated).write_bytes((folder / "cases" / truncated).read_bytes()[:-100])
    (folder / "cases" / foreign).write_bytes(b"not netCDF")
    shutil.copy(folder / "cases" / kept[0], folder / "cases" / swapped)
    (folder / "cases" / gone).unlink()
    altered = bytearray((folder / "cases" / flipped).read_bytes())
    altered[len(altered) // 2] ^= 1
    (folder / "cases" / flipped).write_bytes(altered)
    os.utime(folder / "cases" / flipped, ns=(before[flipped],) * 2)  # size and time stay, as where a disk alters a bit
    found = status(study, folder)
    assert (len(found.done), len(found.missing), len(found.damaged)) == (3, 1, 4)
    assert "has been altered" in found.damaged[flipped.removesuffix(".nc")]
    assert collect(study, folder).converged.sum() == 3 * 6
    again = run(study, out=folder, jobs=1, on_event=events)
    bad = {truncated, foreign, swapped, flipped}
    assert sum(any(name in notice for name in bad) for notice in events.notices) == 4
    assert {path.name for path in (folder / "cases" / "set_aside").glob("*.nc")} == bad
    assert (folder / "cases" / "set_aside" / flipped).read_bytes() == altered
    xr.testing.assert_identical(values_of(again), values)
    assert {name: files_of(folder)[name] for name in kept} == {name: before[name] for name in kept}
    assert len(status(study, folder).done) == 8
    before = files_of(folder)
    xr.testing.assert_identical(values_of(run(study, out=folder, fresh=True, jobs=1)), values)
    assert all(mtime > before[name] for name, mtime in files_of(folder).items())


def test_another_study_in_the_same_folder_is_refused_with_the_difference(folder: Path) -> None:
    before = files_of(folder)
    changed = loads(TEXT.replace("steps: 6", "steps: 5").replace("[2.2, 2.7]", "2.2"))
    difference = r"(?s)another study:\n  sweep.steps: 6 → 5\n.*--fresh"  # less D are no obstacle
    with pytest.raises(FolderError, match=difference):
        run(changed, out=folder, jobs=1)
    assert files_of(folder) == before
    results = run(changed, out=folder, jobs=1, fresh=True)
    assert (results.sizes["step"], results.sizes["D"], len(files_of(folder))) == (5, 1, 4)
    aside = folder / "cases" / "set_aside"  # cases of the other study are not lost
    assert {path.name for path in aside.glob("*.nc")} == set(before)
    assert all("no case of this study" in path.read_text() for path in aside.glob("*.reason.txt"))


@pytest.mark.parametrize(("old", "new"), [("seeds: 2", "seeds: 3"), ("[2, 3]", "[3, 2, 1]")])
def test_more_cases_of_the_same_study_are_all_that_is_computed(folder: Path, old: str, new: str) -> None:
    before, more = files_of(folder), loads(TEXT.replace(old, new).replace("tiny", "renamed"))
    results = run(more, out=folder, jobs=1)
    assert before.items() <= files_of(folder).items()
    assert len(files_of(folder)) == len(more.cases()) > 8
    assert bool(results.converged.all())


def test_other_heights_are_another_study_and_fewer_files_are_the_same(tmp_path: Path) -> None:
    text, out = "surface: {files: [a.npy, b.npy], L: 4.0}\nsweep: {steps: 2}", tmp_path / "out"
    for seed in (1, 3):
        np.save(tmp_path / "a.npy", noise(seed, 5, 5))
        np.save(tmp_path / "b.npy", noise(seed + 1, 5, 5))
        study = loads(text, tmp_path / "study.yaml")
        if seed == 1:
            run(study, out=out, jobs=1)
            before, case = files_of(out), study.cases()[0]
            assert run(loads(text.replace(", b.npy", ""), tmp_path / "study.yaml"), out=out, jobs=1).sizes["case"] == 1
    with pytest.raises(RoughvolError, match="changed since"):
        surface_of(case)
    with pytest.raises(FolderError, match=r"the content of .*a\.npy is not that of a-"):
        run(study, out=out, jobs=1)
    assert files_of(out) == before
    np.save(tmp_path / "b.npy", noise(2, 5, 5))
    assert run(loads(text, tmp_path / "study.yaml"), out=out, jobs=1).sizes["case"] == 2  # one of both measured again


def test_without_a_finished_case_nothing_is_collected(study: Study, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no case of tiny is finished"):
        collect(study, tmp_path / "elsewhere")


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("surface: {file: nan.npy, L: 1.0}", {}, "heights"),
        ("surface: {file: narrow.npy, L: 1.0}", {}, "heights"),
        (FEW, {"jobs": 0}, "jobs is 0"),
        (FEW, {"jobs": "2"}, "jobs is '2'; allowed: a whole number, 1 or more"),
        (FEW, {"only": []}, "names no case of this study"),
        (FEW, {"only": ["nonsense"]}, "nonsense names no case of this study"),
        (FEW, {"scheduler": "nonsense"}, "the scheduler's address is 'nonsense'"),
        (FEW, {"on_event": 5}, "on_event is a function, given a value of the type int"),
    ],
)
def test_a_refused_run_writes_nothing(tmp_path: Path, text: str, options: dict[str, Any], words: str) -> None:
    np.save(tmp_path / "nan.npy", [[0.0, 1.0, np.nan]] * 3)
    np.save(tmp_path / "narrow.npy", [[0.0, 1.0]] * 3)
    with pytest.raises(RoughvolError, match=words):
        run(loads(text, tmp_path / "study.yaml"), out=tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DatasetError, match=r"cannot write .*file: it is no folder"):
        run(loads(FEW), out=tmp_path / "file")


def test_a_long_case_that_stops_is_finished_by_the_next_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "NODES", 0)
    study, asked, out = loads(FEW.replace("seeds: 4", "seeds: 1")), itertools.count(), tmp_path / "run"
    (case,) = study.cases()
    with pytest.raises(KeyboardInterrupt):
        run(study, out=out, jobs=1, stopping=lambda: next(asked) >= 2)  # once before it, then each step
    assert files_of(out) == {}
    assert checkpoint_file(out, case.id).exists()
    found = status(study, out)
    assert (len(found.done), len(found.missing), len(found.failed)) == (0, 1, 0)
    result = run(study, out=out, jobs=1)
    assert not checkpoint_file(out, case.id).exists()
    xr.testing.assert_identical(values_of(result), values_of(run(study, out=tmp_path / "whole", jobs=1)))


# Processes that are killed, and signals


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds child processes in /proc")
def test_a_killed_run_leaves_no_process_and_is_finished_later(tmp_path: Path) -> None:
    study = LONG.replace("seeds: 16", "seeds: 12")  # on a busy machine some end before the process is killed
    process = command(tmp_path, study, "--jobs", "2")
    at_work(tmp_path, process)
    children = _children(process.pid)
    assert lock.holder(tmp_path / "out").pid == process.pid
    process.kill()
    process.communicate(timeout=30)
    assert (bool(children), lock.holder(tmp_path / "out")) == (True, None)
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{child}").exists() for child in children) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not [child for child in children if Path(f"/proc/{child}").exists()]
    before = files_of(tmp_path / "out")
    assert 1 <= len(before) < 12
    case = next(case for case in loads(study).cases() if f"{case.id}.nc" in before)
    stored = dataset.read(tmp_path / "out" / "cases" / f"{case.id}.nc")
    xr.testing.assert_identical(values_of(stored), values_of(run_case(case)))  # the bits of another process
    ids = [case.id for case in loads(study).cases()]
    absent = next(id for id in ids if f"{id}.nc" not in before)
    results = run(loads(study), out=tmp_path / "out", jobs=1, only=[absent])
    assert before.items() <= files_of(tmp_path / "out").items()
    assert not list((tmp_path / "out").rglob(".*"))
    assert (results.sizes["seed"], bool(results.converged.all())) == (len(before) + 1, True)


@pytest.mark.parametrize(
    ("number", "group"),
    [
        (signal.SIGINT, True),
        pytest.param(signal.SIGTERM, False, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, True, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, True, marks=pytest.mark.slow),
    ],
)
def test_a_signal_ends_a_run_after_the_cases_at_work(tmp_path: Path, number: signal.Signals, group: bool) -> None:
    process = command(tmp_path, LONG.replace("seeds: 16", "seeds: 99"), "--jobs", "2")
    running = at_work(tmp_path, process, 2)
    (os.killpg if group else os.kill)(process.pid, number)
    _, errors = process.communicate(timeout=90)
    assert process.returncode == 128 + number
    assert not [word for word in ("Traceback", "leaked", "resource_tracker", "Exception") if word in errors]
    assert "stopping after the cases at work" in errors
    assert errors.splitlines()[-1].startswith("interrupted; finished cases are kept")
    found = status(tmp_path / "study.yaml", tmp_path / "out")
    assert set(running) <= set(found.done)
    assert (len(found.done) < 99, found.failed, found.damaged, found.holder) == (True, {}, {}, None)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def test_a_second_signal_ends_a_run_at_once(tmp_path: Path, number: signal.Signals) -> None:
    process = command(tmp_path, "surface: {D: 2.5, m: 8, seeds: [0]}\nsweep: {steps: 9000}\n")
    note = tmp_path / "out" / "progress.json"
    while process.poll() is None and not (note.exists() and '"running": ["' in note.read_text()):
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGINT)
    while "stopping after the cases" not in (line := process.stderr.readline()):
        assert line
    os.kill(process.pid, number)
    _, errors = process.communicate(timeout=90)
    assert (process.returncode, "Traceback" in errors) == (128 + number, False)
    assert errors.splitlines()[-1].startswith("interrupted; finished cases are kept")


@pytest.mark.slow
def test_a_run_that_ignores_the_end_of_its_terminal_goes_on(tmp_path: Path) -> None:
    ignored = "import signal\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)"  # as nohup does
    process = command(tmp_path, LONG, "--jobs", "2", before=ignored)
    at_work(tmp_path, process)
    os.killpg(process.pid, signal.SIGHUP)
    process.communicate(timeout=90)
    assert process.returncode == 0
    assert len(status(tmp_path / "study.yaml", tmp_path / "out").done) == 16


@pytest.mark.slow
@pytest.mark.processes
def test_a_run_survives_twenty_kills_of_any_of_its_processes(tmp_path: Path) -> None:
    chance, study, out = random.Random(1), loads(LONG), tmp_path / "out"
    undisturbed = values_of(run(study, out=tmp_path / "undisturbed", jobs=2))
    kills, finished = 0, dict[str, int]()
    while kills < 20:
        process = command(tmp_path, study.to_yaml(), "--jobs", "2")
        time.sleep(chance.uniform(0.5, 4.0))
        if process.poll() is None:
            os.kill(chance.choice([process.pid, *_children(process.pid)]), signal.SIGKILL)
            kills += 1
            time.sleep(chance.uniform(0.0, 2.0))  # the run goes on without a worker, until it is killed itself
            process.kill()
        process.communicate(timeout=120)
        now = files_of(out)
        assert finished.items() <= now.items()  # nothing finished is lost or computed again
        finished = now
        if len(finished) == len(study.cases()) or kills == 20:
            again = run(study, out=out, jobs=2)
            assert not list(out.rglob(".*.part"))
            assert not (out / "cases" / "set_aside").exists()
            xr.testing.assert_identical(values_of(again), undisturbed)
            shutil.rmtree(out)
            finished = {}


@pytest.mark.slow
@pytest.mark.parametrize("record", ["", scale.TRANSPORT])
def test_ten_thousand_cases(record: str, tmp_path: Path) -> None:
    folder, few = tmp_path / "work", tmp_path / "few" / "work"
    for place, seeds in ((folder, 2500), (few, 1)):
        place.mkdir(parents=True)
        (place / "scale.yaml").write_text(scale.STUDY.format(seeds=seeds) + record)
        scale.measured(scale.RUN, place)
    for call, times in ((scale.STATUS, 10.0), (scale.LS, 10.0), (scale.COLLECT, 60.0)):  # the time of four cases
        of_many, of_few = (min(scale.measured(call, place)[0] for _ in range(3)) for place in (folder, few))
        assert of_many < times * of_few, call
    scale.measured(scale.STATUS, folder)
    assert "10000 of 10000 cases finished" in (tmp_path / "output.txt").read_text()
