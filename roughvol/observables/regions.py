"""Parts of a surface: a contact seen through a window of its elements, and central squares of several widths.

A window holds the elements whose centres lie in a region. Observables of a window are those of the loaded surface, cut
out there. Lengths stay over the Sq of the whole surface, pressures over its E* Sq/L.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

from roughvol.contact.loading import Contact
from roughvol.errors import ContactError, Problem, StudyError
from roughvol.gap import transport
from roughvol.observables import void
from roughvol.study import Case, Level, Region, RegionWidths
from roughvol.surfaces.surface import intervals
from roughvol.typing import Array, Mask

Window = tuple[slice, slice]
ROUNDING = 1e-9  # of a position over the length of its axis


class Within:
    """A contact seen through a window of its elements: area, pressure, free volume and fields are those inside."""

    def __init__(self, contact: Contact, window: Window) -> None:
        self.whole, self._window = contact, window

    def gap(self) -> Array:
        """Return g/σ inside."""
        return self.whole.gap()[self._window]

    def pressure(self) -> Array:
        """Return p L/(E* σ) inside."""
        return self.whole.pressure()[self._window]

    def contact(self) -> Mask:
        """Return where p > 0 inside."""
        return self.whole.contact()[self._window]

    @cached_property
    def contact_area_fraction(self) -> float:
        """A* of the elements inside."""
        return float(self.contact().mean())

    @cached_property
    def mean_pressure(self) -> float:
        """Mean pressure p* of the elements inside, L and σ of the whole."""
        return float(self.pressure().mean())

    @cached_property
    def free_volume(self) -> float:
        """V* of the elements inside, σ of the whole."""
        return float(self.gap().mean())

    @cached_property
    def plastic_volume(self) -> float:
        """Mean plastic displacement of the elements inside, σ of the whole."""
        return float(self.whole.plastic_displacement()[self._window].mean())

    @cached_property
    def plastic_area_fraction(self) -> float:
        """Elements inside that have yielded, over all inside."""
        return float(self.whole.yielded()[self._window].mean())

    periodic = False  # a part of a period is none
    mean_pressure_bound = math.nan  # only the pressure on the whole surface is certified

    def __getattr__(self, name: str) -> Any:
        """Return what does not depend on the window."""
        return getattr(self.whole, name)


State = Contact | Within


def within(contact: Contact, case: Case) -> State:
    """Return a contact seen in the region of a study; the contact itself where that is the whole surface.

    Parameters
    ----------
    contact : Contact
        A state of the whole surface.
    case : Case
        Names the region.

    Returns
    -------
    Contact or Within
        The state in the region.
    """
    return contact if case.record.region is None else Within(contact, window(case, contact.shape))


def is_period(case: Case) -> bool:
    """Return whether a study observes one period: a part of it is none.

    Parameters
    ----------
    case : Case
        Names the region.

    Returns
    -------
    bool
        Whether opposite sides of the region are joined.
    """
    return case.periodic and case.record.region is None


def window(case: Case, shape: tuple[int, int]) -> Window:
    """Return the rows and columns of the elements in the region that a study observes.

    Parameters
    ----------
    case : Case
        Names the region.
    shape : tuple of int
        Nodes along both axes.

    Returns
    -------
    tuple of slice
        Rows and columns.

    Raises
    ------
    ContactError
        If fewer than two lie in it along an axis.
    """
    return window_of(case.record.region or Region(), shape, periodic=case.periodic)


def window_of(region: Region, shape: tuple[int, int], *, periodic: bool = False) -> Window:
    """Return the rows and columns of the elements whose centres lie in a region.

    Parameters
    ----------
    region : Region
        Shares of the sides.
    shape : tuple of int
        Nodes along both axes.
    periodic : bool
        Whether a side is one spacing longer than its nodes.

    Returns
    -------
    tuple of slice
        Rows and columns.

    Raises
    ------
    ContactError
        If fewer than two lie in it along an axis.
    """
    slices = []
    for (start, end), nodes in zip((region.x, region.y), shape, strict=True):
        side = intervals(nodes, periodic)
        first, last = math.ceil(start * side - ROUNDING), min(math.floor(end * side + ROUNDING), nodes - 1)
        if last <= first:
            raise ContactError(f"the region {region.label} of {shape[0]} × {shape[1]} elements is fewer than 2 × 2")
        slices.append(slice(first, last + 1))
    return slices[0], slices[1]


def check(case: Case, shape: tuple[int, int]) -> None:
    """Refuse a study whose regions hold too few elements of its surface.

    Parameters
    ----------
    case : Case
        Names the regions.
    shape : tuple of int
        Nodes along both axes.

    Raises
    ------
    StudyError
        With the region and the shape.
    """
    widths, least = case.record.region_widths, 3 if case.record.psd is not None else 2
    asked = [] if case.record.region is None else [("record.region", case.record.region)]
    if widths is not None:
        asked += [("record.region_widths.shares", central(share)) for share in widths.shares]
    problems = []
    for key, region in asked:
        try:
            inside = window_of(region, shape, periodic=case.periodic)
        except ContactError as error:
            problems.append(Problem(str(error), key))
            continue
        rows, columns = (part.stop - part.start for part in inside)
        if key == "record.region" and min(rows, columns) < least:
            message = f"the region {region.label} has {rows} × {columns} elements; record.psd needs 3 × 3"
            problems.append(Problem(message, key))
    if problems:
        raise StudyError(problems)


def central(share: float) -> Region:
    """Return the region in the middle whose sides are a share of those of the surface.

    Parameters
    ----------
    share : float
        Width over that of the surface, 0 to 1.

    Returns
    -------
    Region
        The region.
    """
    sides = (0.5 - 0.5 * share, 0.5 + 0.5 * share)
    return Region(x=sides, y=sides)


def levels(asked: RegionWidths) -> dict[str, dict[str, Level] | None]:
    """Return the levels by label of each quantity of the central regions asked for; None for every step.

    Parameters
    ----------
    asked : RegionWidths
        The section ``record.region_widths``.

    Returns
    -------
    dict
        Levels by label, or None, by name of the quantity.
    """
    states_of = dict(zip(QUANTITIES, (asked.at, asked.transmissivity), strict=True))
    return {name: void.by_label(states) for name, states in states_of.items() if states is not None}


def of_state(
    whole: Contact, quantities: list[str], windows: Mapping[float, Window]
) -> tuple[dict[str, Any], dict[str, float]]:
    """Return the numbers inside each window, and the seconds by quantity.

    Parameters
    ----------
    whole : Contact
        A state of the whole surface.
    quantities : list of str
        Keys of `QUANTITIES`.
    windows : mapping
        The window of each width.

    Returns
    -------
    tuple of dict
        Values by stored name; seconds by quantity.
    """
    values: dict[str, Any] = {}
    seconds = {}
    for name in quantities:
        started = time.perf_counter()
        values |= QUANTITIES[name].of_windows(whole, windows)
        seconds[name] = time.perf_counter() - started
    return values, seconds


def _means(whole: Contact, windows: Mapping[float, Window]) -> dict[str, Any]:
    contact, pressure, gap = whole.contact(), whole.pressure(), whole.gap()
    return {
        "contact_area_fraction_within": [contact[inside].mean() for inside in windows.values()],
        "mean_pressure_within": [pressure[inside].mean() for inside in windows.values()],
        "free_volume_within": [gap[inside].mean() for inside in windows.values()],
    }


def _flows(whole: Contact, windows: Mapping[float, Window]) -> dict[str, Any]:
    gap = whole.gap()
    return {
        f"transmissivity_within_{axis}": [
            transport.conduction(gap[inside], n).coefficient for inside in windows.values()
        ]
        for axis, n in void.AXES
    }


class Quantity(NamedTuple):
    """A quantity of the central regions.

    Attributes
    ----------
    of_windows : state of the whole surface, window of each width ↦ numbers by stored name.
    seconds : per state and node of each window, timed at m = 7 … 9.
    flow : whether it factorises, so that its cost grows faster than the nodes.
    """

    of_windows: Callable[[Contact, Mapping[float, Window]], dict[str, Any]]
    seconds: float
    flow: bool = False


QUANTITIES = {
    "region_widths": Quantity(_means, 3e-9),
    "region_transmissivity": Quantity(_flows, void.QUANTITIES["transmissivity"].seconds, flow=True),
}
