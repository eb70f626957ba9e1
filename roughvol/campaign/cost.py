"""What a study will cost, before it is run: cases, memory, disk, time.

The time goes with the convolutions: one is timed on this machine for each grid, and how many a step takes is read off a
rule fitted by `python -m tests.bench.cost_rule` to sweeps to the mean plane (m = 4 … 9, D = 2.1 … 2.9, the three named
accuracies). Averaged over D it is right to a factor of 1.3 on each of these grids in the hour of the fit, and of 1.7 in
others, when Python and memory run at another speed; a search to a factor of 1.8.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from roughvol.campaign import resources
from roughvol.campaign.one_case import surface_of
from roughvol.campaign.resources import cores
from roughvol.contact.halfspace import HalfSpace
from roughvol.observables import regions, void
from roughvol.observables.reduction import searched_levels
from roughvol.study import ACCURACY, EXPECTED, Case, Solver, Study

TIMED_UP_TO = 1025  # nodes a side; beyond it a convolution is long, and scales as N² log N
# seconds a step, whatever the grid, and more where the iteration is used
STEP, ITERATIVE = 1.7e-4, 3.5e-4
PER_CONVOLUTION = 1.2  # time of a step over that of its convolutions, on grids where these matter
# convolutions a step beyond the one that verifies: at m = 6 and 1e-6, for each level more, and with the digits
UNITS, UNITS_PER_LEVEL, DIGITS_POWER = 1.40, 0.34, 1.95
CASE_OVERHEAD = 0.05  # seconds a case: its file
START = 1.5  # seconds: processes start and import
SEARCH = 23  # steps of a sweep that the search for an indentation is worth
LEVEL = 3  # the same of the search for an area or a pressure between two steps
# seconds a state and node, along both axes, timed at m = 7 … 9; that of a flow (a factorisation) grows with the nodes
PER_NODE = {"percolation": 6e-8, "constriction": 5e-7, "estimates": 1e-6, "transmissivity": 7e-6, "diffusivity": 7e-6}
PER_NODE |= {"flux_at": 7e-6, "fields_at": 1e-9, "volume_density": 1.2e-8, "box_counting": 2e-9, "region_widths": 3e-9}
PER_NODE |= {"region_transmissivity": 7e-6}  # of a width, over the nodes inside; box counting of a threshold
FLOWS, FLOW_POWER = ("transmissivity", "diffusivity", "flux_at", "region_transmissivity"), 0.15
FLOW_NODES = 257**2
LONG = 30 * 86400.0  # seconds from which on a run is warned of
ROUGH = 1e-7  # seconds a state and node at the least: enough to see without a timing that a run is not long


@dataclass(frozen=True)
class Estimate:
    """Cost of a study: numbers of cases and of states to solve, bytes in memory a process and on disk, seconds.

    ``observables`` are the seconds, of all cases together, that each thing the study records takes out of them.
    ``notice`` is a sentence where the memory allows fewer processes than asked for.
    """

    cases: int
    steps: int
    jobs: int
    memory: float
    disk: float
    seconds: float
    observables: dict[str, float]
    notice: str = ""


def estimate(study: Study, jobs: int | None = None) -> Estimate:
    """Return the expected cost of computing a whole study in so many processes; all cores if not given.

    There are never more processes than the memory available now allows.
    """
    return _estimate(study.cases(), jobs)


def check_fits(study: Study, place: Path) -> None:
    """Refuse a study that this machine cannot hold; see `resources.check_fits`."""
    cases = study.cases()
    nodes = [math.prod(_shape(case)) for case in cases]
    disk = 2 * sum(resources.disk_of(case, n) for case, n in zip(cases, nodes, strict=True))
    resources.check_fits(cases, nodes, disk, place)


def warning(seconds: float, jobs: int) -> str:
    """Return a warning where a run would take longer than `LONG`; empty where it does not."""
    if seconds < LONG:
        return ""
    many = f"{jobs} process" + "es" * (jobs > 1)
    return f"this takes about {seconds / (365.25 * 86400.0):.2g} years ({seconds / 86400.0:.0f} days) in {many}"


def warning_of(cases: Sequence[Case], nodes: Sequence[int], jobs: int) -> str:
    """Return the warning of some cases; nothing is timed where they are few or small."""
    rough = ROUGH * sum(case.sweep.steps * n for case, n in zip(cases, nodes, strict=True)) / jobs
    if rough < LONG / 30.0:
        return ""
    return warning(_estimate(cases, jobs).seconds, jobs)


def _estimate(cases: Sequence[Case], jobs: int | None) -> Estimate:
    jobs = min(jobs or cores(), len(cases))
    shapes = [_shape(case) for case in cases]
    nodes = [rows * columns for rows, columns in shapes]
    needs = [resources.memory_of(case, n) for case, n in zip(cases, nodes, strict=True)]
    jobs, notice = resources.limited(jobs, needs, resources.available_memory())
    seconds = [_seconds(case, shape) for case, shape in zip(cases, shapes, strict=True)]
    observables = {name: 0.0 for case in cases for name in _observable_seconds(case, shapes[0])}
    for case, shape in zip(cases, shapes, strict=True):
        for name, taken in _observable_seconds(case, shape).items():
            observables[name] += taken
    return Estimate(
        cases=len(cases),
        steps=sum(case.sweep.steps for case in cases),
        jobs=jobs,
        memory=max(needs),
        # each case is stored twice, by itself and in study.nc
        disk=2 * sum(resources.disk_of(case, n) for case, n in zip(cases, nodes, strict=True)),
        seconds=START + max(sum(seconds) / jobs, max(seconds)),
        observables=observables,
        notice=notice,
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
    steps = case.sweep.steps + (SEARCH if searched else 0) + LEVEL * searched_levels(case)
    step = seconds_per_step(shape, case.solver.tolerance, seconds_per_convolution(shape, case.solver.kernel))
    return CASE_OVERHEAD + sum(_observable_seconds(case, shape).values()) + steps * step


def _observable_seconds(case: Case, shape: tuple[int, int]) -> dict[str, float]:
    """Return the seconds each thing that is recorded takes in one case, over all the states it is asked for."""
    record, steps, nodes = case.record, case.sweep.steps, math.prod(shape)
    inside = nodes
    if record.region is not None:
        (x, y) = record.region.x, record.region.y
        inside = math.ceil(nodes * (x[1] - x[0]) * (y[1] - y[0]))
    asked = dict(void.levels(record.transport)) if record.transport else {}
    asked |= regions.levels(record.region_widths) if record.region_widths else {}
    states = {name: steps if at is None else len(at) for name, at in asked.items()}
    selected = {
        "flux_at": record.transport.flux_at if record.transport else None,
        "fields_at": record.fields_at,
        "volume_density": record.volume_density.at if record.volume_density else None,
        "box_counting": record.box_counting.at if record.box_counting else None,
    }
    states |= {name: len(select.levels) for name, select in selected.items() if select is not None}
    parts = {name: [float(inside)] for name in states}  # the nodes of each of its parts, for every state
    if record.box_counting is not None:
        parts["box_counting"] = [float(inside)] * len(record.box_counting.thresholds)
    if record.region_widths is not None:
        shares = record.region_widths.shares
        parts |= {name: [nodes * share**2 for share in shares] for name in regions.QUANTITIES}
    return {
        name: count
        * PER_NODE[name]
        * sum(n * (n / FLOW_NODES) ** (FLOW_POWER if name in FLOWS else 0.0) for n in parts[name])
        for name, count in states.items()
    }


def convolutions_per_step(shape: tuple[int, int], rtol: float) -> float:
    """Return the convolutions that one step of a sweep is expected to take to reach a residual.

    One verifies; a few hundred elements (m ≤ 5) are solved without any other.
    """
    level = _level(shape)
    if level <= 5.0:
        return 1.0
    digits = max(-math.log10(rtol), 0.0) / 6.0
    # between m = 5 and 6 the iteration sets in
    return 1.0 + (UNITS * min(level - 5.0, 1.0) + UNITS_PER_LEVEL * max(level - 6.0, 0.0)) * digits**DIGITS_POWER


def seconds_per_step(shape: tuple[int, int], rtol: float, convolution: float) -> float:
    """Return the seconds that one step of a sweep takes, given those of one convolution on its grid."""
    needed = convolutions_per_step(shape, rtol)
    iterative = ITERATIVE if _level(shape) > 5.0 else 0.0
    return STEP + iterative + PER_CONVOLUTION * needed * convolution


def _level(shape: tuple[int, int]) -> float:
    """Return m of the square grid with as many elements."""
    return math.log2(math.sqrt((shape[0] - 1) * (shape[1] - 1)))


def _shape(case: Case) -> tuple[int, int]:
    return _measured_shape(replace(case, solver=Solver())) if case.m is None else (2**case.m + 1, 2**case.m + 1)


@functools.lru_cache(maxsize=8)
def _measured_shape(case: Case) -> tuple[int, int]:
    """Return the nodes of a surface from files, read once for all estimates of a study."""
    return surface_of(case).shape


@functools.cache
def seconds_per_convolution(shape: tuple[int, int], kernel: str) -> float:
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
