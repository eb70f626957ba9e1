"""The tables of the paper's figures, `figures.toml`: drawing, caption, variables, cases, conditions of the paper.

`FIGURES` are Figs. 1 to 12, each drawn from one run. `COMPARISONS` are theories, second readings and many seeds, each
drawn from the runs of a report.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import matplotlib as mpl

from roughvol.report.document import Drawing as Shown
from roughvol.report.figures import content, registry
from roughvol.report.figures.figure import Figure, figures_of
from roughvol.report.figures.style import STYLE, Drawing
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.evidence import CLAIMS, Evidence, Lacking
from roughvol.reproduction.figures import paper, theory
from roughvol.reproduction.figures.conditions import PaperFigure


class Comparison(Figure):
    """A figure of several runs: call it with the `Evidence` of a report; it raises `Lacking` where no run fits."""

    def __call__(self, evidence: Any) -> Drawing:
        """Return the figure of the runs of a report."""
        with mpl.rc_context(STYLE):
            return self.draw(evidence)


FIGURES = figures_of(__file__, (paper,), PaperFigure)
COMPARISONS = figures_of(__file__, (theory,), Comparison)
ALL: dict[str, Figure] = FIGURES | registry.FIGURES
"""The figures of one run, those of the paper first."""
NAMES = (*ALL, *content.NAMES)
"""Names of all figures: those of the paper, those of the package, those by content."""


def drawings(evidence: Evidence) -> Iterator[Shown]:
    """Yield every figure that the runs of the paper can feed."""
    for name, figure in FIGURES.items():
        run = _feeds(evidence, figure)
        if run is not None:
            yield Shown(name, figure.words(surfaces=run.seeds), run.name, figure(run.dataset))
    for name, comparison in COMPARISONS.items():
        try:
            drawn = comparison(_fit(evidence, name))
        except Lacking:
            continue
        yield Shown(name, comparison.words(), "", drawn)


def _fit(evidence: Evidence, name: str) -> Evidence:
    """Return the runs that the claim of a figure needs, or all of the paper where no claim shows it or none fits."""
    needs = [need for question in CLAIMS.values() if name in question.figures for need in question.needs.values()]
    fit = [run for run in evidence.runs if any(run in evidence.fit(need) for need in needs)]
    # second readings compare runs that the claim itself refuses
    return evidence if not fit or name.startswith("readings_") or name == "seeds" else Evidence(tuple(fit))


def _feeds(evidence: Evidence, figure: PaperFigure) -> ClaimRun | None:
    """Return the run that a figure of the paper is drawn from: chosen as the claims choose theirs."""
    of_fields = {"gap", "box_count", "local_dimension"} & set(figure.needs)
    able = [run for run in evidence.runs if figure.missing(run.dataset) is None]
    able = [run for run in able if run.law in ("std", "")] or able

    def rank(run: ClaimRun) -> tuple[Any, ...]:
        sizes = run.dataset.sizes
        finest = max(run.m) if "m" in sizes else 0
        if of_fields:  # Figs. 8 to 11 show one state, that whose fields were kept
            return "gap" in run.dataset, finest, sizes.get("seed", 0)
        by = "m" if figure.by == "m" else "D"
        return run.end in ("mean-plane", ""), sizes.get(by, 0), finest, sizes.get("seed", 0)

    return max(able, key=rank, default=None)
