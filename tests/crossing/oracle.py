"""The numbers of study.nc by plain numpy: nothing of roughvol is imported here.

Conventions, as the pages state them:

- Flows of several surfaces: the median over the surfaces, closed surfaces counted as 0, with the 16-84 % range. Other
  quantities: the mean over the surfaces that have a value.
- Under fluid pressure the leak is ``fluid_leak_rate_*`` at the load of a recorded state, and not known elsewhere. The
  leak along the steps is named dry.
- Between two steps: monotone cubics over the quantity asked for. Those of flows and openings are of the logarithm, at a
  load over its logarithm, where both steps are open; else straight lines. A Knudsen number is the inverse of an
  opening. A later leg begins at the end of the leg
  before. A way is open up to the first closed step; counts are those of the step beyond. A step that misses a load by
  less than 1e-5 is this load.
- Where the closing load is solved, a way is open up to this load, and its flow falls to 0 there on a straight line over
  p* from the open step.
- A surface whose sweep ended closed along an axis is closed at every higher load: flow 0, no other number.
"""

import functools
import itertools
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import PchipInterpolator

REACHED = 1e-5
FLOWS = ("leak_rate", "gas_leak_rate", "transmissivity", "gas_transmissivity")
BY_LOGARITHM = (*FLOWS, "diffusivity", "critical_gap", "critical_opening")
COUNTED = ("contact_clusters", "trapped_pockets", "iterations", "converged")
LOADS = {  # kind of a load: its number, and the factors to the unit of the studies (MPa, um, mN)
    "pressure": ("nominal_pressure", {"MPa": 1.0, "kPa": 1e-3, "bar": 0.1}),
    "load": ("load", {"mN": 1.0, "N": 1e3}),
    "mean_gap": ("mean_gap", {"um": 1.0, "nm": 1e-3}),
    "contact_area": ("contact_area_fraction", {}),
    "separation": ("separation", {}),
    "indentation": ("indentation", {}),
}
OF_STATE = ("indentation", "separation", "contact_area_fraction", "mean_pressure", "free_volume")
OF_YIELD = ("plastic_volume", "plastic_area_fraction")
LIFTED = ("leak_rate_x", "leak_rate_y", "open_x", "open_y")
Numbers = dict[str, np.ndarray]


@dataclass(eq=False)
class Surface:
    """One surface: its numbers along the steps, and its recorded states by dimension and label."""

    along: Numbers
    legs: np.ndarray
    states: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)
    Sq: float = math.nan
    seed: int = 0
    ends: str = ""
    labels: dict[str, Any] = field(default_factory=dict)
    closes: dict[str, float] = field(default_factory=dict)  # solved p* by axis


@dataclass
class Group:
    """Surfaces that share a row: the words that name them, and the surfaces."""

    words: tuple[str, ...]
    surfaces: list[Surface]


def groups(
    ds: xr.Dataset, modulus: float | Mapping[object, float] = math.nan, lists: Iterable[str] = (), ends: str = ""
) -> list[Group]:
    """Return the surfaces of a study.nc that share a row; ``ends`` is the target of the sweep."""
    found = []
    names = [*lists, *(["case"] if "case" in ds.dims else ["D", "m", "seed"])]
    for chosen in itertools.product(*(ds[name].values.tolist() for name in lists)):
        part = ds.sel(dict(zip(lists, chosen, strict=True)))
        E = modulus if isinstance(modulus, float) else modulus[chosen[0]]
        words = tuple(_words(name, value, ds[name]) for name, value in zip(lists, chosen, strict=True))
        if "case" in ds.dims:
            rows = [(case, [part.sel(case=case)]) for case in ds["case"].values.tolist()]
        else:
            pairs = itertools.product(ds["D"].values.tolist(), ds["m"].values.tolist())
            rows = [(f"D = {D:g}, m = {m}", [part.sel(D=D, m=m, seed=seed) for seed in ds["seed"]]) for D, m in pairs]
        for own, surfaces in rows:
            solved = [one for one in surfaces if "mean_pressure" in one and bool(one["mean_pressure"].notnull().any())]
            named = [(one, {name: one[name].item() for name in names}) for one in solved]
            if solved:
                made = [replace(_surface(one, E), ends=ends, labels=labels) for one, labels in named]
                found.append(Group((*words, own), made))
    return found


def _words(name: str, value: Any, coordinate: Any) -> str:
    unit = coordinate.attrs.get("units", "1")
    return f"{name} = {value:g} {unit}" if isinstance(value, float) else f"{name} = {value}"


