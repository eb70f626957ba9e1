"""Questions about a run: each is put through its real entry point, and every number of the answer is compared.

A question returns how many numbers were compared with the `oracle`. It raises `Refused` with the message where the
program refuses, and fails where a number differs.
"""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
import json
import math
import re
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr
import yaml
from scipy.interpolate import PchipInterpolator

import roughvol
from roughvol.errors import RoughvolError
from tests import kit
from tests.crossing import oracle
from tests.crossing.kinds import BY_NAME, Kind
from tests.crossing.oracle import Group, Surface

DIGITS = 6e-4  # relative: four printed digits
TIGHT = 1e-9  # relative: numbers as they are stored
HEADS = {  # symbol of a column: stored name
    "p": "nominal_pressure",
    "p*": "mean_pressure",
    "A*": "contact_area_fraction",
    "V*": "free_volume",
    "g_mean": "mean_gap",
    "d/σ": "separation",
    "d": "mean_plane_separation",
    "Δ/σ": "indentation",
    "u_pl/σ": "plastic_volume",
    "A_pl*": "plastic_area_fraction",
    "K L/E*": "interfacial_stiffness",
    "Q_seal": "seal_leak_rate",
    "Q_g,seal": "seal_gas_leak_rate",
} | {
    head.format(axis): name.format(axis)
    for axis in "xy"
    for head, name in {
        "open along {}": "open_{}",
        "open along {} dry": "open_dry_{}",
        "h_c,{}": "critical_opening_{}",
        "h_c,{} dry": "critical_opening_dry_{}",
        "T_{}*": "transmissivity_{}",
        "T_{}* dry": "transmissivity_dry_{}",
        "Q_{}": "leak_rate_{}",
        "Q_{} dry": "leak_rate_dry_{}",
        "Q_g,{}": "gas_leak_rate_{}",
        "Q_g,{} dry": "gas_leak_rate_dry_{}",
        "Kn_{}": "knudsen_number_{}",
    }.items()
}
TWICE = ("files", "materials", "part", "coupled")  # kinds asked in Python too, and for text beside JSON
STIFFNESS = "interfacial_stiffness"  # not stored: a slope of two stored numbers


class Curve(NamedTuple):
    """A curve of a figure: the words that name its surfaces, its seed and axis, its name, its points (2, n)."""

    words: str
    seed: str
    axis: str
    name: str
    points: np.ndarray


class Refused(Exception):
    """The program refuses a question with a message."""


_GROUPS: dict[tuple[Path, int, tuple[str, ...]], list[Group]] = {}  # each is read once


@cache
def _dataset(file: Path, content: bytes) -> xr.Dataset:
    with xr.open_dataset(file, engine="netcdf4") as stored:
        return stored.load()


@dataclass
class Made:
    """A run that was made in a folder."""

    kind: Kind
    folder: Path
    name: str = ""
    printed: str = ""  # by the command that made the run

    @property
    def file(self) -> Path:
        """Its study.nc."""
        return self.folder / "runs" / (self.name or self.kind.name) / "study.nc"

    @property
    def modulus(self) -> Any:
        """E* in MPa, that of the changed study for a run of now."""
        return 20.0 if self.name and self.kind.name == "study-changed" else self.kind.modulus

    @property
    def stored(self) -> xr.Dataset:
        """Its dataset, the part that the questions are put to."""
        whole = _dataset(self.file, self.file.read_bytes())
        return whole.sel({self.kind.lists[0]: list(self.kind.modulus)}) if self.kind.changes else whole

    @property
    def beside(self) -> Made:
        """The run to compare with; of a part of a list the same part."""
        other, kind = BY_NAME[self.kind.beside[0]], self.kind
        return Made(replace(other, changes=kind.changes, modulus=kind.modulus) if kind.changes else other, self.folder)

    @property
    def groups(self) -> list[Group]:
        """Its surfaces, as the oracle reads them."""
        key = self.file, self.file.stat().st_mtime_ns, self.kind.changes
        if key not in _GROUPS:
            _GROUPS[key] = oracle.groups(self.stored, self.modulus, self.kind.lists, self.kind.ends)
        return _GROUPS[key]

    @property
    def surfaces(self) -> list[Surface]:
        """All its surfaces, group by group."""
        return [surface for group in self.groups for surface in group.surfaces]

    def group(self, words: str) -> Group:
        """Return the surfaces that a row or a curve means, by the words around it that not all surfaces share."""
        pieces = [set(", ".join(group.words).split(", ")) for group in self.groups]
        shared = set.intersection(*pieces)
        found = [
            group
            for group, own in zip(self.groups, pieces, strict=True)
            if all(re.search(rf"(^|[ :]){re.escape(piece)}([,:]|$)", words) for piece in own - shared)
        ]
        assert len(found) == 1, f"{words!r} names {len(found)} of {[group.words for group in self.groups]}"
        return found[0]


def call(made: Made, *arguments: str) -> str:
    """Return what a command prints; raise `Refused` where it refuses."""
    arguments += tuple(word for change in made.kind.changes for word in ("--set", change))
    with contextlib.chdir(made.folder):
        done = kit.call(*arguments)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise AssertionError("".join(traceback.format_exception(done.exception)))
    if done.exit_code == 2:
        assert "Traceback" not in done.output
        assert done.stdout == "", "a refused command prints nothing else"
        raise Refused(done.stderr)
    assert done.exit_code == 0, done.output
    return done.stdout


@contextlib.contextmanager
def python(made: Made) -> Iterator[None]:
    """Call Python in the folder of a run; raise `Refused` where it raises an error of roughvol."""
    with contextlib.chdir(made.folder), warnings.catch_warnings():
        warnings.simplefilter("ignore", roughvol.RoughvolWarning)
        try:
            yield
        except (RoughvolError, TypeError) as error:
            if isinstance(error, TypeError) and "unexpected keyword argument" not in str(error):
                raise
            raise Refused(str(error)) from error


def alike(made: Made, found: Any, function: Callable[..., Any], *of: Any, **options: Any) -> None:
    """Compare the JSON of a command with the answer of a Python function, which the command prints for every kind."""
    if made.kind.name not in TWICE:
        return
    with python(made):
        answer = function(*of, **options, changes=made.kind.changes)
        if function in (roughvol.show, roughvol.compare):
            names, rows, _ = answer if function is roughvol.show else answer.records()
            plain = [dict(zip(names, row, strict=True)) for row in rows]
        else:
            plain = answer.plain()
        assert json.loads(json.dumps(plain)) == found


# tables of text


@dataclass
class Table:
    """A printed table: the line above, its head and its rows."""

    title: str
    head: list[str]
    rows: list[dict[str, str]]


FIRST = ("step ", "state ", "surface ", "run ", "time ")


