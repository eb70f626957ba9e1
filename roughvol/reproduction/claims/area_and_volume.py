"""Claims about contact area, pressure and free volume (Section 3.1, Figs. 4 to 7, and the limits in Section 3.2)."""

from __future__ import annotations

import functools
import math
from itertools import pairwise

import numpy as np

from roughvol.observables.at_state import at_state
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.evidence import (
    D_SIGMA,
    A,
    Given,
    Outcome,
    P,
    V,
    area_slopes,
    at,
    claim,
    require,
    volumes,
)
from roughvol.reproduction.claims.statistics import exact, jackknife, mean, ratio, single, slope
from roughvol.reproduction.claims.verdict import Check, Number
from roughvol.reproduction.needs import BY_D, BY_M, MANY, PAPER_D
from roughvol.typing import Array, Index

EXPONENT, EXPONENT_ROUNDING = 0.37, 0.005  # Section 3.1, printed with two digits
FAIR = 0.10  # of Persson's exponent: the paper calls its own distance of 0.07 "fair good agreement"
SMALL = 0.02  # relative departure of V* from d/σ that a plot still shows as one line
CLEAR = 0.05  # and that no reader would take for one line


@claim(3, needs=BY_D.of(A, P))
def area_falls_with_D(given: Given) -> Outcome:
    """Compare A*/p*, the slope of the line through the origin over the pressures that all surfaces reach.

    Surfaces of equal seed are a matched pair. Met if the interval of the ratio of their slopes lies below 1 for every
    pair of neighbouring D; essential, because the sentence says "the larger". A* itself is compared at half and
    at the whole of the common range, where a line through the origin could hide a crossing.
    """
    run = given.run()
    m = max(run.m)
    slopes, limit = area_slopes(run, run.D, [m])
    checks = []
    for low, high in pairwise(run.D):
        name = f"A*/p* at D = {high:g} over that at {low:g} (p* ≤ {limit:.2f})"
        number = ratio(f"slope_{low:g}_{high:g}", name, slopes[high, m] / slopes[low, m])
        checks.append(Check.below(f"A*/p* falls from D = {low:g} to {high:g}", number, 1.0))
        for share in (0.5, 1.0):
            first, second = (_at_pressure(run, D, m, share * limit) for D in (low, high))
            name = f"A*(D = {high:g}) - A*(D = {low:g}) at p* = {share * limit:.2f}"
            number = mean(f"area_{low:g}_{high:g}_{share:g}", name, second - first)
            text = f"A* falls at p* = {share * limit:.2f} as well"
            checks.append(Check.below(text, number, 0.0, essential=share == 1.0))
    numbers = [mean(f"slope_D{D:g}", f"A*/p* at D = {D:g}, m = {m}", slopes[D, m]) for D in run.D]
    whole = float(np.exp(np.mean(np.log(slopes[run.D[-1], m] / slopes[run.D[0], m]))))
    why = f"At equal pressure A* at D = {run.D[-1]:g} is {whole:.2f} of that at D = {run.D[0]:g} (p* ≤ {limit:.2f})."
    return Outcome(checks, why, [run], numbers)


def _at_pressure(run: ClaimRun, D: float, m: int, pressure: float) -> Array:
    # the last state may be a rounding short of the pressure that defines the common range
    x, y = run.values(P, D=D, m=m), run.values(A, D=D, m=m)
    pressures = np.minimum(pressure, np.nanmax(x, axis=1))
    return np.array([at_state(p, a, at, straight=True)[0] for p, a, at in zip(x, y, pressures, strict=True)])


