"""Forms of a report, and a report without figures."""

import json
import math
from pathlib import Path

from roughvol.campaign import execution
from roughvol.report import html, markdown, page
from roughvol.report.page import Report
from roughvol.reproduction import sections
from roughvol.reproduction.judgement import Judgement
from tests.kit import without_figures


def stored(folder: Path, **studies: str) -> dict[str, Path]:
    """Run studies in a folder; return their stored answers by name."""
    for name, text in studies.items():
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
        execution.run(folder / f"{name}.yaml", out=folder / name, jobs=1)
    return {name: folder / name / "study.nc" for name in studies}


def bare(judgement: Judgement) -> Report:
    """Return the report of what was judged, without figures."""
    with without_figures():
        return sections.report_of(judgement)


def to_html(report: Report | Judgement) -> str:
    return _rendered(report, html)


def to_markdown(report: Report | Judgement) -> str:
    return _rendered(report, markdown)


def _rendered(report, form) -> str:
    """Return a report with the figures that it has; one of what was judged has none."""
    if isinstance(report, Report):
        return form.render(page.document(report))
    with without_figures():
        return form.render(page.document(sections.report_of(report)))


def expectation(judgement: Judgement, *, relative: float) -> str:
    """Return the expectation a report meets: bands of ± (``relative`` |value| + 1e-9) about its numbers."""
    numbers = {}
    for claim in judgement.claims:
        for key, number in claim.all_numbers.items():
            if math.isfinite(number.value):
                slack = relative * abs(number.value) + 1e-9
                numbers[f"{claim.id}.{key}"] = [number.value - slack, number.value + slack]
    data = {"verdicts": {str(claim.id): claim.verdict for claim in judgement.claims}, "numbers": numbers}
    return json.dumps(data, indent=1, ensure_ascii=False) + "\n"
