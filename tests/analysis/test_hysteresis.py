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


LAYER = ("E_star: 10 MPa", "E: 10 MPa, nu: 0.3, thickness: 50 um")
HARD = ("10 MPa", "10 MPa, hardness: 1 MPa")


def _made(name: str, out: Path, *changes: tuple[str, str]) -> Run:
    text = TEXT
    for before, after in changes:
        text = text.replace(before, after)
    return Run.of(name, roughvol.run(loads(text), jobs=1, out=out / name))


@pytest.mark.parametrize("change", [MIRRORED, PUNCH, REGION])
def test_yield_is_the_only_difference_between_two_runs_that_are_compared(
    change: tuple[str, str], tmp_path: Path
) -> None:
    elastic, metal = _made("elastic", tmp_path, change), _made("metal", tmp_path, change, HARD)
    other = _made("other", tmp_path, HARD)
    assert [found.plastic for found in comparisons([elastic, metal, other])] == ["metal"]


def test_a_layer_is_the_same_in_any_unit_of_length(tmp_path: Path) -> None:
    elastic = _made("elastic", tmp_path, MIRRORED, LAYER)
    metal = _made("metal", tmp_path, MIRRORED, LAYER, HARD, ("100 um", "0.1 mm"))
    half_space = _made("half_space", tmp_path, MIRRORED, HARD)
    assert [found.plastic for found in comparisons([elastic, metal, half_space])] == ["metal"]
