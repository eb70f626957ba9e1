"""Reports of periodic surfaces: every figure that they have, and none of the paper's free patches."""

from __future__ import annotations

from pathlib import Path

import pytest

from roughvol.analysis.stored_run import Run
from roughvol.campaign import execution
from roughvol.reproduction.figures.conditions import is_paper_surface
from roughvol.reproduction.figures.registry import FIGURES
from roughvol.reproduction.judgement import judge
from roughvol.reproduction.needs import Needs
from roughvol.reproduction.sections import report_of
from roughvol.store import dataset
from roughvol.study import loads
from tests.reproduction import kit

RECORD = """
sweep: {steps: 3, to: {contact_area: 0.5}}
record:
  heights: true
  fields_at: last
  psd: {at: last}
  transport: {percolation: every-step, transmissivity: every-step, constriction: last, estimates: last}
"""


@pytest.mark.parametrize(
    ("surface", "origin"),
    [
        ("D: [2.3, 2.6], m: 3, seeds: 2, periodic: true", "periodic surfaces"),
        ("H: 0.7, n: 8, rolloff: 1, cut: 3, seeds: 2", "surfaces with a spectrum"),
    ],
)
def test_a_report_has_every_figure_but_that_of_the_recursion(surface: str, origin: str, tmp_path: Path) -> None:
    execution.run(loads(f"surface: {{{surface}}}\n{RECORD}"), out=tmp_path, jobs=1)
    ds = dataset.read(tmp_path / "study.nc")
    assert "midpoint displacement of a free patch" in (FIGURES["fig01"].missing(ds) or "")
    assert not is_paper_surface(ds)
    assert Needs().unfit(Run.of("other", ds)) == (origin,)
    page = kit.to_html(report_of(judge([tmp_path / "study.nc"])))
    assert "id='run-1'" in page
    assert "<figure" in page
