"""The ensemble: rounds of samples on nested levels until the mean of each quantity is as accurate as asked.

A round computes cases, reads what is stored of them, and decides how many more each level needs. The decision uses
stored numbers in the order of the seeds and nothing else. Its costs are modelled: counts of convolutions, which are
stored with each case and equal on every machine, times the constants of this module. Measured times differ from run to
run, and would make the samples depend on how busy a machine is. Only a budget of time is measured.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from roughvol.errors import CampaignError, Problem, StudyError
from roughvol.observables import allocation, multilevel, refinement
from roughvol.observables.allocation import Plan
from roughvol.observables.at_state import at_state, error_between_steps
from roughvol.observables.multilevel import Link, Mean
from roughvol.observables.refinement import WeakError
from roughvol.store.dataset import Arrays
from roughvol.study import STORED_AS, Accuracy, Case, Ensemble, Level, MadeSurface, Study, levels_below
from roughvol.study.ensemble import AUTO_FROM, AUTO_TO
from roughvol.study.yaml_text import number_text
from roughvol.typing import Array

# Seconds of one core, for the allocation: a case with its file; a step; a node, times log N, a convolution
CASE_SECONDS, STEP_SECONDS, NODE_SECONDS, SINGLE = 0.016, 2.0e-4, 6.0e-9, 0.6
ITERATIVE_FROM, ITERATIVE = 6, 5.0e-4  # m from which on a step iterates, and the seconds that adds
PILOT = 24  # samples of a level before anything is decided, and of the levels that cost much:
COSTLY = {8: 10, 9: 4}
FEWEST = 3
GROWTH = 4  # by which a level grows in one round: its variance is not known well before
KNOWN, PART = 60, 0.6  # samples that give a variance to 20 %, and the share of the way gone with fewer
STOPPING = 3.0  # samples that it costs to stop when the interval is narrow, see `multilevel`
ROUNDS = 40
MOST_CASES = 1_000_000
MORE = 1.25  # by which the level that adds most grows where the plan sees no need
BIAS_SHARE = 0.5  # of the accuracy, that `m: auto` leaves to the resolution

Compute = Callable[[Sequence[Case]], Mapping[str, Arrays]]
Counts = dict[float, dict[int, int]]  # D -> m -> samples


@dataclass(frozen=True)
class Target:
    """One mean that is asked for: the quantity as the study names it, the state, the accuracy."""

    quantity: str
    state: Level
    accuracy: Accuracy

    @property
    def stored(self) -> str:
        """Name of the stored variable."""
        return STORED_AS.get(self.quantity, self.quantity)


def targets_of(ensemble: Ensemble) -> list[Target]:
    """Return the means that are asked for, state by state."""
    asked: dict[str, Accuracy] = ensemble.accuracy.named
    return [Target(name, state, accuracy) for state in ensemble.at.levels for name, accuracy in asked.items()]


@dataclass(frozen=True)
class Sample:
    """What one surface adds: every target's value, its error between steps, that of the solver, and the cost."""

    values: Array
    between: Array
    solver: Array
    cost: float


@dataclass(frozen=True)
class Standing:
    """What is known of one target at one D."""

    target: Target
    mean: Mean
    plan: Plan
    costs: tuple[float, ...]
    links: Mapping[tuple[int, int], Link]
    level_means: tuple[float, ...]
    correlations: tuple[float, ...]
    between: float
    solver: float
    weak: WeakError

    @property
    def wanted(self) -> float:
        """Half-width asked for."""
        return self.target.accuracy.of(self.mean.value)

    @property
    def holds(self) -> bool:
        """Whether the interval is as narrow as asked."""
        return self.mean.half_width <= self.wanted

    @property
    def level_variances(self) -> tuple[float, ...]:
        """Variance over surfaces on each level."""
        levels = range(len(self.costs))
        return tuple(multilevel.variance_of(self.links, multilevel.ladder(self.links, k)) for k in levels)

    @property
    def residuals(self) -> tuple[float, ...]:
        """Variance on each level that the coarser one leaves; of the coarsest, all of it."""
        ladders = [multilevel.ladder(self.links, k) for k in range(len(self.costs))]
        return tuple(self.links[k, one[-2] if len(one) > 1 else -1].variance for k, one in enumerate(ladders))

    @property
    def plain_cost(self) -> float:
        """Seconds that the plain mean of the finest level would take for the interval asked for."""
        wanted = max(self.wanted, 1e-300)
        return allocation.plain_cost(self.level_variances[-1], self.costs[-1], wanted)


