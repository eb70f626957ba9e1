"""The paper's statements on means over surfaces, judged by ten seeds and by an ensemble.

Ten seeds have an interval of ± t(0.975; 9) s/√10 about the mean, s being the scatter of single surfaces on the finest
m. The ensemble has its own interval. A statement is undecided where the interval contains the limit.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from xarray import Dataset

from roughvol.ensemble.multilevel import half_width
from roughvol.reproduction.claim_run import ClaimRun, state_words
from roughvol.reproduction.claims.evidence import A, V
from roughvol.reproduction.claims.many_seeds import FEW
from roughvol.reproduction.claims.verdict import Number, above

HEAD = ("Statement", "mean", "with ten seeds", "verdict", "with the ensemble", "verdict")
VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}
NOTE = (
    "Intervals of 95 %. Ten seeds: the interval that ten independent surfaces of the finest m have on average. "
    "Means of different D are compared as if they were independent."
)


@dataclass(frozen=True)
class Answers:
    """The statements that one ensemble decides: its name, and the rows of a table under `HEAD`."""

    run: str
    rows: tuple[tuple[str, ...], ...]
    changed: int

    @property
    def words(self) -> str:
        """The number of verdicts that change."""
        return f"{self.changed} of {len(self.rows)} verdicts change when ten seeds become the ensemble. {NOTE}"


@dataclass(frozen=True)
class _Mean:
    """A value with its half-widths: of ten seeds, and of the ensemble."""

    value: float
    ten: float
    ensemble: float

    def number(self, half_width: float) -> Number:
        """Return the value with an interval."""
        return Number("", "", self.value, self.value - half_width, self.value + half_width)


def answers(runs: Sequence[ClaimRun]) -> Iterator[Answers]:
    """Yield the statements that each ensemble among the runs decides."""
    for run in runs:
        if "ensemble_samples" not in run.dataset:
            continue
        rows, changed = [], 0
        for statement, mean in (*_volumes_by_D(run.dataset), *_steps_in_m(run.dataset), *_exponents(run.dataset)):
            if not all(map(math.isfinite, (mean.value, mean.ten, mean.ensemble))):
                continue
            ten, ensemble = mean.number(mean.ten), mean.number(mean.ensemble)
            verdicts = [VERDICTS[above(number, 0.0)] for number in (ten, ensemble)]
            changed += verdicts[0] != verdicts[1]
            rows.append((statement, f"{mean.value:.4g}", _span(ten), verdicts[0], _span(ensemble), verdicts[1]))
        if rows:
            yield Answers(run.name, tuple(rows), changed)


def _span(number: Number) -> str:
    return f"{number.low:.4g} to {number.high:.4g}"


def _volumes_by_D(ds: Dataset) -> Iterator[tuple[str, _Mean]]:
    """Yield the growth of V* with D at each state: at d = 0 in the paper's Fig. 6a."""
    if f"{V}_mean" not in ds:
        return
    for at in ds["ensemble_at"].values.tolist():
        state = ds.sel(ensemble_at=at)
        for low, high in itertools.pairwise(ds["D"].values.tolist()):
            one, other = (_mean_of(state.sel(D=D), V) for D in (low, high))
            grown = _Mean(
                other.value - one.value, math.hypot(one.ten, other.ten), math.hypot(one.ensemble, other.ensemble)
            )
            yield f"V* at {state_words(at)} grows from D = {low:g} to {high:g}", grown


def _steps_in_m(ds: Dataset) -> Iterator[tuple[str, _Mean]]:
    """Yield the decrease of V* in the last refinement, relative to V*: Fig. 6b."""
    for D, at, state in _states(ds, V):
        means = state[f"{V}_level_mean"].values
        if means.size < 2:
            continue
        coarse, fine = means[-2:]
        ten, ensemble = _of_step(state, V)
        m = int(ds["m"].values[-1])
        step = _Mean(1.0 - fine / coarse, ten / abs(coarse), ensemble / abs(coarse))
        yield f"V* at {state_words(at)} falls from m = {m - 1} to {m}, D = {D:g} (share)", step


def _exponents(ds: Dataset) -> Iterator[tuple[str, _Mean]]:
    """Yield n of A*/p* ~ δ^n between the two finest m at given p*: Fig. 4b and 5."""
    for D, at, state in _states(ds, A):
        means = state[f"{A}_level_mean"].values
        if means.size < 2 or not at.startswith("pressure"):
            continue
        coarse, fine = means[-2:]
        ten, ensemble = _of_step(state, A)
        scale = math.log(2.0) * abs(fine)
        n = _Mean(math.log2(coarse / fine), ten / scale, ensemble / scale)
        yield f"n > 0 in A*/p* ~ δ^n at {state_words(at)}, D = {D:g}", n


def _states(ds: Dataset, name: str) -> Iterator[tuple[float, str, Dataset]]:
    if f"{name}_level_mean" in ds:
        for D in ds["D"].values.tolist():
            for at in ds["ensemble_at"].values.tolist():
                yield D, at, ds.sel(D=D, ensemble_at=at).transpose("m", ...)


def _mean_of(state: Dataset, name: str) -> _Mean:
    """Return a mean with the half-widths of ten seeds and of the ensemble."""
    interval = state[f"{name}_interval"]
    half = 0.5 * float(interval.sel(bound="upper") - interval.sel(bound="lower"))
    scatter = math.sqrt(float(state[f"{name}_level_variance"].isel(m=-1)))
    return _Mean(float(state[f"{name}_mean"]), half_width(scatter, FEW), half)


def _of_step(state: Dataset, name: str) -> tuple[float, float]:
    """Return the half-widths of the last step in m: of ten common seeds, and of those of the ensemble.

    The step is f/c, of the means f and c of both levels, and Y_f - (f/c) Y_c is its scatter: the residual about the
    regression on the coarse level, and the difference between its slope and f/c.
    """
    (coarse, fine), variances = (state[f"{name}_level_{of}"].values[-2:] for of in ("mean", "variance"))
    slope = np.nan_to_num(state[f"{name}_level_correlation"].values[-1]) * math.sqrt(variances[1])  # times σ_c
    apart = abs(float(slope - fine / coarse * math.sqrt(variances[0])))
    scatter = math.sqrt(float(state[f"{name}_level_residual"].isel(m=-1)))
    many, few = np.maximum(state["ensemble_samples"].values[-2:], 2.0)
    return half_width(math.hypot(scatter, apart), FEW), math.hypot(half_width(scatter, few), half_width(apart, many))
