"""Every claim answered once from the runs of a report, and the runs that serve none.

A run serves the paper if a claim uses it, or if a second reading, the Monte Carlo section or one of the paper's own
figures asks for its configuration. Every other run is a study of its own, and is reported as that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from roughvol.analysis.stored_run import Run
from roughvol.errors import DatasetError
from roughvol.reproduction.claims import ABSENT, Claim, Evidence, Lacking, assess
from roughvol.reproduction.claims.ambiguities import SERVES, readings
from roughvol.reproduction.claims.ensemble_means import Answers, answers
from roughvol.reproduction.claims.leak_estimates import Ratio, ratios
from roughvol.reproduction.claims.many_seeds import ENOUGH, ManySeeds, many_seeds
from roughvol.reproduction.claims.needs import ALONE
from roughvol.reproduction.claims.verdict import Reading
from roughvol.reproduction.literature import LITERATURE
from roughvol.store import StoredRun
from roughvol.store.run import names_of


@dataclass(frozen=True, eq=False)
class Judgement:
    """Claims, readings, few seeds, estimates of leakage, ensembles and rows of the literature, from the runs.

    ``own`` are the runs that serve neither the paper nor the literature, ``cited`` those that serve the literature.
    With ``any_size`` small runs count too, for trials and not for verdicts.
    """

    runs: tuple[Run, ...]
    claims: tuple[Claim, ...]
    readings: tuple[Reading, ...]
    seeds: ManySeeds | None
    estimates: tuple[Ratio, ...]
    answers: tuple[Answers, ...] = ()
    literature: tuple[Claim, ...] = ()
    own: tuple[Run, ...] = ()
    cited: tuple[Run, ...] = ()
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
    runs = tuple(part for name, run in named for part in Run.of(name, run.dataset).parts)
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
