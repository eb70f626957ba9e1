"""Work-precision diagrams: what `tradeoff` has measured, each figure a function of its dataset.

Markers are the means over the surfaces (errors: the largest of any), colours name A*, p* and V*.
"""

from __future__ import annotations

import numpy as np
from xarray import Dataset

from roughvol.report.convergence import rungs
from roughvol.report.figures.style import PAGE, Drawing, axes, looks, plain_ticks
from roughvol.store.tradeoff_variables import QUANTITIES, RUNG
from roughvol.typing import Array

LABELS = {"mean_pressure": r"$p^{\ast}$ (relative)", "free_volume": r"$V^{\ast}$"}
LABELS |= {"contact_area_fraction": r"$A^{\ast}$"}
LOOKS = {name: look | {"label": LABELS[name]} for name, look in zip(LABELS, looks(3), strict=True)}
FLOOR = 1e-16  # where an error of exactly zero is drawn


def _worst(ds: Dataset, name: str) -> Array:
    return np.asarray(np.maximum(ds[name].max("surface").values, FLOOR), dtype=np.float64)


def tradeoff_precision(ds: Dataset) -> Drawing:
    """Errors against the residual asked for, and against the time: what a digit costs.

    An error of exactly 0 is drawn at 1e-16.
    To see: V* and p* stay under their certified bounds at every residual; A* is off by single elements at 1e-5, exact
    below; a digit costs the same time all the way down, and mixed precision costs no digit.
    """
    fig, (left, right) = axes(PAGE, 3.0, 2, grid=True)
    mixed, double = (rungs(ds, "tolerance", how) for how in ("mixed", "double"))
    for name in QUANTITIES:
        left.loglog(mixed["rtol"], _worst(mixed, f"{name}_error"), **LOOKS[name])
    for name, bound, symbol in (("free_volume", "residual", "V"), ("mean_pressure", "mean_pressure_bound", "p")):
        look = {"color": LOOKS[name]["color"], "lw": 0.8, "label": rf"bound of ${symbol}^{{\ast}}$"}
        left.loglog(mixed["rtol"], _worst(mixed, bound), "--", **look)
    left.set(xlabel=r"residual asked for $\eta/\sigma$", ylabel="largest error of any state ($10^{-16}$: none)")
    left.invert_xaxis()
    left.legend()
    for ladder, style, words in ((mixed, "-", "mixed"), (double, ":", "double")):
        for name in ("mean_pressure", "free_volume"):
            look = LOOKS[name] | {"label": f"{LOOKS[name]['label']}, {words}"}
            right.loglog(ladder["seconds"].mean("surface"), _worst(ladder, f"{name}_error"), ls=style, **look)
    # under a decade or a little more: few labels, as plain numbers
    plain_ticks(right.xaxis, (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0))
    right.set(xlabel="seconds a sweep", ylabel="largest error of any state ($10^{-16}$: none)")
    right.legend()
    return fig


def tradeoff_resolution(ds: Dataset) -> Drawing:
    """Discretisation against algebra: errors at each m of the nested family, beside those of the accuracies.

    To see: the errors of a coarse grid are decades above those of any accuracy of the solver.
    """
    fig, (left, right) = axes(PAGE, 3.0, 2, grid=True)
    family = rungs(ds, "resolution")
    levels = family["m"].values
    final = {name: family[name].values for name in QUANTITIES}
    for name in QUANTITIES:
        change = np.sqrt(np.mean(((final[name][:-1] - final[name][-1]) / final[name][-1]) ** 2, axis=1))
        left.semilogy(levels[:-1], np.maximum(change, FLOOR), **LOOKS[name])
    mixed = rungs(ds, "tolerance", "mixed")
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
    return fig


def tradeoff_settings(ds: Dataset) -> Drawing:
    """Work and errors of the other choices: number of steps, kernel, method.

    To see: the states of a sweep do not depend on its steps; the kernel is a choice of physics, not of accuracy; the
    paper's algorithm finds the same.
    """
    fig, (left, right) = axes(PAGE, 3.0, 2, grid=True)
    kept = ds.isel({RUNG: np.flatnonzero(np.isin(ds["ladder"].values, ("steps", "kernel", "method")))})
    names = []
    for k, ladder in enumerate(kept["ladder"].values.tolist()):
        value, m = (kept[name].values[k] for name in (ladder, "m"))
        names.append({"steps": f"{value} steps", "method": f"{value}, $m = {m}$"}.get(ladder, value))
    places = np.arange(len(names))
    for shift, name in enumerate(QUANTITIES):
        error = _worst(kept, f"{name}_error")
        left.plot(places + 0.15 * (shift - 1), error, ls="", **LOOKS[name])
    left.set(yscale="log", ylabel="largest error of any state ($10^{-16}$: none)", xticks=places)
    left.legend()
    right.plot(places, kept["seconds"].mean("surface").values, ls="", marker="D", color=LOOKS["mean_pressure"]["color"])
    right.set(yscale="log", ylabel="seconds a sweep", xticks=places)
    for ax in (left, right):
        ax.set_xticklabels(names, rotation=40, ha="right")
    return fig
