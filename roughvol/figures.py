"""The paper's figures, each a function of a dataset: ``FIGURES["fig04a"](ds)`` is a matplotlib ``Figure``.

Nothing is solved here. What a figure adds to the stored numbers is presentation: the mean over seeds on a common axis,
a straight line through points, a height from a gap. Where that involves a choice (which D, m, state or fit range) the
figure prints the choice. ``missing(name, ds)`` says why a figure cannot be drawn from a dataset, or returns None.

Conventions: starred quantities are dimensionless, volumes are in units of L³. A comparison of D is at the largest m
(m nearest 7 for Figs. 2 and 12a), one of m at the D nearest 2.3; a single case is the one nearest to D = 2.3, m = 7 and
A* = 0.1, the paper's. A study of files (dimension ``case``) has its curves labelled by case. Surfaces of several seeds
are faint lines under their mean over the range that all of them reach, with a band of ± one standard deviation.
"""

from __future__ import annotations

import functools
import operator
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from roughvol.dataset import at_state
from roughvol.errors import DatasetError
from roughvol.physics.freevolume import domain, element_volumes
from roughvol.physics.surface import midpoint_levels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import DataArray, Dataset

Curve = tuple[NDArray[np.float64], NDArray[np.float64]]
Draw = Callable[["Dataset"], Figure]

FIGURES: dict[str, Draw] = {}
NEEDS: dict[str, tuple[tuple[str, ...], str]] = {}  # variables one case must hold, what must have several values

PAPER = {"D": 2.3, "m": 7.0, "contact_area_fraction": 0.1}  # the single configuration of Figs. 8-11
THRESHOLDS = (0.0, 0.1, 0.25, 0.5, 1.0)  # v_th/v_max in Fig. 10, where no box counting names others
COLUMN, PAGE, DPI = 3.5, 7.0, 300  # widths [inch] of a column and of a page, resolution for print
CONTACT, ACCENT = "#08306b", "#c0392b"  # contact is this one flat dark blue wherever it shows in colour
STYLE: dict[Any, Any] = {"font.family": "STIXGeneral", "mathtext.fontset": "stix", "font.size": 8.5}
STYLE |= {"axes.labelsize": 9.5, "axes.titlesize": 8.5, "legend.fontsize": 8.0, "legend.title_fontsize": 8.0}
STYLE |= {"axes.linewidth": 0.6, "lines.linewidth": 1.1, "lines.markersize": 3.5, "legend.frameon": False}
STYLE |= {"xtick.direction": "in", "ytick.direction": "in", "xtick.top": True, "ytick.right": True}
STYLE |= {"grid.linewidth": 0.3, "grid.color": "0.8"}
A, P, V, D_SIGMA = "contact_area_fraction", "mean_pressure", "free_volume", "separation"
LABELS = {
    A: r"real contact area fraction $A^\ast$",
    P: r"dimensionless pressure $p^\ast$",
    V: r"dimensionless free volume $V^\ast$",
    D_SIGMA: r"mean plane separation $d/\sigma$",
    "v": r"element volume $v$ [length$^3$]",
    "f": r"probability density $f(v)$ [length$^{-3}$]",
}


class Family(NamedTuple):
    """The surfaces that share a curve: its label, its D, m or place, its colour and marker, their data along seed."""

    label: str
    value: float
    look: dict[str, Any]
    data: Dataset


def missing(name: str, ds: Dataset) -> str | None:
    """Return why figure `name` cannot be drawn from a dataset, or None if it can (an unknown name is a KeyError)."""
    variables, by = NEEDS[name]
    absent = [variable for variable in variables if variable not in ds]
    if absent:
        return f"{name} needs {', '.join(absent)}, which the study did not record"
    if not bool(_held(ds, *variables).any()):
        return f"{name} needs {', '.join(variables)}, and no case of the dataset has a value of each"
    if by in ("recursion", "m") and "case" in ds.dims:
        return f"{name} needs surfaces made from D and m, and those of the dataset were read from files"
    # One D alone is still worth drawing, unless the dataset compares m: then that figure has the same axes.
    lone = by in ("D", "m") and len(_families(ds, by, *variables)[0]) < 2
    if lone and (by == "m" or ds.sizes.get("m", 0) > 1):
        return f"{name} compares values of {by}, and the dataset has one"
    return None


