"""Former spellings: taken with the new one in a warning, then refused with it."""

import importlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import roughvol.contact
from roughvol import plotting, spellings
from roughvol.errors import DatasetError, RoughvolDeprecation, StudyError
from roughvol.spellings import FORMER, Former
from roughvol.study import loads, of_data
from roughvol.study.reference import keys
from roughvol.surfaces import Surface
from tests import public_names
from tests.kit import call, refused, succeeded

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


@pytest.mark.usefixtures("here")
def test_a_command_warns_once_and_a_run_of_its_own_does_not() -> None:
    Path("old.yaml").write_text(STUDY % ", periodic: true", encoding="utf-8")
    done = succeeded("run", "old.yaml")
    assert done.stderr.count("warning: old.yaml:1: surface.periodic: ") == 1
    stored = Path("runs/old/study.yaml")
    stored.write_text(stored.read_text(encoding="utf-8").replace("sides: periodic", "periodic: true"), encoding="utf-8")
    assert "former" not in call("check", "old").stderr


def test_what_left_is_refused_with_the_new_spelling(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(StudyError, match=r"2: sweep\[1\].steps: left with version 0.13.0; in its place: a number"):
        loads(STUDY[:-19] % "" + "\nsweep: [{steps: 3, to: {pressure: 1}}, {steps: auto, to: {pressure: 2}}]", "s.yaml")
    assert "--pressure left with version 0.14.0; in its place: --at" in refused("ask", "run", "--pressure", "1 MPa")
    assert "--out left" in refused("ls", "--out=folder")
    with pytest.raises(DatasetError, match=r"figure 'answer_cost' left with version 0\.13\.0"):
        plotting.check_known(["answer_cost"])
    with pytest.warns(RoughvolDeprecation, match="HalfSpace"), pytest.raises(AttributeError, match="left with"):
        _ = roughvol.contact.PeriodicHalfSpace
    _known(monkeypatch, replace(PERIODIC, until="0.1.0"))
    with pytest.raises(StudyError, match=r"surface.periodic: left with version 0.1.0; in its place: surface"):
        loads(STUDY % ", periodic: true")


@pytest.mark.usefixtures("here")
def test_a_former_option_and_name_work_with_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    _known(
        monkeypatch,
        Former("option", "check --change", "--set", "1.0.0", LATER),
        Former("name", "roughvol.contact.Body", "roughvol.contact.HalfSpace", "1.0.0", LATER),
    )
    Path("s.yaml").write_text(STUDY % "", encoding="utf-8")
    for words in (("--change", "surface.m=4"), ("--change=surface.m=4",)):
        done = succeeded("check", "s.yaml", *words)
        assert f"warning: --change is the former spelling of --set, and works until version {LATER}" in done.stderr
        assert "17 x 17 nodes" in done.stdout
    with pytest.warns(RoughvolDeprecation, match="contact.Body is the former spelling of roughvol.contact.H"):
        assert roughvol.contact.Body is roughvol.contact.HalfSpace


ARGUMENTS = [(row, *row.old.rstrip(")").split("(")) for row in FORMER if row.old.endswith(")")]


@pytest.mark.parametrize(("row", "made", "name"), ARGUMENTS, ids=[row.old for row, _, _ in ARGUMENTS])
def test_a_former_argument_is_refused_with_the_new_one(row: Former, made: str, name: str) -> None:
    module, _, last = made.rpartition(".")
    words = f"{last}: argument {name} left with version {row.until}; in its place: {row.new}"
    with pytest.raises(TypeError, match=f"^{re.escape(words)}$"):
        getattr(importlib.import_module(module), last)(**{name: None})


def test_a_former_argument_that_works_is_the_new_one_with_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    row = Former("name", "roughvol.surfaces.Surface(ends)", "sides", "1.0.0", LATER, {"open": "free"})
    _known(monkeypatch, row)
    heights = np.eye(3)
    words = f"Surface: argument ends is the former spelling of sides, and works until version {LATER}"
    with pytest.warns(RoughvolDeprecation, match=words) as said:
        assert Surface(heights, 1.0, ends="open").sides == "free"
    assert [one.filename for one in said] == [__file__]
    with pytest.warns(RoughvolDeprecation):
        assert Surface(heights, 1.0, ends="mirrored").sides == "mirrored"
    with pytest.warns(RoughvolDeprecation), pytest.raises(TypeError, match=r"multiple values for .*'sides'"):
        Surface(heights, 1.0, ends="open", sides="free")


def test_former_spellings_are_former() -> None:
    """No row hides a public name, and a new key is one of the schema."""
    known = {key.path for key in keys()}
    for row in FORMER:
        if row.kind == "key":
            assert "=" in row.old or row.old not in known
            assert row.new in known or not row.works
        if row.kind == "name":
            assert row.old not in public_names.stored()["name"]
            assert row.old.rpartition(".")[2] not in dir(roughvol.contact)