@dataclass
class Ensembles:
    """All samples of a study so far, by D, level and seed, and what follows from them."""

    study: Study
    m: int
    samples: dict[tuple[float, int], list[Sample]] = field(default_factory=dict)

    @cached_property
    def targets(self) -> list[Target]:
        """The means that are asked for."""
        assert self.study.ensemble is not None
        return targets_of(self.study.ensemble)

    @property
    def levels(self) -> tuple[int, ...]:
        """Resolutions, coarsest first."""
        return levels_below(self.m)

    @property
    def _surface(self) -> MadeSurface:
        assert isinstance(self.study.surface, MadeSurface)
        return self.study.surface

    @property
    def dimensions(self) -> tuple[float, ...]:
        """All D."""
        return self._surface.dimensions

    def have(self, D: float) -> list[int]:
        """Return the samples of each level."""
        return [len(self.samples.get((D, m), ())) for m in self.levels]

    def cost(self, D: float) -> float:
        """Return the modelled seconds of all samples of one D."""
        return sum(sample.cost for m in self.levels for sample in self.samples.get((D, m), ()))

    def standings(self, D: float) -> list[Standing]:
        """Return what is known of each target."""
        costs = tuple(float(np.mean([one.cost for one in self.samples[D, m]])) for m in self.levels)
        have = self.have(D)
        return [self._standing(D, number, costs, have) for number in range(len(self.targets))]

    def _standing(self, D: float, number: int, costs: tuple[float, ...], have: list[int]) -> Standing:
        target = self.targets[number]
        values = [np.array([one.values[number] for one in self.samples[D, m]]) for m in self.levels]
        links = multilevel.links_of(values)
        ladders = [multilevel.ladder(links, k) for k in range(len(values))]
        means = [multilevel.chain(values, levels, links).value for levels in ladders]
        wanted = target.accuracy.of(means[-1]) or 1e-300
        planned = _with_better_bases(links, have)
        plan = allocation.plan(planned, costs, have, wanted)
        mean = multilevel.chain(values, plan.levels, links, STOPPING)
        if mean.half_width > wanted and plan.samples == tuple(have[k] for k in plan.levels):
            known = allocation.predicted(mean.links, [link.samples for link in mean.links])
            t = max(mean.half_width / math.sqrt(known), allocation.NORMAL)
            plan = allocation.plan(planned, costs, have, wanted * allocation.NORMAL / t)
        pairs = list(itertools.pairwise(values))
        steps = [fine[: coarse.size] - coarse[: fine.size] for coarse, fine in pairs]
        finest = self.samples[D, self.levels[-1]]
        return Standing(
            target,
            mean,
            plan,
            costs,
            links,
            tuple(means),
            tuple(multilevel.correlation(fine, coarse) for coarse, fine in pairs),
            abs(float(np.mean([one.between[number] for one in finest]))),
            float(np.max([one.solver[number] for m in self.levels for one in self.samples[D, m]])),
            refinement.weak_error(
                means,
                [float(step.mean()) for step in steps],
                [float(step.std(ddof=1)) / math.sqrt(step.size) for step in steps],
            ),
        )

    def add(self, case: Case, arrays: Arrays) -> None:
        """Add one case, in the order of the seeds."""
        assert case.D is not None
        assert case.m is not None
        self.samples.setdefault((case.D, case.m), []).append(sampled(self.targets, case, arrays))


def _with_better_bases(links: Mapping[tuple[int, int], Link], have: Sequence[int]) -> dict[tuple[int, int], Link]:
    """Return links for a plan, in which a level of few samples has the variance that the coarser ones give it.

    Chance makes the variance of ten samples small often enough for a plan to begin on such a level.
    """
    better = dict(links)
    for level, samples in enumerate(have):
        if samples < KNOWN and (level, -1) in links:
            variance = multilevel.variance_of(links, multilevel.ladder(links, level))
            better[level, -1] = replace(links[level, -1], variance=variance)
    return better


def pilot(levels: Sequence[int]) -> dict[int, int]:
    """Return the samples of each level before anything is decided."""
    return {m: COSTLY.get(m, PILOT if m < min(COSTLY) else FEWEST) for m in levels}


def next_counts(standings: Sequence[Standing], levels: Sequence[int], have: Sequence[int]) -> dict[int, int]:
    """Return the samples that each level is to have after the next round; those there are if all targets hold."""
    wanted = list(have)
    for one in standings:
        if one.holds:
            continue
        asked = list(have)
        for level, samples in zip(one.plan.levels, one.plan.samples, strict=True):
            asked[level] = max(asked[level], samples)
        if asked == list(have):  # the plan sees no need: the t quantile is wider than it thinks
            slopes = [link.slope for link in one.mean.links]
            adds = [
                math.prod(slopes[k + 1 :]) ** 2 * link.of_mean / (link.samples * one.costs[link.level])
                for k, link in enumerate(one.mean.links)
            ]
            level = one.mean.links[int(np.argmax(adds))].level
            asked[level] = math.ceil(MORE * have[level])
        wanted = [max(pair) for pair in zip(wanted, asked, strict=True)]
    wanted = [_approached(n, before) for n, before in zip(wanted, have, strict=True)]
    used = sorted({level for one in standings for level in one.plan.levels}, reverse=True)
    for finer, coarser in itertools.pairwise(used):  # every seed of a level is one of the coarser ones that are used
        wanted[coarser] = max(wanted[coarser], wanted[finer])
    return dict(zip(levels, wanted, strict=True))


