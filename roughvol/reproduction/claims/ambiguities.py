"""The ambiguous passages of the paper: each reading computed, and beside it the number the paper gives, if any.

A row *agrees* if the interval in which one more surface falls contains the paper's number to its last digit (where the
paper shows one surface), or if the criterion of the claim concerned is met under it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from roughvol.report.figures.cases import nearest
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.area_and_volume import EXPONENT, EXPONENT_ROUNDING, exponents
from roughvol.reproduction.claims.density import EDGES, FULCRUM, F, densities, fulcrum, moments, values_by_D
from roughvol.reproduction.claims.evidence import D_SIGMA, TEXTS, A, Evidence, Lacking, P, V, at
from roughvol.reproduction.claims.shape import REACHED, field
from roughvol.reproduction.claims.statistics import exact, jackknife, mean, single, slope
from roughvol.reproduction.claims.verdict import Number, Reading, Row, above, below
from roughvol.reproduction.claims.volume_formulas import BINS, KINDS, close, estimates
from roughvol.reproduction.needs import BY_D, BY_M, DENSITY, FIELD, ONE_D, PAPER_A, PAPER_D, PAPER_M

SMALL_AMPLITUDE = (0.09**-0.25) / (0.09**-0.5)  # initial variance 1/√0.09, over the default standard deviation 1/√0.09
SMALL = f"initial standard deviation {SMALL_AMPLITUDE / 0.3:.3f}"

_DENSITY_BY_D = BY_D.of(F, EDGES, finest=PAPER_M, m=(PAPER_M,), **DENSITY)
_DENSITY_BY_M = BY_M.of(F, EDGES, m=(5, 6, 7), **DENSITY)
_BY_VARIANCE = replace(_DENSITY_BY_D, law="variance")
_TO_SUMMITS = replace(_DENSITY_BY_D, end="summit-plane")
SERVES = (  # every configuration that a reading asks for
    *(BY_M.of(A, P, law=law) for law in ("std", "variance")),
    *(replace(_DENSITY_BY_M, law=law) for law in ("std", "variance")),
    replace(_DENSITY_BY_M, end="summit-plane"),
    *(_DENSITY_BY_D, _BY_VARIANCE, _TO_SUMMITS),
    *(ONE_D.of(A, finest=PAPER_M, m=(PAPER_M,), end=end) for end in ("mean-plane", "summit-plane")),
    *(BY_M.of(V), ONE_D.of(P), ONE_D.of(V, D_SIGMA), FIELD),
)


def readings(evidence: Evidence) -> list[Reading]:
    """Return every ambiguity for which at least one reading was computed."""
    found = []
    for rows in (_law, _amplitude, _fulcrum, _plane, _counting, _modulus, _separation, _sums):
        with contextlib.suppress(Lacking):
            text = TEXTS["reading"][rows.__name__.removeprefix("_")]
            found.append(Reading(**text, rows=tuple(rows(evidence))))
    return [reading for reading in found if reading.rows]


def _law(evidence: Evidence) -> Iterator[Row]:
    laws = {"std": "standard deviation divided (default)", "variance": "variance divided, as printed"}
    for law, words in laws.items():
        for run in evidence.fit(BY_M.of(A, P, law=law))[:1]:
            for text, number in _exponents_of_law(run, law):
                yield Row(f"{words}; {text}", number, number.reaches(EXPONENT, EXPONENT_ROUNDING))


def _exponents_of_law(run: ClaimRun, law: str) -> Iterator[tuple[str, Number]]:
    """Yield n over four and two m, and n of the area over L², each with words."""
    for finest in (4, 2):
        powers, _, used = exponents(run, PAPER_D, finest)
        span = f"m = {used[0]} to {used[-1]}"
        yield span, single(f"n_{law}_{finest}", f"n, {law} law, {span}", powers)
    powers, _, used = exponents(run, PAPER_D, 4)
    log_spacing = -np.array(used) * np.log(2.0)
    log_area = [np.log((1.0 + 2.0**-m) ** 2) for m in used]  # of all elements over L²
    shifted = powers + slope(log_spacing, log_area)
    yield "area over L² instead of elements", single(f"n_{law}_L2", f"n, {law} law, area over L²", shifted)


def _amplitude(evidence: Evidence) -> Iterator[Row]:
    sources = (
        ("std", "mean-plane", "std law, initial standard deviation 3.333 (default)", 1.0),
        ("std", "mean-plane", f"std law, {SMALL}", SMALL_AMPLITUDE),
        ("variance", "mean-plane", "variance law, initial variance 3.333", 1.0),
        ("std", "summit-plane", "std law, to the plane of the summits", 1.0),
        ("std", "summit-plane", f"std law, to the plane of the summits, {SMALL}", SMALL_AMPLITUDE),
    )
    for law, end, words, scale in sources:
        for run in evidence.fit(replace(_DENSITY_BY_M, law=law, end=end))[:1]:
            volumes = moments(run, PAPER_D)
            for m, paper in ((5, 8.0), (6, 8.0), (7, 2.0)):
                if m in volumes:
                    number = single(f"v_{law}_{end}_{scale:.2f}_{m}", f"v̄ at m = {m}", scale * volumes[m][0])
                    yield Row(f"{words}; m = {m}", number, number.reaches(paper, 0.5) if m > 5 else None)


def _fulcrum(evidence: Evidence) -> Iterator[Row]:
    std = "std law, initial standard deviation 3.333, open elements (default)"
    variance = "variance law, initial variance 3.333"
    summits = "to the plane of the summits"
    sources = (  # configuration, words, key, factor of the volumes, largest D
        (_DENSITY_BY_D, std, "default", 1.0, 3.0),
        (_DENSITY_BY_D, "the same, contact elements counted", "contact", 1.0, 3.0),
        (_DENSITY_BY_D, SMALL, "amplitude", SMALL_AMPLITUDE, 3.0),
        (_DENSITY_BY_D, f"{SMALL}, D ≤ 2.5", "amplitude_25", SMALL_AMPLITUDE, 2.51),
        (_DENSITY_BY_D, "D ≤ 2.5 only", "D25", 1.0, 2.51),
        (_BY_VARIANCE, variance, "variance", 1.0, 3.0),
        (_BY_VARIANCE, f"{variance}, D ≤ 2.5", "variance_25", 1.0, 2.51),
        (_TO_SUMMITS, summits, "summits", 1.0, 3.0),
        (_TO_SUMMITS, f"{summits}, D ≤ 2.5", "summits_25", 1.0, 2.51),
        (_TO_SUMMITS, f"{summits}, {SMALL}", "summits_amplitude", SMALL_AMPLITUDE, 3.0),
    )
    for needs, words, key, scale, largest in sources:
        for run in evidence.fit(needs)[:1]:
            number = _spread_at_one(run, key, scale, largest)
            yield Row(words, number, number.value < FULCRUM)


def _spread_at_one(run: ClaimRun, key: str, scale: float, largest: float) -> Number:
    """Return the spread of f(1) over D up to the largest, of volumes times a scale."""
    m = int(nearest(run.m, PAPER_M))
    data = {D: densities(run, D, m) for D in run.D if largest >= D}
    if key == "contact":
        # contact in: f falls by the share of open elements outside the first bin (v = 1 is not in it)
        data = {D: (f * (1.0 - run.last(A, D=D, m=m))[:, np.newaxis], edges) for D, (f, edges) in data.items()}
    at_one = values_by_D(data, 1.0, scale)
    return jackknife(key, "spread of f(1) over D", lambda seeds: fulcrum(at_one[:, seeds]), run.seeds)


def _plane(evidence: Evidence) -> Iterator[Row]:
    planes = {"mean-plane": "to the mean plane (default)", "summit-plane": "to the mean plane of the summits"}
    for end, words in planes.items():
        for run in evidence.fit(ONE_D.of(A, finest=PAPER_M, m=(PAPER_M,), end=end))[:1]:
            m = int(nearest(run.m, PAPER_M))
            area = run.last(A, D=PAPER_D, m=m)
            whole = area * (1.0 + 2.0**-m) ** 2
            for key, counted, values in (("elements", "share of elements", area), ("L2", "area over L²", whole)):
                number = single(f"{end}_{key}", f"A* at the end, m = {m}", values)
                yield Row(f"{words}; {counted}", number, number.high >= PAPER_A - REACHED)
            separation = np.round(run.last(D_SIGMA, D=PAPER_D, m=m), 9) + 0.0
            yield Row(f"{words}; d/σ there", single(f"{end}_d", f"d/σ at the end, m = {m}", separation))


def _counting(evidence: Evidence) -> Iterator[Row]:
    for run in evidence.fit(BY_M.of(V))[:1]:
        values = np.array([run.last(V, D=PAPER_D, m=m) for m in run.m])
        factor = np.array([[(1.0 + 2.0**-m) ** 2] for m in run.m])
        literal = ("sum", "V/(L²σ), the literal sum", values * factor)
        for key, words, volumes in (("mean", "mean over the elements (default)", values), literal):
            slopes = [slope(run.m, row) for row in volumes.T]
            change = mean(f"slope_{key}", "change of V* at d = 0 per m", slopes)
            yield Row(f"{words}; m = {run.m[0]} to {run.m[-1]}", change, below(change, 0.0))
            for m, volume in ((run.m[0], volumes[0]), (run.m[-1], volumes[-1])):
                number = mean(f"{key}_m{m}", f"V* at d = 0, m = {m}", volume)
                yield Row(f"{words}; V* at d = 0, m = {m}", number)


def _modulus(evidence: Evidence) -> Iterator[Row]:
    run = evidence.best(ONE_D.of(P))
    m = max(run.m)
    pressure = run.last(P, D=PAPER_D, m=m)
    yield Row("E* = E/(1-ν²) (default)", mean("E_star", f"p* at d = 0, m = {m}", pressure))
    for nu in (0.3, 0.5):
        number = mean(f"E_{nu}", f"p* at d = 0, m = {m}", pressure / (1.0 - nu**2))
        yield Row(f"E, with ν = {nu:g}", number)


def _separation(evidence: Evidence) -> Iterator[Row]:
    run = evidence.best(ONE_D.of(V, D_SIGMA))
    m = max(run.m)
    d, v = run.values(D_SIGMA, D=PAPER_D, m=m), run.values(V, D=PAPER_D, m=m)
    rigid = mean("rigid", "V*σ/d - 1 at d/σ = 1", at(d, v - d, np.array([1.0])))
    deformed = exact("deformed", "V*σ/d - 1 at d/σ = 1", 0.0, run.seeds)
    yield Row("rigid far-field separation (default)", rigid, above(rigid, 0.05))
    yield Row("separation of the deformed mean planes (V* = d/σ is then an identity)", deformed, False)


def _sums(evidence: Evidence) -> Iterator[Row]:
    state = field(evidence.best(FIELD))
    words = {
        ("mean", "width"): "as printed, Σ n_k Δv_k",
        ("mean", "volume"): "Σ n_k v_k, the volume of an element of the bin",
        ("fit", "volume"): "Σ n_k v_k with one fitted dimension for each domain",
    }
    for kind, weight in KINDS:
        sums = estimates(state, kind, weight)
        for k in (1, 3):
            name = f"V* over the computed one, K = {BINS[k]}"
            number = exact(f"{kind}_{weight}_{BINS[k]}", name, sums[k] / state.numbers[V])
            yield Row(f"{words[kind, weight]}; K = {BINS[k]}", number, close(number))
