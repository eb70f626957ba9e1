"""A task inside its worker: messages to the caller, and the request to end early."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

Tell = Callable[[Any], None]

REPORT_EVERY = 0.2  # seconds between two messages of one task


class Flag(Protocol):
    """A request to end early, as `threading.Event`."""

    def is_set(self) -> bool:
        """Return whether the task is to end."""
        ...


_flag: Flag | None = None  # of the task of this process


def end_at(flag: Flag | None) -> Flag | None:
    """Set the flag at which the tasks of this process end early.

    Parameters
    ----------
    flag : Flag or None
        None: tasks are not asked.

    Returns
    -------
    Flag or None
        The flag before.
    """
    global _flag
    before, _flag = _flag, flag
    return before


def stop_asked() -> bool:
    """Return, in a worker, whether its task is asked to end early."""
    return _flag is not None and bool(_flag.is_set())


def thinned(tell: Tell) -> Tell:
    """Return a function that drops messages sent too soon after another."""
    last = 0.0

    def rarely(message: Any) -> None:
        nonlocal last
        if time.monotonic() - last >= REPORT_EVERY:
            last = time.monotonic()
            tell(message)

    return rarely
