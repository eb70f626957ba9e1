"""Studies, cases and runs for the tests of campaigns."""

import json
import os
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roughvol.campaign.batch import Progress
from roughvol.campaign.one_case import Context, Stopped, run_case
from roughvol.observables.variables import VARIABLES
from roughvol.store import dataset, dimensional
from roughvol.store.dataset import Dataset
from roughvol.study import Case, Study, loads

DIMS = ("D", "m", "seed")
# The client of Dask leaves its loop's sockets to the garbage collector.
OF_DASK = [pytest.mark.filterwarnings(f"ignore::{kind}") for kind in ("ResourceWarning", "DeprecationWarning")]
TIMES = frozenset(name for name, row in VARIABLES.items() if row.units == "s")
"""The only variables in which two equal runs differ."""


def table(name: str) -> Any:
    """Return the rows of a table of refusals."""
    return tomllib.loads((Path(__file__).parent / "refusals.toml").read_text(encoding="utf-8"))[name]


def case_of(text: str, file: Path | str = "x.yaml") -> Case:
    """Return the first case of a study."""
    return loads(text, file).cases()[0]


def solved(text: str, file: Path | str = "x.yaml") -> Dataset:
    """Return the first case of a study, computed, without dimensions of length 1."""
    result = run_case(case_of(text, file))
    return result.squeeze([dim for dim in DIMS if dim in result.dims])


def collected(study: Study, parts: Sequence[Dataset] = ()) -> Dataset:
    """Return all cases of a study in its units, computed without files where they are not given."""
    parts = parts or [run_case(case) for case in study.cases()]
    return dimensional.in_units(dataset.combine(parts, {}), study, study.cases()[0].length_unit)


def values_of(results: Dataset | Path) -> Dataset:
    """Return all but what may differ between two runs: times and hosts."""
    stored = dataset.read(results / "study.nc") if isinstance(results, Path) else results
    return stored.drop_vars(TIMES, errors="ignore").drop_attrs(deep=False)


def files_of(folder: Path) -> dict[str, int]:
    """Return the times of the files of finished cases by name."""
    return {path.name: path.stat().st_mtime_ns for path in (folder / "cases").glob("*.nc")}


def noise(seed: int, *shape: int) -> np.ndarray:
    """Return independent normal heights."""
    return np.random.default_rng(seed).normal(size=shape)


def resumed(case: Case, stop: int, file: Path) -> tuple[Dataset, list[int]]:
    """Return a case that was stopped after some steps and went on from its checkpoint, with the steps solved then."""
    steps: list[int] = []
    try:
        run_case(case, Context(checkpoint=file, on_step=steps.append, stopping=lambda: len(steps) >= stop))
    except Stopped:
        rest: list[int] = []
        return run_case(case, Context(checkpoint=file, on_step=rest.append)), rest
    raise AssertionError("the case has not stopped")


class Events(list[Progress]):
    """The progress that a run reports."""

    def __call__(self, progress: Progress) -> None:
        """Take in a progress."""
        self.append(progress)

    @property
    def notices(self) -> list[str]:
        """Notices of the run."""
        return [progress.notice for progress in self if progress.notice]


def command(folder: Path, text: str, *arguments: str, before: str = "") -> subprocess.Popen[str]:
    """Start ``roughvol run`` of a study in a process group of its own, with the results in ``folder/out``."""
    (folder / "study.yaml").write_text(text)
    heard = "import signal\nsignal.signal(signal.SIGHUP, signal.SIG_DFL)"  # also where the tests run with nohup
    code = f"{heard}\n{before}\nfrom roughvol.cli import main\nmain()"
    call = [sys.executable, "-c", code, "run", "study.yaml", "--out", "out", *arguments]
    return subprocess.Popen(call, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True)


def at_work(folder: Path, process: subprocess.Popen[str], number: int = 1) -> list[str]:
    """Return the ids of the cases at work, once there are as many and a case is finished."""
    deadline, note = time.monotonic() + 60, folder / "out" / "progress.json"
    while process.poll() is None and time.monotonic() < deadline:
        try:
            ids: list[str] = json.loads(note.read_text())["running"]
        except (OSError, ValueError):
            ids = []
        if len(ids) >= number and files_of(folder / "out"):
            return ids
        time.sleep(0.02)
    raise AssertionError(process.communicate()[1])


class Dask:
    """A scheduler and workers, each a process of this machine."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.address, self.folder = f"tcp://127.0.0.1:{port}", folder
        self.processes: list[subprocess.Popen[bytes]] = []
        self.start("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")

    def start(self, *arguments: str) -> subprocess.Popen[bytes]:
        """Start a scheduler or a worker."""
        paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = os.environ | {
            "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
            "DASK_DISTRIBUTED__DEPLOY__LOST_WORKER_TIMEOUT": "2s",
            "PYTHONPATH": os.pathsep.join(paths),  # for the tasks of this file
        }
        call = [sys.executable, "-m", f"distributed.cli.dask_{arguments[0]}", *arguments[1:]]
        log = subprocess.DEVNULL
        self.processes.append(subprocess.Popen(call, cwd=self.folder, env=environment, stdout=log, stderr=log))
        return self.processes[-1]

    def worker(self, *more: str) -> subprocess.Popen[bytes]:
        """Start a worker; with ``--no-nanny`` it dies for good."""
        return self.start("worker", self.address, "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1", *more)

    def end(self, processes: list[subprocess.Popen[bytes]]) -> None:
        """End processes."""
        for process in processes:
            process.kill()
            process.wait()

    def close(self) -> None:
        """End all processes."""
        self.end(self.processes)

    def names(self) -> list[str]:
        """Return the addresses of the workers that the scheduler knows."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            return list(client.scheduler_info(n_workers=-1)["workers"])
