"""From patches to a seal: the leak of a seal, and the load that closes it, from those of patches of its joint.

The sheet conductance of a patch is G = Q/Δp · L_w/L_l, with L_w its side along the flow and L_l the other. A seal of
width w and length l is a sheet of w/L_w × l/L_l patches (`gap.sheet`), and leaks Q = G Δp l/w. Which patch lies where
is not known: patches are drawn from those computed, many times. The median of the draws is the answer.

**Interval.** Errors that all patches share multiply: grid, levelling and solver, as in `leak_budget`. What averages out
is the part ``window``. It has two sources, and their logarithms add in squares: the draws differ among each other
(2.5 to 97.5 %), and the scans are few. G is proportional to the level of its patches, so the second is the interval of
the mean of their logarithms, Student's, with the scans less one as degrees of freedom. Windows of one scan, and x and y
of one scan, are no further scans: their mean is one number.

**One scan** is the seal repeated. Its quadrants stand in for scans in the interval, and waves longer than a quadrant
are missing there. Without a roll-off the longest waves are the highest: no patch is representative, and the interval is
not known. Nor is it where patches hold more waves along one side than along the other (`doubt_of`).

**x and y.** A patch is turned as well as it lies where x and y are alike: both numbers are drawn for both directions.
They are alike where surfaces are made so, or the mean logarithm of x over y lies within two standard errors of 0. Two
patches more are worth less than a bias, so this is no test at 95 % for few scans.

**Closed patches** conduct nothing in a draw. The interval then begins at 0. It ends at what follows if a closed patch
conducts as much as the poorest open patch.

**Long seals.** Columns of patches differ among each other, and a stream seldom drifts farther sideways than the seal is
wide. More than 128 columns are taken as rings of 64 columns side by side, which have no ends. More than 16 patches in a
row are taken in blocks, no wider than the seal is long. Each block is a patch of its own sheet. A stream drifts as far
sideways as patches conduct across the flow over along it, by the root of this ratio. Blocks are wider by this factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from roughvol.analysis.leak import is_lifted
from roughvol.analysis.legs import first_leg
from roughvol.analysis.parts import Part, together
from roughvol.analysis.tables import number
from roughvol.ensemble.multilevel import COVERAGE, half_width
from roughvol.errors import DatasetError, StudyError
from roughvol.gap import sheet
from roughvol.observables.variables import AXES, QUANTITIES
from roughvol.store.dataset import Dataset
from roughvol.study import Region, Seal, Study
from roughvol.study.sections.seal import WHOLE, check_alike, unevenness
from roughvol.surfaces.psd import octaves, waves
from roughvol.surfaces.surface import Surface, intervals
from roughvol.typing import Array

DRAWS, FEW_DRAWS = 300, 50
QUICK_ROW = 8  # patches in a row, up to which many states have as many draws as one state
ROW, RING = 16, 64  # most patches in a row, and columns of a ring
WIDEST = 1024.0  # largest width of a block over its length along the flow
SIDE_BY_SIDE = 4096  # rings whose mean is taken at most; a longer seal has the same mean
ERRORS = 2.0  # standard errors within which x and y are alike
ENDS = (0.5 - 0.5 * COVERAGE, 0.5 + 0.5 * COVERAGE)
LONGEST = 0.25  # largest variance of the waves as long as the map over that of the highest octave
LEAKS = {"leak_rate": "seal_leak_rate", "gas_leak_rate": "seal_gas_leak_rate"}
NO_LEAK = (
    "no open surface is pressed to this load, the surfaces have different pressures there, or the leak of a surface is "
    "known along one axis alone"
)
NO_ROLL_OFF = (
    "no roll-off is found: the longest waves of the patch are among the highest, longer waves are missing, and no "
    "patch is representative of the seal"
)
UNKNOWN = "seal_unknown"  # attribute with the reason why states have no leak of the seal
NODES = ("nodes_x", "nodes_y")
IN_A_ROW = "fluid pressure lifts patches in a row differently"
ONE_LOAD = 1e-4  # relative: patches at a state have one load
MOST = 700.0  # logarithm of a factor, so that its exponential is finite


@dataclass(frozen=True)
class Estimate:
    """A number of a seal: median over draws, with its interval, from 0 where a patch is closed, NaN where not known."""

    value: float
    low: float
    high: float

    def times(self, factor: float) -> Estimate:
        """Return another unit of the number."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor)

    def with_factor(self, larger: float, smaller: float = math.nan) -> Estimate:
        """Return the number with another error, up and down; the same factor down if none is given."""
        if not math.isfinite(larger):
            return Estimate(self.value, math.nan, math.nan)
        if self.value == 0.0 or self.low == 0.0:
            return replace(self, high=self.high * larger)
        sides = (larger if math.isnan(smaller) else smaller, self.low), (larger, self.high)
        logs = (math.hypot(math.log(factor), math.log(end / self.value)) for factor, end in sides)
        low, high = (math.exp(min(log, MOST)) for log in logs)
        return Estimate(self.value, 0.0 if smaller == math.inf else self.value / low, self.value * high)


