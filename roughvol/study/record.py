"""The section ``record`` of a study: stored quantities, their states, and the region observed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal, get_args, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic_core import core_schema

from roughvol.study.sections import (
    AreaFraction,
    Choice,
    Fraction,
    Level,
    Many,
    Positive,
    StepNumber,
    Strict,
    Whole,
    Word,
    refuse,
)
from roughvol.study.units import In, UnitOf, convert, in_unit, unit_of
from roughvol.study.yaml_text import number_text


class Select(Choice):
    """States to record: the last one, steps, or levels.

    Fields, densities and box counts are those of the state at the level, solved for them. Quantities along the steps
    are those of the first step at the level or beyond it.
    """

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    step: Many[StepNumber] = Field(default_factory=tuple, description="step numbers, from 1 to sweep.steps")
    contact_area: Many[AreaFraction] = Field(default_factory=tuple, description="levels of A*, 0 < A* <= 1")
    pressure: Many[Positive] = Field(default_factory=tuple, description="levels of p* > 0")
    separation: Many[float] = Field(default_factory=tuple, description="levels of d/σ, reached from above")
    indentation: Many[Positive] = Field(default_factory=tuple, description="levels of Δ/σ > 0")
    free_volume: Many[Positive] = Field(default_factory=tuple, description="levels of V* > 0, reached from above")

    @model_serializer
    def _plain(self) -> Any:
        return {kind: list(values) for kind, values in self.named.items()} or "last"

    @property
    def levels(self) -> tuple[Level, ...]:
        """Levels, kind by kind; ``Level("last")`` without any."""
        levels = (Level(kind, value) for kind, values in self.named.items() for value in values)
        return tuple(levels) or (Level("last"),)


Selector = Annotated[Select, Word("last")]
_STATES = "'last', or levels of step, contact_area, pressure, separation, indentation, free_volume"


class BoxCounting(Strict):
    """Box counting of the domains v <= threshold × max(v)."""

    at: Selector = Field(default=Select(), description=f"states: {_STATES}")
    thresholds: Many[Fraction] = Field(
        default=(0.0, 0.1, 0.25, 0.5, 1.0), description="fractions of the largest element volume, 0 to 1; a list"
    )


class VolumeDensity(Strict):
    """The density f(v) of the free volume per element."""

    bins: Annotated[Whole, Field(ge=1, le=10_000)] = Field(default=50, description="number of bins, 1 to 10000")
    at: Selector = Field(default=Select(), description=f"states: {_STATES}")
    include_contact: bool = Field(default=False, description="include elements in contact (v = 0): true or false")


class Switch:
    """Accept true for the defaults of a mapping and false for nothing, and show both in the JSON schema."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(self._spelled_out, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"type": "boolean"}, handler(schema["schema"])]}

    @staticmethod
    def _spelled_out(value: Any) -> Any:
        if isinstance(value, bool):
            return {} if value else None
        if not isinstance(value, dict | BaseModel | None):
            refuse("must be true, false or a mapping (key: value)")
        return value


class Texture(Strict):
    """The texture before load, and of the deformed surface under load."""

    at: Selector = Field(default=Select(), description=f"the states under load to take it at: {_STATES}")


EVERY_STEP = "every-step"


def _tag_states(value: Any) -> str:
    return "<every>" if value == EVERY_STEP else "<states>"


States = Annotated[
    Annotated[Literal["every-step"], Tag("<every>")] | Annotated[Selector, Tag("<states>")], Discriminator(_tag_states)
]
_WHEN = f"'{EVERY_STEP}', {_STATES}"


