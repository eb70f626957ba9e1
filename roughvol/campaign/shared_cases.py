"""Cases that other runs under one root have finished: linked or copied once every bit of their file is verified.

Files of another answer format are never used, and no file is changed or removed.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from roughvol.store import run_folder, stamped_file
from roughvol.store.run_folder import case_file
from roughvol.study import Case

ROOT = "runs"  # name of a folder whose runs share their cases


def taken(folder: Path, missing: Sequence[Case], stopping: Callable[[], bool] = lambda: False) -> list[Case]:
    """Store the cases that a sibling run has finished.

    Parameters
    ----------
    folder : Path
        Folder of the run, which this process owns.
    missing : sequence of Case
        Cases without a file there.
    stopping : callable
        Polled between two cases.

    Returns
    -------
    list of Case
        The cases stored.

    Raises
    ------
    FolderError
        If the folder cannot be written.
    KeyboardInterrupt
        If it is to stop.
    """
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
        return sorted(one for one in own.parent.iterdir() if one != own and (one / "cases").is_dir())
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
        try:
            stamped_file.store(target, source.read_bytes())
        except OSError as error:
            raise stamped_file.cannot_write(target, error) from error
    if run_folder.examined(target, case).fault is None:  # the sibling may have been replaced meanwhile
        return True
    target.unlink(missing_ok=True)
    return False
