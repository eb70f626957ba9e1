"""The time left of a run: the work left at the mean rate of the work done."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping


class Forecast:
    """The work of a run: all, done and left.

    Parameters
    ----------
    works : mapping
        Expected seconds of each case by id, of `ensemble.cost.expected_seconds`. Their ratios alone count.
    steps : mapping
        Number of steps of each case by id.
    later : float
        Expected seconds of the cases that follow in later batches.
    clock : callable
        Seconds.
    """

    def __init__(
        self,
        works: Mapping[str, float],
        steps: Mapping[str, int],
        later: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._works, self._steps, self._clock = works, steps, clock
        self._all = sum(works.values()) + later
        self._done: dict[str, float] = {}
        self._started = clock()

    def reached(self, id: str, step: int) -> None:
        """Note the finished steps of a case at work."""
        self._done[id] = self._works[id] * step / max(self._steps[id], 1)

    def ended(self, id: str) -> None:
        """Note that a case has ended."""
        self._done[id] = self._works[id]

    @property
    def share(self) -> float:
        """Share of the work that is done, 0 to 1."""
        return sum(self._done.values()) / self._all if self._all > 0.0 else 1.0

    def left(self) -> float | None:
        """Return the seconds until the end of the run; None before any work is done."""
        share = self.share
        return (self._clock() - self._started) * (1.0 - share) / share if share > 0.0 else None
