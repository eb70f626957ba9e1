"""Samples of an ensemble: quantities of single surfaces, by D, level and seed.

A sample is a finished case. Its cost is modelled from the stored counts of convolutions, which are equal on every
machine. Measured times vary with the load of a machine, and so would the number of samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from roughvol.ensemble import cost
from roughvol.ensemble.targets import Arrays, Target, series_of, targets_of
from roughvol.errors import each_problem
from roughvol.study import Case, Ensemble, MadeSurface, Study, levels_below
from roughvol.surfaces import texture
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array

Counts = dict[float, dict[int, int]]  # D -> m -> number of samples


@dataclass(frozen=True)
class Sample:
    """The targets on one surface of one level: values, certified errors of the solver (0 without), modelled seconds."""

    values: Array
    solver_errors: Array
    cost: float


@dataclass(frozen=True)
class Request:
    """The samples of a round: cases to compute, and cases of which the surface alone is made."""

    cases: list[Case]
    surfaces: list[Case]


@dataclass
class SampleTable:
    """All samples of a study, by D and m, in the order of the seeds; index s is seed ``first_seed + s``."""

    study: Study
    finest: int
    samples: dict[tuple[float, int], list[Sample]] = field(default_factory=dict)
    surfaces: dict[float, list[tuple[float, ...]]] = field(default_factory=dict)  # numbers of surfaces alone, by D

    @cached_property
    def ensemble(self) -> Ensemble:
        """Section ``ensemble`` of the study."""
        assert self.study.ensemble is not None
        return self.study.ensemble

    @cached_property
    def targets(self) -> list[Target]:
        """Means to estimate."""
        return targets_of(self.ensemble)

    @property
    def levels(self) -> tuple[int, ...]:
        """M of all levels, coarsest first."""
        return levels_below(self.finest)

    @property
    def dimensions(self) -> tuple[float, ...]:
        """All D."""
        assert isinstance(self.study.surface, MadeSurface)
        return self.study.surface.dimensions

    def of(self, D: float) -> list[list[Sample]]:
        """Return the samples of one D, level by level, coarsest first."""
        return [self.samples.get((D, m), []) for m in self.levels]

    def values(self, D: float, target: int) -> list[Array]:
        """Return the values of one target, level by level."""
        return [np.array([sample.values[target] for sample in of_level]) for of_level in self.of(D)]

    def counts(self, D: float) -> list[int]:
        """Return the number of samples of each level."""
        return [len(samples) for samples in self.of(D)]

    def costs(self, D: float) -> list[float]:
        """Return the mean modelled seconds of a sample on each level."""
        return [float(np.mean([sample.cost for sample in of_level])) for of_level in self.of(D)]

    def cost(self, D: float) -> float:
        """Return the modelled seconds of all samples of one D."""
        alone = len(self.surfaces.get(D, ())) * cost.SURFACE
        return alone + sum(sample.cost for samples in self.of(D) for sample in samples)

    def alone(self, D: float) -> Array:
        """Return the numbers of the surfaces without a solve of one D."""
        return np.array(self.surfaces[D])

    def missing(self, counts: Counts) -> list[Case]:
        """Return the cases of the samples that a plan has and this table lacks."""
        return [
            self.study.sample(D, m, self.ensemble.first_seed + seed)
            for D, planned in counts.items()
            for m, number in planned.items()
            for seed in range(len(self.samples.get((D, m), ())), number)
        ]

    def missing_surfaces(self, D: float, number: int) -> list[Case]:
        """Return the cases of one D whose surfaces are lacking until there are so many."""
        m, first = min(cost.SURFACE_M, self.finest), self.ensemble.first_seed
        return [self.study.sample(D, m, first + seed) for seed in range(len(self.surfaces.get(D, ())), number)]

    def add_all(self, request: Request, arrays: Mapping[str, Arrays], numbers: Iterable[tuple[float, ...]]) -> None:
        """Add the stored arrays of the requested cases by id, and `numbers_of` the requested surfaces."""
        for case, row in zip(request.surfaces, numbers, strict=True):
            assert case.D is not None
            self.surfaces.setdefault(case.D, []).append(row)
        with self.study.placing():
            for case in request.cases:
                self.add(case, arrays[case.id])

    def add(self, case: Case, arrays: Arrays) -> None:
        """Add the sample of a finished case; cases come in the order of their seeds."""
        assert case.D is not None
        assert case.m is not None
        series = series_of(arrays)
        words = f"; m = {case.m} is a coarser level of the estimate at m = {self.finest}" * (case.m < self.finest)
        with each_problem(lambda one: replace(one, message=f"{one.message}{words}")):
            values = np.array([target.value(series, case) for target in self.targets])
        errors = np.array([_solver_error(arrays, target) for target in self.targets])
        self.samples.setdefault((case.D, case.m), []).append(Sample(values, errors, cost_of(case, arrays)))


def numbers_of(surface: Surface) -> tuple[float, ...]:
    """Return Sq/(L Sdq) and z_max/Sq of a surface, which explain part of the scatter without a solve."""
    steepness = surface.Sq / (surface.side * texture.Sdq(surface.with_neighbours, surface.spacing))
    return steepness, (surface.z_max - surface.mean_height) / surface.Sq


def cost_of(case: Case, arrays: Arrays) -> float:
    """Return the modelled seconds of a finished case, from its stored counts of convolutions."""
    single, double = (float(np.nansum(arrays[name][1])) for name in ("convolutions_fp32", "convolutions"))
    return cost.sample_seconds(case, double + cost.SINGLE * single)


def _solver_error(arrays: Arrays, target: Target) -> float:
    """Return the largest certified error of a quantity along the steps; 0 without a certificate."""
    if target.quantity == "free_volume":
        return float(np.max(arrays["residual"][1]))
    if target.quantity == "pressure" and "mean_pressure_bound" in arrays:
        bounds = arrays["mean_pressure_bound"][1].reshape(-1) * arrays["mean_pressure"][1].reshape(-1)
        return float(np.nanmax(bounds, initial=0.0))  # NaN where a region has no pressure
    return 0.0