def _surface(ds: xr.Dataset, E: float) -> Surface:
    """Return one surface with what follows from its numbers by plain factors."""
    steps = ds.sizes["step"]
    along: Numbers = {}
    axes = ds["axis"].values.tolist() if "axis" in ds else []
    for key in ds.data_vars:
        v = ds.variables[key]  # quicker than the array with its coordinates
        if v.dims == ("step",):
            along[str(key)] = v.values.astype(float)
        elif v.dims == ("step", "axis"):
            along |= {f"{key}_{axis}": values for axis, values in zip(axes, v.values.astype(float).T, strict=True)}
    along.pop("leg", None)
    legs = ds["leg"].values.astype(int) if "leg" in ds else np.ones(steps, dtype=int)
    Sq, L = float(ds["Sq"]), float(ds["L"])
    along.setdefault("mean_gap", along["free_volume"] * Sq)
    if math.isfinite(E):
        along.setdefault("nominal_pressure", along["mean_pressure"] * (E * Sq / L))
        nodes = 2 ** int(ds["m"]) + ("periodic" not in ds.attrs) if "m" in ds.coords else int(ds["nodes_x"])
        area = (nodes * L / (nodes - ("periodic" not in ds.attrs))) ** 2  # um², and MPa um² is 1e-3 mN
        along["load"] = along["nominal_pressure"] * area * 1e-3
    for axis in "xy":
        for of in ("percolates", "critical_gap", "transmissivity", "gas_transmissivity"):
            if (name := f"{of}_{axis}") in along and np.isfinite(along[name]).any():
                along[f"open_{axis}"] = np.where(np.isfinite(along[name]), along[name] > 0.0, np.nan)
                break
    states: dict[str, dict[str, dict[str, float]]] = {}
    for dim in (str(name) for name in ds.dims if f"{name}_step" in ds):
        held: Numbers = {}
        for key in ds.data_vars:
            v = ds.variables[key]
            if v.dims == (dim,) and v.dtype.kind == "f":
                held[str(key)] = v.values
            elif v.dims == (dim, "axis"):
                held |= {f"{key}_{axis}": values for axis, values in zip(axes, v.values.T, strict=True)}
        labels = ds[dim].values.tolist()
        states[dim] = {
            label: {n.removeprefix(f"{dim}_"): float(v[k]) for n, v in held.items()}
            | {"leg": legs[int(ds[f"{dim}_step"][k]) - 1]}
            for k, label in enumerate(labels)
            if int(ds[f"{dim}_step"][k]) > 0
        }
    _add_stiffness(along, legs)
    seed = int(ds["seed"]) if "seed" in ds.coords else 0
    solved = ds["closing_pressure"].values.tolist() if "closing_pressure" in ds else ()
    closes = {axis: end for axis, end in zip(axes, solved, strict=False) if math.isfinite(end)}
    return Surface(_lifted(along, states.get("fluid_at")), legs, states, Sq, seed, closes=closes)


def _add_stiffness(along: Numbers, legs: np.ndarray) -> None:
    """Add bounds of K L/E* = -dp*/dV* where it is not stored: the slopes over ln p to both neighbours."""
    p, V = along["mean_pressure"], along["free_volume"]
    on = np.flatnonzero((legs == 1) & (p > 0.0))
    low, high = np.full(p.shape, np.nan), np.full(p.shape, np.nan)
    with np.errstate(all="ignore"):
        slopes = -np.diff(np.log(p[on])) / np.diff(V[on])
        for k, j in enumerate(on[1:-1]):
            low[j], high[j] = sorted(p[j] * slopes[k : k + 2])
    along["stiffness_low"], along["stiffness_high"] = low, high


def _lifted(along: Numbers, states: dict[str, dict[str, float]] | None) -> Numbers:
    """Return the numbers along the steps with the leak under fluid pressure, the dry leak by the name dry."""
    if states is None:
        return along
    names = [f"{flow}_{axis}" for flow in (*FLOWS, "open", "critical_opening") for axis in "xy"]
    lifted = {f"{n[:-2]}_dry{n[-2:]}" if n in names else n: values for n, values in along.items()}
    for axis in "xy":
        leak = np.full(along["mean_pressure"].shape, np.nan)
        for state in states.values():
            near = np.isclose(along["mean_pressure"], state["mean_pressure"], rtol=1e-6, atol=0.0)
            leak[near] = state[f"fluid_leak_rate_{axis}"]
        lifted[f"leak_rate_{axis}"] = leak
        lifted[f"open_{axis}"] = np.where(np.isfinite(leak), leak > 0.0, np.nan)
    return lifted


