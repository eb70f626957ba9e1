"""The limit of a process on its own memory, asked for before anything large is imported.

Under a limit too narrow for the libraries, an import ends in an error of its own, or hangs in a library in C.
"""

from __future__ import annotations

import errno
import os

try:
    import resource
except ImportError:  # no such limits on this system
    resource = None  # type: ignore[assignment]

# Bytes of address space that a process needs: measured with 2 cores (VmPeak of one case of m = 4, `roughvol run`), and
# for each core the stack and the buffers of its thread in the libraries of linear algebra.
LIBRARIES, PER_CORE = 4.5e8, 5e7
# Beside a case: a library that is refused its buffers may try for ever, so that a limit must not be met.
SPARE, AS_MUCH_AGAIN = 1e8, 1.5
_TOLD = ("failed to map segment", "cannot allocate memory", "thread-local data", "can't start new thread")


def address_space() -> float | None:
    """Return the bytes of address space this process may use (``ulimit -v``); None without a limit."""
    if resource is None:
        return None
    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if soft == resource.RLIM_INFINITY else float(soft)


def needed(case: float = 0.0) -> float:
    """Return the bytes of address space that one process takes, its libraries alone or with those of a case."""
    libraries = LIBRARIES + PER_CORE * (os.cpu_count() or 1)
    return libraries + SPARE + AS_MUCH_AGAIN * case if case else libraries


def too_narrow() -> str:
    """Return why no process can run under the limit there is; empty if it can."""
    limit = address_space()
    if limit is None or limit >= needed():
        return ""
    return (
        f"not enough memory: the limit of address space is {limit / 1e9:.2g} GB (ulimit -v), "
        f"and the libraries alone need about {needed() / 1e9:.2g} GB"
    )


def is_lack_of_memory(error: BaseException | None) -> bool:
    """Return whether an error, or one that caused it, is that memory has run out."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        text = str(error).lower()
        if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
            return True
        if isinstance(error, ImportError | OSError | RuntimeError) and any(part in text for part in _TOLD):
            return True
        error = error.__cause__ or error.__context__
    return False
