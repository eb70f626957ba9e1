"""Figures named by their content, ``v_of_p`` for V* over p*, of one run or of several runs overlaid.

The name is that of the quantity drawn, then that of the quantity below it: p, a, v and d are p*, A*, V* and d/σ; gap,
leak and flow are the mean gap, the leak rate and the transmissivity. Pressures have the unit of the runs, if all have
one.
"""

from __future__ import annotations

import itertools
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from xarray import Dataset

from roughvol.analysis.derived import derived
from roughvol.analysis.legs import first_leg
from roughvol.analysis.units import in_units
from roughvol.errors import DatasetError
from roughvol.report.figures.curves import plot
from roughvol.report.figures.families import Curve, Family, curves, families, file_text, held
from roughvol.report.figures.origin import lacking, study_of, surfaces
from roughvol.report.figures.style import COLUMN, LABELS, STYLE, WIDE, Drawing, canvas, looks, unit_text
from roughvol.store.variants import parts_of

VARIABLES_OF = {  # the first one that all runs have is drawn
    "p": ("nominal_pressure", "mean_pressure"),
    "a": ("contact_area_fraction",),
    "v": ("free_volume",),
    "d": ("separation",),
    "i": ("indentation",),
    "gap": ("mean_gap",),
    "leak": ("leak_rate_x",),
    "flow": ("transmissivity_x",),
    "stiffness": ("interfacial_stiffness",),
    "conductance": ("contact_conductance",),
}
BELOW = ("p", "a", "v", "d", "i", "gap")
DRAWN = ("v_of_p", "a_of_p", "v_of_a", "v_of_d", "gap_of_p", "leak_of_p")
"""The figures of several runs, without a name."""
WORDS = {
    "nominal_pressure": "nominal pressure $p$",
    "indentation": r"indentation $\Delta/\sigma$",
    "mean_gap": r"mean gap $\bar g$",
    "leak_rate_x": "leak rate along $x$ $Q_x$",
    "transmissivity_x": r"transmissivity along $x$ $T_x^{\ast}$",
    "interfacial_stiffness": r"interfacial stiffness $K L/E^{\ast}$",
    "contact_conductance": r"contact conductance $h$",
}
POWERS = ("stiffness", "conductance")  # that go about with a power of the pressure: both axes are logarithmic
LOGARITHMIC = ("leak", "flow", *POWERS)
MANY = 6  # height files of a run that have a curve each; more are one family
FEW, LINE = 4, 0.19  # lines of a legend over a figure of usual height, and inches that each further one adds
KEY = 6  # characters of the line beside a name of a legend
NAMES = tuple(f"{y}_of_{x}" for y, x in itertools.product(VARIABLES_OF, BELOW) if y != x)
"""Names of all figures by content."""
IN_WORDS = f"Y_of_X as v_of_p, X of {', '.join(BELOW)}, Y of these or {', '.join(LOGARITHMIC)}"


@dataclass(frozen=True)
class Named:
    """A run to overlay: its name and its dataset."""

    name: str
    dataset: Dataset


def parts(name: str, ds: Dataset, *, alone: bool) -> list[Named]:
    """Return the runs to overlay of a dataset: one for each combination of the lists of its study.

    Parameters
    ----------
    name : str
        Name of the run.
    ds : Dataset
        As `dataset.read` returns it.
    alone : bool
        Whether no other run is drawn, so that its name may be left out.

    Returns
    -------
    list of Named
        One for a study without lists.
    """
    return [
        Named(", ".join(filter(None, ("" if alone and part.words else name, part.words))), part.dataset)
        for part in parts_of(ds)
    ]


def missing(name: str, runs: Sequence[Named]) -> str | None:
    """Return why a figure cannot be drawn from runs, None if it can."""
    for run in runs:
        ready = derived(run.dataset, study_of(run.dataset)) if "mean_pressure" in run.dataset else run.dataset
        for key in name.split("_of_"):
            reasons = [lacking(name, ready, (variable,)) for variable in VARIABLES_OF[key]]
            if all(reasons):
                return f"{run.name}: {reasons[-1]}"
    return None


def draw(name: str, runs: Sequence[Named]) -> Drawing:
    """Return a figure by content, its curves named by run where there are several.

    Parameters
    ----------
    name : str
        Of `NAMES`.
    runs : sequence of Named
        One or more runs.

    Returns
    -------
    Drawing
        The figure; single surfaces as lines, several by mean and band.

    Raises
    ------
    DatasetError
        If a run lacks a quantity, or two runs have it in units that do not convert.
    """
    if reason := missing(name, runs):
        raise DatasetError(reason)
    y_key, x_key = name.split("_of_")
    common: dict[str, str] = {}
    ready = [Named(run.name, in_units(first_leg(derived(run.dataset, study_of(run.dataset))), common)) for run in runs]
    x, y = _variable(x_key, ready), _variable(y_key, ready)
    with mpl.rc_context(STYLE):
        some, title = _families(ready, x, y)
        some = [family._replace(label=wrapped(family.label)) for family in some]
        fig = canvas(COLUMN, 3.0 + LINE * max(0, _legend_lines(some) - FEW))
        ax = fig.subplots()
        log = y_key in LOGARITHMIC
        members: list[list[Curve]] = [[_positive(curve) if log else curve for curve in curves(f, x, y)] for f in some]
        plot(ax, some, members, (_label(x, ready), _label(y, ready)), title, log=log)
        if log:
            ax.set_yscale("log")
        if y_key in POWERS and x_key == "p":
            ax.set_xscale("log")
        if len(ready) == 1:
            run = ready[0]
            fig.note(f"Run {file_text(run.name)}: {surfaces(run.dataset, {'surfaces': [f.surfaces for f in some]})}.")
        else:
            fig.note(_names(ready))
    return fig