def _approached(wanted: int, have: int) -> int:
    """Return the samples after the next round: part of the way while the variance is not known well."""
    if have < KNOWN and wanted > MORE * have:
        wanted = have + math.ceil(PART * (wanted - have))
    return min(wanted, GROWTH * max(have, 1))


def sampled(targets: Sequence[Target], case: Case, arrays: Arrays) -> Sample:
    """Return what a finished case adds.

    Raises
    ------
    StudyError
        If its sweep does not reach a state.
    """
    series = {
        name: np.concatenate([[0.0], arrays[name][1].reshape(-1)])
        for name in ("indentation", "separation", "contact_area_fraction", "mean_pressure", "free_volume")
    }
    touch = series["indentation"][1] + series["separation"][1]  # d/σ at first touch, and V* as well
    series["separation"][0] = series["free_volume"][0] = touch
    values, between, solver = (np.zeros(len(targets)) for _ in range(3))
    residual = float(np.max(arrays["residual"][1]))
    for number, target in enumerate(targets):
        quantity, state = series[target.stored], target.state
        if state.value is None:
            values[number] = quantity[-1]
        else:
            along = series[STORED_AS.get(state.kind, state.kind)]
            values[number] = at_state(along, quantity, state.value)[0]
            between[number] = np.nan_to_num(error_between_steps(along, quantity, state.value)[0])
            if not math.isfinite(values[number]):
                raise _unreached(state, case, float(along[-1]))
        if target.quantity == "free_volume":
            solver[number] = residual
        elif target.quantity == "pressure" and "mean_pressure_bound" in arrays:
            bound = arrays["mean_pressure_bound"][1].reshape(-1) * series["mean_pressure"][1:]
            solver[number] = float(np.nanmax(bound))
    return Sample(values, between, solver, cost_of(case, arrays))


def cost_of(case: Case, arrays: Arrays) -> float:
    """Return the modelled seconds of a finished case, from its stored counts."""
    assert case.m is not None
    units = float(np.nansum(arrays["convolutions"][1])) + SINGLE * float(np.nansum(arrays["convolutions_fp32"][1]))
    return seconds_of(case.m, case.sweep.steps, units)


def seconds_of(m: int, steps: int, units: float) -> float:
    """Return the modelled seconds of a sweep with so many convolutions."""
    nodes, step = 2**m + 1, STEP_SECONDS + ITERATIVE * (m >= ITERATIVE_FROM)
    return CASE_SECONDS + step * steps + NODE_SECONDS * nodes**2 * math.log(nodes) * units


def _unreached(state: Level, case: Case, last: float) -> StudyError:
    assert state.value is not None
    message = (
        f"{number_text(state.value)} is not reached by {case.label}, whose sweep ends at {state.kind} {last:.4g}: "
        f"sweep further, as to: {{{state.kind}: {number_text(state.value)}}}"
    )
    return StudyError([Problem(message, f"ensemble.at.{state.kind}")])


@dataclass
class Answer:
    """The answer of an ensemble, with how it was reached.

    ``rounds`` holds, for each D, the modelled cost after each round and the half-width of every target then.
    """

    ensembles: Ensembles
    standings: dict[float, list[Standing]]
    rounds: dict[float, list[tuple[float, tuple[float, ...]]]]
    stopped: str = ""


