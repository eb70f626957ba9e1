"""Parts of the figures of the flow: how a direction of a family is drawn, where it closes, and the one legend."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from roughvol.observables.variables import AXES
from roughvol.report.figures import seal_ways
from roughvol.report.figures.families import Family, curves, mean_and_band, named
from roughvol.report.figures.seal_ways import Way
from roughvol.report.figures.style import GREY, Drawing, looks
from roughvol.typing import Array

LEAD, SHUT = "_lead", "_closed"  # labels of a line that is no data, and of the mark of a closed way
LINES: dict[str, Any] = {"x": "-", "y": (0, (4.0, 1.5))}
CLOSED = {"x": "x", "y": "+"}
LEGEND: dict[str, Any] = {"handlelength": 2.2, "columnspacing": 1.2}
FAINT = 0.13  # opacity of a band, beneath which others are seen


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
    alone = len(some) == 1
    named = [(f"along ${axis}$", some[0], look_of(some[0], axis, alone=True)) for axis in AXES]
    if not alone:
        named = [(family.label, family, family.look) for family in some]
    handles = []
    for label, family, look in named:
        handles.append(Line2D([], [], label=label, **(look | ({"marker": "none"} if family.surfaces > 1 else {}))))
    for axis in sorted(set(closed)):
        handles.append(Line2D([], [], ls="", marker=CLOSED[axis], color=GREY, label=f"{what} along ${axis}$"))
    title = "; ".join(filter(None, [some[0].label if alone else "", *words])) or None
    rows = -(-len(handles) // 6)
    fig.legend(handles=handles, title=title, loc="outside upper center", ncols=-(-len(handles) // rows), **LEGEND)


def closing(
    ax: Axes,
    direction: str,
    colour: Any,
    last: tuple[float, float] | None,
    closed: float,
    family: Family | None = None,
) -> None:
    """Mark a closed way on the lower edge of the axes, and lead a dotted line there from its last open state."""
    floor = ax.get_ylim()[0]
    if last is not None:
        ax.plot([last[0], closed], [max(last[1], floor), floor], ls=":", lw=0.8, color=colour, zorder=2, label=LEAD)
    options: dict[str, Any] = {"ms": 5.0, "mew": 1.3, "clip_on": False, "zorder": 6}
    marks = ax.plot([closed], [floor], ls="", marker=CLOSED[direction], color=colour, label=SHUT, **options)
    if family is not None:
        named(ax, marks, family, curve=f"{family.label}, closed", axis=direction)


def has_median(members: list[Way]) -> bool:
    """Return whether several surfaces share loads, so that their median is drawn."""
    return len(members) > 1 and seal_ways.grid(members).size > 1


def draw_flow(ax: Axes, family: Family, members: list[Way], direction: str, *, alone: bool) -> bool:
    """Draw a flow along one direction; return whether it is seen to close."""
    look, name, floor = look_of(family, direction, alone=alone), name_of(family, direction), ax.get_ylim()[0]
    if not has_median(members):
        return _draw_each(ax, family, members, direction, look | {"label": name}, lead=True)
    at = seal_ways.grid(members)
    centre, low, high = seal_ways.centre_and_band(seal_ways.sample(members, at))
    open_ = centre > 0.0
    ax.fill_between(at, np.maximum(low, 0.1 * floor), high, color=look["color"], alpha=FAINT, lw=0, zorder=2)
    lines = ax.plot(at[open_], centre[open_], label=name, color=look["color"], ls=look["ls"], zorder=3)
    named(ax, lines, family, axis=direction)
    if open_.all():
        return False
    end = int(np.argmin(open_))
    closing(ax, direction, look["color"], (at[end - 1], centre[end - 1]) if end else None, at[end], family)
    return True


def _draw_each(
    ax: Axes, family: Family, members: list[Way], direction: str, look: dict[str, Any], *, lead: bool
) -> bool:
    """Draw the states of one surface up to its closing, or those of several that share no load, which has no mark."""
    if len(members) != 1:
        for member in members:
            lines = ax.plot(member.load, member.value, **(look | {"ls": ""}))
            named(ax, lines, family, axis=direction)
        return False
    (member,) = members
    named(ax, ax.plot(member.load, member.value, zorder=3, **look), family, axis=direction)
    closes = bool(np.isfinite(member.closed))
    if closes:
        last = (member.load[-1], member.value[-1]) if lead and member.load.size else None
        closing(ax, direction, look["color"], last, member.closed, family)
    return closes


def draw_by_width(ax: Axes, width: Array, rows: Array, look: dict[str, Any], direction: str) -> list[str]:
    """Draw T* along a direction against the width of the region; return the direction if it is closed somewhere."""
    if not len(rows):
        return []
    floor = ax.get_ylim()[0]
    centre, low, high = seal_ways.centre_and_band(rows) if len(rows) > 1 else (rows[0],) * 3
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
    if len(members) < 2 or (at := seal_ways.grid(members)).size < 2:
        return _draw_each(ax, family, members, direction, look | {"label": name}, lead=False)
    rows = seal_ways.sample(members, at, hold=True, beyond=beyond)
    closings = sorted(member.closed if np.isfinite(member.closed) else np.inf for member in members)
    end = closings[len(members) // 2]  # from here on the median is closed
    kept = (~np.isnan(rows)).any(axis=0) & (at < end)
    low, high = seal_ways.BAND
    if not kept.any():  # closed wherever the number was taken
        return bool(np.isfinite(end))
    numbers: Any = np.nanpercentile(rows[:, kept], [low, 50.0, high], axis=0, method="inverted_cdf")
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
    if len(members) == 1:
        named(ax, ax.plot(*members[0], label=family.label, zorder=3, **family.look), family)
        return
    at, mean, spread = mean_and_band(members, seal_ways.GRID)
    ax.fill_between(at, mean - spread, mean + spread, color=family.look["color"], alpha=0.18, lw=0, zorder=2)
    named(ax, ax.plot(at, mean, label=family.label, color=family.look["color"], zorder=3), family)
