"""Write the surface of a published case of MIRCO, which names a seed and no file.

`python -m tests.bench.framework_surface` writes configs/literature/files/mirco_seed95.npy: 129² nodes, H 0.7, seed 95.
The rule is midpoint displacement. Corners are 0, a new node is the mean of its neighbours plus a normal number, and the
standard deviation falls by 2^(H/2) in each half step. Normal numbers are those of GNU's C++ library.
"""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parents[2] / "configs" / "literature" / "files"
LEVELS, HURST, DEVIATION, SEED = 7, 0.7, 20.0, 95
MULTIPLIER, MODULUS = 16807, 2**31 - 1  # of minstd_rand0, C++ standard [rand.predef]


def uniform(seed: int) -> Iterator[float]:
    """Yield numbers in [0, 1), each from two steps of the generator, the first one the less significant."""
    state, span = seed, float(MODULUS - 1)
    while True:
        total = 0.0
        for weight in (1.0, span):
            state = state * MULTIPLIER % MODULUS
            total += (state - 1) * weight
        yield total / (span * span)


def normal(seed: int) -> Iterator[float]:
    """Yield normal numbers by Marsaglia's polar method, y before x of each pair."""
    numbers = uniform(seed)
    while True:
        x, y = (2.0 * next(numbers) - 1.0 for _ in range(2))
        square = x * x + y * y
        if 0.0 < square <= 1.0:
            factor = math.sqrt(-2.0 * math.log(square) / square)
            yield y * factor
            yield x * factor


def surface(levels: int = LEVELS, hurst: float = HURST, deviation: float = DEVIATION, seed: int = SEED) -> np.ndarray:
    """Return the heights, in the order in which the rule draws its numbers; the lowest node is 0."""
    n = 2**levels
    z = np.zeros((n + 1, n + 1))
    random, ratio = normal(seed), 2.0 ** (0.5 * hurst)
    step, half, scale = n, n // 2, deviation * ratio
    for _ in range(levels):
        scale /= ratio
        for j in range(half, n, step):
            for k in range(half, n, step):
                corners = z[j + half, k + half] + z[j + half, k - half] + z[j - half, k + half] + z[j - half, k - half]
                z[j, k] = corners / 4.0 + scale * next(random)
        scale /= ratio
        for j in range(half, n, step):  # the four sides
            for line, inner in ((z[:, 0], z[:, half]), (z[:, n], z[:, n - half]), (z[0], z[half]), (z[n], z[n - half])):
                line[j] = (line[j + half] + line[j - half] + inner[j]) / 3.0 + scale * next(random)
        for rows, columns in (
            (range(half, n, step), range(step, n, step)),
            (range(step, n, step), range(half, n, step)),
        ):
            for j in rows:
                for k in columns:
                    sides = z[j, k + half] + z[j, k - half] + z[j + half, k] + z[j - half, k]
                    z[j, k] = sides / 4.0 + scale * next(random)
        step, half = half, half // 2
    return z - z.min()


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    np.save(FOLDER / "mirco_seed95.npy", surface())
