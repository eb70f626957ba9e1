"""The paper's claims as functions of datasets: numbers with intervals, criteria fixed in the code, a verdict by rule.

``assess(runs)`` answers the 24 claims from whatever runs are given, ``READINGS`` what the ambiguous passages mean.
`model` says how a verdict follows from checks, `evidence` how runs are chosen, `statistics` what an interval is; the
claims stand in `surfaces`, `contact`, `resolution`, `morphology`, `theory` and `density`, each with its criterion
argued in its docstring, and the second readings in `readings`.
"""

from __future__ import annotations

from collections.abc import Sequence

from roughvol.claims import contact, density, morphology, resolution, surfaces, theory
from roughvol.claims.evidence import CLAIMS, Evidence, Lacking, Run
from roughvol.claims.model import ABSENT, FAILS, HOLDS, QUALIFIED, VERDICTS, Check, Claim, Number, Reading, Row, plain

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

MODULES = (surfaces, contact, resolution, morphology, theory, density)  # importing them registers their claims


def assess(runs: Sequence[Run]) -> list[Claim]:
    """Return every claim of the paper with its verdict, in the order of the checklist."""
    evidence = Evidence(tuple(runs))
    return [CLAIMS[id](evidence) for id in sorted(CLAIMS)]
