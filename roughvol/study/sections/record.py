"""The section ``record`` of a study: stored quantities, their states, and the region observed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field

from roughvol.study.plain_data import KeyPath, number_text
from roughvol.study.sections.strict import Choice, Strict, default, optional
from roughvol.study.sections.sweep import IN_WORDS, Select, Selector
from roughvol.study.values.own import Own
from roughvol.study.values.state_kinds import Level
from roughvol.study.values.types import TWO, WHOLE, AreaFraction, Fraction, Many, Positive, Switch, Word, refuse
from roughvol.study.values.units import RISING, In, LengthUnit, Viscosity, convert, in_unit, unit_name, unit_of


def _share(value: Any) -> Any:
    """Return the share of a text as 0.1 %, other values as they are."""
    number = value.strip().removesuffix("%") if isinstance(value, str) and value.strip().endswith("%") else ""
    try:
        return round(float(number) / 100.0, 15)
    except ValueError:
        return value


FlowAccuracy = Annotated[
    float,
    pydantic.BeforeValidator(_share),
    Field(ge=1e-12, le=0.1),
    pydantic.WithJsonSchema(
        {"anyOf": [{"type": "number", "minimum": 1e-12, "maximum": 0.1}, {"type": "string", "pattern": "%"}]}
    ),
]


class BoxCounting(Strict):
    """Box counting of the domains v <= threshold × max(v)."""

    at: Selector = default(Select(), f"states: {IN_WORDS}")
    thresholds: Many[Fraction] = default((0.0, 0.1, 0.25, 0.5, 1.0), "fractions of the largest element volume, 0 to 1")


class VolumeDensity(Strict):
    """The density f(v) of the free volume per element."""

    bins: Annotated[int, Field(ge=1, le=10_000), WHOLE] = default(50, "number of bins, 1 to 10000")
    at: Selector = default(Select(), f"states: {IN_WORDS}")
    include_contact: bool = default(False, "include elements in contact (v = 0): true or false")


class Texture(Strict):
    """The texture before load, and of the deformed surface under load."""

    at: Selector = default(Select(), f"the states under load to take it at: {IN_WORDS}")


class Psd(Strict):
    """The spectrum before load, and of the deformed surface where states are named."""

    at: Selector | None = optional(f"states under load to take it at: {IN_WORDS}; default: before load alone")

    @pydantic.model_serializer
    def _plain(self) -> Any:
        return True if self.at is None else {"at": self.at}


EVERY_STEP = "every-step"


def _tag_states(value: Any) -> str:
    return "<every>" if value == EVERY_STEP else "<states>"


def _named(value: Any) -> Any:
    """Refuse values that name no states."""
    if not isinstance(value, dict | pydantic.BaseModel) and value not in (EVERY_STEP, "last"):
        refuse("must be '{every}', 'last', or levels as {example}", every=EVERY_STEP, example="{pressure: [0.1]}")
    return value


States = Annotated[
    Annotated[Literal["every-step"], pydantic.Tag("<every>")] | Annotated[Selector, pydantic.Tag("<states>")],
    pydantic.Discriminator(_tag_states),
    pydantic.BeforeValidator(_named),
]
_WHEN = f"'{EVERY_STEP}', {IN_WORDS}"


class Transport(Choice):
    """Quantities of the void between the surfaces, each with its states."""

    percolation: States | None = optional(f"percolation, connected and trapped volume, clusters, pockets: {_WHEN}")
    constriction: States | None = optional(f"critical gap and its position, x and y: {_WHEN}")
    transmissivity: States | None = optional(f"flow of a liquid, div(g^3 grad P) = 0, x and y, for leak rates: {_WHEN}")
    quadrants: States | None = optional(f"flow of a liquid through the four quadrants, x and y: {_WHEN}")
    diffusivity: States | None = optional(f"diffusion, div(g grad P) = 0, x and y: {_WHEN}")
    cell_transmissivity: States | None = optional(f"flow of a liquid through an endless periodic plane: {_WHEN}")
    gas_flow: States | None = optional(f"flow of the gas of the section fluid, x and y, also at flux_at: {_WHEN}")
    estimates: States | None = optional(f"both coefficients by effective medium and by single junction: {_WHEN}")
    closing: Annotated[bool | None, pydantic.AfterValidator(lambda given: given or None)] = optional(
        "load at which the last way along x and y closes on loading, solved between the steps or beyond: true or false"
    )
    flux_at: Selector | None = optional(f"flux of a liquid as fields: {IN_WORDS}")
    accuracy: FlowAccuracy | None = optional(
        "allowed relative error of a flow, 1e-12 to 0.1, or as 0.1 %; default: 1e-4"
    )

    @pydantic.model_validator(mode="after")
    def _asks_for_something(self) -> Transport:
        quantities = [name for name in type(self).model_fields if name != "accuracy"]
        if not any(self.named.get(name) for name in quantities):
            refuse("must name at least one of {known}", known=", ".join(quantities))
        return self


Span = Annotated[tuple[Fraction, Fraction], TWO, RISING]


class Region(Strict):
    """A rectangle of the surface, as shares of its sides."""

    x: Span = default((0.0, 1.0), "part [from, to] of axis x over its length, 0 <= from < to <= 1")
    y: Span = default((0.0, 1.0), "part [from, to] of axis y over its length, 0 <= from < to <= 1")

    @property
    def label(self) -> str:
        """Region in words, for datasets."""
        return "x/L_x {} to {}, y/L_y {} to {}".format(*map(number_text, (*self.x, *self.y)))

    def sides(self, along_x: float, along_y: float) -> tuple[float, float]:
        """Return the sides of the rectangle on a surface of these sides."""
        return along_x * (self.x[1] - self.x[0]), along_y * (self.y[1] - self.y[0])


class RegionWidths(Strict):
    """A*, p*, V* and transmissivity inside central squares of several widths, from one solution."""

    shares: Many[AreaFraction] = default(
        (1.0, 0.75, 0.5, 0.25), "widths of the central squares over that of the surface, 0 to 1"
    )
    at: States = Field(default=EVERY_STEP, validate_default=True, description=f"states of A*, p* and V*: {_WHEN}")
    transmissivity: States | None = optional(f"states of the transmissivity, x and y: {_WHEN}")


INTERIOR = (("x", (0.25, 0.75)), ("y", (0.25, 0.75)))  # the central half of each side


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

    @pydantic.model_validator(mode="after")
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


class Record(Strict):
    """Quantities stored beside the numbers of every step."""

    heights: bool = default(False, "store the heights of the undeformed surface: true or false")
    residual_heights: bool = default(False, "store the heights left by plastic displacement, at the end: true or false")
    fields_at: Selector | None = optional(f"gap and pressure as fields: {IN_WORDS}")
    box_counting: BoxCounting | None = optional("box counts and local dimension of the free volume; {}: defaults")
    volume_density: VolumeDensity | None = optional(
        "probability density f(v) of the free volumes of elements; {}: defaults"
    )
    texture: Annotated[Texture | None, Switch()] = optional(
        "texture before load and of the deformed surface (Sa, Ssk, Sku, Sp, Sv, Sz, Svi, Sbi, material "
        "ratio, structure function): true, false or {at: states}"
    )
    psd: Annotated[Psd | None, Switch()] = optional(
        "power spectral density before load and of the deformed surface, root mean square height, slope "
        "and curvature by scale, and Nayak's parameter: true (before load), false or {at: states}"
    )
    contact_perimeter: bool = default(False, "perimeter of the contact at every step, for the corrected contact area")
    transport: Transport | None = optional("ways and flows through the gap, each with its states")
    fluid_pressure: FluidPressure | None = optional("contact under fluid pressure: {inlet: 5 bar, at: states}")
    region: Annotated[Region, Word("interior", INTERIOR)] | None = optional(
        "region of all observables but heights and fields: 'interior' (the central half of each side) or "
        "{x: [from, to], y: [from, to]}; default: the whole surface"
    )
    region_widths: RegionWidths | None = optional("A*, p*, V*, T* in central squares of several widths; {}: defaults")
    dimensional: Dimensional | None = optional("quantities with units: pressure, free_volume, mean_gap, leak_rate …")

    own: Own | None = optional(
        "{name: module:function}: functions of a solved state at every step, or entry points of roughvol.observables"
    )
    all_legs: bool = default(
        False, "false: levels on the first leg that reaches them; true: on every leg, as 'pressure=0.5, leg 2'"
    )

    @property
    def part(self) -> Region | None:
        """The region that is observed; None where it is the whole surface."""
        return None if self.region is None or self.region == Region() else self.region

    @property
    def leak_rate(self) -> LeakRate | None:
        """The liquid whose leak rates are stored."""
        return None if self.dimensional is None else self.dimensional.leak_rate

    @property
    def has_units(self) -> bool:
        """Whether anything but `dimensional` has a unit."""
        if self.fluid_pressure is not None and self.fluid_pressure.has_units:
            return True
        return any(unit_of(level.value) is not None for _, level in self.levels())

    def levels(self) -> Iterator[tuple[KeyPath, Level]]:
        """Yield the steps and levels of quantities, each with its place in the study."""
        for name, value in self:
            if isinstance(value, Select):
                yield from value.placed("record", name)
            elif isinstance(value, Strict):
                for inner, select in value:
                    if isinstance(select, Select):
                        yield from select.placed("record", name, inner)
