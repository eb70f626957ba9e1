"""Claims about the shape of the free volume (Section 3.2, Figs. 8 to 11)."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.stats import spearmanr

from roughvol.observables.free_volume import domain, element_volumes, free_volume
from roughvol.report.claims import statistics
from roughvol.report.claims.evidence import D_SIGMA, A, Given, Lacking, Outcome, P, V, claim
from roughvol.report.claims.needs import BOXES, BY_D, FIELD, ONE_D
from roughvol.report.claims.stored_run import Run
from roughvol.report.claims.verdict import Check, Number, above, below
from roughvol.report.paper_rules import PAPER_A, PAPER_D, PAPER_M, nearest, nearest_state
from roughvol.store.dataset import at_state
from roughvol.typing import Array, Index, Mask

STRAIGHT = 0.99  # R² of log N over log r from which a box-counting plot is called straight
REACHED = 0.005  # half a unit of the one digit in A* ~ 0.1, in the next


class Field(NamedTuple):
    """One recorded state: gap over σ, contact, volumes [length³], heights [length], and its numbers."""

    gap: Array
    contact: Mask
    volumes: Array
    heights: Array
    numbers: dict[str, float]
    words: str


def field(run: Run) -> Field:
    """Return the recorded state nearest to D = 2.3, m = 7 and A* = 0.1, the paper's."""
    D, m = nearest(run.D, PAPER_D), int(nearest(run.m, PAPER_M))
    case = run.dataset.sel(D=D, m=m).isel(seed=0)
    steps = case["field_at_step"].values
    places = [k for k in range(len(steps)) if steps[k] > 0]
    if not places:
        message = "no recorded field"
        raise Lacking(message)
    states = {k: at_state(case, "field_at", k) for k in places}
    place = nearest_state({k: float(state[A]) for k, state in states.items()})
    gap = case["gap"].isel(field_at=place).dropna("x", how="all").dropna("y", how="all").transpose("x", "y").values
    numbers = {name: float(states[place][name]) for name in (A, P, V, D_SIGMA)} | {"Sq": float(case["Sq"])}
    numbers["spacing"] = run.L / (len(gap) - 1)
    contact = gap == 0.0
    surface = run.surface(D, m, run.seed_numbers()[0])
    volumes = element_volumes(gap * surface.Sq, numbers["spacing"], contact)
    words = f"D = {D:g}, m = {m}, A* = {numbers[A]:.3f}"
    return Field(gap, contact, volumes, surface.heights, numbers, words)


@claim(
    11,
    "The deformed surface at A* ≈ 0.1",
    "Sec. 3.2, Fig. 8",
    "The undeformed surface (D = 2.3, m = 7) and its deformed shape at a contact area fraction of about 0.1, in the "
    "loading of Sec. 3.",
    needs={"": FIELD, "sweep": ONE_D.of(A, m=(PAPER_M,), finest=PAPER_M, optional=True)},
    figures=("fig08",),
)
def deformed_surface(given: Given) -> Outcome:
    """Ask that the state exists (essential): A* within 0.005 of 0.1, the contact on the plane and nothing beyond it.

    Whether the loading described gets there is the other question. The figure shows one surface, so the interval in
    which A* of one surface falls at the end of the sweep to the mean plane must reach 0.1 within one digit (0.095).
    """
    run = given.run()
    state = field(run)
    number = statistics.exact("area", "A* of the recorded state", state.numbers[A])
    lowest = statistics.exact("lowest_gap", "smallest gap over σ", float(state.gap.min()))
    share = float(state.contact.mean())
    checks = [
        Check(f"A* within {REACHED:g} of {PAPER_A:g}", abs(state.numbers[A] - PAPER_A) <= REACHED, number),
        Check("no gap is negative, and the contact has gap 0", lowest.value == 0.0 and share > 0.0, lowest),
    ]
    numbers = [
        statistics.exact("separation", "d/σ there", state.numbers[D_SIGMA]),
        statistics.exact("pressure", "p* there", state.numbers[P]),
    ]
    sources, reached = [run], ""
    for sweep in given.runs("sweep")[:1]:
        m = int(nearest(sweep.m, PAPER_M))
        end = statistics.single(
            "area_end", f"A* of one surface on the mean plane, D = {PAPER_D:g}, m = {m}", sweep.last(A, D=PAPER_D, m=m)
        )
        checks.append(
            Check("one surface may reach it on the mean plane", end.high >= PAPER_A - REACHED, end, essential=False)
        )
        reached = (
            f"; on the mean plane surfaces have A* = {end.value:.3f} on average, one in {end.low:.3f} to {end.high:.3f}"
        )
        sources.append(sweep)
    why = f"A* = {state.numbers[A]:.3f} is at d/σ = {state.numbers[D_SIGMA]:.2f}, p* = {state.numbers[P]:.2f}{reached}."
    return Outcome(checks, why, sources, numbers)


