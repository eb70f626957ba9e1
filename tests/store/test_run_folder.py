"""The folder of a run: one run at a time, sound files only, clear words when the disk lets it down."""

import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import netCDF4
import numpy as np
import pytest
import xarray as xr

from roughvol.analysis.stored_run import Run
from roughvol.campaign import batch, checks, cost, execution, inventory, machine, workers
from roughvol.errors import CampaignError, DatasetError, FolderError, RoughvolError, StudyError
from roughvol.store import dataset, lock, provenance, run_folder, run_status, stamped_file
from roughvol.store.dataset import Dataset
from roughvol.study import Study, loads, plain_data
from roughvol.study import case as one_of_study
from tests.campaign.kit import Events, files_of, values_of
from tests.kit import call, refused, said

TEXT = "name: small\nsurface: {D: 2.4, m: 3, seeds: 4}\nsweep: {steps: 4}\n"
FIELDS = (
    "name: big\nsurface: {D: 2.4, m: 6, seeds: 5}\nsweep: {steps: 4}\n"
    "record: {heights: true, fields_at: {step: [1, 2, 3, 4]}}\n"
)


@pytest.fixture(scope="module")
def study() -> Study:
    return loads(TEXT)


@pytest.fixture(scope="module")
def finished(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("finished")
    execution.run(study, out=place, jobs=1)
    return place


@pytest.fixture
def place(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "run"))


# One run at a time


def test_a_second_run_is_refused_and_told_who_has_the_folder(study: Study, tmp_path: Path) -> None:
    with lock.opened(tmp_path):
        assert lock.holder(tmp_path) is not None
        with pytest.raises(FolderError, match=rf"in use by process {os.getpid()} on .*, since .*another folder: --out"):
            execution.run(study, out=tmp_path)
    assert lock.holder(tmp_path) is None
    assert not (tmp_path / "lock").exists()


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[1]", b'{"host": 3}', b"\xff\xfe", b"[" * 4000, b'{"host": 3, "pid": "1", "started": "x"}'],
)
def test_a_lock_that_says_nothing_is_stale(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "lock").write_bytes(content)
    with lock.opened(tmp_path):
        assert lock.holder(tmp_path) is not None


def test_the_lock_of_another_machine_is_respected(study: Study, tmp_path: Path) -> None:
    (tmp_path / "lock").write_text(json.dumps({"host": "elsewhere", "pid": 1, "started": "today", "birth": ""}))
    with pytest.raises(FolderError, match=r"process 1 on elsewhere.*if that process is no more, remove .*lock"):
        execution.run(study, out=tmp_path)


@pytest.mark.parametrize("birth", ["", "1"])
def test_without_system_locks_the_process_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, birth: str) -> None:
    monkeypatch.setattr(lock.fcntl, "flock", Mock(side_effect=OSError))
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    for pid, stale in ((dead.pid, True), (os.getpid(), birth == "1")):  # a later process may have the same number
        holder = {"host": platform.node(), "pid": pid, "started": "today", "birth": birth}
        (tmp_path / "lock").write_text(json.dumps(holder))
        assert (lock.holder(tmp_path) is None) is stale
        if stale:
            with lock.opened(tmp_path):
                pass
        else:
            with pytest.raises(FolderError, match="in use"), lock.opened(tmp_path):
                pass


# Sound files only


def test_status_reads_only_the_stamp_of_large_files(study: Study, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_folder, "QUICK_BYTES", 0)
    monkeypatch.setattr(stamped_file, "verified", lambda path: pytest.fail("every bit is read"))
    assert len(run_status.status(study, place).done) == 4


def _relabelled(path: Path, **changed: str | None) -> None:
    """Change labels of the stamp of a file; None leaves a label out."""
    content, labels = stamped_file.verified(path)
    kept = {name: label for name, label in (labels | changed).items() if label is not None}
    stamped_file.store(path, stamped_file.stamped(content, kept))


@pytest.mark.parametrize("name", ["case", "key", "format_of_answers", "study"])
def test_a_file_with_the_stamp_of_another_is_not_read(place: Path, name: str) -> None:
    first, second, *_ = sorted((place / "cases").glob("*.nc"))
    path = place / "study.nc" if name == "study" else first
    _relabelled(path, **{name: stamped_file.labels(second)[name] if name in ("case", "key") else "99"})
    for read in (dataset.read, dataset.read_arrays):
        with pytest.raises(DatasetError, match=rf"{re.escape(path.name)} has the stamp of another dataset: {name} is"):
            read(path)
    dataset.read(second)


