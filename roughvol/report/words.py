"""Words that the report has in HTML, in Markdown and in a terminal alike."""

from __future__ import annotations

from roughvol.report.claims import Check
from roughvol.report.claims.leak_estimates import Ratio
from roughvol.report.model import Report

CITE = (
    "M. Paggi, Q.-C. He, Evolution of the free volume between rough surfaces in contact, Wear 336-337 (2015) 86-95, "
    "doi:10.1016/j.wear.2015.04.021"
)
MARKS = {True: "met", None: "undecided", False: "not met"}
ESTIMATE_HEAD = (
    "run",
    "estimate",
    "A*",
    "median",
    "90 % of states",
    "off by more than 2",
    "open or closed wrongly",
    "n",
)


def heading(report: Report) -> str:
    """Return the title of a report: the question if any claim is answered, else the runs."""
    return "Does the paper hold?" if report.computed else ", ".join(run.name for run in report.runs)


def criterion(check: Check) -> str:
    """Return a criterion in words, and whether the claim stands on it."""
    return check.criterion if check.essential else f"{check.criterion} (not essential)"


def agreement(agrees: bool | None) -> str:
    """Return whether a reading gives the paper's number, in words."""
    return {True: "agrees", False: "does not", None: ""}[agrees]


def span(pair: tuple[float, float]) -> str:
    """Return a range in three digits."""
    return f"{pair[0]:.3g} to {pair[1]:.3g}"


def estimate_row(ratio: Ratio) -> tuple[str, ...]:
    """Return a row of the table of estimates over the flow computed."""
    return (
        ratio.run,
        ratio.estimate,
        span(ratio.area),
        f"{ratio.median:.2f}",
        span(ratio.span),
        f"{ratio.doubled:.0%}",
        str(ratio.closed),
        str(ratio.states),
    )
