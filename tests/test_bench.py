"""The measuring scripts: counts of the solver on small rows, layouts of the store, coverage on made numbers."""

from __future__ import annotations

import json
import sys

import pytest

from tests.bench import card_coverage, solver, store, window_coverage

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


def _leak(load, closes):
    return max(0.0, 1.0 - load / closes) ** 3


def _states(loads, closes):
    four = [[_leak(load, closes * share) for share in (0.8, 0.9, 1.1, 1.2)] for load in loads]
    return [
        {"load": load, "leak": [_leak(load, closes)] * 2, "quadrants": [parts] * 2}
        for load, parts in zip(loads, four, strict=True)
    ]


@pytest.mark.parametrize(("closes", "held"), [(1.1, "100.0 %"), (9.0, "0.0 %")])
def test_the_coverage_of_windows_counts_those_that_hold(tmp_path, monkeypatch, capsys, closes, held):
    loads, curve = window_coverage.LOADS, [0.05, 0.2, 0.4, 0.8]
    window = {"closing": [1.0] * 2, "at": _states(loads, 1.0), "curve": _states(curve, 1.0)}
    window["light"] = window["curve"][2]
    truth = {"closing": [closes] * 2, "at": _states([share * closes for share in loads], closes)}
    (tmp_path / "window_7.json").write_text(json.dumps({"truth": truth, "windows": [window]}))
    monkeypatch.setattr(sys, "argv", ["", "--first", "7", "--joints", "1", "--kept", str(tmp_path)])
    window_coverage.main()
    assert f"closing: {held} of 2" in capsys.readouterr().out


@pytest.mark.parametrize(("closes", "held"), [(1.1, "100 %"), (0.01, "0 %")])
def test_the_coverage_of_grids_counts_those_that_hold(tmp_path, monkeypatch, capsys, closes, held):
    loads = [0.1, 0.3, 0.6]

    def grid(end):
        return {"closing": [end] * 2, "leak": [[_leak(load, end)] * 2 for load in loads]}

    curve = [(load, [_leak(load, 1.0)] * 2) for load in (0.05, 0.2, 0.4, 0.8)]
    for seed, twice in ((7, 0.95), (8, 0.9)):
        grids = {"truth": grid(closes * twice / 0.95), "scan": grid(1.0), "twice": grid(twice), "level": grid(1.01)}
        (tmp_path / f"64_free_{seed}.json").write_text(json.dumps(grids | {"loads": loads, "curve": curve}))
    monkeypatch.setattr(sys, "argv", ["", "--first", "7", "--surfaces", "2", "--nodes", "64", "--kept", str(tmp_path)])
    card_coverage.main()
    assert f"| closing load: all | 4 | {held} |" in capsys.readouterr().out
