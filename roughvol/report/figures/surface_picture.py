"""A picture of the surface that a study presses: map, histogram of the heights, and two profiles."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from roughvol.report.figures.style import CONTACT, PAGE, STYLE, canvas, handy
from roughvol.surfaces.surface import Surface

LIMITS = (0.1, 99.9)  # percentiles of the heights between which the colours run, so that one spike leaves them alone
BINS_PER_SQ, FEWEST_BINS, MOST_BINS = 8, 40, 400
RING = "#c0392b"  # seen on the colours of the map and on white


def look(surface: Surface, unit: str | None = None, title: str = "") -> Figure:
    """Draw the heights above the mean plane, their histogram, and the profiles along x and y through the highest point.

    To see: a spike, a hole, a tilt or a step that the numbers do not show. The dashed curve in the histogram is the
    normal distribution of the same Sq.
    """
    heights = surface.heights - surface.mean_height
    width, depth = (surface.spacing * (nodes - 1) for nodes in surface.shape)
    across, across_unit = handy(max(width, depth), unit)
    scale, height_unit = handy(3.0 * surface.Sq, unit)
    z = heights * scale
    x, y = (np.linspace(0.0, side * across, nodes) for side, nodes in zip((width, depth), z.shape, strict=True))
    row, column = np.unravel_index(int(z.argmax()), z.shape)
    with mpl.rc_context(STYLE):
        fig = canvas(PAGE, 5.4)
        grid = fig.add_gridspec(2, 2, height_ratios=(1.6, 1.0))
        _map(fig, fig.add_subplot(grid[0, 0]), z, (x, y), (x[row], y[column]), (across_unit, height_unit))
        histogram = fig.add_subplot(grid[0, 1])
        _histogram(histogram, z, surface.Sq * scale, height_unit)
        if surface.Sq > 0.0:
            numbers = f"$S_q = {surface.Sq * scale:.3g}$ {height_unit}, highest point ${surface.peak:.3g}\\,S_q$"
            histogram.set_title(f"{numbers}, lowest ${surface.pit:.3g}\\,S_q$")
        along_x = fig.add_subplot(grid[1, 0])
        along_y = fig.add_subplot(grid[1, 1], sharey=along_x)
        for ax, name, other, place, profile, at, fixed in (
            (along_x, "x", "y", x, z[:, column], x[row], y[column]),
            (along_y, "y", "x", y, z[row], y[column], x[row]),
        ):
            ax.axhline(0.0, color="0.6", lw=0.6, zorder=1)
            ax.plot(place, profile, color=CONTACT, lw=0.8)
            ax.plot(at, z[row, column], "o", mfc="none", mec=RING, ms=6, clip_on=False)
            ax.set(xlim=(place[0], place[-1]), xlabel=f"${name}$ [{across_unit}]", ylabel=f"$z$ [{height_unit}]")
            ax.set_title(f"profile at ${other} = {fixed:.4g}$ {across_unit}, through the highest point")
        fig.suptitle(title, fontsize=9.5, parse_math=False)  # a name of a file may hold dollar signs
    return fig


def _map(
    fig: Figure, ax: Any, z: Any, axes: tuple[Any, Any], highest: tuple[float, float], units: tuple[str, str]
) -> None:
    low, high = np.percentile(z, LIMITS)
    (x, y), half = axes, 0.5 * axes[0][1]
    extent = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    image = ax.imshow(z.T, origin="lower", extent=extent, cmap="viridis", vmin=low, vmax=high)
    for line, place in ((ax.axvline, highest[0]), (ax.axhline, highest[1])):
        line(place, color="white", lw=0.5, ls=(0, (4, 4)))
    ax.plot(*highest, "o", mfc="none", mec=RING, ms=8, mew=1.2, clip_on=False)
    ax.set(xlabel=f"$x$ [{units[0]}]", ylabel=f"$y$ [{units[0]}]")
    ax.set_title(f"{z.shape[0]} × {z.shape[1]} nodes, the highest in the ring")
    beside = "bottom" if x[-1] > 1.3 * y[-1] else "right"
    bar = fig.colorbar(image, ax=ax, extend="both", shrink=0.9, pad=0.02, location=beside)
    bar.set_label(f"$z$ from the mean plane [{units[1]}]")


def _histogram(ax: Any, z: Any, Sq: float, unit: str) -> None:
    span = float(z.max() - z.min())
    bins = int(np.clip(BINS_PER_SQ * span / Sq, FEWEST_BINS, MOST_BINS)) if Sq > 0.0 else FEWEST_BINS
    counts, edges, _ = ax.hist(z.ravel(), bins=bins, color=CONTACT, alpha=0.75, log=True)
    if Sq > 0.0:
        middle = np.linspace(max(float(z.min()), -6.0 * Sq), min(float(z.max()), 6.0 * Sq), 200)
        normal = z.size * (edges[1] - edges[0]) / (np.sqrt(2.0 * np.pi) * Sq) * np.exp(-0.5 * (middle / Sq) ** 2)
        ax.plot(middle, normal, "--", color="0.2", lw=0.9, label="normal, same $S_q$")
    ax.plot(float(z.max()), 1.0, "o", mfc="none", mec=RING, ms=6, label="highest point", clip_on=False)
    ax.set(ylim=(0.7, 20.0 * counts.max()), xlabel=f"$z$ from the mean plane [{unit}]", ylabel="nodes in a bin")
    ax.legend(loc="upper right")