def is_isotropic(scans: Sequence[Array]) -> bool:
    """Return whether patches are alike along x and y: the mean logarithm of their ratio within two standard errors.

    A scan has numbers along two axes, shape (numbers, 2), as at several loads. Closed ones (0) and NaN are left out.
    """
    logs = (np.log(scan[(scan > 0.0).all(axis=1)]) for scan in scans)
    ratios = np.array([np.mean(log[:, 0] - log[:, 1]) for log in logs if len(log)])
    return ratios.size > 1 and bool(abs(ratios.mean()) <= ERRORS * ratios.std(ddof=1) / math.sqrt(ratios.size))


def doubt_of(heights: Sequence[Surface]) -> str:
    """Return why patches are not representative of a seal, from their heights; empty where they are."""
    if not has_roll_off(heights):
        return NO_ROLL_OFF
    return unevenness(np.nanmean([waves(surface) for surface in heights], axis=0))


def has_roll_off(heights: Sequence[Surface]) -> bool:
    """Return whether waves as long as the map hold little of the variance of heights, along x and along y.

    Their share of the variance, mean over the maps, is less than `LONGEST` times that of the highest octave.
    docs/explanation/notes/seal.md has how often this is so, with a roll-off and without.
    """
    found = [octaves(surface) for surface in heights]
    mean = np.mean([shares[:, : min(shares.shape[1] for shares in found)] for shares in found], axis=0)
    return bool(np.all(mean[:, 0] < LONGEST * mean.max(axis=1)))


def conductance_of(values: Array, patches: tuple[int, int], *, isotropic: bool, draws: int = DRAWS) -> Estimate:
    """Return the sheet conductance of a seal.

    ``values``, shape (scans, windows, 2), are conductances ≥ 0 of patches along and across the flow. ``patches`` are
    those in a row along the flow, and side by side. With ``isotropic``, both numbers of a patch are drawn for both
    directions.
    """
    return _estimate(values, patches, isotropic, sheet.conductance, np.mean, draws)


def of_one_map(whole: Array, quadrants: Array, patches: tuple[int, int], *, isotropic: bool) -> Estimate:
    """Return the sheet conductance of a seal that is one map repeated, with the interval of its quadrants.

    ``whole``, shape (2,), and ``quadrants``, shape (4, 2), are conductances along and across the flow.
    """
    value, (n, m) = float(whole[0]), patches
    found = conductance_of(quadrants[:, np.newaxis], (2 * n, 2 * m), isotropic=isotropic)
    if value == 0.0 or found.value == 0.0:
        return Estimate(value, 0.0, found.high)
    return Estimate(value, value * found.low / found.value, value * found.high / found.value)


def closing_of(values: Array, patches: tuple[int, int], *, isotropic: bool) -> Estimate:
    """Return the load at which a seal closes, from those of its patches; arguments as for `conductance_of`."""
    return _estimate(values, patches, isotropic, sheet.closing, np.max, DRAWS)


def drawn(
    along: Array,
    across: Array,
    patches: tuple[int, int],
    of: Callable[..., Array],
    together: Callable[..., Array] = np.mean,
    draws: int = DRAWS,
    seed: int = 0,
) -> Array:
    """Return a number of sheets, shape (draws,), drawn from as many patches along as across the flow.

    ``of`` gives the number of each sheet, as `sheet.closing`; ``together`` that of rings side by side, as `numpy.max`.
    """
    n, m = patches
    if n > ROW:
        side = math.ceil(n / ROW)
        down, over = along.mean(), across.mean()
        ratio = min(max(over / down, WIDEST**-2), WIDEST**2) if down > 0.0 else 1.0
        stretch = 2.0 ** round(0.5 * math.log2(ratio))  # a power of two, so that few loads have a ratio on its border
        beside = max(1, min(round(side * stretch), m))  # a sheet narrower than a block has blocks of its own width
        first = drawn(along, across, (side, beside), of, together, draws, seed + 1)
        second = drawn(across, along, (beside, side), of, together, draws, seed + 2)
        if of is sheet.conductance:  # over that along, a block conducts across with the square of its shape
            second = second * (side / beside) ** 2
        return drawn(first, second, (round(n / side), round(m / beside)), of, together, draws, seed)
    if min(along.min(), across.min()) == max(along.max(), across.max()):
        return np.full(draws, along[0])
    rng, ring = np.random.default_rng(seed), m > 2 * RING
    columns = RING if ring else m
    patch = rng.integers(along.size, size=(draws, 2 * n - 1, columns))
    found = of(along[patch[:, :n]], across[patch[:, n:]], ring=ring)
    if not ring:
        return found
    rings = min(round(m / RING), SIDE_BY_SIDE)
    return np.asarray(together(rng.choice(found, (draws, rings)), axis=1))


