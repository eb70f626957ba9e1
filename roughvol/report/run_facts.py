"""One stored run in words and tables: surface, loading, states, closing of the ways through the gap, warnings.

Nothing is judged here. Numbers come from the dataset; in units, where the study names them: the mean gap is V* Sq, the
nominal pressure p* E* Sq/L.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from xarray import DataArray, Dataset

from roughvol.errors import ContactError
from roughvol.observables.conductance import contact_conductance, harmonic_conductivity
from roughvol.observables.stiffness import interfacial_stiffness
from roughvol.report.claims import Run
from roughvol.report.legs import first_leg
from roughvol.report.tables import Table, number
from roughvol.report.yielding import hysteresis
from roughvol.store.variables import VARIABLES
from roughvol.study import HeightFile, SpectralSurface, Study, convert
from roughvol.study.units import in_unit
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
CLOSING = "Where it closes"
COLUMNS = (  # of a table of states, where they are stored or follow from what is
    "nominal_pressure",
    P,
    A,
    V,
    "mean_gap",
    "separation",
    "mean_plane_separation",
    "load_above_hardness_fraction",
    "plastic_volume",
    "plastic_area_fraction",
    "open_x",
    "open_y",
    "critical_opening_x",
    "critical_opening_y",
    "transmissivity_x",
    "transmissivity_y",
    "leak_rate_x",
    "leak_rate_y",
    "knudsen_number_x",
    "knudsen_number_y",
    "gas_leak_rate_x",
    "gas_leak_rate_y",
)
STIFFNESS = "interfacial stiffness -dp/d(mean gap) times L/E*; with h and k_s the conductance h L/k_s"
CONDUCTANCE = "contact conductance per nominal area"
CONDUCTIVITY = "W/m/K"
LOADS = ("nominal_pressure", P)


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
    if "step" in ds.sizes and P in ds:
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
    yield "File", ", ".join(map(str, ds["case"].values.tolist()))
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
    if ds.attrs.get("surface"):
        yield "Treatment", str(ds.attrs["surface"])
    elif run.study and isinstance(run.study.surface, HeightFile):
        yield "Treatment", LEVELLED.get(str(run.study.surface.level), str(run.study.surface.level))
    if "filled_fraction" in ds:
        share = float(ds["filled_fraction"].max())
        missing = round(share * nodes[0] * nodes[1]) if nodes else 0
        count = f", {missing} node{'s' * (missing != 1)}" if nodes else ""
        yield "Missing heights", f"{share:.2%} of the nodes{count}, filled" if share else "none"
    else:
        yield "Missing heights", "none; a file with missing heights would have been refused"


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
    """Yield a table of generated surfaces by D and m."""
    ds = run.dataset
    if "case" in ds.dims or "Sq" not in ds:
        return
    unit = ds.attrs.get("length_unit", "length")
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
        legs = ", ".join(
            f"{run.steps if sweep.automatic else leg.steps} steps to {leg.target.label}" for leg in sweep.legs
        )
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
    if "mean_pressure_bound" in ds and bool(ds["mean_pressure_bound"].notnull().any()):
        yield "Certified error of p*", f"{float(ds['mean_pressure_bound'].max()):.1e} at most, relative"
    for name, colon, text in (line.partition(": ") for line in str(ds.attrs.get("answer", "")).splitlines()):
        if colon:
            yield name, text
    leak = ds.get("leak_rate_x")
    if leak is not None and "pressure_drop" in leak.attrs:
        yield "Leak rate", f"pressure drop {leak.attrs['pressure_drop']}, viscosity {leak.attrs['viscosity']}"
    gas = ds.get("gas_leak_rate_x")
    if gas is not None and "gas" in gas.attrs:
        path = gas.attrs["mean_free_path"]
        yield "Gas", f"{gas.attrs['gas']}; law {gas.attrs['law']}, mean free path {path}"


# states


def derived(ds: Dataset, study: Study | None) -> Dataset:
    """Return a dataset with the mean gap, the nominal pressure where the study has its unit, open ways and stiffness.

    Parameters
    ----------
    ds : Dataset
        A study with states.
    study : Study or None
        Its study.

    Returns
    -------
    Dataset
        The same with further variables.
    """
    ds = _with_stiffness(ds, study)
    if "mean_gap" not in ds and "Sq" in ds:
        gap = ds[V] * ds["Sq"]
        ds = ds.assign(mean_gap=gap.assign_attrs(units=ds.attrs.get("length_unit", "length"), symbol="g_mean"))
    if "nominal_pressure" not in ds and "Sq" in ds and study is not None and study.material.unit:
        pressure = ds[P] * ds["Sq"] * (study.material.contact_modulus / float(ds["L"]))
        ds = ds.assign(nominal_pressure=pressure.assign_attrs(units=study.material.unit, symbol="p"))
    for axis in "xy":
        # any of them is 0 where the way is closed; the first one stored is taken
        for name in (f"percolates_{axis}", f"critical_gap_{axis}", f"transmissivity_{axis}"):
            if name in ds and bool(ds[name].notnull().any()):
                is_open = (ds[name] > 0.0).astype(float).where(ds[name].notnull())
                ds = ds.assign({f"open_{axis}": is_open.assign_attrs(units="1", symbol=f"open along {axis}")})
                break
    return ds


def _with_stiffness(ds: Dataset, study: Study | None) -> Dataset:
    """Return a dataset with the interfacial stiffness on the first leg, and the conductance that follows."""
    first = first_leg(ds)
    try:
        pressure, gap = (first[name].transpose(..., "step") for name in (P, V))
        stiffness = pressure.copy(data=interfacial_stiffness(pressure.values, gap.values)).reindex(step=ds["step"])
    except (ContactError, KeyError):  # pressures that do not rise throughout, as those of a region may
        return ds
    ds = ds.assign(interfacial_stiffness=stiffness.assign_attrs(units="1", symbol="K L/E*", long_name=STIFFNESS))
    unit, bodies = ds.attrs.get("length_unit"), study.material.conductivity if study is not None else None
    if unit and bodies:
        first_body, second = (in_unit(value, CONDUCTIVITY) or math.nan for value in bodies)
        length = convert(float(ds["L"]), unit, "m")
        value = contact_conductance(stiffness.values, harmonic_conductivity(first_body, second), length)
        conductance = stiffness.copy(data=value).assign_attrs(units="W/m^2/K", symbol="h", long_name=CONDUCTANCE)
        ds = ds.assign(contact_conductance=conductance)
    return ds


def groups(ds: Dataset) -> Iterator[tuple[str, Dataset]]:
    """Yield the surfaces that share a table, those computed along `seed`: each file, or each D at each m."""
    if "case" in ds.dims:
        for place, label in enumerate(ds["case"].values.tolist()):
            yield str(label), ds.isel(case=place).expand_dims("seed")
        return
    for D in ds["D"].values:
        for m in ds["m"].values:
            group = ds.sel(D=D, m=m)
            computed = np.flatnonzero(group[P].notnull().any("step").values)
            if computed.size:
                yield f"D = {D:g}, m = {m}", group.isel(seed=computed)


def _states(name: str, group: Dataset, *, several: bool) -> Table | None:
    """Return the states of one group: one surface as it is, several by their mean."""
    names = [column for column in COLUMNS if column in group and bool(group[column].notnull().any())]
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
    notes = [f"Mean over {count} surfaces; open ways are counted."] if count > 1 else []
    if len(shown) < len(steps):
        notes.append(f"{len(shown)} of {len(steps)} states; study.nc has all.")
    heads = ("step", *(head(group[column]) for column in names))
    return Table(f"States, {name}" if several else "States", heads, tuple(rows), " ".join(notes))


def head(variable: DataArray) -> str:
    """Return the head of a column: symbol, and unit where there is one."""
    unit = str(variable.attrs.get("units", "1"))
    symbol = str(variable.attrs.get("symbol", variable.name))
    return symbol if unit == "1" else f"{symbol} [{unit}]"


def cell(name: str, values: Array) -> str:
    """Return the mean over surfaces as text; of an open way, how many of them have one."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return ""
    if name.startswith("open_"):
        open_ = int(finite.sum())
        return ("open" if open_ else "closed") if finite.size == 1 and len(values) == 1 else f"{open_} of {finite.size}"
    return number(float(finite.mean()))


