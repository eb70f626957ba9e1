"""Cores, memory and disk of this machine, and the limit of the address space of a process.

The limit is checked before any large import: under a limit too narrow for the libraries an import fails, or hangs in a
library in C.
"""

import contextlib
import errno
import os
import resource
import shutil
from numbers import Integral
from pathlib import Path

from roughvol.errors import CampaignError

# Bytes of address space of a process: VmPeak of one case of m = 4 with 2 cores, `roughvol run`. For each core: stack
# and buffers of its thread in the libraries of linear algebra.
LIBRARIES, PER_CORE = 4.5e8, 5e7
# Beside a case. A library without its buffers may retry forever, so the limit must not be reached.
SPARE, AS_MUCH_AGAIN = 1e8, 1.5
_MESSAGES = ("failed to map segment", "cannot allocate memory", "thread-local data", "can't start new thread")


def check_jobs(jobs: int | None) -> None:
    """Refuse a number of processes that is no whole number, 1 or more; None is one a core."""
    if jobs is not None and not (isinstance(jobs, Integral) and jobs >= 1):
        raise CampaignError(f"jobs is {jobs!r}; allowed: a whole number, 1 or more")


def address_space() -> float | None:
    """Return the limit of the address space in bytes (``ulimit -v``); None without one."""
    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if soft == resource.RLIM_INFINITY else float(soft)


def needed_space(case: float = 0.0) -> float:
    """Return the bytes of address space of a process, for its libraries and ``case`` bytes of a case."""
    libraries = LIBRARIES + PER_CORE * (os.cpu_count() or 1)
    return libraries + SPARE + AS_MUCH_AGAIN * case if case else libraries


def too_narrow() -> str:
    """Return a message if the limit is too narrow for the libraries, else an empty one."""
    limit = address_space()
    if limit is None or limit >= needed_space():
        return ""
    return (
        f"not enough memory: the limit of address space is {size(limit)} (ulimit -v), "
        f"and the libraries alone need about {size(needed_space())}"
    )


def size(number: float) -> str:
    """Return bytes in B to TB, with three digits."""
    for unit in ("B", "kB", "MB", "GB"):
        if number < 999.5:
            return f"{number:.3g} {unit}"
        number /= 1000.0
    return f"{number:.3g} TB" if number < 999.5 else f"{number:.0f} TB"


def with_causes(error: BaseException | None) -> list[BaseException]:
    """Return an error and its causes."""
    found: list[BaseException] = []
    while error is not None and error not in found:
        found.append(error)
        error = error.__cause__ or error.__context__
    return found


def is_lack_of_memory(error: BaseException | None) -> bool:
    """Return whether an error or one of its causes is a lack of memory."""
    for cause in with_causes(error):
        text = str(cause).lower()
        if isinstance(cause, MemoryError) or (isinstance(cause, OSError) and cause.errno == errno.ENOMEM):
            return True
        if isinstance(cause, ImportError | OSError | RuntimeError) and any(part in text for part in _MESSAGES):
            return True
    return False


def cores() -> int:
    """Return the number of cores open to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available_memory() -> float | None:
    """Return the bytes left by the system and by the control group, None if unknown."""
    return min((value for value in (_memory_left(), _group_left()) if value is not None), default=None)


def free_disk(folder: Path) -> float | None:
    """Return the free bytes at a folder that exists or would be made, None if unknown."""
    for place in (folder, *folder.parents):  # the last is "." or "/"
        with contextlib.suppress(OSError):  # not there yet, a name too long, or the current folder has vanished
            return float(shutil.disk_usage(place).free)
    return None


def _memory_left() -> float | None:
    with contextlib.suppress(OSError):
        lines = (line.split() for line in Path("/proc/meminfo").read_text().splitlines())
        return next((1024.0 * int(line[1]) for line in lines if line[0] == "MemAvailable:"), None)
    return None


def _group_left() -> float | None:
    """Return the bytes left by the limit of the control group (a container, a batch job), None without one."""
    with contextlib.suppress(OSError, ValueError):  # no groups, or no limit ("max")
        group = Path("/proc/self/cgroup").read_text().strip().rsplit("::", 1)[-1].lstrip("/")
        folder = Path("/sys/fs/cgroup") / group
        left = float((folder / "memory.max").read_text()) - float((folder / "memory.current").read_text())
        return max(left, 0.0)  # a limit that was lowered lies below what is in use
    return None
