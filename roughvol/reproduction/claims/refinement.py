"""Claims about the effect of m on V* (Section 3.1, Fig. 7) and about the two ends of the loading (Section 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.area_and_volume import SMALL
from roughvol.reproduction.claims.evidence import D_SIGMA, A, Given, Outcome, P, V, claim, require, volumes
from roughvol.reproduction.claims.statistics import exact, mean, slope
from roughvol.reproduction.claims.verdict import Check, Number
from roughvol.reproduction.needs import BY_M, PAPER_D, PRESSED
from roughvol.typing import Array


@claim(8, needs=BY_M.of(V, P))
def volume_converges(given: Given) -> Outcome:
    """Follow e(m), the mean change of V* at equal p* from m - 1 to m of one surface, over V*, along the common range.

    Converging means that e falls: the slope of log e over m, for each surface, is below 0 with its whole interval
    (essential). A "single curve" is one that a plot shows as one: e at the finest m below 2 % (interval; other).
    """
    run = given.run()
    changes, rates = steps_in_m(run, P)
    rate = mean("rate", "slope of log₂ of the change over m", rates)
    require(len(changes) >= 2, "three m at least")
    final = changes[-1]
    checks = [
        Check.below("the changes fall with m", rate, 0.0),
        Check.below(f"the last change is below {SMALL:.0%}", final, SMALL, essential=False),
    ]
    why = f"V* at equal p* changes by {final.value:.1%} from m = {run.m[-2]} to {run.m[-1]}, and each change is "
    return Outcome(checks, f"{why}{2**rate.value:.2f} of the one before.", [run], changes[:-1])


def steps_in_m(run: ClaimRun, x: str) -> tuple[list[Number], Array]:
    """Return the relative change of V* at equal x for each step in m, and the rate of each surface (log₂ per m)."""
    sizes = [np.mean(np.abs(change), axis=1) for change in _changes(run, x, run.m)]
    numbers = [_number(coarse, fine, x, size) for (coarse, fine), size in zip(pairwise(run.m), sizes, strict=True)]
    middle = np.array(run.m[1:], dtype=float)
    return numbers, np.array([slope(middle, np.log2(row)) for row in np.array(sizes).T])


def _changes(run: ClaimRun, x: str, levels: Sequence[int]) -> list[Array]:
    """Return the relative change of V* at equal x, shape (surfaces, points), from each m to the next."""
    curves, _ = volumes(run, x, [(PAPER_D, m) for m in levels])
    return [(fine - coarse) / fine for coarse, fine in pairwise(curves)]


def _number(coarse: int, fine: int, x: str, changes: Array) -> Number:
    axis = "p*" if x == P else "A*"
    return mean(f"change_{fine}", f"change of V* at equal {axis}, m = {coarse} to {fine}", changes)


@claim(9, needs=BY_M.of(V, A, P))
def volume_at_area_depends_on_m(given: Given) -> Outcome:
    """Take the changes of claim 8 at equal A*, with their sign, and beside those at equal p*.

    Met if V* falls from m to m + 1 for the finest pair (interval below 0; essential), and if that change is larger
    than the one at equal p*, where the paper sees convergence (whole interval of the matched difference; essential).
    That it does not converge, the change at the finest pair being at least half of that two levels before (interval of
    the matched ratio above 0.5), is the adverb "strongly".
    """
    run = given.run()
    require(len(run.m) >= 4, "four m at least")
    signed = [np.mean(change, axis=1) for change in _changes(run, A, run.m[-4:])]
    numbers = [
        _number(coarse, fine, A, size) for (coarse, fine), size in zip(pairwise(run.m[-4:]), signed, strict=True)
    ]
    at_pressure = np.mean(np.abs(_changes(run, P, run.m[-2:])[0]), axis=1)
    name = "size of the change at equal A* less that at equal p*"
    more = mean("area_minus_pressure", name, -signed[-1] - at_pressure)
    keeps = mean("persistence", f"change to m = {run.m[-1]} over that to m = {run.m[-3]}", signed[-1] / signed[0])
    checks = [
        Check.below(f"V* at equal A* falls from m = {run.m[-2]} to {run.m[-1]}", numbers[-1], 0.0),
        Check.above("by more than at equal p*", more, 0.0),
        Check.above("the change does not die out with m", keeps, 0.5, essential=False),
    ]
    why = f"V* at equal A* still falls by {-numbers[-1].value:.0%} from m = {run.m[-2]} to {run.m[-1]} "
    why += f"({np.mean(at_pressure):.1%} at equal p*)."
    return Outcome(checks, why, [run], numbers[:-1])


@claim(
    10,
    needs={
        "pressed": PRESSED.of(V, A, P, D=(PAPER_D,), law=""),
        "far": PRESSED.of(V, A, P, D=(2.1, 2.3, 2.9), separation=-10.0),
    },
)
def limits(given: Given) -> Outcome:
    """Check monotony on every step of every surface of every run that fits, and full contact by going there.

    A step may go the wrong way by what its residual allows: V* and p* by 10⁻⁵, A* by two elements. At the first
    step A* must be below a tenth of its largest value (it is 0 at first touch itself, before the first step). Full
    contact is A* = 1 exactly and V* below 10⁻⁵, on surfaces pressed until then.
    """
    given.run("pressed")
    runs = sorted(given.runs("pressed"), key=lambda run: run.law != "std")
    wrong, steps = 0, 0
    for run in runs:
        for D in run.D:
            for m in run.m:
                v, a, p = (np.diff(run.values(name, D=D, m=m), axis=1) for name in (V, A, P))
                bad = (v > 1e-5) | (p < -1e-5) | (a < -2.5 / (2**m + 1) ** 2)
                wrong, steps = wrong + int(bad.sum()), steps + bad.size
    number = exact("wrong_steps", f"steps of {steps} that go the wrong way", wrong)
    checks = [Check("V* falls, A* and p* rise at every step", wrong == 0, number)]
    paced = [run for run in runs if run.end == "mean-plane"]  # a coarse sweep to full contact starts with a large step
    starts = [run.values(A, D=D, m=max(run.m))[:, 0] / run.last(A, D=D, m=max(run.m)) for run in paced for D in run.D]
    require(starts, "a sweep to the mean plane")
    start = exact("start", "largest A* of a first step over that of the last", float(np.max(np.concatenate(starts))))
    checks.append(Check("A* starts near 0 and V* is largest there", start.value < 0.1, start))
    # the run that was pressed furthest, whatever its end is called
    given.run("far")
    full = max(given.runs("far"), key=lambda run: min(float(run.last(A, D=D, m=max(run.m)).min()) for D in run.D))
    m = max(full.m)
    area = min(float(full.last(A, D=D, m=m).min()) for D in full.D)
    volume = max(float(full.last(V, D=D, m=m).max()) for D in full.D)
    last = exact("full_area", f"smallest A* at the end (m = {m})", area, full.seeds)
    rest = exact("full_volume", f"largest V* at the end (m = {m})", volume, full.seeds)
    checks += [Check("A* = 1 is reached", area == 1.0, last), Check("V* vanishes there", volume < 1e-5, rest)]
    numbers = []
    for D in full.D:
        closed = (full.values(A, D=D, m=m) == 1.0).argmax(axis=1)[:, np.newaxis]
        for key, name, variable in (("full_pressure", "p*", P), ("full_separation", "d/σ", D_SIGMA)):
            values = np.take_along_axis(full.values(variable, D=D, m=m), closed, axis=1)
            numbers.append(mean(f"{key}_D{D:g}", f"{name} of the first step at A* = 1, D = {D:g}, m = {m}", values))
    why = f"{steps - wrong} of {steps} steps are monotonous, and V* is {volume:.1g} at A* = {area:g}."
    return Outcome(checks, why, [*runs, full], numbers)
