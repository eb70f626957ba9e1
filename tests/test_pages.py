"""The pages: tables name their command and version and agree with stored numbers; what a page names exists."""

import contextlib
import functools
import importlib
import inspect
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np
import pytest

from roughvol import __version__, study
from roughvol.campaign import one_case
from roughvol.store import dataset, run_folder, stamped_file
from roughvol.store.dataset import Dataset
from tests.bench import solver, tables
from tests.extremes.__main__ import HEAD, TAIL
from tests.extremes.matrix import CELLS
from tests.kit import said

ROOT = Path(__file__).parents[1]
MINOR = tables.minor(__version__)
DOCS = [path.relative_to(ROOT).as_posix() for path in sorted(ROOT.glob("docs/**/*.md"))]
PROSE = ["README.md", "CONTRIBUTING.md", *DOCS]
NOTES = "docs/explanation/notes"
PAGES = {
    "docs/explanation/performance.md",
    *(f"{NOTES}/{name}.md" for name in ("extremes", "tradeoff", "sides", "store-decision")),
}


def _text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_no_measured_table_is_of_an_older_minor_version() -> None:
    found = list(tables.marks())
    assert {page.relative_to(ROOT).as_posix() for page, _ in found} >= PAGES
    assert [f"{page.name}: {mark[0].strip()}" for page, mark in found if tables.minor(mark[2]) != MINOR] == []


def test_measured_tables_name_a_command_that_exists_and_a_table_follows() -> None:
    for page, mark in tables.marks():
        words = mark[1].split()
        if words[0] == "make":
            assert re.search(rf"^{words[1]}:", _text("Makefile"), re.MULTILINE)
        else:
            assert words[:2] == ["python", "-m"]
            assert (ROOT / f"{words[2].replace('.', '/')}.py").is_file()
        text = page.read_text(encoding="utf-8")
        assert f"`{mark[1]}`" in text
        assert mark[1] in tables.WHOLE or tables.TABLE.match(text, mark.end()), mark[0]


def test_a_table_is_replaced_with_the_version_that_made_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page, one = tmp_path / "docs" / "page.md", "| a |\n|---|\n| {} |\n"
    page.parent.mkdir()
    old = "<!-- made by: make it, roughvol 0.1.2 -->\n\n"
    page.write_text(f"A.\n\n{old}{one.format(1)}\nB.\n\n{old}{one.format(2)}\nC.\n")
    monkeypatch.setattr(tables, "ROOT", tmp_path)
    assert tables.old() == ["make it"]
    with pytest.raises(SystemExit, match="prints 1 tables for 2 marks"):
        tables.put("make it", one.format(3))
    tables.put("make it", f"seconds\n{one.format(3)}and\n{one.format(4)}and\n{one.format(5)}")
    new = old.replace("0.1.2", __version__)
    assert page.read_text() == f"A.\n\n{new}{one.format(3)}\nB.\n\n{new}{one.format(4)}\nC.\n"
    assert tables.old() == []


def test_the_counts_of_the_page_of_performance_are_those_stored() -> None:
    rows = re.findall(r"^\| (?:free \| )?(\d+) \| (1e-\d\d) \| ([\d.]+) \| ([\d.]+) \|", _speed(), re.MULTILINE)
    stored = [row for row in json.loads(solver.BASELINE.read_text(encoding="utf-8")) if row["kernel"] == "free"]
    assert len(rows) == 14
    for m, rtol, *counts in rows:
        same = [row for row in stored if (row["m"], row["rtol"]) == (int(m), float(rtol))]
        assert len(same) == 6  # D = 2.1, 2.5, 2.9 and two seeds
        assert counts == [f"{np.mean([row[kind] for row in same]):.2f}" for kind in ("fp64", "fp32")], (m, rtol)


def _speed() -> str:
    text = _text("docs/explanation/performance.md")
    return text[text.index("| m | η/σ ≤ |") :]


