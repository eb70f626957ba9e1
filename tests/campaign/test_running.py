"""Campaigns: a case is the physics and nothing else; a study is its cases, whatever interrupted or preceded it."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal

import roughvol
from roughvol.campaign import one_case, resources, running, workers
from roughvol.campaign.batch import Progress
from roughvol.campaign.collected import collect
from roughvol.campaign.one_case import Context, run_case, surface_of
from roughvol.campaign.running import run
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.errors import CampaignError, ContactError, DatasetError, FolderError, RoughvolError, StudyError
from roughvol.store import checkpoint, dataset
from roughvol.store.dataset import Dataset
from roughvol.store.run_folder import checkpoint_file
from roughvol.store.run_status import status
from roughvol.study import Study, loads
from roughvol.surfaces.texture import summit_plane

TEXT = """
name: tiny
surface: {D: [2.2, 2.7], m: [3, 4], seeds: 2, L: 10.0}
sweep: {steps: 6, to: mean-plane}
record:
  heights: true
  fields_at: {step: 3}
  box_counting: {at: last}
  volume_density: {bins: 9}
"""
# Long enough to be killed in the midst of, short enough to be finished afterwards.
LONG = "name: long\nsurface: {D: 2.5, m: 5, seeds: 20}\nsweep: {steps: 300}\n"


def _values(results: Dataset) -> Dataset:
    """All but what may differ between two runs: times and hosts."""
    return dataset.answers(results)


def _files(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in (folder / "cases").glob("*.nc")}


@pytest.fixture(scope="module")
def study() -> Study:
    return loads(TEXT)


@pytest.fixture(scope="module")
def finished(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    run(study, out=folder, jobs=2)
    return folder


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    """A finished run to be spoilt."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


# One case


def test_a_case_is_its_surface_and_its_sweep(study: Study) -> None:
    case = study.cases()[3]
    surface, result = surface_of(case), run_case(case).squeeze(("D", "m", "seed"))
    last = (surface.z_max - surface.heights.mean()) / surface.Sq
    contacts = list(sweep(surface, HalfSpace(surface.shape), last * np.arange(1, 7) / 6, rtol=1e-6))
    assert_allclose(result.indentation, last * np.arange(1, 7) / 6, rtol=1e-14)
    assert_allclose(result.contact_area_fraction, [contact.contact_area_fraction for contact in contacts], rtol=1e-12)
    assert_allclose(result.free_volume, [contact.free_volume for contact in contacts], rtol=1e-9)
    assert_array_equal(result.heights, surface.heights)
    assert result.converged.all()
    assert (result.D, result.m, result.seed, result.L) == (case.D, case.m, case.seed, 10.0)


def test_a_half_space_passed_on_changes_nothing(study: Study) -> None:
    held: one_case.HalfSpaces = {}
    for case in study.cases():
        xr.testing.assert_identical(_values(run_case(case, Context(half_spaces=held))), _values(run_case(case)))
        assert len(held) == 1


@pytest.mark.parametrize(
    ("to", "name", "value", "tolerance"),
    [
        ("mean-plane", "separation", 0.0, 1e-12),
        ("{separation: -1.0}", "separation", -1.0, 1e-12),
        ("{indentation: 2.5}", "indentation", 2.5, 1e-15),
        ("{pressure: 0.75}", "mean_pressure", 0.75, 1e-5),
        ("{contact_area: 0.25}", "contact_area_fraction", 0.25, 2 / 17**2),
    ],
)
def test_a_sweep_ends_where_it_was_asked_to(to: str, name: str, value: float, tolerance: float) -> None:
    case = loads(f"surface: {{D: 2.5, m: 4, seeds: 1}}\nsweep: {{steps: 5, to: {to}}}").cases()[0]
    result = run_case(case).squeeze()
    assert abs(float(result[name][-1]) - value) <= tolerance * max(1.0, abs(value))
    assert_allclose(np.diff(result.indentation, prepend=0.0), float(result.indentation[-1]) / 5, rtol=1e-12)


