"""Campaigns: all cases of a study in many processes, resumable, each stored as soon as it is finished.

A study lands in one folder (see `folder`). A case is done if every bit of its file is as it was written and its stamp
says it is ours; what else lies under its name is set aside, neither trusted nor merged. Values do not depend on where
or by how many processes they are computed: a case is always solved in a process of its own kind, its sums by one
thread, and nothing that can change an answer passes from one case to the next.
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from roughvol import (
    collecting,
    dataset,
    dimensional,
    estimate,
    folder,
    ledger,
    regions,
    resources,
    same_study,
    storage,
    validity,
    workers,
)
from roughvol._version import __version__
from roughvol.batch import Batch, OnEvent, Progress
from roughvol.dataset import Arrays, Dataset
from roughvol.errors import CampaignError, DatasetError, FolderError
from roughvol.folder import case_file, checkpoint_file, folder_of, ledger_file
from roughvol.physics import texture
from roughvol.physics.surface import Surface
from roughvol.pressing import FFT, HalfSpaces, last_indentation, run_case, surface_of
from roughvol.resources import cores
from roughvol.standing import Status, status
from roughvol.study import Case, GeneratedSurface, Study, load

__all__ = [
    "FFT",
    "HalfSpaces",
    "Progress",
    "Status",
    "check_surfaces",
    "collect",
    "cores",
    "folder_of",
    "foreseen",
    "last_indentation",
    "run",
    "run_case",
    "status",
    "surface_of",
]

NAMED = 10  # files set aside that are told of one by one


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
    ResourceError
        If a case needs more memory than this machine has, or the files more disk; then nothing has been computed.
    CampaignError
        If cases failed (the others are stored, and the next run computes only what is missing), or ``only`` names what
        is no case of the study.
    """
    study = study if isinstance(study, Study) else load(study)
    if scheduler is not None:
        workers.check_address(scheduler)
    surface = check_surfaces(study)
    place, cases, text = folder_of(study, out), _cases(study), study.stored()
    if jobs is not None and jobs < 1:
        message = f"jobs is {jobs}; allowed: 1 or more"
        raise CampaignError(message)
    if only is not None and (not only or set(only) - cases.keys()):
        message = f"only: {', '.join(sorted(set(only) - cases.keys())) or 'nothing'} names no case of this study"
        raise CampaignError(message)
    wanted = cases.keys() if only is None else cases.keys() & set(only)
    shape = surface.shape if surface is not None else None
    _check_fits(place, cases, shape, fresh=wanted if fresh else (), wanted=wanted, here=scheduler is None)
    with folder.opened(place):
        another = same_study.another_study(place, study, cases)
        if another and not fresh:
            raise FolderError(another)
        storage.store(place / "study.yaml", text.encode())
        notices, absent = _sorted_out(place, cases, fresh=wanted if fresh else (), another=another is not None)
        left = {case.id for case in absent} - wanted
        missing = [case for case in absent if case.id in wanted]
        cases = {id: case for id, case in cases.items() if id not in left}
        kept = len(cases) - len(missing)
        if scheduler is None and missing:
            notices += _slow(missing, shape, jobs)
        if on_event is not None:
            for notice in notices:
                on_event(Progress(cases=len(cases), kept=kept, notice=notice))
        if missing:
            Batch(place, text, missing, kept, surface, on_event).through(jobs, scheduler, stopping)
        elif on_event is not None:
            on_event(Progress(cases=len(cases), kept=len(cases), work=1.0))
        return _collected(place, cases, study, stopping)


def collect(study: Study | str | Path, out: str | Path | None = None) -> Dataset:
    """Return the cases that are done as one dataset, also of a run that is not finished; nothing is written.

    A file that is not sound is left out, and told of by `status` or the next run.

    Raises
    ------
    DatasetError
        If no case is done.
    """
    study = study if isinstance(study, Study) else load(study)
    place, cases = folder_of(study, out), _cases(study)
    parts, _, versions = collecting.sound_parts(place, cases)
    if not parts:
        message = f"no case of {study.name} is finished in {place}"
        raise DatasetError(message)
    return _combined(parts, cases, study, versions)


