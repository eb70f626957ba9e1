"""The counts of the benchmark, on its small rows: no change makes a sweep take more convolutions unseen."""

from __future__ import annotations

import json

import pytest

from tests.bench import solver, store

ROWS = json.loads(solver.BASELINE.read_text(encoding="utf-8"))
BASELINE = {(r["kernel"], r["m"], r["D"], r["rtol"], r["seed"]): r for r in ROWS}
SMALL = [("free", m, D, rtol) for m in (5, 6, 7) for D in (2.1, 2.9) for rtol in (1e-3, 1e-6)]
SMALL += [(kernel, 6, 2.5, 1e-6) for kernel in ("love", "fourier")]


@pytest.mark.parametrize(("kernel", "m", "D", "rtol"), SMALL)
def test_a_sweep_takes_no_more_convolutions_than_the_baseline(kernel, m, D, rtol):
    case = {"kernel": kernel, "m": m, "D": D, "rtol": rtol, "seed": 0, "threads": 1, "steps": 60}
    case["last"] = solver.last_step(case | {"area": 0.5})
    row, stored = solver.measure(case), BASELINE[kernel, m, D, rtol, 0]
    # another processor rounds differently, which shifts single iterations of the sixty steps
    for kind in ("fp64", "fp32"):
        assert row[kind] <= 1.1 * stored[kind] + 0.1, kind
    assert row["residual"] <= rtol
    assert stored["fp64"] >= 1.0


def test_growth_is_reported():
    stored = json.loads(solver.BASELINE.read_text(encoding="utf-8"))
    assert solver.regressions(stored) == []
    worse = [stored[0] | {"fp64": stored[0]["fp64"] + 1.0}, stored[1] | {"m": 99}]
    assert len(solver.regressions(worse)) == 2


def test_the_layouts_of_the_store_are_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    store.layouts(8)
    rows = capsys.readouterr().out.splitlines()[2:]
    sizes = {row.split("|")[1].strip(): int(row.split("|")[2]) for row in rows}
    assert len(sizes) == 4
    assert sizes["now: netCDF-3 (64-bit offset), read by scipy"] < sizes["netCDF-4"]
    assert not list(tmp_path.iterdir())