def level(text: str) -> tuple[str, float, int | None]:
    """Return number, value and leg of a load, as of ``pressure=0.5 MPa, leg 2``; pressures without a unit are p*."""
    found = re.fullmatch(r"(\w+)(?:=(-?[\d.e-]+) ?(\w*))?(?:, leg (\d+))?", text)
    assert found, text
    kind, value, unit, leg = found.groups()
    if kind in ("last", "step"):
        return kind, float(value or 0.0), int(leg) if leg else None
    name, factors = LOADS[kind]
    if kind == "pressure" and not unit:
        name = "mean_pressure"
    return name, float(value) * (factors[unit] if unit else 1.0), int(leg) if leg else None


@functools.cache  # several questions ask for one load
def recorded(surface: Surface, text: str) -> dict[str, float] | None:
    """Return the numbers of a surface at a load: those of the recorded state where the study records the load."""
    numbers = at(surface, text)
    for states in surface.states.values():
        state = next((own for label, own in states.items() if _is_at(label, own["leg"], text)), None)
        if state is None or numbers is None or not math.isfinite(numbers["mean_pressure"]):
            continue
        name, _, leg = level(text)
        name = "mean_pressure" if name == "nominal_pressure" else "free_volume" if name == "mean_gap" else name
        numbers = _on_path(surface, name, state[name], leg) or numbers
        own = {n: state[n] for n in (*OF_STATE, *OF_YIELD) if n in state}
        for n, of in (("nominal_pressure", "mean_pressure"), ("mean_gap", "free_volume")):
            if n in numbers:
                own[n] = numbers[n] / numbers[of] * state[of]
        return numbers | own
    return numbers


def _is_at(label: str, own_leg: float, text: str) -> bool:
    """Return whether a recorded state, by its label and leg, is that of a load in any unit."""
    (kind, own, _), (name, value, leg) = level(label), level(text)
    return kind == name and math.isclose(own, value, rel_tol=1e-12) and leg in (None, own_leg)


def at(surface: Surface, text: str) -> dict[str, float] | None:
    """Return the numbers of a surface at a load, None where its sweep does not reach the load."""
    name, value, leg = level(text)
    p = surface.along["mean_pressure"]
    if name in ("last", "step"):
        wanted = np.isfinite(p) & ((surface.legs == leg) if leg else True)
        k = np.flatnonzero(wanted)[-1] if name == "last" else int(value) - 1
        return {n: float(v[k]) for n, v in surface.along.items()}
    if text == surface.ends:  # the sweep ended at this target: its last step has reached the target
        return at(surface, "last, leg 1")
    return _on_path(surface, name, value, leg)


def _is_lifted(surface: Surface) -> bool:
    """Return whether fluid pressure lifts the gap of a surface."""
    return "leak_rate_dry_x" in surface.along or "transmissivity_dry_x" in surface.along


def _on_path(surface: Surface, name: str, value: float, leg: int | None) -> dict[str, float] | None:
    """Return the numbers where a surface first reaches a value, on a step or between two."""
    p = surface.along["mean_pressure"]
    for own in [leg] if leg else dict.fromkeys(surface.legs.tolist()):
        on = np.flatnonzero((surface.legs == own) & np.isfinite(p))
        on = np.append(on[:1] - 1, on) if on[0] > 0 else on
        x = surface.along[name][on]
        near = np.flatnonzero(np.abs(x - value) <= REACHED * max(abs(value), 1.0 if name == "separation" else 0.0))
        if near.size:
            return {n: float(v[on[near[0]]]) for n, v in surface.along.items()}
        inside = np.flatnonzero((np.minimum(x[:-1], x[1:]) < value) & (value < np.maximum(x[:-1], x[1:])))
        if inside.size:
            k = inside[0]
            lifted = LIFTED if _is_lifted(surface) else ()
            between = {n: _between(n, name, x, v[on], int(k), value) for n, v in surface.along.items()}
            return between | _closing_between(surface, own, on[k], on[k + 1], between) | dict.fromkeys(lifted, math.nan)
        if beyond := _beyond(surface, on, name, value):
            return beyond
    return None


def _between(name: str, over: str, x: np.ndarray, numbers: np.ndarray, k: int, value: float) -> float:
    """Return a number between the steps k and k + 1 of a path over x."""
    low, high = float(numbers[k]), float(numbers[k + 1])
    if math.isnan(low):
        return low
    own = re.sub(r"(_dry)?_[xy]$", "", name)
    if own in ("percolates", "open"):
        return max(low, high)
    if name.startswith(COUNTED):
        return high
    if own == "knudsen_number":  # the inverse of an opening
        with np.errstate(divide="ignore"):
            return float(1.0 / np.float64(_between("critical_gap", over, x, 1.0 / numbers, k, value)))
    logarithm = own in BY_LOGARITHM
    if math.isfinite(high) and (not logarithm or min(low, high) > 0.0):
        rising = np.sign(x[k + 1] - x[k])
        turns = np.flatnonzero(~(rising * np.diff(x) > 0.0))  # where the path goes on otherwise
        alike = slice(max(turns[turns < k] + 1, default=0), min(turns[turns > k], default=x.size - 1) + 1)
        x, y = x[alike], np.asarray(numbers, dtype=float)[alike]
        with np.errstate(divide="ignore", invalid="ignore"):
            y = np.log(y) if logarithm else y
            if logarithm and over in ("mean_pressure", "nominal_pressure", "load") and x[k - alike.start] > 0.0:
                x, value = np.log(x), math.log(value)
        known = np.isfinite(x) & np.isfinite(y)
        read = float(PchipInterpolator(rising * x[known], y[known])(rising * value))
        return math.exp(read) if logarithm else read
    return low + (value - x[k]) / (x[k + 1] - x[k]) * (high - low)


