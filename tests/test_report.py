"""The report: one page that stands alone, says what the claims say, escapes what it is given, and can be checked."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from roughvol import campaign, captions, dataset, figure_cases, report, report_page, tradeoff_figures
from roughvol.claims import ABSENT, FAILS, HOLDS, Evidence, Lacking
from roughvol.cli import main
from roughvol.errors import DatasetError
from roughvol.theory_figures import THEORY

EXPECTED = Path(__file__).parent / "regression" / "expected_small.json"
UNUSABLE = ["", "[]", "{}", '{"numbers": {"4.exponent": 1}}', '{"verdict": {"1": "holds"}}', '{"verdicts": {"x": ""}}']
VOID = {"meta", "img", "br", "link", "hr"}


class Page(HTMLParser):
    """Collects ids, links, images and text, and sees that tags close in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.images: list[str] = []
        self.tags: set[str] = set()
        self.wrong: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.tags.add(tag)
        self.ids += [str(values["id"])] if "id" in values else []
        self.links += [str(values["href"])] if "href" in values else []
        self.images += [str(values["src"])] if "src" in values else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)


@pytest.fixture(scope="module")
def answered(small_study: Path) -> report.Report:
    return report.assemble([small_study], any_size=True)


@pytest.fixture(scope="module")
def html(answered: report.Report) -> str:
    return report.to_html(answered)


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the figures out of the page: they take seconds and are tested once."""
    monkeypatch.setattr(report_page, "drawings", lambda _: iter(()))
    monkeypatch.setattr(report_page, "drawings_of", lambda _: iter(()))


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def test_page_is_well_formed(page: Page) -> None:
    assert page.wrong == []
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))


def test_page_stands_alone(page: Page, html: str) -> None:
    assert "script" not in page.tags
    assert "link" not in page.tags
    assert all(link.startswith("#") for link in page.links)
    assert all(source.startswith("data:image/png;base64,") for source in page.images)
    assert not re.search(r"@import|url\(|https?://|<base|srcset", html)


def test_every_link_leads_somewhere(page: Page) -> None:
    assert {link[1:] for link in page.links} <= set(page.ids)


def test_page_is_light_and_dark_and_prints(html: str) -> None:
    for rule in ("prefers-color-scheme: dark", "@media print", "figure.plot:target"):
        assert rule in html


def test_every_claim_is_on_the_page_with_its_verdict(answered: report.Report, page: Page, html: str) -> None:
    for claim in answered.claims:
        assert f"claim-{claim.id}" in page.ids
        section = html.split(f"id='claim-{claim.id}'")[1].split("</section>")[0]
        assert f">{claim.verdict}<" in section
        assert section.count("class='met'") == sum(check.met is True for check in claim.checks)
        assert section.count("class='not-met'") == sum(check.met is False for check in claim.checks)


def test_figures_are_png_and_each_is_there_once(page: Page, html: str) -> None:
    names = re.findall(r"<figure id='(\w+)'", html)
    assert len(names) == len(set(names)) == len(page.images)
    assert {"fig04a", "fig04b", "fig09", "fig12a", "theory_separation", "theory_bearing", "volume_by_m"} <= set(names)
    for source in page.images:
        assert base64.b64decode(source.split(",")[1])[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.usefixtures("no_figures")
def test_what_comes_from_outside_is_escaped(answered: report.Report) -> None:
    evil = "<img src=x onerror='alert(1)'>&"
    run = dataclasses.replace(answered.runs[0], name=evil)
    claim = dataclasses.replace(answered.claims[1], source=(evil,), why=evil, sentence=evil, figures=())
    text = report.to_html(dataclasses.replace(answered, runs=(run,), claims=(claim,)))
    assert "<img src=x" not in text
    assert "&lt;img src=x onerror=&#x27;alert(1)&#x27;&gt;&amp;" in text


def test_json_says_what_the_claims_say(answered: report.Report) -> None:
    data = json.loads(report.to_json(answered))
    assert data["counts"] == answered.counts()
    assert [claim["verdict"] for claim in data["claims"]] == [claim.verdict for claim in answered.claims]
    numbers = {number["key"]: number["value"] for number in data["claims"][2]["numbers"]}
    assert numbers == {key: number.value for key, number in answered.claims[2].all_numbers.items()}
    facts = data["runs"][0]
    assert facts["states"] == facts["converged"] == 36 * 12
    assert facts["residual"] <= 1e-6


def test_markdown_has_every_verdict_in_tables_of_equal_width(answered: report.Report) -> None:
    text = report.to_markdown(answered)
    for claim in answered.claims:
        assert f"### {claim.id}. {claim.title}: {claim.verdict}" in text
    for table in re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE):
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()}) == 1


def test_summary_counts_all_claims(answered: report.Report) -> None:
    lines = report.summary(answered).splitlines()
    assert len(lines) == 25
    assert lines[-1].startswith("24 claims: ")
    assert sum(map(int, re.findall(r"(\d+) (?:holds|does|not)", lines[-1]))) == 24


@pytest.mark.parametrize("name", sorted(THEORY))
def test_figures_say_what_they_lack(name: str) -> None:
    with pytest.raises(Lacking):
        THEORY[name](Evidence(()))


def test_a_figure_of_theory_shows_computed_numbers(answered: report.Report) -> None:
    run = answered.runs[0]
    axes = THEORY["volume_by_m"](answered.evidence).axes[0]
    drawn = {line.get_label(): line.get_ydata() for line in axes.lines}
    means = [run.last("free_volume", D=2.3, m=m).mean() for m in run.m]
    np.testing.assert_allclose(drawn["mean over elements"], means)


# checks


def test_a_report_meets_its_own_expectation(answered: report.Report) -> None:
    expected = report.expectation(answered, relative=1e-6)
    assert report.departures(answered, expected) == []
    assert len(json.loads(expected)["numbers"]) > 100


def test_what_leaves_its_band_is_named(answered: report.Report) -> None:
    expected = json.loads(report.expectation(answered, relative=1e-6))
    verdict = answered.claims[2].verdict
    expected["verdicts"]["3"] = FAILS if verdict == HOLDS else HOLDS
    expected["numbers"]["4.exponent"] = [5.0, 6.0]
    expected["numbers"]["4.nonsense"] = [0.0, 1.0]
    expected["verdicts"]["99"] = HOLDS
    found = report.departures(answered, json.dumps(expected))
    assert len(found) == 4
    assert any(f"claim 3: {verdict}" in line for line in found)
    assert any("4.exponent" in line and "expected 5 to 6" in line for line in found)


@pytest.mark.parametrize("text", UNUSABLE)
def test_an_expectation_that_checks_nothing_is_refused(answered: report.Report, text: str) -> None:
    with pytest.raises(DatasetError):
        report.departures(answered, text)


def test_small_study_answers_as_stored(answered: report.Report) -> None:
    """A change of the code that changes an answer is seen here.

    Where the change is meant, the file is made anew: `report.expectation(report.assemble([study_nc]), relative=1e-3)`.
    """
    assert report.departures(answered, EXPECTED.read_text(encoding="utf-8")) == []


# the command


@pytest.mark.usefixtures("no_figures")
def test_command_writes_the_report_and_checks(small_study: Path, tmp_path: Path) -> None:
    arguments = ["report", str(small_study), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(main, [*arguments, "--check", str(EXPECTED)])
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines()[-1] == str(tmp_path / "out" / "report.html")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"report.html", "report.md", "claims.json"}
    wrong = tmp_path / "wrong.json"
    wrong.write_text('{"verdicts": {"2": "does not hold"}}')
    failed = CliRunner().invoke(main, [*arguments, "--check", str(wrong)])
    assert failed.exit_code == 1
    assert "claim 2: holds, expected does not hold" in failed.stderr


@pytest.mark.usefixtures("no_figures")
def test_one_run_has_its_report_beside_it(small_study: Path, tmp_path: Path) -> None:
    run = tmp_path / "copy"
    dataset.write(dataset.read(small_study), run / "study.nc")
    assert CliRunner().invoke(main, ["report", str(run)]).exit_code == 0
    assert (run / "report.html").is_file()


def test_no_run_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, ["report"])
    assert done.exit_code == 2
    assert "no finished run" in done.stderr
    with pytest.raises(DatasetError):
        report.assemble([])


@pytest.mark.usefixtures("no_figures")
def test_a_report_that_cannot_be_written_is_an_error(answered: report.Report, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match="cannot write"):
        report.write(answered, tmp_path / "file")


@pytest.mark.usefixtures("no_figures")
def test_runs_that_answer_little_are_reported_all_the_same(tmp_path: Path) -> None:
    """Surfaces alone, and a surface from a file that is gone since: nothing fails, and little is claimed."""
    heights = tmp_path / "hills.npy"
    np.save(heights, np.random.Generator(np.random.PCG64(1)).normal(size=(9, 9)))
    studies = {
        "bare": "{surface: {D: [2.2, 2.8], m: [4, 5], seeds: 2}, sweep: {steps: 0}, record: {heights: true}}",
        "hills": f"{{surface: {{file: {heights}, L: 1.0}}, sweep: {{steps: 3}}}}",
    }
    for name, text in studies.items():
        (tmp_path / f"{name}.yaml").write_text(text)
        campaign.run(tmp_path / f"{name}.yaml", out=tmp_path / name, jobs=1)
    heights.unlink()
    little = report.assemble([tmp_path / name / "study.nc" for name in studies])
    verdicts = {claim.id: claim.verdict for claim in little.claims}
    assert verdicts[2] == HOLDS
    assert all(verdict == ABSENT for id, verdict in verdicts.items() if id > 2)
    assert "hills" in report.to_html(little)
    assert Page(report.to_html(little)).wrong == []
