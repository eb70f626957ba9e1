"""A study changed by keys is the study of a file with these keys."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roughvol.errors import StudyError
from roughvol.study import Quantity, load, loads

TEXT = """
name: changed
surface: {D: 2.3, m: 4, L: 100 um, Sq: 1 um, seeds: [1, 2]}
material: {E_star: 10 MPa, hardness: 1 GPa}
sweep: {steps: 3, to: {pressure: 0.5 MPa}}
record: {fields_at: last}
"""


@pytest.mark.parametrize(
    ("keys", "changes"),
    [
        ({}, []),
        ({"surface.m": 5, "solver.kernel": "punch"}, ["surface.m=5", "solver.kernel=punch"]),
        ({"surface.seeds": np.arange(3)}, ["surface.seeds=[0, 1, 2]"]),
        ({"sweep.to.pressure": Quantity(2.0, "kPa")}, ["sweep.to.pressure=2 kPa"]),
        ({"material.hardness": None}, ["material.hardness=none"]),
        ({"record.region": "none", "material": [{"E_star": "1 MPa", "hardness": "none"}, {"E_star": "2 MPa"}]},
         ["record.region=null", "material=[{E_star: 1 MPa}, {E_star: 2 MPa, hardness: none}]"]),
        ({"material": {"E": [5.0, 10.0], "nu": 0.5}, "sweep.to": "mean-plane"},
         ["material={E: [5, 10], nu: 0.5}", "sweep.to=mean-plane"]),
        ({**dict.fromkeys(("sweep.to", "sweep.steps", "sweep.equal", "sweep.first")), "sweep.pressures": [0.1, 0.2]},
         ["sweep.to=null", "sweep.steps=null", "sweep.equal=null", "sweep.first=null", "sweep.pressures=[0.1, 0.2]"]),
        ({"record": None, "surface.seeds": None}, ["record=null", "surface.seeds=null"]),
        ({"record.transport.percolation": "every-step"}, ["record.transport.percolation=every-step"]),
    ],
)  # fmt: skip
def test_keys_change_a_study_as_they_change_a_file(keys: dict[str, Any], changes: list[str]) -> None:
    study = loads(TEXT)
    assert study.changed(**keys).to_yaml() == loads(TEXT, changes=changes).to_yaml()
    assert loads(TEXT, changes=keys).to_yaml() == loads(TEXT, changes=changes).to_yaml()
    assert loads(study.to_yaml(), changes=changes).to_yaml() == loads(TEXT, changes=changes).to_yaml()  # of a run
    assert study.to_yaml() == loads(TEXT).to_yaml()


@pytest.mark.parametrize(
    ("keys", "key", "words"),
    [
        ({"surface.m": 99}, "surface.m", "must be <= 13, given 99"),
        ({"surface.m": None}, "surface.m", "missing"),
        ({"surfaces.m": 4}, "surfaces", "unknown key; did you mean 'surface'?"),
        ({"sweep.steps": 0}, "record.fields_at", "no contact to record: sweep.steps is 0"),
        ({"surface.seeds[7]": 0}, "surface.seeds[7]", "surface.seeds has 2 items in the study"),
        ({"surface..m": 5}, "surface..m", "is no key of a study; allowed: a path, as surface.m"),
        ({"": 5}, "", "is no key of a study; allowed: a path, as surface.m"),
        ({"surface.file": "none.npy", "surface.D": None, "surface.m": None}, "surface.file", "no such file"),
        ({"material.E_star": object()}, "material.E_star", "must be text, a number, a path, a list or a mapping"),
    ],
)
def test_a_refused_change_names_its_key(keys: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(StudyError) as caught:
        loads(TEXT).changed(**keys)
    assert [words in problem.message for problem in caught.value.problems if problem.key == key] == [True]


def test_a_changed_study_of_a_file_keeps_its_file_and_its_lines(tmp_path: Path) -> None:
    np.save(tmp_path / "z.npy", np.arange(9.0).reshape(3, 3))
    (tmp_path / "a.yaml").write_text("surface:\n  file: z.npy\n  L: 1\n")
    study = load(tmp_path / "a.yaml").changed(**{"surface.level": "tilt"})
    assert study.cases()[0].id == load(tmp_path / "a.yaml", ["surface.level=tilt"]).cases()[0].id
    with pytest.raises(StudyError, match=r"a\.yaml:3: surface\.L: must be > 0"):
        study.changed(**{"surface.L": -1.0})


def test_keys_without_a_value_in_the_study_of_a_run_exclude_no_others() -> None:
    text = TEXT.replace("E_star: 10 MPa", "E: 10 MPa, nu: 0.3")
    changes = ["material.E=null", "material.nu=null", "material.E_star=5 MPa"]
    changed = loads(loads(text).to_yaml(), of_run="study.yaml", changes=changes)
    assert changed.to_yaml() == loads(text, changes=changes).to_yaml()


def test_a_wrong_key_of_the_file_keeps_its_line_under_a_change_inside() -> None:
    with pytest.raises(StudyError, match=r"changed.yaml:1: surfaces: unknown key"):
        loads("surfaces: {D: 2.3, m: 4}\n", "changed.yaml", changes=["surfaces.m=5"])
