"""Figures named by their content, ``v_of_p`` for V* over p*, of one run or of several runs overlaid.

The name is that of the quantity drawn, then that of the quantity below it: p, a, v and d are p*, A*, V* and d/σ; gap,
leak and flow are the mean gap, the leak rate and the transmissivity. The leak is that of a gas where none of a liquid
is stored. Pressures have the unit of the runs, if all have one. A curve shows the surfaces of one D and m, or one file.
A leak and a flow are drawn along x (solid) and y (dashed), with a mark where the way closes.
"""

from __future__ import annotations

import itertools
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from xarray import Dataset

from roughvol.analysis import average
from roughvol.analysis.derived import P, derived, is_pressed, lacks_states
from roughvol.analysis.leak import LIFTED, gas_of, is_lifted
from roughvol.analysis.legs import first_leg
from roughvol.analysis.units import in_units
from roughvol.errors import DatasetError
from roughvol.observables.variables import AXES, QUANTITIES
from roughvol.report.figures import origin, style, ways
from roughvol.report.figures.curves import plot, shown
from roughvol.report.figures.families import Curve, Family, curves, every_family, file_text, held, named, several
from roughvol.report.states import shortest_names
from roughvol.store.variants import Part, parts_of, study_in
from roughvol.tables import table

_TABLE = table(__file__, "figures")["content"]
DRAWN: tuple[str, ...] = tuple(_TABLE["drawn"])
"""The figures of several runs, without a name."""
VARIABLES_OF: dict[str, list[str]] = {key: row["variables"] for key, row in _TABLE["quantities"].items()}
BELOW, POWERS, LOGARITHMIC = (
    [key for key, row in _TABLE["quantities"].items() if flag in row] for flag in ("below", "power", "logarithmic")
)
COLUMNS = ("panel", "curve", "D", "m", "seed", "case", "axis", "x", "y", "x_label", "y_label")
"""Columns of the points of a figure."""
MANY = 6  # height files of a run that have a curve each; more are one family
LINE = 0.19  # inches that each further line of a legend adds
KEY = 6  # characters of the line beside a name of a legend
LABEL_WIDTH = 36  # characters of a label that fit beside the axes
NAMES = tuple(f"{y}_of_{x}" for y, x in itertools.product(VARIABLES_OF, BELOW) if y != x)
"""Names of all figures by content."""
IN_WORDS = f"Y_of_X as v_of_p, X of {', '.join(BELOW)}, Y of these or {', '.join(LOGARITHMIC)}"


@dataclass(frozen=True)
class Named:
    """A run to overlay: its name and its dataset, and of a combination named by its words the run."""

    name: str
    dataset: Dataset
    run: str = ""

    @cached_property
    def ready(self) -> Dataset:
        """The dataset with derived numbers."""
        return derived(self.dataset, study_in(self.dataset)) if "mean_pressure" in self.dataset else self.dataset


def parts(stored: Sequence[tuple[str, Dataset]]) -> list[Named]:
    """Return the runs to overlay of datasets and their names: one for each combination of the lists of a study.

    Of one study the words that all combinations share stand with the run.
    """
    found = [(name, part) for name, ds in stored for part in parts_of(ds)]
    if len(stored) > 1:
        return [Named(", ".join(filter(None, (name, part.words))), part.dataset) for name, part in found]
    if len(found) == 1:
        return [Named(part.words or name, part.dataset, name if part.words else "") for name, part in found]
    study, (name, ds) = study_in(stored[0][1]), stored[0]
    axes = study.axes if study else ()

    def words(part: Part, *, shared: bool) -> str:
        chosen = (axis for axis in axes if (ds.sizes[axis.name] == 1) == shared)
        return ", ".join(axis.words(part.labels[axis.name]) for axis in chosen)

    runs = ", ".join(filter(None, (name, words(found[0][1], shared=True))))
    return [Named(words(part, shared=False), part.dataset, runs) for _, part in found]


