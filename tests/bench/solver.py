"""What a sweep costs: convolutions per step, their time, what is left outside them, and memory (`make bench`).

The unit is one zero-padded convolution of the full grid in double precision; one in single precision counts by its
measured time, but at least one half, one over a window by its share of the points. Counts do not depend on the
machine: `--compare` holds them against the stored baseline and fails if one has grown. As a check on the counting,
"timed" is the time of all convolutions over that of the unit. Seconds, shares and memory are measured in a process per
row.

With `--kernel love` or `fourier` the surfaces are periods of a plane. Steps are equal in the approach, to A* = 0.5 or
another `--area`, and the unit is a convolution without padding.
"""

import argparse
import itertools
import json
import multiprocessing
import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

BASELINE = Path(__file__).with_name("baseline.json")
GROWTH = 1.02  # of a count per step, beyond which `--compare` fails: rounding can shift single iterations


def measure(case: dict[str, Any]) -> dict[str, Any]:
    """Run one sweep of equal steps to d = 0 and return its counts, times and memory."""
    from threadpoolctl import threadpool_limits

    from roughvol.contact.halfspace import HalfSpace
    from roughvol.contact.loading import sweep

    before = _memory("VmRSS")
    clock = time.process_time if case["threads"] == 1 else time.perf_counter  # other work lengthens the second

    class Timed(HalfSpace):
        spent = 0.0

        def displacement_above(self, *args: Any, **kwargs: Any) -> Any:
            start = clock()
            result = super().displacement_above(*args, **kwargs)
            self.spent += clock() - start
            return result

        def displacement_at(self, *args: Any, **kwargs: Any) -> Any:
            start = clock()
            result = super().displacement_at(*args, **kwargs)
            self.spent += clock() - start
            return result

    surface = _surface(case)
    half_space = Timed(surface.shape, **_body(case))
    elements = np.arange(0, surface.heights.size, 7)
    unit, unit_fp32 = (_seconds(half_space, elements, single, clock) for single in (False, True))
    assert half_space.total_compliance.size  # belongs to the grid, not to the sweep
    half_space.spent = 0.0
    steps = case["steps"]
    at = case["last"] * np.arange(1, steps + 1) / steps
    hardness = case.get("hardness")
    limit = hardness and hardness * surface.side / surface.Sq
    with threadpool_limits(1):
        start = clock()
        contacts = [
            (c.convolutions, c.convolutions_fp32, c.residual, c.contact_area_fraction)
            for c in sweep(surface, half_space, at, rtol=case["rtol"], hardness=limit)
        ]
        seconds = clock() - start
    fp64, fp32, residual, area = (np.array(column) for column in zip(*contacts, strict=True))
    return case | {
        "fp64": float(fp64.mean()),
        "fp32": float(fp32.mean()),
        "units": float(fp64.mean() + max(0.5, unit_fp32 / unit) * fp32.mean()),
        "timed": half_space.spent / steps / unit,
        "unit_ms": 1e3 * unit,
        "unit_fp32_ms": 1e3 * unit_fp32,
        "seconds": seconds,
        "outside": 1.0 - half_space.spent / seconds,
        "residual": float(residual.max()),
        "area": float(area[-1]),
        "bytes_per_element": (_memory("VmHWM") - before) / surface.heights.size,
    }


def _memory(name: str) -> float:
    """Return the memory of this process in bytes: now (VmRSS), or the most so far (VmHWM)."""
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(name))
    return 1024.0 * float(line.split()[1])


def _surface(case: dict[str, Any]) -> Any:
    from roughvol.surfaces.midpoint import random_midpoint_displacement

    return random_midpoint_displacement(
        case["D"], case["m"], side=100.0, seed=case["seed"], periodic=case["kernel"] != "free"
    )


def _body(case: dict[str, Any]) -> dict[str, Any]:
    """Return the kernel of a half space, its period and its threads."""
    free = case["kernel"] == "free"
    return {
        "kernel": "love" if free else case["kernel"],
        "threads": case["threads"],
        "sides": "free" if free else "periodic",
    }


