"""Modelled seconds of a case on one core: the one table of constants, for forecasts and for the plan of an ensemble.

The number of convolutions a step was fitted to sweeps to the mean plane (m = 4 … 9, D = 2.1 … 2.9, three accuracies)
by `python -m tests.bench.cost_rule`. Averaged over D, the error of a time was a factor of 1.3 on each grid in the hour
of the fit, 1.7 in others, 1.8 for a search.
"""

from __future__ import annotations

import math

from roughvol.observables.requests import passes, searched_levels, timed
from roughvol.observables.variables import OBSERVABLES
from roughvol.study import Case, Level

CASE = 0.005  # seconds of a case beside its steps: its file (docs/explanation/notes/store-decision.md)
STEP, ITERATIVE = 2.0e-4, 5.0e-4  # seconds of a step without its convolutions; in addition, of a step that iterates
ITERATIVE_ABOVE = 5.0  # m of the largest grid whose steps take one convolution
NODE = 6.0e-9  # seconds of a convolution over N² log N, for N nodes per side
PER_CONVOLUTION = 1.2  # time of a step over that of its convolutions
SINGLE = 0.6  # seconds of a convolution in single precision over one in double precision
UNITS, UNITS_PER_LEVEL, DIGITS_POWER = 1.40, 0.34, 1.95  # convolutions a step at m = 6 and 1e-6; a level; of digits
SEARCH, LEVEL = 23, 3  # steps that take the time of a search for an indentation; for a level between two steps
FLOW = 4e-3  # seconds of the flows of a state beside those of their nodes
SURFACE_M, SURFACE = 6, 6.0e-4  # m of a surface without a solve, and its seconds


def expected_seconds(case: Case, shape: tuple[int, int], convolution: float | None = None) -> float:
    """Return the expected seconds of a case; a convolution on its grid takes ``NODE n log n`` unless it was timed."""
    if case.sweep.steps == 0:
        return CASE
    if convolution is None:
        nodes = math.prod(shape)
        convolution = NODE * nodes * math.log(nodes) / 2.0
    steps = case.sweep.steps + SEARCH * searches(case) + LEVEL * searched_levels(case)
    step = seconds_per_step(shape, case.solver.tolerance, convolution)
    return CASE + sum(observable_seconds(case, shape).values()) + steps * step


def sample_seconds(case: Case, convolutions: float | None = None) -> float:
    """Return the modelled seconds of a sample from its convolutions in double precision, or from those expected."""
    assert case.m is not None
    nodes, steps = 2**case.m + 1, case.sweep.steps
    if convolutions is None:  # the first of a step is in double precision
        convolutions = (1.0 + SINGLE * (convolutions_per_step((nodes, nodes), case.solver.tolerance) - 1.0)) * steps
    step = STEP + ITERATIVE * (case.m > ITERATIVE_ABOVE)
    swept = step * steps + NODE * nodes**2 * math.log(nodes) * convolutions
    searched = 1.0 + SEARCH * searches(case) / max(steps, 1)
    return CASE + searched * swept + sum(observable_seconds(case, (nodes, nodes)).values())


def seconds_per_step(shape: tuple[int, int], rtol: float, convolution: float) -> float:
    """Return the seconds of one step of a sweep from those of one convolution on its grid."""
    iterative = ITERATIVE if _level(shape) > ITERATIVE_ABOVE else 0.0
    return STEP + iterative + PER_CONVOLUTION * convolutions_per_step(shape, rtol) * convolution


def convolutions_per_step(shape: tuple[int, int], rtol: float) -> float:
    """Return the expected convolutions of one step for a residual η/σ: one verifies, and others iterate."""
    above = _level(shape) - ITERATIVE_ABOVE
    if above <= 0.0:
        return 1.0
    digits = max(-math.log10(rtol), 0.0) / 6.0
    return 1.0 + (UNITS * min(above, 1.0) + UNITS_PER_LEVEL * max(above - 1.0, 0.0)) * digits**DIGITS_POWER


def searches(case: Case) -> int:
    """Return the number of states of the path that are searched for."""
    levels = [level for leg in case.sweep.legs for level in leg.listed or (leg.target,)]
    levels += [Level("pressure") for leg in case.sweep.legs if leg.equal != "indentation" for _ in range(leg.steps)]
    return sum(case.endless or level.searched for level in levels)


def observable_seconds(case: Case, shape: tuple[int, int]) -> dict[str, float]:
    """Return the seconds of each observable of a case, all its states together."""
    seconds = {}
    for name, levels in timed(case.record).items():
        row = OBSERVABLES[name]
        nodes = [math.prod(shape) * share for share in passes(row, case.record)]
        count = case.sweep.steps if levels is None else len(levels)
        seconds[name] = count * sum(row.seconds * n + FLOW * row.flow for n in nodes)
    return seconds


def _level(shape: tuple[int, int]) -> float:
    """Return m of the square grid with as many elements."""
    return math.log2(math.sqrt((shape[0] - 1) * (shape[1] - 1)))