@claim(4, needs=BY_M.of(A, P))
def area_exponent(given: Given) -> Outcome:
    """Fit n, the slope of log(A*/p*) over log δ at the four finest m, for each surface; A*/p* as in Fig. 4b.

    Three questions. Does A*/p* fall with refinement: the interval of n lies above 0 (essential). Is it 0.37: the
    paper fits *one* surface, so 0.37 ± 0.005 must meet the interval in which one surface falls (essential). Is
    Persson's D - 2 a fair prediction: the mean n is within 0.10 of it (the paper calls 0.07 "fair good"; not
    essential, because it judges another theory). n over the two finest m is given beside it, to show the fit range.
    """
    run = given.run()
    powers, limit, used = exponents(run, PAPER_D, 4)
    name = f"n at m = {used[0]} to {used[-1]}, p* ≤ {limit:.2f}"
    number = mean("exponent", name, powers)
    one = single("exponent_single", f"{name}, where one more surface falls", powers)
    persson = exact("persson", "n - (D - 2)", number.value - (PAPER_D - 2.0), number.n)
    fair = abs(persson.value) <= FAIR
    checks = [
        Check.above("A*/p* falls with refinement: n > 0", number, 0.0),
        Check(f"one surface may give {EXPONENT}", one.reaches(EXPONENT, EXPONENT_ROUNDING), one),
        Check(f"n within {FAIR:g} of Persson's D - 2 = {PAPER_D - 2:.1f}", fair, persson, essential=False),
    ]
    finest, limit_2, used_2 = exponents(run, PAPER_D, 2)
    name = f"n at m = {used_2[0]} and {used_2[-1]} alone, p* ≤ {limit_2:.2f}"
    numbers = [mean("exponent_finest", name, finest), exact("exponent_seed0", "n of seed 0", powers[0])]
    alone = f"one surface may give {one.low:.2f} to {one.high:.2f}" if number.n > 1 else "from one surface"
    why = f"n = {number} over {number.n} surfaces at m = {used[0]} to {used[-1]} ({alone}), "
    why += f"{finest.mean():.2f} at the two finest."
    return Outcome(checks, why, [run], numbers)


def exponents(run: ClaimRun, D: float, finest: int) -> tuple[Array, float, list[int]]:
    """Return n of A*/p* ~ δ^n of every surface over the finest m, the largest pressure used, and these m."""
    used = run.m[-finest:]
    slopes, limit = area_slopes(run, [D], run.m)
    logs = np.log([slopes[D, m] for m in used])
    return np.array([slope(-np.array(used) * math.log(2.0), row) for row in logs.T]), limit, used


@claim(5, needs=BY_D.of(V, P, D_SIGMA, D=(2.1, 2.9)))
def separation_is_not_volume(given: Given) -> Outcome:
    """Take d as the rigid far-field separation: with that of the deformed mean plane V* = d/σ is an identity.

    "Holds" means a departure V*σ/d - 1 below 2 % (one line on paper) in the mean over surfaces at d/σ = 3, for
    the surfaces that have not lost contact there (those of small D begin below 3). "Cannot be confused" means a
    departure above 5 % at d/σ = 1, for each D, with the whole interval. "Depends on D" means that the interval of
    the matched difference of V* between the largest and the smallest D lies above 0 at d/σ = 1 and at 0.
    """
    run = given.run()
    m, ends = max(run.m), (run.D[0], run.D[-1])
    departure = {D: _departures(run, D, m, np.array([0.0, 0.5, 1.0, 2.0, 3.0])) for D in ends}
    checks, numbers = [], []
    for D in ends:
        far, near = departure[D][:, 4] / 3.0, departure[D][:, 2]
        number = mean(f"departure_3_D{D:g}", f"V*σ/d - 1 at d/σ = 3, D = {D:g}", far)
        if number.n:
            checks.append(Check(f"V* = d/σ within {SMALL:.0%} at d/σ = 3, D = {D:g}", number.value < SMALL, number))
        number = mean(f"departure_1_D{D:g}", f"V*σ/d - 1 at d/σ = 1, D = {D:g}", near)
        checks.append(Check.above(f"V* and d/σ differ by more than {CLEAR:.0%} at d/σ = 1, D = {D:g}", number, CLEAR))
        numbers.append(mean(f"V_at_0_D{D:g}", f"V* at d/σ = 0, D = {D:g}", departure[D][:, 0]))
        fits = [slope(x, y) for x, y in zip(run.values(P, D=D, m=m), _all_departures(run, D, m), strict=True)]
        numbers.append(mean(f"compliance_D{D:g}", f"slope of V* - d/σ over p*, D = {D:g}", fits))
        numbers.append(mean(f"onset_D{D:g}", f"d/σ where V* departs by {SMALL:.0%}, D = {D:g}", _onset(run, D, m)))
    for place, where in ((2, 1.0), (0, 0.0)):
        difference = departure[ends[1]][:, place] - departure[ends[0]][:, place]
        name = f"V*(D = {ends[1]:g}) - V*(D = {ends[0]:g}) at d/σ = {where:g}"
        number = mean(f"V_difference_{where:g}", name, difference)
        checks.append(Check.above(f"V* depends on D at d/σ = {where:g}", number, 0.0))
    onset = ", ".join(f"{n.value:.1f} (D = {D:g})" for D, n in zip(ends, numbers[2::3], strict=True))
    compliance = np.mean([n.value for n in numbers[1::3]])
    why = f"V* leaves d/σ by {SMALL:.0%} at d/σ = {onset}; below, V* - d/σ grows as {compliance:.2f} p* "
    why += "(0.946 p* for a uniformly loaded specimen)."
    return Outcome(checks, why, [run], numbers)


