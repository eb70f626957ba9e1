"""Files that are whole or not there, and that tell when a bit of them has changed.

A file is written aside, brought to the disk, then renamed. A *stamp* at its end holds labels (what the file is) and the
sha256 of everything before it, so that a file is known to be sound before any library parses it. HDF5 does not look
beyond its own end of file: a stamped netCDF file is read by every tool.

    content | labels (JSON) | sha256 of both (64 hexadecimal digits) | length of the labels (8 digits) | ``ROUGHVOL``
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
from pathlib import Path

from roughvol.errors import DatasetError, FolderError

MARK = b"ROUGHVOL"
TAIL = 64 + 8 + len(MARK)
MAX_LABELS = 100_000
Labels = dict[str, str]

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
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
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
    except OSError as error:
        raise _cannot_read(path, error) from error


def is_stamped(content: bytes) -> bool:
    """Return whether content ends with a stamp, sound or not."""
    return content.endswith(MARK)


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
    """Remove what processes that were killed while writing have left; files still being written are left alone."""
    for aside in folder.glob(".*.part"):
        with contextlib.suppress(ValueError, PermissionError):
            try:
                os.kill(int(aside.name.split(".")[-2]), 0)  # signal 0 asks whether the process lives
            except ProcessLookupError:
                aside.unlink(missing_ok=True)


def _labels_length(path: Path, tail: bytes) -> int:
    digits = tail[64:72]
    if len(tail) < TAIL or not tail.endswith(MARK) or not digits.isdigit() or int(digits) > MAX_LABELS:
        message = f"{path} does not end with a checksum: it is truncated, or not a file of this version of roughvol"
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


def check_hdf5(content: bytes, path: Path) -> None:
    """Refuse what is no whole HDF5 file before a library parses it; for files without a stamp.

    Raises
    ------
    DatasetError
        If the signature is missing, or the length is not the one the file itself gives.
    """
    place = {0: 40, 1: 44, 2: 28, 3: 28}.get(content[8] if len(content) > 48 else -1)  # of the end-of-file address
    if place is None or not content.startswith(b"\x89HDF\r\n\x1a\n"):
        message = f"{path} is damaged or no netCDF file (it has no HDF5 signature)"
        raise DatasetError(message)
    if int.from_bytes(content[place : place + 8], "little") != len(content):
        message = f"{path} is damaged or no netCDF file (its length is not the one it was written with)"
        raise DatasetError(message)
