"""Workers for long computations, processes of this machine or of a Dask cluster, behind one loop.

A worker reports, leaves with its parent, and leaves Ctrl-C to it. What a task returns comes back to the caller, so that
nothing but the caller needs the file system of the results.

The processes are spawned, so that each starts from a clean interpreter whatever threads the caller runs. Spawning would
import the caller's ``__main__`` again, which makes a plain script without a ``__name__`` guard start itself over and
over; the functions run here come from importable modules, so ``__main__`` is kept out of it.
"""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import queue
import re
import signal
import sys
import threading
import time
import types
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool as Lost
from contextvars import ContextVar
from typing import Any, Protocol, TypeVar

from roughvol.errors import CampaignError

__all__ = ["Lost", "Tell", "each", "first_interrupt", "in_this_process", "stop_asked"]

Task = TypeVar("Task")
Tell = Callable[[Any], None]

POLL = 0.1  # seconds between two looks at the messages
REPORT_EVERY = 0.2  # seconds between two messages of one process: five a second are more than an eye needs
LIVES = 2  # processes that may die of a task before it is given up
CONNECT = 30  # seconds to reach a scheduler
GONE = 300.0  # seconds that a scheduler may be without any worker, once it has had one
_ADDRESS = re.compile(r"(?:[a-z]+://)?(?:\[[0-9A-Fa-f:.%a-z]+\]|[^\s/:\[\]]+):(?P<port>[0-9]{1,5})/?")
COUNT_EVERY = 1.0  # seconds between two questions to a scheduler: how many workers, whether to stop

_messages: Any = None  # the way to the parent, set once when a worker starts
_stop: Any = None  # set by the parent when the tasks begun are to end early, if they can
_computes_here: ContextVar[bool] = ContextVar("computes_here", default=False)  # set by in_this_process
_one_at_a_time = threading.Lock()  # a Dask worker may run threads; neither netCDF nor a half space can be shared


def check_address(scheduler: str) -> None:
    """Refuse an address that no Dask scheduler can have, before anything is opened.

    Raises
    ------
    CampaignError
        Unless it is ``host:port`` or ``protocol://host:port``.
    """
    found = _ADDRESS.fullmatch(scheduler)
    if found is None or not 0 < int(found["port"]) < 1 << 16:
        message = (
            f"the scheduler's address is {scheduler!r}; "
            "allowed: host:port or protocol://host:port, as in tcp://127.0.0.1:8786"
        )
        raise CampaignError(message)


class Pool(Protocol):
    """Where tasks run; ``fall_together`` if all that are running end with a worker that dies."""

    fall_together: bool

    def width(self) -> int:
        """Return how many tasks to hand over at once."""
        ...

    def submit(self, function: Callable[[Task, Tell], Any], task: Task) -> Future[Any]:
        """Start a task."""
        ...

    def messages(self) -> Iterator[Any]:
        """Yield what tasks have told since the last call."""
        ...

    def stop(self) -> None:
        """Ask the tasks begun to end early, if they can."""
        ...

    def renew(self) -> None:
        """Replace what died."""
        ...

    def check(self) -> None:
        """Raise `CampaignError` if no worker is left that could go on."""
        ...

    def close(self, *, at_once: bool) -> None:
        """End the workers, mid-task if it has to be at once."""
        ...


