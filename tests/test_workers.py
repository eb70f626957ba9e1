"""Worker processes: every task ends once and is told of, dead processes are noticed, callers are left in peace."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from roughvol import workers


def _task(number: int, tell: Callable[[Any], None]) -> None:
    if number == 2:
        message = "two is not wanted"
        raise ValueError(message)
    for value in range(100):  # far more than are passed on
        tell((number, os.getpid(), value))


def _die(number: int, tell: Callable[[Any], None]) -> None:
    if number == 0:
        os._exit(7)
    time.sleep(60)


def _sleep(number: int, tell: Callable[[Any], None]) -> None:
    tell(number)
    time.sleep(60)


def test_every_task_ends_once_elsewhere_and_errors_come_back() -> None:
    messages: list[tuple[int, int, int]] = []
    ended: dict[int, BaseException | None] = {}
    workers.each(
        _task, range(5), jobs=2, on_message=messages.append, on_end=lambda task, error: ended.update({task: error})
    )
    assert sorted(ended) == [0, 1, 2, 3, 4]
    assert {task for task, error in ended.items() if error is not None} == {2}
    assert str(ended[2]) == "two is not wanted"
    assert os.getpid() not in {pid for _, pid, _ in messages}
    assert 0 < len(messages) <= 10


def test_a_process_that_dies_is_noticed() -> None:
    ended: dict[int, BaseException | None] = {}
    workers.each(_die, [0, 1], jobs=2, on_message=print, on_end=lambda task, error: ended.update({task: error}))
    assert [type(ended[task]) for task in (0, 1)] == [workers.Lost, workers.Lost]


def test_an_exception_here_ends_the_tasks_there() -> None:
    def stop(message: Any) -> None:
        raise KeyboardInterrupt

    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        workers.each(_sleep, [0, 1, 2, 3], jobs=2, on_message=stop, on_end=lambda task, error: None)
    assert time.monotonic() - started < 30  # the tasks sleep for 60


def test_main_is_what_it_was() -> None:
    main = sys.modules["__main__"]
    workers.each(_task, [0], jobs=1, on_message=lambda message: None, on_end=lambda task, error: None)
    assert sys.modules["__main__"] is main


def test_a_plain_script_does_not_start_itself_again(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text("surface: {D: 2.5, m: 2, seeds: 2}\nsweep: {steps: 2}\n")
    script = tmp_path / "script.py"
    script.write_text("import roughvol\nprint('once')\nprint(dict(roughvol.run('study.yaml').sizes)['seed'])\n")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("once\n2\n", 0), done.stderr
