"""The measuring scripts: counts on small rows, layouts of the store, coverage, and the commands that pages name."""

import argparse
import importlib
import json
import re
import runpy
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.bench import card_coverage, solver, store, window_coverage

ROOT = Path(__file__).parents[1]
TEXTS = ("Makefile", "README.md", "CONTRIBUTING.md", "docs/**/*.md", "roughvol/**/*.py", "roughvol/**/*.toml")
COMMAND = re.compile(r'python -m tests\.bench\.(\w+(?: (?:"[^"\n]*"|[^\s`"#|,]+))*)')
SMALL_RUNS = (  # in make test-slow
    "card_coverage --surfaces 2 --nodes 32 --kept kept",
    "cost_rule 4 6",
    "flow direct 4",
    "flow gas 4",
    "flow lifted 4",
    "flow large 4 0.1",
    "flow states 4",
    "inverse --m 5 --D 2.5",
    "windows --rolloff 4 --joints 1 --windows 2 --nodes 64 --window 17 --areas 0.1",
    'ensemble_gain --m 4 --accuracy "10 %"',
    "estimates",
    "flow fewer 3",
    "layer thickness",
    "scale --cases 4",
    "seals --roll-off --known",
    "step_errors",
    "validation",
    "wavy_channel --along 8 --figure wavy.png",
)

ROWS = json.loads(solver.BASELINE.read_text(encoding="utf-8"))
BASELINE = {(r["kernel"], r["m"], r["D"], r["rtol"], r["seed"]): r for r in ROWS}
SMALL = [("free", 5, 2.1, 1e-6), ("free", 6, 2.1, 1e-3), ("free", 6, 2.9, 1e-6), ("free", 7, 2.9, 1e-3)]
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


def _named() -> list[str]:
    """Return the commands of the benchmarks that pages, the Makefile and the benchmarks themselves name."""
    paths = [path for glob in (*TEXTS, "tests/bench/*.py") for path in sorted(ROOT.glob(glob))]
    return sorted({found for path in paths for found in COMMAND.findall(path.read_text(encoding="utf-8"))})


class _Parsed(Exception):
    """The arguments are parsed."""


@pytest.mark.parametrize("command", _named())
def test_a_named_command_exists_and_takes_its_arguments(command, monkeypatch):
    name, *words = shlex.split(command)
    module = importlib.import_module(f"tests.bench.{name}")
    if "ArgumentParser" not in Path(module.__file__).read_text(encoding="utf-8"):
        if words and words[0].isalpha():  # the function to call
            assert callable(getattr(module, words[0]))
        return
    parse = argparse.ArgumentParser.parse_args

    def parsed(parser):
        parse(parser)
        raise _Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parsed)
    monkeypatch.setattr(sys, "argv", [name, *words])
    with pytest.raises(_Parsed):
        module.main()


def test_commands_are_found():
    commands = _named()
    assert 'paired . ".:sides=mirrored" --m 7 8 9 10 --D 2.3 --steps 20 --area 0.1 --rounds 3' in commands
    assert {path.stem for path in ROOT.glob("tests/bench/*.py")} - {"__init__"} <= {one.split()[0] for one in commands}


@pytest.mark.slow
@pytest.mark.parametrize("command", SMALL_RUNS)
def test_a_benchmark_prints_its_numbers(command, tmp_path, monkeypatch, capsys):
    name, *words = shlex.split(command)
    monkeypatch.setattr(sys, "argv", [name, *words])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    try:
        runpy.run_path(str(ROOT / "tests" / "bench" / f"{name}.py"), run_name="__main__")
    except SystemExit as end:
        if end.code:
            raise
    assert re.search(r"\d", capsys.readouterr().out)


@pytest.mark.slow
def test_joints_and_windows_are_solved(tmp_path, monkeypatch, capsys):
    for name, value in (("NODES", 64), ("SIDE", 16), ("CORNERS", ((0, 0), (32, 32))), ("CURVE", np.array([0.1, 0.9]))):
        monkeypatch.setattr(window_coverage, name, value)
    monkeypatch.setattr(sys, "argv", ["window_coverage", "--first", "1001", "--joints", "1", "--kept", str(tmp_path)])
    window_coverage.main()
    closing, leak = capsys.readouterr().out.splitlines()[-2:]
    assert re.fullmatch(r"closing: [\d.]+ % of 4", closing)
    assert re.fullmatch(r"leak: [\d.]+ % of \d+", leak)