def each(
    function: Callable[[Task, Tell], Any],
    tasks: Sequence[Task],
    *,
    jobs: int,
    on_message: Callable[[Any], None],
    on_end: Callable[[Task, Any, BaseException | None], None],
    on_begin: Callable[[Task], None] = lambda task: None,
    stopping: Callable[[], bool] = lambda: False,
    scheduler: str | None = None,
) -> bool:
    """Call ``function(task, tell)`` for every task in workers, first task first; return whether all were begun.

    Parameters
    ----------
    function : callable of an importable module
        Does one task; what it passes to ``tell`` arrives at ``on_message``, thinned out to a few a second.
    tasks : sequence
        Picklable.
    jobs : int
        Number of processes, ≥ 1; on a cluster its workers count.
    on_begin, on_message, on_end : callable
        Called here, in the parent: with a task; with a message; with a task, what it returned, its exception or None.
    stopping : callable
        Asked now and then; once it is true no further task begins, and those begun are waited for. On a cluster a task
        that was handed over and not begun comes to ``on_end`` with None.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers are used instead of processes of this machine.

    A process that dies costs only its own task: those that ran with it run again, one at a time, to find which it was;
    a task that has killed `LIVES` processes comes to ``on_end`` with `Lost` (on a cluster: with what Dask says).

    Raises
    ------
    Whatever interrupts it here (Ctrl-C, an exception of a callback); the workers are ended first, mid-task.
    """
    pool: Pool
    if scheduler is not None:
        pool = _Cluster(scheduler)
    else:
        pool = _Here(stopping) if _computes_here.get() else _Processes(jobs)
    waiting, suspects = deque(range(len(tasks))), deque[int]()
    deaths: Counter[int] = Counter()
    running: dict[Future[Any], int] = {}
    all_begun, at_once = True, True

    def begin(number: int) -> bool:
        try:
            running[pool.submit(function, tasks[number])] = number
        except Lost:  # a process has died unseen; what ran with it will say so
            if running:
                return False
            pool.renew()
            running[pool.submit(function, tasks[number])] = number
        on_begin(tasks[number])
        return True

    try:
        while waiting or suspects or running:
            if all_begun and stopping():
                all_begun = not (waiting or suspects or running)
                waiting.clear()
                suspects.clear()
                pool.stop()
            if suspects and not running:
                begin(suspects.popleft())
            elif not suspects and not any(deaths[number] for number in running.values()):
                while waiting and len(running) < pool.width() and begin(waiting[0]):
                    waiting.popleft()
            done, _ = wait(running, timeout=POLL, return_when=FIRST_COMPLETED)
            pool.check()
            for message in pool.messages():
                on_message(message)
            if any(_died(future) for future in done):
                done, _ = wait(running, timeout=None if pool.fall_together else 0)
                lost = [future for future in done if _died(future)]
                pool.renew()
                for future in lost:
                    number = running.pop(future)
                    deaths[number] += 1
                    if deaths[number] >= LIVES:
                        on_end(tasks[number], None, _error(future))
                    elif all_begun:
                        suspects.append(number)
                done -= set(lost)
            for future in done:
                error = _error(future)
                task = tasks[running.pop(future)]
                on_end(task, None if error else future.result(), error)
        at_once = False
    finally:
        pool.close(at_once=at_once)
    return all_begun


def _died(future: Future[Any]) -> bool:
    """Return whether a task ended with its worker; Dask blames all that the worker had at hand."""
    error = _error(future)
    return isinstance(error, Lost) or type(error).__name__ == "KilledWorker"


def _error(future: Future[Any]) -> BaseException | None:
    try:
        return future.exception()
    except CancelledError as error:  # nobody here cancels: the scheduler is gone
        message = "the scheduler is gone; what is finished is kept, run again to go on"
        raise CampaignError(message) from error


