"""Figures of the flow through the gap, each a function of a dataset: ``FIGURES["seal_map"](ds)`` is a ``Figure``.

Nothing is solved here; ``missing(name, ds)`` says why a figure cannot be drawn, or returns None. Curves are by D at the
largest m (or by file). A flow along x and one along y through the same surface count as two ways. A sweep to
percolation ends where the last way of its surface has closed: beyond its last step nothing flows, as is drawn.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from roughvol.dataset import at_state
from roughvol.figures import (
    CONTACT,
    DPI,
    LABELS,
    PAGE,
    PAPER,
    A,
    Family,
    P,
    V,
    _families,
    _held,
    _legend,
    _looks,
    _own,
    _single,
    guarded,
)
from roughvol.physics.transport import constriction

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset

Array = NDArray[np.float64]
Draw = Callable[["Dataset"], Figure]

FIGURES: dict[str, Draw] = {}
NEEDS: dict[str, tuple[str, ...]] = {}

BAND = (16.0, 84.0)  # percentiles: what holds two thirds of the ways
NOMINAL = "nominal_pressure"
FLOOR = 1e-7  # of a coefficient; less is off the axis
STATES = 4  # of a surface, in a figure of its regions
GRID = 240  # points of a mean curve
MAP_RANGE = (1e-2, 1e2)  # of the flux over its mean


def missing(name: str, ds: Dataset) -> str | None:
    """Return why figure `name` cannot be drawn from a dataset, or None if it can (an unknown name is a KeyError)."""
    absent = [variable for variable in NEEDS[name] if variable not in ds]
    if absent:
        return f"{name} needs {', '.join(absent)}, which the study did not record"
    if not bool(_held(ds, *NEEDS[name]).any()):
        return f"{name} needs {', '.join(NEEDS[name])}, and no case of the dataset has a value of each"
    return None


def _figure(*variables: str) -> Callable[[Draw], Draw]:
    """Register a figure and what it needs; called without that, it raises the reason as a `DatasetError`."""

    def register(draw: Draw) -> Draw:
        checked = guarded(draw, missing)
        NEEDS[draw.__name__], FIGURES[draw.__name__] = variables, checked
        return checked

    return register


def ways(family: Family, x: str, *names: str) -> list[tuple[Array, Array]]:
    """Return (x, y) along the loading, for each surface and each variable that holds one, where both are known."""
    found = []
    for seed in range(family.data.sizes["seed"]):
        one = family.data.isel(seed=seed)
        for name in names:
            pair = np.array([one[x].values, one[name].values])
            found.append(tuple(pair[:, np.isfinite(pair).all(axis=0)]))
    return [(along, values) for along, values in found if along.size]


def sample(members: list[tuple[Array, Array]], grid: Array, *, log: bool, closed: float | None) -> Array:
    """Return every member on the grid, shape (members, points): NaN before its first value, `closed` beyond its last.

    With `log`, values are interpolated in their logarithm, and a flow that has stopped is 0 from its last value above
    0 on, for between that one and the next it is not known when it stopped.
    """
    rows = np.full((len(members), grid.size), np.nan)
    for row, (along, values) in zip(rows, members, strict=True):
        sign = 1.0 if along[-1] >= along[0] else -1.0  # V* falls along the loading
        x, at, y = sign * along, sign * grid, values
        open_ = y > 0.0 if log else np.ones(y.size, dtype=bool)
        if open_.any():
            kept, curve = x[open_], np.log(y[open_]) if log else y
            inside = (at >= kept[0]) & (at <= kept[-1])
            between = np.interp(at[inside], kept, curve)
            row[inside] = np.exp(between) if log else between
            row[at > kept[-1]] = np.nan if closed is None else closed
    return rows


def _grid(families: list[Family], x: str, *names: str) -> Array:
    """Return points of x over all that any way of any family covers, from where all have begun."""
    pairs = [pair for family in families for pair in ways(family, x, *names)]
    starts, ends = [along[0] for along, _ in pairs], [along[-1] for along, _ in pairs]
    falls = ends[0] < starts[0]
    return np.linspace(min(ends), min(starts), GRID) if falls else np.linspace(max(starts), max(ends), GRID)


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
        top.set_xlabel(f"nominal pressure [{_unit(ds, NOMINAL)}]")
        ax.tick_params(top=False)


def _unit(ds: Dataset, name: str) -> str:
    """Return the unit of a variable as a formula: ``mm$^{3}$/s``."""
    return re.sub(r"(?:\^|\*\*)(-?\d+)", r"$^{\1}$", str(ds[name].attrs.get("units", "?"))).replace("*", " ")


def _panels(ds: Dataset, rows: int, *names: str) -> tuple[Figure, Any, list[Family], str]:
    """Return a page with a column each for p*, A* and V*, and the families to draw."""
    families, title = _families(ds, "D", *names)
    fig = Figure(figsize=(PAGE, 2.3 * rows + 0.5), layout="constrained", dpi=DPI)
    axes = fig.subplots(rows, 3, sharex="col", sharey="row", squeeze=False)
    for ax, x in zip(axes[-1], (P, A, V), strict=True):
        ax.set_xlabel(LABELS[x])
    _in_units(axes[0, 0], ds)
    return fig, axes, families, title


def _draw(ax: Axes, family: Family, grid: Array, centre: Array, low: Array, high: Array) -> None:
    colour = family.look["color"]
    if not np.isfinite(centre).any():
        return
    ax.fill_between(grid, low, high, color=colour, alpha=0.18, lw=0, zorder=2)
    ax.plot(grid, centre, label=family.label, markevery=0.14, zorder=3, **family.look)


def _title(ax: Axes, *words: str) -> None:
    title = "; ".join(word for word in words if word)
    if ax.get_legend_handles_labels()[1]:
        _legend(ax, title)
    else:  # ways that are known at one state only make no curve
        ax.set_title(title)


@_figure(P, A, V, "connected_volume_fraction", "trapped_volume_fraction")
def seal_volume(ds: Dataset) -> Figure:
    """Free volume connected to the sides of the patch, and trapped in pockets: mean over surfaces ± one deviation."""
    ds = ds.assign(connected=ds[V] * ds["connected_volume_fraction"], trapped=ds[V] * ds["trapped_volume_fraction"])
    fig, axes, families, title = _panels(ds, 2, P, "connected")
    for row, name in zip(axes, ("connected", "trapped"), strict=True):
        row[0].set_ylabel(rf"{name} $V^\ast$")
        for ax, x in zip(row, (P, A, V), strict=True):
            for family in families:
                grid = _grid([family], x, name)
                rows = sample(ways(family, x, name), grid, log=False, closed=None)
                grid, rows = grid[np.isfinite(rows).all(axis=0)], rows[:, np.isfinite(rows).all(axis=0)]
                mean, spread = rows.mean(axis=0), rows.std(axis=0)
                _draw(ax, family, grid, mean, mean - spread, mean + spread)
    axes[0, 0].set_yscale("log")
    _title(axes[0, 1], title, "mean, band ± 1 std. dev. of surfaces")
    return fig


@_figure(P, A, V, "percolates_x", "percolates_y")
def seal_percolation(ds: Dataset) -> Figure:
    """Share of the ways that are open from side to side; the band is its binomial standard error."""
    fig, axes, families, title = _panels(ds, 1, P, "percolates_x", "percolates_y")
    names = ("percolates_x", "percolates_y")
    axes[0, 0].set_ylabel("share of open ways")
    for ax, x in zip(axes[0], (P, A, V), strict=True):
        grid = _grid(families, x, *names)
        for family in families:
            rows = sample(ways(family, x, *names), grid, log=True, closed=0.0)
            rows = np.where(np.isnan(rows), 1.0, rows)  # before its first step a surface hardly touches
            share = rows.mean(axis=0)
            error = np.sqrt(share * (1.0 - share) / len(rows))
            _draw(ax, family, grid, share, share - error, share + error)
    _title(axes[0, 1], title, "along x and y of each surface, band ± 1 std. error")
    return fig


def _coefficient(ds: Dataset, name: str, label: str, *, relative: bool = True) -> Figure:
    """Draw a flow along x and y; the axis spans the decades down to the floor, from the largest if not relative."""
    names = (f"{name}_x", f"{name}_y")
    fig, axes, families, title = _panels(ds, 1, P, *names)
    axes[0, 0].set_ylabel(label)
    top = max(float(ds[one].max()) for one in names)
    floor = FLOOR * (1.0 if relative else top)
    for ax, x in zip(axes[0], (P, A, V), strict=True):
        for family in families:
            members = ways(family, x, *names)
            grid = _grid([family], x, *names)
            rows = sample(members, grid, log=True, closed=0.0)
            known = np.isfinite(rows).all(axis=0)
            low, centre, high = np.percentile(rows[:, known], [BAND[0], 50.0, BAND[1]], axis=0)
            _draw(ax, family, grid[known], np.where(centre > 0.0, centre, np.nan), np.maximum(low, 0.1 * floor), high)
        ax.set_yscale("log")
    axes[0, 0].set_ylim(floor, 2.0 * (1.0 if relative else top))
    words = f"median along x and y, band {BAND[0]:.0f} to {BAND[1]:.0f} %"
    _title(axes[0, 1], title, words)
    return fig


@_figure(P, A, V, "transmissivity_x", "transmissivity_y")
def seal_transmissivity(ds: Dataset) -> Figure:
    """Flow of div(g³ grad P) = 0 over that of smooth plates at the mean gap; a median leaves where half are closed."""
    return _coefficient(ds, "transmissivity", r"transmissivity $T^\ast$")


@_figure(P, A, V, "diffusivity_x", "diffusivity_y")
def seal_diffusivity(ds: Dataset) -> Figure:
    """Flow of div(g grad P) = 0 over that of smooth plates at the mean gap; a median leaves where half are closed."""
    return _coefficient(ds, "diffusivity", r"diffusivity $D^\ast$")


@_figure(P, A, V, "leak_rate_x", "leak_rate_y")
def seal_leak_rate(ds: Dataset) -> Figure:
    """Leak rate of the patch at the pressure drop and viscosity of the study; a median leaves where half are closed."""
    fig = _coefficient(ds, "leak_rate", f"leak rate [{_unit(ds, 'leak_rate_x')}]", relative=False)
    given = ds["leak_rate_x"].attrs
    words = f"pressure drop {given.get('pressure_drop', '?')}, viscosity {given.get('viscosity', '?')}"
    fig.suptitle(words.replace("*", " "), fontsize=8.5)
    return fig


@_figure(A, "contact_area_fraction_within", "mean_pressure_within", "free_volume_within")
def seal_region(ds: Dataset) -> Figure:
    """Values of A*, p*, V* inside central squares over those of the whole, and T* inside, against their width.

    At a few states; mean over surfaces, band ± one standard error. Transmissivities are geometric means over the ways
    along x and y that are open at every width.
    """
    family = _nearest(ds)
    names = {"contact_area_fraction_within": r"$A^\ast$", "mean_pressure_within": r"$p^\ast$"}
    names |= {"free_volume_within": r"$V^\ast$"}
    flows = [name for name in ("transmissivity_within_x", "transmissivity_within_y") if name in ds]
    known = family.data[flows[0] if flows else "free_volume_within"].notnull().any(["seed", "region_width"])
    pressed = (family.data[A] > 0.0).all("seed")  # else there is nothing to take shares of
    steps = family.data["step"].values[(known & pressed).values]
    steps = steps[np.unique(np.linspace(0, len(steps) - 1, min(len(steps), STATES)).round().astype(int))]
    fig = Figure(figsize=(PAGE, 2.7), layout="constrained", dpi=DPI)
    axes = fig.subplots(1, 3 + bool(flows), sharex=True)
    for ax in axes:
        ax.set_xlabel("width of the region over $L$")
    for look, step in zip(_looks(len(steps)), steps, strict=True):
        state = family.data.sel(step=step)
        label = rf"$A^\ast = {float(state[A].mean()):.3f}$"
        for ax, (name, symbol) in zip(axes, names.items(), strict=False):
            inside = state[name].transpose("seed", "region_width").values
            whole = state[name.removesuffix("_within")].values[:, np.newaxis]
            _by_width(ax, state, inside / whole, look, label)
            ax.set_ylabel(f"{symbol} inside / {symbol} of the whole")
        if flows:
            stacked = np.concatenate([state[name].transpose("seed", "region_width").values for name in flows])
            open_ = stacked[(stacked > 0.0).all(axis=1)]
            _by_width(axes[-1], state, open_, look, label, log=True)
            axes[-1].set(ylabel=r"$T^\ast$ inside", yscale="log")
    for ax in axes[:3]:
        ax.axhline(1.0, color="0.4", lw=0.7, ls="--")
    handles, labels = axes[0].get_legend_handles_labels()
    title = f"{family.label}: mean over {family.data.sizes['seed']} surfaces, band ± 1 std. error"
    fig.legend(handles, labels, title=title, loc="outside upper center", ncols=STATES)
    return fig


def _nearest(ds: Dataset) -> Family:
    """Return the surfaces of the D nearest the paper's."""
    families, _ = _families(ds, "D", A, "contact_area_fraction_within")
    wish = PAPER["D"] if "D" in ds.dims else 0.0
    return min(families, key=lambda family: (abs(family.value - wish), -family.value))


