"""How wrong the quick estimates of leakage are: effective medium and single junction over the flow computed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from xarray import broadcast

from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.evidence import A, Evidence

ESTIMATES = {
    "effective medium": "estimate_medium_transmissivity",
    "single critical junction": "estimate_junction_transmissivity",
}
EDGES = (0.0, 0.05, 0.1, 0.2, 0.3, 1.0)  # of the classes of A*
HEAD = ("run", "estimate", "A*", "median", "90 % of states", "off by more than 2", "open or closed wrongly", "n")
FEWEST = 5  # states that a class needs


@dataclass(frozen=True)
class Ratio:
    """An estimate over the transmissivity computed, at the states of one run with A* in a class, x and y together.

    ``span`` holds 90 % of the states, ``doubled`` is the share of those off by more than a factor of two; ``closed``
    counts the states at which one of both is closed.
    """

    run: str
    estimate: str
    area: tuple[float, float]
    median: float
    span: tuple[float, float]
    doubled: float
    closed: int
    states: int

    @property
    def cells(self) -> tuple[str, ...]:
        """The row of a table under `HEAD`."""
        low, high = (f"{value:.3g}" for value in self.area)
        inner = f"{self.span[0]:.3g} to {self.span[1]:.3g}"
        counts = (f"{self.doubled:.0%}", str(self.closed), str(self.states))
        return self.run, self.estimate, f"{low} to {high}", f"{self.median:.2f}", inner, *counts


def ratios(evidence: Evidence) -> list[Ratio]:
    """Return how far the estimates are off, for every run that holds both them and the flow."""
    return [ratio for run in evidence.runs for name in ESTIMATES for ratio in _of(run, name)]


def _of(run: ClaimRun, name: str) -> Iterator[Ratio]:
    ds = run.dataset
    names = (A, ESTIMATES[name], "transmissivity")
    if any(variable not in ds for variable in names):
        return
    area, guess, flow = (one.values.ravel() for one in broadcast(*(ds[variable] for variable in names)))
    mask = np.isfinite(guess) & np.isfinite(flow) & np.isfinite(area)
    for low, high in pairwise(EDGES):
        inside = mask & (area > low) & (area <= high)
        open_ = inside & (guess > 0.0) & (flow > 0.0)
        if open_.sum() < FEWEST:
            continue
        ratio = guess[open_] / flow[open_]
        bounds = np.quantile(ratio, [0.05, 0.95])
        yield Ratio(
            run=run.name,
            estimate=name,
            area=(low, high),
            median=float(np.median(ratio)),
            span=(float(bounds[0]), float(bounds[1])),
            doubled=float(np.mean((ratio > 2.0) | (ratio < 0.5))),
            closed=int((inside & ((guess > 0.0) != (flow > 0.0))).sum()),
            states=int(open_.sum()),
        )
