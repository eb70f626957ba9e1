"""What an ensemble needs beside its samples, computed here in memory: surfaces alone, and trial surfaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from roughvol.campaign.one_case import Context, arrays_of_case, one_thread, surface_of
from roughvol.ensemble import samples, step_error
from roughvol.ensemble.prediction import Expected, Prediction
from roughvol.ensemble.step_error import StepErrors
from roughvol.store.dataset import Arrays
from roughvol.study import Case, Study


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
    return prediction.expected(in_memory(prediction.cases), surfaces_alone(prediction.surfaces))
