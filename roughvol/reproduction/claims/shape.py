"""Claims about the shape of the free volume (Section 3.2, Figs. 8 to 11)."""

from __future__ import annotations

import itertools
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from roughvol.gap.free_volume import domain, element_volumes, free_volume
from roughvol.report.figures.cases import nearest
from roughvol.report.figures.families import own
from roughvol.reproduction.claim_run import ClaimRun, state_words
from roughvol.reproduction.claims.evidence import D_SIGMA, A, Given, Outcome, P, V, claim, paper_state, require
from roughvol.reproduction.claims.statistics import exact, mean, single, slope, straightness
from roughvol.reproduction.claims.verdict import Check, Number
from roughvol.reproduction.needs import BOXES, BY_D, FIELD, ONE_D, PAPER_A, PAPER_D, PAPER_M
from roughvol.store.dataset import recorded_state
from roughvol.surfaces.surface import intervals
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


def field(run: ClaimRun) -> Field:
    """Return the recorded state nearest to D = 2.3, m = 7 and A* = 0.1, the paper's."""
    D = nearest(run.D, PAPER_D)
    m = int(nearest(run.m, PAPER_M))
    case = run.dataset.sel(D=D, m=m).isel(seed=0)
    state = paper_state(case, "field_at")
    gap = own(state["gap"]).values
    numbers = {name: float(state[name]) for name in (A, P, V, D_SIGMA, "Sq")}
    numbers["spacing"] = run.L / intervals(len(gap), "periodic" in run.dataset.attrs)
    contact = gap == 0.0
    surface = run.surface(D, m, run.seed_numbers()[0])
    volumes = element_volumes(gap * surface.Sq, numbers["spacing"], contact)
    words = f"D = {D:g}, m = {m}, A* = {numbers[A]:.3f}"
    return Field(gap, contact, volumes, surface.heights, numbers, words)


@claim(11, needs={"": FIELD, "sweep": ONE_D.of(A, m=(PAPER_M,), finest=PAPER_M, optional=True)})
def deformed_surface(given: Given) -> Outcome:
    """Ask that the state exists (essential): A* within 0.005 of 0.1, the contact on the plane and nothing beyond it.

    Whether the loading described gets there is the other question. The figure shows one surface, so the interval in
    which A* of one surface falls at the end of the sweep to the mean plane must reach 0.1 within one digit (0.095).
    """
    run = given.run()
    state = field(run)
    area = exact("area", "A* of the recorded state", state.numbers[A])
    lowest = exact("lowest_gap", "smallest gap over σ", float(state.gap.min()))
    separation = exact("separation", "d/σ there", state.numbers[D_SIGMA])
    pressure = exact("pressure", "p* there", state.numbers[P])
    near_paper = abs(area.value - PAPER_A) <= REACHED
    on_plane = lowest.value == 0.0 and bool(state.contact.any())
    checks = [
        Check(f"A* within {REACHED:g} of {PAPER_A:g}", near_paper, area),
        Check("no gap is negative, and the contact has gap 0", on_plane, lowest),
    ]
    sources = [run]
    why = f"A* = {area.value:.3f} is at d/σ = {separation.value:.2f}, p* = {pressure.value:.2f}"
    if sweeps := given.runs("sweep"):
        sweep = sweeps[0]
        m = int(nearest(sweep.m, PAPER_M))
        name = f"A* of one surface on the mean plane, D = {PAPER_D:g}, m = {m}"
        end = single("area_end", name, sweep.last(A, D=PAPER_D, m=m))
        reaches = end.high >= PAPER_A - REACHED
        checks.append(Check("one surface may reach it on the mean plane", reaches, end, essential=False))
        sources.append(sweep)
        why += f"; on the mean plane surfaces have A* = {end.value:.3f} on average, "
        why += f"one in {end.low:.3f} to {end.high:.3f}"
    return Outcome(checks, f"{why}.", sources, [separation, pressure])


