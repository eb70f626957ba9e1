"""A Dask cluster: the same values as here, workers that die are survived, tasks that kill them are given up."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from roughvol import campaign, workers
from roughvol.dataset import Dataset
from roughvol.errors import CampaignError
from roughvol.study import loads

pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'roughvol[cluster]'")
# The client of Dask leaves its loop's sockets to the garbage collector.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]

TEXT = "name: c\nsurface: {D: [2.3, 2.6], m: 5, seeds: 6}\nsweep: {steps: 120}\nrecord: {fields_at: last}\n"


def _values(results: Dataset) -> Dataset:
    return results.drop_vars("wall_time").drop_attrs(deep=False)


def _dask(place: Path, *arguments: str) -> subprocess.Popen[bytes]:
    environment = os.environ | {
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2",
        "DASK_DISTRIBUTED__DEPLOY__LOST_WORKER_TIMEOUT": "2s",
        "PYTHONPATH": str(Path(__file__).parent),  # for the tasks of this file
    }
    log = (place / f"{arguments[0]}-{time.monotonic_ns()}.log").open("wb")
    with log:
        return subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]],
            cwd=place,
            env=environment,
            stdout=log,
            stderr=log,
        )


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and two workers on this machine, each process of its own."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    place = tmp_path / "dask"
    place.mkdir()
    scheduler = _dask(place, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    alone = ["--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1"]
    crew = [_dask(place, "worker", address, *alone, "--no-nanny"), _dask(place, "worker", address, *alone)]
    try:
        yield address, crew
    finally:
        for process in [*crew, scheduler]:
            process.terminate()
        for process in [*crew, scheduler]:
            try:
                process.wait(timeout=20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def test_a_cluster_that_loses_a_worker_gives_the_same_values(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path
) -> None:
    address, crew = cluster
    study = loads(TEXT)
    killed: list[int] = []

    def kill_one(now: campaign.Progress) -> None:
        if now.done == 2 and not killed:
            crew[0].kill()
            killed.append(now.done)

    there = campaign.run(study, out=tmp_path / "there", scheduler=address, on_event=kill_one)
    assert killed
    here = campaign.run(study, out=tmp_path / "here", jobs=2)
    xr.testing.assert_identical(_values(there), _values(here))
    assert len(campaign.status(study, tmp_path / "there").done) == 12


def _deadly(number: int, tell: Any) -> int:
    if number == 1:
        os._exit(9)
    return number


def test_a_task_that_kills_workers_is_given_up(cluster: tuple[str, list[subprocess.Popen[bytes]]]) -> None:
    address, _ = cluster
    ended: dict[int, BaseException | None] = {}
    workers.each(
        _deadly,
        range(4),
        jobs=1,
        scheduler=address,
        on_message=print,
        on_end=lambda task, result, error: ended.update({task: error}),
    )
    assert sorted(ended) == [0, 1, 2, 3]
    assert "KilledWorker" in type(ended.pop(1)).__name__
    assert set(ended.values()) == {None}


def test_no_scheduler_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "CONNECT", 1)
    with pytest.raises(CampaignError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"):
        campaign.run(loads(TEXT), out=tmp_path, scheduler="tcp://127.0.0.1:9")
