"""The expected samples and cost of an ensemble before it runs, and the cost of plain Monte Carlo.

The variances are of sweeps to the mean plane at p* = 0.3 (16 to 400 seeds, m = 4 … 9), interpolated in D. At other
states they differ by a factor of two, and so does the cost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from roughvol.campaign import cost, samples
from roughvol.campaign.sampling import PILOT, pilot
from roughvol.observables import allocation
from roughvol.observables.multilevel import Link
from roughvol.study import CLOSING, MadeSurface, Study, levels_below
from roughvol.study.ensemble import AUTO_FROM, RECORDED_BY


@dataclass(frozen=True)
class Scatter:
    """The scatter of a quantity over surfaces, at each of `MEASURED_D`.

    Attributes
    ----------
    spread : tuple of float
        Standard deviation over the mean.
    residual : tuple of float
        Residual variance of m = 5 about its regression on m = 4, over the variance.
    decay : tuple of float
        Number of halvings of the residual variance from level to level.
    """

    spread: tuple[float, ...]
    residual: tuple[float, ...]
    decay: tuple[float, ...]

    def at(self, D: float) -> tuple[float, float, float]:
        """Return spread, residual and decay at one D."""
        rows = (self.spread, self.residual, self.decay)
        spread, residual, decay = (float(np.interp(D, MEASURED_D, row)) for row in rows)
        return spread, residual, decay


MEASURED_D = (2.2, 2.5, 2.8)  # D of all values of `Scatter`
OF_VOLUME = Scatter((0.167, 0.124, 0.075), (0.05, 0.13, 0.37), (2.2, 2.1, 1.5))  # V* at given p*
OF_AREA = Scatter((0.315, 0.21, 0.107), (0.29, 0.50, 0.90), (1.7, 1.4, 0.8))  # A* at given p*
SCATTER = {
    "free_volume": OF_VOLUME,
    "separation": OF_VOLUME,
    "indentation": OF_VOLUME,
    "contact_area": OF_AREA,
    "pressure": OF_AREA,
} | dict.fromkeys(RECORDED_BY, OF_AREA)
"""The measured scatter that each quantity is assumed to have; those of the void have that of A*."""
MEANS = {"free_volume": 1.5, "separation": 1.0, "indentation": 2.0, "contact_area": 0.01, "pressure": 0.5}
MEANS |= {"transmissivity": 0.1, "log_leak_rate": -1.0, "connected_volume_fraction": 1.0}
MEANS |= dict.fromkeys(CLOSING, 10.0)
"""Typical means, for absolute accuracies."""
LARGEST_RESIDUAL = 0.9  # largest residual variance over the variance
FREEDOM = 99.0  # degrees of freedom of the assumed variances


@dataclass(frozen=True)
class Expected:
    """The expected ensemble of one D.

    Attributes
    ----------
    D : float
        Fractal dimension.
    samples : dict
        Number of samples by m.
    seconds : float
        Modelled seconds of one core.
    plain : float
        Modelled seconds of plain Monte Carlo.
    """

    D: float
    samples: dict[int, int]
    seconds: float
    plain: float


def expected(study: Study) -> list[Expected]:
    """Return the expected samples and costs of an ensemble; with ``m: auto``, of its first resolution.

    Parameters
    ----------
    study : Study
        With generated surfaces.

    Returns
    -------
    list of Expected
        One for each D.
    """
    surface = study.surface
    assert isinstance(surface, MadeSurface)
    levels = levels_below(surface.m[0] if surface.m else AUTO_FROM)
    costs = [_seconds(study, m) for m in levels]
    return [_of_dimension(study, D, levels, costs) for D in surface.dimensions]


def _of_dimension(study: Study, D: float, levels: tuple[int, ...], costs: list[float]) -> Expected:
    first = list(pilot(levels).values())
    counts, plain = list(first), costs[-1]
    for target in samples.targets_of(study.ensemble) if study.ensemble else ():
        spread, residual, decay = SCATTER[target.quantity].at(D)
        half_width = float(target.accuracy) / spread  # of a quantity with variance 1
        if not target.accuracy.relative:
            half_width /= abs(MEANS[target.quantity])
        plan = allocation.plan(_links(levels, residual, decay), costs, first, half_width)
        for level, number in zip(plan.levels, plan.samples, strict=True):
            counts[level] = max(counts[level], number)
        plain = max(plain, allocation.plain_cost(1.0, costs[-1], half_width))
    seconds = sum(number * cost for number, cost in zip(counts, costs, strict=True))
    return Expected(D, dict(zip(levels, counts, strict=True)), seconds, plain)


def _links(levels: tuple[int, ...], residual: float, decay: float) -> dict[tuple[int, int], Link]:
    """Return links between adjacent levels, of a quantity with variance 1 on each level."""
    links = {(level, -1): Link(level, -1, PILOT, 0.0, 1.0, FREEDOM) for level in range(len(levels))}
    for level, m in list(enumerate(levels))[1:]:
        share = min(residual * 2.0 ** (-decay * (m - 5)), LARGEST_RESIDUAL)
        links[level, level - 1] = Link(level, level - 1, PILOT, math.sqrt(1.0 - share), share, FREEDOM)
    return links


def _seconds(study: Study, m: int) -> float:
    """Return the modelled seconds of a sample: the first convolution of a step is in double precision."""
    assert isinstance(study.surface, MadeSurface)
    nodes, case = 2**m + 1, study.sample(study.surface.dimensions[0], m, 0)
    convolutions = cost.convolutions_per_step((nodes, nodes), case.solver.tolerance)
    units = 1.0 + samples.SINGLE * (convolutions - 1.0)
    return samples.seconds_of(case, units * case.sweep.steps)
