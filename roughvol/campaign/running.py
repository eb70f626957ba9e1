"""Campaigns: all cases of a study in many processes, resumable, each stored as soon as it is finished.

The results of a study lie in one folder (see `run_folder`). A case is done if every bit of its file is as written and
its stamp names this case. Other files under its name are set aside, never trusted or merged. Values depend neither on
the machine nor on the number of processes: one thread sums, and no state that changes an answer passes between cases.
"""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roughvol.campaign import cluster, validity
from roughvol.campaign.batch import Batch, OnEvent, Progress
from roughvol.campaign.checks import check_fits, check_surfaces, slow
from roughvol.campaign.one_case import FFT
from roughvol.campaign.sorting import sorted_out
from roughvol.errors import CampaignError, DatasetError, FolderError
from roughvol.store import answer, dataset, dimensional, lock, provenance, run_folder, same_study, stamped_file
from roughvol.store.dataset import Arrays, Dataset
from roughvol.store.run_folder import case_file, folder_of
from roughvol.study import Case, Study, load, of_data

if TYPE_CHECKING:
    from roughvol.campaign import ensemble


def run(
    study: Study | str | Path | Mapping[str, Any],
    *,
    out: str | Path | None = None,
    jobs: int | None = None,
    fresh: bool = False,
    on_event: OnEvent | None = None,
    scheduler: str | None = None,
    stopping: Callable[[], bool] = lambda: False,
    only: Collection[str] | None = None,
) -> Dataset:
    """Compute the missing cases of a study, store each when it is finished, and return all of them.

    Parameters
    ----------
    study : Study, path of a study file, or mapping
        The study; a mapping has the keys of a study file.
    out : path, optional
        Folder of the results. Default: ``runs/<name of the study>``.
    jobs : int, optional
        Number of processes, ≥ 1. Default: all cores, fewer if memory is short. It changes no value.
    fresh : bool
        Compute every case anew, also in the folder of another study.
    on_event : callable, optional
        Called with a `Progress` at every change.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers compute instead of processes here.
    stopping : callable, optional
        Polled during the run. Once it is true, cases begun are finished, and the run ends with KeyboardInterrupt.
    only : collection of str, optional
        Ids of the cases to compute. Default: all.

    Returns
    -------
    Dataset
        The finished cases, as stored in ``study.nc``.

    Raises
    ------
    StudyError, SurfaceError
        If the study or its height file cannot be used. Nothing has been computed.
    FolderError
        If the folder is in use, holds another study, or cannot be written. Finished cases stay.
    ResourceError
        If a case needs more memory, or the files more disk, than there is. Nothing has been computed.
    CampaignError
        If cases failed (the others are stored), or ``only`` names no case of the study.
    """
    if not isinstance(study, Study):
        study = of_data(study) if isinstance(study, Mapping) else load(study)
    if scheduler is not None:
        cluster.check_address(scheduler)
    surface = check_surfaces(study)
    folder, text = folder_of(study, out), study.stored()
    cases = answer.cases_of(study, folder)
    if jobs is not None and jobs < 1:
        message = f"jobs is {jobs}; allowed: 1 or more"
        raise CampaignError(message)
    if only is not None and study.ensemble is not None:
        message = "only: an ensemble decides itself which cases it needs"
        raise CampaignError(message)
    if only is not None and (not only or set(only) - cases.keys()):
        message = f"only: {', '.join(sorted(set(only) - cases.keys())) or 'nothing'} names no case of this study"
        raise CampaignError(message)
    wanted = cases.keys() if only is None else cases.keys() & set(only)
    shape = surface.shape if surface is not None else None
    check_fits(folder, cases, shape, fresh=wanted if fresh else (), wanted=wanted, here=scheduler is None)
    with lock.opened(folder):
        another = same_study.another_study(folder, study, cases)
        if another and not fresh:
            raise FolderError(another)
        stamped_file.store(folder / "study.yaml", text.encode())
        notices, absent = sorted_out(folder, cases, fresh=wanted if fresh else (), another=another is not None)
        if study.ensemble is not None:
            sound = cases.keys() - {case.id for case in absent}
            rounds = _Rounds(study, folder, sound, notices, on_event, jobs, scheduler, stopping)
            return rounds.results()
        missing = [case for case in absent if case.id in wanted]
        left = {case.id for case in absent} - wanted
        cases = {id: case for id, case in cases.items() if id not in left}
        kept = len(cases) - len(missing)
        if scheduler is None and missing:
            notices += slow(missing, shape, jobs)
        if on_event is not None:
            for notice in notices:
                on_event(Progress(cases=len(cases), kept=kept, notice=notice))
        if missing:
            Batch(folder, text, missing, kept, surface, on_event, alone=len(study.cases()) == 1).through(
                jobs, scheduler, stopping
            )
        elif on_event is not None:
            on_event(Progress(cases=len(cases), kept=len(cases), work=1.0))
        return _collected(folder, cases, study, stopping)