def test_a_sweep_to_the_summit_plane_ends_on_the_mean_of_the_summits() -> None:
    case = loads("surface: {D: 2.5, m: 4, seeds: 1}\nsweep: {steps: 5, to: summit-plane}").cases()[0]
    surface = surface_of(case)
    height = float(run_case(case).squeeze().separation[-1]) * surface.Sq + surface.heights.mean()
    assert_allclose(height, summit_plane(surface.heights), rtol=1e-10)


def test_a_sweep_that_would_end_before_first_touch_is_an_error() -> None:
    case = loads("surface: {D: 2.5, m: 3, seeds: 1}\nsweep: {to: {separation: 40}}").cases()[0]
    with pytest.raises(ContactError, match=r"separation=40 would end at Δ/σ = -3\d\.\d+; allowed: beyond first touch"):
        run_case(case)


def test_without_steps_nothing_is_pressed() -> None:
    case = loads("surface: {D: 2.5, m: 3, seeds: 1}\nsweep: {steps: 0}\nrecord: {heights: true}").cases()[0]
    result = run_case(case)
    surface = {"Sq", "Sdq", "z_max", "hurst_measured", "nodes_x", "nodes_y"}
    assert set(result.data_vars) == {*surface, "wall_time", "heights"}
    assert "step" not in result.dims


def test_heights_from_a_file_need_not_be_square(tmp_path: Path) -> None:
    heights = np.random.default_rng(1).normal(size=(9, 13))
    np.save(tmp_path / "measured.npy", heights)
    text = "surface: {file: measured.npy, L: 4.0}\nsweep: {steps: 3}\nrecord: {heights: true, fields_at: last}"
    result = run(loads(text, file=tmp_path / "study.yaml"), out=tmp_path / "out", jobs=1)
    assert result.heights.dims == ("case", "x", "y")
    assert result.free_volume.dims == ("case", "step")
    assert result.case.values.tolist() == ["measured.npy"]
    assert_array_equal(result.heights[0], heights)
    assert_array_equal(result.y, np.arange(13) / 8)
    assert np.all(result.gap.values * result.pressure.values == 0.0)


def test_a_file_that_changes_after_the_study_was_read_is_not_used(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.random.default_rng(1).normal(size=(5, 5)))
    case = loads("surface: {file: a.npy, L: 4.0}", file=tmp_path / "study.yaml").cases()[0]
    np.save(tmp_path / "a.npy", np.random.default_rng(2).normal(size=(5, 5)))
    with pytest.raises(RoughvolError, match="changed since"):
        surface_of(case)


# A study


@pytest.mark.processes
def test_values_do_not_depend_on_the_number_of_processes(study: Study, finished: Path, tmp_path: Path) -> None:
    there = run(study, out=tmp_path, jobs=2)  # the other was computed in this process
    xr.testing.assert_identical(_values(there), _values(dataset.read(finished / "study.nc")))


def test_a_run_holds_every_case_and_says_where_it_comes_from(study: Study, finished: Path) -> None:
    with xr.open_dataset(finished / "study.nc") as results:
        assert results.free_volume.sizes == {"D": 2, "m": 2, "seed": 2, "step": 6}
        assert bool(results.converged.all())
        assert results.attrs["study"] == study.to_yaml() == (finished / "study.yaml").read_text()
    assert set(_files(finished)) == {f"{case.id}.nc" for case in study.cases()}


def test_what_is_returned_outlives_its_file(study: Study, folder: Path) -> None:
    results = run(study, out=folder, jobs=1)
    shutil.rmtree(folder)
    assert float(results.free_volume.min()) > 0.0


