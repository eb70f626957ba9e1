"""The figure of an ensemble: what its answer cost on each level, and how its interval narrowed.

``FIGURES["ensemble_cost"](ds)`` is a matplotlib ``Figure`` of the dataset of a study with a section ``ensemble``.
"""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter
from xarray import Dataset

from roughvol.report.figures.origin import Draw, register
from roughvol.report.figures.style import DASHES, PAGE, Drawing, canvas, looks

FIGURES: dict[str, Draw] = {}
NORMAL = 1.96  # of the 95 % interval of many samples


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
    dimensions = np.atleast_1d(ds["D"].values)
    levels = ds["m"].values
    for order, (D, look) in enumerate(zip(dimensions, looks(len(dimensions)), strict=True)):
        one, line = ds.sel(D=D), DASHES[order % len(DASHES)]
        samples, each = one["ensemble_samples"].values, one["ensemble_sample_cost"].values
        left.semilogy(levels, samples, ls=line, label=f"$D = {D:g}$", **look)
        middle.semilogy(levels, samples * each, ls=line, **look)
        name, at = _farthest(one)
        mean = abs(float(one[f"{name}_mean"].sel(ensemble_at=at)))
        cost = one["ensemble_round_cost"].values
        half = one[f"{name}_round_half_width"].sel(ensemble_at=at).values / mean
        right.loglog(cost, 100.0 * half, ls=line, **look)
        variance = float(one[f"{name}_level_variance"].sel(ensemble_at=at).isel(m=-1))
        along = np.geomspace(np.nanmin(cost), max(np.nanmax(cost), float(one["ensemble_plain_cost"])), 9)
        plain = NORMAL * np.sqrt(variance * each[-1] / along) / mean
        right.loglog(along, 100.0 * plain, ls=":", lw=0.8, color=look["color"])
        asked = 100.0 * float(one[f"{name}_accuracy_asked"].sel(ensemble_at=at)) / mean
        right.axhline(asked, lw=0.5, color="0.6", zorder=0)
    left.set(xlabel="$m$", ylabel="samples", xticks=levels)
    middle.set(xlabel="$m$", ylabel="cost of the level [s]", xticks=levels)
    right.set(xlabel="cost [s]", ylabel="half-width of the interval [%]", title="dotted: plain Monte Carlo")
    for axis in (right.xaxis, right.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    left.legend()
    for ax in (left, middle, right):
        ax.grid(visible=True)
    counts = sorted(set(ds["ensemble_samples"].values.ravel().tolist()))
    fig.shown = {"D": dimensions.tolist(), "m": [float(m) for m in levels], "surfaces": [counts[0], counts[-1]]}
    return fig


def _farthest(one: Dataset) -> tuple[str, str]:
    """Return the mean of one D, by its stored name and state, whose interval is widest for what was asked."""
    ratios = {}
    for name in (str(name).removesuffix("_accuracy_asked") for name in one if str(name).endswith("_accuracy_asked")):
        half = 0.5 * (one[f"{name}_interval"].sel(bound="upper") - one[f"{name}_interval"].sel(bound="lower"))
        for at in one["ensemble_at"].values.tolist():
            ratio = float(half.sel(ensemble_at=at) / one[f"{name}_accuracy_asked"].sel(ensemble_at=at))
            if np.isfinite(ratio):
                ratios[name, at] = ratio
    return max(ratios, key=ratios.__getitem__)
