"""The report as JSON, as Markdown, and as lines for a terminal."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from roughvol._version import __version__
from roughvol.report import run_facts
from roughvol.report.claims import VERDICTS, Claim, plain
from roughvol.report.model import Report, facts_of
from roughvol.report.run_facts import Facts
from roughvol.report.words import CITE, ESTIMATE_HEAD, MARKS, agreement, criterion, estimate_row, heading, span

FORMAT = "roughvol claims 1"


def summary(report: Report) -> str:
    """Return runs of their own and the verdicts as lines of text for a terminal, the counts of verdicts last."""
    lines = [line for run in report.own for line in _lines(run_facts.facts(run))]
    if not report.computed:
        return "\n".join(lines)
    width = max(len(verdict) for verdict in VERDICTS)
    lines += [f"{claim.id:3d}  {claim.verdict:<{width}}  {_titled(claim)}" for claim in report.claims]
    counts = ", ".join(f"{count} {verdict}" for verdict, count in report.counts().items() if count)
    return "\n".join([*lines, f"{len(report.claims)} claims: {counts}"])


def _titled(claim: Claim) -> str:
    return f"{claim.title} ({', '.join(claim.source)})" if claim.source else claim.title


def _lines(facts: Facts) -> Iterator[str]:
    """Yield what a run of its own says of itself."""
    yield f"{facts.name}: {facts.title}"
    width = max(len(name) for name, _ in (*facts.surface, *facts.loading))
    yield from (f"  {name:<{width}}  {value}" for name, value in (*facts.surface, *facts.loading))
    for table in facts.tables:
        if table.title == run_facts.CLOSING:
            yield f"  {table.title}"
            yield from (
                "    " + ", ".join(f"{h} {c}" for h, c in zip(table.head, row, strict=True)) for row in table.rows
            )
    yield from (f"  warning: {line}" for line in facts.warnings)


# JSON and Markdown ---------------------------------------------------------------------------------------------------


def to_json(report: Report) -> str:
    """Return claims, numbers, readings and provenance as JSON."""
    data: dict[str, Any] = {"format": FORMAT, "roughvol_version": __version__, "counts": report.counts()}
    data["claims"] = plain(report.claims)
    data["readings"] = plain(report.readings)
    if report.seeds:
        run, spreads, flips = report.seeds
        data["seeds"] = {
            "run": run.name,
            "quantities": [
                {**plain(s.many), "one": list(s.one), "ten": list(s.ten), "missed": s.missed} for s in spreads
            ],
            "wrong_order": [{"comparison": f.name, "one": f.one, "ten": f.ten} for f in flips],
        }
    data["surfaces"] = [run_facts.facts(run).plain() for run in report.own]
    data["estimates"] = [asdict(ratio) for ratio in report.estimates]
    data["runs"] = [facts_of(run) for run in report.runs]
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def to_markdown(report: Report) -> str:
    """Return the report for reading in a terminal."""
    lines = [f"# {heading(report)}", "", CITE]
    if report.computed:
        lines += ["", "| | verdict | claim | why | run | refused |", "|---|---|---|---|---|---|"]
        lines += [_row(claim) for claim in report.claims]
        counts = ", ".join(f"{n} {v}" for v, n in report.counts().items() if n)
        lines += ["", f"{len(report.claims)} claims: {counts}."]
    for run in report.own:
        lines += _section(run_facts.facts(run))
    if report.readings:
        lines += ["", "## Where the text is ambiguous"]
    for reading in report.readings:
        lines += ["", f"### {reading.topic}", "", f"{reading.passage}. Paper: {reading.paper}. {reading.decided}", ""]
        lines += [f"| reading | {_cell(reading.quantity)} | agrees |", "|---|---|---|"]
        lines += [f"| {_cell(row.reading)} | {row.number} | {agreement(row.agrees)} |" for row in reading.rows]
    if report.seeds:
        run, spreads, flips = report.seeds
        lines += ["", f"## How far ten surfaces can mislead ({run.seeds} surfaces, {run.name})", ""]
        lines += ["| quantity | all | 95 % of single surfaces | 95 % of means of ten |", "|---|---|---|---|"]
        lines += [f"| {_cell(s.name)} | {s.many} | {span(s.one)} | {span(s.ten)} |" for s in spreads]
        lines += ["", "| comparison | wrong with one surface each | with ten |", "|---|---|---|"]
        lines += [f"| {_cell(f.name)} | {f.one:.1%} | {f.ten:.1%} |" for f in flips]
    if report.estimates:
        lines += ["", "## How wrong the quick estimates of leakage are", "", f"| {' | '.join(ESTIMATE_HEAD)} |"]
        lines += ["|" + "---|" * len(ESTIMATE_HEAD)]
        lines += [f"| {' | '.join(map(_cell, estimate_row(ratio)))} |" for ratio in report.estimates]
    lines += ["", "## Claims in full"] * bool(report.computed)
    for claim in report.claims if report.computed else ():
        lines += [
            "",
            f"### {claim.id}. {claim.title}: {claim.verdict}",
            "",
            f"{claim.place}: {claim.sentence}",
            "",
            claim.why,
        ]
        if claim.checks:
            lines += ["", "| criterion | | number |", "|---|---|---|"]
            lines += [f"| {_cell(criterion(k))} | {MARKS[k.met]} | {k.number or ''} |" for k in claim.checks]
        lines += [f"- {number.name}: {number}" for number in claim.numbers]
        if claim.source:
            lines += ["", f"Run: {', '.join(claim.source)}."]
        lines += ["", "Refused:", ""] * bool(claim.refused) + [f"- {name}: {why}" for name, why in claim.refused]
    lines += ["", "## Runs", "", "| run | cases | wall time [s] | states | largest residual |", "|---|---|---|---|---|"]
    for facts in map(facts_of, report.runs):
        row = [facts[k] for k in ("name", "cases", "wall_time", "states")]
        lines.append("| " + " | ".join(map(str, row)) + f" | {facts['residual'] or 0:.1e} |")
    return "\n".join(lines) + "\n"


def _row(claim: Claim) -> str:
    # what lacks the records altogether is named in full further down
    short = [(name, why.split("; ")[0]) for name, why in claim.refused if not why.endswith("recorded")]
    refused = "; ".join(f"{name}: {why}" for name, why in short)
    cells = (
        str(claim.id),
        claim.verdict,
        f"{claim.title} ({claim.place})",
        claim.why,
        ", ".join(claim.source),
        refused,
    )
    return f"| {' | '.join(map(_cell, cells))} |"


def _section(facts: Facts) -> list[str]:
    """Return a run of its own."""
    lines = ["", f"## {facts.name}: {facts.title}", ""]
    lines += [f"- Warning: {line}" for line in facts.warnings] + [""] * bool(facts.warnings)
    lines += [f"- {name}: {value}" for name, value in (*facts.surface, *facts.loading)]
    for table in facts.tables:
        lines += ["", f"### {table.title}", ""] + [table.note, ""] * bool(table.note)
        lines += [f"| {' | '.join(map(_cell, table.head))} |", "|" + "---|" * len(table.head)]
        lines += [f"| {' | '.join(map(_cell, row))} |" for row in table.rows]
    return lines


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
