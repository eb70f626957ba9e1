"""Monte Carlo: results that ten surfaces, or one, may give where a hundred are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from roughvol.ensemble.multilevel import half_width
from roughvol.report.figures.cases import nearest
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims import statistics
from roughvol.reproduction.claims.area_and_volume import exponents
from roughvol.reproduction.claims.density import mean_volume_exponents
from roughvol.reproduction.claims.evidence import A, Evidence, P, V, area_slopes, require
from roughvol.reproduction.claims.verdict import Number
from roughvol.reproduction.needs import MANY, PAPER_D
from roughvol.typing import Array

FEW = 10  # surfaces of the paper's Monte Carlo
ENOUGH = MANY.of(A, P, V, D=(2.1, PAPER_D), seeds=3 * FEW)
DRAWS = 5000
SEED = 336  # any number, fixed: the report must not change from one run to the next


@dataclass(frozen=True)
class Spread:
    """A quantity over many surfaces: its mean, and in which 95 % of single surfaces and of means of ten lie.

    ``missed`` is the share of sets of ten whose own t interval does not contain the mean of all.
    """

    name: str
    many: Number
    one: tuple[float, float]
    ten: tuple[float, float]
    missed: float


@dataclass(frozen=True)
class Flip:
    """How often a comparison of two D comes out wrong, with surfaces of different seeds: one of each, ten of each."""

    name: str
    one: float
    ten: float


class ManySeeds(NamedTuple):
    """The run with the most surfaces, and the scatter of few surfaces drawn from it."""

    run: ClaimRun
    spreads: list[Spread]
    flips: list[Flip]


def many_seeds(evidence: Evidence) -> ManySeeds:
    """Return the scatter of one and ten surfaces, in 5000 draws of fixed seed from the run with the most surfaces."""
    evidence.best(ENOUGH)
    runs = [run for run in evidence.fit(ENOUGH) if run.seeds >= 3 * FEW]
    require(runs, f"a run of {3 * FEW} surfaces or more")
    run = max(runs, key=lambda candidate: (candidate.seeds, len(candidate.D)))
    random = np.random.Generator(np.random.PCG64(SEED))
    sets = np.array([random.choice(run.seeds, FEW, replace=False) for _ in range(DRAWS)])
    others = np.array([random.choice(run.seeds, FEW, replace=False) for _ in range(DRAWS)])
    values = dict(_quantities(run))
    spreads = [_spread(key, name, numbers, sets) for key, (name, numbers) in values.items()]
    flips = []
    for low, high in pairwise(run.D):
        for symbol, sign in (("V* at d = 0", 1.0), ("A*/p*", -1.0)):
            _, at_low = values[f"{symbol}_{low:g}"]
            _, at_high = values[f"{symbol}_{high:g}"]
            name = f"{symbol}: D = {high:g} against {low:g}, m = {max(run.m)}"
            flips.append(_flip(name, sign * at_low, sign * at_high, sets, others))
    return ManySeeds(run, spreads, flips)


def _flip(name: str, smaller: Array, larger: Array, sets: np.ndarray, others: np.ndarray) -> Flip:
    """Return how often surfaces of different seeds give the wrong order of two quantities."""
    seeds = len(smaller)
    wrong_pairs = larger[:, np.newaxis] < smaller
    different_seeds = ~np.eye(seeds, dtype=bool)
    wrong_means = larger[others].mean(axis=1) < smaller[sets].mean(axis=1)
    return Flip(name, float(wrong_pairs[different_seeds].mean()), float(wrong_means.mean()))


def _quantities(run: ClaimRun) -> Iterator[tuple[str, tuple[str, Array]]]:
    m = max(run.m)
    slopes, limit = area_slopes(run, run.D, [m])
    for D in run.D:
        yield f"V* at d = 0_{D:g}", (f"V* at d = 0, D = {D:g}, m = {m}", run.last(V, D=D, m=m))
        yield f"A*/p*_{D:g}", (f"A*/p*, D = {D:g}, m = {m} (p* ≤ {limit:.2f})", slopes[D, m])
    if len(run.m) > 1:
        D = nearest(run.D, PAPER_D)
        words = f"D = {D:g}, m = {run.m[0]} to {m}"
        yield "n", (f"n of A*/p* ~ δ^n, {words}", exponents(run, D, len(run.m))[0])
        yield "q", (f"q of v̄ ~ δ^q, {words}", mean_volume_exponents(run, D))


def _spread(key: str, name: str, values: Array, sets: np.ndarray) -> Spread:
    many = statistics.mean(key, name, values)
    drawn = values[sets]
    means = drawn.mean(axis=1)
    half_widths = half_width(drawn.std(axis=1, ddof=1), FEW)
    missed = np.abs(means - many.value) > half_widths
    return Spread(name, many, _middle(values), _middle(means), float(missed.mean()))


def _middle(sample: Array) -> tuple[float, float]:
    """Return the range of the middle 95 % of a sample."""
    low, high = np.quantile(sample, [0.025, 0.975])
    return float(low), float(high)
