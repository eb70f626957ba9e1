"""Runs of every version since 0.11.1 open, with the numbers that their version printed; none is lost by another run.

Between two steps the rule has changed: old and new numbers lie between those of the same two steps.
"""

import contextlib
import itertools
import json
import math
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

import roughvol
from tests.kit import call, refused, said, succeeded, twin
from tests.stored_runs.archive import VERSIONS, studies, unpack

CASES = [(version, name) for version in VERSIONS for name in studies(version)]
OLDEST = VERSIONS[0]
SAME = ("0.12.0", "0.15.0")  # their files hold what those of 0.13.0, and of 0.14.0 or 0.16.0 hold


def _now(now: Callable[[str, str], bool]) -> list[Any]:
    """Return the cases; those that are not asked now are in `make test-slow`."""
    return [pytest.param(*case, marks=() if now(*case) else pytest.mark.slow) for case in CASES]


EACH = _now(lambda version, name: version not in SAME)
# Where a question takes seconds: of the versions since the oldest, one run each.
SOME = _now(lambda version, name: version == OLDEST or (name == "paper" and version not in SAME))
ENDS = _now(lambda version, name: version == OLDEST or (name == "paper" and version == VERSIONS[-1]))
ROUNDING = ("transmissivity_conservation_error",)  # of the order of 1e-16 until 0.14
# Where a way closes between two steps, 0.11.1 had it closed; since 0.12 its leak falls on a straight line to 0.
TO_THE_CLOSING = ("leak_rate_x", "transmissivity_x", "open_x", "percolates_x", "critical_gap_x", "critical_opening_x")
CHANGED = {(OLDEST, "materials"): TO_THE_CLOSING}
# With record.fluid_pressure the leak is that of the lifted gap since 0.12; before, that of the dry gap stood there.
DRY = {f"{name}_{axis}": f"{name}_dry_{axis}" for name in ("leak_rate", "transmissivity", "open") for axis in "xy"}
# Figures of 0.11.1 that are no more, with the reason that `plot` names.
GONE = {
    "answer_cost": "left with version 0.13.0",
    "seal_leak_rate": "shows the gap without fluid pressure; allowed with record.fluid_pressure: leak_of_p",
    "seal_transmissivity": "shows the gap without fluid pressure; allowed with record.fluid_pressure: leak_of_p",
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All stored runs."""
    folder = tmp_path_factory.mktemp("stored")
    unpack(folder)
    return folder


@pytest.fixture
def here(runs: Path, request: pytest.FixtureRequest) -> Iterator[dict[str, Any]]:
    """What a version printed of its runs, in their folder."""
    with contextlib.chdir(runs / request.param):
        yield json.loads(Path("printed.json").read_text(encoding="utf-8"))


def _labels(row: Mapping[str, Any], dims: list[str]) -> tuple[Any, ...]:
    """Return what tells a row from the others at one state."""
    return tuple(row.get(name) for name in dims)


def _between(values: Iterable[float], steps: list[dict[str, Any]], column: str) -> set[int]:
    """Return the places of the steps between each of which and the next one all values lie."""
    ends = [[step.get(column) for step in two] for two in itertools.pairwise(steps)]
    known = {k: sorted(two) for k, two in enumerate(ends) if None not in two}
    return {k for k, (low, high) in known.items() if all(low <= value <= high for value in values)}


def _same(old: object, new: object) -> bool:
    """Return whether two values are equal to rounding."""
    if not isinstance(old, int | float) or not isinstance(new, int | float):
        return old == new
    return math.isclose(old, new, rel_tol=1e-9, abs_tol=1e-12)


@pytest.mark.parametrize(("here", "name"), EACH, indirect=["here"])
def test_a_run_shows_the_numbers_that_its_version_printed(here: dict[str, Any], name: str) -> None:
    version = Path.cwd().name
    at, before = studies(version)[name]["at"], here[name]["show"]
    now = json.loads(said("show", name, "--at", at, "--json"))
    dims = [str(dim) for dim in roughvol.open(name).dims if dim in before["rows"][0]]
    rows = {_labels(row, dims): row for row in now["rows"]}
    steps = json.loads(said("show", name, "--json"))["rows"]
    assert len(rows) == len(now["rows"]) >= len(before["rows"]) > 0
    renamed = DRY if (version, name) == (OLDEST, "lifted") else {}
    compared = 0
    for row in before["rows"]:
        found = rows[_labels(row, dims)]
        own = [step for step in steps if _labels(step, dims) == _labels(row, dims)]
        places = set(range(len(own)))
        for column, value in row.items():
            if column in (*ROUNDING, *CHANGED.get((version, name), ())):
                continue
            column = renamed.get(column, column)
            if column == "state":
                assert found["state"] in (value, f"{value}, leg 1")
            else:
                if not _same(value, found[column]):  # between two steps: straight lines until 0.16, since then cubics
                    places &= _between((value, found[column]), own, column)
                assert places, (column, value, found[column])
                assert before["units"].get(column) in (now["units"].get(column), None)
                compared += isinstance(value, float)
    assert compared >= 5 * len(before["rows"])


@pytest.mark.parametrize(("here", "name"), ENDS, indirect=["here"])
def test_every_question_on_a_run_is_answered(
    here: dict[str, Any], name: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    version = Path.cwd().name
    if name != "paper" or version != VERSIONS[-1]:  # the next tests draw figures
        request.getfixturevalue("no_figures")
    at = studies(version)[name]["at"]
    results = roughvol.open(name)
    assert results.attrs["roughvol_version"] == version
    kind, value = at.split("=")
    state = results.roughvol.at(**{kind: value if " " in value else float(value)})
    assert state.sizes.keys() <= results.sizes.keys() | {"axis"}
    assert bool((state["free_volume"] > 0.0).any())
    said("show", name)
    said("compare", name, twin(name), "--at", at)
    said("check", name)
    said("report", name, "--out", tmp_path)
    assert re.search(rf"^{name} +finished", said("ls"), re.MULTILINE)
    if "leak" in studies(version)[name]:
        _answers_agree(here[name]["ask"], said("ask", name, "--leak-rate", studies(version)[name]["leak"]))


def _answers_agree(before: str, now: str) -> None:
    """Check an answer of `ask`: until 0.11.1 states were solved for it, and now it has an interval."""
    solved = re.findall(r"along (\w): pressure ([\d.]+) MPa, to 1e-6", before)
    if not solved:
        # the words until 0.16, when the loads of steps were p* for any unit
        closes = r"where the last way closes, between the steps .* and .*"
        then = re.sub(closes, "from the last open step to the closing of the last way", before)
        first = r"of p\* = .* or more: the first step (leaks less; .*) not stored"
        then = re.sub(first, r"the first known load \1 not known", then)
        now = re.sub(r"of [\d.]+ MPa or more: ", "", now)
        then, now = (re.sub(r"between the (steps|known loads) [^,\n]* and [^,\n]*", "", text) for text in (then, now))
        # until 1.0 numbers were rounded to the nearest
        words, numbers = zip(*(_apart(text.splitlines()[1]) for text in (then, now)), strict=True)
        assert words[0] == words[1]
        assert numbers[1] == pytest.approx(numbers[0], rel=0.02)
    elif "leakiest" not in now:  # of several surfaces 0.11.1 took the geometric mean
        for axis, pressure in solved:
            low, high = re.findall(rf"along {axis}: pressure .* MPa \(([\d.]+) to ([\d.]+)\)", now)[0]
            assert float(low) <= float(pressure) <= float(high)


def _apart(text: str) -> tuple[str, list[float]]:
    """Return words without numbers, and the numbers."""
    number = r"\d+\.?\d*(?:e-?\d+)?"
    return re.sub(number, "", text), [float(found) for found in re.findall(number, text)]


@pytest.mark.parametrize("here", [OLDEST], indirect=True)
@pytest.mark.parametrize("name", studies(OLDEST))
def test_a_run_of_the_oldest_version_has_its_figures(here: dict[str, Any], name: str, tmp_path: Path) -> None:
    """Each figure of the first run that has it, and one of each run; all of every run are drawn in `make test-slow`."""
    wanted = set(here[name]["figures"])
    gone = wanted & GONE.keys() if name == "lifted" else wanted & {"answer_cost"}
    before = itertools.takewhile(lambda other: other != name, studies(OLDEST))
    drawn = (wanted - gone).difference(*(here[other]["figures"] for other in before)) or {max(wanted)}
    said("plot", name, *sorted(drawn), "--out", tmp_path)
    assert {path.stem for path in tmp_path.rglob("*.png")} == drawn
    for figure in gone:
        assert GONE[figure] in refused("plot", name, figure)


@pytest.mark.slow
@pytest.mark.parametrize(("here", "name"), CASES, indirect=["here"])
def test_a_run_has_figures(here: dict[str, Any], name: str, tmp_path: Path) -> None:
    done = call("plot", name, "--out", tmp_path)
    assert (done.exit_code, done.stderr) == (0, "")
    assert list(tmp_path.rglob("*.png"))


@pytest.mark.parametrize(("here", "name"), SOME, indirect=["here"])
def test_the_same_study_goes_on_or_means_the_same(
    here: dict[str, Any], name: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Numbers of cases that are computed anew are the old ones; no file is lost."""
    version, folder = Path.cwd().name, Path("runs") / name
    if version == OLDEST:  # whose ensembles have other sizes now
        request.getfixturevalue("few_samples")
    before, stored = roughvol.open(name), sorted(path.name for path in folder.glob("cases/*.nc"))
    sides = ["--set", "surface.sides=free"] if name == "scan" and version != "0.16.0" else []
    if sides:
        message = refused("run", f"{name}.yaml")
        assert 'surface.sides: "free" → "mirrored"' in message
        assert "surface.sides" in refused("show", f"{name}.yaml")
    out = tmp_path / "run"  # a copy: other tests read the run
    shutil.copytree(folder, out, copy_function=shutil.copyfile)
    done = succeeded("run", f"{name}.yaml", *sides, "--out", out, "--jobs", "1")
    kept = {path.name for path in out.glob("cases/*.nc")} | {path.name for path in out.glob("cases/set_aside/*.nc")}
    assert {*stored} <= kept
    if aside := list(out.glob("cases/set_aside/*.nc")):
        assert len(aside) == len(stored)
        words = rf"set aside: {len(stored)} case files stored by an older answer format \(\d, now \d\); their cases are"
        assert re.search(words, done.stderr)
    now = roughvol.open(out)
    assert now.sizes == before.sizes or version == OLDEST
    if name == "auto":  # its steps are 20 now: the end of the sweep is the same
        now, before = (ds.isel(step=-1, drop=True) for ds in (now, before))
    for variable in ("free_volume", "contact_area_fraction", "mean_pressure"):
        assert abs(now[variable] - before[variable]).max() < 1e-6, variable
