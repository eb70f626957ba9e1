"""Finished, running, failed, missing and damaged cases of a study, also while a run goes on; all runs of a folder.

It imports no library that computes, and verifies small case files in full: ten thousand take less than two seconds.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from roughvol.errors import DatasetError, FolderError, StudyError, nearest_word
from roughvol.store import lock, run_folder, same_study, sample_plan, stamped_file
from roughvol.store.lock import Holder
from roughvol.store.run_folder import case_file, folder_of
from roughvol.study import HeightFile, Study, check_type, load, loads


@dataclass(frozen=True)
class Status:
    """The state of a study in its folder, with the ids of its cases.

    - ``damaged``, ``failed``, ``outdated``: reason or error by the id of the case. Files of another format are
      outdated; their cases are missing.
    - ``collected``: whether ``study.nc`` holds this study
    - ``strange``: number of other case files that are not of this study; of a part of lists, not of the whole study
    - ``versions``: number of finished cases by version of roughvol
    - ``holder``: the process that runs now
    - ``left``: its estimate of the seconds to go
    """

    folder: Path
    done: tuple[str, ...]
    missing: tuple[str, ...]
    damaged: Mapping[str, str]
    collected: bool
    running: tuple[str, ...] = ()
    failed: Mapping[str, str] = field(default_factory=dict)
    strange: int = 0
    outdated: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, int] = field(default_factory=dict)
    holder: Holder | None = None
    left: float | None = None


def status(study: Study | str | Path, out: str | Path | None = None) -> Status:
    """Return the state of a study in its folder, also while a run goes on there.

    Every bit of small files is verified. Of files larger than `run_folder.QUICK_BYTES`, only the stamp is read.

    Parameters
    ----------
    study : Study or path of a study file
        Study of the run.
    out : path, optional
        Folder of the results; default: ``runs/<name of the study>``.

    Returns
    -------
    Status
        Finished, missing, running, failed and damaged cases.

    Raises
    ------
    FolderError
        If the folder holds another study, as `campaign.run` does.

    See Also
    --------
    roughvol.status : Returns the same of a study or a run by name.

    Examples
    --------
    >>> from roughvol.store import status
    >>> from roughvol.study import loads
    >>> len(status(loads("{name: begun, surface: {D: 2.5, m: 3, seeds: 2}}")).missing)
    2
    """
    study = study if isinstance(study, Study) else load(study)
    folder = folder_of(study, out)
    whole = same_study.stored_in(folder, study)  # the study may have some combinations of its lists
    study = same_study.spelled_as(study, whole)
    cases = sample_plan.cases_of(study, folder)
    if another := same_study.another_study(folder, study, cases):
        raise FolderError(another)
    holder = lock.holder(folder)
    noted, left = _progress(folder) if holder else ((), None)
    stored, failures = run_folder.stored_ids(folder), run_folder.failures(folder, cases)
    outdated = {id: f"{case_file(folder, id)} was {why}" for id, why in run_folder.outdated(folder, cases).items()}
    strange = stored - cases.keys() - outdated.keys()
    if is_part := bool(same_study.part(study, whole)):
        strange -= same_study.cases_of_stored(whole, study, folder)
    files = {id: run_folder.examined(case_file(folder, id), cases[id], quick=True) for id in cases if id in stored}
    done = {id: file.version for id, file in files.items() if file.fault is None}
    outdated |= {id: str(file.fault) for id, file in files.items() if file.outdated}
    others = [id for id in cases if id not in done and id not in noted and id not in failures]
    damaged = {id: str(files[id].fault) for id in others if id in files and id not in outdated}
    missing = tuple(id for id in others if id not in damaged)
    running = tuple(id for id in noted if id in cases and id not in done)
    failed = {id: error for id, error in failures.items() if id not in done and id not in running}
    collected = run_folder.is_collected(folder, (whole if is_part else study).stored())
    versions = dict(Counter(done.values()))
    by_id = tuple(done), missing, damaged, collected, running, failed
    return Status(folder, *by_id, len(strange), outdated, versions, holder, left)


def of_results(folder: Path) -> Status | None:
    """Return the state of a run by the cases of its ``study.nc``: it needs no height file; None if one is not finished.

    Parameters
    ----------
    folder : Path
        The folder of the run.

    Returns
    -------
    Status or None
        All cases are finished.
    """
    from roughvol.store import dataset  # xarray: for a run without its height files alone

    if not run_folder.is_collected(folder, run_folder.stored_study(folder) or ""):
        return None
    try:
        ids = json.loads(dataset.read(folder / "study.nc").attrs.get("case_ids", "[]"))
        labels = {id: stamped_file.verified(case_file(folder, id))[1] for id in ids}
    except DatasetError:
        return None
    if not ids or any(found.get("case") != id for id, found in labels.items()):
        return None
    versions = Counter(found.get("version", "") for found in labels.values())
    strange = len(run_folder.stored_ids(folder) - labels.keys())
    return Status(folder, tuple(ids), (), {}, collected=True, strange=strange, versions=dict(versions))


def _progress(folder: Path) -> tuple[tuple[str, ...], float | None]:
    """Return the cases at work and the seconds to go, as the run has noted them."""
    noted = run_folder.small_json(folder / "progress.json")
    running, left = noted.get("running"), noted.get("left")
    ids = tuple(id for id in running if isinstance(id, str)) if isinstance(running, list) else ()
    return ids, float(left) if isinstance(left, int | float) else None


@dataclass(frozen=True)
class Listed:
    """A run in a folder of runs: size in bytes of all its files, age in seconds since its last change.

    ``state`` is running, finished, or the number of finished and failed cases.
    """

    name: str
    state: str
    size: int
    age: float


def listed(folder: str | Path) -> list[Listed]:
    """Return the runs in a folder, the latest first."""
    check_type(folder, (str, os.PathLike), "the folder of runs is a path")
    folder = Path(folder)
    if not folder.is_dir():
        near = nearest_word(str(folder), [path.parent.name for path in Path("runs").glob("*/study.yaml")])
        see = f"; the state of a run: roughvol status {near}" if near else ": roughvol run STUDY makes runs/NAME"
        raise DatasetError(f"no folder {folder}{see}")
    return sorted([_listed(path.parent) for path in folder.glob("*/study.yaml")], key=lambda run: run.age)


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
    text = run_folder.stored_study(folder) or ""
    try:
        study = loads(text, stored=True)
    except StudyError:
        return f"{len(stored)} finished{failures}, its study cannot be read"
    collected, total = run_folder.is_collected(folder, text), None
    if not isinstance(study.surface, HeightFile):
        cases = sample_plan.cases_of(study, folder)
        total = len(cases)
        if not collected or not stored.isdisjoint(cases):  # cases of an older version have other ids
            stored &= cases.keys()
    elif not study.axes:  # combinations may share cases. The ids of cases need the files.
        total = len(study.surface.each)
    missing = total is not None and 0 < len(stored) < total
    if collected and not failed and not missing:
        return "finished"
    return f"{len(stored)}{'' if total is None else f' of {total}'} finished{failures}"
