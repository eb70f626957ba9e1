"""Cases handed to workers, stored as they come back, with progress reported."""

from __future__ import annotations

import collections
import contextlib
import functools
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from roughvol._version import __version__
from roughvol.campaign import limits, resources, workers
from roughvol.campaign.forecast import Forecast
from roughvol.campaign.one_case import Context, HalfSpaces, Stopped, file_of_case
from roughvol.ensemble import cost
from roughvol.errors import CampaignError, RoughvolError
from roughvol.store import lock, run_folder, stamped_file
from roughvol.store.run_folder import case_file, checkpoint_file, failed_file
from roughvol.study import Case
from roughvol.study import case as one_case
from roughvol.surfaces.surface import Surface

SMALL = 0.25  # share of the available memory up to which a single worker is this process itself
SHORT = 3.0  # expected seconds of one core up to which a run takes no processes
TOLD_EVERY = 1.0  # seconds between two updates of progress.json


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


OnEvent = Callable[[Progress], None]

Task = tuple[Case, str, int, Path, str | None, Surface | None]
_held: HalfSpaces = {}  # of a worker process: the half space of its last case


def run_task(task: Task, tell: workers.Tell, *, answers: int | None = None) -> bytes | None:
    """Run one case in a worker.

    Parameters
    ----------
    task : tuple
        The case, the study as text, the threads, the path of the checkpoint, the mark of the lock of the folder (None
        on this machine), and the surface of a height file.
    tell : callable
        Receives the id of the case and the number of finished steps.
    answers : int, optional
        Answer format of the run. Default: that of this process.

    Returns
    -------
    bytes or None
        Content of the file of the case; None if the case was stopped and has stored its steps.

    Raises
    ------
    CampaignError
        If this process computes answers of another format. Nothing is computed.
    """
    if answers not in (None, one_case.ANSWER_FORMAT):
        message = (
            f"the worker on {platform.node()} has roughvol {__version__} with answers of format "
            f"{one_case.ANSWER_FORMAT}, here {answers}; start workers with the version of this run"
        )
        raise CampaignError(message)
    case, text, threads, checkpoint, mark, surface = task
    # On another machine the path may be another folder: the lock is the same only in the folder of this run.
    shared = mark is None or lock.mark(checkpoint.parent.parent) == mark != ""
    try:
        context = Context(
            _held, threads, checkpoint if shared else None, lambda step: tell((case.id, step)), workers.stop_asked
        )
        return file_of_case(case, context, study=text, surface=surface)
    except Stopped:
        return None


