"""Former spellings: taken with the new one in a warning, then refused with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import roughvol.contact
import roughvol.surfaces
from roughvol import spellings
from roughvol.errors import RoughvolDeprecation, StudyError
from roughvol.spellings import FORMER, Former
from roughvol.study import loads, of_data
from roughvol.study.reference import keys
from tests.kit import call, refused

STUDY = "surface: {D: 2.3, m: 3, seeds: 1%s}\nsweep: {steps: 0}\n"
LATER = "99.0.0"
PERIODIC = spellings.former("key", "surface.periodic")


def _known(monkeypatch: pytest.MonkeyPatch, *rows: Former) -> None:
    monkeypatch.setattr(spellings, "FORMER", rows)


@pytest.mark.parametrize(("word", "sides"), [("true", "periodic"), ("false", "free")])
def test_a_former_key_is_the_new_one_with_a_warning(word: str, sides: str) -> None:
    place = f"s.yaml:1: surface.periodic: .*surface.sides, .*until version 2.0.0: write sides: {sides}$"
    with pytest.warns(RoughvolDeprecation, match=place) as said:
        study = loads(STUDY % f", periodic: {word}", "s.yaml")
    assert [one.filename for one in said] == [__file__]
    assert study == loads(STUDY % f", sides: {sides}", "s.yaml")
    with pytest.warns(RoughvolDeprecation, match=r'study\["surface"\]\["periodic"\]: is the former'):
        of_data({"surface": {"D": 2.3, "m": 3, "periodic": word == "true"}})
    with pytest.warns(RoughvolDeprecation):
        assert study.changed(**{"surface.periodic": word == "true"}).surface.sides == sides
    with pytest.warns(RoughvolDeprecation):
        assert loads(STUDY % ", sides: mirrored", changes=[f"surface.periodic={word}"]).surface.sides == sides


def test_both_spellings_agree() -> None:
    for word, sides in (("true", "free"), ("true", "mirrored"), ("false", "periodic")):
        with pytest.raises(StudyError, match=f"surface.sides: contradicts periodic: {word}; give sides alone"):
            loads(STUDY % f", periodic: {word}, sides: {sides}")
    with pytest.warns(RoughvolDeprecation):
        assert loads(STUDY % ", periodic: true, sides: periodic").surface.sides == "periodic"


def test_a_command_warns_once_and_a_run_of_its_own_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("old.yaml").write_text(STUDY % ", periodic: true", encoding="utf-8")
    done = call("run", "old.yaml")
    assert done.exit_code == 0, done.output
    assert done.stderr.count("warning: old.yaml:1: surface.periodic: ") == 1
    stored = Path("runs/old/study.yaml")
    stored.write_text(stored.read_text(encoding="utf-8").replace("sides: periodic", "periodic: true"), encoding="utf-8")
    assert "former" not in call("check", "old").stderr


def test_what_left_is_refused_with_the_new_spelling(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(StudyError, match=r"2: sweep\[1\].steps: left with version 0.13.0; in its place: a number"):
        loads(STUDY[:-19] % "" + "\nsweep: [{steps: 3, to: {pressure: 1}}, {steps: auto, to: {pressure: 2}}]", "s.yaml")
    assert "--pressure left with version 0.14.0; in its place: --at" in refused("ask", "run", "--pressure", "1 MPa")
    assert "--out left" in refused("ls", "--out=folder")
    assert "figure 'answer_cost' left with version 0.13.0" in _plotted("answer_cost", monkeypatch)
    with pytest.warns(RoughvolDeprecation, match="HalfSpace"), pytest.raises(AttributeError, match="left with"):
        _ = roughvol.contact.PeriodicHalfSpace
    assert PERIODIC is not None
    _known(monkeypatch, replace(PERIODIC, until="0.1.0"))
    with pytest.raises(StudyError, match=r"surface.periodic: left with version 0.1.0; in its place: surface"):
        loads(STUDY % ", periodic: true")


def _plotted(figure: str, monkeypatch: pytest.MonkeyPatch) -> str:
    from roughvol import plotting
    from roughvol.errors import DatasetError

    with pytest.raises(DatasetError) as error:
        plotting.check_known([figure])
    return str(error.value)


def test_a_former_option_and_name_work_with_a_warning(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    _known(
        monkeypatch,
        Former("option", "check --change", "--set", "1.0.0", LATER),
        Former("name", "roughvol.contact.Body", "roughvol.contact.HalfSpace", "1.0.0", LATER),
    )
    Path("s.yaml").write_text(STUDY % "", encoding="utf-8")
    for words in (("--change", "surface.m=4"), ("--change=surface.m=4",)):
        done = call("check", "s.yaml", *words)
        assert done.exit_code == 0, done.output
        assert f"warning: --change is the former spelling of --set, and works until version {LATER}" in done.stderr
        assert "17 x 17 nodes" in done.stdout
    with pytest.warns(RoughvolDeprecation, match="contact.Body is the former spelling of roughvol.contact.H"):
        assert roughvol.contact.Body is roughvol.contact.HalfSpace


@pytest.mark.parametrize("made", [roughvol.contact.HalfSpace, roughvol.surfaces.Surface])
def test_a_former_argument_is_refused_with_the_new_one(made):
    words = rf'{made.__name__}: argument periodic left with version 0.16.0; in its place: sides="free" or "periodic"'
    with pytest.raises(TypeError, match=words):
        made((5, 5), periodic=True)


def test_former_spellings_are_former() -> None:
    """No row hides a public name, and a new key is one of the schema."""
    known = {key.path for key in keys()}
    for row in FORMER:
        if row.kind == "key":
            assert "=" in row.old or row.old not in known
            assert row.new in known or not row.works
        if row.kind == "name":
            assert row.old.rpartition(".")[2] not in dir(roughvol.contact)
