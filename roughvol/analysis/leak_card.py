"""What a leak card holds: surfaces, loads, leaks along x and y with their errors, closing loads.

The leak is the leak that counts (`leak`), of several surfaces the median with the 16 to 84 % range (`average`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from roughvol.analysis.average import Average, average
from roughvol.analysis.closing import Closing
from roughvol.analysis.parts import Part, WithParts, factors_of
from roughvol.observables.variables import AXES
from roughvol.study import convert
from roughvol.study.plain_data import finite

if TYPE_CHECKING:
    from roughvol.analysis.leak_budget.state import Loaded


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
    """A leak beside the leak that counts, of the dry gap or of a ``gas``, along x and y; no ``unit`` for T* V*³.

    ``intervals`` are those of a gas, by the factors of the leak that counts; NaN where they are not known.
    """

    words: str
    leaks: tuple[Average, ...]
    unit: str
    intervals: tuple[tuple[float, float], ...] = ()

    @property
    def gas(self) -> bool:
        """Whether the leak is that of a gas through the gap that counts."""
        return bool(self.intervals)

    def plain(self) -> dict[str, Any]:
        """Return the leak as plain data for JSON."""
        leaks = {axis: finite(leak.value) for axis, leak in zip(AXES, self.leaks, strict=True)}
        intervals = {f"{axis}_interval": _interval(ends) for axis, ends in zip(AXES, self.intervals, strict=False)}
        return {"words": self.words, **leaks, **intervals, "unit": self.unit or "1"}


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
    - ``gas_leak``, ``gas_interval``, ``gas_unit``: leak of the gas of the study, as that of the liquid; NaN without one
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
    gas_interval: tuple[float, float] = (math.nan, math.nan)

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
            numbers |= {"gas_leak": finite(self.gas_leak), "gas_leak_interval": _interval(self.gas_interval)}
            numbers["gas_leak_unit"] = self.gas_unit
        return numbers


@dataclass(frozen=True, eq=False)
class Card:
    """A leak card; units are empty where the study has none.

    ``load`` is in words, as ``pressure=0.5 MPa, leg 2``. ``lifted`` is whether fluid pressure lifts the gap.
    ``warnings`` are limits of the model that the runs exceed.
    """

    title: str
    load: str
    surfaces: tuple[Loaded, ...]
    pressure_unit: str
    length_unit: str
    ways: tuple[Way, ...]
    beside: tuple[Beside, ...]
    lifted: bool
    warnings: tuple[str, ...]
    seal: SealLeak | None = None

    def loads(self, name: str) -> list[float]:
        """Return the known ``mean_pressure`` or ``nominal_pressure`` of surfaces that reach the load of the card."""
        return [load for surface in self.surfaces if math.isfinite(load := surface.number(name))]

    def mean(self, name: str) -> float:
        """Return the mean of a number of the state over the surfaces that have a value; NaN without one."""
        return average(name, [surface.number(name) for surface in self.surfaces]).value

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


def by_factors(gas: float, leak: float, interval: tuple[float, float]) -> tuple[float, float]:
    """Return the interval of the leak of a gas, by the factors of the leak of a liquid."""
    smaller, larger = factors_of(leak, interval)
    return gas * smaller, gas * larger


def _interval(ends: tuple[float, ...]) -> list[float] | None:
    return list(ends) if all(map(math.isfinite, ends)) else None