def _all_departures(run: ClaimRun, D: float, m: int) -> Array:
    return run.values(V, D=D, m=m) - run.values(D_SIGMA, D=D, m=m)


def _departures(run: ClaimRun, D: float, m: int, points: Array) -> Array:
    separation, excess = run.values(D_SIGMA, D=D, m=m), _all_departures(run, D, m)
    # the last separation is 0 to a rounding, and 0 is one of the points
    return at(np.where(np.abs(separation) < 1e-9, 0.0, separation), excess, points)


def _onset(run: ClaimRun, D: float, m: int) -> Array:
    """Return d/σ of each surface at which V* - d/σ grows beyond `SMALL` of d/σ."""
    separation, excess = run.values(D_SIGMA, D=D, m=m), _all_departures(run, D, m)
    masks = excess > SMALL * separation
    return np.array(
        [row[mask.argmax()] if mask.any() else math.nan for row, mask in zip(separation, masks, strict=True)]
    )


def width(curves: Array, seeds: Index) -> float:
    """Return the width of the band that the means over surfaces fill, over their middle, averaged along the axis."""
    means = curves[:, seeds].mean(axis=1)
    return float(np.mean((means.max(axis=0) - means.min(axis=0)) / means.mean(axis=0)))


def _over_scatter(curves: Array, seeds: Index) -> float:
    """Return that width over the scatter of surfaces of one kind: ± one standard deviation, averaged along the axis."""
    if seeds.size < 2:
        return math.nan
    chosen = curves[:, seeds]
    scatter = float(np.mean(2.0 * chosen.std(axis=1, ddof=1).mean(axis=0) / chosen.mean(axis=(0, 1))))
    return width(curves, seeds) / scatter if scatter > 0.0 else math.nan


def _bands(curves: Array, axis: str, seeds: int) -> tuple[Number, Number]:
    """Return the band between the mean curves, and the band over the scatter of surfaces, with their intervals."""
    require(seeds >= 2, "several surfaces of each D")
    wide = jackknife("band", f"width of the band in V*({axis})", functools.partial(width, curves), seeds)
    name = "band between D over scatter of surfaces"
    return wide, jackknife("band_over_scatter", name, functools.partial(_over_scatter, curves), seeds)


