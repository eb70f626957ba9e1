"""The crossing table: every cell is right or refused with its sentence, no cell is empty, and the page is current."""

import functools
from collections.abc import Callable
from types import ModuleType

import click
import pytest
import yaml

import roughvol
from roughvol.analysis.accessor import Accessor
from roughvol.cli import main
from roughvol.study import Study
from roughvol.study.sections.record import Record
from tests.crossing.kinds import BY_NAME, KINDS, write
from tests.crossing.questions import QUESTIONS, Made, Refused
from tests.crossing.table import CELLS, NOT_ASKED, PAGE, TOGETHER, cell, page
from tests.kit import said

PLACES = [(question, kind.name) for kind in KINDS for question in QUESTIONS]


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Made]:
    """Make a kind of run by its name, once, all in one folder."""
    folder = tmp_path_factory.mktemp("crossing")

    @functools.cache
    def make(name: str) -> Made:
        kind = BY_NAME[name]
        one = Made(kind, folder)
        write(folder, kind.files)
        (folder / kind.file).write_text(kind.study, encoding="utf-8")
        one.printed = said("run", folder / kind.file, "--jobs", "1", "--out", one.file.parent)
        write(folder, kind.afterwards)
        return one

    def with_its_neighbour(name: str) -> Made:
        make(BY_NAME[name].beside[0])
        return make(name)

    return with_its_neighbour


@pytest.mark.parametrize(("question", "kind"), PLACES, ids=[f"{kind}: {question}" for question, kind in PLACES])
@pytest.mark.usefixtures("few_samples", "small_grids")
def test_a_cell_is_right_or_refused_with_its_sentence(made: Callable[[str], Made], question: str, kind: str) -> None:
    (expected,) = cell(question, kind)
    if expected == "right":
        assert QUESTIONS[question](made(kind)) > 0, "no number was compared"
        return
    with pytest.raises(Refused) as refused:
        QUESTIONS[question](made(kind))
    assert expected in str(refused.value)


def test_no_cell_is_empty_and_none_has_two_entries() -> None:
    assert list(CELLS) == list(QUESTIONS)
    assert [place for place in PLACES if len(cell(*place)) != 1] == []
    named = {kind for cells in CELLS.values() for kind in (*cells.right.split(), *cells.refused)}
    assert named == set(BY_NAME)


def test_every_command_and_public_function_is_a_question_or_has_a_reason() -> None:
    names = {question.partition(" ")[0] for question in QUESTIONS}
    public = {name for name in roughvol.__all__ if not name.startswith("_")}
    modules = {name for name in public if isinstance(getattr(roughvol, name), ModuleType)}
    answering = {*main.list_commands(click.Context(main)), *(f"roughvol.{name}" for name in public - modules)}
    answering |= {f"ds.roughvol.{name}" for name in vars(Accessor) if not name.startswith("_")}
    assert answering == {*names, *TOGETHER, *NOT_ASKED}, (
        "give a new command or function a question, or a reason in NOT_ASKED"
    )
    assert not names & NOT_ASKED.keys()
    assert set(TOGETHER.values()) <= set(QUESTIONS)


def test_every_section_of_a_study_is_in_a_kind_of_run() -> None:
    studies = [yaml.safe_load(kind.study) for kind in KINDS]
    assert set().union(*studies) | {"name"} == set(Study.model_fields)
    assert set().union(*(study.get("record", {}) for study in studies)) == set(Record.model_fields)


def test_the_page_is_as_its_command_writes_it() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "make crossing writes it"