def test_a_finished_study_is_not_computed_again(study: Study, folder: Path) -> None:
    before, stored = _files(folder), (folder / "study.nc").stat().st_ino
    events: list[Progress] = []
    run(study, out=folder, on_event=events.append)
    assert _files(folder) == before
    assert (folder / "study.nc").stat().st_ino == stored
    assert [(event.kept, event.cases, event.work) for event in events] == [(8, 8, 1.0)]


def test_fresh_computes_all_again_to_the_same_values(study: Study, folder: Path) -> None:
    before, values = _files(folder), dataset.read(folder / "study.nc")
    again = run(study, out=folder, fresh=True, jobs=1)
    assert all(mtime > before[name] for name, mtime in _files(folder).items())
    xr.testing.assert_identical(_values(again), _values(values))


def test_damaged_and_wrong_case_files_are_computed_again_and_no_other(study: Study, folder: Path) -> None:
    before, values = _files(folder), dataset.read(folder / "study.nc")
    truncated, foreign, swapped, gone, *kept = sorted(before)
    for name in (truncated, foreign):
        content = (folder / "cases" / name).read_bytes()
        (folder / "cases" / name).write_bytes(content[:-100] if name == truncated else b"not netCDF")
    shutil.copy(folder / "cases" / kept[0], folder / "cases" / swapped)
    (folder / "cases" / gone).unlink()
    found = status(study, folder)
    assert (len(found.done), len(found.missing), len(found.damaged)) == (4, 1, 3)
    events: list[Progress] = []
    again = run(study, out=folder, jobs=1, on_event=events.append)
    assert [name in event.notice for event in events if event.notice for name in (truncated, foreign, swapped)].count(
        True
    ) == 3
    assert {path.name for path in (folder / "cases" / "set_aside").glob("*.nc")} == {truncated, foreign, swapped}
    xr.testing.assert_identical(_values(again), _values(values))
    assert {name: _files(folder)[name] for name in kept} == {name: before[name] for name in kept}
    assert len(status(study, folder).done) == 8


def test_another_study_in_the_same_folder_is_refused_with_the_difference(folder: Path) -> None:
    before = _files(folder)
    changed = loads(TEXT.replace("steps: 6", "steps: 5").replace("[2.2, 2.7]", "2.2"))
    with pytest.raises(
        FolderError, match=r"(?s)another study:\n  surface.D: no longer 2.7\n  sweep.steps: 6 → 5\n.*--fresh"
    ):
        run(changed, out=folder, jobs=1)
    assert _files(folder) == before
    results = run(changed, out=folder, jobs=1, fresh=True)
    assert results.sizes["step"] == 5
    assert results.sizes["D"] == 1
    assert len(_files(folder)) == 4
    aside = folder / "cases" / "set_aside"  # those of the other study are not lost either
    assert {path.name for path in aside.glob("*.nc")} == set(before)
    assert all("no case of this study" in path.read_text() for path in aside.glob("*.reason.txt"))


@pytest.mark.parametrize(
    ("old", "new"),
    [("seeds: 2", "seeds: 3"), ("[2.2, 2.7]", "[2.2, 2.4, 2.7]"), ("[3, 4]", "[3, 4, 2]"), ("tiny", "renamed")],
)
def test_more_cases_of_the_same_study_are_all_that_is_computed(folder: Path, old: str, new: str) -> None:
    before, more = _files(folder), loads(TEXT.replace(old, new))
    results = run(more, out=folder, jobs=2)
    assert {name: _files(folder)[name] for name in before} == before
    assert len(_files(folder)) == len(more.cases())
    assert bool(results.converged.all())


def test_heights_that_have_changed_are_another_study(tmp_path: Path) -> None:
    for seed in (1, 2):
        np.save(tmp_path / "a.npy", np.random.default_rng(seed).normal(size=(5, 5)))
        study = loads("surface: {file: a.npy, L: 4.0}\nsweep: {steps: 2}", file=tmp_path / "study.yaml")
        if seed == 1:
            run(study, out=tmp_path / "out", jobs=1)
    with pytest.raises(FolderError, match=r"the content of .*a\.npy is not that of a-"):
        run(study, out=tmp_path / "out", jobs=1)


