"""The leak card where the truth is known: windows against the ensemble, levelling against the map without a form."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.analysis.leak_budget import card_of
from roughvol.campaign import card as card_runs
from roughvol.campaign import execution
from roughvol.store.card_runs import CardRuns, Pressed
from roughvol.study import Level, load, loads, parse
from roughvol.surfaces.midpoint import random_midpoint_displacement
from tests.analysis.kit import part_of
from tests.kit import said

RECORD = """
record:
  transport: {transmissivity: every-step}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 1 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""
AT = Level("pressure", 0.5)


def test_quadrants_of_one_map_hold_the_mean_of_the_ensemble(tmp_path: Path) -> None:
    text = (
        "name: rolled\nsurface: {H: 0.8, rolloff: 6, n: 32, seeds: 8, L: 200 um, Sq: 0.4 um}\n"
        "material: {E_star: 10 MPa}\nsweep: {steps: 3, to: {pressure: 0.5}}" + RECORD
    )
    fine = execution.run(card_runs.plan(loads(text), AT).fine.study, jobs=1, out=tmp_path)
    every = [card_of([CardRuns(Pressed("", fine.isel(seed=[k]), AT))], "rolled", "") for k in range(8)]
    for axis in (0, 1):
        ways = [card.ways[axis] for card in every]
        logs = np.log([way.leak.value for way in ways])
        factors = [math.log(part_of(way, "window").factor) for way in ways]
        covered = np.abs(logs - logs.mean()) <= factors
        assert np.mean(covered) >= 0.75  # 95 % of the intervals, with few surfaces to count


def test_a_grid_too_coarse_for_the_waves_of_a_surface_is_left_out() -> None:
    text = "surface: {H: 0.8, rolloff: 12, n: 128, seeds: 1}\nsweep: {steps: 3, to: {pressure: 0.5}}"
    for rolloff, expected in ((12, 3), (20, 2), (40, 1)):
        made = card_runs.plan(loads(text.replace("rolloff: 12", f"rolloff: {rolloff}")), AT)
        assert 1 + len(made.coarser) == expected


def test_another_levelling_covers_the_leak_of_the_map_without_its_form(tmp_path: Path) -> None:
    heights = random_midpoint_displacement(2.2, 5, side=200.0, seed=4).heights
    x = np.linspace(-1.0, 1.0, heights.shape[0])
    flat = _levelled(0.4 * heights / heights.std())
    np.savetxt(tmp_path / "flat.txt", flat, header="heights in um")
    np.savetxt(tmp_path / "bowed.txt", flat + 0.3 * x[:, None] ** 2, header="heights in um")
    leak = {}
    for name, level in (("flat", "none"), ("bowed", "tilt")):
        text = (
            f"name: {name}\nsurface: {{file: {name}.txt, L: 200 um, level: {level}}}\n"
            "material: {E_star: 10 MPa}\nsweep: {steps: 3, to: {pressure: 0.01 MPa}}" + RECORD
        )
        (tmp_path / f"{name}.yaml").write_text(text)
        study = load(tmp_path / f"{name}.yaml")
        runs = card_runs.compute(study, parse("pressure=0.01 MPa"), tmp_path / name, jobs=1)
        leak[name] = card_of([runs], name, "")
    for truth, bowed in zip(leak["flat"].ways, leak["bowed"].ways, strict=True):
        factor = part_of(bowed, "levelling").factor
        assert factor > 1.02
        off = abs(math.log(truth.leak.value / bowed.leak.value))
        assert_allclose(off, math.log(factor), rtol=1e-3)  # quadratic: the truth


def _levelled(heights: np.ndarray) -> np.ndarray:
    """Heights less the quadratic surface through them."""
    x = np.linspace(-1.0, 1.0, heights.shape[0])
    u, v = (axis.ravel() for axis in np.meshgrid(x, x, indexing="ij"))
    terms = np.stack([np.ones(u.size), u, v, u * u, u * v, v * v], axis=1)
    fit = terms @ np.linalg.lstsq(terms, heights.ravel(), rcond=None)[0]
    return heights - fit.reshape(heights.shape)


@pytest.mark.layout
def test_a_card_from_the_file_of_an_instrument(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    topography = pytest.importorskip("SurfaceTopography", reason="needs the extra roughvol[measured]")
    monkeypatch.chdir(tmp_path)
    heights = random_midpoint_displacement(2.2, 6, side=200.0, seed=11).heights
    heights = 0.8 * heights / heights.std() + 0.02 * np.arange(65)[:, None]
    holes = np.random.default_rng(0).random(heights.shape) < 0.002
    scan = topography.Topography(np.ma.masked_array(heights, holes), (65 * 7.8125, 65 * 7.8125), unit="µm")
    scan.to_x3p(str(tmp_path / "scan.x3p"))
    (tmp_path / "seal.yaml").write_text(
        "name: seal\nsurface: {file: scan.x3p, level: tilt, missing: interpolate, unit: um}\n"
        "material: {E: 10 MPa, nu: 0.49}\nsweep: {steps: 4, to: {pressure: 0.05 MPa}}" + RECORD
    )
    printed = said("card", "seal.yaml", "--at", "pressure=0.03 MPa", "--jobs", "1")
    assert re.search(r"Load +0\.03 MPa", printed)
    assert re.search(r"Surface +scan\.x3p, Sq ", printed)
    for part in ("solver", "grid", "window", "levelling"):
        assert f"\n  {part} " in printed
    assert (tmp_path / "runs" / "seal_card" / "card_pressure=0.03_MPa.pdf").stat().st_size > 10_000