def collect(study: Study | str | Path, out: str | Path | None = None) -> Dataset:
    """Return the finished cases as one dataset, also of an unfinished run; nothing is written.

    Damaged files are left out. `status` and the next run report them. Of an ensemble, the dataset has the means as well
    if all samples are finished. Otherwise its attribute ``answer`` gives the number of the missing ones.

    Parameters
    ----------
    study : Study or path of a study file
        Study of the run.
    out : path, optional
        Folder of the results; default: ``runs/<name of the study>``.

    Returns
    -------
    Dataset
        Finished cases, as in ``study.nc``.

    Raises
    ------
    DatasetError
        If no case is finished.
    """
    study = study if isinstance(study, Study) else load(study)
    folder = folder_of(study, out)
    cases = answer.cases_of(study, folder)
    parts, _, versions = _finished(folder, cases)
    if not parts:
        message = f"no case of {study.name} is finished in {folder}"
        raise DatasetError(message)
    if study.ensemble is None:
        return _combined(parts, cases, study, versions)
    return _with_means(study, folder, cases, parts, versions)


class _Unfinished(Exception):
    """Samples that an ensemble needs and its folder lacks."""


def _with_means(
    study: Study, folder: Path, cases: Mapping[str, Case], parts: dict[str, Arrays], versions: Mapping[str, int]
) -> Dataset:
    """Return the finished samples of an ensemble, with the means if none is missing."""
    from roughvol.campaign import answered, ensemble  # scipy.stats: half a second, for ensembles alone

    with contextlib.suppress(DatasetError):  # a budget of time ends elsewhere in each run: its answer is the stored one
        stored = dataset.read(folder / "study.nc")
        same = stored.attrs.get("study") == study.stored() and "answer" in stored.attrs
        if same and stored.attrs.get("case_ids") == provenance.ids_text(parts) and parts.keys() == cases.keys():
            return stored

    def finished(wanted: Sequence[Case]) -> Mapping[str, Arrays]:
        absent = sum(case.id not in parts for case in wanted)
        if absent:
            message = f"{absent} of {len(wanted)} samples of a round are missing"
            raise _Unfinished(message)
        return parts

    results = _combined(parts, {id: case for id, case in cases.items() if id in parts}, study, versions)
    try:
        means = ensemble.estimate_means(study, finished)
    except _Unfinished as error:
        return results.assign_attrs(answer=f"no answer yet: {error}; a run of the study goes on")
    return answer.with_answer(results, answered.variables(means), "\n".join(answered.sentences(means)))


class _Rounds:
    """The rounds of an ensemble, whose samples are cases of the folder."""

    def __init__(
        self,
        study: Study,
        folder: Path,
        sound: Collection[str],
        notices: Sequence[str],
        on_event: OnEvent | None,
        jobs: int | None,
        scheduler: str | None,
        stopping: Callable[[], bool],
    ) -> None:
        self._study, self._folder, self._sound, self._on_event = study, folder, set(sound), on_event
        self._jobs, self._scheduler, self._stopping = jobs, scheduler, stopping
        self._cases: dict[str, Case] = {}
        self._parts: dict[str, Arrays] = {}
        self._versions: Counter[str] = Counter()
        self._interval, self._kept = "", 0
        for notice in notices:
            self._report(Progress(cases=len(self._sound), kept=len(self._sound), notice=notice))

    def results(self) -> Dataset:
        """Return the dataset of all samples and the answer, written when it has changed."""
        from roughvol.campaign import answered, ensemble, steps  # scipy.stats: half a second, for ensembles alone

        measured = steps.measured(self._study, self._stopping)
        if measured.automatic:
            self._report(
                Progress(
                    cases=len(self._sound),
                    kept=len(self._sound),
                    notice=f"{measured.number} steps a sweep, by the accuracy",
                )
            )
        means = ensemble.estimate_means(
            self._study,
            self._compute,
            measured,
            on_plan=lambda counts: answer.store_plan(self._folder, counts, measured.number),
            on_round=self._rounded,
        )
        path, text = self._folder / "study.nc", "\n".join(answered.sentences(means))
        with contextlib.suppress(DatasetError):
            stored = dataset.read(path)
            same = stored.attrs.get("study") == self._study.stored() and stored.attrs.get("answer") == text
            if same and stored.attrs.get("case_ids") == provenance.ids_text(self._cases):
                os.utime(path)
                return stored
        results = _combined(self._parts, self._cases, self._study, self._versions)
        dataset.write(answer.with_answer(results, answered.variables(means), text), path)
        return dataset.read(path)

    def _compute(self, cases: Sequence[Case]) -> Mapping[str, Arrays]:
        """Compute the cases that have no file, and read all."""
        by_id = {case.id: case for case in cases}
        missing = [case for id, case in by_id.items() if id not in self._sound]
        kept = len(self._cases) + len(by_id) - len(missing)
        self._kept += len(by_id) - len(missing)
        if missing:
            Batch(self._folder, self._study.stored(), missing, kept, None, self._report).through(
                self._jobs, self._scheduler, self._stopping
            )
        else:
            self._report(Progress(cases=kept, kept=kept, work=1.0))
        parts = _all_parts(self._folder, by_id, self._stopping, self._versions)
        self._cases |= by_id
        self._parts |= parts
        return parts

    def _rounded(self, estimates: ensemble.Estimates) -> None:
        """Report the interval that is farthest from its accuracy."""
        from roughvol.campaign import answered

        self._interval = answered.progress(estimates)
        count = len(self._cases)
        done, event = count - self._kept, f"{count} samples"
        self._report(Progress(cases=count, kept=self._kept, done=done, work=1.0, event=event))

    def _report(self, progress: Progress) -> None:
        if self._on_event is not None:
            quiet = progress.event if progress.failed or progress.event.endswith("samples") else ""
            self._on_event(replace(progress, event=quiet, interval=self._interval))


