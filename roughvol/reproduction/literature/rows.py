"""A number of the literature as the row of a table: published, computed by criterion, verdict, study."""

from __future__ import annotations

from roughvol.reproduction.claims import ABSENT, HOLDS, Claim
from roughvol.reproduction.model import MARKS, criterion

HEAD = ("Published", "Verdict", "Computed; criterion", "Study")
NOTE = (
    "One row a published number. Computed values are means over surfaces with their 95 % interval; those of a given "
    "surface have none. Criteria are those of the code, written before the first run. Each study is a file of its name "
    "in configs/literature."
)


def published(claim: Claim) -> str:
    """Return the published number with its source.

    Parameters
    ----------
    claim : Claim
        A row of the literature.

    Returns
    -------
    str
        Sentence and source.
    """
    return f"{claim.sentence} ({claim.place})"


def computed(claim: Claim) -> list[str]:
    """Return each computed number with its criteria, after the reason of a verdict other than holds.

    Parameters
    ----------
    claim : Claim
        A row of the literature.

    Returns
    -------
    list of str
        Lines.
    """
    if claim.verdict == ABSENT:
        return [claim.why]
    lines: dict[str, str] = {}
    for check in claim.checks:
        met = f"{criterion(check)} ({MARKS[check.met]})"
        number = check.number
        if number is None:
            lines[check.criterion] = met
        elif number.key in lines:
            lines[number.key] += f"; {met}"
        else:
            surfaces = f", {number.n} surfaces" if number.n > 1 else ""
            lines[number.key] = f"{number.name}: {number}{surfaces}; {met}"
    return [*([] if claim.verdict == HOLDS else [claim.why]), *lines.values()]


def row(claim: Claim) -> tuple[str, ...]:
    """Return a row as text, with its number.

    Parameters
    ----------
    claim : Claim
        A row of the literature.

    Returns
    -------
    tuple of str
        Number, published, verdict, computed and study.
    """
    title = f"{claim.title}. {published(claim)}"
    return (
        str(claim.id),
        title,
        claim.verdict,
        ". ".join(line.rstrip(".") for line in computed(claim)),
        ", ".join(claim.source),
    )
