"""What this machine has, and what a case takes of it: cores, memory and disk."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from roughvol.campaign import limits
from roughvol.errors import CampaignError, ResourceError
from roughvol.observables import recorded
from roughvol.study import Case

# Bytes, as the largest resident set of `run_case` grew at m = 9 and 10 (D = 2.5; docs/cluster.md).
PROCESS_BYTES = 2e8  # of a process that has only imported what it needs
SURFACE_BYTES, NODE_BYTES = 50, 280  # a node: of a surface alone; of the half space and the solver
CHANNEL_BYTES, FLOW_BYTES = 200, 1300  # a node, beside these: of a search for the last channel, of a flow
FIELD_BYTES = 16  # a node and field kept
FILE_BYTES = 1.2e5  # of a case without fields on disk
SMALL = 1e9  # up to which nothing is refused: the estimate is rough, and what fails, fails soon
SPARED = 0.9  # the share of the available memory that a run may fill


def cores() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available_memory() -> float | None:
    """Return the bytes that can still be used, by the system and by the limit of our group; None if not told."""
    found = [_line("/proc/meminfo", "MemAvailable"), _group_left()]
    return min((value for value in found if value is not None), default=None)


def free_disk(place: Path) -> float | None:
    """Return the bytes that are free where a folder is or would be made; None if the system does not tell."""
    place = place.absolute()
    there = next((folder for folder in (place, *place.parents) if folder.exists()), place)
    try:
        return float(shutil.disk_usage(there).free)
    except OSError:
        return None


def memory_of(case: Case, nodes: int) -> float:
    """Return the bytes a process needs for a case on so many nodes."""
    if case.sweep.steps == 0:
        return PROCESS_BYTES + nodes * (SURFACE_BYTES + FIELD_BYTES * fields_of(case))
    transport, widths = case.record.transport, case.record.region_widths
    flows = [transport.transmissivity, transport.diffusivity, transport.flux_at] if transport else []
    flows += [widths.transmissivity] if widths else []
    each = NODE_BYTES + FIELD_BYTES * fields_of(case)
    each += FLOW_BYTES * any(flow is not None for flow in flows)
    each += CHANNEL_BYTES * case.sweep.target.kind.startswith("percolation")
    return PROCESS_BYTES + nodes * each


def disk_of(case: Case, nodes: int) -> float:
    """Return the most bytes that the file of a case takes; fields are compressed, and take less."""
    return FILE_BYTES + 8 * nodes * fields_of(case)


def nodes_of(case: Case, shape: tuple[int, int] | None) -> int:
    """Return the nodes of a case; ``shape`` is that of the surface from its height file."""
    return (2**case.m + 1) ** 2 if case.m is not None else math.prod(shape or (0,))


def fields_of(case: Case) -> int:
    """Return how many fields of a case are kept."""
    return recorded.fields_of(case.record)


def check_fits(cases: Sequence[Case], nodes: Sequence[int], disk: float, place: Path, *, here: bool = True) -> None:
    """Refuse what this machine cannot hold, however few processes compute it; what needs less than 1 GB is tried.

    Parameters
    ----------
    cases, nodes : sequences of equal length
        What is to be computed, and the nodes of each.
    disk : float
        Bytes of the files to be written.
    place : Path
        Folder of the results.
    here : bool
        Whether the cases are computed on this machine; the memory of a cluster is not known.

    Raises
    ------
    ResourceError
        If a case needs more memory than is available, or the files more disk than is free.
    CampaignError
        If a process may not have what a case needs (``ulimit -v``).
    """
    wanting = []
    if here and cases:
        need, case = max(((memory_of(c, n), c) for c, n in zip(cases, nodes, strict=True)), key=lambda pair: pair[0])
        available, limit = available_memory(), limits.address_space()
        if available is not None and need > max(available, SMALL):
            wanting.append(f"{case.label} needs about {_size(need)} of memory, {_size(available)} are available")
        if limit is not None and (space := limits.needed(need - PROCESS_BYTES)) > limit:
            message = (
                f"not enough memory: {case.label} needs about {_size(space)} of address space, "
                f"the limit is {_size(limit)} (ulimit -v)"
            )
            raise CampaignError(message)
    free = free_disk(place)
    if free is not None and disk > max(free, SMALL):
        wanting.append(f"the results need up to {_size(disk)} of disk, {_size(free)} are free at {place}")
    if wanting:
        message = "this study does not fit: " + "; ".join(wanting)
        raise ResourceError(message)


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
    held = f"a case needs about {largest[0] / 1e9:.2g} GB, {available / 1e9:.2g} GB are available"
    return fitting, (
        f"{held}: it may fail" if fitting == jobs else f"{fitting} instead of {jobs} processes at once: {held}"
    )


def _size(number: float) -> str:
    return f"{number / 1e12:.3g} TB" if number >= 1e12 else f"{number / 1e9:.3g} GB"


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