def answer(
    study: Study,
    compute: Compute,
    *,
    planned: Callable[[Counts], None] = lambda counts: None,
    on_round: Callable[[dict[float, list[Standing]]], None] = lambda standings: None,
    clock: Callable[[], float] = time.monotonic,
) -> Answer:
    """Compute samples round by round until every mean is as accurate as asked.

    Parameters
    ----------
    study : Study
        With a section ``ensemble``.
    compute : callable
        Takes cases; returns the arrays of each by its id.
    planned : callable
        Told of the samples wanted before each round.
    on_round : callable
        Told of what is known after each round.
    clock : callable
        Seconds, for the budget.

    Raises
    ------
    StudyError
        If a sweep does not reach a state, or `m: auto` meets a quantity without a limit.
    CampaignError
        If the accuracy is out of reach.
    """
    assert study.ensemble is not None
    assert isinstance(study.surface, MadeSurface)
    finest = study.surface.m
    state = Ensembles(study, finest[0] if finest else AUTO_FROM)
    began, budget = clock(), study.ensemble.budget
    counts: Counts = {D: pilot(state.levels) for D in state.dimensions}
    rounds: dict[float, list[tuple[float, tuple[float, ...]]]] = {D: [] for D in state.dimensions}
    stopped = ""
    for _ in range(ROUNDS):
        _complete(state, counts, compute, planned)
        standings = {D: state.standings(D) for D in state.dimensions}
        for D, each in standings.items():
            rounds[D].append((state.cost(D), tuple(one.mean.half_width for one in each)))
        on_round(standings)
        if not finest:
            _refuse_without_limit(standings)
        if all(one.holds for each in standings.values() for one in each):
            if finest or not _biased(standings) or state.m == AUTO_TO:
                return Answer(state, standings, rounds)
            state.m += 1
            counts = {D: pilot(state.levels) | counts[D] for D in state.dimensions}
            continue
        if stopped:
            return Answer(state, standings, rounds, stopped)
        if budget is None:
            _refuse_too_many(standings)
        new = {D: next_counts(each, state.levels, state.have(D)) for D, each in standings.items()}
        if budget is not None:
            new, stopped = _within(budget, clock() - began, counts, new, state, standings)
            if new == counts:
                return Answer(state, standings, rounds, stopped)
        counts = new
    message = f"the accuracy was not reached in {ROUNDS} rounds"
    raise CampaignError(message)


def _complete(state: Ensembles, counts: Counts, compute: Compute, planned: Callable[[Counts], None]) -> None:
    """Compute the samples that a plan has and the ensemble has not."""
    assert state.study.ensemble is not None
    first = state.study.ensemble.first_seed
    planned(counts)
    wanted = []
    for D, samples in counts.items():
        for m, n in samples.items():
            there = len(state.samples.get((D, m), ()))
            wanted += [state.study.sample(D, m, first + seed) for seed in range(there, n)]
    if wanted:
        found = compute(wanted)
        with state.study.placing():
            for case in wanted:
                state.add(case, found[case.id])


def _within(
    budget: float,
    spent: float,
    counts: Counts,
    new: Counts,
    state: Ensembles,
    standings: Mapping[float, Sequence[Standing]],
) -> tuple[Counts, str]:
    """Return a plan that fits what is left of a budget, and the sentence that it is the last, if it is."""

    def modelled(one: Counts) -> float:
        return sum(
            n * cost
            for D, samples in one.items()
            for n, cost in zip(samples.values(), standings[D][0].costs, strict=True)
        )

    done = modelled(counts)
    rate = spent / done if done > 0.0 else 1.0  # seconds of the clock for one of the model
    needed, left = rate * (modelled(new) - done), budget - spent
    if needed <= left:
        return new, ""
    sentence = f"stopped by the budget of {budget} after the accuracy was not yet reached"
    share = max(left, 0.0) / needed
    return {
        D: {m: counts[D][m] + int(share * (n - counts[D][m])) for m, n in samples.items()} for D, samples in new.items()
    }, sentence


def _biased(standings: Mapping[float, Sequence[Standing]]) -> bool:
    return any(one.weak.bias > BIAS_SHARE * one.wanted for each in standings.values() for one in each)


def _refuse_too_many(standings: Mapping[float, Sequence[Standing]]) -> None:
    """Refuse an accuracy that no machine reaches, as soon as the pilot shows it."""
    most, D, one = max(
        ((sum(one.plan.samples), D, one) for D, each in standings.items() for one in each if not one.holds),
        key=lambda each: each[0],
    )
    if most > MOST_CASES:
        message = (
            f"{one.target.quantity} at {one.target.state.label}, D = {D:g}: ± {one.target.accuracy} needs more than "
            f"{MOST_CASES} samples; its mean is about {one.mean.value:.3g}: ask for less, or set a budget"
        )
        raise CampaignError(message)


def _refuse_without_limit(standings: Mapping[float, Sequence[Standing]]) -> None:
    """Refuse `m: auto` for a mean that has no limit in m."""
    lost = [(D, one) for D, each in standings.items() for one in each if not one.weak.converges]
    if lost:
        lines = "; ".join(
            f"{one.target.quantity} at {one.target.state.label}, D = {D:g}: its last levels change it by "
            f"{', '.join(f'{100.0 * (b / a - 1.0):+.1f} %' for a, b in itertools.pairwise(one.level_means[-4:]))}"
            for D, one in lost[:3]
        )
        message = f"'auto' needs means that converge with m, and these do not ({lines}): give a number"
        raise StudyError([Problem(message, "surface.m")])
