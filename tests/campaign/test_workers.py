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

from roughvol.campaign import workers

pytestmark = pytest.mark.processes


def _task(number: int, tell: Callable[[Any], None]) -> None:
    if number == 2:
        raise ValueError("two is not wanted")
    for value in range(100):  # far more than are passed on
        tell((number, os.getpid(), value))


def _die(number: int, tell: Callable[[Any], None]) -> None:
    if number == 0:
        os._exit(7)
    time.sleep(0.05)


def _die_once(task: tuple[int, Path], tell: Callable[[Any], None]) -> int:
    number, died = task
    if number == 0 and not died.exists():
        died.touch()
        os._exit(7)
    return 10 * number


def _nap(number: int, tell: Callable[[Any], None]) -> int:
    time.sleep(0.05)
    return number


def _sleep(number: int, tell: Callable[[Any], None]) -> None:
    tell(number)
    time.sleep(60)


def test_every_task_ends_once_elsewhere_and_errors_come_back() -> None:
    messages: list[tuple[int, int, int]] = []
    ended: dict[int, BaseException | None] = {}
    workers.each(
        _task,
        range(5),
        jobs=2,
        on_message=messages.append,
        on_end=lambda task, result, error: ended.update({task: error}),
    )
    assert sorted(ended) == [0, 1, 2, 3, 4]
    assert {task for task, error in ended.items() if error is not None} == {2}
    assert str(ended[2]) == "two is not wanted"
    assert os.getpid() not in {pid for _, pid, _ in messages}
    assert 0 < len(messages) <= 10


def test_a_task_that_kills_its_process_is_given_up_and_costs_no_other(tmp_path: Path) -> None:
    ended: dict[int, BaseException | None] = {}
    workers.each(
        _die, range(6), jobs=3, on_message=print, on_end=lambda task, result, error: ended.update({task: error})
    )
    assert sorted(ended) == list(range(6))
    assert isinstance(ended.pop(0), workers.Lost)
    assert set(ended.values()) == {None}


def test_a_process_killed_once_costs_nothing(tmp_path: Path) -> None:
    tasks = [(number, tmp_path / "died") for number in range(4)]
    results: dict[int, int] = {}
    workers.each(
        _die_once, tasks, jobs=2, on_message=print, on_end=lambda task, result, error: results.update({task[0]: result})
    )
    assert results == {0: 0, 1: 10, 2: 20, 3: 30}


def test_a_stop_lets_end_what_has_begun_and_begins_no_more() -> None:
    ended: list[int] = []
    all_begun = workers.each(
        _nap,
        range(20),
        jobs=2,
        on_message=print,
        on_end=lambda task, result, error: ended.append(result),
        stopping=lambda: len(ended) >= 2,
    )
    assert not all_begun
    assert 2 <= len(ended) <= 6
    assert sorted(ended) == list(range(len(ended)))


def test_an_exception_here_ends_the_tasks_there() -> None:
    def stop(message: Any) -> None:
        raise KeyboardInterrupt

    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        workers.each(_sleep, [0, 1, 2, 3], jobs=2, on_message=stop, on_end=lambda task, result, error: None)
    assert time.monotonic() - started < 30  # the tasks sleep for 60


def test_main_is_what_it_was() -> None:
    main = sys.modules["__main__"]
    workers.each(_task, [0], jobs=1, on_message=lambda message: None, on_end=lambda task, result, error: None)
    assert sys.modules["__main__"] is main


def _here(number: int, tell: Callable[[Any], None]) -> tuple[int, int, bool]:
    tell(number)
    if number == 2:
        raise ValueError("two is not wanted")
    return number, os.getpid(), workers.stop_asked()


def test_in_this_process_the_same_is_told_in_the_same_order() -> None:
    told: list[Any] = []
    how: dict[str, Any] = {
        "jobs": 3,
        "on_begin": lambda task: told.append(("begin", task)),
        "on_message": lambda message: told.append(("message", message)),
        "on_end": lambda task, result, error: told.append((task, result, str(error or ""))),
    }
    with workers.in_this_process():
        assert workers.each(_here, range(4), **how)
    for number in range(4):
        end = (None, "two is not wanted") if number == 2 else ((number, os.getpid(), False), "")
        assert told[3 * number : 3 * number + 3] == [("begin", number), ("message", number), (number, *end)]
    assert not workers.stop_asked()


def test_in_this_process_a_stop_is_heard_by_the_task_and_by_the_next() -> None:
    ended: list[Any] = []
    asked = iter([False, True])  # once before the first task, then by the task
    with workers.in_this_process():
        all_begun = workers.each(
            _here,
            range(4),
            jobs=1,
            on_message=print,
            on_end=lambda task, result, error: ended.append(result),
            stopping=lambda: next(asked, True),
        )
    assert not all_begun
    assert ended == [(0, os.getpid(), True)]


def _interrupted(number: int, tell: Callable[[Any], None]) -> None:
    raise KeyboardInterrupt


def test_in_this_process_an_interrupt_of_a_task_ends_all() -> None:
    ended: list[int] = []
    with pytest.raises(KeyboardInterrupt), workers.in_this_process():
        workers.each(
            _interrupted, range(3), jobs=1, on_message=print, on_end=lambda task, result, error: ended.append(task)
        )
    assert ended == []
    assert not workers.stop_asked()


def test_a_context_inside_another_computes_in_processes_again() -> None:
    pids: list[int] = []
    with workers.in_this_process(), workers.in_this_process(False):
        workers.each(_here, [0], jobs=1, on_message=print, on_end=lambda task, result, error: pids.append(result[1]))
    assert pids != [os.getpid()]


def test_a_plain_script_does_not_start_itself_again(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text("surface: {D: 2.5, m: 2, seeds: 2}\nsweep: {steps: 2}\n")
    script = tmp_path / "script.py"
    script.write_text("import roughvol\nprint('once')\nprint(dict(roughvol.run('study.yaml').sizes)['seed'])\n")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert (done.stdout, done.returncode) == ("once\n2\n", 0), done.stderr
