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
from roughvol.observables.variables import AXES
from roughvol.study import convert
from roughvol.study.plain_data import finite


@dataclass(frozen=True)
class Part:
    """A part of the error of a leak or of a closing load: its source, its size, and in words how it was found.

    The number may be ``factor`` times larger: ≥ 1, infinite or NaN where it is not known. It may be ``smaller`` times
    smaller: infinite where it may be 0, by default ``factor``.
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
    """Return how many times smaller and larger a number may be by all parts; NaN if a part is not known."""
    if not parts or not all(part.known for part in parts):
        return math.nan, math.nan
    sides = ([math.log(part.smaller) for part in parts], [math.log(part.factor) for part in parts])
    smaller, larger = (math.exp(math.hypot(*logs)) for logs in sides)
    return smaller, larger


class WithParts:
    """A number with the parts of its error."""

    parts: tuple[Part, ...]

    @property
    def factor(self) -> float:
        """All parts together: the number may be as many times larger. NaN if a part is not known."""
        return together(self.parts)[1]

    @property
    def smaller(self) -> float:
        """All parts together: the number may be as many times smaller; infinite where it may be 0."""
        return together(self.parts)[0]

    @property
    def unknown(self) -> str:
        """The names of the parts that are not known."""
        return ", ".join(part.name for part in self.parts if not part.known)


@dataclass(frozen=True)
class Closing(WithParts):
    """The loads at which the last way of several surfaces closes, in ``unit`` (empty for p*).

    ``spans`` are those of the surfaces whose way is followed. ``parts`` is the error budget of the mean load.
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
        return self.value / self.smaller, self.value * self.factor

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
            error = f", its error is not known ({self.unknown})"
        if len(self.spans) == 1:
            return f"{at}{error}"
        if still:
            count = f"{len(closed)} of {len(self.spans)} surfaces"
            return f"{at} on {count}, open up to {self.load(max(still))} on the others"
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
        """Return a load in ``unit`` in words, as ``0.5 MPa`` or ``p* = 0.3``."""
        return f"{number(value)} {self.unit}" if self.unit else f"p* = {number(value)}"


def _ends(spans: tuple[Span, ...]) -> tuple[float, float]:
    """Return the means of both ends."""
    return float(np.mean([span.open_up_to for span in spans])), float(np.mean([span.closed_from for span in spans]))


