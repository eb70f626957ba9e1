"""All runs of a folder: name, size, state and age, read without a library that computes."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass
from pathlib import Path

from roughvol.errors import DatasetError, StudyError
from roughvol.store import lock, run_folder, sample_plan
from roughvol.study import HeightFile, loads


@dataclass(frozen=True)
class Listed:
    """A run in a folder of runs.

    Attributes
    ----------
    name : str
        Name of its folder.
    state : str
        running, finished, or the number of finished and failed cases.
    size : int
        Bytes of all its files.
    age : float
        Seconds since its last change.
    """

    name: str
    state: str
    size: int
    age: float


def listed(folder: str | Path) -> list[Listed]:
    """Return the runs in a folder, the latest first.

    Parameters
    ----------
    folder : path
        Folder that holds the folders of runs.

    Returns
    -------
    list of Listed
        The runs; empty for a folder without any.

    Raises
    ------
    DatasetError
        If there is no such folder.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DatasetError(f"no folder {folder}: roughvol run STUDY makes runs/NAME")
    found = [_listed(path.parent) for path in folder.glob("*/study.yaml")]
    return sorted(found, key=lambda run: run.age)


def _listed(folder: Path) -> Listed:
    size, latest = 0, 0.0
    for path in folder.rglob("*"):
        with contextlib.suppress(OSError):
            status = path.stat()
            size += status.st_size if path.is_file() else 0
            latest = max(latest, status.st_mtime)
    return Listed(folder.name, _state(folder), size, max(time.time() - latest, 0.0))


def _state(folder: Path) -> str:
    stored, failed = run_folder.stored_ids(folder), run_folder.stored_ids(folder, ".failed.json")
    failures = f", {len(failed)} failed" if failed else ""
    if lock.holder(folder) is not None:
        return f"running, {len(stored)} finished{failures}"
    if (folder / "study.nc").is_file() and not failed:
        return "finished"
    try:
        study = loads(run_folder.stored_study(folder) or "", stored=True)
    except StudyError:
        return f"{len(stored)} finished{failures}, its study cannot be read"
    surface = study.surface
    total = len(surface.each) if isinstance(surface, HeightFile) else len(sample_plan.cases_of(study, folder))
    return f"{len(stored)} of {total} finished{failures}"