def test_the_readme_rounds_the_seconds_of_the_page_of_performance() -> None:
    (sentence,) = re.findall(r"take ([\d.]+) s on 257² nodes and ([\d.]+) s on 1025²", _text("README.md"))
    seconds = dict(re.findall(r"^\| (?:free \| )?(\d+) \| 1e-06 \|(?:[^|]*\|){4} ([\d.]+) \|", _speed(), re.MULTILINE))
    assert [float(number) for number in sentence] == [float(f"{float(seconds[m]):.1g}") for m in ("8", "10")]


def test_the_page_of_extremes_is_as_its_command_writes_it() -> None:
    page = tables.MARK.sub("", _text(f"{NOTES}/extremes.md"))
    head = tables.MARK.sub("", HEAD)
    assert page.startswith(head)
    assert page.endswith(TAIL)
    rows = page[len(head) : -len(TAIL)].splitlines()
    assert [tuple(row.split(" | ")[:2]) for row in rows] == [(f"| {cell.group}", cell.name) for cell in CELLS]


def test_what_other_pages_take_from_the_page_of_the_tradeoff_is_there() -> None:
    page, text = _text(f"{NOTES}/tradeoff.md"), " ".join(_text("docs/explanation/performance.md").split())
    (saved,) = re.findall(r"\*\*Ten times less accuracy costs (\d+) per cent less time\.\*\*", page)
    assert f"**Ten times less accuracy costs {saved} per cent less time**" in text
    assert f"Ten times less accuracy costs {saved} per cent less time (`make tradeoff`)" in _text("README.md")
    counts = dict(re.findall(r"^\| ([^|]+) \| (\d+) \|", page, re.MULTILINE))
    for name, sentence in {
        "the state at A* = 0.1, by search": "takes {} convolutions",
        "the state at p* = 1, by search": "at p* = 1 takes {}",
        "the state where the void closes, by search": "the closing of the last channel {}",
        "60 states, numbers only": "60 states to d = 0 take {}",
    }.items():
        assert sentence.format(counts[name]) in text


def test_the_readme_is_short_and_leads_to_each_group() -> None:
    text = _text("README.md")
    assert len(text.splitlines()) <= 90
    groups = set(re.findall(r"\]\(docs/([a-z-]+)/index\.md\)", text))
    assert groups == {"tutorials", "how-to", "reference", "explanation"}


def _in_prose(pattern: str) -> set[tuple[str, str]]:
    """Return the pages that have a pattern, each with its text."""
    return {(page, found) for page in PROSE for found in re.findall(pattern, _text(page))}


def test_links_of_pages_lead_somewhere() -> None:
    links = {(page, link) for page, link in _in_prose(r"\]\(([^)\s#]+)") if not link.startswith("https:")}
    assert [(page, link) for page, link in links if not ((ROOT / page).parent / link).exists()] == []


def test_modules_and_folders_that_pages_name_exist() -> None:
    paths = [path for folder in ("roughvol", "tests") for path in (ROOT / folder).rglob("*")]
    files = [f"/{path.relative_to(ROOT).as_posix()}" for path in paths]
    named = _in_prose(r"`((?:[\w./]+/)?[a-z_]+\.py|(?:roughvol|tests|docs|configs)/[\w./-]*)`")
    missing = [(page, name) for page, name in named if not (ROOT / name).exists()]
    assert [at for at in missing if not any(file.endswith(f"/{at[1].rstrip('/')}") for file in files)] == []


def test_targets_of_make_that_pages_name_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", _text("Makefile"), re.MULTILINE))
    assert [named for named in _in_prose(r"`make ([a-z-]+)`") if named[1] not in targets] == []


def test_slow_tests_that_pages_name_exist() -> None:
    pages = " ".join(word for page in PROSE for word in _text(page).split())
    texts = [f"{path}\n{path.read_text(encoding='utf-8')}" for path in ROOT.glob("tests/**/test_*.py")]
    for words in re.findall(r"`pytest -m slow ([^`]+)`", pages):
        pattern = re.sub(r"^-k (\w+)$", r"def \\w*\1", words)
        assert any("mark.slow" in text and re.search(pattern, text) for text in texts), words


def test_make_help_describes_every_target() -> None:
    phony = re.findall(r"[a-z-]+", _text("Makefile").partition(".PHONY:")[2].partition("\n")[0])
    shown = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60).stdout
    assert re.findall(r"^  make ([a-z-]+) +\w", shown, re.MULTILINE) == sorted(set(phony), key=phony.index)


