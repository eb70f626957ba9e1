"""Where a run computes: ``jobs=1`` and short runs in this process, others in processes of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from roughvol.campaign import batch, running, workers
from roughvol.errors import CampaignError
from roughvol.store.dataset import Dataset
from roughvol.study import loads

TINY = "name: tiny\nsurface: {D: 2.3, m: 4, seeds: 3}\nsweep: {steps: 5}\n"


def _where(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Return a list to which each run adds whether it computes in this process."""
    told: list[bool] = []
    real = workers.each

    def each(*arguments: Any, **options: Any) -> bool:
        told.append(options["here"])
        return real(*arguments, **options | {"here": True})

    monkeypatch.setattr(workers, "each", each)
    return told


@pytest.mark.parametrize(
    ("jobs", "expected", "here"), [(1, 1e9, True), (None, 0.1, True), (None, 1e9, False), (2, 0.1, False)]
)
def test_one_job_and_short_runs_are_computed_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jobs: int | None, expected: float, here: bool
) -> None:
    monkeypatch.setattr(batch, "SHORT", batch.SHORT if expected < 1.0 else 0.0)
    monkeypatch.setattr(batch.resources, "cores", lambda: 4)
    told = _where(monkeypatch)
    running.run(loads(TINY, "x"), out=tmp_path / "run", jobs=jobs)
    assert told == [here]


def test_one_job_is_this_process_also_where_memory_is_short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "SMALL", 0.0)
    told = _where(monkeypatch)
    running.run(loads(TINY, "x"), out=tmp_path / "run", jobs=1)
    assert told == [True]


def test_values_are_those_of_processes_bit_for_bit(tmp_path: Path) -> None:
    def values(jobs: int) -> Dataset:
        with workers.in_this_process(jobs == 1):
            results = running.run(loads(TINY, "x"), out=tmp_path / str(jobs), jobs=jobs)
        return results.drop_vars("wall_time").drop_attrs()

    xr.testing.assert_identical(values(1), values(2))


def test_a_failing_case_here_is_named_and_costs_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = batch.file_of_case

    def failing(case: Any, *context: Any, **given: Any) -> bytes:
        if case.seed == 1:
            raise MemoryError("does not fit")
        return real(case, *context, **given)

    monkeypatch.setattr(batch, "file_of_case", failing)
    with pytest.raises(CampaignError, match=r"1 of 3 cases failed; the others are kept\n.*not enough memory"):
        running.run(loads(TINY, "x"), out=tmp_path / "run", jobs=1)
    monkeypatch.undo()
    events: list[batch.Progress] = []
    running.run(loads(TINY, "x"), out=tmp_path / "run", jobs=1, on_event=events.append)
    assert events[-1].kept == 2


def test_no_process_is_started_and_a_killed_run_goes_on(tmp_path: Path) -> None:
    study = tmp_path / "long.yaml"
    study.write_text("surface: {D: 2.3, m: 7, seeds: 40}\nsweep: {steps: 60}\n", encoding="utf-8")
    command = [sys.executable, "-m", "roughvol", "run", str(study), "--jobs", "1", "--out", str(tmp_path / "run")]
    there = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    process = subprocess.Popen(command, env=there, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    cases = tmp_path / "run" / "cases"
    try:
        until = time.monotonic() + 60.0
        while not list(cases.glob("*.nc")) and time.monotonic() < until:
            time.sleep(0.02)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        if children.exists():
            assert children.read_text(encoding="utf-8").split() == []
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    kept = len(list(cases.glob("*.nc")))
    assert 0 < kept < 40
    again = subprocess.Popen(command, env=there, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    until = time.monotonic() + 60.0
    while len(list(cases.glob("*.nc"))) <= kept and time.monotonic() < until:
        time.sleep(0.02)
    again.send_signal(signal.SIGINT)
    _, told = again.communicate(timeout=60)
    assert again.returncode == 130
    assert "interrupted; finished cases are kept" in told
