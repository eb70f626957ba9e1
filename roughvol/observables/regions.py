"""Parts of a surface: a contact seen through a window of its elements, and a state as an observable sees it.

Observables of a window are those of the loaded surface, cut out there. Lengths stay over the Sq of the whole surface,
pressures over its E* Sq/L.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from roughvol.contact.loading import Compliance, Contact
from roughvol.errors import ContactError, Problem, StudyError
from roughvol.gap.constriction import Constriction, constriction
from roughvol.study import Case, Region
from roughvol.surfaces.surface import Surface, intervals
from roughvol.typing import Array, Mask

Window = tuple[slice, slice]
Values = dict[str, Any]
"""Numbers and arrays by stored name."""
MEANS = {
    "contact_area_fraction": "contact",
    "mean_pressure": "pressure",
    "free_volume": "gap",
    "plastic_volume": "plastic_displacement",
    "plastic_area_fraction": "yielded",
}
"""Numbers of a contact that are means of its fields."""
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

    def void(self) -> Mask:
        """Return where g > 0 inside."""
        return self.whole.void()[self._window]

    periodic = False  # a part of a period is none
    mean_pressure_bound = math.nan  # only the pressure on the whole surface is certified

    def __getattr__(self, name: str) -> Any:
        """Return the mean of a field inside, L and σ of the whole; of the whole what does not depend on the window."""
        if name not in MEANS:
            return getattr(self.whole, name)
        value = float(getattr(self.whole, MEANS[name])()[self._window].mean())
        setattr(self, name, value)  # once
        return value


State = Contact | Within


def within(contact: Contact, case: Case) -> State:
    """Return a contact seen in the region of a study; the contact itself where that is the whole surface."""
    return contact if case.record.part is None else Within(contact, window(case, contact.shape))


def is_period(case: Case) -> bool:
    """Return whether a study observes one period: a part of it is none."""
    return case.periodic and case.record.part is None


def window(case: Case, shape: tuple[int, int]) -> Window:
    """Return the rows and columns of the elements in the region that a study observes."""
    return window_of(case.record.region or Region(), shape, periodic=case.periodic)


def window_of(region: Region, shape: tuple[int, int], *, periodic: bool = False) -> Window:
    """Return the rows and columns of the elements whose centres lie in a region.

    The side of a period is one spacing longer than its nodes. Fewer than two elements along an axis: `ContactError`.
    """
    slices = []
    for (start, end), nodes in zip((region.x, region.y), shape, strict=True):
        side = intervals(nodes, periodic)
        first, last = math.ceil(start * side - ROUNDING), min(math.floor(end * side + ROUNDING), nodes - 1)
        if last <= first:
            raise ContactError(f"the region {region.label} of {shape[0]} × {shape[1]} elements is fewer than 2 × 2")
        slices.append(slice(first, last + 1))
    return slices[0], slices[1]


def check(case: Case) -> None:
    """Refuse a study whose regions hold too few elements of its surface, by a `StudyError`."""
    widths, least = case.record.region_widths, 3 if case.record.psd is not None else 2
    asked = [] if case.record.region is None else [("record.region", case.record.region)]
    if widths is not None:
        asked += [("record.region_widths.shares", central(share)) for share in widths.shares]
    problems = []
    for key, region in asked:
        try:
            inside = window_of(region, case.shape, periodic=case.periodic)
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
    """Return the region in the middle whose sides are a share of those of the surface."""
    sides = (0.5 - 0.5 * share, 0.5 + 0.5 * share)
    return Region.model_construct(x=sides, y=sides)  # the sides of a tiny share are equal


@dataclass(frozen=True)
class View:
    """One state of a sweep: the case, the whole surface, whose Sq is the unit of lengths, and the state on it.

    ``pressures`` are those of the fluid at the last state with a flow, by name and axis, for the next flow to start
    from.
    """

    case: Case
    surface: Surface
    whole: Contact
    half_space: Compliance
    pressures: dict[str, Array] = field(default_factory=dict)

    @cached_property
    def state(self) -> State:
        """The state in the region."""
        return within(self.whole, self.case)

    @property
    def periodic(self) -> bool:
        """Whether the region is one period of a plane."""
        return self.state.periodic

    @cached_property
    def gap(self) -> Array:
        """Gap g/σ in the region, exactly 0 in contact."""
        return self.state.gap()

    @cached_property
    def narrowest(self) -> list[Constriction]:
        """Critical constrictions along x and y."""
        return [constriction(self.gap, axis, periodic=self.periodic) for axis in (0, 1)]

    @cached_property
    def contact(self) -> Mask:
        """Where p > 0 in the region."""
        return self.state.contact()