class Transport(Choice):
    """Quantities of the void between the surfaces, each with its states."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    percolation: States | None = Field(
        default=None, description=f"percolation, connected and trapped volume, clusters, pockets: {_WHEN}"
    )
    constriction: States | None = Field(default=None, description=f"critical gap and its position, x and y: {_WHEN}")
    transmissivity: States | None = Field(default=None, description=f"flow of div(g^3 grad P) = 0, x and y: {_WHEN}")
    diffusivity: States | None = Field(default=None, description=f"flow of div(g grad P) = 0, x and y: {_WHEN}")
    cell_transmissivity: States | None = Field(
        default=None,
        description=f"flow of div(g^3 grad P) = 0 through the endless plane of a periodic surface: {_WHEN}",
    )
    estimates: States | None = Field(
        default=None, description=f"both coefficients by effective medium and by single junction: {_WHEN}"
    )
    flux_at: Selector | None = Field(default=None, description=f"flux of div(g^3 grad P) = 0 as fields: {_STATES}")

    @model_validator(mode="after")
    def _asks_for_something(self) -> Transport:
        if not self.named:
            refuse("must name at least one of {known}", known=", ".join(type(self).model_fields))
        return self


class Region(Strict):
    """A rectangle of the surface, as shares of its sides."""

    x: tuple[Fraction, Fraction] = Field(
        default=(0.0, 1.0), description="[from, to] along the first axis over its length, 0 <= from < to <= 1"
    )
    y: tuple[Fraction, Fraction] = Field(
        default=(0.0, 1.0), description="[from, to] along the second axis over its length, 0 <= from < to <= 1"
    )

    @field_validator("x", "y", mode="before")
    @classmethod
    def _two(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple) or len(value) != 2:
            refuse("must be two numbers, [from, to]")
        return tuple(value)

    @field_validator("x", "y")
    @classmethod
    def _rising(cls, value: tuple[float, float]) -> tuple[float, float]:
        if value[0] >= value[1]:
            refuse("must rise, from < to")
        return value

    @property
    def label(self) -> str:
        """Region in words, for datasets."""
        return "x/L_x {} to {}, y/L_y {} to {}".format(*map(number_text, (*self.x, *self.y)))


class RegionWidths(Strict):
    """A*, p*, V* and transmissivity inside central squares of several widths, from one solution."""

    shares: Many[AreaFraction] = Field(
        default=(1.0, 0.75, 0.5, 0.25),
        description="widths of the central squares over that of the surface, 0 to 1",
    )
    at: States = Field(default=EVERY_STEP, validate_default=True, description=f"states of A*, p* and V*: {_WHEN}")
    transmissivity: States | None = Field(default=None, description=f"states of the transmissivity, x and y: {_WHEN}")


class LeakRate(Strict):
    """Volume flow of an incompressible liquid through the gap: pressure drop, viscosity, unit."""

    pressure_drop: Annotated[Positive, In("pressure", needed=True)] = Field(
        description="pressure difference between two sides of the region, > 0, with its unit as 1 bar"
    )
    viscosity: Annotated[Positive, In("viscosity", needed=True)] = Field(
        description="dynamic viscosity, > 0, with its unit as 1 mPa*s"
    )
    unit: Annotated[str, UnitOf("flow")] = Field(default="mm^3/s", description="unit of the leak rate, as mm^3/s")

    @property
    def drive(self) -> float:
        """ΔP/μ times 1 m³, in the unit of the leak rate."""
        drop, viscosity = in_unit(self.pressure_drop, "Pa"), in_unit(self.viscosity, "Pa*s")
        assert drop is not None
        assert viscosity is not None
        return convert(drop / viscosity, "m^3/s", self.unit)


class Dimensional(Choice):
    """Quantities stored with a unit beside the starred value. They need no further solution."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    pressure: Annotated[str, UnitOf("pressure")] | None = Field(
        default=None, description="store the nominal contact pressure p* E* Sq/L in this unit, as MPa"
    )
    free_volume: Annotated[str, UnitOf("volume per area")] | None = Field(
        default=None, description="store the free volume over the nominal area in this unit, as mm^3/m^2"
    )
    mean_gap: Annotated[str, UnitOf("length")] | None = Field(
        default=None, description="store the mean gap V* Sq in this unit, as um"
    )
    separation: Annotated[str, UnitOf("length")] | None = Field(
        default=None, description="store the separation d of the mean planes in this unit, as um"
    )
    critical_gap: Annotated[str, UnitOf("length")] | None = Field(
        default=None, description="store the critical gaps along x and y in this unit, as um"
    )
    leak_rate: LeakRate | None = Field(
        default=None, description="store the leak rates along x and y: {pressure_drop: 1 bar, viscosity: 1 mPa*s, unit}"
    )

    @model_validator(mode="after")
    def _asks_for_something(self) -> Dimensional:
        if not self.named:
            refuse("must name at least one of {known}", known=", ".join(type(self).model_fields))
        return self


