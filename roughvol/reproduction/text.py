"""The report as JSON, as Markdown, and as lines for a terminal."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

from roughvol._version import __version__
from roughvol.analysis.hysteresis import HEAD as HEAD_OF_YIELDING
from roughvol.report import run_facts
from roughvol.report.run_facts import Facts
from roughvol.reproduction.claims import VERDICTS, Claim
from roughvol.reproduction.claims.leak_estimates import HEAD
from roughvol.reproduction.claims.many_seeds import ManySeeds
from roughvol.reproduction.claims.verdict import Reading, plain
from roughvol.reproduction.literature import rows as literature_rows
from roughvol.reproduction.model import CITE, MARKS, Report, agreement, counted, criterion, facts_of, heading, span

FORMAT = "roughvol claims 1"


def summary(report: Report) -> str:
    """Return runs of their own and the verdicts as lines of text for a terminal, the counts of verdicts last."""
    lines = [line for run in report.own for line in _lines(run_facts.facts(run))]
    width = max(len(verdict) for verdict in VERDICTS)
    lines += [f"{row.id:3d}  {row.verdict:<{width}}  {_titled(row)}" for row in report.literature]
    if report.literature:
        lines.append(f"{len(report.literature)} numbers of the literature: {counted(report.literature)}")
    if not report.computed:
        return "\n".join(lines)
    lines += [f"{claim.id:3d}  {claim.verdict:<{width}}  {_titled(claim)}" for claim in report.claims]
    return "\n".join([*lines, _counts(report)])


def _counts(report: Report) -> str:
    return f"{len(report.claims)} claims: {counted(report.claims)}"


def _titled(claim: Claim) -> str:
    return f"{claim.title} ({', '.join(claim.source)})" if claim.source else claim.title


def _lines(facts: Facts) -> Iterator[str]:
    """Yield the lines of a run of its own."""
    yield f"{facts.name}: {facts.title}"
    width = max(len(name) for name, _ in (*facts.surface, *facts.loading))
    yield from (f"  {name:<{width}}  {value}" for name, value in (*facts.surface, *facts.loading))
    for table in facts.tables:
        if table.title == run_facts.CLOSING:
            yield f"  {table.title}"
            for row in table.rows:
                cells = [f"{head} {cell}" for head, cell in zip(table.head, row, strict=True)]
                yield f"    {', '.join(cells)}"
    yield from (f"  warning: {line}" for line in facts.warnings)


# JSON and Markdown ---------------------------------------------------------------------------------------------------


def to_json(report: Report) -> str:
    """Return claims, numbers, readings and provenance as JSON."""
    data: dict[str, Any] = {"format": FORMAT, "roughvol_version": __version__, "counts": report.counts()}
    data["claims"] = plain(report.claims)
    data["readings"] = plain(report.readings)
    data["literature"] = plain(report.literature)
    if report.seeds:
        data["seeds"] = _plain_seeds(report.seeds)
    data["surfaces"] = [run_facts.facts(run).plain() for run in report.own]
    data["yielding"] = [asdict(comparison) for comparison in report.yielding]
    data["estimates"] = [asdict(ratio) for ratio in report.estimates]
    data["runs"] = [facts_of(run) for run in report.runs]
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain_seeds(seeds: ManySeeds) -> dict[str, Any]:
    """Return the results of few surfaces as plain data for JSON."""
    quantities = []
    for spread in seeds.spreads:
        few = {"one": list(spread.one), "ten": list(spread.ten), "missed": spread.missed}
        quantities.append(plain(spread.many) | few)
    wrong = [{"comparison": flip.name, "one": flip.one, "ten": flip.ten} for flip in seeds.flips]
    return {"run": seeds.run.name, "quantities": quantities, "wrong_order": wrong}


def to_markdown(report: Report) -> str:
    """Return the report for reading in a terminal."""
    lines = [f"# {heading(report)}", "", CITE]
    if report.computed:
        rows = [_row(claim) for claim in report.claims]
        lines += ["", *_table(("", "verdict", "claim", "why", "run", "refused"), rows)]
        lines += ["", f"{_counts(report)}."]
    for run in report.own:
        lines += _section(run_facts.facts(run))
    if report.literature:
        lines += ["", "## Numbers of the literature", "", literature_rows.NOTE, ""]
        lines += _table(("", *literature_rows.HEAD), [literature_rows.row(claim) for claim in report.literature])
    if report.readings:
        lines += ["", "## Where the text is ambiguous"]
        for reading in report.readings:
            lines += _reading(reading)
    if report.seeds:
        lines += _seeds(report.seeds)
    if report.estimates:
        lines += ["", "## How wrong the quick estimates of leakage are", ""]
        lines += _table(HEAD, [ratio.cells for ratio in report.estimates])
    for comparison in report.yielding:
        lines += ["", f"## {comparison.title}", "", *_table(HEAD_OF_YIELDING, comparison.rows)]
    if report.computed:
        lines += ["", "## Claims in full"]
        for claim in report.claims:
            lines += _in_full(claim)
    lines += _runs(report)
    return "\n".join(map(_without_tags, lines)) + "\n"


def _without_tags(line: str) -> str:
    """Return a line whose ``<`` begins no element of HTML, as in the name of a file or in the symbol ``<V*>``."""
    return re.sub(r"(\\*)<(?=[A-Za-z/!?])", r"\1\1\\<", line)


def _reading(reading: Reading) -> list[str]:
    """Return the lines of an ambiguous passage."""
    lines = ["", f"### {reading.topic}", ""]
    lines += [f"{reading.passage}. Paper: {reading.paper}. {reading.decided}", ""]
    rows = [(row.reading, str(row.number), agreement(row.agrees)) for row in reading.rows]
    return lines + _table(("reading", reading.quantity, "agrees"), rows)


def _seeds(seeds: ManySeeds) -> list[str]:
    """Return the lines on results of few surfaces."""
    lines = ["", f"## How far ten surfaces can mislead ({seeds.run.seeds} surfaces, {seeds.run.name})", ""]
    spreads = [(spread.name, str(spread.many), span(spread.one), span(spread.ten)) for spread in seeds.spreads]
    lines += _table(("quantity", "all", "95 % of single surfaces", "95 % of means of ten"), spreads)
    flips = [(flip.name, f"{flip.one:.1%}", f"{flip.ten:.1%}") for flip in seeds.flips]
    return [*lines, "", *_table(("comparison", "wrong with one surface each", "with ten"), flips)]


def _runs(report: Report) -> list[str]:
    """Return the lines on cost and convergence of every run."""
    rows = []
    for run in report.runs:
        facts = facts_of(run)
        counts = [str(facts[name]) for name in ("name", "cases", "wall_time", "states")]
        rows.append([*counts, f"{facts['residual'] or 0:.1e}"])
    return ["", "## Runs", "", *_table(("run", "cases", "wall time [s]", "states", "largest residual"), rows)]


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table."""
    lines = [f"| {' | '.join(map(_cell, row))} |" for row in (head, *rows)]
    return [lines[0].replace("|  |", "| |"), "|" + "---|" * len(head), *lines[1:]]


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _row(claim: Claim) -> tuple[str, ...]:
    """Return a claim as a row; a run without the records is named in full further down."""
    refused = [f"{name}: {why.split('; ')[0]}" for name, why in claim.refused if not why.endswith("recorded")]
    title = f"{claim.title} ({claim.place})"
    return str(claim.id), claim.verdict, title, claim.why, ", ".join(claim.source), "; ".join(refused)


