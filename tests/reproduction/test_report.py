"""The report: one page that stands alone, says what the claims say, escapes what it is given, and can be checked."""

import base64
import dataclasses
import json
import re
from html import escape, unescape
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import roughvol
from roughvol.errors import DatasetError
from roughvol.report import page as report_page
from roughvol.report import run_facts
from roughvol.report.figures.registry import TRADEOFF
from roughvol.reproduction import judgement
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.evidence import Evidence, Lacking
from roughvol.reproduction.claims.verdict import ABSENT, FAILS, HOLDS
from roughvol.reproduction.figures.registry import ALL, COMPARISONS
from roughvol.reproduction.judgement import Judgement, judge
from roughvol.reproduction.sections import report_of
from roughvol.store import dataset
from roughvol.store.run import names_of
from roughvol.study import loads
from roughvol.surfaces.midpoint import random_midpoint_displacement
from tests.kit import call, refused, said
from tests.reproduction import kit

EXPECTED = Path(__file__).parents[1] / "regression" / "expected_small.json"
UNUSABLE = ["", "[]", "{}", '{"numbers": {"4.exponent": 1}}', '{"verdict": {"1": "holds"}}', '{"verdicts": {"x": ""}}']


def _tree(html: str) -> ElementTree.Element:
    """Return the elements of a page; tags that do not close in order, and names that are not escaped, are errors."""
    page = html.removeprefix("<!doctype html>")
    return ElementTree.fromstring(re.sub(r"<((?:meta|img|br|link|hr)\b[^>]*)>", r"<\1/>", page))


def _all(page: ElementTree.Element, attribute: str) -> list[str]:
    return [element.attrib[attribute] for element in page.iter() if attribute in element.attrib]


@pytest.fixture(scope="module")
def report(answered: Judgement) -> report_page.Report:
    return report_of(answered)


@pytest.fixture(scope="module")
def html(report: report_page.Report) -> str:
    return kit.to_html(report)


@pytest.fixture(scope="module")
def page(html: str) -> ElementTree.Element:
    return _tree(html)


def test_page_is_well_formed_and_stands_alone(page: ElementTree.Element, html: str) -> None:
    ids, links = _all(page, "id"), _all(page, "href")
    assert len(ids) == len(set(ids))
    assert {"script", "link"} & {element.tag for element in page.iter()} == set()
    assert all(link.startswith("#") for link in links)
    assert {link[1:] for link in links} <= set(ids)
    assert all(source.startswith("data:image/png;base64,") for source in _all(page, "src"))
    assert not re.search(r"@import|url\(|https?://|<base|srcset", html)


def test_every_claim_is_on_the_page_with_its_verdict(answered: Judgement, page: ElementTree.Element, html: str) -> None:
    absent = html.split("class='verdicts absent-claims'")[1].split("</table>")[0]
    for claim in answered.absent:
        assert escape(claim.lacking or claim.untested) in absent
    for claim in answered.computed:
        assert f"claim-{claim.id}" in _all(page, "id")
        section = html.split(f"id='claim-{claim.id}'")[1].split("</section>")[0]
        assert f">{claim.verdict}<" in section
        assert section.count("class='met'") == sum(check.met is True for check in claim.checks)
        assert section.count("class='not-met'") == sum(check.met is False for check in claim.checks)


def test_figures_are_png_and_each_is_there_once(page: ElementTree.Element, html: str) -> None:
    names = re.findall(r"<figure id='(\w+)'", html)
    assert len(names) == len(set(names)) == len(_all(page, "src"))
    assert {"fig04a", "fig04b", "fig09", "fig12a", "theory_separation", "theory_bearing", "volume_by_m"} <= set(names)
    assert ALL["fig09"].words() in unescape(html)  # the caption, not the docstring
    for source in _all(page, "src"):
        assert base64.b64decode(source.split(",")[1])[:8] == b"\x89PNG\r\n\x1a\n"


