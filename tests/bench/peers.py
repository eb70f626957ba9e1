"""The same sweep through other codes, side by side in one run (`make bench-peers`, extra `roughvol[peers]`).

Every code gets the same surfaces, the same equal steps to d = 0, and one thread. All results are judged by one ruler:
the pressures a code returns go through roughvol's own operator, which gives the residual η/σ of that state. A peer runs
at the loosest tolerance of a ladder of factors of two at which every step it solves has η ≤ 1e-6 σ; other trials do not
count. Its other stopping criteria are switched off, which can only make it faster. Time is that of the solves alone:
neither setting up, nor reading results, nor this re-measurement counts, nor a step that fails. roughvol is timed
before and after the peers and the median taken.

ContactMechanics is rigid-displacement controlled like roughvol, started cold and started from the forces of the step
before; Tamaas is load controlled and gets the loads that roughvol found, so its indentation is compared instead.
All work in σ = δ = E* = 1.

With `--periodic` the surfaces are periods of a plane, in equal steps of the approach to A* = 0.5. All codes have the
kernel 2/(E* q). roughvol's kernel love is timed beside them, in steps to its own end.
"""

import argparse
import json
import multiprocessing
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from roughvol import __version__

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
PACKAGES = ("roughvol", "ContactMechanics", "SurfaceTopography", "muGrid", "tamaas", "numpy", "scipy", "pyFFTW")
CODES = ("cold", "warm", "tamaas")
TARGET = 1e-6  # η/σ that everybody has to reach
STALLED = 20  # iterations without any change of the penetration that count as a failed step
PERIODIC_END = 0.5  # A* at the last step of periodic surfaces
LOOSEST, TIGHTEST = 2.0**6, 2.0**-12  # ends of the ladder of tolerances, in units of TARGET


@dataclass
class Step:
    """One solved step of a code, or why there is none."""

    pressure: Any = None  # (N, N), in E* σ/δ
    free_volume: float = np.nan
    failure: str = ""


@dataclass
class Sweep:
    """One sweep of a code at a tolerance, as measured here."""

    tolerance: float
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    convolutions: float = 0.0
    failures: dict[int, str] = field(default_factory=dict)
    columns: dict[str, list[float]] = field(
        default_factory=lambda: {name: [] for name in ("residual", "indentation", "area", "pressure", "volume")}
    )

    @property
    def reaches(self) -> bool:
        return bool(np.nanmax(self.columns["residual"], initial=0.0) <= TARGET)


class Problem:
    """A surface, its indentations and roughvol's answer; measures the states of others."""

    def __init__(self, case: dict[str, Any]) -> None:
        from roughvol.contact.halfspace import HalfSpace
        from roughvol.contact.search import indentation_for
        from roughvol.surfaces.midpoint import random_midpoint_displacement

        self.periodic, kernel = case["kernel"] != "free", case["kernel"]
        options = {"side": 100.0, "seed": case["seed"], "periodic": self.periodic}
        self.surface = random_midpoint_displacement(case["D"], case["m"], **options)
        shape = self.surface.shape
        self.half_space: Any = HalfSpace(
            shape, kernel if self.periodic else "love", sides="periodic" if self.periodic else "free"
        )
        assert self.half_space.total_compliance.size  # belongs to the grid, not to the sweep
        self.nodes, self.intervals = shape[0], self.surface.intervals[0]
        heights = self.surface.heights - self.surface.z_max
        self.heights = np.ascontiguousarray(heights / heights.std())
        end = -self.heights.mean()
        if self.periodic:
            end = indentation_for(self.surface, self.half_space, "contact_area", PERIODIC_END)
        self.indentations = end * np.arange(1, case["steps"] + 1) / case["steps"]

    def sweep(self) -> tuple[float, float, list[Any]]:
        """Return wall and processor seconds of roughvol's sweep, and its records."""
        from roughvol.contact.loading import sweep

        start, cpu_start = time.perf_counter(), time.process_time()
        contacts = list(sweep(self.surface, self.half_space, self.indentations, rtol=TARGET))
        return time.perf_counter() - start, time.process_time() - cpu_start, contacts

    def measure(self, pressure: Any, indentation: float | None) -> tuple[float, float]:
        """Return η/σ and Δ/σ of a pressure; an unknown indentation is the one with the smallest residual."""
        gap = self.half_space.displacement(np.ascontiguousarray(pressure) / np.pi) - self.heights
        touching = pressure > 0.0
        if not (touching.any() and np.isfinite(pressure).all()):
            return np.inf, np.nan
        highest, lowest = float(gap[touching].max()), float(gap.min())
        if indentation is None:
            return 0.5 * (highest - lowest), 0.5 * (highest + lowest)
        within = np.abs(gap[touching] - indentation).max()
        return max(float(within), indentation - lowest), indentation


