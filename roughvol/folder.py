"""The folder of a run: who may use it, of which study it is, and what each of its cases has come to.

- ``study.yaml``: the study, every default written out
- ``cases/<id>.nc``: a finished case, stamped (see `storage`)
- ``cases/<id>.failed.json``: the error of a case that failed, until it succeeds
- ``cases/.<id>.checkpoint``: the finished steps of a long sweep
- ``cases/set_aside/``: what lay under the name of a case and cannot be used, each with its reason
- ``cases/ledger``: sizes and times of the finished files, for `status` (see `ledger`)
- ``progress.json``: what a run is doing now
- ``lock``: the process that runs here
- ``study.nc``: all cases together
"""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import platform
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from roughvol import ledger, storage
from roughvol.errors import DatasetError, FolderError
from roughvol.study import Case, Study

try:
    import fcntl
except ImportError:  # no such calls on this system: the lock is then told stale by its process alone
    fcntl = None  # type: ignore[assignment]

ATTEMPTS, PAUSE = 10, 0.1  # at a lock: a look at it, as `status` takes one, holds it for a moment
MAX_BYTES = 1 << 20  # of the small files read back here


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


def folder_of(study: Study, out: str | Path | None = None) -> Path:
    """Return the folder of the results: the one given, or ``runs/<name of the study>``."""
    return Path("runs") / study.name if out is None else Path(out)


def ledger_file(folder: Path) -> Path:
    """Return where the sizes and times of the finished files are noted."""
    return folder / "cases" / "ledger"


def case_file(folder: Path, id: str) -> Path:
    """Return where a finished case is."""
    return folder / "cases" / f"{id}.nc"


def failed_file(folder: Path, id: str) -> Path:
    """Return where the error of a case is."""
    return folder / "cases" / f"{id}.failed.json"


def checkpoint_file(folder: Path, id: str) -> Path:
    """Return where the finished steps of a case are."""
    return folder / "cases" / f".{id}.checkpoint"


def stored_study(folder: Path) -> str | None:
    """Return the text of the study that a folder holds, None without one."""
    try:
        with (folder / "study.yaml").open("rb") as stream:
            return stream.read(MAX_BYTES).decode(errors="replace")
    except FileNotFoundError:
        return None
    except OSError as error:
        return f"cannot read: {error.strerror}"


# The lock --------------------------------------------------------------------------------------------------------


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
        storage.make_folder(folder / "cases")
        handle = _acquire(path)
    except FolderError:
        raise
    except OSError as error:
        raise storage.cannot_write(folder, error) from error
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


# The cases -------------------------------------------------------------------------------------------------------


def strangers(folder: Path, cases: Mapping[str, Case]) -> list[str]:
    """Return the ids of the files of cases that are not of this study."""
    return [id for id in sorted(ledger.files(folder / "cases", ".nc")) if id not in cases]


def outdated(folder: Path, cases: Mapping[str, Case]) -> dict[str, str]:
    """Return the ids of the files not of this study that another format has stored, each with that reason."""
    ours, found = labels_for(next(iter(cases.values()))), {}
    for id in strangers(folder, cases):
        with contextlib.suppress(DatasetError):
            path = case_file(folder, id)
            if why := _other_format(path, storage.labels(path), ours):
                found[id] = why
    return found


def _other_format(path: Path, found: storage.Labels, expected: storage.Labels) -> str | None:
    """Return in what format a file was stored if that is not ours."""
    for name, title, first in (
        ("format_of_answers", "answer format", storage.FIRST_ANSWERS),
        ("format", "file format", ""),
    ):
        theirs, ours = found.get(name, first), expected[name]
        if theirs != ours and theirs:
            age = "a newer" if (len(theirs), theirs) > (len(ours), ours) else "an older"
            return f"{path} was stored by {age} {title} ({theirs}, now {ours})"
    return None


def labels_for(case: Case) -> storage.Labels:
    """Return what the stamp of the file of a case must say."""
    return storage.labels_of({"case_id": case.id, "case": case.key_text})


class Examined(NamedTuple):
    """The file of a case: its version of roughvol, its fault if it has one, whether that is only its format."""

    version: str
    why: str | None = None
    outdated: bool = False


def examined(path: Path, case: Case, *, whole: bool) -> Examined:
    """Return what is known of the file of a case.

    Parameters
    ----------
    whole : bool
        Check every bit, not only that the end is there and says what it should.
    """
    try:
        found = storage.verified(path)[1] if whole else storage.labels(path)
    except DatasetError as error:
        return Examined("", str(error))
    old = _other_format(path, found, labels_for(case)) is not None
    return Examined(found.get("version", ""), mismatch(path, found, case), old)


def mismatch(path: Path, found: storage.Labels, case: Case) -> str | None:
    """Return in what the labels of a file are not those of a case, None if they are; the version is none of it."""
    expected = labels_for(case)
    if why := _other_format(path, found, expected):
        return why
    for name, title in (("format", "file format"), ("case", "case"), ("key", "study")):
        if found.get(name) != expected[name]:
            return f"{path} is of another {title}: {found.get(name)!r}, not {expected[name]!r}"
    return None


def versions_text(versions: Mapping[str, int]) -> str:
    """Return which versions of roughvol computed the cases, empty if it was one."""
    if len(versions) < 2:
        return ""
    several = ", ".join(f"{version} ({count})" for version, count in sorted(versions.items()))
    return f"cases are of several versions of roughvol, with answers of one format: {several}"


def set_aside(path: Path, reason: str) -> Path:
    """Move a file out of the way into ``set_aside``, with its reason beside it, and return where it is now."""
    target = path.parent / "set_aside" / path.name
    try:
        target.parent.mkdir(exist_ok=True)
        number = 1
        while target.exists():
            number += 1
            target = target.with_name(f"{path.stem}.{number}{path.suffix}")
        path.replace(target)
    except OSError as error:
        raise storage.cannot_write(target, error) from error
    storage.store(target.with_name(f"{target.name}.reason.txt"), f"{reason}\n".encode())
    return target


def record_failure(folder: Path, id: str, error: str, kind: str) -> None:
    """Keep the error of a case beside the cases, until it succeeds."""
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    content = {"case": id, "error": error, "type": kind, "date": now}
    storage.store(failed_file(folder, id), json.dumps(content, indent=1, ensure_ascii=False).encode())


def failures(folder: Path, ids: Iterable[str]) -> dict[str, str]:
    """Return the errors of the cases that failed last."""
    found = ledger.files(folder / "cases", ".failed.json")
    return {id: str(small_json(failed_file(folder, id)).get("error", "unknown")) for id in ids if id in found}


def small_json(path: Path) -> dict[str, Any]:
    """Return what a small file of this folder holds, nothing if it cannot be read."""
    try:
        with path.open("rb") as stream:
            found = json.loads(stream.read(MAX_BYTES))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def note(folder: Path, content: Mapping[str, Any]) -> None:
    """Leave word of what a run is doing; that this cannot be written is no reason to stop.

    Raises
    ------
    FolderError
        If the folder has vanished: nothing that is computed could be stored.
    """
    path = folder / "progress.json"
    aside = storage.aside_of(path)
    try:
        aside.write_text(json.dumps(content))
        aside.replace(path)
    except FileNotFoundError as error:
        raise storage.cannot_write(path, error) from error
    except OSError:
        pass
