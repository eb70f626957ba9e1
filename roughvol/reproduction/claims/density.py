"""Claims about the density of the free volumes and the totals at d = 0 (Section 4, Fig. 12)."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from roughvol.report.figures.cases import nearest
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.evidence import Given, Outcome, V, claim, require
from roughvol.reproduction.claims.statistics import exact, jackknife, mean, ratio, slope, straightness
from roughvol.reproduction.claims.verdict import Check
from roughvol.reproduction.needs import BY_D, BY_M, DENSITY, MANY, PAPER_D, PAPER_M
from roughvol.typing import Array

F, EDGES = "volume_density", "volume_density_edges"
FULCRUM = 0.10  # spread of f(1) over D, relative: "almost independent"
LOW_D = 2.5  # the fulcrum is sought among the smoother surfaces alone as well: the paper does not say which D it drew
COARSE_BINS = 10  # of the pooled density in which it is asked whether it decreases: about 4 % of noise a bin at m = 7


def densities(run: ClaimRun, D: float, m: int) -> tuple[Array, Array]:
    """Return f (surfaces, bins) and its edges (surfaces, edges) at the last recorded state."""
    case = run.dataset.sel(D=D, m=m).isel(density_at=-1)
    return case[F].transpose("seed", "bin").values, case[EDGES].transpose("seed", "edge").values


def _centres(edges: Array) -> Array:
    return 0.5 * (edges[:, 1:] + edges[:, :-1])


def value_at(f: Array, edges: Array, v: float) -> Array:
    """Return f(v) of each surface, linear between the centres of bins, 0 beyond the largest volume."""
    return np.array([np.interp(v, x, y, right=0.0) for x, y in zip(_centres(edges), f, strict=True)])


def pooled(f: Array, edges: Array, bins: int) -> tuple[Array, Array]:
    """Return the density of all surfaces together on common bins, exactly: through the cumulative shares."""
    common = np.linspace(0.0, float(edges.max()), bins + 1)
    below = np.pad(np.cumsum(f * np.diff(edges), axis=1), ((0, 0), (1, 0)))
    share = np.mean([np.interp(common, x, y) for x, y in zip(edges, below, strict=True)], axis=0)
    return 0.5 * (common[1:] + common[:-1]), np.diff(share) / np.diff(common)


@claim(19, needs=BY_D.of(F, EDGES, finest=PAPER_M, m=(PAPER_M,), **DENSITY))
def density_by_D(given: Given) -> Outcome:
    """Pool f of all surfaces of one D on ten bins up to its v_max, in which sampling noise is small.

    Decreasing: the rank correlation of f with v is below -0.9 for every D (essential), and the largest f is in the
    first bin for every D (other: "decreasing" to the letter). About linear: R² of a line above 0.9 for every D (other,
    "approximately"). Steeper and shorter at lower D: the interval of the matched ratios of v_max lies above 1 and of
    the slopes of f (least-squares line of each surface) below 1, for every pair of neighbouring D (essential). Fulcrum:
    the means of f(1) over D spread by less than 10 % of their mean (essential: "almost independent").
    """
    from scipy.stats import spearmanr  # half a second: imported where it is used

    run = given.run()
    m = int(nearest(run.m, PAPER_M))
    data = {D: densities(run, D, m) for D in run.D}
    checks = []
    numbers = []
    inner_peaks = []
    for D, (f, edges) in data.items():
        v, together = pooled(f, edges, COARSE_BINS)
        at_peak = int(together.argmax())
        rank = exact(
            f"rank_D{D:g}",
            f"rank correlation of f with v, D = {D:g}",
            float(spearmanr(v, together).statistic),
            len(f),
        )
        peak = exact(f"peak_D{D:g}", f"v of the largest f over v_max, D = {D:g}", v[at_peak] / edges.max(), len(f))
        line = exact(f"line_D{D:g}", f"R² of a line, D = {D:g}", straightness(v, together), len(f))
        checks += [
            Check(f"f falls with v at D = {D:g} (rank correlation below -0.9)", rank.value < -0.9, rank),
            Check(f"f is largest at v = 0 for D = {D:g}", at_peak == 0, peak, essential=False),
            Check(f"a line fits f at D = {D:g} (R² above 0.9)", line.value > 0.9, line, essential=False),
        ]
        numbers.append(mean(f"f1_D{D:g}", f"f(1) at D = {D:g}", value_at(f, edges, 1.0)))
        if at_peak != 0:
            inner_peaks.append(f"{D:g}")
    for low, high in pairwise(run.D):
        pair = f"at D = {high:g} over that at {low:g}"
        largest = ratio(f"vmax_{low:g}_{high:g}", f"v_max {pair}", data[high][1][:, -1] / data[low][1][:, -1])
        slopes = ratio(f"slope_{low:g}_{high:g}", f"slope of f {pair}", _slopes(*data[high]) / _slopes(*data[low]))
        checks.append(Check.above(f"v_max grows from D = {low:g} to {high:g}", largest, 1.0))
        checks.append(Check.below(f"f is flatter at D = {high:g} than at {low:g}", slopes, 1.0))
    at_one = values_by_D(data, 1.0)
    spread = jackknife("fulcrum", "spread of f(1) over D", lambda seeds: fulcrum(at_one[:, seeds]), run.seeds)
    checks.append(Check(f"f(1) spreads by less than {FULCRUM:.0%} over D", spread.value < FULCRUM, spread))
    best_v, least = best_fulcrum(data)
    numbers.append(exact("best_v", "v at which f depends least on D", best_v, run.seeds))
    numbers.append(exact("best_spread", "spread of f there", least, run.seeds))
    why = f"f(1) spreads by {spread.value:.0%} over D (least, {least:.0%}, at v = {best_v:.2g})"
    smooth = {D: pair for D, pair in data.items() if D <= LOW_D}
    if 1 < len(smooth) < len(data):
        v_low, least_low = best_fulcrum(smooth)
        numbers.append(exact("best_v_low", f"v at which f depends least on D ≤ {LOW_D:g}", v_low, run.seeds))
        numbers.append(exact("best_spread_low", "spread of f there", least_low, run.seeds))
        if least_low < FULCRUM:
            why += f"; for D ≤ {LOW_D:g} alone there is one, {least_low:.0%} at v = {v_low:.2g}"
    if inner_peaks:
        why += f"; f has a maximum inside for D = {', '.join(inner_peaks)}."
    else:
        why += "; f is largest at 0 for every D."
    return Outcome(checks, why, [run], numbers)


def _slopes(f: Array, edges: Array) -> Array:
    return np.array([-slope(x, y) for x, y in zip(_centres(edges), f, strict=True)])


def values_by_D(data: dict[float, tuple[Array, Array]], v: float, scale: float = 1.0) -> Array:
    """Return f(v) of each surface, shape (D, surfaces); volumes multiplied by ``scale`` beforehand."""
    return np.array([value_at(f, edges, v / scale) for f, edges in data.values()])


def fulcrum(values: Array) -> float:
    """Return (largest - smallest)/mean over D of the means of f(v), shape (D, surfaces)."""
    means = values.mean(axis=1)
    return float(np.ptp(means) / means.mean()) if means.mean() > 0.0 else math.nan


def best_fulcrum(data: dict[float, tuple[Array, Array]]) -> tuple[float, float]:
    """Return the v below the smallest v_max at which f depends least on D, and the spread there."""
    largest = min(float(edges[:, -1].min()) for _, edges in data.values())
    spreads = {v: fulcrum(values_by_D(data, v)) for v in np.linspace(0.0, largest, 100)[1:]}
    best = min(spreads, key=lambda v: spreads[v])
    return float(best), spreads[best]


@claim(20, needs=BY_D.of(V))
def volume_shrinks(given: Given) -> Outcome:
    """Compare matched pairs of surfaces at the last step: the interval of V*(D') - V*(D) lies above 0."""
    run = given.run()
    m = max(run.m)
    checks = []
    for low, high in pairwise(run.D):
        name = f"V*(D = {high:g}) - V*(D = {low:g}) at d = 0, m = {m}"
        number = mean(f"rise_{low:g}_{high:g}", name, run.last(V, D=high, m=m) - run.last(V, D=low, m=m))
        checks.append(Check.above(f"V* grows from D = {low:g} to {high:g}", number, 0.0))
    numbers = [mean(f"V_D{D:g}", f"V* at d = 0, D = {D:g}, m = {m}", run.last(V, D=D, m=m)) for D in run.D]
    why = f"V* at d = 0 grows from {numbers[0].value:.2f} at D = {run.D[0]:g} to {numbers[-1].value:.2f} at D = "
    return Outcome(checks, f"{why}{run.D[-1]:g}.", [run], numbers)


def moments(run: ClaimRun, D: float) -> dict[int, tuple[Array, Array, Array]]:
    """Return for each m the mean volume, the mean of f over its bins and the largest volume of every surface."""
    data = {m: densities(run, D, m) for m in run.m}
    return {
        m: (np.sum(f * _centres(edges) * np.diff(edges), axis=1), f.mean(axis=1), edges[:, -1])
        for m, (f, edges) in data.items()
    }


@claim(21, needs=BY_M.of(F, EDGES, **DENSITY))
def density_by_m(given: Given) -> Outcome:
    """Fit to every surface the least-squares line through (log v̄, log f̄) over all m; f̄ is the mean of f over its bins.

    Slope -1: the mean is within 0.05 of it (essential; two digits would be 0.005, but a line "provides" the slope by
    an argument, not by a fit). Four orders: the larger of the shifts of v_max and of f̄ between the smallest
    and the largest m rounds to 4 (3.5 to 4.5 decades; other, "up to").
    """
    run = given.run()
    by_m = moments(run, PAPER_D)
    first, last = run.m[0], run.m[-1]
    v, f, largest = (np.log10([by_m[m][k] for m in run.m]) for k in range(3))
    line = mean("slope", "slope of the line of means", [slope(x, y) for x, y in zip(v.T, f.T, strict=True)])
    shift_v = mean("decades_v", f"decades between v_max at m = {first} and {last}", largest[0] - largest[-1])
    shift_f = mean("decades_f", f"decades between mean f at m = {last} and {first}", f[-1] - f[0])
    decades = max(shift_v, shift_f, key=lambda number: number.value)
    checks = [
        Check("slope of the line of means is -1 within 0.05", abs(line.value + 1.0) <= 0.05, line),
        Check("the shift rounds to 4 decades", 3.5 <= decades.value < 4.5, decades, essential=False),
    ]
    why = f"The line of means has slope {line.value:.3f}; the shift is {decades.value:.1f} decades, of which the "
    why += f"area of an element makes {(last - first) * math.log10(4.0):.1f}."
    return Outcome(checks, why, [run], [shift_v if decades is shift_f else shift_f])


@claim(
    22,
    needs={
        "": BY_M.of(F, EDGES, **DENSITY),
        "wide": MANY.of(V, by="D", D=(2.1, 2.9), m=(5, 6, 7), seeds=10, optional=True),
    },
)
def shift_per_m(given: Given) -> Outcome:
    """Fit the exponent q of v̄ ~ (L/2^m)^q, from the slope of log v̄ over m of every surface, all m.

    Met if the interval of q contains D = 2.3 (essential). The observed 0.6 is met if the mean shift per m rounds to it
    (other). The area of an element alone gives q = 2 and a shift of log10 4 = 0.602. Where a run has several D and m
    the law is tested where it must differ most: q at the largest and the smallest D, to be told apart by their D
    (essential if there is such a run).
    """
    run = given.run()
    volumes = {m: volume for m, (volume, _, _) in moments(run, PAPER_D).items()}
    logs = np.log10([volumes[m] for m in run.m])
    shifts = -np.array([slope(run.m, row) for row in logs.T])
    q = mean("exponent", f"q in v̄ ~ (L/2^m)^q, D = {PAPER_D:g}", shifts / math.log10(2.0))
    shift = mean("shift", "shift of log₁₀ v̄ per m", shifts)
    checks = [
        Check(f"q = D = {PAPER_D:g}", q.reaches(PAPER_D), q),
        Check("the shift rounds to 0.6", round(shift.value, 1) == 0.6, shift, essential=False),
    ]
    sources = [run]
    why = f"q = {q}: the shift is {shift.value:.3f} per m, of which the area of an element makes log₁₀ 4 = 0.602"
    wide = next((other for other in given.runs("wide") if len(other.m) > 2), None)
    if wide is not None:
        low, high = wide.D[0], wide.D[-1]
        powers = mean_volume_exponents(wide, high) - mean_volume_exponents(wide, low)
        difference = mean("difference", f"q(D = {high:g}) - q(D = {low:g})", powers)
        text = f"q differs by the difference of D, {high - low:.1f}"
        checks.append(Check(text, difference.reaches(high - low), difference))
        sources.append(wide)
        why += f"; between D = {low:g} and {high:g} q changes by {difference.value:.2f}, not {high - low:.1f}"
    words = "mean volume of the open elements at m ="
    numbers = [mean(f"mean_volume_m{m}", f"{words} {m} [length³]", volume) for m, volume in volumes.items()]
    return Outcome(checks, f"{why}.", sources, numbers)


def mean_volume_exponents(run: ClaimRun, D: float) -> Array:
    """Return q of every surface from the mean volume over all elements, v̄ = V* σ δ²."""
    logs = []
    for m in run.m:
        mean_gap = run.last(V, D=D, m=m) * run.values("Sq", D=D, m=m)
        logs.append(np.log2(mean_gap * (run.L / 2**m) ** 2))
    return -np.array([slope(run.m, row) for row in np.array(logs).T])


@claim(23, needs=BY_M.of(V))
def volume_decays(given: Given) -> Outcome:
    """Fit a line to V* at the last step over m, for every surface.

    Essential: the paper's own sum, V/(L²σ) over (2^m + 1)² elements of side δ, decays (interval of the slope below 0);
    that sum covers more than L² and carries a factor (1 + 2^-m)² of its own. Other: the decay is still there
    without that factor, as a mean over the elements; and over the four finest m alone, where the factor has gone.
    """
    run = given.run()
    require(len(run.m) >= 3, "three m at least")
    pure = np.array([run.last(V, D=PAPER_D, m=m) for m in run.m])
    literal = pure * np.array([[(1.0 + 2.0**-m) ** 2] for m in run.m])
    fits = {
        "literal": (literal, run.m, "V/(L²σ), as printed"),
        "mean": (pure, run.m, "V* as a mean over elements"),
        "finest": (pure[-4:], run.m[-4:], "the same at the finest m alone"),
    }
    checks = []
    for key, (values, ms, words) in fits.items():
        number = mean(f"slope_{key}", f"change per m of {words}", [slope(ms, row) for row in values.T])
        checks.append(Check.below(f"{words} decays", number, 0.0, essential=key == "literal"))
    numbers = [mean(f"V_m{m}", f"V* at d = 0, m = {m}", row) for m, row in zip(run.m, pure, strict=True)]
    why = f"From m = {run.m[0]} to {run.m[-1]} the literal sum goes from {literal[0].mean():.3f} to "
    why += f"{literal[-1].mean():.3f}, the mean over elements from {pure[0].mean():.3f} to {pure[-1].mean():.3f}."
    return Outcome(checks, why, [run], numbers)