def test_a_failing_case_does_not_stop_the_others(tmp_path: Path) -> None:
    surfaces = [surface_of(case) for case in loads("surface: {D: 2.5, m: 3, seeds: 4}").cases()]
    peaks = [(surface.z_max - surface.mean_height) / surface.Sq for surface in surfaces]
    between = float(np.median(peaks))  # two surfaces are lower than the end of this sweep
    study = loads(f"name: s\nsurface: {{D: 2.5, m: 3, seeds: 4}}\nsweep: {{steps: 2, to: {{separation: {between}}}}}")
    events: list[Progress] = []
    with pytest.raises(CampaignError, match="2 of 4 cases failed; the others are kept") as caught:
        run(study, out=tmp_path, jobs=2, on_event=events.append)
    failing = [case for case, peak in zip(study.cases(), peaks, strict=True) if peak < between]
    assert all(case.id in str(caught.value) for case in failing)
    assert isinstance(caught.value.__cause__, ExceptionGroup)
    assert (events[-1].done, events[-1].failed) == (2, 2)
    assert len(_files(tmp_path)) == 2
    assert not (tmp_path / "study.nc").exists()
    with pytest.raises(CampaignError, match="2 of 4"):
        run(study, out=tmp_path, jobs=1)
    assert collect(study, tmp_path).sizes["seed"] == 2


def test_what_is_finished_can_be_collected_before_the_rest(study: Study, folder: Path) -> None:
    gone = study.cases()[0]
    (folder / "cases" / f"{gone.id}.nc").unlink()
    part = collect(study, folder)
    absent = part.sel(D=gone.D, m=gone.m, seed=gone.seed)
    assert absent.free_volume.isnull().all()
    assert not absent.converged.any()
    assert int(part.converged.sum()) == 7 * 6
    with pytest.raises(DatasetError, match="no case of tiny is finished"):
        collect(study, folder / "elsewhere")


def test_progress_only_grows_and_ends_at_all(study: Study, tmp_path: Path) -> None:
    events: list[Progress] = []
    run(study, out=tmp_path, jobs=1, on_event=events.append)
    for name in ("done", "steps_done", "work"):
        values = [getattr(event, name) for event in events]
        assert values == sorted(values)
    assert (events[-1].done, events[-1].steps_done, events[-1].work) == (8, 48, 1.0)
    assert sum(bool(event.event) for event in events) == 8


def test_a_callback_that_raises_ends_the_run_and_what_is_done_stays(study: Study, tmp_path: Path) -> None:
    def stop(progress: Progress) -> None:
        if progress.done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(study, out=tmp_path, jobs=1, on_event=stop)
    before = _files(tmp_path)
    assert 1 <= len(before) < 8
    assert not list((tmp_path / "cases").glob(".*"))
    run(study, out=tmp_path, jobs=1)
    assert {name: _files(tmp_path)[name] for name in before} == before