class ContactMechanicsPeer:
    """Polonsky and Keer's conjugate gradients at imposed displacement, from the Python API."""

    control = "Δ"
    prefix = ""

    def __init__(self, problem: Problem, contacts: list[Any], *, warm: bool) -> None:
        from ContactMechanics import PeriodicFFTElasticHalfSpace, make_system
        from SurfaceTopography import Topography

        size = (float(problem.nodes),) * 2
        self.name = f"ContactMechanics, {'warm' if warm else 'cold'}"
        self.problem, self.warm = problem, warm
        topography = Topography(problem.heights, physical_sizes=size, periodic=problem.periodic)
        substrate: Any = "free"
        if problem.periodic:  # the mean displacement is p*, as roughvol has it
            stiffness = 1.0 / problem.nodes
            substrate = PeriodicFFTElasticHalfSpace(problem.surface.shape, 1.0, size, stiffness_q0=stiffness)
        self.system = make_system(topography, substrate=substrate, **({} if problem.periodic else {"young": 1.0}))
        self.substrate, self.count = self.system.substrate, 0
        for method in ("evaluate_disp", "evaluate_force"):
            setattr(self.substrate, method, self._counted(getattr(self.substrate, method)))

    def convolve(self, pressure: Any) -> Any:
        return -self.substrate.evaluate_disp(pressure)

    def _counted(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*args: Any, **kwargs: Any) -> Any:
            self.count += 1
            return function(*args, **kwargs)

        return counted

    def steps(self, tolerance: float) -> Iterator[tuple[Callable[[], Any], Callable[[Any], Step]]]:
        """Yield for every step what is timed, and what reads its result."""
        nodes = self.problem.nodes
        forces = None

        for indentation in self.problem.indentations:
            seen: list[float] = []

            def stalled(iteration: int, _: Any, state: dict[str, Any], seen: list[float] = seen) -> None:
                # A cold start puts the gap on the first contact set to zero but for rounding; where it is not exactly
                # zero the next conjugate direction is this noise times 1e30, and the iteration stands still for ever
                seen.append(state["rms_penetration"])
                if len(seen) > STALLED and np.ptp(seen[-STALLED:]) <= 1e-9 * seen[-1]:
                    raise RuntimeError(f"rms penetration unchanged at {seen[-1]:.2g} σ for {STALLED} iterations")

            def solve(offset: float = indentation, start: Any = forces) -> Any:
                return self.system.minimize_proxy(
                    offset=offset,
                    initial_forces=start,
                    pentol=tolerance,
                    forcetol=np.inf,
                    thermotol=np.inf,
                    maxiter=5000,
                    callback=stalled,
                )

            def read(result: Any, offset: float = indentation) -> Step:
                nonlocal forces
                forces = None
                if not result.success:
                    return Step(failure=result.message)
                if self.warm:
                    forces = np.zeros(self.substrate.nb_subdomain_grid_pts)
                    forces[:nodes, :nodes] = -result.jac
                gap = result.x[:nodes, :nodes] - self.problem.heights - offset
                return Step(result.jac, float(gap.mean()))

            yield solve, read


