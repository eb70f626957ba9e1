"""A number of the literature as the row of a table: published, computed, criterion, verdict, study."""

from __future__ import annotations

from roughvol.report.claims import ABSENT, Claim
from roughvol.report.html import Html, tag
from roughvol.report.model import MARKS, criterion

HEAD = ("Published", "Computed", "Criterion", "Verdict", "Study")
NOTE = (
    "One row a published number. Computed values are means over surfaces with their 95 % interval; those of a given "
    "surface have none. Criteria were written before the first run. `make literature` runs all studies, "
    "`roughvol run configs/literature/NAME.yaml` one of them."
)


def cells(claim: Claim) -> tuple[str, list[Html], list[Html], str]:
    """Return the cells of a row but for the verdict: published, computed, criteria and study.

    Parameters
    ----------
    claim : Claim
        A row of the literature.

    Returns
    -------
    tuple
        Published number with its source, computed numbers, criteria, and studies.
    """
    published = f"{claim.sentence} ({claim.place})"
    if claim.verdict == ABSENT:
        return published, [tag("span", claim.why)], [], ""
    ours = [tag("div", line) for line in _computed(claim)]
    return published, ours, [tag("div", line) for line in _criteria(claim)], ", ".join(claim.source)


def row(claim: Claim) -> tuple[str, ...]:
    """Return a row as text, with its number and verdict.

    Parameters
    ----------
    claim : Claim
        A row of the literature.

    Returns
    -------
    tuple of str
        Number, published, computed, criterion, verdict and study.
    """
    published = f"{claim.title}. {claim.sentence} ({claim.place})"
    computed = claim.why if claim.verdict == ABSENT else "; ".join(_computed(claim))
    return str(claim.id), published, computed, "; ".join(_criteria(claim)), claim.verdict, ", ".join(claim.source)


def _computed(claim: Claim) -> list[str]:
    """Return the numbers that the criteria are about, each once."""
    numbers = {check.number.key: check.number for check in claim.checks if check.number is not None}
    words = []
    for number in numbers.values():
        surfaces = f", {number.n} surfaces" if number.n > 1 else ""
        words.append(f"{number.name}: {number}{surfaces}")
    return words


def _criteria(claim: Claim) -> list[str]:
    """Return each criterion with whether it is met."""
    return [f"{criterion(check)}: {MARKS[check.met]}" for check in claim.checks]