def missing(name: str, runs: Sequence[Named]) -> str | None:
    """Return why a figure cannot be drawn from runs, None if it can."""
    for run in runs:
        if P in run.dataset and not is_pressed(run.dataset):
            return f"{run.name}: {name} needs states, and the dataset {lacks_states(run.dataset)}"
        for key in name.rsplit("_of_", 1):
            several = VARIABLES_OF.get(key, [key])
            held = [variable for variable in several if variable in run.ready]
            stored = list(dict.fromkeys(_stored(run.ready, variable) for variable in held or several))
            reasons = [origin.lacking(name, run.ready, (variable,)) for variable in stored]
            if all(reasons):
                if not any(variable in run.ready for variable in stored):  # any of them would do
                    wanted = [variable for variable in stored if variable.removesuffix("_dry") == variable]
                    reasons = [origin.lacking(name, run.ready, wanted or stored, joint=" or ")]
                takes = _TABLE["quantities"].get(key, {}).get("takes", "")
                return f"{run.name}: {'; '.join(map(str, reasons))}{takes and f'; it takes {takes}'}"
    return None


def _stored(ds: Dataset, name: str) -> str:
    """Return the variable that holds a flow: under fluid pressure that of its recorded states."""
    return LIFTED.get(name, name) if is_lifted(ds) else name


def own_names(runs: Iterable[Named]) -> list[str]:
    """Return the names of the figures of quantities of a user, numbers along the steps that are in no table."""
    every = (run.dataset for run in runs)
    made = [name for ds in every for name in ds.data_vars if ds.variables[name].dims[-1:] == ("step",)]
    own = [name for name in map(str, made) if name not in QUANTITIES or QUANTITIES[name].observable == "own"]
    return [f"{y}_of_{x}" for y, x in itertools.product(dict.fromkeys(own), BELOW)]


def draw(name: str, runs: Sequence[Named]) -> style.Drawing:
    """Return a figure by content that is not `missing`, its curves named by run where there are several."""
    y_key, x_key = name.rsplit("_of_", 1)
    common: dict[str, str] = {}
    ready = [Named(run.name, in_units(first_leg(run.ready), common), run.run) for run in runs]
    x, y = _variable(x_key, ready), _variable(y_key, ready)
    flows = average.is_flow(y)
    height, few = (3.2, 2) if flows else (3.0, 4)  # inches, and lines of a legend that fit them
    with mpl.rc_context(style.STYLE):
        some, title = _families(ready, x, y)
        some = [family._replace(label=wrapped(family.label)) for family in some]
        fig, ax = style.axes(height=height + LINE * max(0, _legend_lines(some) - few))
        if flows:
            ax.set(xlabel=_label(x, ready), ylabel=_label(y, ready))
            _flow(ax, some, x, y, title)
            notes = []
            if y == "leak_rate":
                notes = _fluids(
                    ready, origin.fluid_text, origin.fluid_note(ready[0].dataset), "Pressure drop and viscosity differ"
                )
            elif y == "gas_leak_rate" and (gas := gas_of(ready[0].dataset)):
                notes = _fluids(ready, gas_of, [f"Gas: {gas}."], "Gases differ")
            notes += origin.patch_note([run.dataset for run in ready], (y,))
        else:
            log = y_key in LOGARITHMIC
            members = [[_positive(curve) if log else curve for curve in curves(f, x, y)] for f in some]
            plot(ax, some, members, (_label(x, ready), _label(y, ready)), title, log=log)
            ax.set_yscale("log" if log else "linear")
            if y_key in POWERS and x_key == "p":
                ax.set_xscale("log")
                style.plain_ticks(ax.xaxis)
            notes = origin.dry_note([run.dataset for run in ready])
        fig.note(" ".join([_origin(ready, some), *notes]))
    return fig


def _flow(ax: Axes, some: Sequence[Family], x: str, name: str, title: str) -> None:
    """Draw a flow along x and y: the states of one surface, median and band of several, and where the ways close."""
    dry = f"{name}_dry"
    stored = [family.data[key] for family in some for key in (name, dry, LIFTED.get(name)) if key in family.data]
    ways.flow_axis(ax, np.concatenate([values.values.ravel() for values in stored]))
    closed, states, median = set[str](), set[str](), False
    for family in some:
        for axis in AXES:
            members = ways.ways(family, x, name, axis)
            median = median or ways.has_median(members)
            states |= {family.label for member in members if member.recorded}
            if members and ways.draw_flow(ax, family, members, axis, alone=len(some) == 1):
                closed.add(axis)
        if dry in family.data:
            _dry(ax, family, x, dry)
    lifted = any(dry in family.data for family in some)
    _legend(ax, some, closed, title, dry=lifted, median=median, states=states)


