"""What this machine has, and what a case takes of it: cores and memory."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from roughvol.study import Case

PROCESS_BYTES = 1.6e8  # of a process that has only imported what it needs
NODE_BYTES = 500  # of the half space and the solver
SPARED = 0.9  # the share of the available memory that a run may fill


def cores() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available_memory() -> float | None:
    """Return the bytes that can still be used, by the system and by the limit of our group; None if not told."""
    found = [_line("/proc/meminfo", "MemAvailable"), _group_left()]
    return min((value for value in found if value is not None), default=None)


def memory_of(nodes: int, fields: int = 0) -> float:
    """Return the bytes a process needs for a case with so many nodes, and fields of them kept."""
    return PROCESS_BYTES + nodes * (NODE_BYTES + 16 * fields)


def fields_of(case: Case) -> int:
    """Return how many fields of a case are kept."""
    flux = case.record.transport.flux_at if case.record.transport else None
    selects = [select for select in (case.record.fields_at, flux) if select is not None]
    return case.record.heights + sum(2 * len(select.levels) for select in selects)


def limited(jobs: int, needs: Iterable[float], available: float | None) -> tuple[int, str]:
    """Return how many processes fit, at most ``jobs`` and at least one, and a sentence if that is fewer.

    Parameters
    ----------
    needs : iterable of float
        Bytes of each case; the largest may run together.
    available : float or None
        Bytes; None if not known, then nothing is limited.
    """
    largest = sorted(needs, reverse=True)[:jobs]
    if available is None or sum(largest) <= SPARED * available:
        return jobs, ""
    fitting, used = 0, 0.0
    for need in largest:
        used += need
        if used > SPARED * available:
            break
        fitting += 1
    fitting = max(fitting, 1)
    if fitting == jobs:
        return (
            jobs,
            f"a case needs about {largest[0] / 1e9:.2g} GB, {available / 1e9:.2g} GB are available: it may fail",
        )
    return fitting, (
        f"{fitting} instead of {jobs} processes at once: a case needs about {largest[0] / 1e9:.2g} GB, "
        f"{available / 1e9:.2g} GB are available"
    )


def _line(path: str, name: str) -> float | None:
    try:
        lines = Path(path).read_text().splitlines()
    except OSError:
        return None
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith(f"{name}:")), None)


def _group_left() -> float | None:
    """Return what the limit of our control group (a container, a batch job) leaves."""
    try:
        group = Path("/proc/self/cgroup").read_text().strip().rsplit("::", 1)[-1].lstrip("/")
        folder = Path("/sys/fs/cgroup") / group
        return float((folder / "memory.max").read_text()) - float((folder / "memory.current").read_text())
    except (OSError, ValueError):  # no groups, or no limit ("max")
        return None
