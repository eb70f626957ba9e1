"""Stored cases of a folder sorted out before a run: sound, outdated, damaged, strange, missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path

from roughvol._version import __version__
from roughvol.errors import DatasetError
from roughvol.store import run_folder, stamped_file
from roughvol.store.run_folder import case_file, checkpoint_file
from roughvol.study import Case

NAMED = 10  # notices of files set aside, before the rest is only counted


def sorted_out(
    folder: Path, cases: Mapping[str, Case], *, fresh: Collection[str], another: bool
) -> tuple[list[str], list[Case]]:
    """Set aside unusable files; return notices, and the cases to compute.

    Sound files of cases outside this study stay, unless the folder held another study.
    """
    stamped_file.remove_leftovers(folder / "cases")
    stamped_file.remove_leftovers(folder)
    stored, strange = run_folder.stored_ids(folder), run_folder.strangers(folder, cases)
    outdated, bad = run_folder.outdated(folder, cases), dict[Path, str]()
    if another:
        paths = [case_file(folder, id) for id in strange if id not in outdated]
        bad = {path: f"{path} is no case of this study" for path in paths}
    missing, finished = [], set()
    versions: Counter[str] = Counter()
    for id, case in cases.items():
        if id not in stored or id in fresh:
            missing.append(case)
            continue
        file = run_folder.examined(case_file(folder, id), case)
        if file.fault is None:
            finished.add(id)
            versions[file.version] += 1
            continue
        missing.append(case)
        bad[case_file(folder, id)] = f"{file.fault}; it is computed {'anew' if file.outdated else 'again'}"
    together = folder / "study.nc"
    if together.exists():
        try:
            stamped_file.verified(together)
        except DatasetError as error:
            bad[together] = f"{error}; it is made again from the cases"
    notices = _of_older_answers(folder, outdated)
    notices += _few([f"set aside: {why} (now {run_folder.set_aside(path, why)})" for path, why in bad.items()], folder)
    try:
        for path in (folder / "cases").glob(".*.checkpoint"):
            if path.name.removeprefix(".").removesuffix(".checkpoint") in finished:
                path.unlink(missing_ok=True)
        for id in fresh:
            for path in (case_file(folder, id), checkpoint_file(folder, id)):
                path.unlink(missing_ok=True)
    except OSError as error:
        raise stamped_file.cannot_write(folder, error) from error
    if left := [id for id in strange if id not in outdated and case_file(folder, id) not in bad]:
        notices.append(f"{folder / 'cases'} keeps files of cases that are not of this study: {len(left)}")
    if missing:
        versions[__version__] += len(missing)
    if several := run_folder.versions_text(versions):
        notices.append(several)
    return notices, missing


def _of_older_answers(folder: Path, outdated: Mapping[str, str]) -> list[str]:
    """Set aside the files of another format, and return one notice for each format."""
    for id, reason in outdated.items():
        path = case_file(folder, id)
        run_folder.set_aside(path, f"{path} was {reason}; its case is computed anew")
    return [
        f"set aside: {count} case files {reason}; their cases are computed anew (now in {folder}/cases/set_aside)"
        for reason, count in Counter(outdated.values()).items()
    ]


def _few(notices: list[str], folder: Path) -> list[str]:
    """Return the first notices and the number of the others."""
    if len(notices) <= NAMED + 1:
        return notices
    more = f"set aside: {len(notices) - NAMED} more, each with its reason beside it in {folder / 'cases' / 'set_aside'}"
    return [*notices[:NAMED], more]