def test_the_hooks_run_the_linters_of_make_lint() -> None:
    lint = _text("Makefile").partition("\nlint: ")[2].partition("\n\n")[0]
    tools = re.findall(r"\$\(BIN\)/(\w+ ?[a-z]*)", lint)
    hooks = re.findall(r"entry: \.venv/bin/(\w+ ?[a-z]*)", _text(".pre-commit-config.yaml"))
    assert [name.strip() for name in hooks] == [name.strip() for name in tools]


NAMES = re.compile(r"`((?:campaign|cli|contact|errors|gap|observables|report|store|study|surfaces)(?:\.\w+)+)`")


def _object(name: str) -> Any:
    """Return the object of a dotted name without ``roughvol.``."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        with contextlib.suppress(ModuleNotFoundError):
            module = importlib.import_module(".".join(["roughvol", *parts[:count]]))
            return functools.reduce(getattr, parts[count:], module)
    raise AttributeError(name)


@pytest.mark.parametrize("page", ["docs/explanation/architecture.md", "CONTRIBUTING.md", "docs/explanation/solver.md"])
def test_functions_that_a_page_names_exist(page: str) -> None:
    for name in re.findall(NAMES, _text(page)):
        if not name.endswith((".py", ".md", ".nc")):
            assert _object(name) is not None


def test_names_that_the_recipes_find_in_a_file_are_there() -> None:
    text = " ".join(_text("CONTRIBUTING.md").split())
    named = re.findall(r"`(\w+)` (?:of|in) `([\w/]+\.py)`", text)
    assert len(named) >= 10
    for name, file in named:
        path = next(path for path in (ROOT / file, ROOT / "roughvol" / file) if path.is_file())
        assert re.search(rf"\b{name}\b", path.read_text(encoding="utf-8")), f"{name} is not in {file}"


def test_the_life_of_a_study_passes_its_stations_in_order(tmp_path: Path) -> None:
    rows = re.findall(r"^\| (\d+) \| `([\w.]+)`", _text("docs/explanation/architecture.md"), re.MULTILINE)
    assert [int(number) for number, _ in rows] == list(range(1, len(rows) + 1))
    assert len(rows) <= 15
    worker = re.search(r"Stations (\d+) to (\d+) run in a worker", _text("docs/explanation/architecture.md"))
    assert worker
    first, last = map(int, worker.groups())
    codes = [_code(name) for _, name in rows]
    (tmp_path / "tiny.yaml").write_text("surface: {D: 2.5, m: 2, seeds: 2}\nsweep: {steps: 1}\n")
    arguments = ("run", tmp_path / "tiny.yaml", "--jobs", "1", "--out", tmp_path / "tiny")
    (case, _) = study.load(tmp_path / "tiny.yaml").cases()
    made: list[Dataset] = []
    there = _calls(lambda: made.append(one_case.run_case(case)))
    stamped_file.make_folder(tmp_path / "tiny" / "cases")
    stamped_file.store(run_folder.case_file(tmp_path / "tiny", case.id), dataset.to_bytes(made[0]))
    here = _calls(lambda: said(*arguments))
    assert _not_passed(codes[first - 1 : last], there) == []
    assert _not_passed(codes[: first - 1] + codes[last:], here) == []


def _not_passed(stations: list[CodeType], called: list[CodeType]) -> list[CodeType]:
    """Return the stations that are left when calls have passed the others in their order."""
    return functools.reduce(lambda left, code: left[1:] if left[:1] == [code] else left, called, stations)


def _code(name: str) -> CodeType:
    function = getattr(_object(name), "callback", _object(name))  # of a command
    return inspect.unwrap(function).__code__


def _calls(function: Callable[[], Any]) -> list[CodeType]:
    """Return the code of every function called, in order."""
    called: list[CodeType] = []
    before = sys.getprofile()
    sys.setprofile(lambda frame, event, _: called.append(frame.f_code) if event == "call" else None)
    try:
        function()
    finally:
        sys.setprofile(before)
    return called
