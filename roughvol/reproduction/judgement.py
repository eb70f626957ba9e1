"""Every claim answered once from the runs of a report, the runs that serve none, and departures from an expectation.

A run serves the paper if a claim uses it, or if a second reading, the Monte Carlo section or one of the paper's own
figures asks for its configuration. Every other run is a study of its own, and is reported as that.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from roughvol.errors import DatasetError
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims import assess
from roughvol.reproduction.claims.ambiguities import SERVES, readings
from roughvol.reproduction.claims.ensemble_means import Answers, answers
from roughvol.reproduction.claims.evidence import Evidence, Lacking
from roughvol.reproduction.claims.leak_estimates import Ratio, ratios
from roughvol.reproduction.claims.many_seeds import ENOUGH, ManySeeds, many_seeds
from roughvol.reproduction.claims.verdict import ABSENT, Claim, Reading
from roughvol.reproduction.literature import LITERATURE
from roughvol.reproduction.needs import ALONE
from roughvol.store import StoredRun
from roughvol.store.run import names_of


@dataclass(frozen=True, eq=False)
class Judgement:
    """Claims, readings, few seeds, estimates of leakage, ensembles and rows of the literature, from the runs.

    ``own`` are the runs that serve neither the paper nor the literature, ``cited`` those that serve the literature.
    With ``any_size`` small runs count too, for trials and not for verdicts.
    """

    runs: tuple[ClaimRun, ...]
    claims: tuple[Claim, ...]
    readings: tuple[Reading, ...]
    seeds: ManySeeds | None
    estimates: tuple[Ratio, ...]
    answers: tuple[Answers, ...] = ()
    literature: tuple[Claim, ...] = ()
    own: tuple[ClaimRun, ...] = ()
    cited: tuple[ClaimRun, ...] = ()
    any_size: bool = False

    @property
    def evidence(self) -> Evidence:
        """The runs that serve the paper, to be asked."""
        return Evidence(tuple(run for run in self.runs if run not in (*self.own, *self.cited)), self.any_size)

    @property
    def computed(self) -> tuple[Claim, ...]:
        """The claims that have a verdict."""
        return tuple(claim for claim in self.claims if claim.verdict != ABSENT)

    @property
    def absent(self) -> tuple[Claim, ...]:
        """The claims that no run can answer."""
        return tuple(claim for claim in self.claims if claim.verdict == ABSENT)


def judge(stored: Sequence[StoredRun | str | Path], *, any_size: bool = False) -> Judgement:
    """Return what stored runs, or what `StoredRun.open` takes, say of the claims."""
    opened = [run if isinstance(run, StoredRun) else StoredRun.open(run) for run in stored]
    opened = list({run.file.resolve(): run for run in opened}.values())
    if not opened:
        raise DatasetError("no run to report on")
    named = zip(names_of([run.file for run in opened]), opened, strict=True)
    runs = tuple(part for name, run in named for part in ClaimRun.of(name, run.dataset).parts)
    rows = tuple(assess(Evidence(runs, any_size), LITERATURE))
    sources = {name for row in rows for name in row.source}
    cited = tuple(run for run in runs if run.name in sources)
    evidence = Evidence(tuple(run for run in runs if run not in cited), any_size)
    claims = tuple(assess(evidence))
    try:
        many = many_seeds(evidence)
    except Lacking:
        many = None
    used = {name for claim in claims for name in claim.source}
    used |= {run.name for needs in (*SERVES, ENOUGH, *ALONE) for run in evidence.fit(needs)}
    return Judgement(
        runs,
        claims,
        tuple(readings(evidence)),
        many,
        tuple(ratios(evidence)),
        tuple(answers(runs)),
        rows if sources else (),
        tuple(run for run in runs if run.name not in used | sources),
        cited,
        any_size,
    )


def departures(judgement: Judgement, expected: str | bytes) -> list[str]:
    """Return in words what left the bands of an expectation.

    ``expected`` is JSON ``{"verdicts": {"4": "holds"}, "numbers": {"4.exponent": [0.35, 0.45]}}``, by claim and key.
    """
    try:
        data = json.loads(expected)
        verdicts = {int(id): str(verdict) for id, verdict in data.get("verdicts", {}).items()}
        bands = {str(name): (float(low), float(high)) for name, (low, high) in data.get("numbers", {}).items()}
        unknown = set(data) - {"verdicts", "numbers", "about"}
    except (ValueError, TypeError, AttributeError) as error:
        message = f"the expectation is not {{'verdicts': {{id: verdict}}, 'numbers': {{id.key: [low, high]}}}}: {error}"
        raise DatasetError(message) from error
    if unknown or not (verdicts or bands):
        got = ", ".join(sorted(unknown)) or "neither"
        raise DatasetError(f"the expectation must name verdicts or numbers and nothing else, got {got}")
    claims = {claim.id: claim for claim in judgement.claims}
    differences = []
    for id, verdict in verdicts.items():
        given = claims[id].verdict if id in claims else "no such claim"
        if given != verdict:
            differences.append(f"claim {id}: {given}, expected {verdict}")
    for name, (low, high) in bands.items():
        id_text, _, key = name.partition(".")
        claim = claims.get(int(id_text)) if id_text.isdecimal() else None
        number = claim.all_numbers.get(key) if claim else None
        if number is None:
            differences.append(f"{name}: not computed, expected {low:g} to {high:g}")
        elif not low <= number.value <= high:
            differences.append(f"{name}: {number.value:.6g}, expected {low:g} to {high:g} ({number.name})")
    return differences
