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

from roughvol.contact import search
from roughvol.contact.loading import Compliance, Contact, Trials, sweep
from roughvol.contact.search import TARGETS
from roughvol.observables import box_counting, free_volume, regions, void
from roughvol.observables.regions import Within, window, within
from roughvol.study import Case, Level
from roughvol.surfaces import texture
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array

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
OF_STATE = ("indentation", "separation", "contact_area_fraction", "mean_pressure", "free_volume")
LAST = Level("last")
ROUNDING = 1e-9  # relative; by which a state may miss a level and still count as reaching it


def end_of(case: Case) -> Callable[[Contact], bool] | None:
    """Return what must hold of a state for the sweep to end there, if it is a matter of the region or of the void."""
    kind, value = case.sweep.target.kind, case.sweep.target.value or 0.0
    if kind.startswith("percolation"):
        return lambda contact: void.stops_percolating(kind, within(contact, case))
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
    case: Case,
    surface: Surface,
    half_space: Compliance,
    contacts: Iterable[Contact],
    on_step: Callable[[int], None] | None = None,
) -> Values:
    """Return the numbers of every step, and what is recorded of the state at each level selected.

    Parameters
    ----------
    case : Case
        Names the levels and what to record there.
    surface : Surface
        The surface pressed.
    half_space : Compliance
        On which the states at levels between two steps are solved.
    contacts : iterable of Contact
        The states in the order of the sweep; none is held longer than its turn.
    on_step : callable, optional
        Called with the number of each step that has been reduced.
    """
    reduction = Reduction(case, surface, half_space)
    for step, contact in enumerate(contacts, start=1):
        reduction.follow(contact)
        if on_step is not None:
            on_step(step)
    return reduction.values()


class Reduction:
    """Takes in the states of a sweep one by one and holds what is recorded of them."""

    def __init__(self, case: Case, surface: Surface, half_space: Compliance) -> None:
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
        self._half_space, self._convolutions = half_space, 0.0
        self._states: list[Mapping[str, Any]] = []

    @property
    def steps(self) -> int:
        """How many states have been taken in."""
        return len(self._per_step["indentation"])

    @property
    def states(self) -> list[Mapping[str, Any]]:
        """The last two states, as `Contact.state` returns them."""
        return self._states

    def follow(self, whole: Contact) -> None:
        """Take in the next state."""
        contact, step = within(whole, self._case), self.steps + 1
        self._along.follow(step, contact, whole)
        for level, wanted in self._reached(step, contact).items():
            state = within(self._at(level, step, whole), self._case)
            numbers = {name: getattr(state, name) for name in OF_STATE}
            for dim, label in wanted:
                started = time.perf_counter()
                own = {f"{dim}_{name}": number for name, number in numbers.items()}
                self._kept[dim][label] = step, own | _AT[dim](self._case, self._surface, state)
                self._seconds[_OBSERVABLES[dim]] += time.perf_counter() - started
        for name in PER_STEP:
            self._per_step[name].append(getattr(contact, name))
        if self._hardness is not None:
            for name, share in zip(ABOVE_HARDNESS, above(contact.pressure(), self._hardness), strict=True):
                self._per_step[name].append(share)
        if step == self._case.sweep.steps and min(whole.shape) > 3:  # 3 nodes have one in the middle
            self._along.values["central_pressure_ratio"] = central_pressure_ratio(whole)
        self._states = [*self._states, whole.state()][-2:]

    def _reached(self, step: int, contact: Contact | Within) -> dict[Level, list[tuple[str, str]]]:
        """Return the levels that this state is the first to reach, and for which dimensions under which labels."""
        found: dict[Level, list[tuple[str, str]]] = {}
        for dim, by_label in self._levels.items():
            for label, level in by_label.items():
                if label not in self._kept[dim] and (level in found or reached(level, step, contact, self._case)):
                    found.setdefault(level, []).append((dim, label))
        return found

    def _at(self, level: Level, step: int, whole: Contact) -> Contact:
        """Return the state at a level that this step is the first to reach."""
        if level.value is None or level.kind == "step" or _is_end(level, step, self._case):
            return whole
        half_space = self._half_space
        before = half_space.convolutions + half_space.convolutions_fp32
        residual = self._per_step["residual"][-1] if self._states else 0.0
        found = at_level(level, self._case, self._surface, half_space, self._states, residual, whole)
        self._convolutions += half_space.convolutions + half_space.convolutions_fp32 - before
        return found

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
            values |= {f"{dim}_{name}": np.full(len(by_label), np.nan) for name in OF_STATE}
            values |= _stacked(list(by_label), {label: arrays for label, (_, arrays) in kept.items()})
        if self._levels:
            values["level_convolutions"] = self._convolutions
        return values

    def state(self) -> Values:
        """Return all this holds, but the last two states, as mappings, lists, numbers and arrays, for `restore`."""
        held = {"per_step": self._per_step, "kept": self._kept, "seconds": self._seconds}
        return {**held, "level_convolutions": self._convolutions, **self._along.state()}

    def restore(self, state: Values, states: list[Mapping[str, Any]]) -> None:
        """Become what returned this state and these last two states."""
        self._per_step = state["per_step"]
        self._kept = {
            dim: {label: (step, values) for label, (step, values) in by_label.items()}
            for dim, by_label in state["kept"].items()
        }
        self._seconds, self._convolutions = state["seconds"], state["level_convolutions"]
        self._states = list(states)
        self._along.restore(state)


