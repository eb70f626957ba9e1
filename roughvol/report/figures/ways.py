"""Ways through the gap in figures: what flows along a direction under load, where it closes, and how both are drawn.

A way is known at its computed states alone. It closes at its solved closing load, if the study has it: beyond the last
state over a load alone, between two states over any quantity. Without one it is closed from the first state at which
nothing flows (or no open void leads from side to side) and that no open state follows; between the last open state and
that one the closing load is not known. Beyond its last state an open way is unknown, not closed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator
from xarray import DataArray, Dataset

from roughvol.analysis.at import MADE
from roughvol.analysis.average import RANGE
from roughvol.analysis.closing import LOADS, solved_loads, span_of
from roughvol.analysis.derived import P
from roughvol.analysis.leak import LIFTED, STATE, is_lifted, with_closed
from roughvol.observables.at_state import at_state
from roughvol.observables.variables import AXES
from roughvol.report.figures.families import Curve, Family, curves, mean_and_band, named, several
from roughvol.report.figures.style import CONTACT, GREY, Drawing, looks
from roughvol.typing import Array, Mask

GRID = 240  # points of a curve over several surfaces
BAND = (100.0 * RANGE[0], 100.0 * RANGE[1])  # percentiles of a band over surfaces
LEAD, SHUT = "_lead", "_closed"  # labels of a line that is no data, and of the mark of a closed way
LINES: dict[str, Any] = {"x": "-", "y": (0, (4.0, 1.5))}
CLOSED = {"x": "x", "y": "+"}
LEGEND: dict[str, Any] = {"handlelength": 2.2, "columnspacing": 1.2}
FAINT = 0.13  # opacity of a band, beneath which others are seen
DECADES = 9  # of a flow that an axis spans; less flows off it
FALL = 60  # points of a flow that falls to 0 between two steps
NARROW = 0.02  # least width of an axis of closing loads alone, as a share of the load
FLUX_RANGE = (1e-2, 1e2)  # of the flux over its mean


class Way(NamedTuple):
    """Computed states of one direction of one surface in the order of loading, shape (states,), and where it closed."""

    load: Array  # of the open states
    value: Array  # there
    closed: float  # that of the solved closing, or of the first state computed closed; NaN if it was open to the end
    ends: float = math.nan  # load of the last computed state
    by_log: bool = False  # read over the logarithm of the load, where both steps have one, as in `at`
    recorded: bool = False  # states under fluid pressure: nothing is known between them
    fall: Curve | None = None  # share of the last flow left on the way to its closing; None: a straight line

    @property
    def known(self) -> bool:
        """Whether the way has any state."""
        return self.load.size > 0 or math.isfinite(self.closed)


def flow(ds: Dataset, name: str, direction: str) -> DataArray:
    """Return a flow along a direction, also 0 at the states at which another variable shows that the way is closed."""
    ds = ds.sel(axis=direction)
    # the ways that are stored are those of the dry gap
    return ds[name] if is_lifted(ds) else with_closed(ds[name], ds)


def way(load: Array, value: Array) -> Way:
    """Return the way of states in the order of loading; those without a value are not computed."""
    mask = np.isfinite(load) & np.isfinite(value)
    load, value = load[mask], value[mask]
    open_, span = value > 0.0, span_of(value, load)
    if span is None:
        return Way(load, value, math.nan)
    return Way(load[open_], value[open_], span.closed_from if span.closes else math.nan, float(load[-1]))


def ways(family: Family, x: str, name: str, direction: str) -> list[Way]:
    """Return a flow along a direction against x, one way for each surface that has any state."""
    known = [states for states in _every_way(family, x, name, direction) if states.known]
    return [states._replace(by_log=x in LOADS) for states in known]


def _every_way(family: Family, x: str, name: str, direction: str) -> list[Way]:
    if is_lifted(family.data) and name in LIFTED and (states := _recorded_loads(family.data, x)) is not None:
        lifted = family.data[LIFTED[name]].sel(axis=direction).transpose("seed", STATE).values
        pressures = family.data[f"{STATE}_mean_pressure"].transpose("seed", STATE).values
        pairs = [[part[k][np.argsort(p)] for part in (states, lifted)] for k, p in enumerate(pressures)]
        return [way(*pair)._replace(recorded=True) for pair in pairs]
    loads = family.data[x].transpose("seed", "step").values
    values = flow(family.data, name, direction).transpose("seed", "step").values
    found = [way(*pair) for pair in zip(loads, values, strict=True)]
    if is_lifted(family.data):  # under fluid pressure the solved loads are those of the dry gap
        return [states._replace(recorded=name in LIFTED) for states in found]
    if x in LOADS:
        ends = solved_loads(family.data, direction, x)
        return [one._replace(closed=end) if math.isfinite(end) else one for one, end in zip(found, ends, strict=True)]
    ends, pressures = solved_loads(family.data, direction, P), family.data[P].transpose("seed", "step").values
    return [_closed_at(*one) for one in zip(found, ends, pressures, loads, strict=True)]


def _closed_at(states: Way, end: float, load: Array, x: Array) -> Way:
    """Return a way over another quantity than the load, up to its solved closing load; its flow is straight over p*."""
    closed = float(at_state(load, x, end)[0])
    if not math.isfinite(closed):
        return states
    if not states.load.size:
        return states._replace(closed=closed)
    points = np.linspace(states.load[-1], closed, FALL)
    left = (end - at_state(x, load, points)) / (end - at_state(x, load, states.load[-1]))
    return states._replace(closed=closed, fall=(points, left))


def _recorded_loads(ds: Dataset, x: str) -> Array | None:
    """Return x at the states under fluid pressure, shape (surfaces, states); None where it is not stored there."""
    stored = MADE.get(x, x)
    if f"{STATE}_{stored}" not in ds:
        return None
    values: Array = ds[f"{STATE}_{stored}"].transpose("seed", STATE).values
    return values if x == stored else values * (ds[x] / ds[stored]).max("step").values[:, np.newaxis]


def falls(members: Sequence[Way]) -> bool:
    """Return whether x falls along the loading, as V* does."""
    for member in members:
        along = np.append(member.load, member.closed if math.isfinite(member.closed) else [])
        if along.size > 1:
            return bool(along[-1] < along[0])
    return False


def grid(members: Sequence[Way], *, before: bool = False) -> Array:
    """Return points along x, in the order of loading, at which every way is known.

    From the load at which the last has begun (with `before`, the first: a way is open before its first state) to the
    one at which the first ends open, or 5 % beyond the last closing. The closing loads are among the points.
    """
    sign = -1.0 if falls(members) else 1.0
    first = [sign * (member.load[0] if member.load.size else member.closed) for member in members]
    closings = [sign * member.closed for member in members if math.isfinite(member.closed)]
    ends = [sign * float(member.load[-1]) for member in members if not math.isfinite(member.closed)]
    start = min(first) if before else max(first)
    stop = min(ends) if ends else max(closings) + 0.05 * abs(max(closings))
    if stop < start:
        return np.empty(0)
    inside = [load for load in closings if start <= load <= stop]
    return sign * np.unique(np.concatenate([np.linspace(start, stop, GRID), inside]))


def ratios(family: Family, x: str, over: DataArray, direction: str) -> list[Way]:
    """Return ratios ``over`` to a flow along a direction against x, with the loads at which the flow closes."""
    over = over.where(flow(family.data, "transmissivity", direction) > 0.0)
    loads, values = (part.transpose("seed", "step").values for part in (family.data[x], over))
    whole = _every_way(family, x, "transmissivity", direction)
    members = [way(*pair)._replace(closed=shown.closed) for *pair, shown in zip(loads, values, whole, strict=True)]
    return [member for member in members if member.known]


def sample(members: Sequence[Way], at: Array, *, hold: bool = False, beyond: float = 0.0) -> Array:
    """Return every way on points along x, shape (ways, points), NaN where it is not known."""
    rows = np.full((len(members), at.size), np.nan)
    sign = -1.0 if falls(members) else 1.0
    points = sign * at
    for row, member in zip(rows, members, strict=True):
        load, closed = sign * member.load, sign * member.closed
        if load.size:
            inside = (points >= load[0]) & (points <= load[-1])
            places, logs = points[inside], np.log(member.value)
            found = at_state(load, logs, places)
            if member.by_log:
                loaded = load > 0.0  # not so an unloaded region
                above = places >= load[loaded].min(initial=np.inf)
                found[above] = at_state(np.log(load[loaded]), logs[loaded], np.log(places[above]))
            row[inside] = np.exp(found)
            between = (points > load[-1]) & (points < closed)
            along, left = member.fall or (np.array([member.load[-1], member.closed]), np.array([1.0, 0.0]))
            row[between] = member.value[-1] * (1.0 if hold else np.clip(at_state(along, left, at[between]), 0.0, 1.0))
        row[points >= closed] = beyond
    return rows


def is_computed(members: Sequence[Way], at: Array) -> Mask:
    """Return where no way lies between its last state and a solved closing load beyond it, shape (points,)."""
    sign = -1.0 if falls(members) else 1.0
    ends, closed = sign * np.transpose([[member.ends, member.closed] for member in members])[:, :, np.newaxis]
    computed: Mask = ~((sign * at > ends) & (sign * at < closed)).any(axis=0)
    return computed


def is_open(members: Sequence[Way], at: Array) -> Array:
    """Return 1 where a way is open and 0 from the first state computed closed on, shape (ways, points).

    NaN beyond the last state of one that was open to the end; before its first step a surface hardly touches.
    """
    sign = -1.0 if falls(members) else 1.0
    rows = np.ones((len(members), at.size))
    for row, member in zip(rows, members, strict=True):
        if math.isfinite(member.closed):
            row[sign * at >= sign * member.closed] = 0.0
        else:
            row[sign * at > sign * member.load[-1]] = np.nan
    return rows


def centre_and_band(rows: Array) -> tuple[Array, Array, Array]:
    """Return median, lower and upper end of the band `BAND` at every point, of rows of shape (surfaces, points)."""
    below, centre, above = np.percentile(rows, [BAND[0], 50.0, BAND[1]], axis=0)
    return centre, below, above


def band_words(counts: Sequence[int]) -> str:
    """Return what a curve and a band are, in words; nothing if every family has one surface alone."""
    if not (number := several(counts)):
        return ""
    return f"median of {number} surfaces, band {BAND[0]:.0f} to {BAND[1]:.0f} %"


def look_of(family: Family, direction: str, *, alone: bool) -> dict[str, Any]:
    """Return how a direction of a family is drawn: dashed and hollow along y, and of its own colour if it is alone."""
    look = looks(2)[AXES.index(direction)] if alone else family.look
    face = look["color"] if direction == "x" else "none"
    return look | {"ls": LINES[direction], "mfc": face, "mew": 0.8}


def name_of(family: Family, direction: str) -> str:
    """Return the label of a direction of a family."""
    return f"{family.label}, along ${direction}$"


def direction_legend(
    fig: Drawing, some: Sequence[Family], words: Iterable[str], closed: Iterable[str] = (), what: str = ""
) -> None:
    """Put one legend above all axes: families by colour, directions of a single one by line, and what marks closing."""
    shown = [*handles(some, {"marker": "none"}), *closed_handles(closed, what)]
    title = "; ".join(filter(None, [some[0].label if len(some) == 1 else "", *words])) or None
    rows = -(-len(shown) // 6)
    fig.legend(handles=shown, title=title, loc="outside upper center", ncols=-(-len(shown) // rows), **LEGEND)


def handles(some: Sequence[Family], of_several: dict[str, str]) -> list[Line2D]:
    """Return the lines of families for a legend, or the directions of a single one; several surfaces look otherwise."""
    named = [(family.label, family, family.look) for family in some]
    if len(some) == 1:
        named = [(f"along ${axis}$", some[0], look_of(some[0], axis, alone=True)) for axis in AXES]
    return [
        Line2D([], [], label=label, **(look | (of_several if family.surfaces > 1 else {})))
        for label, family, look in named
    ]


def closing(
    ax: Axes,
    direction: str,
    colour: Any,
    last: tuple[float, float] | None,
    closed: float,
    family: Family | None = None,
) -> None:
    """Mark a closed way on the lower edge of the axes, and lead a dotted line there from its last open state.

    A way that closes at V* = 0 has no place on a logarithmic axis.
    """
    if closed <= 0.0 and ax.get_xscale() == "log":
        return
    floor = ax.get_ylim()[0]
    if last is not None:
        ax.plot([last[0], closed], [max(last[1], floor), floor], ls=":", lw=0.8, color=colour, zorder=2, label=LEAD)
    options: dict[str, Any] = {"ms": 5.0, "mew": 1.3, "clip_on": False, "zorder": 6}
    marks = ax.plot([closed], [floor], ls="", marker=CLOSED[direction], color=colour, label=SHUT, **options)
    low, high = ax.dataLim.intervalx
    if 0.0 < high - low < NARROW * abs(closed):  # marks alone, whose loads are equal to many digits
        ax.update_datalim([(closed - 0.5 * NARROW * abs(closed), floor), (closed + 0.5 * NARROW * abs(closed), floor)])
    if family is not None:
        named(ax, marks, family, curve=f"{family.label}, closed", axis=direction)


def has_median(members: list[Way]) -> bool:
    """Return whether several surfaces share loads on curves, so that their median is drawn."""
    return len(members) > 1 and not members[0].recorded and grid(members).size > 1


def draw_flow(ax: Axes, family: Family, members: list[Way], direction: str, *, alone: bool) -> bool:
    """Draw a flow along one direction; return whether it is seen to close."""
    look, name, floor = look_of(family, direction, alone=alone), name_of(family, direction), ax.get_ylim()[0]
    if not has_median(members):
        return _draw_each(ax, family, members, direction, look | {"label": name}, lead=True)
    at = grid(members)
    centre, low, high = centre_and_band(sample(members, at))
    computed = is_computed(members, at)
    band = at, np.maximum(low, 0.1 * floor), high
    ax.fill_between(*band, where=computed.tolist(), color=look["color"], alpha=FAINT, lw=0, zorder=2)
    drawn = np.where(computed & (centre > 0.0), centre, np.nan)
    last = int(np.flatnonzero(np.isfinite(drawn)).max(initial=-1))
    lines = ax.plot(at[: last + 1], drawn[: last + 1], label=name, color=look["color"], ls=look["ls"], zorder=3)
    named(ax, lines, family, axis=direction)
    if (centre > 0.0).all():
        return False
    lead = (at[last], centre[last]) if last >= 0 else None
    closing(ax, direction, look["color"], lead, at[int(np.argmin(centre > 0.0))], family)
    return True


def _draw_each(
    ax: Axes, family: Family, members: list[Way], direction: str, look: dict[str, Any], *, lead: bool
) -> bool:
    """Draw the states of one surface up to its closing, or those of several that share no load, which has no mark.

    States under fluid pressure have no line between them, and a mark where they are closed.
    """
    joined, marked = len(members) == 1 and not members[0].recorded, len(members) == 1 or members[0].recorded
    for member in members:
        lines = ax.plot(member.load, member.value, zorder=3, **(look if joined else look | {"ls": ""}))
        named(ax, lines, family, axis=direction)
    closed = [member for member in members if marked and math.isfinite(member.closed)]
    for member in closed:
        last = (member.load[-1], member.value[-1]) if joined and lead and member.load.size else None
        closing(ax, direction, look["color"], last, member.closed, family)
    return bool(closed)


def draw_by_width(ax: Axes, width: Array, rows: Array, look: dict[str, Any], direction: str) -> list[str]:
    """Draw T* along a direction against the width of the region; return the direction if it is closed somewhere."""
    if not len(rows):
        return []
    floor = ax.get_ylim()[0]
    centre, low, high = centre_and_band(rows) if len(rows) > 1 else (rows[0],) * 3
    face = look["color"] if direction == "x" else "w"
    if len(rows) > 1:
        ax.fill_between(width, np.maximum(low, 0.1 * floor), high, color=look["color"], alpha=FAINT, lw=0, zorder=2)
    drawn = np.where(centre > 0.0, centre, np.nan)
    ax.plot(width, drawn, zorder=3, **(look | {"ls": LINES[direction], "mfc": face, "mew": 0.8}))
    for place in width[centre <= 0.0]:
        closing(ax, direction, look["color"], None, place)
    return [direction] if (centre <= 0.0).any() else []


def draw_ratio(ax: Axes, family: Family, members: list[Way], direction: str, *, alone: bool, beyond: float) -> bool:
    """Draw an estimate over the flow along one direction, as long as more than half of the surfaces are open."""
    look, name = look_of(family, direction, alone=alone), name_of(family, direction)
    floor, top = ax.get_ylim()
    if len(members) < 2 or (at := grid(members)).size < 2:
        return _draw_each(ax, family, members, direction, look | {"label": name}, lead=False)
    rows = sample(members, at, hold=True, beyond=beyond)
    closings = sorted(member.closed if np.isfinite(member.closed) else np.inf for member in members)
    end = closings[len(members) // 2]  # from here on the median is closed
    kept = (~np.isnan(rows)).any(axis=0) & (at < end)
    if not kept.any():  # closed wherever the number was taken
        return bool(np.isfinite(end))
    numbers: Any = np.nanpercentile(rows[:, kept], [BAND[0], 50.0, BAND[1]], axis=0, method="inverted_cdf")
    below, centre, above = np.clip(numbers, 0.1 * floor, 10.0 * top)
    ax.fill_between(at[kept], below, above, color=look["color"], alpha=FAINT, lw=0, zorder=2)
    lines = ax.plot(at[kept], centre, label=name, color=look["color"], ls=look["ls"], zorder=3)
    named(ax, lines, family, axis=direction)
    if np.isfinite(end):
        closing(ax, direction, look["color"], None, end, family)
    return bool(np.isfinite(end))


def draw_states(ax: Axes, family: Family, x: str, name: str) -> None:
    """Draw a number that has no direction: through the states of one surface, or as mean ± one deviation of several."""
    members = curves(family, x, name)
    single = len(members) == 1
    at, values, spread = (*members[0], None) if single else mean_and_band(members, GRID)
    # a logarithmic axis has no zero: a line to zero would fall at the last state before it
    drawn = np.where(values > 0.0, values, np.nan) if ax.get_yscale() == "log" else values
    look = family.look if single else {"color": family.look["color"]}
    named(ax, ax.plot(at, drawn, label=family.label, zorder=3, **look), family)
    if spread is not None:
        ax.fill_between(at, values - spread, values + spread, color=look["color"], alpha=0.18, lw=0, zorder=2)


def flow_axis(ax: Axes, values: Array) -> None:
    """Give the y axis of flows a logarithmic scale with room around the open ways, without numbers if nothing flows."""
    values = values[values > 0.0]
    top = float(values.max(initial=1e-300))
    floor = max(float(values.min(initial=top)), top * 10.0**-DECADES)
    ax.set(yscale="log", ylim=(0.4 * floor, 2.5 * top))
    if not values.size:
        ax.yaxis.set_major_locator(NullLocator())
        ax.yaxis.set_minor_locator(NullLocator())


def closed_handles(closed: Iterable[str], what: str) -> list[Line2D]:
    """Return the marks of closed directions for a legend."""
    return [
        Line2D([], [], ls="", marker=CLOSED[axis], color=GREY, label=f"{what} along ${axis}$")
        for axis in sorted(set(closed))
    ]


def draw_flux(ax: Axes, shares: Array, gap: Array, extent: tuple[float, float, float, float], colours: str) -> Any:
    """Draw a flux over its mean on a logarithmic scale, and the contact in flat blue; return the image of the flux."""
    options: dict[str, Any] = {"origin": "lower", "interpolation": "none", "extent": extent}
    image = ax.imshow(shares.T, norm=LogNorm(*FLUX_RANGE, clip=True), cmap=colours, **options)
    ax.imshow(np.where(gap == 0.0, 1.0, np.nan).T, cmap=ListedColormap([CONTACT]), **options)
    return image
