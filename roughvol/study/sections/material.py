"""The section ``material`` of a study: moduli in any unit, hardness in the same or in its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field

from roughvol.study.sections.solver import NamedKernel
from roughvol.study.sections.strict import Strict, default, optional
from roughvol.study.values.units import Conductivity, Length, Pressure, in_unit, unit_of

PoissonRatio = Annotated[float, Field(gt=-1, le=0.5)]
_HARDNESS = "hardness, > 0, in the unit of the modulus, or as 2 GPa: the largest contact pressure; default: elastic"
_PLASTIC = "true: pressures end at the hardness; false: contact is elastic, and the share above the hardness is stored"

Conductivities = Annotated[list[Conductivity], Field(min_length=2, max_length=2)]
_CONDUCTIVITY = "[k1, k2]: conductivities of elastic half spaces, > 0, as [50 W/m/K, 15 W/m/K]: shows the conductance"


class Material(Strict):
    """What both forms of the section have in common."""

    MODULUS: ClassVar[str]
    """Key of the modulus."""

    if TYPE_CHECKING:  # fields of both forms, which follow their moduli
        hardness: float | None = None
        plastic: bool = True

    @property
    def unit(self) -> str | None:
        """Unit of the modulus, None for an arbitrary one."""
        return unit_of(getattr(self, self.MODULUS))

    @property
    def indentation_hardness(self) -> float | None:
        """The hardness in the unit of the modulus."""
        return None if self.hardness is None else in_unit(self.hardness, self.unit)

    @property
    def yields(self) -> bool:
        """Whether pressures end at a hardness."""
        return self.hardness is not None and self.plastic

    def kernel(self, solver: str, length_unit: str | None) -> NamedKernel | None:
        """Return the kernel of a material that has a length, this length in a unit; None for a half space.

        ``solver`` is the kernel of the half space that the material would be without the length.
        """
        return None


class ContactModulus(Material):
    """The material by its contact modulus E*; starred results of elastic contact do not depend on it."""

    MODULUS = "E_star"

    E_star: Pressure = default(1.0, "contact modulus E/(1-nu^2), > 0, as 1 or 100 GPa")
    hardness: Pressure | None = optional(_HARDNESS)
    plastic: bool = default(True, _PLASTIC)
    conductivity: Conductivities | None = optional(_CONDUCTIVITY)

    @property
    def contact_modulus(self) -> float:
        """E*, in the unit of the study."""
        return float(self.E_star)


class CounterMaterial(Strict):
    """The material of the second of two elastic bodies."""

    E: Pressure = Field(description="Young's modulus of the other body, > 0, in the unit of the first, or as 3 GPa")
    nu: PoissonRatio = Field(description="Poisson's ratio of the other body, -1 < nu <= 0.5")


class YoungPoisson(Material):
    """The material by Young's modulus and Poisson's ratio, against a rigid plane or another elastic body."""

    MODULUS = "E"

    E: Pressure = Field(description="Young's modulus, > 0, as 1 or 210 GPa")
    nu: PoissonRatio = Field(description="Poisson's ratio, -1 < nu <= 0.5")
    against: CounterMaterial | None = optional("{E, nu} of the other: 1/E* = (1-nu^2)/E + (1-nu2^2)/E2; default: rigid")
    thickness: Length | None = optional(
        "thickness of an elastic layer bonded to a rigid base, > 0, as 50 um; default: a half space"
    )
    hardness: Pressure | None = optional(_HARDNESS)
    plastic: bool = default(True, _PLASTIC)
    conductivity: Conductivities | None = optional(_CONDUCTIVITY)

    @property
    def contact_modulus(self) -> float:
        """E* in the unit of the study: 1/E* = (1-ν²)/E, plus (1-ν₂²)/E₂ of another elastic body."""
        own = float(self.E) / (1 - self.nu**2)
        if self.against is None:
            return own
        other = float(in_unit(self.against.E, self.unit)) / (1 - self.against.nu**2)
        return 1 / (1 / own + 1 / other)

    def kernel(self, solver: str, length_unit: str | None) -> NamedKernel | None:
        """Return the kernel of a layer; None for a half space."""
        if self.thickness is None:
            return None
        thickness = ("thickness", in_unit(self.thickness, length_unit))
        return NamedKernel("layer", (thickness,), (("nu", self.nu), ("elements", float(solver == "love"))))


def tag_material(value: Any) -> str:
    """Return the tag of `YoungPoisson` if E or nu is given, else that of `ContactModulus`."""
    young = {"E", "nu"} & value.keys() if isinstance(value, dict) else isinstance(value, YoungPoisson)
    return "<young>" if young else "<modulus>"