def above(pressure: Array, hardness: float) -> tuple[float, float]:
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


def at_level(
    level: Level,
    case: Case,
    surface: Surface,
    half_space: Compliance,
    earlier: list[Mapping[str, Any]],
    residual: float,
    after: Contact,
) -> Contact:
    """Return the state at a level that lies between two steps of a sweep, which stays as it is.

    At an indentation or a separation one state is solved; an area or a pressure, in the region of the study if there is
    one, is searched for between the two steps.

    Parameters
    ----------
    level : Level
        Of the kind indentation, separation, contact_area or pressure.
    case : Case
        Its solver and region.
    earlier : list of mappings
        The one or two states before the level, as `Contact.state` returns them; none before the first step.
    residual : float
        η/σ of the last of them.
    after : Contact
        The first step at the level or beyond it.
    """
    solver, value = case.solver, level.value or 0.0
    if level.kind in TARGETS:
        name = TARGETS[level.kind]
        trials = Trials(
            surface,
            half_space,
            rtol=solver.tolerance,
            method=solver.method,
            pressure_error=solver.pressure_error,
        )
        between = [trials.known(state, residual) for state in earlier[-1:]]
        trials.least = between[0] if between else None
        between.append(trials.known(after.state(), after.residual))
        return search.state_reaching(
            trials,
            lambda contact: float(getattr(within(contact, case), name)),
            value * (1.0 - ROUNDING),
            between,
            elements=level.kind == "contact_area",
        )
    indentation = value if level.kind == "indentation" else after.indentation + after.separation - value
    if abs(indentation - after.indentation) <= ROUNDING * after.indentation:
        return after
    return next(
        sweep(
            surface,
            half_space,
            [indentation],
            rtol=solver.tolerance,
            method=solver.method,
            pressure_error=solver.pressure_error,
            resume=earlier,
        )
    )