def guarded(draw: Draw, missing: Callable[[str, Dataset], str | None]) -> Draw:
    """Return the figure in our style, refusing with the reason where the dataset lacks what it needs."""

    @functools.wraps(draw)
    def checked(ds: Dataset) -> Figure:
        reason = missing(draw.__name__, ds)
        if reason is not None:
            raise DatasetError(reason)
        with mpl.rc_context(STYLE):
            return draw(ds)

    return checked


def _figure(*variables: str, by: str = "") -> Callable[[Draw], Draw]:
    """Register a figure and what it needs; called without that, it raises the reason as a `DatasetError`."""

    def register(draw: Draw) -> Draw:
        checked = guarded(draw, missing)
        NEEDS[draw.__name__], FIGURES[draw.__name__] = (variables, by), checked
        return checked

    return register


def _held(ds: Dataset, *variables: str) -> DataArray:
    """Return which cases hold a value of every one of the variables."""
    known = [ds[name].notnull() for name in variables]
    cases = ("D", "m", "seed", "case")
    return functools.reduce(operator.and_, [mask.any([dim for dim in mask.dims if dim not in cases]) for mask in known])


def _looks(count: int) -> list[dict[str, Any]]:
    """Return colours in order (of even steps in lightness, safe for the colour-blind), a marker with each."""
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, max(count, 2)))
    return [{"color": tuple(colours[k]), "marker": "osD^vP<X>*"[k % 10]} for k in range(count)]


def _families(ds: Dataset, by: str, *variables: str, m: float = 1e9) -> tuple[list[Family], str]:
    """Return the families to compare in the order of `by`, and what they have in common, for the legend."""
    common, wish = ("D", PAPER["D"]) if by == "m" else ("m", m)
    if "case" in ds.dims:
        by, title, ds = "case", "", ds.expand_dims("seed")
    else:
        holding = ds[common].values[_held(ds, *variables).any([by, "seed"]).values].tolist()
        fixed = min(holding, key=lambda value: (abs(value - wish), -value))
        ds, title = ds.sel({common: fixed}), f"${common} = {fixed:g}$"
    held = _held(ds, *variables).transpose(by, "seed").values
    places = np.flatnonzero(held.any(axis=1)).tolist()
    families = []
    for place, look in zip(places, _looks(len(places)), strict=True):
        value = ds[by].values[place]
        name = _file(value) if by == "case" else f"${by} = {value:g}$"
        families.append(
            Family(
                name,
                float(place if by == "case" else value),
                look,
                ds.isel({by: place, "seed": np.flatnonzero(held[place])}),
            )
        )
    return families, title


def _single(ds: Dataset, *variables: str) -> tuple[Dataset, str]:
    """Return the case nearest to the paper's D = 2.3, m = 7 that holds the variables, and its name."""
    held = _held(ds, *variables)
    places = [dict(zip(held.dims, place, strict=True)) for place in np.argwhere(held.values).tolist()]
    numbers = [dim for dim in ("D", "m") if dim in held.dims]
    case = ds.isel(min(places, key=lambda place: [abs(float(ds[dim][place[dim]]) - PAPER[dim]) for dim in numbers]))
    return case, ", ".join([f"${dim} = {case[dim].item():g}$" for dim in numbers]) or _file(case["case"].item())


def _file(name: str) -> str:
    """Return the name of a height file as text: no formula, nor (leading underscore) left out of a legend."""
    return name.replace("$", r"\$").lstrip("_")


def _state(ds: Dataset, at: str, *variables: str) -> tuple[Dataset, str, str]:
    """Return the single case at its recorded state (along `at`) nearest to the paper's A* = 0.1, and both in words."""
    case, name = _single(ds, *variables)
    reached = [at_state(case, at, int(k)) for k in np.flatnonzero(case[f"{at}_step"].values > 0)]  # -1: never reached
    state = min(reached, key=lambda one: abs(float(one[A]) - PAPER[A]))
    return state, name, rf"$A^\ast = {float(state[A]):.3f}$, $p^\ast = {float(state[P]):.2f}$"


def _own(field: DataArray) -> DataArray:
    """Return a field (x along axis 0) without the nodes that only finer lattices of the dataset have."""
    return field.dropna("x", how="all").dropna("y", how="all").transpose("x", "y")


