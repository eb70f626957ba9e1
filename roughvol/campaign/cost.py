"""Cost of a study: memory and disk of its cases, and its time, estimated.

Time is that of `ensemble.cost`, with a convolution timed on this machine for each grid.
"""

from __future__ import annotations

import functools
import math
import time
import timeit
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from roughvol.campaign import machine
from roughvol.campaign.machine import size
from roughvol.contact.halfspace import HalfSpace
from roughvol.ensemble.cost import expected_seconds, observable_seconds
from roughvol.errors import CampaignError, ResourceError
from roughvol.observables import requests
from roughvol.observables.variables import OBSERVABLES
from roughvol.study import ACCURACY, EXPECTED, Case, Study, check_type
from roughvol.typing import Shape, Sides

# Bytes, from the growth of the largest resident set of `run_case` at m = 9 and 10 (D = 2.5).
PROCESS_BYTES = 2e8  # of a process after its imports
COMPILED_BYTES = 1.4e8  # of a process, in addition: numba and its compiled loops, of flows and constrictions
SURFACE_BYTES, NODE_BYTES = 50, 280  # per node: of a surface alone; of half space and solver
SKEWED_BYTES = 25  # per node, in addition: while heights get their skewness
CHANNEL_BYTES, FLOW_BYTES = 200, 230  # per node, in addition: of a search for the last channel; of a flow
GAS_BYTES = 40  # per node, in addition: conductances of a gas
FIELD_BYTES = 16  # per node and stored field
FILE_BYTES, STEP_BYTES = 1.2e5, 700  # of the file of a case without fields: at most, and in addition for each step
SMALL = 1e9  # never refused up to here: the estimate is rough
SPARED = 0.9  # largest share of the available memory
TIMED_UP_TO, STRIP = 1025, 64  # nodes a side of a grid that is timed, and across a strip of a larger grid
START = 2.5  # seconds: processes start and import
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

    @property
    def warning(self) -> str:
        """A sentence on a run longer than `LONG`, else empty."""
        if self.seconds < LONG:
            return ""
        processes = f"{self.jobs} process" + "es" * (self.jobs > 1)
        years, days = self.seconds / (365.25 * 86400.0), self.seconds / 86400.0
        return f"this takes about {years:.2g} years ({days:.0f} days) in {processes}"


def memory_of(case: Case) -> float:
    """Return the bytes of memory that a process needs for a case."""
    nodes = math.prod(case.shape)
    if case.sweep.steps == 0:
        skewed = case.spectrum is not None and case.spectrum.Ssk is not None
        per_node = SURFACE_BYTES + SKEWED_BYTES * skewed
    else:
        per_node = NODE_BYTES + CHANNEL_BYTES * any("percolation" in leg.target.kind for leg in case.sweep.legs)
        if flow_elements(case) > 0:
            per_node += FLOW_BYTES
            per_node += GAS_BYTES * (case.gas is not None)
    compiled = case.record.transport is not None or flow_elements(case) > 0
    whole = PROCESS_BYTES + COMPILED_BYTES * compiled
    return whole + nodes * (per_node + FIELD_BYTES * requests.fields_of(case.record))


def flow_elements(case: Case) -> int:
    """Return the number of elements of the largest flow that a case asks for, 0 without one."""
    rows = [OBSERVABLES[name] for name in requests.asked(case.record)]
    shares = [max(requests.passes(row, case.record)) for row in rows if row.flow]
    return math.ceil(math.prod(case.shape) * max(shares, default=0.0))


def disk_of(case: Case) -> float:
    """Return an upper bound of the bytes in the file of a case; compressed fields take less."""
    fields = 8 * math.prod(case.shape) * requests.fields_of(case.record)
    return FILE_BYTES + STEP_BYTES * case.sweep.steps + fields


def check_fits(missing: Iterable[Case], cases: Iterable[Case], folder: Path, *, here: bool = True) -> None:
    """Refuse a run whose missing cases exceed the memory of this machine, or whose files exceed its disk.

    All cases are stored in ``study.nc`` as well. The memory of a cluster is unknown (``here``). `ResourceError`, or
    `CampaignError` where ``ulimit -v`` is too small.
    """
    computed = _alike(missing)
    if not computed:
        return
    problems = []
    if here:
        need, label = max((memory_of(case), case.label) for case, _ in computed)
        available, limit = machine.available_memory(), machine.address_space()
        if available is not None and need > max(available, SMALL):
            problems.append(f"{label} needs about {size(need)} of memory, {size(available)} are available")
        if limit is not None and (space := machine.needed_space(need - PROCESS_BYTES)) > limit:
            message = f"not enough memory: {label} needs about {size(space)} of address space, "
            raise CampaignError(f"{message}the limit is {size(limit)} (ulimit -v)")
    disk = sum(number * disk_of(case) for case, number in computed + _alike(cases))
    free = machine.free_disk(folder)
    if free is not None and disk > max(free, SMALL):
        problems.append(f"the results need up to {size(disk)} of disk, {size(free)} are free at {folder}")
    if problems:
        raise ResourceError("this study does not fit: " + "; ".join(problems))


