"""Files that are whole or not there, and that tell when a bit of them has changed.

A file is written aside, brought to the disk, then renamed. A *stamp* at its end holds labels (what the file is) and the
sha256 of everything before it, so that a file is known to be sound before any library parses it. HDF5 does not look
beyond its own end of file: a stamped netCDF file is read by every tool. A checksum tells damage, not forgery: it is no
signature, and whoever may write a folder may also write a stamp.

    content | labels (JSON) | sha256 of both (64 hexadecimal digits) | length of the labels (8 digits) | ``ROUGHVOL``
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import platform
from collections.abc import Mapping
from pathlib import Path

from roughvol._version import __version__
from roughvol.errors import DatasetError, FolderError

FORMAT = "roughvol 1"  # of the datasets: names, dimensions and units as in the table of `variables`
MARK = b"ROUGHVOL"
TAIL = 64 + 8 + len(MARK)
MAX_LABELS = 100_000
Labels = dict[str, str]
FIRST_ANSWERS = "1"  # format of the answers in files whose stamp does not name it, which are of version 0.7 or older

_REASONS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EROFS: "the file system is read-only",
    errno.EACCES: "the folder may not be written",
    errno.EPERM: "the folder may not be written",
    errno.ENOENT: "the folder has vanished",
    errno.EIO: "the disk does not work",
}


def store(path: Path, content: bytes) -> None:
    """Write a file so that it is either whole or not there: aside, to the disk, then renamed.

    Raises
    ------
    FolderError
        If the folder cannot be written, saying why; what was there under that name still is.
    """
    aside = aside_of(path)
    try:
        try:
            with aside.open("wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            aside.replace(path)
            _sync_folder(path.parent)
        finally:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from error


def touch(path: Path) -> None:
    """Set the time of a file to now, for tools that compare times.

    Raises
    ------
    FolderError
        If that is not allowed.
    """
    try:
        os.utime(path)
    except OSError as error:
        raise cannot_write(path, error) from error


def aside_of(path: Path) -> Path:
    """Return the name under which this process writes a file: no other process, on no other host, has the same."""
    return path.with_name(f".{path.name}.{platform.node()}.{os.getpid()}.part")


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, so that after a power cut they are there if what is in them is.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    absent = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for place in absent:
        _sync_folder(place.parent)


def cannot_write(path: Path, error: OSError) -> FolderError:
    """Return the error that says why a file cannot be written."""
    reason = _REASONS.get(error.errno or 0) or error.strerror or str(error)
    return FolderError(f"cannot write {path}: {reason}")


def _sync_folder(folder: Path) -> None:
    """Bring a new name to the disk; a system that cannot open folders has no need to."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


def stamped(content: bytes, labels: Labels) -> bytes:
    """Return content with a stamp at its end."""
    text = json.dumps(labels, sort_keys=True).encode()
    digest = hashlib.sha256(content)
    digest.update(text)
    return b"".join([content, text, digest.hexdigest().encode(), b"%08d" % len(text), MARK])


def labels_of(attributes: Mapping[str, str]) -> Labels:
    """Return what the stamp of a dataset says: format of the file and of the answer, version, and the case in full."""
    text = attributes.get("case", "")
    return {
        "format": FORMAT,
        "format_of_answers": str(json.loads(text).get("format", "")) if text else "",
        "version": attributes.get("roughvol_version", __version__),
        "case": attributes.get("case_id", ""),
        "key": hashlib.sha256(text.encode()).hexdigest() if text else "",
    }


def labels(path: Path) -> Labels:
    """Return the labels in the stamp of a file, its content unread: quick, but no proof of it.

    Raises
    ------
    DatasetError
        If the file is missing or ends without a stamp (it has been cut short, or was written by something else).
    """
    try:
        with path.open("rb") as stream:
            size = stream.seek(0, os.SEEK_END)
            stream.seek(max(size - TAIL, 0))
            length = _labels_length(path, stream.read(TAIL))
            stream.seek(max(size - TAIL - length, 0))
            return _parsed(path, stream.read(length))
    except DatasetError:
        raise
    except OSError as error:
        raise _cannot_read(path, error) from error


def verified(path: Path) -> tuple[bytes, Labels]:
    """Return the content of a stamped file and its labels, every bit checked.

    Raises
    ------
    DatasetError
        If the file is missing, truncated, altered, or has no stamp.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _cannot_read(path, error) from error
    return unstamped(content, path)


def unstamped(content: bytes, path: Path) -> tuple[bytes, Labels]:
    """Return what was stamped and its labels; ``path`` names it in errors, which are those of `verified`."""
    length = _labels_length(path, content[-TAIL:])
    body = memoryview(content)[: max(len(content) - TAIL, 0)]
    if hashlib.sha256(body).hexdigest().encode() != content[-TAIL : -TAIL + 64]:
        message = f"{path} has been altered: its content does not have the checksum it was written with"
        raise DatasetError(message)
    return bytes(body[: len(body) - length]), _parsed(path, bytes(body[len(body) - length :]))


def remove_leftovers(folder: Path) -> None:
    """Remove what processes that were killed while writing have left; files still being written here are left alone.

    Nobody writes from another host while this one holds the folder, but a worker whose checkpoint is due again soon.
    """
    here = f".{platform.node()}."
    for aside in folder.glob(".*.part"):
        pid = aside.name.split(".")[-2]
        if not pid.isdigit():
            continue
        with contextlib.suppress(OSError):
            if not aside.name.removesuffix(f"{pid}.part").endswith(here) or not _lives(int(pid)):
                aside.unlink(missing_ok=True)


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)  # signal 0 asks whether the process lives
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def _labels_length(path: Path, tail: bytes) -> int:
    digits = tail[64:72]
    if len(tail) < TAIL or not tail.endswith(MARK) or not digits.isdigit() or int(digits) > MAX_LABELS:
        message = f"{path} does not end with a checksum: it is truncated, or not a file of roughvol"
        raise DatasetError(message)
    return int(digits)


def _parsed(path: Path, text: bytes) -> Labels:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        message = f"{path} ends with a damaged checksum"
        raise DatasetError(message) from error
    return {str(name): str(value) for name, value in found.items()} if isinstance(found, dict) else {}


def _cannot_read(path: Path, error: OSError) -> DatasetError:
    if isinstance(error, FileNotFoundError):
        return DatasetError(f"no dataset at {path}")
    return DatasetError(f"cannot read {path}: {error.strerror or error}")
