"""The effect of yield: which runs are compared."""

from __future__ import annotations

from pathlib import Path

import pytest

import roughvol
from roughvol.analysis.hysteresis import comparisons
from roughvol.analysis.stored_run import Run
from roughvol.study import loads

TEXT = """
surface: {D: 2.2, m: 3, L: 100 um, Sq: 0.5 um, seeds: [1, 2]}
material: {E_star: 10 MPa}
sweep: {steps: 2, to: {pressure: 0.1 MPa}}
"""
MIRRORED = ("seeds: [1, 2]", "seeds: [1, 2], sides: mirrored")
PUNCH = ("sweep:", "solver: {kernel: punch}\nsweep:")
REGION = ("sweep:", "record: {region: interior}\nsweep:")


@pytest.mark.parametrize("change", [MIRRORED, PUNCH, REGION])
def test_yield_is_the_only_difference_between_two_runs_that_are_compared(
    change: tuple[str, str], tmp_path: Path
) -> None:
    hard = ("10 MPa", "10 MPa, hardness: 1 MPa")

    def made(name: str, *changes: tuple[str, str]) -> Run:
        text = TEXT
        for before, after in changes:
            text = text.replace(before, after)
        return Run.of(name, roughvol.run(loads(text), jobs=1, out=tmp_path / name))

    elastic, metal, other = made("elastic", change), made("metal", hard, change), made("other", hard)
    assert [found.plastic for found in comparisons([elastic, metal, other])] == ["metal"]