@claim(6, needs=BY_D.of(V, P))
def volume_at_pressure(given: Given) -> Outcome:
    """Measure the band between the lowest and the highest mean curve, over the mean, averaged along p*.

    The natural unit for "significantly" is the scatter between surfaces of one D (± one standard deviation): a band
    wider than that is seen through the scatter. Met if the interval of band/scatter lies above 1 (essential).
    That V* rises with D at equal p* must hold, at the middle and at the end of the common range, for every pair of
    neighbouring D (interval of the matched difference above 0; essential at the end).
    """
    run = given.run()
    m = max(run.m)
    curves, grid = volumes(run, P, [(D, m) for D in run.D])
    wide, relative = _bands(curves, "p*", run.seeds)
    checks = [Check.above("the band is wider than the scatter of surfaces", relative, 1.0)]
    for k, (low, high) in enumerate(pairwise(run.D)):
        for place in (len(grid) // 2, len(grid) - 1):
            name = f"V*(D = {high:g}) - V*(D = {low:g}) at p* = {grid[place]:.2f}"
            number = mean(f"rise_{low:g}_{high:g}_{place}", name, curves[k + 1, :, place] - curves[k, :, place])
            text = f"V* rises from D = {low:g} to {high:g} at p* = {grid[place]:.2f}"
            checks.append(Check.above(text, number, 0.0, essential=place == len(grid) - 1))
    why = f"The mean curves span {wide.value:.0%} of V*, {relative.value:.1f} times the scatter between surfaces."
    return Outcome(checks, why, [run], [wide])


@claim(7, needs={"": BY_D.of(V, A, P), "many": MANY.of(V, A, P, by="D", optional=True)})
def volume_at_area(given: Given) -> Outcome:
    """Measure the band of claim 6 along A*, over the areas that all surfaces reach.

    "Relatively narrow": narrower than the band of V*(p*) of the same surfaces, the whole interval of the
    ratio below 1 (essential). "Almost independent": not wider than the scatter (± one standard deviation) of surfaces
    of one D, the whole interval of band/scatter below 1 (essential: what is wider than the scatter is a dependence).
    A run of more surfaces, where there is one, is asked the same at its finest m (other: it is not the paper's m = 8).
    """
    run = given.run()
    finest = [(D, max(run.m)) for D in run.D]
    along_area, grid = volumes(run, A, finest)
    along_pressure, _ = volumes(run, P, finest)
    wide, relative = _bands(along_area, "A*", run.seeds)
    name = "band in V*(A*) over band in V*(p*)"

    def ratio_of_widths(seeds: Index) -> float:
        return width(along_area, seeds) / width(along_pressure, seeds)

    narrowing = jackknife("band_area_over_pressure", name, ratio_of_widths, run.seeds)
    means = along_area.mean(axis=1)
    numbers = [wide]
    for key, k in (("first", 0), ("last", -1)):
        value = (means[:, k].max() - means[:, k].min()) / means[:, k].mean()
        numbers.append(exact(f"band_at_{key}", f"band at A* = {grid[k]:.4f}", value, run.seeds))
    checks = [
        Check.below("narrower than the band in V*(p*)", narrowing, 1.0),
        Check.below("not wider than the scatter of surfaces of one D", relative, 1.0),
    ]
    sources = [run]
    larger = [other for other in given.runs("many") if other.seeds > run.seeds and len(other.D) > 2]
    if larger:
        many = larger[0]
        curves, _ = volumes(many, A, [(D, max(many.m)) for D in many.D])
        dimensions = ", ".join(f"{D:g}" for D in many.D)
        name = f"the same of {many.seeds} surfaces, D = {dimensions}, m = {max(many.m)}"
        of_many = jackknife("band_over_scatter_many", name, functools.partial(_over_scatter, curves), many.seeds)
        checks.append(Check.below(f"the same with {many.seeds} surfaces of each D", of_many, 1.0, essential=False))
        sources.append(many)
    why = f"The band is {wide.value:.0%} of V* wide, {narrowing.value:.2f} of that in V*(p*) and "
    return Outcome(checks, f"{why}{relative.value:.2f} of the scatter between surfaces.", sources, numbers)
