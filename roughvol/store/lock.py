"""The lock of the folder of a run: one process at a time, and its name for the others."""

from __future__ import annotations

import contextlib
import datetime
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

try:
    import fcntl
except ImportError:  # no such calls on this system: the lock is then told stale by its process alone
    fcntl = None  # type: ignore[assignment]

ATTEMPTS, PAUSE = 10, 0.1  # at a lock: a look at it, as `status` takes one, holds it for a moment


@dataclass(frozen=True)
class Holder:
    """The process that runs in a folder."""

    host: str
    pid: int
    started: str
    birth: str = ""  # tells it from a later process of the same number

    def __str__(self) -> str:
        """Return who and since when."""
        return f"process {self.pid} on {self.host}, since {self.started}"


@contextlib.contextmanager
def opened(folder: Path) -> Iterator[None]:
    """Make the folder if need be and hold it: no other run may use it meanwhile.

    The lock is a file that names its process. The system lets go of it when the process ends, however it ends; where it
    cannot, a lock is stale if its process, of the same host, is no more.

    Raises
    ------
    FolderError
        If another run holds it, or nothing can be written there.
    """
    path = folder / "lock"
    try:
        stamped_file.make_folder(folder / "cases")
        handle = _acquire(path)
    except FolderError:
        raise
    except OSError as error:
        raise stamped_file.cannot_write(folder, error) from error
    progress = folder / "progress.json"  # one that is there is of a run that was killed
    try:
        with contextlib.suppress(OSError):
            progress.unlink(missing_ok=True)
        yield
    finally:
        with contextlib.suppress(OSError):
            if _same_file(handle, path):
                progress.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            if _same_file(handle, path):  # not if the folder was moved away and another run has begun here
                path.unlink()
        os.close(handle)


def mark(folder: Path) -> str:
    """Return what tells the folder of a run from others of its name on other hosts: its lock; empty without one."""
    try:
        with (folder / "lock").open("rb") as stream:
            return stream.read(MAX_BYTES).decode(errors="replace")
    except OSError:
        return ""


def holder(folder: Path) -> Holder | None:
    """Return the process that runs in a folder now, None if there is none."""
    path = folder / "lock"
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:
        return None
    try:
        found = _named(handle)
        if found is None or found.host != platform.node():
            return found
        return found if (_held(handle) if fcntl else _alive(found)) else None
    finally:
        os.close(handle)


def _acquire(path: Path) -> int:
    for attempt in range(ATTEMPTS):
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            if _lock(handle) and _same_file(handle, path):
                _refuse_foreign(handle, path)
                os.ftruncate(handle, 0)
                os.pwrite(handle, json.dumps(vars(_this_process())).encode(), 0)
                os.fsync(handle)
                return handle
            found = _named(handle)
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
        if attempt < ATTEMPTS - 1:
            time.sleep(PAUSE)
    who = found or "a process that is just starting"
    message = f"{path.parent} is in use by {who}; wait for it, end it, or give another --out"
    raise FolderError(message)


def _lock(handle: int) -> bool:
    """Take the lock unless another process has it."""
    if fcntl:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks
            pass
        else:
            return True
    found = _named(handle)
    return found is None or found.host != platform.node() or not _alive(found)


def _held(handle: int) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        found = _named(handle)
        return found is not None and _alive(found)
    return False


def _same_file(handle: int, path: Path) -> bool:
    """Return whether the lock taken is still the file of that name: a run that ends removes it."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _refuse_foreign(handle: int, path: Path) -> None:
    found = _named(handle)
    if found is not None and found.host != platform.node():
        message = f"{path.parent} is in use by {found}; if that process is no more, remove {path}"
        raise FolderError(message)


def _named(handle: int) -> Holder | None:
    try:
        found = Holder(**json.loads(os.pread(handle, MAX_BYTES, 0)))
    except (ValueError, TypeError, OSError, RecursionError):
        return None
    texts = (found.host, found.started, found.birth)
    sound = type(found.pid) is int and 0 < found.pid < 1 << 31 and all(type(text) is str for text in texts)
    return found if sound else None


def _this_process() -> Holder:
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    return Holder(platform.node(), os.getpid(), now, _birth(os.getpid()))


def _alive(found: Holder) -> bool:
    try:
        os.kill(found.pid, 0)  # signal 0 asks whether the process lives
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return not found.birth or _birth(found.pid) == found.birth


def _birth(pid: int) -> str:
    """Return when a process started, in the clock ticks of the system; empty where it does not tell."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[19]
    except (OSError, IndexError):
        return ""
