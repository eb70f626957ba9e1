"""Claims about the theories of the free volume: the bearing area (Eq. 4) and the box dimension (Eqs. 5 to 11)."""

from __future__ import annotations

import numpy as np

from roughvol.gap import box_counting
from roughvol.gap.free_volume import domain
from roughvol.reproduction.claims.evidence import D_SIGMA, A, Given, Outcome, V, claim
from roughvol.reproduction.claims.shape import Field, field
from roughvol.reproduction.claims.statistics import exact, mean, slope
from roughvol.reproduction.claims.verdict import Check, Number
from roughvol.reproduction.formulas import bearing_area_volume, volume_from_dimension
from roughvol.reproduction.needs import FIELD, ONE_D, PAPER_D
from roughvol.typing import Array, Mask

BINS = (25, 50, 100, 200, 400)  # K of Eq. 9 to 11
CLOSE = 0.10  # relative difference from the computed V* up to which a formula gives an estimate
LINEAR = 0.05  # departure from a line over the range, which no reader would overlook


@claim(17, needs=ONE_D.of(V, A, D_SIGMA))
def bearing_area(given: Given) -> Outcome:
    """Evaluate Eq. 4 along the loading, at the computed d/σ and A* of every step.

    It must decay (essential). Linear: the largest departure of V*(A*) of Eq. 4 (Gaussian) from its least-squares line
    is below 5 % of its range (essential; the factor 1 - A* is linear, the integral moves with d as well). Not quite
    linear: the computed V*(A*) departs by more than that (essential). An estimate: at d = 0 Eq. 4 as printed, with the
    heights' own distribution, is within 10 % of the computed V* (other). The factor (1 - A*) counts the open elements a
    second time, so the form without it is given too.
    """
    run = given.run()
    D, m = PAPER_D, max(run.m)
    separation, area, volume = (run.values(name, D=D, m=m) for name in (D_SIGMA, A, V))
    gauss = bearing_area_volume(separation)
    gauss_printed = bearing_area_volume(separation, "gaussian", area)
    heights = [run.surface(D, m, seed).heights for seed in run.seed_numbers()]
    own = np.array([bearing_area_volume(d, z) for d, z in zip(separation[:, -1], heights, strict=True)])
    own_printed = own * (1.0 - area[:, -1])
    ends = {
        "gauss_printed": ("Gaussian heights, as printed", gauss_printed[:, -1]),
        "gauss_without": ("Gaussian heights, without 1 - A*", gauss[:, -1]),
        "own_printed": ("own heights, as printed", own_printed),
        "own_without": ("own heights, without 1 - A*", own),
    }
    numbers = {
        key: mean(key, f"V* of Eq. 4 at the last step, {words}", values) for key, (words, values) in ends.items()
    }
    computed = mean("computed", "computed V* at the last step", volume[:, -1])
    rises = exact("rises", "steps at which it rises", int((np.diff(gauss_printed, axis=1) > 0.0).sum()))
    bend_theory = mean("bend_eq4", "largest departure of Eq. 4 from a line in A*", _bends(area, gauss_printed))
    bend_computed = mean("bend_computed", "the same of the computed V*(A*)", _bends(area, volume))
    off = mean("off", "Eq. 4 as printed (own heights) over the computed V*, less 1", own_printed / volume[:, -1] - 1.0)
    is_close = abs(off.value) <= CLOSE
    checks = [
        Check("Eq. 4 decays with A*", rises.value == 0, rises),
        Check(f"it is linear in A* within {LINEAR:.0%}", bend_theory.value < LINEAR, bend_theory),
        Check(f"the computed V*(A*) is not ({LINEAR:.0%})", bend_computed.value > LINEAR, bend_computed),
        Check(f"within {CLOSE:.0%} of the computed V* at the last step", is_close, off, essential=False),
    ]
    printed = numbers["own_printed"].value
    why = f"Eq. 4 bends by {bend_theory.value:.0%} of its range (the integral moves with d as well), and at d = 0 it "
    why += f"gives {printed:.2f} where {computed.value:.2f} is computed: it knows no elastic displacement."
    return Outcome(checks, why, [run], [*numbers.values(), computed])


