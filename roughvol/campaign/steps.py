"""The error between the steps of an ensemble, by the interpolation at a state between two of them.

Trial surfaces are solved in memory on a cheap level, with more steps than the samples. With every k-th of these steps
alone, the errors at the omitted steps are known. The errors hardly depend on the level (docs/ensemble.md). Their
scatter over surfaces is part of the interval over seeds.
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
from roughvol.typing import Array

SHARE = 0.1  # largest error between steps that needs no remark, over the accuracy
LEVEL = 5  # largest m of the trial surfaces; there a step takes one convolution
STEPS = 60  # fewest steps of a trial
SURFACES = 24  # trial surfaces of all D together


@dataclass(frozen=True)
class Steps:
    """The errors between the steps of all sweeps of an ensemble.

    Attributes
    ----------
    number : int
        Steps.
    errors : tuple of float, length targets
        Error between steps over the accuracy: its mean over the trial surfaces, and one standard error.
    surfaces : int
        Trial surfaces; 0 where nothing is interpolated.
    """

    number: int
    errors: tuple[float, ...]
    surfaces: int


def measured(study: Study, stopping: Callable[[], bool] = lambda: False) -> Steps:
    """Return the errors between the steps of an ensemble; ``stopping`` is polled between trial surfaces.

    Raises
    ------
    StudyError
        If the sweep of a trial surface ends before a state, or a quantity has no value there.
    """
    assert study.ensemble is not None
    assert isinstance(study.surface, MadeSurface)
    targets, number = targets_of(study.ensemble), study.sweep.steps
    if study.sweep.legs[0].listed is not None or all(_exact(target, study) for target in targets):
        return Steps(number, (0.0,) * len(targets), 0)
    every = max(2, math.ceil(STEPS / number))
    trial, m = study.with_steps(number * every), min((LEVEL, *study.surface.m))
    half_spaces: HalfSpaces = {}
    rows = []
    for D in study.surface.dimensions:
        swept = []
        for seed in range(math.ceil(SURFACES / len(study.surface.dimensions))):
            if stopping():
                raise KeyboardInterrupt
            case = trial.sample(D, m, study.ensemble.first_seed + seed)
            swept.append((case, quantities.series_of(arrays_of_case(case, half_spaces))))
        rows.append(_errors(study, targets, swept, every))
    each = np.concatenate(rows)
    with np.errstate(invalid="ignore"):  # infinite errors
        noise = np.nan_to_num(each.std(axis=0, ddof=1), nan=0.0) / math.sqrt(len(each))
    return Steps(number, tuple((np.abs(each.mean(axis=0)) + noise).tolist()), SURFACES)


def _errors(
    study: Study, targets: Sequence[Target], swept: Sequence[tuple[Case, quantities.Series]], every: int
) -> Array:
    """Return the errors of trial surfaces of one D over the accuracy, shape (surfaces, targets)."""
    with study.placing():
        values = [
            [quantities.value_at(series, one.stored, one.state, case) for one in targets] for case, series in swept
        ]
    errors = [
        [quantities.error_at(series, one.stored, one.state, case, every) for one in targets] for case, series in swept
    ]
    pairs = zip(targets, np.mean(values, axis=0), strict=True)
    requested = [target.accuracy.of(float(mean)) or SMALLEST for target, mean in pairs]
    found: Array = np.array(errors) / np.array(requested)
    return found


def _exact(target: Target, study: Study) -> bool:
    """Return whether a mean needs no interpolation: at the last step, also that of a sweep to its own percolation."""
    if target.state == quantities.PERCOLATION:
        return study.sweep.target.kind == CLOSING[target.stored]
    return target.state.value is None
