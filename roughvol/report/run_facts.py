"""One stored run in words and tables: surface, loading, states, closing of the ways through the gap, warnings.

Nothing is judged here. Numbers come from the dataset; in units, where the study names them: the mean gap is V* Sq, the
nominal pressure p* E* Sq/L.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from xarray import Dataset

from roughvol.analysis import leak
from roughvol.analysis.closing import load_of, spans
from roughvol.analysis.derived import ROUNDING, P, derived, groups, is_pressed
from roughvol.analysis.hysteresis import hysteresis
from roughvol.analysis.legs import first_leg
from roughvol.analysis.seal import IN_A_ROW, with_leaks
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import Table, evenly, number, range_text
from roughvol.contact.kernels import KERNELS
from roughvol.observables.variables import AXES
from roughvol.report.document import Pairs
from roughvol.report.states import States, head, sentences
from roughvol.study import HeightFile, Study
from roughvol.surfaces.surface import BEYOND, intervals
from roughvol.typing import Array

STATES = 24  # rows of a table of states; a longer sweep is shown at even steps, its first and last state among them
CLOSING = "Where it closes"
BRACKET = (
    "The last way from side to side closes between the two loads, those of neighbouring states; equal loads are a "
    "solved closing load. The error of grid and window is left out."
)
SPREAD = "Of several surfaces: mean (smallest to largest) over those whose way closes, or else over all."


@dataclass(frozen=True, eq=False)
class Facts:
    """A run in words and tables; ``surface`` and ``loading`` are pairs of a quantity and its value."""

    run: Run
    title: str
    surface: Pairs
    loading: Pairs
    warnings: tuple[str, ...]

    @functools.cached_property
    def tables(self) -> tuple[Table, ...]:
        """The surfaces, where the ways through the gap close, and the states."""
        return tuple(_tables(self.run))

    def plain(self) -> dict[str, Any]:
        """Return the facts as plain data for JSON."""
        tables = [{"title": t.title, "head": list(t.head), "rows": [list(r) for r in t.rows]} for t in self.tables]
        data = {"name": self.run.name, "title": self.title, "warnings": list(self.warnings), "tables": tables}
        return data | {"surface": dict(self.surface), "loading": dict(self.loading)}


def facts(run: Run) -> Facts:
    """Return a run in words and tables."""
    ds = run.dataset
    warnings = tuple(line.strip() for line in str(ds.attrs.get("warnings", "")).splitlines() if line.strip())
    return Facts(run, _title(run), _map(run), _loading(run), warnings)


def _tables(run: Run) -> Iterator[Table]:
    yield from _surfaces(run)
    if is_pressed(run.dataset):
        found = groups(derived(run.dataset, run.study))
        some = [(name, with_leaks(run.study, group, group)) for name, group in found]
        yield from closing([(name, first_leg(group)) for name, group in some])
        for name, group in some:
            yield from hysteresis(run, group, name if len(some) > 1 else "")
        titles = [f"States, {name}" if len(some) > 1 else "States" for name, _ in some]
        yield from filter(None, map(_states, titles, (group for _, group in some)))


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


def _map(run: Run) -> Pairs:
    """Return the surface."""
    ds, unit = run.dataset, _unit(run.dataset)
    length = f"{number(run.L)}{unit}"
    if "case" not in ds.dims:
        made = f"random midpoint displacement, law {run.law or 'unknown'}"
        if run.spectral is not None:
            made = "random fields with a power-law spectrum"
        return _known(("Surfaces", f"{made}, {_computed(run)} of each D and m"), ("L", length), ("Sides", _sides(ds)))
    names = ", ".join(map(str, ds["case"].values.tolist()))
    if ds.sizes["case"] > 1:  # each has a row in the table of surfaces
        of_all = ("Length of the first axis", length), ("Sides", _sides(ds)), ("Treatment", _treatment(run))
        return _known(("Files", names), *of_all)
    size = {"Length of the first axis": length}
    if nodes := _nodes(run):
        periodic = "periodic" in ds.attrs
        spacing = run.L / intervals(nodes[0], periodic)
        size = {"Nodes": f"{nodes[0]} x {nodes[1]}, {number(spacing)}{unit} apart"}
        size["Size"] = f"{number(run.L)} by {number(spacing * intervals(nodes[1], periodic))}{unit}"
    Sq, Sdq = (number(float(ds[name].max())) if name in ds else "" for name in ("Sq", "Sdq"))
    peak = _peak(ds)
    return _known(
        ("File", names),
        *size.items(),
        ("Sides", _sides(ds)),
        ("Sq, root mean square height", Sq and f"{Sq}{unit}"),
        ("Sdq, root mean square slope", Sdq),
        ("Highest point above the mean plane over Sq", number(peak) if math.isfinite(peak) else ""),
        ("Treatment", _treatment(run)),
        ("Missing heights", _missing(ds, nodes)),
    )


def _sides(ds: Dataset) -> str:
    """Return what follows beyond the sides of a surface, in words; empty for a run of a version without the key."""
    sides = ds.attrs.get("sides")
    return f"{sides}: {BEYOND[sides]}" if sides in BEYOND else ""


def _missing(ds: Dataset, nodes: tuple[int, int] | None) -> str:
    """Return the share of the missing heights of a file in words."""
    if "filled_fraction" not in ds:
        return "none; a file with missing heights would have been refused"
    share = float(ds["filled_fraction"].max())
    missing = round(share * math.prod(nodes)) if nodes else 0
    count = f", {missing} node{'s' * (missing != 1)}" if nodes else ""
    return f"{share:.2%} of the nodes{count}, filled" if share else "none"


def _known(*pairs: tuple[str, str]) -> Pairs:
    """Return the pairs with a value."""
    return tuple(pair for pair in pairs if pair[1])


def _treatment(run: Run) -> str:
    """Return what was done to the heights of a file; empty where it is unknown."""
    surface = run.study.surface if run.study is not None else None
    untreated = isinstance(surface, HeightFile) and surface.level == "none"
    return str(run.dataset.attrs.get("surface", "")) or "as in the file" * untreated


def _computed(run: Run) -> str:
    """Return how many surfaces of each D and m were computed, as a range where the numbers differ."""
    if "Sq" not in run.dataset:
        return str(run.seeds)
    return range_text([run.computed(D=D, m=m) for D in run.D for m in run.m])


def _peak(ds: Dataset) -> float:
    """Return (z_max - mean z)/Sq, the d/σ of first touch; NaN where nothing was pressed."""
    if "separation" not in ds or "indentation" not in ds:
        return math.nan
    return float((ds["separation"] + ds["indentation"]).isel(step=0).max())


def _surfaces(run: Run) -> Iterator[Table]:
    """Yield a table of generated surfaces by D and m, or of several files."""
    ds = run.dataset
    measured = "case" in ds.dims
    if "Sq" not in ds or (measured and ds.sizes["case"] == 1):
        return
    columns = {f"Sq [{ds.attrs.get('length_unit', 'length')}]": "Sq", "Sdq": "Sdq"}
    columns |= {"filled share": "filled_fraction"} if measured else {}
    held = {head: name for head, name in columns.items() if name in ds}
    rows = [(*labels, *(_range(part[name].values) for name in held.values())) for labels, part in _labelled(run)]
    heads = ("file", "nodes") if measured else ("D", "m", "nodes")
    yield Table("Surfaces", (*heads, *held), tuple(rows), "" if measured else "Mean over surfaces, and their range.")


def _labelled(run: Run) -> Iterator[tuple[tuple[str, ...], Dataset]]:
    """Yield each file, or the surfaces of each D and m, after the labels of its row: file, or D and m, and nodes."""
    ds = run.dataset
    if "case" in ds.dims:
        for place, name in enumerate(ds["case"].values.tolist()):
            case = ds.isel(case=place)
            yield (str(name), " x ".join(str(int(case[key])) for key in ("nodes_x", "nodes_y") if key in case)), case
        return
    for D, m in itertools.product(run.D, run.m):
        some = ds.sel(D=D, m=m)
        if bool(some["Sq"].notnull().any()):
            nodes = 2**m + ("periodic" not in ds.attrs)
            yield (f"{D:g}", str(m), f"{nodes} x {nodes}"), some


def _range(values: Array) -> str:
    """Return the mean, and the smallest and the largest value where they differ."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return "–"
    low, mean, high = (number(float(value)) for value in (finite.min(), finite.mean(), finite.max()))
    return mean if low == high else f"{mean} ({low} to {high})"


