"""The rounds of an ensemble in a folder: samples computed, means estimated, until these are as accurate as asked."""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from roughvol.campaign import collected, cost
from roughvol.campaign.batch import Batch, OnEvent, Progress
from roughvol.errors import DatasetError
from roughvol.store import answer, dataset, provenance
from roughvol.store.dataset import Arrays, Dataset
from roughvol.study import Case, Study

if TYPE_CHECKING:
    from roughvol.campaign import ensemble


class Rounds:
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
        self._planned, self._goal = dict[float, dict[int, int]](), dict[float, dict[int, int]]()
        for notice in notices:
            self._report(Progress(cases=len(self._sound), kept=len(self._sound), notice=notice))

    def results(self) -> Dataset:
        """Return the dataset of all samples and the answer, written when it has changed."""
        from roughvol.campaign import answered, ensemble, steps  # scipy.stats: half a second, for ensembles alone

        measured = steps.measured(self._study, self._stopping)
        means = ensemble.estimate_means(
            self._study,
            self._compute,
            measured,
            on_plan=self._plan,
            on_round=self._rounded,
        )
        path, text = self._folder / "study.nc", "\n".join(answered.sentences(means))
        with contextlib.suppress(DatasetError):
            stored = dataset.read(path)
            same = stored.attrs.get("study") == self._study.stored() and stored.attrs.get("answer") == text
            if same and stored.attrs.get("case_ids") == provenance.ids_text(self._cases):
                os.utime(path)
                return stored
        results = collected.combined(self._parts, self._cases, self._study, self._versions)
        dataset.write(answer.with_answer(results, answered.variables(means), text), path)
        return dataset.read(path)

    def _plan(self, counts: Mapping[float, dict[int, int]]) -> None:
        """Store the samples of the next round."""
        self._planned = dict(counts)
        answer.store_plan(self._folder, counts)

    def _later(self) -> float:
        """Return the expected seconds of the samples after those planned."""
        seconds = 0.0
        for D, goal in self._goal.items():
            for m, number in goal.items():
                if (more := number - self._planned.get(D, {}).get(m, 0)) > 0:
                    nodes = 2**m + 1
                    seconds += more * cost.expected_seconds(self._study.sample(D, m, 0), (nodes, nodes))
        return seconds

    def _compute(self, cases: Sequence[Case]) -> Mapping[str, Arrays]:
        """Compute the cases that have no file, and read all."""
        by_id = {case.id: case for case in cases}
        missing = [case for id, case in by_id.items() if id not in self._sound]
        kept = len(self._cases) + len(by_id) - len(missing)
        self._kept += len(by_id) - len(missing)
        if missing:
            batch = Batch(self._folder, self._study.stored(), missing, kept, None, self._report, later=self._later())
            batch.through(self._jobs, self._scheduler, self._stopping)
        else:
            self._report(Progress(cases=kept, kept=kept, work=1.0))
        parts = collected.all_parts(self._folder, by_id, self._stopping, self._versions)
        self._cases |= by_id
        self._parts |= parts
        return parts

    def _rounded(self, estimates: ensemble.Estimates) -> None:
        """Report the interval that is farthest from its accuracy."""
        from roughvol.campaign import answered, sampling

        self._interval = answered.progress(estimates)
        self._goal = {D: sampling.goal(row, self._planned[D]) for D, row in estimates.items()}
        count = len(self._cases)
        done, event = count - self._kept, f"{count} samples"
        self._report(Progress(cases=count, kept=self._kept, done=done, work=1.0, event=event))

    def _report(self, progress: Progress) -> None:
        if self._on_event is not None:
            quiet = progress.event if progress.failed or progress.event.endswith("samples") else ""
            self._on_event(replace(progress, event=quiet, interval=self._interval))
