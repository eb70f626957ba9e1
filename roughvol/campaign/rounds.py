"""The rounds of an ensemble in a folder: samples computed as the design asks for them, until the means are accurate."""

from __future__ import annotations

import contextlib
import os
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from roughvol.campaign import collected, trials
from roughvol.campaign.batch import Batch, OnEvent, Progress
from roughvol.ensemble import answer, cost
from roughvol.ensemble.design import Design
from roughvol.errors import DatasetError
from roughvol.store import dataset, provenance, sample_plan
from roughvol.store.dataset import Arrays, Dataset
from roughvol.study import Case, Study


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
        for notice in notices:
            self._report(Progress(cases=len(self._sound), kept=len(self._sound), notice=notice))

    def results(self) -> Dataset:
        """Return the dataset of all samples and the answer, written when it has changed."""
        design, began = Design(self._study, trials.step_errors(self._study, self._stopping)), time.monotonic()
        while request := design.next(time.monotonic() - began):
            later = self._later(design)
            sample_plan.store(self._folder, design.counts)
            surfaces = trials.surfaces_alone(request.surfaces)
            design.add(self._computed(request.cases, later) if request.cases else {}, surfaces)
            self._interval = answer.progress(design.estimates)
            self._report_samples()
        path, text = self._folder / "study.nc", "\n".join(answer.sentences(design))
        with contextlib.suppress(DatasetError):
            stored = dataset.read(path)
            same = stored.attrs.get("study") == self._study.stored() and stored.attrs.get("answer") == text
            if same and stored.attrs.get("case_ids") == provenance.ids_text(self._cases):
                os.utime(path)
                return stored
        results = collected.combined(self._parts, self._cases, self._study, self._versions)
        dataset.write(collected.with_answer(results, design), path)
        return dataset.read(path)

    def _later(self, design: Design) -> float:
        """Return the expected seconds of the samples after the next round."""
        seconds = 0.0
        for D, goal in design.goal.items():
            for m, number in goal.items():
                nodes = 2**m + 1
                each = cost.expected_seconds(self._study.sample(D, m, 0), (nodes, nodes))
                seconds += max(number - design.counts[D].get(m, 0), 0) * each
        return seconds

    def _computed(self, cases: Sequence[Case], later: float) -> Mapping[str, Arrays]:
        """Return the arrays of cases, those without a file computed."""
        by_id = {case.id: case for case in cases}
        missing = [case for id, case in by_id.items() if id not in self._sound]
        kept = len(self._cases) + len(by_id) - len(missing)
        self._kept += len(by_id) - len(missing)
        if missing:
            batch = Batch(self._folder, self._study.stored(), missing, kept, None, self._report, later=later)
            batch.through(self._jobs, self._scheduler, self._stopping)
        else:
            self._report(Progress(cases=kept, kept=kept, work=1.0))
        parts = collected.all_parts(self._folder, by_id, self._stopping, self._versions)
        self._cases |= by_id
        self._parts |= parts
        return parts

    def _report_samples(self) -> None:
        """Report the number of samples after a round."""
        count = len(self._cases)
        done, event = count - self._kept, f"{count} samples"
        self._report(Progress(cases=count, kept=self._kept, done=done, work=1.0, event=event))

    def _report(self, progress: Progress) -> None:
        if self._on_event is not None:
            quiet = progress.event if progress.failed or progress.event.endswith("samples") else ""
            self._on_event(replace(progress, event=quiet, interval=self._interval))
