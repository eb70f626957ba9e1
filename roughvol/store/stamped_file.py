"""Files that are whole or absent, with a checksum that shows every changed bit.

A file is written under another name, flushed to the disk, then renamed. A *stamp* at its end holds labels and the
sha256 of everything before it. The checksum is verified before any library parses the content. Readers of netCDF ignore
bytes behind the content: every tool opens a stamped netCDF file. The checksum shows damage. It is no signature.

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
from typing import Any

from roughvol._version import __version__
from roughvol.errors import DatasetError, FolderError

FORMAT = "roughvol 1"  # of the datasets: names, dimensions and units as in the table of `variables`
MARK = b"ROUGHVOL"
NETCDF = (b"CDF", b"\x89HDF")  # first bytes of netCDF-3 and netCDF-4
TAIL = 64 + 8 + len(MARK)
MAX_LABELS = 100_000
Labels = dict[str, str]

_REASONS = {errno.ENOENT: "the folder has vanished", errno.EEXIST: "it is no folder"}  # others in words of the system


def store(path: Path, content: bytes) -> None:
    """Write a file that is either whole or absent; after a `FolderError` an earlier file of that name stays."""
    aside = aside_of(path)
    try:
        if path.exists() and not path.is_file():  # a device or a pipe: its name is not ours to replace
            path.write_bytes(content)
            return
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


def write(path: Path, content: bytes) -> None:
    """Write a file that is either whole or absent, in a folder that is made if it is absent."""
    make_folder(path.parent)
    store(path, content)


def aside_of(path: Path) -> Path:
    """Return the temporary name of a file, which no other process on any host uses."""
    return path.with_name(f".{path.name}.{platform.node()}.{os.getpid()}.part")


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, safe against a power cut."""
    try:
        absent = [parent for parent in (folder, *folder.parents) if not parent.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        for parent in absent:
            _sync_folder(parent.parent)
    except OSError as error:
        raise cannot_write(folder, error) from error


def cannot_write(path: Path, error: OSError) -> FolderError:
    """Return the error for a file that cannot be written, with its reason."""
    reason = _REASONS.get(error.errno or 0) or error.strerror or str(error)
    return FolderError(f"cannot write {path}: {reason}")


def _sync_folder(folder: Path) -> None:
    """Flush the names in a folder to the disk, on systems that can open folders."""
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
    """Return the labels of a dataset: formats of file and answer, version, id and hash of the case.

    A case has the hash of its states as well, a dataset of several cases that of its study.
    """
    text = attributes.get("case", "")
    own = {"states": states_of(json.loads(text))} if text else {"study": digest_of(attributes.get("study", ""))}
    version = {"version": attributes.get("roughvol_version", __version__)}
    return own | version | identity_of(attributes.get("case_id", ""), text)


def identity_of(id: str, text: str) -> Labels:
    """Return the labels by which a file is that of a case: formats of file and answer, id and hash of its key."""
    return {
        "format": FORMAT,
        "format_of_answers": str(json.loads(text).get("format", "")) if text else "",
        "case": id,
        "key": digest_of(text) if text else "",
    }


def digest_of(text: str) -> str:
    """Return the sha256 of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def states_of(key: Mapping[str, Any]) -> str:
    """Return the sha256 of all that the states of a case depend on: its key without the record, and the region."""
    return digest_of(json.dumps({**key, "record": key.get("record", {}).get("region")}, sort_keys=True))


def labels(path: Path) -> Labels:
    """Return the labels in the stamp of a file without a look at its content."""
    try:
        with path.open("rb") as stream:
            size = stream.seek(0, os.SEEK_END)
            stream.seek(max(size - TAIL, 0))
            length = _labels_length(path, stream.read(TAIL))
            stream.seek(max(size - TAIL - length, 0))
            return _parsed(path, stream.read(length))
    except OSError as error:
        raise _cannot_read(path, error) from error


def verified(path: Path) -> tuple[bytes, Labels]:
    """Return the content and the labels of a stamped file, every bit checked."""
    return unstamped(_content(path), path)


def read(path: Path) -> tuple[bytes, Labels | None]:
    """Return content and labels of a stamped file, every bit checked, or the content of netCDF without a stamp."""
    content = _content(path)
    bare = content.startswith(NETCDF) and not content.endswith(MARK)
    return (content, None) if bare else unstamped(content, path)


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise _cannot_read(path, error) from error


def unstamped(content: bytes, path: Path) -> tuple[bytes, Labels]:
    """Return the content and the labels of stamped bytes; ``path`` names them in the errors of `verified`."""
    length = _labels_length(path, content[-TAIL:])
    body = memoryview(content)[: max(len(content) - TAIL, 0)]
    if hashlib.sha256(body).hexdigest().encode() != content[-TAIL : -TAIL + 64]:
        raise DatasetError(f"{path} has been altered: its content does not have the checksum it was written with")
    return bytes(body[: len(body) - length]), _parsed(path, bytes(body[len(body) - length :]))


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files of killed processes.

    A temporary file of another host can only be a checkpoint, since this process holds the folder. The worker there
    writes it again soon.
    """
    here = f".{platform.node()}."
    for aside in folder.glob(".*.part"):
        pid = aside.name.split(".")[-2]
        if not pid.isdecimal():
            continue
        with contextlib.suppress(OSError):
            if not aside.name.removesuffix(f"{pid}.part").endswith(here) or not alive(int(pid)):
                aside.unlink(missing_ok=True)


def alive(pid: int) -> bool:
    """Return whether a process of this host exists."""
    try:
        os.kill(pid, 0)  # signal 0 only asks
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def _labels_length(path: Path, tail: bytes) -> int:
    digits = tail[64:72]
    if len(tail) < TAIL or not tail.endswith(MARK) or not digits.isdigit() or int(digits) > MAX_LABELS:
        raise DatasetError(f"{path} does not end with a checksum: it is truncated, or not a file of roughvol")
    return int(digits)


def _parsed(path: Path, text: bytes) -> Labels:
    try:
        labels = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path} ends with a damaged checksum") from error
    return {str(name): str(value) for name, value in labels.items()} if isinstance(labels, dict) else {}


def _cannot_read(path: Path, error: OSError) -> DatasetError:
    if isinstance(error, FileNotFoundError | IsADirectoryError):
        return DatasetError(f"no dataset at {path}")
    return DatasetError(f"cannot read {path}: {error.strerror or error}")
