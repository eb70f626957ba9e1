"""Speed against accuracy on the surfaces of a study: cost and error of each setting of the solver.

Five ladders, each with a reference that differs in one respect only:

=============  ==========================================================  ==========================================
ladder         rungs                                                       reference
=============  ==========================================================  ==========================================
tolerance      η/σ ≤ 1e-1 … 1e-10, convolutions inside mixed or double     η/σ ≤ 1e-12, double, same grid and states
steps          all steps of the study, a third, a tenth                    the same reference, at the common states
kernel         love, punch                                                 the same reference
method         fast, paper; on a grid of m ≤ 5                             η/σ ≤ 1e-12, double, of that grid
resolution     four levels of the nested family that ends at the finest m  its finest level at equal separations d/σ
=============  ==========================================================  ==========================================

Errors of A*, p* (relative) and V* are the largest over the states of a sweep. Errors of f(v) and of the box dimension
are those of the last state. A unit of work is one convolution in double precision. One in single precision counts by
its time, at least one half.
"""

from __future__ import annotations

import time
import timeit
import tracemalloc
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from roughvol.campaign.case_surface import one_thread, surface_of
from roughvol.campaign.one_case import FFT
from roughvol.campaign.path import last_indentation
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import KERNELS
from roughvol.contact.loading import sweep
from roughvol.contact.options import Options
from roughvol.errors import Problem, StudyError
from roughvol.gap import box_counting, free_volume
from roughvol.observables.variables import DTYPES
from roughvol.store import provenance, small_file
from roughvol.store.dataset import Dataset
from roughvol.store.tradeoff_variables import EACH, QUANTITIES, RUNG, RUNG_VARIABLES, TABLE
from roughvol.study import Case, Study, refused
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array, Mask

REFERENCE_RTOL = 1e-12  # near the limit of double precision, see `contact.problem`
RTOLS = tuple(10.0**-k for k in range(1, 11))
LEVELS = 4  # of the nested family: three changes, the fewest that show a ratio
PAPER_M = 5  # largest m of the paper's dense algorithm here; minutes a sweep beyond
BINS = 50  # of the density f(v)
THRESHOLDS = (0.0, 0.25)  # v/v_max of the domains for the box dimension
SURFACES = 6  # most surfaces of a study: the first seeds of every D


@dataclass(frozen=True)
class Rung:
    """One setting of the ladder; ``m`` is -1 for a height file."""

    ladder: str
    rtol: float
    precision: str
    kernel: str
    method: str
    steps: int
    m: int

    @property
    def options(self) -> Options:
        """Options of the solver."""
        return Options(self.rtol, self.method, self.precision)


@dataclass(frozen=True)
class _Run:
    """A sweep reduced: numbers of every state, the last state whole, its work."""

    numbers: Array  # (steps, 3): A*, p*, V*
    gap: Array
    contact: Mask
    residual: float
    pressure_bound: float
    counts: tuple[float, float]
    seconds: float


