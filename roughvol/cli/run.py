"""The command `run`: compute a study, with its progress."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import roughvol
from roughvol.cli.options import FRESH, JOBS, JSON, SET, STUDY, command, completed_figures, given, out
from roughvol.cli.output import count, is_seen, say, say_json, say_parts, warn_of
from roughvol.errors import CampaignError
from roughvol.study.values.durations import duration

if TYPE_CHECKING:
    from roughvol.analysis.stored_run import Run
    from roughvol.campaign.batch import Progress
    from roughvol.store.dataset import Dataset

EVENT_EVERY, PLAIN_EVERY = 1.0, 5.0  # seconds between two lines without a terminal: of a case that ended, of steps
STOPPING = "stopping after the cases at work; Ctrl-C again stops at once"
Draw = Callable[["Progress"], None]


@command
@STUDY
@JOBS
@out("runs/NAME")
@FRESH
@click.option("--scheduler", metavar="ADDRESS", help="Compute on the workers of this Dask scheduler.")
@click.option(
    "--figures",
    metavar="NAMES",
    shell_complete=completed_figures,
    help="Compute only the cases of these figures, as in fig05,fig06a.",
)
@JSON
@SET
def run(
    study: Path, out: Path | None, figures: str | None, as_json: bool, changes: tuple[str, ...], **options: Any
) -> None:
    """Compute the unfinished cases of STUDY, and collect all cases in study.nc; STUDY may be - for standard input.

    The numbers of the chief states are printed: levels asked for and ends of legs. `roughvol show` has all.

    Ctrl-C stops after the cases at work, a second one at once. The same command continues the run.
    """
    started = time.monotonic()
    from roughvol.analysis.stored_run import Run
    from roughvol.campaign import execution, signals
    from roughvol.questions import study_of
    from roughvol.report import screen
    from roughvol.store import variants

    loaded, folder = study_of(given(study, changes), changes)
    folder = out or folder
    only = roughvol.plotting.needed(figures.split(","), loaded.cases()) if figures is not None else None
    last: Progress | None = None

    def follow(now: Progress) -> None:
        nonlocal last
        last = now
        draw(now)

    progress = _bar() if is_seen() else _lines()
    with progress as draw, signals.first_interrupt(lambda: say(STOPPING, err=True)) as interrupted:
        results = execution.run(loaded, out=folder, on_event=follow, stopping=interrupted, only=only, **options)
    assert last is not None
    seconds, named = time.monotonic() - started, Run.of(loaded.name, results)
    if as_json:
        _say_record(named, last, folder / "study.nc", seconds)
        return
    before = f", {last.kept} of them finished before" if last.kept else ""
    say(f"{count(last.cases, 'case')} in {duration(seconds)}{before}")
    if "step" in results.sizes:
        say_parts(named, screen.summary)
    say("\n".join([*_summary(variants.counted_once(results, loaded), folder / "study.nc"), str(folder / "study.nc")]))
    warn_of(results)


def _say_record(run: Run, last: Progress, file: Path, seconds: float) -> None:
    """Print a run as JSON: its cases, the numbers of all surfaces as `show --json` has them, and its warnings."""
    from roughvol.report import screen

    names, rows, units = screen.records(run) if "step" in run.dataset.sizes else ([], [], {})
    cases = {"cases": last.cases, "finished_before": last.kept, "seconds": round(seconds, 3)}
    table = {"units": units, "rows": [dict(zip(names, row, strict=True)) for row in rows]}
    answer = {name: run.dataset.attrs.get(name, "").splitlines() for name in ("answer", "warnings")}
    say_json({"run": run.name, "file": str(file), **cases, **table, **answer})


def _summary(results: Dataset, path: Path) -> list[str]:
    """Return states, convolutions, residual and unreached levels of a study; unconverged states are refused."""
    from roughvol.observables.variables import STATES
    from roughvol.store import dataset

    lines = []
    if "step" in results.sizes:
        solved = results.residual.notnull()
        convolutions = float((results.convolutions + results.convolutions_fp32).where(solved).mean())
        lines.append(f"{count(int(solved.sum()), 'state')}, {convolutions:.1f} convolutions each on average")
        lines.append(f"largest residual η/σ {float(results.residual.max()):.1e}")
        if not bool(results.converged.where(solved, True).all()):
            raise CampaignError(f"{path} holds states that did not converge; please report this defect")
    if "observable" in results.sizes:
        seconds = results.observable_time.sum([dim for dim in results.observable_time.dims if dim != "observable"])
        parts = (f"{one.observable.item()} {duration(float(one))}" for one in seconds)
        lines.append(f"time of the observables, all cases: {', '.join(parts)}")
    for dim in STATES:
        for label in results.get(dim, ()):
            if absent := int((results[f"{dim}_step"].sel({dim: label}) < 0).sum()):
                lines.append(f"{label.item()} was not reached in {count(absent, 'case')}")
    for name, absent in dataset.unreached(results).items():
        lines.append(f"no state of {name} was reached in {count(absent, 'case')}")
    return list(dict.fromkeys([*lines, *results.attrs.get("answer", "").splitlines()]))


@contextlib.contextmanager
def _lines() -> Iterator[Draw]:
    """Write a line now and then."""
    last, waiting = time.monotonic(), ""

    def write(now: Progress) -> None:
        nonlocal last, waiting
        if now.notice:
            say(now.notice, err=True)
            return
        waiting = f"{now.event} · {now}" if now.event else waiting
        if time.monotonic() - last >= (EVENT_EVERY if waiting else PLAIN_EVERY):
            say(waiting or str(now), err=True)
            last, waiting = time.monotonic(), ""

    try:
        yield write
    finally:
        if waiting:
            say(waiting, err=True)


@contextlib.contextmanager
def _bar() -> Iterator[Draw]:
    """Draw on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.description}"))
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task("starting", total=1.0)

    def draw(now: Any) -> None:
        with contextlib.suppress(OSError):  # the terminal is closed
            if now.notice or (now.event and now.failed):
                bar.console.print(now.notice or now.event, markup=False, highlight=False)
            bar.update(task, completed=now.work, description=str(now))

    bar.start()
    try:
        yield draw
    finally:
        with contextlib.suppress(OSError):
            bar.stop()
