"""The report as one HTML page: claims, then runs of their own; no network, no script, light, dark and on paper.

Every text that comes from a dataset, a study or a claim is escaped. A figure opens in full size as the target of a link
to itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from roughvol._version import __version__
from roughvol.analysis.hysteresis import HEAD as HEAD_OF_YIELDING
from roughvol.analysis.hysteresis import NOTE as NOTE_OF_YIELDING
from roughvol.report import run_facts
from roughvol.report.drawings import Drawing, drawings_of
from roughvol.report.html import Html, box, figure_html, fold, items, join, pairs, table, tag
from roughvol.report.style import CSS
from roughvol.reproduction.claims import ABSENT, FAILS, HOLDS, QUALIFIED, Claim, Number
from roughvol.reproduction.claims.ensemble_means import HEAD as HEAD_OF_ANSWERS
from roughvol.reproduction.claims.leak_estimates import HEAD
from roughvol.reproduction.claims.many_seeds import FEW
from roughvol.reproduction.drawings import drawings
from roughvol.reproduction.figures.registry import ALL
from roughvol.reproduction.literature import rows as literature_rows
from roughvol.reproduction.model import CITE, MARKS, Report, agreement, criterion, facts_of, heading, span

DECISIONS = (
    "Heights and gaps: rigid overlap ū = Δ - (z_max - z), so that the highest point touches first; the paper's Δ - ξ "
    "with ξ above the lowest point would press the valleys.",
    "Half space: non-periodic, frictionless, linear elastic; each node is a square element under uniform pressure.",
    "σ is the root mean square height about the mean plane of each surface; E* = E/(1-ν²).",
    "f(v) has 50 equal bins up to the largest volume of the surface, ∫ f dv = 1.",
    "Box counting on the first 2^m × 2^m nodes; the dimension is the slope over r = 1 … 2^m/4, two largest boxes "
    "left out.",
    "A*/p* is the slope of the least-squares line through the origin over the pressures that all surfaces reach.",
    "Intervals are 95 %: Student's t over surfaces; a bootstrap (seeded, 2000 resamples) where the number is not "
    "a mean; "
    "surfaces of equal seed are matched pairs.",
    "Criteria revised after a first look at the numbers, so that nobody takes them for blind: a limit inside the 95 % "
    "interval is undecided, not failed (all claims; it moved claim 7 from does not hold to a qualification); claim 10 "
    "presses to d/σ = -200, since the sweep to A* = 1 ended one element short; claim 11 takes the interval for one "
    "surface, as the paper shows one (it moved from a qualification to holds); claim 12 allows Σv the residual of the "
    "solver, 10⁻⁶, instead of rounding (it moved from does not hold to holds); the pressures at which claims 14 and 15 "
    "look were chosen anew, which is why the last check of claim 15 is made at all of them.",
)
SLUGS = {HOLDS: "holds", QUALIFIED: "qualified", FAILS: "fails", ABSENT: "absent"}
SHOWN = 2  # runs refused that a row names at once; more unfold
OPEN = 3  # tables of a run that are shown at once; further ones unfold


def to_html(report: Report) -> str:
    """Return the page, everything in it.

    Parameters
    ----------
    report : Report
        As `model.assemble` returns it.
    """
    figures = {drawing.name: figure_html(drawing.name, drawing) for drawing in drawings(report.evidence)}
    parts = [_head(report), _verdicts(report), _readings(report), _seeds(report, figures)]
    if report.computed:
        parts += [tag("h2", "The claims one by one", id="claims")]
        parts += [_claim(claim, figures) for claim in report.computed]
    if figures:
        parts += [tag("h2", "Further figures", id="figures"), tag("div", *figures.values(), kind="figures")]
    for number, run in enumerate(report.own, start=1):
        parts.append(run_section(run_facts.facts(run), list(drawings_of(run, ALL)), f"run-{number}"))
    parts.append(_literature(report))
    parts += [_estimates(report), _yielding(report), _answers(report), _decisions(report), _runs(report), _citation()]
    body = "\n".join(parts)
    return (
        "<!doctype html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        "<meta name='color-scheme' content='light dark'>\n"
        f"{tag('title', heading(report))}\n<style>{CSS}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n"
        "</body>\n</html>\n"
    )


def _head(report: Report) -> Html:
    links = [tag("a", title, href=f"#{anchor}") for anchor, title in _sections(report)]
    nav = tag("nav", Html(" · ".join(links)))
    lead = "The free volume between rough surfaces in elastic contact"
    if report.computed:
        lead += ": the claims of Paggi & He (2015) beside what was computed"
    return tag("header", tag("h1", heading(report)), tag("p", f"{lead}.", kind="lead"), _chips(report), nav)


def _sections(report: Report) -> list[tuple[str, str]]:
    """Return anchor and title of each section of the page, in their order; those without content are left out."""
    own = [(f"run-{number}", run.name, True) for number, run in enumerate(report.own, start=1)]
    sections = [
        ("verdicts", "Verdicts", bool(report.computed)),
        ("readings", "Ambiguities", bool(report.readings)),
        ("seeds", "Monte Carlo", report.seeds is not None),
        ("claims", "Claims", bool(report.computed)),
        *own,
        ("literature", "Literature", bool(report.literature)),
        ("estimates", "Quick estimates", bool(report.estimates)),
        ("yielding", "Yield", bool(report.yielding)),
        ("answers", "Ensembles", bool(report.answers)),
        ("decisions", "Decisions", bool(report.computed)),
        ("runs", "Runs", True),
        ("cite", "How to cite", True),
    ]
    return [(anchor, title) for anchor, title, has_content in sections if has_content]


def _chips(report: Report) -> Html:
    """Return the number of claims by verdict; empty if none was computed."""
    if not report.computed:
        return Html()
    lines = []
    for verdict, count in report.counts().items():
        if count:
            lines.append(tag("li", tag("b", str(count)), f" {verdict}", kind=SLUGS[verdict]))
    return tag("ul", *lines, kind="chips")


def _verdicts(report: Report) -> Html:
    if not report.computed:
        return Html()
    rule = Html(
        "<p>A verdict follows from criteria in the code; those revised after a first "
        "look are named under Decisions. <b>Holds</b>: every criterion is met. <b>With a qualification</b>: no "
        "essential criterion fails, but another does, or one is undecided (its 95 % interval contains the limit). "
        "<b>Does not hold</b>: an essential criterion fails. A run that lacks the configuration a claim needs is "
        "refused for it.</p>"
    )
    rows = [
        (
            tag("td", str(claim.id), kind="n"),
            tag("td", tag("a", claim.title, href=f"#claim-{claim.id}"), tag("small", claim.place)),
            tag("td", _badge(claim)),
            tag("td", claim.why, data_head="Why"),
            tag("td", _breakable(claim.source), _refused(claim), data_head="Run"),
        )
        for claim in report.computed
    ]
    shown = table(("", "Claim", "Verdict", "Why", "Run"), rows, kind="verdicts")
    return join(tag("h2", "Verdicts", id="verdicts"), rule, shown, _absent(report.absent))


def _breakable(names: Iterable[str]) -> Html:
    """Return names of runs that may break after each underscore."""
    return Html(join(", ".join(names)).replace("_", "_<wbr>"))


def _refused(claim: Claim) -> Html:
    """Return the runs refused with their reasons, folded away where they are many."""
    if not claim.refused:
        return Html()
    count = len(claim.refused)
    reasons = items(f"{name}: {reason}" for name, reason in claim.refused)
    return fold(f"{count} run{'s' * (count > 1)} refused", reasons, kind="refused", unfolded=count <= SHOWN)


def _absent(claims: Iterable[Claim]) -> Html:
    """Return the claims that no run can answer, each with what is lacking, folded away."""
    rows = [
        (
            tag("td", str(claim.id), kind="n"),
            tag("td", claim.title, tag("small", claim.place), id=f"claim-{claim.id}"),
            tag("td", claim.lacking or claim.untested, _refused(claim), data_head="Lacking"),
        )
        for claim in claims
    ]
    if not rows:
        return Html()
    words = f"{len(rows)} claim{'s' * (len(rows) > 1)} not computed, with what is lacking"
    return fold(words, table(("", "Claim", "Lacking"), rows, kind="verdicts"), kind="absent-claims")


def _badge(claim: Claim) -> Html:
    return tag("span", claim.verdict, kind=f"badge {SLUGS[claim.verdict]}")


def _readings(report: Report) -> Html:
    if not report.readings:
        return Html()
    parts = [
        Html(
            "<h2 id='readings'>Where the text is ambiguous</h2><p>Both readings are computed; <i>agrees</i> says which "
            "gives the paper's number. Where the paper shows one surface, the interval is that in which one falls.</p>"
        )
    ]
    for reading in report.readings:
        kinds = {True: "yes", False: "no", None: ""}
        marks = [tag("td", agreement(row.agrees), kind=kinds[row.agrees]) for row in reading.rows]
        rows = [(row.reading, str(row.number), mark) for row, mark in zip(reading.rows, marks, strict=True)]
        paper = (f"{reading.passage}. ", tag("b", "Paper:"), f" {reading.paper}. ")
        words = tag("p", *paper, tag("b", "Decided:"), f" {reading.decided}")
        shown = box(table(("Reading", reading.quantity, ""), rows))
        parts.append(tag("section", tag("h3", reading.topic), words, shown, kind="reading"))
    return Html("\n".join(parts))


def _seeds(report: Report, figures: dict[str, Html]) -> Html:
    if not report.seeds:
        return Html()
    run = report.seeds.run
    title = tag("h2", "Monte Carlo: how far ten surfaces can mislead", id="seeds")
    words = "The paper takes ten surfaces for each set of parameters, and one for the effect of m. "
    words += f"Here {run.seeds} are known (run {run.name}), and {FEW} or one are drawn from them."
    spread_head = (
        "Quantity",
        "mean of all",
        "95 % of single surfaces",
        "95 % of means of ten",
        "t interval of ten misses the mean",
    )
    spread_rows = [
        (spread.name, str(spread.many), span(spread.one), span(spread.ten), f"{spread.missed:.1%}")
        for spread in report.seeds.spreads
    ]
    flip_head = ("Comparison of independent surfaces", "wrong order with one each", "with ten each")
    flip_rows = [(flip.name, f"{flip.one:.1%}", f"{flip.ten:.1%}") for flip in report.seeds.flips]
    tables = (box(table(spread_head, spread_rows)), box(table(flip_head, flip_rows)))
    return join(title, tag("p", words), *tables, figures.pop("seeds", Html()))


def _literature(report: Report) -> Html:
    if not report.literature:
        return Html()
    rows = []
    for row in report.literature:
        link = row.title if row.verdict == ABSENT else tag("a", row.title, href=f"#literature-{row.id}")
        rows.append(
            (
                tag("td", str(row.id), kind="n"),
                tag("td", link, tag("small", literature_rows.published(row))),
                tag("td", _badge(row)),
                tag("td", *(tag("div", line) for line in literature_rows.computed(row)), data_head="Computed"),
                tag("td", _breakable(row.source), data_head="Study"),
            )
        )
    shown = table(("", *literature_rows.HEAD), rows, kind="verdicts")
    full = [_claim(row, {}, "literature") for row in report.literature if row.verdict != ABSENT]
    return join(tag("h2", "Numbers of the literature", id="literature"), tag("p", literature_rows.NOTE), shown, *full)


def _estimates(report: Report) -> Html:
    if not report.estimates:
        return Html()
    words = "Transmissivity by effective medium (Bruggeman) and by a single critical junction over that of the "
    words += "lubrication equation on the same gap, all surfaces and both directions of a run together."
    title = tag("h2", "How wrong the quick estimates of leakage are", id="estimates")
    return join(title, tag("p", words), box(table(HEAD, (ratio.cells for ratio in report.estimates))))


def _yielding(report: Report) -> Html:
    parts = []
    for number, comparison in enumerate(report.yielding):
        anchor = {"id": "yielding"} if number == 0 else {}
        parts.append(join(tag("h2", comparison.title, **anchor), tag("p", NOTE_OF_YIELDING)))
        parts.append(box(table(HEAD_OF_YIELDING, comparison.rows)))
    return Html("\n".join(parts))


def _answers(report: Report) -> Html:
    parts = []
    for number, answered in enumerate(report.answers):
        anchor = {"id": "answers"} if number == 0 else {}
        title = tag("h2", f"Ten seeds and the ensemble ({answered.run})", **anchor)
        parts.append(join(title, tag("p", answered.words), box(table(HEAD_OF_ANSWERS, answered.rows))))
    return Html("\n".join(parts))


def _claim(claim: Claim, figures: dict[str, Html], kind: str = "claim") -> Html:
    rows = []
    for check in claim.checks:
        mark = tag("td", MARKS[check.met], kind=MARKS[check.met].replace(" ", "-"))
        row = (mark, tag("td", criterion(check)), *_number_cells(check.number))
        rows.append(tag("tr", *row, kind="" if check.essential else "minor"))
    rows += [tag("tr", tag("td"), tag("td"), *_number_cells(number)) for number in claim.numbers]
    checks = box(table(("", "Criterion", "Number", "95 % interval", "n"), rows, kind="checks"))
    method = [tag("p", " ".join(part.split())) for part in claim.method.split("\n\n")]
    source = tag("p", f"From: {', '.join(claim.source)}", kind="source") if claim.source else Html()
    return tag(
        "section",
        tag("h3", f"{claim.id}. {claim.title} ", _badge(claim)),
        tag("p", claim.place, kind="place"),
        tag("blockquote", claim.sentence),
        tag("p", claim.why),
        fold("Criteria and numbers", checks) if claim.checks else Html(),
        fold("How it is judged, and why so", *method, source, _refused(claim)),
        tag("div", *(figures.pop(name) for name in claim.figures if name in figures), kind="figures"),
        tag("p", tag("a", "↑ verdicts", href="#verdicts" if kind == "claim" else f"#{kind}"), kind="up"),
        kind="claim",
        id=f"{kind}-{claim.id}",
    )


def _number_cells(number: Number | None) -> Sequence[Html]:
    if number is None:
        return [tag("td")] * 3
    method = join(" ", tag("small", number.method)) if number.method else Html()
    return tag("td", number.name), tag("td", str(number), method, kind="v"), tag("td", str(number.n), kind="v")


def run_section(facts: run_facts.Facts, figures: Sequence[Drawing], anchor: str) -> Html:
    """Return the section of one run: its surface, how it was pressed, its states, its figures.

    Parameters
    ----------
    facts : Facts
        The run in words and tables.
    figures : sequence of Drawing
        All that it can feed.
    anchor : str
        Its id on the page; those of its figures begin with it.
    """
    parts = [tag("h2", facts.name), tag("p", facts.title, kind="place")]
    if facts.warnings:
        parts.append(tag("div", tag("h3", "Warnings"), items(facts.warnings), kind="warnings"))
    surface = tag("div", tag("h3", "Surface"), pairs(facts.surface))
    loading = tag("div", tag("h3", "Loading"), pairs(facts.loading))
    parts.append(tag("div", surface, loading, kind="pair"))
    for number, rows in enumerate(facts.tables):
        note = tag("p", rows.note, kind="note") if rows.note else Html()
        inner = join(box(table(rows.head, rows.rows)), note)
        parts.append(join(tag("h3", rows.title), inner) if number < OPEN else fold(rows.title, inner))
    if figures:
        shown = [figure_html(f"{anchor}-{drawing.name}", drawing) for drawing in figures]
        parts += [tag("h3", "Figures"), tag("div", *shown, kind="figures")]
    return tag("section", *parts, kind="run", id=anchor)


def _decisions(report: Report) -> Html:
    if not report.computed:
        return Html()
    decided = [f"{reading.topic}: {reading.decided}" for reading in report.readings]
    return join(tag("h2", "Decisions", id="decisions"), items([*decided, *DECISIONS]))


def _runs(report: Report) -> Html:
    facts = [facts_of(run) for run in report.runs]
    head = (
        "Run",
        "surfaces",
        "time [s], all cases",
        "states converged",
        "convolutions per state",
        "largest residual η/σ",
    )
    rows: list[Any] = [_row_of_run(f) for f in facts]
    rows.append(_row_of_all_runs(facts))
    machines = [tag("li", f"{words}: {', '.join(names)}") for words, names in _machines(facts).items()]
    studies = [fold(f"{f['name']}.yaml, every default written out", tag("pre", f["study"])) for f in facts]
    return join(
        tag("h2", "Runs, convergence, versions", id="runs"),
        box(table(head, rows)),
        tag("ul", *machines, kind="versions"),
        tag("h3", "Study files"),
        *studies,
    )


def _row_of_run(f: dict[str, Any]) -> tuple[str, ...]:
    converged = f"{f['converged']} of {f['states']}"
    residual = "" if f["residual"] is None else f"{f['residual']:.1e}"
    return f["name"], str(f["cases"]), _shown(f["wall_time"]), converged, _shown(f["convolutions"]), residual


def _row_of_all_runs(facts: Sequence[dict[str, Any]]) -> Html:
    """Return the sums over all runs; convolutions and residual have none."""
    cases = sum(f["cases"] for f in facts)
    seconds = sum(f["wall_time"] or 0.0 for f in facts)
    states = sum(f["states"] for f in facts)
    converged = sum(f["converged"] for f in facts)
    cells = [tag("td", cell, kind="v") for cell in (str(cases), f"{seconds:.0f}", f"{converged} of {states}")]
    return tag("tr", tag("td", "all"), *cells, tag("td"), tag("td"), kind="total")


def _machines(facts: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Return versions, machine and day in words, each with the runs it is true of."""
    groups: dict[str, list[str]] = {}
    for f in facts:
        libraries = dict(f["libraries"])
        planner = ", ".join(f"{k} {v}" for k, v in libraries.pop("fft", {}).items())
        words = f"roughvol {f['roughvol_version']}; {', '.join(f'{k} {v}' for k, v in libraries.items())}; "
        words += f"transforms: {planner}; {f['platform']}; {f['date'][:10]}"
        groups.setdefault(words, []).append(f["name"])
    return groups


def _shown(value: Any) -> str:
    return "" if value is None or (isinstance(value, float) and not np.isfinite(value)) else str(value)


def _citation() -> Html:
    version = f"The computation: roughvol {__version__}, with the study files above (CITATION.cff in the repository)."
    beside = Html(
        "<p>Beside this page: <code>claims.json</code> for machines, <code>report.md</code> for a terminal.</p>"
    )
    return join(tag("h2", "How to cite", id="cite"), tag("p", f"The paper: {CITE}."), tag("p", version), beside)