class TamaasPeer:
    """Polonsky and Keer's method at imposed load; each solve starts from the last. Its own operator is periodic."""

    name = "Tamaas, warm"
    control = "p*"
    prefix = "≈ "

    def __init__(self, problem: Problem, contacts: list[Any]) -> None:
        import tamaas

        tamaas.set_log_level(tamaas.LogLevel.error)
        nodes = problem.nodes
        self.problem, self.tamaas = problem, tamaas
        self.loads = [contact.mean_pressure / problem.intervals for contact in contacts]
        self.model = tamaas.ModelFactory.createModel(
            tamaas.model_type.basic_2d, [float(nodes)] * 2, list(problem.surface.shape)
        )
        self.model.E, self.model.nu = 1.0, 0.0
        self.operator = "Westergaard::neumann::basic_2d" if problem.periodic else "non-periodic"
        if not problem.periodic:
            tamaas.ModelFactory.registerNonPeriodic(self.model, self.operator)

        class Gradients(tamaas.Functional):
            """Adds nothing to the objective; an iteration asks once for its gradient."""

            count = 0

            def computeF(self, primal: Any, dual: Any) -> float:
                return 0.0

            def computeGradF(self, primal: Any, gradient: Any) -> None:
                self.count += 1

        self.gradients = Gradients()

    @property
    def count(self) -> int:
        """Two convolutions an iteration: the gradient, and the search direction, which cannot be observed."""
        return 2 * self.gradients.count

    def convolve(self, pressure: Any) -> Any:
        displacement = np.zeros(pressure.shape)
        if self.problem.periodic:
            self.model.traction[:] = pressure
            self.model.solveNeumann()
            return self.model.displacement + pressure.mean() * self.problem.nodes
        self.model.operators[self.operator](pressure, displacement)
        return displacement

    def steps(self, tolerance: float) -> Iterator[tuple[Callable[[], Any], Callable[[Any], Step]]]:
        """Yield for every step what is timed, and what reads its result."""
        model, problem = self.model, self.problem
        model.traction[:] = 0.0
        model.displacement[:] = 0.0
        solver = self.tamaas.PolonskyKeerRey(model, problem.heights.copy(), tolerance)
        if not problem.periodic:
            solver.setIntegralOperator(self.operator)
        solver.max_iter = 5000
        solver.addFunctionalTerm(self.gradients)
        for load in self.loads:

            def solve(load: float = load) -> float:
                try:
                    return float(solver.solve(load))
                except Exception:
                    model.traction[:] = 0.0  # NaN would stay in the model
                    raise

            def read(error: float) -> Step:
                if not error <= tolerance:
                    return Step(failure=f"returned the error {error:.1e}")
                return Step(model.traction.copy(), float(np.mean(model["gap"])))

            yield solve, read


def run(peer: Any, problem: Problem, tolerance: float, *, give_up: bool) -> Sweep:
    """Return a peer's sweep at a tolerance; `give_up` leaves it at the first step beyond the target."""
    done = Sweep(tolerance)
    before = peer.count
    for number, (solve, read) in enumerate(peer.steps(tolerance)):
        start, cpu_start = time.perf_counter(), time.process_time()
        try:
            result, failure = solve(), ""
        except Exception as error:
            failure = str(error).split("(): ")[-1].rstrip(".")
        seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - cpu_start
        convolutions, before = peer.count - before, peer.count
        step = Step(failure=failure) if failure else read(result)
        row = dict.fromkeys(done.columns, np.nan)
        if step.failure:
            done.failures[number + 1] = step.failure
        else:
            imposed = float(problem.indentations[number]) if peer.control == "Δ" else None
            row["residual"], row["indentation"] = problem.measure(step.pressure, imposed)
            row["area"] = np.count_nonzero(step.pressure > 0.0) / step.pressure.size
            row["pressure"] = float(step.pressure.mean() * problem.intervals)
            row["volume"] = step.free_volume
            done.seconds += seconds
            done.cpu_seconds += cpu_seconds
            done.convolutions += convolutions
        for name, value in row.items():
            done.columns[name].append(value)
        if give_up and not done.reaches:
            break
    done.convolutions /= max(1, len(done.columns["residual"]) - len(done.failures))
    return done


