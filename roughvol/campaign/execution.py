"""The run of a study: all its missing cases in many processes, resumable, each stored as soon as it is finished.

The results of a study lie in one folder (see `run_folder`). A case is done if every bit of its file is as written and
its stamp names this case. Other files under its name are set aside, never trusted or merged. Values depend neither on
the machine nor on the number of processes: one thread sums, and no state that changes an answer passes between cases.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from roughvol.campaign import cluster, collection, cost, interpretation, inventory, machine
from roughvol.campaign.batch import Batch, Control, OnEvent, Progress
from roughvol.campaign.checks import check_surfaces
from roughvol.errors import CampaignError, DatasetError, FolderError
from roughvol.observables.own import register
from roughvol.store import lock, run_folder, same_study, sample_plan, stamped_file
from roughvol.store.dataset import Dataset
from roughvol.store.run_folder import folder_of
from roughvol.study import Case, Study, check_type, load, refused


def run(
    study: Study | str | Path,
    *,
    out: str | Path | None = None,
    jobs: int | None = None,
    fresh: bool = False,
    on_event: OnEvent = lambda progress: None,
    scheduler: str | None = None,
    stopping: Callable[[], bool] = lambda: False,
    only: Collection[str] | None = None,
    made: Collection[Path] = (),
) -> Dataset:
    """Compute the missing cases of a study and return all, as `python.run`.

    ``made`` has files of heights written for this run. They are kept beside its results.
    """
    study = study if isinstance(study, Study) else load(study)
    if scheduler is not None:
        cluster.check_address(scheduler)
    for name, function in (("on_event", on_event), ("stopping", stopping)):
        if not callable(function):
            raise refused(f"{name} is a function, given a value of the type {type(function).__name__}")
    machine.check_jobs(jobs)
    check_type(fresh, bool, "fresh is True or False")
    control = Control(jobs, scheduler, on_event, stopping)
    surface = check_surfaces(study, made)
    folder = folder_of(study, out)
    study = same_study.spelled_as(study, same_study.stored_in(folder, study))
    cases = sample_plan.cases_of(study, folder)
    wanted = _wanted(study, cases, only)
    again = wanted if fresh else set()
    stored = run_folder.stored_ids(folder)
    left = [case for id, case in cases.items() if id in again or id in wanted - stored]
    cost.check_fits(left, cases.values(), folder, here=scheduler is None)
    with lock.opened(folder):
        another = same_study.another_study(folder, study, cases)
        if another and not fresh:
            raise FolderError(another)
        stamped_file.store(folder / "study.yaml", study.stored().encode())
        bodies = {body.file for case in cases.values() for body in case.bodies}
        of_runs = {file for file in bodies if all((file.parent / name).exists() for name in ("study.yaml", "cases"))}
        for file in {*made, *(file for file in of_runs if not file.parent.samefile(folder))}:  # they were in memory
            stamped_file.store(folder / file.name, file.read_bytes())
        notices, absent = inventory.sorted_out(folder, cases, fresh=again, another=another is not None)
        if study.ensemble is not None:
            from roughvol.campaign.rounds import Rounds  # for ensembles alone

            return Rounds(study, folder, cases.keys() - {case.id for case in absent}, control, notices).results()
        changed = [case for case in absent if case.id in wanted]
        taken = set() if fresh else {case.id for case in inventory.taken(folder, changed, stopping)}
        missing = [case for case in changed if case.id not in taken]
        kept = {case.id for case in absent} - wanted
        cases = {id: case for id, case in cases.items() if id not in kept}
        begin = Progress(cases=len(cases), kept=len(cases) - len(missing))
        if taken:
            notices.append(f"nothing to compute for {len(taken)} finished in other runs of this folder")
        if scheduler is None and (long := cost.warning(missing, jobs)):
            notices.append(f"warning: {long}")
        if missing and (sides := interpretation.default_sides(study)):
            notices.append(sides)
        for notice in notices:
            on_event(replace(begin, notice=notice))
        if not missing:
            on_event(replace(begin, work=1.0))
            return collection.of_run(folder, cases, study, stopping, again=bool(changed))
        try:
            text, names = study.of_each_case(), study.names_of_cases() if study.axes else None
            its = surface if len(study.cases()) == 1 else None
            Batch(folder, text, missing, begin.kept, control, surface=its, names=names).compute()
        except CampaignError:
            # a number that was meant otherwise may be the reason
            for sentence in interpretation.doubts(study, surface):
                on_event(replace(begin, notice=f"warning: {sentence}"))
            raise
        return collection.of_run(folder, cases, study, stopping, again=True)


def _wanted(study: Study, cases: Mapping[str, Case], only: Collection[str] | None) -> set[str]:
    """Return the ids of the cases to compute."""
    if only is None:
        return set(cases)
    if study.ensemble is not None:
        raise CampaignError("only: an ensemble decides itself which cases it needs")
    check_type(only, Iterable, "only is a list of ids of cases", CampaignError, but=(str, bytes, Mapping))
    wanted = {str(id) for id in only}
    if not wanted or (strange := wanted - cases.keys()):
        raise CampaignError(f"only: {', '.join(sorted(strange)) if wanted else 'nothing'} names no case of this study")
    return wanted


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

    See Also
    --------
    roughvol.open : Opens the results of a run, with the accessor.

    Examples
    --------
    >>> import roughvol
    >>> from roughvol.campaign import collect
    >>> study = roughvol.study.loads("{name: tiny, surface: {D: 2.5, m: 3, seeds: 2}, sweep: {steps: 2}}")
    >>> ds = roughvol.run(study, jobs=1)
    >>> collect(study).equals(ds)
    True
    """
    study = study if isinstance(study, Study) else load(study)
    register(study.record, study.ensemble)
    folder = folder_of(study, out)
    study = same_study.spelled_as(study, same_study.stored_in(folder, study))
    cases = sample_plan.cases_of(study, folder)
    found = collection.finished(folder, cases)
    if not found.arrays:
        raise DatasetError(f"no case of {study.name} is finished in {folder}")
    if study.ensemble is None:
        return collection.combined(found, cases, study)
    from roughvol.campaign import rounds  # for ensembles alone

    return rounds.collected(study, folder, cases, found)