def limited(jobs: int, needs: Iterable[float], available: float | None) -> tuple[int, str]:
    """Return the number of processes that fit in memory, from one to ``jobs``, and a sentence if it is smaller.

    The largest of the needs [bytes] may run together; ``available`` is None without a limit.
    """
    largest = sorted(needs, reverse=True)[:jobs]
    if available is None or sum(largest) <= SPARED * available:
        return jobs, ""
    fitting = max(1, int(np.searchsorted(np.cumsum(largest), SPARED * available, side="right")))
    text = f"a case needs about {size(largest[0])}, {size(available)} are available"
    if fitting == jobs:
        return fitting, f"{text}: it may fail"
    return fitting, f"{fitting} instead of {jobs} processes at once: {text}"


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

    See Also
    --------
    roughvol.check : Returns it with the first surface and doubts.

    Examples
    --------
    >>> from roughvol.campaign import estimate
    >>> from roughvol.study import loads
    >>> found = estimate(loads("{surface: {D: [2.2, 2.5], m: 4, seeds: 3}, sweep: {steps: 10}}"), jobs=1)
    >>> found.cases, found.steps, found.seconds < 60.0
    (6, 60, True)
    """
    check_type(study, Study, "a study is a Study, as of roughvol.load", CampaignError)
    return _estimate(study.cases(), jobs)


def _estimate(cases: Sequence[Case], jobs: int | None) -> Estimate:
    machine.check_jobs(jobs)
    jobs = min(jobs or machine.cores(), len(cases))
    alike = _alike(cases)
    needs = [need for case, number in alike for need in [memory_of(case)] * min(number, jobs)]
    jobs, notice = limited(jobs, needs, machine.available_memory())
    longest, together = 0.0, 0.0
    observables: Counter[str] = Counter()
    for case, number in alike:
        convolution = seconds_per_convolution(case.shape, case.sides) if case.sweep.steps > 0 else 0.0
        seconds = expected_seconds(case, convolution)
        longest, together = max(longest, seconds), together + number * seconds
        observables.update({name: number * taken for name, taken in observable_seconds(case).items()})
    return Estimate(
        cases=len(cases),
        steps=sum(case.sweep.steps for case in cases),
        jobs=jobs,
        memory=max(needs),
        # each case is stored in its file and in study.nc
        disk=2 * sum(number * disk_of(case) for case, number in alike),
        seconds=START + max(together / jobs, longest),
        observables=dict(observables),
        notice=notice,
    )


def warning(cases: Sequence[Case], jobs: int | None) -> str:
    """Return the warning for cases that take longer than `LONG`; few or small cases are not timed."""
    states = sum(case.sweep.steps * math.prod(case.shape) for case in cases)
    return "" if ROUGH * states / (jobs or machine.cores()) < LONG / 30.0 else _estimate(cases, jobs).warning


def _alike(cases: Iterable[Case]) -> list[tuple[Case, int]]:
    """Return one case of each cost, with the number of cases that have this cost. D and seed change none."""
    names = [field.name for field in fields(Case) if field.name not in ("D", "seed")]
    groups: dict[tuple[int, ...], list[Case]] = {}
    for case in cases:  # the cases of a study share their objects, and a hash of long lists of levels is slow
        groups.setdefault(tuple(id(getattr(case, name)) for name in names), []).append(case)
    return [(alike[0], len(alike)) for alike in groups.values()]


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
        options.append(Choice(name, rtol, estimate(study.changed(**solver), jobs).seconds, EXPECTED[name]))
    return options


@functools.cache
def seconds_per_convolution(shape: Shape, sides: Sides = "free") -> float:
    """Return the seconds of one convolution, timed on this grid.

    Of a larger grid, strips along both axes are timed, without what they share: each side has its own prime factors.
    """
    rows, columns = shape
    if max(shape) <= TIMED_UP_TO:
        return _timed(shape, sides)
    high, wide = min(rows, STRIP), min(columns, STRIP)
    parts = (rows, wide), (high, columns), (high, wide)
    down, across, shared = (_timed(part, sides) / math.prod(part) for part in parts)
    return (down + across - shared) * rows * columns


def _timed(shape: Shape, sides: Sides) -> float:
    half_space, pressure = HalfSpace(shape, sides=sides), np.ones(shape)
    half_space.displacement(pressure)  # plans
    # processor time: on a busy machine others take most of the time of a clock
    return min(timeit.repeat(lambda: half_space.displacement(pressure), timer=time.process_time, number=1, repeat=5))
