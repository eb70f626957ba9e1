"""Conditions of the paper's figures, and how a drawing differs from them.

The same file name, ``fig05.png``, may hold the paper's Fig. 5, the same curves for other D, or those of a measured map.
The note below a drawing names the differences.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from xarray import Dataset

from roughvol.analysis.tables import range_text
from roughvol.report.figures.families import families
from roughvol.report.figures.figure import Figure
from roughvol.report.figures.origin import numbers_text, origin, run_name
from roughvol.report.figures.style import unit_of
from roughvol.store.variants import study_in
from roughvol.study import GeneratedSurface

WORK = "Paggi and He (2015)"
SIDE = 100.0  # L of the paper's surfaces
ACCENT, SECOND = "#00707a", "#1f6fb4"  # laws and published numbers beside computed ones
NEAR = 0.25  # relative: "A* ~ 0.1"


@dataclass(frozen=True)
class PaperFigure(Figure):
    """A figure of the paper, with the paper's conditions."""

    by: str = ""  # what the figure compares: "", "D", "m" or "recursion"
    D: tuple[float, ...] | None = None  # values that the paper shows; None where it gives none
    m: tuple[int, ...] | None = None
    surfaces: int | None = None  # of each D and m
    end: tuple[str, ...] = ()  # kinds of the last state
    area: float | None = None  # A* of the state

    def missing(self, ds: Dataset) -> str | None:
        """Return why the figure cannot be drawn from a dataset, or None if it can."""
        if reason := super().missing(ds):
            return reason
        if self.by in ("recursion", "m") and "case" in ds.dims:
            return f"{self.name} needs surfaces made from D and m, and those of the dataset were read from files"
        study = study_in(ds) if self.by == "recursion" else None
        if self.by == "recursion" and (not is_free(ds) or (study and not isinstance(study.surface, GeneratedSurface))):
            return (
                f"{self.name} shows midpoint displacement of a free patch, and the surfaces of the dataset are others"
            )
        # One D alone is still worth drawing, unless the dataset compares m: then that figure has the same axes.
        lone = self.by in ("D", "m") and len(families(ds[list(self.needs)], self.by, *self.needs)[0]) < 2
        if lone and (self.by == "m" or ds.sizes.get("m", 0) > 1):
            return f"{self.name} compares values of {self.by}, and the dataset has one"
        return None

    def origin(self, ds: Dataset, drawn: Mapping[str, Sequence[float]]) -> str:
        """Return the note of the figure: that it is the paper's, or its run, its surfaces and the differences."""
        words, number = origin(ds, drawn), f"Fig. {self.name[3:].lstrip('0')}"
        if not is_paper_surface(ds):
            return f"{words}. Drawn as {number} of {WORK}, whose surfaces are others."
        if others := self.departures(ds, drawn):
            return f"{words}. Drawn as {number} of {WORK}, but for {'; '.join(others)}."
        run = run_name(ds)
        return f"{number} of {WORK}, computed" + (f" by the run {run}." if run else ".")

    def departures(self, ds: Dataset, drawn: Mapping[str, Sequence[float]]) -> list[str]:
        """Return in words the differences from the paper's conditions; ``drawn`` is `Drawing.shown`."""
        differences = []
        for key, wanted in (("D", self.D), ("m", self.m)):
            values = [round(float(value), 9) for value in drawn.get(key, ())]
            if wanted is not None and values and values != [float(value) for value in wanted]:
                differences.append(f"{key} = {numbers_text(values)}, not {numbers_text(wanted)}")
        counts = sorted({int(count) for count in drawn.get("surfaces", ())})
        if self.surfaces is not None and counts and counts != [self.surfaces]:
            differences.append(f"{range_text(counts)} of each, not {self.surfaces}")
        areas = drawn.get("area", ())
        if self.area is not None and any(abs(area / self.area - 1.0) > NEAR for area in areas):
            differences.append(f"A* = {', '.join(f'{area:.3g}' for area in areas)}, not {self.area:g}")
        study = study_in(ds)
        if self.end and study is not None and study.sweep.steps:
            label = study.sweep.legs[0].target.label
            if label.split("=")[0] not in self.end:
                differences.append(f"a sweep to {label}")
        return differences


def is_free(ds: Dataset) -> bool:
    """Return whether the surfaces are free patches; versions without the attribute had periods beside them."""
    return bool(ds.attrs.get("sides", "periodic" if "periodic" in ds.attrs else "free") == "free")


def is_paper_surface(ds: Dataset) -> bool:
    """Return whether the surfaces have the paper's size and heights: free midpoint patches, L = 100 without a unit."""
    if "case" in ds.dims or abs(float(ds["L"]) - SIDE) > 1e-9 or unit_of(ds, "L") != "length":
        return False
    if not is_free(ds):
        return False
    study = study_in(ds)
    return study is None or (isinstance(study.surface, GeneratedSurface) and study.surface.height is None)
