"""One stored run in words and tables: surface, loading, states, closing of the ways through the gap, warnings.

Nothing is judged here. Numbers come from the dataset; in units, where the study names them: the mean gap is V* Sq, the
nominal pressure p* E* Sq/L.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from xarray import DataArray, Dataset

from roughvol.analysis import average, leak
from roughvol.analysis.closing import load_of, spans
from roughvol.analysis.derived import derived, groups, is_pressed
from roughvol.analysis.hysteresis import hysteresis
from roughvol.analysis.legs import first_leg
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import Table, number, spread
from roughvol.observables.variables import AXES, VARIABLES, columns
from roughvol.study import HeightFile, SpectralSurface
from roughvol.surfaces.surface import intervals
from roughvol.typing import Array

STATES = 24  # rows of a table of states; a longer sweep is shown at even steps, its first and last state among them
P, A, V = "mean_pressure", "contact_area_fraction", "free_volume"
LEVELLED = {
    "none": "as in the file",
    "mean": "their mean taken off",
    "tilt": "a plane taken off",
    "quadratic": "a quadratic taken off",
}
IN_PLACE = (("nominal_pressure", P), ("leak_rate_x", "transmissivity"))
CLOSING = "Where it closes"
STARRED = ("separation", "mean_plane_separation", "indentation", P)
ROUNDING = 1e-12  # a starred number below is 0 to rounding: the mean plane, an unloaded surface


@dataclass(frozen=True)
class Facts:
    """A run in words and tables; ``surface`` and ``loading`` are pairs of a quantity and its value."""

    name: str
    title: str
    surface: tuple[tuple[str, str], ...]
    loading: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]
    tables: tuple[Table, ...]

    def plain(self) -> dict[str, Any]:
        """Return the facts as plain data for JSON."""
        tables = [{"title": t.title, "head": list(t.head), "rows": [list(r) for r in t.rows]} for t in self.tables]
        data = {"name": self.name, "title": self.title, "warnings": list(self.warnings), "tables": tables}
        return data | {"surface": dict(self.surface), "loading": dict(self.loading)}


def facts(run: Run) -> Facts:
    """Return a run in words and tables."""
    ds = run.dataset
    warnings = tuple(line.strip() for line in str(ds.attrs.get("warnings", "")).splitlines() if line.strip())
    tables = [*_surfaces(run)]
    if is_pressed(ds):
        ds = derived(ds, run.study)
        some = list(groups(ds))
        tables += closing([(name, first_leg(group)) for name, group in some])
        for name, group in some:
            tables += hysteresis(group, name if len(some) > 1 else "")
        tables += [table for name, group in some if (table := _states(name, group, several=len(some) > 1))]
    return Facts(run.name, _title(run), tuple(_map(run)), tuple(_loading(run)), warnings, tuple(tables))


def _title(run: Run) -> str:
    ds = run.dataset
    if "case" in ds.dims:
        return ", ".join(map(str, ds["case"].values.tolist()))
    D, m = (", ".join(f"{value:g}" for value in ds[name].values) for name in ("D", "m"))
    count = int(ds["Sq"].notnull().sum()) if "Sq" in ds else ds.sizes["seed"]
    return f"{count} generated surface{'s' * (count != 1)}, D = {D}, m = {m}"


# the surface


def _unit(ds: Dataset) -> str:
    unit = ds.attrs.get("length_unit")
    return f" {unit}" if unit else " (unit of L)"


def _nodes(run: Run) -> tuple[int, int] | None:
    """Return the nodes along x and y of a run of one height file, None if nothing stored shows them."""
    ds = run.dataset
    if {"nodes_x", "nodes_y"} <= set(ds.data_vars) and bool(ds["nodes_x"].notnull().all()):
        return int(ds["nodes_x"].max()), int(ds["nodes_y"].max())
    return (ds.sizes["x"], ds.sizes["y"]) if {"x", "y"} <= set(ds.sizes) else None


def _map(run: Run) -> Iterator[tuple[str, str]]:
    """Yield the surface."""
    ds, unit = run.dataset, _unit(run.dataset)
    if "case" not in ds.dims:
        made = f"random midpoint displacement, law {run.law or 'unknown'}"
        if run.study and isinstance(run.study.surface, SpectralSurface):
            made = "random fields with a power-law spectrum"
        yield "Surfaces", f"{made}, {_computed(run)} of each D and m"
        yield "L", f"{number(run.L)}{unit}"
        return
    names = ds["case"].values.tolist()
    if len(names) > 1:  # each has a row in the table of surfaces
        yield "Files", ", ".join(map(str, names))
        yield "Length of the first axis", f"{number(run.L)}{unit}"
        yield from _treatment(run)
        return
    yield "File", str(names[0])
    if nodes := _nodes(run):
        periodic = "periodic" in ds.attrs
        spacing = run.L / intervals(nodes[0], periodic)
        yield "Nodes", f"{nodes[0]} x {nodes[1]}, {number(spacing)}{unit} apart"
        yield "Size", f"{number(run.L)} by {number(spacing * intervals(nodes[1], periodic))}{unit}"
    else:
        yield "Length of the first axis", f"{number(run.L)}{unit}"
    for name, words in (("Sq", "Sq, root mean square height"), ("Sdq", "Sdq, root mean square slope")):
        if name in ds:
            yield words, number(float(ds[name].max())) + (unit if VARIABLES[name].units == "length" else "")
    peak = _peak(ds)
    if math.isfinite(peak):
        yield "Highest point above the mean plane over Sq", number(peak)
    yield from _treatment(run)
    if "filled_fraction" in ds:
        share = float(ds["filled_fraction"].max())
        missing = round(share * nodes[0] * nodes[1]) if nodes else 0
        count = f", {missing} node{'s' * (missing != 1)}" if nodes else ""
        yield "Missing heights", f"{share:.2%} of the nodes{count}, filled" if share else "none"
    else:
        yield "Missing heights", "none; a file with missing heights would have been refused"


def _treatment(run: Run) -> Iterator[tuple[str, str]]:
    """Yield what was done to the heights of a file."""
    if run.dataset.attrs.get("surface"):
        yield "Treatment", str(run.dataset.attrs["surface"])
    elif run.study and isinstance(run.study.surface, HeightFile):
        yield "Treatment", LEVELLED.get(str(run.study.surface.level), str(run.study.surface.level))


def _computed(run: Run) -> str:
    """Return how many surfaces of each D and m were computed, as a range where the numbers differ."""
    if "Sq" not in run.dataset:
        return str(run.seeds)
    counts = [run.computed(D=D, m=m) for D in run.D for m in run.m]
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"


def _peak(ds: Dataset) -> float:
    """Return (z_max - mean z)/Sq, the d/σ of first touch; NaN where nothing was pressed."""
    if "separation" not in ds or "indentation" not in ds:
        return math.nan
    return float((ds["separation"] + ds["indentation"]).isel(step=0).max())


def _surfaces(run: Run) -> Iterator[Table]:
    """Yield a table of generated surfaces by D and m, or of several files."""
    ds = run.dataset
    if "Sq" not in ds:
        return
    unit = ds.attrs.get("length_unit", "length")
    if "case" in ds.dims:
        if ds.sizes["case"] > 1:
            yield _files(ds, unit)
        return
    rows = []
    for D in run.D:
        for m in run.m:
            values = [run.values(name, D=D, m=m) for name in ("Sq", "Sdq") if name in ds]
            if np.isfinite(values[0]).any():
                rows.append(
                    (f"{D:g}", str(m), " x ".join([str(2**m + ("periodic" not in ds.attrs))] * 2), *map(_range, values))
                )
    head = ("D", "m", "nodes", f"Sq [{unit}]", *(["Sdq"] if "Sdq" in ds else []))
    yield Table("Surfaces", head, tuple(rows), "Mean over surfaces, and their range.")


def _files(ds: Dataset, unit: str) -> Table:
    """Return the table of several files."""
    columns = {f"Sq [{unit}]": "Sq", "Sdq": "Sdq", "filled share": "filled_fraction"}
    held = {head: name for head, name in columns.items() if name in ds}
    rows = []
    for place, name in enumerate(ds["case"].values.tolist()):
        one = ds.isel(case=place)
        nodes = [f"{int(one[key])}" if key in one else "" for key in ("nodes_x", "nodes_y")]
        rows.append((str(name), " x ".join(filter(None, nodes)), *(number(float(one[key])) for key in held.values())))
    return Table("Surfaces", ("file", "nodes", *held), tuple(rows))


def _range(values: Array) -> str:
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return "–"
    low, mean, high = (number(float(value)) for value in (finite.min(), finite.mean(), finite.max()))
    return mean if low == high else f"{mean} ({low} to {high})"


# how it was pressed


def _loading(run: Run) -> Iterator[tuple[str, str]]:
    """Yield material, sweep, solver, states and their certified errors."""
    ds, study = run.dataset, run.study
    if study is not None and study.comment:
        yield "Comment", study.comment
    if study is not None:
        material, unit = study.material, f" {study.material.unit}" if study.material.unit else ""
        yield "Contact modulus E*", f"{number(material.contact_modulus)}{unit}" + ("" if unit else " (no unit given)")
        if material.indentation_hardness is not None:
            acts = "pressures end there" if material.plastic else "for comparison alone, no yield is computed"
            yield "Hardness", f"{number(material.indentation_hardness)}{unit}, {acts}"
        sweep = study.sweep
        legs = ", ".join(f"{leg.steps} steps to {leg.target.label}" for leg in sweep.legs)
        yield "Sweep", legs if sweep.steps else "none, surfaces alone"
        if sweep.steps:
            solver = study.solving
            yield "Solver", f"{solver.method}, residual η/σ at most {solver.tolerance:g}, kernel {solver.kernel}"
    region = str(ds.attrs.get("region", ""))
    if study is not None and study.record.region is not None and region:
        yield "Region observed", region
    if "residual" in ds:
        solved = ds["residual"].notnull()
        converged = int((ds["converged"] & solved).sum())
        yield "States", f"{converged} of {int(solved.sum())} converged"
        yield "Certified residual η/σ", f"{float(ds['residual'].max()):.1e} at most, which bounds the error of V*"
    if "mean_pressure_bound" in ds and bool((loaded := ds[P] > ROUNDING).any()):
        bound = float(ds["mean_pressure_bound"].where(loaded).max())
        yield "Certified error of p*", f"{bound:.1e} at most, relative"
    for name, colon, text in (line.partition(": ") for line in str(ds.attrs.get("answer", "")).splitlines()):
        if colon:
            yield name, text
    if leak.fluid_of(ds):
        yield "Leak rate", leak.fluid_of(ds)
    if study is not None and (fluid := study.record.fluid_pressure) is not None:
        yield "Fluid pressure", f"inlet {fluid.inlet}, outlet {fluid.outlet}, coupling {fluid.coupling}"
    gas = ds.get("gas_leak_rate")
    if gas is not None and "gas" in gas.attrs:
        path = gas.attrs["mean_free_path"]
        yield "Gas", f"{gas.attrs['gas']}; law {gas.attrs['law']}, mean free path {path}"


# states


def _states(name: str, group: Dataset, *, several: bool) -> Table | None:
    """Return the states of one group: one surface as it is, several by the convention of `average`."""
    lifted, group = leak.is_lifted(group), spread(group)
    names = [column for column in columns("states") if column in group and bool(group[column].notnull().any())]
    for dimensional, starred in IN_PLACE:
        if dimensional in names:  # the starred number stays in study.nc
            names = [name for name in names if not name.startswith(starred)]
    steps = np.flatnonzero(group[P].notnull().any("seed").values)
    if not len(steps):
        return None
    shown = steps
    if len(steps) > STATES:
        shown = steps[np.unique(np.linspace(0, len(steps) - 1, STATES).round().astype(int))]
    count = group.sizes["seed"]
    values = {column: group[column].transpose("seed", "step").values for column in names}
    rows = []
    for k in shown.tolist():
        cells = [str(int(group["step"].values[k]))]
        cells += [cell(column, values[column][:, k]) for column in names]
        rows.append(tuple(cells))
    notes = [conventions(names, count, dry=lifted)]
    if len(shown) < len(steps):
        notes.append(f"{len(shown)} of {len(steps)} states; study.nc has all.")
    heads = ("step", *(head(group[column], count) for column in names))
    return Table(f"States, {name}" if several else "States", heads, tuple(rows), " ".join(filter(None, notes)))


def conventions(names: Sequence[str], *surfaces: int, dry: bool = False) -> str:
    """Return what the numbers of a table are: means, medians, counts of surfaces by row, and which leak counts."""
    several, equal = max(surfaces, default=1) > 1, len(set(surfaces)) == 1
    over = f"{surfaces[0]} surfaces" if equal else "the surfaces of a row"
    notes = [f"Mean over {over}; open ways are counted."] if several else []
    if several and any(map(average.is_flow, names)):
        notes.append(f"Flows: {average.IN_WORDS}.")
    return " ".join([*notes, *([leak.DRY_NOTE] if dry else [])])


def head(variable: DataArray, surfaces: int = 1) -> str:
    """Return the head of a column: symbol, unit where there is one, and ``median`` for a flow of several surfaces."""
    unit = str(variable.attrs.get("units", "1"))
    symbol = str(variable.attrs.get("symbol", variable.name))
    median = "median " if surfaces > 1 and average.is_flow(str(variable.name)) else ""
    return f"{median}{symbol}" if unit == "1" else f"{median}{symbol} [{unit}]"


def cell(name: str, values: Array) -> str:
    """Return the number of one surface or of several as text; of an open way, how many surfaces have one."""
    found = average.average(name, np.where(np.abs(values) < ROUNDING, 0.0, values) if name in STARRED else values)
    if found.count == 0:
        return ""
    if name.startswith("open"):
        open_ = int(np.nansum(values))
        return ("open" if open_ else "closed") if len(values) == 1 else f"{open_} of {found.count}"
    if average.is_flow(name) and found.count > 1:
        return f"{number(found.value)} ({number(found.low)} to {number(found.high)})"
    return number(found.value)


# closing


def closing(some: list[tuple[str, Dataset]]) -> Iterator[Table]:
    """Yield at which load the last way along each axis closes; of several surfaces, mean and range of those closed."""
    rows = []
    title: tuple[str, ...] = ()
    dry = any(leak.is_lifted(group) for _, group in some)
    for name, group in some:
        load = load_of(group)
        unit = str(group[load].attrs.get("units", "1"))
        symbol = "p*" if load == P else "p"
        words = symbol if unit == "1" else f"{symbol} [{unit}]"
        title = ("surface", "axis", f"open up to {words}", f"closed from {words}", "ways closed")
        for axis in AXES:
            if not (found := spans(group, axis, load)):
                continue
            closed = [span for span in found if span.closes]
            low = _range(np.array([span.open_up_to for span in closed or found]))
            high = _range(np.array([span.closed_from for span in closed]))
            rows.append((name, axis, low, high, f"{len(closed)} of {len(found)}"))
    notes = [
        "The last way from side to side closes between the two loads, those of neighbouring states. The bracket leaves "
        "out the error of grid and window."
    ]
    if any(group.sizes["seed"] > 1 for _, group in some):
        notes.append("Of several surfaces: mean (smallest to largest) over those whose way closes, or else over all.")
    if any("leg" in group for _, group in some):
        notes.append("The loads are those of leg 1.")
    if dry:
        notes.append("The loads are those of the dry gap.")
    if rows:
        yield Table(CLOSING, title, tuple(rows), " ".join(notes))