def test_what_comes_from_outside_is_escaped(answered: Judgement) -> None:
    evil = "<img src=x onerror='alert(1)'>&"
    run = dataclasses.replace(answered.runs[0], name=evil)
    claim = dataclasses.replace(answered.claims[1], source=(evil,), why=evil, sentence=evil, figures=())
    text = kit.to_html(dataclasses.replace(answered, runs=(run,), claims=(claim,)))
    assert "<img src=x" not in text
    assert "&lt;img src=x onerror=&#x27;alert(1)&#x27;&gt;&amp;" in text


def test_json_says_what_the_claims_say(answered: Judgement, report: report_page.Report) -> None:
    data = json.loads(report_page.to_json(report))
    assert sum(data["counts"].values()) == 24
    assert data["counts"][HOLDS] == sum(claim.verdict == HOLDS for claim in answered.claims)
    assert [claim["verdict"] for claim in data["claims"]] == [claim.verdict for claim in answered.claims]
    numbers = {number["key"]: number["value"] for number in data["claims"][2]["numbers"]}
    assert numbers == {key: number.value for key, number in answered.claims[2].all_numbers.items()}
    facts = data["runs"][0]
    assert facts["states"] == facts["converged"] == 36 * 12
    assert facts["residual"] <= 1e-6


def test_markdown_has_every_verdict_in_tables_of_equal_width(answered: Judgement, report: report_page.Report) -> None:
    text = kit.to_markdown(report)
    for claim in answered.computed:
        assert f"### {claim.id}. {claim.title}: {claim.verdict}" in text
    for claim in answered.absent:
        assert f"| {claim.id} | {claim.title} ({claim.place}) |" in text
    assert _widths_of_tables(text) == {1}


def _widths_of_tables(markdown: str) -> set[int]:
    """Return how many different widths the rows of a table have, over all tables."""
    tables = re.findall(r"(?:^\|.*\n)+", markdown, flags=re.MULTILINE)
    return {len({len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()}) for table in tables}


def test_summary_counts_all_claims(report: report_page.Report) -> None:
    lines = report_page.summary(report).splitlines()
    assert len(lines) == 25
    assert lines[-1].startswith("24 claims: ")
    assert sum(map(int, re.findall(r"(\d+) (?:holds|does|not)", lines[-1]))) == 24


def test_figures_say_what_they_lack() -> None:
    for comparison in COMPARISONS.values():
        with pytest.raises(Lacking):
            comparison(Evidence(()))


def test_a_figure_of_theory_shows_computed_numbers(answered: Judgement) -> None:
    run = answered.runs[0]
    axes = COMPARISONS["volume_by_m"](answered.evidence).axes[0]
    drawn = {line.get_label(): line.get_ydata() for line in axes.lines}
    means = [run.last("free_volume", D=2.3, m=m).mean() for m in run.m]
    np.testing.assert_allclose(drawn["mean over elements"], means)


# checks


def test_what_leaves_its_band_is_named(answered: Judgement) -> None:
    expected = json.loads(kit.expectation(answered, relative=1e-6))
    verdict = answered.claims[2].verdict
    expected["verdicts"]["3"] = FAILS if verdict == HOLDS else HOLDS
    expected["numbers"]["4.exponent"] = [5.0, 6.0]
    expected["numbers"]["4.nonsense"] = [0.0, 1.0]
    expected["verdicts"]["99"] = HOLDS
    found = judgement.departures(answered, json.dumps(expected))
    assert len(found) == 4
    assert any(f"claim 3: {verdict}" in line for line in found)
    assert any("4.exponent" in line and "expected 5 to 6" in line for line in found)


@pytest.mark.parametrize("text", [*UNUSABLE, b"\xa7\xff"])
def test_an_expectation_that_checks_nothing_is_refused(answered: Judgement, text: str | bytes) -> None:
    with pytest.raises(DatasetError):
        judgement.departures(answered, text)