def _notices(study: Study, place: Path, **how: Any) -> list[str]:
    events = Events()
    execution.run(study, out=place, jobs=1, on_event=events, **how)
    return events.notices


def _refuse_work(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: Any) -> None:
        pytest.fail("nothing is left to compute")

    monkeypatch.setattr(execution, "Batch", never)


def test_a_new_version_computes_nothing_anew(study: Study, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = files_of(place)
    for module in (stamped_file, inventory, provenance):
        monkeypatch.setattr(module, "__version__", "99.1.2")
    _refuse_work(monkeypatch)
    found = run_status.status(study, place)
    assert (len(found.done), found.damaged, found.outdated, found.collected) == (4, {}, {}, True)
    assert _notices(study, place) == []
    assert files_of(place) == before
    assert not (place / "cases" / "set_aside").exists()


def test_mixed_versions_are_noted_and_stored(study: Study, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _relabelled(next((place / "cases").glob("*.nc")), version="0.0.1")
    (place / "study.nc").unlink()
    _refuse_work(monkeypatch)
    ours = provenance.__version__
    line = f"cases are of several versions of roughvol, with answers of one format: 0.0.1 (1), {ours} (3)"
    for _ in range(2):
        assert said("status", place).count(line) == 1
        assert _notices(study, place) == [line]
    assert json.loads(dataset.read(place / "study.nc").attrs["case_versions"]) == {"0.0.1": 1, ours: 3}


@pytest.mark.parametrize("named", [True, False])  # whether the old files name their answer format
def test_old_answers_are_computed_anew(study: Study, place: Path, monkeypatch: pytest.MonkeyPatch, named: bool) -> None:
    before = files_of(place)
    for path in [] if named else list((place / "cases").glob("*.nc")):
        _relabelled(path, format_of_answers=None)
    now = one_of_study.ANSWER_FORMAT
    old = now if named else 1  # only files of the first format do not name it
    monkeypatch.setattr(one_of_study, "ANSWER_FORMAT", now + 1)
    later = loads(TEXT)
    found = run_status.status(later, place)
    assert (len(found.done), len(found.missing), found.damaged, len(found.outdated)) == (0, 4, {}, 4)
    (told,) = _notices(later, place)
    assert told.startswith(f"set aside: 4 case files stored by an older answer format ({old}, now {now + 1}); ")
    assert "their cases are computed anew" in told
    assert {path.name for path in (place / "cases" / "set_aside").glob("*.nc")} == set(before)
    assert (len(run_status.status(later, place).done), run_status.status(later, place).outdated) == (4, {})


@pytest.mark.parametrize("changed", [{"version": "99.0"}, {"format_of_answers": "99"}], ids=["version", "answers"])
def test_a_worker_of_another_version_is_noted_and_one_of_another_answer_format_refused(
    study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: dict[str, str]
) -> None:
    each = workers.each

    def other(work: Any, tasks: Any, *, on_end: Any, **how: Any) -> bool:
        def relabelled(task: Any, result: bytes, error: None) -> None:
            content, labels = stamped_file.unstamped(result, tmp_path)
            on_end(task, stamped_file.stamped(content, labels | changed), error)

        return each(work, tasks, on_end=relabelled, **how)

    monkeypatch.setattr(workers, "each", other)
    if "version" in changed:
        told = _notices(study, tmp_path)
        assert told == [f"a worker has roughvol 99.0, here is {provenance.__version__}: answers of one format"]
        assert run_status.status(study, tmp_path).versions == {"99.0": 4}
    else:
        with pytest.raises(CampaignError, match=r"(?s)4 of 4 cases failed.*by a newer answer format \(99, now \d+\)"):
            execution.run(study, out=tmp_path)
        assert run_status.status(study, tmp_path).done == ()


def test_files_of_another_file_format_are_outdated_not_damaged(study: Study, place: Path) -> None:
    path = next((place / "cases").glob("*.nc"))
    _relabelled(path, format="roughvol 0")
    found = run_status.status(study, place)
    assert (len(found.done), len(found.missing), found.damaged) == (3, 1, {})
    assert list(found.outdated.values()) == [f"{path} was stored by an older file format (roughvol 0, now roughvol 1)"]
    execution.run(study, out=place, jobs=1)
    assert len(run_status.status(study, place).done) == 4
    assert "older file format" in (place / "cases" / "set_aside" / f"{path.name}.reason.txt").read_text()


def test_variables_of_a_later_version_are_left_out(study: Study, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = values_of(execution.collect(study, place))
    known = dict(dataset.VARIABLES)
    del known["Sdq"]  # as an older version would not know it
    monkeypatch.setattr(dataset, "VARIABLES", known)
    xr.testing.assert_identical(values_of(execution.collect(study, place)), before.drop_vars("Sdq"))


# The same study


def test_a_subset_of_a_stored_study_is_collected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "name: s\nsurface: {D: [2.3, 2.6], m: 2, seeds: 2}\nsweep: {steps: 2}\n"
    whole, part = loads(text), loads(text.replace("[2.3, 2.6]", "2.6").replace("seeds: 2", "seeds: 1"))
    first = execution.run(whole, out=tmp_path, jobs=1)
    before = files_of(tmp_path)
    _refuse_work(monkeypatch)
    found = run_status.status(part, tmp_path)
    assert (len(found.done), found.missing, found.strange, found.collected) == (1, (), 3, False)
    results = execution.run(part, out=tmp_path, jobs=1)
    assert results.sizes["D"] * results.sizes["seed"] == 1
    assert files_of(tmp_path) == before  # what is left out stays where it is
    assert run_status.status(part, tmp_path).collected
    xr.testing.assert_identical(values_of(execution.run(whole, out=tmp_path, jobs=1)), values_of(first))


def _states(root: Path) -> list[str]:
    return [run.state for run in run_status.listed(root)]


def test_ls_compares_a_run_with_its_study(place: Path) -> None:
    assert _states(place.parent) == ["finished"]
    for study, state in (
        (TEXT.replace("seeds: 4", "seeds: 5"), "4 of 5 finished"),
        (TEXT + "record: {volume_density: {bins: 5}}\n", "0 of 4 finished"),
    ):
        (place / "study.yaml").write_text(loads(study).stored(), encoding="utf-8")
        assert _states(place.parent) == [state]


def test_ls_counts_the_cases_of_a_run_of_some_cases_alone(study: Study, tmp_path: Path) -> None:
    execution.run(study, out=tmp_path / "run", jobs=1, only=[study.cases()[0].id])
    assert _states(tmp_path) == ["1 of 4 finished"]
    execution.run(study, out=tmp_path / "run", jobs=1)
    run_folder.record_failure(tmp_path / "run", "D2.40_m3_s000-00000000", "of another record", "ValueError")
    execution.run(study, out=tmp_path / "run", jobs=1)
    assert _states(tmp_path) == ["finished"]


def test_ls_counts_the_cases_of_height_files_with_a_list(tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", np.random.default_rng(1).normal(size=(5, 5)))
    text = "surface: {file: map.npy, L: 1 mm}\nmaterial: {E: [5 MPa, 9 MPa], nu: 0.5}\n"
    text += "sweep: {to: {pressure: 1 MPa}, steps: 2}\n"
    execution.run(loads(text, tmp_path / "map.yaml"), out=tmp_path / "run", jobs=1)
    (tmp_path / "run" / "study.nc").unlink()
    assert _states(tmp_path) == ["2 finished"]


@pytest.mark.parametrize(("old", "new"), [("steps: 4", "steps: 5"), ("D: 2.4", "D: 2.5"), ("seeds: 4", "seeds: [7]")])
def test_run_and_status_refuse_another_study_in_the_same_words(place: Path, old: str, new: str) -> None:
    path = _written(place.parent, TEXT.replace(old, new))
    with pytest.raises(FolderError, match="holds the results of another study:") as same:
        run_status.status(path, place)
    assert refused("run", path, "--out", place) == f"error: {same.value}\n"


# Height files


def _clone(place: Path, out: Path) -> Dataset:
    (place / "data").mkdir(parents=True)
    np.save(place / "data" / "scan.npy", np.random.default_rng(1).normal(size=(5, 6)))
    (place / "map.yaml").write_text("surface: {file: data/scan.npy, L: 4.0}\nsweep: {steps: 2}\n")
    return execution.run(place / "map.yaml", out=out, jobs=1)


def test_stored_files_hold_no_path_of_this_machine(tmp_path: Path) -> None:
    one, two = (_clone(tmp_path / name, tmp_path / f"{name}_out") for name in ("one", "two"))
    for attrs in (one.attrs, two.attrs):
        del attrs["date"]
    assert one.attrs == two.attrs
    (file,) = json.loads(one.attrs["height_files"])
    content = (tmp_path / "one" / "data" / "scan.npy").read_bytes()
    assert file == {"file": "scan.npy", "sha256": hashlib.sha256(content).hexdigest()}
    assert "file: data/scan.npy" in one.attrs["study"]
    shutil.rmtree(tmp_path / "one")
    study = Run.of("out", one).study  # the stored study is read without its height file
    with pytest.raises(StudyError):
        study.cases()
    written = [path for path in (tmp_path / "one_out").rglob("*") if path.is_file()]
    assert {path.name for path in written} >= {"study.nc", "study.yaml"}
    for private in {str(tmp_path), str(Path.home()) + "/", str(Path.cwd()), "/tmp/"}:
        assert not [path for path in written if private.encode() in path.read_bytes()]


def test_a_height_file_that_was_moved_is_the_same_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _clone(tmp_path / "one", tmp_path / "out")
    before = files_of(tmp_path / "out")
    path = tmp_path / "one" / "map.yaml"
    text = path.read_text()
    (tmp_path / "one" / "data" / "scan.npy").rename(tmp_path / "one" / "scan.npy")
    _refuse_work(monkeypatch)
    for name in ("scan.npy", str(tmp_path / "one" / "scan.npy")):
        path.write_text(text.replace("data/scan.npy", name))
        assert len(run_status.status(path, tmp_path / "out").done) == 1
        assert "file: scan.npy" in execution.run(path, out=tmp_path / "out").attrs["study"]
        assert files_of(tmp_path / "out") == before


def test_a_renamed_height_file_has_its_new_name_in_the_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.save(tmp_path / "face 1.npy", np.random.default_rng(0).normal(size=(5, 5)))
    path = tmp_path / "map.yaml"
    path.write_text("surface: {file: face 1.npy, L: 1.0}\nsweep: {steps: 2}\n")
    before = execution.run(path, out=tmp_path / "out", jobs=1)
    (tmp_path / "face 1.npy").rename(tmp_path / "face_1.npy")
    path.write_text(path.read_text().replace("face 1", "face_1"))
    _refuse_work(monkeypatch)
    after = execution.run(path, out=tmp_path / "out", jobs=1)
    assert after["case"].values.tolist() == ["face_1.npy"]
    np.testing.assert_array_equal(after["free_volume"].values, before["free_volume"].values)
    assert Run.of("map", after).study is not None


@pytest.mark.parametrize("stamped", [True, False])
def test_an_altered_study_nc_is_made_again_unparsed(study: Study, place: Path, finished: Path, stamped: bool) -> None:
    content = bytearray((place / "study.nc").read_bytes())
    content[60 : len(content) // 2] = np.random.default_rng(4).bytes(len(content) // 2 - 60)
    content = content if stamped else content[: content.rindex(b'{"case"')]
    (place / "study.nc").write_bytes(content)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(netCDF4, "Dataset", None)  # nothing can be parsed
        with pytest.raises(DatasetError, match=r"study\.nc (has been altered|does not end with a checksum)"):
            dataset.read(place / "study.nc")
    (told,) = _notices(study, place)
    assert "study.nc" in told
    assert "made again from the cases" in told
    assert (place / "set_aside" / "study.nc").read_bytes() == content
    again, before = (dataset.read(folder / "study.nc") for folder in (place, finished))
    xr.testing.assert_identical(values_of(again), values_of(before))


def test_many_files_set_aside_are_told_of_in_few_lines(tmp_path: Path) -> None:
    many = loads("name: small\nsurface: {D: 2.4, m: 1, seeds: 12}\nsweep: {steps: 1}\n")
    execution.run(many, out=tmp_path, jobs=1)
    for path in (tmp_path / "cases").glob("*.nc"):
        _relabelled(path, key="0")
    told = _notices(many, tmp_path)
    assert len(told) == inventory.NAMED + 1
    assert "is of another study: '0'" in told[0]
    assert "it is computed again" in told[0]
    assert told[-1].startswith("set aside: 2 more, each with its reason beside it in ")
    assert len(list((tmp_path / "cases" / "set_aside").glob("*.nc"))) == 12  # nothing is lost


def test_a_damaged_study_file_is_no_licence_to_go_on(study: Study, place: Path) -> None:
    (place / "study.yaml").write_text("surface: [")
    with pytest.raises(FolderError, match=r"another study:\n  its study\.yaml cannot be read"):
        execution.run(study, out=place)


def _written(place: Path, text: str) -> Path:
    (place / "study.yaml").write_text(text)
    return place / "study.yaml"


# Failures and status


def test_a_failure_is_recorded_listed_and_tried_again(tmp_path: Path) -> None:
    text = "name: s\nsurface: {D: 2.5, m: 3, seeds: 3}\nsweep: {steps: 2, to: {separation: 40}}\n"
    study = loads(text)
    for _ in range(2):
        done = call("run", _written(tmp_path, text), "--out", tmp_path / "out", "--jobs", "1")
        assert done.exit_code == 1
        assert "3 of 3 cases failed" in done.output
    found = run_status.status(study, tmp_path / "out")
    assert (len(found.failed), found.missing, found.running) == (3, (), ())
    assert all("would end at" in error for error in found.failed.values())
    assert said("status", tmp_path / "out").count("failed: a sweep to") == 3


def test_a_run_without_a_finished_case_leaves_its_folder_to_a_changed_study(tmp_path: Path) -> None:
    text = "name: s\nsurface: {D: 2.5, m: 3, seeds: 1}\nsweep: {steps: 2, to: {separation: 40}}\n"
    with pytest.raises(CampaignError, match="1 of 1 cases failed"):
        execution.run(loads(text), out=tmp_path, jobs=1)
    changed = loads(text.replace("40", "1"))
    assert len(run_status.status(changed, tmp_path).missing) == 1
    assert execution.run(changed, out=tmp_path, jobs=1).sizes["step"] == 2


def test_status_works_while_a_run_is_going_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("NOTED_EVERY", "SETTLED"):
        monkeypatch.setattr(f"roughvol.campaign.batch.{name}", 0.0)
    study = loads("name: s\nsurface: {D: 2.5, m: 5, seeds: 2}\nsweep: {steps: 20}")
    seen = []
    execution.run(study, out=tmp_path, jobs=1, on_event=lambda now: seen.append(run_status.status(study, tmp_path)))
    assert any(found.running for found in seen)
    assert all(found.holder is not None and found.holder.pid == os.getpid() for found in seen)
    assert all(len(found.done) + len(found.running) + len(found.missing) == 2 for found in seen)
    assert [found for found in seen if found.running][-1].left is not None
    after = run_status.status(study, tmp_path)
    assert (len(after.done), after.running, after.holder) == (2, (), None)


# Memory


def test_processes_are_limited_by_memory_with_a_sentence() -> None:
    assert cost.limited(4, [1e9] * 10, None) == (4, "")
    assert cost.limited(4, [1e9] * 10, 8e9) == (4, "")
    fitting, sentence = cost.limited(4, [1e9, 3e9, 3e9, 1e9], 8e9)
    assert (fitting, sentence) == (3, "3 instead of 4 processes at once: a case needs about 3 GB, 8 GB are available")
    assert cost.limited(1, [3e9], 2e9)[0] == 1
    assert "may fail" in cost.limited(1, [3e9], 2e9)[1]


def test_a_run_tells_when_memory_limits_it(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "available_memory", lambda: 2e8)
    notices: list[str] = []
    execution.run(study, out=tmp_path, jobs=3, on_event=lambda now: notices.append(now.notice))
    assert next(notice for notice in notices if notice).startswith("1 instead of 3 processes at once")


def test_memory_grows_with_what_is_asked_as_was_measured() -> None:
    text = "surface: {D: 2.4, m: 9, seeds: 1}\nsweep: {steps: STEPS, to: mean-plane}\nrecord: {WHAT}\n"

    def extra(what: str = "", steps: int = 3) -> float:
        (case,) = loads(text.replace("WHAT", what).replace("STEPS", str(steps))).cases()
        whole = cost.PROCESS_BYTES + cost.COMPILED_BYTES * ("transport" in what)
        return (cost.memory_of(case) - whole) / 513**2

    assert extra("heights: true", 0) < extra() < extra("heights: true") < extra("transport: {transmissivity: last}")
    assert extra() >= 263  # bytes a node, measured
    assert extra("transport: {transmissivity: last}") >= 460
    for what, measured in (("", 176e6), ("transport: {constriction: every-step}", 312e6)):  # the resident set at m = 6
        small = loads(text.replace("WHAT", what).replace("STEPS", "3").replace("m: 9", "m: 6"))
        assert cost.memory_of(small.cases()[0]) >= measured


@pytest.fixture
def slow_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine of 23 GB of memory and 79 GB of disk, which takes 10 s for a convolution."""
    monkeypatch.setattr(machine, "available_memory", lambda: 23e9)
    monkeypatch.setattr(machine, "free_disk", lambda place: 79e9)
    monkeypatch.setattr("roughvol.campaign.cost.seconds_per_convolution", lambda *grid: 10.0)


@pytest.mark.usefixtures("slow_machine")
@pytest.mark.parametrize(
    ("seeds", "what", "words"),
    [
        (2, "transport: {transmissivity: last}", "m = 13, seed 0 needs about 34.6 GB of memory, 23 GB are available"),
        (200, "heights: true", "the results need up to 215 GB of disk, 79 GB are free"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_written(tmp_path: Path, seeds: int, what: str, words: str) -> None:
    text = f"name: big\nsurface: {{D: 2.4, m: 13, seeds: {seeds}}}\nsweep: {{steps: 60}}\nrecord: {{{what}}}\n"
    path = _written(tmp_path, text)
    out = [f"--out={tmp_path / 'out'}"]  # of `run`
    for command in ("check", "run"):
        done = call(command, path, *out[command == "check" :])
        assert done.exit_code == 2
        (line,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
        assert words in line
        assert "2 processes at once\n" not in done.stdout
        assert [found.name for found in tmp_path.iterdir()] == ["study.yaml"]


@pytest.mark.usefixtures("slow_machine")
def test_a_run_of_years_is_warned_of_and_not_refused() -> None:
    study = loads("surface: {D: 2.4, m: 11, seeds: 200}\nsweep: {steps: 10000}")
    estimated = cost.estimate(study, jobs=2)
    told = estimated.warning
    years = estimated.seconds / (365.25 * 86400)
    assert years > 0.5
    assert told == f"this takes about {years:.2g} years ({estimated.seconds / 86400:.0f} days) in 2 processes"
    assert cost.warning(study.cases(), 2) == told
    assert cost.warning(study.cases()[:1], 2) == ""


# A disk that lets it down


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=900k", "tmpfs", str(disk)], capture_output=True)
    if mounted.returncode:
        pytest.skip(f"no file system can be mounted here: {mounted.stderr.decode().strip()}")
    try:
        yield disk
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_is_told_and_what_is_finished_stays(small_disk: Path, tmp_path: Path) -> None:
    study = loads(FIELDS)
    with pytest.raises(FolderError, match=r"cannot write .*: No space left on device"):
        execution.run(study, out=small_disk / "run", jobs=1)
    found = run_status.status(study, small_disk / "run")
    assert 1 <= len(found.done) < 5
    assert not found.damaged
    assert not list((small_disk / "run").rglob("*.part"))
    before = files_of(small_disk / "run")
    subprocess.run(["mount", "-o", "remount,size=20m", str(small_disk)], check=True)
    results = execution.run(study, out=small_disk / "run", jobs=1)
    assert before.items() <= files_of(small_disk / "run").items()
    xr.testing.assert_identical(values_of(results), values_of(execution.run(study, out=tmp_path / "other", jobs=1)))


def test_a_disk_that_becomes_read_only_is_told(small_disk: Path, study: Study) -> None:
    execution.run(study, out=small_disk / "run", jobs=1)
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    more = loads(TEXT.replace("seeds: 4", "seeds: 5"))
    with pytest.raises(FolderError, match="Read-only file system"):
        execution.run(more, out=small_disk / "run", jobs=1)
    assert len(run_status.status(study, small_disk / "run").done) == 4
    assert execution.collect(study, small_disk / "run").sizes["seed"] == 4


def test_a_run_whose_folder_was_moved_leaves_the_lock_of_the_next_one_alone(tmp_path: Path) -> None:
    with lock.opened(tmp_path / "run"):
        (tmp_path / "run").rename(tmp_path / "moved")
        with lock.opened(tmp_path / "run"):
            pass
        (tmp_path / "run" / "lock").touch()
    assert (tmp_path / "run" / "lock").exists()


def test_a_stale_note_is_none_and_removed(study: Study, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def note(noted: object) -> None:
        (place / "progress.json").write_text(json.dumps(noted))
        found = run_status.status(study, place)
        assert (len(found.done), found.running, found.left) == (4, (), None)

    with lock.opened(place):  # notes that make no sense
        for noted in ({"running": 5, "left": "x"}, {"running": [3, ["y"]]}, [1], None):
            note(noted)
    assert not (place / "progress.json").exists()
    note({"running": [study.cases()[0].id], "left": 5.0})
    with lock.opened(place):  # of a run that was killed
        assert not (place / "progress.json").exists()
    note({"running": [study.cases()[0].id], "left": 5.0})
    _refuse_work(monkeypatch)
    execution.run(study, out=place)
    assert not (place / "progress.json").exists()


@pytest.mark.parametrize("counted", ["done", "steps_done"])  # after a case, and at once within a case
def test_a_folder_that_vanishes_is_told_and_not_made_again(
    study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counted: str
) -> None:
    for name in ("NOTED_EVERY", "TOLD_EVERY"):
        monkeypatch.setattr(batch, name, 0.0 if counted == "steps_done" else 60.0)
    seen = Events()

    def vanish(now: batch.Progress) -> None:
        seen(now)
        if getattr(now, counted) == 1:
            shutil.rmtree(tmp_path / "run", ignore_errors=True)

    with pytest.raises(FolderError, match="the folder has vanished"):
        execution.run(study, out=tmp_path / "run", jobs=1, on_event=vanish)
    assert not (tmp_path / "run").exists()
    assert getattr(seen[-1], counted) == 1


@pytest.fixture
def of_netcdf(tmp_path: Path) -> Study:
    """A study of a netCDF file of heights."""
    xr.Dataset({"z": (("x", "y"), np.random.default_rng(1).normal(size=(9, 9)))}).to_netcdf(tmp_path / "z.nc")
    return loads("surface: {file: z.nc, L: 4.0}", file=tmp_path / "study.yaml")


@pytest.mark.processes
def test_a_broken_netcdf_file_of_heights_is_an_error(of_netcdf: Study, tmp_path: Path) -> None:
    content = bytearray((tmp_path / "z.nc").read_bytes())
    content[60 : len(content) - 700] = np.random.default_rng(3).bytes(len(content) - 760)
    (tmp_path / "z.nc").write_bytes(content)
    with pytest.raises(RoughvolError, match=r"z\.nc"):
        checks.check_surfaces(of_netcdf)


def die(*_: Any) -> None:
    os._exit(139)


def hang(*_: Any) -> None:
    time.sleep(600)


@pytest.mark.processes
@pytest.mark.parametrize(
    ("library", "seconds", "words"),
    [
        pytest.param(die, checks.READ_SECONDS, "crashes on it", marks=pytest.mark.slow),
        (hang, 0.3, "cannot be read: the library for this format is still reading after"),
    ],
)
def test_a_library_that_crashes_or_reads_for_ever_is_an_error_of_its_file(
    of_netcdf: Study, monkeypatch: pytest.MonkeyPatch, library: Any, seconds: float, words: str
) -> None:
    monkeypatch.setattr(checks, "read_surface", library)
    monkeypatch.setattr(checks, "READ_SECONDS", seconds)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    with pytest.raises(StudyError, match=rf"study\.yaml:1: surface\.file: .*z\.nc: .*{words}"):
        checks.check_surfaces(of_netcdf)


def test_the_study_of_a_run_is_read_again_whatever_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    most, stored = plain_data.MAX_BYTES // 100, plain_data.STORED_BYTES // 100
    monkeypatch.setattr(plain_data, "MAX_BYTES", most)
    for module in (plain_data, run_folder):
        monkeypatch.setattr(module, "STORED_BYTES", stored)
    begin = "surface: {D: 2.5, m: 2, seeds: 1}\nsweep: {steps: 0}\ncomment: "
    study = loads(f"{begin}{'x' * (most - len(begin))}")
    text = study.stored()
    assert len(text) > most  # with every default
    (tmp_path / "study.yaml").write_text(text)
    assert run_folder.stored_study(tmp_path) == text
    assert loads(text, stored=True) == study
