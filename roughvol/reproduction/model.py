"""Contents of a report: every claim answered once from the runs given, the runs with a section of their own, words.

A run serves the paper if a claim uses it, or if a second reading, the Monte Carlo section or one of the paper's own
figures asks for its configuration. Every other run is a study of its own, and is reported as that.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from roughvol.analysis.hysteresis import Comparison, comparisons
from roughvol.analysis.stored_run import Run
from roughvol.errors import DatasetError
from roughvol.reproduction.claims import ABSENT, VERDICTS, Check, Claim, Evidence, Lacking, assess
from roughvol.reproduction.claims.ambiguities import SERVES, readings
from roughvol.reproduction.claims.ensemble_means import Answers, answers
from roughvol.reproduction.claims.leak_estimates import Ratio, ratios
from roughvol.reproduction.claims.many_seeds import ENOUGH, ManySeeds, many_seeds
from roughvol.reproduction.claims.needs import ALONE
from roughvol.reproduction.claims.verdict import Reading
from roughvol.reproduction.literature.needs import LITERATURE
from roughvol.store import StoredRun
from roughvol.store.run import names_of

CITE = (
    "M. Paggi, Q.-C. He, Evolution of the free volume between rough surfaces in contact, Wear 336-337 (2015) 86-95, "
    "doi:10.1016/j.wear.2015.04.021"
)
MARKS = {True: "met", None: "undecided", False: "not met"}


@dataclass(frozen=True, eq=False)
class Report:
    """Results that the page shows: claims, readings, few seeds, ensembles, estimates of leakage, yield, and the runs.

    ``own`` are the runs that serve neither the paper nor the literature; each is reported for itself.
    """

    runs: tuple[Run, ...]
    claims: tuple[Claim, ...]
    readings: tuple[Reading, ...]
    seeds: ManySeeds | None
    estimates: tuple[Ratio, ...]
    own: tuple[Run, ...] = ()
    any_size: bool = False
    yielding: tuple[Comparison, ...] = ()
    answers: tuple[Answers, ...] = ()
    literature: tuple[Claim, ...] = ()
    cited: tuple[Run, ...] = ()

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

    def counts(self) -> dict[str, int]:
        """Return how many claims have each verdict."""
        return {verdict: sum(claim.verdict == verdict for claim in self.claims) for verdict in VERDICTS}


def counted(claims: Sequence[Claim]) -> str:
    """Return how many claims have each verdict, in words."""
    counts = {verdict: sum(claim.verdict == verdict for claim in claims) for verdict in VERDICTS}
    return ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)


def assemble(stored: Sequence[StoredRun | str | Path], *, any_size: bool = False) -> Report:
    """Return the report of stored runs.

    Parameters
    ----------
    stored : sequence of StoredRun, or of what `StoredRun.open` takes
        The runs.
    any_size : bool
        Answer claims from runs too small for them as well: to try the claims out, not for a verdict.

    Returns
    -------
    Report
        Claims, readings and the runs with a page of their own.

    Raises
    ------
    DatasetError
        If one cannot be read, or there is none.
    """
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
    own = tuple(run for run in runs if run.name not in used | sources)
    yielding = tuple(comparisons(runs))
    return Report(
        runs,
        claims,
        tuple(readings(evidence)),
        many,
        tuple(ratios(evidence)),
        own,
        any_size,
        yielding,
        tuple(answers(runs)),
        rows if sources else (),
        cited,
    )


def facts_of(run: Run) -> dict[str, Any]:
    """Return what was run, how long it took, and whether it converged."""
    ds = run.dataset
    facts: dict[str, Any] = {
        "name": run.name,
        "cases": 0,
        "states": 0,
        "converged": 0,
        "residual": None,
        "convolutions": None,
    }
    facts["wall_time"] = round(float(ds["wall_time"].sum()), 1) if "wall_time" in ds else None
    facts["cases"] = int(ds["Sq"].notnull().sum()) if "Sq" in ds else 0
    if "residual" in ds:
        solved = ds["residual"].notnull()
        facts |= {"states": int(solved.sum()), "converged": int((ds["converged"] & solved).sum())}
        facts["residual"] = float(ds["residual"].max())
        facts["convolutions"] = round(float((ds["convolutions"] + ds["convolutions_fp32"]).where(solved).mean()), 2)
    for name in ("roughvol_version", "host", "platform", "date"):
        facts[name] = str(ds.attrs.get(name, ""))
    facts["libraries"] = json.loads(ds.attrs.get("libraries", "{}")) | {"fft": json.loads(ds.attrs.get("fft", "{}"))}
    facts["study"] = str(ds.attrs.get("study", ""))
    return facts


def heading(report: Report) -> str:
    """Return the title of a report: the question if any claim is answered, else the runs."""
    if report.computed:
        return "Does the paper hold?"
    names = ", ".join(run.name for run in report.own)
    return "Do the published numbers hold?" if report.literature and not report.own else names


def criterion(check: Check) -> str:
    """Return a criterion in words, and whether it is essential."""
    return check.criterion if check.essential else f"{check.criterion} (not essential)"


def agreement(agrees: bool | None) -> str:
    """Return whether a reading gives the paper's number, in words."""
    return {True: "agrees", False: "does not", None: ""}[agrees]


def span(pair: tuple[float, float]) -> str:
    """Return a range in three digits."""
    return f"{pair[0]:.3g} to {pair[1]:.3g}"