def loosest(peer: Any, problem: Problem, start: float) -> Sweep:
    """Return the sweep at the loosest tolerance of the ladder that reaches the target on every step it solves."""
    tolerance, found = start, None
    while TIGHTEST * TARGET <= tolerance <= LOOSEST * TARGET:
        trial = run(peer, problem, tolerance, give_up=True)
        print(
            f"{peer.name} at {tolerance:.1e}: {trial.cpu_seconds:.0f} CPU s, η/σ {max(trial.columns['residual']):.1e}",
            flush=True,
        )
        if trial.reaches:
            found = trial
            if tolerance < start:  # the next looser one has been seen to miss
                return found
            tolerance *= 2.0
        elif found is not None:
            return found
        else:
            start = tolerance
            tolerance /= 2.0
    return found or run(peer, problem, tolerance, give_up=False)


def compare(case: dict[str, Any]) -> list[dict[str, Any]]:
    """Return one row per code for a surface."""
    problem = Problem(case)
    repeats = 5 if case["m"] <= 7 else 3
    problem.sweep()  # plans
    timed = [problem.sweep() for _ in range(repeats)]
    contacts = timed[0][2]
    make: dict[str, Callable[[], Any]] = {
        "cold": lambda: ContactMechanicsPeer(problem, contacts, warm=False),
        "warm": lambda: ContactMechanicsPeer(problem, contacts, warm=True),
        "tamaas": lambda: TamaasPeer(problem, contacts),
    }
    peers = [make[code]() for code in case["codes"]]
    swept = []
    for peer in peers:
        print(f"m = {case['m']}: {peer.name} …", flush=True)
        swept.append(loosest(peer, problem, case["tolerances"].get(peer.name, TARGET)))
    timed += [problem.sweep() for _ in range(repeats)]

    own = Sweep(TARGET, *np.median([(wall, cpu) for wall, cpu, _ in timed], axis=0).tolist())
    own.convolutions = float(np.mean([c.convolutions + c.convolutions_fp32 for c in contacts]))
    for contact in contacts:
        # like the others: pressures through the operator once more, not the residual the solver noted
        pressure = contact.pressure() / problem.intervals
        residual, indentation = problem.measure(pressure, contact.approach)
        values = residual, indentation, contact.contact_area_fraction, contact.mean_pressure, contact.free_volume
        for name, value in zip(own.columns, values, strict=True):
            own.columns[name].append(value)
    unit = _milliseconds(lambda: problem.half_space.displacement(problem.heights))
    fp64 = float(np.mean([c.convolutions for c in contacts]))
    rows = [_row(case, "roughvol", own, own, unit, 0.0, "") | {"fp64": fp64}]
    rows += _with_love(case, own) if problem.periodic else []
    for peer, sweep in zip(peers, swept, strict=True):
        field_ours = problem.half_space.displacement(np.exp(problem.heights)) / np.pi
        field_theirs = peer.convolve(np.exp(problem.heights))
        operator = float(np.abs(field_theirs / field_ours - 1.0).max())
        unit = _milliseconds(lambda peer=peer: peer.convolve(problem.heights))
        rows.append(_row(case, peer.name, sweep, own, unit, operator, peer.control) | {"prefix": peer.prefix})
    return rows


