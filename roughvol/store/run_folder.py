"""The files of a run: their names, and what each of them holds.

- ``study.yaml``: the study, every default written out
- ``cases/<id>.nc``: a finished case, stamped (see `stamped_file`)
- ``cases/<id>.failed.json``: the error of a failed case, until it succeeds
- ``cases/.<id>.checkpoint``: the finished steps of a long sweep
- ``cases/set_aside/``: unusable files found under the name of a case, each with its reason
- ``progress.json``: the cases at work, while a run goes on
- ``lock``: the process that runs here
- ``study.nc``: all cases together
"""

from __future__ import annotations

import contextlib
import datetime
import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from roughvol.errors import DatasetError, FolderError
from roughvol.store import stamped_file
from roughvol.study import Case, Study, check_type
from roughvol.study.plain_data import STORED_BYTES

LONGEST = 150  # bytes of a part of a file name

MAX_BYTES = 1 << 20  # of the small text files read here
QUICK_BYTES = 1 << 20  # size up to which `status` verifies a case file as well


def folder_of(study: Study, out: str | Path | None = None) -> Path:
    """Return the folder of the results of a study.

    Parameters
    ----------
    study : Study
        Study of the run.
    out : path, optional
        Folder given by the user; default: ``runs/<name of the study>``.

    Returns
    -------
    Path
        The folder, which may not exist yet.
    """
    check_type(out, (str, os.PathLike, type(None)), "the folder of the results is a path", FolderError)
    if out == "":  # of a Path, the current folder
        raise FolderError("the folder of the results is a path, given an empty text")
    return Path("runs") / study.name if out is None else Path(out)


def slug(text: str) -> str:
    """Return a text as part of a file name: letters, digits and ``=+-.`` as they are, runs of all others as ``_``.

    A text of more than `LONGEST` bytes ends with a hash.
    """
    name = re.sub(r"(?:_|[^\w=+.-])+", "_", text.replace(" = ", "=")).strip("_")
    return name if len(name.encode()) <= LONGEST else _with_hash(name, name)


def slugs(texts: Iterable[str]) -> dict[str, str]:
    """Return the `slug` of each text; where several texts have the same, with a hash of the text."""
    names = {text: slug(text) for text in texts}
    often = Counter(names.values())
    return {text: name if often[name] == 1 else _with_hash(name, text) for text, name in names.items()}


def _with_hash(name: str, text: str) -> str:
    begin = name.encode()[: LONGEST - 9].decode(errors="ignore")
    return f"{begin}_{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def case_file(folder: Path, id: str) -> Path:
    """Return the path of a finished case."""
    return folder / "cases" / f"{id}.nc"


def failed_file(folder: Path, id: str) -> Path:
    """Return the path of the error of a case."""
    return folder / "cases" / f"{id}.failed.json"


def checkpoint_file(folder: Path, id: str) -> Path:
    """Return the path of the finished steps of a case."""
    return folder / "cases" / f".{id}.checkpoint"


def stored_ids(folder: Path, ending: str = ".nc") -> set[str]:
    """Return the ids of the cases that have a file of this ending."""
    with contextlib.suppress(OSError):
        names = (name for name in os.listdir(folder / "cases") if not name.startswith("."))  # noqa: PTH208, quicker
        return {name.removesuffix(ending) for name in names if name.endswith(ending)}
    return set()


def stored_study(folder: Path) -> str | None:
    """Return the text of the study in a folder, None without one."""
    try:
        with (folder / "study.yaml").open("rb") as stream:
            return stream.read(STORED_BYTES).decode(errors="replace")
    except FileNotFoundError:
        return None
    except OSError as error:
        return f"cannot read: {error.strerror}"


def is_collected(folder: Path, text: str) -> bool:
    """Return whether ``study.nc`` holds a study; one written before its stamp had the study is that of the folder."""
    try:
        held = stamped_file.labels(folder / "study.nc").get("study")
    except DatasetError:
        return False
    return stored_study(folder) == text and held in (None, stamped_file.digest_of(text))


def strangers(folder: Path, cases: Mapping[str, Case]) -> list[str]:
    """Return the ids of stored cases that are not of this study."""
    return sorted(stored_ids(folder) - cases.keys())