def tables(text: str) -> list[Table]:
    """Return the tables of a text: columns are parted by two blanks in every line."""
    lines, found = text.splitlines(), []
    end = 0
    for k, line in enumerate(lines):
        if k < end or not (line.lstrip() + " ").startswith(FIRST) or "  " not in line.strip():
            continue
        block = [line]
        for row in lines[k + 1 :]:
            if "  " not in row.strip() or re.match(r"  [A-Z]", row):
                break
            block.append(row)
        end = k + len(block)
        width = max(map(len, block))
        block = [row.ljust(width) for row in block]
        blank = "".join(" " if all(row[j] == " " for row in block) else "x" for j in range(width))
        ends = [(part.start(), part.end()) for part in re.finditer(r"x+(?: x+)*", blank)]
        cells = [[row[start:end].strip() for start, end in ends] for row in block]
        cells[0] = [f"{cells[0][j - 1]} {head}" if head == "16-84 %" else head for j, head in enumerate(cells[0])]
        title = lines[k - 1] if k and "  " not in lines[k - 1] else ""
        found.append(Table(title, cells[0], [dict(zip(cells[0], row, strict=True)) for row in cells[1:]]))
    return found


def check_table(made: Made, table: Table, made_of: Callable[[str], Made] | None = None) -> int:
    """Compare every number of a table of states, or of closing loads; return how many numbers there are."""
    count = 0
    owners = [made_of(row["run"]) if made_of else made for row in table.rows]
    words = [", ".join((table.title, row.get("surface", ""), row.get("run", ""))) for row in table.rows]
    of_rows = [own.group(text) for own, text in zip(owners, words, strict=True)]
    several = any(len(group.surfaces) > 1 for group in of_rows)
    for row, group, own in zip(table.rows, of_rows, owners, strict=True):
        if "ways closed" in row:
            count += _check_closing(group, row)
            continue
        states = [_with_seal(own.kind, _state(surface, row)) for surface in group.surfaces]
        for head, cell in row.items():
            if head in ("step", "state", "surface", "run"):
                continue
            if head == "surfaces":
                _check_count(cell, states)
            elif head == "leg":
                assert int(cell) == group.surfaces[0].legs[int(row["step"]) - 1]
            else:
                assert head.startswith("median ") == (several and oracle.is_flow(_name_of(head))), head
                count += check_cell(head, cell, [state or {} for state in states])
    return count


def _state(surface: Surface, row: dict[str, str]) -> dict[str, float] | None:
    label = row.get("state") or f"step {row['step']}"
    if step := re.fullmatch(r"step (\d+)(, leg \d+)?", label):
        k = int(step[1]) - 1
        return {n: float(v[k]) for n, v in surface.along.items()}
    return oracle.recorded(surface, label)


def _with_seal(kind: Kind, state: dict[str, float] | None) -> dict[str, float] | None:
    """Return a state with the leak of a seal that is one map repeated: as much per length over width as the map."""
    if state is None or kind.squares == 1.0:
        return state
    own = {f"seal_{flow}": f"{flow}_{kind.axes}" for flow in ("leak_rate", "gas_leak_rate")}
    return state | {name: kind.squares * state[of] for name, of in own.items() if of in state}


def _check_count(cell: str, states: Sequence[dict[str, float] | None]) -> None:
    reached = sum(state is not None and math.isfinite(state["mean_pressure"]) for state in states)
    closed = sum(state is not None for state in states) - reached
    there = re.fullmatch(r"(\d+)(?: of (\d+))?(?: \((\d+) closed before\))?", cell)
    assert there, cell
    if all(state is not None and "mean_pressure" in state for state in states) and not there[3]:
        closed = 0  # all steps: a surface without a state at a step is not counted
    assert (int(there[1]), int(there[3] or 0)) == (reached, closed), (cell, reached, closed)
    assert int(there[2] or reached) == (len(states) if there[2] else reached)


def _name_of(head: str) -> str:
    """Return the stored name of the head of a column, as ``median Q_x [mm^3/s]``."""
    symbol = head.removeprefix("median ").partition(" [")[0]
    assert symbol in HEADS, f"the column {head!r} has no number in the oracle"
    return HEADS[symbol]


def check_cell(head: str, cell: str, states: Sequence[dict[str, float]]) -> int:
    """Compare a cell with the numbers of its surfaces."""
    name = _name_of(head)
    if name == STIFFNESS:
        ends = [np.mean([state.get(end, math.nan) for state in states]) for end in ("stiffness_low", "stiffness_high")]
        if cell and np.isfinite(ends).all():
            assert ends[0] * (1.0 - DIGITS) <= float(cell) <= ends[1] * (1.0 + DIGITS), (head, cell, ends)
        return 0
    values = [state.get(name, math.nan) for state in states]
    value, low, high, known = oracle.mean(name, values)
    if cell in ("", "–"):
        assert known == 0, (head, cell, values)
        return 0
    if name.startswith("open_"):
        open_ = sum(value > 0.0 for value in values)
        one = ("open" if open_ else "closed") if known == 1 else ""
        assert cell in (f"{open_} of {known}", one), (head, cell, values)
        return 1
    numbers = _numbers(cell)
    expected_numbers = [value, low, high] if len(numbers) == 3 else [value]
    assert len(numbers) in (1, 3), (head, cell)
    close(numbers, expected_numbers, f"{head}: {cell}", flow=oracle.is_flow(name))
    return len(numbers)


def close(found: Any, expected: Any, words: str, *, within: float = DIGITS, flow: bool = False) -> None:
    """Compare printed numbers with expected ones; a flow of 0 is exact, other zeros are of the order of rounding."""
    if not np.array_equal(found, expected, equal_nan=True):  # most numbers of JSON are equal: ten times as quick
        np.testing.assert_allclose(found, expected, rtol=within, atol=0.0 if flow else 1e-9, err_msg=words)


def _check_closing(group: Group, row: dict[str, str]) -> int:
    spans = [oracle.closing(surface, row["axis"]) for surface in group.surfaces]
    closed = [span for span in spans if math.isfinite(span[1])]
    assert row["ways closed"] == f"{len(closed)} of {len(spans)}"
    ends = {"open": [span[0] for span in closed or spans], "closed": [span[1] for span in closed]}
    count = 0
    for head, cell in row.items():
        if values := ends.get(head.split()[0]) if " " in head else None:
            numbers = _numbers(cell)
            expected = [np.mean(values), min(values), max(values)]
            close(numbers, expected[: len(numbers)], f"{head}: {cell}")
            count += len(numbers)
    return count


# rows of JSON and CSV