def _with_love(case: dict[str, Any], fourier: Sweep) -> list[dict[str, Any]]:
    """Return the row of roughvol with Love's coefficients summed over images, whose answers are its own."""
    problem = Problem(case | {"kernel": "love"})
    problem.sweep()
    timed = [problem.sweep() for _ in range(3)]
    contacts = timed[0][2]
    love = Sweep(TARGET, *np.median([(wall, cpu) for wall, cpu, _ in timed], axis=0).tolist())
    love.convolutions = float(np.mean([c.convolutions + c.convolutions_fp32 for c in contacts]))
    for c in contacts:
        values = c.residual, c.approach, c.contact_area_fraction, c.mean_pressure, c.free_volume
        for name, value in zip(love.columns, values, strict=True):
            love.columns[name].append(value)
    unit = _milliseconds(lambda: problem.half_space.displacement(problem.heights))
    fp64 = float(np.mean([c.convolutions for c in contacts]))
    return [_row(case, "roughvol, love", love, fourier, unit, 0.0, "") | {"fp64": fp64}]


def _milliseconds(convolve: Callable[[], Any]) -> float:
    """Return the median time of a convolution."""
    times = []
    for _ in range(21):
        start = time.perf_counter()
        convolve()
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times[1:]))


def _row(
    case: dict[str, Any], name: str, sweep: Sweep, own: Sweep, unit: float, operator: float, control: str
) -> dict[str, Any]:
    """Return what is stored of a sweep; `disagreement` is the largest relative difference over the steps."""
    ours, theirs = ({k: np.array(v) for k, v in s.columns.items()} for s in (own, sweep))
    quantities = ("area", "pressure", "volume", "indentation")
    with np.errstate(invalid="ignore"):
        apart = {k: float(np.nanmax(np.abs(theirs[k] / ours[k] - 1.0))) for k in quantities}
    return {
        "code": name,
        "m": case["m"],
        "D": case["D"],
        "seed": case["seed"],
        "steps": case["steps"],
        "kernel": case["kernel"],
        "end": "d = 0" if case["kernel"] == "free" else f"A* = {PERIODIC_END}, periodic",
        "tolerance": sweep.tolerance,
        "control": control,
        "seconds": sweep.seconds,
        "cpu_seconds": sweep.cpu_seconds,
        "ratio": sweep.seconds / own.seconds,
        "cpu_ratio": sweep.cpu_seconds / own.cpu_seconds,
        "convolutions": sweep.convolutions,
        "convolution_ms": unit,
        "residual_max": float(np.nanmax(theirs["residual"])),
        "residual_median": float(np.nanmedian(theirs["residual"])),
        "reaches": sweep.reaches,
        "failures": sweep.failures,
        "operator": operator,
        "disagreement": apart,
        "steps_of": {k: [None if np.isnan(x) else x for x in v] for k, v in sweep.columns.items()},
    }


HEADER = (
    "| m | code | tolerance | s per sweep | CPU s | ratio | CPU ratio | convolutions a step | ms each | η/σ max "
    "| η/σ median | steps failed | A* | p* | V* | Δ |\n|" + "---|" * 16
)


