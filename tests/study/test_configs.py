"""Every study file that is shipped can be run, and is called what its file is called."""

from __future__ import annotations

from pathlib import Path

import pytest

from roughvol.study import load, loads

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))


def test_the_papers_studies_are_there() -> None:
    assert {"smoke", "gallery", "effect_of_D", "effect_of_m", "morphology"} <= {path.stem for path in CONFIGS}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_shipped_study_loads_and_is_the_same_when_resolved(path: Path) -> None:
    study = load(path)
    assert study.name == path.stem
    assert len({case.id for case in study.cases()}) == len(study.cases()) > 0
    assert path.read_text(encoding="utf-8").startswith("# ")  # a line on what it feeds
    assert loads(study.to_yaml()) == study
