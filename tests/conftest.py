"""What several test modules share: where tests compute, and one stored run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_limits

from roughvol.campaign import execution, workers
from roughvol.report.figures.style import Drawing

SAVED = Drawing.savefig


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> Iterator[None]:
    """Take one thread for linear algebra: with small matrices, several threads mostly wait for each other."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session", autouse=True)
def _in_this_process() -> Iterator[None]:
    """Compute in this process, also in fixtures: starting a worker takes longer than most cases here."""
    with workers.in_this_process():
        yield


@pytest.fixture(autouse=True)
def _in_processes_where_marked(request: pytest.FixtureRequest) -> Iterator[None]:
    with workers.in_this_process(request.node.get_closest_marker("processes") is None):
        yield


@pytest.fixture(scope="session", autouse=True)
def _quick_figures() -> Iterator[None]:
    """Save figures coarsely, without a layout, and PDF blank: layout and fonts take most of their time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Drawing, "savefig", _saved_quickly)
        yield


@pytest.fixture(autouse=True)
def _figures_with_layout_where_marked(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.node.get_closest_marker("layout") is not None:
        monkeypatch.setattr(Drawing, "savefig", SAVED)


def _saved_quickly(figure: Drawing, file: Any, **options: Any) -> None:
    if str(file).endswith(".pdf"):
        figure = Drawing()  # the fonts of a PDF take a second
    figure._layout_engine = None  # "none" would leave a placeholder, for which matplotlib draws a figure twice
    SAVED(figure, file, **options | {"dpi": 40})


@pytest.fixture(scope="session")
def small_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stored answer (study.nc) of tests/regression/small.yaml."""
    folder = tmp_path_factory.mktemp("runs") / "small"
    execution.run(Path(__file__).parent / "regression" / "small.yaml", out=folder, jobs=2)
    return folder / "study.nc"