@claim(
    12,
    "The map of the free volumes",
    "Sec. 3.2, Fig. 9",
    "The free volume of each element: zero in contact, largest in the deep valleys; V = Σ v.",
    needs=FIELD,
    figures=("fig09",),
)
def volume_map(given: Given) -> Outcome:
    """Ask that the sum of the map is the stored V* within the residual of the solver, η/σ = 10⁻⁶.

    (The map has gap 0 exactly in contact, where the solution leaves up to η.)

    "Depends on the amplitude of the valleys": the rank correlation of v with the depth of the undeformed surface over
    the open elements is above 0.9 (what is left is the elastic displacement, which varies slowly).
    """
    run = given.run()
    state = field(run)
    total = abs(free_volume(state.gap, 1.0) - state.numbers[V])
    depth = state.heights.max() - state.heights
    open_ = ~state.contact
    rank = float(spearmanr(state.volumes[open_], depth[open_]).statistic)
    inside = statistics.exact(
        "contact_volume", "largest v in contact", float(state.volumes[state.contact].max(initial=0.0))
    )
    correlation = statistics.exact("rank_correlation", "rank correlation of v with depth", rank)
    checks = [
        Check("Σ v is the stored V*", total < 1e-6, statistics.exact("sum", "difference of Σ v and V*", total)),
        Check("v = 0 in contact", inside.value == 0.0, inside),
        Check("v follows the depth of the valleys (rank correlation above 0.9)", rank > 0.9, correlation),
    ]
    why = f"v correlates with the depth of the undeformed valleys (rank correlation {rank:.3f}; {state.words})."
    return Outcome(checks, why, [run])


@claim(
    13,
    "Domains v ≤ v_th",
    "Sec. 3.2, Fig. 10",
    "The domain v ≤ v_th is the contact for v_th = 0, grows with v_th, and is everything for v_th = max v.",
    needs=FIELD,
    figures=("fig10",),
)
def domains(given: Given) -> Outcome:
    """Check set theory on the recorded field at 0, 0.1, 0.25, 0.5 and 1 of max v: exact or not."""
    run = given.run()
    state = field(run)
    shares = (0.0, 0.1, 0.25, 0.5, 1.0)
    black = [domain(state.volumes, share * state.volumes.max(), state.contact) for share in shares]
    nested = all(not (small & ~large).any() for small, large in pairwise(black))
    numbers = [
        statistics.exact(f"black_{share:g}", f"share of the domain at v_th = {share:g} max v", float(mask.mean()))
        for share, mask in zip(shares, black, strict=True)
    ]
    off = abs(numbers[0].value - state.numbers[A])
    checks = [
        Check("v_th = 0 is the contact: its share is A*", off < 1e-12, numbers[0]),
        Check("each domain contains the one before", nested),
        Check("v_th = max v is everything", numbers[-1].value == 1.0, numbers[-1]),
    ]
    why = (
        f"The domains grow from {numbers[0].value:.1%} to {numbers[-1].value:.0%} of the elements; half of max v "
        f"has {numbers[3].value:.0%}."
    )
    return Outcome(checks, why, [run], numbers[1:-1])


def boxes(run: Run, D: float, m: int, label: str) -> tuple[Index, Array]:
    """Return box sides and counts N(r) at a state, shape (surfaces, thresholds, r); NaN where it was not reached."""
    case = run.dataset.sel(D=D, m=m, box_at=label)
    counts = case["box_count"].transpose("seed", "threshold", "r").values
    known = case["r"].values <= 2**m
    return case["r"].values[known], counts[:, :, known]


def state_of_boxes(run: Run) -> tuple[float, int, str]:
    """Return D, m and the label of the state nearest to the paper's D = 2.3, m = 7, A* = 0.1 that was box-counted."""
    D, m = nearest(run.D, PAPER_D), int(nearest(run.m, PAPER_M))
    case = run.dataset.sel(D=D, m=m)
    areas = {}
    for place, label in enumerate(case["box_at"].values.tolist()):
        steps = case["box_at_step"].sel(box_at=label).values
        reached = [float(at_state(case.isel(seed=k), "box_at", place)[A]) for k in np.flatnonzero(steps > 0)]
        if len(reached) == run.seeds:
            areas[label] = float(np.mean(reached))
    if not areas:
        message = "a box-counted state that every surface reaches"
        raise Lacking(message)
    return D, m, nearest_state(areas)


