"""A document in its forms: each holds every word of the sections, escaped as the form needs."""

import re
from html import unescape

from roughvol.analysis.tables import Table
from roughvol.report import html, markdown, terminal
from roughvol.report.document import Cell, Document, Section

REFUSED = Section("1 run refused", kind="refused", folded="closed", items=("toy: m = 4",))
ROW = (Cell("A claim", link="part", small="Sec. 3"), Cell("run_1", more=REFUSED), "a|b <c>")
PART = Section(
    "A part & more",
    "part",
    under="below",
    quote="quoted",
    notes=("note <V*>",),
    facts=(("Sq", "1 um"),),
    items=("an item",),
    tables=(Table("", ("claim", "run", "words"), (ROW,), "of the table"),),
    sections=(Section("Inner", notes=("deep",)),),
)
PAGE = Document("Title", "lead", (Cell("2", "holds", small="holds"),), (PART,))
WORDS = "Title lead below quoted an item 1 um of the table Inner deep A claim Sec. 3 run_1 1 run refused toy: m = 4"


def _words(text: str) -> list[str]:
    return re.findall(r"\w+", text)


def test_html_and_markdown_hold_every_word_of_a_page() -> None:
    page = html.render(PAGE)
    shown = unescape(re.sub(r"<[^>]+>", " ", page.split("</style>")[1]))
    for text in (shown, markdown.render(PAGE)):
        assert set(_words(WORDS)) <= set(_words(text))
    assert shown.count("A part & more") == 2  # in the links at the top, and as a heading


def test_nothing_of_a_text_becomes_a_tag() -> None:
    assert "<c>" not in html.render(PAGE)
    assert "<V*>" not in html.render(PAGE)
    assert r"a\|b \<c>" in markdown.render(PAGE)


def test_a_section_folds_where_it_says_so() -> None:
    closed, opened = (html.section(Section("More", folded=how, notes=("x",))) for how in ("closed", "open"))
    assert closed == "<details><summary>More</summary><p>x</p></details>"
    assert opened == closed.replace("<details>", "<details open='open'>")


def test_the_terminal_has_facts_in_columns_and_tables() -> None:
    table = Table("Closing", ("axis", "p"), (("x", "3"),))
    part = Section("Run", facts=(("L", "1 um"), ("Sq", "2 um")), tables=(table,))
    assert list(terminal.lines(part)) == ["Run", "  L   1 um", "  Sq  2 um", "  Closing", "  axis  p", "  x     3"]
