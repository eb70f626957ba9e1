"""Where a drawing comes from, in one line below it: the paper's figure at the paper's conditions, or whose run it is.

The same file name, ``fig05.png``, may hold the paper's Fig. 5, the same curves for other D, or those of a measured map.
`origin` compares the conditions of a drawing with the paper's, and names the run and the differences.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
from xarray import Dataset

from roughvol.analysis.leak import fluid_of, is_lifted
from roughvol.analysis.legs import first_leg
from roughvol.errors import DatasetError, StudyError
from roughvol.report.figures.families import file_text, held
from roughvol.report.figures.style import STYLE, Drawing, unit_of
from roughvol.report.paper_rules import PAPER_A, PAPER_D, PAPER_M
from roughvol.store.record_key import record_key
from roughvol.study import GeneratedSurface, Study, loads

Draw = Callable[["Dataset"], Drawing]

WORK = "Paggi and He (2015)"
SIDE = 100.0  # L of the paper's surfaces
SHOWN = 3  # files that are named


@dataclass(frozen=True)
class Conditions:
    """Conditions of a figure of the paper: D and m (None: not given, or several), surfaces of each, last plane, A*."""

    D: tuple[float, ...] | None = None
    m: tuple[int, ...] | None = None
    surfaces: int | None = None
    end: tuple[str, ...] = ()
    area: float | None = None


LAST = ("mean-plane", "summit-plane")  # Section 3 ends on the one, Section 4 on the other
NEAR = 0.25  # relative: "A* ~ 0.1"
CONDITIONS: dict[str, Conditions] = {
    "fig01": Conditions(),
    "fig02": Conditions(D=(2.1, 2.5, 2.9), m=(7,)),
    "fig03": Conditions(m=(5, 6, 7, 8)),
    "fig04a": Conditions(m=(8,), surfaces=10, end=LAST),
    "fig04b": Conditions(D=(2.3,), surfaces=1, end=LAST),
    "fig05": Conditions(D=(2.1, 2.9), end=LAST),
    "fig06a": Conditions(m=(8,), surfaces=10, end=LAST),
    "fig06b": Conditions(m=(8,), surfaces=10, end=LAST),
    "fig07a": Conditions(D=(2.3,), surfaces=1, end=LAST),
    "fig07b": Conditions(D=(2.3,), surfaces=1, end=LAST),
    **dict.fromkeys(
        ("fig08", "fig09", "fig10", "fig11a", "fig11b"), Conditions(D=(PAPER_D,), m=(PAPER_M,), area=PAPER_A)
    ),
    "fig12a": Conditions(m=(7,), end=LAST),
    "fig12b": Conditions(D=(2.3,), m=(3, 4, 5, 6, 7, 8), end=LAST),
}


def study_of(ds: Dataset) -> Study | None:
    """Return the study of a dataset, or None if it holds none that can be read again."""
    try:
        return loads(str(ds.attrs.get("study", "")))
    except StudyError:  # the height file is no longer there, or nothing is stored
        return None


def run_name(ds: Dataset) -> str:
    """Return the name of the study of a dataset, empty if it has none."""
    match = re.search(r"^name: *(.+?) *$", str(ds.attrs.get("study", "")), re.MULTILINE)
    return match.group(1).strip("'\"") if match else ""


def is_paper_surface(ds: Dataset) -> bool:
    """Return whether the surfaces have the paper's size and heights: free midpoint patches, L = 100 without a unit."""
    if "case" in ds.dims or abs(float(ds["L"]) - SIDE) > 1e-9 or unit_of(ds, "L") != "length":
        return False
    if "periodic" in ds.attrs:
        return False
    study = study_of(ds)
    return study is None or (isinstance(study.surface, GeneratedSurface) and study.surface.height is None)


def surfaces(ds: Dataset, drawn: Mapping[str, Sequence[float]]) -> str:
    """Return in words which surfaces are drawn: files, or D, m, L and how many of each."""
    unit = unit_of(ds, "L")
    side = f"L = {float(ds['L']):g}" + (f" {unit}" if unit != "length" else "")
    if "case" in ds.dims:
        names = [file_text(str(name)) for name in ds["case"].values.tolist()]
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        return f"height {'file' if len(names) == 1 else 'files'} {', '.join(names[:SHOWN])}{more}, {side}"
    values = {dim: drawn.get(dim) or ds[dim].values.tolist() for dim in ("D", "m") if dim in ds.dims}
    parts = [f"{dim} = {_numbers(numbers)}" for dim, numbers in values.items()]
    if "samples" in drawn:
        return ", ".join([*parts, side, _samples(values["D"], drawn["samples"])])
    counts = sorted({int(count) for count in drawn.get("surfaces", (1,))})
    number = "one surface" if counts == [1] else f"{_range(counts)} surfaces"
    several = " of each" if max(map(len, values.values()), default=1) > 1 else ""
    return ", ".join([*parts, side, number + several])


