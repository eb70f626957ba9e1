"""Modelled seconds of a case on one core: the one table of constants, for forecasts and for the plan of an ensemble.

`python -m tests.bench.cost_rule` compares the rule with 320 sweeps of m = 4 … 7. In the hour of its last run 93 % of
them took the expected time to a factor of 1.5, and 99 % to a factor of 2.
"""

from __future__ import annotations

import math

from roughvol.contact import TUNING
from roughvol.observables.requests import passes, searched_levels, timed
from roughvol.observables.variables import OBSERVABLES
from roughvol.study import Case, Level, Scale, Sweep
from roughvol.study.values.units import unit_of

CASE = 0.01  # seconds of a case beside its steps: its file, and its part of study.nc
STEP = 5.5e-4  # seconds of a step beside its convolutions
DENSE = TUNING.dense_up_to  # elements in contact up to which a step takes one convolution
# Further convolutions that take the time of a step: NEAR over the contact area, MOST at most, both at η/σ = 1e-6. The
# steps of a short sweep are long: the area of n steps counts STEPS/n more.
NEAR, MOST, STEPS = 70.0, 150.0, 12.0
YIELDING = 2.3  # time of a step of a surface that yields, over that of an elastic one
SETTLED = 60  # steps of the sweep whose steps are the unit of a search
SEARCH, CLOSING, LEVEL = 18.0, 30.0, 8.0  # steps of a search from first touch, for closed ways, from a state before
BEYOND = 18.0  # steps of a search for the closing load of a way that is open at the end of the sweep
PERIODIC = 2.0  # of these steps on a period: its convolutions are short, and the rest of a solve is not
# AREA is A* on the mean plane at m = 4; the next m has AREA_POWER of it. A* grows with p*, PRESSURE on the mean plane,
# and with the way beyond the plane, over σ; before the plane LEAST of it is left. CLOSED is A* where ways close.
AREA, AREA_POWER, PRESSURE, LEAST, CLOSED = 0.14, 0.8, 0.85, 0.1, 0.42
TOUCH, SUMMITS = 3.0, 0.5  # d/σ of first touch and of the summit plane
VOLUME = 1.5  # A* falls as exp(-VOLUME V*)
# Of a sample, from its counted convolutions: the plan of an ensemble follows from them alone, on any machine.
SAMPLE, SAMPLE_STEP, ITERATIVE, ITERATIVE_ABOVE = 0.005, 2.0e-4, 5.0e-4, 5.0
SAMPLE_SEARCH = 23
NODE, CALL = 6.0e-9, 3.0e-5  # seconds of a convolution over N² log N, for N nodes per side; beside its nodes
SINGLE = 0.6  # seconds of a convolution in single precision over one in double precision
FLOW = 4e-3  # seconds of the flows of a state beside those of their nodes
SURFACE_M, SURFACE = 6, 6.0e-4  # m of a surface without a solve, and its seconds


def expected_seconds(case: Case, convolution: float | None = None) -> float:
    """Return the expected seconds of a case; a convolution on its grid is modelled unless it was timed."""
    if case.sweep.steps == 0:
        return CASE
    shape = case.shape
    if convolution is None:
        nodes = math.prod(shape)
        convolution = CALL + NODE * nodes * math.log(nodes) / 2.0
    tolerance = case.solver.tolerance
    seconds, largest, longer = 0.0, 0.0, PERIODIC if case.sides == "periodic" else 1.0
    for number, leg in enumerate(case.sweep.legs):
        largest = max(largest, expected_area(leg.target, case))
        seconds += leg.steps * seconds_per_step(shape, tolerance, convolution, largest, leg.steps)
        searched = LEVEL * searches(leg, case)
        if number == 0 and searched > 0:
            searched += (longer * CLOSING if leg.target.kind.startswith("percolation") else SEARCH) - LEVEL
        seconds += searched * seconds_per_step(shape, tolerance, convolution, largest, SETTLED)
    closed = expected_area(case.sweep.legs[0].target, case) >= CLOSED
    for level in searched_levels(case):
        area, searched = expected_area(level, case), LEVEL
        if level.kind == "percolation":
            searched = longer * (LEVEL if closed else BEYOND)
        seconds += searched * seconds_per_step(shape, tolerance, convolution, area, SETTLED)
    seconds *= YIELDING if case.plastic else 1.0
    return CASE + sum(observable_seconds(case).values()) + seconds


