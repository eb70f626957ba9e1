"""Campaigns: all cases of a study in many processes, resumable, each stored as soon as it is finished.

A study lands in one folder (see `folder`). A case is done if every bit of its file is as it was written and its stamp
says it is ours; what else lies under its name is set aside, neither trusted nor merged. Values do not depend on where
or by how many processes they are computed: a case is always solved in a process of its own kind, its sums by one
thread, and nothing that can change an answer passes from one case to the next.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from roughvol._version import __version__
from roughvol.campaign import answered, ensemble, validity, workers
from roughvol.campaign.batch import Batch, OnEvent, Progress
from roughvol.campaign.checks import check_fits, check_surfaces, slow
from roughvol.campaign.one_case import FFT
from roughvol.errors import CampaignError, DatasetError, FolderError
from roughvol.store import answer, collection, dataset, dimensional, ledger, lock, run_folder, same_study, stamped_file
from roughvol.store.dataset import Arrays, Dataset
from roughvol.store.run_folder import case_file, checkpoint_file, folder_of, ledger_file
from roughvol.study import Case, Study, load

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
    place, text = folder_of(study, out), study.stored()
    cases = answer.cases_of(study, place)
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
    check_fits(place, cases, shape, fresh=wanted if fresh else (), wanted=wanted, here=scheduler is None)
    with lock.opened(place):
        another = same_study.another_study(place, study, cases)
        if another and not fresh:
            raise FolderError(another)
        stamped_file.store(place / "study.yaml", text.encode())
        notices, absent = _sorted_out(place, cases, fresh=wanted if fresh else (), another=another is not None)
        if study.ensemble is not None:
            sound = cases.keys() - {case.id for case in absent}
            rounds = _Rounds(study, place, sound, notices, on_event, jobs, scheduler, stopping)
            return rounds.answered()
        left = {case.id for case in absent} - wanted
        missing = [case for case in absent if case.id in wanted]
        cases = {id: case for id, case in cases.items() if id not in left}
        kept = len(cases) - len(missing)
        if scheduler is None and missing:
            notices += slow(missing, shape, jobs)
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
    place = folder_of(study, out)
    cases = answer.cases_of(study, place)
    parts, _, versions = collection.sound_parts(place, cases)
    if not parts:
        message = f"no case of {study.name} is finished in {place}"
        raise DatasetError(message)
    return _combined(parts, cases, study, versions)


class _Rounds:
    """The rounds of an ensemble: its samples are cases of the folder like all others."""

    def __init__(
        self,
        study: Study,
        place: Path,
        sound: Collection[str],
        notices: Sequence[str],
        on_event: OnEvent | None,
        jobs: int | None,
        scheduler: str | None,
        stopping: Callable[[], bool],
    ) -> None:
        self._study, self._place, self._sound, self._on_event = study, place, set(sound), on_event
        self._jobs, self._scheduler, self._stopping = jobs, scheduler, stopping
        self._cases: dict[str, Case] = {}
        self._parts: dict[str, Arrays] = {}
        self._versions: Counter[str] = Counter()
        self._standing, self._kept = "", 0
        for notice in notices:
            self._tell(Progress(cases=len(self._sound), kept=len(self._sound), notice=notice))

    def answered(self) -> Dataset:
        """Return the dataset of all samples and the answer, written when it has changed."""
        found = ensemble.answer(
            self._study,
            self._compute,
            planned=lambda counts: answer.keep_plan(self._place, counts),
            on_round=self._judged,
        )
        path, said = self._place / "study.nc", "\n".join(answered.sentences(found))
        with contextlib.suppress(DatasetError):
            stored = dataset.read(path)
            same = stored.attrs.get("study") == self._study.stored() and stored.attrs.get("answer") == said
            if same and stored.attrs.get("case_ids") == dataset.ids_text(self._cases):
                stamped_file.touch(path)
                return stored
        results = _combined(self._parts, self._cases, self._study, self._versions)
        dataset.write(answer.with_answer(results, answered.variables(found), said), path)
        return dataset.read(path)

    def _compute(self, cases: Sequence[Case]) -> Mapping[str, Arrays]:
        """Compute the cases that have no file, and read all."""
        asked = {case.id: case for case in cases}
        missing = [case for id, case in asked.items() if id not in self._sound]
        kept = len(self._cases) + len(asked) - len(missing)
        self._kept += len(asked) - len(missing)
        if missing:
            Batch(self._place, self._study.stored(), missing, kept, None, self._tell).through(
                self._jobs, self._scheduler, self._stopping
            )
        else:
            self._tell(Progress(cases=kept, kept=kept, work=1.0))
        parts = _all_parts(self._place, asked, self._stopping, self._versions)
        self._cases |= asked
        self._parts |= parts
        return parts

    def _judged(self, standings: dict[float, list[ensemble.Standing]]) -> None:
        self._standing = answered.standing(standings)
        count = len(self._cases)
        self._tell(Progress(cases=count, kept=self._kept, done=count - self._kept, work=1.0, event=f"{count} samples"))

    def _tell(self, progress: Progress) -> None:
        if self._on_event is not None:
            quiet = progress.event if progress.failed or progress.event.endswith("samples") else ""
            self._on_event(replace(progress, event=quiet, standing=self._standing))


def _all_parts(
    place: Path, cases: Mapping[str, Case], stopping: Callable[[], bool], versions: Counter[str]
) -> dict[str, Arrays]:
    """Return the arrays of cases that are all to be there, and count their versions."""
    parts, bad, found = collection.sound_parts(place, cases, stopping)
    absent = [f"{case_file(place, id)} has vanished" for id in cases if id not in parts and id not in bad]
    if absent or bad:
        message = "\n".join([*bad.values(), *absent])
        raise DatasetError(message)
    versions.update(found)
    return parts


def _sorted_out(
    place: Path, cases: Mapping[str, Case], *, fresh: Collection[str], another: bool
) -> tuple[list[str], list[Case]]:
    """Set aside what is not sound or not ours; return what to tell of it, and the cases to compute.

    Sound files of cases that this study leaves out stay where they are, unless the folder held another study.
    """
    stamped_file.remove_leftovers(place / "cases")
    stamped_file.remove_leftovers(place)
    strange, old = run_folder.strangers(place, cases), run_folder.outdated(place, cases)
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
        found = run_folder.examined(path, case, whole=True)
        if found.why is None:
            sound[id] = ledger.Entry(there[id], found.version)
            versions[found.version] += 1
            continue
        missing.append(case)
        bad[path] = f"{found.why}; it is computed {'anew' if found.outdated else 'again'}"
    together = place / "study.nc"
    if together.exists():
        try:
            stamped_file.verified(together)
        except DatasetError as error:
            bad[together] = f"{error}; it is made again from the cases"
    notices = [f"set aside: {why} (now {run_folder.set_aside(path, why)})" for path, why in bad.items()]
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
        raise stamped_file.cannot_write(place, error) from error
    ledger.write(ledger_file(place), sound)
    told = _few(notices, place)
    if left := [id for id in strange if case_file(place, id) not in bad]:
        told.append(f"{place / 'cases'} keeps files of cases that are not of this study: {len(left)}")
    if several := run_folder.versions_text(versions):
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
            stamped_file.touch(path)  # newer than the study file, for make
            return stored
    versions: Counter[str] = Counter()
    parts = _all_parts(place, cases, stopping, versions)
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