def origin(name: str, ds: Dataset, drawn: Mapping[str, Sequence[float]]) -> str:
    """Return the note of a figure: which figure of the paper it is, or which run, of what, and how it differs.

    Parameters
    ----------
    name : str
        Of the figure; those without `CONDITIONS` are not the paper's.
    ds : Dataset
        What it is drawn from.
    drawn : mapping
        Values of ``D``, ``m``, ``surfaces`` (how many of each), ``samples`` (of an ensemble, by D and m) and ``area``
        (A*) that it shows, as far as they apply.
    """
    run = run_name(ds)
    words = f"Run {run}: {surfaces(ds, drawn)}" if run else surfaces(ds, drawn)
    if name not in CONDITIONS:
        return f"{words}."
    number = f"Fig. {name[3:].lstrip('0')}"
    if not is_paper_surface(ds):
        return f"{words}. Drawn as {number} of {WORK}, whose surfaces are others."
    others = departures(CONDITIONS[name], ds, drawn)
    if not others:
        return f"{number} of {WORK}, computed" + (f" by the run {run}." if run else ".")
    return f"{words}. Drawn as {number} of {WORK}, but for {'; '.join(others)}."


def departures(paper: Conditions, ds: Dataset, drawn: Mapping[str, Sequence[float]]) -> list[str]:
    """Return in words the differences from the paper's conditions."""
    differences = []
    for key, wanted in (("D", paper.D), ("m", paper.m)):
        values = [round(float(value), 9) for value in drawn.get(key, ())]
        if wanted is not None and values and values != [float(value) for value in wanted]:
            differences.append(f"{key} = {_numbers(values)}, not {_numbers(wanted)}")
    counts = sorted({int(count) for count in drawn.get("surfaces", ())})
    if paper.surfaces is not None and counts and counts != [paper.surfaces]:
        differences.append(f"{_range(counts)} of each, not {paper.surfaces}")
    areas = drawn.get("area", ())
    if paper.area is not None and any(abs(area / paper.area - 1.0) > NEAR for area in areas):
        differences.append(f"A* = {', '.join(f'{area:.3g}' for area in areas)}, not {paper.area:g}")
    study = study_of(ds)
    if paper.end and study is not None and study.sweep.steps:
        label = study.sweep.legs[0].target.label
        if label.split("=")[0] not in paper.end:
            differences.append(f"a sweep to {label}")
    return differences


def _samples(D: Sequence[float], counts: Sequence[float]) -> str:
    """Return in words the samples of an ensemble on each level, by D; ``counts`` runs over D, then m."""
    levels = len(counts) // len(D)
    rows = [_numbers(counts[k * levels : (k + 1) * levels]) for k in range(len(D))]
    if len(D) > 1:
        rows = [f"{row} (D = {value:g})" for row, value in zip(rows, D, strict=True)]
    return f"samples by m: {'; '.join(rows)}"


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def written(ds: Dataset) -> list[str]:
    """Return the version and the date of a dataset in words; empty without them."""
    version, date = (str(ds.attrs.get(key, "")) for key in ("roughvol_version", "date"))
    return [f"roughvol {version}, {date[:10]}."] if version and date else []


def fluid_note(ds: Dataset) -> list[str]:
    """Return pressure drop and viscosity of the leak rates of a dataset as a sentence; empty without them."""
    words = fluid_of(ds)
    return [f"{words[:1].upper()}{words[1:]}."] if words else []


def dry_note(datasets: Sequence[Dataset]) -> list[str]:
    """Return that a figure shows the gap without fluid pressure, where fluid pressure lifts the gap of any dataset."""
    return ["The gap without fluid pressure."] if any(map(is_lifted, datasets)) else []


def lacking(name: str, ds: Dataset, variables: Sequence[str]) -> str | None:
    """Return which variables of a figure a dataset does not have in any case, in words, or None."""
    absent = [variable for variable in variables if variable not in ds]
    if absent:
        keys = dict.fromkeys(filter(None, map(record_key, absent)))
        hint = f" ({', '.join(keys)})" if keys else ""
        return f"{name} needs {', '.join(absent)}, which the study did not record{hint}"
    if not bool(held(first_leg(ds), *variables).any()):
        where = " on the first leg" if "leg" in ds else ""
        return f"{name} needs {', '.join(variables)}, and no case of the dataset has a value of each{where}"
    return None


def register(
    draw: Draw,
    figures: dict[str, Draw],
    missing: Callable[[str, Dataset], str | None],
    *,
    every_leg: bool = False,
) -> Draw:
    """Add a figure to a table by its name, in our style and with its note; return it.

    Parameters
    ----------
    draw : callable
        Draws a dataset.
    figures : dict
        Table of figures by name.
    missing : callable
        Reason why a dataset cannot be drawn, raised as a `DatasetError`, or None.
    every_leg : bool
        Whether all legs of a path are drawn. Default: the first one, which loads the virgin surface.
    """

    @functools.wraps(draw)
    def checked(ds: Dataset) -> Drawing:
        reason = missing(draw.__name__, ds)
        if reason is not None:
            raise DatasetError(reason)
        with mpl.rc_context(STYLE):
            figure = draw(ds if every_leg else first_leg(ds))
            if "L" in ds:
                figure.note(" ".join([origin(draw.__name__, ds, figure.shown), *written(ds), *dry_note([ds])]))
            return figure

    figures[draw.__name__] = checked
    return checked
