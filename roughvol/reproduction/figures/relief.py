"""Lit surfaces in perspective, side by side on one vertical scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LightSource
from xarray import DataArray

from roughvol.report.figures.style import CONTACT, PAGE, Drawing, canvas
from roughvol.typing import Mask


def reliefs(surfaces: Sequence[DataArray], titles: Sequence[str], height: str, contact: Mask | None = None) -> Drawing:
    """Return a figure of lit surfaces on one vertical scale."""
    columns = 3 if len(surfaces) == 3 else min(2, len(surfaces))
    rows, width = -(-len(surfaces) // columns), PAGE / max(columns, 2)
    fig = canvas(width * columns, width * rows * (0.85 if columns > 2 else 0.68) + 0.2)
    fig.set_layout_engine("constrained", rect=(0.0, 0.0, 0.96, 1.0))  # it makes no room for labels of a vertical axis
    low, high = min(float(z.min()) for z in surfaces), max(float(z.max()) for z in surfaces)
    high = high if high > low else low + 1.0  # flat
    shading: dict[str, Any] = {"blend_mode": "soft", "vmin": low, "vmax": high + 0.2 * (high - low)}
    for k, (heights, title) in enumerate(zip(surfaces, titles, strict=True)):
        x, y = heights["x"].values, heights["y"].values
        light, slope = LightSource(315, 45), 0.12 * (len(x) - 1) / (high - low)  # a third of the slopes as drawn
        colours = light.shade(heights.values, mpl.colormaps["pink"], vert_exag=slope, **shading)
        if contact is not None and k == len(surfaces) - 1:
            colours[contact] = mpl.colors.to_rgba(CONTACT)
        ax: Any = fig.add_subplot(rows, columns, k + 1, projection="3d")
        # Every node is drawn (a stride of two would show the next coarser surface), as pixels in vector formats too.
        options = {"rstride": 1, "cstride": 1, "shade": False, "antialiased": False, "lw": 0, "rasterized": True}
        facets = ax.plot_surface(*np.meshgrid(x, y, indexing="ij"), heights.values, **options)
        facets.set_facecolor(colours[:-1, :-1].reshape(-1, 4))  # `facecolors` would be read facet by facet
        ax.set(xlim=(0, x[-1]), xticks=[0, x[-1] / 2, x[-1]], ylim=(0, y[-1]), yticks=[y[-1] / 2, y[-1]])
        ax.set(zlim=(low, high), xlabel="$x/L$", ylabel="$y/L$", zlabel=height)
        ax.set_title(title, y=0.98)
        ax.zaxis.set_major_locator(mpl.ticker.MaxNLocator(3, steps=[1, 2, 5, 10], min_n_ticks=2))
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_formatter("{x:.2g}")
        ax.tick_params(pad=-3, labelsize=7)
        ax.tick_params(axis="z", pad=1)
        narrow = columns > 2
        ax.set_box_aspect((1.0, y[-1] / x[-1], 0.4), zoom=0.86 if narrow else 0.98)
        ax.patch.set_visible(False)  # it would cover the label of its neighbour
        for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
            axis.labelpad = (-4 if narrow else -2) if axis is ax.zaxis else -5
            axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    return fig
