"""The report as one HTML page: claims, then runs of their own; no network, no script, light, dark and on paper.

The page is made of plain strings; every text that comes from a dataset, a study or a claim is escaped. A figure opens
in full size as the target of a link to itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np

from roughvol._version import __version__
from roughvol.report import run_facts, run_page
from roughvol.report.claims import ABSENT, FAILS, HOLDS, QUALIFIED, Claim
from roughvol.report.claims.many_seeds import FEW
from roughvol.report.drawings import drawings, drawings_of
from roughvol.report.html import box, figure_html, table
from roughvol.report.model import Report, facts_of
from roughvol.report.style import CSS
from roughvol.report.words import CITE, ESTIMATE_HEAD, MARKS, agreement, criterion, estimate_row, heading, span

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


def to_html(report: Report) -> str:
    """Return the page, everything in it."""
    figures = {drawing.name: figure_html(drawing.name, drawing) for drawing in drawings(report)}
    parts = [_head(report), _verdicts(report), _readings(report), _seeds(report, figures)]
    if report.computed:
        parts += ["<h2 id='claims'>The claims one by one</h2>", *(_claim(claim, figures) for claim in report.computed)]
    if figures:
        shown = "".join(figures.values())
        parts += [f"<h2 id='figures'>Further figures</h2><div class='figures'>{shown}</div>"]
    for place, run in enumerate(report.own, start=1):
        parts.append(run_page.section(run_facts.facts(run), list(drawings_of(run)), f"run-{place}"))
    parts += [_estimates(report), _decisions(report), _runs(report), _citation(report)]
    body = "\n".join(parts)
    return (
        "<!doctype html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        "<meta name='color-scheme' content='light dark'>\n"
        f"<title>{escape(heading(report))}</title>\n<style>{CSS}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n"
        "</body>\n</html>\n"
    )


def _head(report: Report) -> str:
    links = [("verdicts", "Verdicts")] * bool(report.computed) + [("readings", "Ambiguities")] * bool(report.readings)
    links += [("seeds", "Monte Carlo")] * bool(report.seeds) + [("claims", "Claims")] * bool(report.computed)
    links += [(f"run-{place}", run.name) for place, run in enumerate(report.own, start=1)]
    links += [("estimates", "Quick estimates")] * bool(report.estimates)
    links += [("decisions", "Decisions")] * bool(report.computed) + [("runs", "Runs"), ("cite", "How to cite")]
    nav = " · ".join(f"<a href='#{anchor}'>{escape(words)}</a>" for anchor, words in links)
    lead, chips = "The free volume between rough surfaces in elastic contact.", ""
    if report.computed:
        lead = (
            "The free volume between rough surfaces in elastic contact: the claims of Paggi &amp; He (2015) beside "
            "what was computed."
        )
        counts = "".join(
            f"<li class='{SLUGS[verdict]}'><b>{count}</b> {verdict}</li>"
            for verdict, count in report.counts().items()
            if count
        )
        chips = f"<ul class='chips'>{counts}</ul>"
    return f"<header><h1>{escape(heading(report))}</h1><p class='lead'>{lead}</p>{chips}<nav>{nav}</nav></header>"


def _verdicts(report: Report) -> str:
    if not report.computed:
        return ""
    rows = "".join(
        f"<tr><td class='n'>{c.id}</td><td><a href='#claim-{c.id}'>{escape(c.title)}</a>"
        f"<small>{escape(c.place)}</small></td><td>{_badge(c)}</td>"
        f"<td data-head='Why'>{escape(c.why)}</td><td data-head='Run'>{_source(c)}</td></tr>"
        for c in report.computed
    )
    return (
        "<h2 id='verdicts'>Verdicts</h2><p>A verdict follows from criteria in the code; those revised after a first "
        "look are named under Decisions. <b>Holds</b>: every criterion is met. <b>With a qualification</b>: no "
        "essential criterion fails, but another does, or one is undecided (its 95 % interval contains the limit). "
        "<b>Does not hold</b>: an essential criterion fails. A run that lacks the configuration a claim needs is "
        "refused for it.</p>"
        "<table class='verdicts'><thead><tr><th></th><th>Claim</th><th>Verdict</th><th>Why</th><th>Run</th></tr>"
        f"</thead><tbody>{rows}</tbody></table>{_absent(report.absent)}"
    )


def _source(claim: Claim) -> str:
    """Return the runs used, and those refused with their reasons."""
    names = escape(", ".join(claim.source)).replace("_", "_<wbr>")
    return f"{names}{_refused(claim)}"


def _refused(claim: Claim) -> str:
    if not claim.refused:
        return ""
    items = "".join(f"<li>{escape(name)}: {escape(reason)}</li>" for name, reason in claim.refused)
    count = len(claim.refused)
    unfolded = " open" if count <= SHOWN else ""
    return (
        f"<details class='refused'{unfolded}><summary>{count} run{'s' * (count > 1)} refused</summary>"
        f"<ul>{items}</ul></details>"
    )


def _absent(claims: Iterable[Claim]) -> str:
    """Return the claims that no run can answer, each with what is lacking, folded away."""
    rows = [
        f"<tr><td class='n'>{c.id}</td><td id='claim-{c.id}'>{escape(c.title)}<small>{escape(c.place)}</small></td>"
        f"<td data-head='Lacking'>{escape(c.lacking or c.untested)}{_refused(c)}</td></tr>"
        for c in claims
    ]
    if not rows:
        return ""
    return (
        f"<details class='absent-claims'><summary>{len(rows)} claim{'s' * (len(rows) > 1)} not computed, with what is "
        "lacking</summary><table class='verdicts'><thead><tr><th></th><th>Claim</th><th>Lacking</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></details>"
    )


def _badge(claim: Claim) -> str:
    return f"<span class='badge {SLUGS[claim.verdict]}'>{claim.verdict}</span>"


def _readings(report: Report) -> str:
    if not report.readings:
        return ""
    parts = [
        "<h2 id='readings'>Where the text is ambiguous</h2><p>Both readings are computed; <i>agrees</i> says which "
        "gives the paper's number. Where the paper shows one surface, the interval is that in which one falls.</p>"
    ]
    for reading in report.readings:
        rows = "".join(
            f"<tr><td>{escape(row.reading)}</td><td class='v'>{escape(str(row.number))}</td>"
            f"<td "
            f"class='{'yes' if row.agrees else 'no' if row.agrees is False else ''}'>{agreement(row.agrees)}</td></tr>"
            for row in reading.rows
        )
        parts.append(
            f"<section class='reading'><h3>{escape(reading.topic)}</h3><p>{escape(reading.passage)}. "
            f"<b>Paper:</b> {escape(reading.paper)}. <b>Decided:</b> {escape(reading.decided)}</p>"
            + box(
                f"<table><thead><tr><th>Reading</th><th>{escape(reading.quantity)}</th><th></th></tr></thead>"
                f"<tbody>{rows}</tbody></table>"
            )
            + "</section>"
        )
    return "\n".join(parts)


def _seeds(report: Report, figures: dict[str, str]) -> str:
    if not report.seeds:
        return ""
    run, spreads, flips = report.seeds
    rows = "".join(
        f"<tr><td>{escape(s.name)}</td><td class='v'>{escape(str(s.many))}</td><td class='v'>{span(s.one)}</td>"
        f"<td class='v'>{span(s.ten)}</td><td class='v'>{s.missed:.1%}</td></tr>"
        for s in spreads
    )
    wrong = "".join(
        f"<tr><td>{escape(f.name)}</td><td class='v'>{f.one:.1%}</td><td class='v'>{f.ten:.1%}</td></tr>" for f in flips
    )
    return (
        f"<h2 id='seeds'>Monte Carlo: how far ten surfaces can mislead</h2><p>The paper takes ten surfaces for "
        f"each set of "
        f"parameters, and one for the effect of m. Here {run.seeds} are known (run {escape(run.name)}), and {FEW} "
        f"or one are "
        "drawn from them.</p><div class='box'><table><thead><tr><th>Quantity</th><th>mean of all</th>"
        "<th>95 % of single surfaces</th>"
        "<th>95 % of means of ten</th><th>t interval of ten misses the mean</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div><div class='box'><table><thead><tr>"
        f"<th>Comparison of independent surfaces</th>"
        f"<th>wrong order with one each</th><th>with ten each</th></tr></thead><tbody>{wrong}</tbody></table></div>"
        f"{figures.pop('seeds', '')}"
    )


def _estimates(report: Report) -> str:
    if not report.estimates:
        return ""
    return (
        "<h2 id='estimates'>How wrong the quick estimates of leakage are</h2><p>Transmissivity by effective medium "
        "(Bruggeman) and by a single critical junction over that of the lubrication equation on the same gap, all "
        "surfaces and both directions of a run together.</p>"
        + box(table(ESTIMATE_HEAD, map(estimate_row, report.estimates)))
    )


def _claim(claim: Claim, figures: dict[str, str]) -> str:
    checks = "".join(
        f"<tr{'' if check.essential else ' class=minor'}><td "
        f"class='{MARKS[check.met].replace(' ', '-')}'>{MARKS[check.met]}</td>"
        f"<td>{escape(criterion(check))}</td>{_number_cells(check.number)}</tr>"
        for check in claim.checks
    )
    numbers = "".join(f"<tr><td></td><td></td>{_number_cells(number)}</tr>" for number in claim.numbers)
    checked = (
        "<details><summary>Criteria and numbers</summary><div class='box'><table class='checks'><thead><tr><th></th>"
        f"<th>Criterion</th><th>Number</th><th>95 % "
        f"interval</th><th>n</th></tr></thead><tbody>{checks}{numbers}</tbody></table></div></details>"
        if checks
        else ""
    )
    method = "".join(f"<p>{escape(' '.join(part.split()))}</p>" for part in claim.method.split("\n\n"))
    shown = "".join(figures.pop(name) for name in claim.figures if name in figures)
    source = f"<p class='source'>From: {escape(', '.join(claim.source))}</p>" if claim.source else ""
    return (
        f"<section class='claim' id='claim-{claim.id}'><h3>{claim.id}. {escape(claim.title)} {_badge(claim)}</h3>"
        f"<p "
        f"class='place'>{escape(claim.place)}</p><blockquote>{escape(claim.sentence)}</blockquote><p>{escape(claim.why)}</p>"
        f"{checked}<details><summary>How it is judged, and why so</summary>{method}{source}{_refused(claim)}</details>"
        f"<div class='figures'>{shown}</div><p class='up'><a href='#verdicts'>↑ verdicts</a></p></section>"
    )


def _number_cells(number: Any) -> str:
    if number is None:
        return "<td></td><td></td><td></td>"
    method = f" <small>{escape(number.method)}</small>" if number.method else ""
    return (
        f"<td>{escape(number.name)}</td><td class='v'>{escape(str(number))}{method}</td><td class='v'>{number.n}</td>"
    )


def _decisions(report: Report) -> str:
    if not report.computed:
        return ""
    items = [*(f"{reading.topic}: {reading.decided}" for reading in report.readings), *DECISIONS]
    return "<h2 id='decisions'>Decisions</h2><ul>" + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>"


def _runs(report: Report) -> str:
    facts = [facts_of(run) for run in report.runs]
    rows = "".join(
        f"<tr><td>{escape(f['name'])}</td><td class='v'>{f['cases']}</td><td class='v'>{_shown(f['wall_time'])}</td>"
        f"<td class='v'>{f['converged']} of {f['states']}</td><td class='v'>{_shown(f['convolutions'])}</td>"
        f"<td class='v'>{'' if f['residual'] is None else format(f['residual'], '.1e')}</td></tr>"
        for f in facts
    )
    total = sum(f["wall_time"] or 0.0 for f in facts)
    states, converged = sum(f["states"] for f in facts), sum(f["converged"] for f in facts)
    rows += (
        f"<tr class='total'><td>all</td><td class='v'>{sum(f['cases'] for f in facts)}</td><td "
        f"class='v'>{total:.0f}</td>"
    )
    rows += f"<td class='v'>{converged} of {states}</td><td></td><td></td></tr>"
    studies = "".join(
        f"<details><summary>{escape(f['name'])}.yaml, every default written "
        f"out</summary><pre>{escape(f['study'])}</pre></details>"
        for f in facts
    )
    machines = "".join(
        f"<li>{escape(words)}: {escape(', '.join(names))}</li>" for words, names in _machines(facts).items()
    )
    return (
        "<h2 id='runs'>Runs, convergence, versions</h2><div class='box'><table><thead><tr><th>Run</th><th>surfaces</th>"
        "<th>time [s], all cases</th><th>states converged</th>"
        "<th>convolutions per state</th><th>largest residual η/σ</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div><ul class='versions'>{machines}</ul><h3>Study files</h3>{studies}"
    )


def _machines(facts: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Return versions, machine and day in words, each with the runs it is true of."""
    groups: dict[str, list[str]] = {}
    for f in facts:
        fft = f["libraries"].get("fft", {})
        libraries = ", ".join(f"{k} {v}" for k, v in f["libraries"].items() if k != "fft")
        planner = ", ".join(f"{k} {v}" for k, v in fft.items())
        words = (
            f"roughvol {f['roughvol_version']}; {libraries}; transforms: {planner}; {f['platform']}; {f['date'][:10]}"
        )
        groups.setdefault(words, []).append(f["name"])
    return groups


def _shown(value: Any) -> str:
    return "" if value is None or (isinstance(value, float) and not np.isfinite(value)) else str(value)


def _citation(report: Report) -> str:
    return (
        f"<h2 id='cite'>How to cite</h2><p>The paper: {escape(CITE)}.</p><p>The computation: roughvol "
        f"{escape(__version__)}, "
        "with the study files above (CITATION.cff in the repository).</p>"
        "<p>Beside this page: <code>claims.json</code> for machines, <code>report.md</code> for a terminal.</p>"
    )