def _estimate(
    values: Array,
    patches: tuple[int, int],
    isotropic: bool,
    of: Callable[..., Array],
    together: Callable[..., Array],
    draws: int,
) -> Estimate:
    """Return a number of a seal with its interval."""

    def sheets(some: Array) -> Array:
        pools = (some, some) if isotropic else (some[..., 0], some[..., 1])
        along, across = (np.sort(pool, axis=None) for pool in pools)  # scans have no order
        return drawn(along, across, patches, of, together, draws)

    found, open_ = sheets(values), values > 0.0
    value = float(np.median(found))
    if not open_.any():
        return Estimate(0.0, 0.0, math.inf)
    if open_.all():
        low, high = np.quantile(found, ENDS)
        return Estimate(value, float(low), float(high)).with_factor(_of_few(values, isotropic))
    filled = np.where(open_, values, values[open_].min())
    upper = sheets(filled)
    middle, end = float(np.median(upper)), float(np.quantile(upper, ENDS[1]))
    return Estimate(value, 0.0, Estimate(middle, middle, end).with_factor(_of_few(filled, isotropic)).high)


def _of_few(values: Array, isotropic: bool) -> float:
    """Return the factor of the mean logarithm over scans; infinite for one scan, and where one of two never closes."""
    logs = np.log(values if isotropic else values[..., :1]).mean(axis=(1, 2))
    if len(logs) < 2:
        return math.inf
    with np.errstate(over="ignore"):
        return float(np.exp(half_width(float(logs.std(ddof=1)), len(logs))))


def sizes_of(run: Dataset) -> list[tuple[int, int]]:
    """Return the intervals along x and y of each surface of a run."""
    if lost := [name for name in NODES if name not in run]:
        raise DatasetError(f"the dataset has no {lost[0]}; allowed: all variables of a run with a seal")
    shapes = np.transpose([run[name].values.ravel() for name in NODES])
    known, periodic = shapes[np.isfinite(shapes).all(axis=1)].astype(int).tolist(), "periodic" in run.attrs
    return [(intervals(rows, periodic), intervals(columns, periodic)) for rows, columns in known]


@dataclass(frozen=True)
class Patch:
    """The patch that a run observes, with sides along x and y, as a part of the seal of its study.

    ``aspect`` is width over length of the flow along x, as leaks have it, of all surfaces or of each.
    """

    seal: Seal
    sides: tuple[float, float]
    unit: str | None
    aspect: float | Array
    region: Region | None = None
    made_alike: bool = False  # along x and y

    @classmethod
    def of(cls, study: Study | None, run: Dataset) -> Patch | None:
        """Return the patch of a run; None for a study without a seal."""
        if study is None or study.seal is None:
            return None
        sizes = sizes_of(run)
        check_alike(sizes)
        rows, columns = sizes[0]
        along_x = float(run["L"])
        region = study.record.part
        sides = (region or Region()).sides(along_x, along_x * columns / rows)
        unit = run.attrs.get("length_unit")
        study.seal.check(sides, unit)
        square = math.isclose(*sides, rel_tol=WHOLE)
        return cls(study.seal, sides, unit, _aspect(run), region, made_alike=square and study.surface.is_isotropic)

    def of_each(self, surfaces: Sequence[Dataset]) -> Patch:
        """Return the patch with the aspect of each surface: elements of a region depend on the grid of a map."""
        return replace(self, aspect=np.array([_aspect(surface) for surface in surfaces]))

    @property
    def patches(self) -> tuple[int, int]:
        """Patches in a row along the flow, and side by side."""
        return self.seal.patches(self.sides, self.unit)

    @property
    def draws_of_many(self) -> int:
        """Sheets drawn at each of many states: fewer where a sheet takes long. Its leak then scatters less."""
        return DRAWS if self.patches[0] <= QUICK_ROW else FEW_DRAWS

    @property
    def axes(self) -> tuple[str, str]:
        """The axis of the flow, and the other."""
        return ("x", "y") if self.seal.flow == "x" else ("y", "x")

    def is_isotropic(self, surfaces: Sequence[Dataset]) -> bool:
        """Return whether each of several patches may be turned: x and y are made alike, or flows do not differ."""
        return (self.made_alike and len(surfaces) > 1) or is_isotropic([ratios(surface) for surface in surfaces])

    def counted(self, numbers: Array, *, isotropic: bool) -> Array:
        """Return numbers (..., surfaces, 2) along x and y; those along the flow for both if no way across counts.

        So it is in a row, in a column, and where all patches are one surface.
        """
        several = numbers.shape[-2] > 1
        if several and (isotropic or 1 not in self.patches):
            return numbers
        return numbers[..., [AXES.index(self.seal.flow)] * 2]

    @property
    def squares(self) -> float:
        """Length of the seal over its width."""
        return self.seal.squares(self.unit)

    def conductances(self, leaks: Array, *, in_units: bool) -> Array:
        """Return sheet conductances along and across the flow, of leaks (..., surfaces, 2) along x and y."""
        aspect = np.asarray(self.aspect)
        of_plates = np.stack([1.0 / aspect, aspect], axis=-1) if in_units else 1.0
        found = np.asarray(leaks) * of_plates
        return found if self.seal.flow == "x" else found[..., ::-1]