def check_surfaces(study: Study) -> Surface | None:
    """Read the height files of a study once, so that a bad one is known before anything is computed or written.

    Those that libraries in C read (netCDF, instruments) are read in a process of its own: these may crash on a damaged
    file.

    Raises
    ------
    SurfaceError, DatasetError
        If its heights are not a surface, or cannot be read.
    StudyError
        If the study wants lengths in units that nothing tells, or regions that hold too few elements.
    """
    cases = study.cases()
    if cases[0].file is None:
        with study.placing():
            dimensional.check(cases[0])
            for m, case in {case.m: case for case in cases if case.m is not None}.items():
                regions.check(case, (2**m + 1, 2**m + 1))
        return None
    here = all(body.file.suffix.lower() in READ_HERE for body in cases[0].bodies)
    with study.placing():
        dimensional.check(cases[0])
        surface = surface_of(cases[0]) if here else _read_apart(cases[0])
        regions.check(cases[0], surface.shape)
    return surface


def foreseen(study: Study, surface: Surface | None = None) -> list[validity.Finding]:
    """Return where a study will leave the model, as far as that is known before anything is computed.

    Parameters
    ----------
    study : Study
        The study.
    surface : Surface, optional
        The surface from its height file, as `check_surfaces` returns it; read if not given. Of generated surfaces the
        roughest is made, that of the first seed, and at most at m = `LOOKED_AT`: its slope only grows with m.
    """
    case, given = study.cases()[0], study.surface
    held = validity.setting(study)
    if case.sweep.steps == 0:
        return []
    if not held.scaled:
        return validity.before(held, case.sweep.target, Sq=math.nan, Sdq=math.nan, L=case.L)
    size = 1.0
    if isinstance(given, GeneratedSurface):
        surface = surface_of(replace(case, D=max(given.D), m=min(max(given.m), LOOKED_AT)))
        size = (given.height or surface.Sq) / surface.Sq
    surface = surface or surface_of(case)
    Sdq = size * texture.Sdq(surface.heights, surface.spacing)
    return validity.peak(held, surface.peak) + validity.before(
        held, case.sweep.target, Sq=size * surface.Sq, Sdq=Sdq, L=surface.side
    )


LOOKED_AT = 10  # m up to which a surface is made for its slope alone; 1025² takes a tenth of a second
READ_HERE = (".npy", ".npz", ".txt", ".csv", ".xyz", ".asc")


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
        files = " or ".join(str(body.file) for body in case.bodies)
        message = f"{files}: cannot be read: the library for this format crashes on it, it is damaged"
        raise DatasetError(message) from error
    if error is not None:
        raise error
    return surface


def _read(case: Case, tell: workers.Tell) -> Surface:
    return surface_of(case)


def _cases(study: Study) -> dict[str, Case]:
    return {case.id: case for case in study.cases()}


def _check_fits(
    place: Path,
    cases: Mapping[str, Case],
    shape: tuple[int, int] | None,
    *,
    fresh: Collection[str],
    wanted: Collection[str],
    here: bool,
) -> None:
    """Refuse to begin what this machine cannot hold, by the cases that have no file yet."""
    there = ledger.files(place / "cases", ".nc")
    left = [case for id, case in cases.items() if id in wanted and (id in fresh or id not in there)]
    if not left:
        return
    nodes = [resources.nodes_of(case, shape) for case in left]
    disk = sum(resources.disk_of(case, n) for case, n in zip(left, nodes, strict=True))
    disk += sum(resources.disk_of(case, resources.nodes_of(case, shape)) for case in cases.values())  # study.nc
    resources.check_fits(left, nodes, disk, place, here=here)


def _slow(cases: Sequence[Case], shape: tuple[int, int] | None, jobs: int | None) -> list[str]:
    """Return a warning if it will take very long."""
    told = estimate.warning_of(cases, [resources.nodes_of(case, shape) for case in cases], jobs or cores())
    return [f"warning: {told}"] if told else []