def sample_seconds(case: Case, convolutions: float) -> float:
    """Return the modelled seconds of a sample from its convolutions, counted in double precision."""
    assert case.m is not None
    nodes, steps = case.shape[0], case.sweep.steps
    step = SAMPLE_STEP + ITERATIVE * (case.m > ITERATIVE_ABOVE)
    swept = step * steps + NODE * nodes**2 * math.log(nodes) * convolutions
    searched = 1.0 + SAMPLE_SEARCH * sum(searches(leg, case) for leg in case.sweep.legs) / max(steps, 1)
    return SAMPLE + searched * swept + sum(observable_seconds(case).values())


def seconds_per_step(shape: tuple[int, int], rtol: float, convolution: float, area: float, steps: int) -> float:
    """Return the seconds of one of the steps of a sweep to a contact area, from those of a convolution on its grid."""
    return STEP + convolution * convolutions_per_step(shape, rtol, area, steps)


def convolutions_per_step(shape: tuple[int, int], rtol: float, area: float, steps: int) -> float:
    """Return the convolutions that take the time of one step, for a residual η/σ: one verifies, and others iterate."""
    reach = area * (1.0 + STEPS / max(steps, 1))
    iterated = max(reach - DENSE / math.prod(shape), 0.0)
    digits = max(-math.log10(rtol), 0.0) / 6.0
    return 1.0 + digits * NEAR * iterated / (1.0 + NEAR * reach / MOST)


def expected_area(level: Level, case: Case) -> float:
    """Return the contact area fraction to expect at the end of a leg; of an unknown scale that of a light load."""
    kind, value = level.kind, level.value or 0.0
    if kind.startswith(("percolation", "leak_rate")):
        return CLOSED
    if unit_of(level.value) is not None:
        if case.height is None:
            kind, value = "pressure", PRESSURE
        else:
            scale = Scale(case.E_star, case.L, case.height, case.L**2, case.modulus_unit, case.length_unit)
            kind, value = scale.starred(kind, value)
    if kind == "contact_area":
        return value
    planes = {"summit-plane": SUMMITS, "separation": value, "free_volume": value, "indentation": TOUCH - value}
    plane = planes.get(kind, 0.0)
    if kind == "free_volume" or (case.endless and kind != "pressure"):
        return math.exp(-VOLUME * max(plane, 0.0))
    flat = AREA * AREA_POWER ** (_level(case.shape) - 4.0)
    return min(flat * (value / PRESSURE if kind == "pressure" else max(1.0 - plane, LEAST)), 1.0)


def searches(leg: Sweep, case: Case) -> int:
    """Return the number of states of a leg that are searched for."""
    levels = list(leg.goals)
    levels += [Level("pressure")] * (leg.steps if leg.equal != "indentation" else 0)
    return sum(case.endless or level.searched(endless=False) for level in levels)


def observable_seconds(case: Case) -> dict[str, float]:
    """Return the seconds of each observable of a case, all its states together."""
    seconds = {}
    for name, levels in timed(case.record).items():
        row = OBSERVABLES[name]
        nodes = [math.prod(case.shape) * share for share in passes(row, case.record)]
        count = case.sweep.steps if levels is None else len(levels)
        seconds[name] = count * sum(row.seconds * n + FLOW * row.flow * row.parts for n in nodes)
    return seconds


def _level(shape: tuple[int, int]) -> float:
    """Return m of the square grid with as many elements."""
    return math.log2(math.sqrt((shape[0] - 1) * (shape[1] - 1)))
