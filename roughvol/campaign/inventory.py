"""Stored cases of a folder before a run: sound, outdated, damaged, strange, missing, and those of sibling runs.

Files that cannot be used are set aside. A case that another run under one root has finished is linked or copied, once
every bit of its file is verified; no file of the other run is changed or removed.
"""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

from roughvol._version import __version__
from roughvol.errors import DatasetError
from roughvol.store import run_folder, stamped_file
from roughvol.store.run_folder import case_file, checkpoint_file, failed_file
from roughvol.study import Case

NAMED = 10  # notices of files set aside, before the rest is only counted
ROOT = "runs"  # name of a folder whose runs share their cases


def sorted_out(
    folder: Path, cases: Mapping[str, Case], *, fresh: Collection[str], another: bool
) -> tuple[list[str], list[Case]]:
    """Set aside unusable files; return notices, and the cases to compute.

    Sound files of cases outside this study stay, unless the folder held another study.
    """
    stamped_file.remove_leftovers(folder / "cases")
    stamped_file.remove_leftovers(folder)
    stored, outdated = run_folder.stored_ids(folder), run_folder.outdated(folder, cases)
    strange = [case_file(folder, id) for id in run_folder.strangers(folder, cases) if id not in outdated]
    bad = {path: f"{path} is no case of this study" for path in strange} if another else {}
    missing, finished = [], set()
    versions: Counter[str] = Counter()
    for id, case in cases.items():
        if id in stored and id not in fresh:
            file = run_folder.examined(case_file(folder, id), case)
            if file.fault is None:
                finished.add(id)
                versions[file.version] += 1
                continue
            bad[case_file(folder, id)] = f"{file.fault}; it is computed {'anew' if file.outdated else 'again'}"
        missing.append(case)
    together = folder / "study.nc"
    if together.exists():
        try:
            stamped_file.verified(together)
        except DatasetError as error:
            bad[together] = f"{error}; it is made again from the cases"
    notices = _set_aside(folder, outdated, bad)
    spent = [checkpoint_file(folder, id) for id in finished]
    spent += [file(folder, id) for id in fresh for file in (case_file, checkpoint_file)]
    spent += [failed_file(folder, id) for id in run_folder.stored_ids(folder, ".failed.json") - cases.keys()]
    try:
        for path in spent:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise stamped_file.cannot_write(folder, error) from error
    if strange and not another:
        others = f"{folder / 'cases'} keeps files of other cases: {len(strange)}"
        notices.append(f"{folder / 'study.nc'} gets the cases of this study alone; {others}")
    if missing:
        versions[__version__] += len(missing)
    if several := run_folder.versions_text(versions):
        notices.append(several)
    return notices, missing


def _set_aside(folder: Path, outdated: Mapping[str, str], bad: Mapping[Path, str]) -> list[str]:
    """Set aside files of another format, with a notice for each format, and bad files, of which the first are named."""
    for id, reason in outdated.items():
        path = case_file(folder, id)
        run_folder.set_aside(path, f"{path} was {reason}; its case is computed anew")
    of_formats = [
        f"set aside: {count} case files {reason}; their cases are computed anew (now in {folder}/cases/set_aside)"
        for reason, count in Counter(outdated.values()).items()
    ]
    notices = [f"set aside: {why} (now {run_folder.set_aside(path, why)})" for path, why in bad.items()]
    if (more := len(notices) - NAMED) > 1:
        aside = folder / "cases" / "set_aside"
        notices[NAMED:] = [f"set aside: {more} more, each with its reason beside it in {aside}"]
    return of_formats + notices


def taken(folder: Path, missing: Sequence[Case], stopping: Callable[[], bool] = lambda: False) -> list[Case]:
    """Store the cases that a sibling run has finished, and return them."""
    siblings = siblings_of(folder) if missing else []
    found = []
    for case in missing:
        if stopping():
            raise KeyboardInterrupt
        if any(_taken(case_file(sibling, case.id), folder, case) for sibling in siblings):
            found.append(case)
    return found


def siblings_of(folder: Path) -> list[Path]:
    """Return the other runs under the root of a folder; none outside a root."""
    own = folder.resolve()
    if own.parent.name != ROOT:
        return []
    with contextlib.suppress(OSError):
        return sorted(folder for folder in own.parent.iterdir() if folder != own and (folder / "cases").is_dir())
    return []


def _taken(source: Path, folder: Path, case: Case) -> bool:
    """Link or copy the file of a case, if it is sound."""
    target = case_file(folder, case.id)
    if not source.is_file() or run_folder.examined(source, case).fault is not None:
        return False
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        aside = stamped_file.aside_of(target)
        aside.unlink(missing_ok=True)
        os.link(source, aside)
        aside.replace(target)
    except OSError:  # another disk, or a file system without links
        with contextlib.suppress(OSError):  # what cannot be copied is computed
            stamped_file.store(target, source.read_bytes())
    if run_folder.examined(target, case).fault is None:  # the sibling may have been replaced meanwhile
        return True
    target.unlink(missing_ok=True)
    return False
