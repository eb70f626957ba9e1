"""Solve the reference case of tests/contact/test_loading.py by a slow dense method.

Run `python tests/reference/make_cases.py`.

Nothing of roughvol is imported. The heights are a sum of cosines with random phases. Each element of the surface is a
square under uniform pressure (Love, 1929). The contact set starts as the rigid overlap. Each round solves its equations
by Cholesky, then removes elements in tension and adds elements that penetrate. The conditions of contact are sufficient
and checked at the end, in units of the standard deviation of the heights: gap and penetration to 1e-12.
"""

from pathlib import Path

import numpy as np
from scipy import linalg

FOLDER = Path(__file__).parent
SHAPE, SPACING = (33, 25), 1.5  # nodes; um
YOUNG = 2.0  # effective modulus E*, GPa
SHARES = (0.3, 0.7, 1.2)  # of the peak height above the mean plane: indentations


def rough_heights() -> np.ndarray:
    """Return heights in um: 60 cosines, amplitude falling with the wave number as on a fractal of D = 2.3."""
    random = np.random.Generator(np.random.PCG64(33))
    x, y = np.meshgrid(*(np.linspace(0.0, n / SHAPE[0], n) for n in SHAPE), indexing="ij")
    heights = np.zeros(SHAPE)
    for _ in range(60):
        number, angle, phase = random.uniform(1.0, 12.0), *random.uniform(0.0, 2.0 * np.pi, 2)
        wave = np.cos(2.0 * np.pi * number * (np.cos(angle) * x + np.sin(angle) * y) + phase)
        heights += number**-1.2 * wave
    return np.round(heights, 4)


def love_matrix() -> np.ndarray:
    """Return the displacement in um of each element under a pressure of 1 GPa on each other, for E* in GPa."""
    row, column = np.divmod(np.arange(SHAPE[0] * SHAPE[1]), SHAPE[1])
    x = SPACING * (row[:, None] - row).astype(float)
    y = SPACING * (column[:, None] - column).astype(float)
    half = SPACING / 2.0

    def corner(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b))

    corners = corner(x + half, y + half) - corner(x + half, y - half)
    corners += corner(x - half, y - half) - corner(x - half, y + half)
    return corners / (np.pi * YOUNG)


def solved(matrix: np.ndarray, overlap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pressure and gap for an overlap of the undeformed bodies."""
    touching = overlap > 0.0
    for _ in range(200):
        pressure = np.zeros(overlap.size)
        inside = np.flatnonzero(touching)
        factor = linalg.cho_factor(matrix[np.ix_(inside, inside)])
        pressure[inside] = linalg.cho_solve(factor, overlap[inside])
        residual = overlap[inside] - matrix[np.ix_(inside, inside)] @ pressure[inside]
        pressure[inside] += linalg.cho_solve(factor, residual)  # refined once
        gap = matrix @ pressure - overlap
        after = np.where(touching, pressure > 0.0, gap < 0.0)
        if np.array_equal(after, touching):
            return pressure, np.where(touching, 0.0, gap)
        touching = after
    raise ArithmeticError("the contact set does not settle")


def main() -> None:
    """Solve the states, check them, and store them beside this file."""
    heights = rough_heights()
    matrix, sigma = love_matrix(), heights.std()
    indentations = [share * (heights.max() - heights.mean()) for share in SHARES]
    pressures, gaps = [], []
    for indentation in indentations:
        overlap = (heights - heights.max() + indentation).ravel()
        pressure, gap = solved(matrix, overlap)
        error = np.abs(matrix @ pressure - overlap - gap).max() / sigma
        assert pressure.min() >= 0.0
        assert gap.min() >= 0.0
        assert not (pressure * gap).any()
        assert error < 1e-12, error
        pressures.append(pressure.reshape(SHAPE))
        gaps.append(gap.reshape(SHAPE))
        print(f"{indentation:.6f} um: {np.count_nonzero(pressure)} of {pressure.size} elements, error {error:.1e} σ")
    np.savez_compressed(
        FOLDER / "rough_33x25.npz",
        z=heights,
        dx=SPACING,
        E_star=YOUNG,
        delta=indentations,
        pressure=pressures,
        gap=gaps,
    )


if __name__ == "__main__":
    main()
