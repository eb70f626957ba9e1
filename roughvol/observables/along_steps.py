"""Quantities of the void and of central regions, collected along the steps of a sweep."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from roughvol.contact.loading import Contact
from roughvol.observables import regions, void
from roughvol.observables.levels import on_legs, reached
from roughvol.observables.regions import State, window
from roughvol.study import Case
from roughvol.surfaces.surface import Surface

Values = dict[str, Any]


class AlongSteps:
    """The quantities along the steps: each at every step, or at the first state that reaches each of its levels."""

    def __init__(self, case: Case, surface: Surface) -> None:
        self.case, self.values = case, Values()
        transport, widths = case.record.transport, case.record.region_widths
        self._levels = void.levels(transport) if transport else {}
        self._windows: dict[float, regions.Window] = {}
        if widths is not None:
            self._levels |= regions.levels(widths)
            self._windows = {
                w: regions.window_of(regions.central(w), surface.shape, periodic=case.periodic) for w in widths.shares
            }
            self.values["region_width"] = list(widths.shares)
        self._levels = {
            name: None if levels is None else on_legs(levels, case) for name, levels in self._levels.items()
        }
        self._gas = void.over_sigma(case.gas, case.height or surface.unit)
        self.seconds = dict.fromkeys(self._levels, 0.0)
        rows, columns = window(case, surface.shape)
        self._origin, self._intervals = np.array([rows.start, columns.start]), surface.intervals[0]
        if "percolation" in self._levels:
            self.values["size"] = void.size_classes((rows.stop - rows.start) * (columns.stop - columns.start))
        if "constriction" in self._levels:
            self.values["axis"] = ["x", "y"]
        if {"transmissivity", "diffusivity", void.GAS_FLOW} & self._levels.keys():
            self.values["region_aspect"] = (columns.stop - columns.start) / (rows.stop - rows.start)

    def state(self) -> Values:
        """Return the values collected and the levels still to be reached, for `restore`."""
        left = {name: None if levels is None else list(levels) for name, levels in self._levels.items()}
        return {"along": self.values, "left": left, "along_seconds": self.seconds}

    def restore(self, state: Values) -> None:
        """Take the content of another collection, from its `state`."""
        self.values, self.seconds = state["along"], state["along_seconds"]
        for name, labels in state["left"].items():
            for label in set(self._levels[name] or ()) - set(labels or ()):
                del (self._levels[name] or {})[label]

    def follow(self, step: int, contact: State, whole: Contact, before: Mapping[str, float] | None) -> None:
        """Take in the next state, in the region of the study and as a whole; the numbers of the one before."""
        quantities = []
        for name, levels in self._levels.items():
            hit = [label for label, level in (levels or {}).items() if reached(level, step, contact, self.case, before)]
            for label in hit:
                del (levels or {})[label]
            if levels is None or hit:
                quantities.append(name)
        wanted = [name for name in quantities if name in void.QUANTITIES]
        outcome, seconds = void.of_state(contact, wanted, self._gas)
        central = [name for name in quantities if name in regions.QUANTITIES]
        inside, more = regions.of_state(whole, central, self._windows)
        for name, taken in (seconds | more).items():
            self.seconds[name] += taken
        for name, value in (outcome | inside).items():
            if name.startswith("critical_position"):
                value = (value + self._origin) / self._intervals  # over L, as x and y are
            absent = np.full((self.case.sweep.steps, *np.shape(value)), np.nan)
            self.values.setdefault(name, absent)[step - 1] = value
