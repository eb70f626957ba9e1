"""The ambiguous passages of the paper: each reading computed, and beside it the number the paper gives, if any.

A row *agrees* if the interval in which one more surface falls contains the paper's number to its last digit (where the
paper shows one surface), or if the criterion of the claim concerned is met under it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from roughvol.analysis.stored_run import Run
from roughvol.report.figures.cases import nearest
from roughvol.reproduction.claims.area_and_volume import EXPONENT, EXPONENT_ROUNDING, exponents
from roughvol.reproduction.claims.density import EDGES, FULCRUM, F, densities, fulcrum, moments
from roughvol.reproduction.claims.evidence import D_SIGMA, A, Evidence, Lacking, P, V, at
from roughvol.reproduction.claims.needs import BY_D, BY_M, DENSITY, FIELD, ONE_D
from roughvol.reproduction.claims.shape import REACHED, field
from roughvol.reproduction.claims.statistics import bootstrap, exact, mean, single, slope
from roughvol.reproduction.claims.verdict import Number, Reading, Row, above, below
from roughvol.reproduction.claims.volume_formulas import BINS, KINDS, close, estimates
from roughvol.reproduction.paper_rules import PAPER_A, PAPER_D, PAPER_M

SMALL_AMPLITUDE = (0.09**-0.25) / (0.09**-0.5)  # initial variance 1/√0.09, over the default standard deviation 1/√0.09
SMALL = f"initial standard deviation {SMALL_AMPLITUDE / 0.3:.3f}"

_DENSITY_BY_D = BY_D.of(F, EDGES, finest=PAPER_M, m=(PAPER_M,), **DENSITY)
_DENSITY_BY_M = BY_M.of(F, EDGES, m=(5, 6, 7), **DENSITY)
SERVES = (  # every configuration that a reading asks for
    *(BY_M.of(A, P, law=law) for law in ("std", "variance")),
    *(_DENSITY_BY_M.of(F, EDGES, law=law) for law in ("std", "variance")),
    _DENSITY_BY_M.of(F, EDGES, ends=("summit-plane",)),
    *(_DENSITY_BY_D.of(F, EDGES, law=law) for law in ("std", "variance")),
    _DENSITY_BY_D.of(F, EDGES, ends=("summit-plane",)),
    *(ONE_D.of(A, finest=PAPER_M, m=(PAPER_M,), ends=(end,)) for end in ("mean-plane", "summit-plane")),
    BY_M.of(V),
    ONE_D.of(P),
    ONE_D.of(V, D_SIGMA),
    FIELD,
)


def readings(evidence: Evidence) -> list[Reading]:
    """Return every ambiguity for which at least one reading was computed."""
    answers = []
    for ask in (_law, _amplitude, _fulcrum, _plane, _counting, _modulus, _separation, _sums):
        with contextlib.suppress(Lacking):
            answers.append(ask(evidence))
    return [reading for reading in answers if reading.rows]


def _law(evidence: Evidence) -> Reading:
    laws = {"std": "standard deviation divided (default)", "variance": "variance divided, as printed"}
    rows = []
    for law, words in laws.items():
        runs = evidence.fit(BY_M.of(A, P, law=law))
        if not runs:
            continue
        for text, number in _exponents_of_law(runs[0], law):
            rows.append(Row(f"{words}; {text}", number, number.reaches(EXPONENT, EXPONENT_ROUNDING)))
    return Reading(
        "Midpoint law",
        "Sec. 2: “variance σ₁² = σ₀²/2^((3-D)/2)”",
        "exponent n of A*/p* ~ δ^n, D = 2.3, one surface",
        "0.37",
        tuple(rows),
        "The factor divides the standard deviation: only then is the Hurst exponent 3 - D.",
    )


def _exponents_of_law(run: Run, law: str) -> Iterator[tuple[str, Number]]:
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


def _amplitude(evidence: Evidence) -> Reading:
    rows = []
    sources = (
        ("std", "mean-plane", "std law, initial standard deviation 3.333 (default)", 1.0),
        ("std", "mean-plane", f"std law, {SMALL}", SMALL_AMPLITUDE),
        ("variance", "mean-plane", "variance law, initial variance 3.333", 1.0),
        ("std", "summit-plane", "std law, to the plane of the summits", 1.0),
        ("std", "summit-plane", f"std law, to the plane of the summits, {SMALL}", SMALL_AMPLITUDE),
    )
    for law, end, words, scale in sources:
        for run in evidence.fit(_DENSITY_BY_M.of(F, EDGES, law=law, ends=(end,)))[:1]:
            volumes = moments(run, PAPER_D)
            for m, paper in ((5, 8.0), (6, 8.0), (7, 2.0)):
                if m in volumes:
                    number = single(f"v_{law}_{end}_{scale:.2f}_{m}", f"v̄ at m = {m}", scale * volumes[m][0])
                    rows.append(Row(f"{words}; m = {m}", number, number.reaches(paper, 0.5) if m > 5 else None))
    return Reading(
        "Initial amplitude (and final plane)",
        "Sec. 2: “σ₀² is a free parameter set equal to 1/√0.09”; Sec. 4: “log(8) - log(2) = 0.6 by passing from m "
        "= 6 to 7”",
        "mean volume of the open elements at d = 0 [length³], D = 2.3, L = 100, one surface",
        "8 at m = 6, 2 at m = 7",
        tuple(rows),
        "Initial standard deviation 1/√0.09 = 3.333; no starred number depends on it.",
    )


def _fulcrum(evidence: Evidence) -> Reading:
    rows = []

    def row(run: Run, words: str, key: str, *, scale: float = 1.0, dims: float = 3.0, contact: bool = False) -> None:
        m = int(nearest(run.m, PAPER_M))
        data = {D: densities(run, D, m) for D in run.D if dims >= D}
        if contact:
            # contact in: f falls by the share of open elements outside the first bin (v = 1 is not in it)
            data = {D: (f * (1.0 - run.last(A, D=D, m=m))[:, np.newaxis], edges) for D, (f, edges) in data.items()}
        number = bootstrap(key, "spread of f(1) over D", lambda s: fulcrum(data, 1.0, s, scale), run.seeds)
        rows.append(Row(words, number, number.value < FULCRUM))

    for run in evidence.fit(_DENSITY_BY_D)[:1]:
        row(run, "std law, initial standard deviation 3.333, open elements (default)", "default")
        row(run, "the same, contact elements counted", "contact", contact=True)
        row(run, SMALL, "amplitude", scale=SMALL_AMPLITUDE)
        row(run, f"{SMALL}, D ≤ 2.5", "amplitude_25", scale=SMALL_AMPLITUDE, dims=2.51)
        row(run, "D ≤ 2.5 only", "D25", dims=2.51)
    for run in evidence.fit(_DENSITY_BY_D.of(F, EDGES, law="variance"))[:1]:
        row(run, "variance law, initial variance 3.333", "variance")
        row(run, "variance law, initial variance 3.333, D ≤ 2.5", "variance_25", dims=2.51)
    for run in evidence.fit(_DENSITY_BY_D.of(F, EDGES, ends=("summit-plane",)))[:1]:
        row(run, "to the plane of the summits", "summits")
        row(run, "to the plane of the summits, D ≤ 2.5", "summits_25", dims=2.51)
        row(run, f"to the plane of the summits, {SMALL}", "summits_amplitude", scale=SMALL_AMPLITUDE)
    return Reading(
        "f(1) as a fulcrum",
        "Sec. 4: “the point f(v = 1) is almost independent of D and acts as a fulcrum” (v in units of length³)",
        "spread of the mean f(1) over D, relative to its mean, m = 7",
        f"“almost independent”: below {FULCRUM:.0%}",
        tuple(rows),
        "Contact elements are left out of f (their share is A*); the amplitude is as above.",
    )


def _plane(evidence: Evidence) -> Reading:
    rows = []
    planes = {"mean-plane": "to the mean plane (default)", "summit-plane": "to the mean plane of the summits"}
    for end, words in planes.items():
        for run in evidence.fit(ONE_D.of(A, finest=PAPER_M, m=(PAPER_M,), ends=(end,)))[:1]:
            m = int(nearest(run.m, PAPER_M))
            area = run.last(A, D=PAPER_D, m=m)
            readings_of_area = (
                ("elements", "share of elements", area),
                ("L2", "area over L²", area * (1.0 + 2.0**-m) ** 2),
            )
            for key, counted, values in readings_of_area:
                number = single(f"{end}_{key}", f"A* at the end, m = {m}", values)
                rows.append(Row(f"{words}; {counted}", number, number.high >= PAPER_A - REACHED))
            separation = np.round(run.last(D_SIGMA, D=PAPER_D, m=m), 9) + 0.0
            rows.append(Row(f"{words}; d/σ there", single(f"{end}_d", f"d/σ at the end, m = {m}", separation)))
    return Reading(
        "Final plane",
        "Sec. 3: “the mean plane of the asperity heights”; Sec. 4: “the average plane of the originally "
        "undeformed surface”",
        "A* at the end of the sweep, D = 2.3, m = 7, one surface",
        "about 0.1 (Fig. 8b)",
        tuple(rows),
        "The mean plane of the surface; Figs. 8 to 11 are pressed on to A* = 0.1.",
    )


def _counting(evidence: Evidence) -> Reading:
    rows = []
    for run in evidence.fit(BY_M.of(V))[:1]:
        values = np.array([run.last(V, D=PAPER_D, m=m) for m in run.m])
        factor = np.array([[(1.0 + 2.0**-m) ** 2] for m in run.m])
        sums = (
            ("mean", "mean over the elements (default)", values),
            ("sum", "V/(L²σ), the literal sum", values * factor),
        )
        for key, words, volumes in sums:
            slopes = [slope(run.m, row) for row in volumes.T]
            change = mean(f"slope_{key}", "change of V* at d = 0 per m", slopes)
            rows.append(Row(f"{words}; m = {run.m[0]} to {run.m[-1]}", change, below(change, 0.0)))
            for m, volume in ((run.m[0], volumes[0]), (run.m[-1], volumes[-1])):
                number = mean(f"{key}_m{m}", f"V* at d = 0, m = {m}", volume)
                rows.append(Row(f"{words}; V* at d = 0, m = {m}", number))
    return Reading(
        "Counting of elements",
        "Sec. 2: A* = A/L², V* = V/(L²σ), with (2^m + 1)² elements of side L/2^m",
        "V* at d = 0 against m, D = 2.3",
        "“a decay in the total free volume by increasing m”",
        tuple(rows),
        "Fractions of elements and means over them, so that A* = 1 is full contact.",
    )


def _modulus(evidence: Evidence) -> Reading:
    run = evidence.best(ONE_D.of(P))
    m = max(run.m)
    pressure = run.last(P, D=PAPER_D, m=m)
    rows = [Row("E* = E/(1-ν²) (default)", mean("E_star", f"p* at d = 0, m = {m}", pressure))]
    for nu in (0.3, 0.5):
        number = mean(f"E_{nu}", f"p* at d = 0, m = {m}", pressure / (1.0 - nu**2))
        rows.append(Row(f"E, with ν = {nu:g}", number))
    return Reading(
        "E or E*",
        "Sec. 2: “E and ν denote the composite Young's modulus and Poisson's ratio”, p* = pL/(Eσ)",
        "p* at d = 0, D = 2.3",
        "no number; p* scales by 1/(1-ν²), no exponent and no V* changes",
        tuple(rows),
        "E* in p*, so that no answer depends on ν.",
    )


def _separation(evidence: Evidence) -> Reading:
    run = evidence.best(ONE_D.of(V, D_SIGMA))
    m = max(run.m)
    d, v = run.values(D_SIGMA, D=PAPER_D, m=m), run.values(V, D=PAPER_D, m=m)
    rigid = mean("rigid", "V*σ/d - 1 at d/σ = 1", at(d, v - d, np.array([1.0])))
    deformed = exact("deformed", "V*σ/d - 1 at d/σ = 1", 0.0, run.seeds)
    rows = (
        Row("rigid far-field separation (default)", rigid, above(rigid, 0.05)),
        Row("separation of the deformed mean planes (V* = d/σ is then an identity)", deformed, False),
    )
    return Reading(
        "The separation d",
        "Sec. 3.1: “the separation between the half plane of the rough surface and the elastic half space”",
        "departure of V* from d/σ at d/σ = 1, D = 2.3",
        "“cannot be confused” below 3",
        rows,
        "The rigid far-field separation.",
    )


def _sums(evidence: Evidence) -> Reading:
    state = field(evidence.best(FIELD))
    words = {
        ("mean", "width"): "as printed, Σ n_k Δv_k",
        ("mean", "volume"): "Σ n_k v_k, the volume of an element of the bin",
        ("fit", "volume"): "Σ n_k v_k with one fitted dimension for each domain",
    }
    rows = []
    for kind, weight in KINDS:
        sums = estimates(state, kind, weight)
        for k in (1, 3):
            name = f"V* over the computed one, K = {BINS[k]}"
            number = exact(f"{kind}_{weight}_{BINS[k]}", name, sums[k] / state.numbers[V])
            rows.append(Row(f"{words[kind, weight]}; K = {BINS[k]}", number, close(number)))
    return Reading(
        "Eqs. 9 and 10",
        "Sec. 4: ΔV_k = n_k Δv_th",
        "V* of the formula over the computed V*",
        "1",
        tuple(rows),
        "Both forms are computed; the printed one falls as 1/K.",
    )
