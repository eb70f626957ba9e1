"""The paper's claims as functions of datasets: numbers with intervals, criteria fixed in the code, a verdict by rule.

Titles and sentences are in `paper.toml`. A claim argues its criterion in its docstring, which the report shows.
``assess(runs)`` answers all 24.

=================  ===================================================================
`roughness`        claims 1, 2, 24: the surfaces, and scaling in the plane
`area_and_volume`  claims 3 to 7: area, pressure and volume by D
`refinement`       claims 8 to 10: volume by m, and the two ends of the loading
`shape`            claims 11 to 16: maps, domains, box counting
`volume_formulas`  claims 17 and 18: bearing area and box dimension
`density`          claims 19 to 23: density of the volumes, volume at d = 0
`ambiguities`      second readings of ambiguous passages
`many_seeds`       results of ten surfaces where a hundred are known
`ensemble_means`   statements judged by ten seeds and by an ensemble
`leak_estimates`   quick estimates of leakage over the flow
`verdict`          numbers, checks, and the verdict that follows
`evidence`         registration of a claim, choice of its runs, curves on common axes
`statistics`       means and intervals over surfaces
=================  ===================================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims import area_and_volume, density, refinement, roughness, shape, volume_formulas
from roughvol.reproduction.claims.evidence import CLAIMS, Evidence, Question
from roughvol.reproduction.claims.verdict import Claim

MODULES = (roughness, area_and_volume, refinement, shape, volume_formulas, density)  # their import registers the claims


def assess(evidence: Evidence | Sequence[ClaimRun], among: Mapping[int, Question] = CLAIMS) -> list[Claim]:
    """Return every claim of the paper, or of another table, with its verdict, in their order."""
    evidence = evidence if isinstance(evidence, Evidence) else Evidence(tuple(evidence))
    return [among[id](evidence) for id in sorted(among)]
