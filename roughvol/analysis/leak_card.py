"""What a leak card holds: surfaces, loads, leaks along x and y with their errors, closing loads.

The leak is the leak that counts (`leak`), of several surfaces the median with the 16 to 84 % range (`average`).
Each part of the error is a factor, of the leak or of the closing load, and may reach farther up than down. Parts are
independent, so their logarithms add in squares. If a part is not known, the whole error is not known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from xarray import Dataset

from roughvol.analysis.average import Average, average
from roughvol.analysis.closing import Span
from roughvol.analysis.tables import number
from roughvol.study import convert


@dataclass(frozen=True)
class Part:
    """A part of the error of a leak or of a closing load.

    Attributes
    ----------
    name : str
        Source of the error.
    factor : float
        The number may be as many times larger, ≥ 1; infinite or NaN where it is not known.
    words : str
        How it was found.
    smaller : float
        The number may be as many times smaller; infinite where it may be 0. Default: as many times as larger.
    """

    name: str
    factor: float
    words: str
    smaller: float = math.nan

    def __post_init__(self) -> None:
        if math.isnan(self.smaller):
            object.__setattr__(self, "smaller", self.factor)

    @property
    def known(self) -> bool:
        """Whether the factor is known."""
        return math.isfinite(self.factor)


def together(parts: Sequence[Part]) -> tuple[float, float]:
    """Return how many times smaller and larger a number may be by all parts; NaN if a part is not known.

    Parameters
    ----------
    parts : sequence of Part
        Independent parts of an error.

    Returns
    -------
    (float, float)
        Their logarithms added in squares, downwards and upwards.
    """
    if not parts or not all(part.known for part in parts):
        return math.nan, math.nan
    sides = ([math.log(part.smaller) for part in parts], [math.log(part.factor) for part in parts])
    smaller, larger = (math.exp(math.hypot(*logs)) for logs in sides)
    return smaller, larger


@dataclass(frozen=True)
class Closing:
    """The loads at which the last way of several surfaces closes.

    Attributes
    ----------
    spans : tuple of Span
        Loads of the surfaces whose way is followed.
    unit : str
        Unit of the loads; empty for p*.
    parts : tuple of Part
        Error budget of the mean load; empty where none was made.
    """

    spans: tuple[Span, ...]
    unit: str
    parts: tuple[Part, ...] = ()

    @property
    def value(self) -> float:
        """Mean of the loads over the surfaces; NaN unless all surfaces close."""
        return float(np.mean(self.bracket))

    @property
    def interval(self) -> tuple[float, float]:
        """Smallest and largest closing load by the budget; NaN if a part is not known."""
        smaller, larger = together(self.parts)
        return self.value / smaller, self.value * larger

    @property
    def closed(self) -> tuple[Span, ...]:
        """The surfaces whose way closes within their sweep."""
        return tuple(span for span in self.spans if span.closes)

    @property
    def bracket(self) -> tuple[float, float]:
        """Means of both ends over the surfaces; NaN unless all surfaces close."""
        return _ends(self.spans) if self.spans and len(self.closed) == len(self.spans) else (math.nan, math.nan)

    @property
    def words(self) -> str:
        """The loads in words."""
        closed, still = self.closed, [span.open_up_to for span in self.spans if not span.closes]
        if not self.spans:
            return "not followed"
        if not closed:
            return f"open up to {self.load(max(still))}, the end of the sweep"
        low, high = _ends(closed)
        at = f"at {self.load(low)}" if low == high else f"between {self._range(low, high)}"
        ends = self.interval
        error = f", between {self._range(*ends)}" if all(map(math.isfinite, ends)) else ""
        if self.parts and not error:
            error = f", its error is not known ({', '.join(part.name for part in self.parts if not part.known)})"
        if len(self.spans) == 1:
            return f"{at}{error}"
        if still:
            count = f"{len(closed)} of {len(self.spans)} surfaces"
            return f"{count} {at}, the others open up to {self.load(max(still))}"
        first, last = min(span.open_up_to for span in closed), max(span.closed_from for span in closed)
        return f"{at} in the mean{error}; the first surface above {self.load(first)}, the last below {self.load(last)}"

    @property
    def short(self) -> str:
        """The loads in few words, from the last open step of the first surface to the first closed step of the last."""
        if not self.closed:
            return self.words.removesuffix(", the end of the sweep")
        first, last = min(span.open_up_to for span in self.closed), max(span.closed_from for span in self.closed)
        count = f"{len(self.closed)} of {len(self.spans)}: " if len(self.spans) > 1 else ""
        return f"{count}{self.load(first) if first == last else self._range(first, last).replace(' and ', ' to ')}"

    def _range(self, low: float, high: float) -> str:
        """Return two loads in words, with one unit."""
        return f"{self.load(low).removesuffix(f' {self.unit}')} and {self.load(high).removeprefix('p* = ')}"

    def load(self, value: float) -> str:
        """Return a load in words.

        Parameters
        ----------
        value : float
            The load in `unit`.

        Returns
        -------
        str
            As ``0.5 MPa`` or ``p* = 0.3``.
        """
        return f"{number(value)} {self.unit}" if self.unit else f"p* = {number(value)}"


def _ends(spans: tuple[Span, ...]) -> tuple[float, float]:
    """Return the means of both ends."""
    return float(np.mean([span.open_up_to for span in spans])), float(np.mean([span.closed_from for span in spans]))


@dataclass(frozen=True)
class Way:
    """The leak along one axis.

    Attributes
    ----------
    axis : str
        x or y.
    leak : Average
        Leak in `unit`: that of one surface, or the median over surfaces with its 16 to 84 % range; 0 where closed.
    open : int
        Number of surfaces with an open way.
    unit : str
        Unit of the study, or empty for T* V*³.
    closing : Closing
        Where the last way closes; under fluid pressure that of the dry gap.
    coarser : tuple of (str, Closing)
        The same on coarser grids, after the words of the grid.
    last_open : str
        Leak and load of the last open step of a surface that is closed at the load of the card, in words.
    parts : tuple of Part
        Error budget of the leak; of a closed way that of its closing load.
    at_most : float
        Largest leak of a closed way: that at the far end of the interval of its closing load.
    """

    axis: str
    leak: Average
    open: int
    unit: str
    closing: Closing
    coarser: tuple[tuple[str, Closing], ...]
    last_open: str
    parts: tuple[Part, ...]
    at_most: float = math.nan

    @property
    def factor(self) -> float:
        """All parts together: the number may be as many times larger. NaN if a part is not known."""
        return together(self.parts)[1]

    @property
    def smaller(self) -> float:
        """All parts together: the number may be as many times smaller; infinite where it may be 0."""
        return together(self.parts)[0]

    @property
    def interval(self) -> tuple[float, float]:
        """Smallest and largest leak; NaN if a part of the error is not known."""
        if self.leak.value == 0.0:
            return (0.0, self.at_most) if math.isfinite(self.at_most) else (math.nan, math.nan)
        smaller, larger = together(self.parts)
        return self.leak.value / smaller, self.leak.value * larger


@dataclass(frozen=True)
class Beside:
    """A leak that stands beside the leak that counts: of the dry gap, or of a gas.

    Attributes
    ----------
    words : str
        Kind of the leak.
    leaks : tuple of Average
        Along x and y.
    unit : str
        Their unit, empty for T* V*³.
    """

    words: str
    leaks: tuple[Average, ...]
    unit: str


@dataclass(frozen=True, eq=False)
class SurfaceAtLoad:
    """One surface of a card.

    Attributes
    ----------
    name : str
        Height file, or D, m and seed.
    Sq, Sdq : float
        Root mean square height [unit of length] and slope.
    mean_pressure, nominal_pressure : float
        Load: p*, and with its unit; NaN where unknown.
    contact_area, free_volume : float
        A* and V*.
    leaks : tuple of float
        Along x and y in the unit of the card; NaN where the sweep does not reach the load.
    closings : tuple of Closing
        Along x and y.
    table : Dataset
        Its run: states along ``step``, recorded fields.
    recorded : str
        Label of the state among the recorded states.
    """

    name: str
    Sq: float
    Sdq: float
    mean_pressure: float
    nominal_pressure: float
    contact_area: float
    free_volume: float
    leaks: tuple[float, ...]
    closings: tuple[Closing, ...]
    table: Dataset
    recorded: str


@dataclass(frozen=True)
class SealLeak:
    """The leak of a seal made of patches, and the load that closes it.

    Attributes
    ----------
    label : str
        Length and width in words.
    flow : str
        Axis along which the fluid flows.
    patches : (int, int)
        Patches in a row along the flow, and side by side.
    leak : float
        Leak in `unit`; NaN where no surface is pressed to the load.
    interval : (float, float)
        Smallest and largest leak; NaN where it is not known. From 0 where a patch is closed.
    unit : str
        Unit of the study, or empty for T* V*³ times length over width.
    parts : tuple of Part
        Error budget.
    closing : float
        Load above which the seal is tight, in `load_unit`; NaN where a patch does not close within its sweep.
    closing_interval : (float, float)
        Its interval; NaN where it is not known.
    load_unit : str
        Unit of nominal pressure; empty for p*.
    words : tuple of str
        How it was found, and what is missing.
    closing_parts : tuple of Part
        Error budget of `closing`.
    """

    label: str
    flow: str
    patches: tuple[int, int]
    leak: float
    interval: tuple[float, float]
    unit: str
    parts: tuple[Part, ...]
    closing: float
    closing_interval: tuple[float, float]
    load_unit: str
    words: tuple[str, ...]
    closing_parts: tuple[Part, ...] = ()

    @property
    def factor(self) -> float:
        """All parts together: the leak may be as many times larger. NaN if a part is not known."""
        return together(self.parts)[1]

    @property
    def smaller(self) -> float:
        """All parts together: the leak may be as many times smaller."""
        return together(self.parts)[0]

    def plain(self) -> dict[str, Any]:
        """Return the seal as plain data; pressures in MPa, None where a number is not known.

        Returns
        -------
        dict
            Keys ``leak``, ``tight_above`` and their intervals.
        """
        to_mpa = convert(1.0, self.load_unit, "MPa") if self.load_unit else math.nan
        return {
            "leak": _known(self.leak),
            "leak_interval": _interval(self.interval),
            "tight_above": _known(self.closing * to_mpa),
            "tight_above_interval": _interval(tuple(end * to_mpa for end in self.closing_interval)),
        }


@dataclass(frozen=True, eq=False)
class Card:
    """A leak card.

    Attributes
    ----------
    title : str
        Name of the study.
    load : str
        The load in words, as ``pressure=0.5 MPa, leg 2``.
    surfaces : tuple of SurfaceAtLoad
        Its surfaces.
    pressure_unit, length_unit : str
        Units of nominal pressures and lengths; empty where the study has none.
    ways : tuple of Way
        The leak along x and y.
    beside : tuple of Beside
        Other leaks.
    lifted : bool
        Whether fluid pressure lifts the gap.
    warnings : tuple of str
        Limits of the model that the runs exceed.
    seal : SealLeak or None
        The seal of the study.
    """

    title: str
    load: str
    surfaces: tuple[SurfaceAtLoad, ...]
    pressure_unit: str
    length_unit: str
    ways: tuple[Way, ...]
    beside: tuple[Beside, ...]
    lifted: bool
    warnings: tuple[str, ...]
    seal: SealLeak | None = None

    def loads(self, name: str) -> list[float]:
        """Return a load of the surfaces that reach the load of the card.

        Parameters
        ----------
        name : {"mean_pressure", "nominal_pressure"}
            Attribute of `SurfaceAtLoad`.

        Returns
        -------
        list of float
            Known loads.
        """
        return [load for one in self.surfaces if math.isfinite(load := getattr(one, name))]

    def mean(self, name: str) -> float:
        """Return the mean of a number over the surfaces.

        Parameters
        ----------
        name : str
            Attribute of `SurfaceAtLoad`, as ``mean_pressure``.

        Returns
        -------
        float
            Mean over the surfaces that have a value; NaN without one.
        """
        return average(name, [getattr(surface, name) for surface in self.surfaces]).value

    def plain(self) -> dict[str, Any]:
        """Return the card as plain data for JSON; None where a number is not known.

        Pressures are in MPa. Under fluid pressure the closing is not known.

        Returns
        -------
        dict
            Keys ``surfaces``, ``load``, ``ways``, and ``seal`` if the study has one.
        """
        to_mpa = convert(1.0, self.pressure_unit, "MPa") if self.pressure_unit else math.nan
        ways = []
        for way in self.ways:
            per_unit = math.nan if self.lifted or not way.closing.unit else convert(1.0, way.closing.unit, "MPa")
            closing = tuple(per_unit * end for end in way.closing.interval)
            ways.append(
                {
                    "axis": way.axis,
                    "leak": _known(way.leak.value),
                    "unit": way.unit or "1",
                    "leak_interval": _interval(way.interval),
                    "closing_pressure": _known(per_unit * way.closing.value),
                    "closing_pressure_interval": _interval(closing),
                    "parts": {part.name: _known(part.factor) for part in way.parts},
                }
            )
        load = {"nominal_pressure": self.mean("nominal_pressure") * to_mpa, "mean_pressure": self.mean("mean_pressure")}
        return {
            "surfaces": [surface.name for surface in self.surfaces],
            "load": {name: _known(value) for name, value in load.items()},
            "ways": ways,
            **({"seal": self.seal.plain()} if self.seal is not None else {}),
        }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _interval(ends: tuple[float, ...]) -> list[float] | None:
    return list(ends) if all(map(math.isfinite, ends)) else None