def _aspect(run: Dataset) -> float:
    return float(run["region_aspect"].max()) if "region_aspect" in run else 1.0


def ratios(surface: Dataset) -> Array:
    """Return the transmissivities of a surface along x and y at the steps of its first leg, shape (steps, 2).

    Those of a gas where no liquid flows.
    """
    names = ("transmissivity", "transmissivity_dry", "gas_transmissivity", "gas_transmissivity_dry")
    name = next((name for name in names if name in surface), "")
    if not name:
        return np.empty((0, 2))
    return np.asarray(first_leg(surface)[name].transpose(..., "axis").values, dtype=float).reshape(-1, 2)


def with_leaks(study: Study | None, surfaces: Dataset, states: Dataset) -> Dataset:
    """Return states with the leaks of the seal of their study, as medians over sheets of patches; 0 where closed.

    States without leaks, or of a study without a seal, stay as they are. Where the seal is smaller than its patches, or
    fluid pressure lifts patches in a row by different pressures, the attribute `UNKNOWN` has the reason. A leak at a
    step of surfaces that differ in their load there is missing, as is 0 where a leak of a surface is not known. All
    steps, ``surfaces``, show whether x and y of height files differ.
    """
    flows = [name for name in LEAKS if name in states]  # in this order in tables
    if not flows:
        return states
    try:
        patch = Patch.of(study, surfaces)
    except StudyError as error:
        problem = error.problems[0]
        reason = f"The leak of the seal is not known: {problem.key} {problem.message}."
        return states.assign_attrs({UNKNOWN: reason})
    if patch is None:
        return states
    if is_lifted(surfaces) and patch.patches[0] > 1:
        return states.assign_attrs({UNKNOWN: f"The leak of the seal of {patch.seal.label} is not known: {IN_A_ROW}."})
    alike = patch.is_isotropic([surfaces.isel(seed=slice(k, k + 1)) for k in range(surfaces.sizes["seed"])])
    words = f"{patch.seal.label}, flow along {patch.seal.flow}, {' × '.join(map(str, patch.patches))} patches"
    found = {}
    for name in flows:
        leaks = states[name].transpose(..., "seed", "axis")
        several = leaks.ndim > 2
        draws = patch.draws_of_many if several else DRAWS
        states_of = patch.counted(leaks.values.reshape(-1, *leaks.shape[-2:]), isotropic=alike)
        loads = states["mean_pressure"] * states["Sq"]
        spread = loads.max("seed") - loads.min("seed") <= ONE_LOAD * abs(loads).max("seed")
        have_one = spread.transpose(*leaks.dims[:-2]).values.ravel() | (states_of == 0.0).all(axis=(1, 2))
        known = [
            median(patch, some, isotropic=alike, draws=draws) if one_load else math.nan
            for some, one_load in zip(states_of, have_one, strict=True)
        ]
        every = states.sizes["seed"] == surfaces.sizes["seed"]
        values = np.where(every | (np.array(known) != 0.0), known, math.nan)
        median_leaks = leaks.isel(axis=0, drop=True).copy()
        median_leaks.values = np.broadcast_to(np.reshape(values, (-1, 1) if several else (1,)), median_leaks.shape)
        row = QUANTITIES[LEAKS[name]]
        about = {"symbol": row.symbol, "long_name": row.long_name, "seal": words, "sheets": draws}
        found[LEAKS[name]] = median_leaks.assign_attrs(about)
    return states.assign(found)


