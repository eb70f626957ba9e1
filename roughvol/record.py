"""What a study keeps: each state of a sweep reduced at once to stored numbers, and fields only at the states it names.

All that is observed in contact belongs to the region of the study, as if it were cut out of the loaded surface; the
heights, fields of gap and pressure, Sq and the separation are those of the whole, and lengths are over that Sq.

Everything returned is a mapping from names of `dataset.VARIABLES` to arrays without the dimensions of the case.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol import leakage, regions
from roughvol.physics import fractal, freevolume, texture
from roughvol.physics.contact import Contact
from roughvol.physics.surface import Surface
from roughvol.regions import Within, window, within
from roughvol.study import Case, Level

Values = dict[str, Any]

PER_STEP = (
    "indentation",
    "separation",
    "contact_area_fraction",
    "mean_pressure",
    "free_volume",
    "iterations",
    "convolutions",
    "convolutions_fp32",
    "residual",
    "mean_pressure_bound",
    "converged",
)
ABOVE_HARDNESS = ("contact_above_hardness_fraction", "load_above_hardness_fraction")
LAST = Level("last")
ROUNDING = 1e-9  # by which a state may miss a level and still count as reaching it


def end_of(case: Case) -> Callable[[Contact], bool] | None:
    """Return what must hold of a state for the sweep to end there, if it is a matter of the region or of the void."""
    kind, value = case.sweep.target.kind, case.sweep.target.value or 0.0
    if kind.startswith("percolation"):
        return lambda contact: leakage.stops_percolating(kind, within(contact, case))
    if case.record.region is None:
        return None
    if kind == "contact_area":
        return lambda contact: within(contact, case).contact_area_fraction >= value
    if kind == "pressure":
        return lambda contact: within(contact, case).mean_pressure >= value
    return None


def of_surface(case: Case, surface: Surface) -> Values:
    """Return the numbers of the undeformed surface, its heights if asked for, and the labels of its nodes."""
    values: Values = {"Sq": surface.Sq, "Sdq": texture.Sdq(surface.heights, surface.spacing), "z_max": surface.z_max}
    values["hurst_measured"] = texture.hurst_spectrum(surface.heights, surface.spacing)
    rows, columns = surface.shape
    values |= {"nodes_x": rows, "nodes_y": columns}
    if case.record.heights or case.record.fields_at or (case.record.transport and case.record.transport.flux_at):
        values |= {"x": np.arange(rows) / (rows - 1), "y": np.arange(columns) / (rows - 1)}
    if case.record.heights:
        values["heights"] = surface.heights
    return values


def of_sweep(
    case: Case, surface: Surface, contacts: Iterable[Contact], on_step: Callable[[int], None] | None = None
) -> Values:
    """Return the numbers of every step, and what is recorded of the first state that reaches each level selected.

    Parameters
    ----------
    case : Case
        Names the levels and what to record there.
    surface : Surface
        The surface pressed.
    contacts : iterable of Contact
        The states in the order of the sweep; none is held longer than its turn.
    on_step : callable, optional
        Called with the number of each step that has been reduced.
    """
    reduction = Reduction(case, surface)
    for step, contact in enumerate(contacts, start=1):
        reduction.follow(contact)
        if on_step is not None:
            on_step(step)
    return reduction.values()


class Reduction:
    """Takes in the states of a sweep one by one and holds what is recorded of them."""

    def __init__(self, case: Case, surface: Surface) -> None:
        self._case, self._surface = case, surface
        self._per_step: dict[str, list[Any]] = {name: [] for name in PER_STEP}
        self._hardness = None
        if case.hardness is not None:  # as pressures are stored, p L/(E* σ)
            self._hardness = case.hardness * surface.side / (case.height or surface.Sq or 1.0)
            self._per_step |= {name: [] for name in ABOVE_HARDNESS}
        self._levels = _levels(case)
        self._kept: dict[str, dict[str, tuple[int, Values]]] = {dim: {} for dim in self._levels}
        self._along = AlongSteps(case, surface)
        self._seconds = {_OBSERVABLES[dim]: 0.0 for dim in self._levels}

    @property
    def steps(self) -> int:
        """How many states have been taken in."""
        return len(self._per_step["indentation"])

    def follow(self, whole: Contact) -> None:
        """Take in the next state."""
        contact, step = within(whole, self._case), self.steps + 1
        for name in PER_STEP:
            self._per_step[name].append(getattr(contact, name))
        if self._hardness is not None:
            for name, share in zip(ABOVE_HARDNESS, above(contact.pressure(), self._hardness), strict=True):
                self._per_step[name].append(share)
        self._along.follow(step, contact, whole)
        if step == self._case.sweep.steps and min(whole.shape) > 3:  # 3 nodes have one in the middle
            self._along.values["central_pressure_ratio"] = central_pressure_ratio(whole)
        for dim, by_label in self._levels.items():
            for label, level in by_label.items():
                if label not in self._kept[dim] and reached(level, step, contact, self._case):
                    started = time.perf_counter()
                    self._kept[dim][label] = step, _AT[dim](self._case, self._surface, contact)
                    self._seconds[_OBSERVABLES[dim]] += time.perf_counter() - started

    def values(self) -> Values:
        """Return all that has been recorded."""
        labels = {"step": np.arange(1, self._case.sweep.steps + 1), **_labels(self._case, self._surface)}
        values: Values = {**self._per_step, **self._along.values, **labels}
        if seconds := {**self._along.seconds, **self._seconds}:
            values |= {"observable": list(seconds), "observable_time": list(seconds.values())}
        for dim, by_label in self._levels.items():
            kept = self._kept[dim]
            values[dim] = list(by_label)
            values[f"{dim}_step"] = [kept[label][0] if label in kept else -1 for label in by_label]
            values |= _stacked(list(by_label), {label: arrays for label, (_, arrays) in kept.items()})
        return values

    def state(self) -> Values:
        """Return all this holds as mappings, lists, numbers and arrays, for `restore`."""
        return {"per_step": self._per_step, "kept": self._kept, "seconds": self._seconds, **self._along.state()}

    def restore(self, state: Values) -> None:
        """Become what returned this state."""
        self._per_step = state["per_step"]
        self._kept = {
            dim: {label: (step, values) for label, (step, values) in by_label.items()}
            for dim, by_label in state["kept"].items()
        }
        self._seconds = state["seconds"]
        self._along.restore(state)


def above(pressure: NDArray[np.float64], hardness: float) -> tuple[float, float]:
    """Return the share of the contact with a pressure above the hardness, and the share of the load there.

    Parameters
    ----------
    pressure : ndarray
        Pressure of every element, 0 outside the contact, in any unit.
    hardness : float
        Hardness in the same unit.
    """
    hard = pressure[pressure > hardness]
    if hard.size == 0:
        return 0.0, 0.0
    return hard.size / np.count_nonzero(pressure), float(hard.sum() / pressure.sum())


def central_pressure_ratio(whole: Contact) -> float:
    """Return the mean pressure in the central half of each side over that of the whole; NaN without contact."""
    pressure = whole.pressure()
    mean = float(pressure.mean())
    inside = regions.window_of(regions.central(0.5), whole.shape)
    return float(pressure[inside].mean()) / mean if mean > 0.0 else math.nan


class AlongSteps:
    """Collects quantities of the void and of central regions along the steps, each at the states it is asked for.

    That is at every step, or at the first state that reaches each of its levels.
    """

    def __init__(self, case: Case, surface: Surface) -> None:
        self.case, self.values = case, Values()
        transport, widths = case.record.transport, case.record.region_widths
        self._levels = leakage.levels(transport) if transport else {}
        self._windows: dict[float, regions.Window] = {}
        if widths is not None:
            self._levels |= regions.levels(widths)
            self._windows = {w: regions.window_of(regions.central(w), surface.shape) for w in widths.shares}
            self.values["region_width"] = list(widths.shares)
        self.seconds = dict.fromkeys(self._levels, 0.0)
        rows, columns = window(case, surface.shape)
        self._origin, self._nodes = np.array([rows.start, columns.start]), surface.shape[0]
        if "percolation" in self._levels:
            self.values["size"] = leakage.size_classes((rows.stop - rows.start) * (columns.stop - columns.start))
        if "constriction" in self._levels:
            self.values["axis"] = ["x", "y"]
        if {"transmissivity", "diffusivity"} & self._levels.keys():
            self.values["region_aspect"] = (columns.stop - columns.start) / (rows.stop - rows.start)

    def state(self) -> Values:
        """Return what has been collected, and the levels still to be reached."""
        left = {name: None if levels is None else list(levels) for name, levels in self._levels.items()}
        return {"along": self.values, "left": left, "along_seconds": self.seconds}

    def restore(self, state: Values) -> None:
        """Become what returned this state."""
        self.values, self.seconds = state["along"], state["along_seconds"]
        for name, labels in state["left"].items():
            for label in set(self._levels[name] or ()) - set(labels or ()):
                del (self._levels[name] or {})[label]

    def follow(self, step: int, contact: Contact | Within, whole: Contact) -> None:
        """Take in the next state, as it is seen in the region of the study and as a whole."""
        quantities = []
        for name, levels in self._levels.items():
            hit = [label for label, level in (levels or {}).items() if reached(level, step, contact, self.case)]
            for label in hit:
                del (levels or {})[label]
            if levels is None or hit:
                quantities.append(name)
        void, seconds = leakage.of_state(contact, [name for name in quantities if name in leakage.QUANTITIES])
        central = [name for name in quantities if name in regions.QUANTITIES]
        inside, more = regions.of_state(whole, central, self._windows)
        for name, taken in (seconds | more).items():
            self.seconds[name] += taken
        for name, value in (void | inside).items():
            if name.startswith("critical_position"):
                value = (value + self._origin) / (self._nodes - 1)  # over L, as x and y are
            absent = np.full((self.case.sweep.steps, *np.shape(value)), np.nan)
            self.values.setdefault(name, absent)[step - 1] = value


def reached(level: Level, step: int, contact: Contact | Within, case: Case) -> bool:
    """Return whether a state is at or beyond a level.

    The last step reaches the level that the sweep was asked to end at, though a solve to a finite residual may put it
    one element or a few digits short.
    """
    if step == case.sweep.steps and level in (LAST, case.sweep.target):
        return True
    if level.value is None:
        return False
    slack = ROUNDING * max(1.0, abs(level.value))
    match level.kind:
        case "step":
            return step == level.value
        case "separation":
            return contact.separation <= level.value + slack
        case "indentation":
            return contact.indentation >= level.value - slack
        case "contact_area":
            return contact.contact_area_fraction >= level.value - slack
        case "pressure":
            return contact.mean_pressure >= level.value - slack
    message = f"no such level: {level.label}"
    raise ValueError(message)


def _levels(case: Case) -> dict[str, dict[str, Level]]:
    """Levels by label, for each dimension that runs over states."""
    record = case.record
    selects = {
        "field_at": record.fields_at,
        "density_at": record.volume_density.at if record.volume_density else None,
        "box_at": record.box_counting.at if record.box_counting else None,
        "flux_at": record.transport.flux_at if record.transport else None,
    }
    return {dim: {level.label: level for level in select.levels} for dim, select in selects.items() if select}


def _fields(case: Case, surface: Surface, contact: Contact | Within) -> Values:
    whole = contact.whole if isinstance(contact, Within) else contact
    return {"gap": whole.gap(), "pressure": whole.pressure()}


def _flux(case: Case, surface: Surface, contact: Contact | Within) -> Values:
    """Return the flux on the nodes of the whole surface, NaN outside the region."""
    values = leakage.flux(contact)
    for name, inside in values.items():
        values[name] = np.full(surface.shape, np.nan)
        values[name][window(case, surface.shape)] = inside
    return values


def _density(case: Case, surface: Surface, contact: Contact | Within) -> Values:
    assert case.record.volume_density is not None
    mask = contact.contact()
    density = freevolume.volume_density(
        _volumes(surface, contact),
        mask,
        bins=case.record.volume_density.bins,
        include_contact=case.record.volume_density.include_contact,
    )
    return {"volume_density": density.density, "volume_density_edges": density.edges}


def _boxes(case: Case, surface: Surface, contact: Contact | Within) -> Values:
    assert case.record.box_counting is not None
    volumes, mask = _volumes(surface, contact), contact.contact()
    largest = float(volumes.max())
    domains = [freevolume.domain(volumes, share * largest, mask) for share in case.record.box_counting.thresholds]
    counts = [fractal.box_counts(domain) for domain in domains]
    dimensions = [fractal.local_dimension(count).dimension for count in counts]
    return {"volume_max": largest, "box_count": [count.counts for count in counts], "local_dimension": dimensions}


_OBSERVABLES = {"field_at": "fields_at", "density_at": "volume_density", "box_at": "box_counting", "flux_at": "flux_at"}
_AT = {"field_at": _fields, "density_at": _density, "box_at": _boxes, "flux_at": _flux}


def _volumes(surface: Surface, contact: Contact | Within) -> freevolume.Field:
    """Element volumes v = g δ² [length³]; a flat surface has Sq = 0 and its gap is in lengths already."""
    return freevolume.element_volumes(contact.gap() * (surface.Sq or 1.0), surface.spacing, contact.contact())


def _labels(case: Case, surface: Surface) -> Values:
    """Labels of bins, edges, thresholds and boxes."""
    values: Values = {}
    if case.record.volume_density is not None:
        bins = case.record.volume_density.bins
        values |= {"bin": np.arange(bins), "edge": np.arange(bins + 1)}
    if case.record.box_counting is not None:
        empty = fractal.box_counts(np.zeros(surface.shape, dtype=np.bool_)[window(case, surface.shape)])
        values |= {"r": empty.r, "r_mid": fractal.local_dimension(empty).r_mid}
        values["threshold"] = list(case.record.box_counting.thresholds)
    return values


def _stacked(labels: list[str], kept: Mapping[str, Values]) -> Values:
    """Arrays of all states along a new first axis, NaN where one was not reached; nothing where none was."""
    stacked: Values = {}
    for name, example in next(iter(kept.values()), {}).items():
        absent = np.full(np.shape(example), np.nan)
        arrays = [kept[label][name] if label in kept else absent for label in labels]
        stacked[name] = np.stack([np.asarray(array, dtype=float) for array in arrays])
    return stacked
