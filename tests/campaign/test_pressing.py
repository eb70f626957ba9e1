"""From Python: a map pressed in one call, a study as a dict, a study with changes and from standard input."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

import roughvol
from roughvol.cli import main
from roughvol.errors import StudyError, SurfaceError
from roughvol.study import load, loads

TINY = "surface: {D: 2.3, m: 4, seeds: 1}\nsweep: {steps: 2, to: {indentation: 1}}\n"


@pytest.fixture(autouse=True)
def _empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def _heights() -> np.ndarray:
    x = np.linspace(0.0, 2.0 * np.pi, 17)
    return np.sin(x)[:, None] + np.cos(3.0 * x)[None, :]


def test_press_gives_numbers_in_units_and_leaves_nothing_on_disk() -> None:
    ds = roughvol.press(_heights(), L="500 um", E="10 MPa", nu=0.5, to={"pressure": "0.1 MPa"}, steps=4)
    assert_allclose(float(ds.nominal_pressure[-1]), 0.1, rtol=1e-5)
    assert ds.nominal_pressure.units == "MPa"
    assert ds.mean_gap.units == "um"
    assert_allclose(ds.mean_gap, ds.free_volume * ds.Sq)
    expected = 0.1 * 500 / (10 / 0.75 * float(ds.Sq))
    assert_allclose(float(ds.mean_pressure[-1]), expected, rtol=1e-5)
    assert os.listdir() == []  # noqa: PTH208


@pytest.mark.parametrize(
    ("heights", "options", "error"),
    [
        ([1.0, 2.0], {"L": 1}, SurfaceError),
        (_heights(), {"L": "5 apples"}, StudyError),
        (_heights(), {"L": 1, "E": 1, "E_star": 2}, StudyError),
        (_heights(), {"L": 1, "to": {"presure": 1}}, StudyError),
        (_heights() * np.nan, {"L": 1}, SurfaceError),
    ],
)
def test_press_refuses_what_is_no_map_or_no_study(heights: object, options: dict, error: type[Exception]) -> None:
    with pytest.raises(error):
        roughvol.press(heights, **options)  # type: ignore[arg-type]


def test_a_dict_is_a_study() -> None:
    data = {"name": "tiny", "surface": {"D": 2.3, "m": 4, "seeds": 1}, "sweep": {"steps": 2, "to": {"indentation": 1}}}
    ds = roughvol.run(data, jobs=1)
    again = roughvol.run(load_text(), out="other", jobs=1)
    assert (ds.free_volume.values == again.free_volume.values).all()
    assert Path("runs/tiny/study.nc").is_file()
    with pytest.raises(StudyError, match=r"surface\.D"):
        roughvol.run({"surface": {"D": 9, "m": 4}})
    with pytest.raises(StudyError, match="not plain data"):
        roughvol.run({"surface": {"D": np.array(2.3), "m": 4}})


def load_text() -> Path:
    path = Path("tiny.yaml")
    path.write_text(TINY, encoding="utf-8")
    return path


def test_changes_are_those_of_the_file() -> None:
    path = load_text()
    changed = load(path, ["surface.m=3", "sweep.to={pressure: 0.5}", "record.heights=true", "name=other"])
    text = TINY.replace("m: 4", "m: 3").replace("indentation: 1", "pressure: 0.5")
    assert changed == loads(f"name: other\nrecord: {{heights: true}}\n{text}")
    legs = loads(
        TINY.replace("{steps: 2, to: {indentation: 1}}", "[{steps: 2}, {to: {pressure: 0.1}}]"),
        changes=["sweep[1].steps=7"],
    )
    assert [leg.steps for leg in legs.sweep.legs] == [2, 7]


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ("surface.q=3", "--set: surface.q: unknown key"),
        ("surface.m=99", "--set: surface.m: must be <= 13"),
        ("surface.m", "must be KEY=VALUE"),
        ("surface.D.x=3", "surface.D is no mapping"),
        ("surface.D[0]=3", "surface.D is no list"),
        ("surface.m=[1", "not YAML"),
    ],
)
def test_a_change_without_meaning_is_refused(change: str, part: str) -> None:
    refused = CliRunner().invoke(main, ["run", str(load_text()), "--set", change])
    assert refused.exit_code == 2
    assert part in refused.stderr
    assert "Traceback" not in refused.output


def test_a_study_comes_from_standard_input() -> None:
    done = CliRunner().invoke(main, ["run", "-", "--set", "name=piped", "--jobs", "1"], input=TINY)
    assert done.exit_code == 0, done.output
    assert Path("runs/piped/study.nc").is_file()
    refused = CliRunner().invoke(main, ["check", "-"], input="surface: {D: 9, m: 3}")
    assert "<stdin>:1: surface.D" in refused.stderr


def test_a_comment_changes_no_case() -> None:
    one, other = loads(TINY), loads(TINY + "comment: the second try\n")
    assert [case.id for case in one.cases()] == [case.id for case in other.cases()]
    assert "comment" not in one.to_yaml()
    assert loads(other.to_yaml()) == other