def _by_width(ax: Axes, state: Dataset, rows: Array, look: dict[str, Any], label: str, *, log: bool = False) -> None:
    """Draw the mean of rows, one a surface, against the width of the region; geometric, if `log`."""
    if not len(rows):
        return
    width, rows = state["region_width"].values, np.log(rows) if log else rows
    mean, error = rows.mean(axis=0), rows.std(axis=0) / np.sqrt(len(rows))
    low, centre, high = (np.exp(v) if log else v for v in (mean - error, mean, mean + error))
    ax.fill_between(width, low, high, color=look["color"], alpha=0.18, lw=0, zorder=2)
    ax.plot(width, centre, label=label, zorder=3, **look)


@_figure(
    A, "transmissivity_x", "transmissivity_y", "estimate_medium_transmissivity", "estimate_junction_transmissivity_x"
)
def seal_estimates(ds: Dataset) -> Figure:
    """How far the quick estimates are off: effective medium and single critical junction over the flow computed."""
    for axis in "xy":
        flow = ds[f"transmissivity_{axis}"].where(ds[f"transmissivity_{axis}"] > 0.0)
        ds = ds.assign(
            {
                f"medium_{axis}": ds["estimate_medium_transmissivity"] / flow,
                f"junction_{axis}": ds[f"estimate_junction_transmissivity_{axis}"] / flow,
            }
        )
    families, title = _families(ds, "D", A, "medium_x", "medium_y")
    fig = Figure(figsize=(PAGE, 2.9), layout="constrained", dpi=DPI)
    axes = fig.subplots(1, 2, sharey=True)
    for ax, name, words in zip(axes, ("medium", "junction"), ("effective medium", "critical junction"), strict=True):
        for family in families:
            members = ways(family, A, f"{name}_x", f"{name}_y")
            rows = sample(members, grid := _grid([family], A, f"{name}_x", f"{name}_y"), log=True, closed=None)
            known = np.isfinite(rows).sum(axis=0) > len(rows) // 2  # as long as most ways are open
            if known.any():
                low, centre, high = np.nanpercentile(rows[:, known], [BAND[0], 50.0, BAND[1]], axis=0)
                _draw(ax, family, grid[known], centre, low, high)
        ax.axhline(1.0, color="0.3", lw=0.7, ls="--")
        ax.set(yscale="log", xlabel=LABELS[A])
        _title(ax, words, title, f"median of open ways, {BAND[0]:.0f} to {BAND[1]:.0f} %")
    axes[0].set_ylabel("estimate over computed $T^\\ast$")
    return fig


