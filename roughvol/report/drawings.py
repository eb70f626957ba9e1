"""Figures that a page shows, each with its caption and its run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from roughvol.analysis.stored_run import Run
from roughvol.errors import DatasetError
from roughvol.report.document import Drawing
from roughvol.report.figures.figure import Figure


def drawings_of(run: Run, figures: Mapping[str, Figure]) -> Iterator[Drawing]:
    """Yield every figure of a table that one run can feed by itself."""
    measured = "case" in run.dataset.dims
    for name, figure in figures.items():
        if figure.missing(run.dataset) is not None:
            continue
        words = figure.words(surfaces=1 if measured else run.seeds, measured=measured)
        try:
            yield Drawing(name, words, run.name, figure(run.dataset))
        except DatasetError:
            continue