def test_small_study_answers_as_stored(answered: Judgement) -> None:
    """A change of the code that changes an answer is seen here.

    Where the change is meant, the file is made anew: `kit.expectation(judge([study_nc]), relative=1e-3)`.
    """
    assert judgement.departures(answered, EXPECTED.read_text(encoding="utf-8")) == []


# the command


@pytest.mark.usefixtures("no_figures")
def test_command_writes_the_report_and_checks(own: dict[str, Path], tmp_path: Path) -> None:
    dataset.write(dataset.read(own["sealing"]), tmp_path / "copy" / "study.nc")
    arguments = ("report", tmp_path / "copy", "--check")
    right, wrong = tmp_path / "right.json", tmp_path / "wrong.json"
    right.write_text('{"verdicts": {"2": "not computed"}}')
    assert said(*arguments, right).splitlines()[-1] == str(tmp_path / "copy" / "report.html")
    wrong.write_text('{"verdicts": {"2": "does not hold"}}')
    failed = call(*arguments, wrong, "--out", tmp_path / "out")
    assert failed.exit_code == 1
    assert "claim 2: not computed, expected does not hold" in failed.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"report.html", "report.md", "claims.json"}


@pytest.mark.usefixtures("here")
def test_no_run_is_an_error() -> None:
    assert "no finished run" in refused("report")
    with pytest.raises(DatasetError):
        judge([])


def test_counts_of_surfaces_are_those_computed(answered: Judgement) -> None:
    run = answered.runs[0]
    D, m = run.D[0], run.m[0]
    left_out = (run.dataset["D"] == D) & (run.dataset["m"] == m) & (run.dataset["seed"] == run.seed_numbers()[-1])
    part = run.dataset.assign({name: run.dataset[name].where(~left_out) for name in ("Sq", "mean_pressure")})
    facts = run_facts.facts(dataclasses.replace(run, dataset=part))
    assert f"{run.seeds - 1} to {run.seeds} of each D and m" in dict(facts.surface)["Surfaces"]
    notes = {table.title: table.note for table in facts.tables}
    assert notes[f"States, D = {D:g}, m = {m}"].startswith(f"Mean over {run.seeds - 1} surfaces")


@pytest.mark.usefixtures("no_figures")
def test_a_report_that_cannot_be_written_is_an_error(answered: Judgement, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match="cannot write"):
        report_page.write(report_of(answered), tmp_path / "file")


def test_runs_that_answer_little_are_reported_all_the_same(tmp_path: Path) -> None:
    """Surfaces alone, and a surface from a file that is gone since: nothing fails, and little is claimed."""
    heights = tmp_path / "hills.npy"
    np.save(heights, np.random.Generator(np.random.PCG64(1)).normal(size=(9, 9)))
    studies = {
        "bare": "{surface: {D: [2.2, 2.8], m: [4, 5], seeds: 2}, sweep: {steps: 0}, record: {heights: true}}",
        "hills": f"{{surface: {{file: {heights}, L: 1.0}}, sweep: {{steps: 3}}}}",
    }
    paths = kit.stored(tmp_path, **studies)
    heights.unlink()
    little = judge(list(paths.values()))
    assert {claim.verdict for claim in little.claims} == {ABSENT}
    assert [run.name for run in little.own] == list(studies)
    assert "hills" in "".join(_tree(kit.to_html(little)).itertext())


# a run of one's own


