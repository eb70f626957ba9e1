"""What an ensemble will cost, before it is run: samples on each level, and plain Monte Carlo beside it.

The variances are those of sweeps to the mean plane at p* = 0.3 (D = 2.2, 2.5, 2.8; m = 4 … 9; 16 to 400 seeds). Between
these D they are interpolated. At other states they differ by a factor of two, and so do the costs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from roughvol.campaign import cost, ensemble
from roughvol.campaign.ensemble import SINGLE
from roughvol.observables import allocation
from roughvol.observables.multilevel import Link
from roughvol.study import MadeSurface, Study, levels_below
from roughvol.study.ensemble import AUTO_FROM

MEASURED_D = (2.2, 2.5, 2.8)
# Spread of one surface over the mean; share of the variance at m = 5 that m = 4 leaves; how often that halves by level
LIKE_VOLUME = ((0.167, 0.124, 0.075), (0.05, 0.13, 0.37), (2.2, 2.1, 1.5))
LIKE_AREA = ((0.315, 0.21, 0.107), (0.29, 0.50, 0.90), (1.7, 1.4, 0.8))
SPREADS = {"free_volume": LIKE_VOLUME, "separation": LIKE_VOLUME, "indentation": LIKE_VOLUME}
SPREADS |= {"contact_area": LIKE_AREA, "pressure": LIKE_AREA}
MEANS = {"free_volume": 1.5, "separation": 1.0, "indentation": 2.0, "contact_area": 0.01, "pressure": 0.5}


@dataclass(frozen=True)
class Expected:
    """The ensemble of one D: samples by m, seconds of one core, and those of plain Monte Carlo."""

    D: float
    samples: dict[int, int]
    seconds: float
    plain: float


def expected(study: Study) -> list[Expected]:
    """Return what the ensemble of a study is expected to take; with `m: auto`, on its first resolution."""
    surface = study.surface
    assert isinstance(surface, MadeSurface)
    levels = levels_below(surface.m[0] if surface.m else AUTO_FROM)
    costs = [_seconds(study, m) for m in levels]
    pilot = list(ensemble.pilot(levels).values())
    found = []
    for D in surface.dimensions:
        samples, plain = list(pilot), costs[-1]
        for target in ensemble.targets_of(study.ensemble) if study.ensemble else ():
            share, first, rate = (float(np.interp(D, MEASURED_D, row)) for row in SPREADS[target.quantity])
            links = _links(levels, first, rate)
            half = float(target.accuracy) / share
            if not target.accuracy.relative:
                half /= MEANS[target.quantity]
            plan = allocation.plan(links, costs, pilot, half)
            for level, n in zip(plan.levels, plan.samples, strict=True):
                samples[level] = max(samples[level], n)
            plain = max(plain, allocation.plain_cost(1.0, costs[-1], half))
        total = sum(n * seconds for n, seconds in zip(samples, costs, strict=True))
        found.append(Expected(D, dict(zip(levels, samples, strict=True)), total, plain))
    return found


def _links(levels: tuple[int, ...], first: float, rate: float) -> dict[tuple[int, int], Link]:
    """Return links between adjacent levels, of a quantity that has variance 1 on each."""
    links = {(k, -1): Link(k, -1, ensemble.PILOT, 0.0, 1.0, 99.0) for k in range(len(levels))}
    for k, m in list(enumerate(levels))[1:]:
        share = min(first * 2.0 ** (-rate * (m - 5)), 0.9)
        links[k, k - 1] = Link(k, k - 1, ensemble.PILOT, math.sqrt(1.0 - share), share, 99.0)
    return links


def _seconds(study: Study, m: int) -> float:
    nodes, case = 2**m + 1, study.cases()[0]
    units = cost.convolutions_per_step((nodes, nodes), case.solver.tolerance)
    units = 1.0 + SINGLE * (units - 1.0)
    return ensemble.seconds_of(m, case.sweep.steps, units * case.sweep.steps)