def _volumes(ds: Dataset) -> tuple[NDArray[np.float64], NDArray[np.bool_], dict[str, Any], str]:
    """Return v [length³] and the contact of the one state, how their image lies in its axes, and the state in words."""
    state, name, words = _state(ds, "field_at", "gap")
    gap = _own(state["gap"])
    x, y, contact = gap["x"].values, gap["y"].values, gap.values == 0.0
    v = element_volumes(gap.values * float(state["Sq"]), float(state["L"]) * x[1], contact)
    half = x[1] / 2  # a node is the centre of its element
    extent = (-half, x[-1] + half, -half, y[-1] + half)
    return v, contact, {"origin": "lower", "extent": extent, "interpolation": "none"}, f"{name}: {words}"


def _curves(family: Family, x: str, y: str) -> list[Curve]:
    """Return y(x) of each surface, in the order of x."""
    surfaces = [family.data.isel(seed=seed) for seed in range(family.data.sizes["seed"])]
    pairs = [np.array([one[x].values, one[y].values]) for one in surfaces]
    known = [pair[:, np.isfinite(pair).all(axis=0)] for pair in pairs]
    return [(pair[0][order], pair[1][order]) for pair in known for order in [np.argsort(pair[0], kind="stable")]]


def _histograms(family: Family) -> list[Curve]:
    """Return f(v) of each surface, several of them on common bins through their cumulative, which keeps ∫ f dv = 1."""
    density = family.data["volume_density"].transpose("seed", "bin").values
    edges = family.data["volume_density_edges"].transpose("seed", "edge").values
    bins = edges[0]
    if len(edges) > 1:
        bins = np.linspace(edges.min(), edges.max(), edges.shape[1])
        below = np.pad(np.cumsum(density * np.diff(edges), axis=1), ((0, 0), (1, 0)))
        density = np.diff([np.interp(bins, *pair) for pair in zip(edges, below, strict=True)], axis=1) / np.diff(bins)
    return [(0.5 * (bins[1:] + bins[:-1]), row) for row in density]


def _axes(width: float = COLUMN, height: float = 3.0, columns: int = 1) -> tuple[Figure, Any]:
    """Return a figure that leaves room for everything around its axes, and the axes."""
    fig = Figure(figsize=(width, height), layout="constrained", dpi=DPI)
    return fig, fig.subplots(1, columns)


def _plot(ax: Axes, families: Sequence[Family], curves: Sequence[Sequence[Curve]], x: str, y: str, title: str) -> None:
    """Draw the curves of every family, label the axes, and say above them what is shown."""
    for order, (family, members) in enumerate(zip(families, curves, strict=True)):
        abscissa, mean = members[0]
        if len(members) > 1:
            low, high = max(member[0][0] for member in members), min(member[0][-1] for member in members)
            abscissa = np.linspace(low, high, 200 if high > low else 0)
            rows = np.array([np.interp(abscissa, *member) for member in members])
            mean, spread = rows.mean(axis=0), rows.std(axis=0, ddof=1)
            colour = family.look["color"]
            ax.fill_between(abscissa, mean - spread, mean + spread, color=colour, alpha=0.18, lw=0, zorder=2)
            for member in members:
                ax.plot(*member, color=colour, lw=0.35, alpha=0.4, zorder=1)
        # Markers at equal distances on paper, shifted from curve to curve: they tell apart curves that coincide.
        ax.plot(abscissa, mean, label=family.label, markevery=(0.03 * (order % 4), 0.12), zorder=3, **family.look)
    counts = sorted({len(members) for members in curves})
    if counts[-1] > 1:
        surfaces = "-".join(map(str, dict.fromkeys((counts[0], counts[-1]))))
        title += f"; mean of {surfaces} surfaces, band ± 1 std. dev."
    ax.set(xlabel=LABELS[x], ylabel=LABELS[y])
    _legend(ax, title)


