"""Files of heights as the descriptions of their formats have them, written without the readers under test.

Heights have x as their first axis; y rises with the second. NaN is a missing height.
"""

from __future__ import annotations

import struct

import numpy as np

BLANK = 1.70141e38
X, Y = (2.0, 4.5), (-1.0, 3.0)  # limits of a grid of 6 x 5 nodes with spacings 0.5 and 1


def surfer_text(heights: np.ndarray, x: tuple[float, float] = X, y: tuple[float, float] = Y) -> bytes:
    """Rows of constant y, the lowest y first."""
    rows = "\n\n".join(" ".join("1.70141e+038" if np.isnan(z) else repr(float(z)) for z in row) for row in heights.T)
    nx, ny = heights.shape
    limits = f"{x[0]} {x[1]}\n{y[0]} {y[1]}\n{np.nanmin(heights)} {np.nanmax(heights)}"
    return f"DSAA\n{nx} {ny}\n{limits}\n{rows}\n".encode("ascii")


def surfer_6(heights: np.ndarray, x: tuple[float, float] = X, y: tuple[float, float] = Y) -> bytes:
    head = struct.pack("<4s2h6d", b"DSBB", *heights.shape, *x, *y, np.nanmin(heights), np.nanmax(heights))
    return head + np.where(np.isnan(heights), BLANK, heights).T.astype("<f4").tobytes()


def surfer_7(
    heights: np.ndarray,
    x: tuple[float, float] = X,
    y: tuple[float, float] = Y,
    version: int = 2,
    blank: float = BLANK,
    between: bytes = b"",
) -> bytes:
    nx, ny = heights.shape
    spacing = (x[1] - x[0]) / (nx - 1), (y[1] - y[0]) / (ny - 1)
    numbers = (x[0], y[0], *spacing, np.nanmin(heights), np.nanmax(heights), 0.0, blank)
    data = np.where(np.isnan(heights), blank, heights).T.astype("<f8").tobytes()
    return (
        struct.pack("<4sii", b"DSRB", 4, version)
        + between
        + struct.pack("<4si2i8d", b"GRID", 72, ny, nx, *numbers)
        + struct.pack("<4si", b"DATA", len(data))
        + data
    )
