"""Progress in a notebook: one output, drawn again; nothing elsewhere and nothing of short runs."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import pytest

from roughvol.campaign import notebook, running
from roughvol.campaign.batch import Progress
from roughvol.study import loads


class _Shell:
    kernel = object()


class _Handle:
    def __init__(self, first: Any) -> None:
        self.texts = [repr(first)]

    def update(self, shown: Any) -> None:
        self.texts.append(repr(shown))


@pytest.fixture
def cells(monkeypatch: pytest.MonkeyPatch) -> list[_Handle]:
    """Outputs of an IPython kernel that this process takes itself for."""
    shown: list[_Handle] = []

    def display(first: Any, *, display_id: bool) -> _Handle:
        shown.append(_Handle(first))
        return shown[-1]

    module, inner = types.ModuleType("IPython"), types.ModuleType("IPython.display")
    module.get_ipython, inner.display = _Shell, display  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", module)
    monkeypatch.setitem(sys.modules, "IPython.display", inner)
    return shown


def test_a_run_draws_one_output_that_ends_at_all_cases(
    cells: list[_Handle], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(notebook, "AFTER", 0.0)
    running.run(loads("surface: {D: 2.3, m: 3, seeds: 3}\nsweep: {steps: 4}\n", "x"), out=tmp_path / "run", jobs=1)
    (cell,) = cells
    assert cell.texts[-1].startswith("3 of 3 cases · ")


def test_a_short_run_draws_nothing(cells: list[_Handle], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notebook, "AFTER", 60.0)
    bar = notebook.progress()
    assert bar is not None
    bar(Progress(cases=1, kept=0, done=1, work=1.0))
    assert cells == []


def test_the_output_has_text_and_a_bar(cells: list[_Handle]) -> None:
    bar = notebook.Bar()
    bar(Progress(cases=4, kept=1, done=1, failed=1, work=0.5, left=7.2, interval="V* <1 %"))
    assert repr(bar) == "2 of 4 cases (1 failed) · V* <1 % · about 7 s left"
    assert '<progress value="0.500" max="1">' in bar._repr_html_()
    assert "V* &lt;1 %" in bar._repr_html_()


def test_outside_a_notebook_nothing_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    assert notebook.progress() is None
