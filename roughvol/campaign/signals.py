"""Signals that end a run: Ctrl-C, SIGTERM of a batch system, SIGHUP of a closed terminal.

Each becomes a KeyboardInterrupt with the number of the signal, see `number_of`. A signal that the caller of the process
ignores, as ``nohup`` ignores SIGHUP, stays ignored.
"""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType

ENDS = (signal.SIGTERM, signal.SIGHUP)
ALL = (signal.SIGINT, *ENDS)

Handler = Callable[[int, FrameType | None], None]


def number_of(error: KeyboardInterrupt) -> int:
    """Return the number of the signal that an interrupt comes from; Ctrl-C has none."""
    return error.args[0] if error.args else int(signal.SIGINT)


@contextlib.contextmanager
def as_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at SIGTERM and SIGHUP, as Python does at Ctrl-C."""
    with _handled(ENDS, _interrupt):
        yield


@contextlib.contextmanager
def first_interrupt(tell: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether a signal has arrived. The first calls ``tell``, the second interrupts."""
    arrived: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        if arrived:
            _interrupt(number, frame)
        arrived.append(number)
        tell()

    with _handled(ALL, note):
        try:
            yield lambda: bool(arrived)
        except KeyboardInterrupt as error:
            if error.args or not arrived:
                raise
            raise KeyboardInterrupt(arrived[0]) from error  # of a run that has stopped where it was asked


@contextlib.contextmanager
def blocked() -> Iterator[None]:
    """Block the signals while a process starts: it inherits the mask. Here, they arrive afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ALL)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt(number)


@contextlib.contextmanager
def _handled(numbers: tuple[int, ...], handler: Handler) -> Iterator[None]:
    """Handle signals that are not ignored; outside the main thread, where none arrives, do nothing."""
    before = {}
    try:
        with contextlib.suppress(ValueError):
            for number in numbers:
                if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
                    before[number] = signal.signal(number, handler)
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
