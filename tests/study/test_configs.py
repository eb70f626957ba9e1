"""Every study file that is shipped can be run, and is called what its file is called."""

from __future__ import annotations

from pathlib import Path

import pytest

from roughvol.study import load, loads

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))


def test_the_papers_studies_are_there() -> None:
    assert {"smoke", "gallery", "effect_of_D", "effect_of_m", "morphology"} <= {path.stem for path in CONFIGS}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_config_loads(path: Path) -> None:
    study = load(path)
    assert study.name == path.stem
    assert len({case.id for case in study.cases()}) == len(study.cases()) > 0


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_resolved_config_is_the_same_study(path: Path) -> None:
    study = load(path)
    assert loads(study.to_yaml()) == study
