"""Workers: every task ends once, dead workers are noticed, the caller is left in peace."""

import contextlib
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from roughvol.campaign import cluster, execution, workers
from roughvol.errors import CampaignError, StudyError
from roughvol.store import run_status
from roughvol.study import loads
from tests.campaign import tasks
from tests.campaign.kit import OF_DASK, Dask, Events, values_of
from tests.kit import python

pytestmark = [pytest.mark.processes, *OF_DASK]


class Ends(dict[Any, Any]):
    """The result or the exception of each task."""

    def __call__(self, task: Any, result: Any, error: BaseException | None) -> None:
        """Take in the end of a task."""
        assert task not in self
        self[task] = result if error is None else error


@pytest.mark.parametrize("place", ["here", "daemon", "processes", "cluster"])
def test_every_task_ends_once_and_errors_come_back(
    place: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    if place == "daemon":  # a worker of multiprocessing.Pool
        monkeypatch.setitem(vars(multiprocessing.current_process())["_config"], "daemon", True)
    address = request.getfixturevalue("scheduler") if place == "cluster" else None
    ended, told, begun, main = Ends(), list[Any](), list[int](), sys.modules["__main__"]
    options = {"on_begin": begun.append, "on_message": told.append, "on_end": ended, "scheduler": address}
    with workers.in_this_process(place == "here"):
        workers.each(tasks.task, range(5), jobs=2, **options)  # type: ignore[arg-type]
    assert sorted(ended) == begun == [0, 1, 2, 3, 4]
    assert str(ended.pop(2)) == "two is not wanted"
    assert set(told) <= set(begun)
    assert [(number, stopped) for number, _, stopped in ended.values()] == [(number, False) for number in ended]
    assert ({pid for _, pid, _ in ended.values()} == {os.getpid()}) == (place != "processes")
    assert sys.modules["__main__"] is main


def test_threads_that_start_processes_at_once_leave_main_as_it_is() -> None:
    main = sys.modules["__main__"]

    def start(seconds: float) -> None:
        with workers._without_main():
            time.sleep(seconds)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(start, [0.1, 0.2]))
    assert sys.modules["__main__"] is main


def test_a_stop_lets_end_what_has_begun_and_begins_no_more() -> None:
    ended = Ends()
    workers.each(tasks.nap, range(20), jobs=2, on_end=ended, stopping=lambda: len(ended) >= 2)
    assert 2 <= len(ended) <= 6
    assert sorted(ended) == list(range(len(ended)))


def test_a_task_that_kills_its_process_is_given_up_and_costs_no_other(tmp_path: Path) -> None:
    ended = Ends()
    workers.each(tasks.deadly, range(4), jobs=2, on_end=ended)
    assert isinstance(ended.pop(0), workers.Lost)
    assert ended == {1: 1, 2: 2, 3: 3}
    once = Ends()
    numbered = [(number, tmp_path / "died") for number in range(4)]
    workers.each(tasks.die_once, numbered, jobs=2, on_end=once)
    assert list(once.values()) == [10 * number for number, _ in once]


def test_an_exception_of_the_caller_ends_the_tasks() -> None:
    def stop(message: Any) -> None:
        raise KeyboardInterrupt

    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        workers.each(tasks.sleep, [0, 1], jobs=1, on_message=stop, on_end=Ends())
    assert time.monotonic() - started < 30  # the tasks sleep for 60


def test_in_this_process_all_is_told_in_order_and_an_interrupt_ends_all() -> None:
    told: list[Any] = []
    how: dict[str, Any] = {"jobs": 3, "on_begin": lambda task: told.append(("begin", task)), "on_message": told.append}
    with workers.in_this_process():
        workers.each(tasks.task, range(3), on_end=lambda task, *_: told.append(("end", task)), **how)
        assert told == [part for number in range(3) for part in (("begin", number), number, ("end", number))]
        ended = Ends()
        with pytest.raises(KeyboardInterrupt):
            workers.each(tasks.interrupted, range(3), jobs=1, on_end=ended)
        asked = iter([False, True])  # once before the first task, then by the task
        workers.each(tasks.task, range(4), jobs=1, on_end=ended, stopping=lambda: next(asked, True))
        assert ended == {0: (0, os.getpid(), True)}

        def refuse(message: Any) -> None:
            raise ValueError("refused")

        with pytest.raises(ValueError, match="refused"):
            workers.each(tasks.task, range(4), jobs=1, on_message=refuse, on_end=Ends())