def _all_parts(
    folder: Path, cases: Mapping[str, Case], stopping: Callable[[], bool], versions: Counter[str]
) -> dict[str, Arrays]:
    """Return the arrays of cases that are all to be there, and count their versions."""
    parts, faults, found = _finished(folder, cases, stopping)
    absent = [f"{case_file(folder, id)} has vanished" for id in cases if id not in parts and id not in faults]
    if absent or faults:
        message = "\n".join([*faults.values(), *absent])
        raise DatasetError(message)
    versions.update(found)
    return parts


def _collected(folder: Path, cases: Mapping[str, Case], study: Study, stopping: Callable[[], bool]) -> Dataset:
    """Return ``study.nc``, made from the cases unless it is up to date."""
    path = folder / "study.nc"
    with contextlib.suppress(DatasetError, OSError):
        stored = dataset.read(path)
        if stored.attrs.get("study") == study.stored() and stored.attrs.get("case_ids") == provenance.ids_text(cases):
            os.utime(path)  # newer than the study file, for make
            return stored
    versions: Counter[str] = Counter()
    parts = _all_parts(folder, cases, stopping, versions)
    dataset.write(_combined(parts, cases, study, versions), path)
    return dataset.read(path)


def _finished(
    folder: Path, cases: Mapping[str, Case], stopping: Callable[[], bool] = lambda: False
) -> tuple[dict[str, Arrays], dict[str, str], dict[str, int]]:
    """Return the finished cases by id, the faults of unusable files by id, and the number of cases by version."""
    parts: dict[str, Arrays] = {}
    faults: dict[str, str] = {}
    versions: Counter[str] = Counter()
    for id, case in cases.items():
        if stopping():
            raise KeyboardInterrupt
        path = case_file(folder, id)
        try:
            arrays, labels = dataset.read_arrays(path)
        except DatasetError as error:
            if path.exists():
                faults[id] = str(error)
            continue
        fault = run_folder.mismatch(path, labels, run_folder.labels_for(case))
        if fault is None:
            parts[id] = arrays
            versions[labels.get("version", "")] += 1
        else:
            faults[id] = fault
    return parts, faults, dict(versions)


def _combined(
    parts: Mapping[str, Arrays], cases: Mapping[str, Case], study: Study, versions: Mapping[str, int]
) -> Dataset:
    """Return the dataset of a study with its provenance, dimensional values and warnings."""
    case = next(iter(cases.values()))
    attributes = provenance.provenance(
        study.stored(),
        fft=FFT,
        ids=parts,
        region=case.record.region,
        length_unit=case.length_unit,
        bodies=[body for one in cases.values() for body in one.bodies],
        versions=versions,
        periodic=case.periodic,
    )
    if case.surface_text:
        attributes["surface"] = case.surface_text
    results = dimensional.in_units(dataset.combine(list(parts.values()), attributes), study, case.length_unit)
    findings = validity.after(validity.setting(study), results)
    return results.assign_attrs(warnings="\n".join(validity.sentences(findings, case.notes)))