def _bends(x: Array, y: Array) -> list[float]:
    """Return the largest departure of y from its least-squares line over the range of y, for each surface."""
    return [_bend(*curve) for curve in zip(x, y, strict=True)]


def _bend(x: Array, y: Array) -> float:
    rest = y - y.mean() - slope(x, y) * (x - x.mean())
    return float(np.abs(rest).max() / np.ptp(y))


@claim(18, needs=FIELD)
def volume_of_dimension(given: Given) -> Outcome:
    """Take the dimensions of the domains at K + 1 thresholds from box counts of the recorded field; l = L.

    The paper's D depends on r and v_th; its mean over r = 1 … 2^m is log N(1)/log 2^m, which with l = L gives the
    counts back exactly. Essential: with these, and with each element of a bin counted at the volume of the bin, the sum
    is within 10 % of the computed V* at K = 50. Other: the printed sum, which counts each element at the *width* of
    its bin, is within 10 % as well; it changes by less than 5 % when K doubles (a sum that stands for an integral
    must); and one dimension fitted over all r does as well as the mean (it must if N(r) is a power law).
    """
    run = given.run()
    state = field(run)
    volume = state.numbers[V]
    counted, printed, fitted = (dict(zip(BINS, estimates(state, *kind), strict=True)) for kind in KINDS)
    sum_ = exact("sum", "Σ n_k v_k over the computed V*, K = 50", counted[50] / volume)
    as_printed = exact("printed", "the printed sum over the computed V*, K = 50", printed[50] / volume)
    one = exact("fitted", "Σ n_k v_k with one fitted dimension over V*, K = 50", fitted[50] / volume)
    change = exact("doubling", "change of the printed sum from K = 100 to 200", abs(printed[200] / printed[100] - 1.0))
    limit = "the printed sum has a limit (changes by less than 5 % when K doubles)"
    checks = [
        Check(f"Σ n_k v_k within {CLOSE:.0%} of V*", close(sum_), sum_),
        Check(f"the printed sum within {CLOSE:.0%} of V*", close(as_printed), as_printed, essential=False),
        Check(limit, change.value < 0.05, change, essential=False),
        Check(f"one fitted dimension per domain does as well ({CLOSE:.0%})", close(one), one, essential=False),
    ]
    numbers = [exact(f"printed_{K}", f"V* of the printed sum, K = {K}", value) for K, value in printed.items()]
    why = f"Counting each element at the volume of its bin gives {sum_.value:.3f} of V*; the printed sum counts it at "
    why += f"the width of the bin, gives {as_printed.value:.3f} at K = 50 and falls as 1/K."
    return Outcome(checks, why, [run], numbers)


KINDS = (("mean", "volume"), ("mean", "width"), ("fit", "volume"))


def close(number: Number) -> bool:
    """Return whether an estimate over the computed V* is near 1."""
    return abs(number.value - 1.0) <= CLOSE


def estimates(state: Field, kind: str, weight: str) -> list[float]:
    """Return V* of Eqs. 7 to 10 for each K of `BINS`: mean local dimension, log N(1)/log 2^m, or a "fit" over all r."""
    side = 1 << (min(state.volumes.shape).bit_length() - 1)
    spacing = state.numbers["spacing"]
    volumes, contact = state.volumes[:side, :side], state.contact[:side, :side]
    size = {"length": side * spacing, "spacing": spacing, "Sq": state.numbers["Sq"], "area": (side * spacing) ** 2}
    sums = []
    for K in BINS:
        edges = np.linspace(0.0, float(volumes.max()), K + 1)
        dimensions = np.array([_dimension(domain(volumes, edge, contact), kind) for edge in edges])
        sums.append(volume_from_dimension(edges, dimensions, weight=weight, **size))
    return sums


def _dimension(mask: Mask, kind: str) -> float:
    counts = box_counting.box_counts(mask)
    if kind == "mean":
        return float(np.log(counts.counts[0]) / np.log(counts.r[-1]))
    return -slope(np.log(counts.r), np.log(counts.counts))
