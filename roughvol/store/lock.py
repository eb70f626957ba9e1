"""The lock of the folder of a run: one process at a time, named for the others."""

from __future__ import annotations

import contextlib
import datetime
import fcntl
import json
import os
import platform
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from roughvol.errors import FolderError
from roughvol.store import stamped_file
from roughvol.store.run_folder import MAX_BYTES

ATTEMPTS, PAUSE = 10, 0.1  # to take a lock: `status` holds it for a moment


@dataclass(frozen=True)
class Holder:
    """The process that runs in a folder."""

    host: str
    pid: int
    started: str
    birth: str = ""  # differs for a later process of the same number

    def __str__(self) -> str:
        """Return process, host and start in words."""
        return f"process {self.pid} on {self.host}, since {self.started}"


@contextlib.contextmanager
def opened(folder: Path) -> Iterator[None]:
    """Make a folder if it is absent, and lock it against other runs; a `FolderError` if another run holds it.

    The lock is a file that names its process. The system frees it when the process ends. On file systems without locks,
    it is stale once its process on the same host has ended.
    """
    path, progress = folder / "lock", folder / "progress.json"
    try:
        for place in (folder, folder / "cases"):
            stamped_file.make_folder(place)
        handle = _acquire(path)
    except FolderError:
        raise
    except OSError as error:
        raise stamped_file.cannot_write(folder, error) from error
    try:
        with contextlib.suppress(OSError):
            progress.unlink(missing_ok=True)  # of a run that was killed
        yield
    finally:
        with contextlib.suppress(OSError):
            if _same_file(handle, path):  # else the folder was moved, and another run may hold this one
                path.unlink()
                progress.unlink(missing_ok=True)
        os.close(handle)


def mark(folder: Path) -> str:
    """Return the content of the lock, empty without one: it differs for folders of one name on two hosts."""
    try:
        with (folder / "lock").open("rb") as stream:
            return stream.read(MAX_BYTES).decode(errors="replace")
    except OSError:
        return ""


def holder(folder: Path) -> Holder | None:
    """Return the process that runs in a folder now, None without one."""
    try:
        handle = os.open(folder / "lock", os.O_RDONLY)
    except OSError:
        return None
    try:
        named = _named(handle)
        ours = named is not None and named.host == platform.node()
        return None if ours and _take(handle, named, shared=True) else named
    finally:
        os.close(handle)


def _acquire(path: Path) -> int:
    """Return the handle of the lock file, locked and signed."""
    for attempt in range(ATTEMPTS):
        if attempt:
            time.sleep(PAUSE)
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        with contextlib.ExitStack() as unless_taken:
            unless_taken.callback(os.close, handle)
            named = _named(handle)
            if _take(handle, named) and _same_file(handle, path):
                if named is not None and named.host != platform.node():
                    raise FolderError(f"{path.parent} is in use by {named}; if that process is no more, remove {path}")
                now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
                own = Holder(platform.node(), os.getpid(), now, _birth(os.getpid()))
                os.ftruncate(handle, 0)
                os.pwrite(handle, json.dumps(vars(own)).encode(), 0)
                os.fsync(handle)
                unless_taken.pop_all()
                return handle
    raise FolderError(
        f"{path.parent} is in use by {named or 'a process that is just starting'}; "
        "wait for it, end it, or give another folder: --out, from Python out=FOLDER"
    )


def _take(handle: int, named: Holder | None, *, shared: bool = False) -> bool:
    """Take the lock unless another process has it."""
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        return True
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks: the process named in the file decides
        pass
    if named is None or named.host != platform.node():
        return True
    return not (stamped_file.alive(named.pid) and (not named.birth or _birth(named.pid) == named.birth))


def _same_file(handle: int, path: Path) -> bool:
    """Return whether the lock is still the file of that name: a run removes its file at the end."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _named(handle: int) -> Holder | None:
    """Return the process named in a lock file, None if the content makes no sense."""
    try:
        named = Holder(**json.loads(os.pread(handle, MAX_BYTES, 0)))
    except (ValueError, TypeError, OSError, RecursionError):
        return None
    types = [*map(type, vars(named).values())]
    return named if types == [str, int, str, str] and named.pid > 0 else None


def _birth(pid: int) -> str:
    """Return the start of a process in clock ticks, empty if the system does not give it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[19]
    except (OSError, IndexError):
        return ""