# how it was pressed


def _loading(run: Run) -> Pairs:
    """Return material, sweep, solver, states and their certified errors."""
    ds, study = run.dataset, run.study
    pairs = [] if study is None else _pressed(study, str(ds.attrs.get("region", "")))
    kernel = "love" if study is None else study.kernel(study.surface.length_unit).name
    proved = kernel in KERNELS and KERNELS[kernel].m_matrix
    words = "" if proved else f"; not proved for the kernel {kernel}"
    if "residual" in ds:
        solved, largest = ds["residual"].notnull(), float(ds["residual"].max())
        pairs += [
            ("States", f"{int((ds['converged'] & solved).sum())} of {int(solved.sum())} converged"),
            ("Certified residual η/σ", f"{largest:.1e} at most, which bounds the error of V*{words}"),
        ]
    bound = float(ds["mean_pressure_bound"].where(ds[P] > ROUNDING).max()) if "mean_pressure_bound" in ds else math.nan
    if math.isfinite(bound):
        pairs.append(
            (f"{'Certified' if proved else 'Bound of the'} error of p*", f"{bound:.1e} at most, relative{words}")
        )
    pairs += _answers(str(ds.attrs.get("answer", "")).splitlines())
    fluid = study.record.fluid_pressure if study is not None else None
    gas = ds["gas_leak_rate"].attrs if "gas_leak_rate" in ds else {}
    pairs += [
        ("Leak rate", leak.fluid_of(ds)),
        ("Fluid pressure", f"inlet {fluid.inlet}, outlet {fluid.outlet}, coupling {fluid.coupling}" if fluid else ""),
        ("Gas", f"{leak.gas_of(ds)}, mean free path {gas['mean_free_path']}" if "gas" in gas else ""),
    ]
    return _known(*pairs)