@claim(12, needs=FIELD)
def volume_map(given: Given) -> Outcome:
    """Ask that the sum of the map is the stored V* within the residual of the solver, η/σ = 10⁻⁶.

    (The map has gap 0 exactly in contact, where the solution leaves up to η.)

    "Depends on the amplitude of the valleys": the rank correlation of v with the depth of the undeformed surface over
    the open elements is above 0.9 (what is left is the elastic displacement, which varies slowly).
    """
    run = given.run()
    state = field(run)
    depth = state.heights.max() - state.heights
    open_ = ~state.contact
    difference = abs(free_volume(state.gap, 1.0) - state.numbers[V])
    largest = float(state.volumes[state.contact].max(initial=0.0))
    from scipy.stats import spearmanr  # half a second: imported where it is used

    rank = float(spearmanr(state.volumes[open_], depth[open_]).statistic)
    total = exact("sum", "difference of Σ v and V*", difference)
    inside = exact("contact_volume", "largest v in contact", largest)
    correlation = exact("rank_correlation", "rank correlation of v with depth", rank)
    checks = [
        Check("Σ v is the stored V*", difference < 1e-6, total),
        Check("v = 0 in contact", largest == 0.0, inside),
        Check("v follows the depth of the valleys (rank correlation above 0.9)", rank > 0.9, correlation),
    ]
    why = f"v correlates with the depth of the undeformed valleys (rank correlation {rank:.3f}; {state.words})."
    return Outcome(checks, why, [run])


@claim(13, needs=FIELD)
def domains(given: Given) -> Outcome:
    """Check set theory on the recorded field at 0, 0.1, 0.25, 0.5 and 1 of max v: exact or not."""
    run = given.run()
    state = field(run)
    shares = (0.0, 0.1, 0.25, 0.5, 1.0)
    masks = {share: domain(state.volumes, share * state.volumes.max(), state.contact) for share in shares}
    numbers = {}
    for share, mask in masks.items():
        name = f"share of the domain at v_th = {share:g} max v"
        numbers[share] = exact(f"black_{share:g}", name, float(mask.mean()))
    is_contact = abs(numbers[0.0].value - state.numbers[A]) < 1e-12
    is_nested = all(not (small & ~large).any() for small, large in pairwise(masks.values()))
    is_everything = numbers[1.0].value == 1.0
    checks = [
        Check("v_th = 0 is the contact: its share is A*", is_contact, numbers[0.0]),
        Check("each domain contains the one before", is_nested),
        Check("v_th = max v is everything", is_everything, numbers[1.0]),
    ]
    why = f"The domains grow from {numbers[0.0].value:.1%} to {numbers[1.0].value:.0%} of the elements; "
    why += f"half of max v has {numbers[0.5].value:.0%}."
    return Outcome(checks, why, [run], [numbers[share] for share in shares[1:-1]])


def boxes(run: ClaimRun, D: float, m: int, label: str) -> tuple[Index, Array]:
    """Return box sides and counts N(r) at a state, shape (surfaces, thresholds, r); NaN where it was not reached."""
    case = run.dataset.sel(D=D, m=m, box_at=label)
    counts = case["box_count"].transpose("seed", "threshold", "r").values
    mask = case["r"].values <= 2**m
    return case["r"].values[mask], counts[:, :, mask]


def state_of_boxes(run: ClaimRun) -> tuple[float, int, str]:
    """Return D, m and the label of the state nearest to the paper's D = 2.3, m = 7, A* = 0.1 that was box-counted."""
    D, m = nearest(run.D, PAPER_D), int(nearest(run.m, PAPER_M))
    case = run.dataset.sel(D=D, m=m)
    areas = {}
    for place, label in enumerate(case["box_at"].values.tolist()):
        steps = case["box_at_step"].sel(box_at=label).values
        reached = [float(recorded_state(case.isel(seed=k), "box_at", place, A)[A]) for k in np.flatnonzero(steps > 0)]
        if len(reached) == run.seeds:
            areas[label] = float(np.mean(reached))
    require(areas, "a box-counted state that every surface reaches")
    return D, m, min(areas, key=lambda label: abs(areas[label] - PAPER_A))


