"""Work-precision diagrams: what `tradeoff` has measured, each figure a function of its dataset.

Markers are the means over the surfaces (errors: the largest of any), colours name A*, p* and V*.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from xarray import Dataset

from roughvol.report.figures.origin import Draw, register
from roughvol.report.figures.style import PAGE, Drawing, axes, canvas, looks, plain_ticks
from roughvol.store.tradeoff_variables import PARTS, QUANTITIES, RUNG
from roughvol.typing import Array

FIGURES: dict[str, Draw] = {}
LADDERS: dict[str, str] = {}  # that a figure needs

LABELS = {"mean_pressure": r"$p^{\ast}$ (relative)", "free_volume": r"$V^{\ast}$"}
LABELS |= {"contact_area_fraction": r"$A^{\ast}$"}
LOOKS = {name: look | {"label": LABELS[name]} for name, look in zip(LABELS, looks(3), strict=True)}
ANSWER = "answer"  # in place of a ladder
WORDS = {"seeds": "seeds", "m": "$m$", "steps": "steps", "rtol": r"residual $\eta/\sigma$", "ensemble": "ensemble"}
P = r"$p^{\ast}$"
FLOOR = 1e-16  # where an error of exactly zero is drawn


def missing(name: str, ds: Dataset) -> str | None:
    """Return why a figure cannot be drawn from a dataset, or None if it can."""
    if "ladder" not in ds.coords:
        return f"{name} needs a dataset of `roughvol tradeoff`"
    if LADDERS[name] == ANSWER:
        return None if "answer_cost" in ds else f"{name} needs generated surfaces, whose mean has an error"
    if LADDERS[name] not in ds["ladder"].values:
        return f"{name} needs the ladder {LADDERS[name]!r}, which a height file does not have"
    return None


def _figure(ladder: str) -> Callable[[Draw], Draw]:
    def add(draw: Draw) -> Draw:
        LADDERS[draw.__name__] = ladder
        return register(draw, FIGURES, missing)

    return add


def _rungs(ds: Dataset, ladder: str, precision: str | None = None) -> Dataset:
    kept = ds["ladder"].values == ladder
    if precision is not None:
        kept &= ds["precision"].values == precision
    return ds.isel({RUNG: np.flatnonzero(kept)})


def _worst(ds: Dataset, name: str) -> Array:
    return np.asarray(np.maximum(ds[name].max("surface").values, FLOOR), dtype=np.float64)


@_figure(ANSWER)
def tradeoff_answer(ds: Dataset) -> Drawing:
    """Draw the error of the mean V* against its cost: by seeds, m, steps and residual, and of an ensemble.

    Each line varies one choice about the circle: the finest m, the steps of the study, the residual of `standard`. The
    error is the half-width of the 95 % interval over seeds, plus those of resolution, steps and solver.
    To see: more seeds lower the error down to that of the resolution; fewer steps and a looser residual save time and
    add no visible error up to 1e-2; the ensemble reaches the error of many seeds at a fraction of their cost.
    """
    dimensions = ds["answer_D"].values
    fig = canvas(PAGE, 2.9)
    panels = np.atleast_1d(fig.subplots(1, len(dimensions), sharey=True))
    choices = ds["answer_choice"].values
    for ax, D in zip(panels, dimensions, strict=True):
        one = ds.sel(answer_D=D)
        ax.margins(0.08, 0.12)  # room for the values at the ends of lines
        for (name, label), look in zip(WORDS.items(), looks(len(WORDS)), strict=True):
            rows = one.isel(answer_row=np.flatnonzero(choices == name))
            error = 100.0 * np.sum([rows[part].values for part in PARTS], axis=0)
            ax.loglog(rows["answer_cost"].values, error, **(look | {"label": label, "ms": 4}))
            if name in ("seeds", "m"):
                _name_ends(ax, rows, error)
            if name == "m":
                ax.loglog(rows["answer_cost"].values[-1], error[-1], "o", mfc="none", mec="k", ms=9)
        ax.set(xlabel="cost [s]", title=f"$D = {D:g}$")
        for axis, steps in ((ax.xaxis, (1.0,)), (ax.yaxis, (1.0, 2.0, 5.0))):
            plain_ticks(axis, steps)
    panels[0].set_ylabel(f"error of the mean $V^{{\\ast}}$ at {ds.attrs['answer_at'].replace('pressure', P)} [%]")
    handles, labels = panels[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=len(handles))
    return _with_grid(fig)


def _name_ends(ax: Axes, rows: Dataset, error: Array) -> None:
    """Write the values at both ends of a line."""
    for end in (0, -1):
        text, x = f"{float(rows['answer_setting'][end]):g}", float(rows["answer_cost"][end])
        place: dict[str, Any] = {"xytext": (3, 4), "ha": "left"} if end == 0 else {"xytext": (-5, -10), "ha": "right"}
        ax.annotate(text, (x, error[end]), fontsize=7, textcoords="offset points", **place)


@_figure("tolerance")
def tradeoff_precision(ds: Dataset) -> Drawing:
    """Errors against the residual asked for, and against the time: what a digit costs.

    An error of exactly 0 is drawn at 1e-16.
    To see: V* and p* stay under their certified bounds at every residual; A* is off by single elements at 1e-5, exact
    below; a digit costs the same time all the way down, and mixed precision costs no digit.
    """
    fig, (left, right) = axes(PAGE, 3.0, 2)
    mixed, double = (_rungs(ds, "tolerance", how) for how in ("mixed", "double"))
    for name in QUANTITIES:
        left.loglog(mixed["rtol"], _worst(mixed, f"{name}_error"), **LOOKS[name])
    bounds = [("free_volume", "residual", r"bound of $V^{\ast}$")]
    bounds += [("mean_pressure", "mean_pressure_bound", r"bound of $p^{\ast}$")]
    for name, bound, label in bounds:
        left.loglog(mixed["rtol"], _worst(mixed, bound), "--", color=LOOKS[name]["color"], lw=0.8, label=label)
    left.set(xlabel=r"residual asked for $\eta/\sigma$", ylabel="largest error of any state ($10^{-16}$: none)")
    left.invert_xaxis()
    left.legend()
    for rungs, style, words in ((mixed, "-", "mixed"), (double, ":", "double")):
        for name in ("mean_pressure", "free_volume"):
            look = LOOKS[name] | {"label": f"{LOOKS[name]['label']}, {words}"}
            right.loglog(rungs["seconds"].mean("surface"), _worst(rungs, f"{name}_error"), ls=style, **look)
    # under a decade or a little more: few labels, as plain numbers
    plain_ticks(right.xaxis, (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0))
    right.set(xlabel="seconds a sweep", ylabel="largest error of any state ($10^{-16}$: none)")
    right.legend()
    return _with_grid(fig)


@_figure("resolution")
def tradeoff_resolution(ds: Dataset) -> Drawing:
    """Discretisation against algebra: errors at each m of the nested family, beside those of the accuracies.

    To see: the errors of a coarse grid are decades above those of any accuracy of the solver.
    """
    fig, (left, right) = axes(PAGE, 3.0, 2)
    family = _rungs(ds, "resolution")
    levels = family["m"].values
    final = {name: family[name].values for name in QUANTITIES}
    for name in QUANTITIES:
        change = np.sqrt(np.mean(((final[name][:-1] - final[name][-1]) / final[name][-1]) ** 2, axis=1))
        left.semilogy(levels[:-1], np.maximum(change, FLOOR), **LOOKS[name])
    mixed = _rungs(ds, "tolerance", "mixed")
    for rtol, words in ((1e-3, "draft"), (1e-6, "standard"), (1e-9, "reference")):
        place = int(np.argmin(np.abs(np.log(mixed["rtol"].values / rtol))))
        error = _worst(mixed, "mean_pressure_error")[place]
        left.axhline(error, color=LOOKS["mean_pressure"]["color"], lw=0.7, ls=":")
        left.annotate(f"{words}: " + r"$p^{\ast}$", (levels[0], error), fontsize=7, va="bottom")
    left.set(xlabel="$m$", ylabel=f"relative difference to $m = {levels[-1]}$ at the last state", xticks=levels[:-1])
    left.legend()
    for name in QUANTITIES:
        look = LOOKS[name] | {"label": str(LOOKS[name]["label"]).removesuffix(" (relative)")}
        right.plot(levels, (final[name] / final[name][-1]).mean(axis=1), **look)
    right.set(xlabel="$m$", ylabel=f"value over that at $m = {levels[-1]}$", xticks=levels)
    right.legend()
    return _with_grid(fig)


@_figure("steps")
def tradeoff_settings(ds: Dataset) -> Drawing:
    """Work and errors of the other choices: number of steps, kernel, method.

    To see: the states of a sweep do not depend on its steps; the kernel is a choice of physics, not of accuracy; the
    paper's algorithm finds the same.
    """
    fig, (left, right) = axes(PAGE, 3.0, 2)
    kept = ds.isel({RUNG: np.flatnonzero(np.isin(ds["ladder"].values, ("steps", "kernel", "method")))})
    names = []
    for k in range(kept.sizes[RUNG]):
        row = kept.isel({RUNG: k})
        ladder = row["ladder"].item()
        value, m = row[ladder].item(), row["m"].item()
        names.append({"steps": f"{value} steps", "method": f"{value}, $m = {m}$"}.get(ladder, value))
    places = np.arange(len(names))
    for shift, name in enumerate(QUANTITIES):
        error = _worst(kept, f"{name}_error")
        left.plot(places + 0.15 * (shift - 1), error, ls="", **LOOKS[name])
    left.set_yscale("log")
    left.set(ylabel="largest error of any state ($10^{-16}$: none)", xticks=places)
    left.legend()
    right.plot(places, kept["seconds"].mean("surface").values, ls="", marker="D", color=LOOKS["mean_pressure"]["color"])
    right.set_yscale("log")
    right.set(ylabel="seconds a sweep", xticks=places)
    for ax in (left, right):
        ax.set_xticklabels(names, rotation=40, ha="right")
    return _with_grid(fig)


def _with_grid(fig: Drawing) -> Drawing:
    for ax in fig.axes:
        ax.grid(visible=True)
    return fig
