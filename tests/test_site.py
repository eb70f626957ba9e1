"""The documentation site: every page has one place, notebooks carry no outputs, nothing comes from elsewhere."""

import itertools
import re
from collections import Counter
from pathlib import Path

import pytest

from roughvol.cli.group import GROUPS
from tests.kit import call

COMMANDS = [name for rows in GROUPS.values() for name in rows]
DOCS = Path(__file__).parents[1] / "docs"


def _entries(page: Path) -> list[str]:
    """Return the pages of the tables of contents of a page, relative to docs/, without suffix."""
    text = page.read_text(encoding="utf-8")
    bodies = re.findall(r"^```\{toctree\}\n(.*?)```", text, re.MULTILINE | re.DOTALL)
    names = [line for body in bodies for line in body.split() if not line.startswith(":") and not line.isdigit()]
    return [(page.parent / name).resolve().relative_to(DOCS).as_posix() for name in names]


def test_every_page_is_in_one_group() -> None:
    """A page has one line in the index.md of its folder."""
    pages = {page.relative_to(DOCS).with_suffix("").as_posix(): _entries(page) for page in DOCS.rglob("*.md")}
    assert Counter(itertools.chain(*pages.values())) == dict.fromkeys(pages.keys() - {"index"}, 1)


def test_the_site_copies_no_page_of_the_repository() -> None:
    included = {
        "reference/files": "runs/README",
        "reference/changes": "CHANGELOG",
        "explanation/contributing": "CONTRIBUTING",
    }
    for name, outside in included.items():
        text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
        assert text.startswith(f"```{{include}} ../../{outside}.md\n")
        assert len(text.splitlines()) <= 3


@pytest.mark.parametrize("name", ["ensemble", "my-scan", "reproduce"])
def test_a_notebook_is_text_without_outputs_and_its_cells_are_python(name: str) -> None:
    text = (DOCS / "tutorials" / f"{name}.md").read_text(encoding="utf-8")
    assert text.startswith("---\nfile_format: mystnb\n")
    cells = re.findall(r"^```\{code-cell\} ipython3\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len(cells) >= 4
    for cell in cells:
        compile(cell, f"{name}.md", "exec")


def test_press_takes_five_lines() -> None:
    text = (DOCS / "tutorials" / "my-scan.md").read_text(encoding="utf-8")
    (cell,) = (cell for cell in re.findall(r"ipython3\n(.*?)^```", text, re.M | re.S) if "roughvol.press(" in cell)
    assert len(cell.splitlines()) == 5
    assert 'E="10 MPa", to={"pressure": "0.5 MPa"}' in cell


def test_the_first_tutorial_has_commands_that_exist() -> None:
    text = (DOCS / "tutorials" / "first-study.md").read_text(encoding="utf-8")
    named = set(re.findall(r"^roughvol (\w+)", text, re.MULTILINE))
    assert {"init", "run", "show", "plot", "compare"} <= named <= set(COMMANDS)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_answers_in_the_shells_that_its_page_names(shell: str) -> None:
    page = (DOCS / "how-to" / "completion.md").read_text(encoding="utf-8")
    assert f"_ROUGHVOL_COMPLETE={shell}_source roughvol" in page
    asked = {"_ROUGHVOL_COMPLETE": f"{shell}_complete", "COMP_WORDS": "roughvol sh", "COMP_CWORD": "1"}
    if shell == "fish":
        asked["COMP_CWORD"] = "sh"
    answer = call(env=asked, prog_name="roughvol")
    assert "show" in answer.stdout
    assert "schema" not in answer.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_an_example_of_itself(name: str) -> None:
    shown = call(name, "--help", prog_name="roughvol").output
    _, _, examples = shown.partition("Examples:")
    assert re.search(rf"^ +roughvol {name}\b", examples, re.MULTILINE), shown
