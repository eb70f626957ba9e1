"""Cases handed to workers, stored as they come back, with progress reported."""

from __future__ import annotations

import contextlib
import math
import os
import platform
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from roughvol._version import __version__
from roughvol.campaign import cost, machine, workers
from roughvol.campaign.one_case import Context, HalfSpaces, Stopped, file_of_case
from roughvol.ensemble.cost import expected_seconds
from roughvol.errors import CampaignError, RoughvolError
from roughvol.store import lock, run_folder, stamped_file
from roughvol.store.run_folder import case_file, checkpoint_file, failed_file
from roughvol.study import Case
from roughvol.study import case as one_case
from roughvol.study.values.durations import duration
from roughvol.surfaces.surface import Surface

SMALL = 0.25  # share of the available memory up to which a single worker is this process itself
SHORT = 3.0  # expected seconds of one core up to which a run takes no processes
SETTLED = 30.0  # seconds after which the rate of the work is known: before, it is that of the start
TOLD_EVERY, NOTED_EVERY = 0.2, 1.0  # seconds between two messages of a case, and between two updates of progress.json


@dataclass(frozen=True)
class Progress:
    """The progress of a run.

    Attributes
    ----------
    cases, kept, done, failed : int
        Number of cases: all, finished before, finished now, failed now.
    steps, steps_done : int
        Number of steps of the cases computed now.
    work : float
        Share of the work done, 0 to 1. A step weighs its expected cost.
    event, notice : str
        A line on a case that has just ended; a line on the run, as a file set aside. Else empty.
    interval : str
        Half-width of an ensemble beside the requested one. Else empty.
    left : float, optional
        Expected seconds until the end of the run.

    See Also
    --------
    roughvol.run : Calls ``on_event`` with it.

    Examples
    --------
    >>> import roughvol
    >>> seen = []
    >>> study = {"name": "seen", "surface": {"D": 2.5, "m": 3, "seeds": 2}, "sweep": {"steps": 2}}
    >>> _ = roughvol.run(study, jobs=1, on_event=seen.append)
    >>> seen[-1].cases, seen[-1].done, seen[-1].work
    (2, 2, 1.0)
    """

    cases: int
    kept: int
    done: int = 0
    failed: int = 0
    steps: int = 0
    steps_done: int = 0
    work: float = 0.0
    event: str = ""
    notice: str = ""
    interval: str = ""
    left: float | None = None

    def __str__(self) -> str:
        """Return finished cases, steps, time left and interval in one line."""
        parts = [f"{self.kept + self.done} of {self.cases} case{'s' * (self.cases != 1)}"]
        parts[0] += f" ({self.failed} failed)" * (self.failed > 0)
        if self.steps:
            parts.append(f"{self.steps_done} of {self.steps} steps")
        if self.left is not None and self.work < 1.0:
            parts.append(f"about {duration(self.left)} left")
        return " · ".join(filter(None, (*parts, self.interval)))


OnEvent = Callable[[Progress], None]


@dataclass(frozen=True)
class Control:
    """Where a run computes, and who follows and stops it; it changes no value. The fields are arguments of `run`."""

    jobs: int | None = None
    scheduler: str | None = None
    on_event: OnEvent = lambda progress: None
    stopping: Callable[[], bool] = lambda: False


@dataclass(frozen=True)
class Task:
    """A case with all that a worker needs for it."""

    case: Case
    context: Context
    mark: str | None  # of the lock of the folder, see `lock.mark`; None on this machine
    answers: int  # answer format of the run


_held: HalfSpaces = {}  # of a worker process: the half space of its last case
os.register_at_fork(after_in_child=_held.clear)  # a fork has no threads of this half space, and would wait for them


def run_task(task: Task, tell: Callable[[tuple[str, int]], None], stopping: Callable[[], bool]) -> bytes | None:
    """Return the content of the file of a case, run in a worker; None if it was stopped and has stored its steps."""
    if task.answers != one_case.ANSWER_FORMAT:
        raise CampaignError(
            f"the worker on {platform.node()} has roughvol {__version__} with answers of format "
            f"{one_case.ANSWER_FORMAT}, here {task.answers}; start workers with the version of this run"
        )
    told = 0.0

    def on_step(step: int) -> None:
        nonlocal told
        if time.monotonic() - told >= TOLD_EVERY:
            told = time.monotonic()
            tell((task.case.id, step))

    context = replace(task.context, half_spaces=_held, on_step=on_step, stopping=stopping)
    # On another machine the path may be another folder: the lock is the same only in the folder of this run.
    if context.checkpoint and task.mark not in (None, lock.mark(context.checkpoint.parent.parent) or None):
        context = replace(context, checkpoint=None)
    try:
        return file_of_case(task.case, context)
    except Stopped:
        return None


