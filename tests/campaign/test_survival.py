"""What a campaign survives, done for real: processes killed at random moments, impatient people, ten thousand cases."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray as xr

from roughvol.campaign import collected, one_case, running
from roughvol.store import dataset, run_status
from roughvol.store.dataset import Dataset
from roughvol.store.run_folder import case_file
from roughvol.study import loads

LONG = "name: long\nsurface: {D: 2.5, m: 5, seeds: 24}\nsweep: {steps: 300}\n"
ENDLESS = "name: endless\nsurface: {D: 2.5, m: 8, seeds: 2}\nsweep: {steps: 4000}\n"


def _values(results: Dataset) -> Dataset:
    return dataset.answers(results)


def _start(
    folder: Path, text: str, *, command: str = "run", ignored: signal.Signals | None = None
) -> subprocess.Popen[str]:
    (folder / "study.yaml").write_text(text)
    code = "from roughvol.cli import main; main()"
    if ignored is not None:
        code = f"import signal; signal.signal({int(ignored)}, signal.SIG_IGN); {code}"
    jobs = ["-j2"] if command == "run" else []
    call = [sys.executable, "-c", code, command, "study.yaml", "--out", "out", *jobs]
    return subprocess.Popen(call, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True)


def _running(folder: Path, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 60
    while '"running": ["' not in _note(folder) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)


def _note(folder: Path) -> str:
    try:
        return (folder / "out" / "progress.json").read_text()
    except FileNotFoundError:
        return ""


def test_a_second_ctrl_c_ends_a_run_at_once(tmp_path: Path) -> None:
    process = _start(tmp_path, ENDLESS)
    _running(tmp_path, process)
    os.killpg(process.pid, signal.SIGINT)
    assert process.stderr is not None
    first = ""
    while "stopping after the cases" not in first:
        first = process.stderr.readline()
        assert first
    assert process.poll() is None  # the cases that are being computed would take minutes
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert errors.splitlines()[-1].startswith("interrupted; finished cases are kept")
    assert "Traceback" not in errors
    assert run_status.status(tmp_path / "study.yaml", tmp_path / "out").holder is None


ENDS = (signal.SIGTERM, signal.SIGHUP)  # of a batch system, of a closed terminal


def _left(process: subprocess.Popen[str]) -> str:
    """Return what a process that has been told to end writes until then."""
    _, errors = process.communicate(timeout=90)
    for word in ("Traceback", "leaked", "resource_tracker", "Exception"):
        assert word not in errors
    return errors


@pytest.mark.parametrize("group", [False, True], ids=["process", "group"])
@pytest.mark.parametrize("number", ENDS, ids=lambda number: number.name)
def test_a_signal_ends_a_run_as_the_first_ctrl_c_does(tmp_path: Path, number: signal.Signals, group: bool) -> None:
    process = _start(tmp_path, LONG.replace("m: 5", "m: 6"))
    _running(tmp_path, process)
    while len(at_work := json.loads(_note(tmp_path) or "{}").get("running", [])) < 2:
        time.sleep(0.02)
    (os.killpg if group else os.kill)(process.pid, number)
    errors = _left(process)
    assert process.returncode == 128 + number
    assert "stopping after the cases at work" in errors
    assert errors.splitlines()[-1].startswith("interrupted; finished cases are kept")
    found = run_status.status(tmp_path / "study.yaml", tmp_path / "out")
    assert set(at_work) <= set(found.done)
    assert (len(found.done) < 24, found.failed, found.damaged, found.holder) == (True, {}, {}, None)


@pytest.mark.parametrize("number", ENDS, ids=lambda number: number.name)
def test_a_second_signal_ends_a_run_at_once(tmp_path: Path, number: signal.Signals) -> None:
    process = _start(tmp_path, ENDLESS)
    _running(tmp_path, process)
    os.kill(process.pid, signal.SIGINT)
    assert process.stderr is not None
    while "stopping after the cases" not in (line := process.stderr.readline()):
        assert line
    os.kill(process.pid, number)
    errors = _left(process)
    assert process.returncode == 128 + number
    assert errors.splitlines()[-1].startswith("interrupted; finished cases are kept")


def test_a_run_whose_terminal_is_closed_finishes_the_cases_at_work(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text(LONG.replace("m: 5", "m: 6"))
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(tmp_path)
        code = "from roughvol.cli import main; main()"
        os.execv(sys.executable, [sys.executable, "-c", code, "run", "study.yaml", "--out", "out", "-j2"])
    deadline = time.monotonic() + 60
    while len(at_work := json.loads(_note(tmp_path) or "{}").get("running", [])) < 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    os.close(terminal)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 128 + signal.SIGHUP
    found = run_status.status(tmp_path / "study.yaml", tmp_path / "out")
    assert at_work
    assert set(at_work) <= set(found.done)
    assert (len(found.done) < 24, found.failed, found.holder) == (True, {}, None)


def test_a_run_that_ignores_the_end_of_its_terminal_goes_on(tmp_path: Path) -> None:
    text = LONG.replace("seeds: 24", "seeds: 3")
    process = _start(tmp_path, text, ignored=signal.SIGHUP)  # as nohup does
    _running(tmp_path, process)
    os.killpg(process.pid, signal.SIGHUP)
    _left(process)
    assert process.returncode == 0
    assert len(run_status.status(tmp_path / "study.yaml", tmp_path / "out").done) == 3


@pytest.mark.parametrize("number", [signal.SIGINT, *ENDS], ids=lambda number: number.name)
def test_a_signal_ends_any_command_without_a_traceback(tmp_path: Path, number: signal.Signals) -> None:
    process = _start(tmp_path, ENDLESS, command="tradeoff")
    time.sleep(4.0)
    assert process.poll() is None
    os.kill(process.pid, number)
    _left(process)
    assert process.returncode == 128 + number


@pytest.mark.slow
def test_a_run_survives_twenty_kills_of_any_of_its_processes(tmp_path: Path) -> None:
    chance, study, out = random.Random(1), loads(LONG), tmp_path / "out"
    undisturbed = _values(running.run(study, out=tmp_path / "undisturbed", jobs=2))
    kills, finished = 0, dict[str, int]()
    while kills < 20:
        process = _start(tmp_path, LONG)
        time.sleep(chance.uniform(0.5, 4.0))
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        family = [process.pid, *map(int, children.read_text().split())] if process.poll() is None else []
        if family:
            victim = chance.choice(family)
            with contextlib.suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)
                kills += 1
            time.sleep(chance.uniform(0.0, 2.0))  # the run goes on without a worker, until it is killed itself
            process.kill()
        process.communicate(timeout=120)
        now = {path.name: path.stat().st_mtime_ns for path in (out / "cases").glob("*.nc")}
        assert {name: now[name] for name in finished} == finished  # nothing finished is lost or computed again
        finished = now
        if len(finished) == len(study.cases()) or kills == 20:
            again = running.run(study, out=out, jobs=2)
            assert not list(out.rglob(".*.part"))
            assert not (out / "cases" / "set_aside").exists()
            xr.testing.assert_identical(_values(again), undisturbed)
            shutil.rmtree(out)
            finished = {}


@pytest.mark.slow
def test_ten_thousand_cases(tmp_path: Path) -> None:
    text = "name: scale\nsurface: {D: [2.2, 2.4, 2.6, 2.8], m: 3, seeds: 2500}\nsweep: {steps: 4}\n"
    (tmp_path / "scale.yaml").write_text(text)
    study, out = loads(text), tmp_path / "out"
    (out / "cases").mkdir(parents=True)
    one = one_case.run_case(study.cases()[0])
    for case in study.cases():
        part = one.assign_coords(D=[case.D], seed=[case.seed])
        part.attrs = one.attrs | {"case_id": case.id, "case": json.dumps(case.key, sort_keys=True)}
        case_file(out, case.id).write_bytes(dataset.to_bytes(part))
    command = [sys.executable, "-c", "from roughvol.cli import main; main()", "status", "out"]

    def seconds_of_status() -> float:
        started = time.monotonic()
        shown = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert "10000 of 10000 cases finished" in shown.stdout
        return time.monotonic() - started

    (out / "study.yaml").write_text(study.stored())
    started = time.monotonic()
    assert collected.collect(study, out).sizes["seed"] == 2500
    seconds = time.monotonic() - started
    running.run(study, out=out)
    shown = min(seconds_of_status() for _ in range(5))  # the best of five
    assert shown < 2.0
    assert seconds < 60.0
