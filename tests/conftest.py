"""What several test modules share."""

from __future__ import annotations

from pathlib import Path

import pytest

from roughvol.campaign import running


@pytest.fixture(scope="session")
def small_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stored answer (study.nc) of tests/regression/small.yaml."""
    folder = tmp_path_factory.mktemp("runs") / "small"
    running.run(Path(__file__).parent / "regression" / "small.yaml", out=folder, jobs=2)
    return folder / "study.nc"