def _in_full(claim: Claim) -> list[str]:
    """Return a claim with its sentence, its checks and numbers, and the runs refused."""
    lines = ["", f"### {claim.id}. {claim.title}: {claim.verdict}", "", f"{claim.place}: {claim.sentence}"]
    lines += ["", claim.why]
    if claim.checks:
        rows = [(criterion(check), MARKS[check.met], str(check.number or "")) for check in claim.checks]
        lines += ["", *_table(("criterion", "", "number"), rows)]
    lines += [f"- {number.name}: {number}" for number in claim.numbers]
    if claim.source:
        lines += ["", f"Run: {', '.join(claim.source)}."]
    if claim.refused:
        lines += ["", "Refused:", ""]
        lines += [f"- {name}: {why}" for name, why in claim.refused]
    return lines


def _section(facts: Facts) -> list[str]:
    """Return a run of its own."""
    lines = ["", f"## {facts.name}: {facts.title}", ""]
    if facts.warnings:
        lines += [*(f"- Warning: {line}" for line in facts.warnings), ""]
    lines += [f"- {name}: {value}" for name, value in (*facts.surface, *facts.loading)]
    for table in facts.tables:
        lines += ["", f"### {table.title}", ""]
        if table.note:
            lines += [table.note, ""]
        lines += _table(table.head, table.rows)
    return lines