def fitted_dimension(r: Index, counts: Array) -> Array:
    """Return the box dimension: minus the slope of log N over log r for r = 1 … 2^m/4, along the last axis.

    The two largest boxes are left out: with at most four of them N is 1 to 4 for every domain.
    """
    used = r <= max(r[-1] // 4, 2)
    logs = np.log(np.where(counts > 0, counts, np.nan))[..., used]
    return np.apply_along_axis(lambda row: -statistics.slope(np.log(r[used]), row), -1, logs)


@claim(
    14,
    "Box-counting curves are nearly straight",
    "Sec. 3.2, Fig. 11a",
    "log N over log r is close to a straight line for every threshold, which suggests a power law.",
    needs=BOXES.of("box_count", states=(("box_at", "contact_area=0.1"), ("box_at", "pressure=1.2"))),
    figures=("fig11a",),
)
def straight_box_counts(given: Given) -> Outcome:
    """Call a curve straight on paper if R² of the line through all box sides is above 0.99 (mean over surfaces).

    R² is kind to monotonous curves in logarithms, so a power law asks for more: the local dimensions of one curve, over
    the sides r = 1 … 2^m/4, differ by less than 0.1 (interval; other, because the paper says "close to").
    """
    run = given.run()
    D, m, label = state_of_boxes(run)
    r, counts = boxes(run, D, m, label)
    logs, used = np.log(counts), r <= max(r[-1] // 4, 2)
    local = -np.diff(logs[..., used], axis=-1) / np.log(2.0)
    checks = []
    for k, share in enumerate(run.dataset["threshold"].values.tolist()):
        fits = [statistics.straightness(np.log(r), row) for row in logs[:, k]]
        number = statistics.mean(f"R2_{share:g}", f"R² at v_th = {share:g} max v", fits)
        checks.append(Check(f"R² above {STRAIGHT} at v_th = {share:g} max v", number.value > STRAIGHT, number))
        number = statistics.mean(
            f"bend_{share:g}", f"range of the local dimension at v_th = {share:g} max v", np.ptp(local[:, k], axis=-1)
        )
        checks.append(
            Check(
                f"local dimension constant within 0.1 at v_th = {share:g} max v",
                below(number, 0.1),
                number,
                essential=False,
            )
        )
    bends = [check.number.value for check in checks[1::2] if check.number]
    straight = [check.number.value for check in checks[::2] if check.number]
    why = (
        f"R² is {min(straight):.3f} or more, but the local dimension of one curve varies by up to {max(bends):.2f} "
        f"({_words(label)}, D = {D:g}, m = {m})."
    )
    return Outcome(checks, why, [run])


@claim(
    15,
    "The local dimension depends on r; contact and everything bound the rest",
    "Sec. 3.2, Fig. 11b",
    "The local dimension depends on r; that of the contact is below 2, that of v_th = max v is 2, and these two bound "
    "the others.",
    needs=BOXES.of("box_count", states=(("box_at", "contact_area=0.1"), ("box_at", "pressure=1.2"))),
    figures=("fig11b",),
)
def bounds_of_dimension(given: Given) -> Outcome:
    """Test four statements, each essential.

    "Depends on r": the local dimension of the contact ranges over more than 0.1. "Below 2": the whole interval of
    its fitted dimension is. "Is 2": exactly, at every r. "Bound": the fitted dimension rises with v_th for each pair
    of neighbouring thresholds (interval of the matched difference not below 0). Whether the bounds hold at every r
    and not only for the fit is the other check, made at every state that was box-counted.
    """
    run = given.run()
    D, m, label = state_of_boxes(run)
    r, counts = boxes(run, D, m, label)
    thresholds = run.dataset["threshold"].values.tolist()
    if thresholds[0] != 0.0 or thresholds[-1] != 1.0:
        message = "thresholds from 0 to 1"
        raise Lacking(message)
    fitted = fitted_dimension(r, counts)
    local = -np.diff(np.log(counts), axis=-1) / np.log(2.0)
    bend = statistics.mean("range", "range of the local dimension of the contact", np.ptp(local[:, 0], axis=-1))
    contact = statistics.mean("contact", "dimension of the contact", fitted[:, 0])
    whole = statistics.exact(
        "whole", "largest |local dimension - 2| at v_th = max v", float(np.abs(local[:, -1] - 2.0).max()), run.seeds
    )
    checks = [
        Check("local dimension of the contact ranges over more than 0.1", above(bend, 0.1), bend),
        Check("dimension of the contact below 2", below(contact, 2.0), contact),
        Check("dimension 2 for v_th = max v", whole.value < 1e-12, whole),
    ]
    numbers = []
    for k, (low, high) in enumerate(pairwise(thresholds)):
        number = statistics.mean(
            f"rise_{high:g}", f"dimension at {high:g} max v less that at {low:g}", fitted[:, k + 1] - fitted[:, k]
        )
        checks.append(
            Check(
                f"dimension not smaller at {high:g} max v than at {low:g}",
                True if number.low >= 0.0 else None if number.high >= 0.0 else False,
                number,
            )
        )
        numbers.append(statistics.mean(f"fit_{high:g}", f"dimension at v_th = {high:g} max v", fitted[:, k + 1]))
    outside = total = 0
    for state in run.dataset["box_at"].values.tolist():
        _, counts = boxes(run, D, m, state)
        every = -np.diff(np.log(counts[np.isfinite(counts).all(axis=(1, 2))]), axis=-1) / np.log(2.0)
        outside += int(((every < every[:, :1] - 1e-12) | (every > 2.0 + 1e-12)).sum())
        total += every.size
    number = statistics.exact("outside", f"local dimensions of {total} below that of the contact or above 2", outside)
    checks.append(Check("the same at every r", outside == 0, number, essential=False))
    why = (
        f"The contact has dimension {contact}, v_th = max v exactly 2 ({_words(label)}, D = {D:g}, m = {m}); "
        f"{outside} of {total} local dimensions at all states lie outside."
    )
    return Outcome(checks, why, [run], numbers)


@claim(
    16,
    "The dimension of the contact rises with p* and falls with D",
    "Sec. 3.2",
    "The fractal dimension of the contact area increases with the pressure and decreases with D.",
    needs=BOXES.of("box_count", by="D", D=BY_D.D, states=(("box_at", "pressure=0.3"), ("box_at", "pressure=2.4"))),
    figures=("theory_dimension",),
)
def contact_dimension(given: Given) -> Outcome:
    """Fit the dimension over r = 1 … 2^m/4, at states of equal pressure, on matched surfaces.

    "Rises": from the lowest to the highest pressure recorded, for every D. "Falls with D": between neighbouring D, at
    every pressure. Intervals of matched differences exclude 0; both essential. At equal *area* the same comparison
    of D tells whether the dimension falls with D by itself, or only because the area does (other).
    """
    run = given.run()
    m = max(run.m)
    labels = run.dataset["box_at"].values.tolist()
    dimension = {(D, label): fitted_dimension(*_contact(run, D, m, label)) for D in run.D for label in labels}
    pressures = [label for label in labels if label.startswith("pressure=")]
    areas = [label for label in labels if label.startswith("contact_area=")]
    if len(pressures) < 2:
        message = "box counting at two pressures"
        raise Lacking(message)
    pressures.sort(key=_level)
    checks, numbers = [], []
    for D in run.D:
        each = dimension[D, pressures[-1]] - dimension[D, pressures[0]]
        number = statistics.mean(
            f"rise_D{D:g}", f"rise from p* = {_level(pressures[0]):g} to {_level(pressures[-1]):g}, D = {D:g}", each
        )
        checks.append(Check(f"rises with pressure at D = {D:g}", above(number, 0.0), number))
    for label in (*pressures, *areas):
        symbol = "p*" if label in pressures else "A*"
        for low, high in pairwise(run.D):
            each = dimension[high, label] - dimension[low, label]
            if np.isfinite(each).sum() < max(2, run.seeds // 2):
                continue
            number = statistics.mean(
                f"{label}_{low:g}_{high:g}",
                f"dimension at D = {high:g} less that at {low:g}, {symbol} = {_level(label):g}",
                each,
            )
            text = f"falls from D = {low:g} to {high:g} at {symbol} = {_level(label):g}"
            checks.append(Check(text, below(number, 0.0), number, essential=label in pressures))
        numbers += [
            _mean_dimension(dimension[D, label], D, label, symbol)
            for D in run.D
            if np.isfinite(dimension[D, label]).any()
        ]
    ends = [numbers[0].value, numbers[len(run.D) * (len(pressures) - 1)].value]
    equal = [check for check in checks if not check.essential]
    met = sum(check.met is True for check in equal)
    why = (
        f"At D = {run.D[0]:g} it rises from {ends[0]:.2f} to {ends[1]:.2f} with pressure and falls with D; at "
        f"equal area "
        f"{met} of {len(equal)} comparisons of neighbouring D still fall."
    )
    return Outcome(checks, why, [run], numbers)


def _contact(run: Run, D: float, m: int, label: str) -> tuple[Index, Array]:
    r, counts = boxes(run, D, m, label)
    zero = int(np.flatnonzero(run.dataset["threshold"].values == 0.0)[0])
    return r, counts[:, zero]


def _words(label: str) -> str:
    return label.replace("pressure=", "p* = ").replace("contact_area=", "A* = ").replace("separation=", "d/σ = ")


def _level(label: str) -> float:
    return float(label.split("=")[1])


def _mean_dimension(each: Array, D: float, label: str, symbol: str) -> Number:
    return statistics.mean(
        f"dimension_{label}_D{D:g}", f"dimension of the contact, D = {D:g}, {symbol} = {_level(label):g}", each
    )
