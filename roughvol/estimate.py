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

from roughvol.campaign import cores, surface_of
from roughvol.physics.halfspace import HalfSpace
from roughvol.study import Case, Study

TIMED_UP_TO = 1025  # nodes a side; beyond it a convolution is long, and scales as N² log N
STEP_OVERHEAD = 5e-4  # seconds a step, whatever the grid
PER_CONVOLUTION = 1.8  # time of a step over that of its convolutions, on grids where these matter
CASE_OVERHEAD = 0.05  # seconds a case: its file
START = 1.5  # seconds: processes start and import
SEARCH = 20  # solves it takes to find an indentation, each from nothing, so about two steps' worth
PROCESS_BYTES = 1.6e8  # of a process that has only imported what it needs
NODE_BYTES = 500  # of the half space and the solver
FILE_BYTES = 8e4  # of a case without fields


@dataclass(frozen=True)
class Estimate:
    """Cost of a study: numbers of cases and of states to solve, bytes in memory a process and on disk, seconds."""

    cases: int
    steps: int
    jobs: int
    memory: float
    disk: float
    seconds: float


def estimate(study: Study, jobs: int | None = None) -> Estimate:
    """Return the expected cost of computing a whole study in so many processes; all cores if not given."""
    cases = study.cases()
    jobs = min(jobs or cores(), len(cases))
    shapes = [_shape(case) for case in cases]
    seconds = [_seconds(case, shape) for case, shape in zip(cases, shapes, strict=True)]
    nodes = [rows * columns for rows, columns in shapes]
    fields = [_field_count(case) for case in cases]
    return Estimate(
        cases=len(cases),
        steps=sum(case.sweep.steps for case in cases),
        jobs=jobs,
        memory=PROCESS_BYTES + max(n * (NODE_BYTES + 16 * f) for n, f in zip(nodes, fields, strict=True)),
        # each case is stored twice, by itself and in study.nc
        disk=2 * sum(FILE_BYTES + 8 * n * f for n, f in zip(nodes, fields, strict=True)),
        seconds=START + max(sum(seconds) / jobs, max(seconds)),
    )


def _seconds(case: Case, shape: tuple[int, int]) -> float:
    if case.sweep.steps == 0:
        return CASE_OVERHEAD
    steps = case.sweep.steps + (2 * SEARCH if case.sweep.target.kind in ("contact_area", "pressure") else 0)
    convolutions = convolutions_per_step(shape, case.solver.tolerance)
    return CASE_OVERHEAD + steps * (
        STEP_OVERHEAD + PER_CONVOLUTION * convolutions * _convolution(shape, case.solver.kernel)
    )


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


def _field_count(case: Case) -> int:
    return case.record.heights + (2 * len(case.record.fields_at.levels) if case.record.fields_at else 0)


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