@_figure(A, P, "flux_x", "gap", "critical_position_x")
def seal_map(ds: Dataset) -> Figure:
    """Flux along x at each recorded load over its mean, contact in flat blue, the critical constriction in a circle.

    The flow enters at x = 0 and leaves at x = L.
    """
    case, name = _single(ds, "flux_x")
    reached = [label for label in case["flux_at"].values if int(case["flux_at_step"].sel(flux_at=label)) > 0]
    labels = [label for label in reached if label in case["field_at"].values][:3]
    fig = Figure(figsize=(PAGE, 2.7), layout="constrained", dpi=DPI)
    axes = fig.subplots(1, len(labels), sharey=True, squeeze=False)[0]
    for ax, label in zip(axes, labels, strict=True):
        state = at_state(case, "flux_at", case["flux_at"].values.tolist().index(label))
        flux = _own(state["flux_x"])
        x, y, half = flux["x"].values, flux["y"].values, flux["x"].values[1] / 2
        options: dict[str, Any] = {"origin": "lower", "interpolation": "none"}
        options["extent"] = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
        shares = flux.values / (float(flux.mean()) or 1.0)
        norm = LogNorm(*MAP_RANGE, clip=True)
        image = ax.imshow(np.maximum(shares, MAP_RANGE[0]).T, norm=norm, cmap="OrRd", **options)
        gap = state["gap"].sel(field_at=label, x=flux["x"], y=flux["y"]).transpose("x", "y").values
        ax.imshow(np.where(gap == 0.0, 1.0, np.nan).T, cmap=ListedColormap([CONTACT]), **options)
        place = constriction(gap, 0).element  # of this state: what is stored along the steps is that of the step after
        if place is not None:
            for width, colour in ((2.6, "w"), (1.2, "k")):
                ax.plot(x[place[0]], y[place[1]], marker="o", ms=11, mfc="none", mec=colour, mew=width)
        title = rf"$A^\ast = {float(state[A]):.3f}$, $p^\ast = {float(state[P]):.2f}$"
        if "flux_at_transmissivity_x" in state:
            mantissa, power = f"{float(state['flux_at_transmissivity_x']):.1e}".split("e")
            title += "\n" + rf"$T_x^\ast = {mantissa} \times 10^{{{int(power)}}}$"
        ax.set(xlabel="$x/L$", title=title)
    axes[0].set_ylabel("$y/L$")
    fig.colorbar(image, ax=list(axes), label="flux over its mean", extend="both", shrink=0.8)
    fig.suptitle(f"{name}: flow along $x$; contact in blue, the critical constriction in a circle", fontsize=8.5)
    return fig
