"""Reports of periodic surfaces: every figure that they have, and none of the paper's free patches."""

from pathlib import Path

import pytest

from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.figures.conditions import is_paper_surface
from roughvol.reproduction.figures.registry import ALL, FIGURES
from roughvol.reproduction.judgement import judge
from roughvol.reproduction.needs import Needs
from roughvol.reproduction.sections import report_of
from roughvol.store import dataset
from tests.reproduction import kit

RECORD = """
  fields_at: last
  psd: {at: last}
  transport: {percolation: every-step, transmissivity: every-step, constriction: last, estimates: last}
"""


def _run(surface: str, folder: Path, record: str = "") -> ClaimRun:
    text = f"surface: {{{surface}}}\nsweep: {{steps: 3, to: {{contact_area: 0.5}}}}\nrecord:\n  heights: true{record}"
    return ClaimRun.of("other", dataset.read(kit.stored(folder, other=text)["other"]))


@pytest.mark.parametrize(
    ("surface", "origin"),
    [
        ("D: [2.3, 2.6], m: 3, seeds: 2, sides: periodic", "periodic surfaces"),
        ("D: [2.3, 2.6], m: 3, seeds: 2, sides: mirrored", "mirrored surfaces"),
        ("H: 0.7, n: 8, rolloff: 1, cut: 3, seeds: 2", "surfaces with a spectrum"),
    ],
)
def test_surfaces_of_another_origin_are_none_of_the_paper(surface: str, origin: str, tmp_path: Path) -> None:
    run = _run(surface, tmp_path)
    assert "midpoint displacement of a free patch" in (FIGURES["fig01"].missing(run.dataset) or "")
    assert not is_paper_surface(run.dataset)
    assert Needs().unfit(run) == (origin,)


def test_a_report_has_every_figure_but_that_of_the_recursion(tmp_path: Path) -> None:
    run = _run("D: [2.3, 2.6], m: 3, seeds: 2, sides: periodic", tmp_path, RECORD)
    page = kit.to_html(report_of(judge([tmp_path / "other" / "study.nc"])))
    drawn = {name for name, figure in ALL.items() if figure.missing(run.dataset) is None}
    assert "fig01" not in drawn
    assert {name for name in ALL if f"id='run-1-{name}'" in page} == drawn
