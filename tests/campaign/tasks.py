"""Tasks for workers; this module imports no large library, so that processes start at once."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

Tell = Callable[[Any], None]
Stopping = Callable[[], bool]


def task(number: int, tell: Tell, stopping: Stopping) -> tuple[int, int, bool]:
    tell(number)
    if number == 2:
        raise ValueError("two is not wanted")
    return number, os.getpid(), stopping()


def nap(number: int, tell: Tell, stopping: Stopping) -> int:
    time.sleep(0.05)
    return number


def deadly(number: int, tell: Tell, stopping: Stopping) -> int:
    if number == 0:
        os._exit(7)
    return nap(number, tell, stopping)


def die_once(task: tuple[int, Path], tell: Tell, stopping: Stopping) -> int:
    number, died = task
    if number == 0 and not died.exists():
        died.touch()
        os._exit(7)
    return 10 * number


def sleep(number: int, tell: Tell, stopping: Stopping) -> None:
    tell(number)
    time.sleep(60)


def interrupted(number: int, tell: Tell, stopping: Stopping) -> None:
    raise KeyboardInterrupt