class AlongSteps:
    """Collects quantities of the void and of central regions along the steps, each at the states it is asked for.

    That is at every step, or at the first state that reaches each of its levels.
    """

    def __init__(self, case: Case, surface: Surface) -> None:
        self.case, self.values = case, Values()
        transport, widths = case.record.transport, case.record.region_widths
        self._levels = void.levels(transport) if transport else {}
        self._windows: dict[float, regions.Window] = {}
        if widths is not None:
            self._levels |= regions.levels(widths)
            self._windows = {w: regions.window_of(regions.central(w), surface.shape) for w in widths.shares}
            self.values["region_width"] = list(widths.shares)
        self.seconds = dict.fromkeys(self._levels, 0.0)
        rows, columns = window(case, surface.shape)
        self._origin, self._nodes = np.array([rows.start, columns.start]), surface.shape[0]
        if "percolation" in self._levels:
            self.values["size"] = void.size_classes((rows.stop - rows.start) * (columns.stop - columns.start))
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
        outcome, seconds = void.of_state(contact, [name for name in quantities if name in void.QUANTITIES])
        central = [name for name in quantities if name in regions.QUANTITIES]
        inside, more = regions.of_state(whole, central, self._windows)
        for name, taken in (seconds | more).items():
            self.seconds[name] += taken
        for name, value in (outcome | inside).items():
            if name.startswith("critical_position"):
                value = (value + self._origin) / (self._nodes - 1)  # over L, as x and y are
            absent = np.full((self.case.sweep.steps, *np.shape(value)), np.nan)
            self.values.setdefault(name, absent)[step - 1] = value


def reached(level: Level, step: int, contact: Contact | Within, case: Case) -> bool:
    """Return whether a state is at or beyond a level.

    The last step reaches the level that the sweep was asked to end at, though a solve to a finite residual may put it
    one element or a few digits short.
    """
    if _is_end(level, step, case):
        return True
    if level.value is None:
        return False
    slack = ROUNDING * (max(1.0, abs(level.value)) if level.kind == "separation" else level.value)
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


def _is_end(level: Level, step: int, case: Case) -> bool:
    """Return whether a level is the end of the sweep, at its last step."""
    return step == case.sweep.steps and level in (LAST, case.sweep.target)


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


def searched_levels(case: Case) -> int:
    """Return for how many levels a state is searched for, each once."""
    levels = {level for by_label in _levels(case).values() for level in by_label.values()}
    return sum(level.kind in TARGETS and level != case.sweep.target for level in levels)


def _fields(case: Case, surface: Surface, contact: Contact | Within) -> Values:
    whole = contact.whole if isinstance(contact, Within) else contact
    return {"gap": whole.gap(), "pressure": whole.pressure()}


def _flux(case: Case, surface: Surface, contact: Contact | Within) -> Values:
    """Return the flux on the nodes of the whole surface, NaN outside the region."""
    values = void.flux(contact)
    for name in ("flux_x", "flux_y"):
        inside, values[name] = values[name], np.full(surface.shape, np.nan)
        values[name][window(case, surface.shape)] = inside
    return values


def _density(case: Case, surface: Surface, contact: Contact | Within) -> Values:
    assert case.record.volume_density is not None
    mask = contact.contact()
    density = free_volume.volume_density(
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
    domains = [free_volume.domain(volumes, share * largest, mask) for share in case.record.box_counting.thresholds]
    counts = [box_counting.box_counts(domain) for domain in domains]
    dimensions = [box_counting.local_dimension(count).dimension for count in counts]
    return {"volume_max": largest, "box_count": [count.counts for count in counts], "local_dimension": dimensions}


_OBSERVABLES = {"field_at": "fields_at", "density_at": "volume_density", "box_at": "box_counting", "flux_at": "flux_at"}
_AT = {"field_at": _fields, "density_at": _density, "box_at": _boxes, "flux_at": _flux}


def _volumes(surface: Surface, contact: Contact | Within) -> Array:
    """Element volumes v = g δ² [length³]; a flat surface has Sq = 0 and its gap is in lengths already."""
    return free_volume.element_volumes(contact.gap() * (surface.Sq or 1.0), surface.spacing, contact.contact())


def _labels(case: Case, surface: Surface) -> Values:
    """Labels of bins, edges, thresholds and boxes."""
    values: Values = {}
    if case.record.volume_density is not None:
        bins = case.record.volume_density.bins
        values |= {"bin": np.arange(bins), "edge": np.arange(bins + 1)}
    if case.record.box_counting is not None:
        empty = box_counting.box_counts(np.zeros(surface.shape, dtype=np.bool_)[window(case, surface.shape)])
        values |= {"r": empty.r, "r_mid": box_counting.local_dimension(empty).r_mid}
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
