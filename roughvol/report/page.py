"""The report of runs: what several runs show together, a section for each other run, and how all of them were computed.

``write`` puts ``report.html`` (one file: figures inside, no network, no script), ``report.md`` and ``claims.json`` into
a folder.
"""

from __future__ import annotations

import contextlib
import functools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roughvol._version import __version__
from roughvol.analysis import hysteresis
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import Table
from roughvol.errors import DatasetError
from roughvol.report import html, markdown, terminal
from roughvol.report.document import Cell, Document, Drawing, Section
from roughvol.report.figures.figure import Figure
from roughvol.report.run_facts import CLOSING, Facts, facts
from roughvol.store import stamped_file

OPEN = 3  # tables of a run that are shown at once; further ones unfold
BESIDE = "Beside this page: claims.json for machines, report.md for a terminal."


@dataclass(frozen=True, eq=False)
class Report:
    """Runs to report on, and what is said of them together.

    - ``own``: runs with a section of their own
    - ``figures``: figures that such a section may show, by name
    - ``lead``, ``chips``: words and counts below the title
    - ``before``, ``after``: sections before and after those of the runs of their own
    - ``record``, ``lines``: data of these sections for claims.json, and their lines for a terminal
    - ``sources``: works to cite
    """

    runs: tuple[Run, ...]
    own: tuple[Run, ...]
    figures: Mapping[str, Figure]
    title: str
    lead: str
    chips: tuple[Cell, ...]
    before: tuple[Section, ...]
    after: tuple[Section, ...]
    sources: tuple[str, ...]
    record: Mapping[str, Any]
    lines: tuple[str, ...]

    @functools.cached_property
    def facts(self) -> tuple[Facts, ...]:
        """The runs of their own in words and tables."""
        return tuple(map(facts, self.own))


def write(report: Report, folder: Path) -> Path:
    """Write ``report.html``, ``report.md`` and ``claims.json`` and return the path of the first."""
    page = document(report)
    pages = {"claims.json": to_json(report), "report.md": markdown.render(page), "report.html": html.render(page)}
    for name, text in pages.items():
        stamped_file.write(folder / name, text.encode())
    return folder / "report.html"


def document(report: Report) -> Document:
    """Return the page."""
    own = (_run(found, report.figures, f"run-{k}") for k, found in enumerate(report.facts, start=1))
    runs = dict.fromkeys(run.name.partition(", ")[0] for run in report.own)  # without the words of combinations
    title = report.title or ", ".join(runs)
    sections = (*report.before, *own, *_yielding(report.runs), *report.after, _runs(report.runs), _cite(report))
    return Document(title, f"{report.lead}.", report.chips, tuple(sections))


def summary(report: Report) -> str:
    """Return the page as lines for a terminal: runs of their own, then what the runs show together."""
    return "\n".join([*(line for found in report.facts for line in _brief(found)), *report.lines])


def to_json(report: Report) -> str:
    """Return numbers and provenance as JSON."""
    data = {"format": "roughvol claims 1", "roughvol_version": __version__, **report.record}
    data["surfaces"] = [found.plain() for found in report.facts]
    data["yielding"] = [asdict(comparison) for comparison in hysteresis.comparisons(report.runs)]
    data["runs"] = [computation(run) for run in report.runs]
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _run(found: Facts, figures: Mapping[str, Figure], anchor: str) -> Section:
    """Return the section of one run: its surface, how it was pressed, its states, its figures."""
    parts = [Section("Warnings", kind="warnings", items=found.warnings)] if found.warnings else []
    pair = Section("Surface", facts=found.surface), Section("Loading", facts=found.loading)
    parts.append(Section(kind="pair", sections=pair))
    parts += [Section(t.title, folded="" if k < OPEN else "closed", tables=(t,)) for k, t in enumerate(found.tables)]
    drawn = tuple(drawing._replace(name=f"{anchor}-{drawing.name}") for drawing in drawings_of(found.run, figures))
    parts += [Section("Figures", drawings=drawn)] if drawn else []
    return Section(found.run.name, anchor, kind="run", under=found.title, sections=tuple(parts))


def drawings_of(run: Run, figures: Mapping[str, Figure]) -> Iterator[Drawing]:
    """Yield every figure of a table that one run can feed by itself."""
    measured = "case" in run.dataset.dims
    for name, figure in figures.items():
        words = figure.words(surfaces=1 if measured else run.seeds, measured=measured)
        with contextlib.suppress(DatasetError):  # of a figure that lacks what it draws
            yield Drawing(name, words, run.name, figure(run.dataset))


