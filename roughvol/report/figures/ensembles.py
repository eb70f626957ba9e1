"""The figure of an ensemble: the cost of its answer by level.

It is a function of the dataset of a study with a section ``ensemble``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from xarray import Dataset

from roughvol.report.figures.families import file_text
from roughvol.report.figures.style import DASHES, GREY, PAGE, Drawing, axes, looks, plain_ticks
from roughvol.typing import Array

NORMAL = 1.96  # of the 95 % interval of many samples
MANY = 3  # so many different means, or more, are not named
LINES = DASHES[:3]  # dots are plain Monte Carlo


def ensemble_cost(ds: Dataset) -> Drawing:
    """Draw samples and cost by level, and the half-width of the interval against cost, beside plain Monte Carlo.

    Costs are modelled seconds of one core, from the counts of convolutions. Of each D the mean is shown that is
    farthest from its accuracy; a mean of zero has no relative interval.
    To see: most samples are on coarse levels, and cost is spread over all; the interval falls with the square root of
    the cost, as that of plain Monte Carlo does, at a fraction of its cost.
    """
    fig, (left, middle, right) = axes(PAGE, 2.8, 3, grid=True)
    dimensions = ds["D"].values
    levels = ds["m"].values
    counts = ds["ensemble_samples"].transpose("D", "m").values
    means = dict[str, None]()
    for order, (D, samples, look) in enumerate(zip(dimensions, counts, looks(len(dimensions)), strict=True)):
        of_D, line = ds.sel(D=D), LINES[order % len(LINES)]
        label = f"$D = {D:g}$"
        left.plot(levels, samples, ls=line, label=label, **look)
        middle.plot(levels, samples * of_D["ensemble_sample_cost"].values, ls=line, label=f"_{label}", **look)
        if (farthest := _farthest(of_D)) is not None:
            means[_draw_intervals(right, of_D, *farthest, line, look)] = None
    words = "\n".join(means) or "every mean is 0"
    right.set_title(words if len(means) < MANY else "mean farthest from its accuracy")
    left.set(xlabel="$m$", ylabel="samples", xticks=levels, yscale="log")
    middle.set(xlabel="$m$", ylabel="cost of the level [s]", xticks=levels, yscale="log")
    right.set(xlabel="cost [s]", ylabel="half-width of the interval [%]", xscale="log", yscale="log")
    for axis in (left.yaxis, middle.yaxis, right.xaxis, right.yaxis):
        plain_ticks(axis)
    handles = [
        *left.get_legend_handles_labels()[0],
        Line2D([], [], color="k", ls=":", lw=0.8, label="plain Monte Carlo"),
        Line2D([], [], color=GREY, lw=0.5, label="accuracy asked for"),
    ]
    fig.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    fig.shown = {"D": dimensions.tolist(), "m": levels.tolist(), "samples": counts.ravel().tolist()}
    return fig


def _draw_intervals(ax: Any, of_D: Dataset, name: str, at: str, line: Any, look: dict[str, Any]) -> str:
    """Draw the half-width of a mean against cost, beside plain Monte Carlo and the request; return which mean it is."""
    state = of_D.sel(ensemble_at=at)
    percent = 100.0 / abs(float(state[f"{name}_mean"]))
    cost = of_D["ensemble_round_cost"].values
    label = f"_$D = {float(of_D['D']):g}$"
    ax.plot(cost, percent * state[f"{name}_round_half_width"].values, ls=line, label=label, **look)
    every = [*cost, float(of_D["ensemble_plain_cost"])]
    plain_cost = np.geomspace(np.nanmin(every), np.nanmax(every), 9)
    plain: dict[str, Any] = {"ls": ":", "lw": 0.8, "color": look["color"], "label": f"{label}, plain Monte Carlo"}
    ax.plot(plain_cost, percent * _plain_half_width(state, name, plain_cost), **plain)
    ax.axhline(percent * float(state[f"{name}_accuracy_asked"]), lw=0.5, color=GREY, zorder=0)
    symbol = str(state[f"{name}_mean"].attrs.get("symbol", name)).strip("<>")
    return file_text(symbol if at == "percolation" else f"{symbol} at {at}")


def _plain_half_width(state: Dataset, name: str, cost: Array) -> Array:
    """Return the half-width of plain Monte Carlo on the finest level for a cost [s]."""
    finest = state.isel(m=-1)
    samples = cost / float(finest["ensemble_sample_cost"])
    return NORMAL * np.sqrt(float(finest[f"{name}_level_variance"]) / samples)


def _farthest(of_D: Dataset) -> tuple[str, str] | None:
    """Return the mean other than 0 whose interval is widest for its accuracy, by its stored name and state."""
    ratios = {}
    for name in (str(name).removesuffix("_accuracy_asked") for name in of_D if str(name).endswith("_accuracy_asked")):
        half = 0.5 * (of_D[f"{name}_interval"].sel(bound="upper") - of_D[f"{name}_interval"].sel(bound="lower"))
        for at in of_D["ensemble_at"].values.tolist():
            ratio = float(half.sel(ensemble_at=at) / of_D[f"{name}_accuracy_asked"].sel(ensemble_at=at))
            if np.isfinite(ratio) and float(of_D[f"{name}_mean"].sel(ensemble_at=at)) != 0.0:
                ratios[name, at] = ratio
    return max(ratios, key=ratios.__getitem__, default=None)
