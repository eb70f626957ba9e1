"""Worker processes for long computations: they report, they leave with their parent, they leave Ctrl-C to it.

The processes are spawned, so that each starts from a clean interpreter whatever threads the caller runs. Spawning would
import the caller's ``__main__`` again, which makes a plain script without a ``__name__`` guard start itself over and
over; the functions run here come from importable modules, so ``__main__`` is kept out of it.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool as Lost
from typing import Any, TypeVar

__all__ = ["Lost", "Tell", "each"]

Task = TypeVar("Task")
Tell = Callable[[Any], None]

POLL = 0.1  # seconds between two looks at the messages
REPORT_EVERY = 0.2  # seconds between two messages of one process: five a second are more than an eye needs

_messages: Any = None  # the way to the parent, set once when a worker starts


def each(
    function: Callable[[Task, Tell], None],
    tasks: Sequence[Task],
    *,
    jobs: int,
    on_message: Callable[[Any], None],
    on_end: Callable[[Task, BaseException | None], None],
) -> None:
    """Call ``function(task, tell)`` for every task in worker processes, first task first.

    Parameters
    ----------
    function : callable of an importable module
        Does one task; what it passes to ``tell`` arrives at ``on_message``, thinned out to a few a second.
    tasks : sequence
        Picklable.
    jobs : int
        Number of processes, ≥ 1.
    on_message, on_end : callable
        Called here, in the parent: with a message; with a task and its exception, or None if it ended well.

    A process that dies ends them all; its task and those not finished come to ``on_end`` with `Lost`.

    Raises
    ------
    Whatever interrupts it here (Ctrl-C, an exception of a callback); the processes are ended first, mid-task.
    """
    context = multiprocessing.get_context("spawn")
    messages = context.SimpleQueue()
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin, initargs=(messages,))
    try:
        with _without_main(), _interrupts_blocked():
            pending = {pool.submit(_call, function, task): task for task in tasks}
        while pending:
            done, _ = wait(pending, timeout=POLL, return_when=FIRST_COMPLETED)
            while not messages.empty():
                on_message(messages.get())
            for future in done:
                on_end(pending.pop(future), future.exception())
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        messages.close()


def _call(function: Callable[[Task, Tell], None], task: Task) -> None:
    last = 0.0

    def tell(message: Any) -> None:
        nonlocal last
        if time.monotonic() - last >= REPORT_EVERY:
            last = time.monotonic()
            _messages.put(message)

    function(task, tell)


def _begin(messages: Any) -> None:
    global _messages  # a queue can only be handed over when a process starts
    _messages = messages
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
