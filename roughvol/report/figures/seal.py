"""Figures of the flow through the gap, each a function of a dataset.

Nothing is solved here. Curves are by D at the largest m (or by file), and by direction: solid along x, dashed along y.
The directions are never averaged with each other.

One surface is drawn through its computed states, with a marker at each. Several surfaces are a median and a band over
surfaces, without markers. A direction that is sealed ends at a cross (along x) or a plus (along y) on the lower edge:
at the solved closing load of the study, else at the first state computed closed, or where the median is. The dotted
line to it begins at the last open state. The closing load lies between both, or is the end of the line.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from xarray import Dataset

from roughvol.analysis import leak
from roughvol.analysis.tables import evenly
from roughvol.gap.constriction import constriction
from roughvol.observables.variables import AXES, SOLVED
from roughvol.report.figures import ways
from roughvol.report.figures.cases import SHOWN_D, nearest
from roughvol.report.figures.curves import shown
from roughvol.report.figures.families import Family, curves, families, own, several, single
from roughvol.report.figures.origin import fluid_text, region_of
from roughvol.report.figures.style import GREY, LABELS, PAGE, A, Drawing, P, V, canvas, looks, plain_ticks, unit_of
from roughvol.store.dataset import recorded_state

NOMINAL = "nominal_pressure"
STATES = 4  # of a surface, in a figure of its regions


def _in_units(ax: Axes, ds: Dataset) -> None:
    """Put the pressure in its unit along the top of an axis of p*, where one factor holds for all surfaces."""
    if NOMINAL not in ds:
        return
    factors = (ds[NOMINAL] / ds[P].where(ds[P] > 0.0)).values
    factors = factors[np.isfinite(factors)]
    if factors.size and np.ptp(factors) < 1e-9 * factors.max():
        factor = float(factors.mean())
        there_and_back: Any = (lambda p: p * factor, lambda p: p / factor)
        top = ax.secondary_xaxis("top", functions=there_and_back)
        top.set_xlabel(f"nominal pressure [{unit_of(ds, NOMINAL)}]")
        ax.tick_params(top=False)


def _panels(ds: Dataset, rows: int, *names: str) -> tuple[Drawing, Any, list[Family], str]:
    """Return a page with a column each for p*, A* and V*, and the families to draw."""
    some, title = families(ds, "D", *names)
    rows = rows or (1 if len(some) == 1 else len(AXES))
    fig = canvas(PAGE, 2.1 * rows + 1.0)
    axes = fig.subplots(rows, 3, sharex="col", sharey="row", squeeze=False)
    for ax, x in zip(axes[-1], (P, A, V), strict=True):
        ax.set_xlabel(LABELS[x])
    if bool((ds[V].where(ds[names[-1]].notnull()) > 0.0).any()):
        axes[0, 2].set_xscale("log")  # most of the closing happens below V* = 0.3
        for ax in axes[:, 2]:
            plain_ticks(ax.xaxis)
    _in_units(axes[0, 0], ds)
    fig.shown = shown(some)
    return fig, axes, some, title


def _rows(axes: Any, some: list[Family], label: str) -> list[tuple[Any, str]]:
    """Return the axes and x of each direction: both in one row for one family, a row each for several."""
    if len(some) == 1:
        axes[0, 0].set_ylabel(label)
        return [(axes[0], direction) for direction in AXES]
    for row, direction in zip(axes, AXES, strict=True):
        row[0].set_ylabel(f"{label}, along ${direction}$")
    return list(zip(axes, AXES, strict=True))


def seal_volume(ds: Dataset) -> Drawing:
    """Free volume connected to the sides of the patch, and trapped in pockets, over p*, A* and V*.

    One surface: its computed states. Several: mean and one standard deviation. Trapped volume grows towards sealing.
    """
    ds = ds.assign(connected=ds[V] * ds["connected_volume_fraction"], trapped=ds[V] * ds["trapped_volume_fraction"])
    fig, axes, some, title = _panels(ds, 2, P, "connected")
    if bool((ds["connected"] > 0.0).any()):
        axes[0, 0].set_yscale("log")  # before the curves: an axis without any has no range
    for row, name in zip(axes, ("connected", "trapped"), strict=True):
        row[0].set_ylabel(rf"{name} $V^{{\ast}}$")
        for ax, x in zip(row, (P, A, V), strict=True):
            for family in some:
                ways.draw_states(ax, family, x, name)
    number = several(family.surfaces for family in some)
    words = [title, f"mean of {number} surfaces, band ± 1 std. dev." if number else ""]
    handles = axes[0, 0].get_legend_handles_labels()[0]
    fig.legend(handles=handles, title="; ".join(filter(None, words)) or None, loc="outside upper center", ncols=6)
    return fig


def seal_percolation(ds: Dataset) -> Drawing:
    """Which directions are open from side to side: of one surface 1 or 0 at its states, of several the share.

    A step falls at the solved closing load, if the study has it. Else it falls at the first state computed closed: the
    closing load lies between that state and the one before. The band is the binomial standard error.
    """
    fig, axes, some, title = _panels(ds, 0, P, "percolates")
    many = any(family.surfaces > 1 for family in some)
    for row, direction in _rows(axes, some, "share of open surfaces" if many else "open (1) or closed (0)"):
        for ax, x in zip(row, (P, A, V), strict=True):
            for family in some:
                members = ways.ways(family, x, "percolates", direction)
                at = ways.grid(members, before=True)
                look = ways.look_of(family, direction, alone=len(some) == 1)
                line = {"color": look["color"], "ls": look["ls"], "zorder": 3 + (direction == "y")}
                share = ways.is_open(members, at).mean(axis=0)
                ax.plot(at, share, drawstyle="steps-post", label=ways.name_of(family, direction), **line)
                if len(members) == 1:
                    states = curves(family.along(direction), x, "percolates")[0]
                    ax.plot(*states, label="_states", **(look | {"ls": "", "zorder": line["zorder"]}))
                    continue
                error = np.sqrt(share * (1.0 - share) / len(members))
                band = {"color": look["color"], "alpha": ways.FAINT, "lw": 0, "zorder": 2}
                ax.fill_between(at, share - error, share + error, step="post", **band)
    for ax in axes.ravel():
        ax.set_ylim(-0.05, 1.05)
    end = "solved closing load" if SOLVED in ds and not leak.is_lifted(ds) else "first state computed closed"
    words = f"a step falls at the {end}" + ("; band ± 1 std. error" if many else "")
    ways.direction_legend(fig, some, [title, words])
    return fig


def _coefficient(ds: Dataset, name: str, label: str, *words: str) -> Drawing:
    """Draw a flow along x and along y over p*, A* and V*."""
    fig, axes, some, title = _panels(ds, 0, P, name)
    for ax in axes[:, 0]:
        ways.flow_axis(ax, np.concatenate([family.data[name].values.ravel() for family in some]))
    closed = []
    for row, direction in _rows(axes, some, label):
        for ax, x in zip(row, (P, A, V), strict=True):
            for family in some:
                members = ways.ways(family, x, name, direction)
                if members and ways.draw_flow(ax, family, members, direction, alone=len(some) == 1):
                    closed.append(direction)
    counts = [family.surfaces for family in some]
    ways.direction_legend(fig, some, [title, ways.band_words(counts), *words], closed, _what(counts, ds))
    return fig


def _what(counts: list[int], ds: Dataset) -> str:
    """Return what the mark of a closed direction is."""
    if max(counts) > 1:
        return "median closed"
    return "closed" if SOLVED in ds else "first state closed"


def seal_transmissivity(ds: Dataset) -> Drawing:
    """Flow of div(g³ grad P) = 0 along x and y over that of smooth plates at the mean gap, and where it stops."""
    return _coefficient(ds, "transmissivity", r"transmissivity $T^{\ast}$")


def seal_diffusivity(ds: Dataset) -> Drawing:
    """Flow of div(g grad P) = 0 along x and y over that of smooth plates at the mean gap, and where it stops."""
    return _coefficient(ds, "diffusivity", r"diffusivity $D^{\ast}$")


def seal_leak_rate(ds: Dataset) -> Drawing:
    """Leak rate of the patch along x and y, at the pressure drop and viscosity of the study, and where it stops."""
    return _coefficient(ds, "leak_rate", f"leak rate [{unit_of(ds, 'leak_rate')}]", fluid_text(ds))


def seal_region(ds: Dataset) -> Drawing:
    """Values of A*, p*, V* inside central squares over those of the whole, and T* along x and y inside, by their width.

    The whole is the surface, or the region of the study.

    At a few states. One surface: its values. Several: mean and one standard error; of T* median and band. A way that is
    closed is marked on the lower edge.
    """
    family, whole = _nearest(ds), "region" if region_of(ds) else "whole"
    names = {"contact_area_fraction_within": r"$A^{\ast}$", "mean_pressure_within": r"$p^{\ast}$"}
    names |= {"free_volume_within": r"$V^{\ast}$"}
    flow = "transmissivity_within"
    flows = AXES if flow in ds and bool(family.data[flow].notnull().any()) else ()  # perhaps on another leg alone
    recorded = family.data[flow].sel(axis="x") if flows else family.data["free_volume_within"]
    stored = recorded.notnull().any(["seed", "region_width"])
    pressed = (family.data[A] > 0.0).all("seed")  # else there is nothing to take shares of
    steps = family.data["step"].values[(stored & pressed).values]
    steps = steps[evenly(len(steps), STATES)]
    fig = canvas(PAGE, 2.9)
    fig.shown = shown([family])
    axes = fig.subplots(1, 3 + bool(flows), sharex=True)
    for ax in axes:
        ax.set_xlabel("width over $L$")
    states = [family.data.sel(step=step) for step in steps]
    if flows:
        values = np.concatenate([state[flow].values.ravel() for state in states])
        values = values[values > 0.0]
        axes[-1].set(ylabel=r"$T^{\ast}$ inside", yscale="log", ylim=(0.4 * values.min(initial=1.0), 2.5))
    handles, closed = [], []
    for look, state in zip(looks(len(steps)), states, strict=True):
        label = rf"$A^{{\ast}} = {float(state[A].mean()):.3f}$"
        handles.append(Line2D([], [], label=label, **look))
        width = state["region_width"].values
        for ax, (name, symbol) in zip(axes, names.items(), strict=False):
            inside = state[name].transpose("seed", "region_width").values
            with np.errstate(invalid="ignore"):  # V* of full contact is 0 inside, too
                rows = inside / state[name.removesuffix("_within")].values[:, np.newaxis]
            mean = rows.mean(axis=0)
            if len(rows) > 1:
                error = rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
                ax.fill_between(width, mean - error, mean + error, color=look["color"], alpha=0.18, lw=0, zorder=2)
            ax.plot(width, mean, label=label, zorder=3, **look)
            ax.set_ylabel(f"{symbol} inside / {symbol} of the {whole}")
        for direction in flows:
            rows = state[flow].sel(axis=direction).transpose("seed", "region_width").values
            closed += ways.draw_by_width(axes[-1], width, rows[np.isfinite(rows).all(axis=1)], look, direction)
    for ax in axes[:3]:
        ax.axhline(1.0, color=GREY, lw=0.7, ls="--")
    for axis in flows:
        handles.append(Line2D([], [], color=GREY, ls=ways.LINES[axis], label=rf"$T^{{\ast}}$ along ${axis}$"))
    handles += ways.closed_handles(closed, "closed")
    words = f": mean of {family.surfaces} surfaces, band ± 1 std. error" if family.surfaces > 1 else ""
    words += rf"; $T^{{\ast}}$: {ways.band_words([family.surfaces])}" if words and flows else ""
    options: dict[str, Any] = ways.LEGEND | {"loc": "outside upper center", "ncols": -(-len(handles) // 2)}
    fig.legend(handles=handles, title=f"{family.label}{words}", **options)
    return fig


def _nearest(ds: Dataset) -> Family:
    """Return the surfaces of the D nearest 2.3."""
    some, _ = families(ds, "D", A, "contact_area_fraction_within")
    value = nearest([family.value for family in some], SHOWN_D if "D" in ds.dims else 0.0)
    return next(family for family in some if family.value == value)


def seal_estimates(ds: Dataset) -> Drawing:
    """How far the quick estimates are off: effective medium and critical junction over the flow, by direction.

    Several surfaces: median and band, as long as the median is open. A closed way has no flow to compare with: the
    effective medium counts as infinitely too high there, the junction, closed as well, is left out. Between its last
    open state and the closing the last ratio is kept. A direction ends at a mark on the lower edge.
    """
    some, title = families(ds, "D", A, "transmissivity", "estimate_medium_transmissivity")
    rows = 1 if len(some) == 1 else len(AXES)
    fig = canvas(PAGE, 2.1 * rows + 1.0)
    fig.shown = shown(some)
    axes = fig.subplots(rows, 2, sharex="all", sharey="all", squeeze=False)
    drawn = []
    for row, direction in _rows(axes, some, r"estimate over $T^{\ast}$"):
        # Where a way is closed the medium, if it still flows, is infinitely too high; the junction is closed as well.
        for ax, name, beyond in ((row[0], "medium", np.inf), (row[1], "junction", np.nan)):
            for family in some:
                along = family.along(direction).data
                over = along[f"estimate_{name}_transmissivity"] / along["transmissivity"]
                drawn.append((ax, family, ways.ratios(family, A, over, direction), direction, beyond))
    values = np.concatenate([np.ones(1), *(one.value for _, _, members, _, _ in drawn for one in members)])
    axes[0, 0].set(yscale="log", ylim=(0.5 * float(values.min()), 2.0 * float(values.max())))
    closed = [
        direction
        for ax, family, members, direction, beyond in drawn
        if ways.draw_ratio(ax, family, members, direction, alone=len(some) == 1, beyond=beyond)
    ]
    for ax in axes.flat:
        ax.axhline(1.0, color=GREY, lw=0.7, ls="--", zorder=1)
    for ax, words in zip(axes[0], ("effective medium", "critical junction"), strict=True):
        ax.set_title(words)
    for ax in axes[-1]:
        ax.set_xlabel(LABELS[A])
    counts = [family.surfaces for family in some]
    ways.direction_legend(fig, some, [title, ways.band_words(counts)], closed, _what(counts, ds))
    return fig


def mapped(ds: Dataset) -> list[str]:
    """Return the states at which a case has its flux and its gap."""
    reached = (ds["flux_at_step"] > 0).any([dim for dim in ds["flux_at_step"].dims if dim != "flux_at"])
    return [label for label in ds["flux_at"].values[reached.values] if label in ds["field_at"].values]


def seal_map(ds: Dataset) -> Drawing:
    """Flux along x at each recorded load over its mean, contact in flat blue, the critical constriction in a circle.

    The flow enters at x = 0 and leaves at x = L.
    """
    case, name = single(ds.sel(flux_at=mapped(ds)), "flux")
    case = case.sel(axis="x")
    labels = case["flux_at"].values[case["flux_at_step"].values > 0][:3]
    fig = canvas(PAGE - 1.4 * (3 - len(labels)), 2.9)
    axes = fig.subplots(1, len(labels), sharey=True, squeeze=False)[0]
    for ax, label in zip(axes, labels, strict=True):
        state = recorded_state(case, "flux_at", case["flux_at"].values.tolist().index(label))
        flux = own(state["flux"])
        x, y = flux["x"].values, flux["y"].values
        half = (x[1] - x[0]) / 2
        whole = state["gap"].sel(field_at=label)
        gap = whole.sel(x=flux["x"], y=flux["y"]).transpose("x", "y").values
        periodic = "periodic" in ds.attrs and int(whole.notnull().sum()) == gap.size  # a region is no period
        shares = np.maximum(flux.values / (float(flux.mean()) or 1.0), ways.FLUX_RANGE[0])
        image = ways.draw_flux(ax, shares, gap, (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half), "OrRd")
        place = constriction(gap, 0, periodic=periodic).element  # of this state; the stored one is of the next step
        if place is not None:
            spot: dict[str, Any] = {"marker": "o", "ms": 11, "mfc": "none", "clip_on": False}
            for width, colour in ((2.6, "w"), (1.2, "k")):
                ax.plot(x[place[0]], y[place[1]], mec=colour, mew=width, **spot)
        title = rf"$A^{{\ast}} = {float(state[A]):.3f}$, $p^{{\ast}} = {float(state[P]):.2f}$"
        if "flux_at_transmissivity" in state:
            flow = float(state["flux_at_transmissivity"])
            mantissa, power = f"{flow:.1e}".split("e")
            words = rf"{mantissa} \times 10^{{{int(power)}}}" if flow else "0"
            title += "\n" + rf"$T_x^{{\ast}} = {words}$"
        ax.set(xlabel="$x/L$", title=title)
    axes[0].set_ylabel("$y/L$")
    fig.colorbar(image, ax=list(axes), label="flux over its mean", extend="both", shrink=0.8)
    fig.shown = {key: [float(case[key])] for key in ("D", "m") if key in case.coords}
    fig.suptitle(f"{name}: flow along $x$; contact in blue, the critical constriction in a circle", fontsize=8.5)
    return fig