class _Processes:
    """Processes of this machine."""

    fall_together = True

    def __init__(self, jobs: int) -> None:
        self._jobs, self._context = jobs, multiprocessing.get_context("spawn")
        self._queue, self._flag = self._context.SimpleQueue(), self._context.Event()
        self._others = set(multiprocessing.active_children())
        self._pool = self._new()

    def _new(self) -> ProcessPoolExecutor:
        given = (self._queue, self._flag)
        return ProcessPoolExecutor(self._jobs, mp_context=self._context, initializer=_begin, initargs=given)

    def width(self) -> int:
        return self._jobs

    def submit(self, function: Callable[[Task, Tell], Any], task: Task) -> Future[Any]:
        with _without_main(), _interrupts_blocked():
            return self._pool.submit(_call, function, task)

    def messages(self) -> Iterator[Any]:
        while not self._queue.empty():
            yield self._queue.get()

    def stop(self) -> None:
        self._flag.set()

    def renew(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._queue = self._context.SimpleQueue()  # one that died while it wrote has left it locked
        self._pool = self._new()

    def check(self) -> None:
        pass  # one that dies ends its task

    def close(self, *, at_once: bool) -> None:
        if at_once:
            for process in set(multiprocessing.active_children()) - self._others:
                process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._queue.close()


@contextlib.contextmanager
def in_this_process(here: bool = True) -> Iterator[None]:
    """Let `each` call its function in this process, without workers, as long as the context lasts in this thread.

    Starting a process takes about a second; many short tasks take less. A debugger stops in the tasks.
    The price: a task that crashes takes the caller with it, and a task sees the state left by earlier ones.
    A call with ``scheduler`` is not affected.

    Parameters
    ----------
    here : bool
        False: in processes again, inside such a context.
    """
    token = _computes_here.set(here)
    try:
        yield
    finally:
        _computes_here.reset(token)


class _Here:
    """The caller's own process: a task has ended when `submit` returns, and its messages follow."""

    fall_together = False

    def __init__(self, stopping: Callable[[], bool]) -> None:
        self._stopping, self._told = stopping, deque[Any]()

    def width(self) -> int:
        return 1

    def submit(self, function: Callable[[Task, Tell], Any], task: Task) -> Future[Any]:
        global _stop
        future: Future[Any] = Future()
        before, _stop = _stop, self
        try:
            future.set_result(function(task, _thinned(self._told.append)))
        except Exception as error:  # an interrupt is no error of the task: it ends `each`
            future.set_exception(error)
        finally:
            _stop = before
        return future

    def is_set(self) -> bool:
        """Return whether the task is to end early: what `stop_asked` asks."""
        return self._stopping()

    def messages(self) -> Iterator[Any]:
        while self._told:
            yield self._told.popleft()

    def stop(self) -> None:
        """Do nothing: the task asks by itself."""

    def renew(self) -> None:
        """Do nothing: no worker dies."""

    def check(self) -> None:
        """Do nothing: no worker is lost."""

    def close(self, *, at_once: bool) -> None:
        """Do nothing: no worker is left."""


class _Cluster:
    """Workers of a Dask scheduler; they come and go, and a task whose worker died runs again on another."""

    fall_together = False

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client, Event
        except ImportError as error:
            message = "a scheduler needs dask.distributed: pip install 'roughvol[cluster]'"
            raise CampaignError(message) from error
        check_address(address)
        try:
            self._client = Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, RuntimeError) as error:
            message = f"no scheduler answers at {address}: {error}"
            raise CampaignError(message) from error
        self._executor = self._client.get_executor(pure=False)
        self._run = f"roughvol-{uuid.uuid4().hex}"  # what is told goes by this name, and so does the wish to stop
        self._told: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._client.subscribe_topic(self._run, lambda event: self._told.put(event[1]))
        self._stop, self._stopping = Event(self._run, client=self._client), False
        self._width, self._threads, self._counted = 1, 0, -math.inf
        self._last_seen: float | None = None  # None: the first worker may be long in coming, as from a batch system

    def width(self) -> int:
        if time.monotonic() - self._counted > COUNT_EVERY:
            self._threads = sum(self._client.nthreads().values())
            self._width = max(2 * self._threads, 1)  # one task at work and one at hand
            self._counted = time.monotonic()
        return self._width

    def submit(self, function: Callable[[Task, Tell], Any], task: Task) -> Future[Any]:
        return self._executor.submit(_call_there, function, task, self._run)

    def messages(self) -> Iterator[Any]:
        while not self._told.empty():
            message = self._told.get()
            yield tuple(message) if isinstance(message, list) else message  # tuples may arrive as lists

    def stop(self) -> None:
        if not self._stopping:
            self._stop.set()
            self._stopping = True

    def renew(self) -> None:
        pass

    def check(self) -> None:
        self.width()
        now = time.monotonic()
        if self._threads:
            self._last_seen = now
        elif self._last_seen is not None and now - self._last_seen > GONE:
            message = (
                f"the scheduler has had no worker for {GONE:.0f} s, after it had some; "
                "what is finished is kept, run again to go on"
            )
            raise CampaignError(message)

    def close(self, *, at_once: bool) -> None:
        with contextlib.suppress(Exception):
            if at_once:
                self._stop.set()  # what is still running there shall not run on for nobody
            self._executor.shutdown(wait=not at_once)
            self._client.unsubscribe_topic(self._run)
        self._client.close()


class _StopThere:
    """The wish to stop, as a worker of a cluster learns of it: asked for rarely, and not heard if nobody answers."""

    def __init__(self, run: str) -> None:
        from distributed import Event, get_client

        self._event, self._asked, self._found = Event(run, client=get_client()), -math.inf, False

    def is_set(self) -> bool:
        if not self._found and time.monotonic() - self._asked > COUNT_EVERY:
            with contextlib.suppress(Exception):
                self._found = bool(self._event.is_set())
            self._asked = time.monotonic()
        return self._found


def _call_there(function: Callable[[Task, Tell], Any], task: Task, run: str) -> Any:
    global _stop
    from distributed import get_worker

    worker = get_worker()
    with _one_at_a_time:
        _stop = _StopThere(run)
        return None if _stop.is_set() else function(task, _thinned(lambda message: worker.log_event(run, message)))


def stop_asked() -> bool:
    """Return, in a worker, whether its task is to end early if it can."""
    return _stop is not None and bool(_stop.is_set())


def _call(function: Callable[[Task, Tell], Any], task: Task) -> Any:
    return function(task, _thinned(_messages.put))


def _thinned(tell: Tell) -> Tell:
    last = 0.0

    def rarely(message: Any) -> None:
        nonlocal last
        if time.monotonic() - last >= REPORT_EVERY:
            last = time.monotonic()
            tell(message)

    return rarely


def _begin(messages: Any, stop: Any) -> None:
    global _messages, _stop  # they can only be handed over when a process starts
    _messages, _stop = messages, stop
    threading.Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    """End this process as soon as its parent is gone: a killed run would leave it waiting for tasks forever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Start processes that never see Ctrl-C (they inherit the mask); one that comes meanwhile reaches us afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def first_interrupt(tell: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Give a question whether Ctrl-C has been pressed once, of which ``tell`` is told; the second ends all at once."""
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():  # only there can signals be caught
        yield asked.is_set
        return

    def note(number: int, frame: object) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        asked.set()
        tell()

    before = signal.signal(signal.SIGINT, note)
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGINT, before)