def _dry(ax: Axes, family: Family, x: str, name: str) -> None:
    """Draw a flow of the dry gap as thin grey lines beside the lifted flow."""
    for axis in AXES:
        for surface, curve in enumerate(curves(family.along(axis), x, name)):
            look: dict[str, Any] = {"color": style.GREY, "lw": 0.6, "ls": ways.LINES[axis], "zorder": 1}
            lines = ax.plot(*_positive(curve), label=f"_dry, along ${axis}$", **look)
            named(ax, lines, family, surface, curve=f"{family.label}, without fluid pressure", axis=axis)


def _legend(
    ax: Axes, some: Sequence[Family], closed: set[str], title: str, *, dry: bool, median: bool, states: set[str]
) -> None:
    """Put families, directions, closings and the dry gap into one legend above the axes; ``states`` have no line."""
    alone, number = len(some) == 1, several(family.surfaces for family in some)
    drawn = ways.band_words([family.surfaces for family in some]) if median else f"each of {number} surfaces"
    heading = [some[0].label if alone else "", title, drawn if number else ""]
    # a median has no markers, single states have no line
    handles = ways.handles(some, {"marker": "none"} if median else {"ls": ""})
    for handle, family in zip(handles, [*some, *some], strict=False):  # a single family has two directions
        if family.label in states:
            words = f"{handle.get_label()}{', each surface' * median}"
            handle.set(linestyle="", marker=handle.get_marker() if alone else family.look["marker"], label=words)
    joined = {family.label for family in some} > states
    for axis in () if alone else AXES:
        look: dict[str, Any] = {"ls": ways.LINES[axis] if joined else "", "mfc": style.GREY if axis == "x" else "none"}
        mark = "o" if states else "none"
        handles.append(Line2D([], [], color=style.GREY, marker=mark, label=f"along ${axis}$", **look))
    handles += ways.closed_handles(closed, "closed")
    words = "without fluid pressure" + ", each surface" * bool(number)
    for axis in AXES if dry else ():
        handles.append(Line2D([], [], color=style.GREY, lw=0.6, ls=ways.LINES[axis], label=f"along ${axis}$ {words}"))
    style.legend(ax, "; ".join(filter(None, heading)), handles)


def _fluids(runs: Sequence[Named], words_of: Callable[[Dataset], str], alone: list[str], differ: str) -> list[str]:
    """Return the notes on the fluid of a leak, those of all runs, or one note with the fluid of each run."""
    found: dict[str, list[str]] = {}
    for run in runs:
        found.setdefault(words_of(run.dataset), []).append(run.name)
    if len(found) == 1:
        return alone
    each = [f"{file_text(names)}: {words or 'unknown'}" for words, names in shortest_names(found).items()]
    return [f"{differ}: {'; '.join(each)}."]


def _origin(runs: Sequence[Named], some: Sequence[Family]) -> str:
    """Return the runs of a figure in words, or their number where they are many, and which leg of a path it shows."""
    names = [file_text(run.name) for run in runs]
    of = file_text(runs[0].run)
    listed = ("; " if any(", " in name for name in names) else ", ").join(names)
    words = f"Run {of}: {listed}." if of else f"Runs {listed}."
    if len(runs) == 1:
        words = f"Run {', '.join(filter(None, (of, names[0])))}: {origin.surfaces(runs[0].dataset, shown(some))}."
    elif len(runs) > MANY:
        words = f"Run {of}: " * bool(of) + f"{len(runs)} {'' if of else 'runs or '}combinations; the legend names them."
    legs = (line for run in runs for line in origin.leg_note(run.dataset, (P,)))
    return " ".join([words, *dict.fromkeys((*legs, *(line for run in runs for line in origin.written(run.dataset))))])


def wrapped(label: str) -> str:
    """Return a label in lines that fit the legend, none of which ends within a formula or a range."""
    joined = re.sub(r"\$[^$]*\$|\S+ to \S+", lambda whole: whole.group().replace(" ", "\0"), label)
    return textwrap.fill(joined, style.WIDE - KEY).replace("\0", " ")


