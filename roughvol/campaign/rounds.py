"""The rounds of an ensemble: samples computed as the design asks for them, until the means are accurate.

The samples are cases of the folder. Surfaces without a solve, and trial surfaces, are computed here in memory.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from roughvol.campaign import collection
from roughvol.campaign.batch import Batch, Control, Forecast, Progress
from roughvol.campaign.case_surface import one_thread, surface_of
from roughvol.campaign.collection import Finished
from roughvol.campaign.one_case import Context, arrays_of_case
from roughvol.ensemble import answer, cost, samples, step_error
from roughvol.ensemble.design import Design
from roughvol.ensemble.prediction import Expected, Prediction
from roughvol.ensemble.step_error import StepErrors
from roughvol.observables.variables import DTYPES, VARIABLES
from roughvol.store import sample_plan, small_file
from roughvol.store.dataset import Arrays, Dataset
from roughvol.study import Case, Study


class Rounds:
    """The rounds of an ensemble in its folder, of which samples with a ``sound`` file are not computed again."""

    def __init__(
        self, study: Study, folder: Path, sound: Collection[str], control: Control, notices: Sequence[str]
    ) -> None:
        self._study, self._folder, self._sound = study, folder, sound
        self._on_event, self._control = control.on_event, replace(control, on_event=self._report)
        self._cases: dict[str, Case] = {}
        self._found = Finished()
        self._interval, self._kept, self._forecast = "", 0, Forecast()
        for notice in notices:
            self._report(Progress(cases=len(sound), kept=len(sound), notice=notice))

    def results(self) -> Dataset:
        """Return the dataset of all samples and the answer, written when it has changed.

        The answer of a finished ensemble is the stored one. A run beyond a budget goes on.
        """
        assert self._study.ensemble is not None
        if self._study.ensemble.budget is None:
            stored = collection.stored(self._folder, self._study, self._sound)
            if stored is not None and "answer" in stored.attrs:
                self._report(Progress(cases=len(self._sound), kept=len(self._sound), work=1.0))
                return collection.renewed(self._folder, stored)
        design, began = Design(self._study, step_errors(self._study, self._control.stopping)), time.monotonic()
        while request := design.next(time.monotonic() - began):
            later = self._later(design)
            sample_plan.store(self._folder, design.counts)
            surfaces = surfaces_alone(request.surfaces)
            design.add(request, self._computed(request.cases, later) if request.cases else {}, surfaces)
            self._interval = answer.progress(design.estimates)
            count = len(self._cases)
            done, event = count - self._kept, f"{count} samples"
            self._report(Progress(cases=count, kept=self._kept, done=done, work=1.0, event=event))
        stored = collection.stored(self._folder, self._study, self._cases)
        if stored is not None and stored.attrs.get("answer") == "\n".join(answer.sentences(design)):
            return collection.renewed(self._folder, stored)
        results = collection.combined(self._found, self._cases, self._study)
        return collection.written(self._folder, _with_answer(results, design))

    def _later(self, design: Design) -> float:
        """Return the expected seconds of the samples after the next round."""
        seconds = 0.0
        for D, goal in design.goal.items():
            for m, number in goal.items():
                each = cost.expected_seconds(self._study.sample(D, m, 0))
                seconds += max(number - design.counts[D].get(m, 0), 0) * each
        return seconds

    def _computed(self, cases: Sequence[Case], later: float) -> Mapping[str, Arrays]:
        """Return the arrays of cases, those without a file computed."""
        by_id = {case.id: case for case in cases}
        missing = [case for id, case in by_id.items() if id not in self._sound]
        kept = len(self._cases) + len(by_id) - len(missing)
        self._kept += len(by_id) - len(missing)
        if missing:
            text, control, forecast = self._study.of_each_case(), self._control, self._forecast
            Batch(self._folder, text, missing, kept, control, forecast=forecast, later=later).compute()
        else:
            self._report(Progress(cases=kept, kept=kept, work=1.0))
        found = collection.complete(self._folder, by_id, self._control.stopping)
        self._cases |= by_id
        self._found.arrays |= found.arrays
        self._found.versions += found.versions
        return found.arrays

    def _report(self, progress: Progress) -> None:
        quiet = progress.event if progress.failed or progress.event.endswith("samples") else ""
        self._on_event(replace(progress, event=quiet, interval=self._interval))


def collected(study: Study, folder: Path, cases: Mapping[str, Case], found: Finished) -> Dataset:
    """Return the finished samples of an ensemble, with the means if none is missing."""
    # a budget of time ends elsewhere in each run: its answer is the stored one
    stored = collection.stored(folder, study, found.arrays)
    if stored is not None and "answer" in stored.attrs and found.arrays.keys() == cases.keys():
        return stored
    results = collection.combined(found, {id: case for id, case in cases.items() if id in found.arrays}, study)
    design = Design(study, step_errors(study))
    while request := design.next():
        if absent := sum(case.id not in found.arrays for case in request.cases):
            missing = f"{absent} of {len(request.cases)} samples of a round are missing"
            return results.assign_attrs(answer=f"no answer yet: {missing}; a run of the study goes on")
        design.add(request, found.arrays, surfaces_alone(request.surfaces))
    return _with_answer(results, design)


def _with_answer(results: Dataset, design: Design) -> Dataset:
    """Return a dataset with the variables of an answer, and its sentences as the attribute ``answer``."""
    for name, (dims, array) in answer.variables(design).items():
        row = VARIABLES[name]
        results[name] = (dims, np.asarray(array, dtype=DTYPES[row.kind]))
        results[name].attrs = small_file.words_of(row, results.attrs.get("length_unit", "length"))
    return results.assign_attrs(answer="\n".join(answer.sentences(design)))


def surfaces_alone(cases: Sequence[Case]) -> list[tuple[float, ...]]:
    """Return the numbers of surfaces without a solve."""
    with one_thread():
        return [samples.numbers_of(surface_of(case)) for case in cases]


def in_memory(cases: Sequence[Case], stopping: Callable[[], bool] = lambda: False) -> dict[str, Arrays]:
    """Return the arrays of cases by id, without files."""
    context, found = Context(), {}
    for case in cases:
        if stopping():
            raise KeyboardInterrupt
        found[case.id] = arrays_of_case(case, context)
    return found


def step_errors(study: Study, stopping: Callable[[], bool] = lambda: False) -> StepErrors:
    """Return the errors between the steps of an ensemble, from trial surfaces."""
    return step_error.measured(study, in_memory(step_error.trial(study), stopping))


def expected(study: Study) -> list[Expected]:
    """Return the expected samples and costs of an ensemble by D."""
    prediction = Prediction(study)
    return prediction.expected(in_memory(prediction.request.cases), surfaces_alone(prediction.request.surfaces))