class Batch:
    """The cases computed now, and their progress."""

    def __init__(
        self,
        folder: Path,
        text: str,
        cases: Sequence[Case],
        kept: int,
        surface: Surface | None,
        on_event: OnEvent | None,
        *,
        alone: bool = True,
        later: float = 0.0,
    ) -> None:
        self._given = surface if alone else None  # the surface of the only case; of several, the first shows the size
        self._folder, self._text, self._kept, self._surface, self._on_event = folder, text, kept, surface, on_event
        shape = surface.shape if surface is not None else None
        works = {case.id: cost.expected_seconds(case, _shape(case, shape)) for case in cases}
        self._steps = {case.id: case.sweep.steps for case in cases}
        self._forecast = Forecast(works, self._steps, later)
        self._expected = sum(works.values())
        self._cases = sorted(cases, key=lambda case: -works[case.id])  # the longest first
        labels = collections.Counter(case.label for case in cases)
        # combinations of lists press one surface several times
        self._names = {case.id: case.label if labels[case.label] == 1 else case.id for case in cases}
        self._all_steps, self._more = sum(self._steps.values()), later > 0.0
        self._reached: dict[str, int] = {}  # steps of the cases at work
        self._steps_done, self._done = 0, 0  # of the cases that have ended
        self._failures: dict[str, BaseException] = {}
        self._versions = {__version__}  # of this process and of the workers
        self._noted = time.monotonic()

    def through(self, jobs: int | None, scheduler: str | None, stopping: Callable[[], bool]) -> None:
        """Compute all cases.

        Raises
        ------
        CampaignError
            If cases failed.
        KeyboardInterrupt
            If it was stopped before the end.
        """
        short = jobs is None and self._expected < SHORT  # processes would take longer to start
        jobs = jobs or resources.cores()
        processes = 1 if short and scheduler is None else min(jobs, len(self._cases))
        if scheduler is None:
            processes = self._limited(processes)
        here = scheduler is None and (jobs == 1 or (processes == 1 and self._small()))
        self._tell()
        self._note(at_once=True)
        threads = 1 if scheduler else max(1, jobs // processes)  # other cores work inside the convolutions
        folder, mark = self._folder.resolve(), lock.mark(self._folder) if scheduler else None
        tasks: list[Task] = [
            (case, self._text, threads, checkpoint_file(folder, case.id), mark, self._given) for case in self._cases
        ]
        try:
            workers.each(
                functools.partial(run_task, answers=one_case.ANSWER_FORMAT),
                tasks,
                jobs=processes,
                on_begin=self._begun,
                on_message=self._stepped,
                on_end=self._ended,
                stopping=stopping,
                scheduler=scheduler,
                here=here,
            )
        finally:
            stamped_file.remove_leftovers(self._folder / "cases")
        if self._done + len(self._failures) < len(tasks):
            raise KeyboardInterrupt
        if self._failures:
            error = _campaign_error(self._failures, self._kept + len(tasks))
            raise error from BaseExceptionGroup("failed", list(self._failures.values()))

    def _small(self) -> bool:
        """Return whether no case can exhaust the memory: a process of its own would only cost its start."""
        shape = self._surface.shape if self._surface else None
        most = max(resources.memory_of(case, resources.nodes_of(case, shape)) for case in self._cases)
        return most < SMALL * (resources.available_memory() or 0.0)

    def _limited(self, jobs: int) -> int:
        """Return the number of processes that memory allows, with a notice if it is smaller."""
        shape = self._surface.shape if self._surface else None
        needs = [resources.memory_of(case, resources.nodes_of(case, shape)) for case in self._cases]
        fitting, sentence = resources.limited(jobs, needs, resources.available_memory())
        if sentence:
            self._tell(notice=sentence)
        return fitting

    def _begun(self, task: Task) -> None:
        self._reached[task[0].id] = 0
        self._note()

    def _stepped(self, message: tuple[str, int]) -> None:
        if message[0] in self._reached:
            self._reached[message[0]] = message[1]
            self._forecast.reached(*message)
            self._tell()
            self._note()

    def _ended(self, task: Task, result: bytes | None, error: BaseException | None) -> None:
        case = task[0]
        if error is None and result is None:  # stopped on the way
            return
        self._reached.pop(case.id, None)
        if result is not None:
            error = self._stored(case, result)
        self._forecast.ended(case.id)
        if error is None:
            self._done += 1
            self._steps_done += self._steps[case.id]
            self._tell(f"{self._names[case.id]}: done")
        else:
            self._failures[case.id] = error
            run_folder.record_failure(self._folder, case.id, _text(error), type(error).__name__)
            self._tell(f"{self._names[case.id]}: FAILED, {_text(error)}")
        self._note()

    def _stored(self, case: Case, result: bytes) -> CampaignError | None:
        """Store the file of a case, and return an error if its answers are of another format."""
        path = case_file(self._folder, case.id)
        _, labels = stamped_file.unstamped(result, path)
        version = labels.get("version", "")
        if fault := run_folder.mismatch(path, labels, run_folder.labels_for(case)):
            message = f"a worker has roughvol {version}, whose answers are of another format: {fault}"
            return CampaignError(message)
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
        if self._on_event is None:
            return
        ended = self._done + len(self._failures) == len(self._cases)
        progress = Progress(
            cases=self._kept + len(self._cases),
            kept=self._kept,
            done=self._done,
            failed=len(self._failures),
            steps=self._all_steps,
            steps_done=self._steps_done + sum(self._reached.values()),
            work=1.0 if ended and not self._more else self._forecast.share,
            event=event,
            notice=notice,
            left=self._forecast.left(),
        )
        self._on_event(progress)

    def _note(self, *, at_once: bool = False) -> None:
        """Update progress.json if the last update is old enough."""
        now = time.monotonic()
        if at_once or now - self._noted >= TOLD_EVERY:
            self._noted = now
            run_folder.note(self._folder, {"running": list(self._reached), "left": self._forecast.left()})


def _shape(case: Case, shape: tuple[int, int] | None) -> tuple[int, int]:
    """Return the nodes of a case; of height files those of the given surface, or of m = 8."""
    nodes = case.nodes_per_side
    return (nodes, nodes) if nodes is not None else shape or (257, 257)


def _campaign_error(failures: Mapping[str, BaseException], cases: int) -> CampaignError:
    """Return an error that names every failed case."""
    lines = [f"{id}: {_text(error)}" for id, error in failures.items()]
    others = "" if len(failures) == cases else "; the others are kept"
    return CampaignError("\n".join([f"{len(failures)} of {cases} cases failed{others}", *lines]))


def _text(error: BaseException) -> str:
    if isinstance(error, workers.Lost):
        return "its process died, and again when it ran alone (out of memory?)"
    if limits.is_lack_of_memory(error):
        return "not enough memory"
    return str(error) if isinstance(error, RoughvolError) else f"{type(error).__name__}: {error}"