def _sorted_out(
    place: Path, cases: Mapping[str, Case], *, fresh: Collection[str], another: bool
) -> tuple[list[str], list[Case]]:
    """Set aside what is not sound or not ours; return what to tell of it, and the cases to compute.

    Sound files of cases that this study leaves out stay where they are, unless the folder held another study.
    """
    storage.remove_leftovers(place / "cases")
    storage.remove_leftovers(place)
    strange, old = folder.strangers(place, cases), folder.outdated(place, cases)
    bad = {case_file(place, id): f"{why}; its case is computed anew" for id, why in old.items()}
    if another:
        bad |= {case_file(place, id): f"{case_file(place, id)} is no case of this study" for id in strange}
    there = ledger.files(place / "cases", ".nc")
    missing, sound = [], {}
    versions: Counter[str] = Counter()
    for id, case in cases.items():
        if id not in there or id in fresh:
            missing.append(case)
            continue
        path = case_file(place, id)
        found = folder.examined(path, case, whole=True)
        if found.why is None:
            sound[id] = ledger.Entry(there[id], found.version)
            versions[found.version] += 1
            continue
        missing.append(case)
        bad[path] = f"{found.why}; it is computed {'anew' if found.outdated else 'again'}"
    together = place / "study.nc"
    if together.exists():
        try:
            storage.verified(together)
        except DatasetError as error:
            bad[together] = f"{error}; it is made again from the cases"
    notices = [f"set aside: {why} (now {folder.set_aside(path, why)})" for path, why in bad.items()]
    if missing:
        versions[__version__] += len(missing)
    try:
        if missing:
            together.unlink(missing_ok=True)  # it would not belong to the cases beside it
        for path in (place / "cases").glob(".*.checkpoint"):
            if path.name.removeprefix(".").removesuffix(".checkpoint") in sound:  # of a worker that did not know
                path.unlink(missing_ok=True)
        for case in (case for case in missing if case.id in fresh):
            for path in (case_file(place, case.id), checkpoint_file(place, case.id)):
                path.unlink(missing_ok=True)
    except OSError as error:
        raise storage.cannot_write(place, error) from error
    ledger.write(ledger_file(place), sound)
    told = _few(notices, place)
    if left := [id for id in strange if case_file(place, id) not in bad]:
        told.append(f"{place / 'cases'} keeps files of cases that are not of this study: {len(left)}")
    if several := folder.versions_text(versions):
        told.append(several)
    return told, missing


def _few(notices: list[str], place: Path) -> list[str]:
    if len(notices) <= NAMED + 1:
        return notices
    more = f"set aside: {len(notices) - NAMED} more, each with its reason beside it in {place / 'cases' / 'set_aside'}"
    return [*notices[:NAMED], more]


def _collected(place: Path, cases: Mapping[str, Case], study: Study, stopping: Callable[[], bool]) -> Dataset:
    path = place / "study.nc"
    with contextlib.suppress(DatasetError):
        stored = dataset.read(path)
        same = stored.attrs.get("study") == study.stored() and stored.attrs.get("case_ids") == dataset.ids_text(cases)
        if same and "warnings" in stored.attrs:  # which files of older versions lack
            storage.touch(path)  # newer than the study file, for make
            return stored
    parts, bad, versions = collecting.sound_parts(place, cases, stopping)
    absent = [f"{case_file(place, id)} has vanished" for id in cases if id not in parts and id not in bad]
    if absent or bad:
        message = "\n".join([*bad.values(), *absent])
        raise DatasetError(message)
    dataset.write(_combined(parts, cases, study, versions), path)
    return dataset.read(path)


def _combined(
    parts: Mapping[str, Arrays], cases: Mapping[str, Case], study: Study, versions: Mapping[str, int]
) -> Dataset:
    one = next(iter(cases.values()))
    unit, region = one.length_unit, one.record.region
    attributes = dataset.provenance(
        study.stored(),
        fft=FFT,
        ids=parts,
        region=region,
        length_unit=unit,
        bodies=one.bodies,
        versions=versions,
    )
    if one.surface_text:
        attributes["surface"] = one.surface_text
    results = dimensional.in_units(dataset.combine(list(parts.values()), attributes), study, unit)
    found = validity.after(validity.setting(study), results)
    return results.assign_attrs(warnings="\n".join(validity.sentences(found, one.notes)))
