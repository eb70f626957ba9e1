"""How good the approximate inverses of the solver are: eigenvalues of M⁻¹K and iterations, given the true contact.

    python -m tests.bench.inverse --m 9 10 --D 2.1 2.5

Sweeps to d = 0, and solves the last step once more on the contact set it ended with, by plain conjugate gradients from
the secant of the two states before: with the near field alone, and with blocks (solver.md). Counts only: the first
and the last eigenvalue, and the iterations to 10⁻⁶ σ.
"""

import argparse
from collections import deque
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigs
from threadpoolctl import threadpool_limits

from roughvol.contact.far_field import by_blocks
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.contact.near_field import near_field
from roughvol.contact.options import Tuning
from roughvol.surfaces.midpoint import random_midpoint_displacement

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
        rows = []
        for name, reach in (("near field, √2", 2.0), ("near field, √5", 5.0), ("blocks", 5.0)):
            inverse: Any = near_field(half_space, elements, Tuning(near_reach=reach**0.5))
            if name == "blocks":
                t = np.maximum(rate + inverse(1.0 - displacement), 0.0)
                inverse = by_blocks(inverse, half_space, elements, t)
            needed = iterate(half_space, elements, inverse, residual)
            rows.append((name, *extremes(half_space, elements, inverse), needed))
    return rows


def field(state: dict[str, Any], surface: Any) -> Any:
    """Return the pressures of a state on the whole grid, flat."""
    pressure = np.zeros(surface.heights.size)
    pressure[state["elements"]] = state["pressure"]
    return pressure


def iterate(half_space: Any, elements: Any, inverse: Any, r: Any) -> int | None:
    """Return after how many conjugate gradients (Polak-Ribière) |r| ≤ 10⁻⁶ σ, if it is so soon."""
    direction, old, product = np.zeros_like(r), np.zeros_like(r), 1.0
    for iteration in range(1, ITERATIONS + 1):
        z = inverse(r)
        last, product = product, float(r @ z)
        direction = z + max(0.0, (product - float(old @ z)) / last) * direction
        response = half_space.displacement_at(elements, direction)
        old, r = r, r - float(r @ direction) / float(direction @ response) * response
        if np.abs(r).max() <= TOLERANCE:
            return iteration
    return None


def extremes(half_space: Any, elements: Any, inverse: Any) -> tuple[float, float]:
    """Return the least and the largest real part of the eigenvalues of K M⁻¹, to one per cent."""
    count = elements.size

    def image(r: Any) -> Any:
        return half_space.displacement_at(elements, inverse(r.ravel()))

    operator = LinearOperator((count, count), matvec=image, dtype=float)
    least, largest = (
        eigs(operator, 1, which=which, tol=1e-2, v0=np.ones(count), return_eigenvectors=False)[0].real
        for which in ("SR", "LR")
    )
    return float(least), float(largest)


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