def _legend(ax: Axes, title: str) -> None:
    """Put the legend above the axes, where it cannot cover data, in as many columns as fit."""
    labels = [re.sub(r"\\[a-z]+|[${}^_]", "", str(label)) for label in ax.get_legend_handles_labels()[1]]
    columns = max(1, min(len(labels), 56 // (4 + max(map(len, labels)))))
    options: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "borderaxespad": 0.2}
    options |= {"handlelength": 1.3, "handletextpad": 0.4, "columnspacing": 0.9, "labelspacing": 0.3}
    legend = ax.legend(title=title.removeprefix("; ") or None, ncols=columns, **options)
    legend.get_title().set_multialignment("center")


def _compare(ds: Dataset, by: str, x: str, y: str) -> Figure:
    """Return a single-column figure of y(x), one curve per value of D or m."""
    fig, ax = _axes()
    families, title = _families(ds, by, x, y)
    _plot(ax, families, [_curves(family, x, y) for family in families], x, y, title)
    return fig


def _reliefs(surfaces: Sequence[DataArray], titles: Sequence[str], height: str, contact: Any = None) -> Figure:
    """Return lit surfaces on one vertical scale; `contact` marks the contact elements of the last."""
    columns = 3 if len(surfaces) == 3 else min(2, len(surfaces))
    rows, width = -(-len(surfaces) // columns), PAGE / max(columns, 2)
    fig = Figure(figsize=(width * columns, width * rows * (0.8 if columns > 2 else 0.6)), layout="constrained", dpi=DPI)
    low, high = min(float(z.min()) for z in surfaces), max(float(z.max()) for z in surfaces)
    for k, (heights, title) in enumerate(zip(surfaces, titles, strict=True)):
        x, y = heights["x"].values, heights["y"].values
        light, slope = LightSource(315, 45), 0.12 * (len(x) - 1) / (high - low)  # a third of the slopes as drawn
        options: dict[str, Any] = {
            "blend_mode": "soft",
            "vert_exag": slope,
            "vmin": low,
            "vmax": high + 0.2 * (high - low),
        }
        colours = light.shade(heights.values, mpl.colormaps["pink"], **options)
        if contact is not None and k == len(surfaces) - 1:
            colours[contact] = mpl.colors.to_rgba(CONTACT)
        ax: Any = fig.add_subplot(rows, columns, k + 1, projection="3d")
        # Every node is drawn (a stride of two would show the next coarser surface), as pixels in vector formats too.
        options = {"rstride": 1, "cstride": 1, "shade": False, "antialiased": False, "lw": 0, "rasterized": True}
        ax.plot_surface(*np.meshgrid(x, y, indexing="ij"), heights.values, facecolors=colours, **options)
        ax.set(xlim=(0, x[-1]), xticks=[0, x[-1] / 2, x[-1]], ylim=(0, y[-1]), yticks=[y[-1] / 2, y[-1]])
        ax.set(zlim=(low, high), xlabel="$x/L$", ylabel="$y/L$", zlabel=height)
        ax.set_title(title, y=0.95)
        ax.locator_params(axis="z", nbins=4)
        ax.yaxis.set_major_formatter("{x:.2g}")
        ax.tick_params(pad=-3, labelsize=7)
        ax.set_box_aspect((1.0, y[-1] / x[-1], 0.4), zoom=1.15)
        for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
            axis.labelpad = -8 if axis is not ax.zaxis else -6
            axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    return fig


def _gallery(families: Sequence[Family], title: str) -> Figure:
    """Return the first surface of each family, its label and rms slope above it."""
    surfaces = [family.data.isel(seed=0) for family in families]
    titles = [f"{family.label}, {title}".removesuffix(", ") for family in families]
    if all("Sdq" in one for one in surfaces):
        titles = [f"{t}, $S_{{dq}} = {float(one['Sdq']):.2f}$" for t, one in zip(titles, surfaces, strict=True)]
    return _reliefs([_own(one["heights"]) / float(one["L"]) for one in surfaces], titles, "$z/L$")


def _boxes(ds: Dataset, variable: str, r: str, label: str) -> tuple[Figure, Axes]:
    """Return a figure with one line over the box side for each threshold."""
    state, name, words = _state(ds, "box_at", variable)
    fig, ax = _axes()
    for order, look in enumerate(_looks(state.sizes["threshold"])):
        values = state[variable].isel(threshold=order).dropna(r)
        ax.plot(values[r], values, label=f"${float(values['threshold']):g}$", **look)
    ax.set_xscale("log", base=2)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set(xlabel=r"box side $r/\delta$", ylabel=label)
    _legend(ax, f"{name}: {words}\nthreshold $v_{{th}}/v_{{max}}$ (0: contact, 1: all)")
    return fig, ax


def _densities(ds: Dataset, by: str, m: float = 1e9) -> tuple[Figure, Any, list[list[Curve]]]:
    """Return a figure of f(v) at the last recorded state, its axes, and the histograms of each family."""
    density = ds["volume_density"]
    known = density.notnull().any([dim for dim in density.dims if dim != "density_at"]).values
    ds = ds.isel(density_at=int(np.flatnonzero(known)[-1]))
    families, title = _families(ds, by, "volume_density", "volume_density_edges", m=m)
    fig, ax = _axes()
    curves = [_histograms(family) for family in families]
    _plot(ax, families, curves, "v", "f", title)
    return fig, ax, curves


@_figure("heights", by="recursion")
def fig01(ds: Dataset) -> Figure:
    """Fig. 1: the first half steps of the random midpoint displacement.

    Colour is the height of a node, shape the half step that gave it. Arrows run from the nodes whose heights are
    averaged to the new node, to which a random number is then added; nodes that exist never move.
    """
    case, name = _single(ds, "heights")
    depth = min(int(case["m"]), 2)
    stride, half = 2 ** (int(case["m"]) - depth), 2 ** (depth - 1)
    z, levels = _own(case["heights"]).values[::stride, ::stride], midpoint_levels(depth)
    letters = ["oij", "qlk", "prs"]  # of the paper's Section 2, by column
    arrow = {"arrowstyle": "-|>", "lw": 0.5, "color": "0.45", "shrinkA": 4, "shrinkB": 5, "mutation_scale": 6}
    colours = {"cmap": "RdBu_r", "vmin": -abs(z).max(), "vmax": abs(z).max(), "edgecolors": "k", "zorder": 3}
    fig, axes = _axes(PAGE, 2.1, 2 * depth)
    for step, ax in enumerate(axes, start=1):
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
    axes[0].set_ylabel("$j$")
    fig.colorbar(nodes, ax=axes, label=f"$z$ [length] ({name})", pad=0.01)
    return fig


@_figure("heights", by="D")
def fig02(ds: Dataset) -> Figure:
    """Fig. 2: surfaces of low, middle and high D at m = 7 on one vertical scale: the rms slope grows with D."""
    families, title = _families(ds, "D", "heights", m=PAPER["m"])
    chosen = dict.fromkeys(np.linspace(0, len(families) - 1, 3).round().astype(int).tolist())
    return _gallery([families[k] for k in chosen], title)


@_figure("heights", by="m")
def fig03(ds: Dataset) -> Figure:
    """Fig. 3: one surface at its four finest resolutions m: each contains the nodes of the coarser ones."""
    families, title = _families(ds, "m", "heights")
    return _gallery(families[-4:], title)


@_figure(A, P, by="D")
def fig04a(ds: Dataset) -> Figure:
    """Fig. 4a: A* against p* by D: the larger D, the smaller the contact area at equal pressure."""
    return _compare(ds, "D", P, A)


@_figure(A, P, by="m")
def fig04b(ds: Dataset) -> Figure:
    """Fig. 4b: A* against p* by m, and its slope against the spacing, A*/p* ~ δ^n.

    The slope is that of the least-squares line through the origin over 0 < p* ≤ the largest pressure that all curves
    reach; n is the least-squares line through the mean logarithms at the four finest m (coarser lattices have a
    handful of contact elements). Beside it the paper's 0.37 (for D = 2.3) and Persson's D - 2, through the same centre.
    """
    fig, (left, right) = _axes(PAGE, 3.0, 2)
    families, title = _families(ds, "m", P, A)
    _plot(left, families, [_curves(family, P, A) for family in families], P, A, title)
    # Not less than where the last of them begins, so that each has a step there.
    limit = min(float(family.data[P].max("step").min()) for family in families)
    limit = max([limit, *(float(family.data[P].min("step").max()) for family in families)])
    spacings, slopes = np.array([2.0**-family.value for family in families]), []
    for spacing, family in zip(spacings, families, strict=True):
        low = family.data.where(family.data[P] <= limit)
        each = ((low[P] * low[A]).sum("step") / (low[P] ** 2).sum("step")).values
        right.plot(np.full(len(each), spacing), each, ls="", **family.look)
        slopes.append(np.log(each).mean())
    logs, D, fitted = np.log(spacings[-4:]), float(families[0].data["D"]), [family.value for family in families[-4:]]
    n = np.polyfit(logs, slopes[-4:], 1)[0]
    laws = [(n, "fit", "k", "-"), (0.37, "paper", ACCENT, "--"), (D - 2, "Persson", "0.4", ":")]
    for power, label, colour, style in laws if abs(D - PAPER["D"]) < 0.005 else laws[::2]:
        law = np.exp(np.mean(slopes[-4:]) + power * (np.log(spacings) - logs.mean()))
        right.plot(spacings, law, color=colour, ls=style, label=f"{label} ${power:.2f}$", zorder=1)
    right.set(xlabel=r"spacing $\delta/L$", ylabel=rf"$A^\ast/p^\ast$ (line through 0, $p^\ast \leq {limit:.2f}$)")
    right.set_xscale("log", base=2)
    right.set_yscale("log")
    right.yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 4, 6, 8)))
    right.yaxis.set_major_formatter("{x:g}")
    right.yaxis.set_minor_formatter(NullFormatter())
    _legend(right, rf"$n$ of $A^\ast/p^\ast \sim \delta^n$; fit to $m = {fitted[0]:g}$ to ${fitted[-1]:g}$")
    return fig