def test_a_plain_script_does_not_start_itself_again(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from roughvol.campaign import workers\nfrom tests.campaign import tasks\nprint('once')\n"
        "workers.each(tasks.nap, range(2), jobs=2, on_end=lambda task, result, error: print(result + 2))\n"
    )
    assert sorted(python(script).stdout.split()) == ["2", "3", "once"]


# A cluster


@pytest.fixture(scope="module")
def dask(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dask]:
    pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'roughvol[cluster]'")
    with contextlib.closing(Dask(tmp_path_factory.mktemp("dask"))) as started:
        yield started


TEXT = "name: c\nsurface: {D: [2.3, 2.6], m: 4, seeds: 4}\nsweep: {steps: 60}\n"


@pytest.mark.slow
def test_a_cluster_survives_its_workers(dask: Dask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A killed worker changes no value, a task that kills workers is given up, and so is a scheduler without any."""
    study, first = loads(TEXT), dask.worker("--no-nanny")
    events = Events()

    def follow(now: Any) -> None:
        events(now)
        if now.done == 2 and first.poll() is None:
            dask.worker("--no-nanny")
            first.kill()
            first.wait()

    there = execution.run(study, out=tmp_path / "there", scheduler=dask.address, on_event=follow)
    assert first.poll() is not None
    with workers.in_this_process():
        here = execution.run(study, out=tmp_path / "here", jobs=1)
    xr.testing.assert_identical(values_of(there), values_of(here))
    dask.worker()  # with a nanny, which starts it again
    dask.end(dask.processes[2:-1])
    ended = Ends()
    workers.each(tasks.nap, range(3), jobs=1, scheduler=dask.address, on_end=Ends())  # a nanny gives up at its start
    workers.each(tasks.deadly, range(3), jobs=1, scheduler=dask.address, on_end=ended)
    assert "KilledWorker" in type(ended.pop(0)).__name__
    assert ended == {1: 1, 2: 2}
    monkeypatch.setattr(cluster, "GONE", 1.0)

    def kill_all(now: Any) -> None:
        if now.done == 1:
            dask.processes[-1].terminate()  # its nanny ends it

    with pytest.raises(CampaignError, match="has had no worker for 1 s, after it had some; what is finished is kept"):
        execution.run(study, out=tmp_path / "left", scheduler=dask.address, on_event=kill_all)
    assert run_status.status(study, tmp_path / "left").done


@pytest.mark.slow
def test_a_long_sweep_goes_on_elsewhere_where_the_folder_is_shared(dask: Dask, tmp_path: Path) -> None:
    (dask.folder / "small.py").write_text(
        "from roughvol.store import checkpoint\ncheckpoint.NODES, checkpoint.EVERY = 0, 0.1\n"
    )
    study = loads("name: c\nsurface: {D: 2.4, m: 6, seeds: 1}\nsweep: {steps: 3000}\nrecord: {fields_at: last}\n")
    dask.end(dask.processes[1:])
    first, others = dask.worker("--no-nanny", "--preload", "small.py"), list[subprocess.Popen[bytes]]()
    steps: dict[bool, list[int]] = {False: [], True: []}

    def replace(now: Any) -> None:
        steps[bool(others)].append(now.steps_done)
        if now.steps_done >= 800 and not others:
            dask.end([first])
            others.append(dask.worker("--no-nanny", "--preload", "small.py"))

    there = execution.run(study, out=tmp_path / "there", scheduler=dask.address, on_event=replace)
    assert len(steps[False]) > 2  # a worker reports its steps
    assert min(steps[True]) > 200  # and the next does not begin with the first
    assert not list((tmp_path / "there" / "cases").glob(".*"))
    xr.testing.assert_identical(values_of(there), values_of(execution.run(study, out=tmp_path / "here", jobs=1)))


@pytest.mark.parametrize(
    ("address", "right"),
    [
        *((address, True) for address in ("tcp://127.0.0.1:8786", "localhost:8786", "tls://n-1.org:1/", "[::1]:8786")),
        *((address, False) for address in ("127.0.0.1", "127.0.0.1:port", "tcp://a:99999", "", "http://127.0.0.1:80")),
    ],
)
def test_an_address_that_no_scheduler_can_have_is_refused(address: str, right: bool) -> None:
    message = "allowed: host:port or protocol://host:port"
    with contextlib.nullcontext() if right else pytest.raises(StudyError, match=message):
        cluster.check_address(address)


def test_a_scheduler_that_does_not_answer_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "CONNECT", 1)
    with pytest.raises(CampaignError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"):
        execution.run(loads(TEXT), out=tmp_path, scheduler="tcp://127.0.0.1:9")
