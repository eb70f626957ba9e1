"""The section ``seal``: the seal that the computed surfaces are patches of.

    seal: {length: 120 mm, width: 2 mm}     # flow: x

No case depends on it: a leak card, `ask` and `creep` make the leak of the seal from those of its patches.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from roughvol.errors import DatasetError, Problem, StudyError
from roughvol.study.plain_data import number_text
from roughvol.study.sections.strict import Strict, default
from roughvol.study.values.units import Length, convert, in_unit, unit_of

if TYPE_CHECKING:
    from roughvol.study.sections.material import ContactModulus, YoungPoisson
    from roughvol.study.values.state_kinds import Level

WHOLE = 0.02  # of a patch: a seal shorter by no more is as long as the patch
EVEN = 1.5  # most waves on one side of a patch over those on the other
FEWEST = 1.5  # waves on a side that can be compared: fewer are no roll-off, and their number scatters
MOST_IN_A_ROW = 10**6  # most patches along the flow: from 17 on, every factor 16 doubles the work at least


class Seal(Strict):
    """The seal that the surfaces are patches of: a strip, longer along its line than across it as a rule."""

    length: Length = Field(description="length along the seal line, > 0: in the unit of L, or as 120 mm")
    width: Length = Field(description="width across the seal line, along the flow, > 0: in the unit of L, or as 2 mm")
    flow: Literal["x", "y"] = default("x", "axis of the surfaces along which the fluid flows: x or y")

    @property
    def label(self) -> str:
        """The seal in words, as ``120 mm by 2 mm``."""
        return f"{self.length} by {self.width}"

    def patches(self, sides: tuple[float, float], unit: str | None) -> tuple[int, int]:
        """Return the number of patches in a row along the flow, and side by side, from their sides along x and y."""
        along, across = sides if self.flow == "x" else sides[::-1]
        return max(1, round(in_unit(self.width, unit) / along)), max(1, round(in_unit(self.length, unit) / across))

    def squares(self, unit: str | None) -> float:
        """Return the length over the width; lengths without a unit are in this unit."""
        return float(in_unit(self.length, unit)) / float(in_unit(self.width, unit))

    def overload(
        self, load: Level, sides: tuple[float, float], unit: str | None, material: ContactModulus | YoungPoisson
    ) -> str:
        """Return why a load is too large for a patch, and its pressure on the seal; empty where a patch can carry it.

        A patch, with sides in the unit of length, carries less than its hardness, or E*.
        """
        if load.kind != "load" or not load.value or unit is None or material.unit is None:
            return ""
        on_patch = 1e-6 * in_unit(load.value, "N") / (math.prod(sides) * convert(1.0, unit, "m") ** 2)
        if on_patch < convert(material.indentation_hardness or material.contact_modulus, material.unit, "MPa"):
            return ""
        words = f"{load.label} is the load of a patch, {on_patch:.3g} MPa, which is more than it carries"
        return f"{words}; on the seal of {self.label} it is pressure={self.pressure(load, unit):.3g}MPa"

    def pressure(self, load: Level, unit: str) -> float:
        """Return the pressure of a force on the whole seal [MPa]; lengths without a unit are in this unit."""
        area = in_unit(self.length, unit) * in_unit(self.width, unit) * convert(1.0, unit, "m") ** 2
        return float(1e-6 * in_unit(load.value or 0.0, "N") / area)

    def check(self, sides: tuple[float, float], unit: str | None) -> None:
        """Refuse a seal that is smaller than its patches or far wider, or has a unit where they have none."""
        if problems := [Problem(message, f"seal.{key}") for key, message in self.problems(sides, unit)]:
            raise StudyError(problems)

    def problems(self, sides: tuple[float, float], unit: str | None) -> Iterator[tuple[str, str]]:
        """Yield each key that `check` refuses, with a message."""
        at = "xy".index(self.flow)
        for key, axis, side in (("width", "xy"[at], sides[at]), ("length", "yx"[at], sides[1 - at])):
            given, patch = getattr(self, key), f"{number_text(float(f'{side:.4g}'))} {unit or ''}".strip()
            if unit is None and unit_of(given):
                yield key, f"has a unit ({given}) and L has none: give L with its unit, as L: 100 um"
            elif in_unit(given, unit) < (1.0 - WHOLE) * side:
                allowed = f"at least as much, or record.region as long along {axis} as the seal"
                yield key, f"is {given}, and a patch is {patch} long along {axis}; allowed: {allowed}"
            elif key == "width" and in_unit(given, unit) > MOST_IN_A_ROW * side:
                yield key, f"is {given}; allowed: at most {MOST_IN_A_ROW} patches of {patch} in a row"


def unevenness(waves: Sequence[float]) -> str:
    """Return in words that patches hold more waves along one side than along the other; empty where they do not.

    ``waves`` are mean numbers along x and y. A patch that is shorter than wide, counted in waves, has many ways beside
    each other and closes late. docs/explanation/notes/seal.md has how far seals of such patches are off.
    """
    (few, short), (many, wide) = sorted(zip(waves, "xy", strict=True))
    if few < FEWEST or not many > EVEN * few:
        return ""
    return (
        f"a patch holds {many / few:.2g} times as many waves along {wide} as along {short}: near closing a seal of "
        f"such patches leaks too much along {short} and too little along {wide}; observe {few / many:.2g} of the patch "
        f"along {wide} (record.region)"
    )


def check_alike(sizes: Sequence[Sequence[int]]) -> None:
    """Refuse patches of different shapes: their conductances are not those of one sheet."""
    ratios = [columns / rows for rows, columns in sizes]
    if max(ratios) > (1.0 + WHOLE) * min(ratios):
        words = f"{min(ratios):.3g} to {max(ratios):.3g} times as long along y as along x"
        raise DatasetError(f"a seal takes patches of one shape, and the surfaces are {words}: crop them alike")
