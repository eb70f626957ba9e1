"""A Dask cluster: the same values as here, workers that die are survived, tasks that kill them are given up."""

from __future__ import annotations

import os
import pickle
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from click.testing import CliRunner

from roughvol.campaign import batch, running, workers
from roughvol.campaign import cluster as pool
from roughvol.cli import main
from roughvol.errors import CampaignError
from roughvol.store import dataset, run_status, stamped_file
from roughvol.store.dataset import Dataset
from roughvol.study import ANSWER_FORMAT, loads

pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'roughvol[cluster]'")
# The client of Dask leaves its loop's sockets to the garbage collector.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]

TEXT = "name: c\nsurface: {D: [2.3, 2.6], m: 5, seeds: 6}\nsweep: {steps: 120}\nrecord: {fields_at: last}\n"


def _values(results: Dataset) -> Dataset:
    return dataset.answers(results)


def _dask(place: Path, *arguments: str) -> subprocess.Popen[bytes]:
    environment = os.environ | {
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
        "DASK_DISTRIBUTED__DEPLOY__LOST_WORKER_TIMEOUT": "2s",
        # for the tasks of this file, by the code that is tested
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])]),
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


def _ended(processes: list[subprocess.Popen[bytes]]) -> None:
    for process in processes:
        process.terminate()
    for process in processes:
        try:
            process.wait(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


class Cluster:
    """A scheduler and workers on this machine, each a process; the tests of this file share what they leave alive."""

    def __init__(self, place: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.address, self.place = f"tcp://127.0.0.1:{port}", place
        self.workers: list[subprocess.Popen[bytes]] = []
        self._scheduler = _dask(place, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")

    def start(self, *more: str) -> subprocess.Popen[bytes]:
        """Start a worker; with ``--no-nanny`` it dies for good."""
        self.workers.append(
            _dask(self.place, "worker", self.address, "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1", *more)
        )
        return self.workers[-1]

    def alive(self) -> list[subprocess.Popen[bytes]]:
        return [worker for worker in self.workers if worker.poll() is None]

    def wait_for(self, workers: int) -> None:
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)

    def end_workers(self) -> None:
        _ended(self.workers)
        self.workers.clear()

    def end(self) -> None:
        _ended([*self.workers, self._scheduler])


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    cluster = Cluster(tmp_path_factory.mktemp("dask"))
    try:
        yield cluster
    finally:
        cluster.end()


@pytest.fixture
def cluster(scheduler: Cluster) -> Cluster:
    """A scheduler and at least one worker, which a nanny starts again if a task kills it."""
    if not scheduler.alive():
        scheduler.start()
    return scheduler


def test_a_long_sweep_goes_on_elsewhere_where_the_folder_is_shared(scheduler: Cluster, tmp_path: Path) -> None:
    (scheduler.place / "small.py").write_text(
        "from roughvol.store import checkpoint\ncheckpoint.NODES, checkpoint.EVERY = 0, 0.1\n"
    )
    study = loads("name: c\nsurface: {D: 2.4, m: 6, seeds: 1}\nsweep: {steps: 3000}\nrecord: {fields_at: last}\n")
    scheduler.end_workers()  # those of other tests keep no checkpoints of small cases
    first = scheduler.start("--no-nanny", "--preload", "small.py")
    steps: list[int] = []
    again: list[int] = []

    def replace(now: batch.Progress) -> None:
        (again if len(scheduler.workers) == 2 else steps).append(now.steps_done)
        if now.steps_done >= 800 and len(scheduler.workers) == 1:
            first.kill()
            first.wait()
            scheduler.start("--no-nanny", "--preload", "small.py")

    try:
        there = running.run(study, out=tmp_path / "there", scheduler=scheduler.address, on_event=replace)
    finally:
        scheduler.end_workers()
    assert len(steps) > 2  # a worker tells of its steps
    assert min(again) > 200  # and the next does not begin with the first
    assert not list((tmp_path / "there" / "cases").glob(".*"))
    xr.testing.assert_identical(_values(there), _values(running.run(study, out=tmp_path / "here", jobs=1)))


def test_a_worker_whose_answers_are_of_another_format_computes_nothing(scheduler: Cluster, tmp_path: Path) -> None:
    (scheduler.place / "later.py").write_text(
        "from roughvol.campaign import batch\n"
        "from roughvol.study import case\n"
        "case.ANSWER_FORMAT = 99\n"
        "batch.file_of_case = lambda *_, **__: 1 / 0\n"
    )
    scheduler.end_workers()
    scheduler.start("--no-nanny", "--preload", "later.py")
    study = loads(TEXT.replace("seeds: 6", "seeds: 2").replace("steps: 120", "steps: 2"))
    study.cases()[0].key_text  # noqa: B018, cached before it is sent
    try:
        with pytest.raises(CampaignError, match=rf"(?s)4 of 4 cases failed.*worker.*answers.*99.*here {ANSWER_FORMAT}"):
            running.run(study, out=tmp_path, scheduler=scheduler.address)
    finally:
        scheduler.end_workers()
    found = run_status.status(study, tmp_path)
    assert (len(found.failed), found.done) == (4, ())


def test_a_process_labels_its_file_by_its_own_format_of_answers(tmp_path: Path) -> None:
    case = loads(TEXT.replace("steps: 120", "steps: 1").replace("m: 5", "m: 2")).cases()[0]
    assert case.key_text  # cached before it is sent
    (tmp_path / "case").write_bytes(pickle.dumps(case))
    code = (
        "import pathlib, pickle\n"
        "from roughvol.study import case\n"
        "case.ANSWER_FORMAT = 99\n"
        "from roughvol.campaign.one_case import Context, file_of_case\n"
        "case = pickle.loads(pathlib.Path('case').read_bytes())\n"
        "pathlib.Path('case.nc').write_bytes(file_of_case(case, Context()))\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    assert stamped_file.labels(tmp_path / "case.nc")["format_of_answers"] == "99"


def test_a_stopped_run_leaves_what_the_workers_had_not_begun(cluster: Cluster, tmp_path: Path) -> None:
    study, done = loads(TEXT.replace("seeds: 6", "seeds: 40")), [0]
    with pytest.raises(KeyboardInterrupt):
        running.run(
            study,
            out=tmp_path / "there",
            scheduler=cluster.address,
            on_event=lambda now: done.append(now.done),
            stopping=lambda: done[-1] >= 2,
        )
    found = run_status.status(study, tmp_path / "there")
    assert 2 <= len(found.done) <= 8  # of 80: those at work, and what the workers had sent meanwhile
    assert (found.damaged, found.failed) == ({}, {})


def test_a_cluster_that_loses_a_worker_gives_the_same_values(cluster: Cluster, tmp_path: Path) -> None:
    study, doomed = loads(TEXT), cluster.start("--no-nanny")
    cluster.wait_for(len(cluster.alive()))
    killed: list[int] = []

    def kill_one(now: batch.Progress) -> None:
        if now.done == 2 and not killed:
            doomed.kill()
            killed.append(now.done)

    there = running.run(study, out=tmp_path / "there", scheduler=cluster.address, on_event=kill_one)
    assert killed
    here = running.run(study, out=tmp_path / "here", jobs=2)
    xr.testing.assert_identical(_values(there), _values(here))
    assert len(run_status.status(study, tmp_path / "there").done) == 12


def _deadly(number: int, tell: Any) -> int:
    if number == 1:
        os._exit(9)
    return number


def test_a_task_that_kills_workers_is_given_up(cluster: Cluster) -> None:
    ended: dict[int, BaseException | None] = {}
    workers.each(
        _deadly,
        range(4),
        jobs=1,
        scheduler=cluster.address,
        on_message=print,
        on_end=lambda task, result, error: ended.update({task: error}),
    )
    assert sorted(ended) == [0, 1, 2, 3]
    assert "KilledWorker" in type(ended.pop(1)).__name__
    assert set(ended.values()) == {None}


@pytest.mark.parametrize(
    "address",
    ["127.0.0.1", "tcp://127.0.0.1", "127.0.0.1:port", "tcp://a:99999", "tcp://:1", "", "http://127.0.0.1:80"],
)
def test_an_address_that_no_scheduler_can_have_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setattr("distributed.Client", lambda *_, **__: pytest.fail("a client is opened"))
    (tmp_path / "c.yaml").write_text(TEXT)
    call = ["run", str(tmp_path / "c.yaml"), "--out", str(tmp_path / "out"), "--scheduler", address]
    refused = CliRunner().invoke(main, call)
    assert refused.exit_code == 1
    (line,) = refused.stderr.splitlines()
    assert f"the scheduler's address is {address!r}; allowed: host:port or protocol://host:port" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:8786", "localhost:8786", "tls://node-1.example.org:1/", "[::1]:8786"]
)
def test_addresses_of_dask_are_accepted(address: str) -> None:
    pool.check_address(address)


def test_no_scheduler_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool, "CONNECT", 1)
    with pytest.raises(CampaignError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"):
        running.run(loads(TEXT), out=tmp_path, scheduler="tcp://127.0.0.1:9")


def test_a_scheduler_that_has_lost_all_its_workers_is_given_up(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pool, "GONE", 1.0)

    def kill_all(now: batch.Progress) -> None:
        if now.done == 1:
            cluster.end_workers()

    with pytest.raises(CampaignError, match="has had no worker for 1 s, after it had some; what is finished is kept"):
        running.run(loads(TEXT), out=tmp_path, scheduler=cluster.address, on_event=kill_all)
    assert run_status.status(loads(TEXT), tmp_path).done
