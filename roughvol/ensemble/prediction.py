"""The expected samples and cost of an ensemble before it runs, and the cost of plain Monte Carlo.

`SEEDS` surfaces of each level up to `FINEST` give the scatter of each quantity at its states, the share of it that a
coarser level and surfaces without a solve explain, and the cost of a sample. On finer levels the variance is that of
the last level, and the cost follows the cost model. The residual variance decreases by a factor 2^κ from level to
level. κ is the mean of the measured one and of 2 (3 - D) + 0.4: the added heights have the variance 2^(-2 (3 - D)) of
those before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from roughvol.ensemble import allocation, cost, multilevel
from roughvol.ensemble.design import pilot
from roughvol.ensemble.estimate import STOPPING
from roughvol.ensemble.multilevel import Link
from roughvol.ensemble.samples import Request, SampleTable
from roughvol.ensemble.targets import SMALLEST, Arrays
from roughvol.study import MadeSurface, Study, levels_below
from roughvol.study.sections.surface import first_finest
from roughvol.typing import Array

FINEST = 6  # finest level solved
SEEDS = 32  # surfaces of each level
SURFACES = 400  # surfaces without a solve
EXCESS = 0.4  # decay of residual variances beyond that of the added heights, in halvings
SLOWEST, FASTEST = 0.3, 2.5  # of the measured decay, which has an error of half a halving
FREEDOM = 99.0  # degrees of freedom of the expected variances

Links = dict[tuple[int, int], Link]


@dataclass(frozen=True)
class Expected:
    """The expected ensemble of one D; seconds are modelled, of one core."""

    D: float
    samples: dict[int, int]  # by m
    surfaces: int  # without a solve
    seconds: float
    plain: float  # seconds of plain Monte Carlo
    steps: int


class Prediction:
    """The expected ensemble of a study, from the cases that it names: samples, surfaces alone, and cases for costs."""

    def __init__(self, study: Study) -> None:
        assert isinstance(study.surface, MadeSurface)
        self._levels = levels_below(first_finest(study.surface))
        self._table = SampleTable(study, min(self._levels[-1], max(FINEST, self._levels[0])))
        dimensions, counts = self._table.dimensions, dict.fromkeys(self._table.levels, SEEDS)
        surfaces = [case for D in dimensions for case in self._table.missing_surfaces(D, SURFACES)]
        self.request = Request(self._table.missing(dict.fromkeys(dimensions, counts)), surfaces)

    def expected(self, arrays: Mapping[str, Arrays], numbers: Sequence[tuple[float, ...]]) -> list[Expected]:
        """Return the expected samples and costs by D; with ``m: auto`` or ``n: auto``, of the first resolution."""
        self._table.add_all(self.request, arrays, numbers)
        return [self._of_dimension(D) for D in self._table.dimensions]

    def _of_dimension(self, D: float) -> Expected:
        table, levels = self._table, self._levels
        alone, first, solved = table.alone(D), list(pilot(levels).values()), len(table.levels)
        costs = table.costs(D)
        modelled = [cost.expected_seconds(table.study.sample(D, m, 0)) for m in levels]
        costs += [each * costs[-1] / modelled[solved - 1] for each in modelled[solved:]]
        counts, surfaces, plain = list(first), 0, costs[-1]
        for number, target in enumerate(table.targets):
            values = table.values(D, number)
            means = [abs(float(each.mean())) or SMALLEST for each in values]
            relative = target.accuracy.relative  # then each level is measured by its mean
            scaled = [each / mean if relative else each for each, mean in zip(values, means, strict=True)]
            links = _links(scaled, alone, D, first)
            half_width = float(target.accuracy)
            plan = allocation.plan(links, costs, first, half_width, alone)
            few = dict(enumerate(first)) | dict(zip(plan.levels, plan.samples, strict=True))
            plan = allocation.plan(_uncertain(links, few), costs, first, half_width, alone)
            for level, planned in zip(plan.levels, plan.samples, strict=True):
                counts[level] = max(counts[level], planned)
            surfaces = max(surfaces, plan.alone)
            variance = multilevel.level_variance(links, multilevel.nearest_chain(links, solved - 1), alone)
            plain = max(plain, allocation.plain_cost(variance, costs[-1], half_width))
        surfaces = max(surfaces, *counts)
        together = sum(number * each for number, each in zip(counts, costs, strict=True)) + surfaces * cost.SURFACE
        return Expected(D, dict(zip(levels, counts, strict=True)), surfaces, together, plain, table.study.sweep.steps)


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
