"""The constants of `roughvol/ensemble/cost.py`, fitted to sweeps and searches on this machine.

`python -m tests.bench.cost_rule [m …]`. The time of a step is STEP + n PER_CONVOLUTION t, and ITERATIVE more
where the iteration is used (m > 5); t is the time of one convolution, n how many a step takes:

    n = 1 + (UNITS + UNITS_PER_LEVEL (m - 6)) (log10(1/η) / 6)^DIGITS_POWER,    m > 5.

n is fitted to counts, the others to processor times, by relative least squares; a search is told in steps of a sweep to
the same residual. Printed are the constants, and how far the rule is off for every grid and accuracy.
"""

from __future__ import annotations

import itertools
import math
import sys
import time

import numpy as np
from scipy.optimize import nnls
from threadpoolctl import threadpool_limits

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.contact.search import indentation_for
from roughvol.ensemble import cost
from roughvol.study import ACCURACY
from roughvol.surfaces.midpoint import random_midpoint_displacement

STEPS = 60
SEEDS = 2


def measure(m: int, D: float, seed: int) -> list[tuple[float, float, float, float, float, float]]:
    """Return (m, digits, convolution's seconds, units a step, seconds a step, steps a search is worth) by accuracy."""
    surface = random_midpoint_displacement(D, m, seed=seed)
    half_space = HalfSpace(surface.shape)
    end = (surface.z_max - surface.mean_height) / surface.Sq
    list(sweep(surface, half_space, [end]))  # plans and tables
    single, double = (_seconds(half_space, how) for how in (True, False))
    rows = []
    for rtol in ACCURACY.values():
        started, counts = time.process_time(), _units(half_space, single / double)
        list(sweep(surface, half_space, end * np.arange(1, STEPS + 1) / STEPS, rtol=rtol))
        seconds = (time.process_time() - started) / STEPS
        units = (_units(half_space, single / double) - counts) / STEPS
        started = time.process_time()
        for target, value in (("contact_area", 0.05), ("pressure", 1.0)):
            indentation_for(surface, half_space, target, value, rtol=rtol)
        search = (time.process_time() - started) / 2 / seconds
        rows.append((m, -math.log10(rtol), double, units, seconds, search))
    return rows


def _units(half_space: HalfSpace, ratio: float) -> float:
    return half_space.convolutions + ratio * half_space.convolutions_fp32


def _seconds(half_space: HalfSpace, single: bool) -> float:
    elements = np.arange(math.prod(half_space.shape))
    pressure = np.ones(elements.size, dtype=np.float32 if single else np.float64)
    times = []
    for _ in range(9):
        started = time.process_time()
        half_space.displacement_at(elements, pressure, single=single)
        times.append(time.process_time() - started)
    return float(np.median(times[2:]))


def main() -> int:
    """Measure, fit, print."""
    grids = [int(m) for m in sys.argv[1:]] or [4, 5, 6, 7, 8, 9]
    with threadpool_limits(1):
        rows = [
            row for m, D, seed in itertools.product(grids, (2.1, 2.5, 2.9), range(SEEDS)) for row in measure(m, D, seed)
        ]
    m, digits, convolution, units, seconds, search = np.array(rows).T
    some = m > 5

    def factors(power: float) -> np.ndarray:
        return np.column_stack((np.ones_like(m), m - 6.0))[some] * (digits[some, None] / 6.0) ** power

    def fit(power: float) -> tuple[np.ndarray, float]:
        return nnls(factors(power) / units[some, None], ((units - 1.0) / units)[some])

    power = min(np.arange(0.5, 3.0, 0.05), key=lambda power: fit(power)[1])
    at_six, per_level = fit(power)[0]
    model = np.ones_like(m)
    model[some] += factors(power) @ (at_six, per_level)
    columns = np.column_stack((np.ones_like(m), some, model * convolution))
    times = nnls(columns / seconds[:, None], np.ones_like(seconds))[0]
    names = ("STEP", "ITERATIVE", "PER_CONVOLUTION")
    print("  ".join(f"{name} = {value:.2g}" for name, value in zip(names, times, strict=True)))
    print(f"UNITS = {at_six:.2f}  UNITS_PER_LEVEL = {per_level:.2f}  DIGITS_POWER = {power:.2f}", end="  ")
    print(f"SEARCH = {np.median(search):.0f}")
    shapes = [(2 ** int(k) + 1,) * 2 for k in m]
    rule = np.array(
        [cost.seconds_per_step(*row) for row in zip(shapes, 10.0**-digits, convolution, strict=True)], dtype=float
    )
    fitted = columns @ times
    print("   m  η/σ    units  s a step   fitted: off by   rule in the package: off by   a search in steps")
    for k, d in sorted({(k, d) for k, d in zip(m, digits, strict=True)}):
        here = (m == k) & (digits == d)
        off = [np.exp(np.mean(np.log((x / seconds)[here]))) for x in (fitted, rule)]
        print(
            f"  {k:2.0f}  1e-{d:.0f} {units[here].mean():6.2f}  {seconds[here].mean():.2e}   {off[0]:6.2f}           "
            f"{off[1]:6.2f}                       {search[here].mean():5.1f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
