"""The expected samples and cost of an ensemble before it runs, and the cost of plain Monte Carlo.

`SEEDS` surfaces of each level up to `FINEST` are solved in memory. They give the scatter of each quantity at its
states, what a coarser level and surfaces without a solve explain of it, and the cost of a sample. On finer levels the
variance is that of the last level. The residual variance decreases by a factor 2^κ from level to level. κ is the mean
of the measured one and of 2 (3 - D) + 0.4: the added heights have the variance 2^(-2 (3 - D)) of those before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from roughvol.campaign import cost, samples, steps
from roughvol.campaign.estimates import STOPPING
from roughvol.campaign.one_case import HalfSpaces, arrays_of_case
from roughvol.campaign.sampling import pilot
from roughvol.observables import allocation, multilevel
from roughvol.observables.multilevel import Link
from roughvol.study import MadeSurface, Record, Study, levels_below
from roughvol.study.sections.spectral import first_finest
from roughvol.typing import Array

FINEST = 6  # finest level solved
COSTED = 8  # finest level of which one surface is solved for its cost
SEEDS = 32  # surfaces of each level
SURFACES = 400  # surfaces without a solve
EXCESS = 0.4  # decay of residual variances beyond that of the added heights, in halvings
SLOWEST, FASTEST = 0.3, 2.5  # of the measured decay, which has an error of half a halving
FREEDOM = 99.0  # degrees of freedom of the expected variances

Links = dict[tuple[int, int], Link]


@dataclass(frozen=True)
class Expected:
    """The expected ensemble of one D.

    Attributes
    ----------
    D : float
        Fractal dimension.
    samples : dict
        Number of samples by m.
    surfaces : int
        Surfaces without a solve.
    seconds : float
        Modelled seconds of one core.
    plain : float
        Modelled seconds of plain Monte Carlo.
    steps : int
        Steps of a sweep.
    """

    D: float
    samples: dict[int, int]
    surfaces: int
    seconds: float
    plain: float
    steps: int


def expected(study: Study) -> list[Expected]:
    """Return the expected samples and costs of an ensemble; with ``m: auto`` or ``n: auto``, of its first resolution.

    Parameters
    ----------
    study : Study
        With generated surfaces and a section ``ensemble``.

    Returns
    -------
    list of Expected
        One for each D.

    Raises
    ------
    StudyError
        If the sweep of a surface ends before a state, or a quantity has no value there.
    """
    surface = study.surface
    assert isinstance(surface, MadeSurface)
    levels = levels_below(first_finest(surface))
    found = steps.measured(study)
    table = samples.SampleTable(study, min(levels[-1], max(FINEST, levels[0])), found.errors)
    return [_of_dimension(table, D, levels) for D in surface.dimensions]


def _of_dimension(table: samples.SampleTable, D: float, levels: tuple[int, ...]) -> Expected:
    _solve(table, D)
    alone, first, solved = table.alone(D), list(pilot(levels).values()), len(table.levels)
    costs = [float(np.mean([sample.cost for sample in of_level])) for of_level in table.of(D)]
    costs += [_cost(table, D, m) for m in levels[solved:] if m <= COSTED]
    scale = costs[-1] / _seconds(table.study, levels[len(costs) - 1])
    costs += [scale * _seconds(table.study, m) for m in levels[len(costs) :]]
    counts, surfaces, plain = list(first), 0, costs[-1]
    for number, target in enumerate(table.targets):
        values = [np.array([sample.values[number] for sample in of_level]) for of_level in table.of(D)]
        means = [abs(float(each.mean())) or samples.SMALLEST for each in values]
        relative = target.accuracy.relative  # then each level is measured by its mean
        scaled = [each / mean if relative else each for each, mean in zip(values, means, strict=True)]
        links = _links(scaled, alone.values, D, first)
        half_width = float(target.accuracy)
        plan = allocation.plan(links, costs, first, half_width, alone)
        few = dict(enumerate(first)) | dict(zip(plan.levels, plan.samples, strict=True))
        plan = allocation.plan(_uncertain(links, few), costs, first, half_width, alone)
        for level, planned in zip(plan.levels, plan.samples, strict=True):
            counts[level] = max(counts[level], planned)
        surfaces = max(surfaces, plan.alone)
        variance = multilevel.level_variance(links, multilevel.nearest_chain(links, solved - 1), alone.values)
        plain = max(plain, allocation.plain_cost(variance, costs[-1], half_width))
    surfaces = max(surfaces, *counts)
    seconds = sum(number * cost for number, cost in zip(counts, costs, strict=True))
    seconds += surfaces * samples.SURFACE_SECONDS
    return Expected(D, dict(zip(levels, counts, strict=True)), surfaces, seconds, plain, int(table.study.sweep.steps))


def _solve(table: samples.SampleTable, D: float) -> None:
    """Add surfaces of one D, solved in memory, and surfaces without a solve."""
    half_spaces: HalfSpaces = {}
    table.add_surfaces(D, SURFACES)
    with table.study.placing():
        for case in table.missing({D: dict.fromkeys(table.levels, SEEDS)}):
            table.add(case, arrays_of_case(case, half_spaces))


def _cost(table: samples.SampleTable, D: float, m: int) -> float:
    """Return the modelled seconds of a sample from one surface, pressed without what else the study records."""
    case = table.study.sample(D, m, table.ensemble.first_seed)
    return samples.cost_of(case, arrays_of_case(replace(case, record=Record())))


def _links(values: Sequence[Array], alone: Array, D: float, first: Sequence[int]) -> Links:
    """Return links between adjacent levels, measured up to the last solved level and extrapolated beyond."""
    links = multilevel.links_of(values, alone)
    last = len(values) - 1
    links = {(level, parent): link for (level, parent), link in links.items() if parent in (-1, level - 1)}
    if not last:
        return links
    measured = SLOWEST
    if last > 1 and links[last, last - 1].alone > 0.0 and links[last - 1, last - 2].alone > 0.0:
        measured = math.log2(links[last - 1, last - 2].alone / links[last, last - 1].alone)
    decay = 0.5 * (min(max(measured, SLOWEST), FASTEST) + 2.0 * (3.0 - D) + EXCESS)
    base, link = links[last, -1], links[last, last - 1]
    for level in range(last + 1, len(first)):
        share = 2.0 ** (-decay * (level - last))
        controlled = first[level] >= multilevel.CONTROLLED
        variance, gains = (link.variance, link.gains) if controlled else (link.alone, ())
        parent = level - 1
        links[level, parent] = Link(
            level, parent, first[level], link.slope, share * variance, FREEDOM, gains, share * link.alone
        )
        links[level, -1] = Link(level, -1, first[level], 0.0, base.variance, FREEDOM, base.gains, base.alone)
    return links


def _uncertain(links: Links, numbers: Mapping[int, int]) -> Links:
    """Return links whose variances have what an interval of few samples adds: pooling, stopping, Student's quantile."""
    wider = dict(links)
    for (level, parent), link in links.items():
        freedom = max(numbers[level] - 2.0, 1.0)
        variance = link.variance
        if parent >= 0 and freedom < multilevel.POOLED_BELOW:
            bound = multilevel.RESIDUAL_RATIO * links[parent, parent - 1 if parent else -1].alone
            share = freedom / multilevel.POOLED_BELOW
            variance = max(variance, share * variance + (1.0 - share) * bound)
            freedom = multilevel.POOLED_BELOW
        widening = (multilevel.quantile(freedom) / allocation.NORMAL) ** 2 * (1.0 + STOPPING / freedom)
        wider[level, parent] = replace(link, variance=widening * variance)
    return wider


def _seconds(study: Study, m: int) -> float:
    """Return the modelled seconds of a sample: the first convolution of a step is in double precision."""
    assert isinstance(study.surface, MadeSurface)
    nodes, case = 2**m + 1, study.sample(study.surface.dimensions[0], m, 0)
    convolutions = cost.convolutions_per_step((nodes, nodes), case.solver.tolerance)
    units = 1.0 + samples.SINGLE * (convolutions - 1.0)
    return samples.seconds_of(case, units * case.sweep.steps)
