"""Campaigns: all cases of a study in many processes, resumable, each stored as soon as it is finished.

The results of a study lie in one folder (see `run_folder`). A case is done if every bit of its file is as written and
its stamp names this case. Other files under its name are set aside, never trusted or merged. Values depend neither on
the machine nor on the number of processes: one thread sums, and no state that changes an answer passes between cases.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

from roughvol.campaign import cluster, collected, notebook, shared_cases
from roughvol.campaign.batch import Batch, OnEvent, Progress
from roughvol.campaign.checks import check_missing_cases_fit, check_surfaces, doubtful, slow
from roughvol.campaign.sorting import sorted_out
from roughvol.errors import CampaignError, FolderError
from roughvol.store import (
    lock,
    same_study,
    sample_plan,
    stamped_file,
)
from roughvol.store.dataset import Dataset
from roughvol.store.run_folder import folder_of
from roughvol.study import Study, load


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
    made: Collection[Path] = (),
) -> Dataset:
    """Compute the missing cases of a study and return all; `python.run` is the form for users, with its parameters.

    ``made`` has files of heights written for this run. They are kept beside its results.
    """
    if not isinstance(study, Study):
        study = load(study)
    if scheduler is not None:
        cluster.check_address(scheduler)
    on_event = on_event or notebook.progress()
    surface = check_surfaces(study, made)
    folder, text = folder_of(study, out), study.stored()
    cases = sample_plan.cases_of(study, folder)
    if jobs is not None and jobs < 1:
        raise CampaignError(f"jobs is {jobs}; allowed: 1 or more")
    if only is not None and study.ensemble is not None:
        raise CampaignError("only: an ensemble decides itself which cases it needs")
    if only is not None and (not only or set(only) - cases.keys()):
        message = f"only: {', '.join(sorted(set(only) - cases.keys())) or 'nothing'} names no case of this study"
        raise CampaignError(message)
    wanted = cases.keys() if only is None else cases.keys() & set(only)
    shape = surface.shape if surface is not None else None
    check_missing_cases_fit(folder, cases, shape, fresh=wanted if fresh else (), wanted=wanted, here=scheduler is None)
    with lock.opened(folder):
        another = same_study.another_study(folder, study, cases)
        if another and not fresh:
            raise FolderError(another)
        stamped_file.store(folder / "study.yaml", text.encode())
        for file in made:
            stamped_file.store(folder / file.name, file.read_bytes())
        notices, absent = sorted_out(folder, cases, fresh=wanted if fresh else (), another=another is not None)
        if study.ensemble is not None:
            from roughvol.campaign.rounds import Rounds  # scipy.stats: half a second, for ensembles alone

            sound = cases.keys() - {case.id for case in absent}
            rounds = Rounds(study, folder, sound, notices, on_event, jobs, scheduler, stopping)
            return rounds.results()
        missing = [case for case in absent if case.id in wanted]
        changed = bool(missing)
        if not fresh:
            taken = {case.id for case in shared_cases.taken(folder, missing, stopping)}
            missing = [case for case in missing if case.id not in taken]
            if taken:
                notices = [*notices, f"nothing to compute for {len(taken)} finished in other runs of this folder"]
        left = {case.id for case in absent} - wanted
        cases = {id: case for id, case in cases.items() if id not in left}
        kept = len(cases) - len(missing)
        if scheduler is None and missing:
            notices += slow(missing, shape, jobs)
        if on_event is not None:
            for notice in notices:
                on_event(Progress(cases=len(cases), kept=kept, notice=notice))
        if missing:
            batch = Batch(folder, text, missing, kept, surface, on_event, alone=len(study.cases()) == 1)
            try:
                batch.through(jobs, scheduler, stopping)
            except CampaignError:
                if on_event is not None:  # a number that was meant otherwise may be the reason
                    for sentence in doubtful(study, surface):
                        on_event(Progress(cases=len(cases), kept=kept, notice=f"warning: {sentence}"))
                raise
        elif on_event is not None:
            on_event(Progress(cases=len(cases), kept=len(cases), work=1.0))
        return collected.of_run(folder, cases, study, stopping, again=changed)