@_figure(D_SIGMA, V)
def fig05(ds: Dataset) -> Figure:
    """Fig. 5: V* against d/σ for the smallest and the largest D: V* = d/σ only at large separation."""
    families, title = _families(ds, "D", D_SIGMA, V)
    ends = [families[0], families[-1]] if "D" in ds.dims and len(families) > 1 else families
    far = max(float(family.data[D_SIGMA].max()) for family in ends)
    fig, ax = _axes()
    ax.plot([0.0, far], [0.0, far], ls="--", color="k", lw=0.8, label=r"$V^\ast = d/\sigma$")
    _plot(ax, ends, [_curves(family, D_SIGMA, V) for family in ends], D_SIGMA, V, title)
    return fig


@_figure(P, V, by="D")
def fig06a(ds: Dataset) -> Figure:
    """Fig. 6a: V* against p* by D: at equal pressure a larger D leaves more free volume."""
    return _compare(ds, "D", P, V)


@_figure(A, V, by="D")
def fig06b(ds: Dataset) -> Figure:
    """Fig. 6b: V* against A* by D: how nearly the curves lie in one band."""
    return _compare(ds, "D", A, V)


@_figure(P, V, by="m")
def fig07a(ds: Dataset) -> Figure:
    """Fig. 7a: V* against p* by m: the curves converge as m grows."""
    return _compare(ds, "m", P, V)


