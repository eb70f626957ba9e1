"""Figures that a report shows, each drawn from one run or from several."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from roughvol.analysis.stored_run import Run
from roughvol.errors import DatasetError
from roughvol.report.captions import caption
from roughvol.report.claims import Evidence, Lacking
from roughvol.report.figures.paper import FIGURES, NEEDS, missing
from roughvol.report.figures.selection import figures
from roughvol.report.figures.theory import THEORY
from roughvol.report.model import Report, uses_of


class Drawing(NamedTuple):
    """A figure with its name, its caption and the run it is drawn from, empty where it compares several."""

    name: str
    caption: str
    source: str
    figure: Figure


def drawings(report: Report) -> Iterator[Drawing]:
    """Yield every figure that the runs of the paper can feed."""
    for name, draw in FIGURES.items():
        run = _feeds(report, name)
        if run is not None:
            yield Drawing(name, caption(name, surfaces=run.seeds), run.name, draw(run.dataset))
    for name, draw_all in THEORY.items():
        try:
            figure = draw_all(_evidence(report, name))
        except Lacking:
            continue
        yield Drawing(name, caption(name), "", figure)


def drawings_of(run: Run) -> Iterator[Drawing]:
    """Yield every figure that one run can feed by itself."""
    measured = "case" in run.dataset.dims
    surfaces = 1 if measured else run.seeds
    for name, (draw, why_not) in figures().items():
        if why_not(name, run.dataset) is not None:
            continue
        try:
            words = caption(name, surfaces=surfaces, measured=measured)
            yield Drawing(name, words, run.name, draw(run.dataset))
        except DatasetError:
            continue


def _evidence(report: Report, name: str) -> Evidence:
    """Return the runs that the claim of a figure needs, or all of the paper where no claim shows it or none fits."""
    evidence, needs = report.evidence, uses_of(name)
    fit = [run for run in evidence.runs if any(run in evidence.fit(need) for need in needs)]
    # second readings compare runs that the claim itself refuses
    return evidence if not fit or name.startswith("readings_") or name == "seeds" else Evidence(tuple(fit))


def _feeds(report: Report, name: str) -> Run | None:
    """Return the run that a figure of the paper is drawn from: chosen as the claims choose theirs."""
    variables, by = NEEDS[name]
    of_fields = {"gap", "box_count", "local_dimension"} & set(variables)
    able = [run for run in report.evidence.runs if missing(name, run.dataset) is None]
    able = [run for run in able if run.law in ("std", "")] or able

    def rank(run: Run) -> tuple[Any, ...]:
        sizes = run.dataset.sizes
        finest = max(run.m) if "m" in sizes else 0
        if of_fields:  # Figs. 8 to 11 show one state, that whose fields were kept
            return "gap" in run.dataset, finest, sizes.get("seed", 0)
        return run.end in ("mean-plane", ""), sizes.get("m" if by == "m" else "D", 0), finest, sizes.get("seed", 0)

    return max(able, key=rank, default=None)
