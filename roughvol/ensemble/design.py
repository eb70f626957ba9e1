"""The design of an ensemble: rounds of samples on nested levels until each mean is as accurate as requested.

    design = Design(study, step_errors)
    while request := design.next():
        design.add(request, arrays of request.cases, numbers of request.surfaces)

The design estimates the means from all samples after a round, and plans the samples of the next one. The plan follows
from stored numbers in the order of the seeds. It is therefore the same on every machine. Only a budget uses a clock.

Rounds: Giles, Oper. Res. 56 (2008) 607, here with nested seeds. Estimator: Schaden & Ullmann, SIAM/ASA J. Uncertainty
Quantification 8 (2020) 601.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from roughvol.ensemble.allocation import weights
from roughvol.ensemble.estimate import RELIABLE, MeanEstimate, estimates_of
from roughvol.ensemble.samples import Counts, Request, SampleTable
from roughvol.ensemble.step_error import StepErrors
from roughvol.ensemble.targets import Arrays
from roughvol.errors import CampaignError, Problem, StudyError
from roughvol.study import MadeSurface, Study
from roughvol.study.sections.ensemble import AUTO_TO
from roughvol.study.sections.surface import SpectralSurface, first_finest, holds_all_waves
from roughvol.study.values.units import in_unit

ROUNDS = 40  # largest number of rounds
MOST_SAMPLES = 1_000_000  # largest number of samples for one mean without a budget
FEW_SURFACES = 10_000  # surfaces without a solve that a round may make in any case: six seconds
PILOT = 24  # pilot samples of a level coarser than those of `COSTLY`
COSTLY = {8: 10, 9: 4}  # pilot samples of the levels m = 8 and m = 9
FEWEST = 3  # pilot samples of a level finer than those of `COSTLY`
GROWTH = 4  # largest factor between the samples of a level in successive rounds
PART = 0.6  # share of the planned samples added to a level of fewer than `RELIABLE`
MOST_SURFACES = 100_000  # largest number of surfaces without a solve
MORE = 1.25  # growth of one level where the plan adds none
BIAS_SHARE = 0.5  # largest bias with `m: auto` or `n: auto`, as a share of the accuracy

Estimates = dict[float, list[MeanEstimate]]  # by D


class Design:
    """The samples of an ensemble (``table``), those of the next round, and the means so far.

    Samples are planned (``counts``) by D and m; estimates are those of the last round by D. ``rounds`` has, by D and
    round, the modelled seconds so far and the half-width of each mean. ``stopped`` is the reason for an early end.
    """

    def __init__(self, study: Study, steps: StepErrors) -> None:
        assert isinstance(study.surface, MadeSurface)
        self.steps, self._surface, self._automatic = steps, study.surface, not study.surface.m
        self.table = SampleTable(study, first_finest(study.surface))
        self.counts: Counts = {D: pilot(self.table.levels) for D in self.table.dimensions}
        self.estimates: Estimates = {}
        self.rounds: dict[float, list[tuple[float, tuple[float, ...]]]] = {D: [] for D in self.table.dimensions}
        self.stopped = ""

    def next(self, spent: float = 0.0) -> Request | None:
        """Return the samples of the next round after so many seconds; None once the means are accurate enough.

        `StudyError` for a mean without a limit under ``m: auto`` or ``n: auto``; `CampaignError` for an accuracy out of
        reach.
        """
        if self.estimates:
            counts = self._planned(spent)
            if counts is None:
                return None
            if len(next(iter(self.rounds.values()))) == ROUNDS:
                raise CampaignError(f"the accuracy was not reached in {ROUNDS} rounds")
            self.counts = counts
        surfaces = [case for D in self.counts for case in self.table.missing_surfaces(D, self._alone(D))]
        return Request(self.table.missing(self.counts), surfaces)

    def add(self, request: Request, arrays: Mapping[str, Arrays], numbers: Iterable[tuple[float, ...]]) -> None:
        """Add the stored arrays of the requested cases by id, and `samples.numbers_of` the requested surfaces."""
        self.table.add_all(request, arrays, numbers)
        self.estimates = {D: estimates_of(self.table, D, self.steps.errors) for D in self.table.dimensions}
        for D, estimates in self.estimates.items():
            self.rounds[D].append((self.table.cost(D), tuple(estimate.mean.half_width for estimate in estimates)))

    @property
    def goal(self) -> Counts:
        """Number of samples by D and m that the last estimates require in the end. Few samples make it uncertain."""
        counts = {D: _goal(row, list(self.counts[D].values())) for D, row in self.estimates.items()}
        return {D: dict(zip(self.counts[D], numbers, strict=True)) for D, numbers in counts.items()}

    def _alone(self, D: float) -> int:
        """Return the number of surfaces without a solve of a round: one a seed, and those that the estimates plan."""
        number = max(len(self.table.surfaces.get(D, ())), *self.counts[D].values())
        if self.stopped or D not in self.estimates:
            return number
        planned = max(estimate.plan.alone for estimate in self.estimates[D])
        return max(number, min(planned, max(GROWTH * number, FEW_SURFACES), MOST_SURFACES))

    def _planned(self, spent: float) -> Counts | None:
        """Return the number of samples after the next round, None where no round follows."""
        estimates, table = self.estimates, self.table
        divergent = [pair for pair in self._all() if not pair[1].converges] if self._automatic else []
        if divergent:
            if holds_all_waves(self._surface, table.finest):
                raise _no_limit(divergent, "n" if isinstance(self._surface, SpectralSurface) else "m")
            return self._refined()
        if all(estimate.reached for _, estimate in self._all()):
            biased = any(one.bias > BIAS_SHARE * one.requested for _, one in self._all())
            return self._refined() if self._automatic and table.finest < AUTO_TO and biased else None
        if self.stopped:
            return None
        budget = table.ensemble.budget
        if budget is None:
            self._require_feasible()
        planned = {D: next_counts(row, table.levels, table.counts(D)) for D, row in estimates.items()}
        if budget is None:
            return planned
        costs = {D: row[0].costs for D, row in estimates.items()}
        planned, reduced = within_budget(in_unit(budget, "s") - spent, spent, self.counts, planned, costs)
        if reduced:
            self.stopped = f"stopped by the budget of {budget}, before the accuracy was reached"
        return None if reduced and planned == self.counts else planned

    def _all(self) -> Iterator[tuple[float, MeanEstimate]]:
        """Yield every estimate with its D."""
        yield from ((D, estimate) for D, row in self.estimates.items() for estimate in row)

    def _refined(self) -> Counts:
        """Add a finer level, and return the samples with its pilot."""
        self.table.finest += 1
        return {D: pilot(self.table.levels) | self.counts[D] for D in self.table.dimensions}

    def _require_feasible(self) -> None:
        """Refuse an accuracy that needs more samples than `MOST_SAMPLES`."""
        D, worst = max(
            ((D, estimate) for D, estimate in self._all() if not estimate.reached),
            key=lambda pair: sum(pair[1].plan.samples),
        )
        if sum(worst.plan.samples) > MOST_SAMPLES:
            raise CampaignError(
                f"{_label(D, worst)}: ± {worst.target.accuracy} needs more than {MOST_SAMPLES} samples; "
                f"its mean is about {worst.mean.value:.3g}: ask for less, or set a budget"
            )


def _no_limit(divergent: Sequence[tuple[float, MeanEstimate]], key: str) -> StudyError:
    """Return the refusal of ``m: auto`` or ``n: auto`` for means that have no limit."""
    lines = "; ".join(
        f"{_label(D, estimate)}: its last levels change it by {_changes(estimate.level_means)}"
        for D, estimate in divergent[:3]
    )
    message = f"'auto' needs means that converge with {key}, and these do not ({lines}): give a number"
    return StudyError([Problem(message, f"surface.{key}")])


def _label(D: float, estimate: MeanEstimate) -> str:
    return f"{estimate.target.quantity} at {estimate.target.state.label}, D = {D:g}"


def _changes(level_means: Sequence[float]) -> str:
    """Return the relative changes of a mean over the last three levels, in per cent; from 0 they are infinite."""
    coarse, fine = np.array(level_means[:-1][-3:]), np.array(level_means[1:][-3:])
    change = np.divide(fine - coarse, coarse, out=np.where(fine == coarse, 0.0, np.inf), where=coarse != 0.0)
    return ", ".join(f"{100.0 * part:+.1f} %" for part in change)


def pilot(levels: Sequence[int]) -> dict[int, int]:
    """Return the samples of the pilot by m."""
    return {m: COSTLY.get(m, PILOT if m < min(COSTLY) else FEWEST) for m in levels}


def next_counts(estimates: Sequence[MeanEstimate], levels: Sequence[int], existing: Sequence[int]) -> dict[int, int]:
    """Return the samples of each m after the next round; those that exist if all estimates are reached."""
    counts = _goal(estimates, existing)
    counts = [_approached(number, before) for number, before in zip(counts, existing, strict=True)]
    used = sorted({level for estimate in estimates for level in estimate.plan.levels}, reverse=True)
    for finer, coarser in itertools.pairwise(used):  # nested: a used coarser level has all seeds of a finer one
        counts[coarser] = max(counts[coarser], counts[finer])
    return dict(zip(levels, counts, strict=True))


def _goal(estimates: Sequence[MeanEstimate], existing: Sequence[int]) -> list[int]:
    """Return the samples of each level that the estimates not yet reached require in the end."""
    required = [_required(estimate, existing) for estimate in estimates if not estimate.reached]
    return [max(numbers) for numbers in zip(existing, *required, strict=True)]


def _required(estimate: MeanEstimate, existing: Sequence[int]) -> list[int]:
    """Return the samples of each level that one estimate requires, at least one more than exist."""
    required = list(existing)
    for level, samples in zip(estimate.plan.levels, estimate.plan.samples, strict=True):
        required[level] = max(required[level], samples)
    lacking = len(estimate.alone) < min(estimate.plan.alone, MOST_SURFACES)
    if required == list(existing) and not lacking:  # Student's quantile is wider than the plan assumes
        level = _most_effective_level(estimate)
        required[level] = math.ceil(MORE * existing[level])
    return required


def _most_effective_level(estimate: MeanEstimate) -> int:
    """Return the level of the chain with the largest share of the variance for its cost."""
    links = estimate.mean.links
    shares = [
        weight * link.mean_variance / (link.samples * estimate.costs[link.level])
        for weight, link in zip(weights(links), links, strict=True)
    ]
    return links[int(np.argmax(shares))].level


def _approached(planned: int, existing: int) -> int:
    """Return the samples after the next round: part of the plan, where few samples make the variance uncertain."""
    if existing < RELIABLE and planned > MORE * existing:
        planned = existing + math.ceil(PART * (planned - existing))
    return min(planned, GROWTH * max(existing, 1))


def within_budget(
    left: float, spent: float, counts: Counts, planned: Counts, costs: Mapping[float, Sequence[float]]
) -> tuple[Counts, bool]:
    """Return the plan of a round that fits into the measured seconds left of a budget, and whether it is reduced."""
    done = _modelled(counts, costs)
    rate = spent / done if done > 0.0 else 1.0  # measured seconds over modelled ones
    needed = rate * (_modelled(planned, costs) - done)
    if needed <= left:
        return planned, False
    share = max(left, 0.0) / needed if needed > 0.0 else 0.0  # surfaces without a solve alone are planned
    reduced = {
        D: {m: counts[D][m] + int(share * (number - counts[D][m])) for m, number in levels.items()}
        for D, levels in planned.items()
    }
    return reduced, True


def _modelled(counts: Counts, costs: Mapping[float, Sequence[float]]) -> float:
    """Return the modelled seconds of samples."""
    return sum(
        number * cost for D, levels in counts.items() for number, cost in zip(levels.values(), costs[D], strict=True)
    )
