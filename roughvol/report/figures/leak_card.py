"""The drawings of a leak card: leak against load, map of the flux, error or closing loads."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from xarray import Dataset, concat

from roughvol.analysis.closing import LOADS
from roughvol.analysis.leak import STATE
from roughvol.analysis.leak_budget.state import Loaded, gap_of
from roughvol.analysis.leak_card import Card
from roughvol.gap.transport import conduction
from roughvol.observables.variables import AXES, SOLVED
from roughvol.report.card_text import SAME, has_legs
from roughvol.report.figures.families import Family
from roughvol.report.figures.style import GREY, STYLE, Drawing, looks, plain_ticks, read_style, unit_text
from roughvol.report.figures.ways import CLOSED, FAINT, draw_flow, draw_flux, flow_axis, look_of, ways

SANS = read_style("card")
PANEL = (3.3, 3.1)  # inches, at the width of a figure on the page: its type has the size of the page's
LEAST = 1e-3  # factor at which a bar down to 0 ends; 1/LEAST that of a bar upwards, and of a leak
FAR = 10.0  # loads beyond this multiple of those of the curves are cut, so that the curves can be read
LEGEND: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": 2, "borderaxespad": 0.1}
LEGEND |= {"handlelength": 1.4, "columnspacing": 0.9, "handletextpad": 0.5}
GRIDS = {"": "1", "twice the spacing": "2", "four times the spacing": "4"}


class Panel(NamedTuple):
    """A drawing of a card: its name, its caption, and how it is drawn."""

    name: str
    caption: str
    draw: Any


def panels(card: Card) -> list[Panel]:
    """Return the drawings of a card that have something to show."""
    several = len(card.surfaces) > 1
    marked = [way for way in card.ways if way.leak.value > 0.0 and math.isfinite(_load(card))]
    kind = "Median leak over surfaces" if several else "Leak"
    dry = f" of the gap without fluid pressure{', and the leak under it' * bool(marked)}" if card.lifted else ""
    leg = " on leg 1" if has_legs(card) else ""
    drawn = {
        "the band is 16 to 84 % of the surfaces": several,
        "upright bars are the error at the load of the card": any(math.isfinite(way.factor) for way in marked),
        "horizontal bars are the intervals of the closing loads": any(
            math.isfinite(way.closing.interval[1]) for way in card.ways
        ),
        "the band is the interval of the loads": any(math.isfinite(way.closing.factor) for way in card.ways)
        and not several,
        f"longer bars are cut at {FAR:g} times the largest load": any(
            _farthest(card) < way.closing.interval[1] < math.inf for way in card.ways
        ),
    }
    words = f"{'; '.join([f'{kind}{dry} against load{leg}', *(said for said, there in drawn.items() if there)])}."
    found = [Panel("leak", words, _against_load)]
    if (shown := _shown(card)) is not None:
        surface, axis = shown
        name = f" on {surface.name}" if several else ""
        lifted = " under fluid pressure" if card.lifted else ""
        open_ = surface.leak(axis) > 0.0
        what = f"Flux along {axis} over its mean" if open_ else f"Closed along {axis}"
        found.append(Panel("flux", f"{what}{lifted}{name}; contact is blue.", partial(_flux_map, surface, axis)))
    if any(way.leak.value > 0.0 and any(part.known for part in way.parts) for way in card.ways):
        open_ways = [way for way in card.ways if way.leak.value > 0.0]
        ends = [end for way in open_ways for end in (way.smaller, way.factor)]
        ends += [end for way in open_ways for part in way.parts for end in (part.smaller, part.factor)]
        beyond = any(1.0 / LEAST < end < math.inf for end in ends)
        cut = f" Longer bars are cut at a factor of {1.0 / LEAST:g}." * beyond
        found.append(Panel("budget", f"Parts of the error as factors of the leak.{cut}", _budget))
    else:
        found.append(Panel("closing", "Closing loads on this grid and on coarser grids.", _closings))
    return found


def drawing_of(card: Card, panel: Panel) -> Drawing:
    """Return one drawing of a card, in the type of the page."""
    with mpl.rc_context(STYLE | SANS):
        fig = Drawing(figsize=PANEL, layout="constrained", dpi=150)
        fig.style = SANS
        panel.draw(fig.subplots(), card)
    return fig


# leak against load


def _against_load(ax: Axes, card: Card) -> None:
    """Draw the leak over the load, where the ways close, and leak and error at the load of the card."""
    family = _family(card)
    leaks = np.append(family.data["leak"].values, [way.leak.value for way in card.ways])
    most = np.nanmax(leaks, initial=0.0) / LEAST
    known = [min(leak, most) for way in card.ways for leak in way.interval if math.isfinite(leak)]
    flow_axis(ax, np.append(leaks[np.isfinite(leaks)], known))
    unit = card.ways[0].unit
    ax.set(xlabel=_load_label(card), ylabel=f"leak [{unit_text(unit)}]" if unit else "leak T* V*³")
    handles, dry = [], ", dry" * card.lifted + ", leg 1" * has_legs(card)
    at = _load(card)
    reach = float(np.nanmax(family.data[_load_name(card)].values))
    far = _farthest(card)
    for order, way in enumerate(card.ways):
        members = ways(family, _load_name(card), "leak", way.axis)
        if members:
            draw_flow(ax, family, members, way.axis, alone=True)
        look = look_of(family, way.axis, alone=True)
        if len(members) == 1 and math.isfinite(way.closing.factor):
            ends = members[0].load / way.closing.smaller, np.minimum(members[0].load * way.closing.factor, far)
            ax.fill_betweenx(members[0].value, *ends, color=look["color"], alpha=FAINT, lw=0, zorder=2)
        low, high = way.closing.interval
        if math.isfinite(high):
            height = ax.get_ylim()[0] * (1.3 + 0.4 * order)
            ax.plot(
                [low, min(high, far)], [height, height], color=look["color"], lw=2.5, solid_capstyle="butt", zorder=6
            )
        handles.append(Line2D([], [], label=f"along {way.axis}{dry}", color=look["color"], ls=look["ls"]))
        if way.leak.value > 0.0 and math.isfinite(at):
            low, high = way.interval
            error = np.array([[way.leak.value - low], [high - way.leak.value]]) if math.isfinite(way.factor) else None
            beside = at + (order - 0.5) * 0.02 * reach  # so that two intervals can be seen apart
            mark = {"marker": look["marker"], "color": look["color"], "mfc": look["mfc"], "ls": ""}
            if card.lifted:
                handles.append(Line2D([], [], label=f"{way.axis}, lifted", **mark))
            ax.errorbar([beside], [way.leak.value], yerr=error, capsize=3, ms=5.0, zorder=7, **mark)
    if math.isfinite(at):
        handles.append(ax.axvline(at, color=GREY, lw=0.8, ls=":", label="load of the card"))
    closed = [way.axis for way in card.ways if way.closing.closed]
    handles += [
        Line2D([], [], ls="", marker=CLOSED[axis], color=GREY, label=f"closed along {axis}{dry}") for axis in closed
    ]
    ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.legend(handles=handles, **LEGEND)


def _family(card: Card) -> Family:
    """Return loads and leaks along the steps of the first leg, surfaces along seed; under fluid pressure dry leaks."""
    tables = []
    for surface in card.surfaces:
        kept = [name for name in (*LOADS, SOLVED) if name in surface.loading]
        tables.append(surface.loading[kept].reset_coords(drop=True).assign(leak=surface.leaks().variable))
    return Family("", 0.0, looks(1)[0], concat(tables, "seed"))


def _load(card: Card) -> float:
    """Return the load of the card, NaN where its surfaces have different loads."""
    loads = card.loads(_load_name(card))
    return float(np.mean(loads)) if loads and np.ptp(loads) <= SAME * max(loads) else math.nan


def _load_name(card: Card) -> str:
    return "nominal_pressure" if card.pressure_unit else "mean_pressure"


def _farthest(card: Card) -> float:
    """Return the load at which a longer bar is cut."""
    steps = (float(np.nanmax(surface.loading[_load_name(card)].values)) for surface in card.surfaces)
    loads = (*steps, _load(card), *(way.closing.value for way in card.ways))
    return FAR * max(filter(math.isfinite, loads))


def _load_label(card: Card) -> str:
    return f"nominal pressure [{unit_text(card.pressure_unit)}]" if card.pressure_unit else "pressure p*"


# where it leaks


def _shown(card: Card) -> tuple[Loaded, str] | None:
    """Return the first surface with fields at the load, and the axis of its map: open ones if there are any.

    The axis is that of the flow through the seal.
    """
    kept = [
        surface for surface in card.surfaces if "gap" in surface.table and bool(_state(surface)["gap"].notnull().any())
    ]
    maps = [(surface, axis) for axis in (card.seal.flow if card.seal else AXES) for surface in kept]
    return max(maps, key=lambda shown: shown[0].leak(shown[1]) > 0.0, default=None)


def _state(surface: Loaded) -> Dataset:
    return surface.fields.sel(field_at=surface.recorded, flux_at=surface.recorded)


def _flux_map(surface: Loaded, axis: str, ax: Axes, card: Card) -> None:
    """Draw the flux along an axis over its mean on one surface, and the contact."""
    state = _state(surface).sel(axis=axis)
    flux, gap = (state[name].transpose("x", "y").values for name in ("flux", "gap"))
    if card.lifted:
        gap = state.sel({STATE: surface.recorded})["fluid_gap"].transpose("x", "y").values
        inside, periodic = gap_of(surface.fields, surface.recorded, axis)
        along = conduction(inside, AXES.index(axis), periodic=periodic).flux
        flux = flux.copy()
        flux[np.isfinite(flux)] = np.hypot(*along).ravel()
    mean = np.nanmean(flux)
    image = np.where(flux > 0.0, flux / mean, np.nan) if mean > 0.0 else np.full(flux.shape, np.nan)
    extent = (0.0, 1.0, 0.0, (flux.shape[1] - 1) / (flux.shape[0] - 1))
    drawn = draw_flux(ax, image, gap, extent, "YlOrRd")
    if mean > 0.0:
        ax.figure.colorbar(drawn, ax=ax, label=f"flux along {axis} over its mean", location="top", shrink=0.9)
    ax.set(xticks=(0.0, 0.5, 1.0), yticks=[place for place in (0.0, 0.5, 1.0) if place <= extent[3]])
    ax.set(xlabel="x/L", ylabel="y/L", title="" if mean > 0.0 else f"closed along {axis}; contact is blue")


# error and closing


def _budget(ax: Axes, card: Card) -> None:
    """Draw the parts of the error as factors."""
    names = [*dict.fromkeys(part.name for way in card.ways for part in way.parts), "together"]
    ax.use_sticky_edges = False  # no bar ends on the frame
    for order, (way, look) in enumerate(zip(card.ways, looks(2), strict=True)):
        factors = {part.name: (part.smaller, part.factor) for part in way.parts if way.leak.value > 0.0}
        factors |= {"together": (way.smaller, way.factor)} if factors else {}
        for row, name in enumerate(names):
            place, (smaller, larger) = row + 0.2 - 0.4 * order, factors.get(name, (math.nan, math.nan))
            if math.isfinite(larger):
                low = max(1.0 / smaller, LEAST)
                width = min(max(larger, 1.0 + 1e-9), 1.0 / LEAST) - low
                ax.barh(place, width, left=low, height=0.35, color=look["color"], label=f"along {way.axis}")
            elif name in factors:
                of_panel = ax.get_yaxis_transform()
                ax.text(0.02, place, "unknown", va="center", color=GREY, size="small", transform=of_panel)
    ax.set(xscale="log", xlabel="factor of the leak")
    ax.axvline(1.0, color=GREY, lw=0.8)
    ax.set_yticks(range(len(names)), names)
    ax.set_xlim(min(0.45, ax.get_xlim()[0]), max(2.2, ax.get_xlim()[1]))
    plain_ticks(ax.xaxis)
    ax.set_ylim(len(names) - 0.5, -0.5)
    _legend(ax)


def _closings(ax: Axes, card: Card) -> None:
    """Draw between which loads the ways close on this grid and on coarser grids, and the load of the card."""
    rows = ["", *(words for words, _ in card.ways[0].coarser)]
    ax.margins(x=0.05)  # the load of the card may be the largest
    for order, (way, look) in enumerate(zip(card.ways, looks(2), strict=True)):
        for row, closing in enumerate([way.closing, *(closing for _, closing in way.coarser)]):
            place, known = row + 0.2 - 0.4 * order, math.isfinite(closing.interval[1])
            bars = [closing.interval] if known else [(span.open_up_to, span.closed_from) for span in closing.closed]
            for low, high in bars:
                ax.barh(place, high - low, left=low, height=0.3, color=look["color"], alpha=1.0 / len(bars) ** 0.5)
            if closing.closed:
                middle = float(np.mean([(span.open_up_to + span.closed_from) / 2.0 for span in closing.closed]))
                mark = {"marker": "|", "ms": 12.0, "mew": 2.0, "color": look["color"], "ls": ""}
                ax.plot([middle], [place], label=f"along {way.axis}", **mark)
    if math.isfinite(at := _load(card)):
        ax.axvline(at, color=GREY, lw=0.8, ls=":", label="load of the card")
    ax.set_yticks(range(len(rows)), [GRIDS[row] for row in rows])
    ax.set(xlabel=f"closes: {_load_label(card)}", ylabel="spacing over that of the map", xlim=(0.0, None))
    ax.set_ylim(len(rows) - 0.5, -0.5)
    _legend(ax)


def _legend(ax: Axes) -> None:
    """Put each label once into the legend above the axes."""
    handles, labels = ax.get_legend_handles_labels()
    found = dict(zip(labels, handles, strict=True))
    ax.legend(found.values(), found.keys(), **LEGEND)