def check_rows(made: Made, rows: Sequence[dict[str, Any]], labels: Sequence[str]) -> int:
    """Compare the rows of single surfaces; every surface that has a state has a row."""
    count = 0
    expected = 0
    for surface in made.surfaces:
        own = [row for row in rows if all(_same(row[name], label) for name, label in surface.labels.items())]
        states = _states_of(surface, labels)
        assert len(own) == len(states), (surface.labels, len(own), len(states))
        expected += len(states)
        for row, state in zip(own, states, strict=True):
            numbers = _with_seal(made.kind, state) or {}
            for name, value in row.items():
                if name in (*surface.labels, "step", "state", STIFFNESS):
                    continue
                wanted = surface.legs[int(row["step"]) - 1] if name == "leg" else numbers.get(name, math.nan)
                assert name == "leg" or name in numbers or value is None, f"{name} has no number in the oracle"
                found = math.nan if value is None else float(value)
                wanted = wanted if math.isfinite(wanted) else math.nan  # a Knudsen number of a closed way
                close(found, wanted, f"{surface.labels}, {name}", within=TIGHT, flow=oracle.is_flow(name))
                count += value is not None
    assert len(rows) == expected
    return count


def _same(found: Any, label: Any) -> bool:
    return float(found) == float(label) if isinstance(label, int | float) else found == label


def _states_of(surface: Surface, labels: Sequence[str]) -> list[dict[str, float]]:
    if labels:
        return [numbers for label in labels if (numbers := oracle.recorded(surface, label)) is not None]
    solved = np.flatnonzero(np.isfinite(surface.along["mean_pressure"]))
    return [{n: float(v[k]) for n, v in surface.along.items()} for k in solved]


# the questions


def run(made: Made) -> int:
    """The table after `roughvol run STUDY`, its closing loads, and the number of cases."""
    text = made.printed
    if made.kind.changes:  # a run of the part alone has the numbers of the part
        text = call(made, "run", made.kind.file, "--jobs", "1", "--out", f"runs/{made.kind.name}-alone")
    elif made.kind.afterwards:
        text = call(made, "run", made.kind.file, "--jobs", "1")
    assert text.startswith(f"{_cases(made)} case")
    stored = made.stored
    if "residual" in stored:
        states = re.search(r"^(\d+) states?, .*\nlargest residual η/σ (.*)$", text, re.MULTILINE)
        assert states
        assert int(states[1]) == int(stored["residual"].notnull().sum())
        close(float(states[2]), float(stored["residual"].max()), "largest residual", within=0.06)
    return 1 + check_means(made, text) + sum(check_table(made, table) for table in tables(text))


def check_means(made: Made, text: str) -> int:
    """Compare the means of an ensemble with their intervals, in the lines below a table."""
    found = re.findall(
        r"^mean (\S+) at (\w+) = ([\d.]+(?: \w+)?), D = ([\d.]+), m = \d+: ([\d.]+) ± ([\d.]+) %", text, re.MULTILINE
    )
    means = [yaml.safe_load(made.kind.study).get("ensemble", {}).get(key, {}) for key in ("accuracy", "at")]
    assert len(found) == len(means[0]) * len(means[1].get("pressure", ()))
    for symbol, kind, load, D, value, share in found:
        state, name = made.stored.sel(D=float(D), ensemble_at=f"{kind}={load}"), HEADS.get(symbol, symbol)
        mean, low, high = float(state[f"{name}_mean"]), *state[f"{name}_interval"].values.tolist()
        close(float(value), mean, f"mean {symbol}")
        close(float(share), 50.0 * (high - low) / mean, "half width of the interval", within=0.05)  # two digits
    return 2 * len(found)


def _cases(made: Made) -> int:
    return len(made.surfaces) or len(json.loads(made.stored.attrs["case_ids"]))


def show(made: Made) -> int:
    """The tables of all steps, `roughvol show RUN`."""
    text = call(made, "show", made.kind.asked)
    found = tables(text)
    assert len(found) == len(made.groups)
    for table, group in zip(found, made.groups, strict=True):
        solved = np.any([np.isfinite(surface.along["mean_pressure"]) for surface in group.surfaces], axis=0)
        assert len(table.rows) == solved.sum()
    return check_means(made, text) + sum(check_table(made, table) for table in found)


def _at(made: Made) -> list[str]:
    return [part for text in made.kind.at for part in ("--at", text)]


def show_at(made: Made) -> int:
    """The table of states at loads, `roughvol show RUN --at LOAD`."""
    found = tables(call(made, "show", made.kind.asked, *_at(made)))
    expected = [
        any(oracle.recorded(surface, label) is not None for surface in group.surfaces)
        for group in made.groups
        for label in made.kind.at
    ]
    assert sum(len(table.rows) for table in found) == sum(expected)
    return sum(check_table(made, table) for table in found)


def show_json(made: Made) -> int:
    """The numbers of every surface at loads, `roughvol show RUN --at LOAD --json`."""
    found = json.loads(call(made, "show", made.kind.asked, "--json", *_at(made)))["rows"]
    alike(made, found, roughvol.show, made.kind.asked, made.kind.at)
    return check_rows(made, found, made.kind.at)


def show_csv(made: Made) -> int:
    """The numbers of every surface at all steps as comma-separated values, `roughvol show RUN --csv`."""
    rows = csv.DictReader(io.StringIO(call(made, "show", made.kind.asked, "--csv")))
    return check_rows(made, [{name: _plain(value) for name, value in row.items()} for row in rows], ())


def _plain(text: str) -> Any:
    if text in ("", "True", "False"):
        return {"": None, "True": 1.0, "False": 0.0}[text]
    with contextlib.suppress(ValueError):
        return float(text)
    return text


def compare(made: Made) -> int:
    """The numbers of two runs side by side, `roughvol compare RUN RUN --at LOAD --json`, of some kinds as a table."""
    beside, load = made.kind.beside
    other, words = made.beside, ("compare", made.kind.asked, beside, "--at", load)
    found = json.loads(call(made, *words, "--json"))["rows"]
    alike(made, found, roughvol.compare, [made.kind.asked, beside], [load])
    expected = [
        any(oracle.recorded(surface, load) is not None for surface in group.surfaces)
        for group in made.groups + other.groups
    ]
    assert len(found) == sum(expected)
    count = 0
    if made.kind.name in TWICE:
        (table,) = tables(call(made, *words))
        assert len(table.rows) == len(found)
        count = check_table(made, table, lambda words: other if words.partition(", ")[0] == beside else made)
    for row in found:
        own = other if row["run"].partition(", ")[0] == beside else made
        group = own.group(row["run"])
        states = [_with_seal(own.kind, oracle.recorded(surface, row["state"])) or {} for surface in group.surfaces]
        reached = [state for state in states if math.isfinite(state.get("mean_pressure", math.nan))]
        closed = [state for state in states if state and state not in reached]
        counts = [row[name] for name in ("surfaces", "reached", "closed_before")]
        assert counts == [len(states), len(reached), len(closed)]
        for name, value in row.items():
            if name in ("state", "run", "surfaces", "reached", "closed_before", STIFFNESS):
                continue
            stem = re.sub("_(low|high)$", "", name)
            numbers = [state.get(stem, math.nan) for state in states]
            mean, low, high, known = oracle.mean(stem, numbers)
            expected = {f"{stem}_low": low, f"{stem}_high": high}.get(name, mean)
            if name.startswith("open_") and known:
                expected = sum(number > 0.0 for number in numbers)
            wanted = expected if math.isfinite(expected) else math.nan
            close(math.nan if value is None else value, wanted, f"{row['run']}, {name}", within=TIGHT, flow=True)
            count += value is not None
    return count


