"""One page that answers whether the paper holds: claims beside numbers, figures, readings, provenance.

``assemble`` answers everything once from the runs given; ``write`` puts ``report.html`` (one file: figures inside, no
network, no script), ``report.md`` and ``claims.json`` into a folder; ``departures`` compares with stated bands. The
HTML is made of plain strings, every text that comes from a dataset or a study escaped.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from roughvol import dataset
from roughvol._version import __version__
from roughvol.claims import (
    VERDICTS,
    Claim,
    Evidence,
    Lacking,
    Reading,
    Run,
    assess,
    plain,
)
from roughvol.claims.estimates import Ratio, ratios
from roughvol.claims.readings import readings
from roughvol.claims.seeds import Flip, Spread, many_seeds
from roughvol.errors import DatasetError
from roughvol.report_page import (
    CITE,
    ESTIMATE_HEAD,
    MARKS,
    agreement,
    criterion,
    estimate_row,
    facts_of,
    span,
    to_html,
)

FORMAT = "roughvol claims 1"


@dataclass(frozen=True, eq=False)
class Report:
    """Everything the page says, computed: claims, second readings, few seeds, estimates of leakage, and the runs."""

    runs: tuple[Run, ...]
    claims: tuple[Claim, ...]
    readings: tuple[Reading, ...]
    seeds: tuple[Run, list[Spread], list[Flip]] | None
    estimates: tuple[Ratio, ...]

    @property
    def evidence(self) -> Evidence:
        """The runs, to be asked."""
        return Evidence(self.runs)

    def counts(self) -> dict[str, int]:
        """Return how many claims have each verdict."""
        return {verdict: sum(claim.verdict == verdict for claim in self.claims) for verdict in VERDICTS}


def assemble(paths: Sequence[Path]) -> Report:
    """Return the report of stored runs, each the path of a ``study.nc``.

    Raises
    ------
    DatasetError
        If one cannot be read, or there is none.
    """
    if not paths:
        message = "no run to report on"
        raise DatasetError(message)
    runs = tuple(Run.of(path.resolve().parent.name, dataset.read(path)) for path in paths)
    evidence = Evidence(runs)
    try:
        many = many_seeds(evidence)
    except Lacking:
        many = None
    return Report(runs, tuple(assess(runs)), tuple(readings(evidence)), many, tuple(ratios(evidence)))


def write(report: Report, folder: Path) -> Path:
    """Write ``report.html``, ``report.md`` and ``claims.json`` and return the path of the first.

    Raises
    ------
    DatasetError
        If the folder cannot be written.
    """
    pages = {"claims.json": to_json(report), "report.md": to_markdown(report), "report.html": to_html(report)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in pages.items():
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        message = f"cannot write the report to {folder}: {error}"
        raise DatasetError(message) from error
    return folder / "report.html"


def departures(report: Report, expected: str) -> list[str]:
    """Return in words what left the bands of an expectation.

    Parameters
    ----------
    expected : str
        JSON ``{"verdicts": {"4": "holds"}, "numbers": {"4.exponent": [0.35, 0.45]}}``; a number is named by its claim
        and its key in claims.json, and its value (not its interval) must lie in the band.

    Raises
    ------
    DatasetError
        If it is no such JSON.
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
        message = (
            f"the expectation must name verdicts or numbers and nothing else, got "
            f"{', '.join(sorted(unknown)) or 'neither'}"
        )
        raise DatasetError(message)
    claims = {claim.id: claim for claim in report.claims}
    found = []
    for id, verdict in verdicts.items():
        given = claims[id].verdict if id in claims else "no such claim"
        if given != verdict:
            found.append(f"claim {id}: {given}, expected {verdict}")
    for name, (low, high) in bands.items():
        id_text, _, key = name.partition(".")
        claim = claims.get(int(id_text)) if id_text.isdecimal() else None
        number = claim.all_numbers.get(key) if claim else None
        if number is None:
            found.append(f"{name}: not computed, expected {low:g} to {high:g}")
        elif not low <= number.value <= high:
            found.append(f"{name}: {number.value:.6g}, expected {low:g} to {high:g} ({number.name})")
    return found


def expectation(report: Report, *, relative: float, absolute: float = 1e-9, about: str = "") -> str:
    """Return the expectation a report meets: bands of ± (``relative`` |value| + ``absolute``) about its numbers."""
    numbers = {}
    for claim in report.claims:
        for key, number in claim.all_numbers.items():
            if math.isfinite(number.value):
                slack = relative * abs(number.value) + absolute
                numbers[f"{claim.id}.{key}"] = [number.value - slack, number.value + slack]
    data: dict[str, Any] = {"about": about} if about else {}
    data |= {"verdicts": {str(claim.id): claim.verdict for claim in report.claims}, "numbers": numbers}
    return json.dumps(data, indent=1, ensure_ascii=False) + "\n"


def summary(report: Report) -> str:
    """Return the verdicts as lines of text for a terminal, the counts last."""
    width = max(len(verdict) for verdict in VERDICTS)
    lines = [f"{claim.id:3d}  {claim.verdict:<{width}}  {claim.title}" for claim in report.claims]
    counts = ", ".join(f"{count} {verdict}" for verdict, count in report.counts().items() if count)
    return "\n".join([*lines, f"{len(report.claims)} claims: {counts}"])


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
    data["estimates"] = [asdict(ratio) for ratio in report.estimates]
    data["runs"] = [facts_of(run) for run in report.runs]
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def to_markdown(report: Report) -> str:
    """Return the report for reading in a terminal."""
    lines = ["# Does the paper hold?", "", CITE, "", "| | verdict | claim | why |", "|---|---|---|---|"]
    lines += [f"| {c.id} | {c.verdict} | {_cell(c.title)} ({_cell(c.place)}) | {_cell(c.why)} |" for c in report.claims]
    lines += [
        "",
        f"{len(report.claims)} claims: " + ", ".join(f"{n} {v}" for v, n in report.counts().items() if n) + ".",
    ]
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
    lines += ["", "## Claims in full"]
    for claim in report.claims:
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
    lines += ["", "## Runs", "", "| run | cases | wall time [s] | states | largest residual |", "|---|---|---|---|---|"]
    for facts in map(facts_of, report.runs):
        row = [facts[k] for k in ("name", "cases", "wall_time", "states")]
        lines.append("| " + " | ".join(map(str, row)) + f" | {facts['residual'] or 0:.1e} |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
