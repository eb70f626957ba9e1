"""Estimated cost of a study: cases, memory, disk, time.

Time is that of `ensemble.cost`, with a convolution timed on this machine for each grid.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from roughvol.campaign import resources
from roughvol.campaign.one_case import surface_of
from roughvol.campaign.resources import cores
from roughvol.contact.halfspace import HalfSpace
from roughvol.ensemble.cost import expected_seconds, observable_seconds
from roughvol.study import ACCURACY, EXPECTED, Case, Solver, Study

TIMED_UP_TO = 1025  # nodes a side; times of larger grids are scaled as N² log N
START = 1.5  # seconds: processes start and import
LONG = 30 * 86400.0  # seconds of a run that draws a warning
ROUGH = 1e-7  # seconds a state and node at least, to skip the timing of short runs


@dataclass(frozen=True)
class Estimate:
    """Estimated cost of a study."""

    cases: int
    steps: int  # states to solve
    jobs: int  # processes
    memory: float  # bytes of a process
    disk: float  # bytes of all files
    seconds: float
    observables: dict[str, float]  # seconds of one core, all cases together
    notice: str = ""  # if the memory allows fewer processes than asked for


def estimate(study: Study, jobs: int | None = None) -> Estimate:
    """Return the estimated cost of a study.

    Parameters
    ----------
    study : Study
        The study, without regard to finished cases.
    jobs : int, optional
        Number of processes. Default: all cores. The available memory limits it.

    Returns
    -------
    Estimate
        Cases, memory, disk and time.
    """
    return _estimate(study.cases(), jobs)


def check_study_fits(study: Study, folder: Path) -> None:
    """Refuse a study beyond the memory or disk of this machine, see `resources.check_resources`."""
    cases, counts = _alike(study.cases())
    nodes = [math.prod(_shape(case)) for case in cases]
    disk = 2 * sum(count * resources.disk_of(case, n) for case, count, n in zip(cases, counts, nodes, strict=True))
    resources.check_resources(cases, nodes, disk, folder)


def warning(seconds: float, jobs: int) -> str:
    """Return a warning for a run longer than `LONG`, else an empty one."""
    if seconds < LONG:
        return ""
    many = f"{jobs} process" + "es" * (jobs > 1)
    return f"this takes about {seconds / (365.25 * 86400.0):.2g} years ({seconds / 86400.0:.0f} days) in {many}"


def warning_of(cases: Sequence[Case], nodes: Sequence[int], jobs: int) -> str:
    """Return the warning for cases; few or small ones are not timed."""
    rough = ROUGH * sum(case.sweep.steps * n for case, n in zip(cases, nodes, strict=True)) / jobs
    if rough < LONG / 30.0:
        return ""
    return warning(_estimate(cases, jobs).seconds, jobs)


def _alike(cases: Sequence[Case]) -> tuple[list[Case], list[int]]:
    """Return one case of each cost, and the numbers of cases with this cost. D and seed change none."""
    names = [field.name for field in fields(Case) if field.name not in ("D", "seed")]
    groups: dict[tuple[int, ...], list[Case]] = {}
    for case in cases:  # the cases of a study share their objects, and a hash of long lists of levels is slow
        groups.setdefault(tuple(id(getattr(case, name)) for name in names), []).append(case)
    return [alike[0] for alike in groups.values()], [len(alike) for alike in groups.values()]


def _estimate(cases: Sequence[Case], jobs: int | None) -> Estimate:
    jobs = min(jobs or cores(), len(cases))
    each, counts = _alike(cases)
    shapes = [_shape(case) for case in each]
    nodes = [rows * columns for rows, columns in shapes]
    needs = [resources.memory_of(case, n) for case, n in zip(each, nodes, strict=True)]
    several = [need for need, count in zip(needs, counts, strict=True) for _ in range(min(count, jobs))]
    jobs, notice = resources.limited(jobs, several, resources.available_memory())
    seconds = [_seconds(case, shape) for case, shape in zip(each, shapes, strict=True)]
    observables: dict[str, float] = {}
    for case, shape, count in zip(each, shapes, counts, strict=True):
        for name, taken in observable_seconds(case, shape).items():
            observables[name] = observables.get(name, 0.0) + count * taken
    together = sum(count * taken for count, taken in zip(counts, seconds, strict=True))
    return Estimate(
        cases=len(cases),
        steps=sum(case.sweep.steps for case in cases),
        jobs=jobs,
        memory=max(needs),
        # each case is stored in its file and in study.nc
        disk=2 * sum(count * resources.disk_of(case, n) for case, count, n in zip(each, counts, nodes, strict=True)),
        seconds=START + max(together / jobs, max(seconds)),
        observables=observables,
        notice=notice,
    )


@dataclass(frozen=True)
class Choice:
    """One accuracy: name, bound of η/σ, seconds, and expected errors of A*, p* (relative) and V*."""

    name: str
    rtol: float
    seconds: float
    errors: tuple[float, float, float]


def choices(study: Study, jobs: int | None = None) -> list[Choice]:
    """Return time and errors of a study at each named accuracy; an empty list if nothing is solved."""
    if study.sweep.steps == 0 or study.solver.method == "paper":
        return []
    options = []
    for name, rtol in ACCURACY.items():
        solver = {"solver.accuracy": name, "solver.rtol": None, "solver.max_error": None}
        cost = estimate(study.changed(**solver), jobs)
        options.append(Choice(name, rtol, cost.seconds, EXPECTED[name]))
    return options


def _seconds(case: Case, shape: tuple[int, int]) -> float:
    """Return the seconds of a case, with a convolution timed on its grid."""
    timed = case.sweep.steps > 0
    return expected_seconds(case, shape, _convolution(case, shape) if timed else 0.0)


def _convolution(case: Case, shape: tuple[int, int]) -> float:
    return seconds_per_convolution(shape, case.periodic)


def _shape(case: Case) -> tuple[int, int]:
    nodes = case.nodes_per_side
    return _measured_shape(replace(case, solver=Solver())) if nodes is None else (nodes, nodes)


@functools.lru_cache(maxsize=8)
def _measured_shape(case: Case) -> tuple[int, int]:
    """Return the nodes of a surface from files, read once."""
    return surface_of(case).shape


@functools.cache
def seconds_per_convolution(shape: tuple[int, int], periodic: bool = False) -> float:
    """Return the seconds of one convolution, timed on this grid, or scaled from `TIMED_UP_TO`."""
    timed = (min(shape[0], TIMED_UP_TO), min(shape[1], TIMED_UP_TO))
    half_space = HalfSpace(timed, periodic=periodic)
    pressure = np.ones(timed)
    half_space.displacement(pressure)  # plans
    times = []
    for _ in range(5):
        started = time.perf_counter()
        half_space.displacement(pressure)
        times.append(time.perf_counter() - started)
    size, timed_size = math.prod(shape), math.prod(timed)
    return min(times) * size * math.log(size) / (timed_size * math.log(timed_size))