def wrapped(label: str) -> str:
    """Return a label in lines that fit the legend, none of which ends within a formula."""
    joined = re.sub(r"\$[^$]*\$", lambda formula: formula.group().replace(" ", "\0"), label)
    return textwrap.fill(joined, WIDE - KEY).replace("\0", " ")


def _legend_lines(some: Sequence[Family]) -> int:
    """Return the lines of the legend of families, in as many columns as fit."""
    lines = [line for family in some for line in family.label.splitlines()]
    columns = max(1, WIDE // (KEY + max(map(len, lines), default=0)))
    return -(-len(lines) // columns)


def _names(runs: Sequence[Named]) -> str:
    """Return the names of the runs, or their number where the legend has them and they are many."""
    if len(runs) > MANY:
        return f"{len(runs)} runs or combinations; the legend names them."
    return f"Runs {', '.join(file_text(run.name) for run in runs)}."


def _positive(curve: Curve) -> Curve:
    """Return a curve without its zeros, which a logarithmic axis does not have."""
    x, y = curve
    return x[y > 0.0], y[y > 0.0]


def _variable(key: str, runs: Sequence[Named]) -> str:
    """Return the variable to draw: the first that all runs have, with one unit."""
    for name in VARIABLES_OF[key]:
        units = {_unit(name, run.dataset) for run in runs if name in run.dataset}
        if all(name in run.dataset for run in runs) and len(units) == 1:
            return name
    units = {_unit(name, run.dataset) for run in runs for name in VARIABLES_OF[key] if name in run.dataset}
    message = f"the runs have {VARIABLES_OF[key][-1]} in different units: {', '.join(sorted(units))}"
    raise DatasetError(message)


def _unit(name: str, ds: Dataset) -> str:
    return str(ds[name].attrs.get("units", "1"))


def _label(name: str, runs: Sequence[Named]) -> str:
    unit = _unit(name, runs[0].dataset)
    words = LABELS.get(name) or WORDS[name]
    return words if unit == "1" else f"{words} [{unit_text(unit)}]"


def _families(runs: Sequence[Named], x: str, y: str) -> tuple[list[Family], str]:
    """Return the families of all runs, named by run, and what they share."""
    if len(runs) == 1 and runs[0].dataset.sizes.get("case", 0) <= MANY:
        return families(runs[0].dataset, "D", x, y)
    found: list[Family] = []
    for run in runs:
        if run.dataset.sizes.get("case", 0) > MANY:
            held_by = held(run.dataset, x, y).values
            members = run.dataset.isel(case=np.flatnonzero(held_by)).rename(case="seed")
            found.append(Family(file_text(run.name), 0.0, {}, members))
            continue
        some, title = families(run.dataset, "D", x, y)
        for family in some:
            words = ", ".join(filter(None, [family.label, title])) if "case" not in run.dataset.dims else family.label
            lone = len(some) == 1
            label = file_text(run.name) if lone else f"{file_text(run.name)}: {words}"
            found.append(family._replace(label=label))
    return [family._replace(look=look) for family, look in zip(found, looks(len(found)), strict=True)], ""


def data(fig: Drawing) -> Iterator[Mapping[str, object]]:
    """Yield the points of the curves of a figure, of any of this package.

    Parameters
    ----------
    fig : Drawing
        The figure.

    Yields
    ------
    mapping
        panel, curve, x, y, x_label, y_label; a curve without a name in the legend is ``surface 1`` and so on.

    Raises
    ------
    DatasetError
        If the figure has no curves, as a map.
    """
    empty = True
    for panel, ax in enumerate(fig.axes, start=1):
        unnamed = 0
        for line in ax.get_lines():
            label = str(line.get_label())
            if label.startswith("_"):
                unnamed += 1
                label = f"surface {unnamed}"
            names = {"panel": panel, "curve": label, "x_label": ax.get_xlabel(), "y_label": ax.get_ylabel()}
            xs, ys = (np.atleast_1d(np.asarray(part, dtype=float)) for part in line.get_data())
            for x, y in zip(xs.tolist(), ys.tolist(), strict=False):
                empty = False
                yield names | {"x": x, "y": y}
    if empty:
        message = "the figure has no curves: --format csv takes figures of curves, fields are in study.nc"
        raise DatasetError(message)
