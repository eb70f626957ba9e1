"""The text of the command line: errors, progress, summaries and costs, as strings."""

from __future__ import annotations

import csv
import errno
import io
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roughvol.errors import CampaignError, RoughvolError, StudyError
from roughvol.study.values.durations import duration

if TYPE_CHECKING:
    from roughvol.campaign.batch import Progress
    from roughvol.campaign.cost import Estimate
    from roughvol.store.dataset import Dataset


_SYSTEM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG)
_MANY = os.strerror(errno.EMFILE)


def message(error: RoughvolError) -> str:
    """Return an error as text; the problems of a study line by line."""
    if isinstance(error, StudyError):
        lines = [f"  {problem}" for problem in error.problems]
        return "\n".join([f"{count(len(lines), 'problem')} in the study", *lines])
    return f"error: {error}"


def system_error(error: BaseException) -> str:
    """Return an error of the system that a user can cure, as a full disk, in words; empty for others."""
    texts = {getattr(one, "errno", None): str(one) for one in _chain(error)}
    if errno.EMFILE in texts or errno.ENFILE in texts or any(_MANY in text for text in texts.values()):
        return "too many open files; allow more of them: ulimit -n 256"
    if not isinstance(error, OSError) or error.errno not in _SYSTEM:
        return ""
    return f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror)


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and its causes."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def progress(now: Progress, seconds: float) -> str:
    """Return finished cases, steps, rate and time left in one line."""
    failed = f" ({now.failed} failed)" if now.failed else ""
    text = f"{now.kept + now.done} of {count(now.cases, 'case')}{failed}"
    if now.steps:
        text += f" · {now.steps_done} of {now.steps} steps · {now.steps_done / max(seconds, 1e-3):.0f} steps/s"
    if now.left is not None and now.work < 1.0:
        text += f" · about {duration(now.left)} left"
    return f"{text} · {now.interval}" if now.interval else text


def ran(last: Progress, seconds: float) -> str:
    """Return the number of cases of a run and its time."""
    before = f", {last.kept} of them finished before" if last.kept else ""
    return f"{count(last.cases, 'case')} in {duration(seconds)}{before}"


def summary(results: Dataset, path: Path) -> str:
    """Return states, convolutions, residual and unreached levels of a study, and the path of its file.

    Raises
    ------
    CampaignError
        If the file holds a state that did not converge.
    """
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
    lines += results.attrs.get("answer", "").splitlines()
    return "\n".join([*dict.fromkeys(lines), str(path)])


def cost(estimate: Estimate) -> str:
    """Return the cost of a study as comments of its YAML."""
    processes = count(estimate.jobs, "process", "processes")
    lines = [
        f"# {count(estimate.cases, 'case')}, {count(estimate.steps, 'state')} to solve",
        f"# memory  about {size(estimate.memory)} a process, {processes} at once",
        *([f"#         {estimate.notice}"] if estimate.notice else []),
        f"# disk    up to {size(estimate.disk)}",
        f"# time    about {duration(estimate.seconds)} (estimate from convolutions timed on this machine)",
        *(f"#         {duration(seconds)} of one core for {name}" for name, seconds in estimate.observables.items()),
    ]
    return "\n".join(lines)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in aligned columns; text to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    left = [any(cell[:1].isalpha() for cell in column) for column in zip(*rows, strict=True)] or [True] * len(head)
    lines = [
        "  ".join(
            cell.ljust(width) if words else cell.rjust(width)
            for cell, width, words in zip(line, widths, left, strict=True)
        )
        for line in (head, *rows)
    ]
    return "\n".join(line.rstrip() for line in lines)


def csv_text(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return rows as comma-separated values; a missing value is empty.

    A spreadsheet computes texts such as ``=cmd|…``. A text that begins like a formula gets an apostrophe in front.
    """
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([[_plain(cell) for cell in row] for row in (head, *rows)])
    return text.getvalue()


def _plain(cell: Any) -> Any:
    if cell is None:
        return ""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t", "\r")) else cell


def count(number: int, noun: str, plural: str = "") -> str:
    """Return a number with its noun: ``1 case``, ``2 cases``."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def size(number: float) -> str:
    """Return bytes in B to TB."""
    power = min(int(math.log10(max(number, 1.0)) / 3), 4)
    return f"{number / 1000**power:.3g} {('B', 'kB', 'MB', 'GB', 'TB')[power]}"
