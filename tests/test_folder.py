"""The folder of a run: one run at a time, sound files only, clear words when the disk lets it down."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from roughvol import campaign, dataset, folder, resources, storage
from roughvol.cli import main
from roughvol.dataset import Dataset
from roughvol.errors import CampaignError, DatasetError, FolderError, RoughvolError
from roughvol.study import Study, loads

TEXT = "name: small\nsurface: {D: 2.4, m: 3, seeds: 4}\nsweep: {steps: 4}\n"
FIELDS = (
    "name: big\nsurface: {D: 2.4, m: 6, seeds: 8}\nsweep: {steps: 4}\n"
    "record: {heights: true, fields_at: {step: [1, 2, 3, 4]}}\n"
)


def _values(results: Dataset) -> Dataset:
    return dataset.answers(results)


@pytest.fixture(scope="module")
def study() -> Study:
    return loads(TEXT)


@pytest.fixture(scope="module")
def finished(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("finished")
    campaign.run(study, out=place, jobs=1)
    return place


@pytest.fixture
def place(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "run"))


# One run at a time


def test_a_second_run_is_refused_and_told_who_has_the_folder(study: Study, tmp_path: Path) -> None:
    with folder.opened(tmp_path):
        assert folder.holder(tmp_path) is not None
        with pytest.raises(FolderError, match=rf"in use by process {os.getpid()} on .*, since .*another --out"):
            campaign.run(study, out=tmp_path)
    assert folder.holder(tmp_path) is None
    assert not (tmp_path / "lock").exists()


def test_the_lock_of_a_killed_process_is_stale(study: Study, tmp_path: Path) -> None:
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom roughvol import folder\n"
        "with folder.opened(Path(sys.argv[1])):\n    print('held', flush=True)\n    time.sleep(60)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process.stdout:
        assert process.stdout.readline() == "held\n"
        found = folder.holder(tmp_path)
        assert found is not None
        assert found.pid == process.pid
        process.kill()
        process.wait(timeout=30)
    assert (tmp_path / "lock").exists()
    assert folder.holder(tmp_path) is None
    assert campaign.run(study, out=tmp_path, jobs=1).sizes["seed"] == 4


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[1]", b'{"host": 3}', b"\xff\xfe", json.dumps({"host": platform.node(), "pid": "1", "started": "x"})],
)
def test_a_lock_that_says_nothing_is_stale(tmp_path: Path, content: bytes | str) -> None:
    (tmp_path / "lock").write_bytes(content if isinstance(content, bytes) else content.encode())
    with folder.opened(tmp_path):
        assert folder.holder(tmp_path) is not None


def test_the_lock_of_another_machine_is_respected(study: Study, tmp_path: Path) -> None:
    (tmp_path / "lock").write_text(json.dumps({"host": "elsewhere", "pid": 1, "started": "today", "birth": ""}))
    with pytest.raises(FolderError, match=r"process 1 on elsewhere.*if that process is no more, remove .*lock"):
        campaign.run(study, out=tmp_path)


@pytest.mark.parametrize("birth", ["", "1"])
def test_without_locks_of_the_system_the_process_decides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, birth: str
) -> None:
    monkeypatch.setattr(folder, "fcntl", None)
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    for pid, stale in ((dead.pid, True), (os.getpid(), birth == "1")):  # a later process may have the same number
        holder = {"host": platform.node(), "pid": pid, "started": "today", "birth": birth}
        (tmp_path / "lock").write_text(json.dumps(holder))
        assert (folder.holder(tmp_path) is None) is stale
        if stale:
            with folder.opened(tmp_path):
                pass
        else:
            with pytest.raises(FolderError, match="in use"), folder.opened(tmp_path):
                pass


# Sound files only


def test_a_flipped_bit_is_found_named_set_aside_and_computed_again(study: Study, place: Path, finished: Path) -> None:
    path = next((place / "cases").glob("*.nc"))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)
    notices: list[str] = []
    again = campaign.run(study, out=place, jobs=1, on_event=lambda now: notices.append(now.notice))
    told = [notice for notice in notices if notice]
    assert len(told) == 1
    assert "has been altered" in told[0]
    assert path.name in told[0]
    assert (place / "cases" / "set_aside" / path.name).read_bytes() == content
    xr.testing.assert_identical(_values(again), _values(campaign.collect(study, finished)))


def test_files_of_another_version_are_computed_again(study: Study, place: Path) -> None:
    path = next((place / "cases").glob("*.nc"))
    content, labels = storage.verified(path)
    storage.store(path, storage.stamped(content, labels | {"version": "0.0.1"}))
    found = campaign.status(study, place)
    assert list(found.damaged.values()) == [
        f"{path} is of another version of roughvol: '0.0.1', not '{labels['version']}'"
    ]
    campaign.run(study, out=place, jobs=1)
    assert len(campaign.status(study, place).done) == 4
    assert "another version" in (place / "cases" / "set_aside" / f"{path.name}.reason.txt").read_text()


@pytest.mark.parametrize("stamped", [True, False])
def test_a_study_nc_that_is_not_as_written_is_never_parsed_but_made_again(
    study: Study, place: Path, finished: Path, stamped: bool
) -> None:
    content = bytearray((place / "study.nc").read_bytes())
    content[60 : len(content) // 2] = os.urandom(len(content) // 2 - 60)
    content = content if stamped else content[: content.rindex(b'{"case"')]
    (place / "study.nc").write_bytes(content)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(netCDF4, "Dataset", None)  # nothing can be parsed
        with pytest.raises(DatasetError, match=r"study\.nc (has been altered|does not end with a checksum)"):
            dataset.read(place / "study.nc")
    notices: list[str] = []
    again = campaign.run(study, out=place, jobs=1, on_event=lambda now: notices.append(now.notice))
    assert [("study.nc" in told, "made again from the cases" in told) for told in notices if told] == [(True, True)]
    assert (place / "set_aside" / "study.nc").read_bytes() == content
    xr.testing.assert_identical(_values(again), _values(dataset.read(finished / "study.nc")))


def test_many_files_set_aside_are_told_of_in_few_lines(tmp_path: Path) -> None:
    many = loads("name: small\nsurface: {D: 2.4, m: 1, seeds: 15}\nsweep: {steps: 1}\n")
    campaign.run(many, out=tmp_path, jobs=1)
    for path in (tmp_path / "cases").glob("*.nc"):
        content, labels = storage.verified(path)
        storage.store(path, storage.stamped(content, labels | {"version": "0.0.1"}))
    notices: list[str] = []
    campaign.run(many, out=tmp_path, jobs=1, on_event=lambda now: notices.append(now.notice))
    told = [notice for notice in notices if notice]
    assert len(told) == campaign.NAMED + 1
    assert "is of another version of roughvol: '0.0.1'" in told[0]
    assert "it is computed again" in told[0]
    assert told[-1].startswith("set aside: 5 more, each with its reason beside it in ")
    assert len(list((tmp_path / "cases" / "set_aside").glob("*.nc"))) == 15  # nothing is lost


def test_a_damaged_study_file_is_no_licence_to_go_on(study: Study, place: Path) -> None:
    (place / "study.yaml").write_text("surface: [")
    with pytest.raises(FolderError, match=r"another study:\n  its study\.yaml cannot be read"):
        campaign.run(study, out=place)


def test_a_name_cannot_lead_out_of_the_folder(tmp_path: Path) -> None:
    for name in ("../up", "/tmp/x", "a/b", "..", ".hidden", "a\x00b"):
        found = CliRunner().invoke(main, ["run", str(_written(tmp_path, f"name: {json.dumps(name)}\n" + TEXT[12:]))])
        assert found.exit_code == 2, found.output
    assert [path.name for path in tmp_path.iterdir()] == ["study.yaml"]


def _written(place: Path, text: str) -> Path:
    (place / "study.yaml").write_text(text)
    return place / "study.yaml"


# Failures and status


def test_a_failure_is_recorded_listed_and_tried_again(tmp_path: Path) -> None:
    text = "name: s\nsurface: {D: 2.5, m: 3, seeds: 3}\nsweep: {steps: 2, to: {separation: 40}}\n"
    study = loads(text)
    call = ["run", str(_written(tmp_path, text)), "--out", str(tmp_path / "out"), "--jobs", "1"]
    for _ in range(2):
        done = CliRunner().invoke(main, call)
        assert done.exit_code == 1
        assert "3 of 3 cases failed" in done.output
    found = campaign.status(study, tmp_path / "out")
    assert (len(found.failed), found.missing, found.running) == (3, (), ())
    assert all("would end at" in error for error in found.failed.values())
    shown = CliRunner().invoke(main, ["status", str(tmp_path / "study.yaml"), "--out", str(tmp_path / "out")])
    assert shown.output.count("failed: a sweep to") == 3


def test_status_works_while_a_run_is_going_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("roughvol.batch.TOLD_EVERY", 0.0)
    study = loads("name: s\nsurface: {D: 2.5, m: 5, seeds: 4}\nsweep: {steps: 100}")
    seen = []
    campaign.run(study, out=tmp_path, jobs=1, on_event=lambda now: seen.append(campaign.status(study, tmp_path)))
    running = [found for found in seen if found.running]
    assert running
    assert all(found.holder is not None and found.holder.pid == os.getpid() for found in seen)
    assert all(len(found.done) + len(found.running) + len(found.missing) == 4 for found in seen)
    assert running[-1].left is not None
    after = campaign.status(study, tmp_path)
    assert (len(after.done), after.running, after.holder) == (4, (), None)


# Memory


def test_processes_are_limited_by_memory_with_a_sentence() -> None:
    assert resources.limited(4, [1e9] * 10, None) == (4, "")
    assert resources.limited(4, [1e9] * 10, 8e9) == (4, "")
    fitting, sentence = resources.limited(4, [1e9, 3e9, 3e9, 1e9], 8e9)
    assert (fitting, sentence) == (3, "3 instead of 4 processes at once: a case needs about 3 GB, 8 GB are available")
    assert resources.limited(1, [3e9], 2e9)[0] == 1
    assert "may fail" in resources.limited(1, [3e9], 2e9)[1]


def test_a_run_tells_when_memory_limits_it(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resources, "available_memory", lambda: 2e8)
    notices: list[str] = []
    campaign.run(study, out=tmp_path, jobs=3, on_event=lambda now: notices.append(now.notice))
    assert next(notice for notice in notices if notice).startswith("1 instead of 3 processes at once")


def test_the_memory_of_this_machine_is_known() -> None:
    available = resources.available_memory()
    assert available is None or 1e6 < available < 1e15


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
    with pytest.raises(FolderError, match=r"cannot write .*: the disk is full"):
        campaign.run(study, out=small_disk / "run", jobs=1)
    found = campaign.status(study, small_disk / "run")
    assert 1 <= len(found.done) < 8
    assert not found.damaged
    assert not list((small_disk / "run").rglob("*.part"))
    before = {path.name: path.stat().st_mtime_ns for path in (small_disk / "run" / "cases").glob("*.nc")}
    subprocess.run(["mount", "-o", "remount,size=20m", str(small_disk)], check=True)
    results = campaign.run(study, out=small_disk / "run", jobs=1)
    after = {path.name: path.stat().st_mtime_ns for path in (small_disk / "run" / "cases").glob("*.nc")}
    assert {name: after[name] for name in before} == before
    xr.testing.assert_identical(_values(results), _values(campaign.run(study, out=tmp_path / "other", jobs=1)))


def test_a_disk_that_becomes_read_only_is_told(small_disk: Path, study: Study) -> None:
    campaign.run(study, out=small_disk / "run", jobs=1)
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    more = loads(TEXT.replace("seeds: 4", "seeds: 5"))
    with pytest.raises(FolderError, match="read-only"):
        campaign.run(more, out=small_disk / "run", jobs=1)
    assert len(campaign.status(study, small_disk / "run").done) == 4
    assert campaign.collect(study, small_disk / "run").sizes["seed"] == 4


def test_a_run_whose_folder_was_moved_leaves_the_lock_of_the_next_one_alone(tmp_path: Path) -> None:
    with folder.opened(tmp_path / "run"):
        (tmp_path / "run").rename(tmp_path / "moved")
        with folder.opened(tmp_path / "run"):
            pass
        (tmp_path / "run" / "lock").touch()
    assert (tmp_path / "run" / "lock").exists()


def test_a_folder_that_vanishes_while_a_long_case_runs_ends_the_run_at_once(tmp_path: Path) -> None:
    study = loads("name: s\nsurface: {D: 2.5, m: 8, seeds: 1}\nsweep: {steps: 10000}\n")  # minutes

    def vanish(now: campaign.Progress) -> None:
        if now.steps_done:
            shutil.rmtree(tmp_path / "run", ignore_errors=True)

    with pytest.raises(FolderError, match="the folder has vanished"):
        campaign.run(study, out=tmp_path / "run", jobs=1, on_event=vanish)


def test_a_note_of_a_run_that_makes_no_sense_is_none(study: Study, place: Path) -> None:
    with folder.opened(place):
        for noted in ({"running": 5, "left": "x"}, {"running": [3, "y"]}, [1], None):
            (place / "progress.json").write_text(json.dumps(noted))
            found = campaign.status(study, place)
            assert (len(found.done), found.running, found.left) == (4, (), None)


def test_a_folder_that_vanishes_is_told_and_not_made_again(study: Study, tmp_path: Path) -> None:
    def vanish(now: campaign.Progress) -> None:
        if now.done == 1 and (tmp_path / "run").exists():
            shutil.rmtree(tmp_path / "run")

    with pytest.raises(FolderError, match="the folder has vanished"):
        campaign.run(study, out=tmp_path / "run", jobs=1, on_event=vanish)
    assert not (tmp_path / "run").exists()
    with pytest.raises(CampaignError, match="jobs is 0"):
        campaign.run(study, out=tmp_path / "run", jobs=0)


@pytest.mark.parametrize("crash", [True, False])
def test_a_broken_netcdf_file_of_heights_is_an_error_even_if_the_library_crashes(tmp_path: Path, crash: bool) -> None:
    xr.Dataset({"z": (("x", "y"), np.random.default_rng(1).normal(size=(9, 9)))}).to_netcdf(tmp_path / "z.nc")
    content = bytearray((tmp_path / "z.nc").read_bytes())
    if not crash:
        content[60 : len(content) - 700] = os.urandom(len(content) - 760)
    (tmp_path / "z.nc").write_bytes(content)
    study = loads("surface: {file: z.nc, L: 4.0}", file=tmp_path / "study.yaml")
    if crash:  # whatever this library does with this file: one that ends its process
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("roughvol.campaign._read", die)
            patch.setenv("PYTHONPATH", str(Path(__file__).parent))
            with pytest.raises(DatasetError, match=r"z\.nc: .*crashes on it"):
                campaign.check_surfaces(study)
    else:
        with pytest.raises(RoughvolError, match=r"z\.nc"):
            campaign.check_surfaces(study)


def die(case: Any, tell: Any) -> None:
    os._exit(139)