@_figure(A, V, by="m")
def fig07b(ds: Dataset) -> Figure:
    """Fig. 7b: V* against A* by m: no convergence, as the contact area shrinks with the spacing."""
    return _compare(ds, "m", A, V)


@_figure("heights", "gap")
def fig08(ds: Dataset) -> Figure:
    """Fig. 8: a surface before contact and pressed (contact dark blue) at A* near 0.1, from the undeformed mean plane.

    The deformed height is the plane less the gap, z_max - Δ - g: all of the deformation is drawn on the rough side.
    """
    state, name, words = _state(ds, "field_at", "heights", "gap")
    before, gap = _own(state["heights"]), _own(state["gap"])
    before = (before - before.mean()) / float(state["Sq"])
    after = float(before.max()) - float(state["indentation"]) - gap
    return _reliefs([before, after], [f"{name}: undeformed", words], r"$z/\sigma$", gap.values == 0.0)


@_figure("gap")
def fig09(ds: Dataset) -> Figure:
    """Fig. 9: the free volume of each element: contact in flat dark blue, the deepest valleys dark red."""
    v, contact, frame, words = _volumes(ds)
    fig, ax = _axes(COLUMN, 0.6 + 2.2 * v.shape[1] / v.shape[0])
    colours = mpl.colormaps["YlOrRd"].with_extremes(under=CONTACT)
    image = ax.imshow(np.where(contact, -1.0, v).T, cmap=colours, vmin=0.0, vmax=v.max() or 1.0, **frame)
    ax.set(xlabel="$x/L$", ylabel="$y/L$", title=words)
    bar = fig.colorbar(image, ax=ax, extend="min", shrink=0.8, label=LABELS["v"])
    bar.ax.set_xlabel("contact", labelpad=6, fontsize=8)
    return fig


