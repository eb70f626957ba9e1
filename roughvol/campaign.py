"""Campaigns: all cases of a study in many processes, resumable, each stored as soon as it is finished.

A study lands in one folder (see `folder`). A case is done if every bit of its file is as it was written and its stamp
says it is ours; what else lies under its name is set aside, neither trusted nor merged. Values do not depend on where
or by how many processes they are computed: a case is always solved in a process of its own kind, its sums by one
thread, and nothing that can change an answer passes from one case to the next.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from roughvol import dataset, folder, storage, workers
from roughvol.batch import Batch, OnEvent, Progress
from roughvol.dataset import Dataset
from roughvol.errors import CampaignError, DatasetError
from roughvol.folder import Holder, case_file, checkpoint_file
from roughvol.physics.surface import Surface
from roughvol.pressing import FFT, HalfSpaces, last_indentation, run_case, surface_of
from roughvol.resources import cores
from roughvol.study import Case, Study, load

__all__ = [
    "FFT",
    "HalfSpaces",
    "Progress",
    "Status",
    "check_surfaces",
    "collect",
    "cores",
    "folder_of",
    "last_indentation",
    "run",
    "run_case",
    "status",
    "surface_of",
]


@dataclass(frozen=True)
class Status:
    """What is there of a study: its folder and the ids of its cases that are done, missing, running, damaged, failed.

    ``damaged`` holds a reason for each, ``failed`` the error. ``holder`` is the process that runs now, ``left`` its
    estimate of the seconds to go, None if there is none yet.
    """

    folder: Path
    done: tuple[str, ...]
    missing: tuple[str, ...]
    damaged: Mapping[str, str]
    collected: bool
    running: tuple[str, ...] = ()
    failed: Mapping[str, str] = field(default_factory=dict)
    holder: Holder | None = None
    left: float | None = None


def run(
    study: Study | str | Path,
    *,
    out: str | Path | None = None,
    jobs: int | None = None,
    fresh: bool = False,
    on_event: OnEvent | None = None,
    scheduler: str | None = None,
    stopping: Callable[[], bool] = lambda: False,
    only: Collection[str] | None = None,
) -> Dataset:
    """Run every case of a study that is not done yet, store each when it is finished, and return them all together.

    Parameters
    ----------
    study : Study or path of a study file
        What to compute.
    out : path, optional
        Folder of the results; ``runs/<name of the study>`` if not given.
    jobs : int, optional
        Number of processes, ≥ 1; all cores if not given, fewer if the memory does not suffice. It changes no value.
    fresh : bool
        Compute every case anew, also those that are done, also in the folder of another study.
    on_event : callable, optional
        Called with a `Progress` when something has moved.
    scheduler : str, optional
        Address of a Dask scheduler whose workers compute instead of processes here.
    stopping : callable, optional
        Asked now and then; once it is true, the cases begun are finished and the run ends with KeyboardInterrupt.
    only : collection of str, optional
        Ids of the cases to compute; the others are left for another run.

    Returns
    -------
    Dataset
        All cases that are done, as stored in ``study.nc``.

    Raises
    ------
    StudyError, SurfaceError
        If the study or its height file cannot be used; then nothing has been computed.
    FolderError
        If the folder is in use, holds another study, or cannot be written (any more); what is finished stays.
    CampaignError
        If cases failed. The others are stored, and the next run computes only what is missing.
    """
    study = study if isinstance(study, Study) else load(study)
    surface = check_surfaces(study)
    place, cases, text = folder_of(study, out), _cases(study), study.to_yaml()
    if jobs is not None and jobs < 1:
        message = f"jobs is {jobs}; allowed: 1 or more"
        raise CampaignError(message)
    with folder.opened(place):
        if not fresh:
            folder.check_same_study(place, study, cases)
        storage.store(place / "study.yaml", text.encode())
        wanted = cases.keys() if only is None else cases.keys() & set(only)
        notices, absent = _sorted_out(place, cases, fresh=wanted if fresh else ())
        left = {case.id for case in absent} - wanted
        missing = [case for case in absent if case.id in wanted]
        cases = {id: case for id, case in cases.items() if id not in left}
        kept = len(cases) - len(missing)
        if on_event is not None:
            for notice in notices:
                on_event(Progress(cases=len(cases), kept=kept, notice=notice))
        if missing:
            Batch(place, text, missing, kept, surface, on_event).through(jobs, scheduler, stopping)
        elif on_event is not None:
            on_event(Progress(cases=len(cases), kept=len(cases), work=1.0))
        return _collected(place, cases, text)


def status(study: Study | str | Path, out: str | Path | None = None) -> Status:
    """Return what the cases of a study have come to in a folder, also while a run is going on there.

    Of each file only the end is read; whether every bit of it is sound, the next run finds out.
    """
    study = study if isinstance(study, Study) else load(study)
    place, cases = folder_of(study, out), _cases(study)
    holder = folder.holder(place)
    now = folder.small_json(place / "progress.json") if holder else {}
    done, missing, damaged = [], [], {}
    failed = folder.failures(place, cases)
    running = tuple(id for id in now.get("running", ()) if id in cases)
    there = {path.stem for path in (place / "cases").glob("*.nc")}
    for id, case in cases.items():
        why = folder.why_not(case_file(place, id), dataset.labels_for(case), whole=False) if id in there else "missing"
        if why is None:
            done.append(id)
        elif id in running or id in failed:
            continue
        elif why == "missing":
            missing.append(id)
        else:
            damaged[id] = why
    running = tuple(id for id in running if id not in set(done))
    failed = {id: error for id, error in failed.items() if id not in {*done, *running}}
    collected = (place / "study.nc").is_file()
    left = now.get("left")
    return Status(place, tuple(done), tuple(missing), damaged, collected, running, failed, holder, left)


def collect(study: Study | str | Path, out: str | Path | None = None) -> Dataset:
    """Return the cases that are done as one dataset, also of a run that is not finished; nothing is written.

    Raises
    ------
    DatasetError
        If no case is done.
    """
    study = study if isinstance(study, Study) else load(study)
    place, cases = folder_of(study, out), _cases(study)
    parts = []
    done = []
    for id, case in cases.items():
        if folder.why_not(case_file(place, id), dataset.labels_for(case), whole=False) is None:
            with contextlib.suppress(DatasetError):  # what is not sound is left out here, and told of by the next run
                parts.append(dataset.read_arrays(case_file(place, id)))
                done.append(id)
    if not done:
        message = f"no case of {study.name} is finished in {place}"
        raise DatasetError(message)
    return dataset.combine(parts, dataset.provenance(study.to_yaml(), fft=FFT, ids=done))


def check_surfaces(study: Study) -> Surface | None:
    """Read the height file of a study once, so that a bad one is known before anything is computed or written.

    A netCDF file is read in a process of its own, since its library may crash on a damaged one.

    Raises
    ------
    SurfaceError, DatasetError
        If its heights are not a surface, or cannot be read.
    """
    for case in study.cases():
        if case.file is None:
            return None
        if case.file.suffix.lower() != ".nc":
            return surface_of(case)
        return _read_apart(case)
    return None


def _read_apart(case: Case) -> Surface:
    ended: list[tuple[Surface, BaseException | None]] = []
    workers.each(
        _read,
        [case],
        jobs=1,
        on_message=lambda message: None,
        on_end=lambda task, surface, error: ended.append((surface, error)),
    )
    surface, error = ended[0]
    if isinstance(error, workers.Lost):
        message = f"{case.file}: cannot be read as .nc: the netCDF library crashes on it, it is damaged"
        raise DatasetError(message) from error
    if error is not None:
        raise error
    return surface


def _read(case: Case, tell: workers.Tell) -> Surface:
    return surface_of(case)


def folder_of(study: Study, out: str | Path | None = None) -> Path:
    """Return the folder of the results: the one given, or ``runs/<name of the study>``."""
    return Path("runs") / study.name if out is None else Path(out)


def _cases(study: Study) -> dict[str, Case]:
    return {case.id: case for case in study.cases()}


def _sorted_out(place: Path, cases: Mapping[str, Case], *, fresh: Collection[str]) -> tuple[list[str], list[Case]]:
    """Set aside what is not sound or not ours; return what to tell of it, and the cases to compute."""
    storage.remove_leftovers(place / "cases")
    storage.remove_leftovers(place)
    bad = {path: f"{path} is no case of this study" for path in folder.strangers(place, cases)}
    missing = []
    for id, case in cases.items():
        path = case_file(place, id)
        why = folder.why_not(path, dataset.labels_for(case), whole=True) if id not in fresh else "missing"
        if why is not None:
            missing.append(case)
        if why not in (None, "missing"):
            bad[path] = str(why)
    notices = [f"set aside: {why} (now {folder.set_aside(path, why)})" for path, why in bad.items()]
    try:
        if missing:
            (place / "study.nc").unlink(missing_ok=True)  # it would not belong to the cases beside it
        for case in (case for case in missing if case.id in fresh):
            for path in (case_file(place, case.id), checkpoint_file(place, case.id)):
                path.unlink(missing_ok=True)
    except OSError as error:
        raise storage.cannot_write(place, error) from error
    return notices, missing


def _collected(place: Path, cases: Mapping[str, Case], text: str) -> Dataset:
    path = place / "study.nc"
    with contextlib.suppress(DatasetError):
        stored = dataset.read(path)
        if stored.attrs["study"] == text and stored.attrs.get("case_ids") == dataset.ids_text(cases):
            return stored
    dataset.write(_combined(place, cases, text), path)
    return dataset.read(path)


def _combined(place: Path, cases: Mapping[str, Case], text: str) -> Dataset:
    parts = [dataset.read_arrays(case_file(place, id)) for id in cases]
    return dataset.combine(parts, dataset.provenance(text, fft=FFT, ids=cases))
