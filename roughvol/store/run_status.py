"""How a study stands: which of its cases are done, running, failed, missing or damaged, also while a run is going on.

It imports nothing that computes, and opens no file of a case whose size and time are those in the ledger, so that it is
quick where there are many.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from roughvol.store import answer, ledger, lock, run_folder, same_study
from roughvol.store.lock import Holder
from roughvol.store.run_folder import case_file, folder_of, ledger_file
from roughvol.study import Study, load


@dataclass(frozen=True)
class Status:
    """What is there of a study: its folder and the ids of its cases that are done, missing, running, damaged, failed.

    ``damaged`` holds a reason for each, ``failed`` the error. ``outdated`` holds a reason for each file that another
    format of files or answers has stored; its case is missing. ``strange`` counts the other files of cases that are not
    of this study, ``versions`` the finished cases by the version of roughvol that computed them. ``holder`` is the
    process that runs now, ``left`` its estimate of the seconds to go, None if there is none yet.
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
    """Return what the cases of a study have come to in a folder, also while a run is going on there.

    A file that is not as the ledger says is read; whether the bits of all others are sound, the next run finds out.

    Raises
    ------
    FolderError
        If the folder holds another study, as `campaign.run` does.
    """
    study = study if isinstance(study, Study) else load(study)
    place = folder_of(study, out)
    cases = answer.cases_of(study, place)
    same_study.check_same_study(place, study, cases)
    holder = lock.holder(place)
    running, left = _now(place) if holder else ((), None)
    seen = ledger.read(ledger_file(place))  # before the files: what is stored meanwhile has no line, and is opened
    there = ledger.files(place / "cases", ".nc")
    failed = run_folder.failures(place, cases)
    done, missing, damaged, outdated = [], [], {}, run_folder.outdated(place, cases)
    strange = len(there.keys() - cases.keys() - outdated.keys())
    versions: Counter[str] = Counter()
    for id, case in cases.items():
        why: str | None = None
        if id in there:
            noted, path = seen.get(id), case_file(place, id)
            if noted is not None and noted.seen == there[id]:
                found = run_folder.Examined(noted.version)
            else:  # one that has changed since is read whole; of one that has no line, the end
                found = run_folder.examined(path, case, whole=noted is not None)
            if found.why is None:
                done.append(id)
                versions[found.version] += 1
                continue
            why = found.why
            if found.outdated:
                outdated[id], why = why, None
        if id in running or id in failed:
            continue
        if why is None:
            missing.append(id)
        else:
            damaged[id] = why
    finished = set(done)
    running = tuple(id for id in running if id in cases and id not in finished)
    failed = {id: error for id, error in failed.items() if id not in finished and id not in running}
    collected = (place / "study.nc").is_file() and run_folder.stored_study(place) == study.stored()
    return Status(
        place,
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


def _now(place: Path) -> tuple[tuple[str, ...], float | None]:
    """Return what a run has noted: the cases at work, and the seconds it thinks it needs."""
    noted = run_folder.small_json(place / "progress.json")
    running, left = noted.get("running"), noted.get("left")
    ids = tuple(id for id in running if isinstance(id, str)) if isinstance(running, list) else ()
    return ids, float(left) if isinstance(left, int | float) else None