def _legend_lines(some: Sequence[Family]) -> int:
    """Return the lines of the legend of families, in as many columns as fit."""
    lines = [line for family in some for line in family.label.splitlines()]
    columns = max(1, style.WIDE // (KEY + max(map(len, lines), default=0)))
    return -(-len(lines) // columns)


def _positive(curve: Curve) -> Curve:
    """Return a curve without its zeros, which a logarithmic axis does not have."""
    x, y = curve
    return x[y > 0.0], y[y > 0.0]


def _variable(key: str, runs: Sequence[Named]) -> str:
    """Return the variable to draw: the first of which all runs have values, with one unit."""
    known = VARIABLES_OF.get(key, [key])
    units = {name: {_unit(name, run.dataset) for run in runs if name in run.dataset} for name in known}
    for name, found in units.items():
        if len(found) == 1 and not any(origin.lacking(key, run.dataset, (_stored(run.dataset, name),)) for run in runs):
            return name
    differing = ", ".join(sorted(set().union(*units.values())))
    raise DatasetError(f"the runs have {' or '.join(known)} in different units: {differing}")


def _unit(name: str, ds: Dataset) -> str:
    return str(ds[name].attrs.get("units", "1"))


def _label(name: str, runs: Sequence[Named]) -> str:
    unit = _unit(name, runs[0].dataset)
    label = style.LABELS.get(name) or file_text(str(runs[0].dataset[name].attrs["long_name"]))
    words = label if unit == "1" else f"{label} [{style.unit_text(unit)}]"
    return words if name in style.LABELS else textwrap.fill(words, LABEL_WIDTH)


def _families(runs: Sequence[Named], x: str, y: str) -> tuple[list[Family], str]:
    """Return the families of all runs, named by run, and what they share."""
    if len(runs) == 1 and runs[0].dataset.sizes.get("case", 0) <= MANY:
        return every_family(runs[0].dataset, x, _stored(runs[0].dataset, y))
    found: list[Family] = []
    for run in runs:
        if run.dataset.sizes.get("case", 0) > MANY:
            held_by = held(run.dataset, x, _stored(run.dataset, y)).values
            members = run.dataset.isel(case=np.flatnonzero(held_by)).rename(case="seed")
            found.append(Family(file_text(run.name), 0.0, {}, members))
            continue
        some, title = every_family(run.dataset, x, _stored(run.dataset, y))
        for family in some:
            words = ", ".join(filter(None, [family.label, title])) if len(some) > 1 else ""
            found.append(family._replace(label=": ".join(filter(None, [file_text(run.name), words]))))
    return [family._replace(look=look) for family, look in zip(found, style.looks(len(found)), strict=True)], ""


def data(fig: style.Drawing) -> Iterator[Mapping[str, object]]:
    """Yield the points of the curves of a figure, of any of this package; a number that is missing is None."""
    empty = True
    for panel, ax in enumerate(fig.axes, start=1):
        unnamed = 0
        for line in ax.get_lines():
            label = str(line.get_label())
            if label == ways.LEAD or line.get_transform() != ax.transData:
                continue  # a guide: a line to a mark, or one across the axes
            source = dict(fig.sources.get(line, {}))
            if not source and label.startswith("_child"):
                unnamed += 1
                label = f"line {unnamed}"
            names = dict.fromkeys(COLUMNS) | source | {"panel": panel}
            names["curve"] = style.plain(str(source.get("curve", label.lstrip("_")))).replace("\n", " ")
            x_label, y_label = (style.plain(label).replace("\n", " ") for label in (ax.get_xlabel(), ax.get_ylabel()))
            names |= {"x_label": x_label, "y_label": y_label}
            xs, ys = (np.atleast_1d(np.asarray(part, dtype=float)) for part in line.get_data())
            if label == ways.SHUT:
                ys = np.full(ys.shape, np.nan)  # the mark is on the edge of the axes, which is no leak
            for point in zip(xs.tolist(), ys.tolist(), strict=False):
                x, y = (value if math.isfinite(value) else None for value in point)
                if x is not None or y is not None:  # a ring of waves that a region has not
                    empty = False
                    yield names | {"x": x, "y": y}
    if empty:
        raise DatasetError("the figure has no curves: --format csv takes figures of curves, fields are in study.nc")
