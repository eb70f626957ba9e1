"""Figures of the paper and comparisons that the runs of a report can feed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from roughvol.analysis.stored_run import Run
from roughvol.report.document import Drawing
from roughvol.reproduction.claims import CLAIMS, Evidence, Lacking
from roughvol.reproduction.figures.conditions import PaperFigure
from roughvol.reproduction.figures.registry import COMPARISONS, FIGURES


def drawings(evidence: Evidence) -> Iterator[Drawing]:
    """Yield every figure that the runs of the paper can feed."""
    for name, figure in FIGURES.items():
        run = _feeds(evidence, figure)
        if run is not None:
            yield Drawing(name, figure.words(surfaces=run.seeds), run.name, figure(run.dataset))
    for name, comparison in COMPARISONS.items():
        try:
            drawn = comparison(_fit(evidence, name))
        except Lacking:
            continue
        yield Drawing(name, comparison.words(), "", drawn)


def _fit(evidence: Evidence, name: str) -> Evidence:
    """Return the runs that the claim of a figure needs, or all of the paper where no claim shows it or none fits."""
    needs = [need for question in CLAIMS.values() if name in question.figures for need in question.needs.values()]
    fit = [run for run in evidence.runs if any(run in evidence.fit(need) for need in needs)]
    # second readings compare runs that the claim itself refuses
    return evidence if not fit or name.startswith("readings_") or name == "seeds" else Evidence(tuple(fit))


def _feeds(evidence: Evidence, figure: PaperFigure) -> Run | None:
    """Return the run that a figure of the paper is drawn from: chosen as the claims choose theirs."""
    of_fields = {"gap", "box_count", "local_dimension"} & set(figure.needs)
    able = [run for run in evidence.runs if figure.missing(run.dataset) is None]
    able = [run for run in able if run.law in ("std", "")] or able

    def rank(run: Run) -> tuple[Any, ...]:
        sizes = run.dataset.sizes
        finest = max(run.m) if "m" in sizes else 0
        if of_fields:  # Figs. 8 to 11 show one state, that whose fields were kept
            return "gap" in run.dataset, finest, sizes.get("seed", 0)
        by = "m" if figure.by == "m" else "D"
        return run.end in ("mean-plane", ""), sizes.get(by, 0), finest, sizes.get("seed", 0)

    return max(able, key=rank, default=None)
