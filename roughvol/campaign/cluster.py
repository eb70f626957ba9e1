"""Workers of a Dask cluster, which come and go, as a pool of `workers.each`."""

from __future__ import annotations

import contextlib
import math
import queue
import re
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any, TypeVar

from roughvol.errors import CampaignError
from roughvol.study import check_type, refused

Task = TypeVar("Task")
Function = Callable[[Task, Callable[[Any], None], Callable[[], bool]], Any]  # of a task, see `workers.each`

CONNECT = 30  # seconds to reach a scheduler
SPARE = 5  # seconds beyond them until a client that still connects is given up
GONE = 300.0  # seconds without any worker before a scheduler is given up, once it has had one
COUNT_EVERY = 1.0  # seconds between two questions to a scheduler
PROTOCOLS = ("tcp", "tls", "ucx", "ws", "wss")  # of Dask between machines
_ADDRESS = re.compile(
    "(?:(?:" + "|".join(PROTOCOLS) + r")://)?(?:\[[0-9A-Fa-f:.%a-z]+\]|[^\s/:\[\]]+):(?P<port>[0-9]{1,5})/?"
)
_one_at_a_time = threading.Lock()  # threads of a Dask worker cannot share netCDF or a half space


def check_address(scheduler: str) -> None:
    """Refuse an address that is no ``host:port`` or ``protocol://host:port`` with one of `PROTOCOLS`."""
    check_type(scheduler, str, "the scheduler's address is text", refused)
    match = _ADDRESS.fullmatch(scheduler)
    if match is None or not 0 < int(match["port"]) < 1 << 16:
        raise refused(
            f"the scheduler's address is {scheduler!r}; "
            "allowed: host:port or protocol://host:port, as in tcp://127.0.0.1:8786, with a protocol of "
            f"{', '.join(PROTOCOLS)}"
        )


class Cluster:
    """Workers of a Dask scheduler, which come and go; the interface is that of the pools in `workers`."""

    fall_together = False

    def __init__(self, address: str) -> None:
        check_address(address)
        try:
            from distributed import Event
        except ImportError as error:
            raise CampaignError("a scheduler needs dask.distributed: pip install 'roughvol[cluster]'") from error
        self._client = _connected(address)
        self._executor = self._client.get_executor(pure=False)
        self._run = f"roughvol-{uuid.uuid4().hex}"  # name of the messages, and of the event that stops
        self._inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._client.subscribe_topic(self._run, lambda event: self._inbox.put(event[1]))
        self._stop = Event(self._run, client=self._client)
        self._threads, self._counted = 0, -math.inf
        self._last_seen: float | None = None  # of any worker; the first may come late, as from a batch system

    def width(self) -> int:
        """Return the number of tasks to hand over at once: one at work and one waiting for each thread."""
        if time.monotonic() - self._counted > COUNT_EVERY:
            self._threads = sum(self._client.nthreads().values())
            self._counted = time.monotonic()
        return max(2 * self._threads, 1)

    def submit(self, function: Function[Task], task: Task) -> Future[Any]:
        """Start a task."""
        return self._executor.submit(_call_there, function, task, self._run)

    def messages(self) -> Iterator[Any]:
        """Yield the messages of tasks since the last call; raise a `CampaignError` if no worker is left."""
        self.width()
        now = time.monotonic()
        if self._threads:
            self._last_seen = now
        elif self._last_seen is not None and now - self._last_seen > GONE:
            raise CampaignError(
                f"the scheduler has had no worker for {GONE:.0f} s, after it had some; "
                "what is finished is kept, run again to go on"
            )
        while not self._inbox.empty():
            message = self._inbox.get()
            yield tuple(message) if isinstance(message, list) else message  # tuples may arrive as lists

    def stop(self) -> None:
        """Ask the tasks begun to end early."""
        self._stop.set()

    def renew(self) -> None:
        """Do nothing: the scheduler replaces dead workers."""

    def close(self, *, at_once: bool) -> None:
        """Leave the scheduler, mid-task if at once."""
        with contextlib.suppress(Exception):
            if at_once:
                self._stop.set()  # running tasks have no caller left
            self._executor.shutdown(wait=not at_once)
            self._client.unsubscribe_topic(self._run)
        self._client.close()


def _connected(address: str) -> Any:
    """Return a client of a scheduler, connected in a thread: a client of Dask tries a web server without end."""
    from distributed import Client

    answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def connect() -> None:
        try:
            answers.put(Client(address, timeout=CONNECT, set_as_default=False))
        except (OSError, ValueError, RuntimeError) as error:
            answers.put(error)

    threading.Thread(target=connect, daemon=True).start()
    try:
        answer = answers.get(timeout=CONNECT + SPARE)
    except queue.Empty:
        answer = "another server answers"
    if isinstance(answer, str | Exception):
        message = f"no scheduler answers at {address}: {answer}"
        raise CampaignError(message) from (answer if isinstance(answer, Exception) else None)
    return answer


def _call_there(function: Function[Task], task: Task, run: str) -> Any:
    """Call the function of a task on a worker, unless the run is to stop; a scheduler without an answer stops none."""
    from distributed import Event, get_client, get_worker

    event, worker = Event(run, client=get_client()), get_worker()
    polled, stopped = -math.inf, False

    def stopping() -> bool:
        nonlocal polled, stopped
        if not stopped and time.monotonic() - polled > COUNT_EVERY:
            with contextlib.suppress(Exception):
                stopped = bool(event.is_set())
            polled = time.monotonic()
        return stopped

    with _one_at_a_time:
        return None if stopping() else function(task, lambda message: worker.log_event(run, message), stopping)