def last_step(case: dict[str, Any]) -> float:
    """Return the indentation of the last step: at d = 0, or at an area on a period."""
    from roughvol.contact.halfspace import HalfSpace
    from roughvol.contact.search import indentation_for

    surface = _surface(case)
    if case["kernel"] == "free":
        return float((surface.z_max - surface.mean_height) / surface.Sq)
    half_space = HalfSpace(surface.shape, **_body(case))
    return indentation_for(surface, half_space, "contact_area", case["area"], rtol=1e-3)


def _seconds(half_space: Any, elements: Any, single: bool, clock: Callable[[], float]) -> float:
    """Return the median time of a convolution."""
    pressure = np.ones(elements.size)
    times = []
    for _ in range(max(5, min(200, 10_000_000 // half_space.influence.size))):
        start = clock()
        half_space.displacement_at(elements, pressure, single=single)
        times.append(clock() - start)
    return float(np.median(times[1:]))


def rows(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Return one measurement per m, D, tolerance and seed, each from a fresh process."""
    context = multiprocessing.get_context("spawn")
    found = []
    print(HEADER)
    fixed = {name: getattr(arguments, name) for name in ("threads", "steps", "hardness", "area")}
    lists = itertools.product(arguments.kernel, arguments.m, arguments.rtol, arguments.D, range(arguments.seeds))
    for kernel, m, rtol, D, seed in lists:
        case = {"m": m, "D": D, "rtol": rtol, "seed": seed, "kernel": kernel} | fixed
        with context.Pool(1) as pool:  # the memory of the search is not that of the sweep
            case["last"] = pool.apply(last_step, (case,))
        with context.Pool(1) as pool:
            row = pool.apply(measure, (case,))
        found.append(row)
        print(_line(row), flush=True)
    return found


HEADER = " kernel   m    D     η/σ  seed   fp64   fp32  units  timed  unit ms  fp32 ms  seconds  outside  bytes/element"


def _line(row: dict[str, Any]) -> str:
    return (
        f"{row['kernel']:7s}  {row['m']:2d}  {row['D']:.1f}"
        f"  {row['rtol']:.0e}  {row['seed']:3d}  {row['fp64']:5.2f}  {row['fp32']:5.2f}"
        f"  {row['units']:5.2f}  {row['timed']:5.2f}  {row['unit_ms']:7.3f}  {row['unit_fp32_ms']:7.3f}"
        f"  {row['seconds']:7.3f}  {100 * row['outside']:5.0f} %  {row['bytes_per_element']:7.0f}"
    )


def summary(found: list[dict[str, Any]]) -> str:
    """Return the means over D and seeds by m and tolerance, as a Markdown table."""
    lines = [
        "| kernel | m | η/σ ≤ | fp64 | fp32 | units per step | timed | s per sweep | outside | bytes/element |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for key in sorted({(row["kernel"], row["m"], -row["rtol"]) for row in found}):
        of = [row for row in found if (row["kernel"], row["m"], -row["rtol"]) == key]
        names = ("fp64", "fp32", "units", "timed", "seconds", "outside", "bytes_per_element")
        mean = {name: np.mean([row[name] for row in of]) for name in names}
        lines.append(
            f"| {key[0]} | {key[1]} | {-key[2]:.0e} | {mean['fp64']:.2f} | {mean['fp32']:.2f} | {mean['units']:.2f} "
            f"| {mean['timed']:.2f} | {mean['seconds']:.3g} | {100 * mean['outside']:.0f} % "
            f"| {mean['bytes_per_element']:.0f} |"
        )
    return "\n".join(lines)


def regressions(found: list[dict[str, Any]]) -> list[str]:
    """Return what has grown beyond the stored baseline, or is not in it."""
    stored = {_name(row): row for row in json.loads(BASELINE.read_text(encoding="utf-8"))}
    worse = []
    for row in found:
        known = stored.get(_name(row))
        if known is None:
            worse.append(f"{_name(row)}: not in the baseline")
            continue
        worse += [
            f"{_name(row)}: {kind} {known[kind]:.2f} -> {row[kind]:.2f} per step"
            for kind in ("fp64", "fp32")
            if row[kind] > GROWTH * known[kind] + 0.02
        ]
    return worse


def _name(row: dict[str, Any]) -> str:
    return f"{row['kernel']} m={row['m']} D={row['D']} rtol={row['rtol']:.0e} seed={row['seed']}"


def figure(found: list[dict[str, Any]], path: Path) -> None:
    """Draw time and units per step against the number of elements, with the floor of one convolution per step."""
    from matplotlib.figure import Figure

    chosen = [row for row in found if row["rtol"] == 1e-6] or found
    chosen = [row for row in chosen if row["kernel"] == chosen[0]["kernel"]]
    sizes = sorted({row["m"] for row in chosen})
    elements = [(2**m + 1) ** 2 for m in sizes]
    drawing = Figure(figsize=(7.0, 3.0), layout="constrained")
    left, right = drawing.subplots(1, 2)
    colours = ("#440154", "#2a788e", "#7ad151")
    for index, D in enumerate(sorted({row["D"] for row in chosen})):
        style = {"marker": "osD"[index % 3], "color": colours[index % 3], "label": f"$D = {D}$"}
        of = [[row for row in chosen if row["m"] == m and row["D"] == D] for m in sizes]
        left.plot(elements, [np.mean([row["seconds"] for row in group]) for group in of], **style)
        right.plot(elements, [np.mean([row["units"] for row in group]) for group in of], **style)
    floor = [1e-3 * chosen[0]["steps"] * np.mean([row["unit_ms"] for row in chosen if row["m"] == m]) for m in sizes]
    left.plot(elements, floor, "k--", label="one convolution a step")
    right.axhline(1.0, color="k", ls="--")
    steps, threads = chosen[0]["steps"], chosen[0]["threads"]
    taken = f"time of {steps} steps, {threads} thread{'s' * (threads > 1)} [s]"
    for axis, label in ((left, taken), (right, "convolutions per step [units]")):
        axis.set(xscale="log", xlabel="elements $N^2$", ylabel=label)
    left.set_yscale("log")
    right.set_ylim(0.0, None)
    left.legend(frameon=False, fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    drawing.savefig(path, dpi=200)


def main() -> int:
    """Measure, print, store, draw and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--m", type=int, nargs="+", default=[4, 5, 6, 7, 8, 9])
    parser.add_argument("--D", type=float, nargs="+", default=[2.1, 2.5, 2.9])
    parser.add_argument("--rtol", type=float, nargs="+", default=[1e-3, 1e-6])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--steps", type=int, default=60, help="1: a single solve at the last one")
    parser.add_argument("--kernel", nargs="+", default=["free"], choices=["free", "love", "fourier"])
    parser.add_argument("--area", type=float, default=0.5, help="A* at the last step of periodic surfaces")
    parser.add_argument("--hardness", type=float, help="H/E*, the largest pressure; default: elastic contact")
    parser.add_argument("--out", type=Path, default=Path("runs/bench"))
    parser.add_argument("--compare", action="store_true", help="fail if a count has grown beyond the baseline")
    parser.add_argument("--store", action="store_true", help="put these counts into the baseline")
    arguments = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    found = rows(arguments)
    print("\n" + summary(found))
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "solver.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    figure(found, arguments.out / "solver.png")
    if arguments.store:
        rows_by_name = {_name(row): row for row in [*json.loads(BASELINE.read_text(encoding="utf-8")), *found]}
        columns = ("kernel", "m", "D", "rtol", "seed", "fp64", "fp32")
        kept = [{name: row[name] for name in columns} for row in rows_by_name.values()]
        BASELINE.write_text("[\n" + ",\n".join(json.dumps(row) for row in kept) + "\n]\n", encoding="utf-8")
    worse = regressions(found) if arguments.compare else []
    print("\n".join(worse) if worse else "")
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
