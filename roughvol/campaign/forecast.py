"""The time left of a run: expected seconds of its cases, corrected by measured ones.

Seconds are those of one process. The expected ones come from constants (`samples`, `cost`); no grid is timed. Their
ratio to the measured ones is kept for each size of grid.
"""

from __future__ import annotations

import heapq
import math
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from roughvol.campaign import cost
from roughvol.study import Case

CASE = 0.005  # seconds of a case with its file
CONVOLUTION = 6.0e-9  # seconds of a convolution over n log n, n nodes, as `samples.NODE_SECONDS` for squares
SURFACE = 2.0e-7  # seconds per node: surface and half space
RISE = 1.5  # power of the share of steps in the share of their time, on one way to d = 0
TRUSTED = 0.3  # seconds of expected work that weigh as much as measured ones
PACKED = 64  # cases waiting up to which each is placed; beyond, processes end together
CLOSING = 30  # steps that a search for the closing of the last channel takes beyond `cost.SEARCH` (docs/tradeoff.md)
END = 0.3  # seconds from the last case to the collected dataset
SILENT = 0.5  # least time left of a case, over the time since its last message


@dataclass(frozen=True)
class Work:
    """The expected work of one case.

    Attributes
    ----------
    nodes : int
        Nodes of its grid.
    first : float
        Seconds before its second step: surface, half space, search for the end.
    swept : float
        Seconds of all steps.
    steps : int
        Number of steps.
    power : float
        Share of time after a share x of the steps: x to this power.
    """

    nodes: int
    first: float
    swept: float
    steps: int
    power: float = 1.0

    @property
    def total(self) -> float:
        """Seconds of the case."""
        return self.first + self.swept

    def after(self, step: int) -> float:
        """Return the seconds up to a step."""
        share = min(step / self.steps, 1.0) if self.steps else 1.0
        return self.first + self.swept * share**self.power if step else 0.0


def work_of(case: Case, shape: tuple[int, int]) -> Work:
    """Return the expected work of a case.

    Parameters
    ----------
    case : Case
        Any case.
    shape : tuple of int
        Nodes of its surface along x and y.

    Returns
    -------
    Work
        In seconds of one process, before any measurement.
    """
    nodes, steps, legs = math.prod(shape), case.sweep.steps, case.sweep.legs
    first = CASE + SURFACE * nodes
    if steps == 0:
        return Work(nodes, first, 0.0, 0)
    step = cost.seconds_per_step(shape, case.solver.tolerance, CONVOLUTION * nodes * math.log(nodes) / 2.0)
    observed = sum(cost.observable_seconds(case, shape).values())
    closings = sum(leg.target.kind.startswith("percolation") for leg in legs)
    searched = step * (cost.SEARCH * cost.searches(case) + CLOSING * closings)
    listed = any(leg.listed for leg in legs)
    swept = step * (steps + cost.LEVEL * cost.searched_levels(case)) + observed
    if listed or len(legs) > 1:  # searches along the way
        return Work(nodes, first, swept + searched, steps)
    return Work(nodes, first + searched, swept, steps, RISE if not observed else 1.0)


@dataclass
class Rates:
    """Measured over expected seconds, for each grid and for all."""

    measured: dict[int, float] = field(default_factory=lambda: defaultdict(float))  # seconds, by nodes
    expected: dict[int, float] = field(default_factory=lambda: defaultdict(float))
    prior: float = 1.0  # the ratio before any measurement: that of the start of processes

    def add(self, nodes: int, measured: float, expected: float) -> None:
        """Add a stretch of work."""
        self.measured[nodes] += measured
        self.expected[nodes] += expected

    def of(self, nodes: int) -> float:
        """Return the ratio for a grid; where little was measured, that of all grids, at first the prior."""
        overall = (sum(self.measured.values()) + TRUSTED * self.prior) / (sum(self.expected.values()) + TRUSTED)
        measured, expected = self.measured.get(nodes, 0.0), self.expected.get(nodes, 0.0)
        return (measured + TRUSTED * overall) / (expected + TRUSTED)


@dataclass
class _Begun:
    """A case at work: its last sign, the work done by then, and whether its process was running before."""

    since: float
    done: float
    warm: bool


class Forecast:
    """The work of a run: all, done and left."""

    def __init__(
        self,
        works: Mapping[str, Work],
        *,
        rates: Rates | None = None,
        later: Mapping[int, float] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Hold the work of cases by id, and the seconds of work after them by nodes."""
        self._works, self._clock = works, clock
        self._rates, self._later = rates or Rates(), later or {}
        self._waiting = dict(works)
        self._sums: dict[int, float] = defaultdict(float)  # seconds of the cases waiting, by nodes
        for work in works.values():
            self._sums[work.nodes] += work.total
        self._all = sum(work.total for work in works.values())
        self._running: dict[str, _Begun] = {}
        self._ended, self._begun_before = 0.0, 0
        self._processes, self._cold = 1, 0

    def start(self, processes: int, *, here: bool) -> None:
        """Set the number of processes; those that are not this one have to start."""
        self._processes, self._cold = processes, 0 if here else processes

    def begun(self, id: str) -> None:
        """Note that a case begins."""
        work = self._waiting.pop(id, None)
        if work is not None:
            self._sums[work.nodes] -= work.total
        self._begun_before += 1
        self._running[id] = _Begun(self._clock(), 0.0, self._begun_before > self._cold)
        self._processes = max(self._processes, len(self._running))

    def reached(self, id: str, step: int) -> None:
        """Note the finished steps of a case at work."""
        self._moved(id, self._works[id].after(step))

    def ended(self, id: str) -> None:
        """Note that a case has ended."""
        self._moved(id, self._works[id].total)
        self._running.pop(id, None)
        self._ended += self._works[id].total

    def _moved(self, id: str, done: float) -> None:
        one, now = self._running.get(id), self._clock()
        if one is None:
            return
        if one.warm:
            self._rates.add(self._works[id].nodes, now - one.since, done - one.done)
        else:  # a loaded machine starts processes late, and computes slowly too
            self._rates.prior = max((now - one.since) / (cost.START + done), 1.0)
        self._running[id] = _Begun(now, done, True)

    @property
    def share(self) -> float:
        """Share of the work that is done, 0 to 1."""
        done = self._ended + sum(one.done for one in self._running.values())
        whole = self._all + sum(self._later.values())
        return done / whole if whole > 0.0 else 1.0

    def left(self) -> float:
        """Return the seconds until the end of the run."""
        rate, now = self._rates.of, self._clock()
        loads = [self._left_of(id, one, now) for id, one in self._running.items()]
        loads += [0.0] * (self._processes - len(loads))
        start = cost.START if self._cold and not self._begun_before else 0.0
        if len(self._waiting) <= PACKED:
            heapq.heapify(loads)
            for work in sorted(self._waiting.values(), key=lambda work: -work.total):
                heapq.heapreplace(loads, loads[0] + work.total * rate(work.nodes))
            longest = max(loads)
        else:
            waiting = sum(seconds * rate(nodes) for nodes, seconds in self._sums.items())
            longest = max(max(loads), (sum(loads) + waiting) / len(loads))
        later = sum(seconds * rate(nodes) for nodes, seconds in self._later.items())
        return start + longest + later / len(loads) + END * self._rates.prior

    def _left_of(self, id: str, one: _Begun, now: float) -> float:
        """Return the seconds left of a case at work."""
        work, silent = self._works[id], now - one.since
        start = 0.0 if one.warm else cost.START
        expected = start + (work.total - one.done) * self._rates.of(work.nodes) - silent
        return max(expected, SILENT * max(silent - start, 0.0))