SCAN = """
name: scan
surface: {{file: {file}, L: 50 um, level: tilt, missing: nearest}}
material: {{E: 10 MPa, nu: 0.49}}
sweep: {{steps: 8, to: percolation}}
record: {{transport: {{constriction: every-step, percolation: every-step}}, dimensional: {{pressure: kPa}}}}
"""
SEALING = """
name: sealing
surface: {D: [2.2, 2.4], m: 4, seeds: 2}
sweep: {steps: 6, to: percolation}
record: {transport: {percolation: every-step}}
"""


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the stored answers of a measured map and of a small sealing study."""
    folder = tmp_path_factory.mktemp("own")
    heights = random_midpoint_displacement(D=2.2, m=4, seed=3).heights[:, :13].copy()
    heights[2, 3] = np.nan
    np.save(folder / "map.npy", heights)
    made = kit.stored(folder, scan=SCAN.format(file=folder / "map.npy"), sealing=SEALING)
    warnings = "the slope <0.9> is large\nthe pressure exceeds the hardness"
    dataset.write(dataset.read(made["scan"]).assign_attrs(warnings=warnings), folder / "warned" / "study.nc")
    return made | {"warned": folder / "warned" / "study.nc"}


@pytest.fixture(scope="module")
def scan_page(own: dict[str, Path]) -> str:
    return kit.to_html(judge([own["warned"]]))


def _text(html: str) -> str:
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", html)).split())


def test_a_scan_gets_a_page_about_its_surface(own: dict[str, Path], scan_page: str) -> None:
    text, stored = _text(scan_page), dataset.read(own["scan"])
    assert "17 x 13" in text
    assert "50 by 37.5 um" in text
    assert f"Sq, root mean square height {run_facts.number(float(stored.Sq[0]))} um" in text
    peak = float((stored.separation + stored.indentation)[0, 0])
    assert f"Highest point above the mean plane over Sq {run_facts.number(peak)}" in text
    assert "tilt" in text
    assert f"{1 / (17 * 13):.2%} of the nodes, 1 node, filled" in text
    assert "13.16 MPa" in text
    _tree(scan_page)


def test_a_scan_is_not_asked_about_the_paper(scan_page: str) -> None:
    for words in ("not computed", "Does the paper hold", "claim-", "Verdicts"):
        assert words not in scan_page
    assert "Wear 336-337" in scan_page


def test_warnings_are_shown_one_a_line(scan_page: str, own: dict[str, Path]) -> None:
    assert "<li>the slope &lt;0.9&gt; is large</li><li>the pressure exceeds the hardness</li>" in scan_page
    assert "Warnings" not in kit.to_html(judge([own["scan"]]))


def test_a_study_of_ones_own_gets_its_facts_and_no_claims(own: dict[str, Path]) -> None:
    text = _text(kit.to_html(judge([own["sealing"]])))
    assert "4 generated surfaces, D = 2.2, 2.4, m = 4" in text
    assert "Where it closes" in text
    assert "not computed" not in text


def test_a_smaller_study_of_the_paper_has_what_each_claim_lacks(tmp_path: Path) -> None:
    text = "name: smaller\nsurface: {D: [2.2, 2.4], m: 4, seeds: 2}\nsweep: {steps: 6, to: mean-plane}\n"
    found = judge(list(kit.stored(tmp_path, smaller=text).values()))
    assert not found.computed
    page = _text(kit.to_html(found))
    assert f"{len(found.claims)} claims not computed, with what is lacking" in page
    lacking = "D = 2.2, 2.4, needs 2.1, 2.3, 2.5, 2.7, 2.9; m = 4, needs m >= 8; 2 surfaces of each kind, needs 10"
    assert f"smaller: {lacking}" in page
    assert report_page.summary(report_of(found)).endswith("the page has what each claim lacks")
    for name, own in (("sized", "L: 1 mm, "), ("scaled", "Sq: 0.5, ")):  # the surfaces of the paper have neither
        others = judge(list(kit.stored(tmp_path, **{name: text.replace("{D: ", f"{{{own}D: ")}).values()))
        assert "claim" not in report_page.summary(report_of(others))


def test_runs_of_the_paper_and_scans_have_a_section_each(
    small_study: Path, own: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judgement, "readings", lambda evidence: ())  # they take seconds
    both = judge([small_study, own["scan"]], any_size=True)
    html = kit.to_html(both)
    assert [run.name for run in both.own] == ["scan"]
    assert "Does the paper hold?" in html
    assert "<section id='run-1' class='run'>" in html
    _tree(html)
    assert dict(both.claims[2].refused) == {"scan": "heights from a file"}


def test_each_row_names_its_run_and_those_refused(answered: Judgement, small_study: Path, tmp_path: Path) -> None:
    dataset.write(dataset.read(small_study), tmp_path / "toy" / "study.nc")
    refused = judge([tmp_path / "toy" / "study.nc"])
    assert not refused.computed
    assert dict(refused.claims[2].refused)["toy"].startswith("D = 2.1, 2.3, 2.9, needs")
    row = kit.to_html(answered).split("href='#claim-3'")[1].split("</tr>")[0]
    assert "data-head='Run'>small" in row
    claim = dataclasses.replace(answered.claims[2], refused=(("toy", "m = 4, needs m >= 8; 1 surface"),))
    some = dataclasses.replace(answered, claims=(claim,))
    assert "<li>toy: m = 4, needs m &gt;= 8; 1 surface</li>" in kit.to_html(some).split("</table>")[0]
    assert "1 run refused: toy: m = 4, needs m >= 8; 1 surface |" in kit.to_markdown(some)
    assert json.loads(report_page.to_json(kit.bare(some)))["claims"][0]["refused"] == dict(claim.refused)


def test_facts_are_in_json_markdown_and_on_the_terminal(own: dict[str, Path]) -> None:
    scan = judge([own["warned"]])
    assert json.loads(report_page.to_json(kit.bare(scan)))["surfaces"][0]["surface"]["Nodes"].startswith("17 x 13")
    markdown, lines = kit.to_markdown(scan), report_page.summary(kit.bare(scan))
    assert _widths_of_tables(markdown) == {1}
    for words in ("17 x 13", "the pressure exceeds the hardness", "Where it closes"):
        assert words in markdown
        assert words in lines
    assert "not computed" not in markdown + lines


def test_runs_of_one_name_are_told_apart(tmp_path: Path) -> None:
    paths = [tmp_path / name / "study.nc" for name in ("a/scan", "b/scan", "other")]
    assert names_of(paths) == ["a/scan", "b/scan", "other"]


# captions and narrow windows


def test_every_figure_has_a_caption_of_its_own() -> None:
    captions = [figure.caption for figure in (*ALL.values(), *COMPARISONS.values(), *TRADEOFF.values())]
    for text in captions:
        assert text.endswith(".")
        assert max(len(sentence.split()) for sentence in re.split(r"[.;:] ", text)) <= 30
    assert len(set(captions)) == len(captions)


def test_a_single_surface_has_no_band_and_a_measured_one_no_D() -> None:
    assert "band" in ALL["fig04a"].words()
    text = ALL["fig04a"].words(surfaces=1, measured=True)
    assert "band" not in text
    assert "dimension D" not in text


def test_the_page_is_light_and_dark_prints_and_fits_a_phone(html: str) -> None:
    """Every table scrolls in its own box, but for those that turn into cards, whose cells name their columns."""
    for rule in ("prefers-color-scheme: dark", "@media print", "figure.plot:target"):
        assert rule in html
    for before, table in re.findall(r"(.{0,20})<table([^>]*)>", html):
        assert "class='box'>" in before or "verdicts" in table
    assert "table.verdicts td[data-head]::before" in html
    assert html.count("data-head='Why'") == len(re.findall(r"<td class='n'>\d+</td><td><a", html))


@pytest.mark.parametrize(
    ("kernel", "words"), [("love", "Certified error of p*"), ("punch", "Bound of the error of p*")]
)
def test_a_bound_is_certified_where_it_is_proved_for_the_kernel(kernel: str, words: str, tmp_path: Path) -> None:
    study = loads(f"surface: {{D: 2.3, m: 3, seeds: 1}}\nsweep: {{steps: 2}}\nsolver: {{kernel: {kernel}}}")
    found = dict(run_facts.facts(ClaimRun.of("s", roughvol.run(study, out=tmp_path, jobs=1))).loading)
    assert found[words].endswith("relative" if kernel == "love" else "; not proved for the kernel punch")