class FluidPressure(Strict):
    """Pressure of a fluid that lifts the surfaces: contact and flow at the load of a state, along x and y."""

    inlet: Annotated[Positive, In("pressure")] = Field(
        description="fluid pressure at the inlet, > 0, over that around: in the unit of p*, or as 5 bar"
    )
    outlet: Annotated[float, Field(ge=0), In("pressure")] = Field(
        default=0.0, description="fluid pressure at the outlet, 0 <= outlet < inlet: in the unit of p*, or as 1 bar"
    )
    coupling: Literal["one-way", "full"] = Field(
        default="full",
        description="'one-way': the fluid pressure of the dry gap changes the gap once; 'full': until gap and fluid "
        "pressure agree",
    )
    at: Selector = Field(default=Select(), description=f"states, each at its load: {_STATES}")

    @model_validator(mode="after")
    def _falls(self) -> FluidPressure:
        units = {unit_of(self.inlet) is None, unit_of(self.outlet) is None}
        outlet: float | None = self.outlet
        if len(units) > 1 and self.outlet != 0.0:
            refuse("inlet and outlet: give both with a unit, or none")
        if unit_of(self.outlet) is not None:
            outlet = in_unit(self.outlet, unit_of(self.inlet))
        if outlet is not None and outlet >= self.inlet:
            refuse("the outlet must be below the inlet")
        return self

    @property
    def has_units(self) -> bool:
        """Whether the pressures have a unit."""
        return unit_of(self.inlet) is not None


INTERIOR = (("x", (0.25, 0.75)), ("y", (0.25, 0.75)))  # the central half of each side


class Record(Strict):
    """Quantities stored beside the numbers of every step."""

    heights: bool = Field(default=False, description="store the heights: true or false")
    residual_heights: bool = Field(
        default=False, description="store the heights left by plastic displacement, at the end: true or false"
    )
    fields_at: Selector | None = Field(default=None, description=f"gap and pressure as fields: {_STATES}")
    box_counting: BoxCounting | None = Field(default=None, description="box counting; {}: defaults")
    volume_density: VolumeDensity | None = Field(
        default=None, description="density of the element volumes; {}: defaults"
    )
    texture: Annotated[Texture | None, Switch()] = Field(
        default=None,
        description="texture before load and of the deformed surface (Sa, Ssk, Sku, Sp, Sv, Sz, Svi, Sbi, material "
        "ratio, structure function): true, false or {at: states}",
    )
    psd: bool = Field(
        default=False,
        description="power spectral density of the undeformed surface, root mean square height, slope and curvature by "
        "scale, and Nayak's parameter: true or false",
    )
    transport: Transport | None = Field(
        default=None,
        description="quantities of the void, each with its states",
    )
    fluid_pressure: FluidPressure | None = Field(
        default=None, description="contact under the pressure of a fluid in its gap: {inlet: 5 bar, at: states}"
    )
    region: Annotated[Region, Word("interior", INTERIOR)] | None = Field(
        default=None,
        description="region of all observables but heights and fields: 'interior' (the central half of each side) or "
        "{x: [from, to], y: [from, to]}; default: the whole surface",
    )
    region_widths: RegionWidths | None = Field(
        default=None,
        description="A*, p*, V* and transmissivity of central squares of several widths; {}: defaults",
    )
    dimensional: Dimensional | None = Field(
        default=None, description="quantities stored with units too: pressure, free_volume, mean_gap, leak_rate …"
    )

    @model_validator(mode="after")
    def _one_drop(self) -> Record:
        fluid, leak = self.fluid_pressure, self.dimensional.leak_rate if self.dimensional else None
        if fluid is not None and leak is not None and fluid.has_units:
            inlet, outlet, drop = (in_unit(value, "Pa") for value in (fluid.inlet, fluid.outlet, leak.pressure_drop))
            if abs((inlet or 0.0) - (outlet or 0.0) - (drop or 0.0)) > 1e-6 * (drop or 0.0):
                refuse(
                    "fluid_pressure: inlet - outlet must equal dimensional.leak_rate.pressure_drop, {drop}",
                    drop=str(leak.pressure_drop),
                )
        return self

    @property
    def has_units(self) -> bool:
        """Whether anything but `dimensional` has a unit."""
        return self.fluid_pressure is not None and self.fluid_pressure.has_units


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the records that an annotation holds, in unions and behind ``Annotated``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models(argument)


def _selectors() -> Iterator[tuple[str, ...]]:
    """Yield the path of every key of `Record` that selects states."""
    for name, annotation in get_type_hints(Record, include_extras=True).items():
        for model in _models(annotation):
            if issubclass(model, Select):
                yield (name,)
                continue
            for inner, hint in get_type_hints(model, include_extras=True).items():
                if any(issubclass(part, Select) for part in _models(hint)):
                    yield name, inner


SELECTORS = tuple(_selectors())
"""Paths of the keys of the section ``record`` that select states."""
