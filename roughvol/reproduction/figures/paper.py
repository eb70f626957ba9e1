"""The paper's figures, each a function of a dataset (table: `registry`).

Nothing is solved here. A figure adds presentation to the stored numbers: the mean over seeds on a common axis, a
straight line through points, a height from a gap. It prints each choice (D, m, state, fit range). A note below it names
the figure of the paper or, where the conditions are others, the run.

Conventions: starred quantities are dimensionless, other labels carry the units of the dataset. For D, m and state
see `report.figures.cases`. A single surface is drawn through its computed states, and markers are computed states.
Several surfaces are faint lines under their mean over the range that all of them reach; that mean has no markers, and a
band of ± one standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from xarray import Dataset

from roughvol.analysis.tables import evenly
from roughvol.gap.free_volume import domain
from roughvol.report.figures.cases import FINEST
from roughvol.report.figures.curves import plot, shown
from roughvol.report.figures.families import Family, curves, families, own, single
from roughvol.report.figures.style import (
    COLUMN,
    CONTACT,
    GREY,
    LABELS,
    PAGE,
    A,
    Drawing,
    P,
    V,
    axes,
    canvas,
    handy,
    legend,
    looks,
    plain_ticks,
    unit_of,
)
from roughvol.reproduction.claims.evidence import D_SIGMA, slopes_of_area
from roughvol.reproduction.figures.conditions import ACCENT, is_paper_surface
from roughvol.reproduction.figures.element_volumes import densities, density_label, merged, state, volume_label, volumes
from roughvol.reproduction.figures.relief import reliefs
from roughvol.reproduction.needs import PAPER_D, PAPER_M
from roughvol.surfaces.midpoint import midpoint_levels

FLAT, TALL = 0.6, 2.0  # least and largest height of the panel of a map over its width
THRESHOLDS = (0.0, 0.1, 0.25, 0.5, 1.0)  # v_th/v_max in Fig. 10, where no box counting names others


def _of_state(fig: Drawing, case: Dataset) -> Drawing:
    """Return a figure of one state that knows which it shows."""
    fig.shown = {key: [float(case[key])] for key in ("D", "m") if key in case} | {"area": [float(case[A])]}
    return fig


def _tall(shape: Sequence[int]) -> float:
    """Return the height of the panel of a map over its width; a narrow map leaves a part of its panel empty."""
    return min(max(shape[1] / shape[0], FLAT), TALL)


def _compare(ds: Dataset, by: str, x: str, y: str) -> Drawing:
    """Return a single-column figure of y(x), one curve per value of D or m."""
    fig, ax = axes()
    some, title = families(ds, by, x, y)
    plot(ax, some, [curves(family, x, y) for family in some], (LABELS[x], LABELS[y]), title)
    fig.shown = shown(some)
    return fig


def _gallery(some: Sequence[Family], title: str) -> Drawing:
    """Return the first surface of each family, its label and rms slope above it."""
    surfaces = [family.data.isel(seed=0) for family in some]
    titles = [f"{family.label}, {title}".removesuffix(", ") for family in some]
    if all("Sdq" in surface for surface in surfaces):
        titles = [f"{t}, $S_{{dq}} = {float(surface['Sdq']):.3g}$" for t, surface in zip(titles, surfaces, strict=True)]
    heights = [own(surface["heights"]) for surface in surfaces]
    scale, unit = handy(max(float(abs(z).max()) for z in heights), heights[0].attrs.get("units"))
    scale, label = (1.0 / float(surfaces[0]["L"]), "$z/L$") if unit == "length" else (scale, f"$z$ [{unit}]")
    fig = reliefs([z * scale for z in heights], titles, label)
    fig.shown = shown(some)
    return fig


def _boxes(ds: Dataset, variable: str, r: str, label: str) -> tuple[Drawing, Axes]:
    """Return a figure with one line over the box side for each threshold."""
    case, name, words = state(ds, "box_at", variable)
    fig, ax = axes()
    for order, look in enumerate(looks(case.sizes["threshold"])):
        values = case[variable].isel(threshold=order).dropna(r)
        ax.plot(values[r], values, label=f"${float(values['threshold']):g}$", **look)
    ax.set_xscale("log", base=2)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set(xlabel=r"box side $r/\delta$", ylabel=label)
    legend(ax, f"{name}: {words}\nthreshold $v_{{th}}/v_{{max}}$ (0: contact, 1: all)")
    return _of_state(fig, case), ax


def _densities(ds: Dataset, by: str, m: float = FINEST, *, log: bool = False) -> tuple[Drawing, Any, list[Family]]:
    """Return a figure of f(v) at the last recorded state, which its title names, its axes, and the families."""
    density = ds["volume_density"]
    stored = density.notnull().any([dim for dim in density.dims if dim != "density_at"]).values
    ds = ds.isel(density_at=int(np.flatnonzero(stored)[-1]))
    some, common = families(ds, by, "volume_density", "volume_density_edges", m=m)
    label = str(ds["density_at"].item())
    title = f"{'last step' if label == 'last' else label}\n{common}".rstrip()
    fig, ax = axes(height=3.6 if log else 3.2)
    members = [merged(*densities(family), log=log) for family in some]
    plot(ax, some, members, (volume_label(ds), density_label(ds)), title, common=True, log=log)
    fig.shown = shown(some)
    return fig, ax, some


def fig01(ds: Dataset) -> Drawing:
    """Fig. 1: the first half steps of the random midpoint displacement.

    Colour is the height of a node, shape the half step that gave it. Arrows run from the nodes whose heights are
    averaged to the new node, to which a random number is then added; nodes that exist never move.
    """
    case, name = single(ds, "heights")
    depth = min(int(case["m"]), 2)
    stride, half = 2 ** (int(case["m"]) - depth), 2 ** (depth - 1)
    z, levels = own(case["heights"]).values[::stride, ::stride], midpoint_levels(depth)
    letters = ["oij", "qlk", "prs"]  # of the paper's Section 2, by column
    arrow = {"arrowstyle": "-|>", "lw": 0.5, "color": "0.45", "shrinkA": 4, "shrinkB": 5, "mutation_scale": 6}
    colours = {"cmap": "RdBu_r", "vmin": -abs(z).max(), "vmax": abs(z).max(), "edgecolors": "k", "zorder": 3}
    fig, panels = axes(PAGE, 2.1, 2 * depth)
    for step, ax in enumerate(panels, start=1):
        reach = half >> (step - 1) // 2
        around = [(1, 1), (1, -1), (-1, 1), (-1, -1)] if step % 2 else [(1, 0), (-1, 0), (0, 1), (0, -1)]
        for node in np.argwhere(levels == step):
            for start in (node + reach * np.array(offset) for offset in around):
                if start.min() >= 0 and start.max() < len(z):
                    ax.annotate("", node, start, arrowprops=arrow)
        for level in range(step + 1):
            x, y = np.nonzero(levels == level)
            size, width = (48, 1.0) if level == step else (22, 0.4)
            nodes = ax.scatter(x, y, size, z[x, y], marker="soD^v"[level], linewidths=width, **colours)
            for i, j in zip(x, y, strict=True):
                if step <= 2:
                    ax.annotate(f"${letters[i // half][j // half]}$", (i, j), (6, 3), textcoords="offset points")
        ax.set(xticks=range(len(z)), yticks=range(len(z)), xlabel="$i$", aspect="equal", title=f"half step {step}")
        ax.margins(0.2)
    panels[0].set_ylabel("$j$")
    fig.colorbar(nodes, ax=panels, label=f"$z$ [{unit_of(case, 'heights')}] ({name})", pad=0.01)
    return fig


def fig02(ds: Dataset) -> Drawing:
    """Fig. 2: surfaces of low, middle and high D at m = 7 on one vertical scale: the rms slope grows with D."""
    some, title = families(ds, "D", "heights", m=PAPER_M)
    return _gallery([some[k] for k in evenly(len(some), 3)], title)


def fig03(ds: Dataset) -> Drawing:
    """Fig. 3: one surface at its four finest resolutions m: each contains the nodes of the coarser ones."""
    some, title = families(ds, "m", "heights")
    return _gallery(some[-4:], title)


def fig04a(ds: Dataset) -> Drawing:
    """Fig. 4a: A* against p* by D: the larger D, the smaller the contact area at equal pressure."""
    return _compare(ds, "D", P, A)


def fig04b(ds: Dataset) -> Drawing:
    """Fig. 4b: A* against p* by m, and its slope against the spacing, A*/p* ~ δ^n.

    The slope is that of the least-squares line through the origin over 0 < p* ≤ the largest pressure that all curves
    reach; n is the least-squares line through the mean logarithms at the four finest m (coarser lattices have a
    handful of contact elements). Beside it the paper's 0.37 (for D = 2.3) and Persson's D - 2, through the same centre.
    """
    fig, (left, right) = axes(PAGE, 3.0, 2)
    some, title = families(ds, "m", P, A)
    plot(left, some, [curves(family, P, A) for family in some], (LABELS[P], LABELS[A]), title)
    states = [family.data[[P, A]].transpose("seed", "step", ...) for family in some]
    of_surfaces, limit = slopes_of_area({k: (state[P].values, state[A].values) for k, state in enumerate(states)})
    spacings, slopes = np.array([2.0**-family.value for family in some]), []
    for spacing, family, ratios in zip(spacings, some, of_surfaces.values(), strict=True):
        right.plot(np.full(len(ratios), spacing), ratios, ls="", **family.look)
        slopes.append(np.log(ratios).mean())
    logs, D, fitted = np.log(spacings[-4:]), float(some[0].data["D"]), [family.value for family in some[-4:]]
    n = np.polyfit(logs, slopes[-4:], 1)[0]
    laws = [(n, "fit", "k", "-"), (0.37, "paper", ACCENT, "--"), (D - 2, "Persson", GREY, ":")]
    for power, label, colour, style in laws if abs(D - PAPER_D) < 0.005 else laws[::2]:
        law = np.exp(np.mean(slopes[-4:]) + power * (np.log(spacings) - logs.mean()))
        right.plot(spacings, law, color=colour, ls=style, label=f"{label} ${power:.2f}$", zorder=1)
    label = rf"$A^{{\ast}}/p^{{\ast}}$ (line through 0, $p^{{\ast}} \leq {limit:.2f}$)"
    right.set(xlabel=r"spacing $\delta/L$", ylabel=label)
    right.set_xscale("log", base=2)
    right.set_yscale("log")
    plain_ticks(right.yaxis, (1, 1.5, 2, 3, 4, 6, 8))
    law_words = r"$n$ of $A^{\ast}/p^{\ast} \sim \delta^n$"
    legend(right, f"{law_words}; fit to $m = {fitted[0]:g}$ to ${fitted[-1]:g}$")
    fig.shown = shown(some)
    return fig


def fig05(ds: Dataset) -> Drawing:
    """Fig. 5: V* against d/σ for the smallest and the largest D: V* = d/σ only at large separation."""
    some, title = families(ds, "D", D_SIGMA, V)
    ends = [some[0], some[-1]] if "D" in ds.dims and len(some) > 1 else some
    far = max(float(family.data[D_SIGMA].max()) for family in ends)
    fig, ax = axes()
    same = far * np.append(0.0, np.geomspace(1e-3, 1.0, 40))  # seen on logarithmic axes too
    ax.plot(same, same, ls="--", color="k", lw=0.8, label=r"$V^{\ast} = d/\sigma$")
    plot(ax, ends, [curves(family, D_SIGMA, V) for family in ends], (LABELS[D_SIGMA], LABELS[V]), title)
    fig.shown = shown(ends)
    return fig


def fig06a(ds: Dataset) -> Drawing:
    """Fig. 6a: V* against p* by D: at equal pressure a larger D leaves more free volume."""
    return _compare(ds, "D", P, V)


def fig06b(ds: Dataset) -> Drawing:
    """Fig. 6b: V* against A* by D: how nearly the curves lie in one band."""
    return _compare(ds, "D", A, V)


def fig07a(ds: Dataset) -> Drawing:
    """Fig. 7a: V* against p* by m: the curves converge as m grows."""
    return _compare(ds, "m", P, V)


def fig07b(ds: Dataset) -> Drawing:
    """Fig. 7b: V* against A* by m: no convergence, as the contact area shrinks with the spacing."""
    return _compare(ds, "m", A, V)


def fig08(ds: Dataset) -> Drawing:
    """Fig. 8: a surface before contact and pressed (contact dark blue) at A* near 0.1, from the undeformed mean plane.

    The deformed height is the plane less the gap, z_max - Δ - g: all of the deformation is drawn on the rough side.
    """
    case, name, words = state(ds, "field_at", "heights", "gap")
    before, gap = own(case["heights"]), own(case["gap"])
    before = (before - before.mean()) / float(case["Sq"])
    after = float(before.max()) - float(case["indentation"]) - gap
    fig = reliefs([before, after], [f"{name}: undeformed", words], r"$z/\sigma$", gap.values == 0.0)
    return _of_state(fig, case)


def fig09(ds: Dataset) -> Drawing:
    """Fig. 9: the free volume of each element: contact in flat dark blue, the deepest valleys dark red."""
    case, v, contact, frame, words = volumes(ds)
    fig, ax = axes(COLUMN, 0.6 + 2.2 * _tall(v.shape))
    colours = mpl.colormaps["YlOrRd"].with_extremes(under=CONTACT)
    image = ax.imshow(np.where(contact, -1.0, v).T, cmap=colours, vmin=0.0, vmax=v.max() or 1.0, **frame)
    ax.set(xlabel="$x/L$", ylabel="$y/L$", title=words)
    bar = fig.colorbar(image, ax=ax, extend="min", shrink=0.8, label=volume_label(ds))
    # below the tip, a twentieth of the bar
    bar.ax.text(0.5, -0.06, "contact", transform=bar.ax.transAxes, ha="center", va="top", fontsize=8)
    return _of_state(fig, case)


def fig10(ds: Dataset) -> Drawing:
    """Fig. 10: the domains v ≤ v_th in black, from the contact (v_th = 0) to everything (v_th = max v)."""
    case, v, contact, frame, words = volumes(ds)
    thresholds = ds["threshold"].values.tolist() if "threshold" in ds else THRESHOLDS
    columns = max(3, -(-len(thresholds) // 2))
    rows = -(-len(thresholds) // columns)
    fig = canvas(PAGE, 0.6 + rows * (0.2 + PAGE / columns * _tall(v.shape)))
    for k, share in enumerate(thresholds):
        ax = fig.add_subplot(rows, columns, k + 1)
        black = domain(v, share * v.max(), contact)
        ax.imshow(black.T, cmap="gray_r", vmin=0, vmax=1, **frame)
        threshold = rf"v_{{th}} = {share:g}\,v_{{max}}" if share else "v_{th} = 0"
        ax.set(title=f"${threshold}$: {100 * black.mean():.3g} % black")
        ax.tick_params(direction="out", top=False, right=False)
        lowest = k + columns >= len(thresholds)  # of its column: nothing below it has an axis
        ax.tick_params(labelbottom=lowest, labelleft=k % columns == 0)
        ax.set(xlabel="$x/L$" if lowest else "", ylabel="" if k % columns else "$y/L$")
    fig.suptitle(f"{words}; black: $v \\leq v_{{th}}$", fontsize=9)
    return _of_state(fig, case)


def fig11a(ds: Dataset) -> Drawing:
    """Fig. 11a: boxes of side r that meet the domain v ≤ v_th, one nearly straight line per threshold."""
    fig, ax = _boxes(ds, "box_count", "r", "number of boxes $N(r)$")
    ax.set_yscale("log")
    return fig


def fig11b(ds: Dataset) -> Drawing:
    """Fig. 11b: local dimension -d log N / d log r: below 2 (dashed) in contact, 2 for v_th = max v."""
    fig, ax = _boxes(ds, "local_dimension", "r_mid", r"local dimension $\mathcal{D}$")
    ax.axhline(2.0, ls="--", color="k", lw=0.8, zorder=1)
    return fig


def fig12a(ds: Dataset) -> Drawing:
    """Fig. 12a: density of the free volumes by D at m = 7, on bins of enough elements (`element_volumes.merged`).

    Dotted, for the paper's surfaces alone: v = 1, where the paper sees a fulcrum. In other units v = 1 means nothing.
    """
    fig, ax, _ = _densities(ds, "D", PAPER_M)
    if is_paper_surface(ds) and fig.shown["m"] == [PAPER_M] and ax.get_xlim()[1] > 1.0:
        ax.axvline(1.0, color=GREY, lw=0.7, ls=":", zorder=0)
    ax.set(xlim=(0.0, None), ylim=(0.0, None))
    return fig


def fig12b(ds: Dataset) -> Drawing:
    """Fig. 12b: density of the free volumes by m, and the line through (mean of v, mean of f over its stored bins).

    The curves are on bins joined until each holds enough elements and is wide enough for the axis; a star is of the
    stored equal bins, as the paper's.
    """
    fig, ax, some = _densities(ds, "m", log=True)
    ax.set(xscale="log", yscale="log")
    means = []
    for edges, rows, _ in map(densities, some):
        f = rows.mean(axis=0)
        means.append((np.average(0.5 * (edges[1:] + edges[:-1]), weights=f), f.mean()))
    v, f = np.array(means).T
    ax.plot(v, f, ls="", color=ACCENT, marker="*", ms=8, mec="w", mew=0.5, zorder=5)
    words = r"stars: $(\overline{v}, \overline{f})$"
    if len(v) > 1:
        slope, offset = np.polyfit(np.log(v), np.log(f), 1)
        ax.plot(v, np.exp(offset) * v**slope, color=ACCENT, lw=0.9, zorder=4)
        words += f", slope ${slope:.2f}$"
    legend(ax, ax.get_legend().get_title().get_text() + f"\n{words}")
    return fig