def table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as a Markdown table."""
    return "\n".join([HEADER, *(_line(row) for row in rows)])


def _line(row: dict[str, Any]) -> str:
    own = row["code"].startswith("roughvol")
    apart = {
        name: "" if own else "imposed" if row["control"] == name else f"{row['disagreement'][key]:.0e}"
        for name, key in (("A*", "area"), ("p*", "pressure"), ("V*", "volume"), ("Δ", "indentation"))
    }
    count = f"{row.get('prefix', '')}{row['convolutions']:.1f}" + (f" ({row['fp64']:.1f} fp64)" if own else "")
    cells = [
        str(row["m"]),
        row["code"],
        f"{row['tolerance']:.1e}" + ("" if row["reaches"] else " (misses)"),
        f"{row['seconds']:.3g}",
        f"{row['cpu_seconds']:.3g}",
        f"{row['ratio']:.0f}",
        f"{row['cpu_ratio']:.0f}",
        count,
        f"{row['convolution_ms']:.2f}",
        f"{row['residual_max']:.1e}",
        f"{row['residual_median']:.1e}",
        f"{len(row['failures'])} of {row['steps']}" if row["failures"] else "0",
        *apart.values(),
    ]
    return "| " + " | ".join(cells) + " |"


def summary(rows: list[dict[str, Any]]) -> str:
    """Return the columns of `table` that performance.md shows."""
    lines = [line.strip("| ").split(" | ") for line in [HEADER.partition("\n")[0], *map(_line, rows)]]
    shown = [[cells[column] for column in (0, 1, 2, 4, 6, 7, 9, 11)] for cells in lines]
    shown.insert(1, ["---"] * len(shown[0]))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in shown)


def notes(rows: list[dict[str, Any]]) -> str:
    """Return the settings, and the steps that failed and why."""
    versions = ", ".join(f"{name} {__version__ if name == 'roughvol' else metadata.version(name)}" for name in PACKAGES)
    first = rows[0]
    operator = max(row["operator"] for row in rows)
    lines = [
        f"{time.strftime('%Y-%m-%d')}, {platform.processor() or platform.machine()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}; {versions}. One thread each (OMP_NUM_THREADS = 1).",
        f"RMD surfaces, D = {first['D']}, seed {first['seed']}, {first['steps']} equal steps to {first['end']}; "
        f"η re-measured by one operator, all codes at the loosest tolerance (factors of two) with η ≤ {TARGET:.0e} σ.",
        f"The peers' operators differ from roughvol's by at most {operator:.0e}, relative. A*, p*, V*, Δ: largest "
        "relative difference from roughvol over all solved steps; ratio: of wall times, CPU ratio: of processor times, "
        "which other work on the machine disturbs less.",
        "Tamaas' convolutions: two per iteration, iterations counted. Steps that fail count neither in time nor in "
        "convolutions.",
    ]
    for row in rows:
        if row["failures"]:
            which, why = ", ".join(map(str, row["failures"])), next(iter(row["failures"].values()))
            lines.append(f"m = {row['m']}, {row['code']}: failed at step {which}; the first: {why}.")
    return "\n".join(f"- {line}" for line in lines)


def main() -> int:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--m", type=int, nargs="+", default=[6, 7, 8])
    parser.add_argument("--D", type=float, default=2.3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--periodic", action="store_true", help="periods of a plane, kernel 2/(E* q)")
    parser.add_argument("--codes", nargs="+", default=CODES, choices=CODES, help="ContactMechanics cold, warm; Tamaas")
    parser.add_argument("--out", type=Path, default=Path("runs/bench"))
    arguments = parser.parse_args()
    for variable in THREAD_VARIABLES:
        os.environ[variable] = "1"  # read by the processes started below, before they load a library
    try:
        for name in PACKAGES:
            metadata.version(name)
    except metadata.PackageNotFoundError as missing:
        print(f"{missing}; the peers come with: pip install 'roughvol[peers]'", file=sys.stderr)
        return 1
    arguments.out.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("spawn")
    rows: list[dict[str, Any]] = []
    name = "peers_periodic" if arguments.periodic else "peers"
    tolerances: dict[str, float] = {}
    for m in arguments.m:
        case = {"m": m, "D": arguments.D, "seed": arguments.seed, "steps": arguments.steps, "tolerances": tolerances}
        case |= {"codes": arguments.codes, "kernel": "fourier" if arguments.periodic else "free"}
        with context.Pool(1) as pool:
            found = pool.apply(compare, (case,))
        tolerances = {row["code"]: row["tolerance"] for row in found}
        rows += found
        print(f"m = {m} is done", flush=True)
        text = f"{table(rows)}\n\n{notes(rows)}\n"
        (arguments.out / f"{name}.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
        (arguments.out / f"{name}.md").write_text(text, encoding="utf-8")
    print(f"\n{summary(rows)}\n\n{notes(rows)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
