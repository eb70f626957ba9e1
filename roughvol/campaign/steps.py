"""The steps of an ensemble: the error of the interpolation between them, and their number for ``steps: auto``.

Trial surfaces are solved in memory on a cheap level, with more steps than the samples. With every k-th of these steps
alone, the errors at the omitted steps are known. Of ``steps: auto`` the fewest steps are taken whose mean error is
below `SHARE` of the accuracy at every state, with one standard error added. The errors hardly depend on the level
(docs/ensemble.md). The scatter of these errors over surfaces is part of the interval over seeds.

Seeds and numbers of steps of the trial follow from the study alone. The choice is therefore the same in every run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from roughvol.campaign import quantities
from roughvol.campaign.one_case import HalfSpaces, arrays_of_case
from roughvol.campaign.samples import SMALLEST, Target, targets_of
from roughvol.study import CLOSING, Case, MadeSurface, Study
from roughvol.study.sections.targets import FEWEST_STEPS
from roughvol.typing import Array

SHARE = 0.1  # largest error between steps that needs no remark, over the accuracy
LEVEL = 5  # largest m of the trial surfaces; there a step takes one convolution
EVERY = (6, 4, 3, 2)  # steps of a trial over those that are judged
FIRST, MOST = 6 * FEWEST_STEPS, 960  # steps of a trial that chooses: at first, at most
SURFACES = (24, 96, 384)  # trial surfaces of all D together: at first, and where their scatter decides


@dataclass(frozen=True)
class Steps:
    """The number of steps of all sweeps of an ensemble.

    Attributes
    ----------
    number : int
        Steps.
    errors : tuple of float, length targets
        Error between steps over the accuracy: its mean over the trial surfaces, and one standard error.
    surfaces : int
        Trial surfaces; 0 where nothing is interpolated.
    automatic : bool
        Whether the campaign has chosen the number.
    """

    number: int
    errors: tuple[float, ...]
    surfaces: int
    automatic: bool


def measured(study: Study, stopping: Callable[[], bool] = lambda: False) -> Steps:
    """Return the number of steps of an ensemble, given or chosen, and the errors between them.

    Parameters
    ----------
    study : Study
        With a section ``ensemble``.
    stopping : callable
        Polled between trial surfaces; once it is true, the trial ends with KeyboardInterrupt.

    Returns
    -------
    Steps
        Number and errors.

    Raises
    ------
    StudyError
        If the sweep of a trial surface ends before a state, or a quantity has no value there.
    """
    assert study.ensemble is not None
    targets, automatic = targets_of(study.ensemble), study.sweep.automatic
    given = int(study.sweep.steps)
    if study.sweep.legs[0].listed is not None or all(_exact(target, study) for target in targets):
        return Steps(given, (0.0,) * len(targets), 0, automatic)
    if not automatic:
        return Steps(given, errors_of(study, given, stopping), SURFACES[0], False)
    trial, steps, number = _Trial(study, targets, stopping), FIRST, 0
    while True:
        errors = trial.errors(steps, SURFACES[number], EVERY)
        enough = np.flatnonzero((errors <= SHARE).all(axis=1))
        choice = int(enough[0]) if enough.size else -1
        if enough.size or (steps >= MOST and number == len(SURFACES) - 1):
            return Steps(steps // EVERY[choice], tuple(errors[choice].tolist()), SURFACES[number], True)
        if number < len(SURFACES) - 1 and (trial.noisy(errors[-1]) or steps >= MOST):
            number += 1
        else:
            steps *= 2


def errors_of(study: Study, number: int, stopping: Callable[[], bool] = lambda: False) -> tuple[float, ...]:
    """Return the errors between a number of steps over the accuracy, from trial surfaces.

    Parameters
    ----------
    study : Study
        With a section ``ensemble``.
    number : int
        Steps, ≥ 1.
    stopping : callable
        As for `measured`.

    Returns
    -------
    tuple of float, length targets
        As in `Steps`.

    Raises
    ------
    StudyError
        As for `measured`.
    """
    assert study.ensemble is not None
    trial, every = _Trial(study, targets_of(study.ensemble), stopping), max(2, math.ceil(FIRST / number))
    return tuple(trial.errors(number * every, SURFACES[0], [every])[0].tolist())


def _exact(target: Target, study: Study) -> bool:
    """Return whether a mean needs no interpolation: at the last step, also that of a sweep to its own percolation."""
    if target.state == quantities.PERCOLATION:
        return study.sweep.target.kind == CLOSING[target.stored]
    return target.state.value is None


class _Trial:
    """Surfaces of a cheap level, solved in memory, and their errors with fewer steps."""

    def __init__(self, study: Study, targets: Sequence[Target], stopping: Callable[[], bool]) -> None:
        assert isinstance(study.surface, MadeSurface)
        self._study, self._targets, self._stopping = study, targets, stopping
        self._dimensions = study.surface.dimensions
        self._m = min(LEVEL, study.surface.m[0]) if study.surface.m else LEVEL
        self._half_spaces: HalfSpaces = {}
        self._series: dict[tuple[int, float], list[tuple[Case, quantities.Series]]] = {}
        self._noise = np.zeros(0)

    def errors(self, steps: int, number: int, judged: Sequence[int]) -> Array:
        """Return the errors with every k-th step over the accuracy, shape (judged, targets)."""
        rows: list[Array] = []
        for D in self._dimensions:
            swept = self._swept(steps, D, math.ceil(number / len(self._dimensions)))
            with self._study.placing():
                values = [
                    [quantities.value_at(series, one.stored, one.state, case) for one in self._targets]
                    for case, series in swept
                ]
            errors = [
                [[self._error(series, one, case, k) for one in self._targets] for k in judged] for case, series in swept
            ]
            pairs = zip(self._targets, np.mean(values, axis=0), strict=True)
            requested = [target.accuracy.of(float(mean)) or SMALLEST for target, mean in pairs]
            rows.append(np.array(errors) / np.array(requested))
        each = np.concatenate(rows)
        with np.errstate(invalid="ignore"):  # infinite errors
            noise = np.nan_to_num(each.std(axis=0, ddof=1), nan=0.0) / math.sqrt(len(each))
        self._noise = noise[-1]
        found: Array = np.abs(each.mean(axis=0)) + noise
        return found

    def noisy(self, errors: Array) -> bool:
        """Return whether more surfaces may reduce the errors that are too large: scatter is the half of each."""
        high = errors > SHARE
        return bool((self._noise[high] > 0.5 * errors[high]).all())

    def _error(self, series: quantities.Series, target: Target, case: Case, every: int) -> float:
        """Return the error of one surface; infinite where a number to be chosen might not reach the state."""
        of_target = (series, target.stored, target.state, case)
        if self._study.sweep.automatic and math.isinf(quantities.error_at(*of_target, 2 * every)):
            return math.inf  # without a value at first touch; other surfaces may begin at a larger load
        return quantities.error_at(*of_target, every)

    def _swept(self, steps: int, D: float, number: int) -> list[tuple[Case, quantities.Series]]:
        """Return the first surfaces of one D."""
        assert self._study.ensemble is not None
        known, study = self._series.setdefault((steps, D), []), self._study.with_steps(steps)
        first = self._study.ensemble.first_seed
        for seed in range(first + len(known), first + number):
            if self._stopping():
                raise KeyboardInterrupt
            case = study.sample(D, self._m, seed)
            known.append((case, quantities.series_of(arrays_of_case(case, self._half_spaces))))
        return known[:number]
