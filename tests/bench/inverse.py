"""How good the approximate inverses of the solver are: eigenvalues of M⁻¹K and iterations, given the true contact.

    python -m tests.bench.inverse --m 9 10 --D 2.1 2.5

Sweeps to d = 0, and solves the last step once more on the contact set it ended with, by plain conjugate gradients from
the secant of the two states before: with the near field alone, with hats, and with blocks (docs/solver.md). Counts
only: the first and the last eigenvalue that twenty iterations see, and the iterations to 10⁻⁶ σ.
"""

from __future__ import annotations

import argparse
from collections import deque
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import linalg
from threadpoolctl import threadpool_limits

from roughvol.physics.blocks import by_blocks
from roughvol.physics.contact import sweep
from roughvol.physics.halfspace import HalfSpace
from roughvol.physics.precondition import near_field, two_level
from roughvol.physics.surface import random_midpoint_displacement

STEPS, ITERATIONS, TOLERANCE = 60, 20, 1e-6


def measure(m: int, D: float, seed: int, threads: int) -> list[tuple[str, float, float, int | None]]:
    """Return name, first and last eigenvalue, and iterations, of each inverse."""
    surface = random_midpoint_displacement(D, m, side=100.0, seed=seed)
    half_space = HalfSpace(surface.shape, threads=threads)
    last = (surface.z_max - surface.mean_height) / surface.Sq
    with threadpool_limits(1):
        kept = deque(sweep(surface, half_space, last * np.arange(1, STEPS + 1) / STEPS), maxlen=3)
        before, now, after = (contact.state() for contact in kept)
        elements = after["elements"]
        rate = (field(now, surface) - field(before, surface))[elements] * STEPS / last
        displacement = (now["touch_at"] - before["touch_at"])[elements] * STEPS / last
        residual = after["indentation"] - (2.0 * now["touch_at"] - before["touch_at"])[elements]
        influence, shape = half_space.influence, half_space.shape
        rows = []
        for name, reach in (("near field, √2", 2.0), ("near field, √5", 5.0), ("hats", 5.0), ("blocks", 2.0)):
            inverse: Any = near_field(influence, shape[1], elements, reach**0.5)
            t = np.maximum(rate + inverse(1.0 - displacement), 0.0)
            if name in ("hats", "blocks"):
                inverse = (two_level if name == "hats" else by_blocks)(inverse, influence, shape, elements, t)
            rows.append((name, *iterate(half_space, elements, inverse, residual)))
    return rows


def field(state: dict[str, Any], surface: Any) -> Any:
    """Return the pressures of a state on the whole grid, flat."""
    pressure = np.zeros(surface.heights.size)
    pressure[state["elements"]] = state["pressure"]
    return pressure


def iterate(half_space: Any, elements: Any, inverse: Any, r: Any) -> tuple[float, float, int | None]:
    """Return the extreme Ritz values of conjugate gradients (Lanczos), and after how many |r| ≤ 10⁻⁶ σ."""
    direction = np.zeros_like(r)
    product, needed, lengths, ratios = 1.0, None, [], []
    for iteration in range(1, ITERATIONS + 1):
        z = inverse(r)
        product, old = float(r @ z), product
        ratios.append(product / old if lengths else 0.0)
        direction = z + ratios[-1] * direction
        response = half_space.displacement_at(elements, direction)
        lengths.append(product / float(direction @ response))
        r = r - lengths[-1] * response
        largest = float(np.abs(r).max())
        needed = iteration if needed is None and largest <= TOLERANCE else needed
        if largest <= 1e-3 * TOLERANCE:
            break
    diagonal = [1.0 / lengths[0]] + [
        1.0 / b + ratio / a for (a, b), ratio in zip(pairwise(lengths), ratios[1:], strict=True)
    ]
    beside = [ratio**0.5 / a for a, ratio in zip(lengths, ratios[1:], strict=False)]
    values = linalg.eigvalsh_tridiagonal(np.array(diagonal), np.array(beside))
    return float(values[0]), float(values[-1]), needed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--m", type=int, nargs="+", default=[8, 9, 10])
    parser.add_argument("--D", type=float, nargs="+", default=[2.1, 2.5])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    print("| m | D | inverse | eigenvalues | iterations |\n|---|---|---|---|---|")
    for m in arguments.m:
        for D in arguments.D:
            for name, first, final, needed in measure(m, D, arguments.seed, arguments.threads):
                shown = needed or f"> {ITERATIONS}"
                print(f"| {m} | {D} | {name} | {first:.2f} … {final:.3g} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
