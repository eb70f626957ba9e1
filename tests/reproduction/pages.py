"""The forms of a report, from what was judged."""

from __future__ import annotations

from roughvol.report import html, markdown, page
from roughvol.reproduction.judgement import Judgement
from roughvol.reproduction.sections import report_of


def to_html(judgement: Judgement) -> str:
    return html.render(page.document(report_of(judgement)))


def to_markdown(judgement: Judgement) -> str:
    return markdown.render(page.document(report_of(judgement)))


def to_json(judgement: Judgement) -> str:
    return page.to_json(report_of(judgement))


def summary(judgement: Judgement) -> str:
    return page.summary(report_of(judgement))