# closing


def closing(some: list[tuple[str, Dataset]]) -> Iterator[Table]:
    """Yield at which load the last way along each axis closes."""
    rows = []
    title: tuple[str, ...] = ()
    for name, group in some:
        load = next(column for column in LOADS if column in group)
        unit = str(group[load].attrs.get("units", "1"))
        symbol = "p" if load == LOADS[0] else "p*"
        words = symbol if unit == "1" else f"{symbol} [{unit}]"
        title = ("surface", "axis", f"open up to {words}", f"closed from {words}", "ways closed")
        for axis in "xy":
            if f"open_{axis}" not in group:
                continue
            spans = [_span(group.isel(seed=k), f"open_{axis}", load) for k in range(group.sizes["seed"])]
            reached = [span for span in spans if span is not None]
            closed = [span for span in reached if math.isfinite(span[1])]
            if not reached:
                continue
            low, high = (_range(np.array([span[k] for span in closed or reached])) for k in (0, 1))
            rows.append((name, axis, low, high, f"{len(closed)} of {len(reached)}"))
    if rows:
        yield Table(
            CLOSING,
            title,
            tuple(rows),
            "The last way from side to side closes between the two loads, those of neighbouring states.",
        )


def _span(surface: Dataset, name: str, load: str) -> tuple[float, float] | None:
    """Return the largest load at which a way is open and the smallest beyond at which it is closed, NaN for none."""
    open_, loads = surface[name].values, surface[load].values
    mask = np.isfinite(open_) & np.isfinite(loads)
    if not mask.any():
        return None
    open_, loads = open_[mask] > 0.0, loads[mask]
    last = int(np.flatnonzero(open_)[-1]) if open_.any() else -1
    below = float(loads[last]) if last >= 0 else 0.0
    return below, float(loads[last + 1]) if last + 1 < len(loads) else math.nan