def median(patch: Patch, leaks: Array, *, isotropic: bool, in_units: bool = True, draws: int = DRAWS) -> float:
    """Return the leak of a seal whose patches have leaks along x and y; NaN without `known_of` them.

    A leak of 0 is NaN too where a patch is not known: it may be open. A gas goes the same way: between two pressures
    its throughput goes with p², and G of viscous flow is that of the liquid.
    """
    known = known_of(patch.conductances(patch.counted(leaks, isotropic=isotropic), in_units=in_units))
    if not len(known):
        return math.nan
    found = conductance_of(known[:, np.newaxis], patch.patches, isotropic=isotropic and len(known) > 1, draws=draws)
    return math.nan if found.value == 0.0 and len(known) < len(leaks) else found.value * patch.squares


def known_of(leaks: Array) -> Array:
    """Return the leaks along two axes of the patches that are known, shape (patches, 2).

    The array is empty where a patch is known along one axis alone: the patch closed there, and seals drawn from the
    others leak more.
    """
    finite = np.isfinite(leaks)
    whole = finite.all(axis=1)
    return leaks[whole & (finite.any(axis=1) == whole).all()]


def window_of(found: Estimate, samples: str, doubt: str = "") -> Part:
    """Return the part of the error that averages out; not known where a patch is closed, or with a doubt."""
    words = doubt or f"95 % of the sheets, and of the mean of {samples}, of logarithms by t"
    if doubt or not found.low > 0.0:
        return Part("window", math.nan, words)
    return Part("window", found.high / found.value, words, found.value / found.low)


def leak_of(
    patch: Patch,
    maps: Array,
    quadrants: Array | None,
    *,
    isotropic: bool,
    doubt: str,
    shared: Sequence[Part],
) -> tuple[Estimate, tuple[Part, ...], tuple[str, ...]]:
    """Return the leak of a seal, the parts of its error, and how it was found in words.

    ``maps``, shape (scans, 2), are conductances of the maps along and across the flow in the unit of the leak.
    ``quadrants``, shape (4, 2), are those of the only map. ``doubt`` says why the patches are not representative.
    ``shared`` are the errors that all patches share.
    """
    n, m = patch.patches
    if not len(maps):
        return Estimate(math.nan, math.nan, math.nan), (), ()
    found = conductance_of(maps[:, None], (n, m), isotropic=isotropic and len(maps) > 1)
    turned = ", each as it lies and turned" if isotropic else "; x and y differ"
    count = f"{len(maps)} surface{'s' * (len(maps) > 1)}"
    words = [f"{DRAWS} sheets of {n} × {m} patches, drawn from {count}{turned}"]
    if quadrants is not None:
        found = of_one_map(maps[0], quadrants, (n, m), isotropic=isotropic)
        words = [
            f"the map repeated, {n} × {m} times; its interval is that of its quadrants",
            f"waves longer than a quadrant of the map are missing: {number(max(patch.sides) / 2)} {patch.unit or ''}",
        ]
    if closed := int((maps[:, :1] == 0.0).sum()):
        words.append(f"{closed} of {len(maps)} patches are closed along the flow")
        if found.value > 0.0 and not shared:
            words.append("the median patch is closed: the errors that all patches share are not known")
    smaller, larger = together(shared)
    samples = count if quadrants is None else "4 quadrants"
    parts = (*shared, window_of(found, samples, doubt))
    found = found.with_factor(math.nan if doubt else larger, smaller)
    return found.times(patch.squares), parts, tuple(words)


def surface_of(run: Dataset, region: Region | None) -> Surface:
    """Return the patch of a run with stored heights: its surface, or the region of it that is observed."""
    from roughvol.observables import regions  # imports the solver, for cards alone

    z, periodic = run["heights"].transpose("x", "y").values, "periodic" in run.attrs
    spacing = float(run["L"]) / intervals(z.shape[0], periodic)
    if region is None:
        return Surface(z, spacing, sides="periodic" if periodic else "free")
    return Surface(z[regions.window_of(region, z.shape, periodic=periodic)], spacing)