def _answers(lines: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the means and costs of an ensemble by their names, then its other sentences together."""
    named = [line for line in lines if line.startswith(("mean ", "D = "))]
    for line in named:
        name, _, text = line.partition(": ")
        yield name, text
    yield "Ensemble", "; ".join(line for line in lines if line not in named)


def _pressed(study: Study, region: str) -> list[tuple[str, str]]:
    """Return material, sweep and solver of a study; texts that do not apply are empty."""
    material, sweep, seal = study.material, study.sweep, study.seal
    unit = f" {material.unit}" if material.unit else ""
    leaks = "leaks along x and y are those of the patch, leaks named seal those of the seal"
    if study.record.fluid_pressure is not None:
        leaks += f", known of a seal as wide as a patch alone: {IN_A_ROW}"
    hardness, solver = "", ""
    if material.indentation_hardness is not None:
        acts = "pressures end there" if material.plastic else "for comparison alone, no yield is computed"
        hardness = f"{number(material.indentation_hardness)}{unit}, {acts}"
    if sweep.steps:
        solving, kernel = study.solving, study.kernel(study.surface.length_unit).label
        solver = f"{solving.method}, residual η/σ at most {solving.tolerance:g}, kernel {kernel}"
    legs = ", ".join(f"{leg.steps} step{'s' * (leg.steps != 1)} to {_end(leg.target.label)}" for leg in sweep.legs)
    return [
        ("Comment", study.comment or ""),
        ("Contact modulus E*", f"{number(material.contact_modulus)}{unit or ' (no unit given)'}"),
        ("Hardness", hardness),
        ("Sweep", legs if sweep.steps else "none, surfaces alone"),
        ("Solver", solver),
        ("Region observed", region if study.record.region is not None else ""),
        ("Seal", f"{seal.label}, flow along {seal.flow}; {leaks}" if seal else ""),
    ]


def _end(label: str) -> str:
    """Return the end of a leg in words: the closing of the last way has labels as ``percolation-x``."""
    kind, _, axis = label.partition("percolation-")
    return label if kind or not axis else "percolation" if axis == "both" else f"percolation along {axis}"


# states


def _states(title: str, group: Dataset) -> Table | None:
    """Return the states of one group, at most `STATES` of them."""
    every = States.of_steps("states", group)
    count = len(every.rows)
    if count <= STATES:
        return every.table(title) if count else None
    shown = replace(every, rows=tuple(every.rows[k] for k in evenly(count, STATES)))
    return shown.table(title, f"{len(shown.rows)} of {count} states; study.nc has all.")


# closing


def closing(some: list[tuple[str, Dataset]]) -> Iterator[Table]:
    """Yield at which load the last way along each axis closes; of several surfaces, mean and range of those closed."""
    rows = []
    title: tuple[str, ...] = ()
    for name, group in some:
        load = load_of(group)
        words = head(load, group.variables[load].attrs)
        title = ("surface", "axis", f"open up to {words}", f"closed from {words}", "ways closed")
        for axis in AXES:
            if not (found := spans(group, axis, load)):
                continue
            closed = [span for span in found if span.closes]
            low = _range(np.array([span.open_up_to for span in closed or found]))
            high = _range(np.array([span.closed_from for span in closed]))
            rows.append((name, axis, low, high, f"{len(closed)} of {len(found)}"))
    note = sentences(
        {
            BRACKET: True,
            SPREAD: any(group.sizes["seed"] > 1 for _, group in some),
            "The loads are those of leg 1.": any("leg" in group for _, group in some),
            "The loads are those of the dry gap.": any(leak.is_lifted(group) for _, group in some),
        }
    )
    if rows:
        yield Table(CLOSING, title, tuple(rows), note)