def run_python(made: Made) -> int:
    """The dataset that `roughvol.run(STUDY)` returns, every variable."""
    with python(made):
        alone = {"out": f"runs/{made.kind.name}-alone"} if made.kind.changes else {}
        found = roughvol.run(made.kind.file, jobs=1, changes=made.kind.changes, **alone)
    return check_dataset(made, found)


def open_python(made: Made) -> int:
    """The dataset that `roughvol.open(RUN)` returns, every variable."""
    with python(made):
        found = roughvol.open(made.kind.asked, changes=made.kind.changes)
    return check_dataset(made, found)


def check_dataset(made: Made, found: Any) -> int:
    """Compare a dataset with study.nc, bit for bit."""
    stored = made.stored.squeeze([name for name in made.kind.lists if name not in found.dims])
    assert set(found.data_vars) == set(stored.data_vars)
    for name in stored.data_vars:
        values = found.variables[name].transpose(*stored.variables[name].dims).values
        np.testing.assert_array_equal(values, stored.variables[name].values, str(name))
    return sum(variable.size for variable in stored.data_vars.values())


def at_python(made: Made) -> int:
    """The numbers of every surface at loads, `roughvol.open(RUN).roughvol.at(LOAD)`."""
    count = 0
    for label in made.kind.at:
        with python(made):
            found = roughvol.open(made.kind.asked, changes=made.kind.changes).roughvol.at(label)
        for surface in made.surfaces:
            place = {name: value for name, value in surface.labels.items() if name in found.dims}
            own = _by_direction(found.sel(place))
            numbers = oracle.recorded(surface, label)
            if numbers is None:
                assert not own["reached"], surface.labels
                assert math.isnan(own["mean_pressure"]), surface.labels
                continue
            for name in numbers.keys() & own.keys() - {"leg", STIFFNESS}:
                wanted = numbers[name] if math.isfinite(numbers[name]) else math.nan
                given = own[name] if math.isfinite(own[name]) else math.nan
                close(given, wanted, f"{surface.labels}, {name}", within=TIGHT, flow=oracle.is_flow(name))
                count += math.isfinite(wanted)
    return count


def _by_direction(ds: xr.Dataset) -> dict[str, float]:
    """Return the numbers of a surface by name, those along an axis as ``leak_rate_x``."""
    numbers = {}
    for name in ds.data_vars:
        variable = ds.variables[name]  # quicker than the array with its coordinates
        if variable.dims == ("axis",):
            numbers |= {f"{name}_{axis}": float(v) for axis, v in zip(ds.indexes["axis"], variable.values, strict=True)}
        if not variable.dims:
            numbers[str(name)] = float(variable)
    return numbers


def status(made: Made) -> int:
    """The number of finished cases, `roughvol status STUDY`."""
    text = call(made, "status", made.kind.file)
    cases = _cases(made)
    assert f"runs/{made.kind.name}: {cases} of {cases} cases finished, collected" in text
    with python(made):
        assert len(roughvol.status(made.kind.file, changes=made.kind.changes).done) == cases
    return 1


# figures


def plot(made: Made) -> int:
    """The points of the curves of V* over the load, `roughvol plot RUN v_of_p --format csv`."""
    return _plotted(made, "v_of_p", check_volumes)


def plot_leak(made: Made) -> int:
    """The points of the leaks along x and y over the load, `roughvol plot RUN leak_of_p --format csv`."""
    return _plotted(made, "leak_of_p", check_leaks)


def _plotted(made: Made, figure: str, check: Callable[[Made, list[Curve]], int]) -> int:
    path = call(made, "plot", made.kind.asked, figure, "--format", "csv").strip()
    points: dict[tuple[str, ...], list[tuple[float, float]]] = {}
    with (made.folder / path).open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            assert "nan" not in row.values()
            surface = row["case"] if "case" in row else f"D = {row['D']}, m = {row['m']}"
            key = f"{row['curve']}, {surface}", row.get("seed", ""), row.get("axis", ""), row["curve"]
            points.setdefault(key, []).append((float(row["x"] or "nan"), float(row["y"] or "nan")))
    curves = [Curve(*key, np.array(values).T) for key, values in points.items()]
    return check(made, curves)


def plot_python(made: Made) -> int:
    """The lines of the figure of V*, of some kinds that of the leak too, that `roughvol.plot(RUN, NAME)` returns."""
    count = 0
    with python(made):
        leaks = made.kind.name in TWICE
        for name, check in [("v_of_p", check_volumes), *([("leak_of_p", check_leaks)] if leaks else [])]:
            curves = []
            for line in roughvol.plot(made.kind.asked, name, changes=made.kind.changes).axes[0].get_lines():
                label = str(line.get_label()).replace("$", "").replace("\n", " ")
                if not label.startswith("_"):
                    axis = label[-1] if re.search("along [xy]$", label) else ""
                    curves.append(Curve(label, "", axis, label, np.array(line.get_data(), dtype=float)))
            count += check(made, curves)
    return count


def _curve(
    made: Made, curves: Sequence[Curve], group: Group, axis: str = "", *, each: bool = False
) -> np.ndarray | None:
    """Return the curve of all surfaces of a group, by its words: that with a seed is the curve of one of several.

    ``each``: the points of all surfaces, by load and number.
    """
    several = len(group.surfaces) > 1
    found = [
        curve.points
        for curve in curves
        if not re.search("closed|without fluid", curve.name)
        and not (several and curve.seed)
        and curve.axis == axis
        and curve.points.size
        and made.group(curve.words) is group
    ]
    if each and found:
        return _sorted(np.concatenate(found, axis=1))
    assert len(found) <= 1, (curves, group.words, axis)
    return found[0] if found else None


def _sorted(points: np.ndarray) -> np.ndarray:
    """Return points by load and number."""
    return points[:, np.lexsort(points[::-1])]


