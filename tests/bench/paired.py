"""Two versions of the solver against each other, or one with other constants: processor time, in one run.

    git worktree add ../old 7ca2980
    python -m tests.bench.paired ../old . --m 7 8 --D 2.1 2.5 --rounds 5
    python -m tests.bench.paired . ".:dense_up_to=160" --m 7
    python -m tests.bench.paired . ".:sides=mirrored" --m 7 8 9 10 --D 2.3 --steps 20 --area 0.1

With `--kernel love` or `fourier` surfaces are periods of a plane, and the last step is at A* = 0.5. `--area` sets A*
of the last step. `sides=mirrored` behind a colon mirrors the surface of a version.

Versions are folders, with constants of `Tuning` behind a colon. Each sweep has a process of its own; the versions take
turns, so that a busy machine slows all of them. The ratio is the median over the rounds, "convolving" the seconds in
convolutions.
"""

import argparse
import json
import os
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np

SWEEP = """
import json, sys, time
import numpy as np
from threadpoolctl import threadpool_limits
try:
    from roughvol.contact import HalfSpace, sweep
    from roughvol.surfaces import random_midpoint_displacement
except ImportError:  # up to 0.8.0
    from roughvol.physics.contact import sweep
    from roughvol.physics.halfspace import HalfSpace
    from roughvol.physics.surface import random_midpoint_displacement

m, D, seed, steps, repeats, rtol, kernel, area, constants = json.loads(sys.argv[1])
options, made, sides = {}, {"side": 100.0, "seed": seed}, constants.pop("sides", None)
if constants:
    from roughvol.contact import Tuning
    options["tuning"] = Tuning(**constants)
if kernel == "free":
    surface = random_midpoint_displacement(D, m, **made)
    if sides:
        from dataclasses import replace
        surface = replace(surface, sides=sides)
        half_space = HalfSpace(surface.shape, sides=sides, **options)
    else:
        half_space = HalfSpace(surface.shape, **options)
    assert half_space.total_compliance.size
    end = (surface.z_max - surface.mean_height) / surface.Sq
else:
    area = area or 0.5
    surface = random_midpoint_displacement(D, m, **made, periodic=True)
    try:
        half_space = HalfSpace(surface.shape, kernel, sides="periodic", **options)
    except TypeError:  # up to 0.11.1
        half_space = HalfSpace(surface.shape, kernel, periodic=True, **options)
if area:
    from roughvol.contact.search import indentation_for
    end = round(indentation_for(surface, half_space, "contact_area", area, rtol=1e-4), 2)
def timed(convolve):
    def clocked(*given, **options):
        start = time.process_time()
        result = convolve(*given, **options)
        convolving.append(time.process_time() - start)
        return result
    return clocked

for name in ("displacement_at", "displacement_above"):
    if hasattr(HalfSpace, name):
        setattr(HalfSpace, name, timed(getattr(HalfSpace, name)))
seconds, convolving = [], []
with threadpool_limits(1):
    for _ in range(repeats):
        start = time.process_time()
        counts = [
            (c.convolutions, c.convolutions_fp32, c.iterations)
            for c in sweep(surface, half_space, end * np.arange(1, steps + 1) / steps, rtol=rtol, **options)
        ]
        seconds.append(time.process_time() - start)
print(json.dumps([float(np.median(seconds)), sum(convolving) / repeats, *np.mean(counts, axis=0)]))
"""


def measure(version: str, case: list[object]) -> list[float]:
    """Return seconds, seconds in convolutions, and convolutions and iterations per step, from a process of its own."""
    folder, _, text = version.partition(":")
    constants = dict(pair.split("=") for pair in text.split(",") if pair)
    numbers = {name: value if name == "sides" else json.loads(value) for name, value in constants.items()}
    threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    environment = os.environ | threads | {"PYTHONPATH": str(Path(folder).resolve())}
    command = [sys.executable, "-c", SWEEP, json.dumps([*case, numbers])]
    run = subprocess.run(command, cwd=folder, env=environment, check=True, stdout=subprocess.PIPE)
    return json.loads(run.stdout)


def main() -> None:
    """Measure and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("versions", nargs="+")
    parser.add_argument("--m", type=int, nargs="+", default=[7, 8, 9])
    parser.add_argument("--D", type=float, nargs="+", default=[2.1, 2.5])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--rtol", type=float, default=1e-6)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--kernel", default="free", help="free, or that of a period: love, punch, fourier")
    parser.add_argument("--area", type=float, help="A* of the last step; default: d = 0, or A* = 0.5 on a period")
    parser.add_argument("--repeats", type=int, default=1, help="sweeps in each process; the median counts")
    given = parser.parse_args()
    print("| m | D | version | CPU s | ratio | convolving | fp64 | fp32 | iterations |\n|" + "---|" * 9)
    for m, D in product(given.m, given.D):
        case = [m, D, given.seed, given.steps, given.repeats, given.rtol, given.kernel, given.area]
        rounds = np.array([[measure(version, case) for version in given.versions] for _ in range(given.rounds)])
        ratios = np.median(rounds[:, :, 0] / rounds[:, :1, 0], axis=0)
        for version, numbers, ratio in zip(given.versions, np.median(rounds, axis=0), ratios, strict=True):
            seconds, convolving, *counts = numbers
            shown = " | ".join(f"{count:.2f}" for count in counts)
            print(f"| {m} | {D} | {version} | {seconds:.3g} | {ratio:.2f} | {convolving:.3g} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