class Forecast:
    """The work of a run in one batch or several: all, done and left. It begins with the first batch."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._started = clock, math.nan
        self._works, self._steps, self._done = dict[str, float](), dict[str, int](), dict[str, float]()
        self._all = 0.0

    def expect(self, works: Mapping[str, float], steps: Mapping[str, int], later: float = 0.0) -> None:
        """Begin a batch: seconds, whose ratios count, and steps of its cases by id, and the seconds of later ones."""
        if not self._works:
            self._started = self._clock()
        self._works |= works
        self._steps |= steps
        self._all = math.fsum(self._works.values()) + later

    def reached(self, id: str, step: int) -> None:
        """Note the finished steps of a case at work."""
        self._done[id] = self._works[id] * (step / max(self._steps[id], 1))  # the last step is all, to the bit

    def ended(self, id: str) -> None:
        """Note that a case has ended."""
        self._done[id] = self._works[id]

    @property
    def share(self) -> float:
        """Share of the work that is done, 0 to 1."""
        return math.fsum(self._done.values()) / self._all if self._all > 0.0 else 1.0

    def left(self) -> float | None:
        """Return the seconds until the end of the run; None while its rate is not known.

        The first seconds start processes and compile flows. They take many times as long as a step.
        """
        share, seconds = self.share, self._clock() - self._started
        return seconds * (1.0 - share) / share if share > 0.0 and seconds >= SETTLED else None


class Batch:
    """The cases computed now, and their progress.

    ``study`` is the study as text, ``kept`` the number of cases finished before, ``surface`` that of a case alone,
    if it was read. ``forecast`` is that of earlier batches, ``later`` are the expected seconds of later ones.
    ``names``: cases in words by id; default their labels.
    """

    def __init__(
        self,
        folder: Path,
        study: str,
        cases: Sequence[Case],
        kept: int,
        control: Control,
        *,
        surface: Surface | None = None,
        forecast: Forecast | None = None,
        later: float = 0.0,
        names: Mapping[str, str] | None = None,
    ) -> None:
        self._folder, self._study, self._control, self._surface = folder, study, control, surface
        works = {case.id: expected_seconds(case) for case in cases}
        self._steps = {case.id: case.sweep.steps for case in cases}
        self._now = Progress(cases=kept + len(cases), kept=kept, steps=sum(self._steps.values()))
        self._forecast = forecast or Forecast()
        self._forecast.expect(works, self._steps, later)
        self._expected = sum(works.values())
        self._cases = sorted(cases, key=lambda case: -works[case.id])  # the longest first
        named = {case.id: (names or {}).get(case.id, case.label) for case in cases}
        often = Counter(named.values())
        self._names = {id: name if often[name] == 1 else id for id, name in named.items()}
        self._reached: dict[str, int] = {}  # steps of the cases at work
        self._steps_done = 0  # of the cases that have ended
        self._failures: dict[str, BaseException] = {}
        self._versions = {__version__}  # of this process and of the workers
        self._noted = -math.inf

    def compute(self) -> None:
        """Compute all cases; raise a `CampaignError` if cases failed, and KeyboardInterrupt if the run was stopped."""
        scheduler, jobs = self._control.scheduler, self._control.jobs or machine.cores()
        processes, here = self._processes(jobs) if scheduler is None else (jobs, False)
        self._tell()
        self._note()
        threads = 1 if scheduler else max(1, jobs // processes)  # other cores work inside the convolutions
        folder, mark = self._folder.resolve(), lock.mark(self._folder) if scheduler else None
        context = Context(threads=threads, study=self._study, surface=self._surface)
        tasks = [
            Task(case, replace(context, checkpoint=checkpoint_file(folder, case.id)), mark, one_case.ANSWER_FORMAT)
            for case in self._cases
        ]
        try:
            workers.each(
                run_task,
                tasks,
                jobs=processes,
                on_begin=self._begun,
                on_message=self._stepped,
                on_end=self._ended,
                stopping=self._control.stopping,
                scheduler=scheduler,
                here=here,
            )
        finally:
            stamped_file.remove_leftovers(self._folder / "cases")
        if self._now.done + self._now.failed < len(tasks):
            raise KeyboardInterrupt
        if self._failures:
            lines = [f"{id}: {_text(error)}" for id, error in self._failures.items()]
            others = "" if len(lines) == self._now.cases else "; the others are kept"
            message = "\n".join([f"{len(lines)} of {self._now.cases} cases failed{others}", *lines])
            raise CampaignError(message) from BaseExceptionGroup("failed", list(self._failures.values()))

    def _processes(self, jobs: int) -> tuple[int, bool]:
        """Return the number of processes, and whether the only one is this process itself.

        It is for ``jobs=1``, and for runs shorter than the start of processes where no case can exhaust the memory.
        """
        short = self._control.jobs is None and self._expected < SHORT
        processes = 1 if short else min(jobs, len(self._cases))
        needs = [cost.memory_of(case) for case in self._cases]
        available = machine.available_memory()
        processes, sentence = cost.limited(processes, needs, available)
        if sentence:
            self._tell(notice=sentence)
        return processes, jobs == 1 or (processes == 1 and max(needs) < SMALL * (available or 0.0))

    def _begun(self, task: Task) -> None:
        self._reached[task.case.id] = 0
        self._note()

    def _stepped(self, message: tuple[str, int]) -> None:
        if message[0] in self._reached:
            self._reached[message[0]] = message[1]
            self._forecast.reached(*message)
            self._tell()
            self._note()

    def _ended(self, task: Task, result: bytes | None, error: BaseException | None) -> None:
        case = task.case
        if error is None and result is None:  # stopped on the way
            return
        self._reached.pop(case.id, None)
        if result is not None:
            error = self._stored(case, result)
        self._forecast.ended(case.id)
        if error is None:
            self._now = replace(self._now, done=self._now.done + 1)
            self._steps_done += self._steps[case.id]
            self._tell(f"{self._names[case.id]}: done")
        else:
            self._failures[case.id] = error
            self._now = replace(self._now, failed=len(self._failures))
            run_folder.record_failure(self._folder, case.id, _text(error), type(error).__name__)
            self._tell(f"{self._names[case.id]}: FAILED, {_text(error)}")
        self._note()

    def _stored(self, case: Case, result: bytes) -> CampaignError | None:
        """Store the file of a case, and return an error if its answers are of another format."""
        path = case_file(self._folder, case.id)
        _, labels = stamped_file.unstamped(result, path)
        version = labels.get("version", "")
        if fault := run_folder.mismatch(path, labels, run_folder.labels_for(case)):
            return CampaignError(f"a worker has roughvol {version}, whose answers are of another format: {fault}")
        if version not in self._versions:
            self._versions.add(version)
            self._tell(notice=f"a worker has roughvol {version}, here is {__version__}: answers of one format")
        stamped_file.store(path, result)
        for old in (failed_file(self._folder, case.id), checkpoint_file(self._folder, case.id)):
            with contextlib.suppress(OSError):
                old.unlink(missing_ok=True)
        return None

    def _tell(self, event: str = "", notice: str = "") -> None:
        """Report the progress to the caller of the run."""
        steps, share, left = self._steps_done + sum(self._reached.values()), self._forecast.share, self._forecast.left()
        now = replace(self._now, steps_done=steps, work=share, left=left, event=event, notice=notice)
        self._control.on_event(now)

    def _note(self) -> None:
        """Update progress.json if the last update is old enough."""
        now = time.monotonic()
        if now - self._noted >= NOTED_EVERY:
            self._noted = now
            run_folder.note(self._folder, {"running": list(self._reached), "left": self._forecast.left()})


def _text(error: BaseException) -> str:
    if isinstance(error, workers.Lost):
        return "its process died, and again when it ran alone (out of memory?)"
    if machine.is_lack_of_memory(error):
        return "not enough memory"
    return str(error) if isinstance(error, RoughvolError) else f"{type(error).__name__}: {error}"