def outdated(folder: Path, cases: Mapping[str, Case]) -> dict[str, str]:
    """Return the ids of strangers stored in another format, each with that reason."""
    expected, reasons = labels_for(next(iter(cases.values()))), {}
    for id in strangers(folder, cases):
        with contextlib.suppress(DatasetError):
            if reason := _other_format(stamped_file.labels(case_file(folder, id)), expected):
                reasons[id] = reason
    return reasons


def labels_for(case: Case) -> stamped_file.Labels:
    """Return the labels that the file of a case must have."""
    return stamped_file.identity_of(case.id, case.key_text)


def _other_format(labels: stamped_file.Labels, expected: stamped_file.Labels) -> str | None:
    """Return the format of a file in words if it is not the present one."""
    # A stamp without a format of answers is of version 0.7 or older: format 1.
    for name, title, default in (("format_of_answers", "answer format", "1"), ("format", "file format", "")):
        theirs, ours = labels.get(name, default), expected[name]
        if theirs and theirs != ours:
            age = "a newer" if (len(theirs), theirs) > (len(ours), ours) else "an older"
            return f"stored by {age} {title} ({theirs}, now {ours})"
    return None


class Examined(NamedTuple):
    """The file of a case: its version of roughvol, its fault or None, whether the fault is only its format."""

    version: str
    fault: str | None = None
    outdated: bool = False


def examined(path: Path, case: Case, *, quick: bool = False) -> Examined:
    """Return version and fault of the file of a case; ``quick``: beyond `QUICK_BYTES`, only the stamp is read."""
    try:
        whole = not quick or path.stat().st_size <= QUICK_BYTES
        labels = stamped_file.verified(path)[1] if whole else stamped_file.labels(path)
    except (DatasetError, OSError) as error:
        return Examined("", str(error))
    expected = labels_for(case)
    is_outdated = _other_format(labels, expected) is not None
    return Examined(labels.get("version", ""), mismatch(path, labels, expected), is_outdated)


def mismatch(path: Path, labels: stamped_file.Labels, expected: stamped_file.Labels) -> str | None:
    """Return the first difference between the labels of a file and those expected; versions may differ."""
    if reason := _other_format(labels, expected):
        return f"{path} was {reason}"
    for name, title in (("format", "file format"), ("case", "case"), ("key", "study")):
        if labels.get(name) != expected[name]:
            return f"{path} is of another {title}: {labels.get(name)!r}, not {expected[name]!r}"
    return None


def versions_text(versions: Mapping[str, int]) -> str:
    """Return a sentence on the versions of roughvol that computed the cases; empty for a single one."""
    if len(versions) < 2:
        return ""
    several = ", ".join(f"{version} ({count})" for version, count in sorted(versions.items()))
    return f"cases are of several versions of roughvol, with answers of one format: {several}"


def set_aside(path: Path, reason: str) -> Path:
    """Move a file into ``set_aside`` with its reason beside it, and return its new path."""
    target = path.parent / "set_aside" / path.name
    try:
        target.parent.mkdir(exist_ok=True)
        number = 1
        while target.exists():
            number += 1
            target = target.with_name(f"{path.stem}.{number}{path.suffix}")
        path.replace(target)
    except OSError as error:
        raise stamped_file.cannot_write(target, error) from error
    stamped_file.store(target.with_name(f"{target.name}.reason.txt"), f"{reason}\n".encode())
    return target


def record_failure(folder: Path, id: str, error: str, kind: str) -> None:
    """Store the error of a case."""
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    content = {"case": id, "error": error, "type": kind, "date": now}
    stamped_file.store(failed_file(folder, id), json.dumps(content, indent=1, ensure_ascii=False).encode())


def failures(folder: Path, ids: Iterable[str]) -> dict[str, str]:
    """Return the stored errors by the ids of their cases."""
    failed = stored_ids(folder, ".failed.json")
    return {id: str(small_json(failed_file(folder, id)).get("error", "unknown")) for id in ids if id in failed}


def small_json(path: Path) -> dict[str, Any]:
    """Return the content of a small file of this folder, nothing if it cannot be read."""
    try:
        with path.open("rb") as stream:
            content = json.loads(stream.read(MAX_BYTES))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def note(folder: Path, content: Mapping[str, Any]) -> None:
    """Write ``progress.json``, without an error unless the folder has vanished: no result could be stored."""
    try:
        stamped_file.store(folder / "progress.json", json.dumps(content).encode())
    except FolderError:
        if not folder.exists():
            raise
