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


def nms(heights: np.ndarray, dx: float, dy: float) -> bytes:
    """NanoFocus: counts of 16 bits between the limits of z, the first line of the image first."""
    low, high = float(heights.min()), float(heights.max())
    head = bytearray(3468)
    struct.pack_into("<2I", head, 0, 2, 1)
    struct.pack_into("<2d", head, 16, low, high)
    struct.pack_into("<2I2d", head, 1368, *heights.shape, dx, dy)
    counts = np.rint((heights.T - low) / (high - low) * 65534).astype("<u2")
    return bytes(head) + counts.tobytes() + bytes(heights.size)


def wsxm(heights: np.ndarray, kind: str, size: tuple[float, float]) -> bytes:
    """WSxM: rows in the order of rising y, the numbers of a row in the order of falling x; sizes in um, heights in nm.

    https://spmimages.ftmc.uam.es/file-specifications; y falls with the index of an image, so it is that of the caller.
    """
    numbers = 1e3 * heights.T[:, ::-1]
    low, high = float(numbers.min()), float(numbers.max())
    if kind == "short":
        numbers, low, high = np.rint(30000 * (numbers - low) / (high - low)), 0, 30000
    text = (
        "WSxM file copyright Nanotec Electronica\r\nSxM Image file\r\nImage header size: 0\r\n\r\n"
        f"[Control]\r\n\r\n    X Amplitude: {size[0]} µm\r\n    Y Amplitude: {size[1]} µm\r\n\r\n"
        f"[General Info]\r\n\r\n    Image Data Type: {kind}\r\n"
        f"    Number of columns: {heights.shape[0]}\r\n    Number of rows: {heights.shape[1]}\r\n"
        f"    Z Amplitude: {1e3 * float(np.ptp(heights))} nm\r\n\r\n"
        f"[Miscellaneous]\r\n\r\n    Maximum: {high}\r\n    Minimum: {low}\r\n\r\n[Header end]\r\n"
    )
    return text.encode("latin-1") + numbers.astype({"double": "<f8", "float": "<f4", "short": "<i2"}[kind]).tobytes()
