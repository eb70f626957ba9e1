"""The section ``material`` of a study: moduli in any unit, hardness in the same or in its own."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from roughvol.study.sections.strict import Strict
from roughvol.study.values.units import Conductivity, Pressure, in_unit, unit_of

PoissonRatio = Annotated[float, Field(gt=-1, le=0.5)]
_HARDNESS = "hardness, > 0, in the unit of the modulus, or as 2 GPa: the largest contact pressure; default: elastic"
_PLASTIC = "true: pressures end at the hardness; false: contact is elastic, and the share above the hardness is stored"

Conductivities = Annotated[list[Conductivity], Field(min_length=2, max_length=2)]
_CONDUCTIVITY = "[k1, k2]: heat conductivities of both bodies, > 0, as [50 W/m/K, 15 W/m/K]: shows the conductance"


class ContactModulus(Strict):
    """The material by its contact modulus E*; starred results of elastic contact do not depend on it."""

    E_star: Pressure = Field(default=1.0, description="contact modulus E/(1-nu^2), > 0, as 1 or 100 GPa")
    hardness: Pressure | None = Field(default=None, description=_HARDNESS)
    plastic: bool = Field(default=True, description=_PLASTIC)
    conductivity: Conductivities | None = Field(default=None, description=_CONDUCTIVITY)

    @property
    def contact_modulus(self) -> float:
        """E*, in the unit of the study."""
        return float(self.E_star)

    @property
    def unit(self) -> str | None:
        """Unit of the contact modulus, None for an arbitrary one."""
        return unit_of(self.E_star)

    @property
    def indentation_hardness(self) -> float | None:
        """The hardness in the unit of the modulus."""
        return in_unit(self.hardness, self.unit)


class CounterMaterial(Strict):
    """The material of the second of two elastic bodies."""

    E: Pressure = Field(description="Young's modulus of the other body, > 0, in the unit of the first, or as 3 GPa")
    nu: PoissonRatio = Field(description="Poisson's ratio of the other body, -1 < nu <= 0.5")


class YoungPoisson(Strict):
    """The material by Young's modulus and Poisson's ratio, against a rigid plane or another elastic body."""

    E: Pressure = Field(description="Young's modulus, > 0, as 1 or 210 GPa")
    nu: PoissonRatio = Field(description="Poisson's ratio, -1 < nu <= 0.5")
    against: CounterMaterial | None = Field(
        default=None, description="{E, nu} of the other body: 1/E* = (1-nu^2)/E + (1-nu2^2)/E2; default: rigid"
    )
    hardness: Pressure | None = Field(default=None, description=_HARDNESS)
    plastic: bool = Field(default=True, description=_PLASTIC)
    conductivity: Conductivities | None = Field(default=None, description=_CONDUCTIVITY)

    @property
    def contact_modulus(self) -> float:
        """E* in the unit of the study: 1/E* = (1-ν²)/E, plus (1-ν₂²)/E₂ of another elastic body."""
        own = float(self.E) / (1 - self.nu**2)
        if self.against is None:
            return own
        E, nu = in_unit(self.against.E, self.unit), self.against.nu
        assert E is not None
        other = float(E) / (1 - nu**2)
        return 1 / (1 / own + 1 / other)

    @property
    def unit(self) -> str | None:
        """Unit of the contact modulus, None for an arbitrary one."""
        return unit_of(self.E)

    @property
    def indentation_hardness(self) -> float | None:
        """The hardness in the unit of the modulus."""
        return in_unit(self.hardness, self.unit)


def tag_material(value: Any) -> str:
    """Return the tag of `YoungPoisson` if E or nu is given, else that of `ContactModulus`."""
    young = {"E", "nu"} & value.keys() if isinstance(value, dict) else isinstance(value, YoungPoisson)
    return "<young>" if young else "<modulus>"
