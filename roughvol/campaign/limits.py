"""Limit of the address space of a process, checked before any large import.

Under a limit too narrow for the libraries an import fails, or hangs in a library in C.
"""

from __future__ import annotations

import errno
import os

try:
    import resource
except ImportError:  # a system without such limits
    resource = None  # type: ignore[assignment]

# Bytes of address space of a process: VmPeak of one case of m = 4 with 2 cores, `roughvol run`. For each core: stack
# and buffers of its thread in the libraries of linear algebra.
LIBRARIES, PER_CORE = 4.5e8, 5e7
# Beside a case. A library without its buffers may retry forever, so the limit must not be reached.
SPARE, AS_MUCH_AGAIN = 1e8, 1.5
_MESSAGES = ("failed to map segment", "cannot allocate memory", "thread-local data", "can't start new thread")


def address_space() -> float | None:
    """Return the limit of the address space in bytes (``ulimit -v``); None without one."""
    if resource is None:
        return None
    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if soft == resource.RLIM_INFINITY else float(soft)


def needed(case: float = 0.0) -> float:
    """Return the bytes of address space of a process, for its libraries and ``case`` bytes of a case."""
    libraries = LIBRARIES + PER_CORE * (os.cpu_count() or 1)
    return libraries + SPARE + AS_MUCH_AGAIN * case if case else libraries


def too_narrow() -> str:
    """Return a message if the limit is too narrow for the libraries, else an empty one."""
    limit = address_space()
    if limit is None or limit >= needed():
        return ""
    return (
        f"not enough memory: the limit of address space is {limit / 1e9:.2g} GB (ulimit -v), "
        f"and the libraries alone need about {needed() / 1e9:.2g} GB"
    )


def is_lack_of_memory(error: BaseException | None) -> bool:
    """Return whether an error or one of its causes is a lack of memory."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        text = str(error).lower()
        if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
            return True
        if isinstance(error, ImportError | OSError | RuntimeError) and any(part in text for part in _MESSAGES):
            return True
        error = error.__cause__ or error.__context__
    return False