def _closing_between(surface: Surface, leg: int, low: int, high: int, there: dict[str, float]) -> dict[str, float]:
    """Return flows, openings and ways at a place between two steps, of which one is beyond a solved closing load."""
    found = {}
    for axis, end in {} if leg > 1 and "plastic_volume" in surface.along else surface.closes.items():
        for own in (*BY_LOGARITHM, "critical_opening", "open", "percolates", "knudsen_number"):
            name = f"{own}{'_dry' * _is_lifted(surface)}_{axis}"
            name = name if name in surface.along else f"{own}_{axis}"
            if name not in surface.along or (_is_lifted(surface) and name in LIFTED):
                continue
            ends = surface.along[name][[low, high]]
            if own == "knudsen_number":
                with np.errstate(divide="ignore"):
                    ends = 1.0 / ends
            if not (ends.min() == 0.0 < ends.max()):
                continue
            last = surface.along["mean_pressure"][low if ends[0] > 0.0 else high]
            share = min(max((end - there["mean_pressure"]) / (end - last), 0.0), 1.0)
            if own in ("open", "percolates"):
                found[name] = float(share > 0.0)
            elif own == "knudsen_number":
                found[name] = 1.0 / (share * ends.max()) if share > 0.0 else math.inf
            else:
                found[name] = share * ends.max()
    return found


def _beyond(surface: Surface, on: np.ndarray, name: str, value: float) -> dict[str, float] | None:
    """Return the numbers of a surface beyond the end of a sweep that closed: flows 0, nothing else."""
    x = surface.along[name][on]
    rising = x[-1] > x[0]
    if not (value > x.max() if rising else value < x.min()):
        return None
    shut = [axis for axis in "xy" if _ways(surface, axis) is not None and _ways(surface, axis)[on[-1]] == 0.0]
    if name in ("mean_pressure", "nominal_pressure", "load") and surface.legs[on[-1]] == 1:
        starred = value * surface.along["mean_pressure"][on[-1]] / x[-1]
        shut += [axis for axis, end in surface.closes.items() if end <= starred * (1.0 + REACHED) and axis not in shut]
    names = [f"{flow}{'_dry' * _is_lifted(surface)}_{axis}" for flow in (*FLOWS, "open") for axis in shut]
    return {n: 0.0 if n in (*names, "converged") else math.nan for n in surface.along} if shut else None


def _ways(surface: Surface, axis: str) -> Any:
    return surface.along.get(f"open_dry_{axis}", surface.along.get(f"open_{axis}"))


def is_flow(name: str) -> bool:
    """Return whether several surfaces have a median."""
    return re.sub(r"(_dry)?_[xy]$", "", name) in FLOWS


def mean(name: str, values: Iterable[float]) -> tuple[float, float, float, int]:
    """Return the number of several surfaces, its 16-84 % range, and the surfaces with a value; 0 if it is not known."""
    every = np.array(list(values))
    known = every[np.isfinite(every)]
    if not known.size or (is_flow(name) and np.median(known) == 0.0 < np.median(np.nan_to_num(every, nan=np.inf))):
        return math.nan, math.nan, math.nan, 0
    low, high = np.quantile(known, [0.16, 0.84])
    return float(np.median(known) if is_flow(name) else known.mean()), float(low), float(high), known.size


def closing(surface: Surface, axis: str) -> tuple[float, float]:
    """Return the last load with an open way on the first leg, and that of the next step; infinite where none closes."""
    way, on = _ways(surface, axis), (surface.legs == 1) & np.isfinite(surface.along["mean_pressure"])
    load = surface.along.get("nominal_pressure", surface.along["mean_pressure"])[on]
    if axis in surface.closes:
        end = surface.closes[axis] * float(load[-1] / surface.along["mean_pressure"][on][-1])
        return end, end
    still = np.flatnonzero(way[on] > 0.0)
    last = still[-1] if still.size else -1
    return (float(load[last]) if last >= 0 else 0.0), (float(load[last + 1]) if last + 1 < load.size else math.inf)