def _load(surface: Surface, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return load and number of the first leg at the states that have both, in the order of the load."""
    x = surface.along.get("nominal_pressure", surface.along["mean_pressure"])
    y = surface.along[name]
    kept = (surface.legs == 1) & np.isfinite(x) & np.isfinite(y)
    return x[kept], y[kept]


def check_volumes(made: Made, curves: Sequence[Curve]) -> int:
    """Compare V* over the load: the states of every surface, and the mean of several by cubics between them."""
    count = 0
    for curve in curves:
        group = made.group(curve.words)
        if curve.seed and len(group.surfaces) > 1:
            (surface,) = (surface for surface in group.surfaces if surface.seed == int(curve.seed))
            close(curve.points, _load(surface, "free_volume"), f"V* of {curve.words}, {curve.seed}", within=TIGHT)
            count += curve.points.size
    for group in made.groups:
        points = _curve(made, curves, group)
        assert points is not None, f"no curve of {group.words}"
        each = [_load(surface, "free_volume") for surface in group.surfaces]
        if len(each) > 1:
            expected = points[0], np.mean([_volume_at(points[0], *one) for one in each], axis=0)
            assert points[0].size > 100
        else:
            (expected,) = each
        close(points, expected, f"V* of {group.words}", within=TIGHT)
        count += points.size
    return count


def _volume_at(x: np.ndarray, load: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Return V* of a surface at loads: cubics, from the last unloaded step of a region on."""
    last = np.flatnonzero(load == load[0])[-1]
    return np.where(x == load[0], volume[0], PchipInterpolator(load[last:], volume[last:])(x))


def check_leaks(made: Made, curves: Sequence[Curve]) -> int:
    """Compare leaks over the load: open states of a surface; of several the median, by cubics of the logarithm.

    Between its last open state and the next one, the leak of a surface falls to 0 along a straight line. Under fluid
    pressure the leak of every surface is known at its recorded states alone.
    """
    count = 0
    for group in made.groups:
        for axis in "xy":
            leak_rate = "leak_rate" if "leak_rate_x" in group.surfaces[0].along else "gas_leak_rate"
            each = [_load(surface, f"{leak_rate}_{axis}") for surface in group.surfaces]
            lifted = f"{leak_rate}_dry_{axis}" in group.surfaces[0].along
            points = _curve(made, curves, group, axis, each=lifted)
            if points is None:
                assert not any((leak > 0.0).any() for _, leak in each), f"no curve of {group.words} along {axis}"
                continue
            if lifted:
                expected = _sorted(
                    np.concatenate([(load[leak > 0.0], leak[leak > 0.0]) for load, leak in each], axis=1)
                )
            elif len(each) > 1:
                assert points[0].size > 100
                ends = [oracle.closing(surface, axis)[1] for surface in group.surfaces if axis in surface.closes]
                ends = ends or [math.nan] * len(each)
                every = zip(each, ends, strict=True)
                expected = points[0], np.median([_leak_at(points[0], *one, end) for one, end in every], axis=0)
            else:
                ((load, leak),) = each
                expected = load[leak > 0.0], leak[leak > 0.0]
            close(points, expected, f"leak of {group.words} along {axis}", within=1e-6, flow=True)
            count += points.size
    for curve in curves:
        if "closed" in curve.name:  # the mark of a closing has a load and no leak
            assert np.isnan(curve.points[1]).all()
            count += 1
        elif "without fluid" in curve.name and curve.seed:
            group = made.group(curve.words)
            (surface,) = (surface for surface in group.surfaces if surface.seed == int(curve.seed))
            load, leak = _load(surface, f"leak_rate_dry_{curve.axis}")
            close(curve.points, (load[leak > 0.0], leak[leak > 0.0]), str(curve.words), within=TIGHT, flow=True)
            count += curve.points.size
    return count


def _leak_at(x: np.ndarray, load: np.ndarray, leak: np.ndarray, closes: float) -> np.ndarray:
    """Return the leak of a surface at loads: cubics of logarithms between open states, then a line to 0.

    The line ends at the solved closing load, or else at the next state.
    """
    open_ = np.flatnonzero(leak > 0.0)
    if not open_.size:
        return np.zeros(x.shape)
    last, loaded = open_[-1], open_[load[open_] > 0.0]
    if loaded.size > 1:
        inside = np.clip(x, load[loaded[0]], load[last])
        logs = PchipInterpolator(np.log(load[loaded]), np.log(leak[loaded]))(np.log(inside))
    else:
        logs = np.full(x.shape, np.log(leak[last]))
    if loaded.size < open_.size and loaded.size:  # a region, unloaded at first: cubics over the load
        begins = loaded[0] - 1
        light = PchipInterpolator(load[begins : last + 1], np.log(leak[begins : last + 1]))(x)
        logs = np.where(x < load[loaded[0]], np.where(x == load[0], np.log(leak[0]), light), logs)
    found = np.exp(logs)
    end = closes if math.isfinite(closes) else load[last + 1] if last + 1 < load.size else math.nan
    if math.isfinite(end):
        found = np.where(x > load[last], np.interp(x, [load[last], end], [leak[last], 0.0]), found)
    return found


# the report


def report(made: Made) -> int:
    """The tables of claims.json and report.md, `roughvol report RUN`."""
    with kit.without_figures():  # they are questions of their own
        *_, page = call(made, "report", made.kind.asked).splitlines()
    folder = (made.folder / page).parent
    data = json.loads((folder / "claims.json").read_text(encoding="utf-8"))
    alike(made, data, roughvol.report_on, [made.kind.asked])
    text = (folder / "report.md").read_text(encoding="utf-8")
    count = 0
    for run in data["surfaces"]:
        for table in run["tables"]:
            rows = [dict(zip(table["head"], row, strict=True)) for row in table["rows"]]
            assert all(f"| {' | '.join(row)} |" in text for row in table["rows"])
            found = Table(f"{run['name']}, {table['title'].removeprefix('States, ')}", table["head"], rows)
            count += _check_part(made, found)
    stored = made.stored
    parts = 1 if not made.kind.lists else stored.sizes[made.kind.lists[0]]
    assert sum(run["cases"] for run in data["runs"]) == int(stored["Sq"].notnull().sum())
    assert len(data["surfaces"]) == parts
    if "residual" in stored:
        solved = [re.match(r"(\d+) of (\d+) converged", part["loading"]["States"]) for part in data["surfaces"]]
        assert sum(int(one[1]) for one in solved if one) == int(stored["residual"].notnull().sum())
    if "case" in stored.dims:
        count += _check_map(data["surfaces"][0]["surface"], stored)
    moduli = sorted(_numbers(part["loading"]["Contact modulus E*"])[0] for part in data["surfaces"])
    expected = [made.kind.modulus] * parts if isinstance(made.kind.modulus, float) else made.kind.modulus.values()
    if np.isfinite(list(expected)).all():
        close(moduli, sorted(expected), "E*")
    return count + parts


def _check_part(made: Made, table: Table) -> int:
    if "On every leg" in table.title:
        return _check_path(made, table)
    if "Sdq" not in table.head:
        return check_table(made, table)
    stored = made.stored
    count = 0
    for row in table.rows:
        where = {"case": row["file"]} if "file" in row else {"D": float(row["D"]), "m": int(row["m"])}
        for head, cell in row.items():
            if head.startswith(("Sq", "Sdq")):
                values = stored[head.partition(" ")[0]].sel(where).values.ravel()
                values = values[np.isfinite(values)]
                numbers = _numbers(cell)
                close(numbers, [values.mean(), values.min(), values.max()][: len(numbers)], f"{head}: {cell}")
                count += len(numbers)
    return count


def _numbers(text: str) -> list[float]:
    return [float(found) for found in re.findall(r"-?\d[\d.]*(?:e-?\d+)?", text)]


def _check_path(made: Made, table: Table) -> int:
    """Compare quantities on the legs of a path with those of the two steps around the pressure."""
    (group,) = made.groups
    count = 0
    for row in table.rows:
        axis = re.search("along ([xy])", row["quantity"])
        for head in ("leg 1", "leg 2"):
            ends = []
            for surface in group.surfaces:
                values = surface.along[HEADS.get(row["quantity"], f"transmissivity_{axis[1] if axis else ''}")]
                values = values * surface.along["free_volume"] ** 3 if axis else values
                steps = np.flatnonzero(surface.legs == int(head[-1]))
                steps = steps if head == "leg 1" else np.concatenate([steps[:1] - 1, steps])
                p = surface.along["mean_pressure"][steps]
                p, y = (p, values[steps]) if p[0] < p[-1] else (p[::-1], values[steps][::-1])
                k = min(int(np.searchsorted(p, float(row["p*"]) * (1.0 - 1e-5))), p.size - 1)
                ends.append(sorted((y[k] if p[k] <= float(row["p*"]) * (1.0 + 1e-5) else y[max(k - 1, 0)], y[k])))
            of = np.median if axis else np.mean
            low, high = of([end[0] for end in ends]), of([end[1] for end in ends])
            assert low * (1.0 - DIGITS) <= float(row[head]) <= high * (1.0 + DIGITS), (row, head, low, high)
            count += 1
    return count


def _check_map(facts: dict[str, str], stored: Any) -> int:
    """Compare Sq and Sdq of the only file."""
    found = {head.partition(",")[0]: _numbers(cell) for head, cell in facts.items() if head.startswith(("Sq", "Sdq"))}
    assert bool(found) == (stored.sizes["case"] == 1)
    for name, numbers in found.items():
        close(numbers, [float(stored[name].values.ravel()[0])], name)
    return len(found)


# questions that compute

ERRORS = ("residual", "mean_pressure_bound", "iterations", "convolutions", "convolutions_fp32", "level_convolutions")


def check(made: Made) -> int:
    """Sq and Sdq of the first surface, and the numbers of cases and states, `roughvol check STUDY`."""
    text = call(made, "check", made.kind.file)
    (found,) = re.findall(r"Sq = ([\d.]+)(?: um)?, Sdq = ([\d.]+)", text)
    stored = made.stored
    expected = [stored[name].values.ravel()[0] for name in ("Sq", "Sdq")]
    states = int(stored["residual"].notnull().sum()) if "residual" in stored else 0
    if made.kind.name == "file-changed":  # the numbers are those of the file as it is now
        expected[0] = np.load(made.folder / "worn.npy").std()
        assert float(found[0]) == pytest.approx(expected[0], rel=DIGITS)
        return 1
    close([float(number) for number in found], expected, text[-900:], within=1e-3)
    if made.kind.name in ("ensemble", "own"):  # it decides itself how many surfaces it takes
        return 2
    words = f"# {_cases(made)} case{'s' * (_cases(made) > 1)}, {states} states to solve"
    assert words in text
    if made.kind.name in TWICE:
        with python(made):
            seen = roughvol.check(made.kind.file, changes=made.kind.changes)
        assert (seen.estimate.cases, seen.estimate.steps) == (_cases(made), states)
        close(seen.plain()["surface"]["Sq"], expected[0], "Sq", within=1e-6)
    return 3


def press(made: Made) -> int:
    """The numbers along the steps of the heights of a run, pressed again by `roughvol.press(HEIGHTS, …)`."""
    study = yaml.safe_load(made.kind.study)
    for change in made.kind.changes:
        key, _, value = change.partition("=")
        study[key.split(".")[0]][key.split(".")[1]] = value
    options = {"L": study["surface"].get("L", 100.0), **study.get("material", {}), "jobs": 1}
    options |= {name: study[name] for name in ("sweep", "record", "solver", "fluid", "ensemble") if name in study}
    ds = made.stored.squeeze(made.kind.lists if made.kind.changes else ())
    further = {name: value for name, value in study["surface"].items() if name == "against"}
    options |= {"surface": further | {"sides": ds.attrs["sides"]}}
    with python(made):
        if made.kind.name == "files":
            roughvol.press(study["surface"]["files"], **options)
        if made.kind.name in ("file-changed", "bodies"):
            found = roughvol.press(study["surface"]["file"], **options)
            if made.kind.name == "file-changed":
                close(float(found["Sq"]), np.load(made.folder / "worn.npy").std(), "Sq", within=TIGHT)
                return 1
        else:
            maps = _maps(ds.isel(dict.fromkeys(made.kind.lists, 0), missing_dims="ignore"))
            if made.kind.name in ("seeds", "solved", "m", "D", "ensemble"):
                roughvol.press(maps, **options)
            found = roughvol.press(maps[-1], **options)
    cases = ds if "case" in ds.dims else ds.stack(case=["D", "m", "seed"])
    return _check_pressed(found, cases.isel(case=-1))


def _check_pressed(found: Any, stored: Any) -> int:
    """Compare every number of a surface that was pressed again, but for sizes of errors and numbers of iterations."""
    count = 0
    for name in stored.data_vars:
        variable = stored.variables[name]
        kept = variable.dtype.kind == "f" and not {"x", "y", "observable"} & set(variable.dims)
        if not kept or name in ERRORS or name.endswith(("_time", "_error")):
            continue
        assert name in found, name
        close(found.variables[name].transpose(*variable.dims).values, variable.values, name, within=1e-5)
        count += variable.size
    return count


def _maps(ds: Any) -> list[np.ndarray]:
    """Return the stored heights of every surface; those of an ensemble are not stored, flat ones take their place."""
    if "heights" not in ds:
        return [np.zeros((5, 5)), np.zeros((9, 9))]
    stacked = ds["heights"].stack(surface=[dim for dim in ds["heights"].dims if dim not in ("x", "y")])
    return [stacked.isel(surface=k).transpose("x", "y").values for k in range(stacked.sizes["surface"])]


# read-offs


def ask(made: Made) -> int:
    """The load, modulus and Sq of a leak, `roughvol ask RUN --leak-rate VALUE`: asked for the leak of a solved step."""
    every = made.surfaces
    leaks = {"leak_rate_x": "mm^3/s", "gas_leak_rate_x": "mbar*l/s"}
    units = [unit for name, unit in leaks.items() if any(name in surface.along for surface in every)]
    count, units = 0, units or ["mm^3/s"]
    for unit, axis in itertools.product(units, made.kind.axes):
        flow = "leak_rate" if unit == "mm^3/s" else "gas_leak_rate"
        paths = [_path(surface, f"{flow}_{{}}", made.kind.squares) for surface in every]
        step = _leakiest_step(paths, axis) if paths and flow + "_x" in every[0].along else None
        leak = step[1] if step else 1e-9
        words = ("--leak-rate", f"{leak!r} {unit}")
        answer = json.loads(call(made, "ask", made.kind.asked, *words, "--json"))
        alike(made, answer, roughvol.ask, made.kind.asked, leak_rate=words[1])
        found = answer["answers"]
        count += sum(_check_answer(answer, paths, leak) for answer in found)
        if step is None:
            continue
        (exact,) = (answer for answer in found if answer["axis"] == axis)
        close(exact["value"], step[0], f"load of {leak} {unit}", within=1e-6)
        if flow == "leak_rate" and axis == "x" and "plastic_volume" not in every[0].along:
            count += _ask_others(made, axis, step, paths)
    if made.kind.name in TWICE:
        text = call(made, "ask", made.kind.asked, *words)
        assert all(f"along {axis}: " in text for axis in made.kind.axes)
    return count


def _path(surface: Surface, name: str, times: float = 1.0) -> dict[str, np.ndarray]:
    """Return load, p* and flows of the first leg of a surface, flows as many times as large."""
    on = (surface.legs == 1) & np.isfinite(surface.along["mean_pressure"])
    flows = {axis: times * surface.along[name.format(axis)][on] for axis in "xy" if name.format(axis) in surface.along}
    return {"p": surface.along.get("nominal_pressure", surface.along["mean_pressure"])[on], **flows}


def _leakiest_step(paths: Sequence[dict[str, np.ndarray]], axis: str) -> tuple[float, float, int] | None:
    """Return load, leak and surface of the last step at which no other surface leaks more, as the steps before show."""
    found = []
    for k, path in enumerate(paths):
        for load, leak in zip(path["p"], path[axis], strict=True):
            others = [other for j, other in enumerate(paths) if j != k]
            before = [other[axis][other["p"] <= load * (1.0 + 1e-5)] for other in others]
            if leak > 0.0 and all(values.size and values[-1] <= leak for values in before):
                found.append((float(load), float(leak), k))
    return max(found, default=None)


def _check_answer(answer: dict[str, Any], paths: Sequence[dict[str, np.ndarray]], leak: float) -> int:
    """Compare a load with the steps around it: every surface leaks less at its next step, one leaks more before."""
    axis, value, (low, high) = answer["axis"], answer["value"], answer["interval"]
    near = leak * (1.0 - 1e-6), leak * (1.0 + 1e-6)
    if value is None and high is None:  # beyond the last step
        assert max(path[axis][-1] for path in paths) > near[0]
        return 1
    if value is None and low == 0.0:  # before the first step
        assert max(path[axis][0] for path in paths) <= near[1]
        return 1
    middle = value if value is not None else low
    assert low * (1.0 - 1e-9) <= middle <= high * (1.0 + 1e-9)
    beyond = [path[axis][path["p"] >= high * (1.0 - 1e-6)] for path in paths]
    assert all(values[0] <= near[1] for values in beyond if values.size), (answer, leak)
    assert any((path[axis][path["p"] <= low * (1.0 + 1e-6)] >= near[0]).any() for path in paths), (answer, leak)
    return 3


def _ask_others(made: Made, axis: str, step: tuple[float, float, int], paths: Sequence[dict[str, np.ndarray]]) -> int:
    """Compare E* and Sq: at the load P, E* P/p leaks as E* does at p; Sq P/p leaks (P/p)^3 times as much."""
    load, count = 1.25 * step[0], 0
    before = [other["p"] <= step[0] * (1.0 + 1e-5) for other in paths]
    over_cubes = [other[axis][on][-1] / other["p"][on][-1] ** 3 for other, on in zip(paths, before, strict=True)]
    leakiest = max(over_cubes) <= step[1] / step[0] ** 3 * (1.0 + 1e-5)  # of heights in proportion, too
    for unknown, leak in (("modulus", step[1]), *([("Sq", step[1] * 1.25**3)] if leakiest else [])):
        words = ("--leak-rate", f"{leak!r} mm^3/s", "--for", unknown, "--at", f"pressure={load!r} MPa", "--json")
        found = json.loads(call(made, "ask", made.kind.asked, *words))["answers"]
        (exact,) = (answer for answer in found if answer["axis"] == axis)
        E_star = made.kind.modulus if isinstance(made.kind.modulus, float) else next(iter(made.kind.modulus.values()))
        close(
            exact["value"], 1.25 * (E_star if unknown == "modulus" else made.surfaces[step[2]].Sq), unknown, within=1e-6
        )
        count += 1
    return count


def ask_closed(made: Made) -> int:
    """The loads between which the last way of all surfaces closes, `roughvol ask RUN --closed`."""
    answers = json.loads(call(made, "ask", made.kind.asked, "--closed", "--json"))
    alike(made, answers, roughvol.ask, made.kind.asked)
    found = answers["answers"]
    for answer in found:
        spans = [oracle.closing(surface, answer["axis"]) for surface in made.surfaces]
        ends = max(span[0] for span in spans), max(span[1] for span in spans)
        low, high = answer["interval"]
        assert (answer["value"] is None) == (ends[0] == 0.0 or math.isinf(ends[1]))
        close([low, math.inf if high is None else high], ends, f"closing along {answer['axis']}", within=TIGHT)
    return 2 * len(found)


def creep(made: Made) -> int:
    """The leak at the loads of two solved steps, `roughvol creep RUN --law LAW --at LOAD --times TIMES`."""
    every = made.surfaces
    leak_rate = "leak_rate_{}" if every and "leak_rate_x" in every[0].along else "gas_leak_rate_{}"
    paths = [_path(surface, leak_rate, made.kind.squares) for surface in every]
    p = paths[0]["p"] if paths else np.array([1.0, 2.0])
    first = max(1 if p.size > 2 else 0, int(np.argmax(p > 0.0)))
    ends = [float(p[first]), min([float(p[first + 1]), *(float(path["p"][-1]) for path in paths)])]
    law = made.folder / "law.yaml"
    law.write_text(f"table: {{times: [1 s, 1 h], ratios: [1, {ends[1] / ends[0]!r}]}}\n", encoding="utf-8")
    unit = " MPa" if made.kind.modulus == 10.0 or made.kind.lists else ""
    words = ("--law", law.name, "--at", f"pressure={ends[0]!r}{unit}", "--times", "1 s, 1 h")
    (table,) = tables(call(made, "creep", made.kind.asked, *words))
    if made.kind.name in TWICE:
        with python(made):
            history = roughvol.creep(made.kind.asked, law, at=words[3], times=words[5], changes=made.kind.changes)
        for axis, leak in history.leak.items():
            for row, value in zip(table.rows, leak.value, strict=True):
                cell = next(cell for head, cell in row.items() if head.startswith((f"Q_{axis}", "Q_seal")))
                assert "clos" in cell or float(cell) == pytest.approx(value, rel=0.05)
    count = 0
    for row, load in zip(table.rows, ends, strict=True):
        areas = [_around(_path(surface, "contact_area_fraction"), load, "x") for surface in every]
        count += _between(row["A*"], [np.mean([area[k] for area in areas]) for k in (0, 1)])
        for axis in made.kind.axes:
            leaks = [_around(path, load, axis) for path in paths]
            for head, cell in row.items():
                if head.startswith(f"Q_{axis}") and "closing" not in cell:
                    shares = (0.16, 0.84) if head.endswith("16-84 %") else (0.5,)
                    lows, highs = (np.quantile([leak[k] for leak in leaks], shares) for k in (0, 1))
                    texts = cell.replace("closed", "0").split(" to ")
                    texts = texts * len(lows) if cell == "0" else texts
                    count += sum(_between(*one) for one in zip(texts, zip(lows, highs, strict=True), strict=True))
                elif head == f"open along {axis}":
                    surely = sum(leak[0] > 0.0 for leak in leaks)
                    assert surely <= int(cell.split()[0]) <= sum(leak[1] > 0.0 for leak in leaks)
    return count


def _around(path: dict[str, np.ndarray], load: float, name: str) -> tuple[float, float]:
    """Return the smallest and the largest number of a surface at the steps around a load; equal on a step."""
    near = np.flatnonzero(np.isclose(path["p"], load, rtol=1e-5, atol=0.0))
    k = int(np.searchsorted(path["p"], load))
    ends = path[name][near[:1]] if near.size else path[name][[k - 1, min(k, path["p"].size - 1)]]
    return float(ends.min()), float(ends.max())


def _between(text: str, ends: Sequence[float]) -> int:
    """Check that a printed number is between two numbers, but for the rounding of its last digit."""
    digits = re.sub(r"e.*", "", text).partition(".")[2]
    unit = 0.51 * 10.0 ** (int((re.findall(r"e(.*)", text) or ["0"])[0]) - len(digits))
    assert ends[0] - unit <= float(text) <= ends[1] + unit, (text, ends)
    return 1


# the leak card


def card(made: Made) -> int:
    """Load, leaks and closing loads of the leak card, `roughvol card STUDY --at LOAD --json`."""
    load = made.kind.card
    found = json.loads(call(made, "card", made.kind.file, "--at", load, "--jobs", "1", "--json"))
    alike(made, found, roughvol.card, made.kind.file, load, jobs=1)
    own = made
    if made.kind.afterwards:  # a card is of the study and the files as they are now
        call(made, "run", made.kind.file, "--out", "runs/now", "--fresh", "--jobs", "1")
        own = Made(made.kind, made.folder, "now")
    if not made.kind.lists or made.kind.changes:
        if made.kind.squares != 1.0:  # one square patch, repeated
            (along,) = (way["leak"] for way in found["ways"] if way["axis"] == made.kind.axes)
            close(found["seal"]["leak"], made.kind.squares * along, "leak of the seal", within=1e-5)
        if "coarser grids" in made.kind.title:
            parts = ("solver", "grid", "window", "levelling")[: 3 if "periodic" in made.kind.title else 4]
            for way in found["ways"]:
                assert tuple(way["parts"]) == parts
                assert None not in (way["leak_interval"], way["closing_pressure_interval"]), "a part is unknown"
        return _check_card(own.groups, found, load)
    count = 0
    for words, part in found.items():
        count += _check_card([group for group in own.groups if group.words[0] == words], part, load)
    assert len(found) == len({group.words[0] for group in own.groups})
    return count


def _check_card(groups: Sequence[Group], found: dict[str, Any], load: str) -> int:
    surfaces = [surface for group in groups for surface in group.surfaces]
    states = [oracle.recorded(surface, load) for surface in surfaces]
    assert all(state is not None for state in states)
    assert len(found["surfaces"]) == len(surfaces)
    count = 0
    for name in ("mean_pressure", "nominal_pressure"):
        values = [state[name] for state in states if name in state]
        if found["load"][name] is None:
            assert not values or not np.isfinite(values).all() or "leak_rate_x" not in states[0]
            continue
        close(found["load"][name], np.mean(values), name, within=1e-5)
        count += 1
    for way in found["ways"]:
        axis = way["axis"]
        if f"transmissivity_{axis}" not in states[0]:  # of a gas alone
            leaks = [way["leak"]]
        elif way["unit"] == "1":  # without units: T* V*³
            leaks = [state[f"transmissivity_{axis}"] * state["free_volume"] ** 3 for state in states]
        else:
            leaks = [state[f"leak_rate_{axis}"] for state in states]
        close(way["leak"], np.median(leaks), f"leak along {axis}", within=2e-3, flow=True)  # flows of a card: 1e-3
        if way["leak_interval"] is not None:
            assert way["leak_interval"][0] <= way["leak"] <= way["leak_interval"][1]
        spans = [oracle.closing(surface, axis) for surface in surfaces]
        ends = np.mean(spans, axis=0)
        lifted = "leak_rate_dry_x" in surfaces[0].along
        closes = way["closing_pressure"]
        if closes is None:
            assert lifted or way["unit"] == "1" or not np.isfinite(ends).all(), (axis, spans)
        else:
            assert ends[0] * (1.0 - 1e-3) <= closes <= ends[1] * (1.0 + 1e-3), (axis, spans, closes)
        if way["closing_pressure_interval"] is not None:
            assert way["closing_pressure_interval"][0] < closes < way["closing_pressure_interval"][1]
        count += 2
    for beside in found.get("beside", ()):
        name = "gas_leak_rate" if beside["unit"] == "mbar*l/s" else "leak_rate"
        name += "_dry" if "dry gap" in beside["words"] else ""
        for axis in "xy":
            leaks = [state[f"{name}_{axis}"] for state in states]
            close(beside[axis], np.median(leaks), f"{name} along {axis}", within=2e-3, flow=True)
            count += 1
    return count


QUESTIONS: dict[str, Callable[[Made], int]] = {
    "run": run,
    "show": show,
    "show --at": show_at,
    "show --json": show_json,
    "show --csv": show_csv,
    "compare": compare,
    "plot v_of_p": plot,
    "plot leak_of_p": plot_leak,
    "report": report,
    "roughvol.plot": plot_python,
    "roughvol.open": open_python,
    "ds.roughvol.at": at_python,
    "roughvol.run": run_python,
    "roughvol.press": press,
    "card": card,
    "ask": ask,
    "ask --closed": ask_closed,
    "creep": creep,
    "check": check,
    "status": status,
}
