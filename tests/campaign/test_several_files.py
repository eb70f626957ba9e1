"""Several height files in one study: each is a case."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import roughvol
from roughvol.cli import main
from roughvol.errors import StudyError
from roughvol.study import load, loads
from roughvol.study.sections import height_file

TEXT = "surface: {files: maps/*.npy, L: 100 um}\nmaterial: {E_star: 10 MPa}\nsweep: {pressures: [0.05 MPa, 0.1 MPa]}\n"


@pytest.fixture(autouse=True)
def _maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("maps").mkdir()
    for k, shape in enumerate(((9, 9), (9, 9), (9, 12))):
        np.save(f"maps/m{k}.npy", np.random.default_rng(k).random(shape))
    Path("several.yaml").write_text(TEXT, encoding="utf-8")


def test_each_file_is_the_case_that_it_is_alone() -> None:
    cases = load("several.yaml").cases()
    alone = [loads(TEXT.replace("files: maps/*.npy", f"file: maps/m{k}.npy"), "x.yaml").cases()[0] for k in range(3)]
    assert [case.id for case in cases] == [case.id for case in alone]
    ds = roughvol.run("several.yaml", jobs=1)
    assert ds.case.values.tolist() == ["m0.npy", "m1.npy", "m2.npy"]
    np.testing.assert_allclose(ds.mean_pressure * ds.Sq / 100.0 * 10.0, [[0.05, 0.1]] * 3, rtol=2e-5)
    one = roughvol.run(loads(TEXT.replace("files: maps/*.npy", "file: maps/m2.npy"), "one.yaml"), jobs=1)
    assert (one.free_volume.sel(case="m2.npy") == ds.free_volume.sel(case="m2.npy")).all()
    assert [entry["file"] for entry in json.loads(ds.attrs["height_files"])] == ds.case.values.tolist()


def test_a_further_file_is_a_further_case() -> None:
    roughvol.run("several.yaml", jobs=1)
    np.save("maps/m9.npy", np.random.default_rng(9).random((9, 9)))
    done = CliRunner().invoke(main, ["run", "several.yaml", "--jobs", "1"])
    assert done.exit_code == 0, done.output
    assert "4 cases in " in done.stdout
    assert "3 of them finished before" in done.stdout
    for name in ("several", "several.yaml"):
        assert "4 of 4 cases finished, collected" in CliRunner().invoke(main, ["status", name]).stdout
    assert CliRunner().invoke(main, ["plot", "several", "v_of_p"]).exit_code == 0


@pytest.mark.parametrize(
    ("surface", "part"),
    [
        ("{files: nothing/*.npy, L: 1 um}", "no file matches"),
        ("{files: '**/../**', L: 1 um}", "surface.files: has '..' behind"),
        ("{files: 's*/../*.npy', L: 1 um}", "surface.files: has '..' behind"),
        ("{files: [maps/m0.npy, maps/none.npy], L: 1 um}", "no such file"),
        ("{files: maps/*.npy}", "does not give the length"),
        ("{files: maps/*.npy, file: maps/other.npy, L: 1 um}", "give one of them"),
        ("{files: [maps/m0.npy, maps/../maps/m0.npy], L: 1 um}", "two files have one name"),
        ("{files: 3, L: 1 um}", "must be a pattern or a list of files"),
    ],
)
def test_files_that_make_no_cases_are_refused(surface: str, part: str) -> None:
    with pytest.raises(StudyError) as refused:
        loads(f"surface: {surface}\nsweep: {{steps: 1}}\n", "several.yaml").cases()
    assert part in str(refused.value)


def test_a_pattern_may_begin_above_the_study(tmp_path: Path) -> None:
    (tmp_path / "studies").mkdir()
    np.save(tmp_path / "a.npy", np.eye(4))
    study = loads("surface: {files: '../*.npy', L: 1 um}", tmp_path / "studies" / "s.yaml")
    assert [Path(case.bodies[0].file).name for case in study.cases()] == ["a.npy"]


def test_a_pattern_of_too_many_files_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(height_file, "MOST_FILES", 2)
    for name in "abc":
        np.save(tmp_path / f"{name}.npy", np.eye(4))
    with pytest.raises(StudyError, match=r"surface\.files: matches more than 2 files"):
        loads("surface: {files: '*.npy', L: 1 um}", tmp_path / "s.yaml")


STRANGE = ("=cmd|calc.npy", "@SUM(A1).npy", "+1.npy", "<img src=x onerror=alert(1)>.npy", "<b>\\<i>.npy", "plain.npy")


def test_names_of_files_are_neither_formulas_nor_elements_of_pages() -> None:
    for number, name in enumerate(STRANGE):
        np.save(name, np.random.default_rng(number).random((9, 9)))
    surface = f"{{files: {json.dumps(list(STRANGE))}, L: 100 um}}"
    roughvol.run(loads(f"name: strange\nsurface: {surface}\nsweep: {{steps: 2}}\n", "strange.yaml"), jobs=1)
    shown = CliRunner().invoke(main, ["show", "strange", "--csv"])
    assert shown.exit_code == 0
    rows = list(csv.DictReader(io.StringIO(shown.stdout)))
    names = {row["case"] for row in rows}
    assert names == {f"'{name}" if name[0] in "=@+" else name for name in STRANGE}
    assert any(float(row["separation"]) < 0.0 for row in rows)  # negative numbers stay numbers
    assert CliRunner().invoke(main, ["report", "strange", "--out", "page"]).exit_code == 0
    for page in ("report.md", "report.html"):
        text = Path("page", page).read_text(encoding="utf-8")
        assert "onerror" in text
        assert not re.search(r"(?<!\\)(?:\\\\)*<(?:img src=x|b>|i>\.npy)", text)
