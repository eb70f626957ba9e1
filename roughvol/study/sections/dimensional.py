"""What `record` has with units: numbers stored in a unit, and the pressure of a fluid in the gap."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from roughvol.study.sections.strict import Choice, Strict, default, optional
from roughvol.study.sections.sweep import IN_WORDS, Select, Selector
from roughvol.study.values.types import Positive, refuse
from roughvol.study.values.units import In, LengthUnit, Viscosity, convert, in_unit, unit_name, unit_of


class LeakRate(Strict):
    """Volume flow of an incompressible liquid through the gap: pressure drop, viscosity, unit."""

    pressure_drop: Annotated[Positive, In("pressure", needed=True)] = Field(
        description="pressure difference between two sides of the region, > 0, with its unit as 1 bar"
    )
    viscosity: Viscosity = Field(description="dynamic viscosity, > 0, with its unit as 1 mPa*s")
    unit: Annotated[str, unit_name("flow")] = default("mm^3/s", "unit of the leak rate, as mm^3/s")

    @property
    def drive(self) -> float:
        """ΔP/μ times 1 m³, in the unit of the leak rate."""
        return convert(self.rate, "m^3/s", self.unit)

    @property
    def rate(self) -> float:
        """ΔP/μ [1/s]."""
        return in_unit(self.pressure_drop, "Pa") / in_unit(self.viscosity, "Pa*s")


class Dimensional(Choice):
    """Quantities stored with a unit beside the starred value. They need no further solution."""

    EMPTY = "must name at least one of {known}"

    pressure: Annotated[str, unit_name("pressure")] | None = optional(
        "store the nominal contact pressure p* E* Sq/L in this unit, as MPa"
    )
    free_volume: Annotated[str, unit_name("volume per area")] | None = optional(
        "store the free volume over the nominal area in this unit, as mm^3/m^2"
    )
    mean_gap: LengthUnit | None = optional("store the mean gap V* Sq in this unit, as um")
    separation: LengthUnit | None = optional("store the separation d of the mean planes in this unit, as um")
    critical_gap: LengthUnit | None = optional("store the critical gaps along x and y in this unit, as um")
    leak_rate: LeakRate | None = optional(
        "leak rates along x and y, of transport.transmissivity: {pressure_drop: 1 bar, viscosity: 1 mPa*s, unit}"
    )
    gas_leak_rate: Annotated[str, unit_name("throughput")] | None = optional(
        "store the leak rates of the gas (section fluid) in this unit, as mbar*l/s or sccm"
    )


class FluidPressure(Strict):
    """Pressure of a fluid that lifts the surfaces: contact and flow at the load of a state, along x and y."""

    inlet: Annotated[Positive, In("pressure")] = Field(
        description="fluid pressure at the inlet, > 0, over that around: in the unit of p*, or as 5 bar"
    )
    outlet: Annotated[float, Field(ge=0), In("pressure")] = default(
        0.0, "fluid pressure at the outlet, 0 <= outlet < inlet: in the unit of p*, or as 1 bar"
    )
    coupling: Literal["one-way", "full"] = default(
        "full",
        "'one-way': the fluid pressure of the dry gap changes the gap once; 'full': until gap and pressure agree",
    )
    at: Selector = default(Select(), f"states, each at its load: {IN_WORDS}")
    fields: bool = default(False, "store the lifted gaps, fluid_gap: true or false")

    @model_validator(mode="after")
    def _falls(self) -> FluidPressure:
        if (unit_of(self.inlet) is None) != (unit_of(self.outlet) is None) and self.outlet != 0.0:
            refuse("inlet and outlet: give both with a unit, or none")
        if in_unit(self.outlet, unit_of(self.inlet)) >= self.inlet:
            refuse(f"inlet must be above outlet, given {self.inlet} and {self.outlet}")
        return self

    @property
    def has_units(self) -> bool:
        """Whether the pressures have a unit."""
        return unit_of(self.inlet) is not None
