"""Finished, running, failed, missing and damaged cases of a study, also while a run goes on.

It imports no library that computes, and verifies small case files in full: ten thousand take less than two seconds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from roughvol.store import lock, run_folder, same_study, sample_plan
from roughvol.store.lock import Holder
from roughvol.store.run_folder import case_file, folder_of
from roughvol.study import Study, load


@dataclass(frozen=True)
class Status:
    """The state of a study in its folder.

    Attributes
    ----------
    folder : Path
        Folder of the results.
    done, missing, running : tuple of str
        Ids of the cases.
    damaged, failed, outdated : mapping of str to str
        Reason or error by the id of the case. Files of another format are outdated; their cases are missing.
    collected : bool
        Whether ``study.nc`` holds this study.
    strange : int
        Number of other case files that are not of this study.
    versions : mapping of str to int
        Number of finished cases by version of roughvol.
    holder : Holder or None
        The process that runs now.
    left : float or None
        Its estimate of the seconds to go.
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
    """
    study = study if isinstance(study, Study) else load(study)
    folder = folder_of(study, out)
    cases = sample_plan.cases_of(study, folder)
    same_study.check_same_study(folder, study, cases)
    holder = lock.holder(folder)
    running, left = _progress(folder) if holder else ((), None)
    stored = run_folder.stored_ids(folder)
    failed = run_folder.failures(folder, cases)
    outdated = {id: f"{case_file(folder, id)} was {why}" for id, why in run_folder.outdated(folder, cases).items()}
    strange = len(stored - cases.keys() - outdated.keys())
    done, missing, damaged = [], [], {}
    versions: Counter[str] = Counter()
    for id, case in cases.items():
        file = run_folder.examined(case_file(folder, id), case, quick=True) if id in stored else None
        if file is not None and file.fault is None:
            done.append(id)
            versions[file.version] += 1
            continue
        if file is not None and file.outdated:
            outdated[id] = str(file.fault)
        if id in running or id in failed:
            continue
        if file is None or file.outdated:
            missing.append(id)
        else:
            damaged[id] = str(file.fault)
    finished = set(done)
    running = tuple(id for id in running if id in cases and id not in finished)
    failed = {id: error for id, error in failed.items() if id not in finished and id not in running}
    collected = run_folder.is_collected(folder, study.stored())
    return Status(
        folder,
        tuple(done),
        tuple(missing),
        damaged,
        collected,
        running=running,
        failed=failed,
        strange=strange,
        outdated=outdated,
        versions=dict(versions),
        holder=holder,
        left=left,
    )


def _progress(folder: Path) -> tuple[tuple[str, ...], float | None]:
    """Return the cases at work and the seconds to go, as the run has noted them."""
    noted = run_folder.small_json(folder / "progress.json")
    running, left = noted.get("running"), noted.get("left")
    ids = tuple(id for id in running if isinstance(id, str)) if isinstance(running, list) else ()
    return ids, float(left) if isinstance(left, int | float) else None
