"""The means of an ensemble: rounds of samples on nested levels until each mean is as accurate as requested.

A round computes cases, estimates the means from all samples, and plans the samples of the next round. The plan follows
from stored numbers in the order of the seeds. It is therefore the same on every machine. Only a budget uses a clock.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from roughvol.campaign.estimates import MeanEstimate, estimates_of
from roughvol.campaign.samples import Counts, SampleTable
from roughvol.campaign.sampling import GROWTH, MOST_SURFACES, next_counts, pilot, within_budget
from roughvol.campaign.steps import Steps, measured
from roughvol.errors import CampaignError, Problem, StudyError
from roughvol.store.dataset import Arrays
from roughvol.study import Case, MadeSurface, Study
from roughvol.study.sections.ensemble import AUTO_TO
from roughvol.study.sections.spectral import SpectralSurface, first_finest, holds_all_waves

ROUNDS = 40  # largest number of rounds
MOST_SAMPLES = 1_000_000  # largest number of samples for one mean without a budget
FEW_SURFACES = 10_000  # surfaces without a solve that a round may make in any case: six seconds
BIAS_SHARE = 0.5  # largest bias with `m: auto` or `n: auto`, as a share of the accuracy

Compute = Callable[[Sequence[Case]], Mapping[str, Arrays]]
Estimates = dict[float, list[MeanEstimate]]  # by D


@dataclass
class Answer:
    """The means of an ensemble and their history.

    Attributes
    ----------
    samples : SampleTable
        All samples.
    steps : Steps
        Errors between the steps.
    estimates : dict
        Estimates of all means, by D.
    rounds : dict
        For each D and round: the modelled seconds so far, and the half-width of each mean.
    stopped : str
        The reason for an end before the accuracy was reached; else empty.
    """

    samples: SampleTable
    steps: Steps
    estimates: Estimates
    rounds: dict[float, list[tuple[float, tuple[float, ...]]]]
    stopped: str = ""


def estimate_means(
    study: Study,
    compute: Compute,
    steps: Steps | None = None,
    *,
    on_plan: Callable[[Counts], None] = lambda counts: None,
    on_round: Callable[[Estimates], None] = lambda estimates: None,
    clock: Callable[[], float] = time.monotonic,
) -> Answer:
    """Compute samples round by round until every mean is as accurate as requested.

    Parameters
    ----------
    study : Study
        With a section ``ensemble``.
    compute : callable
        Maps cases to their stored arrays, by the id of the case.
    steps : Steps, optional
        From `steps.measured`. Default: measured here.
    on_plan : callable
        Called before each round with the planned number of samples, by D and m.
    on_round : callable
        Called after each round with the estimates, by D.
    clock : callable
        Seconds, for the budget.

    Returns
    -------
    Answer
        The means, also those of a budget that ended too early.

    Raises
    ------
    StudyError
        If a sweep ends before a state, or a mean has no limit that ``m: auto`` or ``n: auto`` could approach.
    CampaignError
        If the accuracy is out of reach.

    References
    ----------
    Giles, Oper. Res. 56 (2008) 607, for the rounds, here with nested seeds.
    Schaden & Ullmann, SIAM/ASA J. Uncertainty Quantification 8 (2020) 601, for the estimator.
    """
    assert study.ensemble is not None
    assert isinstance(study.surface, MadeSurface)
    automatic = not study.surface.m
    steps = measured(study) if steps is None else steps
    table = SampleTable(study, first_finest(study.surface), steps.errors)
    start, budget = clock(), study.ensemble.budget
    counts: Counts = {D: pilot(table.levels) for D in table.dimensions}
    answer = Answer(table, steps, {}, {D: [] for D in table.dimensions})
    for _ in range(ROUNDS):
        on_plan(counts)
        _complete(table, counts, compute)
        if not answer.stopped:
            _add_surfaces(table, answer.estimates)
        estimates = {D: estimates_of(table, D) for D in table.dimensions}
        _record(answer, estimates)
        on_round(estimates)
        divergent = [pair for pair in _all(estimates) if not pair[1].weak_error.converges] if automatic else []
        if divergent:
            if holds_all_waves(study.surface, table.finest):
                raise _no_limit(divergent, "n" if isinstance(study.surface, SpectralSurface) else "m")
            counts = _refined(table, counts)
            continue
        if all(estimate.reached for _, estimate in _all(estimates)):
            if not automatic or table.finest == AUTO_TO or not _biased(estimates):
                return answer
            counts = _refined(table, counts)
            continue
        if answer.stopped:
            return answer
        if budget is None:
            _require_feasible(estimates)
        planned = {D: next_counts(row, table.levels, table.counts(D)) for D, row in estimates.items()}
        if budget is not None:
            spent, costs = clock() - start, {D: row[0].costs for D, row in estimates.items()}
            planned, reduced = within_budget(budget - spent, spent, counts, planned, costs)
            if reduced:
                answer.stopped = f"stopped by the budget of {budget} after the accuracy was not yet reached"
            if reduced and planned == counts:
                return answer
        counts = planned
    raise CampaignError(f"the accuracy was not reached in {ROUNDS} rounds")


def _complete(table: SampleTable, counts: Counts, compute: Compute) -> None:
    """Compute the samples that a plan has and the table lacks, and a surface alone for each seed."""
    for D, levels in counts.items():
        table.add_surfaces(D, max(levels.values()))
    cases = table.missing(counts)
    if cases:
        arrays = compute(cases)
        with table.study.placing():
            for case in cases:
                table.add(case, arrays[case.id])


def _add_surfaces(table: SampleTable, estimates: Estimates) -> None:
    """Make the surfaces without a solve that the last estimates plan, at most `GROWTH` times those that exist."""
    for D, row in estimates.items():
        planned = max(estimate.plan.alone for estimate in row)
        most = min(max(GROWTH * len(table.surfaces[D]), FEW_SURFACES), MOST_SURFACES)
        table.add_surfaces(D, min(planned, most))


def _record(answer: Answer, estimates: Estimates) -> None:
    """Add the estimates of a round to an answer."""
    answer.estimates = estimates
    for D, row in estimates.items():
        half_widths = tuple(estimate.mean.half_width for estimate in row)
        answer.rounds[D].append((answer.samples.cost(D), half_widths))


def _all(estimates: Estimates) -> Iterator[tuple[float, MeanEstimate]]:
    """Yield every estimate with its D."""
    yield from ((D, estimate) for D, row in estimates.items() for estimate in row)


def _biased(estimates: Estimates) -> bool:
    """Return whether a finer resolution is needed."""
    return any(estimate.weak_error.bias > BIAS_SHARE * estimate.requested for _, estimate in _all(estimates))


def _require_feasible(estimates: Estimates) -> None:
    """Refuse an accuracy that needs more samples than `MOST_SAMPLES`."""
    D, worst = max(
        ((D, estimate) for D, estimate in _all(estimates) if not estimate.reached),
        key=lambda pair: sum(pair[1].plan.samples),
    )
    if sum(worst.plan.samples) > MOST_SAMPLES:
        message = (
            f"{_label(D, worst)}: ± {worst.target.accuracy} needs more than {MOST_SAMPLES} samples; "
            f"its mean is about {worst.mean.value:.3g}: ask for less, or set a budget"
        )
        raise CampaignError(message)


def _refined(table: SampleTable, counts: Counts) -> Counts:
    """Add a finer level to a table, and return the samples with its pilot."""
    table.finest += 1
    return {D: pilot(table.levels) | counts[D] for D in table.dimensions}


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
    """Return the relative changes of a mean over the last three levels, in per cent."""
    changes = [100.0 * (fine / coarse - 1.0) for coarse, fine in itertools.pairwise(level_means[-4:])]
    return ", ".join(f"{change:+.1f} %" for change in changes)
