"""The paper's claims as functions of datasets: numbers with intervals, criteria fixed in the code, a verdict by rule.

``assess(runs)`` answers the 24 claims from the runs that fit them, `readings` what the ambiguous passages mean.
`model` says how a verdict follows from checks, `needs` which configuration a claim asks for, `evidence` how runs are
chosen, `statistics` what an interval is. The claims are in `surfaces`, `contact`, `resolution`, `morphology`, `theory`
and `density`, each with its criterion argued in its docstring, and the second readings in `readings`.
"""

from __future__ import annotations

from collections.abc import Sequence

from roughvol.report.claims import area_and_volume, density, formulas, refinement, roughness, shape
from roughvol.report.claims.evidence import CLAIMS, Evidence, Lacking
from roughvol.report.claims.stored_run import Run
from roughvol.report.claims.verdict import (
    ABSENT,
    FAILS,
    HOLDS,
    QUALIFIED,
    VERDICTS,
    Check,
    Claim,
    Number,
    Reading,
    Row,
    plain,
)

__all__ = [
    "ABSENT",
    "CLAIMS",
    "FAILS",
    "HOLDS",
    "QUALIFIED",
    "VERDICTS",
    "Check",
    "Claim",
    "Evidence",
    "Lacking",
    "Number",
    "Reading",
    "Row",
    "Run",
    "assess",
    "plain",
]

MODULES = (roughness, area_and_volume, refinement, shape, formulas, density)  # importing them registers their claims


def assess(evidence: Evidence | Sequence[Run]) -> list[Claim]:
    """Return every claim of the paper with its verdict, in the order of the checklist."""
    evidence = evidence if isinstance(evidence, Evidence) else Evidence(tuple(evidence))
    return [CLAIMS[id](evidence) for id in sorted(CLAIMS)]