def surfaces_of(study: Study) -> tuple[Case, ...]:
    """Return the cases of the ladders: finest m of a study, every D, the first seeds up to `SURFACES` cases."""
    cases = study.cases()
    finest = max((case.m or 0 for case in cases), default=0)
    cases = tuple(case for case in cases if (case.m or 0) == finest)
    if not cases or cases[0].sweep.steps == 0:
        raise StudyError([Problem("the study has no sweep; allowed: at least 1", "sweep.steps")])
    sweep = cases[0].sweep
    if cases[0].plastic or len(sweep.legs) > 1 or sweep.legs[0].listed or sweep.has_units:
        message = "a trade-off is measured on one elastic sweep; allowed: no list of legs or states, no hardness that "
        raise refused(f"{message}acts, an end without a unit")
    if len({case.label for case in cases}) < len(cases):
        raise refused("a trade-off is measured on one combination of lists; allowed: --set with a value of each list")
    if cases[0].endless:
        message = f"given {cases[0].sides}; allowed: free, the ladders of m and kernel are of a free patch"
        raise StudyError([Problem(message, "surface.sides")])
    seeds, dimensions = dict.fromkeys(case.seed for case in cases), {case.D for case in cases}
    kept = list(seeds)[: max(1, SURFACES // len(dimensions))]
    return tuple(case for case in cases if case.seed in kept)


def rungs_of(case: Case) -> list[Rung]:
    """Return the rungs of every ladder for a surface."""
    m, steps, solver = -1 if case.m is None else case.m, case.sweep.steps, case.solver
    base = Rung("tolerance", 1e-9, "mixed", solver.kernel, "fast", steps, m)
    rungs = [replace(base, rtol=rtol, precision=how) for how in ("mixed", "double") for rtol in RTOLS]
    fewer = dict.fromkeys(k for k in (steps, steps // 3, steps // 10) if k and steps % k == 0)
    rungs += [replace(base, ladder="steps", steps=k) for k in fewer]
    rungs += [replace(base, ladder="kernel", kernel=name) for name, kernel in KERNELS.items() if kernel.coefficients]
    if case.m is not None:
        least = min(case.m, PAPER_M)
        few = max(k for k in fewer if k <= max(6, min(fewer)))
        small = replace(base, ladder="method", m=least, steps=few, rtol=1e-6)
        rungs += [replace(small, method=how) for how in ("fast", "paper")]
        rungs += [replace(base, ladder="resolution", m=k) for k in range(max(1, case.m - LEVELS + 1), case.m + 1)]
    return rungs


def measure(study: Study, on_rung: Callable[[int, int], None] | None = None) -> Dataset:
    """Return errors, bounds and costs of every rung on the surfaces of a study; its accuracy has no effect."""
    cases = surfaces_of(study)
    rungs = rungs_of(cases[0])
    values = {name: np.full((len(rungs), len(cases)), np.nan) for name, row in TABLE.items() if row.dims == EACH}
    held: dict[tuple[Any, ...], tuple[HalfSpace, float]] = {}
    with one_thread():
        for column, case in enumerate(cases):
            bench = _Bench(case, {rung.m for rung in rungs}, held)
            for row, rung in enumerate(rungs):
                for name, value in bench.compare(rung, memory=column == 0).items():
                    values[name][row, column] = value
                if on_rung is not None:
                    on_rung(column * len(rungs) + row + 1, len(cases) * len(rungs))
    coords: dict[str, Any] = {"surface": ("surface", np.array([case.label for case in cases], dtype=object))}
    for name, variable in RUNG_VARIABLES.items():
        coords[name] = (RUNG, np.array([getattr(rung, name) for rung in rungs], dtype=DTYPES[variable.kind]))
    coords["D"] = ("surface", np.array([np.nan if case.D is None else case.D for case in cases]))
    result = Dataset(
        {name: (EACH.split(), array) for name, array in values.items()},
        coords=coords,
        attrs=provenance.provenance(study.stored(), fft=FFT, cases=cases, ids=[case.id for case in cases]),
    )
    for name, variable in TABLE.items():
        result[name].attrs = small_file.words_of(variable, "length")
    result["D"].attrs = {"units": "1", "long_name": "fractal dimension of the surface", "symbol": "D"}
    return result


class _Bench:
    """One surface on its ladders, with the grids of all their m; surfaces share half spaces."""

    def __init__(self, case: Case, levels: set[int], held: dict[tuple[Any, ...], tuple[HalfSpace, float]]) -> None:
        self._held, self._runs = held, dict[int, _Run]()
        self._kernel, self._steps, self._finest = case.solver.kernel, case.sweep.steps, max(levels)
        cases = {m: case if m < 0 else replace(case, m=m) for m in levels}
        self._surfaces = {m: surface_of(one) for m, one in cases.items()}
        swept = {self._finest, min(self._finest, PAPER_M)}
        # last indentation of the sweep, by m
        self._ends = {m: last_indentation(cases[m], self._surfaces[m], self._half_space(m)[0]) for m in swept}

    def compare(self, rung: Rung, *, memory: bool) -> dict[str, float]:
        """Return the variables of one rung on this surface."""
        surface, (half_space, ratio) = self._surfaces[rung.m], self._half_space(rung.m, rung.kernel)
        by_level = rung.ladder == "resolution"
        m = self._finest if by_level else rung.m
        # another level of the family has the separations d/σ of the finest
        shift = surface.peak - self._surfaces[m].peak
        at: Array = self._ends[m] * np.arange(1, rung.steps + 1) / rung.steps + shift
        run, reference = _swept(surface, half_space, at, rung.options), self._reference(m)
        every = len(reference.numbers) // len(run.numbers)
        wanted = reference.numbers[every - 1 :: every]
        change, touched, states = np.abs(run.numbers - wanted), wanted[:, 1] > 0.0, len(run.numbers)
        return {
            "contact_area_fraction_error": float(change[:, 0].max()),
            "mean_pressure_error": float((change[touched, 1] / wanted[touched, 1]).max(initial=0.0)),
            "free_volume_error": float(change[:, 2].max()),
            "volume_density_error": _density_error(run, reference),
            "box_dimension_error": _dimension_error(run, reference),
            "residual": run.residual,
            "mean_pressure_bound": run.pressure_bound,
            "convolutions_per_step": run.counts[0] / states,
            "convolutions_fp32_per_step": run.counts[1] / states,
            "units": (run.counts[0] + ratio * run.counts[1]) / states,
            "seconds": run.seconds,
            "memory": _peak(surface, at[-1], rung) if memory else np.nan,
        } | dict(zip(QUANTITIES, run.numbers[-1].tolist(), strict=True))

    def _half_space(self, m: int, kernel: str = "") -> tuple[HalfSpace, float]:
        """Return the half space and the cost of a convolution in single precision, in units."""
        shape = self._surfaces[m].shape
        key = (shape, kernel or self._kernel)
        if key not in self._held:
            half_space = HalfSpace(shape, kernel=key[1])
            assert half_space.total_compliance.size  # cost of the grid, not of the first sweep
            self._held[key] = half_space, max(0.5, _seconds(half_space, True) / _seconds(half_space, False))
        return self._held[key]

    def _reference(self, m: int) -> _Run:
        if m not in self._runs:
            at = self._ends[m] * np.arange(1, self._steps + 1) / self._steps
            exact = Options(REFERENCE_RTOL, precision="double")
            self._runs[m] = _swept(self._surfaces[m], self._half_space(m)[0], at, exact)
        return self._runs[m]


def _swept(surface: Surface, half_space: HalfSpace, indentations: Iterable[float], options: Options) -> _Run:
    started = (half_space.convolutions, half_space.convolutions_fp32, time.process_time())
    numbers, residual, bound = [], 0.0, 0.0
    for last in sweep(surface, half_space, indentations, options):
        numbers.append([last.contact_area_fraction, last.mean_pressure, last.free_volume])
        residual, bound = max(residual, last.residual), max(bound, last.mean_pressure_bound)
    seconds = time.process_time() - started[2]
    counts = half_space.convolutions - started[0], half_space.convolutions_fp32 - started[1]
    return _Run(np.array(numbers), last.gap(), last.contact(), residual, bound, counts, seconds)


def _density_error(run: _Run, reference: _Run) -> float:
    """Return ∫ |f - f_ref| dv of the open gaps in common bins: 0 for equal, 2 for disjoint densities."""
    upper = float(max(run.gap.max(), reference.gap.max()))
    if not min(run.gap.max(), reference.gap.max()) > 0.0:
        return float("nan")
    found, exact = (free_volume.volume_density(each.gap, each.contact, BINS, upper=upper) for each in (run, reference))
    return float(np.abs(found.density - exact.density) @ np.diff(found.edges))


def _dimension_error(run: _Run, reference: _Run) -> float:
    """Return the largest difference of the local dimensions at equal box lengths; the largest boxes have length L."""
    worst = 0.0
    for share in THRESHOLDS:
        found, exact = _local_dimensions(run, share), _local_dimensions(reference, share)
        common = min(found.size, exact.size)
        worst = max(worst, float(np.abs(found[:common] - exact[:common]).max(initial=0.0)))
    return worst


def _local_dimensions(run: _Run, share: float) -> Array:
    """Return the local dimensions of the domain D(v ≤ ``share`` v_max), from the largest boxes on."""
    domain = free_volume.domain(run.gap, share * float(run.gap.max()), run.contact)
    return box_counting.local_dimension(box_counting.box_counts(domain)).dimension[::-1]


def _seconds(half_space: HalfSpace, single: bool) -> float:
    elements = np.arange(0, half_space.shape[0] * half_space.shape[1], 7)
    pressure = np.ones(elements.size, dtype=np.float32 if single else np.float64)
    # the first makes the plans
    return min(timeit.repeat(lambda: half_space.displacement_at(elements, pressure, single=single), number=1, repeat=6))


def _peak(surface: Surface, end: float, rung: Rung) -> float:
    """Return the peak memory in bytes of a half space and a sweep to the same end in six steps."""
    tracemalloc.start()
    try:
        half_space = HalfSpace(surface.shape, kernel=rung.kernel)
        for _ in sweep(surface, half_space, end * np.arange(1, 7) / 6, rung.options):
            pass
        return float(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()
