"""What a study will cost, before it is run: cases, memory, disk, time.

The time goes with the convolutions: one is timed on this machine for each grid, and how many a step takes is read off a
rule fitted to sweeps to the mean plane (m = 5 … 9, D = 2.1 … 2.9, residuals 1e-3 … 1e-9), which scatter about it by a
factor of 1.5 either way.
"""

from __future__ import annotations

import functools
import math
import time
from dataclasses import dataclass

import numpy as np

from roughvol import leakage, resources
from roughvol.physics.halfspace import HalfSpace
from roughvol.pressing import surface_of
from roughvol.resources import cores
from roughvol.study import ACCURACY, EXPECTED, Case, Study

TIMED_UP_TO = 1025  # nodes a side; beyond it a convolution is long, and scales as N² log N
STEP_OVERHEAD = 5e-4  # seconds a step, whatever the grid
PER_CONVOLUTION = 1.8  # time of a step over that of its convolutions, on grids where these matter
CASE_OVERHEAD = 0.05  # seconds a case: its file
START = 1.5  # seconds: processes start and import
SEARCH = 20  # solves it takes to find an indentation, each from nothing, so about two steps' worth
# seconds a state and node, along both axes, timed at m = 7 … 9; that of a flow (a factorisation) grows with the nodes
VOID = {"percolation": 6e-8, "constriction": 5e-7, "estimates": 1e-6, "transmissivity": 7e-6, "diffusivity": 7e-6}
FLOWS, FLOW_POWER, FLOW_NODES = ("transmissivity", "diffusivity", "flux_at"), 0.15, 257**2
FILE_BYTES = 8e4  # of a case without fields


@dataclass(frozen=True)
class Estimate:
    """Cost of a study: numbers of cases and of states to solve, bytes in memory a process and on disk, seconds.

    ``observables`` are the seconds, of all cases together, that each quantity of the void takes out of them.
    """

    cases: int
    steps: int
    jobs: int
    memory: float
    disk: float
    seconds: float
    observables: dict[str, float]


def estimate(study: Study, jobs: int | None = None) -> Estimate:
    """Return the expected cost of computing a whole study in so many processes; all cores if not given."""
    cases = study.cases()
    jobs = min(jobs or cores(), len(cases))
    shapes = [_shape(case) for case in cases]
    seconds = [_seconds(case, shape) for case, shape in zip(cases, shapes, strict=True)]
    observables = {name: 0.0 for case in cases for name in _void_seconds(case, shapes[0])}
    for case, shape in zip(cases, shapes, strict=True):
        for name, taken in _void_seconds(case, shape).items():
            observables[name] += taken
    nodes = [rows * columns for rows, columns in shapes]
    fields = [resources.fields_of(case) for case in cases]
    return Estimate(
        cases=len(cases),
        steps=sum(case.sweep.steps for case in cases),
        jobs=jobs,
        memory=max(resources.memory_of(n, f) for n, f in zip(nodes, fields, strict=True)),
        # each case is stored twice, by itself and in study.nc
        disk=2 * sum(FILE_BYTES + 8 * n * f for n, f in zip(nodes, fields, strict=True)),
        seconds=START + max(sum(seconds) / jobs, max(seconds)),
        observables=observables,
    )


@dataclass(frozen=True)
class Choice:
    """One accuracy for a study: its name, bound on η/σ, seconds, and the errors of A*, p* (relative), V* to expect."""

    name: str
    rtol: float
    seconds: float
    errors: tuple[float, float, float]


def choices(study: Study, jobs: int | None = None) -> list[Choice]:
    """Return what each named accuracy would cost a study and what error it leaves; nothing if nothing is solved."""
    if study.sweep.steps == 0 or study.solver.method == "paper":
        return []
    found = []
    for name, rtol in ACCURACY.items():
        solver = study.solver.model_copy(update={"accuracy": name, "rtol": None, "max_error": None})
        cost = estimate(study.model_copy(update={"solver": solver}), jobs)
        found.append(Choice(name, rtol, cost.seconds, EXPECTED[name]))
    return found


def _seconds(case: Case, shape: tuple[int, int]) -> float:
    if case.sweep.steps == 0:
        return CASE_OVERHEAD
    searched = case.sweep.target.kind in ("contact_area", "pressure") or case.sweep.target.value is None
    searched = searched and not case.sweep.target.kind.endswith("plane")
    steps = case.sweep.steps + (2 * SEARCH if searched else 0)
    convolutions = convolutions_per_step(shape, case.solver.tolerance)
    return (
        CASE_OVERHEAD
        + sum(_void_seconds(case, shape).values())
        + steps * (STEP_OVERHEAD + PER_CONVOLUTION * convolutions * _convolution(shape, case.solver.kernel))
    )


def _void_seconds(case: Case, shape: tuple[int, int]) -> dict[str, float]:
    """Return the seconds each quantity of the void takes in one case, over all the states it is asked for."""
    asked, nodes = case.record.transport, math.prod(shape)
    if asked is None:
        return {}
    if case.record.region is not None:
        (x, y) = case.record.region.x, case.record.region.y
        nodes = math.ceil(nodes * (x[1] - x[0]) * (y[1] - y[0]))
    states = {name: case.sweep.steps if at is None else len(at) for name, at in leakage.levels(asked).items()}
    if asked.flux_at is not None:
        states["flux_at"] = len(asked.flux_at.levels)
    dearer = (nodes / FLOW_NODES) ** FLOW_POWER
    each = {name: VOID.get(name, VOID["transmissivity"]) * (dearer if name in FLOWS else 1.0) for name in states}
    return {name: count * each[name] * nodes for name, count in states.items()}


def convolutions_per_step(shape: tuple[int, int], rtol: float) -> float:
    """Return the convolutions that one step of a sweep is expected to take to reach a residual.

    One verifies; a few hundred elements (m ≤ 5) are solved without any other. Each doubling of the nodes a side adds
    1.25 at a residual of 1e-6, in proportion to the digits asked for.
    """
    doublings = math.log2(math.sqrt((shape[0] - 1) * (shape[1] - 1)))
    return 1.0 + 1.25 * max(doublings - 5.0, 0.0) * -math.log10(rtol) / 6.0


def _shape(case: Case) -> tuple[int, int]:
    if case.m is None:
        return surface_of(case).shape
    return 2**case.m + 1, 2**case.m + 1


@functools.cache
def _convolution(shape: tuple[int, int], kernel: str) -> float:
    """Return the seconds of one convolution, timed on a grid of this shape or on the largest that is quick to time."""
    timed = (min(shape[0], TIMED_UP_TO), min(shape[1], TIMED_UP_TO))
    half_space = HalfSpace(timed, kernel=kernel)
    pressure = np.ones(timed)
    half_space.displacement(pressure)  # plans
    times = []
    for _ in range(5):
        started = time.perf_counter()
        half_space.displacement(pressure)
        times.append(time.perf_counter() - started)
    size, timed_size = math.prod(shape), math.prod(timed)
    return min(times) * size * math.log(size) / (timed_size * math.log(timed_size))
