"""Closing loads that are solved: against the end of percolation of a sweep, between steps and beyond them."""

from functools import lru_cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.campaign import run_case
from roughvol.study import loads

SURFACES = {
    "free": "{D: 2.2, m: 4, seeds: [3]}",
    "periodic": "{H: 0.8, rolloff: 2, n: 16, seeds: [3], sides: periodic}",
}


@lru_cache
def _run(surface, sweep, record):
    (case,) = loads(f"surface: {SURFACES[surface]}\nsweep: {sweep}\nrecord: {record}").cases()
    return run_case(case)


BEFORE = "{steps: 5, to: {pressure: 0.5}}"
ENDS = (BEFORE, "{steps: 7, to: percolation}", "{pressures: [9.0]}")


@pytest.mark.parametrize(
    ("surface", "end", "region"), [*(("periodic", end, "") for end in ENDS), ("free", BEFORE, "region: interior, ")]
)
def test_a_closing_load_is_that_of_a_sweep_to_the_end_of_percolation(surface, end, region):
    """The sweep ends before the closing, at the closing of both ways, and its first step is closed."""
    solved = _run(surface, end, f"{{{region}transport: {{closing: true}}}}")["closing_pressure"]
    for axis in "xy":
        ended = _run(surface, f"{{steps: 1, to: {{percolation: {axis}}}}}", f"{{{region}}}")
        assert_allclose(solved.sel(axis=axis).item(), ended["mean_pressure"].values.ravel()[-1], rtol=2e-3)


YIELDS = "material: {E: 200 GPa, nu: 0.3, hardness: 5 GPa}"


def test_of_a_surface_that_yields_the_closing_between_steps_is_solved_and_beyond_them_is_not_known():
    text = "surface: {D: 2.2, m: 4, seeds: [3], L: 100 um, Sq: 1 um}\nsweep: {steps: 6, to: {pressure: %s}}\n" + YIELDS
    text += "\nrecord: {transport: {percolation: every-step, closing: true}}"
    early, late = (run_case(loads(text % end).cases()[0]) for end in ("0.2", "2.2"))
    assert np.isnan(early["closing_pressure"]).all()
    for axis in "xy":
        open_ = late["percolates"].sel(axis=axis).values.ravel() > 0
        pressures = late["mean_pressure"].values.ravel()
        solved = late["closing_pressure"].sel(axis=axis).item()
        if open_.all():
            assert np.isnan(solved)
        else:
            assert pressures[open_][-1] < solved <= pressures[~open_][0]