@dataclass(frozen=True)
class Way(WithParts):
    """The leak along one axis.

    - ``leak``: the leak of one surface, or the median over surfaces with its 16 to 84 % range; 0 where closed
    - ``open``: number of surfaces with an open way
    - ``unit``: unit of the study, or empty for T* V*³
    - ``closing``: where the last way closes; under fluid pressure that of the dry gap
    - ``coarser``: closings on coarser grids, after the words of the grid
    - ``last_open``: last open step of a surface that is closed at the load of the card: leak and load, in words
    - ``parts``: error budget of the leak; of a closed way that of its closing load
    - ``at_most``: largest leak of a closed way: that at the far end of the interval of its closing load
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
    def interval(self) -> tuple[float, float]:
        """Smallest and largest leak; NaN if a part of the error is not known."""
        if self.leak.value == 0.0:
            return (0.0, self.at_most) if math.isfinite(self.at_most) else (math.nan, math.nan)
        return self.leak.value / self.smaller, self.leak.value * self.factor


@dataclass(frozen=True)
class Beside:
    """A leak beside the leak that counts, of the dry gap or of a ``gas``, along x and y; no ``unit`` for T* V*³."""

    words: str
    leaks: tuple[Average, ...]
    unit: str
    gas: bool = False

    def plain(self) -> dict[str, Any]:
        """Return the leak as plain data for JSON."""
        leaks = {axis: finite(leak.value) for axis, leak in zip(AXES, self.leaks, strict=True)}
        return {"words": self.words, **leaks, "unit": self.unit or "1"}


@dataclass(frozen=True, eq=False)
class SurfaceAtLoad:
    """One surface of a card: its height file, or D, m and seed.

    ``Sq`` is the root mean square height [unit of length], ``Sdq`` the slope. Loads are p* and the nominal pressure,
    NaN where unknown. Leaks along x and y are in the unit of the card, NaN where the sweep does not reach the load.
    ``table`` has the states of its run along ``step`` and the recorded fields, ``recorded`` the label of the state
    there.
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
class SealLeak(WithParts):
    """The leak of a seal made of patches, and the load that closes it; a number is NaN where it is not known.

    - ``label``: length and width in words
    - ``flow``: axis along which the fluid flows
    - ``patches``: patches in a row along the flow, and side by side
    - ``leak``, ``interval``: leak, and the smallest and largest leak, from 0 where a patch is closed
    - ``unit``: unit of the study, or empty for T* V*³ times length over width
    - ``closing``, ``closing_interval``: load above which the seal is tight; NaN where a patch does not close in its
      sweep
    - ``load_unit``: unit of nominal pressure; empty for p*
    - ``parts``, ``closing_parts``: error budgets of the leak and of the closing load
    - ``words``: how the leak was found, and what is missing
    - ``gas_leak``, ``gas_unit``: leak of the gas of the study; NaN without one
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
    gas_leak: float = math.nan
    gas_unit: str = ""

    def plain(self) -> dict[str, Any]:
        """Return ``leak``, ``tight_above`` and their intervals as plain data: pressures in MPa, None where unknown."""
        to_mpa = convert(1.0, self.load_unit, "MPa") if self.load_unit else math.nan
        numbers = {
            "leak": finite(self.leak),
            "leak_interval": _interval(self.interval),
            "tight_above": finite(self.closing * to_mpa),
            "tight_above_interval": _interval(tuple(end * to_mpa for end in self.closing_interval)),
        }
        if self.gas_unit:
            numbers |= {"gas_leak": finite(self.gas_leak), "gas_leak_unit": self.gas_unit}
        return numbers


@dataclass(frozen=True, eq=False)
class Card:
    """A leak card; units are empty where the study has none.

    ``load`` is in words, as ``pressure=0.5 MPa, leg 2``. ``lifted`` is whether fluid pressure lifts the gap.
    ``warnings`` are limits of the model that the runs exceed.
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
        """Return the known ``mean_pressure`` or ``nominal_pressure`` of surfaces that reach the load of the card."""
        return [load for one in self.surfaces if math.isfinite(load := getattr(one, name))]

    def mean(self, name: str) -> float:
        """Return the mean of an attribute of `SurfaceAtLoad` over the surfaces that have a value; NaN without one."""
        return average(name, [getattr(surface, name) for surface in self.surfaces]).value

    def plain(self) -> dict[str, Any]:
        """Return the card as plain data for JSON: pressures in MPa, None where a number is not known.

        Under fluid pressure the closing is not known.
        """
        to_mpa = convert(1.0, self.pressure_unit, "MPa") if self.pressure_unit else math.nan
        ways = []
        for way in self.ways:
            per_unit = math.nan if self.lifted or not way.closing.unit else convert(1.0, way.closing.unit, "MPa")
            closing = tuple(per_unit * end for end in way.closing.interval)
            ways.append(
                {
                    "axis": way.axis,
                    "leak": finite(way.leak.value),
                    "unit": way.unit or "1",
                    "leak_interval": _interval(way.interval),
                    "closing_pressure": finite(per_unit * way.closing.value),
                    "closing_pressure_interval": _interval(closing),
                    "parts": {part.name: finite(part.factor) for part in way.parts},
                }
            )
        load = {"nominal_pressure": self.mean("nominal_pressure") * to_mpa, "mean_pressure": self.mean("mean_pressure")}
        return {
            "surfaces": [surface.name for surface in self.surfaces],
            "load": {name: finite(value) for name, value in load.items()},
            "ways": ways,
            **({"beside": [leak.plain() for leak in self.beside]} if self.beside else {}),
            **({"seal": self.seal.plain()} if self.seal is not None else {}),
        }


def _interval(ends: tuple[float, ...]) -> list[float] | None:
    return list(ends) if all(map(math.isfinite, ends)) else None
