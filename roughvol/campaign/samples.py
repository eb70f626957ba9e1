"""Samples of an ensemble: quantities of single surfaces, by D, level and seed.

A sample is a finished case. Its cost is modelled from the stored counts of convolutions, which are equal on every
machine. Measured times vary with the load of a machine, and so would the number of samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from roughvol.campaign import cost, quantities
from roughvol.campaign.one_case import one_thread, surface_of
from roughvol.observables.allocation import Alone
from roughvol.observables.variables import VARIABLES
from roughvol.store.dataset import Arrays
from roughvol.study import CLOSING, Accuracy, Case, Ensemble, Level, MadeSurface, Study, levels_below
from roughvol.study.values.state_kinds import stored_name
from roughvol.surfaces import texture
from roughvol.typing import Array

STEP_SECONDS = 2.0e-4  # cost of a step without its convolutions
SINGLE = 0.6  # cost of a convolution in single precision over one in double precision
ALONE_AT = 6  # m of surfaces without a solve
SURFACE_SECONDS = 6.0e-4  # cost of one of these
SMALLEST = 1e-300  # half-width in place of 0, for a relative accuracy of a mean of 0
ITERATIVE_FROM = 6  # smallest m at which a step iterates
ITERATIVE_SECONDS = 5.0e-4  # additional cost of a step that iterates

Counts = dict[float, dict[int, int]]  # D -> m -> number of samples


@dataclass(frozen=True)
class Target:
    """A mean to estimate: the quantity as named in the study, the state, the accuracy."""

    quantity: str
    state: Level
    accuracy: Accuracy

    @property
    def stored(self) -> str:
        """Name of the stored variable."""
        return stored_name(self.quantity)

    @property
    def symbol(self) -> str:
        """Symbol of the quantity, as V*."""
        return VARIABLES[f"{self.stored}_mean"].symbol.strip("<>")


def targets_of(ensemble: Ensemble) -> list[Target]:
    """Return the means to estimate, state by state.

    Parameters
    ----------
    ensemble : Ensemble
        Section of the study.

    Returns
    -------
    list of Target
        All quantities at the first state, then at the second, and so on; those without a state at the end.
    """
    accuracies: dict[str, Accuracy] = ensemble.accuracy.named
    closing = {name: accuracies.pop(name) for name in CLOSING if name in accuracies}
    at_states = [Target(name, state, accuracy) for state in ensemble.at.levels for name, accuracy in accuracies.items()]
    return [*at_states, *(Target(name, quantities.PERCOLATION, accuracy) for name, accuracy in closing.items())]


@dataclass(frozen=True)
class Sample:
    """The targets on one surface of one level.

    Attributes
    ----------
    values : array, shape (targets,)
        Each quantity at its state.
    solver_errors : array, shape (targets,)
        Certified bounds of the errors of the solver; 0 without a bound.
    cost : float
        Modelled seconds of one core.
    """

    values: Array
    solver_errors: Array
    cost: float


@dataclass
class SampleTable:
    """All samples of a study, by D and level, in the order of the seeds.

    Attributes
    ----------
    study : Study
        With generated surfaces and a section ``ensemble``.
    finest : int
        m of the finest level.
    step_errors : tuple of float, length targets
        Errors between steps over the accuracy, from `steps`.
    samples : dict
        Samples by D and m; index s is seed ``first_seed + s``.
    surfaces : dict
        Numbers of surfaces without a solve, by D; index s is seed ``first_seed + s``.
    """

    study: Study
    finest: int
    step_errors: tuple[float, ...]
    samples: dict[tuple[float, int], list[Sample]] = field(default_factory=dict)
    surfaces: dict[float, list[tuple[float, ...]]] = field(default_factory=dict)

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

    def counts(self, D: float) -> list[int]:
        """Return the number of samples of each level."""
        return [len(samples) for samples in self.of(D)]

    def cost(self, D: float) -> float:
        """Return the modelled seconds of all samples of one D."""
        alone = len(self.surfaces.get(D, ())) * SURFACE_SECONDS
        return alone + sum(sample.cost for samples in self.of(D) for sample in samples)

    def alone(self, D: float) -> Alone:
        """Return the surfaces without a solve of one D."""
        return Alone(np.array(self.surfaces[D]), SURFACE_SECONDS)

    def add_surfaces(self, D: float, number: int) -> None:
        """Make surfaces of one D until there are so many; they are not stored."""
        known, first = self.surfaces.setdefault(D, []), self.ensemble.first_seed
        m = min(ALONE_AT, self.finest)
        with one_thread():
            for seed in range(len(known), number):
                surface = surface_of(self.study.sample(D, m, first + seed))
                steepness = surface.Sq / (surface.side * texture.Sdq(surface.with_neighbours, surface.spacing))
                known.append((steepness, (surface.z_max - surface.mean_height) / surface.Sq))

    def missing(self, counts: Counts) -> list[Case]:
        """Return the cases of the samples that a plan has and this table lacks."""
        first = self.ensemble.first_seed
        return [
            self.study.sample(D, m, first + seed)
            for D, planned in counts.items()
            for m, number in planned.items()
            for seed in range(len(self.samples.get((D, m), ())), number)
        ]

    def add(self, case: Case, arrays: Arrays) -> None:
        """Add the sample of a finished case; cases come in the order of their seeds."""
        assert case.D is not None
        assert case.m is not None
        self.samples.setdefault((case.D, case.m), []).append(sample_of(self.targets, case, arrays))


def sample_of(targets: Sequence[Target], case: Case, arrays: Arrays) -> Sample:
    """Return the sample of a finished case.

    Parameters
    ----------
    targets : sequence of Target
        Means to estimate.
    case : Case
        A generated surface.
    arrays : mapping
        Stored variables of the case: dimensions and values by name.

    Returns
    -------
    Sample
        One value for each target.

    Raises
    ------
    StudyError
        If the sweep ends before a state.
    """
    series = quantities.series_of(arrays)
    return Sample(
        np.array([quantities.value_at(series, target.stored, target.state, case) for target in targets]),
        np.array([_solver_error(arrays, target) for target in targets]),
        cost_of(case, arrays),
    )


def _solver_error(arrays: Arrays, target: Target) -> float:
    """Return the largest certified error of a quantity along the steps; 0 without a certificate."""
    if target.quantity == "free_volume":
        return float(np.max(arrays["residual"][1]))
    if target.quantity == "pressure" and "mean_pressure_bound" in arrays:
        bounds = arrays["mean_pressure_bound"][1].reshape(-1) * arrays["mean_pressure"][1].reshape(-1)
        return float(np.nanmax(bounds))
    return 0.0


def cost_of(case: Case, arrays: Arrays) -> float:
    """Return the modelled seconds of a finished case, from its stored counts of convolutions.

    Parameters
    ----------
    case : Case
        A generated surface.
    arrays : mapping
        Stored variables of the case: dimensions and values by name.

    Returns
    -------
    float
        Seconds of one core.
    """
    assert case.m is not None
    single, double = (float(np.nansum(arrays[name][1])) for name in ("convolutions_fp32", "convolutions"))
    return seconds_of(case, double + SINGLE * single)


def seconds_of(case: Case, convolutions: float) -> float:
    """Return the modelled seconds of a case.

    Parameters
    ----------
    case : Case
        A generated surface.
    convolutions : float
        Convolutions of the full grid, all steps together, in units of one in double precision.

    Returns
    -------
    float
        Seconds of one core.
    """
    assert case.m is not None
    nodes, steps = 2**case.m + 1, case.sweep.steps
    step = STEP_SECONDS + ITERATIVE_SECONDS * (case.m >= ITERATIVE_FROM)
    swept = step * steps + cost.NODE * nodes**2 * math.log(nodes) * convolutions
    searched = 1.0 + cost.SEARCH * cost.searches(case) / max(steps, 1)
    return cost.CASE_OVERHEAD + searched * swept + sum(cost.observable_seconds(case, (nodes, nodes)).values())
