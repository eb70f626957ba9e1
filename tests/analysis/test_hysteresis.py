"""The effect of yield: which runs are compared, and the leak at equal loads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

import roughvol
from roughvol.analysis.derived import derived, groups
from roughvol.analysis.hysteresis import comparisons, hysteresis
from roughvol.analysis.stored_run import Run
from roughvol.report.run_facts import facts
from roughvol.study import loads

TEXT = """
surface: {D: 2.2, m: 3, L: 100 um, Sq: 0.5 um, seeds: [1, 2]}
material: {E_star: 10 MPa}
sweep: {steps: 2, to: {pressure: 0.1 MPa}}
"""
MIRRORED = "surface.sides=mirrored"
LAYER = "material={E: 10 MPa, nu: 0.3, thickness: 50 um}"
HARD = "material.hardness=1 MPa"
CLOSING = "record.transport={transmissivity: every-step, closing: true}"
PATH = "sweep=[{pressures: [0.02 MPa, 0.2 MPa]}, {pressures: [0.02 MPa]}]"


def _made(name: str, out: Path, *changes: str) -> Run:
    return Run.of(name, roughvol.run(loads(TEXT, changes=changes), jobs=1, out=out / name))


@pytest.mark.parametrize("change", [MIRRORED, "solver.kernel=punch", "record.region=interior"])
def test_yield_is_the_only_difference_between_two_runs_that_are_compared(change: str, tmp_path: Path) -> None:
    elastic, metal = _made("elastic", tmp_path, change), _made("metal", tmp_path, change, HARD)
    other = _made("other", tmp_path, HARD)
    assert [found.plastic for found in comparisons([elastic, metal, other])] == ["metal"]


def test_each_D_and_m_that_both_runs_have_is_compared(tmp_path: Path) -> None:
    """The largest D at the largest m stood for all, and the table did not say so."""
    several = ("surface.D=[2.2, 2.6]", "surface.m=[2, 3]")
    elastic, metal = _made("elastic", tmp_path, *several), _made("metal", tmp_path, *several, HARD)
    part = replace(metal, dataset=metal.dataset.where((metal.dataset["D"] < 2.5) | (metal.dataset["m"] < 3)))
    found = list(comparisons([elastic, part]))
    assert [one.surfaces for one in found] == ["D = 2.2, m = 2", "D = 2.2, m = 3", "D = 2.6, m = 2"]
    assert found[0].title == "With yield (metal) and without (elastic), D = 2.2, m = 2"
    assert len({one.rows for one in found}) == 3


def test_a_layer_is_the_same_in_any_unit_of_length(tmp_path: Path) -> None:
    elastic = _made("elastic", tmp_path, MIRRORED, LAYER)
    metal = _made("metal", tmp_path, MIRRORED, LAYER, HARD, "surface.L=0.1 mm")
    half_space = _made("half_space", tmp_path, MIRRORED, HARD)
    assert [found.plastic for found in comparisons([elastic, metal, half_space])] == ["metal"]


def test_a_way_is_closed_on_every_leg_from_its_solved_closing_load_on(tmp_path: Path) -> None:
    run = _made("path", tmp_path, "surface.seeds=[1]", CLOSING, PATH)
    ((_, group),) = groups(derived(run.dataset, run.study))
    (table,) = hysteresis(run, group)
    closes = {f"leak along {axis}": float(group.closing_pressure.sel(axis=axis).squeeze()) for axis in "xy"}
    rows = [(float(p), closes[name[:12]], cells) for p, name, *cells in table.rows if name[:12] in closes]
    assert {p >= load for p, load, _ in rows} == {True, False}
    for p, load, cells in rows:
        assert [float(cell) == 0.0 for cell in cells] == [p >= load] * 2, (p, load)
    (states,) = (table for table in facts(run).tables if table.title == "States")
    assert [row[:2] for row in states.rows] == [("1", "1"), ("2", "1"), ("3", "2")]  # the step and its leg


def test_every_leg_has_the_numbers_of_the_same_surfaces(tmp_path: Path) -> None:
    sweep = "sweep=[{steps: 4, to: {pressure: 0.2 MPa}}, {steps: 4, to: {contact_area: 0.36}}]"
    run = _made("path", tmp_path, sweep)
    ((_, group),) = groups(derived(run.dataset, run.study))
    (table,) = hysteresis(run, group)
    rows = [cells for cells in table.rows if cells[1] == "V*" and cells[3]]
    reached = 0
    for p, _, *found in rows:
        up, down = (run.dataset.roughvol.at(f"p={p}, leg {leg}").squeeze() for leg in (1, 2))
        reached += int(down.reached.sum())
        expected = [float(one.free_volume.where(down.reached).mean()) for one in (up, down)]
        assert_allclose([float(cell) for cell in found], expected, rtol=1e-3)  # four digits
    assert reached < 2 * len(rows)


def test_a_leak_is_compared_where_both_runs_have_one(tmp_path: Path) -> None:
    elastic, metal = (
        _made(name, tmp_path, f"record.transport={{transmissivity: {states}}}", *hard)
        for name, states, hard in (("elastic", "every-step", ()), ("metal", "last", (HARD,)))
    )
    (found,) = comparisons([elastic, metal])
    assert [row[0] for row in found.rows if row[1].startswith("leak along x")] == [found.rows[-1][0]]


def test_two_runs_are_compared_by_the_leak_of_their_states(tmp_path: Path) -> None:
    sweep = "sweep={pressures: [0.05 MPa, 0.1 MPa, 0.15 MPa, 0.2 MPa]}"
    runs = [_made(name, tmp_path, CLOSING, sweep, *hard) for name, hard in {"elastic": (), "metal": (HARD,)}.items()]
    ((compared),) = comparisons(runs)
    found, expected = [], []
    for p, _, *leaks in (row for row in compared.rows if row[1].startswith("leak along y")):
        for run, leak in zip(runs, leaks, strict=False):
            at = run.dataset.roughvol.at(f"p={p}")
            found.append(float(leak))
            expected.append(float((at.transmissivity * at.free_volume**3).sel(axis="y").median()))
    assert 0.0 == min(expected) < max(expected)
    assert_allclose(found, expected, rtol=5e-3)  # the load is printed in four digits
