"""The error between the steps of an ensemble, by the interpolation at a state between two of them.

Trial surfaces of a cheap level have more steps than the samples. With every k-th of these steps alone, the errors at
the omitted steps are known. They hardly depend on the level (docs/explanation/notes/ensemble.md). Their scatter over
surfaces is part of the interval over seeds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from roughvol.ensemble.targets import PERCOLATION, Arrays, Target, error_at, series_of, targets_of
from roughvol.study import CLOSING, Case, MadeSurface, Study

SHARE = 0.1  # largest error between steps that needs no remark, over the accuracy
LEVEL = 5  # largest m of the trial surfaces; there a step takes one convolution
STEPS = 60  # fewest steps of a trial
SURFACES = 24  # trial surfaces of all D together


@dataclass(frozen=True)
class StepErrors:
    """The errors between steps over the accuracy, by target: mean over trial surfaces, and one standard error."""

    errors: tuple[float, ...]
    surfaces: int  # 0 where nothing is interpolated


def trial(study: Study) -> list[Case]:
    """Return the cases of the trial surfaces; none where nothing is interpolated."""
    assert study.ensemble is not None
    assert isinstance(study.surface, MadeSurface)
    if study.sweep.legs[0].listed is not None or all(_exact(target, study) for target in targets_of(study.ensemble)):
        return []
    finer, m = study.changed(**{"sweep.steps": study.sweep.steps * _every(study)}), min((LEVEL, *study.surface.m))
    first, number = study.ensemble.first_seed, math.ceil(SURFACES / len(study.surface.dimensions))
    return [finer.sample(D, m, first + seed) for D in study.surface.dimensions for seed in range(number)]


def measured(study: Study, arrays: Mapping[str, Arrays]) -> StepErrors:
    """Return the errors between steps from the finished cases of `trial`, by id."""
    assert study.ensemble is not None
    targets, every, cases = targets_of(study.ensemble), _every(study), trial(study)
    if not cases:
        return StepErrors((0.0,) * len(targets), 0)
    rows = []
    for D in dict.fromkeys(case.D for case in cases):
        swept = [(case, series_of(arrays[case.id])) for case in cases if case.D == D]
        with study.placing():
            means = np.mean([[target.value(series, case) for target in targets] for case, series in swept], axis=0)
        errors = [
            [error_at(series, target.stored, target.state, case, every) for target in targets] for case, series in swept
        ]
        requested = [target.half_width(float(mean)) for target, mean in zip(targets, means, strict=True)]
        rows.append(np.array(errors) / np.array(requested))
    each = np.concatenate(rows)
    with np.errstate(invalid="ignore"):  # infinite errors
        noise = np.nan_to_num(each.std(axis=0, ddof=1), nan=0.0) / math.sqrt(len(each))
    return StepErrors(tuple((np.abs(each.mean(axis=0)) + noise).tolist()), len(each))


def _every(study: Study) -> int:
    """Return the steps of a trial for each step of the study."""
    return max(2, math.ceil(STEPS / study.sweep.steps))


def _exact(target: Target, study: Study) -> bool:
    """Return whether a mean needs no interpolation: at a solved state, also where the void closes."""
    if target.state == PERCOLATION:
        transport = study.record.transport
        solved = transport is not None and transport.closing and not study.material.yields
        return bool(solved) or study.sweep.target.kind == CLOSING[target.stored]
    return target.state.value is None or study.sweep.legs[0].step_of(target.state) is not None