@_figure("gap")
def fig10(ds: Dataset) -> Figure:
    """Fig. 10: the domains v ≤ v_th in black, from the contact (v_th = 0) to everything (v_th = max v)."""
    v, contact, frame, words = _volumes(ds)
    thresholds = ds["threshold"].values.tolist() if "threshold" in ds else THRESHOLDS
    columns = max(3, -(-len(thresholds) // 2))
    rows = -(-len(thresholds) // columns)
    fig = Figure(
        figsize=(PAGE, 0.4 + rows * (0.2 + PAGE / columns * v.shape[1] / v.shape[0])), layout="constrained", dpi=DPI
    )
    for k, share in enumerate(thresholds):
        ax = fig.add_subplot(rows, columns, k + 1)
        black = domain(v, share * v.max(), contact)
        ax.imshow(black.T, cmap="gray_r", vmin=0, vmax=1, **frame)
        threshold = rf"v_{{th}} = {share:g}\,v_{{max}}" if share else "v_{th} = 0"
        ax.set(title=f"${threshold}$: {100 * black.mean():.3g} % black", xlabel="$x/L$", ylabel="$y/L$")
        ax.tick_params(direction="out", top=False, right=False)
        ax.label_outer()
    fig.suptitle(f"{words}; black: $v \\leq v_{{th}}$", fontsize=9)
    return fig


@_figure("box_count")
def fig11a(ds: Dataset) -> Figure:
    """Fig. 11a: boxes of side r that meet the domain v ≤ v_th, one nearly straight line per threshold."""
    fig, ax = _boxes(ds, "box_count", "r", "number of boxes $N(r)$")
    ax.set_yscale("log")
    return fig


@_figure("local_dimension")
def fig11b(ds: Dataset) -> Figure:
    """Fig. 11b: local dimension -d log N / d log r: below 2 (dashed) in contact, 2 for v_th = max v."""
    fig, ax = _boxes(ds, "local_dimension", "r_mid", r"local dimension $\mathcal{D}$")
    ax.axhline(2.0, ls="--", color="k", lw=0.8, zorder=1)
    return fig


@_figure("volume_density", "volume_density_edges", by="D")
def fig12a(ds: Dataset) -> Figure:
    """Fig. 12a: density of the free volumes by D at m = 7; dotted: v = 1, where the paper sees a fulcrum."""
    fig, ax, _ = _densities(ds, "D", PAPER["m"])
    if ax.get_xlim()[1] > 1.0:
        ax.axvline(1.0, color="0.4", lw=0.7, ls=":", zorder=0)
    ax.set(xlim=(0.0, None), ylim=(0.0, None))
    return fig


@_figure("volume_density", "volume_density_edges", by="m")
def fig12b(ds: Dataset) -> Figure:
    """Fig. 12b: density of the free volumes by m, and the line through (mean of v, mean of f over its bins)."""
    fig, ax, curves = _densities(ds, "m")
    ax.set(xscale="log", yscale="log")
    for line in ax.lines:  # empty bins have no logarithm
        line.set_ydata(np.where(line.get_ydata() > 0.0, line.get_ydata(), np.nan))
    means = [(members[0][0], np.mean([f for _, f in members], axis=0)) for members in curves]
    v, f = np.array([(np.average(v, weights=f), f.mean()) for v, f in means]).T
    ax.plot(v, f, ls="", color=ACCENT, marker="*", ms=7, mec="k", mew=0.4, zorder=5)
    words = r"stars: $(\overline{v}, \overline{f})$"
    if len(v) > 1:
        slope, offset = np.polyfit(np.log(v), np.log(f), 1)
        ax.plot(v, np.exp(offset) * v**slope, color=ACCENT, lw=0.9, zorder=4)
        words += f", slope ${slope:.2f}$"
    _legend(ax, ax.get_legend().get_title().get_text() + f"\n{words}")
    return fig
