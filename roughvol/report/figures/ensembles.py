"""Figures of an ensemble: the cost of its answer by level, and the error of a mean by seeds, m and cost.

``FIGURES["ensemble_cost"](ds)`` is a matplotlib ``Figure`` of the dataset of a study with a section ``ensemble``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from xarray import Dataset

from roughvol.report.figures.origin import Draw, register
from roughvol.report.figures.style import DASHES, GREY, PAGE, Drawing, canvas, looks, plain_ticks
from roughvol.typing import Array

FIGURES: dict[str, Draw] = {}
NORMAL = 1.96  # of the 95 % interval of many samples
PANELS = 3  # most D of a figure
LEVELS = 5  # most m of a figure, the finest
SEEDS = (10, 100, 1000)  # numbers of seeds marked
LINES = DASHES[:3]  # dots are plain Monte Carlo


def missing(name: str, ds: Dataset) -> str | None:
    """Return why a figure cannot be drawn from a dataset, or None if it can."""
    return None if "ensemble_samples" in ds else f"{name} needs a study with a section 'ensemble'"


def _figure(draw: Draw) -> Draw:
    return register(draw, FIGURES, missing)


@_figure
def ensemble_cost(ds: Dataset) -> Drawing:
    """Draw samples and cost by level, and the half-width of the interval against cost, beside plain Monte Carlo.

    Costs are modelled seconds of one core, from the counts of convolutions. Of each D the mean is shown that is
    farthest from its accuracy.
    To see: most samples are on coarse levels, and cost is spread over all; the interval falls with the square root of
    the cost, as that of plain Monte Carlo does, at a fraction of its cost.
    """
    fig = canvas(PAGE, 2.8)
    left, middle, right = fig.subplots(1, 3)
    dimensions = ds["D"].values
    levels = ds["m"].values
    counts = ds["ensemble_samples"].transpose("D", "m").values
    for order, (D, look) in enumerate(zip(dimensions, looks(len(dimensions)), strict=True)):
        one = ds.sel(D=D)
        line = LINES[order % len(LINES)]
        samples = counts[order]
        left.plot(levels, samples, ls=line, label=f"$D = {D:g}$", **look)
        middle.plot(levels, samples * one["ensemble_sample_cost"].values, ls=line, **look)
        _draw_intervals(right, one, line, look)
    left.set(xlabel="$m$", ylabel="samples", xticks=levels, yscale="log")
    middle.set(xlabel="$m$", ylabel="cost of the level [s]", xticks=levels, yscale="log")
    right.set(xlabel="cost [s]", ylabel="half-width of the interval [%]", xscale="log", yscale="log")
    for axis in (left.yaxis, middle.yaxis, right.xaxis, right.yaxis):
        plain_ticks(axis, _steps(axis))
    handles = [
        *left.get_legend_handles_labels()[0],
        Line2D([], [], color="k", ls=":", lw=0.8, label="plain Monte Carlo"),
        Line2D([], [], color=GREY, lw=0.5, label="accuracy asked for"),
    ]
    fig.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    for ax in (left, middle, right):
        ax.grid(visible=True)
    fig.shown = {"D": dimensions.tolist(), "m": levels.tolist(), "samples": counts.ravel().tolist()}
    return fig


@_figure
def answer_cost(ds: Dataset) -> Drawing:
    """Draw the error of the mean against cost: a number of seeds on one m, and the ensemble.

    The mean is that of V*, at the state farthest from its accuracy; of another quantity in a study without V*.
    The error is the half-width of the 95 % interval over seeds, plus the distance of this m from the limit. Without a
    limit it is the distance from the finest m. Dots are 10, 100, 1000 seeds. Costs are modelled seconds of one core.
    The dashed line is the error that the solver certifies.
    To see: at each m more seeds help down to the error of the resolution, and no further; a finer m pays once seeds do
    not; the ensemble has the error of the finest m at the cost of a coarse one.
    """
    dimensions = ds["D"].values[:: max(1, (ds.sizes["D"] - 1) // (PANELS - 1))][:PANELS]
    fig = canvas(PAGE, 2.8)
    panels = np.atleast_1d(fig.subplots(1, len(dimensions), sharey=True))
    levels = ds["m"].values[-LEVELS:]
    ranked = _ranked(ds.sel(D=dimensions[0]))
    name, at = next((pair for pair in ranked if pair[0] == "free_volume"), ranked[0])
    for ax, D in zip(panels, dimensions, strict=True):
        one = ds.sel(D=D)
        state = one.sel(ensemble_at=at)
        for m, look in zip(levels, looks(len(levels)), strict=True):
            _draw_level(ax, state.sel(m=m), name, _distance(state, name, m), look)
        percent = 100.0 / abs(float(state[f"{name}_mean"]))
        error = state[f"{name}_round_half_width"].values + _distance(state, name, levels[-1])
        ax.plot(one["ensemble_round_cost"].values, percent * error, color="k", lw=1.4, marker="s", ms=3)
        certified = percent * float(state[f"{name}_solver_error"])
        if certified > 0.0:
            ax.axhline(certified, ls="--", lw=0.8, color=GREY)
        symbol = ds[f"{name}_mean"].attrs.get("symbol", "").strip("<>")
        ax.set(
            xlabel="cost [s]", xscale="log", yscale="log", title=f"$D = {D:g}$, {symbol} at {at.replace('=', ' = ')}"
        )
        ax.grid(visible=True)
        for axis in (ax.xaxis, ax.yaxis):
            plain_ticks(axis, _steps(axis))
    panels[0].set_ylabel("error of the mean [%]")
    handles = [
        *panels[0].get_legend_handles_labels()[0],
        Line2D([], [], color="k", lw=1.4, marker="s", ms=3, label="ensemble"),
        Line2D([], [], color=GREY, ls="--", lw=0.8, label="solver"),
    ]
    fig.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    counts = ds["ensemble_samples"].sel(D=dimensions, m=levels).transpose("D", "m").values
    fig.shown = {"D": dimensions.tolist(), "m": levels.tolist(), "samples": counts.ravel().tolist()}
    return fig


def _draw_level(ax: Any, level: Dataset, name: str, distance: float, look: dict[str, Any]) -> None:
    """Draw the error of the mean of n seeds on one level against cost, with dots at powers of ten."""
    seeds = np.geomspace(SEEDS[0], SEEDS[-1], 25)
    percent = 100.0 / abs(float(level[f"{name}_mean"]))
    spread, seconds = float(level[f"{name}_level_variance"]) ** 0.5, float(level["ensemble_sample_cost"])

    def error(n: Array) -> Array:
        return percent * (NORMAL * spread / np.sqrt(n) + distance)

    label = f"$m = {int(level['m'])}$"
    ax.plot(seconds * seeds, error(seeds), **(look | {"marker": "", "ls": "-"}), label=label)
    dots = np.array(SEEDS, dtype=np.float64)
    ax.plot(seconds * dots, error(dots), **(look | {"marker": ".", "ls": ""}))


def _distance(state: Dataset, name: str, m: int) -> float:
    """Return the distance of the mean on a level from its limit; from the finest level without one."""
    means = state[f"{name}_level_mean"]
    from_finest = abs(float(means.sel(m=m)) - float(means.isel(m=-1)))
    return from_finest + float(np.nan_to_num(state[f"{name}_bias"]))


def _draw_intervals(ax: Any, one: Dataset, line: Any, look: dict[str, Any]) -> None:
    """Draw the half-width of one D against cost, that of plain Monte Carlo, and the request."""
    name, at = _farthest(one)
    state = one.sel(ensemble_at=at)
    percent = 100.0 / abs(float(state[f"{name}_mean"]))
    cost = one["ensemble_round_cost"].values
    ax.plot(cost, percent * state[f"{name}_round_half_width"].values, ls=line, **look)
    end = max(float(np.nanmax(cost)), float(one["ensemble_plain_cost"]))
    plain_cost = np.geomspace(np.nanmin(cost), end, 9)
    ax.plot(plain_cost, percent * _plain_half_width(state, name, plain_cost), ls=":", lw=0.8, color=look["color"])
    ax.axhline(percent * float(state[f"{name}_accuracy_asked"]), lw=0.5, color=GREY, zorder=0)


def _plain_half_width(state: Dataset, name: str, cost: Array) -> Array:
    """Return the half-width of plain Monte Carlo on the finest level for a cost [s]."""
    finest = state.isel(m=-1)
    samples = cost / float(finest["ensemble_sample_cost"])
    return NORMAL * np.sqrt(float(finest[f"{name}_level_variance"]) / samples)


def _steps(axis: Any) -> tuple[float, ...]:
    """Return the multiples of powers of ten that are labelled: the more, the shorter the logarithmic axis."""
    low, high = axis.get_view_interval()
    decades = np.log10(high / low)
    if decades < 1.0:
        return (1.0, 2.0, 3.0, 5.0, 7.0)
    return (1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)


def _farthest(one: Dataset) -> tuple[str, str]:
    """Return the mean of one D, by its stored name and state, whose interval is widest for what was asked."""
    return _ranked(one)[0]


def _ranked(one: Dataset) -> list[tuple[str, str]]:
    """Return the means of one D by stored name and state, the widest interval for what was asked first."""
    ratios = {}
    for name in (str(name).removesuffix("_accuracy_asked") for name in one if str(name).endswith("_accuracy_asked")):
        half = 0.5 * (one[f"{name}_interval"].sel(bound="upper") - one[f"{name}_interval"].sel(bound="lower"))
        for at in one["ensemble_at"].values.tolist():
            ratio = float(half.sel(ensemble_at=at) / one[f"{name}_accuracy_asked"].sel(ensemble_at=at))
            if np.isfinite(ratio):
                ratios[name, at] = ratio
    return sorted(ratios, key=ratios.__getitem__, reverse=True)