@pytest.mark.parametrize("heights", [[[0.0, 1.0, np.nan]] * 3, [[0.0, 1.0]] * 3], ids=["nan", "narrow"])
def test_bad_heights_are_known_before_anything_is_written(tmp_path: Path, heights: Any) -> None:
    np.save(tmp_path / "bad.npy", np.array(heights))
    study = loads("surface: {file: bad.npy, L: 1.0}", file=tmp_path / "study.yaml")
    with pytest.raises(RoughvolError, match="heights"):
        run(study, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_study_that_cannot_be_read_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.yaml").write_text("surface: {D: 3.5, m: 4}\n")
    with pytest.raises(StudyError, match=r"surface\.D"):
        roughvol.run("bad.yaml")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.yaml"]


def test_a_folder_that_cannot_be_written_is_an_error(study: Study, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DatasetError, match=r"cannot write .*file: Not a directory"):
        run(study, out=tmp_path / "file")
    with pytest.raises(CampaignError, match="jobs is 0"):
        run(study, out=tmp_path / "out", jobs=0)


# Interrupts


def _start(folder: Path) -> tuple[subprocess.Popen[str], Path]:
    (folder / "long.yaml").write_text(LONG)
    command = [sys.executable, "-c", "from roughvol.cli import main; main()", "run", "long.yaml", "--jobs", "2"]
    process = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True)
    run_folder = folder / "runs" / "long"
    deadline = time.monotonic() + 60
    while len(_files(run_folder)) < 3 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)
    return process, run_folder


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _finish_and_check(run_folder: Path) -> None:
    before = _files(run_folder)
    assert 3 <= len(before) < 20
    study = loads(LONG)
    results = run(study, out=run_folder)
    assert {name: _files(run_folder)[name] for name in before} == before
    assert not list(run_folder.rglob(".*"))
    case = study.cases()[0]
    xr.testing.assert_identical(_values(results.sel(seed=[case.seed])), _values(run_case(case)))
    assert bool(results.converged.all())


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds child processes in /proc")
def test_a_killed_run_leaves_no_process_and_is_finished_later(tmp_path: Path) -> None:
    process, run_folder = _start(tmp_path)
    children = _children(process.pid)
    process.kill()
    process.communicate(timeout=30)
    assert process.returncode == -signal.SIGKILL
    assert children
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{child}").exists() for child in children) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not [child for child in children if Path(f"/proc/{child}").exists()]
    _finish_and_check(run_folder)


def test_ctrl_c_ends_a_run_with_one_message_and_it_goes_on_later(tmp_path: Path) -> None:
    process, run_folder = _start(tmp_path)
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to the whole group
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert errors.splitlines()[-1].startswith("interrupted; finished cases are kept")
    _finish_and_check(run_folder)


def test_a_long_case_that_is_asked_to_stop_is_finished_by_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkpoint, "NODES", 0)
    study = loads("name: s\nsurface: {D: 2.4, m: 3, seeds: 1}\nsweep: {steps: 6}\n")
    (case,) = study.cases()
    asked = itertools.count()
    with pytest.raises(KeyboardInterrupt):
        run(study, out=tmp_path / "run", jobs=1, stopping=lambda: next(asked) >= 3)  # once before it, then each step
    assert _files(tmp_path / "run") == {}
    assert checkpoint_file(tmp_path / "run", case.id).exists()
    found = status(study, tmp_path / "run")
    assert (len(found.done), len(found.missing), len(found.failed)) == (0, 1, 0)
    result = run(study, out=tmp_path / "run", jobs=1)
    assert not checkpoint_file(tmp_path / "run", case.id).exists()
    xr.testing.assert_identical(_values(result), _values(run(study, out=tmp_path / "whole", jobs=1)))


def test_cases_asked_for_that_are_none_of_the_study_are_refused(tmp_path: Path) -> None:
    study = loads("name: few\nsurface: {D: 2.3, m: 2, seeds: 1}\nsweep: {steps: 2}")
    for only in ([], ["nonsense"]):
        with pytest.raises(CampaignError, match="names no case of this study"):
            running.run(study, out=tmp_path / "few", jobs=1, only=only)
    assert not (tmp_path / "few").exists()


def test_cores_that_memory_leaves_over_work_inside_the_convolutions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = loads("name: tight\nsurface: {D: 2.3, m: 2, seeds: 4}\nsweep: {steps: 2}")
    monkeypatch.setattr(resources, "limited", lambda *_: (1, "memory for one process"))
    given = []
    monkeypatch.setattr(workers, "each", lambda work, tasks, *, jobs, **_: given.append((jobs, tasks[0][2])))
    with pytest.raises(KeyboardInterrupt):  # nothing is computed here
        running.run(study, out=tmp_path / "tight", jobs=4)
    assert given == [(1, 4)]