def fitted_dimension(r: Index, counts: Array) -> Array:
    """Return the box dimension, the slope of -log N over log r for r = 1 … 2^m/4: larger boxes are four at most."""
    used = r <= max(r[-1] // 4, 2)
    logs = np.log(np.where(counts > 0, counts, np.nan))[..., used]
    return np.apply_along_axis(lambda row: -slope(np.log(r[used]), row), -1, logs)


def _local_dimension(counts: Array) -> Array:
    """Return -d log₂ N / d log₂ r between neighbouring box sides, along the last axis."""
    return -np.diff(np.log(counts), axis=-1) / np.log(2.0)


@claim(14, needs=BOXES.of("box_count", states=(("box_at", "contact_area=0.1"), ("box_at", "pressure=1.2"))))
def straight_box_counts(given: Given) -> Outcome:
    """Call a curve straight on paper if R² of the line through all box sides is above 0.99 (mean over surfaces).

    R² is kind to monotonous curves in logarithms, so a power law asks for more: the local dimensions of one curve, over
    the sides r = 1 … 2^m/4, differ by less than 0.1 (interval; other, because the paper says "close to").
    """
    run = given.run()
    D, m, label = state_of_boxes(run)
    r, counts = boxes(run, D, m, label)
    local = _local_dimension(counts[..., r <= max(r[-1] // 4, 2)])
    checks = []
    straight = []
    bends = []
    for k, share in enumerate(run.dataset["threshold"].values.tolist()):
        where = f"at v_th = {share:g} max v"
        of_each = [straightness(np.log(r), row) for row in np.log(counts[:, k])]
        R2 = mean(f"R2_{share:g}", f"R² {where}", of_each)
        bend = mean(f"bend_{share:g}", f"range of the local dimension {where}", np.ptp(local[:, k], axis=-1))
        checks.append(Check(f"R² above {STRAIGHT} {where}", R2.value > STRAIGHT, R2))
        checks.append(Check.below(f"local dimension constant within 0.1 {where}", bend, 0.1, essential=False))
        straight.append(R2.value)
        bends.append(bend.value)
    why = f"R² is {min(straight):.3f} or more, but the local dimension of one curve varies by up to {max(bends):.2f} "
    return Outcome(checks, f"{why}({state_words(label)}, D = {D:g}, m = {m}).", [run])


@claim(15, needs=BOXES.of("box_count", states=(("box_at", "contact_area=0.1"), ("box_at", "pressure=1.2"))))
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
    require(thresholds[0] == 0.0 and thresholds[-1] == 1.0, "thresholds from 0 to 1")
    fitted = fitted_dimension(r, counts)
    local = _local_dimension(counts)
    bend = mean("range", "range of the local dimension of the contact", np.ptp(local[:, 0], axis=-1))
    contact = mean("contact", "dimension of the contact", fitted[:, 0])
    off_two = float(np.abs(local[:, -1] - 2.0).max())
    whole = exact("whole", "largest |local dimension - 2| at v_th = max v", off_two, run.seeds)
    checks = [
        Check.above("local dimension of the contact ranges over more than 0.1", bend, 0.1),
        Check.below("dimension of the contact below 2", contact, 2.0),
        Check("dimension 2 for v_th = max v", off_two < 1e-12, whole),
    ]
    numbers = []
    for k, (low, high) in enumerate(pairwise(thresholds)):
        name = f"dimension at {high:g} max v less that at {low:g}"
        rise = mean(f"rise_{high:g}", name, fitted[:, k + 1] - fitted[:, k])
        checks.append(Check(f"dimension not smaller at {high:g} max v than at {low:g}", _not_negative(rise), rise))
        numbers.append(mean(f"fit_{high:g}", f"dimension at v_th = {high:g} max v", fitted[:, k + 1]))
    outside, total = _outside_bounds(run, D, m)
    name = f"local dimensions of {total} below that of the contact or above 2"
    checks.append(Check("the same at every r", outside == 0, exact("outside", name, outside), essential=False))
    why = f"The contact has dimension {contact}, v_th = max v exactly 2 ({state_words(label)}, D = {D:g}, m = {m}); "
    why += f"{outside} of {total} local dimensions at all states lie outside."
    return Outcome(checks, why, [run], numbers)


def _not_negative(number: Number) -> bool | None:
    """Return whether an interval has no negative part; None if zero is inside it."""
    if number.low >= 0.0:
        return True
    return None if number.high >= 0.0 else False


def _outside_bounds(run: ClaimRun, D: float, m: int) -> tuple[int, int]:
    """Return how many local dimensions lie below that of the contact or above 2, and how many there are."""
    outside = 0
    total = 0
    for label in run.dataset["box_at"].values.tolist():
        _, counts = boxes(run, D, m, label)
        reached = np.isfinite(counts).all(axis=(1, 2))
        local = _local_dimension(counts[reached])
        below = local < local[:, :1] - 1e-12
        above = local > 2.0 + 1e-12
        outside += int((below | above).sum())
        total += local.size
    return outside, total


@claim(
    16, needs=BOXES.of("box_count", by="D", D=BY_D.D, states=(("box_at", "pressure=0.3"), ("box_at", "pressure=2.4")))
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
    zero = int(np.flatnonzero(run.dataset["threshold"].values == 0.0)[0])
    dimension = {}
    for D, label in itertools.product(run.D, labels):
        r, counts = boxes(run, D, m, label)
        dimension[D, label] = fitted_dimension(r, counts[:, zero])
    pressures = sorted((label for label in labels if label.startswith("pressure=")), key=_level)
    areas = [label for label in labels if label.startswith("contact_area=")]
    require(len(pressures) >= 2, "box counting at two pressures")
    lightest, heaviest = pressures[0], pressures[-1]
    enough = max(2, run.seeds // 2)
    checks = []
    numbers = []
    for D in run.D:
        name = f"rise from p* = {_level(lightest):g} to {_level(heaviest):g}, D = {D:g}"
        rise = mean(f"rise_D{D:g}", name, dimension[D, heaviest] - dimension[D, lightest])
        checks.append(Check.above(f"rises with pressure at D = {D:g}", rise, 0.0))
    for label in (*pressures, *areas):
        state = state_words(label)
        for low, high in pairwise(run.D):
            differences = dimension[high, label] - dimension[low, label]
            if np.isfinite(differences).sum() < enough:
                continue
            name = f"dimension at D = {high:g} less that at {low:g}, {state}"
            fall = mean(f"{label}_{low:g}_{high:g}", name, differences)
            text = f"falls from D = {low:g} to {high:g} at {state}"
            checks.append(Check.below(text, fall, 0.0, essential=label in pressures))
        for D in run.D:
            if np.isfinite(dimension[D, label]).any():
                name = f"dimension of the contact, D = {D:g}, {state}"
                numbers.append(mean(f"dimension_{label}_D{D:g}", name, dimension[D, label]))
    smooth = run.D[0]
    first = np.nanmean(dimension[smooth, lightest])
    last = np.nanmean(dimension[smooth, heaviest])
    at_equal_area = [check for check in checks if not check.essential]
    falling = sum(check.met is True for check in at_equal_area)
    why = f"At D = {smooth:g} it rises from {first:.2f} to {last:.2f} with pressure and falls with D; "
    why += f"at equal area {falling} of {len(at_equal_area)} comparisons of neighbouring D still fall."
    return Outcome(checks, why, [run], numbers)


def _level(label: str) -> float:
    return float(label.split("=")[1])
