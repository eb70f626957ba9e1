"""Campaigns: all cases of a study in many processes, resumable, each stored as soon as it is finished.

The results of a study lie in one folder (see `run_folder`). A case is done if every bit of its file is as written and
its stamp names this case. Other files under its name are set aside, never trusted or merged. Values depend neither on
the machine nor on the number of processes: one thread sums, and no state that changes an answer passes between cases.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roughvol.campaign import cluster, collected, known, notebook
from roughvol.campaign.batch import Batch, OnEvent, Progress
from roughvol.campaign.checks import check_fits, check_surfaces, slow
from roughvol.campaign.rounds import Rounds
from roughvol.campaign.sorting import sorted_out
from roughvol.errors import CampaignError, FolderError
from roughvol.store import (
    answer,
    lock,
    same_study,
    stamped_file,
)
from roughvol.store.dataset import Dataset
from roughvol.store.run_folder import folder_of
from roughvol.study import Study, load, of_data

if TYPE_CHECKING:
    pass


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
        Number of processes, ≥ 1; 1 is this process. Default: all cores, fewer if memory is short or the run is. It
        changes no value.
    fresh : bool
        Compute every case anew, also in the folder of another study.
    on_event : callable, optional
        Called with a `Progress` at every change. Default: in a notebook, a bar; else nothing.
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
    on_event = on_event or notebook.progress()
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
            rounds = Rounds(study, folder, sound, notices, on_event, jobs, scheduler, stopping)
            return rounds.results()
        missing = [case for case in absent if case.id in wanted]
        changed = bool(missing)
        if not fresh:
            found = known.answered(folder, missing, text, stopping)
            missing, notices = found.missing, [*notices, *filter(None, [found.notice])]
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
        return collected.of_run(folder, cases, study, stopping, again=changed)
