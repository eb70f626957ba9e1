"""The section ``fluid`` of a study: a gas, its temperature, and the pressures on both sides of the joint.

The mean free path is that of the viscosity, λ = (μ/p) √(π R T/(2 M)), with molar mass M and gas constant R
(Karniadakis, Beskok & Aluru 2005, Microflows and Nanoflows). λ p is constant at one temperature. The throughput p V̇ is
a flow of volume at the temperature of the gas, times the pressure there; over R T it is a flow of substance. sccm is a
flow of substance: cm³ a minute at 0 °C and 101325 Pa.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from roughvol.errors import meant
from roughvol.study.sections.strict import Strict, default
from roughvol.study.values.types import Positive, refuse
from roughvol.study.values.units import In, Viscosity, convert, counts_substance, in_unit
from roughvol.surfaces.length_units import METRES
from roughvol.tables import table

GAS_CONSTANT = 8.31446261815324  # J/(mol K), exact since 2019
ZERO_CELSIUS = 273.15  # K


class Substance(NamedTuple):
    """A gas: viscosity at a temperature [Pa s, K], Sutherland's constant [K], molar mass [kg/mol].

    μ(T) = μ₀ (T/T₀)^1.5 (T₀ + S)/(T + S).
    """

    viscosity: float
    reference: float
    sutherland: float
    molar_mass: float


SUBSTANCES = {name: Substance(**row) for name, row in table(__file__).items()}
EQUAL = 1e-11  # relative difference of two pressures that are equal: their ratio is kept with 12 digits
LAWS = Literal["kinetic", "slip", "viscous"]


class OwnGas(Strict):
    """A gas by viscosity and molar mass."""

    viscosity: Viscosity = Field(description="dynamic viscosity at the temperature of the gas, > 0, as 18 uPa*s")
    molar_mass: Annotated[Positive, In("molar mass", needed=True)] = Field(description="molar mass, > 0, as 29 g/mol")


def _above_zero(temperature: float) -> float:
    if not (kelvin := in_unit(temperature, "K")) > 0.0:
        refuse("must be above 0 K, is {kelvin} K", kelvin=f"{kelvin:g}")
    return temperature


def _of_ones_own(value: Any) -> str:
    """Return the tag of `OwnGas` for a mapping, else that of a name."""
    return "<own>" if isinstance(value, dict | OwnGas) else "<name>"


def _known(value: Any) -> Any:
    if isinstance(value, str) and value not in SUBSTANCES:
        known = f"{', '.join(SUBSTANCES)}, or a mapping as {{viscosity: 18 uPa*s, molar_mass: 29 g/mol}}"
        near = meant(value, SUBSTANCES)
        refuse("'{gas}' is no known gas{near}; allowed: {known}", gas=value[:40], near=near, known=known)
    return value


class Fluid(Strict):
    """A gas between two pressures; isothermal and ideal."""

    gas: Annotated[
        Annotated[str, Tag("<name>")] | Annotated[OwnGas, Tag("<own>")],
        Discriminator(_of_ones_own),
        BeforeValidator(_known),
    ] = Field(description=f"{', '.join(SUBSTANCES)}, or {{viscosity: 18 uPa*s, molar_mass: 29 g/mol}}")
    inlet: Annotated[Positive, In("pressure", needed=True)] = Field(
        description="absolute pressure on the side of the inlet, > outlet, with its unit as 2 bar"
    )
    outlet: Annotated[float, Field(ge=0), In("pressure", needed=True)] = Field(
        description="absolute pressure on the side of the outlet, >= 0, with its unit as 1 bar; 0 bar: vacuum"
    )
    temperature: Annotated[float, In("temperature", needed=True), AfterValidator(_above_zero)] = Field(
        default="293.15 K", validate_default=True, description="temperature of the gas, > 0 K, as 293 K or 20 degC"
    )
    law: LAWS = default(
        "kinetic",
        "conductance of an element: 'kinetic' (all Knudsen numbers, Fukui & Kaneko 1990), 'slip' "
        "(g^3 + 6 lambda g^2) or 'viscous' (g^3)",
    )

    @model_validator(mode="after")
    def _falls(self) -> Fluid:
        if self.pressures[0] * (1.0 - EQUAL) <= self.pressures[1]:
            refuse(f"inlet must be above outlet, given {self.inlet} and {self.outlet}")
        return self

    @property
    def pressures(self) -> tuple[float, float]:
        """Absolute pressures of inlet and outlet [Pa]."""
        return in_unit(self.inlet, "Pa"), in_unit(self.outlet, "Pa")

    @property
    def kelvin(self) -> float:
        """Temperature [K]."""
        return in_unit(self.temperature, "K")

    @property
    def viscosity(self) -> float:
        """Dynamic viscosity at the temperature [Pa s]."""
        if isinstance(self.gas, OwnGas):
            return in_unit(self.gas.viscosity, "Pa*s")
        viscosity, reference, constant, _ = SUBSTANCES[self.gas]
        return viscosity * (self.kelvin / reference) ** 1.5 * (reference + constant) / (self.kelvin + constant)

    @property
    def molar_mass(self) -> float:
        """Molar mass [kg/mol]."""
        if isinstance(self.gas, OwnGas):
            return in_unit(self.gas.molar_mass, "kg/mol")
        return SUBSTANCES[self.gas].molar_mass

    def mean_free_path(self, pressure: float) -> float:
        """Return λ [m] at a pressure [Pa]."""
        return self.viscosity / pressure * math.sqrt(0.5 * math.pi * GAS_CONSTANT * self.kelvin / self.molar_mass)

    @property
    def label(self) -> str:
        """The gas and its state in words."""
        name = self.gas if isinstance(self.gas, str) else f"gas of {self.gas.viscosity} and {self.gas.molar_mass}"
        return f"{name}, {self.inlet} to {self.outlet}, {self.temperature}"

    def gas_in(self, length_unit: str) -> Gas:
        """Return what the flow through a gap depends on, λ in a unit of length of a study."""
        inlet, outlet = self.pressures
        path = self.mean_free_path(inlet) / METRES[length_unit]
        return Gas(self.law, float(f"{path:.12g}"), float(f"{outlet / inlet:.12g}"))


@dataclass(frozen=True)
class Gas:
    """What the flow of a gas through a gap depends on, over that of viscous flow between plates.

    Attributes
    ----------
    law : kinetic, slip or viscous.
    mean_free_path : at the pressure of the inlet [unit of length of the study].
    outlet : pressure of the outlet over that of the inlet.
    """

    law: str
    mean_free_path: float
    outlet: float


def throughput(value: float, given: str, wanted: str, kelvin: float) -> float:
    """Return a throughput in another unit; sccm, sccs and slpm hold at 0 °C, the others at the temperature of the gas.

    Parameters
    ----------
    value : float
        Throughput in the unit ``given``.
    given, wanted : str
        Units, as mbar*l/s, Pa*m^3/s or sccm.
    kelvin : float
        Temperature of the gas [K].

    Returns
    -------
    float
        Throughput in the unit ``wanted``.
    """
    warm = kelvin / ZERO_CELSIUS
    return convert(value, given, wanted) * warm ** (counts_substance(given) - counts_substance(wanted))
