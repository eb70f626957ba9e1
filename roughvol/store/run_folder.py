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
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from roughvol.errors import DatasetError
from roughvol.store import ledger, stamped_file
from roughvol.study import Case, Study

MAX_BYTES = 1 << 20  # of the small files read back here


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
            if why := _other_format(path, stamped_file.labels(path), ours):
                found[id] = why
    return found


def _other_format(path: Path, found: stamped_file.Labels, expected: stamped_file.Labels) -> str | None:
    """Return in what format a file was stored if that is not ours."""
    for name, title, first in (
        ("format_of_answers", "answer format", stamped_file.FIRST_ANSWERS),
        ("format", "file format", ""),
    ):
        theirs, ours = found.get(name, first), expected[name]
        if theirs != ours and theirs:
            age = "a newer" if (len(theirs), theirs) > (len(ours), ours) else "an older"
            return f"{path} was stored by {age} {title} ({theirs}, now {ours})"
    return None


def labels_for(case: Case) -> stamped_file.Labels:
    """Return what the stamp of the file of a case must say."""
    return stamped_file.labels_of({"case_id": case.id, "case": case.key_text})


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
        found = stamped_file.verified(path)[1] if whole else stamped_file.labels(path)
    except DatasetError as error:
        return Examined("", str(error))
    old = _other_format(path, found, labels_for(case)) is not None
    return Examined(found.get("version", ""), mismatch(path, found, case), old)


def mismatch(path: Path, found: stamped_file.Labels, case: Case) -> str | None:
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
        raise stamped_file.cannot_write(target, error) from error
    stamped_file.store(target.with_name(f"{target.name}.reason.txt"), f"{reason}\n".encode())
    return target


def record_failure(folder: Path, id: str, error: str, kind: str) -> None:
    """Keep the error of a case beside the cases, until it succeeds."""
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    content = {"case": id, "error": error, "type": kind, "date": now}
    stamped_file.store(failed_file(folder, id), json.dumps(content, indent=1, ensure_ascii=False).encode())


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
    aside = stamped_file.aside_of(path)
    try:
        aside.write_text(json.dumps(content))
        aside.replace(path)
    except FileNotFoundError as error:
        raise stamped_file.cannot_write(path, error) from error
    except OSError:
        pass
