"""Cores, memory and disk of this machine, and the needs of a case."""

from __future__ import annotations

import contextlib
import math
import os
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from roughvol.campaign import limits
from roughvol.errors import CampaignError, ResourceError
from roughvol.gap.network import check_multigrid, needs_multigrid
from roughvol.observables import requests
from roughvol.observables.variables import OBSERVABLES
from roughvol.study import Case

# Bytes, from the growth of the largest resident set of `run_case` at m = 9 and 10 (D = 2.5; docs/how-to/cluster.md).
PROCESS_BYTES = 2e8  # of a process after its imports
SURFACE_BYTES, NODE_BYTES = 50, 280  # per node: of a surface alone; of half space and solver
SKEWED_BYTES = 25  # per node, in addition: while heights get their skewness
CHANNEL_BYTES, FLOW_BYTES = 200, 1300  # per node, in addition: of a search for the last channel; of a flow
LARGE_FLOW_BYTES = 650  # per node: of a flow by multigrid (python -m tests.bench.flow 12 0.1)
GAS_BYTES = 150  # per node, in addition: conductances of a gas
FIELD_BYTES = 16  # per node and stored field
FILE_BYTES = 1.2e5  # of the file of a case without fields
SMALL = 1e9  # never refused up to here: the estimate is rough
SPARED = 0.9  # largest share of the available memory


def cores() -> int:
    """Return the number of cores open to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available_memory() -> float | None:
    """Return the bytes left by the system and by the control group, None if unknown."""
    values = [_line("/proc/meminfo", "MemAvailable"), _group_left()]
    return min((value for value in values if value is not None), default=None)


def free_disk(folder: Path) -> float | None:
    """Return the free bytes at a folder that exists or would be made, None if unknown."""
    folder = folder.absolute()
    for place in (folder, *folder.parents):
        with contextlib.suppress(OSError):  # not there yet, or a name too long
            return float(shutil.disk_usage(place).free)
    return None


def memory_of(case: Case, nodes: int) -> float:
    """Return the bytes of memory that a process needs for a case of that many nodes."""
    if case.sweep.steps == 0:
        skewed = case.spectrum is not None and case.spectrum.Ssk is not None
        return PROCESS_BYTES + nodes * (SURFACE_BYTES + SKEWED_BYTES * skewed + FIELD_BYTES * fields_of(case))
    per_node = NODE_BYTES + FIELD_BYTES * fields_of(case)
    if (elements := flow_elements(case, nodes)) > 0:
        per_node += LARGE_FLOW_BYTES if needs_multigrid(elements) else FLOW_BYTES
        per_node += GAS_BYTES * (case.gas is not None)
    per_node += CHANNEL_BYTES * any(leg.target.kind.startswith("percolation") for leg in case.sweep.legs)
    return PROCESS_BYTES + nodes * per_node


def flow_elements(case: Case, nodes: int) -> int:
    """Return the number of elements of the largest flow that a case asks for, 0 without one."""
    rows = [OBSERVABLES[name] for name in requests.asked(case.record)]
    shares = [max(requests.passes(row, case.record)) for row in rows if row.flow]
    return math.ceil(nodes * max(shares, default=0.0))


def disk_of(case: Case, nodes: int) -> float:
    """Return an upper bound of the bytes in the file of a case; compressed fields take less."""
    return FILE_BYTES + 8 * nodes * fields_of(case)


def nodes_of(case: Case, shape: tuple[int, int] | None) -> int:
    """Return the number of nodes of a case; ``shape`` is that of a surface from a height file."""
    return case.nodes_per_side**2 if case.nodes_per_side is not None else math.prod(shape or (0,))


def fields_of(case: Case) -> int:
    """Return how many fields of a case are kept."""
    return requests.fields_of(case.record)


def check_resources(
    cases: Sequence[Case], nodes: Sequence[int], disk: float, folder: Path, *, here: bool = True
) -> None:
    """Refuse cases that exceed the memory or the disk of this machine, even in one process.

    Parameters
    ----------
    cases, nodes : sequences of equal length
        The cases to compute, and the number of nodes of each.
    disk : float
        Bytes of the files to write.
    folder : Path
        Folder of the results.
    here : bool
        Whether this machine computes; the memory of a cluster is unknown.

    Raises
    ------
    ResourceError
        If a case needs more memory than is available, or the files more disk than is free.
    ContactError
        If a flow needs pyamg, and it is not installed.
    CampaignError
        If the limit of a process on its memory is too small (``ulimit -v``).
    """
    problems = []
    if here:
        check_multigrid(max((flow_elements(c, n) for c, n in zip(cases, nodes, strict=True)), default=0))
    if here and cases:
        need, case = max(((memory_of(c, n), c) for c, n in zip(cases, nodes, strict=True)), key=lambda pair: pair[0])
        available, limit = available_memory(), limits.address_space()
        if available is not None and need > max(available, SMALL):
            problems.append(f"{case.label} needs about {_size(need)} of memory, {_size(available)} are available")
        if limit is not None and (space := limits.needed(need - PROCESS_BYTES)) > limit:
            message = (
                f"not enough memory: {case.label} needs about {_size(space)} of address space, "
                f"the limit is {_size(limit)} (ulimit -v)"
            )
            raise CampaignError(message)
    free = free_disk(folder)
    if free is not None and disk > max(free, SMALL):
        problems.append(f"the results need up to {_size(disk)} of disk, {_size(free)} are free at {folder}")
    if problems:
        raise ResourceError("this study does not fit: " + "; ".join(problems))


def limited(jobs: int, needs: Iterable[float], available: float | None) -> tuple[int, str]:
    """Return the number of processes that fit in memory, from one to ``jobs``, and a sentence if it is smaller.

    Parameters
    ----------
    jobs : int
        Number of processes asked for.
    needs : iterable of float
        Bytes of each case; the largest may run together.
    available : float or None
        Bytes available, None for no limit.
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
    need_text = f"a case needs about {largest[0] / 1e9:.2g} GB, {available / 1e9:.2g} GB are available"
    return fitting, (
        f"{need_text}: it may fail"
        if fitting == jobs
        else f"{fitting} instead of {jobs} processes at once: {need_text}"
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
    """Return the bytes left by the limit of the control group (a container, a batch job), None without one."""
    try:
        group = Path("/proc/self/cgroup").read_text().strip().rsplit("::", 1)[-1].lstrip("/")
        folder = Path("/sys/fs/cgroup") / group
        return float((folder / "memory.max").read_text()) - float((folder / "memory.current").read_text())
    except (OSError, ValueError):  # no groups, or no limit ("max")
        return None
