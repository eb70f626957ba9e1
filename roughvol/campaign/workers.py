"""Tasks handed to workers in one loop: processes of this machine, a Dask cluster, or the caller itself.

Results come back to the caller, which alone needs the file system of the results. A worker sends messages, ends with
its parent, and leaves signals to it: a terminal and a batch system send them to all processes.

Processes are spawned: each starts from a clean interpreter, whatever threads the caller runs. Spawning imports the
``__main__`` of the caller again, and a plain script without a ``__name__`` guard would start itself without end. The
functions run here come from importable modules, so ``__main__`` is hidden while a process starts.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
import threading
import types
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool as Lost
from contextvars import ContextVar
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, TypeVar

from roughvol.campaign import signals
from roughvol.campaign.cluster import Cluster, Function
from roughvol.errors import CampaignError

__all__ = ["Lost", "each", "in_this_process"]

Task = TypeVar("Task")

POLL = 0.1  # seconds between two looks at the messages
LIVES = 2  # processes that may die of a task before it is given up

_messages: Any = None  # of a worker process, set at its start: the queue to the parent
_stop: Any = None  # and the event at which tasks are to end
_one_at_a_time = threading.RLock()  # threads that call roughvol cannot share a half space
os.register_at_fork(after_in_child=lambda: globals().update(_one_at_a_time=threading.RLock()))  # a thread may hold it
_hiding = threading.Lock()  # a second thread would take the module that hides __main__ for it
_computes_here: ContextVar[bool | None] = ContextVar("computes_here", default=None)  # set by in_this_process


def each(
    function: Function[Task],
    tasks: Sequence[Task],
    *,
    jobs: int,
    on_end: Callable[[Task, Any, BaseException | None], None],
    on_begin: Callable[[Task], None] = lambda task: None,
    on_message: Callable[[Any], None] = lambda message: None,
    stopping: Callable[[], bool] = lambda: False,
    scheduler: str | None = None,
    here: bool = False,
) -> None:
    """Call ``function(task, tell, stopping)`` for every task in workers, in order; a function of an importable module.

    Messages ``tell(message)`` arrive at ``on_message``. ``on_end`` is called in this process with a task, its result,
    and its exception or None. Once ``stopping()`` is true, no further task begins, and those begun are awaited; on a
    cluster, a task handed over and not begun ends with the result None. ``here`` calls the function in this process,
    unless `in_this_process` decides; a daemonic process always does. An exception of a callback, or Ctrl-C, ends the
    workers mid-task.

    A process that dies costs only its own task. Tasks that ran with it run again, one at a time, to find the one that
    killed it. A task that has killed `LIVES` processes ends with `Lost`; on a cluster, with the exception of Dask.
    """
    decided = _computes_here.get()
    alone = multiprocessing.current_process().daemon  # as a worker of multiprocessing.Pool: it may start no process
    if scheduler is None and (alone or (here if decided is None else decided)):
        _each_here(function, tasks, on_end, on_begin, on_message, stopping)
        return
    pool: _Processes | Cluster = _Processes(jobs) if scheduler is None else Cluster(scheduler)
    waiting, suspects = deque(range(len(tasks))), deque[int]()
    deaths: Counter[int] = Counter()
    running: dict[Future[Any], int] = {}
    stopped, at_once = False, True

    def begin(numbers: deque[int]) -> bool:
        task = tasks[numbers[0]]
        try:
            future = pool.submit(function, task)
        except Lost:  # a process has died; the tasks that ran with it end with that error
            if running:
                return False
            pool.renew()
            future = pool.submit(function, task)
        running[future] = numbers.popleft()
        on_begin(task)
        return True

    try:
        while waiting or suspects or running:
            if not stopped and stopping():
                stopped = True
                waiting.clear()
                suspects.clear()
                pool.stop()
            if suspects and not running:
                begin(suspects)
            elif not suspects and not any(deaths[number] for number in running.values()):
                while waiting and len(running) < pool.width() and begin(waiting):
                    pass
            done, _ = wait(running, timeout=POLL, return_when=FIRST_COMPLETED)
            for message in pool.messages():
                on_message(message)
            if any(_died(future) for future in done):
                done, _ = wait(running, timeout=None if pool.fall_together else 0)
                pool.renew()
            for future in done:
                number, error = running.pop(future), _error(future)
                deaths[number] += _died(future)
                if not _died(future) or deaths[number] >= LIVES:
                    on_end(tasks[number], None if error else future.result(), error)
                elif not stopped:
                    suspects.append(number)
        at_once = False
    finally:
        pool.close(at_once=at_once)


def _each_here(
    function: Function[Task],
    tasks: Sequence[Task],
    on_end: Callable[[Task, Any, BaseException | None], None],
    on_begin: Callable[[Task], None],
    on_message: Callable[[Any], None],
    stopping: Callable[[], bool],
) -> None:
    """Do what `each` does in this process."""
    refused: list[BaseException] = []  # what the caller raised at a message

    def tell(message: Any) -> None:
        try:
            on_message(message)
        except BaseException as error:
            refused.append(error)
            raise

    for task in tasks:
        if stopping():
            return
        on_begin(task)
        result, failure = None, None
        try:
            with _one_at_a_time:
                result = function(task, tell, stopping)
        except Exception as error:  # an interrupt is no error of the task: it ends all
            if error in refused:
                raise
            failure = error
        on_end(task, result, failure)


@contextlib.contextmanager
def in_this_process(here: bool = True) -> Iterator[None]:
    """Let `each` call its function in this process, without workers, as long as the context lasts in this thread.

    Starting a process takes about a second, and a debugger stops in the tasks. A task that crashes takes the caller
    with it. A call with ``scheduler`` is not affected. ``here=False`` inside such a context: in processes again.
    """
    token = _computes_here.set(here)
    try:
        yield
    finally:
        _computes_here.reset(token)


def _died(future: Future[Any]) -> bool:
    """Return whether a task ended with its worker. Dask blames every task that the worker held."""
    error = _error(future)
    return isinstance(error, Lost) or type(error).__name__ == "KilledWorker"


def _error(future: Future[Any]) -> BaseException | None:
    try:
        return future.exception()
    except CancelledError as error:  # never cancelled here: the scheduler is gone
        raise CampaignError("the scheduler is gone; what is finished is kept, run again to go on") from error


class _Worker(SpawnProcess):
    """A process with signals blocked."""

    def terminate(self) -> None:
        """End the process: SIGTERM would not."""
        self.kill()


class _Context(SpawnContext):
    Process = _Worker


class _Processes:
    """Processes of this machine."""

    fall_together = True  # all running tasks end with a worker that dies

    def __init__(self, jobs: int) -> None:
        self._jobs, self._context = jobs, _Context()
        with signals.blocked():  # also in the process that keeps the books of semaphores
            self._queue, self._flag = self._context.SimpleQueue(), self._context.Event()
        self._others = set(multiprocessing.active_children())
        self._pool = self._new()

    def _new(self) -> ProcessPoolExecutor:
        shared = (self._queue, self._flag)
        return ProcessPoolExecutor(self._jobs, mp_context=self._context, initializer=_begin, initargs=shared)

    def width(self) -> int:
        """Return the number of tasks to hand over at once."""
        return self._jobs

    def submit(self, function: Function[Task], task: Task) -> Future[Any]:
        """Start a task."""
        with _without_main(), signals.blocked():
            return self._pool.submit(_call, function, task)

    def messages(self) -> Iterator[Any]:
        """Yield the messages of tasks since the last call."""
        while not self._queue.empty():
            yield self._queue.get()

    def stop(self) -> None:
        """Ask the tasks begun to end early."""
        self._flag.set()

    def renew(self) -> None:
        """Replace dead workers."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._queue = self._context.SimpleQueue()  # a process that died while writing has left it locked
        self._pool = self._new()

    def close(self, *, at_once: bool) -> None:
        """End the workers, mid-task if at once."""
        if at_once:
            for process in set(multiprocessing.active_children()) - self._others:
                process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._queue.close()


def _call(function: Function[Task], task: Task) -> Any:
    return function(task, _messages.put, _stop.is_set)


def _begin(messages: Any, stop: Any) -> None:
    """Initialise a worker process."""
    global _messages, _stop  # queues and events pass to a process only at its start
    _messages, _stop = messages, stop
    sys.stdout = sys.stderr  # the caller alone answers: what modules of a user print is no part of it
    threading.Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    """End this process with its parent: after a kill it would wait for tasks forever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Hide ``__main__`` while a process starts."""
    with _hiding:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = types.ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main