def _brief(found: Facts) -> Iterator[str]:
    """Yield the lines of a run of its own."""
    closing = tuple(table for table in found.tables if table.title == CLOSING)
    warnings = tuple(f"warning: {line}" for line in found.warnings)
    title = f"{found.run.name}: {found.title}"
    return terminal.lines(Section(title, facts=found.surface + found.loading, tables=closing, items=warnings))


def _yielding(runs: Sequence[Run]) -> Iterator[Section]:
    for number, comparison in enumerate(hysteresis.comparisons(runs)):
        table = Table("", hysteresis.HEAD, comparison.rows)
        anchor = "" if number else "yielding"
        yield Section(comparison.title, anchor, "Yield", notes=(hysteresis.NOTE,), tables=(table,))


def _runs(runs: Sequence[Run]) -> Section:
    """Return the section on cost, convergence and versions of every run."""
    found = [computation(run) for run in runs]
    head = ("Run", "surfaces", "time [s], all cases", "states converged", "convolutions per state")
    rows = [
        (f["name"], *(_shown(f[key]) for key in ("cases", "wall_time")), f"{f['converged']} of {f['states']}",
         _shown(f["convolutions"]), "" if f["residual"] is None else f"{f['residual']:.1e}")
        for f in found
    ]  # fmt: skip
    sums = {key: sum(f[key] or 0 for f in found) for key in ("cases", "wall_time", "states", "converged")}
    states = f"{sums['converged']} of {sums['states']}"
    rows.append(("all", str(sums["cases"]), f"{sums['wall_time']:.0f}", states, "", ""))
    machines: dict[str, list[str]] = {}
    for f in found:
        machines.setdefault(_machine(f), []).append(f["name"])
    studies = tuple(
        Section(f"{f['name']}.yaml, every default written out", folded="closed", code=f["study"]) for f in found
    )
    return Section(
        "Runs, convergence, versions",
        "runs",
        "Runs",
        kind="versions",
        items=tuple(f"{words}: {', '.join(names)}" for words, names in machines.items()),
        tables=(Table("", (*head, "largest residual η/σ"), tuple(rows)),),
        sections=(Section("Study files", sections=studies),),
    )


def computation(run: Run) -> dict[str, Any]:
    """Return what was run, how long it took, and whether it converged."""
    ds = run.dataset
    found: dict[str, Any] = {"name": run.name, "cases": 0, "states": 0, "converged": 0}
    found |= {"residual": None, "convolutions": None, "wall_time": None}
    if "wall_time" in ds:
        found["wall_time"] = round(float(ds["wall_time"].sum()), 1)
    if "Sq" in ds:
        found["cases"] = int(ds["Sq"].notnull().sum())
    if "residual" in ds:
        solved = ds["residual"].notnull()
        found |= {"states": int(solved.sum()), "converged": int((ds["converged"] & solved).sum())}
        found["residual"] = float(ds["residual"].max())
        found["convolutions"] = round(float((ds["convolutions"] + ds["convolutions_fp32"]).where(solved).mean()), 2)
    found |= {name: str(ds.attrs.get(name, "")) for name in ("roughvol_version", "host", "platform", "date", "study")}
    found["libraries"] = json.loads(ds.attrs.get("libraries", "{}")) | {"fft": json.loads(ds.attrs.get("fft", "{}"))}
    return found


def _machine(f: Mapping[str, Any]) -> str:
    """Return versions, machine and day in words."""
    libraries = dict(f["libraries"])
    planner = ", ".join(f"{k} {v}" for k, v in libraries.pop("fft", {}).items())
    versions = ", ".join(f"{k} {v}" for k, v in libraries.items())
    return f"roughvol {f['roughvol_version']}; {versions}; transforms: {planner}; {f['platform']}; {f['date'][:10]}"


def _shown(value: Any) -> str:
    return "" if value is None or (isinstance(value, float) and not np.isfinite(value)) else str(value)


def _cite(report: Report) -> Section:
    version = f"The computation: roughvol {__version__}, with the study files above (CITATION.cff in the repository)."
    return Section("How to cite", "cite", notes=(*report.sources, version, BESIDE))
